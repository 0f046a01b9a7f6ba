//! Panels on the right, a tab each.

mod asset;
mod camera;
mod export;
mod light;
mod lights;
mod look;
mod objects;
mod report;
mod transfer;

use eframe::egui::{self, Align2, Sense, Ui};

use super::app::Viewer;
use super::style;
use super::tabs::{TABS, Tab};
use transplat_engine::language::tr;

/// The tabs, and what the chosen one has.
pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    tabs(ui, &mut viewer.preferences.tab);
    ui.separator();
    // What is left beside a control's name and number.
    ui.spacing_mut().slider_width =
        (ui.available_width() - style::NAME_WIDTH - style::NUMBER_WIDTH).clamp(80.0, 260.0);
    egui::ScrollArea::vertical()
        .id_salt(viewer.preferences.tab as usize)
        .auto_shrink([false, false])
        .show(ui, |ui| {
            match viewer.preferences.tab {
                Tab::Light => light::show(ui, viewer),
                Tab::Look => look::show(ui, viewer),
                Tab::Camera => camera::show(ui, viewer),
                Tab::Asset => {
                    objects::show(ui, viewer);
                    ui.separator();
                    asset::show(ui, viewer);
                }
                Tab::Export => export::show(ui, viewer),
                Tab::Report => report::show(ui, viewer),
            }
            ui.add_space(20.0);
        });
}

/// One beside the other, as wide as there is room, an icon over its name.
fn tabs(ui: &mut Ui, chosen: &mut Tab) {
    ui.add_space(4.0);
    ui.horizontal(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        let gaps = 2.0 * (TABS.len() - 1) as f32;
        let width = (ui.available_width() - gaps) / TABS.len() as f32;
        for (tab, icon, name, tip) in TABS {
            let (name, tip) = (tr(name), tr(tip));
            let size = egui::vec2(width, style::TAB_HEIGHT);
            let (rect, response) = ui.allocate_exact_size(size, Sense::click());
            let is_chosen = *chosen == tab;
            let visuals = ui.style().interact_selectable(&response, is_chosen);
            if is_chosen || response.hovered() || response.has_focus() {
                let fill = if is_chosen {
                    visuals.bg_fill
                } else {
                    visuals.weak_bg_fill
                };
                ui.painter().rect_filled(rect, 4.0, fill);
            }
            let color = visuals.text_color();
            let at = |dy: f32| rect.center() + egui::vec2(0.0, dy);
            let painter = ui.painter();
            let icon = char::from(icon);
            painter.text(at(-8.0), Align2::CENTER_CENTER, icon, style::icon(), color);
            painter.text(at(13.0), Align2::CENTER_CENTER, name, style::small(), color);
            response
                .widget_info(|| egui::WidgetInfo::selected(egui::Role::Tab, true, is_chosen, name));
            if response.on_hover_text(tip).clicked() {
                *chosen = tab;
            }
        }
    });
}
