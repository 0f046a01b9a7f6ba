//! Handles of placed lights: position, target, distance and size.

mod view;

use std::f32::consts::TAU;

use eframe::egui::{Color32, CursorIcon, Painter, Pos2, Response, Shape, Stroke, Ui, Vec2};
use glam::DVec3;
use transplat_core::color::Display;
use transplat_core::scene::{Light, LightSource};

use super::projection::{HELD, Screen};
use super::session::Session;
use view::{LightDrag, LightHandle, LightHandleView};

/// Points of a light's own handle.
const BULB: f32 = 8.0;

/// Corners of a circle.
const CORNERS: usize = 40;

/// The drag of a light's handle that begins at a point of the window.
fn held(
    session: &Session,
    view: &LightHandleView<'_>,
    handle: LightHandle,
    number: usize,
    at: Pos2,
) -> Option<LightDrag> {
    let from = session.project.scene.lights[number].clone();
    let pointer = view.screen.inside(at);
    let held = view.point(view.held(handle, &from)?).unwrap_or(at);
    Some(LightDrag {
        handle,
        at: number,
        pointer,
        off: view.screen.inside(held) - pointer,
        side: view.side(&from.source),
        from,
    })
}

/// The handles as they are held.
#[derive(Default)]
pub struct LightHandles {
    drag: Option<LightDrag>,
}

impl LightHandles {
    /// Takes hold of the handle at a point of the window, and chooses its light; whether there is one.
    pub fn hold(&mut self, session: &mut Session, at: Pos2, screen: Screen<'_>) -> bool {
        let found = view(session, screen).and_then(|view| {
            let chosen = session.chosen_light();
            let handle = view.handle_at((&session.project.scene.lights, chosen), at)?;
            let number = match handle {
                LightHandle::Around(number) => number,
                _ => chosen?,
            };
            held(session, &view, handle, number, at)
        });
        if let Some(drag) = &found {
            session.selected_light = drag.at;
        }
        self.drag = found;
        self.drag.is_some()
    }

    /// Takes hold of the chosen light where the pointer is; whether there is one.
    pub fn hold_light(&mut self, session: &Session, at: Pos2, screen: Screen<'_>) -> bool {
        self.drag = view(session, screen).and_then(|view| {
            let number = session.chosen_light()?;
            held(session, &view, LightHandle::Around(number), number, at)
        });
        self.drag.is_some()
    }

    /// Puts what is held back to where it was taken.
    pub fn cancel(&mut self, session: &mut Session) {
        if let Some(drag) = self.drag.take()
            && let Some(light) = session.project.scene.lights.get_mut(drag.at)
            && light.source.kind() == drag.from.source.kind()
        {
            light.source = drag.from.source;
        }
    }

    /// Pulls what is held to a point of the window.
    pub fn drag(&mut self, session: &mut Session, to: Pos2, screen: Screen<'_>) {
        let Some(drag) = &self.drag else {
            return;
        };
        let made = view(session, screen).and_then(|view| view.dragged(drag, screen.inside(to)));
        if let (Some(made), Some(light)) = (made, session.project.scene.lights.get_mut(drag.at)) {
            // It may be one that was put there meanwhile.
            if light.source.kind() == made.source.kind() {
                light.source = made.source;
            }
        }
    }

    /// Lets go.
    pub fn let_go(&mut self) {
        self.drag = None;
    }

    /// Draws the handles over the picture.
    pub fn draw(&self, ui: &Ui, session: &Session, response: &Response, screen: Screen<'_>) {
        let Some(view) = view(session, screen) else {
            return;
        };
        let painter = ui.painter_at(screen.part);
        let hovered = response.hover_pos();
        let lights = (&session.project.scene.lights[..], session.chosen_light());
        let hovered = hovered.and_then(|at| view.handle_at(lights, at));
        if hovered.is_some() && self.drag.is_none() {
            ui.set_cursor_icon(CursorIcon::Grab);
        }
        let active = self.drag.as_ref().map(|drag| drag.handle).or(hovered);
        for (at, light) in session.project.scene.lights.iter().enumerate() {
            let is_chosen = session.chosen_light() == Some(at);
            draw(&painter, &view, (at, light), is_chosen, active);
        }
    }
}

/// Where the handles are; none where they are not shown.
fn view<'a>(session: &Session, screen: Screen<'a>) -> Option<LightHandleView<'a>> {
    session.overlays.lights.then(|| LightHandleView {
        screen,
        lit: session.lit(),
        scene_from_world: session.project.world_from_scene().transpose(),
    })
}

/// A light's colour as strong as a screen shows it.
pub fn color_of(light: &Light) -> Color32 {
    let (emission, gain) = (light.source.emission(), light.gain());
    let colored: [f32; 3] = std::array::from_fn(|c| emission[c] * gain[c]);
    let most = colored.iter().copied().fold(0.0, f32::max);
    if !(most > 0.0 && most.is_finite()) {
        return Color32::from_gray(90);
    }
    super::probes::color(Display::default().encode(colored.map(|c| c / most)))
}

fn draw(
    painter: &Painter,
    view: &LightHandleView<'_>,
    (at, light): (usize, &Light),
    is_chosen: bool,
    active: Option<LightHandle>,
) {
    let source = &light.source;
    let color = color_of(light);
    let faint = if light.on { 0.9 } else { 0.3 };
    let line = |handle: LightHandle| match active == Some(handle) {
        true => Stroke::new(3.0, HELD),
        false => Stroke::new(1.5, color.gamma_multiply(faint)),
    };
    let place = view.place(source);
    let own = line(LightHandle::Around(at));
    let shape = |corners: Vec<DVec3>, stroke| {
        let corners: Vec<_> = corners.into_iter().map(|p| view.point(p)).collect();
        for (i, a) in corners.iter().enumerate() {
            if let (Some(a), Some(b)) = (a, corners[(i + 1) % corners.len()]) {
                painter.line_segment([*a, b], stroke);
            }
        }
    };
    match source {
        LightSource::Rect { center, edges, .. } => {
            let [u, v] = edges.map(|e| 0.5 * e);
            let corners = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
            let corners = corners.map(|[a, b]| *center + a * u + b * v);
            shape(corners.to_vec(), own);
        }
        LightSource::Disc {
            center,
            radius,
            normal,
            ..
        } => shape(circle(*center, *radius, *normal), own),
        LightSource::Spot {
            direction,
            cutoff_deg,
            ..
        } if is_chosen => {
            let aim = source.aim(view.lit.center);
            let wide = cutoff_deg.min(85.0).to_radians().tan() * place.distance(aim);
            let rim = circle(aim, wide, *direction);
            let thin = Stroke::new(1.0, own.color.gamma_multiply(0.6));
            for corner in rim.iter().step_by(CORNERS / 4) {
                if let (Some(a), Some(b)) = (view.point(place), view.point(*corner)) {
                    painter.line_segment([a, b], thin);
                }
            }
            shape(rim, thin);
        }
        _ => {}
    }
    let (here, is_away) = view.bulb(source);
    let aim = source
        .direction()
        .and(view.point(source.aim(view.lit.center)));
    if let Some(aim) = aim.filter(|_| is_chosen) {
        let thin = Stroke::new(1.0, own.color.gamma_multiply(0.6));
        painter.line_segment([here, aim], thin);
        if is_chosen && source.position().is_some() {
            let stroke = line(LightHandle::Aim);
            let arm = 6.0;
            for [x, y] in [[arm, 0.0], [0.0, arm]] {
                let arm = Vec2::new(x, y);
                painter.line_segment([aim - arm, aim + arm], stroke);
            }
        }
    }
    if is_chosen {
        if let Some(away) = view.away(source) {
            let stroke = line(LightHandle::Away);
            painter.line_segment([here, away], Stroke::new(1.0, stroke.color));
            let head = (away - here).normalized();
            let side = 5.0 * head.rot90();
            painter.line_segment([away - 4.0 * head + side, away + 4.0 * head], stroke);
            painter.line_segment([away - 4.0 * head - side, away + 4.0 * head], stroke);
        }
        if let Some(rim) = view.rim(source).and_then(|rim| view.point(rim)) {
            let stroke = line(LightHandle::Size);
            painter.circle(rim, 4.0, Color32::from_black_alpha(120), stroke);
        }
    }
    let rim = if is_chosen {
        Stroke::new(2.5, HELD)
    } else {
        Stroke::new(1.5, Color32::from_black_alpha(180))
    };
    painter.circle(here, BULB, color.gamma_multiply(faint), rim);
    if is_away {
        let (out, side) = ((here - view.screen.part.center()).normalized(), 5.0);
        let tip = here + (BULB + 8.0) * out;
        let foot = here + (BULB + 2.0) * out;
        let corners = vec![tip, foot + side * out.rot90(), foot - side * out.rot90()];
        painter.add(Shape::convex_polygon(corners, own.color, Stroke::NONE));
    } else if source.position().is_none() {
        // Rays, for one that is the sun.
        for i in 0..8 {
            let out = Vec2::angled(TAU * i as f32 / 8.0);
            let ends = [here + (BULB + 2.0) * out, here + (BULB + 6.0) * out];
            painter.line_segment(ends, own);
        }
    }
}

fn circle(center: DVec3, radius: f64, normal: DVec3) -> Vec<DVec3> {
    let (u, v) = normal.any_orthonormal_pair();
    let corner = |i: usize| {
        let (sin, cos) = (f64::from(TAU) * i as f64 / CORNERS as f64).sin_cos();
        center + radius * (cos * u + sin * v)
    };
    (0..CORNERS).map(corner).collect()
}
