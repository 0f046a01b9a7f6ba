//! PNG and JPEG images: decoded from sRGB, turned as EXIF says, their highlights clipped.

use std::path::Path;

use super::super::decode;
use super::super::read::{MAX_ENVIRONMENT_PIXELS, check_map_size, open};
use crate::color::srgb_decode;
use crate::error::{Error, Result};
use crate::images::Image;

pub fn load(path: &Path) -> Result<Image> {
    let invalid = |why| Error::invalid(path, why);
    let mut picture = decode::picture(open(path)?).map_err(invalid)?;
    let [width, height] = picture.size();
    check_map_size(path, width, height)?;
    let limit = 16 * MAX_ENVIRONMENT_PIXELS as u64;
    let decoded = picture.decode(limit).map_err(invalid)?;
    let decoded = decoded.into_rgb32f();
    let pixels = decoded.pixels().map(|p| p.0.map(srgb_decode)).collect();
    Ok(Image {
        is_clipped: true,
        ..Image::new(width, height, pixels)
    })
}

/// Width and height.
pub fn size(path: &Path) -> Result<[usize; 2]> {
    let picture = decode::picture(open(path)?);
    let mut picture = picture.map_err(|why| Error::invalid(path, why))?;
    Ok(picture.size())
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
        let image = load(file.path()).expect("a good file");
        assert!(image.is_clipped);
        assert_eq!(image.pixels[0], [0.0; 3]);
        let [r, g, b] = image.pixels[1];
        // 188 is the encoding of a little over one half.
        assert!(r == 1.0 && (g - 0.5).abs() < 0.01 && b == 0.0);
    }
}
