//! Stage *bake*: what blocks the light, of the geometry alone; for each preset in a form of its own.

mod depth_maps;
pub mod front;
mod hierarchy;
pub mod occlusion;
pub mod open_object;
pub mod trace;
pub(crate) mod transmittance;

use std::ops::ControlFlow;
use std::sync::Arc;

use glam::Vec3;

use crate::error::{Error, Result};
use crate::sh::lattice;
use crate::skips::Skips;
use crate::surfels::SurfelCloud;
use crate::transfer::Preset;

pub use depth_maps::{
    BakeInput, BakeSettings, DEFAULT_DIRECTIONS, DIRECTION_BATCH, DIRECTIONS, EDGE_ON, EMPTY,
    MIN_SLOPE_COSINE, MapFrame, SHARPNESS, Softness, TAPS, Visibility, bake, bake_receivers,
    bake_visibility, fill_unfinished, quantize_open,
};
use occlusion::Occlusion;

/// Told how far a long stage is, 0 to 1; `Break` cancels it.
pub type Progress<'a> = &'a (dyn Fn(f64) -> ControlFlow<()> + Sync);

/// A [`Progress`] that neither shows nor stops anything.
pub fn no_progress(_: f64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// An occluder reaches this many standard deviations: where its opacity has fallen to a quarter.
pub const OCCLUDER_REACH: f32 = 1.7;

/// Surfels fainter than this cast no shadow.
pub const OCCLUDER_OPACITY: f32 = 0.3;

/// A height difference below this many of the receiver's own larger standard deviations is no shadow.
pub const BIAS_SCALES: f32 = 1.0;

/// A surfel as the bake sees it, in units of the object's radius around its centre.
#[derive(Clone, Copy, Debug)]
pub struct BakeSurfel {
    /// Centre.
    pub position: Vec3,
    /// Half axes of the disc that casts a shadow; zero where it casts none.
    pub axes: [Vec3; 2],
    /// Unit normal, of either sign.
    pub normal: Vec3,
    /// Least height difference that is a shadow.
    pub bias: f32,
}

/// An asset scaled to the unit ball.
pub(crate) struct ScaledObject {
    pub surfels: Vec<BakeSurfel>,
    /// Where the scaled coordinates have their origin, in the asset's.
    pub center: Vec3,
    /// What 1 in the scaled coordinates is, in scene units.
    pub radius: f32,
    /// Median of the surfels' larger standard deviations, scaled.
    pub median_size: f32,
}

impl ScaledObject {
    pub fn new(cloud: &SurfelCloud) -> Self {
        let bounds = cloud.bounds();
        let mut scales: Vec<f32> = cloud.scales.iter().map(|s| s.max_element()).collect();
        let middle = scales.len() / 2;
        let median = if scales.is_empty() {
            bounds.radius
        } else {
            *scales.select_nth_unstable_by(middle, f32::total_cmp).1
        };
        let radius = 1.01 * bounds.radius + OCCLUDER_REACH * median.min(bounds.radius);
        let surfels = (0..cloud.len())
            .map(|i| {
                let casts = cloud.opacities[i] > OCCLUDER_OPACITY;
                let scale = cloud.scales[i] / radius;
                let reach = if casts { OCCLUDER_REACH } else { 0.0 };
                let [u, v] = cloud.tangents[i];
                BakeSurfel {
                    position: (cloud.positions[i] - bounds.center) / radius,
                    axes: [u * (scale.x * reach), v * (scale.y * reach)],
                    normal: u.cross(v),
                    bias: BIAS_SCALES * scale.max_element(),
                }
            })
            .collect();
        Self {
            surfels,
            center: bounds.center,
            radius,
            median_size: median / radius,
        }
    }
}

/// `0` below `low`, `1` above `high`, and smooth between.
pub(crate) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// An order of the lattice's directions in which every beginning of it covers the sphere: indices by their reversed binary digits.
pub fn refining_order(directions: usize) -> Vec<usize> {
    let bits = directions.next_power_of_two().trailing_zeros();
    (0..1usize << bits)
        .map(|i| {
            i.reverse_bits()
                .checked_shr(usize::BITS - bits)
                .unwrap_or(0)
        })
        .filter(|i| *i < directions)
        .collect()
}

/// Whether what was baked for a preset serves another.
pub(crate) fn check_preset(baked: Preset, wanted: Preset) -> Result<()> {
    if baked == wanted {
        return Ok(());
    }
    Err(Error::Mismatch(format!(
        "the bake is for preset {}, and the preset is {}; `transplat bake --preset {}` makes the other",
        baked.name(),
        wanted.name(),
        wanted.name()
    )))
}

/// What a preset needs of the geometry alone.
#[derive(Clone, Debug)]
pub enum Bake {
    /// For preset `paper`.
    Visibility(Visibility),
    /// For preset `best`.
    Occlusion(Arc<Occlusion>),
}

impl Bake {
    /// Bakes on the CPU from start to end; `settings` are preset `paper`'s.
    ///
    /// # Errors
    /// The asset is too large, or [`Error::Cancelled`] when `progress` asked for it.
    pub fn new(
        cloud: &SurfelCloud,
        preset: Preset,
        settings: &BakeSettings,
        progress: Progress<'_>,
    ) -> Result<Self> {
        Self::with_skips(cloud, preset, settings, &Skips::default(), progress)
    }

    /// The same, leaving out what it is told to.
    ///
    /// # Errors
    /// As [`Bake::new`].
    pub fn with_skips(
        cloud: &SurfelCloud,
        preset: Preset,
        settings: &BakeSettings,
        skips: &Skips,
        progress: Progress<'_>,
    ) -> Result<Self> {
        if preset == Preset::Best {
            let baked = Occlusion::bake_in_stages(cloud, (&[1], skips), progress, |_, _| ())?;
            return Ok(Self::Occlusion(Arc::new(baked)));
        }
        if progress(0.0).is_break() {
            return Err(Error::Cancelled);
        }
        if skips.open_object
            && let Some(open) = Visibility::of_open_object(cloud, settings.directions)
        {
            return Ok(Self::Visibility(open));
        }
        Ok(Self::Visibility(bake(cloud, settings, progress)?))
    }

    /// The preset that it is for.
    pub fn preset(&self) -> Preset {
        match self {
            Self::Visibility(_) => Preset::Paper,
            Self::Occlusion(_) => Preset::Best,
        }
    }

    /// The bake, if it is for a preset.
    ///
    /// # Errors
    /// It is for the other one.
    pub fn of_preset(&self, preset: Preset) -> Result<&Self> {
        check_preset(self.preset(), preset)?;
        Ok(self)
    }

    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.normals().len()
    }

    /// Whether there is no surfel.
    pub fn is_empty(&self) -> bool {
        self.normals().is_empty()
    }

    /// Directions that were asked.
    pub fn directions(&self) -> usize {
        match self {
            Self::Visibility(v) => v.directions,
            Self::Occlusion(_) => occlusion::DIRECTIONS,
        }
    }

    /// Bytes that it takes in a file, beside the head.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Visibility(v) => v.open.len(),
            Self::Occlusion(o) => {
                size_of_val(&o.tracer.fronts.of[..])
                    + size_of_val(&o.open[..])
                    + size_of_val(&o.starts[..])
                    + size_of_val(&o.hits[..])
            }
        }
    }

    /// Unit normals, turned to the open side. `[n]`
    pub fn normals(&self) -> &[Vec3] {
        match self {
            Self::Visibility(v) => &v.normals,
            Self::Occlusion(o) => &o.normals,
        }
    }

    /// Whether both sides of surfel `i` are about equally open.
    pub fn is_two_sided(&self, i: usize) -> bool {
        match self {
            Self::Visibility(v) => v.two_sided[i],
            Self::Occlusion(o) => o.two_sided[i] > 0.5,
        }
    }

    /// Whether it is little better than a guess which side of surfel `i` is its front, and matters.
    pub fn is_ambiguous(&self, i: usize) -> bool {
        match self {
            Self::Visibility(v) => v.two_sided[i],
            Self::Occlusion(o) => o.is_ambiguous(i),
        }
    }

    /// Share of what is seen of the asset that is ambiguous, 0 to 1; preset `paper` does not tell what is seen.
    pub fn ambiguous_share(&self) -> Option<f32> {
        match self {
            Self::Visibility(_) => None,
            Self::Occlusion(o) => Some(o.ambiguous_share),
        }
    }

    /// How many stored normals pointed to the closed side.
    pub fn flipped(&self) -> usize {
        match self {
            Self::Visibility(v) => v.flipped,
            Self::Occlusion(o) => o.flipped,
        }
    }

    /// Surfels that are closed on both sides.
    pub fn buried(&self) -> usize {
        match self {
            Self::Visibility(v) => v.buried,
            Self::Occlusion(o) => o.buried,
        }
    }

    /// How open each direction is around surfel `i`, 0 to 1.
    pub fn seen_by(&self, i: usize) -> Vec<(Vec3, f32)> {
        match self {
            Self::Visibility(v) => lattice(v.directions)
                .into_iter()
                .zip(&v.open[i * v.directions..])
                .map(|(d, open)| (d, f32::from(*open) / 255.0))
                .collect(),
            Self::Occlusion(o) => occlusion::directions()
                .into_iter()
                .enumerate()
                .map(|(j, d)| (d, f32::from(u8::from(o.is_open(i, j)))))
                .collect(),
        }
    }

    /// Cosine-weighted share of the front side's hemisphere that is open, `[n]`, 0 to 1: ambient occlusion.
    pub fn openness(&self) -> Vec<f32> {
        match self {
            Self::Visibility(v) => v.openness(),
            Self::Occlusion(o) => o.openness(),
        }
    }
}
