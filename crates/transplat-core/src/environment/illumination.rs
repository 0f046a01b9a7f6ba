//! A light in the forms in which the methods need it.

use glam::DMat3;

use super::beams::{Beam, Beams};
use super::map::EnvironmentMap;
use super::radiance::{IncidentRadiance, project_environment};
use crate::error::{Error, Result};

/// A light in the forms in which the methods need it.
#[derive(Clone, Debug, PartialEq)]
pub struct Illumination {
    /// As an SH series.
    pub radiance: IncidentRadiance,
    /// As beams, for the directional method; where nobody needs them they are left out.
    pub beams: Option<Beams>,
    /// How far it is to be believed as the light of a capture, 0 to 1: what a surfel changes by, away from it, is taken to that power
    /// (the directional method).
    pub trust: f32,
}

impl Illumination {
    /// Radiance 1 from everywhere.
    pub fn even(degree: usize) -> Self {
        Self {
            radiance: IncidentRadiance::even(degree),
            beams: Some(Beams::even()),
            trust: 1.0,
        }
    }

    /// Of a map, its SH series to a degree.
    pub fn of(map: &EnvironmentMap, degree: usize) -> Self {
        Self {
            radiance: project_environment(map, degree),
            beams: Some(Beams::of(map)),
            trust: 1.0,
        }
    }

    /// What the directional method needs of it.
    ///
    /// # Errors
    /// The light was read without.
    pub fn for_directional(&self) -> Result<(&IncidentRadiance, &Beams)> {
        let missing = || Error::Mismatch("the light was not read for preset best".into());
        Ok((&self.radiance, self.beams.as_ref().ok_or_else(missing)?))
    }

    /// The light turned by `rotation` (world to world).
    pub fn rotated(&self, rotation: DMat3) -> Self {
        Self {
            radiance: self.radiance.rotated(rotation),
            beams: self.beams.as_ref().map(|b| b.rotated(rotation)),
            trust: self.trust,
        }
    }

    /// The light mirrored left to right in its own map: `f(x, -y, z)`.
    pub fn mirrored(&self) -> Self {
        Self {
            radiance: self.radiance.mirrored(),
            beams: self.beams.as_ref().map(Beams::mirrored),
            trust: self.trust,
        }
    }

    /// The light with each channel multiplied.
    pub fn tinted(&self, gain: [f32; 3]) -> Self {
        Self {
            radiance: self.radiance.tinted(gain),
            beams: self.beams.as_ref().map(|b| b.tinted(gain)),
            trust: self.trust,
        }
    }

    /// The light with its strength multiplied.
    pub fn scaled(&self, gain: f32) -> Self {
        self.tinted([gain; 3])
    }

    /// Adds a source without extent.
    pub fn add(&mut self, beam: Beam) {
        self.radiance.add(beam.direction, beam.energy);
        if let Some(beams) = &mut self.beams {
            beams.add(beam);
        }
    }

    /// [`IncidentRadiance::mean_irradiance`].
    pub fn mean_irradiance(&self) -> f32 {
        self.radiance.mean_irradiance()
    }

    /// Whether the light is black.
    pub fn is_black(&self) -> bool {
        self.radiance.is_black()
    }
}
