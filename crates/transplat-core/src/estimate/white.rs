//! Strength of the capture light by what is white.

use std::f64::consts::PI;

use super::clusters::{Clusters, Pair};
use crate::numeric::weighted_quantile;
use crate::transfer::materials::WHITEST;

/// Mean albedo of the whitest surface where that is grey, and how much of it the surface loses per unit of saturation: what is coloured
/// is darker. Fitted on seven shapes under one sky; under four other lights no other values are better.
const WHITE: f64 = 0.72;
const LOSS: f64 = 0.65;

/// Share of all that is darker than the surfaces whose colour counts.
const TENTH: f64 = 0.9;

/// Clusters that each cluster is compared with, and itself, by weight.
pub(super) struct Neighborhoods {
    of: Vec<Vec<(u32, f64)>>,
}

impl Neighborhoods {
    pub fn new(clusters: usize, pairs: &[Pair]) -> Self {
        let mut of: Vec<Vec<(u32, f64)>> = (0..clusters as u32).map(|i| vec![(i, 0.0)]).collect();
        for pair in pairs {
            let [a, b] = pair.of;
            let weight = pair.weight.iter().sum();
            let near = &mut of[a as usize];
            near[0].1 = near[0].1.max(weight);
            near.push((b, weight));
        }
        Self { of }
    }

    /// Median of a value around each cluster: noise does not raise its upper quantiles. `[c]`
    fn smoothed(&self, values: &[f64]) -> Vec<f64> {
        let each = self.of.iter().zip(values);
        each.map(|(near, own)| {
            let near = near.iter().map(|(i, w)| (values[*i as usize], *w));
            weighted_quantile(near.filter(|(_, w)| *w > 0.0).collect(), 0.5).unwrap_or(*own)
        })
        .collect()
    }

    /// Strength of a light with which the whitest surface is as white as its colour allows; `lit`: irradiance by the light at strength 1,
    /// `[c]`.
    pub fn plausible_strength(&self, clusters: &Clusters, lit: &[[f64; 3]]) -> Option<f64> {
        // Of the strengths that clusters ask for to be white, the whitest surfaces' are the largest.
        let quantile = |values: &[f64], share: f64| {
            let each = values.iter().copied().zip(clusters.mass.iter().copied());
            weighted_quantile(each.collect(), share)
        };
        let asked = |white: f64| self.smoothed(&strengths(clusters, lit, white));
        let each = asked(WHITE);
        let first = quantile(&each, f64::from(WHITEST))?;
        let least = quantile(&each, TENTH)?;
        let whitest = (0..clusters.len()).filter(|i| each[*i] >= least);
        let saturation = whitest.map(|i| {
            let albedo: [f64; 3] = std::array::from_fn(|c| {
                clusters.radiance[i][c] / (first * lit[i][c] + clusters.bounced[i][c])
            });
            let [least, most] = [f64::min, f64::max].map(|end| albedo.into_iter().reduce(end));
            let ratio = least.unwrap_or(0.0).max(0.0) / most.unwrap_or(0.0).max(1e-30);
            (1.0 - ratio, clusters.mass[i])
        });
        let saturation = weighted_quantile(saturation.collect(), 0.5)?;
        quantile(
            &asked(WHITE * (1.0 - LOSS * saturation)),
            f64::from(WHITEST),
        )
    }
}

/// Strength at which each cluster has a mean albedo. `[c]`
fn strengths(clusters: &Clusters, lit: &[[f64; 3]], albedo: f64) -> Vec<f64> {
    let sum = |v: &[f64; 3]| v.iter().sum::<f64>();
    let each = clusters.radiance.iter().zip(&clusters.bounced).zip(lit);
    each.map(|((b, g), lit)| (PI / albedo * sum(b) - sum(g)) / sum(lit))
        .collect()
}
