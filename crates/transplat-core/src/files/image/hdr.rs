//! Radiance .hdr (RGBE, XYZE): flat, old and new run lengths, exposure and colour correction, primaries, and all eight orders of scanlines.

use std::borrow::Cow;
use std::io::Read;
use std::path::Path;

use glam::DVec2;

use super::super::read::{MAX_ENVIRONMENT_PIXELS, check_map_size, open, read_all};
use super::primaries::{Chromaticities, apply, rec_709_from};
use crate::error::{Error, Result};
use crate::images::Image;

/// Four bytes a pixel for the largest map, and room for a header.
const MAX_BYTES: u64 = MAX_ENVIRONMENT_PIXELS as u64 * 5;

/// No header is longer.
const MAX_HEADER: u64 = 1 << 16;

pub fn load(path: &Path) -> Result<Image> {
    parse(path, &read_all(path, MAX_BYTES)?)
}

/// Width and height, as the header tells them.
pub fn size(path: &Path) -> Result<[usize; 2]> {
    let mut head = Vec::new();
    open(path)?
        .take(MAX_HEADER)
        .read_to_end(&mut head)
        .map_err(Error::io(path))?;
    let (header, _) = parse_header(&head).map_err(|m| Error::invalid(path, m))?;
    Ok(header.size())
}

struct HdrHeader {
    /// Divisor of stored values that yields radiance, by channel.
    exposure: [f32; 3],
    xyz: bool,
    primaries: Option<Chromaticities>,
    /// Remarks on what was ignored, for the user.
    warnings: Vec<String>,
    /// Scanlines, and pixels in each.
    scanlines: usize,
    length: usize,
    /// Scanlines run along columns (the first axis of the resolution line is X).
    transposed: bool,
    flip_x: bool,
    flip_y: bool,
}

impl HdrHeader {
    /// Width and height.
    fn size(&self) -> [usize; 2] {
        let (lines, length) = (self.scanlines, self.length);
        if self.transposed {
            [lines, length]
        } else {
            [length, lines]
        }
    }
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Image> {
    let invalid = |message: String| Error::invalid(path, message);
    let (header, mut data) = parse_header(bytes).map_err(invalid)?;
    let (lines, length) = (header.scanlines, header.length);
    let [width, height] = header.size();
    check_map_size(path, width, height)?;
    // The new code packs 16 pixels of one colour into a byte, the old one 64.
    if width * height > data.len().saturating_mul(64) {
        return Err(invalid("the pixels end before the map does".into()));
    }
    // Whatever its first pixels look like: run lengths have another length, or are longer than that.
    let is_flat = data.len() == 4 * width * height;
    let mut scanline = vec![[0u8; 4]; length];
    let mut stored = Vec::new();
    for line in 0..lines {
        let read = match is_flat {
            true => read_flat(&mut data, &mut scanline),
            false => read_scanline(&mut data, &mut scanline),
        };
        read.map_err(|problem| invalid(format!("{problem} in scanline {line} of {lines}")))?;
        stored.extend_from_slice(&scanline);
    }
    let gain = header.exposure.map(|exposure| 1.0 / exposure);
    let mut pixels = Vec::with_capacity(stored.len());
    for y in 0..height {
        let y = if header.flip_y { height - 1 - y } else { y };
        for x in 0..width {
            let x = if header.flip_x { width - 1 - x } else { x };
            let index = if header.transposed {
                x * height + y
            } else {
                y * width + x
            };
            pixels.push(decode_pixel(stored[index], gain, header.xyz));
        }
    }
    let mut warnings = header.warnings;
    if let Some(primaries) = header.primaries
        && !(primaries.red.y > 0.0 && primaries.white.y > 0.0)
    {
        warnings.push("its PRIMARIES are of no colours, and are ignored".into());
    }
    if let Some(primaries) = header.primaries.filter(|_| !header.xyz)
        && let Some(matrix) = rec_709_from(&primaries, None)
    {
        apply(&matrix, &mut pixels);
    }
    let mut image = Image::new(width, height, pixels);
    image.provenance.warnings = warnings;
    Ok(image)
}

fn parse_header(bytes: &[u8]) -> Result<(HdrHeader, &[u8]), String> {
    let mut rest = bytes;
    let mut exposure = [1f32; 3];
    let (mut xyz, mut primaries, mut warnings) = (false, None, Vec::new());
    let mut next_line = || -> Result<Cow<'_, str>, String> {
        let end = rest.iter().take(4096).position(|b| *b == b'\n');
        let Some(end) = end else {
            return Err("the header does not end".into());
        };
        // Comments are in whatever encoding their writer had.
        let line = &rest[..end];
        rest = &rest[end + 1..];
        Ok(String::from_utf8_lossy(
            line.strip_suffix(b"\r").unwrap_or(line),
        ))
    };
    loop {
        let line = next_line()?;
        if line.is_empty() {
            break;
        }
        if let Some(format) = line.strip_prefix("FORMAT=") {
            xyz = match format.trim() {
                "32-bit_rle_rgbe" => false,
                "32-bit_rle_xyze" => true,
                other => {
                    return Err(format!(
                        "FORMAT={other} is not known; 32-bit_rle_rgbe and 32-bit_rle_xyze are"
                    ));
                }
            };
        } else if let Some(value) = line.strip_prefix("EXPOSURE=") {
            match numbers::<1>(value) {
                Some([value]) if value > 0.0 => exposure = exposure.map(|e| e * value),
                _ => warnings.push(format!("{line} is no exposure, and is ignored")),
            }
        } else if let Some(value) = line.strip_prefix("COLORCORR=") {
            match numbers::<3>(value) {
                Some(by) if by.iter().all(|v| *v > 0.0) => {
                    exposure = std::array::from_fn(|c| exposure[c] * by[c]);
                }
                _ => warnings.push(format!("{line} is no colour correction, and is ignored")),
            }
        } else if let Some(value) = line.strip_prefix("PRIMARIES=") {
            match numbers::<8>(value) {
                Some(v) => {
                    let at = |i: usize| DVec2::new(v[2 * i].into(), v[2 * i + 1].into());
                    primaries = Some(Chromaticities {
                        red: at(0),
                        green: at(1),
                        blue: at(2),
                        white: at(3),
                    });
                }
                None => warnings.push(format!("{line} are no primaries, and are ignored")),
            }
        }
    }
    if !exposure.iter().all(|e| *e > 1e-30 && *e < 1e30) {
        warnings.push(
            "its EXPOSURE and COLORCORR lines multiply to nothing usable, and are ignored".into(),
        );
        exposure = [1.0; 3];
    }
    let resolution = next_line()?;
    let words: Vec<&str> = resolution.split_whitespace().collect();
    let problem = || format!("{resolution:?} is not a resolution line such as -Y 512 +X 1024");
    let [first, lines, second, length] = words[..] else {
        return Err(problem());
    };
    let size = |text: &str| text.parse::<usize>().map_err(|_| problem());
    let negative = |axis: &str| axis.starts_with('-');
    let (transposed, x, y) = match (first, second) {
        ("+X" | "-X", "+Y" | "-Y") => (true, first, second),
        ("+Y" | "-Y", "+X" | "-X") => (false, second, first),
        _ => return Err(problem()),
    };
    let header = HdrHeader {
        exposure,
        xyz,
        primaries,
        warnings,
        scanlines: size(lines)?,
        length: size(length)?,
        transposed,
        // Radiance's Y points up: -Y is the usual order, top row first.
        flip_x: negative(x),
        flip_y: !negative(y),
    };
    Ok((header, rest))
}

/// Finite numbers of a line, and no other.
fn numbers<const N: usize>(text: &str) -> Option<[f32; N]> {
    let values = text.split_whitespace().map(|word| word.parse::<f32>().ok());
    let values: Vec<f32> = values.collect::<Option<_>>()?;
    let is_finite = values.iter().all(|v| v.is_finite());
    values.try_into().ok().filter(|_| is_finite)
}

/// Takes `n` bytes from the front.
fn take<'a>(data: &mut &'a [u8], n: usize) -> Result<&'a [u8], &'static str> {
    let (head, tail) = data.split_at_checked(n).ok_or("the pixels end")?;
    *data = tail;
    Ok(head)
}

fn read_scanline(data: &mut &[u8], scanline: &mut [[u8; 4]]) -> Result<(), &'static str> {
    let length = scanline.len();
    let is_new = (8..32768).contains(&length)
        && matches!(data, [2, 2, high, low, ..] if usize::from(*high) << 8 | usize::from(*low) == length);
    if !is_new {
        return read_flat_or_old(data, scanline);
    }
    take(data, 4)?;
    for channel in 0..4 {
        let mut x = 0;
        while x < length {
            let code = usize::from(take(data, 1)?[0]);
            let (run, values): (usize, &[u8]) = if code > 128 {
                (code - 128, take(data, 1)?)
            } else {
                (code, take(data, code)?)
            };
            if run == 0 || x + run > length {
                return Err("a run of the wrong length");
            }
            for i in 0..run {
                scanline[x + i][channel] = values[i % values.len()];
            }
            x += run;
        }
    }
    Ok(())
}

fn read_flat(data: &mut &[u8], scanline: &mut [[u8; 4]]) -> Result<(), &'static str> {
    let bytes = take(data, 4 * scanline.len())?;
    scanline.copy_from_slice(bytes.as_chunks().0);
    Ok(())
}

fn read_flat_or_old(data: &mut &[u8], scanline: &mut [[u8; 4]]) -> Result<(), &'static str> {
    let mut x = 0;
    let mut shift = 0;
    let mut last = None;
    while x < scanline.len() {
        let pixel: [u8; 4] = take(data, 4)?.try_into().map_err(|_| "the pixels end")?;
        if let ([1, 1, 1, count], Some(last)) = (pixel, last) {
            let run = usize::from(count) << shift;
            if shift > 24 || run > scanline.len() - x {
                return Err("a run of the wrong length");
            }
            scanline[x..x + run].fill(last);
            x += run;
            shift += 8;
        } else {
            scanline[x] = pixel;
            last = Some(pixel);
            x += 1;
            shift = 0;
        }
    }
    Ok(())
}

fn decode_pixel([r, g, b, exponent]: [u8; 4], gain: [f32; 3], xyz: bool) -> [f32; 3] {
    if exponent == 0 {
        return [0.0; 3];
    }
    let scale = (f32::from(exponent) - 136.0).exp2();
    let stored = [r, g, b];
    let c: [f32; 3] = std::array::from_fn(|c| f32::from(stored[c]) * (scale * gain[c]));
    if !xyz {
        return c;
    }
    // CIE XYZ to linear Rec. 709, D65.
    let rows = [
        [3.240_454_2, -1.537_138_5, -0.498_531_4],
        [-0.969_266, 1.876_010_8, 0.041_556],
        [0.055_643_4, -0.204_025_9, 1.057_225_2],
    ];
    rows.map(|row: [f32; 3]| (row[0] * c[0] + row[1] * c[1] + row[2] * c[2]).max(0.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn parse(header: &str, data: &[u8]) -> Result<Image> {
        super::parse(Path::new("a.hdr"), &[header.as_bytes(), data].concat())
    }

    #[test]
    fn flat_exposure_and_format() {
        // 2^(129 - 136) * 128 = 1; exposure 2 in two lines of which the product is 4.
        let data = [128, 64, 32, 129, 0, 0, 0, 0];
        let map = parse(
            "#?RADIANCE\n# made by hand\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=2.0\nEXPOSURE=2.0\n\n-Y 1 +X 2\n",
            &data,
        )
        .expect("a good file");
        assert_eq!((map.width, map.height), (2, 1));
        assert_eq!(map.pixels, [[0.25, 0.125, 0.0625], [0.0; 3]]);
    }

    #[test]
    fn every_scanline_order_yields_the_same_picture() {
        // A 3 x 2 picture whose pixel (x, y) has red 10 x + y.
        let red = |x: usize, y: usize| (10 * x + y) as u8 + 1;
        for (first, second) in [
            ("-Y", "+X"),
            ("-Y", "-X"),
            ("+Y", "+X"),
            ("+Y", "-X"),
            ("+X", "-Y"),
            ("-X", "-Y"),
            ("+X", "+Y"),
            ("-X", "+Y"),
        ] {
            let (w, h) = (3usize, 2usize);
            let count = |axis: &str| if axis.ends_with('X') { w } else { h };
            let at = |axis: &str, i: usize| match axis {
                "+X" => i,
                "-X" => w - 1 - i,
                "-Y" => i,
                _ => h - 1 - i,
            };
            let mut data = Vec::new();
            for i in 0..count(first) {
                for j in 0..count(second) {
                    let (a, b) = (at(first, i), at(second, j));
                    let (x, y) = if first.ends_with('X') { (a, b) } else { (b, a) };
                    data.extend([red(x, y), 0, 0, 136]);
                }
            }
            let header = format!(
                "#?RGBE\n\n{first} {} {second} {}\n",
                count(first),
                count(second)
            );
            let map = parse(&header, &data).expect("a good file");
            for y in 0..h {
                for x in 0..w {
                    assert_eq!(
                        map.pixels[y * w + x][0],
                        f32::from(red(x, y)),
                        "{first} {second}"
                    );
                }
            }
        }
    }

    #[test]
    fn old_and_new_run_lengths() {
        let old = [5, 6, 7, 136, 1, 1, 1, 3, 9, 9, 9, 136];
        let map = parse("#?RADIANCE\n\n-Y 1 +X 5\n", &old).expect("old run lengths");
        assert_eq!(map.pixels[3], [5.0, 6.0, 7.0]);
        assert_eq!(map.pixels[4], [9.0; 3]);
        // Ten pixels: a run of 10, a literal of 10, a run of 4 and one of 6, an exponent run.
        let mut new = vec![2, 2, 0, 10, 138, 7, 10];
        new.extend(1..=10);
        new.extend([132, 1, 134, 2, 138, 136]);
        let map = parse("#?RADIANCE\n\n-Y 1 +X 10\n", &new).expect("new run lengths");
        assert_eq!(map.pixels[9], [7.0, 10.0, 2.0]);
        assert_eq!(map.pixels[0], [7.0, 1.0, 1.0]);
    }

    /// Headers as programs write them: comments in any encoding, factors that are none, other primaries.
    #[test]
    fn what_a_header_says_is_honoured_or_ignored_with_a_word() {
        let flat = [128, 64, 32, 129];
        let head = |line: &[u8]| [b"#?RADIANCE\n", line, b"\n\n-Y 1 +X 1\n"].concat();
        let load = |line: &[u8]| {
            let bytes = [&head(line)[..], &flat].concat();
            super::parse(Path::new("a.hdr"), &bytes).expect("a good file")
        };
        for line in [
            &b"EXPOSURE=0.0"[..],
            b"EXPOSURE=nan",
            b"COLORCORR=1 1",
            b"PRIMARIES=x",
        ] {
            let image = load(line);
            assert_eq!(image.pixels[0], [1.0, 0.5, 0.25]);
            assert_eq!(image.provenance.warnings.len(), 1, "{line:?}");
        }
        let image = load(b"SOFTWARE=f\xfcr alle");
        assert!(image.pixels[0] == [1.0, 0.5, 0.25] && image.provenance.warnings.is_empty());
        assert_eq!(load(b"COLORCORR=2 0.5 1").pixels[0], [0.5, 1.0, 0.25]);
        // ITU-R BT.2020: grey stays grey, and green is more than ours.
        let wide = b"PRIMARIES=0.708 0.292 0.170 0.797 0.131 0.046 0.3127 0.3290";
        let [r, g, b] = load(wide).pixels[0];
        let sum = 0.2126 * r + 0.7152 * g + 0.0722 * b;
        let own = 0.2627 + 0.5 * 0.6780 + 0.25 * 0.0593;
        assert!(r > 1.0 && (sum - own).abs() < 2e-3, "{r} {g} {b}");
    }

    /// A pixel of a flat file may be what run lengths begin with.
    #[test]
    fn the_length_of_a_flat_file_tells_that_it_is_flat() {
        let mut data = vec![2, 2, 0, 10];
        data.extend((0..36u8).map(|i| 100 + i));
        let map = parse("#?RADIANCE\n\n-Y 1 +X 10\n", &data).expect("a good file");
        assert_eq!(
            map.pixels[1],
            decode_pixel([100, 101, 102, 103], [1.0; 3], false)
        );
    }

    #[test]
    fn absurd_claims_are_refused_before_any_allocation() {
        for header in [
            "#?RADIANCE\n\n-Y 1000000 +X 1000000\n",
            "#?RADIANCE\n\n-Y 18446744073709551615 +X 2\n",
            "#?RADIANCE\n\n-Y 0 +X 2\n",
            "#?RADIANCE\n\n-Y 1 +X 134217728\n",
            "#?RADIANCE\n\n-Y 100 +X 60000\n",
            "#?RADIANCE\n\n-Y 8192 +X 16384\n",
            "#?RADIANCE\n\n-Y 2 X 2\n",
            "#?RADIANCE\nFORMAT=banana\n\n-Y 1 +X 1\n",
            "#?RADIANCE\n",
        ] {
            assert!(parse(header, &[0; 64]).is_err(), "{header}");
        }
    }

    proptest! {
        #[test]
        fn garbage_is_an_error_or_a_map(width in 1usize..40, height in 1usize..4, data in proptest::collection::vec(any::<u8>(), 0..400)) {
            let header = format!("#?RADIANCE\n\n-Y {height} +X {width}\n");
            if let Ok(map) = parse(&header, &data) {
                prop_assert!(map.pixels.iter().flatten().all(|v| v.is_finite()));
            }
        }
    }
}
