//! An object of a scene: a splat, how it is read, where it stands, and what it was captured under.

use std::path::PathBuf;

use glam::{Quat, Vec3};

use super::light::EnvironmentLight;
use crate::color::Encoding;
use crate::error::{Error, Result};
use crate::surfels::{Hide, SurfelCloud, UpAxis};

/// The most places that may be said to see the outside, and how far away they may be: each costs a pass over the asset.
pub const MOST_PLACES: usize = 32;
const FARTHEST: f32 = 1e12;

/// A splat in a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Object {
    /// Its file; none where the scene is for any.
    pub asset: Option<PathBuf>,
    /// The asset's up axis, where the file's own is not to be believed.
    pub up: Option<UpAxis>,
    /// The asset's colour is linear already.
    pub linear: bool,
    /// Places, in the asset's coordinates, that see its outside: where which side of a surface is its front could not be told.
    pub outside_from: Vec<Vec3>,
    /// Where it stands.
    pub transform: Transform,
    /// The light that it was captured under.
    pub source: EnvironmentLight,
    /// What of it is not drawn.
    pub hide: Hide,
}

impl Object {
    /// How the file is read: that makes a cloud of it, which stays whatever else is set.
    pub fn apply_to(&self, cloud: &mut SurfelCloud) {
        if self.linear {
            cloud.encoding = Encoding::StoredLinear;
        }
        cloud.outside_from.clone_from(&self.outside_from);
    }

    pub(super) fn validate(&self) -> Result<()> {
        let is_place = |p: &Vec3| p.abs().max_element() < FARTHEST;
        if self.outside_from.len() > MOST_PLACES || !self.outside_from.iter().all(is_place) {
            return Err(Error::Mismatch(format!(
                "outside_from: up to {MOST_PLACES} places of three numbers below {FARTHEST:e} are expected"
            )));
        }
        self.hide.validate()?;
        self.source.validate("source")
    }
}

/// From an object's own coordinates to the scene's: scaled, turned, moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    /// Of lengths.
    pub scale: f32,
    /// After the scale.
    pub rotation: Quat,
    /// In scene units.
    pub translation: Vec3,
}

impl Default for Transform {
    /// Where it was captured.
    fn default() -> Self {
        Self {
            scale: 1.0,
            rotation: Quat::IDENTITY,
            translation: Vec3::ZERO,
        }
    }
}
