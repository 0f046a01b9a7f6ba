//! PNG and JPEG pictures as environments: decoded from sRGB, their highlights clipped.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::{ImageReader, Limits};

use super::read::check_map_size;
use crate::color::srgb_decode;
use crate::environment::EnvironmentMap;
use crate::error::{Error, Result};

pub fn load(path: &Path) -> Result<EnvironmentMap> {
    let [width, height] = size(path)?;
    check_map_size(path, width, height)?;
    let mut reader = reader(path)?;
    let mut limits = Limits::default();
    limits.max_alloc = Some(16 * super::read::MAX_ENVIRONMENT_PIXELS as u64);
    reader.limits(limits);
    let picture = reader.decode().map_err(invalid(path))?.into_rgb32f();
    let pixels = picture.pixels().map(|p| p.0.map(srgb_decode)).collect();
    Ok(EnvironmentMap::new(width, height, pixels).with_clipped_highlights())
}

/// Its width and height.
pub fn size(path: &Path) -> Result<[usize; 2]> {
    let (width, height) = reader(path)?.into_dimensions().map_err(invalid(path))?;
    Ok([width as usize, height as usize])
}

fn reader(path: &Path) -> Result<ImageReader<BufReader<File>>> {
    ImageReader::open(path)
        .and_then(ImageReader::with_guessed_format)
        .map_err(Error::io(path))
}

fn invalid(path: &Path) -> impl Fn(image::ImageError) -> Error + '_ {
    |error| Error::invalid(path, error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_are_decoded_from_srgb_and_marked() {
        let file = tempfile::Builder::new()
            .suffix(".png")
            .tempfile()
            .expect("a temporary file");
        let mut picture = image::RgbImage::new(2, 1);
        picture.put_pixel(1, 0, image::Rgb([255, 188, 0]));
        picture.save(file.path()).expect("room for it");
        let map = load(file.path()).expect("a good file");
        assert!(map.has_clipped_highlights());
        assert_eq!(map.pixels()[0], [0.0; 3]);
        let [r, g, b] = map.pixels()[1];
        // 188 is the encoding of a little over one half.
        assert!(r == 1.0 && (g - 0.5).abs() < 0.01 && b == 0.0);
    }
}
