//! Extreme case: its inputs, and how it is tried.

use std::cell::RefCell;

use crate::bake::Bake;
use crate::environment::{EnvironmentMap, Illumination};
use crate::error::Result;
use crate::progress::no_progress;
use crate::settings::{Method, TransferSettings};
use crate::surfels::SurfelCloud;
use crate::transfer::{Part, PreparedTransfer, Relit};

/// Directions of the harmonic method's bake here.
const DIRECTIONS: usize = 64;

/// The property of a case that is no valid input.
pub(super) const REFUSED: &str = "refused with a reason";

/// One extreme case.
pub struct Case {
    /// For people.
    pub name: &'static str,
    /// Property that must hold beside that all numbers are finite.
    pub property: &'static str,
    /// The asset, or why it cannot be one: what a loader refuses is as good.
    pub(super) make: fn() -> Result<CaseInput>,
    pub(super) check: fn(&Trial<'_>) -> std::result::Result<(), String>,
}

/// Inputs of a case.
pub struct CaseInput {
    /// The asset.
    pub cloud: SurfelCloud,
    /// The light of the capture.
    pub source: EnvironmentMap,
    /// The new light.
    pub target: EnvironmentMap,
    /// Factors of the lights.
    pub gains: [f32; 2],
    /// Epsilon, where it is not the method's.
    pub epsilon: Option<f32>,
    /// SH degree of the light.
    pub degree: usize,
}

/// One case under way: what a property may look at and try.
pub struct Trial<'a> {
    /// Method and terms.
    pub settings: TransferSettings,
    /// The asset.
    pub cloud: &'a SurfelCloud,
    /// Source and target.
    pub lights: [Illumination; 2],
    /// Relit result.
    pub relit: Relit,
    /// True where the source explained nothing.
    pub source_was_black: bool,
    pub(super) bake: Bake,
    pub(super) note: RefCell<String>,
}

impl Trial<'_> {
    /// Tells something beside whether it holds.
    pub(super) fn note(&self, text: String) {
        self.note.replace(text);
    }

    /// Relights the same asset, or one of the same geometry, by other lights or settings.
    ///
    /// # Errors
    /// What is asked for is no valid input.
    pub fn again(
        &self,
        cloud: &SurfelCloud,
        lights: [&Illumination; 2],
        settings: &TransferSettings,
    ) -> Result<Relit> {
        let prepared = PreparedTransfer::new(cloud, &self.bake, lights[0], settings)?;
        let relit = prepared.relight(lights[1], Part::Whole)?;
        Ok(relit.of_degree(cloud.sh_degree))
    }
}

pub(super) fn bake(cloud: &SurfelCloud, method: Method) -> Result<Bake> {
    Bake::new(cloud, method, DIRECTIONS, &no_progress)
}
