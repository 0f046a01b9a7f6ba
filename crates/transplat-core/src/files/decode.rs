//! Guarded calls of third-party decoders: one that panics is an error, and none takes more memory than its file may need.

mod guard;
mod json;

use std::io::{BufRead, Cursor, Read, Seek};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use exr::block::UncompressedBlock;
use exr::block::chunk::Chunk;
use exr::meta::MetaData;
use exr::meta::attribute::SampleType;
use exr::meta::header::Header;
use exr::prelude::f16;
use flate2::bufread::{GzDecoder, MultiGzDecoder};
use half::slice::HalfFloatSliceExt;
use image::{DynamicImage, ImageDecoder, ImageReader, Limits};
use rayon::prelude::*;
use zip::ZipArchive;

use guard::guarded;
pub use json::from_slice as json;

/// Result with what is wrong, in words.
type Result<T> = std::result::Result<T, String>;

/// Chunks of an OpenEXR file that are held at once: enough for all cores, and little memory.
const CHUNKS_AT_ONCE: usize = 64;

/// A stream whose decoder is guarded at each read.
pub struct Guarded<R>(R);

impl<R: Read> Read for Guarded<R> {
    fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<usize> {
        let read = guarded("the stream", || Ok::<_, String>(self.0.read(bytes)));
        read.map_err(std::io::Error::other)?
            .map_err(|e| match e.kind() {
                kind @ std::io::ErrorKind::UnexpectedEof => {
                    std::io::Error::new(kind, "it is cut off")
                }
                // Decoders say where in their own code.
                kind => std::io::Error::new(kind, "the packed data is broken"),
            })
    }
}

impl<R> Guarded<R> {
    /// The stream behind it.
    pub fn into_inner(self) -> R {
        self.0
    }
}

/// Content of a gzip stream, to be read in parts.
pub fn gunzip<R: BufRead>(packed: R) -> Guarded<GzDecoder<R>> {
    Guarded(GzDecoder::new(packed))
}

/// Content of a gzip file's streams, one after the other.
pub fn gunzip_all<R: BufRead>(packed: R) -> Guarded<MultiGzDecoder<R>> {
    Guarded(MultiGzDecoder::new(packed))
}

/// The decoder of a zstd frame.
pub type Zstd<R> = ruzstd::decoding::StreamingDecoder<R, ruzstd::decoding::FrameDecoder>;

/// Content of a zstd frame, to be read in parts.
pub fn unzstd<R: Read>(packed: R) -> Result<Guarded<Zstd<R>>> {
    let decoder = || ruzstd::decoding::StreamingDecoder::new(packed);
    let opened = guarded("the zstd frame", decoder);
    opened
        .map(Guarded)
        .map_err(|_| "the zstd frame is broken".into())
}

/// Bytes of a text in base64.
pub fn base64(text: &str) -> Result<Vec<u8>> {
    guarded("the base64 text", || STANDARD.decode(text))
}

/// A zip archive.
pub struct Archive<R>(ZipArchive<R>);

impl<R: Read + Seek> Archive<R> {
    pub fn open(file: R) -> Result<Self> {
        let opened = guarded("the zip archive", || ZipArchive::new(file));
        opened
            .map(Self)
            .map_err(|_| "it is cut off or broken; copy it again".into())
    }

    /// Names of its files, without those that systems add (`__MACOSX`, `.DS_Store`).
    pub fn names(&self) -> Vec<String> {
        let is_file = |name: &String| {
            let mut parts = name.split('/');
            !name.ends_with('/') && !parts.any(|part| part == "__MACOSX" || part.starts_with('.'))
        };
        let names = self
            .0
            .file_names()
            .filter_map(|name| Some(name.ok()?.into_owned()));
        names.filter(is_file).collect()
    }

    /// A file of it, of at most so many bytes.
    pub fn read(&mut self, name: &str, limit: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        guarded(name, || {
            let file = self.0.by_name(name);
            let file = file.map_err(|_| "is not in the archive, or packed in an unknown way")?;
            let read = file.take(limit + 1).read_to_end(&mut bytes);
            read.map_err(|_| "is cut off or broken in the archive")
        })?;
        if bytes.len() as u64 > limit {
            return Err(format!("is larger than {} MB", limit >> 20));
        }
        Ok(bytes)
    }

    /// Bytes that a file of it claims to have, unpacked.
    pub fn size(&mut self, name: &str) -> Option<u64> {
        guarded(name, || self.0.by_name(name).map(|file| file.size())).ok()
    }

    /// The first bytes of a file of it.
    pub fn start(&mut self, name: &str, count: u64) -> Result<Vec<u8>> {
        let mut bytes = Vec::new();
        guarded(name, || {
            let file = self.0.by_name(name).map_err(|e| e.to_string())?;
            let read = file.take(count).read_to_end(&mut bytes);
            read.map_err(|e| e.to_string())
        })?;
        Ok(bytes)
    }
}

/// A PNG, JPEG or WebP image that was not decoded yet.
pub struct DecodedImage<D> {
    decoder: D,
    /// Width and height of what is decoded, before it is turned.
    stored: [usize; 2],
}

/// Reads the header of a PNG, JPEG or WebP image.
pub fn picture<'a>(file: impl BufRead + Seek + 'a) -> Result<DecodedImage<impl ImageDecoder + 'a>> {
    guarded("the image", || {
        let reader = ImageReader::new(file).with_guessed_format();
        let decoder = reader
            .map_err(|e| e.to_string())?
            .into_decoder()
            .map_err(|e| e.to_string())?;
        let (width, height) = decoder.dimensions();
        let stored = [width as usize, height as usize];
        Ok::<_, String>(DecodedImage { decoder, stored })
    })
}

impl<D: ImageDecoder> DecodedImage<D> {
    /// Width and height as it is meant to be seen (EXIF orientation).
    pub fn size(&mut self) -> [usize; 2] {
        use image::metadata::Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
        let orientation = guarded("the orientation", || self.decoder.orientation());
        let [width, height] = self.stored;
        match orientation {
            Ok(Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH) => [height, width],
            _ => [width, height],
        }
    }

    /// Decodes it in at most so many bytes, turned as it is meant to be seen.
    pub fn decode(mut self, limit: u64) -> Result<DynamicImage> {
        let orientation = guarded("the orientation", || self.decoder.orientation());
        let mut image = guarded("the image", || {
            let mut limits = Limits::default();
            limits.max_alloc = Some(limit);
            self.decoder.set_limits(limits)?;
            DynamicImage::from_decoder(self.decoder)
        })?;
        if let Ok(orientation) = orientation {
            image.apply_orientation(orientation);
        }
        Ok(image)
    }
}

/// Decodes an image in memory of which the size was checked.
pub fn small_picture(
    bytes: &[u8],
    check: impl FnOnce([usize; 2]) -> Result<u64>,
) -> Result<DynamicImage> {
    let mut picture = picture(Cursor::new(bytes))?;
    let limit = check(picture.size())?;
    picture.decode(limit)
}

/// Headers of an OpenEXR file, one a part.
pub fn exr_headers(file: impl Read + Seek) -> Result<Vec<Header>> {
    let read = || MetaData::read_from_buffered(file, false);
    let meta = guarded("the OpenEXR header", read).map_err(of_exr)?;
    Ok(meta.headers.into_vec())
}

/// The decoder's words where it lacks something; those for what is wrong say where in its own code.
fn of_exr(why: String) -> String {
    match why.strip_prefix("not supported: ") {
        Some(what) => format!("OpenEXR: not read: {what}"),
        None => "no whole OpenEXR file: it is cut off or broken; save or copy it again".into(),
    }
}

/// Reads channels of a part of an OpenEXR file, at its largest level: `[channel][height][width]`, of the header's own size.
///
/// Channels must not be subsampled, and the size of the part was checked.
pub fn exr_channels(
    file: impl Read + Seek,
    part: usize,
    channels: &[usize],
) -> Result<Vec<Vec<f32>>> {
    guarded("the OpenEXR file", || {
        read_exr_channels(file, part, channels)
    })
    .map_err(of_exr)
}

fn read_exr_channels(
    file: impl Read + Seek,
    part: usize,
    channels: &[usize],
) -> exr::error::Result<Vec<Vec<f32>>> {
    let reader = exr::block::read(file, false)?;
    let meta = reader.meta_data().clone();
    let header = &meta.headers[part];
    let [width, height] = [header.layer_size.width(), header.layer_size.height()];
    let mut planes = vec![vec![0f32; width * height]; channels.len()];
    let mut halves = Vec::new();
    let mut chunks = reader.filter_chunks(false, |_, _, block| {
        block.layer == part && block.level == exr::prelude::Vec2(0, 0)
    })?;
    loop {
        let some: Vec<Chunk> = chunks
            .by_ref()
            .take(CHUNKS_AT_ONCE)
            .collect::<exr::error::Result<_>>()?;
        if some.is_empty() {
            return Ok(planes);
        }
        let decoded = some.into_par_iter().map(|chunk| {
            // On a thread of the pool, where it must be as quiet.
            let decode = || UncompressedBlock::decompress_chunk(chunk, &meta, false);
            guarded("a block", decode).map_err(|why| exr::error::Error::Invalid(why.into()))
        });
        for block in decoded.collect::<exr::error::Result<Vec<_>>>()? {
            for line in block.lines(&header.channels) {
                let Some(plane) = channels.iter().position(|c| *c == line.location.channel) else {
                    continue;
                };
                let at = line.location.position;
                let row =
                    &mut planes[plane][at.y() * width + at.x()..][..line.location.sample_count];
                match header.channels.list[line.location.channel].sample_type {
                    SampleType::F16 => {
                        halves.resize(row.len(), f16::ZERO);
                        line.read_samples_into_slice(&mut halves)?;
                        halves.convert_to_f32_slice(row);
                    }
                    SampleType::F32 => line.read_samples_into_slice(row)?,
                    SampleType::U32 => {
                        for (out, sample) in row.iter_mut().zip(line.read_samples::<u32>()) {
                            *out = sample? as f32;
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_decoder_that_panics_is_an_error() {
        let failed = guarded("the thing", || -> Result<()> { panic!("as decoders do") });
        assert!(failed.is_err_and(|why| why.contains("the thing is broken")));
        let mut stream = Guarded(Panics);
        assert!(stream.read(&mut [0; 4]).is_err());
    }

    struct Panics;

    impl Read for Panics {
        fn read(&mut self, _: &mut [u8]) -> std::io::Result<usize> {
            panic!("as decoders do")
        }
    }
}
