//! A light in the forms that the methods need.

use std::borrow::Cow;

use glam::{Affine3A, DMat3, Vec3};

use super::emitter::{Emitter, FEW, Shape};
use super::light_samples::{LightSample, LightSamples};
use super::map::EnvironmentMap;
use super::radiance::{IncidentRadiance, project_environment};
use crate::error::{Error, Result};

/// A light in the forms in which the methods need it.
#[derive(Clone, Debug, PartialEq)]
pub struct Illumination {
    /// As an SH series.
    pub radiance: IncidentRadiance,
    /// As beams, for the directional method; where nobody needs them they are left out.
    pub light_samples: Option<LightSamples>,
    /// Lights at a finite distance or with an extent, beside those: the directional method takes them as they are.
    pub emitters: Vec<Emitter>,
    /// Confidence in it as a capture light, 0 to 1: the change of a surfel away from it is raised to that power (the directional method).
    pub trust: f32,
    /// User-set gain by channel, which is in it already: that is known, and counts in full where a source has low confidence.
    pub user_gain: [f32; 3],
}

impl Illumination {
    /// A light in these forms, wholly believed.
    pub fn new(radiance: IncidentRadiance, light_samples: Option<LightSamples>) -> Self {
        Self {
            radiance,
            light_samples,
            emitters: Vec::new(),
            trust: 1.0,
            user_gain: [1.0; 3],
        }
    }

    /// Radiance 1 from everywhere.
    pub fn even(degree: usize) -> Self {
        Self::new(IncidentRadiance::even(degree), Some(LightSamples::even()))
    }

    /// SH series of a map to a degree.
    pub fn of(map: &EnvironmentMap, degree: usize) -> Self {
        Self::new(
            project_environment(map, degree),
            Some(LightSamples::of(map)),
        )
    }

    /// Light with a user-set gain by channel.
    pub fn told(&self, gain: [f32; 3]) -> Self {
        Self {
            user_gain: std::array::from_fn(|c| self.user_gain[c] * gain[c]),
            ..self.tinted(gain)
        }
    }

    /// Inputs of the directional method.
    ///
    /// # Errors
    /// The light was read without.
    pub fn for_directional(&self) -> Result<(&IncidentRadiance, &LightSamples)> {
        let missing = || Error::Mismatch("the light was not read for preset best".into());
        Ok((
            &self.radiance,
            self.light_samples.as_ref().ok_or_else(missing)?,
        ))
    }

    /// The light turned by `rotation` (world to world).
    pub fn rotated(&self, rotation: DMat3) -> Self {
        Self {
            radiance: self.radiance.rotated(rotation),
            light_samples: self.light_samples.as_ref().map(|b| b.rotated(rotation)),
            emitters: self.emitters_moved(Affine3A::from_mat3(rotation.as_mat3())),
            ..*self
        }
    }

    /// The light as an object sees it that stands somewhere else.
    pub fn seen_by(&self, scene_from_object: Affine3A) -> Self {
        let object_from_scene = scene_from_object.inverse();
        let (_, turn, _) = object_from_scene.to_scale_rotation_translation();
        Self {
            emitters: self.emitters_moved(object_from_scene),
            ..self.rotated(DMat3::from_quat(turn.as_dquat()))
        }
    }

    fn emitters_moved(&self, to_other: Affine3A) -> Vec<Emitter> {
        self.emitters.iter().map(|e| e.moved(to_other)).collect()
    }

    /// The light mirrored left to right, `f(x, -y, z)`.
    pub fn mirrored(&self) -> Self {
        Self {
            radiance: self.radiance.mirrored(),
            light_samples: self.light_samples.as_ref().map(LightSamples::mirrored),
            emitters: self.emitters_moved(Affine3A::from_scale(Vec3::new(1.0, -1.0, 1.0))),
            ..*self
        }
    }

    /// The light with each channel multiplied.
    pub fn tinted(&self, gain: [f32; 3]) -> Self {
        Self {
            radiance: self.radiance.tinted(gain),
            light_samples: self.light_samples.as_ref().map(|b| b.tinted(gain)),
            emitters: self.emitters.iter().map(|e| e.tinted(gain)).collect(),
            ..*self
        }
    }

    /// The light with its strength multiplied.
    pub fn scaled(&self, gain: f32) -> Self {
        self.tinted([gain; 3])
    }

    /// Adds a source without extent.
    pub fn add(&mut self, light_sample: LightSample) {
        // What the user made of the rest counts for its share of all.
        let means = self.radiance.mean_irradiances();
        self.user_gain = std::array::from_fn(|c| {
            let (mean, added) = (means[c], light_sample.energy[c] / 4.0);
            let unset = mean / self.user_gain[c].max(f32::MIN_POSITIVE);
            if mean > 0.0 && unset.is_finite() {
                (mean + added) / (unset + added)
            } else {
                1.0
            }
        });
        self.radiance
            .add(light_sample.direction, light_sample.energy);
        if let Some(light_samples) = &mut self.light_samples {
            light_samples.add(light_sample);
        }
    }

    /// The light without its compact sources, where it was read with them.
    #[must_use]
    pub fn without_suns(&self) -> Self {
        let mut light = self.clone();
        let suns = light
            .light_samples
            .as_mut()
            .map(|b| std::mem::take(&mut b.suns));
        for sun in suns.unwrap_or_default() {
            let less = sun.energy.map(|e| -e);
            light.radiance.add(sun.direction, less);
        }
        light
    }

    /// The light as it arrives at a place, which may be taken for the light on all of an object where that is small: what is near becomes a beam
    /// for each of its samples.
    pub fn at_one_place(&self, place: Vec3) -> Cow<'_, Self> {
        if self.emitters.is_empty() {
            return Cow::Borrowed(self);
        }
        let mut all = Self {
            emitters: Vec::new(),
            ..self.clone()
        };
        for light in &self.emitters {
            for k in 0..light.shape.samples(FEW) {
                let seen = light.shape.sample((k, FEW), [0.5; 2], place, 0.0);
                // Nothing is as bright as a point is in its own place.
                let strength = seen.strength.min(1e12);
                all.radiance
                    .add(seen.direction, light.emission.map(|e| e * strength));
            }
        }
        Cow::Owned(all)
    }

    /// [`IncidentRadiance::mean_irradiance`], with what comes from infinitely far away beside it.
    pub fn mean_irradiance(&self) -> f32 {
        let far = self.emitters.iter().filter_map(|light| match light.shape {
            // A surface turned all ways sees a quarter of what one does that faces it.
            Shape::Distant { .. } => Some(light.emission.iter().sum::<f32>() / 12.0),
            _ => None,
        });
        self.radiance.mean_irradiance() + far.sum::<f32>()
    }

    /// True for black light.
    pub fn is_black(&self) -> bool {
        self.radiance.is_black() && self.emitters.iter().all(|e| e.emission == [0.0; 3])
    }
}
