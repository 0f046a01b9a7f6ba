//! Frame of the viewport: camera, backdrops and ground from the settings.

use transplat_core::camera::{Camera, CameraPose, Lens};
use transplat_core::present::{Background, View};
use transplat_core::scene::Object;
use transplat_gpu::live::{Frame, Placement};
use transplat_gpu::present::{BackdropLight, GroundPlane, Presentation};

use super::session::Session;
use transplat_engine::object::ObjectState;
use transplat_engine::project::{SOURCE, TARGET};
use transplat_engine::render::half;

impl Session {
    /// Frame of a viewport of a size with the settings as they are.
    pub fn frame(&self, size: [usize; 2], view: View) -> Option<Frame> {
        self.frame_from(&self.project.pose, size, view)
    }

    /// Frame seen from another pose.
    pub(super) fn frame_from(
        &self,
        pose: &CameraPose,
        size: [usize; 2],
        view: View,
    ) -> Option<Frame> {
        let asset = self.project.states.iter().find_map(|s| s.asset.as_ref())?;
        let (up, bounds) = (
            self.project.scene_up(),
            self.project.scene_bounds().unwrap_or(asset.bounds),
        );
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
        let scene = &self.project.scene;
        let light = |side: usize| {
            let (_, settings, gain) = self.project.behind(side, view);
            BackdropLight {
                map_from_asset: settings.map_from_asset(up),
                gain: settings.gain().map(|g| g * gain),
            }
        };
        let (center, axes, half_edge) = self.project.ground_plane()?;
        let ready = |side: usize| {
            let shown = self.project.backdrops[side].made_from();
            let (light, settings, _) = self.project.behind(side, view);
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
            Background::Backplate if self.project.plate.current().is_none() => {
                Background::Color([0.25; 3])
            }
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
                graded: [SOURCE, TARGET].map(|side| self.project.graded_by(side, view)),
                false_color: scene.false_color,
                background,
                plate: self.project.plate.get().copied().unwrap_or([1; 2]),
                lights: [light(SOURCE), light(TARGET)],
                ground: GroundPlane {
                    center,
                    axes,
                    half: half_edge,
                    catches: scene.shadow_catcher && self.project.ground_lit.get().is_some(),
                    grid: self.overlays.grid.then(|| grid_spacing(bounds.radius)),
                },
                bounds,
                depth_unit: 1.0,
            },
            against_pinned: self.project.compared().is_some(),
            marks: self.overlays.marks,
            pixel_step: 1,
            objects: scene
                .objects
                .iter()
                .zip(&self.project.states)
                .map(placement)
                .collect(),
        })
    }
}

/// Place and visibility of an object.
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
