//! Light estimate in f64: derivatives by differences, a pair at a time.

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector};

use crate::transfer::materials::{WHITEST, WHITEST_ALBEDO};

/// Means over clusters, and which of them are compared.
pub struct EstimateProblem<'a> {
    /// Mean radiance. `[c][3]`
    pub radiance: &'a [[f64; 3]],
    /// Irradiance by radiance 1 from around each direction. `[c][D]`
    pub seen: &'a [f32],
    /// Basis functions over the directions. `[D][K]`
    pub basis: &'a [Vec<f64>],
    /// Prior precision of each coefficient about 0. `[K]`
    pub precision: &'a [f64],
    /// Coupling of two channels. `[3][3]`
    pub coupling: [[f64; 3]; 3],
    /// Irradiance from surfels. `[c][3]`
    pub bounced: &'a [[f64; 3]],
    /// Shares of all, that sum to 1. `[c]`
    pub mass: &'a [f64],
    /// Two clusters, and how much each channel counts.
    pub pairs: &'a [([usize; 2], [f64; 3])],
    /// Light from everywhere, as a share of the mean.
    pub epsilon: f64,
    /// Variance of the pairs' differences.
    pub noise: f64,
}

impl EstimateProblem<'_> {
    /// Minus the logarithm of each cluster's albedo. `[c][3]`
    fn residual(&self, sky: &[Vec<f64>; 3], exposure: Option<f64>) -> (Vec<[f64; 3]>, f64) {
        let (n, d) = (self.radiance.len(), self.basis.len());
        let mut direct = vec![[0.0; 3]; n];
        for c in 0..3 {
            let radiance: Vec<f64> = self
                .basis
                .iter()
                .map(|b| b.iter().zip(&sky[c]).map(|(b, y)| b * y).sum::<f64>().exp())
                .collect();
            let mean = radiance.iter().sum::<f64>() / d as f64;
            for i in 0..n {
                for j in 0..d {
                    direct[i][c] += f64::from(self.seen[i * d + j]) * radiance[j] / mean;
                }
            }
        }
        let sum = |v: &[f64; 3]| v[0] + v[1] + v[2];
        let exposure = exposure.unwrap_or_else(|| {
            let mut asked: Vec<(f64, f64)> = (0..n)
                .map(|i| {
                    let left = PI * sum(&self.radiance[i]) / WHITEST_ALBEDO - sum(&self.bounced[i]);
                    (
                        left / (sum(&direct[i]) + 3.0 * PI * self.epsilon),
                        self.mass[i],
                    )
                })
                .collect();
            asked.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut below = 0.0;
            for (strength, mass) in asked {
                below += mass;
                if below >= f64::from(WHITEST) {
                    return strength;
                }
            }
            1.0
        });
        let u = (0..n)
            .map(|i| {
                std::array::from_fn(|c| {
                    let e = exposure * (direct[i][c] + self.epsilon * PI) + self.bounced[i][c];
                    e.ln() - self.radiance[i][c].ln()
                })
            })
            .collect();
        (u, exposure)
    }

    /// One turn of Gauss-Newton from a sky: by how much each coefficient is to change. `[3][K]`
    pub fn step(&self, sky: &[Vec<f64>; 3]) -> [Vec<f64>; 3] {
        const H: f64 = 1e-5;
        let k = self.precision.len();
        let (u, exposure) = self.residual(sky, None);
        // How each cluster's residual changes with each coefficient of its channel. [c][3][K]
        let mut slope = vec![vec![vec![0.0; k]; 3]; u.len()];
        for q in 0..k {
            let moved = |by: f64| {
                let sky = sky.clone().map(|mut s| {
                    s[q] += by;
                    s
                });
                self.residual(&sky, Some(exposure)).0
            };
            let (less, more) = (moved(-H), moved(H));
            for i in 0..u.len() {
                for c in 0..3 {
                    slope[i][c][q] = (more[i][c] - less[i][c]) / (2.0 * H);
                }
            }
        }
        let size = 3 * k;
        let mut matrix = DMatrix::<f64>::zeros(size, size);
        let mut right = DVector::<f64>::zeros(size);
        for ([a, b], weight) in self.pairs {
            let all: f64 = weight.iter().sum();
            let apart: f64 = (0..3)
                .map(|c| weight[c] / all * (u[*a][c] - u[*b][c]).powi(2))
                .sum();
            for c in 0..3 {
                let w = weight[c] / (self.noise + apart);
                for p in 0..k {
                    let row = slope[*a][c][p] - slope[*b][c][p];
                    right[c * k + p] -= w * row * (u[*a][c] - u[*b][c]);
                    for q in 0..k {
                        let column = slope[*a][c][q] - slope[*b][c][q];
                        matrix[(c * k + p, c * k + q)] += w * row * column;
                    }
                }
            }
        }
        for p in 0..k {
            for a in 0..3 {
                for b in 0..3 {
                    let held = self.precision[p] * self.coupling[a][b];
                    matrix[(a * k + p, b * k + p)] += held;
                    right[a * k + p] -= held * sky[b][p];
                }
            }
        }
        // By elimination: production takes its matrix for positive definite.
        let solved = matrix.lu().solve_mut(&mut right);
        assert!(solved, "the prior keeps it regular");
        std::array::from_fn(|c| right.as_slice()[c * k..(c + 1) * k].to_vec())
    }
}
