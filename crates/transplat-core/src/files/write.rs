//! Files out. Everything is written under a temporary name beside its place and renamed when it is whole.

use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use image::codecs::hdr::HdrEncoder;
use image::{ExtendedColorType, ImageEncoder};

use crate::environment::EnvironmentMap;
use crate::error::{Error, Result};
use crate::rasterize::Raster;

/// Checks, before long work, that a file can be written there.
///
/// # Errors
/// It is a directory, its folder does not exist, or it is there and may not be written.
pub fn check_output(path: &Path) -> Result<()> {
    // Through a link, the file it points to is what is replaced.
    let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    if target.is_dir() {
        return Err(Error::invalid(
            path,
            "is a directory; the name of a file is expected",
        ));
    }
    if target.exists() {
        // What may not be written may not be replaced either.
        File::options()
            .write(true)
            .open(&target)
            .map_err(Error::io(path))?;
        return Ok(());
    }
    let folder = folder_of(&target);
    if !folder.is_dir() {
        return Err(Error::invalid(
            path,
            format!("the folder {} does not exist", folder.display()),
        ));
    }
    check_folder(folder)
}

/// Checks, before long work, that files can be written into a folder, or it can be made.
///
/// # Errors
/// It, or what there is of the way to it, is no folder or may not be written.
pub fn check_folder(path: &Path) -> Result<()> {
    let whole = std::path::absolute(path).map_err(Error::io(path))?;
    let there = whole.ancestors().find(|folder| folder.exists());
    let there = there.unwrap_or(&whole);
    if !there.is_dir() {
        let what = format!("{} is no folder", there.display());
        return Err(Error::invalid(path, what));
    }
    let tried = temporary().tempfile_in(there);
    tried.map(drop).map_err(|e| Error::io(path)(plain(e)))
}

/// A file that is there until it is whole.
fn temporary() -> tempfile::Builder<'static, 'static> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".transplat-").suffix(".part");
    builder
}

/// Without the name of a temporary file, which nobody asked for.
fn plain(error: std::io::Error) -> std::io::Error {
    error.kind().into()
}

/// The folder that a file is in.
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Writes a file whole or not at all. What is no regular file (a pipe, `/dev/null`) is written straight.
///
/// # Errors
/// The folder does not exist or cannot be written, or the disk is full; a file that was there before is still there then.
pub fn write_atomically(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<&mut File>) -> std::io::Result<()>,
) -> Result<()> {
    let fail = Error::io;
    check_output(path)?;
    let target: PathBuf = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let through = |file: &mut File| {
        let mut out = BufWriter::with_capacity(1 << 18, file);
        write(&mut out)?;
        out.flush()
    };
    if target.exists() && !target.is_file() {
        let mut file = File::options()
            .write(true)
            .open(&target)
            .map_err(fail(path))?;
        return through(&mut file).map_err(fail(path));
    }
    let folder = folder_of(&target);
    let mut builder = temporary();
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        // As any new file: what the umask allows, not the owner alone.
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    let mut file = builder
        .tempfile_in(folder)
        .map_err(|e| fail(path)(plain(e)))?;
    through(file.as_file_mut()).map_err(fail(path))?;
    file.as_file().sync_all().map_err(fail(path))?;
    file.persist(&target).map_err(|e| fail(path)(e.error))?;
    Ok(())
}

/// Writes an 8-bit PNG from display-encoded straight colour and alpha, `[height][width]`, values 0 to 1.
///
/// # Errors
/// The file cannot be written.
pub fn write_png(
    path: &Path,
    width: usize,
    height: usize,
    rgba: &[[f32; 4]],
    bits: PngBits,
) -> Result<()> {
    let values = || rgba.iter().flatten().map(|v| v.clamp(0.0, 1.0));
    let (bytes, kind): (Vec<u8>, _) = match bits {
        PngBits::Eight => (
            values().map(|v| (v * 255.0 + 0.5) as u8).collect(),
            ExtendedColorType::Rgba8,
        ),
        PngBits::Sixteen => (
            values()
                .flat_map(|v| ((v * 65535.0 + 0.5) as u16).to_ne_bytes())
                .collect(),
            ExtendedColorType::Rgba16,
        ),
    };
    write_atomically(path, |out| {
        image::codecs::png::PngEncoder::new(out)
            .write_image(&bytes, width as u32, height as u32, kind)
            .map_err(std::io::Error::other)
    })
}

/// Bits of a channel of a PNG.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum PngBits {
    /// 8.
    #[default]
    Eight,
    /// 16.
    Sixteen,
}

/// Number format of an EXR.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExrFloats {
    /// 32 bits.
    #[default]
    Full,
    /// 16 bits: half the size, up to 65504.
    Half,
}

/// True where an environment can be written by that name.
pub fn is_environment_name(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    is_radiance(path) || extension.eq_ignore_ascii_case("exr")
}

fn is_radiance(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    extension.eq_ignore_ascii_case("hdr")
}

/// Writes an environment as OpenEXR, or as Radiance where its name ends with .hdr.
///
/// # Errors
/// The file cannot be written.
pub fn write_environment(path: &Path, map: &EnvironmentMap) -> Result<()> {
    if is_radiance(path) {
        let size = [map.width() as u32, map.height() as u32];
        let bytes = bytemuck::cast_slice(map.pixels());
        return write_atomically(path, |out| {
            HdrEncoder::new(out)
                .write_image(bytes, size[0], size[1], ExtendedColorType::Rgb32F)
                .map_err(std::io::Error::other)
        });
    }
    let opaque = |&[r, g, b]: &[f32; 3]| [r, g, b, 1.0];
    let raster = Raster {
        width: map.width(),
        height: map.height(),
        pixels: map.pixels().iter().map(opaque).collect(),
        depth: Vec::new(),
    };
    write_exr(path, &raster, ExrFloats::Full)
}

/// A channel of a picture in layers.
#[derive(Clone, Debug)]
pub struct Channel {
    /// `layer.letter`, or a letter alone for what is shown where nobody asks for layers.
    pub name: String,
    /// `[height][width]`
    pub values: Vec<f32>,
}

/// Writes a picture in layers as one float EXR, with the look (JSON) that it was made by in its attribute `transplat`.
///
/// # Errors
/// A channel's name is not of ASCII characters, or the file cannot be written.
pub fn write_layers(
    path: &Path,
    size: [usize; 2],
    channels: Vec<Channel>,
    made_by: &str,
) -> Result<()> {
    use exr::prelude::{
        AnyChannel, AnyChannels, AttributeValue, Compression, Encoding, FlatSamples, Image, Layer,
        LayerAttributes, Text, WritableImage,
    };
    let channels = channels.into_iter();
    // What is no ASCII, the format has no encoding for.
    let text = |text: &str| Text::new_or_none(text).filter(|_| text.is_ascii());
    let channels = channels.map(|c| {
        let why = || Error::invalid(path, format!("{}: no name of a channel", c.name));
        let name = text(&c.name).ok_or_else(why)?;
        Ok(AnyChannel::new(name, FlatSamples::F32(c.values)))
    });
    let channels = channels.collect::<Result<_>>()?;
    let mut attributes = LayerAttributes::default();
    if let (Some(name), Some(value)) = (text("transplat"), text(&ascii_json(made_by))) {
        (attributes.other).insert(name, AttributeValue::Text(value));
    }
    let encoding = Encoding {
        compression: Compression::ZIP16,
        ..Encoding::default()
    };
    let list = AnyChannels::sort(channels);
    let layer = Layer::new((size[0], size[1]), attributes, encoding, list);
    let mut bytes = std::io::Cursor::new(Vec::new());
    let written = Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes);
    written.map_err(|e| Error::invalid(path, format!("OpenEXR: {e}")))?;
    write_atomically(path, |out| out.write_all(bytes.get_ref()))
}

/// JSON with everything that is not ASCII escaped: it stands within strings only.
fn ascii_json(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if c.is_ascii() {
            out.push(c);
        } else {
            let units = c.encode_utf16(&mut [0; 2]).to_vec();
            units.iter().for_each(|u| out += &format!("\\u{u:04x}"));
        }
    }
    out
}

/// Writes a float EXR from premultiplied linear colour.
///
/// # Errors
/// The file cannot be written.
pub fn write_exr(path: &Path, raster: &Raster, floats: ExrFloats) -> Result<()> {
    use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage, f16};
    let at = |at: Vec2<usize>| raster.pixels[at.y() * raster.width + at.x()];
    let size = (raster.width, raster.height);
    // The encoder seeks, so it writes to memory first; in parallel it would write blocks in any order, and no two files were alike.
    let mut bytes = std::io::Cursor::new(Vec::new());
    let written = match floats {
        ExrFloats::Full => {
            let channels = SpecificChannels::rgba(|p| {
                let [r, g, b, a] = at(p);
                (r, g, b, a)
            });
            let image = Image::from_channels(size, channels);
            image.write().non_parallel().to_buffered(&mut bytes)
        }
        ExrFloats::Half => {
            let channels = SpecificChannels::rgba(|p| {
                let [r, g, b, a] = at(p).map(|v| f16::from_f32(v.clamp(-65504.0, 65504.0)));
                (r, g, b, a)
            });
            let image = Image::from_channels(size, channels);
            image.write().non_parallel().to_buffered(&mut bytes)
        }
    };
    written.map_err(|e| Error::invalid(path, format!("OpenEXR: {e}")))?;
    write_atomically(path, |out| out.write_all(bytes.get_ref()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_what_was_there() {
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("out");
        std::fs::write(&path, "before").expect("room for it");
        let result = write_atomically(&path, |out| {
            out.write_all(b"half")?;
            Err(std::io::ErrorKind::StorageFull.into())
        });
        assert!(result.is_err());
        assert_eq!(std::fs::read(&path).expect("it is there"), b"before");
        assert_eq!(
            std::fs::read_dir(folder.path()).expect("a folder").count(),
            1
        );
        assert!(write_atomically(folder.path(), |_| Ok(())).is_err());
        assert!(write_atomically(&folder.path().join("no/such"), |_| Ok(())).is_err());
    }
}
