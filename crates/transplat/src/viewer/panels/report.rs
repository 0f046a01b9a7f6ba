//! What ran, how long it took, and what was left out.

use eframe::egui::{self, Ui};

use crate::report::milliseconds;
use crate::viewer::app::Viewer;
use crate::viewer::widgets::{fact, thousands};

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let session = &viewer.session;
    let passes = session.passes();
    let stages = session.stages;
    egui::Grid::new("stages")
        .num_columns(3)
        .striped(true)
        .show(ui, |ui| {
            ui.strong("stage");
            ui.strong("ran");
            ui.strong("last");
            ui.end_row();
            let load = session.asset.as_ref().map(|a| a.load_ms);
            let rows = [
                ("load", stages.load, load),
                ("project environment", stages.project_environment, None),
                (
                    "bake visibility",
                    stages.bake,
                    session.baked().map(|b| b.ms),
                ),
                ("prepare", stages.prepare, Some(session.times.prepare)),
                ("transfer", passes.transfer, Some(session.transfer_ms())),
                ("sort", passes.sort, None),
                ("project surfels", passes.project, None),
                ("shade", passes.shade, None),
                ("draw", passes.draw, Some(session.frame_timer.ms())),
                ("present", passes.present, None),
            ];
            for (name, ran, ms) in rows {
                ui.label(name);
                ui.label(thousands(ran));
                ui.label(
                    ms.filter(|ms| *ms > 0.0)
                        .map_or(String::new(), milliseconds),
                );
                ui.end_row();
            }
        });
    if let Some(file) = session.baked().and_then(|b| b.file.as_ref()) {
        fact(ui, "bake", file.display().to_string());
    }
    ui.label("Left out");
    let left_out = viewer.left_out();
    if left_out.is_empty() {
        ui.weak("nothing");
    }
    for (what, why) in left_out {
        fact(ui, &what, why);
    }
}
