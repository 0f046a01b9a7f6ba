//! Splats in and out, whatever their format.

use std::fs::Metadata;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use glam::{Affine3A, DQuat, Quat};

use super::format::{self, SplatFormat};
use super::kind::{FileKind, file_kind, file_of};
use super::rows::{NOT_WRITTEN, SplatKind, SplatReport};
use super::write::write_atomically;
use super::written::WritableSplat;
use super::{gltf, ksplat, ply, read, sog, splat, spz};
use crate::error::{Error, Result};
use crate::surfels::{SurfelCloud, UpAxis};
use crate::transfer::materials::Materials;

/// The file behind an asset: what [`write_relit`] needs to write it again with other colour.
#[derive(Clone, Debug)]
pub struct SplatFile {
    /// Where it was read.
    pub path: PathBuf,
    /// Report of loading.
    pub report: SplatReport,
    /// In which format it is.
    pub format: SplatFormat,
    /// Header that a PLY is written again by.
    header: Option<ply::Header>,
    stamp: Stamp,
    /// Surfel of each row of the file, [`NOT_WRITTEN`] where the row is not written. `[vertices]`
    surfel_of_row: Arc<[u32]>,
}

impl SplatFile {
    /// File of some of its surfels, numbered anew in that order.
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

    /// The axis that is up in most files of its kind; a PLY of 2D surfels comes with any.
    pub fn usual_up(&self) -> Option<UpAxis> {
        let is_any = self.format == SplatFormat::Ply && self.report.kind == SplatKind::Surfels2d;
        (!is_any).then(|| self.format.usual_up())
    }

    /// True where an up axis is more than the default of a PLY that has none.
    fn is_up_known(&self, up: UpAxis) -> bool {
        let is_said = self.format != SplatFormat::Ply || self.report.up.is_some();
        is_said || up != UNTOLD_UP
    }

    /// The format that a file of that name is written in.
    pub fn written_format(&self, path: &Path) -> SplatFormat {
        SplatFormat::of_name(path).unwrap_or(self.format)
    }

    /// Its surfels as the file has them, without what was left out.
    fn order(&self) -> Vec<u32> {
        let skipped_work = &self.report.skipped_work;
        let rows = self.surfel_of_row.iter().enumerate();
        let kept = |(row, s): &(usize, &u32)| {
            **s != NOT_WRITTEN && skipped_work.binary_search(row).is_err()
        };
        rows.filter(kept).map(|(_, surfel)| *surfel).collect()
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

/// Up axis of a PLY that has none.
const UNTOLD_UP: UpAxis = UpAxis::PlusZ;

/// Length and time of change when it was read: it must still be the same when it is written again.
type Stamp = (u64, Option<SystemTime>);

fn stamp(metadata: &Metadata) -> Stamp {
    (metadata.len(), metadata.modified().ok())
}

/// Loads a splat, in any of the formats that are read: of 2D surfels or of 3D Gaussians.
///
/// Rows with values that are no numbers are left out of the picture (opacity 0) and reported.
///
/// # Errors
/// The file cannot be read, is no splat, lacks a property that a splat has, ends before its rows do, or is mostly no numbers.
pub fn load_splat(path: &Path) -> Result<(SurfelCloud, SplatFile)> {
    let path = &*file_of(path);
    let kind = file_kind(path);
    let mut reader = read::open(path)?;
    let length = reader.len();
    let metadata = std::fs::metadata(path).map_err(Error::io(path))?;
    let mut format = match kind {
        Ok(FileKind::Splat(format)) => format,
        Err(error @ Error::Io { .. }) => return Err(error),
        other => return Err(Error::invalid(path, instead_of_a_splat(other, length))),
    };
    let mut header = None;
    let finished = match format {
        SplatFormat::Ply | SplatFormat::CompressedPly => {
            let (finished, found) = ply::read(path, &mut reader, length)?;
            if found.is_none() {
                format = SplatFormat::CompressedPly;
            }
            header = found;
            finished
        }
        SplatFormat::Spz => spz::read(path, &mut reader, length)?,
        SplatFormat::Sog => sog::read(path)?,
        SplatFormat::Splat => splat::read(path, &mut reader, length)?,
        SplatFormat::Ksplat => ksplat::read(path, &mut reader, length)?,
        SplatFormat::Gltf => gltf::read(path)?,
    };
    let (mut cloud, report, surfel_of_row) = finished;
    // A PLY is taken as it is promised, and the others as they mostly are.
    let assumed = match format {
        SplatFormat::Ply => UNTOLD_UP,
        _ => format.usual_up(),
    };
    cloud.up = report.up.unwrap_or(assumed);
    let asset = SplatFile {
        path: path.to_owned(),
        report,
        format,
        header,
        stamp: stamp(&metadata),
        surfel_of_row: surfel_of_row.into(),
    };
    Ok((cloud, asset))
}

/// Losses in a file of that name, which is not of the splat's own format.
pub fn losses(asset: &SplatFile, cloud: &SurfelCloud, path: &Path) -> Option<String> {
    let format = SplatFormat::of_name(path).filter(|f| *f != asset.format)?;
    let mut losses = format.losses(cloud);
    let mut splat = WritableSplat::new(cloud, &cloud.sh, asset.order());
    format::arrange(format, &mut splat);
    // What is too coarse is not written at all.
    let is_explicit = |r: &format::Rounding| r.is_seen() && !r.is_too_coarse();
    let rounding = format::rounding(format, &splat).filter(is_explicit);
    losses.extend(rounding.map(|r| {
        format!(
            "positions of {:.0} % of the splats in steps as large as they are",
            100.0 * r.blurred
        )
    }));
    (!losses.is_empty()).then(|| format!("{} holds {}", format.name(), losses.join("; ")))
}

/// Description of a file that is no splat.
fn instead_of_a_splat(kind: Result<FileKind>, length: u64) -> String {
    match kind {
        _ if length == 0 => "the file is empty; a splat is expected",
        Ok(FileKind::Look) => {
            "a look, where one splat is expected; render, relight and the window open looks"
        }
        Ok(FileKind::Rig) => "a rig of lights, where a splat is expected (--rig takes it)",
        Ok(other) => return format!("{}, where a splat is expected", other.called()),
        Err(Error::Invalid { message, .. }) => return format!("no splat: {message}"),
        Err(_) => "no splat",
    }
    .into()
}

/// Writes a splat that comes of no file, in the format that the name tells or else as PLY, with a colour `[n][K][3]` as
/// [`crate::color::Encoding::Stored`] has it.
///
/// # Errors
/// The output cannot be written.
pub fn write_splat(cloud: &SurfelCloud, stored: &[[f32; 3]], path: &Path) -> Result<()> {
    let format = SplatFormat::of_name(path).unwrap_or(SplatFormat::Ply);
    let order = (0..cloud.len() as u32).collect();
    // Whatever the cloud's own colour is.
    let splat = WritableSplat {
        is_linear: false,
        ..WritableSplat::new(cloud, stored, order)
    };
    write_checked(format, splat, path)
}

/// Writes a splat in a format that holds where its Gaussians are.
fn write_checked(format: SplatFormat, mut splat: WritableSplat<'_>, path: &Path) -> Result<()> {
    format::arrange(format, &mut splat);
    let splat = &splat;
    let rounding = format::rounding(format, splat).filter(format::Rounding::is_too_coarse);
    if let Some(format::Rounding { step, size, .. }) = rounding {
        return Err(Error::invalid(
            path,
            format!(
                "{} would hold positions in steps of {step:.3} here, and the splats are {size:.3} large: write it as .ply or .glb; what floats far away, or a far origin, makes it so coarse",
                format.name()
            ),
        ));
    }
    write_atomically(path, |out| format::write(format, splat, out))
}

/// Writes the asset again with other colour, in the format that the name tells, or else in its own: in that and for a PLY, nothing else that it
/// holds is changed.
///
/// `stored` is the colour `[n][K][3]` as the file stores it. Rows that were left out at loading are made harmless in a PLY: what was no number is
/// 0, and they are transparent; elsewhere they are not written.
///
/// # Errors
/// The source file is gone or has changed since it was loaded, or the output cannot be written.
pub fn write_relit(
    asset: &SplatFile,
    cloud: &SurfelCloud,
    stored: &[[f32; 3]],
    path: &Path,
) -> Result<()> {
    let metadata = std::fs::metadata(&asset.path).map_err(Error::io(&asset.path))?;
    if stamp(&metadata) != asset.stamp {
        return Err(Error::invalid(
            &asset.path,
            "has changed since it was loaded; load it again",
        ));
    }
    let format = asset.written_format(path);
    if let (SplatFormat::Ply, Some(header)) = (format, &asset.header) {
        let mut reader = read::open(&asset.path)?;
        let columns = ply::ColorColumns::new(header, &asset.report, &asset.surfel_of_row, stored)?;
        return write_atomically(path, |out| columns.write(&mut reader, out));
    }
    write_anew(asset, (cloud, stored), None, path)
}

/// Writes the asset anew with the colour of another cloud, which has its surfels, and where that is wanted with what they are made of, in the
/// format that the name tells, or else in its own. Nothing but the splat is written: other properties, comments and elements of a PLY are not.
///
/// # Errors
/// The format holds no materials, or the output cannot be written.
pub fn write_delit(
    asset: &SplatFile,
    cloud: &SurfelCloud,
    materials: Option<&Materials>,
    path: &Path,
) -> Result<()> {
    let format = asset.written_format(path);
    if materials.is_some() {
        format.check_materials(path)?;
    }
    write_anew(asset, (cloud, &cloud.sh), materials, path)
}

/// Writes the splat alone, upright as files of the format are where the asset's are otherwise.
fn write_anew(
    asset: &SplatFile,
    (cloud, stored): (&SurfelCloud, &[[f32; 3]]),
    materials: Option<&Materials>,
    path: &Path,
) -> Result<()> {
    let format = asset.written_format(path);
    let Some((turn, up)) = turn(asset.format, format, cloud.up) else {
        let splat = WritableSplat {
            up: asset.is_up_known(cloud.up).then_some(cloud.up),
            materials: materials.map(|m| &m.each[..]),
            ..WritableSplat::new(cloud, stored, asset.order())
        };
        return write_checked(format, splat, path);
    };
    let colored = SurfelCloud {
        sh: stored.to_vec().into(),
        up,
        ..cloud.clone()
    };
    let turned = SurfelCloud {
        origin: turn.as_dquat().normalize() * cloud.origin,
        ..colored.transformed(Affine3A::from_quat(turn))
    };
    let materials = materials.map(|m| m.clone().turned(turn));
    let splat = WritableSplat {
        materials: materials.as_ref().map(|m| &m.each[..]),
        ..WritableSplat::new(&turned, &turned.sh, asset.order())
    };
    write_checked(format, splat, path)
}

/// Rotation of a splat that goes from one format to another whose files have another axis up, and the up axis then.
fn turn(from: SplatFormat, to: SplatFormat, up: UpAxis) -> Option<(Quat, UpAxis)> {
    let up_there = to.usual_up();
    if from.usual_up() == up_there || up == up_there {
        return None;
    }
    let there_from_here = up_there.asset_from_world() * up.asset_from_world().transpose();
    let turn = DQuat::from_mat3(&there_from_here).as_quat();
    Some((turn, up_there))
}
