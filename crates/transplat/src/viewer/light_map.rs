//! Map of the light around the scene: dragged, it rotates the light.

use std::f32::consts::{PI, TAU};

use eframe::egui::{self, Color32, ColorImage, Pos2, Rect, Sense, Stroke, TextureHandle, Ui, pos2};
use glam::{DMat3, Mat3, Vec3};
use transplat_core::color::Display;
use transplat_core::environment::EnvironmentMap;
use transplat_core::scene::EnvironmentLight;
use transplat_core::surfels::UpAxis;

use super::navigation;
use super::probes::{color, image};
use super::session::Session;
use super::widgets::{Grab, named};
use transplat_engine::environments::Environment;
use transplat_engine::language::tr;
use transplat_engine::project::TARGET;

/// Pixels across.
const WIDTH: usize = 256;

/// The picture of one side's light.
#[derive(Default)]
pub struct LightMap {
    shown: Option<(LightMapKey, TextureHandle)>,
    /// Rotation of the light at the press.
    grab: Grab<f64>,
    /// True once it was dragged, and need not be explained.
    is_known: bool,
}

/// All that it depends on; turned, it is shown from another column on.
#[derive(Clone, PartialEq)]
struct LightMapKey {
    light: u64,
    /// Rotation of the unrotated light.
    map_from_world: DMat3,
    gain: [f32; 3],
    without_suns: bool,
}

impl LightMap {
    /// The map, as wide as there is room, and how it lies there.
    fn map(
        &mut self,
        ui: &mut Ui,
        session: &Session,
        side: usize,
    ) -> (MapPlacement, egui::Response) {
        let width = ui.available_width();
        let size = egui::vec2(width, 0.5 * width);
        let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
        named(&response, egui::Role::Image, tr("Map of the light"));
        let light = session.light(side).clone();
        let settings = session.side(side);
        let rotation = settings.rotation;
        let unturned = EnvironmentLight {
            rotation: 0.0,
            ..settings.clone()
        };
        let key = LightMapKey {
            light: light.id,
            map_from_world: unturned.map_from_asset(UpAxis::PlusZ),
            // How strong it is does not show in it.
            gain: settings.tint.map(|t| t * light.thumbnail_gain),
            without_suns: settings.without_suns,
        };
        // Away from the eye, in the map as if it were not turned.
        let ahead = session.project.pose.azimuth + 180.0 - rotation;
        let ahead = across_azimuth((ahead as f32).to_radians());
        let texture = self.texture(ui, (&light, settings), &key);
        paint_turned(ui, rect, texture, ahead - 0.5);
        let placed = MapPlacement {
            rect,
            ahead,
            rotation: (rotation as f32).to_radians(),
            brightest: (light.brightest)
                .filter(|_| !settings.without_suns)
                .map(|d| key.map_from_world.transpose().as_mat3() * d),
        };
        (placed, response)
    }

    /// The map with lights of one's own, each with its colour, the chosen one ringed. Returns the direction of the world that is pointed at with
    /// the button down.
    pub fn show_lights(
        &mut self,
        ui: &mut Ui,
        session: &Session,
        lights: impl Iterator<Item = (Vec3, Color32, bool)>,
    ) -> Option<Vec3> {
        let (placed, response) = self.map(ui, session, TARGET);
        let painter = ui.painter_at(placed.rect);
        for (toward, color, is_chosen) in lights {
            let at = placed.at(toward);
            let rim = Stroke::new(1.5, Color32::from_black_alpha(200));
            painter.circle(at, 4.5, color, rim);
            if is_chosen {
                ring(ui, placed.rect, at);
            }
        }
        let pointed = response.interact_pointer_pos();
        let response = response.on_hover_text(tr("Environment around the object, with placed lights as dots.\n\nClick or drag: light from there."));
        let is_meant = response.is_pointer_button_down_on() || response.clicked();
        let at = pointed.filter(|_| is_meant)?;
        Some(placed.direction(at))
    }

    /// The map. Returns whether it turned the light.
    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, side: usize) -> bool {
        let rotation = session.side(side).rotation;
        let (placed, response) = self.map(ui, session, side);
        let (rect, light) = (placed.rect, session.light(side).clone());
        if let Some(d) = placed.brightest {
            let turn = Mat3::from_rotation_z(placed.rotation);
            ring(ui, rect, placed.at(turn * d));
        }
        let dragged = self.grab.drag(&response, rotation);
        // To the right azimuths fall.
        let mut brought = false;
        let turned = dragged.map(|(then, by)| (then, -by.x / rect.width()));
        if response.double_clicked()
            && let (Some(d), Some(at)) = (light.brightest, response.interact_pointer_pos())
        {
            let wanted = placed.direction(at);
            session
                .side_mut(side)
                .bring(d.as_dvec3(), wanted.as_dvec3());
            brought = true;
        }
        if let Some((from, by)) = turned {
            let rotation = from + 360.0 * f64::from(by);
            session.side_mut(side).rotation = navigation::wrap(rotation);
        }
        // What it says would hide the numbers that change.
        self.is_known |= response.is_pointer_button_down_on();
        let response = response.on_hover_cursor(egui::CursorIcon::ResizeHorizontal);
        if !self.is_known {
            response.on_hover_text(tr("Environment around the object, the view direction in the middle.\n\nDrag: rotate. Double-click: bring the brightest light there."));
        }
        turned.is_some() || brought
    }

    fn texture(
        &mut self,
        ui: &Ui,
        light: (&Environment, &EnvironmentLight),
        key: &LightMapKey,
    ) -> &TextureHandle {
        let kept = self.shown.take().filter(|(k, _)| k == key);
        let draw = || {
            let image = picture(light, key);
            let texture = ui
                .ctx()
                .load_texture("light map", image, egui::TextureOptions::LINEAR);
            (key.clone(), texture)
        };
        &self.shown.insert(kept.unwrap_or_else(draw)).1
    }
}

/// Layout of the map in the window.
struct MapPlacement {
    rect: Rect,
    /// Middle of the map, as a share across the unrotated map.
    ahead: f32,
    /// Rotation of the light, in radians.
    rotation: f32,
    /// Where its brightest is, as if it were not turned.
    brightest: Option<Vec3>,
}

impl MapPlacement {
    /// Where a direction of the world is.
    fn at(&self, d: Vec3) -> Pos2 {
        let across = across_azimuth(d.y.atan2(d.x) - self.rotation);
        let x = (across - self.ahead + 0.5).rem_euclid(1.0);
        let y = d.z.clamp(-1.0, 1.0).acos() / PI;
        self.rect.min + egui::vec2(x, y) * self.rect.size()
    }

    /// The direction of the world that is at a point.
    fn direction(&self, at: Pos2) -> Vec3 {
        let place = (at - self.rect.min) / self.rect.size();
        let azimuth = TAU * (1.0 - self.ahead - place.x) + self.rotation;
        let (sin, cos) = (PI * place.y.clamp(0.0, 1.0)).sin_cos();
        Vec3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos)
    }
}

/// Rings a point of the map.
fn ring(ui: &Ui, rect: Rect, at: Pos2) {
    let painter = ui.painter_at(rect);
    painter.circle_stroke(at, 7.0, Stroke::new(3.0, Color32::from_black_alpha(160)));
    painter.circle_stroke(at, 7.0, Stroke::new(1.5, Color32::WHITE));
}

/// Position of an azimuth across the unrotated map, a whole turn being 1 and azimuth 0 in the middle.
fn across_azimuth(azimuth: f32) -> f32 {
    0.5 - azimuth / TAU
}

fn picture((light, settings): (&Environment, &EnvironmentLight), key: &LightMapKey) -> ColorImage {
    let small = settings.backdrop(&light.small, &light.illumination);
    let map = EnvironmentMap::of_directions(WIDTH, WIDTH / 2, |d| {
        let radiance = small.sample((key.map_from_world * d).as_vec3());
        std::array::from_fn(|c| radiance[c] * key.gain[c])
    });
    let display = Display::default();
    image(&map, |radiance| color(display.encode(radiance)))
}

/// A map that begins so far across itself.
fn paint_turned(ui: &Ui, rect: Rect, texture: &TextureHandle, begin: f32) {
    let begin = begin.rem_euclid(1.0);
    let seam = rect.left() + (1.0 - begin) * rect.width();
    let (mut left, mut right) = (rect, rect);
    left.set_right(seam);
    right.set_left(seam);
    for (part, from, to) in [(left, begin, 1.0), (right, 0.0, begin)] {
        let uv = Rect::from_min_max(pos2(from, 0.0), pos2(to, 1.0));
        ui.painter().image(texture.id(), part, uv, Color32::WHITE);
    }
}
