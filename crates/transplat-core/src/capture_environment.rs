//! Environment of a part of a capture, as the rest of the capture shows it: where an estimate of the part's light begins.

use std::f32::consts::PI;

use glam::Vec3;

use crate::camera::Camera;
use crate::color::{Display, srgb_decode, srgb_encode};
use crate::environment::EnvironmentMap;
use crate::probe::{CLIPPED, Cube, SAMPLES, direction_in};
use crate::rasterize::{ColorSpace, rasterize, shade};
use crate::surfels::{Bounds, SurfelCloud};

/// Share of the sphere from which on a part is enclosed: open ground is half of it.
const ENCLOSED: f32 = 0.6;

/// Largest radius of a part, relative to the whole's: a room is not enclosed by what stands in it.
const LARGEST: f32 = 0.5;

/// Rows of the map.
const ROWS: usize = 64;

/// Distance from which on the rest is seen, relative to the part's radius.
const NEAR: f32 = 0.02;

/// Share of the camera's white, encoded, from which what is shown may be clipped: soft Gaussians blend white with what is around it.
const NEARLY_CLIPPED: f32 = 0.85;

/// Factor by which clipped light is expected to have been brighter than white.
const BEYOND_WHITE: f32 = 3.0;

/// Radiance at least where its logarithm counts.
const LEAST_SHOWN: f32 = 1e-3;

/// Uncertainty of what is not clipped: it may look otherwise from the part, or shine on the side that no camera saw. (0.25 to 1 are within 0.4 dB of each other.)
const LEAST_UNCERTAINTY: f32 = 0.4;

/// Logarithm of light from above over that from the side, where neither is shown.
const BRIGHTER_ABOVE: f32 = 1.0;

/// The light around a place as a splat shows it, with its uncertainty: what is clipped was brighter, and what is open is not known.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureEnvironment {
    /// Radiance by direction in the splat's coordinates, equirectangular. `[2 ROWS x ROWS]`
    radiance: Vec<[f32; 3]>,
    /// Uncertainty of it, 0 to 1: the share of a change of its logarithm that it takes. `[2 ROWS x ROWS]`
    uncertainty: Vec<f32>,
    /// Share of the sphere that is covered, 0 to 1.
    pub cover: f32,
}

impl CaptureEnvironment {
    /// Environment of some surfels of a splat, as the others show it, none where those do not reach far enough to enclose them. Light is clipped from
    /// `white` on, if that is set.
    pub fn around(whole: &SurfelCloud, part: &[usize], white: Option<f32>) -> Option<Self> {
        let places: Vec<Vec3> = part.iter().map(|i| whole.positions[*i]).collect();
        let (bounds, all) = (Bounds::of(&places), whole.bounds());
        if part.is_empty() || bounds.radius.is_nan() || bounds.radius > LARGEST * all.radius {
            return None;
        }
        let mut hidden = vec![false; whole.len()];
        for i in part {
            hidden[*i] = true;
        }
        let space = ColorSpace::Display(Display::default());
        let (degree, encoding) = (whole.sh_degree, whole.encoding);
        let colors = shade(
            &whole.positions,
            &whole.sh,
            degree,
            encoding,
            bounds.center,
            space,
        );
        let draw = |camera: &Camera| {
            Ok::<_, std::convert::Infallible>(rasterize(whole, camera, &colors, &hidden))
        };
        let near = NEAR * bounds.radius.max(1e-4 * all.radius);
        let cube = Cube::seen_from(bounds.center, near, ROWS, draw);
        let cube = cube.unwrap_or_else(|never| match never {});
        Some(Self::of(&cube, whole.up.direction(), white)).filter(|e| e.cover >= ENCLOSED)
    }

    /// The light that a cube shows, brighter where that is clipped; where it is open like the rest of it, and brighter along `up`.
    fn of(cube: &Cube, up: Vec3, white: Option<f32>) -> Self {
        let blank = blank();
        let width = blank.width();
        let mut logs = Vec::with_capacity(blank.pixels().len());
        let mut uncertainty = Vec::with_capacity(blank.pixels().len());
        let mut known = [[0f64; 2]; 3];
        let mut cover = 0.0;
        for i in 0..blank.pixels().len() {
            let (column, row) = (i % width, i / width);
            let (mut log, mut covered, mut sure) = ([0f32; 3], 0.0, 0.0);
            for sample in 0..SAMPLES * SAMPLES {
                let [across, down] = [sample % SAMPLES, sample / SAMPLES]
                    .map(|s| (s as f64 + 0.5) / SAMPLES as f64 - 0.5);
                let d = direction_in(&blank, column as f64 + across, row as f64 + down).as_vec3();
                let (encoded, alpha) = cube.toward(d);
                let linear = encoded.map(srgb_decode);
                let most = linear.into_iter().fold(0.0, f32::max);
                let most = white.map_or(0.0, |white| srgb_encode(most / white));
                let clipped = (most - NEARLY_CLIPPED) / (CLIPPED - NEARLY_CLIPPED);
                let clipped = clipped.clamp(0.0, 1.0);
                let omega = blank.pixel_solid_angle(row) * f64::from(alpha * (1.0 - clipped));
                for c in 0..3 {
                    let own = linear[c].max(LEAST_SHOWN).ln();
                    log[c] += alpha * (own + clipped * BEYOND_WHITE.ln());
                    known[c][0] += omega * f64::from(own);
                    known[c][1] += omega;
                }
                covered += alpha;
                sure += alpha * (1.0 - clipped);
            }
            let all = (SAMPLES * SAMPLES) as f32;
            cover += blank.pixel_solid_angle(row) as f32 * covered / all;
            logs.push((log.map(|v| v / all), covered / all));
            uncertainty.push(1.0 - (1.0 - LEAST_UNCERTAINTY) * sure / all);
        }
        let elsewhere = known.map(|[log, omega]| (log / omega.max(1e-9)) as f32);
        let radiance = logs.into_iter().enumerate().map(|(i, (log, covered))| {
            let above = BRIGHTER_ABOVE * direction(&blank, i).dot(up);
            let open = 1.0 - covered;
            std::array::from_fn(|c| (log[c] + open * (elsewhere[c] + above)).exp())
        });
        Self {
            radiance: radiance.collect(),
            uncertainty,
            cover: cover / (4.0 * PI),
        }
    }

    /// Pixels: direction, solid angle, radiance and uncertainty.
    pub fn pixels(&self) -> impl Iterator<Item = (Vec3, f64, [f32; 3], f32)> {
        let blank = blank();
        let each = self.radiance.iter().zip(&self.uncertainty).enumerate();
        each.map(move |(i, (radiance, uncertainty))| {
            let omega = blank.pixel_solid_angle(i / blank.width());
            (direction(&blank, i), omega, *radiance, *uncertainty)
        })
    }

    /// Radiance and uncertainty towards a direction.
    pub fn toward(&self, d: Vec3) -> ([f32; 3], f32) {
        let width = 2 * ROWS;
        let row = d.z.clamp(-1.0, 1.0).acos() / PI * ROWS as f32 - 0.5;
        let column = (0.5 - d.y.atan2(d.x) / (2.0 * PI)) * width as f32 - 0.5;
        let (mut radiance, mut uncertainty) = ([0.0; 3], 0.0);
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (column.floor() as isize + dx, row.floor() as isize + dy);
            let share = |at: f32, place: isize| 1.0 - (at - place as f32).abs();
            let weight = share(column, x) * share(row, y);
            let (x, y) = (x.rem_euclid(width as isize), y.clamp(0, ROWS as isize - 1));
            let i = y as usize * width + x as usize;
            for c in 0..3 {
                radiance[c] += weight * self.radiance[i][c];
            }
            uncertainty += weight * self.uncertainty[i];
        }
        (radiance, uncertainty)
    }

    /// Light with its radiance multiplied.
    pub fn tinted(&self, gain: [f32; 3]) -> Self {
        let tinted = |v: &[f32; 3]| std::array::from_fn(|c| gain[c] * v[c]);
        Self {
            radiance: self.radiance.iter().map(tinted).collect(),
            ..self.clone()
        }
    }
}

/// An empty map.
fn blank() -> EnvironmentMap {
    EnvironmentMap::new(2 * ROWS, ROWS, vec![[0.0; 3]; 2 * ROWS * ROWS])
}

fn direction(map: &EnvironmentMap, i: usize) -> Vec3 {
    let d = map.direction(i % map.width(), i / map.width());
    Vec3::from_array(d.map(|v| v as f32))
}
