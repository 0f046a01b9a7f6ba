//! Formats of splats, and their losses.

use std::io::{Seek, Write};
use std::path::Path;

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::written::WritableSplat;
use super::{gltf, ply, sog, splat, spz};
use crate::color::Encoding;
use crate::error::{Error, Result};
use crate::numeric::quantile;
use crate::sh::MAX_DEGREE;
use crate::surfels::{SurfelCloud, Thickness, UpAxis};

/// A format of splats.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SplatFormat {
    /// PLY as trainers write it.
    Ply,
    /// The compressed PLY of PlayCanvas.
    CompressedPly,
    /// SPZ of Niantic.
    Spz,
    /// SOG of PlayCanvas.
    Sog,
    /// 32 bytes a splat, without a header.
    Splat,
    /// Format of GaussianSplats3D, which is only read.
    Ksplat,
    /// glTF with `KHR_gaussian_splatting`.
    Gltf,
}

impl SplatFormat {
    /// Formats that are written, each with the ending of its name; the longer one before that which it ends with.
    pub const WRITTEN: [(&'static str, Self); 6] = [
        (".compressed.ply", Self::CompressedPly),
        (".ply", Self::Ply),
        (".spz", Self::Spz),
        (".sog", Self::Sog),
        (".splat", Self::Splat),
        (".glb", Self::Gltf),
    ];

    /// The one that a file of that name is written in.
    pub fn of_name(path: &Path) -> Option<Self> {
        let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
        let mut written = Self::WRITTEN.into_iter();
        written
            .find(|(ending, _)| name.ends_with(ending))
            .map(|(_, format)| format)
    }

    /// The ending of its files' names, and nothing where it is not written.
    pub fn ending(self) -> Option<&'static str> {
        let mut written = Self::WRITTEN.into_iter();
        written
            .find(|(_, format)| *format == self)
            .map(|(ending, _)| ending)
    }

    /// Name of the format.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ply => "PLY",
            Self::CompressedPly => "compressed PLY",
            Self::Spz => "SPZ",
            Self::Sog => "SOG",
            Self::Splat => ".splat",
            Self::Ksplat => ".ksplat",
            Self::Gltf => "glTF",
        }
    }

    /// The axis that its files have up by their specification; PLY and what was made of it has none, and mostly -y.
    pub(super) fn usual_up(self) -> UpAxis {
        match self {
            Self::Spz | Self::Gltf => UpAxis::PlusY,
            _ => UpAxis::MinusY,
        }
    }

    /// Refuses to write what surfels are made of in a format that has no room for it.
    ///
    /// # Errors
    /// It has none; says which have.
    pub fn check_materials(self, path: &Path) -> Result<()> {
        if matches!(self, Self::Ply | Self::Gltf) {
            return Ok(());
        }
        let what = format!("{} holds no materials; .ply and .glb do", self.name());
        Err(Error::invalid(path, what))
    }

    /// The highest SH degree that it holds.
    fn max_degree(self) -> usize {
        match self {
            Self::Ply => MAX_DEGREE,
            Self::CompressedPly => ply::compressed::MAX_DEGREE,
            Self::Spz => spz::MAX_DEGREE,
            Self::Sog => sog::MAX_DEGREE,
            Self::Splat | Self::Ksplat => 0,
            Self::Gltf => gltf::MAX_DEGREE,
        }
    }

    /// Losses of a splat in the format, in words.
    pub fn losses(self, cloud: &SurfelCloud) -> Vec<String> {
        let mut losses = Vec::new();
        let degree = cloud.filled_degree();
        match self.max_degree() {
            most if degree <= most => {}
            0 => losses.push("no colour that depends on the view".into()),
            most => losses.push(format!("SH of degree {most} at most, of {degree}")),
        }
        let has = |test: fn(&Thickness) -> bool| cloud.thicknesses.iter().any(test);
        if self != Self::Ply && has(|t| t.is_flat()) {
            losses.push("no 2D Gaussians, which become thin 3D Gaussians".into());
        }
        if matches!(self, Self::Splat | Self::Gltf) && has(|t| t.is_antialiased()) {
            losses.push("no mark that it was trained antialiased".into());
        }
        if self != Self::Gltf && cloud.encoding == Encoding::Linear {
            losses.push("no mark that its colour is linear".into());
        }
        if let Some(quantum) = self.quantum() {
            losses.push(quantum.into());
        }
        losses
    }

    /// Quantum of its numbers.
    fn quantum(self) -> Option<&'static str> {
        match self {
            Self::CompressedPly => Some(
                "positions and scales of 10 and 11 bits within 256 neighbours, rotations of 10 bits, colours of 8",
            ),
            Self::Spz => Some(
                "positions of 24 bits, scales in steps of 6 %, rotations of 10 bits, colours of 8",
            ),
            Self::Sog => Some(
                "positions of 16 bits, rotations of 8, scales and colours of 256 values, 65536 higher SH",
            ),
            Self::Splat => Some("rotations and colours of 8 bits"),
            Self::Ply | Self::Ksplat | Self::Gltf => None,
        }
    }
}

/// Rounding of positions in a format.
pub(super) struct Rounding {
    /// Median of what their positions are rounded to, at most half of which they are off.
    pub step: f64,
    /// Median of the splats' larger standard deviations.
    pub size: f64,
    /// Share of the splats that are rounded to their own size and more.
    pub blurred: f64,
}

/// Share of blurred splats from which on a picture shows them.
const SEEN_SHARE: f64 = 0.02;

impl Rounding {
    /// True where half of the splats may be off by half of their own size and more.
    pub fn is_too_coarse(&self) -> bool {
        self.step > self.size
    }

    /// True where a picture shows the rounding.
    pub fn is_seen(&self) -> bool {
        self.blurred > SEEN_SHARE
    }
}

/// Brings Gaussians into an order that a format holds well: the file's own, or one in which chunks are small where they would span far too much.
///
/// What lies far off comes last, each octave of distance by itself: a chunk with one floater in it spans the way there.
pub(super) fn arrange(format: SplatFormat, splat: &mut WritableSplat<'_>) {
    let is_seen = || rounding(format, splat).is_some_and(|r| r.is_seen());
    if format == SplatFormat::CompressedPly && is_seen() {
        let positions = || {
            splat
                .order
                .iter()
                .map(|i| splat.cloud.positions[*i as usize])
        };
        let median = |values: Vec<f32>| quantile(values, 0.5).unwrap_or(0.0);
        let center =
            Vec3::from_array([0, 1, 2].map(|a| median(positions().map(|p| p[a]).collect())));
        let near = median(positions().map(|p| p.distance(center)).collect());
        let octave = |i: u32| {
            let distance = splat.cloud.positions[i as usize].distance(center);
            (distance / near.max(f32::MIN_POSITIVE)).max(1.0).log2() as u32
        };
        // Surfels are stored along a Morton curve.
        splat.order.sort_by_cached_key(|i| (octave(*i), *i));
    }
}

/// Rounding of a splat's positions in a format.
pub(super) fn rounding(format: SplatFormat, splat: &WritableSplat<'_>) -> Option<Rounding> {
    let cloud = splat.cloud;
    let place = |i: u32| cloud.origin + cloud.positions[i as usize].as_dvec3();
    let in_floats = |p: DVec3| 2.0 * (p - p.as_vec3().as_dvec3()).abs().max_element();
    let size = f64::from(cloud.median_size()?);
    let order = splat.order.iter().copied();
    let steps: Vec<f64> = match format {
        // They have 64 bits where 32 do not do.
        SplatFormat::Ply | SplatFormat::Gltf | SplatFormat::Ksplat => return None,
        SplatFormat::Splat => order.map(|i| in_floats(place(i))).collect(),
        SplatFormat::Spz => vec![spz::position_step(splat); splat.len()],
        SplatFormat::Sog => {
            let log = |v: f64| v.signum() * v.abs().ln_1p();
            let logs = |i: u32| DVec3::from_array(place(i).to_array().map(log));
            let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
            for i in &splat.order {
                (least, most) = (least.min(logs(*i)), most.max(logs(*i)));
            }
            let span = (most - least) / f64::from(u16::MAX);
            order
                .map(|i| (span * (place(i).abs() + 1.0)).max_element())
                .collect()
        }
        SplatFormat::CompressedPly => {
            let chunks = splat.order.chunks(ply::compressed::CHUNK);
            let steps = chunks.flat_map(|chunk| {
                let places = || chunk.iter().map(|i| place(*i));
                let least = places().fold(DVec3::INFINITY, DVec3::min);
                let most = places().fold(DVec3::NEG_INFINITY, DVec3::max);
                let step = (most - least).max_element() / 1023.0;
                places().map(move |p| step.max(in_floats(p)))
            });
            steps.collect()
        }
    };
    let own_size = |i: u32| f64::from(cloud.scales[i as usize].max_element());
    let is_blurred = |(i, step): (&u32, &f64)| *step > own_size(*i);
    let blurred = splat
        .order
        .iter()
        .zip(&steps)
        .filter(|s| is_blurred(*s))
        .count();
    let blurred = blurred as f64 / splat.len().max(1) as f64;
    let step = quantile(steps.into_iter().map(|s| s as f32).collect(), 0.5)?;
    Some(Rounding {
        step: step.into(),
        size,
        blurred,
    })
}

/// Writes a splat in a format that is written.
pub(super) fn write(
    format: SplatFormat,
    splat: &WritableSplat<'_>,
    out: &mut (impl Write + Seek),
) -> std::io::Result<()> {
    match format {
        SplatFormat::Ply | SplatFormat::Ksplat => ply::write_made(splat, out),
        SplatFormat::CompressedPly => ply::compressed::write(splat, out),
        SplatFormat::Spz => spz::write(splat, out),
        SplatFormat::Sog => sog::write(splat, out),
        SplatFormat::Splat => splat::write(splat, out),
        SplatFormat::Gltf => gltf::write(splat, out),
    }
}

#[cfg(test)]
mod tests;
