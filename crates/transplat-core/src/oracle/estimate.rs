//! Light estimate in f64: derivatives by differences, a pair at a time.

use std::f64::consts::PI;

use nalgebra::{DMatrix, DVector};

/// Means over clusters, and which of them are compared.
pub struct EstimateProblem<'a> {
    /// Mean radiance. `[c][3]`
    pub radiance: &'a [[f64; 3]],
    /// Irradiance by radiance 1 from around each direction. `[c][D]`
    pub seen: &'a [f32],
    /// Basis functions over the directions. `[D][K]`
    pub basis: &'a [Vec<f64>],
    /// Prior mean of each coefficient. `[K]`
    pub prior: &'a [f64],
    /// Prior precision of each coefficient about its mean. `[K]`
    pub precision: &'a [f64],
    /// Coupling of two channels. `[3][3]`
    pub coupling: [[f64; 3]; 3],
    /// Mean radiance of the light at strength 1, by channel.
    pub tint: [f64; 3],
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
    fn residual(&self, sky: &[Vec<f64>; 3], strength: Option<f64>) -> (Vec<[f64; 3]>, f64) {
        let (n, d) = (self.radiance.len(), self.basis.len());
        let mut direct = vec![[0.0; 3]; n];
        for c in 0..3 {
            let radiance: Vec<f64> = self
                .basis
                .iter()
                .map(|b| b.iter().zip(&sky[c]).map(|(b, y)| b * y).sum::<f64>().exp())
                .collect();
            let mean = radiance.iter().sum::<f64>() / d as f64 / self.tint[c];
            for i in 0..n {
                for j in 0..d {
                    direct[i][c] += f64::from(self.seen[i * d + j]) * radiance[j] / mean;
                }
            }
        }
        let strength = strength.unwrap_or_else(|| self.plausible_strength(&direct));
        let u = (0..n)
            .map(|i| {
                std::array::from_fn(|c| {
                    let e = strength * (direct[i][c] + self.epsilon * PI) + self.bounced[i][c];
                    e.ln() - self.radiance[i][c].ln()
                })
            })
            .collect();
        (u, strength)
    }

    /// Strength at which the whitest surface, smoothed by medians, has the albedo 0.72 (1 - 0.65 saturation).
    fn plausible_strength(&self, direct: &[[f64; 3]]) -> f64 {
        let n = direct.len();
        let sum = |v: &[f64; 3]| v[0] + v[1] + v[2];
        let lit = |i: usize, c: usize| direct[i][c] + PI * self.epsilon;
        let quantile = |mut of: Vec<(f64, f64)>, share: f64| {
            of.sort_by(|a, b| a.0.total_cmp(&b.0));
            let wanted = share * of.iter().map(|(_, m)| m).sum::<f64>();
            let mut below = 0.0;
            let at = of.iter().find(|(_, m)| {
                below += m;
                below >= wanted
            });
            at.expect("some").0
        };
        let asked = |white: f64| -> Vec<f64> {
            let own: Vec<f64> = (0..n)
                .map(|i| {
                    let left = PI * sum(&self.radiance[i]) / white - sum(&self.bounced[i]);
                    left / (lit(i, 0) + lit(i, 1) + lit(i, 2))
                })
                .collect();
            (0..n)
                .map(|i| {
                    let near = self.pairs.iter().filter(|([a, _], _)| *a == i);
                    let mut near: Vec<(f64, f64)> =
                        near.map(|([_, b], w)| (own[*b], sum(w))).collect();
                    let most = near.iter().map(|(_, w)| *w).fold(0.0, f64::max);
                    near.push((own[i], most));
                    if most > 0.0 {
                        quantile(near, 0.5)
                    } else {
                        own[i]
                    }
                })
                .collect()
        };
        let weighted = |values: &[f64]| -> Vec<(f64, f64)> {
            let each = values.iter().copied();
            each.zip(self.mass.iter().copied()).collect()
        };
        let first = asked(0.72);
        let (strength, tenth) = (
            quantile(weighted(&first), 0.95),
            quantile(weighted(&first), 0.9),
        );
        let saturation = (0..n)
            .filter(|i| first[*i] >= tenth)
            .map(|i| {
                let a: Vec<f64> = (0..3)
                    .map(|c| self.radiance[i][c] / (strength * lit(i, c) + self.bounced[i][c]))
                    .collect();
                let (low, high) = (a[0].min(a[1]).min(a[2]), a[0].max(a[1]).max(a[2]));
                (1.0 - low / high, self.mass[i])
            })
            .collect();
        let white = 0.72 * (1.0 - 0.65 * quantile(saturation, 0.5));
        quantile(weighted(&asked(white)), 0.95)
    }

    /// One turn of Gauss-Newton from a sky: by how much each coefficient is to change. `[3][K]`
    pub fn step(&self, sky: &[Vec<f64>; 3]) -> [Vec<f64>; 3] {
        const H: f64 = 1e-5;
        let k = self.precision.len();
        let (u, strength) = self.residual(sky, None);
        // How each cluster's residual changes with each coefficient of its channel. [c][3][K]
        let mut slope = vec![vec![vec![0.0; k]; 3]; u.len()];
        for q in 0..k {
            let moved = |by: f64| {
                let sky = sky.clone().map(|mut s| {
                    s[q] += by;
                    s
                });
                self.residual(&sky, Some(strength)).0
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
                    right[a * k + p] -= held * (sky[b][p] - self.prior[p]);
                }
            }
        }
        // By elimination: production takes its matrix for positive definite.
        let solved = matrix.lu().solve_mut(&mut right);
        assert!(solved, "the prior keeps it regular");
        std::array::from_fn(|c| right.as_slice()[c * k..(c + 1) * k].to_vec())
    }
}
