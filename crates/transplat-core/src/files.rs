//! Files in and out. A file is known by what it begins with, never by its name, and nothing is allocated by a number that a file only claims.

mod asset;
mod bake;
mod cameras;
mod estimate;
mod exr;
#[cfg(test)]
mod fuzz;
mod hdr;
mod look;
mod picture;
mod ply;
mod read;
mod write;

use std::io::Read;
use std::path::Path;

use crate::environment::EnvironmentMap;
use crate::error::{Error, Result};

pub use asset::{AssetFile, AssetKind, AssetReport, load_asset, write_relit};
pub use bake::{BakeHeader, geometry_key, inspect_bake, load_bake, save_bake};
pub use cameras::{CameraFile, load_cameras};
pub use estimate::{load_estimate, save_estimate};
pub use exr::load_picture;
pub use look::{load_look, look_text, save_look};
use read::open;
pub use read::{MAX_ENVIRONMENT_EDGE, MAX_ENVIRONMENT_PIXELS};
pub use write::{ExrFloats, PngBits, check_output, write_atomically, write_exr, write_png};

/// What a file is, by its first bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// A splat in PLY.
    Ply,
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
}

/// Looks at the first bytes of a file.
///
/// # Errors
/// The file cannot be read, is empty, or is of no kind that this program opens.
pub fn file_kind(path: &Path) -> Result<FileKind> {
    let mut start = Vec::new();
    let read = open(path)?.take(64).read_to_end(&mut start);
    read.map_err(Error::io(path))?;
    if start.is_empty() {
        return Err(Error::invalid(path, "the file is empty"));
    }
    Ok(match &start[..] {
        [b'p', b'l', b'y', after, ..] if after.is_ascii_whitespace() => FileKind::Ply,
        _ if start.starts_with(b"#?") => FileKind::Hdr,
        _ if start.starts_with(&[0x76, 0x2f, 0x31, 0x01]) => FileKind::Exr,
        _ if start.starts_with(b"\x89PNG") || start.starts_with(&[0xff, 0xd8, 0xff]) => {
            FileKind::Picture
        }
        _ if start.starts_with(bake::ANY_MAGIC) => FileKind::Bake,
        _ if start.trim_ascii_start().starts_with(b"{") => FileKind::Look,
        _ => {
            return Err(Error::invalid(
                path,
                "its content is of no kind that this program knows; it opens splats (.ply), environments (.hdr, .exr, .png, .jpg), bakes and looks",
            ));
        }
    })
}

/// Loads an environment: Radiance .hdr, OpenEXR, or a PNG or JPEG picture (decoded from sRGB).
///
/// # Errors
/// The file cannot be read, is broken, or is no environment.
pub fn load_environment(path: &Path) -> Result<EnvironmentMap> {
    match file_kind(path)? {
        FileKind::Hdr => hdr::load(path),
        FileKind::Exr => exr::load(path),
        FileKind::Picture => picture::load(path),
        FileKind::Ply => Err(Error::invalid(
            path,
            "is a splat; an environment (.hdr, .exr, .png, .jpg) is expected here",
        )),
        FileKind::Bake | FileKind::Look => Err(Error::invalid(
            path,
            "is no environment; .hdr, .exr, .png or .jpg is expected here",
        )),
    }
}
