//! Layout of the window: menus, panels, light library, viewport, status.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use eframe::egui::{self, Key, Ui};

use super::app::{STORAGE_KEY, Viewer};
use super::files::ask;
use super::history;
use super::light_library;
use super::mode_chips;
use super::panels;
use super::session::Dialog;
use super::tabs::{LightPage, Tab};
use super::timeline;

/// Interval at which work and settings are saved.
const KEEPS_AFTER: Duration = Duration::from_secs(5);

impl eframe::App for Viewer {
    fn logic(&mut self, context: &egui::Context, _frame: &mut eframe::Frame) {
        self.check_device(context);
        self.open_dropped(context);
        self.add_next();
        self.fit_screen(context);
        self.keys(context);
        self.timeline.play(context, &mut self.session);
        self.session.image_folder = PathBuf::from(&self.preferences.export.folder);
        for event in self.session.update() {
            self.deal_with(context, event);
        }
        // What is to be computed has been started: all that is settled is as it is set.
        self.is_stopped = self.session.project.is_stopped(self.session.selected);
        if !self.viewport.is_dragging() {
            self.pictures.draw(context, &self.session);
        }
        self.decide_on_quitting(context);
        if std::mem::take(&mut self.light_library.wants_files) {
            ask(&mut self.session, Dialog::Open);
        }
        let time = context.input(|i| i.time);
        // While a splat is loading, its look is still to come; and a drag is one step.
        let is_comparing = self.session.project.comparing.is_some();
        let is_between = self.session.project.is_loading_asset() || self.viewport.is_dragging();
        let is_between = is_between || self.timeline.is_moving();
        if !is_between && !is_comparing {
            let scene = self.session.project.scene_as_step();
            if !scene.animation.keys.is_empty() {
                self.history.went_to(self.timeline.time(), &scene);
            }
            self.history.feed(time, &scene);
            // That is seen only when there is a frame.
            if self.history.is_in_flux() {
                context.request_repaint_after_secs(history::STEP_S as f32 + 0.05);
            }
        }
        // What was done is kept when there is a frame, too.
        if context.input(|i| !i.events.is_empty()) {
            self.keeps_at = Some(Instant::now() + KEEPS_AFTER + Duration::from_secs(1));
        }
        // A frame that comes before forgets what was asked for.
        match self
            .keeps_at
            .map(|at| at.saturating_duration_since(Instant::now()))
        {
            Some(Duration::ZERO) => self.keeps_at = None,
            Some(left) => context.request_repaint_after(left),
            None => {}
        }
        self.follow_document();
        self.store_lights();
        self.remember_opened();
        let title = self.document_title();
        if self.title != title {
            context.send_viewport_cmd(egui::ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        // What a narrow window with large text has no room for is scrolled to.
        let in_a_row = egui::ScrollArea::horizontal;
        egui::Panel::top("menus").show(ui, |ui| {
            in_a_row().show(ui, |ui| self.menus(ui));
        });
        egui::Panel::bottom("status").show(ui, |ui| {
            in_a_row().show(ui, |ui| self.status(ui));
        });
        egui::Panel::bottom("shelf")
            .exact_size(light_library::HEIGHT)
            .show(ui, |ui| {
                (self.light_library).show(ui, &mut self.session, &self.pictures);
            });
        if self.timeline.is_shown {
            egui::Panel::bottom("timeline")
                .exact_size(timeline::HEIGHT)
                .show(ui, |ui| self.timeline.show(ui, &mut self.session));
        }
        // Asked for by what is shown below.
        self.session.project.requested.confidence = false;
        if self.shown.panels {
            egui::Panel::right("panels")
                .default_size(324.0)
                .size_range(300.0..=480.0)
                .show(ui, |ui| panels::show(ui, self));
        }
        let hold_before = !ui.ctx().text_edit_focused()
            && ui.input(|i| i.key_down(Key::B) && !i.modifiers.command);
        let overlays = &mut self.session.overlays;
        let has_light_page = self.shown.panels && self.preferences.tab == Tab::Light;
        let page = has_light_page.then_some(self.shown.light);
        overlays.lights = page == Some(LightPage::Lights) && overlays.light_handles;
        overlays.capture_light = page == Some(LightPage::CapturedUnder);
        let placing = &mut self.viewport.placing;
        *placing = placing.filter(|way| Some(way.page()) == page);
        egui::CentralPanel::no_frame().show(ui, |ui| {
            self.viewport.navigation = self.preferences.navigation;
            if self.question.is_some() || self.shown.path_field.is_some() {
                self.viewport.end_transform();
            }
            self.viewport.show(ui, &mut self.session, hold_before);
        });
        let context = ui.ctx().clone();
        self.light_probes(&context);
        self.hint(&context);
        self.empty_scene(&context);
        mode_chips::show(&context, self.viewport.rect, &mut self.session);
        self.jobs_and_messages(&context);
        self.path_window(&context);
        self.answer_question(&context);
        self.quit_window(&context);
        self.preview_window(&context);
        self.sheet_of_shortcuts(&context);
        self.drop_hint(&context);
    }

    /// A program that is stopped from outside loses no more than that.
    fn auto_save_interval(&self) -> Duration {
        KEEPS_AFTER
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        // Settings of one command line are for once.
        if !self.settings_for_once {
            self.preferences.keep(&self.session.project.scene);
        }
        self.keep_work();
        self.preferences.grid = self.session.overlays.grid;
        let absent = self.light_library.absent.iter();
        self.preferences.light_library = Some(
            self.light_library
                .paths
                .iter()
                .chain(absent)
                .cloned()
                .collect(),
        );
        if let Ok(text) = serde_json::to_string(&self.preferences) {
            storage.set_string(STORAGE_KEY, text);
        }
    }
}
