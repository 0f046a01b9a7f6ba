//! Kind of a file, by its first bytes.

use std::borrow::Cow;
use std::path::Path;

use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};

use super::format::SplatFormat;
use super::read::{SPZ, ZIP, first_bytes, read_all};
use super::{bake, cameras, decode, gltf, ksplat, lut, sog, splat, spz};
use crate::error::{Error, Result};

/// Kind of a file, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// A splat, of that format.
    Splat(SplatFormat),
    /// A Radiance .hdr environment.
    Hdr,
    /// An OpenEXR environment.
    Exr,
    /// A PNG or JPEG picture.
    Picture,
    /// A saved bake.
    Bake,
    /// A saved look (JSON).
    Look,
    /// Lights of one's own (JSON).
    Rig,
    /// A table of colours (.cube).
    Lut,
    /// Cameras (JSON, or a COLMAP model).
    Cameras,
}

impl FileKind {
    /// True for a splat.
    pub fn is_splat(self) -> bool {
        matches!(self, Self::Splat(_))
    }

    /// Name where something else is expected.
    pub fn called(self) -> &'static str {
        match self {
            Self::Splat(_) => "a splat",
            Self::Hdr | Self::Exr | Self::Picture => "an image",
            Self::Bake => "a bake",
            Self::Look => "a look",
            Self::Rig => "a rig of lights",
            Self::Lut => "a LUT (for --lut)",
            Self::Cameras => "a file of cameras (--cameras takes it)",
        }
    }

    /// True where it may be an environment.
    pub fn is_environment(self) -> bool {
        matches!(self, Self::Hdr | Self::Exr | Self::Picture)
    }
}

/// As many first bytes are looked at.
const START: u64 = 512;

/// File that a splat is read from: the path itself, or in a folder the file that describes it.
pub fn file_of(path: &Path) -> Cow<'_, Path> {
    let inside = path.join(sog::META);
    if path.is_dir() && inside.is_file() {
        inside.into()
    } else {
        path.into()
    }
}

/// Begins what is said of a file that nothing here opens.
pub(super) const UNKNOWN: &str = "its content is of no kind that this program knows";

/// Looks at the first bytes of a file; of text in JSON at what it holds.
///
/// # Errors
/// The file cannot be read, is empty, or is of no kind that this program opens.
pub fn file_kind(path: &Path) -> Result<FileKind> {
    if cameras::is_colmap(path) || path.is_dir() && cameras::file_in(path).is_some() {
        return Ok(FileKind::Cameras);
    }
    let path = &*file_of(path);
    let (start, file_bytes) = first_bytes(path, START)?;
    if start.is_empty() {
        return Err(Error::invalid(path, "the file is empty"));
    }
    let bom = "\u{feff}".as_bytes();
    let start = start.strip_prefix(bom).unwrap_or(&start);
    Ok(match start {
        [b'p', b'l', b'y', after @ ..] if after.first().is_none_or(u8::is_ascii_whitespace) => {
            // The first element that a header names.
            let is_packed = start.windows(14).any(|w| w == b"element chunk ");
            FileKind::Splat(match is_packed {
                true => SplatFormat::CompressedPly,
                false => SplatFormat::Ply,
            })
        }
        _ if start.starts_with(b"#?") => FileKind::Hdr,
        _ if start.starts_with(&[0x76, 0x2f, 0x31, 0x01]) => FileKind::Exr,
        _ if start.starts_with(b"\x89PNG") || start.starts_with(&[0xff, 0xd8, 0xff]) => {
            FileKind::Picture
        }
        _ if start.starts_with(bake::ANY_MAGIC) => FileKind::Bake,
        _ if start.starts_with(SPZ) || start.starts_with(spz::GZIP) => {
            FileKind::Splat(SplatFormat::Spz)
        }
        // Of other archives that is what is in them.
        _ if start.starts_with(ZIP) => FileKind::Splat(SplatFormat::Sog),
        _ if start.starts_with(gltf::MAGIC) => FileKind::Splat(SplatFormat::Gltf),
        _ if start.trim_ascii_start().starts_with(b"{") => kind_of_json(path)?,
        _ if cameras::begins_as_list(start) => FileKind::Cameras,
        _ if lut::begins_as_one(start) => FileKind::Lut,
        // These may begin with any comment.
        _ if lut::begins_as_text(start) && is_named(path, "cube") => FileKind::Lut,
        _ if is_named(path, "json") => {
            let message = "no look: that is a JSON object, and begins with \"{\"";
            return Err(Error::invalid(path, message));
        }
        _ if ksplat::begins_as_one(start) => FileKind::Splat(SplatFormat::Ksplat),
        _ if splat::begins_as_one(start, file_bytes) => FileKind::Splat(SplatFormat::Splat),
        _ => {
            let what = match start {
                _ if start.starts_with(b"PXR-USDC") || start.starts_with(b"#usda") => {
                    "a USD scene, which is not read; save its splat as PLY, SPZ or glTF"
                }
                _ => UNKNOWN,
            };
            return Err(Error::invalid(
                path,
                format!(
                    "{what}; what opens: splats (.ply, .spz, .sog, .splat, .ksplat, .glb, .gltf), environments (.hdr, .exr, .png, .jpg), bakes, looks, rigs, cameras and LUTs (.cube)"
                ),
            ));
        }
    })
}

/// Refuses a file that is known to be something else than a text in JSON, where `what` is expected.
pub(super) fn expect_json(path: &Path, what: &str) -> Result<()> {
    match file_kind(path) {
        Ok(FileKind::Look | FileKind::Rig | FileKind::Cameras) => Ok(()),
        Ok(other) => {
            let why = format!("{}, where {what} is expected", other.called());
            Err(Error::invalid(path, why))
        }
        Err(error @ Error::Io { .. }) => Err(error),
        // Its own reader says what is wrong.
        Err(_) => Ok(()),
    }
}

/// Keys that a text in JSON is known by; what has none of the others is a look, or nothing.
#[derive(Default, Deserialize)]
#[serde(default)]
struct Known {
    asset: Option<IgnoredAny>,
    meshes: Option<IgnoredAny>,
    means: Option<IgnoredAny>,
    quats: Option<IgnoredAny>,
    frames: Option<IgnoredAny>,
    #[serde(deserialize_with = "named")]
    lights: bool,
    #[serde(deserialize_with = "named")]
    environment: bool,
    version: Option<IgnoredAny>,
    #[serde(rename = "lodLevels")]
    lod_levels: Option<u64>,
    filenames: Vec<String>,
}

/// True where the key is there, be it as `null`.
fn named<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<bool, D::Error> {
    IgnoredAny::deserialize(from).map(|_| true)
}

fn kind_of_json(path: &Path) -> Result<FileKind> {
    let text = read_all(path, gltf::MAX_FILE_BYTES)?;
    Ok(match decode::json(&text) {
        Ok(Known {
            means: Some(_),
            quats: Some(_),
            ..
        }) => FileKind::Splat(SplatFormat::Sog),
        Ok(Known {
            asset: Some(_),
            meshes: Some(_),
            ..
        }) => FileKind::Splat(SplatFormat::Gltf),
        Ok(Known {
            lod_levels: Some(levels),
            filenames,
            ..
        }) => {
            let part = filenames.first().map_or("0_0/meta.json", String::as_str);
            return Err(Error::invalid(
                path,
                format!(
                    "a streamed SOG splat of {levels} levels of detail in {} parts, which is not read as a whole; open one of its parts, such as {part}",
                    filenames.len()
                ),
            ));
        }
        Ok(Known {
            frames: Some(_), ..
        }) => FileKind::Cameras,
        // Looks that have lights have a version, too.
        Ok(Known {
            version: None,
            lights,
            environment,
            ..
        }) if lights || environment => FileKind::Rig,
        // Meant to be one, good or not.
        Err(_) if cameras::has_poses(&text) => FileKind::Cameras,
        _ => FileKind::Look,
    })
}

fn is_named(path: &Path, ending: &str) -> bool {
    let extension = path.extension();
    extension.is_some_and(|e| e.eq_ignore_ascii_case(ending))
}
