//! Menus and the bar above the viewport.

use std::path::PathBuf;

use eframe::egui::{self, Ui};
use transplat_core::present::View;
use transplat_core::scene::{EnvironmentLight, Object, Scene};
use transplat_core::surfels::Hide;

use super::app::Viewer;
use super::export::Task;
use super::files::{PathField, ask};
use super::preferences::Preferences;
use super::session::{Dialog, SaveKind};
use super::shortcuts::{self, Action};
use super::widgets::{button, entry};
use crate::bundled::{BUNDLED_LIGHTS, BUNDLED_SPLAT, BUNDLED_TRAINED_SPLAT, bundled};

impl Viewer {
    pub(super) fn menus(&mut self, ui: &mut Ui) {
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| self.file_menu(ui));
            ui.menu_button("Edit", |ui| {
                let scene = self.session.scene.clone();
                self.item(ui, "Undo", Action::Undo, self.history.has_undo(&scene));
                self.item(ui, "Redo", Action::Redo, self.history.has_redo(&scene));
                ui.menu_button("History", |ui| self.history_menu(ui));
                ui.separator();
                if entry(ui, "Reset all settings") {
                    let kept = &self.session.scene;
                    let same = |light: &EnvironmentLight| EnvironmentLight {
                        file: light.file.clone(),
                        ..EnvironmentLight::default()
                    };
                    let object = |object: &Object| Object {
                        source: same(&object.source),
                        up: None,
                        linear: false,
                        outside_from: Vec::new(),
                        hide: Hide::default(),
                        // What it is, and where it stands, is no setting.
                        ..object.clone()
                    };
                    self.session.scene = Scene {
                        objects: kept.objects.iter().map(object).collect(),
                        environment: same(&kept.environment),
                        note: kept.note.clone(),
                        bookmarks: kept.bookmarks.clone(),
                        variants: kept.variants.clone(),
                        ..Preferences::default().scene()
                    };
                }
            });
            ui.menu_button("View", |ui| self.view_menu(ui));
            ui.menu_button("Help", |ui| {
                self.shown.help |= entry(ui, "Shortcuts (?)");
                self.shown.about |= entry(ui, "About");
            });
            ui.separator();
            self.compare_bar(ui);
        });
    }

    pub(super) fn file_menu(&mut self, ui: &mut Ui) {
        self.item(ui, "Open…", Action::Open, true);
        self.item(ui, "Open folder of environments…", Action::OpenFolder, true);
        if entry(ui, "Open or save by path…") {
            self.shown.path_field = Some(PathField::new());
        }
        let recent = self.preferences.recent.clone();
        ui.menu_button("Open recent", |ui| {
            if recent.is_empty() {
                ui.weak("nothing yet");
            }
            for path in recent {
                if entry(ui, &path.display().to_string()) {
                    self.open(&path);
                }
            }
        });
        let before = self.work_aside().filter(|path| path.is_file());
        if let Some(path) = before
            && entry(ui, "Work before this")
        {
            self.open(&path);
        }
        for (name, splat) in [
            ("Bundled scene", BUNDLED_SPLAT),
            ("Bundled scene, trained", BUNDLED_TRAINED_SPLAT),
        ] {
            if entry(ui, name) {
                self.bundled_scene(splat);
            }
        }
        ui.separator();
        for (name, action) in [
            ("Save look…", Action::SaveLook),
            ("Export relit splat…", Action::ExportSplat),
            ("Save picture", Action::Screenshot),
            ("Copy picture", Action::Copy),
        ] {
            self.item(ui, name, action, true);
        }
        if entry(ui, "Save picture as…") {
            let extension = self.preferences.export.format.extension();
            let name = format!("{}.{extension}", self.asset_name());
            ask(&mut self.session, Dialog::Save(SaveKind::Screenshot, name));
        }
        if entry(ui, "Save turntable") {
            self.export(Task::Turntable);
        }
        ui.separator();
        if ui.button("Quit").clicked() {
            ui.ctx().send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    /// What was done, the last first; a click goes back to it.
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

    fn bundled_scene(&mut self, splat: &str) {
        let Some(splat) = bundled(splat) else {
            self.session.error("the bundled scene is not installed");
            return;
        };
        let mut scene = self.preferences.scene();
        let lights: Vec<PathBuf> = BUNDLED_LIGHTS.iter().filter_map(|n| bundled(n)).collect();
        scene.objects[0].source.file = lights.first().cloned();
        scene.environment.file = lights.get(1).cloned();
        scene.objects[0].asset = Some(splat);
        for path in &lights {
            self.shelf.add(&mut self.session, path);
        }
        self.session.open_scene(scene);
    }

    pub(super) fn view_menu(&mut self, ui: &mut Ui) {
        ui.menu_button("Theme", |ui| {
            for (name, theme) in [
                ("System", egui::ThemePreference::System),
                ("Light", egui::ThemePreference::Light),
                ("Dark", egui::ThemePreference::Dark),
            ] {
                let current = ui.ctx().options(|o| o.theme_preference);
                if ui.radio(current == theme, name).clicked() {
                    ui.ctx().set_theme(theme);
                    ui.close();
                }
            }
        });
        ui.menu_button("Text size", |ui| {
            for percent in [80, 90, 100, 110, 125, 150, 200] {
                let factor = percent as f32 / 100.0;
                let current = (ui.ctx().zoom_factor() - factor).abs() < 0.01;
                if ui.radio(current, format!("{percent} %")).clicked() {
                    ui.ctx().set_zoom_factor(factor);
                    ui.close();
                }
            }
        });
        ui.separator();
        ui.checkbox(&mut self.shown.panels, "Panels");
        ui.checkbox(&mut self.preferences.probes, "Light probes");
        ui.checkbox(&mut self.session.overlays.grid, "Grid");
        ui.checkbox(&mut self.session.overlays.marks, "Mark doubtful surfels");
    }

    pub(super) fn compare_bar(&mut self, ui: &mut Ui) {
        let session = &mut self.session;
        for (name, view, tip) in COMPARE {
            ui.selectable_value(&mut session.scene.view, view, name)
                .on_hover_text(tip);
        }
        ui.separator();
        let current = CHANNELS
            .iter()
            .find(|(_, view, _)| *view == session.scene.view);
        egui::ComboBox::from_id_salt("channel")
            .selected_text(current.map_or("Channel", |(name, ..)| name))
            .width(96.0)
            .show_ui(ui, |ui| {
                ui.selectable_value(&mut session.scene.view, View::After, "Final");
                for (name, view, tip) in CHANNELS {
                    ui.selectable_value(&mut session.scene.view, view, name)
                        .on_hover_text(tip);
                }
            })
            .response
            .on_hover_text("One part of the picture alone, or what it was made of.")
            .widget_info(|| egui::WidgetInfo::labeled(egui::Role::ComboBox, true, "Channel"));
        ui.separator();
        let tip = "Keeps the look as it is. Change what you like, and compare: the pinned look stands where “before” stood. (P)";
        if button(ui, "Pin", tip) {
            session.pin();
        }
        if let Some(pinned) = &mut session.pinned {
            ui.checkbox(&mut pinned.is_compared, "against pinned")
                .on_hover_text("Compare with the pinned look instead of the capture.");
            if button(ui, "Swap", "Exchange the pinned look with this one. (T)") {
                session.swap_pinned();
            }
            if ui.button("Unpin").clicked() {
                session.pinned = None;
            }
        }
    }
}

/// Ways to compare: name, view, what it shows.
pub(super) const COMPARE: [(&str, View, &str); 5] = [
    (
        "After",
        View::After,
        "The splat relit. (C: next way to compare)",
    ),
    (
        "Before",
        View::Before,
        "The splat as it was captured. (hold B)",
    ),
    (
        "Split",
        View::Split,
        "Before left of the line, after right of it; drag the line.",
    ),
    ("Side by side", View::SideBySide, "Both pictures whole."),
    (
        "Difference",
        View::Difference,
        "After minus before; grey is none. Its scale is in the panel Look.",
    ),
];

/// Channels: name, view, what it shows.
const CHANNELS: [(&str, View, &str); 7] = [
    (
        "Diffuse",
        View::Diffuse,
        "What is scattered: all that is not gloss. (Preset paper: what does not depend on the view.)",
    ),
    (
        "Specular",
        View::Specular,
        "What is mirrored: highlights and reflections. (Preset paper: what depends on the view.)",
    ),
    (
        "Normals",
        View::Normals,
        "Where surfels face: red is X, green Y, blue Z.",
    ),
    ("Depth", View::Depth, "Near is white, far is dark."),
    (
        "Visibility",
        View::Visibility,
        "How open each surfel is: black is in a hollow.",
    ),
    (
        "Ratio tau",
        View::Tau,
        "How many stops the new light is over the old one.",
    ),
    (
        "Doubts",
        View::Doubts,
        "What was left out, and where the relit colour is doubtful.",
    ),
];
