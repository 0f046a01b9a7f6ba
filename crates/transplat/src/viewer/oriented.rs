//! The lights as the asset sees them: turned, tinted and scaled, once a change.

use std::sync::Arc;

use transplat_core::environment::Illumination;
use transplat_core::look::{LightSettings, Look};
use transplat_core::surfels::UpAxis;

use super::lights::Light;

/// A light as the asset sees it; two are the same where nothing was changed in between.
#[derive(Clone)]
pub struct OrientedLight {
    pub light: Arc<Illumination>,
    version: u64,
}

impl PartialEq for OrientedLight {
    fn eq(&self, other: &Self) -> bool {
        self.version == other.version
    }
}

/// What the lights were made from: maps, settings, whether they are matched, and the asset's up axis.
type MadeFrom = ([u64; 2], [LightSettings; 2], bool, UpAxis);

/// The lights of both sides, kept since they are asked for several times a frame.
#[derive(Default)]
pub(super) struct OrientedLights {
    kept: Option<(MadeFrom, [OrientedLight; 2])>,
    last_version: u64,
}

impl OrientedLights {
    /// Source and target of a look.
    pub fn of(&mut self, sides: [&Light; 2], look: &Look, up: UpAxis) -> [OrientedLight; 2] {
        let from = (
            sides.map(|side| side.id),
            [look.source.clone(), look.target.clone()],
            look.match_strength,
            up,
        );
        if let Some((made_from, lights)) = &self.kept
            && *made_from == from
        {
            return lights.clone();
        }
        let [source, target] = sides.map(|side| &side.illumination);
        let before = self.kept.take().map(|(_, lights)| lights);
        let made = look.lights(source, target, up).map(Arc::new);
        let lights = std::array::from_fn(|side| match &before {
            Some(before) if before[side].light == made[side] => before[side].clone(),
            _ => {
                self.last_version += 1;
                OrientedLight {
                    light: made[side].clone(),
                    version: self.last_version,
                }
            }
        });
        self.kept = Some((from, lights.clone()));
        lights
    }
}
