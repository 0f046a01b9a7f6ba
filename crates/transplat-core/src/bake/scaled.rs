//! A splat in units of its own size, as all bakes take it.

use glam::Vec3;
use rayon::prelude::*;

use crate::surfels::SurfelCloud;

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
    /// Length of the scaled unit, in scene units.
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
            .into_par_iter()
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
