//! Helpers that all readers share.

use std::fs::File;
use std::io::{BufRead, BufReader, Cursor, Read, Seek, SeekFrom};
use std::path::Path;

use super::decode::{self, Archive};
use super::sog::layout::meta_in;
use crate::error::{Error, Result};

/// Maps of more pixels than this are refused: 16384 x 8192, 1.6 GB in memory.
pub const MAX_ENVIRONMENT_PIXELS: usize = 1 << 27;

/// No edge of a map is longer: 512 pixels a degree, and what is kept a column stays small.
pub const MAX_ENVIRONMENT_EDGE: usize = 1 << 16;

/// First bytes of a gzip stream.
const GZIP: &[u8] = &[0x1f, 0x8b];

/// First bytes of an SPZ splat: in the clear in version 4, inside the gzip stream before.
pub(super) const SPZ: &[u8] = b"NGSP";

/// First bytes of a zip archive.
pub(super) const ZIP: &[u8] = b"PK\x03\x04";

/// Bytes that are unpacked of a file at most.
const MAX_UNPACKED: u64 = 1 << 34;

/// A file to be read, or what was packed in it.
pub(super) struct Input {
    stored: Stored,
    length: u64,
}

enum Stored {
    File(BufReader<File>),
    Unpacked(Cursor<Vec<u8>>),
}

impl Input {
    /// Bytes of it in all.
    pub fn len(&self) -> u64 {
        self.length
    }

    fn file(file: File, length: u64) -> Self {
        Self {
            stored: Stored::File(BufReader::with_capacity(BUFFER, file)),
            length,
        }
    }

    fn unpacked(bytes: Vec<u8>) -> Self {
        Self {
            length: bytes.len() as u64,
            stored: Stored::Unpacked(Cursor::new(bytes)),
        }
    }
}

/// Bytes that are read of a file at once.
const BUFFER: usize = 1 << 20;

impl Read for Input {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        match &mut self.stored {
            Stored::File(file) => file.read(bytes),
            Stored::Unpacked(bytes_of) => bytes_of.read(bytes),
        }
    }
}

impl BufRead for Input {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        match &mut self.stored {
            Stored::File(file) => file.fill_buf(),
            Stored::Unpacked(bytes) => bytes.fill_buf(),
        }
    }

    fn consume(&mut self, count: usize) {
        match &mut self.stored {
            Stored::File(file) => file.consume(count),
            Stored::Unpacked(bytes) => bytes.consume(count),
        }
    }
}

impl Seek for Input {
    fn seek(&mut self, to: SeekFrom) -> std::io::Result<u64> {
        match &mut self.stored {
            Stored::File(file) => file.seek(to),
            Stored::Unpacked(bytes) => bytes.seek(to),
        }
    }

    fn seek_relative(&mut self, offset: i64) -> std::io::Result<()> {
        match &mut self.stored {
            Stored::File(file) => file.seek_relative(offset),
            Stored::Unpacked(bytes) => bytes.seek_relative(offset),
        }
    }
}

/// Opens a file for reading as it is; a directory is an error here, not at the first read.
fn open_packed(path: &Path) -> Result<File> {
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

/// Endings of splats that are read, without the dot.
pub const SPLAT_ENDINGS: [&str; 7] = ["ply", "spz", "sog", "splat", "ksplat", "glb", "gltf"];

/// Packing of one file in another.
enum Packing {
    /// It is what it is.
    None,
    Gzip,
    /// The one file in a zip archive, and its bytes.
    Zip(Archive<BufReader<File>>, String),
}

/// Opens a file, and says how it packs another one. Formats of splats that are packed themselves (SPZ, SOG) are what they are.
fn packing(path: &Path) -> Result<(File, Packing)> {
    let mut file = open_packed(path)?;
    let again = |file: &File| {
        let file = file.try_clone().map_err(Error::io(path))?;
        Ok::<_, Error>(BufReader::with_capacity(BUFFER, file))
    };
    let mut start = Vec::new();
    let read = file.by_ref().take(4).read_to_end(&mut start);
    read.and_then(|_| file.rewind()).map_err(Error::io(path))?;
    let packing = if start.starts_with(GZIP) {
        let mut head = Vec::new();
        let read = decode::gunzip(again(&file)?).take(4).read_to_end(&mut head);
        // What is broken already here is told by the reader of what it claims to be.
        match read.is_ok() && !head.starts_with(SPZ) {
            true => Packing::Gzip,
            false => Packing::None,
        }
    } else if start.starts_with(ZIP) {
        let invalid = |why: String| Error::invalid(path, why);
        let archive = Archive::open(again(&file)?);
        let archive = archive.map_err(|why| invalid(format!("is no whole zip archive: {why}")))?;
        let names = archive.names();
        // What a splat or a light is called, among whatever else lies beside it.
        let is_one = |name: &&String| {
            let end = name
                .rsplit('.')
                .next()
                .unwrap_or_default()
                .to_ascii_lowercase();
            SPLAT_ENDINGS.contains(&&*end) || ["hdr", "exr"].contains(&&*end)
        };
        let known: Vec<&String> = names.iter().filter(is_one).collect();
        match (&known[..], &names[..]) {
            _ if meta_in(&names).is_some() => Packing::None,
            ([name], _) => Packing::Zip(archive, (*name).clone()),
            (_, [name]) => Packing::Zip(archive, name.clone()),
            _ => {
                let some: Vec<&str> = names.iter().take(8).map(String::as_str).collect();
                return Err(invalid(format!(
                    "a zip archive of {} files; unpack it and open one of them ({})",
                    names.len(),
                    some.join(", ")
                )));
            }
        }
    } else {
        Packing::None
    };
    // What was read of it, was read through the same position.
    file.rewind().map_err(Error::io(path))?;
    Ok((file, packing))
}

/// Opens a file for reading, or the file that it packs.
pub(super) fn open(path: &Path) -> Result<Input> {
    let invalid = |why: String| Error::invalid(path, why);
    let (file, packing) = packing(path)?;
    let length = file.metadata().map_err(Error::io(path))?.len();
    match packing {
        Packing::None => Ok(Input::file(file, length)),
        Packing::Gzip => {
            let mut bytes = Vec::new();
            let packed = decode::gunzip_all(BufReader::with_capacity(BUFFER, file));
            let most = most_unpacked(length);
            let read = packed.take(most + 1).read_to_end(&mut bytes);
            read.map_err(|e| invalid(format!("the gzip stream is broken: {e}")))?;
            if bytes.len() as u64 > most {
                let mb = most >> 20;
                return Err(invalid(format!(
                    "unpacks to more than {mb} MB; unpack it first"
                )));
            }
            Ok(Input::unpacked(bytes))
        }
        Packing::Zip(mut archive, name) => {
            let bytes = archive.read(&name, most_unpacked(length));
            let bytes = bytes.map_err(|why| invalid(format!("{name}: {why}")))?;
            Ok(Input::unpacked(bytes))
        }
    }
}

/// Bytes that may be unpacked of so many: text of numbers packs 4 to 1, and a bomb 1000 to 1.
fn most_unpacked(packed: u64) -> u64 {
    (100 * packed).clamp(1 << 20, MAX_UNPACKED)
}

/// The first bytes of a file, or of the one that it packs, and how many it has where that is known.
pub(super) fn first_bytes(path: &Path, count: u64) -> Result<(Vec<u8>, Option<u64>)> {
    let (file, packing) = packing(path)?;
    let length = file.metadata().map_err(Error::io(path))?.len();
    let mut start = Vec::new();
    let length = match packing {
        Packing::None => {
            let read = file.take(count).read_to_end(&mut start);
            read.map_err(Error::io(path))?;
            Some(length)
        }
        Packing::Gzip => {
            let packed = decode::gunzip(BufReader::new(file));
            let read = packed.take(count).read_to_end(&mut start);
            read.map_err(|e| Error::invalid(path, format!("the gzip stream is broken: {e}")))?;
            None
        }
        Packing::Zip(mut archive, name) => {
            let read = archive.start(&name, count);
            start = read.map_err(|why| Error::invalid(path, format!("{name}: {why}")))?;
            archive.size(&name)
        }
    };
    Ok((start, length))
}

/// Checks that there is a file or folder that may be read.
///
/// # Errors
/// There is none, or it may not be.
pub fn check_readable(path: &Path) -> Result<()> {
    std::fs::metadata(path).map(drop).map_err(Error::io(path))
}

/// Reads a whole file, or what is packed in it, which must not be larger than `limit` bytes.
pub(crate) fn read_all(path: &Path, limit: u64) -> Result<Vec<u8>> {
    let input = open(path)?;
    let mut bytes = Vec::with_capacity(input.len().min(limit) as usize + 1);
    input
        .take(limit + 1)
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
