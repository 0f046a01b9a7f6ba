//! Thumbnails of the light library.

use eframe::egui::{self, Color32, Rect, Stroke, TextureHandle, Ui};

use super::widgets::named;

/// Size of a thumbnail in points.
pub const THUMBNAIL: egui::Vec2 = egui::vec2(112.0, 56.0);

/// Room for a name over a thumbnail, in points.
pub const NAME_HEIGHT: f32 = 17.0;

/// A "+" as high as what it adds.
pub fn add_button(ui: &mut Ui, name: &str) -> egui::Response {
    let inside = ui.vertical(|ui| {
        ui.add_space(NAME_HEIGHT);
        let button = egui::Button::new("+").min_size(egui::vec2(44.0, THUMBNAIL.y));
        ui.add(button)
    });
    named(&inside.inner, egui::Role::Button, name);
    inside.inner
}

/// A thumbnail in its frame.
pub fn paint_thumbnail(
    ui: &Ui,
    rect: Rect,
    texture: Option<&TextureHandle>,
    selected: bool,
    hovered: bool,
) {
    let painter = ui.painter();
    match texture {
        Some(texture) => {
            let uv = Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
            painter.image(texture.id(), rect, uv, Color32::WHITE);
        }
        None => {
            painter.rect_filled(rect, 2.0, ui.visuals().extreme_bg_color);
        }
    }
    let stroke = if selected {
        Stroke::new(2.5, ui.visuals().selection.bg_fill)
    } else if hovered {
        Stroke::new(1.5, ui.visuals().text_color())
    } else {
        Stroke::new(1.0, ui.visuals().weak_text_color())
    };
    painter.rect_stroke(rect, 2.0, stroke, egui::StrokeKind::Outside);
}
