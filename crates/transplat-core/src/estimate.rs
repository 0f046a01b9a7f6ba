//! Stage *estimate*: the capture light from the splat, and from the rest of a capture that it is cut out of. `docs/method.md` derives it.
//!
//! Neighbours tend to be of the same stuff, and what they differ in is the light on them. The light is the one under which the albedos of
//! neighbours are most alike. Its logarithm is an SH series, so it is never negative, and the more even light is the more probable
//! one beforehand: what the object does not tell stays even, and a little brighter above. Its strength follows from the whitest
//! surfaces, which are taken to be as white as things are, and from the light that bounces between surfaces. Its mean is taken to be grey.

mod alignment;
mod clusters;
mod completion;
mod expected;
mod fit;
mod sky;
mod strength;
mod sun;
#[cfg(test)]
mod tests;
mod white;

use glam::{DMat3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bake::directional::DirectionalBake;
use crate::bake::strata::{DIRECTIONS, directions};
use crate::capture_environment::CaptureEnvironment;
use crate::environment::{EnvironmentMap, Illumination};
use crate::error::Result;
use crate::progress::{Progress, part};
use crate::sh::{MAX_DEGREE, SQRT_4PI, evaluate_sh};
use crate::surfels::{SurfelCloud, UpAxis};
use crate::transfer::directional::mean_radiance;
pub use alignment::{Advice, Alignment, align_light};
use clusters::{Clusters, FEWEST_CLUSTERS, NEIGHBORS};
use completion::draw_sun;
pub use completion::{CompletedMap, FoundExposure};
use expected::ExpectedLight;
use fit::{Explained, Fit, Fitted, FittedLight, Unit};
pub use sky::DEGREE;

/// Trust at least, and where the object tells nothing. To leave the colour as it was captured (0) and to divide all of a wrong light out of it (1)
/// are wrong by about as much, and in opposite ways: the one keeps the old shading alone, the other lays a new one over it.
pub const LEAST_TRUST: f32 = 0.5;

/// Confidence from which on trust is full. Below, it grows in proportion: of 42 captures under seven lights, those of confidence 0.5 to 0.7 are
/// nearest at a trust of 0.8.
const CONFIDENT: f32 = 0.95;

/// Share of the uncertainty that is left where the rest of the capture shows some of the light.
const SHOWN_UNCERTAINTY: f64 = 0.5;

/// Factors between the exposure of a photographed panorama and that of the capture: six stops either way.
const PLAUSIBLE_EXPOSURES: std::ops::RangeInclusive<f64> = 1.0 / 64.0..=64.0;

/// Confidence from which on an estimate says where up is.
const CERTAIN: f32 = 0.6;

/// Length of the mean normal above which everything faces one way.
const ONE_WAY: f32 = 0.97;

/// Unevenness of the light on the object, in logarithms, below which the capture's light was as good as even, and the noise below which
/// that can be told.
const EVEN: f64 = 0.08;
const QUIET: f64 = 0.3;

/// Height of the light (sine of its elevation) below which the up axis is doubtful.
const LOW_LIGHT: f32 = 0.2;

/// Rows of the estimate's map.
const MAP_ROWS: usize = 256;

/// Neighbours that a noisy cluster is compared with, where [`NEIGHBORS`] differ by [`NOISY`] or more under any light: so many, or that share
/// of all.
const MANY_NEIGHBORS: usize = 96;
const MANY_SHARE: f64 = 0.08;
const NOISY: f64 = 0.15;

/// Progress of an estimate after each of its stages.
const GATHERED: f64 = 0.1;
const SKY_FITTED: f64 = 0.3;
const SUN_FITTED: f64 = 0.7;
const STRENGTH_FITTED: f64 = 0.85;
const TINT_FITTED: f64 = 0.95;

/// A light that was estimated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct EstimatedLight {
    /// SH coefficients of the natural logarithm of the radiance, to degree [`DEGREE`]; of its ratio to `shown`, where that is set. `[K][3]`
    pub log_radiance: Vec<[f32; 3]>,
    /// Light as the rest of the capture shows it, in the strength of the estimate. It is not saved.
    #[serde(skip)]
    pub shown: Option<CaptureEnvironment>,
    /// Direction of a sun and its irradiance on a surface that faces it, where there was one to be found.
    pub sun: Option<([f32; 3], [f32; 3])>,
}

/// What keeps an object from telling its light.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Obstacle {
    /// Too few visible surfels see the light.
    TooLittle,
    /// The object is black.
    Black,
    /// All of it faces one way.
    OneWay,
    /// The light was about even, as far as the object tells.
    EvenLight,
}

impl Obstacle {
    /// For the user.
    pub fn reason(self) -> &'static str {
        match self {
            Self::TooLittle => "too few visible Gaussians see the light",
            Self::Black => "the object is black",
            Self::OneWay => "the whole object faces one way",
            Self::EvenLight => "the object shows hardly any shading, as under even light",
        }
    }
}

/// What an asset tells of the light it was captured under.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// The most probable light; even where nothing tells it.
    pub light: EstimatedLight,
    /// How sure it is, 0 to 1: of the variance of the light over the object, and of the noise that no light explains, the share that is told.
    pub confidence: f32,
    /// Why even light is assumed instead, where it is.
    pub obstacle: Option<Obstacle>,
}

impl Estimate {
    /// The confidence for people: nothing is wholly sure.
    pub fn percent(&self) -> f32 {
        (100.0 * self.confidence).min(99.0)
    }

    /// Whether most of the light comes from the side or from below: an asset whose up axis is wrong looks so.
    pub fn may_lie_on_its_side(&self, up: UpAxis) -> bool {
        let is_alone = self.light.shown.is_none();
        let is_certain = self.is_told() && is_alone && self.confidence >= CERTAIN;
        is_certain && self.light.dominant_direction().dot(up.direction()) < LOW_LIGHT
    }

    /// True where the object tells its light.
    pub fn is_told(&self) -> bool {
        self.obstacle.is_none()
    }

    /// Share of the change away from its light that is applied, in logarithms: it grows with the confidence. See [`Illumination::trust`].
    pub fn trust(&self) -> f32 {
        match self.obstacle {
            Some(Obstacle::EvenLight) => 1.0,
            Some(_) => LEAST_TRUST,
            None => {
                let grown = (self.confidence / CONFIDENT).clamp(0.0, 1.0);
                LEAST_TRUST + (1.0 - LEAST_TRUST) * grown
            }
        }
    }

    /// The source light where nothing tells it: even, and so strong that the whitest albedo is plausible.
    pub fn stand_in(&self) -> Illumination {
        let radiance = self.light.sky_radiance(Vec3::Z);
        let is_light = radiance.iter().all(|v| v.is_finite() && *v > 0.0);
        Illumination {
            trust: self.trust(),
            ..Illumination::even(MAX_DEGREE).tinted(if is_light { radiance } else { [1.0; 3] })
        }
    }

    /// The light that the rest of a capture shows, where the object tells nothing.
    fn shown(shown: &CaptureEnvironment) -> Self {
        Self {
            light: EstimatedLight {
                log_radiance: vec![[0.0; 3]; sky::SKY],
                shown: Some(shown.clone()),
                sun: None,
            },
            confidence: 1.0 - SHOWN_UNCERTAINTY as f32,
            obstacle: None,
        }
    }

    fn none(obstacle: Obstacle) -> Self {
        Self {
            light: EstimatedLight {
                log_radiance: vec![[0.0; 3]; sky::SKY],
                shown: None,
                sun: None,
            },
            confidence: 0.0,
            obstacle: Some(obstacle),
        }
    }
}

/// Estimates the light that `cloud` was captured under; `bake` is the cloud's for the directional method, `shown` the environment of an
/// isolated part of a capture.
///
/// # Errors
/// [`crate::error::Error::Cancelled`] when `progress` asked for it.
pub fn estimate_light(
    cloud: &SurfelCloud,
    bake: &DirectionalBake,
    shown: Option<&CaptureEnvironment>,
    progress: Progress<'_>,
) -> Result<Estimate> {
    let (estimate, _) = estimate_with_strength(cloud, bake, shown, progress)?;
    Ok(estimate)
}

/// Estimate, and the factor that brings a shown light of no unit to that of the photographs, where the object shows it.
fn estimate_with_strength(
    cloud: &SurfelCloud,
    bake: &DirectionalBake,
    shown: Option<&CaptureEnvironment>,
    progress: Progress<'_>,
) -> Result<(Estimate, Option<f64>)> {
    let radiance = mean_radiance(cloud, &bake.normals);
    let clusters = Clusters::new(cloud, bake, &radiance);
    let expected = match shown {
        Some(shown) => ExpectedLight::shown(shown),
        None => ExpectedLight::from_above(cloud.up.direction()),
    };
    let mut near = Fit::new(&clusters, NEIGHBORS, &expected);
    if clusters.len() < FEWEST_CLUSTERS || near.has_no_pairs() {
        let has_light = radiance.iter().any(|[b, _]| b.iter().any(|v| *v > 0.0));
        let is_black = !has_light && !cloud.is_empty();
        let obstacle = match is_black {
            true => Obstacle::Black,
            false => Obstacle::TooLittle,
        };
        let estimate = shown.map_or_else(|| Estimate::none(obstacle), Estimate::shown);
        return Ok((estimate, None));
    }
    let sky_of = |fit: &Fit<'_>| {
        let step = part(progress, GATHERED, SKY_FITTED);
        fit.run(FittedLight::even(), &step)
    };
    let mut sky = sky_of(&near)?;
    let mut far = None;
    if sky.noise.sqrt() >= NOISY {
        let share = (MANY_SHARE * clusters.len() as f64) as usize;
        let fit = Fit::new(&clusters, share.clamp(NEIGHBORS, MANY_NEIGHBORS), &expected);
        sky = sky_of(&fit)?;
        far = Some(fit);
    }
    let fit = far.as_ref().unwrap_or(&near);
    let with_sun = sun::add_sun(fit, &sky, bake, &part(progress, SKY_FITTED, SUN_FITTED))?;
    let Fitted {
        light, explained, ..
    } = with_sun.unwrap_or(sky);
    let even = match shown {
        Some(_) => {
            Fit::new(&clusters, NEIGHBORS, &ExpectedLight::even()).explain(&FittedLight::even())
        }
        None => fit.explain(&FittedLight::even()),
    };
    let step = part(progress, SUN_FITTED, STRENGTH_FITTED);
    let strength = match expected.has_unit {
        true => 1.0,
        false => strength::find(&mut near, &light, explained.strength, &step)?,
    };
    let mut fit = far.unwrap_or(near);
    fit.strength = Some(strength);
    if shown.is_none() {
        let step = part(progress, STRENGTH_FITTED, TINT_FITTED);
        fit.unit = Unit::Mean(strength::tint(&mut fit, &light, &step)?);
    }
    let mut fitted = fit.run(light, &part(progress, TINT_FITTED, 1.0))?;
    if shown.is_some_and(|shown| shown.uncertainty > 0.0) {
        fit.balance_strength_and_tint(&mut fitted);
    }
    // Where bounced light explains all there is, the fit has no strength to find.
    let strength = fitted.explained.strength;
    let strength = Some(strength).filter(|s| PLAUSIBLE_EXPOSURES.contains(s));
    Ok((judge(&clusters, &even, fitted, shown), strength))
}

/// Completes a panorama that `cloud` was captured under; `bake` is the cloud's for the directional method.
///
/// `unit`: factors that bring the map to the unit of the cloud's colours, by channel; none where nobody knows them, as of photographs. The map's
/// exposure then follows from the shading, too. `to_asset` rotates the map's directions to the cloud's coordinates.
///
/// # Errors
/// [`crate::error::Error::Cancelled`] when `progress` asked for it.
pub fn complete_light(
    cloud: &SurfelCloud,
    bake: &DirectionalBake,
    map: &EnvironmentMap,
    unit: Option<[f32; 3]>,
    to_asset: DMat3,
    progress: Progress<'_>,
) -> Result<CompletedMap> {
    let white = completion::white_of(map);
    let shown = CaptureEnvironment::of_panorama(map, white, to_asset, unit.is_some());
    let shown = shown.tinted(unit.unwrap_or([1.0; 3]));
    let (found, strength) = estimate_with_strength(cloud, bake, Some(&shown), progress)?;
    let (found, exposure) = match (shown.has_unit, strength) {
        (true, _) => (found, FoundExposure::Known),
        (false, Some(strength)) => (found, FoundExposure::Found(strength as f32)),
        // The panorama stays as it is expected.
        (false, None) => (Estimate::shown(&shown), FoundExposure::Unknown),
    };
    let unit = unit.unwrap_or([1.0; 3]);
    let light = &found.light;
    let sun = light.sun.map(|(toward, energy)| {
        let energy = std::array::from_fn(|c| energy[c] / unit[c].max(f32::MIN_POSITIVE));
        (Vec3::from_array(toward), energy)
    });
    let log = |d| light.log(d);
    Ok(completion::completed(
        map, white, &log, sun, exposure, to_asset,
    ))
}

fn judge(
    clusters: &Clusters,
    even: &Explained,
    fitted: Fitted,
    shown: Option<&CaptureEnvironment>,
) -> Estimate {
    let of_even = EstimatedLight::new(&FittedLight::even(), even, None);
    let mean = |value: &dyn Fn(usize) -> f64| -> f64 {
        let each = clusters.mass.iter().enumerate();
        each.map(|(i, m)| m * value(i)).sum()
    };
    let unevenness: f64 = (0..3)
        .map(|c| {
            let log = |i: usize| fitted.explained.log_irradiance[i][c] - even.log_irradiance[i][c];
            let middle = mean(&log);
            mean(&|i| (log(i) - middle).powi(2))
        })
        .sum::<f64>()
        / 3.0;
    let explained = (unevenness - fitted.open).max(0.0);
    let explained_share = explained / (unevenness + fitted.noise);
    let confidence = match shown {
        Some(_) => 1.0 - SHOWN_UNCERTAINTY * (1.0 - explained_share),
        None => explained_share,
    };
    let each = clusters.normals.iter().zip(&clusters.mass);
    let facing: Vec3 = each.map(|(n, m)| n.normalize_or_zero() * *m as f32).sum();
    if let (Some(shown), false) = (shown, confidence.is_finite()) {
        return Estimate::shown(shown);
    }
    let obstacle = if shown.is_some() {
        None
    } else if !confidence.is_finite() {
        Some(Obstacle::TooLittle)
    } else if facing.length() > ONE_WAY {
        Some(Obstacle::OneWay)
    } else if fitted.noise.sqrt() < QUIET && explained.sqrt() < EVEN {
        Some(Obstacle::EvenLight)
    } else {
        None
    };
    Estimate {
        light: match obstacle {
            None => EstimatedLight::new(&fitted.light, &fitted.explained, shown),
            Some(_) => of_even,
        },
        confidence: match obstacle {
            None => confidence as f32,
            Some(_) => 0.0,
        },
        obstacle,
    }
}

impl EstimatedLight {
    fn new(light: &FittedLight, explained: &Explained, shown: Option<&CaptureEnvironment>) -> Self {
        let scale: [f64; 3] =
            std::array::from_fn(|c| explained.strength / explained.mean_radiance[c]);
        let mut log_radiance: Vec<[f32; 3]> = (0..sky::SKY)
            .map(|k| std::array::from_fn(|c| (light.sky[c][k] * SQRT_4PI) as f32))
            .collect();
        if shown.is_none() {
            for c in 0..3 {
                log_radiance[0][c] += (scale[c].ln() * SQRT_4PI) as f32;
            }
        }
        Self {
            log_radiance,
            shown: shown.map(|shown| shown.tinted(scale.map(|s| s as f32))),
            sun: light.sun.as_ref().map(|sun| {
                let energy = std::array::from_fn(|c| (scale[c] * light.sun_energy(c)) as f32);
                (sun.direction.to_array(), energy)
            }),
        }
    }

    /// Whether it has all its coefficients, and nothing but numbers.
    pub(crate) fn is_sound(&self) -> bool {
        let sun = self.sun.iter().flat_map(|(d, e)| [d, e]);
        let mut values = self.log_radiance.iter().chain(sun).flatten();
        self.log_radiance.len() == sky::SKY && values.all(|v| v.is_finite())
    }

    /// Where most of the light comes from, in the asset's coordinates: the unit vector along the sum of all light.
    pub fn dominant_direction(&self) -> Vec3 {
        let sky = directions().into_iter();
        let omega = 4.0 * std::f32::consts::PI / DIRECTIONS as f32;
        let sky = sky.map(|d| d * omega * self.sky_radiance(d).iter().sum::<f32>());
        let sun = self.sun.iter();
        let sun = sun.map(|(d, energy)| Vec3::from_array(*d) * energy.iter().sum::<f32>());
        sky.chain(sun).sum::<Vec3>().normalize_or_zero()
    }

    /// Logarithm of the radiance of the sky, or of its ratio to what is shown.
    fn log(&self, d: Vec3) -> [f32; 3] {
        evaluate_sh(&self.log_radiance, DEGREE, d.to_array())
    }

    /// Radiance of the sky, without the sun.
    pub fn sky_radiance(&self, d: Vec3) -> [f32; 3] {
        let log = self.log(d);
        match &self.shown {
            None => log.map(f32::exp),
            Some(shown) => shown.toward(d).changed(log, shown.uncertainty),
        }
    }

    /// As a map that any program can open, upright for an asset with that up axis. The sun is a small disc in it.
    pub fn map(&self, up: UpAxis) -> EnvironmentMap {
        let (width, height) = (2 * MAP_ROWS, MAP_ROWS);
        let blank = EnvironmentMap::new(width, height, vec![[0.0; 3]; width * height]);
        let direction = |i: usize| {
            let [x, y, z] = blank.direction(i % width, i / width);
            (up.asset_from_world() * glam::DVec3::new(x, y, z)).as_vec3()
        };
        let mut pixels: Vec<[f32; 3]> = (0..width * height)
            .into_par_iter()
            .map(|i| self.sky_radiance(direction(i)))
            .collect();
        if let Some((toward, energy)) = self.sun {
            let toward = Vec3::from_array(toward);
            draw_sun(&blank, &mut pixels, toward, energy, &direction);
        }
        EnvironmentMap::new(width, height, pixels)
    }
}
