//! Menus and the bar above the viewport.

use std::collections::BTreeMap;
use std::path::PathBuf;

use eframe::egui::{self, Ui};
use transplat_core::files::percent_encoded;
use transplat_core::present::View;
use transplat_core::response::CameraResponse;
use transplat_core::scene::{EnvironmentLight, Object, Scene};
use transplat_core::surfels::SurfelFilter;

use super::app::Viewer;
use super::autosave::{Autosave, age_in_words};
use super::document::NextScene;
use super::export::task::Task;
use super::files::{PathField, ask};
use super::gestures::NavigationPreset;
use super::preferences::Preferences;
use super::questions::Question;
use super::session::{Dialog, SaveKind};
use super::shortcuts::{self, Action};
use super::widgets::{button, entry};
use transplat_engine::bundled::{
    BUNDLED_LIGHTS, BUNDLED_SPLAT, BUNDLED_TRAINED_SPLAT, bundled, manual,
};
use transplat_engine::language::{self, tr, tr_format, tr_later};
use transplat_engine::words::of_error;

impl Viewer {
    pub(super) fn menus(&mut self, ui: &mut Ui) {
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button(tr("File"), |ui| self.file_menu(ui));
            ui.menu_button(tr("Edit"), |ui| {
                let scene = self.session.project.scene_as_step().into_owned();
                self.item(ui, tr("Undo"), Action::Undo, self.history.has_undo(&scene));
                self.item(ui, tr("Redo"), Action::Redo, self.history.has_redo(&scene));
                ui.menu_button(tr("History"), |ui| self.history_menu(ui));
                ui.separator();
                let beside = &mut self.preferences.bakes_beside;
                let tip = tr("Saves bakes in the folder of the splat instead of your cache.");
                if ui
                    .checkbox(beside, tr("Bakes beside splats"))
                    .on_hover_text(tip)
                    .changed()
                {
                    self.session.project.bakes_are_beside = *beside;
                }
                if entry(ui, tr("Reset all settings")) {
                    let kept = &self.session.project.scene;
                    let same = |light: &EnvironmentLight| EnvironmentLight {
                        file: light.file.clone(),
                        ..EnvironmentLight::default()
                    };
                    let object = |object: &Object| Object {
                        source: same(&object.source),
                        up: None,
                        response: CameraResponse::default(),
                        outside_from: Vec::new(),
                        hide: SurfelFilter::default(),
                        // What it is, and where it stands, is no setting.
                        ..object.clone()
                    };
                    self.session.project.scene = Scene {
                        objects: kept.objects.iter().map(object).collect(),
                        environment: same(&kept.environment),
                        note: kept.note.clone(),
                        bookmarks: kept.bookmarks.clone(),
                        variants: kept.variants.clone(),
                        ..Preferences::default().scene()
                    };
                }
            });
            ui.menu_button(tr("View"), |ui| self.view_menu(ui));
            ui.menu_button(tr("Help"), |ui| {
                if entry(ui, tr("Manual")) {
                    self.open_manual(ui.ctx());
                }
                self.shown.help |= entry(ui, tr("Shortcuts (?)"));
                self.shown.about |= entry(ui, tr("About"));
            });
            ui.separator();
            self.compare_bar(ui);
        });
    }

    pub(super) fn file_menu(&mut self, ui: &mut Ui) {
        self.item(ui, tr("New"), Action::New, true);
        self.item(ui, tr("Open…"), Action::Open, true);
        self.item(ui, tr("Open folder…"), Action::OpenFolder, true);
        if entry(ui, tr("Open or save by path…")) {
            self.shown.path_field = Some(PathField::new());
        }
        let recent = self.preferences.recent.clone();
        ui.menu_button(tr("Recent"), |ui| {
            if recent.is_empty() {
                ui.weak(tr("No recent files"));
            }
            for path in recent {
                if entry(ui, &path.display().to_string()) {
                    self.open(&path);
                }
            }
        });
        ui.menu_button(tr("Bundled scenes"), |ui| {
            for (name, splat) in [
                (tr("Teapot"), BUNDLED_SPLAT),
                (tr("Breakfast (trained)"), BUNDLED_TRAINED_SPLAT),
            ] {
                if entry(ui, name) {
                    self.replace_scene(NextScene::Bundled(splat));
                }
            }
        });
        ui.separator();
        self.item(ui, tr("Save"), Action::Save, true);
        self.item(ui, tr("Save as…"), Action::SaveAs, true);
        let path = self.document.path.clone();
        let is_changed = self.has_unsaved();
        ui.add_enabled_ui(path.is_some() && is_changed, |ui| {
            if let (true, Some(path)) = (entry(ui, tr("Revert")), path) {
                self.question = Some(Question::Revert(path));
            }
        });
        ui.menu_button(tr("Autosaves"), |ui| {
            let autosaves = self.autosaves();
            if autosaves.is_empty() {
                ui.weak(tr("No autosaves"));
            }
            for Autosave { path, name, age } in autosaves {
                if entry(ui, &format!("{name}, {}", age_in_words(age))) {
                    self.replace_scene(NextScene::Autosave(path));
                }
            }
        });
        ui.separator();
        for (name, action) in [
            (tr("Export relit splat…"), Action::ExportSplat),
            (tr("Save image"), Action::Screenshot),
            (tr("Copy image"), Action::Copy),
        ] {
            self.item(ui, name, action, true);
        }
        if entry(ui, tr("Save image as…")) {
            let extension = self.preferences.export.format.extension();
            let name = format!("{}.{extension}", self.asset_name());
            ask(&mut self.session, Dialog::Save(SaveKind::Screenshot, name));
        }
        if entry(ui, tr("Save turntable")) {
            self.export(Task::Turntable);
        }
        ui.separator();
        if ui.button(tr("Quit")).clicked() {
            ui.ctx().send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    /// Opens the manual in the browser, and says where it is.
    fn open_manual(&mut self, context: &egui::Context) {
        let Some(page) = manual() else {
            return self.session.error(tr(
                "The manual is not installed. Build it with cargo xtask docs.",
            ));
        };
        let url = format!("file://{}", percent_encoded(&page));
        context.open_url(egui::OpenUrl::new_tab(url));
        let text = tr_format!(
            "The manual opens in the browser: {page}",
            page = page.display()
        );
        self.session.info(text);
    }

    /// Lists the steps of the history, the last first; a click goes back to one.
    fn history_menu(&mut self, ui: &mut Ui) {
        let mut chosen = None;
        egui::ScrollArea::vertical()
            .max_height(360.0)
            .show(ui, |ui| {
                let (steps, at) = self.history.steps();
                for (step, what) in steps.enumerate().rev() {
                    let mut text = egui::RichText::new(what);
                    if step > at {
                        text = text.weak();
                    }
                    if ui.selectable_label(step == at, text).clicked() {
                        chosen = Some(step);
                    }
                }
            });
        let scene = chosen.and_then(|step| self.history.go_to(step).cloned());
        if let Some(scene) = scene {
            self.come_back_to(scene);
            ui.close();
        }
    }

    /// An entry with its shortcut, which does its action.
    fn item(&mut self, ui: &mut Ui, name: &str, action: Action, enabled: bool) {
        let button = egui::Button::new(name).shortcut_text(shortcuts::of(action));
        if ui.add_enabled(enabled, button).clicked() {
            self.act(action, false);
            ui.close();
        }
    }

    pub(super) fn bundled_scene(&mut self, splat: &str) {
        let Some(splat) = bundled(splat) else {
            self.session
                .error(tr("The bundled scene is not installed."));
            return;
        };
        let mut scene = self.preferences.scene();
        let lights: Vec<PathBuf> = BUNDLED_LIGHTS.iter().filter_map(|n| bundled(n)).collect();
        scene.objects[0].source.file = lights.first().cloned();
        scene.environment.file = lights.get(1).cloned();
        scene.objects[0].asset = Some(splat);
        for path in &lights {
            self.light_library.add(&mut self.session, path);
        }
        self.session.project.open_scene(scene);
    }

    fn language_menu(&mut self, ui: &mut Ui) {
        let found = languages().into_keys().map(Some);
        for language in std::iter::once(None).chain(found) {
            let is_spoken = self.preferences.language == language;
            let name = language.as_deref().unwrap_or("English");
            if ui.radio(is_spoken, name).clicked() {
                self.speak(language);
                ui.close();
            }
        }
        if let Some(own) = language::own_folder() {
            let own = own.display();
            let text = tr_format!("Add translations (.po) in {folder}", folder = own);
            ui.weak(text);
        }
    }

    /// Speaks a language from here on; one that cannot be read is told, and the last one is spoken.
    pub(super) fn speak(&mut self, language: Option<String>) {
        let file = language.as_ref().and_then(|name| languages().remove(name));
        if file.is_none() && language.is_some() {
            // It was there at the last start.
            return;
        }
        match language::speak(file.as_deref()) {
            Ok(()) => self.preferences.language = language,
            Err(error) => self.session.error(of_error(&error)),
        }
    }

    pub(super) fn view_menu(&mut self, ui: &mut Ui) {
        ui.menu_button(tr("Theme"), |ui| {
            for (name, theme) in [
                (tr("System"), egui::ThemePreference::System),
                (tr("Light theme"), egui::ThemePreference::Light),
                (tr("Dark theme"), egui::ThemePreference::Dark),
            ] {
                let current = ui.ctx().options(|o| o.theme_preference);
                if ui.radio(current == theme, name).clicked() {
                    ui.ctx().set_theme(theme);
                    ui.close();
                }
            }
        });
        ui.menu_button(tr("Text size"), |ui| {
            for percent in [80, 90, 100, 110, 125, 150, 200] {
                let factor = percent as f32 / 100.0;
                let current = (ui.ctx().zoom_factor() - factor).abs() < 0.01;
                if ui.radio(current, format!("{percent} %")).clicked() {
                    ui.ctx().set_zoom_factor(factor);
                    ui.close();
                }
            }
        });
        ui.menu_button(tr("Language"), |ui| self.language_menu(ui));
        ui.menu_button(tr("Navigation"), |ui| {
            for (name, preset) in NavigationPreset::ALL {
                let is_chosen = self.preferences.navigation == preset;
                if ui.radio(is_chosen, name).clicked() {
                    self.preferences.navigation = preset;
                    ui.close();
                }
            }
        });
        ui.separator();
        ui.checkbox(&mut self.shown.panels, tr("Panels"));
        ui.checkbox(&mut self.preferences.probes, tr("Reference balls"));
        ui.checkbox(&mut self.timeline.is_shown, tr("Timeline"));
        ui.checkbox(&mut self.session.overlays.grid, tr("Grid"));
        ui.checkbox(&mut self.session.overlays.marks, tr("Mark low confidence"));
    }

    pub(super) fn compare_bar(&mut self, ui: &mut Ui) {
        let session = &mut self.session;
        for (name, view, tip) in COMPARE {
            let (name, tip) = (tr(name), tr(tip));
            ui.selectable_value(&mut session.project.scene.view, view, name)
                .on_hover_text(tip);
        }
        ui.separator();
        let current = CHANNELS
            .iter()
            .find(|(_, view, _)| *view == session.project.scene.view);
        egui::ComboBox::from_id_salt("channel")
            .selected_text(tr(current.map_or(tr_later("Channel"), |(name, ..)| name)))
            .width(96.0)
            .height(400.0)
            .show_ui(ui, |ui| {
                ui.selectable_value(&mut session.project.scene.view, View::After, tr("Final"));
                for (name, view, tip) in CHANNELS {
                    let (name, tip) = (tr(name), tr(tip));
                    ui.selectable_value(&mut session.project.scene.view, view, name)
                        .on_hover_text(tip);
                }
            })
            .response
            .on_hover_text(tr("Shows one channel of the image, or its inputs."))
            .widget_info(|| egui::WidgetInfo::labeled(egui::Role::ComboBox, true, tr("Channel")));
        ui.separator();
        let tip = tr("Pins the look: comparisons show it in the place of “before”. (P)");
        if button(ui, tr("Pin"), tip) {
            session.project.pin();
        }
        if let Some(pinned) = &mut session.project.pinned {
            ui.checkbox(&mut pinned.is_compared, tr("against pinned"))
                .on_hover_text(tr("Compare with the pinned look instead of the capture."));
            if button(
                ui,
                tr("Swap"),
                tr("Swaps the pinned look with this one. (T)"),
            ) {
                session.project.swap_pinned();
            }
            if ui.button(tr("Unpin")).clicked() {
                session.project.pinned = None;
            }
        }
    }
}

/// Ways to compare: name, view, what it shows.
pub(super) const COMPARE: [(&str, View, &str); 5] = [
    (
        tr_later("After"),
        View::After,
        tr_later("The relit splat. (C: next comparison)"),
    ),
    (
        tr_later("Before"),
        View::Before,
        tr_later("The splat as captured. (hold B)"),
    ),
    (
        tr_later("Split"),
        View::Split,
        tr_later("Before on the left, after on the right. Drag the line."),
    ),
    (
        tr_later("Side by side"),
        View::SideBySide,
        tr_later("Shows both images in full."),
    ),
    (
        tr_later("Difference"),
        View::Difference,
        tr_later("After minus before; grey is no difference. The panel Look sets its scale."),
    ),
];

/// Channels: name, view, what it shows.
pub(super) const CHANNELS: [(&str, View, &str); 9] = [
    (
        tr_later("Diffuse"),
        View::Diffuse,
        tr_later("Diffuse light only."),
    ),
    (
        tr_later("Specular"),
        View::Specular,
        tr_later("Highlights and reflections."),
    ),
    (
        tr_later("Normals"),
        View::Normals,
        tr_later("Normals: red is X, green Y, blue Z."),
    ),
    (
        tr_later("Depth"),
        View::Depth,
        tr_later("Near is white, far is dark."),
    ),
    (
        tr_later("Ambient occlusion"),
        View::Visibility,
        tr_later("Ambient occlusion: black is fully occluded."),
    ),
    (
        tr_later("Albedo"),
        View::Albedo,
        tr_later("Base colour without light."),
    ),
    (
        tr_later("Emission"),
        View::Emission,
        tr_later("Light that surfaces emit. The panel Look sets the threshold."),
    ),
    (
        tr_later("Ratio"),
        View::Tau,
        tr_later("How much brighter or darker the new light is, in stops."),
    ),
    (
        tr_later("Confidence"),
        View::Confidence,
        tr_later("Where the relit colour is uncertain."),
    ),
];

/// The languages that are there, a user's own before those that come with the program.
fn languages() -> BTreeMap<String, PathBuf> {
    let folders = bundled("languages")
        .into_iter()
        .chain(language::own_folder());
    language::languages(folders)
}
