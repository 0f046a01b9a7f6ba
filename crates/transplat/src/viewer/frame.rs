//! What the viewport shows: the camera, the lights behind the object, the ground, as the settings have them.

use std::sync::Arc;

use transplat_core::camera::Camera;
use transplat_core::ground::GROUND_REACH;
use transplat_core::look::{LightSettings, Look};
use transplat_core::present::{Background, View};
use transplat_gpu::live::Frame;
use transplat_gpu::present::{BackdropLight, GroundPlane, Presentation};

use super::lights::Light;
use super::session::{Pinned, SOURCE, Session, TARGET};
use crate::picture::half;

impl Session {
    /// What a viewport of a size shows with the settings as they are.
    pub fn frame(&self, size: [usize; 2], view: View) -> Option<Frame> {
        let asset = self.asset.as_ref()?;
        let up = self.up();
        let whole = Camera::from_pose(&self.pose, up, size, asset.bounds.radius);
        let camera = if view == View::SideBySide {
            half(&whole)
        } else {
            whole
        };
        let look = &self.look;
        let light = |side: usize| {
            let (_, settings, gain) = self.behind(side, view);
            BackdropLight {
                map_from_asset: settings.map_from_asset(up),
                gain: settings.gain().map(|g| g * gain),
            }
        };
        let (center, axes) = asset.ground;
        let ready = |side: usize| {
            let shown = &self.backdrop_for[side];
            shown
                .as_ref()
                .is_some_and(|k| k.light == self.behind(side, view).0.id)
        };
        let [source, target] = view.backdrops();
        // Until its map is read, an environment behind the object is a plain grey.
        let waits = (source && !ready(SOURCE)) || (target && !ready(TARGET));
        let background = match view.background(look.background) {
            Background::Environment if waits => Background::Color([0.25; 3]),
            other => other,
        };
        Some(Frame {
            presentation: Presentation {
                camera,
                size,
                view,
                wipe: look.wipe,
                difference_scale: look.difference_scale,
                display: look.display,
                false_color: look.false_color,
                background,
                lights: [light(SOURCE), light(TARGET)],
                ground: GroundPlane {
                    center,
                    axes,
                    half: GROUND_REACH * asset.bounds.radius,
                    catches: look.shadow_catcher && self.ground_lit_for.is_some(),
                    grid: self.grid.then(|| grid_spacing(asset.bounds.radius)),
                },
                bounds: asset.bounds,
                depth_unit: 1.0,
            },
            against_pinned: self.against_pinned,
            marks: self.show_marks,
            hidden: (self.hidden.clone(), self.hidden_version),
        })
    }

    /// The light that is seen behind a side, as it is turned, and what it is brought to the source's strength by. Behind a pinned look it
    /// is that look's.
    pub(super) fn behind(&self, side: usize, view: View) -> (&Arc<Light>, &LightSettings, f32) {
        let target_of = |look: &Look, lights: [&Light; 2]| {
            look.match_gain(&lights[0].illumination, &lights[1].illumination)
        };
        if side == SOURCE
            && view.has_two_sides()
            && let Some(Pinned { look, sides }) =
                self.pinned.as_ref().filter(|_| self.against_pinned)
        {
            let [source, target] = sides;
            let gain = target_of(look, [source, target]);
            return (target, &look.target, gain);
        }
        let [source, target] = &self.sides;
        if side == SOURCE {
            return (source, &self.look.source, 1.0);
        }
        let gain = target_of(&self.look, [source, target]);
        (target, &self.look.target, gain)
    }
}

/// A round spacing of the grid, a quarter of the object's radius and more.
fn grid_spacing(radius: f32) -> f32 {
    let raw = radius / 4.0;
    let power = 10f32.powf(raw.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0];
    let step = steps.iter().find(|s| **s * power >= raw).unwrap_or(&10.0);
    step * power
}
