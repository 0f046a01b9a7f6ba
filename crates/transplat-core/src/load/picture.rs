//! PNG and JPEG pictures as environments: decoded from sRGB, their highlights clipped.

use std::path::Path;

use image::{ImageReader, Limits};

use super::check_map_size;
use crate::color::srgb_decode;
use crate::environment::EnvironmentMap;
use crate::error::{Error, Result};

pub fn load(path: &Path) -> Result<EnvironmentMap> {
    let told = |error: image::ImageError| Error::invalid(path, error.to_string());
    let reader = || {
        ImageReader::open(path)
            .and_then(ImageReader::with_guessed_format)
            .map_err(Error::io(path))
    };
    let (width, height) = reader()?.into_dimensions().map_err(told)?;
    check_map_size(path, width as usize, height as usize)?;
    let mut reader = reader()?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(16 * super::MAX_ENVIRONMENT_PIXELS as u64);
    reader.limits(limits);
    let picture = reader.decode().map_err(told)?.into_rgb32f();
    let pixels = picture.pixels().map(|p| p.0.map(srgb_decode)).collect();
    Ok(EnvironmentMap::new(width as usize, height as usize, pixels).with_clipped_highlights())
}
