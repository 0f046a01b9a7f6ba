//! Annotations over the image: names of the sides, legends, the crop box.

use eframe::egui::{self, Align2, Color32, Painter, Pos2, Rect, Shape, Stroke, Ui};
use glam::Vec3;
use transplat_core::camera::Camera;
use transplat_core::present::{
    FALSE_COLORS, LowConfidence, NO_DOUBT, View, emission_color, tau_colors,
};

use super::projection::Screen;
use super::session::Session;
use transplat_engine::language::{tr, tr_format};

/// Height of a legend's line in points.
const LEGEND_LINE: f32 = 18.0;

/// Width of a legend in points.
const LEGEND_WIDTH: f32 = 250.0;

/// Ends of the capture light's arrow, in radii of the object from its middle.
const ARROW: [f32; 2] = [1.35, 0.85];

/// Points between the capture light's arrow and the edge of the image, and its colour.
const MARGIN: f32 = 34.0;
const SUNNY: Color32 = Color32::from_rgb(255, 200, 120);

/// Names the sides of a comparison, and explains colours that are none of light.
pub fn annotate(ui: &Ui, rect: Rect, session: &Session, view: View) {
    let painter = ui.painter_at(rect);
    name_sides(&painter, rect, session, view);
    if let Some(why) = session.project.not_final(view) {
        let below = egui::pos2(rect.center().x, rect.top() + 38.0);
        tag(&painter, below, Align2::CENTER_TOP, why);
    }
    let entries = legend(session, view);
    if !entries.is_empty() {
        draw_legend(&painter, rect, &entries);
    }
}

fn name_sides(painter: &Painter, rect: Rect, session: &Session, view: View) {
    let [left, right] = if session.project.compared().is_some() {
        [tr("pinned look"), tr("this look")]
    } else {
        [tr("before"), tr("after")]
    };
    let (top, margin) = (rect.top() + 14.0, 14.0);
    let at = |share: f32| egui::pos2(rect.left() + share * rect.width(), top);
    match view {
        View::Split => {
            let x = at(session.project.scene.wipe).x;
            let sides = [
                (x - margin, Align2::RIGHT_TOP, left),
                (x + margin, Align2::LEFT_TOP, right),
            ];
            for (x, anchor, name) in sides {
                tag(painter, egui::pos2(x, top), anchor, name);
            }
            let handle = egui::pos2(x, rect.center().y);
            let rim = Stroke::new(1.5, Color32::from_gray(60));
            painter.circle(handle, 7.0, Color32::from_gray(230), rim);
        }
        View::SideBySide => {
            tag(painter, at(0.25), Align2::CENTER_TOP, left);
            tag(painter, at(0.75), Align2::CENTER_TOP, right);
        }
        View::Before => tag(
            painter,
            at(0.5),
            Align2::CENTER_TOP,
            tr("before: as captured"),
        ),
        View::Difference => {
            let text = tr_format!(
                "{right} minus {left}, x {difference_scale:.1}",
                difference_scale = session.project.scene.difference_scale,
                right = right,
                left = left
            );
            tag(painter, at(0.5), Align2::CENTER_TOP, &text);
        }
        _ => {}
    }
}

/// A text on a plate.
pub fn tag(painter: &Painter, at: Pos2, anchor: Align2, text: &str) {
    let font = egui::FontId::proportional(13.0);
    let galley = painter.layout_no_wrap(text.to_owned(), font, Color32::WHITE);
    let rect = anchor.anchor_size(at, galley.size());
    let shade = Color32::from_black_alpha(140);
    painter.rect_filled(rect.expand2(egui::vec2(6.0, 3.0)), 4.0, shade);
    painter.galley(rect.min, galley, Color32::WHITE);
}

/// Colours with what they stand for, from the top.
fn legend(session: &Session, view: View) -> Vec<(Color32, String)> {
    if view == View::Tau {
        let stops = [-3.0f32, -1.5, 0.0, 1.5, 3.0];
        let colors = tau_colors(&stops.map(|s| [s.exp2(); 3]));
        let entry = |(s, c): (f32, _)| {
            (
                encoded(c),
                tr_format!("{s:+.1} stops by the new light", s = s),
            )
        };
        return stops.into_iter().zip(colors).map(entry).collect();
    }
    if view == View::Emission {
        let entry = |(share, text): (f32, &str)| (encoded(emission_color(share)), text.into());
        let entries = [
            (1.0, tr("emits light")),
            (0.5, tr("half")),
            (0.0, tr("is lit")),
        ];
        return entries.map(entry).into();
    }
    if view == View::Confidence || session.overlays.marks {
        let confidence = session.state().confidence.get();
        let shares = confidence.map(|d| d.shares).unwrap_or_default();
        let entry = |(low_confidence, share): (&LowConfidence, f32)| {
            let text = format!(
                "{} ({:.1} %)",
                low_confidence_name(*low_confidence),
                100.0 * share
            );
            (encoded(low_confidence.color()), text)
        };
        let mut entries: Vec<_> = LowConfidence::ALL.iter().zip(shares).map(entry).collect();
        if view == View::Confidence {
            entries.push((encoded(NO_DOUBT), tr("high confidence").into()));
        }
        return entries;
    }
    if session.project.scene.false_color && view.is_light() {
        let bounds = FALSE_COLORS.map(|(to, _)| to);
        let text = |i: usize| match i {
            0 => tr_format!("under {:+.1} stops from middle grey", bounds[0]),
            _ if bounds[i].is_finite() => tr_format!("{:+.1} to {:+.1}", bounds[i - 1], bounds[i]),
            _ => tr_format!("over {:+.1}", bounds[i - 1]),
        };
        let entries = FALSE_COLORS.iter().enumerate();
        return entries
            .map(|(i, (_, color))| (encoded(*color), text(i)))
            .collect();
    }
    Vec::new()
}

fn draw_legend(painter: &Painter, viewport: Rect, entries: &[(Color32, String)]) {
    let size = egui::vec2(LEGEND_WIDTH, LEGEND_LINE * entries.len() as f32 + 10.0);
    let corner = viewport.left_bottom() + egui::vec2(12.0, -12.0 - size.y);
    let rect = Rect::from_min_size(corner, size);
    painter.rect_filled(rect, 4.0, Color32::from_black_alpha(150));
    for (i, (color, text)) in entries.iter().enumerate() {
        let line = rect.min + egui::vec2(6.0, 5.0 + LEGEND_LINE * i as f32);
        let swatch = Rect::from_min_size(line + egui::vec2(0.0, 3.0), egui::vec2(12.0, 12.0));
        painter.rect_filled(swatch, 2.0, *color);
        let font = egui::FontId::proportional(12.0);
        let at = line + egui::vec2(20.0, LEGEND_LINE / 2.0);
        painter.text(at, Align2::LEFT_CENTER, text, font, Color32::WHITE);
    }
}

fn encoded(color: [f32; 3]) -> Color32 {
    let [r, g, b] = color.map(|v| (v * 255.0) as u8);
    Color32::from_rgb(r, g, b)
}

/// The crop box, where one is set.
pub fn draw_crop_box(ui: &Ui, rect: Rect, session: &Session, camera: &Camera) {
    let hide = &session.object().hide;
    let (Some(asset), true) = (session.asset(), hide.crop) else {
        return;
    };
    let scene_from_object = session.object().transform.scene_from_object();
    let ends = [hide.crop_min, hide.crop_max];
    let corner = |i: usize| {
        let pick = |axis: usize| ends[i >> axis & 1][axis];
        let offset = Vec3::new(pick(0), pick(1), pick(2)) * asset.bounds.radius;
        let place = scene_from_object.transform_point3(asset.bounds.center + offset);
        let ([x, y], depth) = camera.project(place);
        (depth > camera.near).then(|| rect.min + egui::vec2(x, y))
    };
    let painter = ui.painter_at(rect);
    let stroke = Stroke::new(1.0, Color32::from_rgb(240, 200, 80));
    for i in 0..8usize {
        for j in [1, 2, 4].map(|axis| i | axis) {
            if j != i
                && let (Some(a), Some(b)) = (corner(i), corner(j))
            {
                painter.line_segment([a, b], stroke);
            }
        }
    }
}

/// Arrow at the selected object from where the brightest part of its capture light shone.
pub fn draw_capture_light(ui: &Ui, session: &Session, screen: Screen<'_>) {
    let toward = session.project.brightest_of_capture(session.selected);
    let is_shown = session.overlays.capture_light && session.object().shown;
    let (Some(asset), Some(toward), true) = (session.asset(), toward, is_shown) else {
        return;
    };
    let place = session.object().transform.scene_from_object();
    let bounds = asset.bounds.transformed(place);
    let ends = ARROW.map(|radii| screen.at(bounds.center + radii * bounds.radius * toward));
    let [Some(tail), Some(tip)] = ends else {
        return;
    };
    // As much of it as the image has room for.
    let inside = screen.part.shrink(MARGIN);
    let from_tip = tail - tip;
    let fits = |share: &f32| inside.contains(tip + *share * from_tip);
    let shares = (1..=20).rev().map(|i| i as f32 / 20.0);
    let Some(tail) = shares.into_iter().find(fits).map(|s| tip + s * from_tip) else {
        return;
    };
    let painter = ui.painter_at(screen.part);
    painter.line_segment([tail, tip], Stroke::new(2.0, SUNNY));
    let (back, side) = (
        12.0 * from_tip.normalized(),
        5.0 * from_tip.normalized().rot90(),
    );
    let head = vec![tip, tip + back + side, tip + back - side];
    painter.add(Shape::convex_polygon(head, SUNNY, Stroke::NONE));
    painter.circle_filled(tail, 5.0, SUNNY);
    let (anchor, aside) = match tail.x < inside.center().x {
        true => (Align2::RIGHT_CENTER, -14.0),
        false => (Align2::LEFT_CENTER, 14.0),
    };
    tag(
        &painter,
        tail + egui::vec2(aside, 0.0),
        anchor,
        tr("capture light"),
    );
}

/// A ring around the surfel that is inspected.
pub fn mark_surfel(ui: &Ui, rect: Rect, session: &Session, camera: &Camera, surfel: Option<usize>) {
    let scene_from_object = session.object().transform.scene_from_object();
    let position = |i: usize| {
        let own = *session.asset()?.cloud.positions.get(i)?;
        Some(scene_from_object.transform_point3(own))
    };
    let Some(position) = surfel.and_then(position) else {
        return;
    };
    let ([x, y], depth) = camera.project(position);
    if depth > camera.near {
        let at = rect.min + egui::vec2(x, y);
        let painter = ui.painter_at(rect);
        painter.circle_stroke(at, 7.0, Stroke::new(3.0, Color32::from_black_alpha(160)));
        painter.circle_stroke(at, 7.0, Stroke::new(1.5, Color32::WHITE));
    }
}

/// A doubt's name for the user.
pub fn low_confidence_name(low_confidence: LowConfidence) -> &'static str {
    match low_confidence {
        LowConfidence::LeftOut => tr("hidden: invalid or nearly transparent"),
        LowConfidence::DarkSource => tr("dark in the capture light"),
        LowConfidence::Clipped => tr("clipped in the capture"),
        LowConfidence::AtLimit => tr("ratio beyond 3 stops"),
        LowConfidence::AmbiguousNormal => tr("uncertain normal orientation"),
    }
}
