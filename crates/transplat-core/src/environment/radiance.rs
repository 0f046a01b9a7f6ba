//! Incident radiance of a light as SH coefficients.

use std::f64::consts::PI;

use glam::{DMat3, Vec3};
use rayon::prelude::*;

use super::map::{EnvironmentMap, azimuth};
use crate::sh::{
    MAX_DEGREE, SQRT_4PI, band_of, basis_constants, coefficient_count, evaluate_basis,
    rotate_coefficients,
};

/// A light as the transfer sees it: SH coefficients of incident radiance `L` to a degree.
#[derive(Clone, Debug, PartialEq)]
pub struct IncidentRadiance {
    /// Degree of the expansion.
    pub degree: usize,
    /// `[K][3]`, linear RGB.
    pub coefficients: Vec<[f32; 3]>,
}

impl IncidentRadiance {
    /// Radiance 1 from everywhere.
    pub fn even(degree: usize) -> Self {
        let mut coefficients = vec![[0f32; 3]; coefficient_count(degree)];
        coefficients[0] = [SQRT_4PI as f32; 3];
        Self {
            degree,
            coefficients,
        }
    }

    /// The light turned by `rotation` (world to world).
    pub fn rotated(&self, rotation: DMat3) -> Self {
        Self {
            degree: self.degree,
            coefficients: rotate_coefficients(rotation, self.degree, &self.coefficients),
        }
    }

    /// The light mirrored left to right in its own map: `f(x, -y, z)`, which turns the sign of all coefficients with m < 0.
    pub fn mirrored(&self) -> Self {
        let mut out = self.clone();
        for (i, c) in out.coefficients.iter_mut().enumerate() {
            let l = band_of(i);
            if i < l * l + l {
                *c = c.map(|v| -v);
            }
        }
        out
    }

    /// The light's bands up to `degree`; missing ones are dark.
    pub fn truncated(&self, degree: usize) -> Self {
        let mut coefficients = self.coefficients.clone();
        coefficients.resize(coefficient_count(degree), [0.0; 3]);
        Self {
            degree,
            coefficients,
        }
    }

    /// The light with each channel multiplied.
    pub fn tinted(&self, gain: [f32; 3]) -> Self {
        Self {
            degree: self.degree,
            coefficients: self
                .coefficients
                .iter()
                .map(|c| std::array::from_fn(|i| c[i] * gain[i]))
                .collect(),
        }
    }

    /// Adds light from one direction, radiance times solid angle.
    pub fn add(&mut self, direction: Vec3, energy: [f32; 3]) {
        let mut basis = vec![0f32; self.coefficients.len()];
        evaluate_basis(direction.to_array(), self.degree, &mut basis);
        for (c, y) in self.coefficients.iter_mut().zip(basis) {
            *c = std::array::from_fn(|i| c[i] + y * energy[i]);
        }
    }

    /// The light with its strength multiplied.
    pub fn scaled(&self, gain: f32) -> Self {
        self.tinted([gain; 3])
    }

    /// Irradiance on a surface that sees everything, averaged over all normals and the three channels: `pi` times the mean radiance.
    pub fn mean_irradiance(&self) -> f32 {
        self.mean_irradiances().iter().sum::<f32>() / 3.0
    }

    /// Mean irradiance by channel.
    pub fn mean_irradiances(&self) -> [f32; 3] {
        self.coefficients[0].map(|dc| (PI / SQRT_4PI) as f32 * dc)
    }

    /// True for black light.
    pub fn is_black(&self) -> bool {
        self.coefficients.iter().flatten().all(|v| *v == 0.0)
    }
}

/// Projects a map on the basis: every pixel's centre with its exact solid angle: a sun is a few pixels wide, and point samples miss it.
///
/// A row is first reduced to its Fourier sums over azimuth, of which all its coefficients are made. Sums are kept in f64.
pub fn project_environment(map: &EnvironmentMap, degree: usize) -> IncidentRadiance {
    assert!(degree <= MAX_DEGREE);
    let k = coefficient_count(degree);
    let waves: Vec<[(f32, f32); MAX_DEGREE + 1]> = (0..map.width)
        .map(|column| {
            std::array::from_fn(|m| {
                let (sin, cos) = (m as f64 * azimuth(column, map.width)).sin_cos();
                (cos as f32, sin as f32)
            })
        })
        .collect();
    let sums = map
        .pixels
        .par_chunks_exact(map.width)
        .enumerate()
        .fold(
            || vec![[0f64; 3]; k],
            |mut sums, (row, pixels)| {
                let fourier = fourier_sums(pixels, &waves, degree);
                for (i, weight) in row_weights(map, row, degree).into_iter().enumerate() {
                    let center = band_of(i) * (band_of(i) + 1);
                    let wave = &fourier[i.abs_diff(center)];
                    for (sum, (cos, sin)) in sums[i].iter_mut().zip(wave) {
                        *sum += weight * if i >= center { cos } else { sin };
                    }
                }
                sums
            },
        )
        .reduce(
            || vec![[0f64; 3]; k],
            |mut a, b| {
                for (a, b) in a.iter_mut().flatten().zip(b.iter().flatten()) {
                    *a += b;
                }
                a
            },
        );
    IncidentRadiance {
        degree,
        coefficients: sums.iter().map(|c| c.map(|v| v as f32)).collect(),
    }
}

type FourierSums = [[(f64, f64); 3]; MAX_DEGREE + 1];

/// `sum over the row of L cos(m phi), L sin(m phi)`, per channel.
fn fourier_sums(
    pixels: &[[f32; 3]],
    waves: &[[(f32, f32); MAX_DEGREE + 1]],
    degree: usize,
) -> FourierSums {
    let mut total: FourierSums = Default::default();
    // Short f32 sums inside long f64 ones: fast, and no loss that grows with the width.
    for (pixels, waves) in pixels.chunks(32).zip(waves.chunks(32)) {
        let mut part = [[(0f32, 0f32); 3]; MAX_DEGREE + 1];
        for (pixel, wave) in pixels.iter().zip(waves) {
            for m in 0..=degree {
                for c in 0..3 {
                    part[m][c].0 += pixel[c] * wave[m].0;
                    part[m][c].1 += pixel[c] * wave[m].1;
                }
            }
        }
        for m in 0..=degree {
            for c in 0..3 {
                total[m][c].0 += f64::from(part[m][c].0);
                total[m][c].1 += f64::from(part[m][c].1);
            }
        }
    }
    total
}

/// Solid angle times `q(l,|m|) sin^|m|(theta)` of one row, for each coefficient: what its Fourier sums are multiplied by. `[K]`
pub fn row_weights(map: &EnvironmentMap, row: usize, degree: usize) -> Vec<f64> {
    let constants = basis_constants();
    let (sin, z) = (PI * (row as f64 + 0.5) / map.height as f64).sin_cos();
    // `q(l,m) sin^m(theta)` at the height of the row, with the basis's normalisation.
    let mut q = [[0f64; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    for m in 0..=degree {
        q[m][m] = constants.start[m] * sin.powi(m as i32);
        for l in m + 1..=degree {
            let below = if l > m + 1 { q[l - 2][m] } else { 0.0 };
            q[l][m] = constants.a[l][m] * z * q[l - 1][m] - constants.b[l][m] * below;
        }
    }
    let weight = map.pixel_solid_angle(row);
    (0..coefficient_count(degree))
        .map(|i| {
            let l = band_of(i);
            weight * q[l][i.abs_diff(l * l + l)]
        })
        .collect()
}
