//! What all readers share.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};

/// Maps of more pixels than this are refused: 16384 x 8192, 1.6 GB in memory.
pub const MAX_ENVIRONMENT_PIXELS: usize = 1 << 27;

/// No edge of a map is longer: 512 pixels a degree, and what is kept a column stays small.
pub const MAX_ENVIRONMENT_EDGE: usize = 1 << 16;

/// Opens a file for reading; a directory is an error here, not at the first read.
pub(crate) fn open(path: &Path) -> Result<File> {
    // Asked before it is opened: opening a pipe waits for ever.
    let metadata = std::fs::metadata(path).map_err(Error::io(path))?;
    if metadata.is_dir() {
        return Err(Error::invalid(
            path,
            "is a directory where a file is expected",
        ));
    }
    if !metadata.is_file() {
        return Err(Error::invalid(path, "is no regular file"));
    }
    File::open(path).map_err(Error::io(path))
}

/// Reads a whole file, which must not be larger than `limit` bytes.
pub(crate) fn read_all(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let file = open(path)?;
    let mut bytes = Vec::new();
    file.take(limit + 1)
        .read_to_end(&mut bytes)
        .map_err(Error::io(path))?;
    if bytes.len() as u64 > limit {
        return Err(Error::invalid(
            path,
            format!(
                "larger than {} MB, which no file of this kind is",
                limit >> 20
            ),
        ));
    }
    Ok(bytes)
}

/// Checks the size that a map's header claims.
pub(crate) fn check_map_size(path: &Path, width: usize, height: usize) -> Result<()> {
    if width == 0 || height == 0 {
        return Err(Error::invalid(path, "the map has no pixels"));
    }
    let too_large = width.max(height) > MAX_ENVIRONMENT_EDGE
        || width
            .checked_mul(height)
            .is_none_or(|n| n > MAX_ENVIRONMENT_PIXELS);
    if too_large {
        return Err(Error::invalid(
            path,
            format!(
                "claims {width} x {height} pixels; at most {MAX_ENVIRONMENT_PIXELS} (16384 x 8192) are accepted"
            ),
        ));
    }
    Ok(())
}

/// So many bytes, of which no more are held than there are.
pub(crate) fn read_exactly(reader: &mut impl Read, count: u64) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    reader.take(count).read_to_end(&mut bytes)?;
    if (bytes.len() as u64) < count {
        let message = format!("it ends after {} of {count} bytes", bytes.len());
        let kind = std::io::ErrorKind::UnexpectedEof;
        return Err(std::io::Error::new(kind, message));
    }
    Ok(bytes)
}
