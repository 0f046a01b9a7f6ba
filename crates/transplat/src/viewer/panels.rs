//! The panels on the right: one a stage of the pipeline.

mod asset;
mod export;
mod light;
mod objects;
mod report;
mod transfer;
mod view;

use eframe::egui::{self, Ui};

pub use view::frame;

use super::app::Viewer;
use super::session::{SOURCE, TARGET};

/// All panels, each to be folded.
pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    // What is left beside a control's name and number.
    ui.spacing_mut().slider_width = (ui.available_width() - 204.0).clamp(80.0, 260.0);
    egui::ScrollArea::vertical()
        .auto_shrink([false, false])
        .show(ui, |ui| {
            panel(ui, "Objects", false, |ui| objects::show(ui, viewer));
            panel(ui, "Asset", true, |ui| asset::show(ui, viewer));
            panel(ui, "Source light", false, |ui| {
                light::show(ui, viewer, SOURCE)
            });
            panel(ui, "Target light", true, |ui| {
                light::show(ui, viewer, TARGET)
            });
            panel(ui, "Transfer", true, |ui| transfer::show(ui, viewer));
            panel(ui, "View", false, |ui| view::show(ui, viewer));
            panel(ui, "Export", false, |ui| export::show(ui, viewer));
            panel(ui, "Report", false, |ui| report::show(ui, viewer));
            ui.add_space(20.0);
        });
}

fn panel(ui: &mut Ui, title: &str, open: bool, contents: impl FnOnce(&mut Ui)) {
    egui::CollapsingHeader::new(egui::RichText::new(title).strong())
        .id_salt(title)
        .default_open(open)
        .show(ui, |ui| {
            ui.push_id(title, contents);
        });
}
