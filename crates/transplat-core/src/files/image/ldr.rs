//! PNG and JPEG images: decoded from sRGB, turned as EXIF says, their highlights clipped.

use std::io::Cursor;
use std::path::Path;

use super::super::decode;
use super::super::read::{MAX_ENVIRONMENT_PIXELS, check_map_size, open, read_all};
use crate::color::srgb_decode;
use crate::error::{Error, Result};
use crate::images::Image;

/// Bytes of the largest file: more than as many pixels as are accepted take, not compressed and of 16 bits.
const LARGEST: u64 = 1 << 30;

pub fn load(path: &Path) -> Result<Image> {
    let invalid = |why| Error::invalid(path, why);
    let bytes = read_all(path, LARGEST)?;
    let mut picture = decode::picture(Cursor::new(&bytes)).map_err(invalid)?;
    let [width, height] = picture.size();
    check_map_size(path, width, height)?;
    let limit = 16 * MAX_ENVIRONMENT_PIXELS as u64;
    let decoded = picture.decode(limit).map_err(invalid)?;
    let decoded = decoded.into_rgb32f();
    let pixels = decoded.pixels().map(|p| p.0.map(srgb_decode)).collect();
    let mut image = Image::new(width, height, pixels);
    image.is_clipped = true;
    if is_cut(&bytes) {
        let warning = "the file ends before its image does: what is missing of it is grey";
        image.provenance.warnings.push(warning.into());
    }
    Ok(image)
}

/// True for a JPEG without an end of image (FF D9) after its last scan (FF DA), neither of which occurs in coded data.
fn is_cut(bytes: &[u8]) -> bool {
    let last = |marker: u8| bytes.windows(2).rposition(|w| w == [0xff, marker]);
    bytes.starts_with(&[0xff, 0xd8]) && last(0xd9) < last(0xda)
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
    fn a_photograph_that_is_cut_off_is_said_to_be() {
        let file = tempfile::Builder::new().suffix(".jpg").tempfile();
        let file = file.expect("a temporary file");
        let noise = |x: u32, y: u32| image::Rgb([(x * 37 + y * 91) as u8, (x * y) as u8, x as u8]);
        let picture = image::RgbImage::from_fn(64, 64, noise);
        picture.save(file.path()).expect("room for it");
        let whole = load(file.path()).expect("a good file");
        assert!(whole.provenance.warnings.is_empty());
        let whole = std::fs::read(file.path()).expect("it is there");
        std::fs::write(file.path(), &whole[..whole.len() / 2]).expect("room for it");
        let cut = load(file.path()).map(|image| image.provenance.warnings.len());
        assert!(cut.is_ok_and(|warnings| warnings == 1));
    }

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
