//! Image loader: Radiance, OpenEXR, PNG and JPEG, whatever they are for. [`EnvironmentMap`] makes a light of one.

pub(super) mod exr;
mod hdr;
mod ldr;
mod primaries;

use std::path::Path;

use super::kind::{FileKind, UNKNOWN, file_kind};
use crate::backplate::Backplate;
use crate::environment::EnvironmentMap;
use crate::error::{Error, Result};
use crate::images::{Image, ImageReading};
use crate::rasterize::Raster;

/// Loads an image: Radiance, OpenEXR, PNG or JPEG, in linear Rec. 709. Of an OpenEXR file with several layers or parts that one which is
/// named, or else the unnamed one, or the one that is called as the whole picture usually is.
///
/// # Errors
/// The file cannot be read, is broken, is no image, or has no such layer.
pub fn load_image(path: &Path, layer: Option<&str>) -> Result<Image> {
    let kind = file_kind(path).map_err(|error| match error {
        Error::Invalid { path, message } if message.starts_with(UNKNOWN) => Error::invalid(
            &path,
            "not an image that is read here (.hdr, .exr, .png, .jpg); save it as PNG, JPEG or OpenEXR",
        ),
        other => other,
    })?;
    match kind {
        FileKind::Exr => exr::load(path, layer),
        FileKind::Hdr | FileKind::Picture if layer.is_some() => Err(Error::invalid(
            path,
            "has no layers, of which one is named (--layer); OpenEXR files may have some",
        )),
        FileKind::Hdr => hdr::load(path),
        FileKind::Picture => ldr::load(path),
        other => Err(Error::invalid(
            path,
            format!(
                "{}, where an image (.hdr, .exr, .png, .jpg) is expected",
                other.called()
            ),
        )),
    }
}

/// Width and height of an image, of which only the header is read.
///
/// # Errors
/// As [`load_image`].
pub fn image_size(path: &Path) -> Result<[usize; 2]> {
    match file_kind(path)? {
        FileKind::Picture => ldr::size(path),
        FileKind::Hdr => hdr::size(path),
        FileKind::Exr => exr::size(path),
        _ => load_image(path, None).map(|i| [i.width, i.height]),
    }
}

/// Loads an image with its alpha; it has no depth.
///
/// # Errors
/// As [`load_image`].
pub fn load_picture(path: &Path) -> Result<Raster> {
    let image = load_image(path, None)?;
    let alpha = image.alpha.iter().copied().chain(std::iter::repeat(1.0));
    let pixels = image.pixels.iter().zip(alpha);
    Ok(Raster {
        width: image.width,
        height: image.height,
        pixels: pixels.map(|([r, g, b], a)| [*r, *g, *b, a]).collect(),
        depth: Vec::new(),
    })
}

/// Loads a photograph to be seen behind objects.
///
/// # Errors
/// As [`load_image`].
pub fn load_backplate(path: &Path) -> Result<Backplate> {
    load_image(path, None).map(Backplate::of)
}

/// Loads an environment: an image that is a panorama, or laid out as its file or its shape tells.
///
/// # Errors
/// As [`load_image`].
pub fn load_environment(path: &Path) -> Result<EnvironmentMap> {
    load_environment_as(path, &ImageReading::default())
}

/// Loads an environment, read as is told.
///
/// # Errors
/// As [`load_image`], or the image has not the shape of the layout.
pub fn load_environment_as(path: &Path, reading: &ImageReading) -> Result<EnvironmentMap> {
    let image = load_image(path, reading.layer.as_deref())?;
    let layout = reading.layout.or(image.layout);
    EnvironmentMap::of_image(image)
        .laid_out(layout)
        .map_err(|why| Error::invalid(path, why.to_string()))
}
