//! Environment of a capture, as the rest of it or a panorama shows it: where an estimate of the light begins.

use std::f32::consts::PI;

use glam::{DMat3, Vec3};

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

/// Logarithms of light stay within this.
pub const MOST_LOG: f32 = 12.0;

/// Radiance of a direction, in two parts.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShownRadiance {
    /// As it is shown.
    pub certain: [f32; 3],
    /// As it is expected where it is clipped or open.
    pub uncertain: [f32; 3],
}

impl ShownRadiance {
    /// Radiance after a change of the logarithm of what is uncertain; what is certain takes the share `uncertainty` of it.
    pub fn changed(self, log: [f32; 3], uncertainty: f32) -> [f32; 3] {
        std::array::from_fn(|c| {
            let log = log[c].clamp(-MOST_LOG, MOST_LOG);
            self.certain[c] * (uncertainty * log).exp() + self.uncertain[c] * log.exp()
        })
    }

    fn add(&mut self, other: Self, weight: f32) {
        for c in 0..3 {
            self.certain[c] += weight * other.certain[c];
            self.uncertain[c] += weight * other.uncertain[c];
        }
    }

    /// Light in another unit.
    fn scaled(self, gain: [f32; 3]) -> Self {
        let scaled = |v: [f32; 3]| std::array::from_fn(|c| gain[c] * v[c]);
        Self {
            certain: scaled(self.certain),
            uncertain: scaled(self.uncertain),
        }
    }
}

/// The light around a place as a splat or a panorama shows it, with its uncertainty: what is clipped was brighter, and what is open is not known.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureEnvironment {
    /// Radiance by direction in the splat's coordinates, equirectangular. `[2 ROWS x ROWS]`
    pixels: Vec<ShownRadiance>,
    /// Uncertainty of what is certain: see [`ShownRadiance::changed`].
    pub uncertainty: f32,
    /// True where it has the unit of the capture's photographs.
    pub has_unit: bool,
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

    /// Environment of a panorama whose highlights are clipped from the radiance `white` on; `to_asset` rotates the map's directions.
    pub fn of_panorama(map: &EnvironmentMap, white: f32, to_asset: DMat3, has_unit: bool) -> Self {
        let blank = blank();
        let mut sums = vec![(ShownRadiance::default(), 0.0); blank.pixels().len()];
        // Every pixel of ours has a few of the map's.
        let steps = (4 * ROWS).div_ceil(map.height());
        for i in 0..map.pixels().len() {
            let (column, row) = (i % map.width(), i / map.width());
            let pixel = map.pixels()[i];
            let pixel = match is_clipped(pixel, white) {
                true => clipped_radiance(pixel),
                false => ShownRadiance {
                    certain: pixel,
                    ..ShownRadiance::default()
                },
            };
            let omega = map.pixel_solid_angle(row) as f32;
            for step in 0..steps * steps {
                let [across, down] =
                    [step % steps, step / steps].map(|s| (s as f64 + 0.5) / steps as f64 - 0.5);
                let d = to_asset * direction_in(map, column as f64 + across, row as f64 + down);
                let (sum, weight) = &mut sums[nearest_pixel(d.as_vec3())];
                sum.add(pixel, omega);
                *weight += omega;
            }
        }
        let mean = |(sum, weight): (ShownRadiance, f32)| sum.scaled([1.0 / weight.max(1e-12); 3]);
        Self {
            pixels: sums.into_iter().map(mean).collect(),
            uncertainty: 0.0,
            has_unit,
            cover: 1.0,
        }
    }

    /// The light that a cube shows, brighter where that is clipped; where it is open like the rest of it, and brighter along `up`.
    fn of(cube: &Cube, up: Vec3, white: Option<f32>) -> Self {
        let blank = blank();
        let width = blank.width();
        let mut logs = Vec::with_capacity(blank.pixels().len());
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
            logs.push((log.map(|v| v / all), covered / all, sure / all));
        }
        let elsewhere = known.map(|[log, omega]| (log / omega.max(1e-9)) as f32);
        let pixel = |(i, (log, covered, sure)): (usize, ([f32; 3], f32, f32))| {
            let above = BRIGHTER_ABOVE * direction(&blank, i).dot(up);
            let open = 1.0 - covered;
            let radiance: [f32; 3] =
                std::array::from_fn(|c| (log[c] + open * (elsewhere[c] + above)).exp());
            ShownRadiance {
                certain: radiance.map(|v| sure * v),
                uncertain: radiance.map(|v| (1.0 - sure) * v),
            }
        };
        Self {
            pixels: logs.into_iter().enumerate().map(pixel).collect(),
            uncertainty: LEAST_UNCERTAINTY,
            has_unit: true,
            cover: cover / (4.0 * PI),
        }
    }

    /// Pixels: direction, solid angle and radiance.
    pub fn pixels(&self) -> impl Iterator<Item = (Vec3, f64, ShownRadiance)> {
        let blank = blank();
        let each = self.pixels.iter().enumerate();
        each.map(move |(i, radiance)| {
            let omega = blank.pixel_solid_angle(i / blank.width());
            (direction(&blank, i), omega, *radiance)
        })
    }

    /// Radiance towards a direction.
    pub fn toward(&self, d: Vec3) -> ShownRadiance {
        let width = 2 * ROWS;
        let row = d.z.clamp(-1.0, 1.0).acos() / PI * ROWS as f32 - 0.5;
        let column = (0.5 - d.y.atan2(d.x) / (2.0 * PI)) * width as f32 - 0.5;
        let mut sum = ShownRadiance::default();
        for (dx, dy) in [(0, 0), (1, 0), (0, 1), (1, 1)] {
            let (x, y) = (column.floor() as isize + dx, row.floor() as isize + dy);
            let share = |at: f32, place: isize| 1.0 - (at - place as f32).abs();
            let weight = share(column, x) * share(row, y);
            let (x, y) = (x.rem_euclid(width as isize), y.clamp(0, ROWS as isize - 1));
            sum.add(self.pixels[y as usize * width + x as usize], weight);
        }
        sum
    }

    /// Light with its radiance multiplied.
    pub fn tinted(&self, gain: [f32; 3]) -> Self {
        Self {
            pixels: self.pixels.iter().map(|p| p.scaled(gain)).collect(),
            ..self.clone()
        }
    }
}

/// Pixel that a direction falls into.
fn nearest_pixel(d: Vec3) -> usize {
    let row = d.z.clamp(-1.0, 1.0).acos() / PI * ROWS as f32;
    let column = (0.5 - d.y.atan2(d.x) / (2.0 * PI)) * (2 * ROWS) as f32;
    let row = (row as usize).min(ROWS - 1);
    row * 2 * ROWS + (column as usize).min(2 * ROWS - 1)
}

/// True for a pixel of a panorama that is clipped from `white` on.
pub fn is_clipped(pixel: [f32; 3], white: f32) -> bool {
    pixel.into_iter().any(|v| v >= white)
}

/// Expected radiance of a clipped pixel, which was at least as bright as it is shown.
pub fn clipped_radiance(pixel: [f32; 3]) -> ShownRadiance {
    ShownRadiance {
        certain: pixel,
        uncertain: pixel.map(|v| (BEYOND_WHITE - 1.0) * v),
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
