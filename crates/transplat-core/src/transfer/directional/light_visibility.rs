//! Visibility of a placed light from the surfels of a splat, and its cache.

use std::sync::{Arc, Mutex, PoisonError};

use crate::environment::Shape;

/// Visibility of a light from the surfels of a splat, for an emission of 1.
#[derive(Debug)]
pub struct LightVisibility {
    pub shape: Shape,
    /// Irradiance of the front and the back. `[n]`
    pub irradiance: Vec<[f32; 2]>,
    /// Visible share of each of its parts from the front, 0 to 1. `[n][parts]`
    pub seen: Vec<f32>,
}

/// Cache of the lights' visibility, by the last that were traced.
#[derive(Debug, Default)]
pub struct ShadowCache(Mutex<Vec<Arc<LightVisibility>>>);

impl ShadowCache {
    /// All of it.
    pub fn get(&self) -> Vec<Arc<LightVisibility>> {
        self.0
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .clone()
    }

    /// Forgets that for this.
    pub fn set(&self, met: Vec<Arc<LightVisibility>>) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = met;
    }
}
