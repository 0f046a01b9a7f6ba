//! Files in and out. A file is known by what it begins with, never by its name, and nothing is allocated by a number that a file only claims.

mod asset;
mod bake;
mod cameras;
mod estimate;
mod exr;
mod format;
#[cfg(test)]
mod fuzz;
mod gltf;
mod hdr;
mod kind;
mod ksplat;
mod look;
mod lut;
mod packed;
mod picture;
mod ply;
mod read;
mod rows;
mod sog;
mod splat;
mod spz;
mod write;
mod written;

use std::path::Path;

use crate::environment::{EnvironmentMap, Layout};
use crate::error::{Error, Result};
use crate::plate::Plate;

pub use asset::{AssetFile, load_asset, losses, write_delit, write_relit, write_splat};
pub use bake::{BakeHeader, geometry_key, inspect_bake, load_bake, save_bake};
pub use cameras::{CameraFile, CameraFrame, is_camera_file, load_cameras};
pub use estimate::{load_estimate, save_estimate};
pub use exr::load_picture;
pub use format::SplatFormat;
pub use kind::{FileKind, file_kind, file_of};
pub use look::{load_look, load_rig, look_text, save_look, save_rig};
pub use lut::load_lut;
pub use read::{MAX_ENVIRONMENT_EDGE, MAX_ENVIRONMENT_PIXELS};
pub use rows::{AssetKind, AssetReport};
pub use write::{
    Channel, ExrFloats, PngBits, check_folder, check_output, folder_of, is_environment_name,
    write_atomically, write_environment, write_exr, write_layers, write_png,
};

/// Whether two paths are of one file, however they are spelled.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    let whole = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    a == b || whole(a) == whole(b)
}

/// Loads a photograph to be seen behind objects: anything that an environment may be, of any shape.
///
/// # Errors
/// The file cannot be read, is broken, or is no picture.
pub fn load_plate(path: &Path) -> Result<Plate> {
    let as_it_is = Some(Layout::Equirectangular);
    Ok(Plate::of(&load_environment_as(path, as_it_is)?))
}

/// Width and height of a photograph, of which only the header is read.
///
/// # Errors
/// As [`load_plate`].
pub fn plate_size(path: &Path) -> Result<[usize; 2]> {
    match file_kind(path)? {
        FileKind::Picture => picture::size(path),
        FileKind::Hdr => hdr::size(path),
        FileKind::Exr => exr::size(path),
        _ => load_plate(path).map(|p| [p.width, p.height]),
    }
}

/// Loads an environment: Radiance .hdr, OpenEXR, or a PNG or JPEG picture (decoded from sRGB); a panorama, or laid out as its shape tells.
///
/// # Errors
/// The file cannot be read, is broken, or is no environment.
pub fn load_environment(path: &Path) -> Result<EnvironmentMap> {
    load_environment_as(path, None)
}

/// The same of a picture that is laid out as told.
///
/// # Errors
/// As [`load_environment`], or the picture has not the shape of what is told.
pub fn load_environment_as(path: &Path, told: Option<Layout>) -> Result<EnvironmentMap> {
    let picture = match file_kind(path)? {
        FileKind::Hdr => hdr::load(path),
        FileKind::Exr => exr::load(path),
        FileKind::Picture => picture::load(path),
        FileKind::Splat(_) => Err(Error::invalid(
            path,
            "is a splat; an environment (.hdr, .exr, .png, .jpg) is expected here",
        )),
        FileKind::Bake | FileKind::Look | FileKind::Rig | FileKind::Lut => Err(Error::invalid(
            path,
            "is no environment; .hdr, .exr, .png or .jpg is expected here",
        )),
    };
    picture?
        .laid_out(told)
        .map_err(|why| Error::invalid(path, why.to_string()))
}
