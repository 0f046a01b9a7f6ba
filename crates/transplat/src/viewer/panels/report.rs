//! Panel *Report*: confidence, run times, and skipped work.

use eframe::egui::{self, Align, Button, Ui};
use transplat_core::present::LowConfidence;

use crate::viewer::annotations::low_confidence_name;
use crate::viewer::app::Viewer;
use crate::viewer::session::Session;
use crate::viewer::widgets::{fact, thousands};
use transplat_engine::jobs::{Kind, Work};
use transplat_engine::language::{tr, tr_format};
use transplat_engine::words::milliseconds;
use transplat_eval::sweep::{Point, Stage};

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    confidence(ui, &mut viewer.session);
    ui.separator();
    let session = &viewer.session;
    let passes = session.canvas.passes();
    let stages = session.project.stages;
    egui::Grid::new("stages")
        .num_columns(3)
        .striped(true)
        .show(ui, |ui| {
            ui.strong(tr("stage"));
            ui.strong(tr("runs"));
            ui.strong(tr("last session"));
            ui.end_row();
            let load = session.asset().map(|a| a.load_ms);
            let bake = session.baked().map(|b| b.ms);
            let prepare = session.state().prepared.get().map(|p| p.ms);
            let rows = [
                (tr("load"), stages.load, load),
                (tr("project environment"), stages.project_environment, None),
                (tr("bake visibility"), stages.bake, bake),
                (tr("prepare"), stages.prepare, prepare),
                (tr("transfer"), passes.transfer, Some(session.transfer_ms())),
                (tr("sort"), passes.sort, None),
                (tr("project Gaussians"), passes.project, None),
                (tr("shade"), passes.shade, None),
                (
                    tr("draw"),
                    passes.draw,
                    Some(session.canvas.timers.frame.ms()),
                ),
                (tr("present"), passes.present, None),
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
        fact(ui, tr("bake"), file.display().to_string());
    }
    ui.label(tr("Skipped work"));
    let skipped_work = viewer.skipped_work();
    if skipped_work.is_empty() {
        ui.weak(tr("Nothing"));
    }
    for skipped in skipped_work {
        fact(ui, &skipped.what, viewer.skipped_work_in_words(&skipped));
    }
    ui.separator();
    settings(ui, viewer);
    ui.separator();
    extremes(ui, viewer);
}

/// Error against run time of the settings that can be chosen.
fn settings(ui: &mut Ui, viewer: &mut Viewer) {
    let session = &mut viewer.session;
    ui.label(tr("Settings: time and error"));
    let is_running = session
        .jobs
        .is_running(Kind::Of(session.state().id, Work::Measure));
    let can_measure = session.asset().is_some() && !is_running;
    let button = ui.add_enabled(can_measure, Button::new(tr("Measure this object")));
    let button = button.on_hover_text(tr("Measures run time and error of each method, SH degree and term on this object. Takes minutes."));
    if button.clicked() {
        session.measure();
    }
    if session.take_new_measured() {
        ui.scroll_to_cursor(Some(Align::TOP));
    }
    let mut chosen = None;
    let points = || session.measured().into_iter().flat_map(|m| &m.points);
    egui::Grid::new("settings").num_columns(4).striped(true).show(ui, |ui| {
        let offered = |p: &&Point| p.stage == Stage::Transfer && p.setting.is_offered;
        for (i, point) in points().filter(offered).enumerate() {
            if i == 0 {
                ui.strong(tr("setting"));
                ui.strong(tr("new light"));
                ui.strong(tr("PSNR")).on_hover_text(tr("PSNR against the method in 64 bits at full quality, on a thinned object. Do not compare it between methods."));
                ui.end_row();
            }
            let name = if point.setting.is_default {
                tr_format!("{} (default)", point.setting.name)
            } else {
                point.setting.name.clone()
            };
            ui.label(name).on_hover_text(&point.device);
            ui.label(point.time.map_or(String::new(), |t| milliseconds(t.ms)));
            let psnr = point.numeric.and_then(|n| n.psnr);
            ui.label(psnr.map_or(String::new(), |v| tr_format!("{v:.1} dB", v = v)));
            let is_set = session.project.scene.transfer.method == point.setting.settings.method
                && session.project.scene.transfer.terms == point.setting.settings.terms
                && session.project.scene.transfer.sh_degree == point.setting.settings.sh_degree;
            let button = ui.add_enabled(!is_set, Button::new(tr("take")).small());
            let button = button.on_hover_text(if point.on_front {
                tr("No other measured setting is faster and more accurate.")
            } else {
                tr("Another setting is faster and more accurate.")
            });
            if button.clicked() {
                chosen = Some(point.setting.clone());
            }
            ui.end_row();
        }
    });
    if points().next().is_some() {
        ui.weak(tr(
            "PSNR against the same method computed in full, not against the truth.",
        ));
    }
    for line in session.measured().into_iter().flat_map(|m| &m.words) {
        ui.weak(line);
    }
    if let Some(setting) = chosen {
        session.apply_setting(&setting);
    }
}

/// Stiff and extreme cases.
fn extremes(ui: &mut Ui, viewer: &mut Viewer) {
    let session = &mut viewer.session;
    let can_try = !session.jobs.is_running(Kind::Extremes);
    let button = ui.add_enabled(can_try, Button::new(tr("Run extreme cases")));
    let button = button.on_hover_text(tr(
        "Relights extreme scenes and compares with 64-bit results. Takes half a minute.",
    ));
    if button.clicked() {
        session.try_extremes();
    }
    for line in session.extremes.lines() {
        ui.weak(line);
    }
    if !session.extremes.is_empty() {
        ui.weak(tr("Runs extreme lights and geometry with both methods. transplat report --extremes lists them."));
    }
}

/// Reasons for low confidence in the result.
fn confidence(ui: &mut Ui, session: &mut Session) {
    ui.label(tr("Reliability"));
    session.project.requested.confidence = !ui.input(|i| i.pointer.any_down());
    match session.state().confidence.get().map(|d| d.shares) {
        Some(shares) => {
            for (low_confidence, share) in LowConfidence::ALL.iter().zip(shares) {
                fact(
                    ui,
                    low_confidence_name(*low_confidence),
                    format!("{:.1} %", 100.0 * share),
                );
            }
        }
        None => {
            ui.weak(tr("being counted"));
        }
    }
    ui.checkbox(&mut session.overlays.marks, tr("Mark in the image"))
        .on_hover_text(tr("Colours Gaussians of low confidence. (K)"));
}
