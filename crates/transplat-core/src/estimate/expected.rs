//! The light that is expected before the object is asked: brighter above, or as the rest of a capture shows it.

use glam::Vec3;

use super::sky::{SKY, nearest_direction, sky_basis};
use crate::bake::strata::{DIRECTIONS, directions};
use crate::capture_environment::{CaptureEnvironment, MOST_LOG};
use crate::environment::LightSamples;
use crate::sh::band_of;

/// Mean of the logarithm along the up axis (basis of mean square 1): the upper half is 2.8 times as bright as the lower.
const ABOVE: f64 = 0.6;

/// Width of a known sun, in degrees: half of what the bake's directions are apart.
const SUN_WIDTH: f32 = 5.0;

/// Radiance at least.
const LEAST_RADIANCE: f64 = 1e-6;

/// Prior of a fit: radiance by direction, and how much of that is uncertain.
pub(super) struct ExpectedLight {
    /// Radiance over the bake's directions that is certain, and that is not. `[3][DIRECTIONS]`
    certain: [Vec<f64>; 3],
    uncertain: [Vec<f64>; 3],
    /// Share of the fitted logarithm that what is certain takes.
    uncertainty: f64,
    /// True where the rest of a capture or a panorama shows some of it.
    pub is_shown: bool,
    /// True where that has the unit of the photographs.
    pub has_unit: bool,
    /// Directions of what is uncertain, one for each of the bake's that has any; those with the largest share of the light come first.
    pub uncertain_directions: Vec<Vec3>,
    /// Mean of each fitted coefficient. `[SKY]`
    pub coefficients: Vec<f64>,
}

impl ExpectedLight {
    /// Even light.
    pub fn even() -> Self {
        Self {
            certain: std::array::from_fn(|_| vec![0.0; DIRECTIONS]),
            uncertain: std::array::from_fn(|_| vec![1.0; DIRECTIONS]),
            uncertainty: 0.0,
            is_shown: false,
            has_unit: false,
            uncertain_directions: Vec::new(),
            coefficients: vec![0.0; SKY],
        }
    }

    /// Light that comes from above rather than from below.
    pub fn from_above(up: Vec3) -> Self {
        // The first band's functions are proportional to the coordinates, and their squares sum to 3.
        let mut coefficients = sky_basis(up);
        for (k, value) in coefficients.iter_mut().enumerate() {
            *value *= if band_of(k) == 1 {
                ABOVE / 3f64.sqrt()
            } else {
                0.0
            };
        }
        Self {
            coefficients,
            ..Self::even()
        }
    }

    /// Light that is known; suns are as wide as the directions are apart.
    pub fn known(light: &LightSamples) -> Self {
        let directions = directions();
        let mut energies = vec![[0.0; 3]; DIRECTIONS];
        let mut add = |j: usize, energy: [f32; 3], share: f64| {
            for (sum, energy) in energies[j].iter_mut().zip(energy) {
                *sum += share * f64::from(energy);
            }
        };
        for cell in &light.cells {
            let j = nearest_direction(&directions, cell.direction);
            add(j, cell.energy, 1.0);
        }
        for sun in &light.suns {
            let shares: Vec<f64> = directions
                .iter()
                .map(|d| {
                    let angle = sun.direction.angle_between(*d).to_degrees();
                    (-f64::from(angle / SUN_WIDTH).powi(2)).exp()
                })
                .collect();
            let all: f64 = shares.iter().sum();
            for (j, share) in shares.into_iter().enumerate() {
                add(j, sun.energy, share / all);
            }
        }
        // The unit of a panorama is nobody's.
        let radiance = |c: usize| {
            let mean = energies.iter().map(|e| e[c]).sum::<f64>() / DIRECTIONS as f64;
            let over_mean = |e: &[f64; 3]| (e[c] / mean.max(f64::MIN_POSITIVE)).max(LEAST_RADIANCE);
            energies.iter().map(over_mean).collect()
        };
        Self {
            uncertain: std::array::from_fn(radiance),
            ..Self::even()
        }
    }

    /// Light as the rest of a capture or a panorama shows it.
    pub fn shown(shown: &CaptureEnvironment) -> Self {
        let directions = directions();
        let mut sums = vec![([[0f64; 3]; 2], 0f64); DIRECTIONS];
        let mut toward = vec![(Vec3::ZERO, 0f32); DIRECTIONS];
        for (direction, omega, radiance) in shown.pixels() {
            let j = nearest_direction(&directions, direction);
            let (sum, weight) = &mut sums[j];
            let luminance = |v: [f32; 3]| omega as f32 * v.into_iter().sum::<f32>();
            toward[j].0 += luminance(radiance.uncertain) * direction;
            toward[j].1 += luminance(radiance.certain) + luminance(radiance.uncertain);
            for c in 0..3 {
                sum[0][c] += omega * f64::from(radiance.certain[c]);
                sum[1][c] += omega * f64::from(radiance.uncertain[c]);
            }
            *weight += omega;
        }
        let mean = |part: usize, c: usize| {
            let each = sums.iter();
            each.map(|(sum, weight)| sum[part][c] / weight.max(1e-12))
                .collect()
        };
        let mut certain: [Vec<f64>; 3] = std::array::from_fn(|c| mean(0, c));
        for value in certain.iter_mut().flatten() {
            *value = value.max(LEAST_RADIANCE);
        }
        toward.retain(|(sum, _)| *sum != Vec3::ZERO);
        let share = |(sum, all): &(Vec3, f32)| sum.length() / all;
        toward.sort_by(|a, b| share(b).total_cmp(&share(a)));
        let each = toward.into_iter();
        let uncertain_directions = each.map(|(sum, _)| sum.normalize());
        Self {
            uncertain_directions: uncertain_directions.collect(),
            certain,
            uncertain: std::array::from_fn(|c| mean(1, c)),
            uncertainty: f64::from(shown.uncertainty),
            is_shown: true,
            has_unit: shown.has_unit,
            coefficients: vec![0.0; SKY],
        }
    }

    /// True where a sun may be: one that a panorama shows is clipped in it.
    pub fn may_hold_sun(&self, d: Vec3) -> bool {
        let is_near = |uncertain: &Vec3| uncertain.angle_between(d).to_degrees() < SUN_WIDTH;
        let is_whole = self.is_shown && self.uncertainty == 0.0;
        !is_whole || self.uncertain_directions.iter().any(is_near)
    }

    /// Radiance towards one of the bake's directions, where the fitted logarithm is `log`, and its change with that.
    pub fn radiance(&self, channel: usize, direction: usize, log: f64) -> [f64; 2] {
        let log = log.clamp(f64::from(-MOST_LOG), f64::from(MOST_LOG));
        let certain = self.certain[channel][direction] * (self.uncertainty * log).exp();
        let uncertain = self.uncertain[channel][direction] * log.exp();
        [certain + uncertain, self.uncertainty * certain + uncertain]
    }
}
