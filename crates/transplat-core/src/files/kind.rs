//! What a file is, by its first bytes.

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

use serde::de::IgnoredAny;
use serde::{Deserialize, Deserializer};

use super::format::SplatFormat;
use super::read::{open, read_all};
use super::{bake, gltf, ksplat, lut, sog, splat, spz};
use crate::error::{Error, Result};

/// What a file is, by its first bytes.
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
}

impl FileKind {
    /// Whether it is a splat.
    pub fn is_splat(self) -> bool {
        matches!(self, Self::Splat(_))
    }

    /// Whether it may be an environment.
    pub fn is_environment(self) -> bool {
        matches!(self, Self::Hdr | Self::Exr | Self::Picture)
    }
}

/// As many first bytes are looked at.
const START: u64 = 512;

/// What a splat is read from: the file itself, or where a folder is one the file in it that says so.
pub fn file_of(path: &Path) -> Cow<'_, Path> {
    let inside = path.join(sog::META);
    if path.is_dir() && inside.is_file() {
        inside.into()
    } else {
        path.into()
    }
}

/// Looks at the first bytes of a file; of text in JSON at what it holds.
///
/// # Errors
/// The file cannot be read, is empty, or is of no kind that this program opens.
pub fn file_kind(path: &Path) -> Result<FileKind> {
    let path = &*file_of(path);
    let file = open(path)?;
    let file_bytes = file.metadata().map_err(Error::io(path))?.len();
    let mut start = Vec::new();
    let read = file.take(START).read_to_end(&mut start);
    read.map_err(Error::io(path))?;
    if start.is_empty() {
        return Err(Error::invalid(path, "the file is empty"));
    }
    Ok(match &start[..] {
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
        _ if start.starts_with(spz::MAGIC) || start.starts_with(spz::GZIP) => {
            FileKind::Splat(SplatFormat::Spz)
        }
        _ if start.starts_with(sog::ZIP) && sog::is_bundle(path) => {
            FileKind::Splat(SplatFormat::Sog)
        }
        _ if start.starts_with(gltf::MAGIC) => FileKind::Splat(SplatFormat::Gltf),
        _ if start.trim_ascii_start().starts_with(b"{") => kind_of_json(path)?,
        _ if lut::begins_as_one(&start) => FileKind::Lut,
        // These may begin with any comment.
        _ if lut::begins_as_text(&start) && is_named(path, "cube") => FileKind::Lut,
        _ if is_named(path, "json") => {
            let message = "no look: that is a JSON object, and begins with \"{\"";
            return Err(Error::invalid(path, message));
        }
        _ if ksplat::begins_as_one(&start) => FileKind::Splat(SplatFormat::Ksplat),
        _ if splat::begins_as_one(&start, file_bytes) => FileKind::Splat(SplatFormat::Splat),
        _ => {
            let what = match &start[..] {
                _ if start.starts_with(sog::ZIP) => {
                    "a zip archive without the meta.json of a SOG splat"
                }
                _ if start.starts_with(b"PXR-USDC") || start.starts_with(b"#usda") => {
                    "a USD scene, which is not read; save its splat as PLY, SPZ or glTF"
                }
                _ => "its content is of no kind that this program knows",
            };
            return Err(Error::invalid(
                path,
                format!(
                    "{what}; it opens splats (.ply, .spz, .sog, .splat, .ksplat, .glb, .gltf), environments (.hdr, .exr, .png, .jpg), bakes, looks, rigs of lights and tables of colours (.cube)"
                ),
            ));
        }
    })
}

/// What a text in JSON is known by; what is none of the others is a look, or nothing.
#[derive(Deserialize)]
struct Known {
    asset: Option<IgnoredAny>,
    meshes: Option<IgnoredAny>,
    means: Option<IgnoredAny>,
    quats: Option<IgnoredAny>,
    #[serde(default, deserialize_with = "named")]
    lights: bool,
    #[serde(default, deserialize_with = "named")]
    environment: bool,
    version: Option<IgnoredAny>,
}

/// Whether it is there, be it as `null`.
fn named<'de, D: Deserializer<'de>>(from: D) -> std::result::Result<bool, D::Error> {
    IgnoredAny::deserialize(from).map(|_| true)
}

fn kind_of_json(path: &Path) -> Result<FileKind> {
    let text = read_all(path, gltf::MAX_FILE_BYTES)?;
    Ok(match serde_json::from_slice(&text) {
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
        // Looks that have lights have a version, too.
        Ok(Known {
            version: None,
            lights,
            environment,
            ..
        }) if lights || environment => FileKind::Rig,
        _ => FileKind::Look,
    })
}

fn is_named(path: &Path, ending: &str) -> bool {
    let extension = path.extension();
    extension.is_some_and(|e| e.eq_ignore_ascii_case(ending))
}
