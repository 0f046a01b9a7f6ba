//! LUT files: `.cube` (Adobe, Cube LUT Specification 1.0, 2013), with the two ranges and the shaper curves before a cube.

use std::path::Path;

use super::read::read_all;
use crate::error::{Error, Result};
use crate::lut::{Lut, Table};

/// A cube of this edge is 2.1 million entries; those in use have 17 to 65.
const MOST_OF_CUBE: usize = 129;

/// By the specification.
const MOST_OF_CURVES: usize = 65536;

const EXPECTED: &str = "a LUT (.cube) is expected here";

/// Bytes of the largest cube, written with a dozen digits.
const MOST_BYTES: u64 = 1 << 27;

/// True for a file that begins as one.
pub(super) fn begins_as_one(start: &[u8]) -> bool {
    let text = text_of(start);
    let mut words = [&b"TITLE"[..], b"LUT_1D_", b"LUT_3D_", b"DOMAIN_"].into_iter();
    words.any(|word| text.starts_with(word))
}

/// True for a file that may be one all the same: with a comment first.
pub(super) fn begins_as_text(start: &[u8]) -> bool {
    text_of(start).starts_with(b"#")
}

fn text_of(start: &[u8]) -> &[u8] {
    let bom = "\u{feff}".as_bytes();
    start.strip_prefix(bom).unwrap_or(start).trim_ascii_start()
}

/// Loads a grade.
///
/// # Errors
/// The file cannot be read, or is no `.cube` file; the line is told.
pub fn load_lut(path: &Path) -> Result<Lut> {
    let bytes = read_all(path, MOST_BYTES)?;
    // Titles and comments may be of any encoding.
    parse(&String::from_utf8_lossy(&bytes)).map_err(|why| Error::invalid(path, why))
}

#[derive(Clone, Copy)]
struct Range {
    from: [f32; 3],
    to: [f32; 3],
}

const WHOLE: Range = Range {
    from: [0.0; 3],
    to: [1.0; 3],
};

fn parse(text: &str) -> Result<Lut, String> {
    let (mut curves, mut cube) = (None, None);
    let (mut domain, mut of_curves, mut of_cube) = (WHOLE, None, None);
    let (mut entries, mut warnings) = (Vec::new(), Vec::new());
    for (i, line) in text.trim_start_matches('\u{feff}').lines().enumerate() {
        let line = line.split('#').next().unwrap_or_default().trim();
        let mut words = line.split_whitespace();
        let Some(first) = words.next() else {
            continue;
        };
        let fail = |why: String| format!("line {}: {why}", i + 1);
        let values = || numbers::<3>(line.split_whitespace().skip(1)).map_err(fail);
        let pair = || numbers::<2>(line.split_whitespace().skip(1)).map_err(fail);
        let size = |most| size(words.clone().next(), most).map_err(fail);
        match first {
            "TITLE" => {}
            "LUT_1D_SIZE" => curves = Some(size(MOST_OF_CURVES)?),
            "LUT_3D_SIZE" => cube = Some(size(MOST_OF_CUBE)?),
            "DOMAIN_MIN" => domain.from = values()?,
            "DOMAIN_MAX" => domain.to = values()?,
            "LUT_1D_INPUT_RANGE" => of_curves = Some(pair()?),
            "LUT_3D_INPUT_RANGE" => of_cube = Some(pair()?),
            "LUT_IN_VIDEO_RANGE" | "LUT_OUT_VIDEO_RANGE" => {
                let side = if first == "LUT_IN_VIDEO_RANGE" {
                    "input"
                } else {
                    "output"
                };
                warnings.push(format!(
                    "line {}: {first}: its {side} is meant for video range (64 to 940 of 1023), and it is applied to full range; export it for full range if colours come out too flat or too hard",
                    i + 1
                ));
            }
            // As other programs extend the format.
            _ if is_keyword(first) => {
                warnings.push(format!(
                    "line {}: {first} is not known, and is skipped",
                    i + 1
                ));
            }
            _ if first.starts_with(|c: char| c.is_ascii_alphabetic()) => {
                let is_none = "is no keyword of a .cube file";
                return Err(fail(format!("{first:?} {is_none}; {EXPECTED}")));
            }
            _ if curves.is_none() && cube.is_none() => {
                return Err(fail(format!("comes before any size; {EXPECTED}")));
            }
            _ => entries.push(numbers(line.split_whitespace()).map_err(fail)?),
        }
    }
    let [in_curves, in_cube] = [curves.unwrap_or(0), cube.map_or(0, |n: usize| n.pow(3))];
    if in_curves + in_cube == 0 {
        return Err(format!(
            "holds neither LUT_1D_SIZE nor LUT_3D_SIZE; {EXPECTED}"
        ));
    }
    if entries.len() != in_curves + in_cube {
        return Err(format!(
            "holds {} colours where its sizes ask for {}",
            entries.len(),
            in_curves + in_cube
        ));
    }
    let of_the_cube = entries.split_off(in_curves);
    let table = |size: Option<usize>, range: Option<[f32; 2]>, entries| {
        let range = range.map_or(domain, |[from, to]| Range {
            from: [from; 3],
            to: [to; 3],
        });
        if (0..3).any(|c| range.from[c] >= range.to[c]) {
            return Err("its range ends where it begins, or before".to_owned());
        }
        Ok(size.map(|size| Table {
            size,
            from: range.from,
            to: range.to,
            entries,
        }))
    };
    Ok(Lut {
        curves: table(curves, of_curves, entries)?,
        cube: table(cube, of_cube, of_the_cube)?,
        warnings,
    })
}

/// True for a word that is written as the format's keywords are.
fn is_keyword(word: &str) -> bool {
    let is_letter = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
    word.len() > 1 && word.chars().all(is_letter)
}

fn size(word: Option<&str>, most: usize) -> Result<usize, String> {
    let size = word.and_then(|word| word.parse().ok());
    size.filter(|size| (2..=most).contains(size))
        .ok_or_else(|| format!("a size of 2 to {most} is expected"))
}

fn numbers<'a, const N: usize>(words: impl Iterator<Item = &'a str>) -> Result<[f32; N], String> {
    let expected = || format!("{N} numbers are expected");
    let numbers: Option<Vec<f32>> = words.map(|word| word.parse().ok()).collect();
    let numbers = numbers.ok_or_else(expected)?;
    if numbers.iter().any(|v| !v.is_finite()) {
        return Err("a value is no finite number".into());
    }
    numbers.try_into().map_err(|_| expected())
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARES: &str = "TITLE \"of two\"\n# red runs fastest\nLUT_3D_SIZE 2\r\nDOMAIN_MIN 0 0 0\nDOMAIN_MAX 1 1 2\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 0 1\n1 0 1\n0 1 1\n1 1 1e0\n";

    #[test]
    fn a_cube_is_read_with_its_domain() {
        let lut = parse(SQUARES).expect("a cube");
        assert_eq!(lut.curves, None);
        assert_eq!(lut.apply([0.25, 0.5, 1.0]), [0.25, 0.5, 0.5]);
    }

    /// As DaVinci Resolve writes them.
    #[test]
    fn curves_may_stand_before_a_cube() {
        let cube = SQUARES.split("DOMAIN_MAX 1 1 2\n").nth(1).expect("colours");
        let text = format!(
            "\u{feff}LUT_1D_SIZE 2\nLUT_1D_INPUT_RANGE 0 4\nLUT_3D_SIZE 2\nLUT_3D_INPUT_RANGE 0.0 1.0\n0 0 0\n1 1 0.5\n{cube}"
        );
        let lut = parse(&text).expect("both");
        assert_eq!(lut.apply([1.0, 2.0, 4.0]), [0.25, 0.5, 0.5]);
    }

    #[test]
    fn keywords_of_other_programs_are_skipped_with_a_word() {
        let lut = parse(&format!("LUT_IN_VIDEO_RANGE\nLUT_OF_TOMORROW 7\n{SQUARES}"));
        let lut = lut.expect("a cube");
        assert_eq!(lut.apply([0.25, 0.5, 1.0]), [0.25, 0.5, 0.5]);
        assert!(
            lut.warnings[0].contains("video range"),
            "{:?}",
            lut.warnings
        );
        assert!(lut.warnings[1].contains("LUT_OF_TOMORROW is not known"));
    }

    #[test]
    fn what_is_none_says_what_is_wrong() {
        for (change, with, why) in [
            ("LUT_3D_SIZE 2", "", "line 6: comes before any size"),
            ("LUT_3D_SIZE 2", "LUT_3D_SIZE 300", "line 3: a size of 2 to"),
            ("LUT_3D_SIZE 2", "LUT_3D_SIZE 3", "holds 8 colours"),
            ("0 1 0", "0 1", "line 8: 3 numbers"),
            ("0 1 0", "0 nan 0", "line 8: a value is no finite"),
            ("DOMAIN_MAX 1 1 2", "DOMAIN_MAX 1 0 1", "range ends"),
            ("TITLE", "ply", "line 1: \"ply\" is no keyword"),
        ] {
            let found = parse(&SQUARES.replace(change, with)).expect_err(why);
            assert!(found.contains(why), "{found}");
        }
    }
}
