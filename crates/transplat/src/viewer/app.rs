//! The window: menus, panels, shelf, viewport, status; keys and drops.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui::{self, Color32, Key, Ui};
use transplat_core::load::{FileKind, file_kind};
use transplat_core::look::{EVEN, Look};
use transplat_core::present::{Background, View};
use transplat_core::rasterize::MIN_ALPHA;
use transplat_gpu::Context;
use transplat_gpu::live::Passes;

use super::export::{self, Task};
use super::files::{BUNDLED_LIGHTS, BUNDLED_SPLAT, Dialog, ask, bundled};
use super::navigation::{self, Preset};
use super::panels;
use super::preferences::Preferences;
use super::probes::{Key as ProbeKey, Probe};
use super::session::{Event, SOURCE, SaveKind, Session, Settings, Stages, TARGET};
use super::shelf::{self, Shelf};
use super::shortcuts::{self, Action, GESTURES, SHORTCUTS};
use super::viewport::Viewport;
use super::widgets::{milliseconds, thousands};

/// Where the preferences are kept.
const STORAGE_KEY: &str = "preferences";

/// How long a message stays that is no error, in seconds.
const MESSAGE_S: f32 = 7.0;

/// How long a drop waits for the pointer to tell where it was let go, in seconds.
const DROP_WAIT_S: f64 = 0.15;

/// What the viewer opens with.
#[derive(Default)]
pub struct Opening {
    /// Splats, environments, folders and looks in any order.
    pub files: Vec<PathBuf>,
    /// Puts the settings of the command line over those that were kept.
    pub settings: Option<Box<dyn FnOnce(Look) -> Look>>,
    /// A saved bake of the splat.
    pub bake: Option<PathBuf>,
}

/// The viewer.
pub struct Viewer {
    /// What is open.
    pub session: Session,
    pub(super) preferences: Preferences,
    pub(super) viewport: Viewport,
    pub(super) directions_draft: Option<usize>,
    shelf: Shelf,
    undoer: egui::util::undoer::Undoer<Look>,
    probes: [Option<Probe>; 2],
    show_help: bool,
    show_about: bool,
    show_panels: bool,
    path_field: Option<String>,
    dropped: Vec<PathBuf>,
    dropped_at: f64,
    clipboard: Option<arboard::Clipboard>,
    lost: bool,
    title: String,
}

impl Viewer {
    /// A viewer in a window.
    ///
    /// # Errors
    /// The window was not made with wgpu.
    pub fn new(
        cc: &eframe::CreationContext<'_>,
        opening: Opening,
    ) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let state = cc
            .wgpu_render_state
            .as_ref()
            .ok_or("the window has no wgpu")?;
        let context = Arc::new(Context::from_device(
            &state.adapter,
            state.device.clone(),
            state.queue.clone(),
        ));
        let kept = cc.storage.and_then(|s| s.get_string(STORAGE_KEY));
        // What an older or newer program kept differently is left.
        let preferences: Preferences = kept
            .and_then(|text| serde_json::from_str(&text).ok())
            .unwrap_or_default();
        let mut session = Session::new(
            context,
            state.target_format,
            &cc.egui_ctx,
            preferences.look(),
        );
        session.grid = preferences.grid;
        let mut viewer = Self {
            shelf: Shelf::default(),
            session,
            viewport: Viewport::default(),
            directions_draft: None,
            undoer: Default::default(),
            probes: [None, None],
            show_help: false,
            show_about: false,
            show_panels: true,
            path_field: None,
            dropped: Vec::new(),
            dropped_at: 0.0,
            clipboard: None,
            lost: false,
            title: String::new(),
            preferences,
        };
        viewer.first_scene(opening);
        Ok(viewer)
    }

    fn first_scene(&mut self, opening: Opening) {
        let lights = BUNDLED_LIGHTS.iter().filter_map(|name| bundled(name));
        let lights: Vec<PathBuf> = lights.collect();
        for path in &lights {
            self.shelf.add(&mut self.session, path);
        }
        for path in self.preferences.shelf.clone() {
            if path.is_file() {
                self.shelf.add(&mut self.session, &path);
            }
        }
        let mut look = self.session.look.clone();
        if let Some(settings) = opening.settings {
            look = settings(look);
        }
        self.session.bake = opening.bake;
        if look.target.file.is_none() {
            let second = lights.get(1).cloned();
            look.target.file = Some(second.unwrap_or_else(|| EVEN.into()));
        }
        let is = |file: &PathBuf, kind| file_kind(file).is_ok_and(|k| k == kind);
        let splat = opening.files.iter().find(|f| is(f, FileKind::Ply)).cloned();
        let by_look = opening.files.iter().any(|f| is(f, FileKind::Look));
        let bundled_splat = bundled(BUNDLED_SPLAT);
        let nothing_told = splat.is_none() && look.asset.is_none() && !by_look;
        // Another light than even is known only where somebody tells it, as for the bundled scene.
        let known = lights.first().filter(|_| nothing_told).cloned();
        let source = look
            .source
            .file
            .get_or_insert(known.unwrap_or_else(|| EVEN.into()));
        self.session.request_light(&source.clone());
        let settings = Settings::Capture {
            source: look.source.clone(),
            up: look.up,
            linear: look.linear,
            hide: look.hide,
            camera: look.camera,
        };
        let asset = splat.clone().or(look.asset.clone());
        self.session.look = Look {
            camera: None,
            ..look
        };
        if let Some(asset) = asset {
            self.preferences.remember(&asset);
            self.session.load_asset(asset, settings);
        } else if nothing_told {
            match bundled_splat {
                Some(bundled) => self.session.load_asset(bundled, settings),
                None => self
                    .session
                    .error("the bundled scene is not installed; drop a splat on the window"),
            }
        }
        for file in opening.files {
            if Some(&file) != splat.as_ref() {
                self.open(&file);
            }
        }
    }

    // ---- files ----

    /// Opens a file or a folder of environments, as if it had been dropped.
    pub fn open(&mut self, path: &Path) {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        if path.is_dir() {
            match crate::scene::environments_in(&path) {
                Ok(inside) if inside.is_empty() => self.session.error(format!(
                    "{}: the folder holds no environment (.hdr, .exr)",
                    path.display()
                )),
                Ok(inside) => {
                    for light in inside {
                        self.shelf.add(&mut self.session, &light);
                    }
                }
                Err(error) => self.session.error(format!("{error:#}")),
            }
            return;
        }
        if let Ok(kind) = file_kind(&path) {
            self.preferences.remember(&path);
            if matches!(kind, FileKind::Hdr | FileKind::Exr | FileKind::Picture) {
                self.shelf.add(&mut self.session, &path);
            }
        }
        self.session.open(&path);
    }

    fn open_dropped(&mut self, context: &egui::Context) {
        let now = context.input(|i| i.time);
        let dropped = context.input(|i| i.raw.dropped_files.clone());
        if !dropped.is_empty() {
            self.dropped
                .extend(dropped.iter().map(|f| f.path().to_owned()));
            self.dropped_at = now;
        }
        if self.dropped.is_empty() {
            return;
        }
        // The system tells where the pointer is only after the drop.
        let moved = context.input(|i| i.pointer.delta() != egui::Vec2::ZERO);
        if !moved && now - self.dropped_at < DROP_WAIT_S {
            context.request_repaint_after_secs(0.05);
            return;
        }
        let at = context.pointer_latest_pos();
        let slot = [SOURCE, TARGET].into_iter().find(|side| {
            self.shelf.slots[*side]
                .zip(at)
                .is_some_and(|(rect, at)| rect.contains(at))
        });
        for path in std::mem::take(&mut self.dropped) {
            let kind = file_kind(&path);
            match (slot, kind) {
                (Some(side), Ok(FileKind::Hdr | FileKind::Exr | FileKind::Picture)) => {
                    self.shelf.add(&mut self.session, &path);
                    self.session.set_light(side, path);
                }
                _ => self.open(&path),
            }
        }
    }

    fn save_look(&mut self, path: &Path) {
        let path = if path.extension().is_some() {
            path.to_owned()
        } else {
            path.with_extension("json")
        };
        match transplat_core::export::save_look(&path, &self.session.look_to_save()) {
            Ok(()) => {
                self.preferences.remember(&path);
                self.session.info(format!("saved {}", path.display()));
            }
            Err(error) => self.session.error(error.to_string()),
        }
    }

    fn asset_name(&self) -> String {
        let asset = self.session.asset.as_ref();
        asset.map_or_else(|| "asset".into(), |a| a.name())
    }

    pub(super) fn ask_for_splat(&mut self) {
        let name = format!(
            "{}_{}.ply",
            self.asset_name(),
            self.session.sides[TARGET].name()
        );
        ask(&mut self.session, Dialog::Save(SaveKind::Splat, name));
    }

    /// Starts an export.
    pub fn export(&mut self, task: Task) {
        let settings = self.preferences.export.clone();
        export::start(&mut self.session, &self.shelf.paths, &settings, task);
    }

    /// The settings of exports.
    pub fn export_settings(&mut self) -> &mut export::ExportSettings {
        &mut self.preferences.export
    }

    fn deal_with(&mut self, event: Event) {
        match event {
            Event::Files(paths) => {
                for path in paths {
                    self.open(&path);
                }
            }
            Event::SaveTo(path, SaveKind::Look) => self.save_look(&path),
            Event::SaveTo(path, SaveKind::Splat) => self.export(Task::Splat(path)),
            Event::SaveTo(path, SaveKind::Screenshot) => self.export(Task::Screenshot(Some(path))),
            Event::SaveTo(path, SaveKind::Folder) => {
                self.preferences.export.folder = path.display().to_string();
            }
            Event::LightFailed { path, .. } => self.shelf.forget(&path),
            Event::Clipboard(size, bytes) => self.copy(size, bytes),
            _ => {}
        }
    }

    fn copy(&mut self, [width, height]: [usize; 2], bytes: Vec<u8>) {
        // The clipboard's owner serves it: it lives as long as the window.
        if self.clipboard.is_none() {
            self.clipboard = arboard::Clipboard::new().ok();
        }
        let image = arboard::ImageData {
            width,
            height,
            bytes: bytes.into(),
        };
        let copied = self.clipboard.as_mut().map(|c| c.set_image(image));
        match copied {
            Some(Ok(())) => self
                .session
                .info(format!("copied {width} x {height} pixels")),
            Some(Err(error)) => self
                .session
                .error(format!("the clipboard refused the picture: {error}")),
            None => self.session.error("there is no clipboard here"),
        }
    }

    // ---- what tests read ----

    /// How often the stages on the GPU ran.
    pub fn passes(&self) -> Passes {
        self.session.passes()
    }

    /// How often the stages before them ran.
    pub fn stages(&self) -> Stages {
        self.session.stages
    }

    /// The lights on the shelf.
    pub fn shelf(&self) -> &[PathBuf] {
        &self.shelf.paths
    }

    /// What this scene did not need, and why.
    pub fn left_out(&self) -> Vec<(String, String)> {
        let session = &self.session;
        let mut out = Vec::new();
        let mut add = |what: &str, why: String| out.push((what.to_owned(), why));
        let Some(asset) = &session.asset else {
            return out;
        };
        let faint = asset
            .cloud
            .opacities
            .iter()
            .filter(|o| **o <= MIN_ALPHA)
            .count();
        if faint > 0 {
            add(
                "surfels never seen",
                format!("{} are too faint or broken", thousands(faint)),
            );
        }
        let hidden = session.hidden.iter().filter(|h| **h).count();
        if hidden > 0 {
            add("hidden surfels", thousands(hidden));
        }
        if session.source_is_assumed() {
            add("projection of the source", "its light is even".into());
        }
        let terms = session.look.transfer.terms;
        if !terms.shadow {
            add("self-shadow", "switched off".into());
        }
        if let Some(prepared) = &session.prepared {
            let degree = asset.cloud.sh_degree;
            if !terms.specular {
                add("specular transfer", "switched off".into());
            } else if prepared.specular_degree == 0 {
                let why = if !asset.cloud.has_view_dependence() {
                    "the asset's colour does not depend on the view"
                } else if session.look.transfer.sh_degree == 0 {
                    "the light has degree 0"
                } else {
                    "the source light is even: it tells nothing of gloss"
                };
                add("specular transfer", why.into());
            } else if prepared.specular_degree < degree {
                let why = "the source light has nothing there".into();
                add(&format!("SH bands above {}", prepared.specular_degree), why);
            }
        }
        if session.bake_file.is_some() && session.times.bake < 1000.0 && session.stages.bake <= 1 {
            add("bake", "a kept one is used".into());
        }
        out
    }

    // ---- keys ----

    fn keys(&mut self, context: &egui::Context) {
        if context.text_edit_focused() {
            return;
        }
        // The arrows belong to a slider that was reached by Tab.
        let focused = context.egui_wants_keyboard_input();
        // Longer combinations first, so that ctrl + shift + Z is not taken for ctrl + Z.
        let mut table: Vec<_> = SHORTCUTS.iter().collect();
        table.sort_by_key(|s| std::cmp::Reverse(u8::from(s.0.ctrl) + u8::from(s.0.shift)));
        let mut actions = Vec::new();
        context.input_mut(|i| {
            let nudges = [
                Key::ArrowLeft,
                Key::ArrowRight,
                Key::ArrowUp,
                Key::ArrowDown,
            ];
            for (modifiers, key, action, _) in table {
                if focused && nudges.contains(key) {
                    continue;
                }
                let fine = nudges.contains(key) && i.consume_key(egui::Modifiers::SHIFT, *key);
                if fine {
                    actions.push((*action, true));
                } else if i.consume_key(*modifiers, *key) {
                    actions.push((*action, false));
                }
            }
            if i.events
                .iter()
                .any(|e| matches!(e, egui::Event::Text(t) if t == "?"))
            {
                actions.push((Action::Help, false));
            }
        });
        for (action, fine) in actions {
            self.act(context, action, fine);
        }
        let digits = [
            Key::Num1,
            Key::Num2,
            Key::Num3,
            Key::Num4,
            Key::Num5,
            Key::Num6,
            Key::Num7,
            Key::Num8,
            Key::Num9,
        ];
        for (i, key) in digits.into_iter().enumerate() {
            let pressed = context.input_mut(|input| input.consume_key(egui::Modifiers::NONE, key));
            if pressed && let Some(path) = self.shelf.paths.get(i).cloned() {
                self.session.set_light(TARGET, path);
            }
        }
    }

    fn act(&mut self, context: &egui::Context, action: Action, fine: bool) {
        let step = if fine { 1.0 } else { 5.0 };
        let session = &mut self.session;
        let target = &mut session.look.target;
        match action {
            Action::Open => ask(session, Dialog::Open),
            Action::OpenFolder => ask(session, Dialog::OpenFolder),
            Action::SaveLook => self.ask_for_look(),
            Action::ExportSplat => self.ask_for_splat(),
            Action::Screenshot => self.export(Task::Screenshot(None)),
            Action::Copy => self.export(Task::Clipboard),
            Action::Undo => self.undo(context),
            Action::Redo => self.redo(),
            Action::Frame => panels::frame(self),
            Action::Orthographic => session.pose.orthographic = !session.pose.orthographic,
            Action::Front => navigation::look_from(&mut session.pose, Preset::Front),
            Action::Right => navigation::look_from(&mut session.pose, Preset::Right),
            Action::Top => navigation::look_from(&mut session.pose, Preset::Top),
            Action::NextCompare => {
                let ways = COMPARE.map(|(_, view, _)| view);
                let at = ways.iter().position(|v| *v == session.look.view);
                session.look.view = ways[at.map_or(0, |i| (i + 1) % ways.len())];
            }
            Action::Pin => session.pin(),
            Action::Grid => session.grid = !session.grid,
            Action::Probes => self.preferences.probes = !self.preferences.probes,
            Action::Marks => session.show_marks = !session.show_marks,
            Action::Background => {
                session.look.background = match session.look.background {
                    Background::Environment => Background::Color([0.18; 3]),
                    _ => Background::Environment,
                };
            }
            Action::Match => session.look.match_strength = !session.look.match_strength,
            Action::Swap => session.swap_lights(),
            Action::Panels => self.show_panels = !self.show_panels,
            Action::Help => self.show_help = !self.show_help,
            Action::NudgeLeft => target.rotation = navigation::wrap(target.rotation + step),
            Action::NudgeRight => target.rotation = navigation::wrap(target.rotation - step),
            Action::NudgeUp => target.tilt = navigation::wrap(target.tilt + step),
            Action::NudgeDown => target.tilt = navigation::wrap(target.tilt - step),
        }
    }

    fn ask_for_look(&mut self) {
        let name = format!(
            "{}_{}.json",
            self.asset_name(),
            self.session.sides[TARGET].name()
        );
        ask(&mut self.session, Dialog::Save(SaveKind::Look, name));
    }

    fn undo(&mut self, _context: &egui::Context) {
        if let Some(look) = self.undoer.undo(&self.session.look).cloned() {
            self.session.apply_look(look);
        }
    }

    fn redo(&mut self) {
        if let Some(look) = self.undoer.redo(&self.session.look).cloned() {
            self.session.apply_look(look);
        }
    }

    // ---- parts of the window ----

    fn menus(&mut self, ui: &mut Ui) {
        egui::MenuBar::new().ui(ui, |ui| {
            ui.menu_button("File", |ui| self.file_menu(ui));
            ui.menu_button("Edit", |ui| {
                let look = self.session.look.clone();
                let item = |ui: &mut Ui, name: &str, action, enabled| {
                    let button = egui::Button::new(name).shortcut_text(shortcuts::of(action));
                    ui.add_enabled(enabled, button).clicked()
                };
                if item(ui, "Undo", Action::Undo, self.undoer.has_undo(&look)) {
                    self.undo(&ui.ctx().clone());
                    ui.close();
                }
                if item(ui, "Redo", Action::Redo, self.undoer.has_redo(&look)) {
                    self.redo();
                    ui.close();
                }
                ui.separator();
                if ui.button("Reset all settings").clicked() {
                    let kept = &self.session.look;
                    self.session.look = Look {
                        asset: kept.asset.clone(),
                        source: transplat_core::look::LightSettings {
                            file: kept.source.file.clone(),
                            ..Default::default()
                        },
                        target: transplat_core::look::LightSettings {
                            file: kept.target.file.clone(),
                            ..Default::default()
                        },
                        ..Preferences::default().look()
                    };
                    ui.close();
                }
            });
            ui.menu_button("View", |ui| self.view_menu(ui));
            ui.menu_button("Help", |ui| {
                if ui.button("Shortcuts (?)").clicked() {
                    self.show_help = true;
                    ui.close();
                }
                if ui.button("About").clicked() {
                    self.show_about = true;
                    ui.close();
                }
            });
            ui.separator();
            self.compare_bar(ui);
        });
    }

    fn file_menu(&mut self, ui: &mut Ui) {
        let item = |ui: &mut Ui, name: &str, action| {
            let button = egui::Button::new(name).shortcut_text(shortcuts::of(action));
            ui.add(button).clicked()
        };
        let mut chosen = None;
        for (name, action) in [
            ("Open…", Action::Open),
            ("Open folder of environments…", Action::OpenFolder),
        ] {
            if item(ui, name, action) {
                chosen = Some(action);
            }
        }
        if ui.button("Open or save by path…").clicked() {
            self.path_field = Some(String::new());
            ui.close();
        }
        let recent = self.preferences.recent.clone();
        ui.menu_button("Open recent", |ui| {
            if recent.is_empty() {
                ui.weak("nothing yet");
            }
            for path in recent {
                if ui.button(path.display().to_string()).clicked() {
                    self.open(&path);
                    ui.close();
                }
            }
        });
        if ui.button("Bundled scene").clicked() {
            self.bundled_scene();
            ui.close();
        }
        ui.separator();
        for (name, action) in [
            ("Save look…", Action::SaveLook),
            ("Export relit splat…", Action::ExportSplat),
            ("Save picture", Action::Screenshot),
            ("Copy picture", Action::Copy),
        ] {
            if item(ui, name, action) {
                chosen = Some(action);
            }
        }
        if ui.button("Save picture as…").clicked() {
            let extension = self.preferences.export.format.extension();
            let name = format!("{}.{extension}", self.asset_name());
            ask(&mut self.session, Dialog::Save(SaveKind::Screenshot, name));
            ui.close();
        }
        if ui.button("Save turntable").clicked() {
            self.export(Task::Turntable);
            ui.close();
        }
        ui.separator();
        if ui.button("Quit").clicked() {
            ui.ctx().send_viewport_cmd(egui::ViewportCommand::Close);
        }
        if let Some(action) = chosen {
            self.act(&ui.ctx().clone(), action, false);
            ui.close();
        }
    }

    fn bundled_scene(&mut self) {
        let Some(splat) = bundled(BUNDLED_SPLAT) else {
            self.session.error("the bundled scene is not installed");
            return;
        };
        let mut look = self.preferences.look();
        let lights: Vec<PathBuf> = BUNDLED_LIGHTS.iter().filter_map(|n| bundled(n)).collect();
        look.source.file = lights.first().cloned();
        look.target.file = lights.get(1).cloned();
        look.asset = Some(splat.clone());
        for path in &lights {
            self.shelf.add(&mut self.session, path);
        }
        self.session
            .load_asset(splat, Settings::Look(Box::new(look)));
    }

    fn view_menu(&mut self, ui: &mut Ui) {
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
        ui.checkbox(&mut self.show_panels, "Panels");
        ui.checkbox(&mut self.preferences.probes, "Light probes");
        ui.checkbox(&mut self.session.grid, "Grid");
        ui.checkbox(&mut self.session.show_marks, "Mark doubtful surfels");
    }

    fn compare_bar(&mut self, ui: &mut Ui) {
        let session = &mut self.session;
        for (name, view, tip) in COMPARE {
            ui.selectable_value(&mut session.look.view, view, name)
                .on_hover_text(tip);
        }
        ui.separator();
        let current = CHANNELS
            .iter()
            .find(|(_, view, _)| *view == session.look.view);
        egui::ComboBox::from_id_salt("channel")
            .selected_text(current.map_or("Channel", |(name, ..)| name))
            .width(96.0)
            .show_ui(ui, |ui| {
                ui.selectable_value(&mut session.look.view, View::After, "Final");
                for (name, view, tip) in CHANNELS {
                    ui.selectable_value(&mut session.look.view, view, name)
                        .on_hover_text(tip);
                }
            })
            .response
            .on_hover_text("One part of the picture alone, or what it was made of.")
            .widget_info(|| egui::WidgetInfo::labeled(egui::Role::ComboBox, true, "Channel"));
        ui.separator();
        let pin = ui.button("Pin").on_hover_text(
            "Keeps the look as it is. Change what you like, and compare: the pinned look stands where “before” stood. (P)",
        );
        if pin.clicked() {
            session.pin();
        }
        if session.pinned.is_some() {
            ui.checkbox(&mut session.against_pinned, "against pinned")
                .on_hover_text("Compare with the pinned look instead of the capture.");
            if ui
                .button("Swap")
                .on_hover_text("Exchange the pinned look with this one.")
                .clicked()
            {
                session.swap_pinned();
            }
            if ui.button("Unpin").clicked() {
                session.pinned = None;
                session.against_pinned = false;
            }
        }
    }

    fn status(&mut self, ui: &mut Ui) {
        let session = &self.session;
        ui.horizontal(|ui| {
            let total = session.asset.as_ref().map_or(0, |a| a.cloud.len());
            let drawn = session.live().drawn();
            ui.label(format!("{} of {} surfels", thousands(drawn), thousands(total)))
                .on_hover_text("Drawn, of all that the splat has: what is hidden or behind the camera is not drawn.");
            ui.separator();
            ui.label(format!("frame {}", milliseconds(session.frame_timer.ms())))
                .on_hover_text("From the first command of the last changed picture to its end on the graphics adapter.");
            ui.separator();
            ui.label(format!("transfer {}", milliseconds(session.transfer_timer.ms())))
                .on_hover_text("The last change of light, from the click to its end on the graphics adapter.");
            ui.separator();
            let bake = if session.bake_share < 1.0 {
                format!("bake {:.0} %", 100.0 * session.bake_share)
            } else {
                format!("bake {}", milliseconds(session.times.bake))
            };
            ui.label(bake).on_hover_text("The object's visibility; until it is baked, shadows are missing or coarse.");
            ui.separator();
            if let Some(bytes) = crate::report::memory_bytes() {
                ui.label(format!("{} MB", thousands((bytes >> 20) as usize)))
                    .on_hover_text("Memory that the program holds.");
                ui.separator();
            }
            let software = session.context.is_software();
            let name = ui.label(session.context.name());
            if software {
                ui.colored_label(ui.visuals().warn_fg_color, "software")
                    .on_hover_text("This driver computes on the CPU: everything works, slowly. A graphics card with its Vulkan driver makes it fast.");
            } else {
                name.on_hover_text("The graphics adapter.");
            }
            let left_out = self.left_out();
            if !left_out.is_empty() {
                ui.separator();
                let text = format!("left out: {}", left_out.len());
                let all: Vec<String> = left_out.iter().map(|(what, why)| format!("{what}: {why}")).collect();
                ui.label(text).on_hover_text(all.join("\n"));
            }
        });
    }

    /// What runs, with its progress and a way to stop it; and what was said.
    fn jobs_and_messages(&mut self, context: &egui::Context) {
        let rect = self.viewport.rect;
        let area = egui::Area::new(egui::Id::unique("jobs"))
            .fixed_pos(rect.left_top() + egui::vec2(10.0, 40.0))
            .order(egui::Order::Foreground);
        let now = std::time::Instant::now();
        self.session
            .messages
            .retain(|m| m.is_error || (now - m.since).as_secs_f32() < MESSAGE_S);
        let messages = self.session.messages.clone();
        let jobs: Vec<(u64, String, f32, bool)> = self
            .session
            .jobs
            .running()
            .iter()
            // What is over in a moment is not worth a word.
            .filter(|j| j.started.elapsed().as_secs_f32() > 0.4)
            .map(|j| (j.id, j.label.clone(), j.progress(), j.can_be_cancelled()))
            .collect();
        if messages.is_empty() && jobs.is_empty() {
            return;
        }
        let width = (rect.width() * 0.5).clamp(240.0, 460.0);
        let mut dismissed = None;
        let mut cancelled = None;
        area.show(context, |ui| {
            ui.set_max_width(width);
            for (id, label, progress, can_cancel) in &jobs {
                egui::Frame::popup(ui.style()).show(ui, |ui| {
                    ui.horizontal(|ui| {
                        if *progress > 0.0 {
                            ui.add(
                                egui::ProgressBar::new(*progress)
                                    .desired_width(90.0)
                                    .show_percentage(),
                            );
                        } else {
                            ui.spinner();
                        }
                        ui.label(label);
                        if *can_cancel && ui.small_button("Cancel").clicked() {
                            cancelled = Some(*id);
                        }
                    });
                });
            }
            for (i, message) in messages.iter().enumerate() {
                egui::Frame::popup(ui.style()).show(ui, |ui| {
                    ui.horizontal_top(|ui| {
                        let close = ui.small_button("×").on_hover_text("Dismiss");
                        close.widget_info(|| {
                            egui::WidgetInfo::labeled(egui::Role::Button, true, "Dismiss")
                        });
                        if close.clicked() {
                            dismissed = Some(i);
                        }
                        let color = if message.is_error {
                            ui.visuals().error_fg_color
                        } else {
                            ui.visuals().text_color()
                        };
                        ui.add(
                            egui::Label::new(egui::RichText::new(&message.text).color(color))
                                .wrap(),
                        );
                    });
                });
            }
        });
        if let Some(i) = dismissed {
            self.session.messages.remove(i);
        }
        if let Some(id) = cancelled {
            for job in self.session.jobs.running().iter().filter(|j| j.id == id) {
                job.cancel();
            }
        }
        context.request_repaint_after_secs(0.25);
    }

    fn light_probes(&mut self, context: &egui::Context) {
        if !self.preferences.probes || self.session.asset.is_none() {
            return;
        }
        let session = &self.session;
        let rect = self.viewport.rect;
        let Some(frame) = session.frame([100, 100], View::After) else {
            return;
        };
        let lights = session.oriented_lights();
        for side in [SOURCE, TARGET] {
            let settings = if side == SOURCE {
                &session.look.source
            } else {
                &session.look.target
            };
            let shown = &frame.presentation.lights[side];
            let key = ProbeKey {
                light: session.sides[side].path.clone(),
                oriented: lights[side].clone(),
                map_from_asset: settings.map_from_asset(session.up()),
                gain: shown.gain,
                display: session.look.display,
                view: frame.presentation.camera.view_from_world,
            };
            let name = super::session::SIDES[side];
            Probe::update(
                &mut self.probes[side],
                context,
                name,
                key,
                &session.sides[side],
            );
        }
        let area = egui::Area::new(egui::Id::unique("probes"))
            .pivot(egui::Align2::RIGHT_TOP)
            .fixed_pos(rect.right_top() + egui::vec2(-10.0, 10.0))
            .order(egui::Order::Middle)
            .interactable(false);
        area.show(context, |ui| {
            let frame = egui::Frame::new()
                .fill(Color32::from_black_alpha(130))
                .corner_radius(5.0)
                .inner_margin(6.0);
            frame.show(ui, |ui| {
                ui.spacing_mut().item_spacing = egui::vec2(6.0, 3.0);
                for (side, probe) in self.probes.iter().enumerate() {
                    let Some(probe) = probe else { continue };
                    let name = super::session::SIDES[side];
                    ui.label(
                        egui::RichText::new(name)
                            .small()
                            .color(Color32::from_gray(220)),
                    );
                    ui.horizontal(|ui| {
                        for texture in [&probe.grey, &probe.mirror] {
                            let image =
                                egui::Image::new(texture).fit_to_exact_size(egui::vec2(46.0, 46.0));
                            ui.add(image);
                        }
                        ui.vertical(|ui| {
                            ui.spacing_mut().item_spacing.y = 2.0;
                            for texture in [&probe.map, &probe.sh] {
                                let image = egui::Image::new(texture)
                                    .fit_to_exact_size(egui::vec2(44.0, 22.0));
                                ui.add(image);
                            }
                        });
                    });
                }
            });
        });
    }

    fn sheet_of_shortcuts(&mut self, context: &egui::Context) {
        let mut open = self.show_help;
        egui::Window::new("Shortcuts")
            .open(&mut open)
            .resizable(false)
            .show(context, |ui| {
                egui::ScrollArea::vertical()
                    .max_height(500.0)
                    .show(ui, |ui| {
                        egui::Grid::new("shortcuts")
                            .num_columns(2)
                            .striped(true)
                            .show(ui, |ui| {
                                for (gesture, what) in GESTURES {
                                    ui.label(gesture);
                                    ui.label(what);
                                    ui.end_row();
                                }
                                for (modifiers, key, _, what) in SHORTCUTS {
                                    ui.label(shortcuts::name(modifiers, key));
                                    ui.label(what);
                                    ui.end_row();
                                }
                            });
                    });
            });
        self.show_help = open;
        let mut open = self.show_about;
        egui::Window::new("About").open(&mut open).resizable(false).show(context, |ui| {
            ui.label(concat!("transplat ", env!("CARGO_PKG_VERSION")));
            ui.label("Relights captured objects by spherical-harmonic radiance transfer, after the paper “TranSplat”.");
        });
        self.show_about = open;
    }

    fn path_window(&mut self, context: &egui::Context) {
        let Some(mut text) = self.path_field.take() else {
            return;
        };
        let mut open = true;
        let mut act: Option<fn(&mut Self, PathBuf)> = None;
        egui::Window::new("By path")
            .open(&mut open)
            .resizable(false)
            .show(context, |ui| {
                let label = ui.label("A file or folder to open, or the name of a file to write:");
                let field = egui::TextEdit::singleline(&mut text).desired_width(420.0);
                let response = ui.add(field).labelled_by(label.id);
                if response.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
                    act = Some(|v, path| v.open(&path));
                }
                ui.horizontal(|ui| {
                    if ui.button("Open").clicked() {
                        act = Some(|v, path| v.open(&path));
                    }
                    if ui.button("Save look").clicked() {
                        act = Some(|v, path| v.save_look(&path));
                    }
                    if ui.button("Save picture").clicked() {
                        act = Some(|v, path| v.export(Task::Screenshot(Some(path))));
                    }
                    if ui.button("Export splat").clicked() {
                        act = Some(|v, path| v.export(Task::Splat(path)));
                    }
                });
            });
        match act {
            Some(act) if !text.trim().is_empty() => act(self, PathBuf::from(text.trim())),
            _ if open => self.path_field = Some(text),
            _ => {}
        }
    }

    fn drop_hint(&self, context: &egui::Context) {
        if context.input(|i| i.raw.hovered_files.is_empty()) {
            return;
        }
        let painter = context.layer_painter(egui::LayerId::new(
            egui::Order::Foreground,
            egui::Id::unique("drop hint"),
        ));
        let rect = self.viewport.rect;
        painter.rect_filled(rect, 0.0, Color32::from_black_alpha(120));
        painter.text(
            rect.center(),
            egui::Align2::CENTER_CENTER,
            "Drop splats, environments, folders of environments, looks.\nOn a slot below: the light of that slot.",
            egui::FontId::proportional(20.0),
            Color32::WHITE,
        );
    }

    /// A device that is gone takes the window with it; the look is kept.
    fn check_device(&mut self, context: &egui::Context) {
        if self.lost || !self.session.context.is_lost() {
            return;
        }
        self.lost = true;
        let look = directories::ProjectDirs::from("", "", "transplat")
            .map(|d| d.cache_dir().join("recovered_look.json"));
        let kept = look.filter(|path| {
            let made = path
                .parent()
                .is_none_or(|f| std::fs::create_dir_all(f).is_ok());
            made && transplat_core::export::save_look(path, &self.session.look_to_save()).is_ok()
        });
        let kept = kept.map_or(String::new(), |path| {
            format!(
                " Your settings are in {}: open them after a new start.",
                path.display()
            )
        });
        eprintln!(
            "transplat: the graphics device was lost; the driver may have been updated, reset or run out of memory.{kept}"
        );
        context.send_viewport_cmd(egui::ViewportCommand::Close);
    }
}

impl eframe::App for Viewer {
    fn logic(&mut self, context: &egui::Context, _frame: &mut eframe::Frame) {
        self.check_device(context);
        self.open_dropped(context);
        self.keys(context);
        for event in self.session.update() {
            self.deal_with(event);
        }
        if std::mem::take(&mut self.shelf.wants_files) {
            ask(&mut self.session, Dialog::Open);
        }
        let time = context.input(|i| i.time);
        self.undoer.feed_state(time, &self.session.look);
        let title = match &self.session.asset {
            Some(asset) => format!("{} – transplat", asset.name()),
            None => "transplat".into(),
        };
        if self.title != title {
            context.send_viewport_cmd(egui::ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    fn ui(&mut self, ui: &mut Ui, _frame: &mut eframe::Frame) {
        egui::Panel::top("menus").show(ui, |ui| self.menus(ui));
        egui::Panel::bottom("status").show(ui, |ui| self.status(ui));
        egui::Panel::bottom("shelf")
            .exact_size(shelf::HEIGHT)
            .show(ui, |ui| self.shelf.show(ui, &mut self.session));
        if self.show_panels {
            egui::Panel::right("panels")
                .default_size(300.0)
                .size_range(240.0..=460.0)
                .show(ui, |ui| panels::show(ui, self));
        }
        let hold_before = !ui.ctx().text_edit_focused() && ui.input(|i| i.key_down(Key::B));
        egui::CentralPanel::no_frame().show(ui, |ui| {
            self.viewport.show(ui, &mut self.session, hold_before);
        });
        let context = ui.ctx().clone();
        self.light_probes(&context);
        self.jobs_and_messages(&context);
        self.path_window(&context);
        self.sheet_of_shortcuts(&context);
        self.drop_hint(&context);
    }

    fn save(&mut self, storage: &mut dyn eframe::Storage) {
        self.preferences.keep(&self.session.look);
        self.preferences.grid = self.session.grid;
        let own: Vec<PathBuf> = BUNDLED_LIGHTS.iter().filter_map(|n| bundled(n)).collect();
        self.preferences.shelf = self
            .shelf
            .paths
            .iter()
            .filter(|p| !own.contains(p))
            .cloned()
            .collect();
        if let Ok(text) = serde_json::to_string(&self.preferences) {
            storage.set_string(STORAGE_KEY, text);
        }
    }
}

/// Ways to compare: name, view, what it shows.
const COMPARE: [(&str, View, &str); 5] = [
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
        "After minus before; grey is none. Its scale is in the panel View.",
    ),
];

/// Channels: name, view, what it shows.
const CHANNELS: [(&str, View, &str); 7] = [
    (
        "Diffuse",
        View::Diffuse,
        "What does not depend on the view.",
    ),
    (
        "Specular",
        View::Specular,
        "What depends on the view: highlights and reflections.",
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
