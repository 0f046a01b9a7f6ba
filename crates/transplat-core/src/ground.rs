//! Shadow catcher: a ground plane under the objects, darkened by their visibility under a light.

use glam::Vec3;
use rayon::prelude::*;

use crate::bake::harmonic::{BakeInput, Softness, bake_receivers};
use crate::bake::scaled::BakeSurfel;
use crate::camera::Camera;
use crate::color::luminance;
use crate::environment::Illumination;
use crate::error::Result;
use crate::progress::Progress;
use crate::rasterize::ColorSpace;
use crate::sh::{evaluate_sh, lattice};
use crate::surfels::{SurfelCloud, UpAxis};

/// Receivers along an edge of the ground.
pub const GROUND_CELLS: usize = 96;

/// Half the ground's edge, in the object's radius.
pub const GROUND_REACH: f32 = 3.0;

/// From this share of the ground's reach the shadow fades, so that it has no edge.
pub const GROUND_FADE: f32 = 0.7;

/// A height difference below this share of the object's radius is no shadow: the object stands on the ground.
const BIAS: f32 = 0.004;

/// The ground under an object: how open each of its cells is towards the sky.
#[derive(Clone, Debug)]
pub struct Ground {
    /// Middle of the ground, in the asset's coordinates.
    pub center: Vec3,
    /// Unit axes of the cells' columns and rows.
    pub axes: [Vec3; 2],
    /// Half the edge, in scene units.
    pub half: f32,
    /// Upwards.
    pub normal: Vec3,
    directions: usize,
    /// `[GROUND_CELLS^2][N]`, 255 is open.
    open: Vec<u8>,
}

/// The ground's plane: a point under the middle of the object at the height of its lowest part (floaters do not count), and its two axes.
pub fn ground_plane(cloud: &SurfelCloud, up_axis: UpAxis) -> (Vec3, [Vec3; 2]) {
    let bounds = cloud.bounds();
    let up = up_axis.direction();
    let mut heights: Vec<f32> = cloud
        .positions
        .iter()
        .zip(&cloud.opacities)
        .filter(|(_, opacity)| **opacity > 0.1)
        .map(|(p, _)| (*p - bounds.center).dot(up))
        .collect();
    let lowest = if heights.is_empty() {
        0.0
    } else {
        let at = heights.len() / 200;
        *heights.select_nth_unstable_by(at, f32::total_cmp).1
    };
    let world = up_axis.asset_from_world().as_mat3();
    let lowest = lowest.max(-bounds.radius);
    (bounds.center + up * lowest, [world.x_axis, world.y_axis])
}

impl Ground {
    /// Bakes the ground under an object.
    ///
    /// # Errors
    /// `progress` asked to stop.
    pub fn bake(
        cloud: &SurfelCloud,
        up: UpAxis,
        directions: usize,
        progress: Progress<'_>,
    ) -> Result<Self> {
        let input = BakeInput::new(cloud, directions);
        let (center, axes) = ground_plane(cloud, up);
        let half = GROUND_REACH * cloud.bounds().radius;
        let normal = up.direction();
        let receivers: Vec<BakeSurfel> = (0..GROUND_CELLS * GROUND_CELLS)
            .map(|i| {
                let at = |i: usize| (2.0 * (i as f32 + 0.5) / GROUND_CELLS as f32 - 1.0) * half;
                let p = center + axes[0] * at(i % GROUND_CELLS) + axes[1] * at(i / GROUND_CELLS);
                BakeSurfel {
                    position: (p - input.center) / input.radius,
                    axes: [Vec3::ZERO; 2],
                    normal,
                    bias: BIAS,
                }
            })
            .collect();
        Ok(Self {
            center,
            axes,
            half,
            normal,
            directions,
            open: bake_receivers(&input, &receivers, Softness::default(), progress)?,
        })
    }

    /// Share of the light that reaches each cell, `[GROUND_CELLS^2]`, 1 is unshadowed: by a sum over the bake's directions.
    ///
    /// `light` is the light as the asset sees it, of the highest degree there is; what of it is near counts as it is seen from the object's middle.
    pub fn lit_share(&self, light: &Illumination) -> Vec<f32> {
        let middle = self.center + self.normal * (self.half / GROUND_REACH);
        let light = &light.at_one_place(middle).radiance;
        let weights: Vec<f32> = lattice(self.directions)
            .into_iter()
            .map(|d| {
                let cosine = d.dot(self.normal).max(0.0);
                let d = d.to_array();
                let radiance = luminance(evaluate_sh(&light.coefficients, light.degree, d));
                cosine * radiance.max(0.0)
            })
            .collect();
        let total: f32 = weights.iter().sum();
        let floor = 1e-20f32.max(1e-6 * total);
        self.open
            .par_chunks_exact(self.directions)
            .map(|row| {
                let lit: f32 = row
                    .iter()
                    .zip(&weights)
                    .map(|(o, w)| f32::from(*o) * w)
                    .sum();
                if total <= floor {
                    1.0
                } else {
                    (lit / (255.0 * total)).clamp(0.0, 1.0)
                }
            })
            .collect()
    }

    /// Shadow at a pixel: coverage by black, 0 to 1.
    pub fn shadow(
        &self,
        lit: &[f32],
        camera: &Camera,
        x: usize,
        y: usize,
        space: ColorSpace,
    ) -> f32 {
        let ray = camera.ray(x, y);
        let down = ray.dot(self.normal);
        let height = (camera.eye - self.center).dot(self.normal);
        if height <= 0.0 || down >= -1e-6 {
            return 0.0;
        }
        let p = camera.eye + ray * (height / -down) - self.center;
        let at = self.axes.map(|axis| p.dot(axis) / self.half);
        let rim = at[0].abs().max(at[1].abs());
        if rim >= 1.0 {
            return 0.0;
        }
        let [u, v] = at.map(|a| (0.5 * a + 0.5) * GROUND_CELLS as f32 - 0.5);
        let (column, row) = (u.floor(), v.floor());
        let (fu, fv) = (u - column, v - row);
        let last = GROUND_CELLS as f32 - 1.0;
        let cell = |dx: f32, dy: f32| {
            let x = (column + dx).clamp(0.0, last) as usize;
            let y = (row + dy).clamp(0.0, last) as usize;
            lit[y * GROUND_CELLS + x]
        };
        let top = cell(0.0, 0.0) * (1.0 - fu) + cell(1.0, 0.0) * fu;
        let bottom = cell(0.0, 1.0) * (1.0 - fu) + cell(1.0, 1.0) * fu;
        let lit = top * (1.0 - fv) + bottom * fv;
        let fade = ((1.0 - rim) / (1.0 - GROUND_FADE)).clamp(0.0, 1.0);
        fade * (1.0 - in_space(lit, space))
    }
}

/// A share of light as what a picture of that space is multiplied by. Display values follow the curve's power, so that a shadow on a
/// transparent picture darkens whatever it is laid over as it would have in light.
fn in_space(lit: f32, space: ColorSpace) -> f32 {
    match space {
        ColorSpace::Display(_) => lit.powf(1.0 / 2.2),
        ColorSpace::Linear => lit,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::harmonic::DEFAULT_DIRECTIONS;
    use crate::environment::IncidentRadiance;
    use crate::present::PLAIN;
    use crate::progress::no_progress;
    use crate::synthetic;

    /// Under a light from the side, the ground is dark on the other side of the object and nowhere else.
    #[test]
    fn the_shadow_lies_opposite_the_light() {
        let cloud = synthetic::sphere(2000);
        let ground =
            Ground::bake(&cloud, cloud.up, DEFAULT_DIRECTIONS, &no_progress).expect("a bake");
        // A lobe towards +X, 45 degrees up.
        let mut light = IncidentRadiance::even(8);
        let towards = Vec3::new(1.0, 0.0, 1.0).normalize();
        light.coefficients.fill([0.0; 3]);
        for d in lattice(4000) {
            let radiance = d.dot(towards).max(0.0).powi(30);
            light.add(d, [radiance / 4000.0; 3]);
        }
        let lit = ground.lit_share(&Illumination::new(light, None));
        let at = |x: f32, y: f32| {
            let cell = |v: f32| ((v / ground.half * 0.5 + 0.5) * GROUND_CELLS as f32) as usize;
            lit[cell(y) * GROUND_CELLS + cell(x)]
        };
        // The sphere's middle is 1 over the ground: its shadow is around x = -1.
        assert!(at(-1.0, 0.0) < 0.2, "{}", at(-1.0, 0.0));
        // The degree-8 lobe is wide and rings: some light is taken elsewhere too.
        let elsewhere = [at(2.0, 0.0), at(0.0, 2.4), at(-2.9, 0.0)];
        assert!(elsewhere.iter().all(|l| *l > 0.8), "{elsewhere:?}");
        let camera = Camera::look_at(
            Vec3::new(0.0, -6.0, 4.0),
            Vec3::new(-1.0, 0.0, -1.0),
            Vec3::Z,
            0.5,
            [101, 101],
            0.1,
        );
        assert!(ground.shadow(&lit, &camera, 50, 50, PLAIN) > 0.4);
        let below = Camera {
            eye: Vec3::new(0.0, -6.0, -4.0),
            ..camera
        };
        assert_eq!(ground.shadow(&lit, &below, 50, 50, PLAIN), 0.0);
    }
}
