//! What a file is, by its first bytes.

use std::io::Read;
use std::path::Path;

use super::{bake, lut, read::open};
use crate::error::{Error, Result};

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
    /// A table of colours (.cube).
    Lut,
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
        [b'p', b'l', b'y', after @ ..] if after.first().is_none_or(u8::is_ascii_whitespace) => {
            FileKind::Ply
        }
        _ if start.starts_with(b"#?") => FileKind::Hdr,
        _ if start.starts_with(&[0x76, 0x2f, 0x31, 0x01]) => FileKind::Exr,
        _ if start.starts_with(b"\x89PNG") || start.starts_with(&[0xff, 0xd8, 0xff]) => {
            FileKind::Picture
        }
        _ if start.starts_with(bake::ANY_MAGIC) => FileKind::Bake,
        _ if start.trim_ascii_start().starts_with(b"{") => FileKind::Look,
        _ if lut::begins_as_one(&start) => FileKind::Lut,
        // These may begin with any comment.
        _ if lut::begins_as_text(&start) && is_named(path, "cube") => FileKind::Lut,
        _ if is_named(path, "json") => {
            let message = "no look: that is a JSON object, and begins with \"{\"";
            return Err(Error::invalid(path, message));
        }
        _ => {
            return Err(Error::invalid(
                path,
                "its content is of no kind that this program knows; it opens splats (.ply), environments (.hdr, .exr, .png, .jpg), bakes, looks and tables of colours (.cube)",
            ));
        }
    })
}

fn is_named(path: &Path, ending: &str) -> bool {
    let extension = path.extension();
    extension.is_some_and(|e| e.eq_ignore_ascii_case(ending))
}
