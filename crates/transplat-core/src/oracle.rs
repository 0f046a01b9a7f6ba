//! Oracle: the same mathematics in plain f64, one surfel at a time, as the formulas read. Production code and the GPU passes are tested against it.

mod directional;
mod estimate;
mod harmonic;
mod pooling;
mod rays;

use glam::DVec3;

use crate::environment::EnvironmentMap;
use crate::sh::{coefficient_count, evaluate_basis, fibonacci_sphere};

pub use directional::OracleDirectional;
pub use estimate::EstimateProblem;
pub use harmonic::{OracleHarmonic, relight_asset, relight_surfel, visibility_coefficients};
pub use rays::{first_hit, hit_distance, openness, transmittance};

/// `L_k = sum over pixels of L(d) Y_k(d) omega`, `[K][3]`.
pub fn project_environment(map: &EnvironmentMap, degree: usize) -> Vec<[f64; 3]> {
    let k = coefficient_count(degree);
    let mut sums = vec![[0f64; 3]; k];
    let mut y = vec![0f64; k];
    for row in 0..map.height() {
        let omega = map.pixel_solid_angle(row);
        for column in 0..map.width() {
            evaluate_basis(map.direction(column, row), degree, &mut y);
            let pixel = map.pixels()[row * map.width() + column];
            for (sum, y) in sums.iter_mut().zip(&y) {
                for (s, p) in sum.iter_mut().zip(pixel) {
                    *s += omega * y * f64::from(p);
                }
            }
        }
    }
    sums
}

/// Error against exact values: the L2 norm of the difference over theirs, and the largest difference.
pub fn difference<A: Copy + Into<f64>, B: Copy + Into<f64>>(
    got: &[[A; 3]],
    exact: &[[B; 3]],
) -> (f64, f64) {
    let (mut off, mut all, mut largest) = (0.0, 0.0, 0f64);
    for (got, exact) in got.iter().flatten().zip(exact.iter().flatten()) {
        let exact: f64 = (*exact).into();
        let difference = (*got).into() - exact;
        off += difference * difference;
        all += exact * exact;
        largest = largest.max(difference.abs());
    }
    ((off / f64::max(all, 1e-30)).sqrt(), largest)
}

/// Projects from evenly spread point samples: what they miss of a sun is lost.
pub fn project_samples(map: &EnvironmentMap, degree: usize, samples: usize) -> Vec<[f64; 3]> {
    let k = coefficient_count(degree);
    let mut sums = vec![[0f64; 3]; k];
    let mut y = vec![0f64; k];
    let weight = 4.0 * std::f64::consts::PI / samples.max(1) as f64;
    for d in fibonacci_sphere(samples) {
        evaluate_basis(d, degree, &mut y);
        let radiance = map.sample(DVec3::from_array(d).as_vec3());
        for (sum, y) in sums.iter_mut().zip(&y) {
            for (s, r) in sum.iter_mut().zip(radiance) {
                *s += weight * y * f64::from(r);
            }
        }
    }
    sums
}
