//! Strength and tint of the capture light by bounced light, averaged with what is white and with grey.

use super::fit::{Fit, FittedLight, LONGEST_STEP, Unit};
use super::white::WHITE_SD;
use crate::error::Result;
use crate::progress::{Progress, tell};

/// Strengths that are tried, over the one by what is white.
const TRIED: [f64; 7] = [0.45, 0.65, 0.85, 1.0, 1.2, 1.5, 2.1];

/// Turns of the fit at each.
const TURNS: usize = 3;

/// Standard deviation of the logarithm of the strength by bounced light at best; what it gains by the square of the noise over a
/// reference; and the share of two-sided surfaces, which pass light on, at which it counts for nothing any more.
const BOUNCE_SD: f64 = 0.1;
const NOISE_SD: f64 = 0.12;
const NOISE: f64 = 0.06;
const LEAVES: f64 = 1.0 / 3.0;

/// Standard deviation of the tint by bounced light at best, its reference noise, and that of light about grey.
const TINT_SD: f64 = 0.06;
const TINT_NOISE: f64 = 0.1;
const GREY_SD: f64 = 0.15;

/// Weight of bounced light from which the tint is asked for at all.
const LEAST_WEIGHT: f64 = 0.05;

/// Precision that holds what is not asked for.
const HELD: f64 = 1e5;

/// Most probable strength by white surfaces and bounced light; `near`: a fit that compares near clusters.
///
/// Light that bounces between surfaces has the pictures' unit, so hollows would be too bright or too dark under any other strength.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub(super) fn find(
    near: &mut Fit<'_>,
    light: &FittedLight,
    white: f64,
    progress: Progress<'_>,
) -> Result<f64> {
    near.strength = Some(white);
    let noise = near.noise(&near.explain(light));
    let mut costs = [0.0; TRIED.len()];
    for (i, factor) in TRIED.into_iter().enumerate() {
        tell(progress, i as f64 / TRIED.len() as f64)?;
        near.strength = Some(factor * white);
        let mut light = light.clone();
        for _ in 0..TURNS {
            if let Some(solved) = near.solve(&light, &near.explain(&light), noise) {
                light.change(&solved.step, LONGEST_STEP);
            }
        }
        costs[i] = near.cost(&light, &near.explain(&light), noise);
    }
    let (bounce, variance) = least(&costs);
    let variance = uncertainty(near, noise, BOUNCE_SD, NOISE) + variance / opaque(near).powi(2);
    let [of_white, of_bounce] = [1.0 / WHITE_SD.powi(2), 1.0 / variance];
    let log = bounce * of_bounce / (of_white + of_bounce);
    Ok(if log.is_finite() {
        white * log.exp()
    } else {
        white
    })
}

/// Most probable tint of a light of known strength: factors of its mean radiance, whose product is 1.
///
/// Bounced light has the pictures' unit in each channel. So hollows would be too blue under a light that is taken for too yellow.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub(super) fn tint(
    fit: &mut Fit<'_>,
    light: &FittedLight,
    progress: Progress<'_>,
) -> Result<[f64; 3]> {
    let explained = fit.explain(light);
    let variance = uncertainty(fit, fit.noise(&explained), TINT_SD, TINT_NOISE);
    let of_grey = GREY_SD.powi(2);
    let weight = of_grey / (of_grey + variance);
    if weight < LEAST_WEIGHT {
        return Ok([1.0; 3]);
    }
    let before = (fit.unit, fit.precision[0]);
    fit.unit = Unit::Known(explained.mean_radiance);
    fit.precision[0] = [HELD, 1.0 / of_grey];
    let found = fit.run(light.clone(), progress);
    (fit.unit, fit.precision[0]) = before;
    let log = found?.means().map(f64::ln);
    let middle = log.iter().sum::<f64>() / 3.0;
    Ok(log.map(|l| (weight * (l - middle)).exp()))
}

/// Variance of what bounced light says, by the noise of the clusters and the share of them that pass light on.
fn uncertainty(fit: &Fit<'_>, noise: f64, least: f64, reference: f64) -> f64 {
    let of_noise = NOISE_SD * noise / (reference * reference);
    (least.powi(2) + of_noise.powi(2)) / opaque(fit).powi(2)
}

/// Share of the evidence of bounced light that counts beside surfels that pass light on, 0 to 1.
fn opaque(fit: &Fit<'_>) -> f64 {
    (1.0 - fit.clusters.two_sided / LEAVES).max(1e-3)
}

/// Logarithm of the factor of least cost, by a parabola through the least three, and its variance.
fn least(costs: &[f64; TRIED.len()]) -> (f64, f64) {
    let x = TRIED.map(f64::ln);
    let by_cost = |a: &usize, b: &usize| costs[*a].total_cmp(&costs[*b]);
    let lowest = (0..x.len()).min_by(by_cost).unwrap_or(0);
    let i = lowest.clamp(1, x.len() - 2);
    let slope = |i: usize| (costs[i + 1] - costs[i]) / (x[i + 1] - x[i]);
    let curvature = 2.0 * (slope(i) - slope(i - 1)) / (x[i + 1] - x[i - 1]);
    if curvature > 0.0 {
        let at = 0.5 * (x[i - 1] + x[i]) - slope(i - 1) / curvature;
        (at.clamp(x[0], x[x.len() - 1]), 1.0 / curvature)
    } else {
        (0.0, f64::INFINITY)
    }
}
