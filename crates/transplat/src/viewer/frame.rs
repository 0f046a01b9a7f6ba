//! What the viewport shows: the camera, the lights behind the object, the ground, as the settings have them.

use std::sync::Arc;

use transplat_core::camera::{Camera, CameraPose, Lens};
use transplat_core::present::{Background, View};
use transplat_core::scene::{EnvironmentLight, Object, Scene};
use transplat_gpu::live::{Frame, Placement};
use transplat_gpu::present::{BackdropLight, GroundPlane, Presentation};

use super::environments::Environment;
use super::object::ObjectState;
use super::session::{SOURCE, Session, TARGET};
use crate::picture::half;

impl Session {
    /// What a viewport of a size shows with the settings as they are.
    pub fn frame(&self, size: [usize; 2], view: View) -> Option<Frame> {
        self.frame_from(&self.pose, size, view)
    }

    /// The same, seen from elsewhere.
    pub(super) fn frame_from(
        &self,
        pose: &CameraPose,
        size: [usize; 2],
        view: View,
    ) -> Option<Frame> {
        let asset = self.states.iter().find_map(|s| s.asset.as_ref())?;
        let (up, bounds) = (self.scene_up(), self.scene_bounds().unwrap_or(asset.bounds));
        let whole = Camera {
            // It is for saved pictures: nothing is drawn anew for it.
            lens: Lens::default(),
            ..Camera::from_pose(pose, up, size, bounds.radius)
        };
        let camera = if view == View::SideBySide {
            half(&whole)
        } else {
            whole
        };
        let scene = &self.scene;
        let light = |side: usize| {
            let (_, settings, gain) = self.behind(side, view);
            BackdropLight {
                map_from_asset: settings.map_from_asset(up),
                gain: settings.gain().map(|g| g * gain),
            }
        };
        let (center, axes, half_edge) = self.ground_plane()?;
        let ready = |side: usize| {
            let shown = self.backdrops[side].made_from();
            let (light, settings, _) = self.behind(side, view);
            shown.is_some_and(|k| {
                let is_it = k.light == light.id && k.without_suns == settings.without_suns;
                is_it || k.is_sky && light.sky.is_some()
            })
        };
        let [source, target] = view.backdrops();
        // Until its map is read, an environment behind the object is a plain grey.
        let waits = (source && !ready(SOURCE)) || (target && !ready(TARGET));
        let background = match view.background(scene.background) {
            Background::Environment if waits => Background::Color([0.25; 3]),
            Background::Plate if self.plate.current().is_none() => Background::Color([0.25; 3]),
            other => other,
        };
        Some(Frame {
            presentation: Presentation {
                camera,
                size,
                view,
                wipe: scene.wipe,
                difference_scale: scene.difference_scale,
                display: scene.display,
                graded: [SOURCE, TARGET].map(|side| self.graded_by(side, view)),
                false_color: scene.false_color,
                background,
                plate: self.plate.get().copied().unwrap_or([1; 2]),
                lights: [light(SOURCE), light(TARGET)],
                ground: GroundPlane {
                    center,
                    axes,
                    half: half_edge,
                    catches: scene.shadow_catcher && self.ground_lit.get().is_some(),
                    grid: self.overlays.grid.then(|| grid_spacing(bounds.radius)),
                },
                bounds,
                depth_unit: 1.0,
            },
            against_pinned: self.compared().is_some(),
            marks: self.overlays.marks,
            pixel_step: 1,
            objects: scene
                .objects
                .iter()
                .zip(&self.states)
                .map(placement)
                .collect(),
        })
    }

    /// The light that is seen behind a side, as it is turned, and what it is brought to the source's strength by. Behind a pinned look it
    /// is that look's.
    pub(super) fn behind(
        &self,
        side: usize,
        view: View,
    ) -> (&Arc<Environment>, &EnvironmentLight, f32) {
        // All objects are in the light of the first.
        let at = 0;
        let pinned = self.compared();
        if let Some(pinned) = pinned.filter(|_| side == SOURCE && view.has_two_sides()) {
            let maps = [&pinned.sources[0], &pinned.environment];
            let gain = environment_gain(&pinned.scene, 0, maps);
            return (&pinned.environment, &pinned.scene.environment, gain);
        }
        let sides = self.sides_of(at);
        let gain = match side {
            SOURCE => 1.0,
            _ => environment_gain(&self.scene, at, sides.map(|(_, there)| &there.light)),
        };
        let (settings, there) = sides[side];
        (&there.light, settings, gain)
    }
}

fn environment_gain(scene: &Scene, at: usize, lights: [&Arc<Environment>; 2]) -> f32 {
    let maps = lights.map(|light| &light.illumination);
    scene.environment_gain(&scene.objects[at], maps)
}

/// How an object stands in the scene, and what of it is drawn.
fn placement((object, state): (&Object, &ObjectState)) -> Placement {
    Placement {
        scene_from_object: object.transform.scene_from_object(),
        shown: object.shown,
        hidden: state.hidden.get().cloned().unwrap_or_default(),
        hidden_version: state.hidden.version(),
    }
}

/// A round spacing of the grid, a quarter of the object's radius and more.
pub(super) fn grid_spacing(radius: f32) -> f32 {
    let raw = radius / 4.0;
    let power = 10f32.powf(raw.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0];
    let step = steps.iter().find(|s| **s * power >= raw).unwrap_or(&10.0);
    step * power
}
