//! Accuracy of the estimated capture light.

use std::f32::consts::PI;
use std::sync::Arc;

use anyhow::Result;
use glam::Vec3;
use transplat_core::bake::Bake;
use transplat_core::environment::Illumination;
use transplat_core::estimate::{Estimate, estimate_light};
use transplat_core::progress::no_progress;
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::PreparedTransfer;
use transplat_core::transfer::directional::DirectionalTransfer;

use super::tables::LightEstimate;
use super::variants::Approach;
use crate::ground_truth::TruthObject;
use transplat_engine::environments::Environment;

/// The estimate of an unknown capture light, compared with the true light.
pub struct Unknown {
    estimated: Illumination,
    pub estimate: LightEstimate,
}

impl Unknown {
    pub fn new(
        object: &TruthObject,
        cloud: &SurfelCloud,
        bake: &Bake,
        light: &Illumination,
    ) -> Result<Self> {
        let Bake::Directional(directional) = bake else {
            anyhow::bail!("the light is estimated by a bake for preset best");
        };
        let estimate = estimate_light(cloud, directional, None, &no_progress)?;
        let estimated = Environment::estimated(&estimate, cloud.up)?.illumination;
        let truth = irradiance(cloud, bake, light)?;
        let (correlation, gain) = compare(cloud, &irradiance(cloud, bake, &estimated)?, &truth);
        Ok(Self {
            estimated,
            estimate: LightEstimate {
                object: object.name.clone(),
                source: object.source.name.clone(),
                confidence: estimate.confidence,
                correlation,
                angle: angle(&estimate, light),
                gain,
            },
        })
    }

    /// Prepares an approach that does not know the light of the capture; none where it does.
    pub fn prepare(
        &self,
        approach: &Approach,
        cloud: &SurfelCloud,
        bake: &Bake,
    ) -> Result<Option<PreparedTransfer>> {
        let by = |light: &Illumination, settings| {
            Ok(Some(PreparedTransfer::new(cloud, bake, light, settings)?))
        };
        match approach {
            Approach::Nothing | Approach::Known(_) => Ok(None),
            Approach::Estimated(settings) => by(&self.estimated, settings),
            Approach::EstimateFitted(settings) => {
                let gain = self.estimate.gain.map(|g| g as f32);
                by(&self.estimated.tinted(gain), settings)
            }
            Approach::Albedo => albedo(cloud, bake).map(Some),
        }
    }
}

/// Takes the captured mean colour for albedo: every surfel received the irradiance pi, so scattered what its albedo says.
fn albedo(cloud: &SurfelCloud, bake: &Bake) -> Result<PreparedTransfer> {
    let mut settings = TransferSettings::of(Method::Directional);
    for term in ["lobe", "residual", "glow"] {
        settings = settings.without(term)?;
    }
    let even = Illumination::even(MAX_DEGREE);
    let mut prepared = directional(PreparedTransfer::new(cloud, bake, &even, &settings)?)?;
    let received = PI * prepared.light_gain;
    Arc::make_mut(&mut prepared)
        .divisor
        .fill([[received; 3]; 2]);
    Ok(PreparedTransfer::Directional(prepared))
}

fn directional(prepared: PreparedTransfer) -> Result<Arc<DirectionalTransfer>> {
    let PreparedTransfer::Directional(best) = prepared else {
        anyhow::bail!("a transfer of preset best");
    };
    Ok(best)
}

/// Irradiance on the front of each surfel, in the light's own unit. `[n]`
fn irradiance(cloud: &SurfelCloud, bake: &Bake, light: &Illumination) -> Result<Vec<[f64; 3]>> {
    let settings = TransferSettings::of(Method::Directional);
    let best = directional(PreparedTransfer::new(cloud, bake, light, &settings)?)?;
    let over = 1.0 / f64::from(best.light_gain);
    let fronts = best.divisor.iter().map(|[front, _]| front);
    Ok(fronts.map(|e| e.map(|v| f64::from(v) * over)).collect())
}

/// Correlation with the truth, and by what the first has to be multiplied to be nearest to it: surfels count by area and opacity.
fn compare(cloud: &SurfelCloud, ours: &[[f64; 3]], truth: &[[f64; 3]]) -> ([f64; 3], [f64; 3]) {
    let weights: Vec<f64> = (0..cloud.len())
        .map(|i| f64::from(cloud.opacities[i] * cloud.scales[i].element_product()))
        .collect();
    let total: f64 = weights.iter().sum();
    let mean = |value: &dyn Fn(usize) -> f64| -> f64 {
        let each = weights.iter().enumerate();
        each.map(|(i, w)| w * value(i)).sum::<f64>() / total
    };
    let (mut correlation, mut gain) = ([0.0; 3], [1.0; 3]);
    for c in 0..3 {
        let (a, b) = (|i: usize| ours[i][c], |i: usize| truth[i][c]);
        let (of_a, of_b) = (mean(&a), mean(&b));
        let both = mean(&|i| (a(i) - of_a) * (b(i) - of_b));
        let each = mean(&|i| (a(i) - of_a).powi(2)) * mean(&|i| (b(i) - of_b).powi(2));
        correlation[c] = both / each.sqrt().max(1e-30);
        gain[c] = mean(&|i| a(i) * b(i)) / mean(&|i| a(i).powi(2)).max(1e-30);
    }
    (correlation, gain)
}

/// Angle between the directions that most of the light comes from, in degrees; none where there is no estimate.
fn angle(estimate: &Estimate, light: &Illumination) -> Option<f32> {
    let light_samples = light
        .light_samples
        .as_ref()
        .filter(|_| estimate.is_told())?;
    let all = light_samples.suns.iter().chain(&light_samples.cells);
    let sum: Vec3 = all
        .map(|b| b.direction * b.energy.iter().sum::<f32>())
        .sum();
    let cosine = estimate
        .light
        .dominant_direction()
        .dot(sum.normalize_or_zero());
    Some(cosine.clamp(-1.0, 1.0).acos().to_degrees())
}
