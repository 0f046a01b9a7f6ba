//! Rotation of a known light about the up axis at which it explains a capture best.
//!
//! A panorama of the place where an object was captured rarely says how the object lies in it. The object does: under the light as it was,
//! what neighbours differ by is their irradiance ([`super::fit`]), and under a wrong rotation it is not.

use glam::DMat3;

use super::clusters::{Clusters, FEWEST_CLUSTERS, NEIGHBORS};
use super::expected::ExpectedLight;
use super::fit::{Fit, FittedLight};
use crate::bake::directional::DirectionalBake;
use crate::environment::LightSamples;
use crate::error::Result;
use crate::progress::{Progress, tell};
use crate::scene::wrap;
use crate::surfels::{SurfelCloud, UpAxis};
use crate::transfer::directional::mean_radiance;

/// Rotations that are tried: one each 10 degrees.
const ROTATIONS: usize = 36;
const STEP: f64 = 360.0 / ROTATIONS as f64;

/// Error of a rotation over the least one, from which the least one is proposed.
const CLEARLY_WORSE: f64 = 1.15;

/// Error over that of even light, from which a light explains nothing.
const NO_BETTER_THAN_EVEN: f64 = 0.97;

/// Error of the mirrored light over that of the light as it is, below which it is taken for mirrored.
const MIRRORED: f64 = 0.9;

/// Error of a light at every rotation: standard deviation of what the logarithms of neighbours differ by, by the median.
#[derive(Clone, Debug, PartialEq)]
pub struct Alignment {
    /// Error of even light.
    even: f64,
    /// Errors of the light, and of the light mirrored, at each rotation.
    errors: [[f64; ROTATIONS]; 2],
}

/// Change of a known light that the shading advises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Advice {
    /// It explains the shading as well as it can.
    Keep,
    /// It explains the shading clearly better at another rotation, in degrees about the up axis, and mirrored or not.
    Rotate(f64, bool),
    /// It explains the shading no better than even light does at any rotation, and clearly worse at some.
    Replace,
}

/// Compares a light with a capture at all rotations about its up axis. `lights`: the light at rotation 0 in the Z-up world, as it is and
/// mirrored. `bake` is the cloud's for the directional method. None where the object says nothing.
///
/// # Errors
/// [`crate::error::Error::Cancelled`] when `progress` asked for it.
pub fn align_light(
    cloud: &SurfelCloud,
    bake: &DirectionalBake,
    up: UpAxis,
    lights: [&LightSamples; 2],
    progress: Progress<'_>,
) -> Result<Option<Alignment>> {
    let radiance = mean_radiance(cloud, &bake.normals);
    let clusters = Clusters::new(cloud, bake, &radiance);
    let even = ExpectedLight::even();
    let rotated = |light: &LightSamples, k: usize| {
        let rotation = DMat3::from_rotation_z((STEP * k as f64).to_radians());
        ExpectedLight::known(&light.rotated(up.asset_from_world() * rotation))
    };
    let each = lights.into_iter();
    let known: Vec<ExpectedLight> = each
        .flat_map(|light| (0..ROTATIONS).map(move |k| rotated(light, k)))
        .collect();
    let mut fit = Fit::new(&clusters, NEIGHBORS, &even);
    if clusters.len() < FEWEST_CLUSTERS || fit.has_no_pairs() {
        return Ok(None);
    }
    let error = |fit: &Fit<'_>| fit.misfit(&fit.explain(&FittedLight::even())).sqrt();
    let even = error(&fit);
    let mut errors = [[0.0; ROTATIONS]; 2];
    for (at, known) in known.iter().enumerate() {
        tell(progress, at as f64 / (2 * ROTATIONS) as f64)?;
        fit.expected = known;
        errors[at / ROTATIONS][at % ROTATIONS] = error(&fit);
    }
    let is_sound = even.is_finite() && errors.iter().flatten().all(|e| e.is_finite());
    Ok(is_sound.then_some(Alignment { even, errors }))
}

impl Alignment {
    /// Error at a rotation in degrees.
    fn error(&self, rotation: f64, is_mirrored: bool) -> f64 {
        let at = (rotation / STEP).rem_euclid(ROTATIONS as f64);
        let (first, share) = (at as usize % ROTATIONS, at.fract());
        let of = &self.errors[usize::from(is_mirrored)];
        of[first] + share * (of[(first + 1) % ROTATIONS] - of[first])
    }

    /// Rotation of the least error, in degrees.
    fn least(&self, is_mirrored: bool) -> f64 {
        let of = &self.errors[usize::from(is_mirrored)];
        let by_error = |a: &usize, b: &usize| of[*a].total_cmp(&of[*b]);
        let k = (0..ROTATIONS).min_by(by_error).unwrap_or(0);
        let [before, after] = [k + ROTATIONS - 1, k + 1].map(|k| of[k % ROTATIONS]);
        // The vertex of the parabola through the least and both beside it.
        let curvature = before - 2.0 * of[k] + after;
        let aside = if curvature > 0.0 {
            0.5 * (before - after) / curvature
        } else {
            0.0
        };
        wrap(STEP * (k as f64 + aside))
    }

    /// Rotation at which the light explains most, in degrees, and whether mirrored; `is_mirrored`: whether it is now, and stays where the errors
    /// are alike.
    pub fn best(&self, is_mirrored: bool) -> (f64, bool) {
        let [own, other] = [is_mirrored, !is_mirrored].map(|m| {
            let rotation = self.least(m);
            (rotation, m, self.error(rotation, m))
        });
        let (rotation, mirrored, _) = if other.2 < MIRRORED * own.2 {
            other
        } else {
            own
        };
        (rotation, mirrored)
    }

    /// Advice for the light at its rotation, in degrees.
    pub fn advice(&self, rotation: f64, is_mirrored: bool) -> Advice {
        let (best, mirrored) = self.best(is_mirrored);
        let least = self.error(best, mirrored);
        let worst = self.errors.iter().flatten().copied().fold(0.0, f64::max);
        if least > NO_BETTER_THAN_EVEN * self.even {
            // Where noise or an even light leave all rotations alike, nothing is known.
            match worst > CLEARLY_WORSE * self.even {
                true => Advice::Replace,
                false => Advice::Keep,
            }
        } else if self.error(rotation, is_mirrored) > CLEARLY_WORSE * least
            && (mirrored != is_mirrored || wrap(best - rotation).abs() >= STEP)
        {
            Advice::Rotate(best, mirrored)
        } else {
            Advice::Keep
        }
    }
}
