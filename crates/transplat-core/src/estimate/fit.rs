//! The light that explains the clusters best: Gauss-Newton with reweighting, the logarithm of the light as an SH series.

use std::f64::consts::PI;

use glam::Vec3;
use nalgebra::{Cholesky, DMatrix, DMatrixView, DVector, Dyn};
use rayon::prelude::*;

use super::clusters::{Clusters, Pair};
use super::expected::ExpectedLight;
use super::sky::{SKY, nearest_direction, sky_basis};
use super::white::{WHITE_SD, White, whitest};
use crate::bake::strata::{DIRECTIONS, directions};
use crate::capture_environment::MOST_LOG;
use crate::error::Result;
use crate::numeric::weighted_quantile;
use crate::progress::{Progress, tell};
use crate::settings::Method;
use crate::sh::band_of;

/// Turns at most, and the change of the logarithm of the irradiance (root of the mean square) that ends them: a twentieth of [`LEAST_NOISE`].
const TURNS: usize = 16;
const SMALL_CHANGE: f64 = 1e-3;

/// Longest step of one turn, in logarithms of light.
pub(super) const LONGEST_STEP: f64 = 1.5;

/// Weight of the prior that channels are alike over the prior that the light is even.
const COUPLING: f64 = 3.0;

/// Noise at least, in logarithms.
const LEAST_NOISE: f64 = 0.02;

/// Variance of a normal distribution over the median of a mean of three squares.
const VARIANCE_OF_MEDIAN: f64 = 1.27;

/// Radiance at least, relative to what is bright, where its logarithm is taken.
const LEAST_RADIANCE: f64 = 1e-4;

/// Precision of the constant coefficient: by how much all that is uncertain may differ from what is shown.
const CONSTANT_PRECISION: f64 = 0.5;

/// Strength at least, relative to what is bright: where blocking surfels are so bright that they explain everything, some direct light is left.
const LEAST_STRENGTH: f64 = 1e-3;

/// A sun's energy is held by hardly more than the object.
const SUN_PRECISION: f64 = 1e-3;

/// A sun with how the clusters see it.
#[derive(Clone)]
pub(super) struct FittedSun {
    pub direction: Vec3,
    /// Irradiance of a cluster by a sun of energy 1. `[c]`
    pub seen: Vec<f64>,
    pub log_energy: [f64; 3],
}

/// A light under way: the logarithm of the sky's radiance, and a sun.
#[derive(Clone)]
pub(super) struct FittedLight {
    /// Coefficients of [`sky_basis`]. `[3][SKY]`
    pub sky: [Vec<f64>; 3],
    pub sun: Option<FittedSun>,
}

impl FittedLight {
    pub fn even() -> Self {
        Self {
            sky: std::array::from_fn(|_| vec![0.0; SKY]),
            sun: None,
        }
    }

    /// Adds a step of all unknowns `[3][P]`, shortened where it is longer than `longest`.
    pub fn change(&mut self, step: &DVector<f64>, longest: f64) {
        let p = self.unknowns();
        let shorter = (longest / step.amax()).min(1.0);
        for c in 0..3 {
            let of_sun = self.sun.as_mut().map(|s| &mut s.log_energy[c]);
            let values = self.sky[c].iter_mut().chain(of_sun);
            for (value, step) in values.zip(&step.as_slice()[c * p..]) {
                *value += shorter * step;
            }
        }
    }

    /// Unknowns of a channel.
    fn unknowns(&self) -> usize {
        SKY + usize::from(self.sun.is_some())
    }

    pub fn sun_energy(&self, channel: usize) -> f64 {
        let log = self.sun.as_ref().map(|s| s.log_energy[channel]);
        let most = f64::from(MOST_LOG);
        log.map_or(0.0, |log| log.clamp(-most, most).exp())
    }
}

/// Irradiance of the clusters by a sky, in the unit of the expected light.
#[derive(Clone)]
pub(super) struct SkyIrradiance {
    /// Radiance over the bake's directions, and its change with the fitted logarithm. `[3][DIRECTIONS]`
    radiance: [Vec<[f64; 2]>; 3],
    /// `[c][3]`
    direct: Vec<[f64; 3]>,
}

/// Explanation of the clusters by a light.
pub(super) struct Explained {
    /// Sky radiance over the bake's directions, relative to the light's mean, and its change with the fitted logarithm. `[3][DIRECTIONS]`
    radiance: [Vec<[f64; 2]>; 3],
    /// Irradiance by the light at strength 1. `[c]`
    direct: Vec<[f64; 3]>,
    /// Divisor of the light's radiance that makes its strength 1 in each channel: as [`Unit`] has it.
    pub mean_radiance: [f64; 3],
    /// Strength of the light, in the unit of the pictures: given, or such that the whitest albedo is plausible.
    pub strength: f64,
    /// Logarithm of the irradiance, bounced light included. `[c]`
    pub log_irradiance: Vec<[f64; 3]>,
    /// Residual less that of the radiance: minus the logarithm of the albedo.
    residual: Vec<[f64; 3]>,
}

/// Divisor of a light's radiance at strength 1, by channel.
#[derive(Clone, Copy)]
pub(super) enum Unit {
    /// Mean of the light over its tint, which is all that is known of its colour. The strength says the rest.
    Mean([f64; 3]),
    /// Divisor that is known.
    Known([f64; 3]),
}

/// Finds the light of the highest probability.
pub(super) struct Fit<'a> {
    pub clusters: &'a Clusters,
    pairs: Vec<Pair>,
    /// Mean radiance of the light, where that is known.
    pub strength: Option<f64>,
    /// [`sky_basis`] over the bake's directions. `[SKY][DIRECTIONS]`
    basis: DMatrix<f32>,
    /// Light that is expected, the mean of the prior.
    pub expected: &'a ExpectedLight,
    pub unit: Unit,
    /// Precision of each coefficient's prior, for the sum of the channels and for what they differ by. `[SKY]`
    pub precision: Vec<[f64; 2]>,
    /// Light from everywhere, as a share of the mean, that no surfel is without: as in the transfer.
    epsilon: f64,
}

/// One turn's linear problem, solved.
pub(super) struct Solved {
    /// By how much each unknown of each channel is to change. `[3][P]`
    pub step: DVector<f64>,
    factor: Cholesky<f64, Dyn>,
    /// Jacobian of the logarithm of the irradiance, by channel. `[P][c]`
    jacobian: Vec<DMatrix<f64>>,
}

impl Solved {
    /// Root of the mean square, over clusters of some mass, by which the logarithm of the irradiance changes with the step.
    fn irradiance_change(&self, mass: &[f64]) -> f64 {
        let each = self.jacobian.iter().enumerate().map(|(c, jacobian)| {
            let p = jacobian.nrows();
            let change = jacobian.tr_mul(&self.step.rows(c * p, p));
            let each = change.iter().zip(mass);
            each.map(|(v, m)| m * v * v).sum::<f64>()
        });
        (each.sum::<f64>() / 3.0).sqrt()
    }
}

/// Where a fit ended.
pub(super) struct Fitted {
    pub light: FittedLight,
    pub explained: Explained,
    /// Variance of the differences that no light explains.
    pub noise: f64,
    /// Mean variance of the logarithm of the irradiance that is left open.
    pub open: f64,
}

impl Fitted {
    /// Mean radiance by channel, over the fit's unit.
    pub fn means(&self) -> [f64; 3] {
        [0, 1, 2].map(|c| {
            let sky = self.explained.radiance[c].iter().map(|r| r[0]).sum::<f64>();
            let sky = sky / DIRECTIONS as f64;
            sky + self.light.sun_energy(c) / (4.0 * PI * self.explained.mean_radiance[c])
        })
    }
}

impl<'a> Fit<'a> {
    /// A fit to clusters, each compared with so many nearest ones, of a light like the expected one.
    pub fn new(clusters: &'a Clusters, neighbors: usize, expected: &'a ExpectedLight) -> Self {
        let pairs = clusters.pairs(neighbors);
        let columns: Vec<Vec<f64>> = directions().iter().map(|d| sky_basis(*d)).collect();
        let basis = |k: usize, j: usize| columns[j][k] as f32;
        Self {
            strength: expected.has_unit.then_some(1.0),
            clusters,
            pairs,
            expected,
            basis: DMatrix::from_fn(SKY, DIRECTIONS, basis),
            unit: match expected.is_shown {
                true => Unit::Known([1.0; 3]),
                false => Unit::Mean([1.0; 3]),
            },
            precision: (0..SKY).map(precision).collect(),
            epsilon: f64::from(Method::Directional.epsilon()),
        }
    }

    /// True where no two clusters can be compared.
    pub fn has_no_pairs(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Radiance of a light's sky towards a direction, in any unit.
    pub fn sky_radiance(&self, light: &FittedLight, d: Vec3) -> [f64; 3] {
        let j = match self.expected.is_shown {
            true => nearest_direction(&directions(), d),
            // The same in all directions.
            false => 0,
        };
        let basis = sky_basis(d);
        [0, 1, 2].map(|c| {
            let log: f64 = light.sky[c].iter().zip(&basis).map(|(y, b)| y * b).sum();
            self.expected.radiance(c, j, log)[0]
        })
    }

    pub fn explain(&self, light: &FittedLight) -> Explained {
        self.explain_with(self.sky_irradiance(&light.sky), light)
    }

    /// Irradiance by a sky alone.
    pub fn sky_irradiance(&self, sky: &[Vec<f64>; 3]) -> SkyIrradiance {
        let clusters = self.clusters;
        let radiance: [Vec<[f64; 2]>; 3] = std::array::from_fn(|c| {
            let towards = |j: usize| {
                let basis = self.basis.column(j);
                let each = sky[c].iter().zip(basis.iter());
                let log: f64 = each.map(|(y, b)| y * f64::from(*b)).sum();
                self.expected.radiance(c, j, log)
            };
            (0..DIRECTIONS).map(towards).collect()
        });
        let rows = clusters.seen.par_chunks_exact(DIRECTIONS);
        let direct = rows.map(|row| {
            std::array::from_fn(|c| {
                let each = row.iter().zip(&radiance[c]);
                each.map(|(s, r)| f64::from(*s) * r[0]).sum()
            })
        });
        SkyIrradiance {
            direct: direct.collect(),
            radiance,
        }
    }

    /// Explanation by a light of known irradiance by its sky.
    pub fn explain_with(&self, sky: SkyIrradiance, light: &FittedLight) -> Explained {
        let clusters = self.clusters;
        let SkyIrradiance {
            mut radiance,
            mut direct,
        } = sky;
        let energy = [0, 1, 2].map(|c| light.sun_energy(c));
        let mean_radiance: [f64; 3] = std::array::from_fn(|c| match self.unit {
            Unit::Mean(tint) => {
                let sky: f64 = radiance[c].iter().map(|r| r[0]).sum();
                (sky / DIRECTIONS as f64 + energy[c] / (4.0 * PI)) / tint[c]
            }
            Unit::Known(unit) => unit[c],
        });
        for (sky, mean) in radiance.iter_mut().zip(mean_radiance) {
            for r in sky.iter_mut().flatten() {
                *r /= mean;
            }
        }
        for (i, direct) in direct.iter_mut().enumerate() {
            let seen = light.sun.as_ref().map_or(0.0, |s| s.seen[i]);
            for c in 0..3 {
                direct[c] = (direct[c] + seen * energy[c]) / mean_radiance[c];
            }
        }
        let strength = self
            .strength
            .unwrap_or_else(|| self.plausible_strength(&direct));
        let least = LEAST_RADIANCE * clusters.bright();
        let log_irradiance: Vec<[f64; 3]> = direct
            .iter()
            .zip(&clusters.bounced)
            .map(|(d, b)| {
                std::array::from_fn(|c| (strength * (d[c] + self.epsilon * PI) + b[c]).ln())
            })
            .collect();
        let residual = log_irradiance
            .iter()
            .zip(&clusters.radiance)
            .map(|(e, b)| std::array::from_fn(|c| e[c] - b[c].max(least).ln()))
            .collect();
        Explained {
            radiance,
            direct,
            mean_radiance,
            strength,
            log_irradiance,
            residual,
        }
    }

    /// Strength of a light by the whitest surfaces, from their irradiance by it; none where blocking surfels explain them.
    fn white(&self, direct: &[[f64; 3]]) -> Option<White> {
        let lit = direct.iter().map(|d| d.map(|v| v + self.epsilon * PI));
        let lit: Vec<[f64; 3]> = lit.collect();
        let least = LEAST_STRENGTH * self.clusters.bright();
        whitest(self.clusters, &self.pairs, &lit).filter(|w| w.strength > least)
    }

    /// [`Self::white`] where a light is shown in the unit of the photographs: it is an observation there.
    fn white_of_shown(&self, explained: &Explained) -> Option<White> {
        let shown = self.expected.has_unit.then_some(&explained.direct);
        shown.and_then(|direct| self.white(direct))
    }

    /// The strength with which the whitest albedo is plausible.
    fn plausible_strength(&self, direct: &[[f64; 3]]) -> f64 {
        let least = LEAST_STRENGTH * self.clusters.bright();
        self.white(direct).map_or(least, |w| w.strength)
    }

    /// Logarithm by which a shown light is too weak for the whitest surfaces, and its change with each unknown. `[3 P]`
    fn white_residual(
        &self,
        explained: &Explained,
        jacobian: &[DMatrix<f64>],
    ) -> Option<(f64, DVector<f64>)> {
        let white = self.white_of_shown(explained)?;
        let p = jacobian[0].nrows();
        let mut change = DVector::zeros(3 * p);
        let mass: f64 = white.clusters.iter().map(|i| self.clusters.mass[*i]).sum();
        for i in white.clusters {
            let lit: f64 = explained.direct[i]
                .iter()
                .map(|d| d + self.epsilon * PI)
                .sum();
            for (c, jacobian) in jacobian.iter().enumerate() {
                let share =
                    explained.log_irradiance[i][c].exp() / lit.max(1e-12) / explained.strength;
                let weight = -self.clusters.mass[i] / mass * share;
                change
                    .rows_mut(c * p, p)
                    .axpy(weight, &jacobian.column(i), 1.0);
            }
        }
        Some((white.strength.ln(), change))
    }

    /// Moves a shown light half of the rest of the way: its strength to that of the whitest surfaces, its tint to grey.
    pub fn balance_strength_and_tint(&mut self, fitted: &mut Fitted) {
        let white = self.plausible_strength(&fitted.explained.direct);
        let means = fitted.means();
        let grey = means.iter().sum::<f64>() / 3.0;
        self.unit = Unit::Known(means.map(|mean| (mean / grey).sqrt()));
        self.strength = Some(white.sqrt());
        fitted.explained = self.explain(&fitted.light);
    }

    /// Squared difference of each pair, the mean of its channels, with what the pair counts.
    fn differences(&self, explained: &Explained) -> Vec<(f64, f64)> {
        let r = &explained.residual;
        self.pairs
            .iter()
            .map(|pair| {
                let [a, b] = pair.of.map(|k| r[k as usize]);
                let total: f64 = pair.weight.iter().sum();
                let sum: f64 = (0..3).map(|c| pair.weight[c] * (a[c] - b[c]).powi(2)).sum();
                (if total > 0.0 { sum / total } else { 0.0 }, total / 3.0)
            })
            .collect()
    }

    /// Variance of the pairs' differences, by their median: edges between materials do not count.
    pub fn misfit(&self, explained: &Explained) -> f64 {
        let median = weighted_quantile(self.differences(explained), 0.5);
        median.map_or(0.0, |d| VARIANCE_OF_MEDIAN * d)
    }

    /// [`Self::misfit`], which is at least what no capture is free of.
    pub fn noise(&self, explained: &Explained) -> f64 {
        self.misfit(explained).max(LEAST_NOISE * LEAST_NOISE)
    }

    /// Minus the logarithm of a light's probability, but for a constant.
    pub fn cost(&self, light: &FittedLight, explained: &Explained, noise: f64) -> f64 {
        let pairs = self.differences(explained);
        let misfit: f64 = pairs
            .iter()
            .map(|(d, w)| 1.5 * w * (d / noise).ln_1p())
            .sum();
        let mut prior = 0.0;
        for a in 0..3 {
            for b in 0..3 {
                for k in 0..SKY {
                    prior += 0.5
                        * held(self.precision[k], a, b)
                        * (light.sky[a][k] - self.expected.coefficients[k])
                        * (light.sky[b][k] - self.expected.coefficients[k]);
                }
            }
        }
        let white = self.white_of_shown(explained);
        let too_weak = white.map_or(0.0, |w| w.strength.ln() / WHITE_SD);
        misfit + prior + 0.5 * too_weak * too_weak
    }

    /// Goes on from a light until the irradiance hardly changes any more.
    pub fn run(&self, mut light: FittedLight, progress: Progress<'_>) -> Result<Fitted> {
        let mut turn = 0;
        let mut longest = LONGEST_STEP;
        let mut last_change = f64::INFINITY;
        loop {
            tell(progress, turn as f64 / TURNS as f64)?;
            let explained = self.explain(&light);
            let noise = self.noise(&explained);
            let solved = self.solve(&light, &explained, noise);
            let change = solved
                .as_ref()
                .map_or(0.0, |s| s.irradiance_change(&self.clusters.mass));
            let Some(Solved { step, .. }) = solved
                .as_ref()
                .filter(|_| turn < TURNS && change > SMALL_CHANGE)
            else {
                // Only numbers that are none have no solution: what was found so far is kept.
                let open = solved.map_or(f64::INFINITY, |s| self.open(&s));
                return Ok(Fitted {
                    light,
                    explained,
                    noise,
                    open,
                });
            };
            if change > last_change {
                // It jumps to and fro across the minimum.
                longest = 0.5 * step.amax().min(longest);
            }
            light.change(step, longest);
            last_change = change;
            turn += 1;
        }
    }

    /// One turn of Gauss-Newton, at a noise and the strength that the light has now.
    pub fn solve(&self, light: &FittedLight, explained: &Explained, noise: f64) -> Option<Solved> {
        let jacobian: Vec<DMatrix<f64>> = (0..3)
            .into_par_iter()
            .map(|c| self.jacobian(light, explained, c))
            .collect();
        let (mut matrix, mut gradient) = self.normal_equations(light, explained, &jacobian, noise);
        if let Some((log, change)) = self.white_residual(explained, &jacobian) {
            let precision = 1.0 / (WHITE_SD * WHITE_SD);
            matrix.ger(precision, &change, &change, 1.0);
            gradient.axpy(precision * log, &change, 1.0);
        }
        let factor = Cholesky::new(matrix)?;
        Some(Solved {
            step: -factor.solve(&gradient),
            factor,
            jacobian,
        })
    }

    /// Change of the logarithm of the irradiance with each unknown of a channel. `[P][c]`
    fn jacobian(&self, light: &FittedLight, explained: &Explained, c: usize) -> DMatrix<f64> {
        let clusters = self.clusters;
        let (n, p) = (clusters.len(), light.unknowns());
        let sky = &explained.radiance[c];
        let lit = DMatrix::from_fn(SKY, DIRECTIONS, |k, j| {
            self.basis[(k, j)] * sky[j][1] as f32
        });
        let mean_factor = match self.unit {
            Unit::Mean(tint) => 1.0 / tint[c],
            Unit::Known(_) => 0.0,
        };
        let of_mean: Vec<f64> = (0..SKY)
            .map(|k| {
                mean_factor * lit.row(k).iter().map(|v| f64::from(*v)).sum::<f64>()
                    / DIRECTIONS as f64
            })
            .collect();
        let seen = DMatrixView::from_slice(&clusters.seen, DIRECTIONS, n);
        let of_sky = lit * seen;
        let energy = light.sun_energy(c) / explained.mean_radiance[c];
        let mut jacobian = DMatrix::zeros(p, n);
        for (i, mut column) in jacobian.column_iter_mut().enumerate() {
            let direct = explained.direct[i][c];
            for (k, v) in column.iter_mut().enumerate() {
                *v = match &light.sun {
                    Some(sun) if k == SKY => {
                        sun.seen[i] * energy - mean_factor * direct * energy / (4.0 * PI)
                    }
                    _ => f64::from(of_sky[(k, i)]) - direct * of_mean[k],
                };
            }
            column *= explained.strength / explained.log_irradiance[i][c].exp();
        }
        jacobian
    }

    /// Matrix and right side of a turn's linear problem, of all channels' unknowns.
    fn normal_equations(
        &self,
        light: &FittedLight,
        explained: &Explained,
        jacobian: &[DMatrix<f64>],
        noise: f64,
    ) -> (DMatrix<f64>, DVector<f64>) {
        let p = light.unknowns();
        let differences = self.differences(explained);
        let blocks: Vec<(DMatrix<f64>, DVector<f64>)> = (0..3)
            .into_par_iter()
            .map(|c| {
                let j = &jacobian[c];
                let columns = j.as_slice();
                let mut weighed = vec![0.0; columns.len()];
                let mut residual = DVector::zeros(j.ncols());
                for (pair, (d, _)) in self.pairs.iter().zip(&differences) {
                    let w = pair.weight[c] / (noise + d);
                    let [a, b] = pair.of.map(|k| k as usize);
                    let r = w * (explained.residual[a][c] - explained.residual[b][c]);
                    residual[a] += r;
                    residual[b] -= r;
                    for (a, b) in (a * p..(a + 1) * p).zip(b * p..) {
                        let change = w * (columns[a] - columns[b]);
                        weighed[a] += change;
                        weighed[b] -= change;
                    }
                }
                let weighed = DMatrixView::from_slice(&weighed, p, j.ncols());
                (j * weighed.transpose(), j * residual)
            })
            .collect();
        let mut matrix = DMatrix::zeros(3 * p, 3 * p);
        let mut gradient = DVector::zeros(3 * p);
        for (a, (block, right)) in blocks.iter().enumerate() {
            matrix.view_mut((a * p, a * p), (p, p)).copy_from(block);
            gradient.rows_mut(a * p, p).copy_from(right);
        }
        for k in 0..p {
            for a in 0..3 {
                for b in 0..3 {
                    let held = match self.precision.get(k) {
                        Some(precision) => held(*precision, a, b),
                        None if a == b => SUN_PRECISION,
                        None => 0.0,
                    };
                    matrix[(a * p + k, b * p + k)] += held;
                    if k < SKY {
                        gradient[a * p + k] +=
                            held * (light.sky[b][k] - self.expected.coefficients[k]);
                    }
                }
            }
        }
        (matrix, gradient)
    }

    /// Mean variance of the logarithm of the irradiance, about its mean, that the object leaves open.
    fn open(&self, solved: &Solved) -> f64 {
        let covariance = solved.factor.inverse();
        let mass = &self.clusters.mass;
        let sums = solved.jacobian.iter().enumerate().map(|(c, j)| {
            let p = j.nrows();
            let mut centred = j.clone();
            let mean: DVector<f64> = j * DVector::from_column_slice(mass);
            for (mut column, m) in centred.column_iter_mut().zip(mass) {
                column -= &mean;
                column *= m.sqrt();
            }
            let block = covariance.view((c * p, c * p), (p, p));
            (block * &centred).component_mul(&centred).sum()
        });
        sums.sum::<f64>() / 3.0
    }
}

/// Precision of the prior of coefficient `k`, for the sum of the channels and for what they differ by: fine detail is less probable than
/// that the light is even, and colour less probable than both.
pub(super) fn precision(k: usize) -> [f64; 2] {
    let band = band_of(k) as f64;
    let of_sum = match k {
        0 => CONSTANT_PRECISION,
        _ => band * (band + 1.0),
    };
    [of_sum, COUPLING * of_sum]
}

/// Two channels' entry of a prior's precision.
pub(super) fn held([of_sum, of_difference]: [f64; 2], a: usize, b: usize) -> f64 {
    let of_both = (of_sum - of_difference) / 3.0;
    of_both + if a == b { of_difference } else { 0.0 }
}
