//! Splats in and out, whatever their format.

use std::fs::Metadata;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use super::kind::{FileKind, file_kind};
use super::rows::{AssetReport, NOT_WRITTEN};
use super::write::write_atomically;
use super::{ply, read};
use crate::error::{Error, Result};
use crate::surfels::SurfelCloud;

/// The file behind an asset: what [`write_relit`] needs to write it again with other colour.
#[derive(Clone, Debug)]
pub struct AssetFile {
    /// Where it was read.
    pub path: PathBuf,
    /// What was noticed.
    pub report: AssetReport,
    format: AssetFormat,
    stamp: Stamp,
    /// Which surfel each row of the file is, [`NOT_WRITTEN`] where the row is not written. `[vertices]`
    surfel_of_row: Arc<[u32]>,
}

impl AssetFile {
    /// The same for some of its surfels, numbered anew in that order.
    pub fn part(&self, surfels: &[usize]) -> Self {
        let mut anew = vec![NOT_WRITTEN; self.surfel_of_row.len()];
        for (new, surfel) in surfels.iter().enumerate() {
            anew[*surfel] = new as u32;
        }
        let rows = self.surfel_of_row.iter();
        let rows = rows.map(|surfel| anew.get(*surfel as usize).copied());
        Self {
            surfel_of_row: rows.map(|new| new.unwrap_or(NOT_WRITTEN)).collect(),
            ..self.clone()
        }
    }

    /// The surfel that a row of the file is, the first row is 0.
    pub fn surfel_of(&self, row: usize) -> Option<usize> {
        let surfel = *self.surfel_of_row.get(row)?;
        (surfel != NOT_WRITTEN).then_some(surfel as usize)
    }

    /// The row of the file that a surfel is, the first is 0.
    pub fn row_of(&self, surfel: usize) -> Option<usize> {
        let mut rows = self.surfel_of_row.iter();
        rows.position(|s| *s as usize == surfel)
    }
}

/// What a format needs to write a file of its own again.
#[derive(Clone, Debug)]
enum AssetFormat {
    Ply(ply::Header),
}

/// Length and time of change when it was read: it must still be the same when it is written again.
type Stamp = (u64, Option<SystemTime>);

fn stamp(metadata: &Metadata) -> Stamp {
    (metadata.len(), metadata.modified().ok())
}

/// Loads a splat: a 2DGS or 3DGS PLY.
///
/// A 3D Gaussian becomes a surfel by dropping its shortest axis. Rows with values that are no numbers are left out of the
/// picture (opacity 0) and reported.
///
/// # Errors
/// The file cannot be read, is no splat, lacks a property that a splat has, ends before its rows do, or is mostly no numbers.
pub fn load_asset(path: &Path) -> Result<(SurfelCloud, AssetFile)> {
    let kind = file_kind(path);
    let file = read::open(path)?;
    let metadata = file.metadata().map_err(Error::io(path))?;
    let mut reader = BufReader::with_capacity(1 << 20, file);
    let ((cloud, report, surfel_of_row), format) = match kind {
        Ok(FileKind::Ply) => {
            let (finished, header) = ply::read(path, &mut reader, metadata.len())?;
            (finished, AssetFormat::Ply(header))
        }
        Err(error @ Error::Io { .. }) => return Err(error),
        other => {
            let message = match other {
                _ if metadata.len() == 0 => "the file is empty; a splat in PLY is expected",
                Ok(FileKind::Look) => {
                    "a look, where one splat is expected; render, relight and the window open looks"
                }
                Ok(FileKind::Bake) => "a bake, where a splat is expected",
                Ok(FileKind::Lut) => {
                    "a table of colours, where a splat is expected (--lut takes it)"
                }
                Ok(_) => "a picture, where a splat is expected",
                Err(_) => "not a PLY splat: does not begin with \"ply\"",
            };
            return Err(Error::invalid(path, message));
        }
    };
    let asset = AssetFile {
        path: path.to_owned(),
        report,
        format,
        stamp: stamp(&metadata),
        surfel_of_row: surfel_of_row.into(),
    };
    Ok((cloud, asset))
}

/// Writes a splat that comes of no file, as 2DGS in PLY, with a colour `[n][K][3]` as [`crate::color::Encoding::Stored`] has it.
///
/// # Errors
/// The output cannot be written.
pub fn write_splat(cloud: &SurfelCloud, stored: &[[f32; 3]], path: &Path) -> Result<()> {
    write_atomically(path, |out| ply::write_made(cloud, stored, out))
}

/// Writes the asset again with other colour, and nothing else that its format holds changed.
///
/// `stored` is the colour `[n][K][3]` as the file stores it. Rows that were left out at loading are made harmless: what was no number is 0, and they are transparent.
///
/// # Errors
/// The source file is gone or has changed since it was loaded, or the output cannot be written.
pub fn write_relit(asset: &AssetFile, stored: &[[f32; 3]], path: &Path) -> Result<()> {
    let source = read::open(&asset.path)?;
    if stamp(&source.metadata().map_err(Error::io(&asset.path))?) != asset.stamp {
        return Err(Error::invalid(
            &asset.path,
            "has changed since it was loaded; load it again",
        ));
    }
    let mut reader = BufReader::with_capacity(1 << 18, source);
    match &asset.format {
        AssetFormat::Ply(header) => {
            let columns =
                ply::ColorColumns::new(header, &asset.report, &asset.surfel_of_row, stored)?;
            write_atomically(path, |out| columns.write(&mut reader, out))
        }
    }
}
