//! The light that is expected before the object is asked: brighter above, or as the rest of a capture shows it.

use glam::Vec3;

use super::sky::{SKY, nearest_direction, sky_basis};
use crate::bake::strata::{DIRECTIONS, directions};
use crate::capture_environment::CaptureEnvironment;
use crate::environment::LightSamples;
use crate::sh::band_of;

/// Mean of the logarithm along the up axis (basis of mean square 1): the upper half is 2.8 times as bright as the lower.
const ABOVE: f64 = 0.6;

/// Width of a known sun, in degrees: half of what the bake's directions are apart.
const SUN_WIDTH: f32 = 5.0;

/// Prior of a fit: radiance by direction, and how much of that is uncertain.
pub(super) struct ExpectedLight {
    /// Logarithm of what is shown over the bake's directions. `[3][DIRECTIONS]`
    pub log_radiance: [Vec<f64>; 3],
    /// Uncertainty of it: factor of the fitted logarithm. `[DIRECTIONS]`
    pub uncertainty: Vec<f64>,
    /// True where the rest of a capture shows some of it.
    pub is_shown: bool,
    /// Mean of each fitted coefficient. `[SKY]`
    pub coefficients: Vec<f64>,
}

impl ExpectedLight {
    /// Even light.
    pub fn even() -> Self {
        Self {
            log_radiance: std::array::from_fn(|_| vec![0.0; DIRECTIONS]),
            uncertainty: vec![1.0; DIRECTIONS],
            is_shown: false,
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
        let log = |c: usize| {
            let mean = energies.iter().map(|e| e[c]).sum::<f64>() / DIRECTIONS as f64;
            let over_mean = |e: &[f64; 3]| (e[c] / mean.max(f64::MIN_POSITIVE)).max(1e-6);
            energies.iter().map(|e| over_mean(e).ln()).collect()
        };
        Self {
            log_radiance: std::array::from_fn(log),
            ..Self::even()
        }
    }

    /// Light as the rest of a capture shows it.
    pub fn shown(shown: &CaptureEnvironment) -> Self {
        let directions = directions();
        let mut sums = vec![[0f64; 6]; DIRECTIONS];
        for (direction, omega, radiance, uncertainty) in shown.pixels() {
            let [r, g, b] = radiance.map(f64::from);
            // What is uncertain changes a cell by its share of the light.
            let luminance = r + g + b;
            let each = [r, g, b, luminance * f64::from(uncertainty), luminance, 1.0];
            let cell = &mut sums[nearest_direction(&directions, direction)];
            for (sum, value) in cell.iter_mut().zip(each) {
                *sum += omega * value;
            }
        }
        let mean = |j: usize, k: usize| sums[j][k] / sums[j][if k == 3 { 4 } else { 5 }].max(1e-12);
        let of_each = |k: usize| {
            (0..DIRECTIONS)
                .map(move |j| (j, k))
                .map(|(j, k)| mean(j, k))
        };
        Self {
            log_radiance: std::array::from_fn(|c| of_each(c).map(|v| v.max(1e-6).ln()).collect()),
            uncertainty: of_each(3).collect(),
            is_shown: true,
            coefficients: vec![0.0; SKY],
        }
    }
}
