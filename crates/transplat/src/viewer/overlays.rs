//! Overlays of the viewport: status, jobs and messages, light probes, sheets.

use std::time::{Duration, Instant};

use eframe::egui::text::{CCursor, CCursorRange};
use eframe::egui::{self, Color32, Key, Ui};
use glam::Vec2;
use transplat_core::camera::CameraPose;
use transplat_core::present::View;
use transplat_core::scene::Scene;
use transplat_core::settings::optimizations::SkippedWork;
use transplat_core::surfels::UpAxis;

use super::app::{Quitting, Viewer};
use super::document::NextScene;
use super::export::task::Task;
use super::files::path_as_typed;
use super::navigation;
use super::probes::{BallEnvironment, MAP_WIDTH, ProbeBall, ProbeKey};
use super::questions::modal;
use super::session::{Dialog, Message, SIDES, SaveKind, Session};
use super::shortcuts::{self, Action, GESTURES, SHORTCUTS};
use super::widgets::{named, thousands, waiting};
use transplat_engine::bundled::BUNDLED_SPLAT;
use transplat_engine::jobs::{Job, Kind, PROGRESS_INTERVAL, Work};
use transplat_engine::language::{tr, tr_format};
use transplat_engine::project::{SOURCE, TARGET};
use transplat_engine::words::milliseconds;

/// Points across a ball in the corner.
const BALL_SIZE: f32 = 46.0;

/// Seconds that a message stays that is no error.
const MESSAGE_S: f32 = 7.0;

/// Seconds that a message stays that offers something.
const OFFER_S: f32 = 20.0;

/// Time that a job runs before it is shown.
const MOMENT: Duration = Duration::from_millis(400);

/// Messages that are shown, the latest.
const MOST_MESSAGES: usize = 4;

/// A window over the middle of the picture.
fn in_the_middle(title: &str, picture: egui::Rect) -> egui::Window<'_> {
    egui::Window::new(title)
        .pivot(egui::Align2::CENTER_CENTER)
        .default_pos(picture.center())
        .resizable(false)
}

impl Viewer {
    pub(super) fn status(&mut self, ui: &mut Ui) {
        let session = &self.session;
        ui.horizontal(|ui| {
            let assets = session.project.states.iter().filter_map(|s| s.asset.as_ref());
            let total = assets.map(|a| a.cloud.len()).sum();
            // Nothing is drawn of an empty scene.
            let drawn = session.canvas.live().drawn().min(total);
            ui.label(tr_format!("{} of {} Gaussians", thousands(drawn), thousands(total)))
                .on_hover_text(tr("Gaussians drawn, of all in the scene."));
            ui.separator();
            ui.label(tr_format!("frame {}", milliseconds(session.canvas.timers.frame.ms())))
                .on_hover_text(tr("Time to render the last frame."));
            ui.separator();
            ui.label(tr_format!("transfer {}", milliseconds(session.transfer_ms())))
                .on_hover_text(tr("Time of the last change of light."));
            ui.separator();
            let running = session.running_jobs().find(|j| matches!(j.kind, Kind::Of(_, Work::Bake(_))));
            let bake = if let Some(job) = running {
                tr_format!("bake {:.0} %", 100.0 * job.progress())
            } else if session.bake_share() < 1.0 {
                tr_format!("bake {:.0} %", 100.0 * session.bake_share())
            } else {
                tr_format!("bake {}", milliseconds(session.baked().map_or(0.0, |b| b.ms)))
            };
            ui.label(bake).on_hover_text(tr("Visibility bake. Until it is done, shadows are missing or coarse."));
            ui.separator();
            if let Some(bytes) = crate::summary::memory_bytes("VmRSS:") {
                ui.label(tr_format!("{} MB", thousands((bytes >> 20) as usize)))
                    .on_hover_text(tr("Memory in use."));
                ui.separator();
            }
            let software = session.canvas.context.is_software();
            let name = ui.label(session.canvas.context.name());
            if software {
                ui.colored_label(ui.visuals().warn_fg_color, tr("software"))
                    .on_hover_text(tr("No graphics card driver was found, so this runs on the CPU. Install your card's driver for full speed."));
            } else {
                name.on_hover_text(tr("Graphics adapter."));
            }
            let skipped_work = self.skipped_work();
            if !skipped_work.is_empty() {
                ui.separator();
                let text = match skipped_work.len() {
                    1 => tr("1 step skipped").to_owned(),
                    n => tr_format!("{n} steps skipped", n = n),
                };
                let line = |s: &SkippedWork| format!("{}: {}", s.what, self.skipped_work_in_words(s));
                let all: Vec<String> = skipped_work.iter().map(line).collect();
                ui.label(text)
                    .on_hover_text(tr_format!("Skipped, since not needed or off:\n{}", all.join("\n")));
            }
        });
    }

    /// Shows running jobs, with progress and a way to stop them, and messages.
    pub(super) fn jobs_and_messages(&mut self, context: &egui::Context) {
        let rect = self.viewport.rect;
        let area = egui::Area::new(egui::Id::unique("jobs"))
            // Below what is said of the picture itself.
            .fixed_pos(rect.left_top() + egui::vec2(10.0, 66.0))
            // Windows can be brought before it.
            .order(egui::Order::Middle);
        let is_stopped = self.is_stopped;
        let is_relit = self.session.state().relit.get().is_some();
        let mut goes_on = false;
        let Session {
            messages,
            jobs,
            project,
            ..
        } = &mut self.session;
        let running = || project.jobs.running().iter().chain(jobs.running());
        let stays = |m: &Message| match m.offer {
            Some(_) => OFFER_S,
            None => MESSAGE_S,
        };
        messages.retain(|m| m.is_error || m.since.elapsed().as_secs_f32() < stays(m));
        // What is over in a moment is not worth a word.
        let is_long = |j: &&Job| j.started.elapsed() > MOMENT;
        if !running().all(|j| is_long(&j)) {
            context.request_repaint_after(MOMENT);
        }
        let jobs: Vec<&Job> = running().filter(is_long).collect();
        if messages.is_empty() && jobs.is_empty() && !is_stopped {
            return;
        }
        let width = (rect.width() * 0.5).clamp(240.0, 460.0);
        let mut dismissed = None;
        let mut dismiss_all = false;
        let mut taken = None;
        area.show(context, |ui| {
            ui.set_max_width(width);
            for job in &jobs {
                egui::Frame::popup(ui.style()).show(ui, |ui| {
                    ui.horizontal(|ui| {
                        if job.waits() {
                            ui.weak(tr("queued"));
                        } else if job.progress() > 0.0 {
                            let bar = egui::ProgressBar::new(job.progress());
                            ui.add(bar.desired_width(90.0).show_percentage());
                        } else {
                            let (rect, _) = ui
                                .allocate_exact_size(egui::Vec2::splat(16.0), egui::Sense::hover());
                            waiting(ui, rect);
                        }
                        ui.label(&job.label);
                        if let Some(left) = job.time_left().and_then(left_in_words) {
                            ui.weak(left);
                        }
                        if job.is_cancelled() {
                            ui.weak(tr("stopping"));
                        } else if job.can_be_cancelled() && ui.small_button(tr("Cancel")).clicked()
                        {
                            job.cancel();
                        }
                    });
                });
            }
            if is_stopped {
                egui::Frame::popup(ui.style()).show(ui, |ui| {
                    ui.horizontal(|ui| {
                        ui.label(match is_relit {
                            true => tr("Stopped: the image is coarse."),
                            false => tr("Stopped before the object was relit."),
                        });
                        goes_on = ui.small_button(tr("Resume")).clicked();
                    });
                });
            }
            if messages.len() > 2 && ui.small_button(tr("Dismiss all")).clicked() {
                dismiss_all = true;
            }
            let hidden = messages.len().saturating_sub(MOST_MESSAGES);
            if hidden > 0 {
                ui.weak(tr_format!("and {hidden} earlier", hidden = hidden));
            }
            for (i, message) in messages.iter().enumerate().skip(hidden) {
                egui::Frame::popup(ui.style()).show(ui, |ui| {
                    ui.horizontal_top(|ui| {
                        let close = ui.small_button("×").on_hover_text(tr("Dismiss"));
                        named(&close, egui::Role::Button, tr("Dismiss"));
                        if close.clicked() {
                            dismissed = Some(i);
                        }
                        let color = if message.is_error {
                            ui.visuals().error_fg_color
                        } else {
                            ui.visuals().text_color()
                        };
                        let text = egui::RichText::new(&message.text).color(color);
                        ui.vertical(|ui| {
                            ui.add(egui::Label::new(text).wrap());
                            if let Some((of, remedy)) = message.offer
                                && ui.button(remedy.name()).clicked()
                            {
                                taken = Some((of, remedy));
                                dismissed = Some(i);
                            }
                        });
                    });
                });
            }
        });
        // Errors stay; everything else goes by itself or goes on.
        if !jobs.is_empty() || messages.iter().any(|m| !m.is_error) {
            context.request_repaint_after(PROGRESS_INTERVAL);
        }
        if goes_on {
            self.session.project.rebake(self.session.selected);
            return;
        }
        if dismiss_all {
            messages.clear();
        } else if let Some(i) = dismissed {
            messages.remove(i);
        }
        // The object may be gone meanwhile.
        if let Some((of, remedy)) = taken
            && let Some(at) = self.session.project.at(of)
        {
            self.session.project.apply_remedy(at, remedy);
        }
    }

    pub(super) fn light_probes(&mut self, context: &egui::Context) {
        if !self.preferences.probes || self.session.asset().is_none() {
            return;
        }
        let session = &self.session;
        let rect = self.viewport.rect;
        let Some(frame) = session.frame([100, 100], View::After) else {
            return;
        };
        let lights = session.oriented_lights();
        let scene_from_view = frame.presentation.camera.view_from_world.transpose();
        let place = session.lit().center;
        for side in [SOURCE, TARGET] {
            let key = ProbeKey {
                oriented: lights[side].clone(),
                place,
                transfer: session.project.scene.transfer.clone(),
                display: session.project.scene.display,
                world_from_view: session.project.world_from_scene().as_mat3() * scene_from_view,
            };
            let around = || {
                let (scene, light) = (&session.project.scene, session.light(side));
                if side == SOURCE {
                    let settings = session.side(side);
                    let map = settings.in_world(&light.small, &light.illumination, MAP_WIDTH, 1.0);
                    let light = settings.orient(&light.illumination, UpAxis::PlusZ);
                    return BallEnvironment::new(light, map, place);
                }
                let maps = session
                    .project
                    .matched_sides()
                    .map(|(_, side)| &side.light.illumination);
                let all = scene.light_in_world(maps);
                let map = scene.panorama(light.small_dome(), maps, &all, place, MAP_WIDTH);
                BallEnvironment::new(all, map, place)
            };
            let name = tr(SIDES[side]);
            ProbeBall::update(&mut self.probes[side], context, name, key, around);
        }
        let area = egui::Area::new(egui::Id::unique("probes"))
            .pivot(egui::Align2::RIGHT_TOP)
            .fixed_pos(rect.right_top() + egui::vec2(-10.0, 10.0))
            .order(egui::Order::Middle);
        let mut balls: Vec<(usize, egui::Response)> = Vec::new();
        area.show(context, |ui| {
            let frame = egui::Frame::new()
                .fill(Color32::from_black_alpha(130))
                .corner_radius(5.0)
                .inner_margin(6.0);
            frame.show(ui, |ui| {
                ui.spacing_mut().item_spacing = egui::vec2(6.0, 3.0);
                for (side, probe) in self.probes.iter().enumerate() {
                    let Some(probe) = probe else { continue };
                    let name = tr(SIDES[side]);
                    ui.label(
                        egui::RichText::new(name)
                            .small()
                            .color(Color32::from_gray(220)),
                    );
                    ui.horizontal(|ui| {
                        for (texture, ball) in
                            [(&probe.grey, tr("Grey")), (&probe.mirror, tr("Mirror"))]
                        {
                            let image = egui::Image::new(texture)
                                .fit_to_exact_size(egui::vec2(BALL_SIZE, BALL_SIZE))
                                .sense(egui::Sense::drag());
                            let ball = tr_format!("{ball} ball {name}", ball = ball, name = name);
                            let response = ui.add(image).on_hover_cursor(egui::CursorIcon::Grab);
                            named(&response, egui::Role::Image, ball);
                            // What mirrors nothing is a ball, too.
                            let (center, radius) = (response.rect.center(), 0.5 * BALL_SIZE);
                            let rim = (0.5, Color32::from_gray(120));
                            ui.painter().circle_stroke(center, radius, rim);
                            let tip = tr("Drag to rotate and tilt the light.");
                            balls.push((side, response.on_hover_text(tip)));
                        }
                        ui.vertical(|ui| {
                            ui.spacing_mut().item_spacing.y = 2.0;
                            for texture in [&probe.map, &probe.seen] {
                                let image = egui::Image::new(texture)
                                    .fit_to_exact_size(egui::vec2(44.0, 22.0));
                                ui.add(image);
                            }
                        });
                    });
                }
            });
        });
        for ((side, response), grab) in balls.iter().zip(&mut self.grabbed_balls) {
            let light = self.session.side_mut(*side);
            if let Some(((rotation, tilt), by)) = grab.drag(response, (light.rotation, light.tilt))
            {
                (light.rotation, light.tilt) = (rotation, tilt);
                navigation::turn_light(light, Vec2::new(by.x, by.y));
                self.preferences.knows_how_to_turn_the_light = true;
            }
        }
    }

    /// Shows what to do where there is no splat.
    pub(super) fn empty_scene(&mut self, context: &egui::Context) {
        let project = &self.session.project;
        if project.has_asset() || project.is_loading_asset() {
            return;
        }
        egui::Area::new(egui::Id::unique("empty"))
            .pivot(egui::Align2::CENTER_CENTER)
            .fixed_pos(self.viewport.rect.center())
            .order(egui::Order::Middle)
            .show(context, |ui| {
                ui.vertical_centered(|ui| {
                    // The viewport is dark in both themes.
                    let [title, text] = [230, 180].map(Color32::from_gray);
                    let heading = egui::RichText::new(tr("Drop a splat here")).heading();
                    ui.label(heading.color(title));
                    ui.colored_label(
                        text,
                        tr("2DGS or 3DGS: .ply, .spz, .sog, .splat, .ksplat, .glb"),
                    );
                    ui.add_space(8.0);
                    if ui.button(tr("Open…")).clicked() {
                        self.act(Action::Open, false);
                    }
                    if ui.button(tr("Open the teapot")).clicked() {
                        self.replace_scene(NextScene::Bundled(BUNDLED_SPLAT));
                    }
                });
            });
    }

    /// Tells how the light is turned, until it was.
    pub(super) fn hint(&mut self, context: &egui::Context) {
        let knows = &mut self.preferences.knows_how_to_turn_the_light;
        *knows |= self.viewport.light_was_turned;
        if *knows || self.session.asset().is_none() {
            return;
        }
        let rect = self.viewport.rect;
        egui::Area::new(egui::Id::unique("hint"))
            .pivot(egui::Align2::CENTER_BOTTOM)
            .fixed_pos(rect.center_bottom() - egui::vec2(0.0, 14.0))
            .order(egui::Order::Middle)
            .show(context, |ui| {
                egui::Frame::popup(ui.style()).show(ui, |ui| {
                    ui.horizontal(|ui| {
                        ui.label(tr("Shift + right drag rotates the light. Drop a splat or an HDRI on the window."));
                        let close = ui.small_button("×").on_hover_text(tr("Do not show it again"));
                        named(&close, egui::Role::Button, tr("Close the hint"));
                        *knows |= close.clicked();
                    });
                });
            });
    }

    pub(super) fn sheet_of_shortcuts(&mut self, context: &egui::Context) {
        let whole = context.content_rect();
        let corner = whole.left_top() + egui::vec2(20.0, 34.0);
        let mut open = self.shown.help;
        egui::Window::new(tr("Shortcuts"))
            .default_pos(corner)
            .open(&mut open)
            .resizable(false)
            .show(context, |ui| {
                let room = (whole.height() - 110.0).max(160.0);
                egui::ScrollArea::both()
                    .max_height(room)
                    .max_width(whole.width() - 60.0)
                    .show(ui, |ui| {
                        ui.horizontal_top(|ui| {
                            let mut gestures = shortcuts::camera_drags(self.preferences.navigation);
                            gestures.extend(GESTURES);
                            let gestures: Vec<_> = (gestures.into_iter())
                                .map(|(gesture, what)| (tr(gesture).to_owned(), tr(what)))
                                .collect();
                            sheet(ui, "gestures", &gestures);
                            ui.separator();
                            let keys = SHORTCUTS
                                .map(|(m, key, _, what)| (shortcuts::name(m, key), tr(what)));
                            for (column, keys) in keys.chunks(keys.len().div_ceil(2)).enumerate() {
                                sheet(ui, ["keys", "more keys"][column], keys);
                                ui.separator();
                            }
                        });
                    });
            });
        let escape = context.input(|i| i.key_pressed(Key::Escape));
        self.shown.help = open && !escape;
        let mut open = self.shown.about;
        egui::Window::new(tr("About"))
            .default_pos(corner)
            .open(&mut open)
            .resizable(false)
            .show(context, |ui| {
                ui.label(concat!("transplat ", env!("CARGO_PKG_VERSION")));
                ui.label(tr(
                    "Relights captured objects by radiance transfer, after the paper “TranSplat”.",
                ));
            });
        self.shown.about = open && !escape;
    }

    pub(super) fn path_window(&mut self, context: &egui::Context) {
        let Some(mut field) = self.shown.path_field.take() else {
            return;
        };
        let (mut open, mut is_shown) = (true, true);
        let mut act = None;
        in_the_middle(tr("Path"), self.viewport.rect)
            .open(&mut is_shown)
            .show(context, |ui| {
                let label = ui.label(match &field.dialog {
                    None => tr("File or folder to open, or file to save:"),
                    Some(Dialog::Open) => tr("No file dialog is available. File to open:"),
                    Some(Dialog::OpenFolder) => tr("No file dialog is available. Folder to open:"),
                    Some(Dialog::Save(SaveKind::Backplate, _)) => {
                        tr("No file dialog is available. Backplate to open:")
                    }
                    Some(Dialog::Save(SaveKind::OpenRig, _)) => {
                        tr("No file dialog is available. Rig to open (.json):")
                    }
                    Some(Dialog::Save(SaveKind::Lut, _)) => {
                        tr("No file dialog is available. LUT to open (.cube):")
                    }
                    Some(Dialog::Save(SaveKind::Folder, _)) => {
                        tr("No file dialog is available. Folder for images:")
                    }
                    Some(Dialog::Save(..)) => tr("No file dialog is available. File to save:"),
                });
                let edit = egui::TextEdit::singleline(&mut field.text).desired_width(420.0);
                let response = ui.add(edit).labelled_by(label.id);
                let asked_again = ui.input(|i| i.modifiers.command && i.key_pressed(Key::O));
                if std::mem::take(&mut field.is_new) || asked_again {
                    response.request_focus();
                    select_stem(context, response.id, &field.text);
                }
                open &= !ui.input(|i| i.key_pressed(Key::Escape));
                if response.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter)) {
                    act = field.actions().first().map(|(_, kind)| *kind);
                }
                let named = !field.text.trim().is_empty();
                ui.horizontal(|ui| {
                    for (name, kind) in field.actions() {
                        let button = egui::Button::new(name);
                        if ui.add_enabled(named, button).clicked() {
                            act = Some(kind);
                        }
                    }
                    open &= !ui.button(tr("Cancel")).clicked();
                });
            });
        match act {
            Some(kind) if !field.text.trim().is_empty() => {
                let path = path_as_typed(&field.text);
                match kind {
                    None => self.open(&path),
                    Some(kind) => self.save_to(&path, kind, false),
                }
            }
            _ if open && is_shown => self.shown.path_field = Some(field),
            _ => {}
        }
    }

    /// A picture as it would be saved, as large as there is room.
    pub(super) fn preview_window(&mut self, context: &egui::Context) {
        let Some(picture) = &self.preview else {
            return;
        };
        let mut is_shown = !context.input(|i| i.key_pressed(Key::Escape));
        let mut again = false;
        let session = &self.session;
        let is_this = |(scene, pose): &(Scene, CameraPose)| {
            *scene == session.project.scene && *pose == session.project.pose
        };
        let is_old = !self.previewed.as_ref().is_some_and(is_this);
        let room = 0.9 * self.viewport.rect.size();
        let size = picture.size_vec2();
        let scale = (room.x / size.x).min(room.y / size.y).min(1.0);
        in_the_middle(tr("Preview"), self.viewport.rect)
            .open(&mut is_shown)
            .show(context, |ui| {
                let image = egui::Image::new((picture.id(), size * scale));
                ui.add(image.alt_text(tr("The image as it would be saved")));
                if is_old {
                    ui.horizontal(|ui| {
                        ui.weak(tr("The scene has changed since."));
                        again = ui.button(tr("Preview again")).clicked();
                    });
                }
            });
        if !is_shown {
            self.preview = None;
        }
        if again {
            self.export(Task::Preview);
        }
    }

    /// Keeps the window open while exports are under way, until it is said what is to become of them.
    pub(super) fn decide_on_quitting(&mut self, context: &egui::Context) {
        let under_way = self.session.jobs.is_awaited(Kind::Export);
        if context.input(|i| i.viewport().close_requested()) && under_way && !self.lost {
            context.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.quitting.get_or_insert_with(|| Quitting {
                since: Instant::now(),
                waits: false,
            });
        }
        if let Some(quitting) = self.quitting.take_if(|_| !under_way) {
            // An export that failed meanwhile is to be seen.
            let mut messages = self.session.messages.iter();
            if !messages.any(|m| m.is_error && m.since > quitting.since) {
                context.send_viewport_cmd(egui::ViewportCommand::Close);
            }
        }
    }

    /// Asks what is to become of exports that are under way.
    pub(super) fn quit_window(&mut self, context: &egui::Context) {
        let Some(quitting) = self.quitting else {
            return;
        };
        let of_export = |job: &&Job| job.kind == Kind::Export && !job.is_cancelled();
        let count = self.session.jobs.running().iter().filter(of_export).count();
        let asked = modal("quit").show(context, |ui| {
            ui.label(match count {
                _ if quitting.waits => tr("The window closes once all is saved.").into(),
                0 | 1 => tr("An export is still running.").into(),
                count => tr_format!("{count} exports are still running.", count = count),
            });
            ui.horizontal(|ui| {
                // It keeps its place: a second click must not meet another button.
                let label = egui::Button::new(tr("Quit when done"));
                if ui.add_enabled(!quitting.waits, label).clicked() {
                    self.quitting = Some(Quitting {
                        waits: true,
                        ..quitting
                    });
                }
                if ui.button(tr("Stop and quit")).clicked() {
                    self.session.jobs.cancel(Kind::Export);
                    context.send_viewport_cmd(egui::ViewportCommand::Close);
                }
                if ui.button(tr("Cancel")).clicked() {
                    self.quitting = None;
                }
            });
        });
        if asked.should_close() {
            self.quitting = None;
        }
    }

    pub(super) fn drop_hint(&self, context: &egui::Context) {
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
            tr("Drop splats, environments, looks or LUTs.\nDrop an environment on a slot below to use it there."),
            egui::FontId::proportional(20.0),
            Color32::WHITE,
        );
    }
}

/// Selects of a path what is to be typed anew: the name of its file, without what that ends in.
fn select_stem(context: &egui::Context, field: egui::Id, text: &str) {
    let cursor = |part: &str| CCursor::new(part.chars().count());
    let start = text.rfind(['/', '\\']).map_or(0, |at| at + 1);
    let end = text[start..].rfind('.').map_or(text.len(), |at| start + at);
    let mut state = egui::TextEdit::load_state(context, field).unwrap_or_default();
    let range = CCursorRange::two(cursor(&text[..start]), cursor(&text[..end]));
    state.cursor.set_char_range(Some(range));
    state.store(context, field);
}

fn sheet(ui: &mut Ui, name: &str, lines: &[(String, &str)]) {
    egui::Grid::new(name)
        .num_columns(2)
        .striped(true)
        .show(ui, |ui| {
            for (keys, what) in lines {
                ui.label(keys);
                ui.label(*what);
                ui.end_row();
            }
        });
}

/// Time left in words, where that is long enough to be shown.
fn left_in_words(left: Duration) -> Option<String> {
    match left.as_secs() {
        0..5 => None,
        s @ 5..100 => Some(tr_format!("{} s left", s.next_multiple_of(5))),
        s => Some(tr_format!("{} min left", s.div_ceil(60))),
    }
}
