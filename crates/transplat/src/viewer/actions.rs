//! Actions of keys and menu entries.

use eframe::egui::{self, Key};
use transplat_core::present::Background;
use transplat_core::scene::Scene;

use super::app::Viewer;
use super::export::task::Task;
use super::files::ask;
use super::menus::COMPARE;
use super::navigation;
use super::session::{Dialog, SaveKind};
use super::shortcuts::{ARROWS, Action, SHORTCUTS};
use transplat_engine::jobs::Kind;
use transplat_engine::project::TARGET;

impl Viewer {
    pub(super) fn keys(&mut self, context: &egui::Context) {
        if context.text_edit_focused()
            || self.shown.path_field.is_some()
            || self.replacing.is_some()
            || self.quitting.is_some()
            // What is typed while the desktop's dialog comes is for that.
            || self.session.jobs.is_running(Kind::Dialog)
        {
            return;
        }
        // The arrows belong to a slider that was reached by Tab.
        let focused = context.egui_wants_keyboard_input();
        // Longer combinations first, so that ctrl + shift + Z is not taken for ctrl + Z.
        let mut table: Vec<_> = SHORTCUTS.iter().collect();
        table.sort_by_key(|s| std::cmp::Reverse(u8::from(s.0.ctrl) + u8::from(s.0.shift)));
        let mut actions = Vec::new();
        context.input_mut(|i| {
            for (modifiers, key, action, _) in table {
                if focused && ARROWS.contains(key) {
                    continue;
                }
                // Each press counts, however many come between two frames.
                let mut take = |modifiers, fine| {
                    let presses = i.count_and_consume_key(modifiers, *key);
                    actions.extend(std::iter::repeat_n((*action, fine), presses));
                };
                if ARROWS.contains(key) {
                    take(egui::Modifiers::SHIFT, true);
                }
                take(*modifiers, false);
            }
            if i.events
                .iter()
                .any(|e| matches!(e, egui::Event::Text(t) if t == "?"))
            {
                actions.push((Action::Help, false));
            }
        });
        for (action, fine) in actions {
            if action == Action::FullScreen {
                let is_full = context.input(|i| i.viewport().fullscreen == Some(true));
                context.send_viewport_cmd(egui::ViewportCommand::Fullscreen(!is_full));
            }
            self.act(action, fine);
        }
        for (number, path) in (1..=9).zip(&self.light_library.paths) {
            let key = Key::from_name(&number.to_string());
            let is_pressed = |k| context.input_mut(|i| i.consume_key(egui::Modifiers::NONE, k));
            if key.is_some_and(is_pressed) {
                self.session.set_light(TARGET, path.clone());
            }
        }
    }

    pub(super) fn act(&mut self, action: Action, fine: bool) {
        let step = if fine { 1.0 } else { 5.0 };
        let session = &mut self.session;
        let target = &mut session.project.scene.environment;
        match action {
            Action::Open => ask(session, Dialog::Open),
            Action::OpenFolder => ask(session, Dialog::OpenFolder),
            Action::SaveLook => self.ask_where(SaveKind::Look, "json"),
            Action::ExportSplat => self.ask_where(SaveKind::Splat, self.splat_ending()),
            Action::Screenshot => self.export(Task::Screenshot(None)),
            Action::Copy => self.export(Task::Clipboard),
            Action::Undo => self.undo(),
            Action::Redo => self.redo(),
            Action::Duplicate => session.project.duplicate(session.selected),
            Action::Remove => {
                if !self.timeline.remove_pointed(session) {
                    session.remove_object();
                }
            }
            Action::Frame => self.session.project.frame_all(),
            Action::Orthographic => {
                session.project.pose.orthographic = !session.project.pose.orthographic
            }
            Action::Front => navigation::look_from(&mut session.project.pose, navigation::FRONT),
            Action::Right => navigation::look_from(&mut session.project.pose, navigation::RIGHT),
            Action::Top => navigation::look_from(&mut session.project.pose, navigation::TOP),
            Action::NextCompare => {
                let ways = COMPARE.map(|(_, view, _)| view);
                let at = ways.iter().position(|v| *v == session.project.scene.view);
                session.project.scene.view = ways[at.map_or(0, |i| (i + 1) % ways.len())];
            }
            Action::Pin => session.project.pin(),
            Action::SwapPinned => session.project.swap_pinned(),
            Action::KeepView => session.keep_view(),
            Action::NextView => session.next_view(true),
            Action::LastView => session.next_view(false),
            Action::NextLook => session.next_look(true),
            Action::LastLook => session.next_look(false),
            Action::Grid => session.overlays.grid = !session.overlays.grid,
            Action::Probes => self.preferences.probes = !self.preferences.probes,
            Action::Timeline => self.timeline.is_shown = !self.timeline.is_shown,
            Action::Marks => session.overlays.marks = !session.overlays.marks,
            Action::Background => {
                session.project.scene.background = match session.project.scene.background {
                    Background::Environment => Background::Color([0.18; 3]),
                    _ => Background::Environment,
                };
            }
            Action::Match => {
                session.project.scene.match_strength = !session.project.scene.match_strength
            }
            Action::Swap => session.swap_lights(),
            Action::Panels => self.shown.panels = !self.shown.panels,
            Action::Tab(tab) => {
                self.preferences.tab = tab;
                self.shown.panels = true;
            }
            // The window's own.
            Action::FullScreen => {}
            Action::Help => self.shown.help = !self.shown.help,
            Action::NudgeLeft => target.rotation = navigation::wrap(target.rotation + step),
            Action::NudgeRight => target.rotation = navigation::wrap(target.rotation - step),
            Action::NudgeUp => target.tilt = navigation::wrap(target.tilt + step),
            Action::NudgeDown => target.tilt = navigation::wrap(target.tilt - step),
        }
    }

    pub(super) fn undo(&mut self) {
        let now = self.session.project.scene_as_step();
        if let Some(scene) = self.history.undo(&now).cloned() {
            self.come_back_to(scene);
        }
    }

    pub(super) fn redo(&mut self) {
        let now = self.session.project.scene_as_step();
        if let Some(scene) = self.history.redo(&now).cloned() {
            self.come_back_to(scene);
        }
    }

    /// Settings of another time, seen from where the camera is now.
    pub(super) fn come_back_to(&mut self, scene: Scene) {
        let then = scene.camera;
        let camera = Some(self.session.project.pose);
        self.session.apply(Scene { camera, ..scene });
        if let Some(then) = then {
            self.session.project.bring_lights_along(&then);
        }
    }
}
