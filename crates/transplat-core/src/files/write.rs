//! Files out. Everything is written under a temporary name beside its place and renamed when it is whole.

use std::fs::File;
use std::io::{BufRead, BufReader, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use image::ImageEncoder;

use super::bake;
use super::estimate::EstimateFile;
use super::ply::{AssetFile, Format};
use super::read::open;
use crate::bake::Bake;
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::rasterize::Raster;
use crate::surfels::SurfelCloud;

/// Whether a file can be written there: to be asked before long work.
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
    Ok(())
}

pub(super) fn folder_of(path: &Path) -> &Path {
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
    // An error of the temporary file names that file, which nobody asked for.
    let plain = |e: std::io::Error| std::io::Error::from(e.kind());
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
    let mut builder = tempfile::Builder::new();
    builder.prefix(".transplat-").suffix(".part");
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

/// Writes what an asset told of its light.
///
/// # Errors
/// The file cannot be written; nothing is left of it then.
pub fn save_estimate(path: &Path, cloud: &SurfelCloud, estimate: &Estimate) -> Result<()> {
    write_atomically(path, |out| {
        let file = EstimateFile::new(cloud, estimate);
        Ok(serde_json::to_writer_pretty(out, &file)?)
    })
}

/// Writes a bake.
///
/// # Errors
/// The file cannot be written; nothing is left of it then.
pub fn save_bake(path: &Path, cloud: &SurfelCloud, baked: &Bake) -> Result<()> {
    write_atomically(path, |out| {
        out.write_all(bake::MAGIC)?;
        for value in [
            bake::geometry_key(cloud),
            cloud.len() as u64,
            bake::kind_of(baked.method()),
            baked.directions() as u64,
        ] {
            out.write_all(&value.to_le_bytes())?;
        }
        match baked {
            Bake::Harmonic(visibility) => out.write_all(&visibility.open),
            Bake::Directional(directional) => {
                out.write_all(bytemuck::cast_slice(&directional.tracer.fronts.of))?;
                out.write_all(bytemuck::cast_slice(&directional.open))?;
                out.write_all(bytemuck::cast_slice(&directional.starts))?;
                out.write_all(bytemuck::cast_slice(&directional.hits))
            }
        }
    })
}

/// Writes the asset again with other colour: every property, comment and trailing element that the file had, in its order.
///
/// `stored` is the colour `[n][K][3]` as the file stores it. Rows that were left out at loading are made harmless: what was no number is 0, and they are transparent.
///
/// # Errors
/// The source file is gone or has changed since it was loaded, or the output cannot be written.
pub fn write_relit_ply(asset: &AssetFile, stored: &[[f32; 3]], path: &Path) -> Result<()> {
    let source = open(&asset.path)?;
    let metadata = source.metadata().map_err(Error::io(&asset.path))?;
    if (metadata.len(), metadata.modified().ok()) != asset.stamp {
        return Err(Error::invalid(
            &asset.path,
            "has changed since it was loaded; load it again",
        ));
    }
    let columns = ColorColumns::new(asset, stored)?;
    let mut reader = BufReader::with_capacity(1 << 18, source);
    write_atomically(path, |out| {
        let prefix = asset.header.bytes
            + if asset.header.format == Format::Ascii {
                0
            } else {
                asset.header.skip
            };
        std::io::copy(&mut (&mut reader).take(prefix), out)?;
        if asset.header.format == Format::Ascii {
            columns.write_ascii(&mut reader, out)?;
        } else {
            reader.seek(SeekFrom::Start(prefix))?;
            columns.write_binary(&mut reader, out)?;
        }
        std::io::copy(&mut reader, out)?;
        Ok(())
    })
}

/// For each property of a row the index of the colour that replaces it.
struct ColorColumns<'a> {
    asset: &'a AssetFile,
    /// `[n][K][3]`
    stored: &'a [[f32; 3]],
    coefficients: usize,
    /// Per property: coefficient and channel.
    replaced: Vec<Option<(usize, usize)>>,
}

impl<'a> ColorColumns<'a> {
    fn new(asset: &'a AssetFile, stored: &'a [[f32; 3]]) -> Result<Self> {
        let properties = &asset.header.properties;
        let rest = properties
            .iter()
            .filter(|p| p.name.starts_with("f_rest_"))
            .count();
        let coefficients = rest / 3 + 1;
        let rows = asset.report.vertices;
        if stored.len() != rows * coefficients {
            return Err(Error::Mismatch(format!(
                "{} colour coefficients do not fit {rows} surfels of {coefficients}",
                stored.len()
            )));
        }
        let replaced = properties
            .iter()
            .map(|p| {
                let number = |prefix: &str| p.name.strip_prefix(prefix)?.parse::<usize>().ok();
                if let Some(channel) = number("f_dc_") {
                    return (channel < 3).then_some((0, channel));
                }
                let i = number("f_rest_")?;
                Some((i % (coefficients - 1) + 1, i / (coefficients - 1)))
            })
            .collect();
        Ok(Self {
            asset,
            stored,
            coefficients,
            replaced,
        })
    }

    /// The value that replaces property `column` of `row`, if any does; `old` is what was there.
    fn value(&self, row: usize, column: usize, old: impl FnOnce() -> f32) -> Option<f32> {
        if let Some((coefficient, channel)) = self.replaced[column] {
            return Some(self.stored[row * self.coefficients + coefficient][channel]);
        }
        let property = &self.asset.header.properties[column];
        if property.scalar.is_float() && self.asset.report.left_out.binary_search(&row).is_ok() {
            if property.name == "opacity" {
                return Some(-30.0);
            }
            let old = old();
            // What was left out for being out of range becomes small too.
            return (!old.is_finite() || old.abs() > 1e6).then_some(0.0);
        }
        None
    }

    fn write_binary(&self, reader: &mut impl Read, out: &mut impl Write) -> std::io::Result<()> {
        let header = &self.asset.header;
        let big_endian = header.big_endian();
        let mut row_bytes = vec![0u8; header.stride];
        for row in 0..self.asset.report.vertices {
            reader.read_exact(&mut row_bytes)?;
            for (column, p) in header.properties.iter().enumerate() {
                let at = &mut row_bytes[p.offset..];
                let old = || p.scalar.read(at, big_endian);
                if let Some(value) = self.value(row, column, old) {
                    p.scalar.write_float(value, at, big_endian);
                }
            }
            out.write_all(&row_bytes)?;
        }
        Ok(())
    }

    fn write_ascii(&self, reader: &mut impl BufRead, out: &mut impl Write) -> std::io::Result<()> {
        let mut line = String::new();
        let (mut skipped, mut row) = (0, 0);
        while row < self.asset.report.vertices {
            line.clear();
            if reader.read_line(&mut line)? == 0 {
                return Err(std::io::ErrorKind::UnexpectedEof.into());
            }
            if line.trim().is_empty() || skipped < self.asset.header.skip {
                skipped += u64::from(!line.trim().is_empty());
                out.write_all(line.as_bytes())?;
                continue;
            }
            for (column, word) in line.split_ascii_whitespace().enumerate() {
                let separator = if column == 0 { "" } else { " " };
                let old = || word.parse().unwrap_or(f32::NAN);
                match self.value(row, column, old) {
                    Some(value) => write!(out, "{separator}{value}")?,
                    None => write!(out, "{separator}{word}")?,
                }
            }
            out.write_all(b"\n")?;
            row += 1;
        }
        Ok(())
    }
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
            image::ExtendedColorType::Rgba8,
        ),
        PngBits::Sixteen => (
            values()
                .flat_map(|v| ((v * 65535.0 + 0.5) as u16).to_ne_bytes())
                .collect(),
            image::ExtendedColorType::Rgba16,
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

/// What an EXR's values are stored as.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ExrFloats {
    /// 32 bits.
    #[default]
    Full,
    /// 16 bits: half the size, up to 65504.
    Half,
}

/// Writes a float EXR from premultiplied linear colour.
///
/// # Errors
/// The file cannot be written.
pub fn write_exr(path: &Path, raster: &Raster, floats: ExrFloats) -> Result<()> {
    use exr::prelude::{Image, SpecificChannels, Vec2, WritableImage, f16};
    let at = |at: Vec2<usize>| raster.pixels[at.y() * raster.width + at.x()];
    let size = (raster.width, raster.height);
    // The encoder seeks, so it writes to memory first.
    let mut bytes = std::io::Cursor::new(Vec::new());
    let written = match floats {
        ExrFloats::Full => {
            let channels = SpecificChannels::rgba(|p| {
                let [r, g, b, a] = at(p);
                (r, g, b, a)
            });
            let image = Image::from_channels(size, channels);
            image.write().to_buffered(&mut bytes)
        }
        ExrFloats::Half => {
            let channels = SpecificChannels::rgba(|p| {
                let [r, g, b, a] = at(p).map(|v| f16::from_f32(v.clamp(-65504.0, 65504.0)));
                (r, g, b, a)
            });
            let image = Image::from_channels(size, channels);
            image.write().to_buffered(&mut bytes)
        }
    };
    written.map_err(|e| Error::invalid(path, format!("OpenEXR: {e}")))?;
    write_atomically(path, |out| out.write_all(bytes.get_ref()))
}

#[cfg(test)]
mod tests;
