//! Sun estimate: a sky alone cannot cast crisp shadows.

use glam::Vec3;
use rayon::prelude::*;

use super::clusters::{Clusters, NONE};
use super::fit::{Fit, Fitted, FittedLight, FittedSun};
use crate::bake::directional::DirectionalBake;
use crate::error::Result;
use crate::progress::{Progress, part, tell};
use crate::sh::lattice;

/// Directions in which the brightest part of the sky is looked for.
const SEARCHED: usize = 2000;

/// Uncertain directions of a shown light that are tried, and factors of the sky's energy there.
const TRIED: usize = 64;
const STRONGER: [f64; 4] = [1.0, 4.0, 16.0, 64.0];

/// Cosine to the brightest direction within which the sky's light may be the sun's.
const AROUND: f64 = 0.9;

/// Share of the sky's unevenness that is left when a sun takes over.
const LEFT: f64 = 0.5;

/// Steps in which the direction is looked for, in degrees.
const STEPS: [f32; 4] = [7.0, 3.5, 2.0, 1.0];

/// Directions around the best one that each step tries.
const RING: usize = 6;

/// The light with a sun, where that is much more probable than without one.
///
/// # Errors
/// [`crate::error::Error::Cancelled`].
pub(super) fn add_sun(
    fit: &Fit<'_>,
    without: &Fitted,
    bake: &DirectionalBake,
    progress: Progress<'_>,
) -> Result<Option<Fitted>> {
    let noise = without.noise;
    let cost = |f: &Fitted| fit.cost(&f.light, &f.explained, noise);
    let starts = starts(fit, &without.light, noise, bake);
    let mut found: Option<Fitted> = None;
    for (at, light) in starts.iter().enumerate() {
        let [from, to] = [at, at + 1].map(|at| at as f64 / starts.len() as f64);
        let progress = part(progress, from, to);
        let mut light = fit.run(light.clone(), &part(&progress, 0.0, 0.4))?.light;
        for (i, step) in STEPS.into_iter().enumerate() {
            tell(&progress, 0.4 + 0.05 * i as f64)?;
            light = turn(fit, light, step, noise, bake);
        }
        let with = fit.run(light, &part(&progress, 0.6, 1.0))?;
        if found.as_ref().is_none_or(|best| cost(&with) < cost(best)) {
            found = Some(with);
        }
    }
    let Some(with) = found else {
        return Ok(None);
    };
    let [before, after] = [cost(without), cost(&with)];
    // Direction and energy are five unknowns (the Bayesian information criterion of Schwarz, 1978).
    let worth = 2.5 * (fit.clusters.len() as f64).ln();
    Ok((after.is_finite() && before - after > worth).then_some(with))
}

/// Suns from which a fit starts: where the sky is brightest, and where a shown light is uncertain and a sun explains most.
fn starts(
    fit: &Fit<'_>,
    sky: &FittedLight,
    noise: f64,
    bake: &DirectionalBake,
) -> Vec<FittedLight> {
    let radiance: Vec<(Vec3, [f64; 3])> = lattice(SEARCHED)
        .into_iter()
        .map(|d| (d, fit.sky_radiance(sky, d)))
        .collect();
    let sum = |v: &[f64; 3]| v.iter().sum::<f64>();
    let brightest = radiance
        .iter()
        .max_by(|a, b| sum(&a.1).total_cmp(&sum(&b.1)))
        .map_or(Vec3::Z, |(d, _)| *d);
    let omega = 4.0 * std::f64::consts::PI / SEARCHED as f64;
    let energy_around = |peak: Vec3| {
        let around = radiance
            .iter()
            .filter(|(d, _)| f64::from(d.dot(peak)) > AROUND);
        let mut energy = [0.0; 3];
        for (_, r) in around {
            for c in 0..3 {
                energy[c] += omega * r[c];
            }
        }
        energy
    };
    let shaded = sky
        .sky
        .clone()
        .map(|s| s.iter().map(|y| LEFT * y).collect());
    let shone = |direction: Vec3, seen: Vec<f64>| FittedLight {
        sky: shaded.clone(),
        sun: Some(FittedSun {
            direction,
            seen,
            log_energy: energy_around(direction).map(f64::ln),
        }),
    };
    let sky_irradiance = fit.sky_irradiance(&shaded);
    let uncertain = fit.expected.uncertain_directions.par_iter().take(TRIED);
    let tried = uncertain.flat_map_iter(|direction| {
        let light = shone(*direction, fit.clusters.seen_towards(*direction));
        let sky_irradiance = &sky_irradiance;
        STRONGER.into_iter().map(move |factor| {
            let mut light = light.clone();
            for log in light.sun.iter_mut().flat_map(|sun| &mut sun.log_energy) {
                *log += f64::ln(factor);
            }
            let explained = fit.explain_with(sky_irradiance.clone(), &light);
            (fit.cost(&light, &explained, noise), light)
        })
    });
    let best = tried
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, mut light)| {
            if let Some(sun) = &mut light.sun {
                sun.seen = seen(fit.clusters, sun.direction, bake);
            }
            light
        });
    let at_brightest = shone(brightest, seen(fit.clusters, brightest, bake));
    [at_brightest].into_iter().chain(best).collect()
}

/// The sun turned to where it explains more, by a step's angle in degrees.
fn turn(
    fit: &Fit<'_>,
    mut light: FittedLight,
    step: f32,
    noise: f64,
    bake: &DirectionalBake,
) -> FittedLight {
    let sky = fit.sky_irradiance(&light.sky);
    let cost = |light: &FittedLight| {
        let explained = fit.explain_with(sky.clone(), light);
        fit.cost(light, &explained, noise)
    };
    let Some(middle) = light.sun.as_ref().map(|s| s.direction) else {
        return light;
    };
    let mut best = cost(&light);
    let aside = middle.any_orthonormal_vector();
    let (sin, cos) = step.to_radians().sin_cos();
    for k in 0..RING {
        let angle = std::f32::consts::TAU * k as f32 / RING as f32;
        let (s, c) = angle.sin_cos();
        let direction = (cos * middle + sin * (c * aside + s * middle.cross(aside))).normalize();
        if !fit.expected.may_hold_sun(direction) {
            continue;
        }
        let mut other = light.clone();
        if let Some(sun) = &mut other.sun {
            sun.direction = direction;
            sun.seen = seen(fit.clusters, direction, bake);
        }
        let other_cost = cost(&other);
        if other_cost < best {
            (best, light) = (other_cost, other);
        }
    }
    light
}

/// Irradiance of each cluster by a sun of energy 1. `[c]`
fn seen(clusters: &Clusters, direction: Vec3, bake: &DirectionalBake) -> Vec<f64> {
    let cosine = |i: usize| bake.normals[i].dot(direction);
    let faces = |i: u32| clusters.share[i as usize] > 0.0 && cosine(i as usize) > 0.0;
    let open = bake.tracer.open_towards(direction, faces);
    let mut seen = vec![0.0; clusters.len()];
    for (i, k) in clusters.of.iter().enumerate() {
        if *k != NONE && open[i] {
            seen[*k as usize] += f64::from(clusters.share[i] * cosine(i));
        }
    }
    seen
}
