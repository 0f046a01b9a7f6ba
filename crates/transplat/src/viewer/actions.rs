//! Actions of keys and menu entries.

use eframe::egui::{self, Key, Modifiers};
use transplat_core::present::Background;
use transplat_core::scene::Scene;

use super::app::Viewer;
use super::document::NextScene;
use super::export::task::Task;
use super::files::ask;
use super::gestures::NavigationPreset;
use super::menus::COMPARE;
use super::navigation;
use super::questions::{Answer, Question};
use super::session::{Dialog, SaveKind};
use super::shortcuts::{ARROWS, Action, SHORTCUTS};
use transplat_engine::jobs::Kind;
use transplat_engine::project::TARGET;

impl Viewer {
    pub(super) fn keys(&mut self, context: &egui::Context) {
        if context.text_edit_focused()
            || self.shown.path_field.is_some()
            || self.question.is_some()
            || self.quitting.is_some()
            || self.viewport.is_transforming()
            // What is typed while the desktop's dialog comes is for that.
            || self.session.jobs.is_running(Kind::Dialog)
        {
            return;
        }
        let is_blender = self.preferences.navigation == NavigationPreset::Blender;
        if is_blender {
            self.numpad_keys(context);
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
                    take(Modifiers::SHIFT, true);
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
            let modifiers = if is_blender {
                Modifiers::ALT
            } else {
                Modifiers::NONE
            };
            let is_pressed = |k| context.input_mut(|i| i.consume_key(modifiers, k));
            if key.is_some_and(is_pressed) {
                self.session.set_light(TARGET, path.clone());
            }
        }
    }

    /// Looks from a side, turns or frames by the digits, as Blender does by the numeric keypad.
    fn numpad_keys(&mut self, context: &egui::Context) {
        // Those are lights.
        if context.input(|i| i.modifiers.alt) {
            return;
        }
        let pose = &mut self.session.project.pose;
        let mut frames = false;
        context.input_mut(|i| {
            let mut pressed = |modifiers, key| i.consume_key(modifiers, key);
            for (key, near, far) in [
                (Key::Num1, navigation::FRONT, navigation::BACK),
                (Key::Num3, navigation::RIGHT, navigation::LEFT),
                (Key::Num7, navigation::TOP, navigation::BOTTOM),
            ] {
                if pressed(Modifiers::CTRL, key) {
                    navigation::look_from(pose, far);
                } else if pressed(Modifiers::NONE, key) {
                    navigation::look_from(pose, near);
                }
            }
            for (key, azimuth, elevation) in [
                (Key::Num4, -15.0, 0.0),
                (Key::Num6, 15.0, 0.0),
                (Key::Num2, 0.0, -15.0),
                (Key::Num8, 0.0, 15.0),
                (Key::Num9, 180.0, 0.0),
            ] {
                if pressed(Modifiers::NONE, key) {
                    pose.azimuth = navigation::wrap(pose.azimuth + azimuth);
                    pose.elevation = (pose.elevation + elevation).clamp(-90.0, 90.0);
                }
            }
            pose.orthographic ^= pressed(Modifiers::NONE, Key::Num5);
            frames = pressed(Modifiers::NONE, Key::Period);
        });
        if frames {
            self.session.project.frame_all();
        }
    }

    pub(super) fn act(&mut self, action: Action, fine: bool) {
        let step = if fine { 1.0 } else { 5.0 };
        let session = &mut self.session;
        let target = &mut session.project.scene.environment;
        match action {
            Action::Open => ask(session, Dialog::Open),
            Action::OpenFolder => ask(session, Dialog::OpenFolder),
            Action::New => self.replace_scene(NextScene::Empty),
            Action::Save => self.save_document(None),
            Action::SaveAs => self.ask_where(SaveKind::Look, "json"),
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
            Action::Transform(by) => self.viewport.asked_transform = Some(by),
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

    /// Shows the question that is open, and does as it is answered.
    pub(super) fn answer_question(&mut self, context: &egui::Context) {
        let Some(asked) = self.question.take() else {
            return;
        };
        let selected = self.session.selected;
        let called = self.session.project.called(selected);
        let Some(answer) = asked.ask(context, &self.document_name(), &called) else {
            self.question = Some(asked);
            return;
        };
        match (answer, asked) {
            (Answer::Overwrite, Question::Overwrite(path, kind)) => self.save_to(&path, kind, true),
            (Answer::Save, Question::Discard(next)) => self.save_document(Some(next)),
            (Answer::Discard, Question::Discard(next)) => self.show_next(next),
            (Answer::Discard, Question::Revert(path)) => self.show_next(NextScene::Look(path)),
            (Answer::Add, Question::AddOrReplace(path)) => self.session.project.add_object(path),
            (Answer::Replace, Question::AddOrReplace(path)) => {
                if self.autosave() {
                    self.session.project.replace_object(selected, path);
                }
            }
            // What came with it is not opened either.
            _ => {
                self.to_add.clear();
                self.to_open.clear();
            }
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
