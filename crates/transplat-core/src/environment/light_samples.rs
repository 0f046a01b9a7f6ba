//! Sampled environment: suns as delta lights, and the rest of the map in stratified cells.
//!
//! A sun is a few pixels wide and holds up to half of all light: its shadow is crisp, and no sum over a lattice of directions can show
//! that. So it is taken out of the map and kept with its exact direction. What is left is smooth enough for the lattice.

use std::f64::consts::PI;

use glam::{DMat3, DVec3, Vec3};
use multiversion::multiversion;
use rayon::prelude::*;

use super::map::EnvironmentMap;
use crate::color::luminance;

/// Light from one direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightSample {
    /// Unit vector towards the source.
    pub direction: Vec3,
    /// Radiance times solid angle, linear RGB: the irradiance on a surface that faces it.
    pub energy: [f32; 3],
}

/// A light as the directional method sees it.
#[derive(Clone, Debug, PartialEq)]
pub struct LightSamples {
    /// Compact bright sources, brightest first; at most [`MAX_SUNS`].
    pub suns: Vec<LightSample>,
    /// Everything else, in cells of about 2.8 degrees.
    pub cells: Vec<LightSample>,
}

/// Compact sources that are taken out of a map, at most.
pub const MAX_SUNS: usize = 8;

/// A compact source holds at least this share of all light: what holds less throws no shadow whose edge would be seen.
pub const SUN_SHARE: f64 = 0.025;

/// Radius of the disc around the brightest pixel that a compact source lies in, in degrees.
pub const SUN_RADIUS: f64 = 4.0;

/// Outer radius of the ring around it whose median is what the sky would be without it, in degrees.
const RING_RADIUS: f64 = 10.0;

/// Most light that the ring may hold above its median, relative to the disc: beside a piece of the rim of a soft box it is five times as much, beside
/// a window of a few degrees less than as much.
const MOST_BESIDE: f64 = 2.0;

/// Bright discs that are looked at before what is left is sky.
const MOST_TRIES: usize = 64;

/// Columns of the map in which suns are looked for: 0.35 degrees.
const SEARCH_COLUMNS: usize = 1024;

/// Columns of the grid of cells.
const CELL_COLUMNS: usize = 128;

impl LightSamples {
    /// Radiance 1 from everywhere.
    pub fn even() -> Self {
        Self::of(&EnvironmentMap::new(
            2 * CELL_COLUMNS,
            CELL_COLUMNS,
            vec![[1.0; 3]; 2 * CELL_COLUMNS * CELL_COLUMNS],
        ))
    }

    /// Takes a map apart.
    pub fn of(map: &EnvironmentMap) -> Self {
        let map = map.reduced(SEARCH_COLUMNS);
        let mut pixels = Pixels::of(&map);
        let total = pixels.sum();
        let least = SUN_SHARE * total;
        let mut suns = Vec::new();
        for _ in 0..MOST_TRIES {
            let Some(peak) = pixels.peak(least).filter(|_| suns.len() < MAX_SUNS) else {
                break;
            };
            let (excess, beside) = pixels.excess_around(peak);
            let energy: f64 = excess.iter().flat_map(|(_, e)| e).sum();
            let all = excess
                .iter()
                .flat_map(|(i, _)| pixels.energy[*i])
                .sum::<f64>();
            // A piece of a window or a soft box is none: around its middle, and beside its rim, it is as bright.
            let compact = energy >= 0.5 * all && beside < MOST_BESIDE * energy;
            let is_sun = energy >= least && compact;
            if is_sun {
                suns.push(light_sample(
                    excess.iter().map(|(i, e)| (pixels.direction(*i), *e)),
                ));
            }
            // A small bright dot is sky, and does not hide a sun that is less bright.
            pixels.settle(&excess, is_sun);
        }
        Self {
            suns,
            cells: pixels.cells(),
        }
    }

    /// The light turned by `rotation` (world to world).
    pub fn rotated(&self, rotation: DMat3) -> Self {
        self.map(|b| LightSample {
            direction: (rotation * b.direction.as_dvec3()).as_vec3(),
            ..*b
        })
    }

    /// The light mirrored left to right in its own map: `f(x, -y, z)`.
    pub fn mirrored(&self) -> Self {
        self.map(|b| LightSample {
            direction: b.direction * Vec3::new(1.0, -1.0, 1.0),
            ..*b
        })
    }

    /// The light with each channel multiplied.
    pub fn tinted(&self, gain: [f32; 3]) -> Self {
        self.map(|b| LightSample {
            energy: std::array::from_fn(|c| b.energy[c] * gain[c]),
            ..*b
        })
    }

    /// The light with no energy above `most`, so that no sum overflows.
    pub fn clamped(&self, most: f32) -> Self {
        self.map(|b| LightSample {
            energy: b.energy.map(|e| e.min(most)),
            ..*b
        })
    }

    /// Light samples with the suns among the cells.
    pub fn with_suns_as_sky(&self) -> Self {
        Self {
            suns: Vec::new(),
            cells: [&self.cells[..], &self.suns[..]].concat(),
        }
    }

    /// Adds a compact source; one too many makes the dimmest sky.
    pub fn add(&mut self, light_sample: LightSample) {
        self.suns.push(light_sample);
        self.suns
            .sort_by(|a, b| luminance(b.energy).total_cmp(&luminance(a.energy)));
        if self.suns.len() > MAX_SUNS {
            self.cells.extend(self.suns.pop());
        }
    }

    fn map(&self, f: impl Fn(&LightSample) -> LightSample) -> Self {
        Self {
            suns: self.suns.iter().map(&f).collect(),
            cells: self.cells.iter().map(&f).collect(),
        }
    }

    /// The cells gathered into the directions nearest to them; each beam comes from where most of its light is. `[N]`
    pub fn gathered(&self, lattice: &[Vec3]) -> Vec<LightSample> {
        let axes: [Vec<f32>; 3] = std::array::from_fn(|c| lattice.iter().map(|d| d[c]).collect());
        let nearest: Vec<usize> = self
            .cells
            .par_iter()
            .map(|cell| nearest(cell.direction, &axes))
            .collect();
        let mut sums = vec![Sum::default(); lattice.len()];
        for (cell, i) in self.cells.iter().zip(nearest) {
            sums[i].add(cell.direction.as_dvec3(), cell.energy.map(f64::from));
        }
        sums.into_iter()
            .zip(lattice)
            .map(|(s, d)| s.light_sample(*d))
            .collect()
    }

    /// Irradiance on a surface that sees everything, averaged over all normals, per channel.
    pub fn mean_irradiances(&self) -> [f32; 3] {
        let mut sum = [0f64; 3];
        for light_sample in self.suns.iter().chain(&self.cells) {
            for (s, e) in sum.iter_mut().zip(light_sample.energy) {
                *s += f64::from(e);
            }
        }
        // The clamped cosine's mean over the sphere is a quarter.
        sum.map(|s| (s / 4.0) as f32)
    }

    /// The mean of those.
    pub fn mean_irradiance(&self) -> f32 {
        self.mean_irradiances().iter().sum::<f32>() / 3.0
    }
}

/// A light as a picture of what sums over directions know of it: even around each direction, with its suns as discs.
#[derive(Clone, Debug)]
pub struct Mosaic {
    axes: [Vec<f32>; 3],
    /// Radiance of each direction's surroundings.
    radiance: Vec<[f32; 3]>,
    /// Direction and radiance.
    suns: Vec<(Vec3, [f32; 3])>,
}

/// Cosine of the radius of a sun's disc in a [`Mosaic`], so large that a small picture shows it: 2 degrees.
const SHOWN_SUN: f32 = 0.999_39;

impl Mosaic {
    /// The mosaic of a light on some directions, which share the sphere evenly.
    pub fn new(light_samples: &LightSamples, lattice: &[Vec3]) -> Self {
        let over = |light_sample: &LightSample, solid_angle: f64| {
            light_sample.energy.map(|e| e / solid_angle as f32)
        };
        let each = 4.0 * PI / lattice.len() as f64;
        let disc = 2.0 * PI * f64::from(1.0 - SHOWN_SUN);
        let sky = light_samples.gathered(lattice);
        Self {
            axes: std::array::from_fn(|c| lattice.iter().map(|d| d[c]).collect()),
            radiance: sky.iter().map(|b| over(b, each)).collect(),
            suns: light_samples
                .suns
                .iter()
                .map(|b| (b.direction, over(b, disc)))
                .collect(),
        }
    }

    /// Radiance from a direction.
    pub fn radiance(&self, d: Vec3) -> [f32; 3] {
        let mut sum = self.radiance[nearest(d, &self.axes)];
        for (toward, radiance) in &self.suns {
            if toward.dot(d) > SHOWN_SUN {
                sum = std::array::from_fn(|c| sum[c] + radiance[c]);
            }
        }
        sum
    }
}

/// Index of the direction nearest to `d`, an axis after the other.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn nearest(d: Vec3, [x, y, z]: &[Vec<f32>; 3]) -> usize {
    const LANES: usize = 16;
    let (mut most, mut block) = ([f32::MIN; LANES], [0u32; LANES]);
    let whole = x.len() / LANES * LANES;
    for start in (0..whole).step_by(LANES) {
        let part = |p: &[f32]| -> [f32; LANES] {
            let mut out = [0f32; LANES];
            out.copy_from_slice(&p[start..start + LANES]);
            out
        };
        let (x, y, z) = (part(x), part(y), part(z));
        for i in 0..LANES {
            let cosine = d.x * x[i] + d.y * y[i] + d.z * z[i];
            block[i] = if cosine > most[i] {
                start as u32
            } else {
                block[i]
            };
            most[i] = if cosine > most[i] { cosine } else { most[i] };
        }
    }
    let lanes = (0..LANES).map(|i| (most[i], block[i] as usize + i));
    let rest = (whole..x.len()).map(|i| (d.x * x[i] + d.y * y[i] + d.z * z[i], i));
    lanes
        .chain(rest)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map_or(0, |found| found.1)
}

/// A beam in the making: what many parts hold together, from their mean direction.
#[derive(Clone, Copy, Default)]
struct Sum {
    toward: DVec3,
    energy: [f64; 3],
}

impl Sum {
    fn add(&mut self, direction: DVec3, energy: [f64; 3]) {
        self.toward += direction * energy.iter().sum::<f64>();
        for (sum, e) in self.energy.iter_mut().zip(energy) {
            *sum += e;
        }
    }

    /// The beam; from `dark` where there is no light.
    fn light_sample(&self, dark: Vec3) -> LightSample {
        LightSample {
            direction: self.toward.normalize_or(dark.as_dvec3()).as_vec3(),
            energy: self.energy.map(|v| v as f32),
        }
    }
}

/// The beam that holds what all of some pixels do.
fn light_sample(parts: impl Iterator<Item = (DVec3, [f64; 3])>) -> LightSample {
    let mut sum = Sum::default();
    parts.for_each(|(d, e)| sum.add(d, e));
    sum.light_sample(Vec3::Z)
}

/// A map's pixels as energies.
struct Pixels<'a> {
    map: &'a EnvironmentMap,
    /// `[height][width]`
    energy: Vec<[f64; 3]>,
    /// Radiance, all channels; nothing where no sun is looked for any more. `[height][width]`
    radiance: Vec<f64>,
}

impl<'a> Pixels<'a> {
    fn of(map: &'a EnvironmentMap) -> Self {
        let energy: Vec<[f64; 3]> = map
            .pixels()
            .iter()
            .enumerate()
            .map(|(i, p)| {
                let omega = map.pixel_solid_angle(i / map.width());
                p.map(|v| omega * f64::from(v))
            })
            .collect();
        let radiance = map.pixels().iter();
        let radiance = radiance.map(|p| p.iter().map(|v| f64::from(*v)).sum());
        Self {
            map,
            radiance: radiance.collect(),
            energy,
        }
    }

    fn sum(&self) -> f64 {
        self.energy.iter().flatten().sum()
    }

    fn direction(&self, i: usize) -> DVec3 {
        let w = self.map.width();
        DVec3::from_array(self.map.direction(i % w, i / w))
    }

    /// The brightest pixel, if a disc as bright as that could hold so much.
    fn peak(&self, least: f64) -> Option<usize> {
        let all = self.radiance.iter().enumerate();
        let (peak, radiance) = all.max_by(|a, b| a.1.total_cmp(b.1))?;
        let disc = 2.0 * PI * (1.0 - SUN_RADIUS.to_radians().cos());
        // On a coarse map one pixel is more than the disc.
        let omega = disc.max(self.map.pixel_solid_angle(peak / self.map.width()));
        (radiance * omega >= least && least > 0.0).then_some(peak)
    }

    /// Excess of the disc around a pixel over the sky around it: index and energy of each pixel, and the ring's in all.
    fn excess_around(&self, peak: usize) -> (Vec<(usize, [f64; 3])>, f64) {
        let (w, h) = (self.map.width(), self.map.height());
        let toward = self.direction(peak);
        let [inner, outer] = [SUN_RADIUS, RING_RADIUS].map(|degrees| degrees.to_radians().cos());
        // Rows further away than the ring are not looked at.
        let reach = (RING_RADIUS / 180.0 * h as f64).ceil() as usize + 1;
        let rows = (peak / w).saturating_sub(reach)..(peak / w + reach + 1).min(h);
        let (mut disc, mut ring) = (Vec::new(), Vec::new());
        for i in rows.start * w..rows.end * w {
            let cosine = self.direction(i).dot(toward);
            if cosine > inner {
                disc.push(i);
            } else if cosine > outer {
                ring.push(i);
            }
        }
        let sky: [f64; 3] = std::array::from_fn(|c| {
            let mut values: Vec<f64> = ring
                .iter()
                .map(|i| self.energy[*i][c] / self.map.pixel_solid_angle(i / w))
                .collect();
            let middle = values.len() / 2;
            if values.is_empty() {
                return 0.0;
            }
            *values.select_nth_unstable_by(middle, f64::total_cmp).1
        });
        let excess = |i: usize| -> [f64; 3] {
            let omega = self.map.pixel_solid_angle(i / w);
            std::array::from_fn(|c| (self.energy[i][c] - sky[c] * omega).max(0.0))
        };
        let beside = ring.iter().flat_map(|i| excess(*i)).sum();
        (disc.into_iter().map(|i| (i, excess(i))).collect(), beside)
    }

    /// Looks no more at a disc, and takes its excess away where that is a sun.
    fn settle(&mut self, excess: &[(usize, [f64; 3])], is_sun: bool) {
        for (i, x) in excess {
            self.radiance[*i] = 0.0;
            if is_sun {
                for (e, x) in self.energy[*i].iter_mut().zip(x) {
                    *e -= x;
                }
            }
        }
    }

    /// The rest, a block of pixels a cell.
    fn cells(&self) -> Vec<LightSample> {
        let (w, h) = (self.map.width(), self.map.height());
        let columns = CELL_COLUMNS.min(w);
        let rows = (CELL_COLUMNS / 2).min(h);
        let span = |i: usize, of: usize, to: usize| i * of / to..(i + 1) * of / to;
        (0..rows * columns)
            .into_par_iter()
            .map(|cell| {
                let (y, x) = (cell / columns, cell % columns);
                // Not by the pixel's number: its division costs more than all else here.
                let row_of = |row: usize| {
                    span(x, w, columns).map(move |column| {
                        let direction = self.map.direction(column, row);
                        (DVec3::from_array(direction), self.energy[row * w + column])
                    })
                };
                light_sample(span(y, h, rows).flat_map(row_of))
            })
            .filter(|b| b.energy.iter().any(|e| *e > 0.0))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::{fibonacci_sphere, lattice};

    /// A grey sky of radiance 0.2 with a sun of radiance 1000, 2 degrees wide.
    fn sunny(width: usize) -> EnvironmentMap {
        let sun = DVec3::new(0.5, -0.6, 0.7).normalize();
        EnvironmentMap::of_directions(width, width / 2, |d| {
            if d.dot(sun) > 1f64.to_radians().cos() {
                [1000.0, 900.0, 700.0]
            } else {
                [0.2; 3]
            }
        })
    }

    #[test]
    fn a_sun_is_taken_out_and_nothing_is_lost() {
        let map = sunny(1024);
        let light_samples = LightSamples::of(&map);
        assert_eq!(light_samples.suns.len(), 1);
        let sun = &light_samples.suns[0];
        let truth = Vec3::new(0.5, -0.6, 0.7).normalize();
        // The pixels' centroid, a third of a degree wide each.
        assert!(sun.direction.angle_between(truth) < 0.2f32.to_radians());
        // Its rim cuts through pixels, six across.
        let omega = 2.0 * PI * (1.0 - 1f64.to_radians().cos());
        assert!((f64::from(sun.energy[0]) / (999.8 * omega) - 1.0).abs() < 0.15);
        let total = crate::environment::project_environment(&map, 0).mean_irradiance();
        assert!((light_samples.mean_irradiance() / total - 1.0).abs() < 1e-3);
        // What is left is the sky: no cell stands out.
        for light_sample in light_samples.gathered(&lattice(64)) {
            let e = light_sample.energy;
            assert!(
                (e[0] / (0.2 * 4.0 * PI as f32 / 64.0) - 1.0).abs() < 0.25,
                "{e:?}"
            );
        }
    }

    #[test]
    fn a_sky_without_sun_has_none() {
        assert!(LightSamples::even().suns.is_empty());
        assert!((LightSamples::even().mean_irradiance() - PI as f32).abs() < 1e-3);
        let dark = EnvironmentMap::new(64, 32, vec![[0.0; 3]; 64 * 32]);
        assert!(LightSamples::of(&dark).suns.is_empty());
        assert_eq!(LightSamples::of(&dark).mean_irradiance(), 0.0);
    }

    #[test]
    fn a_small_bright_dot_does_not_hide_the_sun() {
        let map = sunny(1024);
        let plain = LightSamples::of(&map);
        assert_eq!(plain.suns.len(), 1);
        let mut pixels = map.pixels().to_vec();
        // Brighter than the sun, near the pole, where a pixel is small: less than a hundredth of all light.
        pixels[20 * 1024 + 100] = [4000.0; 3];
        let dotted = LightSamples::of(&EnvironmentMap::new(1024, 512, pixels));
        assert_eq!(dotted.suns.len(), 1);
        let cosine = dotted.suns[0].direction.dot(plain.suns[0].direction);
        assert!(cosine > 0.9999, "{:?}", dotted.suns);
    }

    #[test]
    fn no_sun_is_cut_out_of_a_soft_box() {
        // 24 and 40 degrees wide, brighter in its middle, in a dark room.
        for half_width in [12f64, 20.0] {
            let map = EnvironmentMap::of_directions(512, 256, |d| {
                let off = d.dot(DVec3::X).clamp(-1.0, 1.0).acos().to_degrees() / half_width;
                [if off < 1.0 {
                    (20.0 - 8.0 * off) as f32
                } else {
                    0.02
                }; 3]
            });
            assert_eq!(LightSamples::of(&map).suns, [], "{half_width}");
        }
    }

    #[test]
    fn a_mosaic_holds_the_lights_energy_and_shows_its_sun() {
        let map = sunny(512);
        let light_samples = LightSamples::of(&map);
        let mosaic = Mosaic::new(&light_samples, &lattice(384));
        let many = fibonacci_sphere(200_000);
        let mean = many
            .iter()
            .map(|d| f64::from(mosaic.radiance(DVec3::from_array(*d).as_vec3())[1]))
            .sum::<f64>()
            / many.len() as f64;
        // The mean irradiance over all normals is pi times the mean radiance.
        let exact = f64::from(light_samples.mean_irradiances()[1]) / PI;
        // 60 of the samples hit the sun's disc, which holds a fifth of the light: an eighth of that is their scatter.
        assert!((mean - exact).abs() < 0.03 * exact, "{mean} {exact}");
        // On its disc it outshines the sky that is behind it.
        let sun = light_samples.suns[0].direction;
        assert!(mosaic.radiance(sun)[1] > 10.0 * mosaic.radiance(-sun)[1]);
    }

    #[test]
    fn small_maps_are_taken_apart_too() {
        for (w, h) in [(1, 1), (2, 1), (1, 2), (7, 3)] {
            let map = EnvironmentMap::new(w, h, vec![[1.0, 2.0, 3.0]; w * h]);
            let light_samples = LightSamples::of(&map);
            assert!((light_samples.mean_irradiance() - 2.0 * PI as f32).abs() < 1e-3);
        }
    }
}
