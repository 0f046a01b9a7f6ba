//! Accuracy of the estimated capture light.

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
use super::variants::AssumedSource;
use transplat_engine::environments::Environment;

/// Stand-ins for an unknown capture light, compared with the true one.
pub struct Unknown {
    estimated: Illumination,
    even: Illumination,
    /// Factors of the true light over the two stand-ins, by channel.
    gains: [[f64; 3]; 2],
    pub estimate: LightEstimate,
}

impl Unknown {
    pub fn new(
        object: &str,
        cloud: &SurfelCloud,
        bake: &Bake,
        light: &Illumination,
    ) -> Result<Self> {
        let Bake::Directional(directional) = bake else {
            anyhow::bail!("the light is estimated by a bake for preset best");
        };
        let estimate = estimate_light(cloud, directional, None, &no_progress)?;
        let even = Illumination::even(MAX_DEGREE);
        let estimated = Environment::estimated(&estimate, cloud.up)?.illumination;
        let irradiance = |light: &Illumination| irradiance(cloud, bake, light);
        let truth = irradiance(light)?;
        let compared = [&estimated, &even].map(|l| Ok(compare(cloud, &irradiance(l)?, &truth)));
        let [of_estimate, of_even]: [Result<_>; 2] = compared;
        let ((correlation, gain), (_, gain_of_even)) = (of_estimate?, of_even?);
        Ok(Self {
            estimated,
            even,
            gains: [gain, gain_of_even],
            estimate: LightEstimate {
                object: object.to_owned(),
                confidence: estimate.confidence,
                correlation,
                angle: angle(&estimate, light),
                gain,
            },
        })
    }

    /// The source light of a variant, where it is not the one that was told.
    pub fn light(&self, source: AssumedSource) -> Option<Illumination> {
        let (light, gain) = match source {
            AssumedSource::Told => return None,
            AssumedSource::Estimated | AssumedSource::EstimatedFitted => {
                (&self.estimated, self.gains[0])
            }
            AssumedSource::Even | AssumedSource::EvenFitted => (&self.even, self.gains[1]),
        };
        let gain = if source.is_fitted() { gain } else { [1.0; 3] };
        Some(light.tinted(gain.map(|g| g as f32)))
    }
}

/// Irradiance on the front of each surfel, in the light's own unit. `[n]`
fn irradiance(cloud: &SurfelCloud, bake: &Bake, light: &Illumination) -> Result<Vec<[f64; 3]>> {
    let settings = TransferSettings::of(Method::Directional);
    let prepared = PreparedTransfer::new(cloud, bake, light, &settings)?;
    let PreparedTransfer::Directional(best) = prepared else {
        anyhow::bail!("a transfer of preset best");
    };
    let best: &DirectionalTransfer = &best;
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
