//! Files in and out. A file is recognized by its first bytes, never by its name, and no memory is allocated by a number that a file only claims.

mod bake;
mod cameras;
mod decode;
mod estimate;
mod format;
#[cfg(test)]
mod fuzz;
mod gltf;
mod image;
mod kind;
mod ksplat;
mod look;
mod lut;
mod packed;
mod ply;
mod read;
mod rows;
mod sog;
mod splat;
mod splat_file;
mod spz;
mod write;
mod written;

use std::path::Path;

use crate::error::{Error, Result};

pub use bake::{BakeHeader, geometry_key, inspect_bake, load_bake, save_bake};
pub use cameras::{CameraFile, CameraFrame, cameras_of_training, load_cameras};
pub use estimate::{load_estimate, save_estimate};
pub use format::SplatFormat;
pub use gltf::{percent_decoded, percent_encoded};
pub use image::{
    image_size, load_backplate, load_environment, load_environment_as, load_image, load_picture,
};
pub use kind::{FileKind, file_kind, file_of};
pub use look::{load_look, load_rig, look_text, save_look, save_rig};
pub use lut::load_lut;
pub use read::{MAX_ENVIRONMENT_EDGE, MAX_ENVIRONMENT_PIXELS, SPLAT_ENDINGS, check_readable};
pub use rows::{SplatKind, SplatReport};
pub use splat_file::{SplatFile, load_splat, losses, write_delit, write_relit, write_splat};
pub use write::{
    Channel, ExrFloats, PngBits, check_folder, check_output, folder_of, is_environment_name,
    write_atomically, write_environment, write_exr, write_layers, write_png,
};

/// Reads a value from a text in JSON.
///
/// # Errors
/// The text is no JSON, or holds another value than is expected: what and where.
pub fn parse_json<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, String> {
    decode::json(text.as_bytes())
}

/// Reads a value from a file in JSON of at most 256 MB; `what` is what it should be.
///
/// # Errors
/// The file cannot be read, or is nothing of that kind.
pub fn load_json<T: serde::de::DeserializeOwned>(path: &Path, what: &str) -> Result<T> {
    kind::expect_json(path, &format!("a {what}"))?;
    let text = read::read_all(path, 1 << 28)?;
    decode::json(&text).map_err(|why| Error::invalid(path, format!("no {what}: {why}")))
}

/// Whether two paths are of one file, however they are spelled.
pub fn is_same_file(a: &Path, b: &Path) -> bool {
    let whole = |path: &Path| path.canonicalize().unwrap_or_else(|_| path.to_owned());
    a == b || whole(a) == whole(b)
}
