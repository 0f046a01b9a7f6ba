//! Strength of the capture light by what is white.

use std::f64::consts::PI;

use super::clusters::{Clusters, Pair};
use crate::numeric::weighted_quantile;
use crate::transfer::materials::WHITEST;

/// Mean albedo of the whitest surface where that is grey, and how much of it the surface loses per unit of saturation: what is coloured
/// is darker.
const WHITE: f64 = 0.72;
const LOSS: f64 = 0.65;

/// Standard deviation of the logarithm of the strength by what is white.
pub(super) const WHITE_SD: f64 = 0.18;

/// Share of all that is darker than the surfaces whose colour counts.
const TENTH: f64 = 0.9;

/// Strength of a light by white surfaces.
pub(super) struct White {
    /// Strength with which the whitest surface is as white as its colour allows.
    pub strength: f64,
    /// Clusters that are among the whitest.
    pub clusters: Vec<usize>,
}

/// Asks the whitest surfaces; `lit`: irradiance by the light at strength 1, `[c]`; `pairs`: each cluster's in a run.
pub(super) fn whitest(clusters: &Clusters, pairs: &[Pair], lit: &[[f64; 3]]) -> Option<White> {
    // Of the strengths that clusters ask for to be white, the whitest surfaces' are the largest.
    let quantile = |values: &[f64], share: f64| {
        let each = values.iter().copied().zip(clusters.mass.iter().copied());
        weighted_quantile(each.collect(), share)
    };
    let asked = |white: f64| smoothed(strengths(clusters, lit, white), pairs);
    let each = asked(WHITE);
    let first = quantile(&each, f64::from(WHITEST))?;
    let least = quantile(&each, TENTH)?;
    let whitest: Vec<usize> = (0..clusters.len()).filter(|i| each[*i] >= least).collect();
    let saturation = whitest.iter().map(|i| {
        let i = *i;
        let albedo: [f64; 3] = std::array::from_fn(|c| {
            clusters.radiance[i][c] / (first * lit[i][c] + clusters.bounced[i][c])
        });
        let [least, most] = [f64::min, f64::max].map(|end| albedo.into_iter().reduce(end));
        let ratio = least.unwrap_or(0.0).max(0.0) / most.unwrap_or(0.0).max(1e-30);
        (1.0 - ratio, clusters.mass[i])
    });
    let saturation = weighted_quantile(saturation.collect(), 0.5)?;
    let white = WHITE * (1.0 - LOSS * saturation);
    Some(White {
        strength: quantile(&asked(white), f64::from(WHITEST))?,
        clusters: whitest,
    })
}

/// Strength at which each cluster has a mean albedo. `[c]`
fn strengths(clusters: &Clusters, lit: &[[f64; 3]], albedo: f64) -> Vec<f64> {
    let sum = |v: &[f64; 3]| v.iter().sum::<f64>();
    let each = clusters.radiance.iter().zip(&clusters.bounced).zip(lit);
    each.map(|((b, g), lit)| (PI / albedo * sum(b) - sum(g)) / sum(lit))
        .collect()
}

/// Median of a value over each cluster and those it is compared with: noise does not raise its upper quantiles. `[c]`
fn smoothed(values: Vec<f64>, pairs: &[Pair]) -> Vec<f64> {
    let mut medians = values.clone();
    for near in pairs.chunk_by(|p, q| p.of[0] == q.of[0]) {
        let [own, _] = near[0].of.map(|k| k as usize);
        let weight = |p: &Pair| p.weight.iter().sum::<f64>();
        let most = near.iter().map(weight).fold(0.0, f64::max);
        let others = near.iter().map(|p| (values[p.of[1] as usize], weight(p)));
        let all = [(values[own], most)].into_iter().chain(others);
        let median = weighted_quantile(all.filter(|(_, w)| *w > 0.0).collect(), 0.5);
        medians[own] = median.unwrap_or(values[own]);
    }
    medians
}
