//! Capture light by a click on the object.

use glam::DVec3;
use transplat_core::scene::STOPS;
use transplat_core::transfer::PreparedTransfer;

use crate::language::tr;
use crate::project::Project;

/// Albedo of what is called white: of paper and wall paint.
const WHITE: f32 = 0.8;

/// Least albedo of what may be called white.
const DARKEST: f32 = 1e-4;

impl Project {
    /// Sets strength and tint of an object's capture light so that it is white around a surfel. Light that bounces is left out, so a second click
    /// comes nearer.
    ///
    /// # Errors
    /// Why that cannot be told, for the user.
    pub fn take_as_white(&mut self, at: usize, surfel: usize) -> Result<(), &'static str> {
        let prepared = self.states[at].prepared.get().map(|p| &p.prepared);
        let Some(PreparedTransfer::Directional(transfer)) = prepared else {
            return Err(tr(
                "This needs preset best, one object, and a finished bake.",
            ));
        };
        let albedo = transfer.albedo_around(surfel);
        if albedo.iter().any(|a| *a < DARKEST) {
            return Err(tr("That is too dark to be white."));
        }
        let source = &mut self.scene.objects[at].source;
        let gain = source.gain();
        let gain: [f32; 3] = std::array::from_fn(|c| gain[c] * albedo[c] / WHITE);
        let most = gain.into_iter().fold(0.0, f32::max);
        source.tint = gain.map(|g| g / most);
        let (low, high) = STOPS.into_inner();
        source.strength = most.log2().clamp(low, high);
        Ok(())
    }

    /// Direction of the world as it was where an object was captured.
    pub fn captured_from(&self, at: usize, direction: DVec3) -> DVec3 {
        let in_scene = self.world_from_scene().transpose() * direction;
        let turn = self.scene.objects[at].transform.rotation.as_dquat();
        self.up_of(at).asset_from_world().transpose() * (turn.inverse() * in_scene)
    }
}
