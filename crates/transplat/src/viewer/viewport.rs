//! Viewport: the image, and what the mouse does there.

use eframe::egui::{self, Key, PointerButton, Pos2, Rect, Sense, Ui};
use eframe::{egui_wgpu, wgpu};
use glam::{DVec3, Vec2, Vec3};
use transplat_core::camera::Camera;
use transplat_core::present::View;
use transplat_core::rasterize::{Pick, pick};
use transplat_core::surfels::UpAxis;

use super::annotations::{annotate, draw_capture_light, draw_crop_box, mark_surfel, tag};
use super::gestures::{DragStep, Gesture, Gestures, NavigationPreset, Press};
use super::gizmo::{Gizmo, KeyedTransform};
use super::light_handles::LightHandles;
use super::navigation;
use super::projection::Screen;
use super::rigs::mirrored;
use super::session::Session;
use super::tabs::LightPage;
use super::widgets::named;
use transplat_engine::language::tr;
use transplat_engine::project::canvas::Canvas;
use transplat_engine::project::{SOURCE, TARGET};

/// Cosine to where a highlight is wanted from which it is there.
const NEAR_ENOUGH: f64 = 0.999;

/// A frame on the GPU that takes longer than this makes a drag step down in quality.
const SLOW_FRAME_MS: f64 = 40.0;

/// Seconds after the last move until full quality comes back.
const SETTLE_S: f64 = 0.2;

/// Coarsest step of quality: edges are divided by it.
const MAX_STEP: usize = 4;

/// Least distance of a light that is placed by a shadow, in distances from that to what throws it.
const BEHIND: f64 = 1.5;

/// Points from the wipe's line within which it is taken.
const WIPE_REACH: f32 = 6.0;

/// Way of setting a light by its effect on an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placing {
    /// The capture light makes white what is there.
    White,
    /// The brightest part of the capture light is mirrored there.
    CapturedHighlight,
    /// Its reflection is seen where the pointer is.
    Highlight,
    /// Its shadow falls there, of what was under the pointer at the press.
    Shadow,
    /// It shines there.
    Aim,
}

impl Placing {
    /// Page of the panel *Light* that it is chosen on.
    pub fn page(self) -> LightPage {
        match self {
            Self::White | Self::CapturedHighlight => LightPage::CapturedUnder,
            Self::Highlight | Self::Shadow | Self::Aim => LightPage::Lights,
        }
    }
}

/// Says what a click or a drag does now.
fn say_what_to_do(ui: &Ui, rect: Rect, placing: Placing) {
    let text = match placing {
        Placing::White => tr("Click what is white. Esc to finish."),
        Placing::CapturedHighlight => tr("Click a captured highlight. Esc to finish."),
        Placing::Highlight => tr("Click or drag where the light should reflect. Esc to finish."),
        Placing::Shadow => {
            tr("Drag from the shadow caster to where its shadow should fall. Esc to finish.")
        }
        Placing::Aim => tr("Click where the light should aim. Esc to finish."),
    };
    let below = Pos2::new(rect.center().x, rect.top() + 62.0);
    tag(&ui.painter_at(rect), below, egui::Align2::CENTER_TOP, text);
}

/// State of the viewport.
pub struct Viewport {
    pub rect: Rect,
    /// Buttons and keys of the camera.
    pub navigation: NavigationPreset,
    last_move: f64,
    step: usize,
    gestures: Gestures,
    /// The surfel that was clicked, and the state of its object.
    pub clicked: Option<(u64, usize)>,
    /// The light turns with the camera.
    pub light_locked_to_camera: bool,
    /// True where the light was rotated here by hand.
    pub light_was_turned: bool,
    gizmo: Gizmo,
    lights: LightHandles,
    /// Transform that a key asks for.
    pub asked_transform: Option<KeyedTransform>,
    /// True while it follows the pointer.
    is_transforming: bool,
    /// Way that the next drag places a light.
    pub placing: Option<Placing>,
    /// True where the click of this frame placed a light or ended a transform.
    is_click_taken: bool,
    /// True where the pointer was on anything that a light could be placed by, since it was pressed.
    has_met: bool,
    /// Frame whose time quality was last set by.
    judged: u64,
}

impl Default for Viewport {
    fn default() -> Self {
        Self {
            rect: Rect::NOTHING,
            navigation: NavigationPreset::default(),
            last_move: -1e9,
            step: 1,
            gestures: Gestures::default(),
            clicked: None,
            light_locked_to_camera: false,
            light_was_turned: false,
            gizmo: Gizmo::default(),
            lights: LightHandles::default(),
            asked_transform: None,
            is_transforming: false,
            placing: None,
            is_click_taken: false,
            has_met: false,
            judged: 0,
        }
    }
}

struct Paint(Canvas);

impl egui_wgpu::CallbackTrait for Paint {
    fn paint(
        &self,
        _info: egui::PaintCallbackInfo,
        pass: &mut wgpu::RenderPass<'static>,
        _resources: &egui_wgpu::CallbackResources,
    ) {
        self.0.live().paint(pass);
    }
}

impl Viewport {
    /// Shows the asset in all the room there is; `hold_before` shows it as captured for now.
    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, hold_before: bool) {
        let (rect, response) = ui.allocate_exact_size(ui.available_size(), Sense::click_and_drag());
        self.rect = rect;
        named(&response, egui::Role::Canvas, tr("Viewport"));
        let seen = |s: &Session| {
            let place = s.object().transform;
            let lights = s.project.scene.lights.clone();
            (
                s.project.pose,
                s.project.scene.environment.clone(),
                lights,
                s.project.scene.wipe,
                place,
            )
        };
        let before = seen(session);
        self.follow_pointer(ui, session);
        self.navigate(ui, session, &response);
        if self.light_locked_to_camera {
            // As the camera was moved here, and by nothing else.
            let turned = navigation::wrap(session.project.pose.azimuth - before.0.azimuth);
            let target = &mut session.project.scene.environment;
            target.rotation = navigation::wrap(target.rotation + turned);
        }
        let now = ui.input(|i| i.time);
        if before != seen(session) {
            self.last_move = now;
        }
        let view = if hold_before {
            View::Before
        } else {
            session.project.scene.view
        };
        let pixels = self.picture_size(ui, session, now);
        session.project.viewport = pixels;
        if let Some(mut frame) = session.frame(pixels, view) {
            frame.pixel_step = self.step;
            let start = std::time::Instant::now();
            let ran = session.canvas.live().frame(&frame);
            if ran {
                let timer = &session.canvas.timers.frame;
                timer.measure(&session.canvas.context, start, session.jobs.wake());
            }
            let callback = Paint(session.canvas.clone());
            ui.painter()
                .add(egui_wgpu::Callback::new_paint_callback(rect, callback));
        }
        if let Some((camera, ..)) = self.camera_at(session, self.rect.min) {
            let mut parts = [self.rect.left_top(), self.rect.right_top()]
                .map(|at| self.part_at(session, Some(at)))
                .to_vec();
            parts.dedup();
            for part in parts {
                draw_crop_box(ui, part, session, &camera);
                draw_capture_light(
                    ui,
                    session,
                    Screen {
                        camera: &camera,
                        part,
                    },
                );
                mark_surfel(ui, part, session, &camera, self.inspected(session));
            }
        }
        annotate(ui, self.rect, session, view);
        if let Some(placing) = self.placing {
            say_what_to_do(ui, self.rect, placing);
        }
        if let Some((part, camera)) = self.shown_part(ui, session, &response) {
            let screen = Screen {
                camera: &camera,
                part,
            };
            if session.overlays.lights {
                self.lights.draw(ui, session, &response, screen);
            } else {
                self.gizmo.draw(ui, session, &response, screen);
            }
        }
    }

    /// Pixels of the picture: those of the screen, or fewer while something moves and frames are slow.
    fn picture_size(&mut self, ui: &Ui, session: &Session, now: f64) -> [usize; 2] {
        let moving = now - self.last_move < SETTLE_S;
        if moving {
            let (ms, frame) = (
                session.canvas.timers.frame.ms(),
                session.canvas.timers.frame.count(),
            );
            // Once for each measured frame; and back only to what would be fast enough.
            if frame != self.judged {
                self.judged = frame;
                let finer = (self.step as f64 / (self.step as f64 - 1.0).max(0.5)).powi(2);
                if ms > SLOW_FRAME_MS && self.step < MAX_STEP {
                    self.step += 1;
                } else if self.step > 1 && ms * finer < 0.7 * SLOW_FRAME_MS {
                    self.step -= 1;
                }
            }
            ui.request_repaint_after_secs(SETTLE_S as f32 + 0.02);
        } else {
            self.step = 1;
        }
        let scale = ui.pixels_per_point() / self.step as f32;
        let pixels = |points: f32| ((points * scale).round() as usize).clamp(1, 8192);
        [pixels(self.rect.width()), pixels(self.rect.height())]
    }

    /// The picture that a place belongs to: one of two side by side, or all of the viewport.
    fn part_at(&self, session: &Session, at: Option<Pos2>) -> Rect {
        if session.project.scene.view != View::SideBySide {
            return self.rect;
        }
        let middle = self.rect.center().x;
        let (left, right) = self.rect.split_left_right_at_x(middle);
        if at.is_some_and(|p| p.x >= middle) {
            right
        } else {
            left
        }
    }

    /// From a place in the window to the picture's pixels and its camera.
    fn camera_at(&self, session: &Session, at: Pos2) -> Option<(Camera, usize, usize)> {
        let bounds = session.project.scene_bounds()?;
        let size = [
            self.rect.width().max(1.0) as usize,
            self.rect.height().max(1.0) as usize,
        ];
        let whole = Camera::from_pose(
            &session.project.pose,
            session.project.scene_up(),
            size,
            bounds.radius,
        );
        let at = at - self.rect.min;
        if session.project.scene.view == View::SideBySide {
            let half = transplat_engine::render::half(&whole);
            let x = at.x as usize % half.width.max(1);
            return Some((half, x, at.y as usize));
        }
        Some((whole, at.x as usize, at.y as usize))
    }

    fn pick_at(&self, session: &Session, at: Pos2) -> Option<Pick> {
        self.picked(session, at).map(|(_, pick)| pick)
    }

    /// The object that is in front at a place in the window, and its surfel; where that is in the scene.
    fn picked(&self, session: &Session, at: Pos2) -> Option<(usize, Pick)> {
        let (camera, x, y) = self.camera_at(session, at)?;
        let each = session
            .project
            .scene
            .objects
            .iter()
            .zip(&session.project.states)
            .enumerate();
        let shown = each.filter(|(_, (object, _))| object.shown);
        let picks = shown.filter_map(|(which, (object, state))| {
            let asset = state.asset.as_ref()?;
            let hidden = state.hidden.get().map_or(&[][..], |h| h);
            let scene_from_object = object.transform.scene_from_object();
            let seen = camera.seen_from(scene_from_object);
            let mut pick = pick(&asset.cloud, &seen, hidden, x, y)?;
            pick.position = scene_from_object.transform_point3(pick.position);
            Some((which, pick))
        });
        let distance = |(_, pick): &(usize, Pick)| pick.position.distance(camera.eye);
        picks.min_by(|a, b| distance(a).total_cmp(&distance(b)))
    }

    /// True while something is being dragged, or follows the pointer.
    pub fn is_dragging(&self) -> bool {
        self.gestures.held().is_some() || self.is_transforming
    }

    /// True while a transform follows the pointer.
    pub fn is_transforming(&self) -> bool {
        self.is_transforming
    }

    /// Ends a transform that follows the pointer: what it moved stays.
    pub fn end_transform(&mut self) {
        self.asked_transform = None;
        self.is_transforming = false;
    }

    /// Begins the transform that a key asked for, and lets it follow the pointer up to a click, Enter or Esc.
    fn follow_transform(&mut self, ui: &Ui, session: &mut Session) {
        let Some((camera, ..)) = self.camera_at(session, self.rect.min) else {
            return self.end_transform();
        };
        let at = ui.input(|i| i.pointer.latest_pos());
        let at = at.unwrap_or(self.rect.center());
        let screen = Screen {
            camera: &camera,
            part: self.part_at(session, Some(at)),
        };
        let of_light = session.overlays.lights;
        if let Some(by) = self.asked_transform.take()
            && self.rect.contains(at)
            && !self.is_dragging()
        {
            let holds = match of_light {
                true => by == KeyedTransform::Move && self.lights.hold_light(session, at, screen),
                false => self.gizmo.hold_object(session, by, at, screen),
            };
            self.is_transforming = holds;
        }
        if !self.is_transforming {
            return;
        }
        let key = |key| ui.input(|i| i.key_pressed(key));
        for (axis, name) in [Key::X, Key::Y, Key::Z].into_iter().enumerate() {
            if key(name) && !of_light {
                self.gizmo.constrain(axis);
            }
        }
        match of_light {
            true => self.lights.drag(session, at, screen),
            false => {
                let in_steps = ui.input(|i| i.modifiers.command);
                self.gizmo.drag(session, at, in_steps, screen);
            }
        }
        let cancels = key(Key::Escape) || ui.input(|i| i.pointer.secondary_pressed());
        if cancels {
            self.gizmo.cancel(session);
            self.lights.cancel(session);
        }
        if cancels || key(Key::Enter) || ui.input(|i| i.pointer.primary_pressed()) {
            self.is_transforming = false;
        }
    }

    /// Takes the pointer's events of this frame, in their order.
    fn follow_pointer(&mut self, ui: &Ui, session: &mut Session) {
        let mut has_placed = false;
        self.is_click_taken = false;
        let was_transforming = self.is_transforming;
        self.follow_transform(ui, session);
        for event in ui.input(|i| i.events.clone()) {
            if let Some(press) = self.gestures.press(&event) {
                if self.is_transforming || was_transforming {
                    // The press ends the transform, and its click selects nothing.
                    self.gestures.begin(Gesture::EndTransform, press);
                    continue;
                }
                let is_free = ui.ctx().layer_id_at(press.at) == Some(ui.layer_id());
                if ui.is_enabled() && is_free && self.rect.contains(press.at) {
                    let gesture = self.gesture_of(session, press);
                    self.gestures.begin(gesture, press);
                }
                continue;
            }
            let held = self.gestures.held();
            if let Some(step) = self.gestures.follow(&event) {
                self.take_step(session, &step);
            }
            if self.gestures.held().is_none() {
                has_placed |= held == Some(Gesture::Place);
                self.is_click_taken |= held == Some(Gesture::EndTransform);
            }
        }
        self.is_click_taken |= has_placed;
        self.gestures
            .hold_only(|button| ui.input(|i| i.pointer.button_down(button)));
        let held = self.gestures.held();
        let follows = self.is_transforming;
        if held != Some(Gesture::Handle) && !follows {
            self.gizmo.let_go();
        }
        if held != Some(Gesture::LightHandle) && !follows {
            self.lights.let_go();
        }
        if has_placed && !self.has_met && self.placing != Some(Placing::Shadow) {
            session.info(tr("Click or drag on an object."));
        }
        if (has_placed && self.has_met) || ui.input(|i| i.key_pressed(Key::Escape)) {
            self.placing = None;
        }
    }

    /// Gesture that a press begins.
    fn gesture_of(&mut self, session: &mut Session, press: Press) -> Gesture {
        let is_primary = press.button == PointerButton::Primary;
        if is_primary && self.is_on_wipe(session, Some(press.at)) {
            return Gesture::Wipe;
        }
        if let Some(gesture) = self.navigation.gesture(&press) {
            return gesture;
        }
        let on_nothing = self.navigation.on_nothing();
        match self.placing {
            Some(_) => {
                self.has_met = false;
                self.place(session, press.at, press.at);
                Gesture::Place
            }
            None => {
                let part = self.part_at(session, Some(press.at));
                let camera = self.camera_at(session, self.rect.min);
                let Some((camera, ..)) = camera else {
                    return on_nothing;
                };
                let screen = Screen {
                    camera: &camera,
                    part,
                };
                if session.overlays.lights {
                    if self.lights.hold(session, press.at, screen) {
                        return Gesture::LightHandle;
                    }
                } else if self.gizmo.hold(session, press.at, screen) {
                    return Gesture::Handle;
                }
                on_nothing
            }
        }
    }

    fn take_step(&mut self, session: &mut Session, step: &DragStep) {
        let part = self.part_at(session, Some(step.pressed_at));
        let shorter = part.width().min(part.height()).max(1.0);
        let (up, by) = (session.project.scene_up(), step.by());
        match step.gesture {
            Gesture::Orbit => navigation::orbit(&mut session.project.pose, by),
            Gesture::Pan => navigation::pan(&mut session.project.pose, up, by, shorter),
            Gesture::Zoom => {
                let radius = session.project.scene_bounds().map_or(1.0, |b| b.radius);
                let (factor, pose) = ((by.y / 150.0).exp(), &mut session.project.pose);
                navigation::zoom(pose, up, factor, Vec2::ZERO, shorter, radius);
            }
            Gesture::Select | Gesture::EndTransform => {}
            Gesture::LookAround => navigation::look_around(&mut session.project.pose, up, by),
            Gesture::TurnLight => {
                self.light_was_turned = true;
                navigation::turn_light(&mut session.project.scene.environment, by);
            }
            Gesture::Wipe => {
                let share = (step.to.x - self.rect.left()) / self.rect.width().max(1.0);
                session.project.scene.wipe = share.clamp(0.0, 1.0);
            }
            Gesture::Handle | Gesture::LightHandle => {
                let in_steps = step.modifiers.command;
                if let Some((camera, ..)) = self.camera_at(session, self.rect.min) {
                    let screen = Screen {
                        camera: &camera,
                        part,
                    };
                    match step.gesture {
                        Gesture::Handle => self.gizmo.drag(session, step.to, in_steps, screen),
                        _ => self.lights.drag(session, step.to, screen),
                    }
                }
            }
            Gesture::Place => self.place(session, step.pressed_at, step.to),
        }
    }

    /// Places the chosen light by what it does on the objects: where the pointer was pressed, and where it is.
    fn place(&mut self, session: &mut Session, from: Pos2, to: Pos2) {
        let placed = session.chosen_light().unwrap_or_default();
        let was_met = match self.placing {
            // Once: what a drag passes is relit already, or not yet.
            Some(Placing::White) if from != to => false,
            Some(Placing::White) => self.take_as_white(session, to),
            Some(Placing::CapturedHighlight) => {
                self.turn_highlight(session, to, SOURCE);
                self.picked(session, to).is_some()
            }
            Some(_) if session.project.scene.lights.is_empty() => false,
            Some(Placing::Aim) => self.aim(session, placed, to),
            Some(Placing::Highlight) => {
                let found = self.mirrored_at(session, to);
                if let Some([there, toward]) = found {
                    session.put_light(placed, there, toward.normalize_or(DVec3::Z), 0.0);
                }
                // What is there and not baked yet was told.
                found.is_some() || self.picked(session, to).is_some()
            }
            Some(Placing::Shadow) => self.cast_shadow(session, placed, from, to),
            None => false,
        };
        self.has_met |= was_met;
    }

    /// Sets the capture light so that what is at a point of the window is white, if anything is.
    fn take_as_white(&self, session: &mut Session, at: Pos2) -> bool {
        let Some((object, pick)) = self.picked(session, at) else {
            return false;
        };
        if let Err(why) = session.project.take_as_white(object, pick.surfel) {
            session.info(why);
        }
        true
    }

    /// Points a light at what is at a point of the window, if anything is.
    fn aim(&self, session: &mut Session, light: usize, at: Pos2) -> bool {
        let Some((_, pick)) = self.picked(session, at) else {
            return false;
        };
        let there = session.project.world_from_scene() * pick.position.as_dvec3();
        let source = &mut session.project.scene.lights[light].source;
        match source.position() {
            Some(position) => source.put(position, there),
            None => session.info(tr("A sun has no aim. Rotate it instead.")),
        }
        true
    }

    /// Place under a point of the window, and the direction that it mirrors to the eye, in the world.
    fn mirrored_at(&self, session: &mut Session, at: Pos2) -> Option<[DVec3; 2]> {
        let (object, pick) = self.picked(session, at)?;
        let (camera, ..) = self.camera_at(session, at)?;
        let Some(normal) = session.project.scene_normal(object, pick.surfel) else {
            session.info(tr("Wait for the bake to place a highlight."));
            return None;
        };
        let to_eye = (camera.eye - pick.position).normalize_or_zero();
        let in_scene = [pick.position, mirrored(normal, to_eye)];
        Some(in_scene.map(|v| session.project.world_from_scene() * v.as_dvec3()))
    }

    /// Puts a light so that what is at one point of the window throws its shadow to another, if they are two and there is something at both.
    fn cast_shadow(&self, session: &mut Session, light: usize, from: Pos2, to: Pos2) -> bool {
        let seen = |at: Pos2| self.picked(session, at).map(|(_, pick)| pick.position);
        let falls = seen(to).or_else(|| self.on_ground(session, to));
        let Some([caster, there]) = seen(from).zip(falls).map(<[Vec3; 2]>::from) else {
            return false;
        };
        let [caster, there] =
            [caster, there].map(|p| session.project.world_from_scene() * p.as_dvec3());
        // At the press both are one.
        let apart = caster.distance(there);
        let is_drawn = apart > 1e-3 * session.lit().radius;
        if is_drawn {
            // Behind what throws it.
            let toward = (caster - there).normalize();
            session.put_light(light, there, toward, BEHIND * apart);
        }
        is_drawn
    }

    /// Where a point of the window is on the ground under the objects.
    fn on_ground(&self, session: &Session, at: Pos2) -> Option<Vec3> {
        let (center, ..) = session.project.ground_plane()?;
        let (camera, ..) = self.camera_at(session, self.rect.min)?;
        let part = self.part_at(session, Some(at));
        let screen = Screen {
            camera: &camera,
            part,
        };
        let up = session.project.scene_up().direction();
        screen.on_plane(screen.inside(at), center, up)
    }

    /// The wheel, keys that fly, and clicks.
    fn navigate(&mut self, ui: &Ui, session: &mut Session, response: &egui::Response) {
        let up = session.project.scene_up();
        let radius = session.project.scene_bounds().map_or(1.0, |b| b.radius);
        let part = self.part_at(session, response.hover_pos());
        let shorter = part.width().min(part.height()).max(1.0);
        let held = self.gestures.held();
        if held == Some(Gesture::LookAround) {
            self.fly(ui, session, radius);
        }
        if self.placing.is_some() && response.hovered() {
            ui.set_cursor_icon(egui::CursorIcon::Crosshair);
        }
        let is_on_wipe = held.is_none() && self.is_on_wipe(session, response.hover_pos());
        if is_on_wipe || held == Some(Gesture::Wipe) {
            ui.set_cursor_icon(egui::CursorIcon::ResizeHorizontal);
        }
        if let Some(pointer) = response.hover_pos() {
            let scroll = ui.input(|i| i.smooth_scroll_delta().y + 300.0 * i.zoom_delta().ln());
            if scroll != 0.0 {
                let from_middle = pointer - part.center();
                let at = Vec2::new(from_middle.x, from_middle.y);
                let factor = (-scroll / 300.0).exp();
                navigation::zoom(&mut session.project.pose, up, factor, at, shorter, radius);
            }
        }
        if response.double_clicked() {
            if let Some(at) = response.interact_pointer_pos() {
                if ui.input(|i| i.modifiers.shift) {
                    self.turn_highlight(session, at, TARGET);
                } else if let Some(pick) = self.pick_at(session, at) {
                    navigation::set_pivot(&mut session.project.pose, up, pick.position);
                }
            }
        } else if response.clicked() && !self.is_click_taken && !ui.input(|i| i.modifiers.shift) {
            let at = response.interact_pointer_pos();
            let picked = at.and_then(|at| self.picked(session, at));
            if let Some((object, _)) = picked {
                session.selected = object;
            }
            self.clicked = picked.map(|(_, pick)| (session.state().id, pick.surfel));
        }
    }

    /// Turns the light of a side so that its brightest part is mirrored to the eye where the pointer is.
    fn turn_highlight(&self, session: &mut Session, at: Pos2, side: usize) {
        let Some([_, mut wanted]) = self.mirrored_at(session, at) else {
            return;
        };
        if side == SOURCE {
            session.selected = self
                .picked(session, at)
                .map_or(session.selected, |(o, _)| o);
            // It shone on the object where that was captured.
            wanted = session.project.captured_from(session.selected, wanted);
        }
        let Some(brightest) = session.light(side).brightest else {
            return session.info(tr("Uniform white has no highlight."));
        };
        let light = session.side_mut(side);
        let in_map = brightest.as_dvec3();
        light.bring(in_map, wanted);
        let came = light.map_from_asset(UpAxis::PlusZ).transpose() * in_map;
        if came.dot(wanted.normalize_or_zero()) < NEAR_ENOUGH {
            session.info(tr("The light cannot come closer without tilting."));
        }
    }

    /// The surfel that was clicked, where it is of the selected object.
    pub fn inspected(&self, session: &Session) -> Option<usize> {
        let (of, surfel) = self.clicked?;
        (of == session.state().id).then_some(surfel)
    }

    /// The picture that the pointer is in, or was when it went down, and its camera.
    fn shown_part(
        &self,
        ui: &Ui,
        session: &Session,
        response: &egui::Response,
    ) -> Option<(Rect, Camera)> {
        let (camera, ..) = self.camera_at(session, self.rect.min)?;
        let origin = ui.input(|i| i.pointer.press_origin());
        let part = self.part_at(session, origin.or(response.hover_pos()));
        Some((part, camera))
    }

    fn fly(&mut self, ui: &Ui, session: &mut Session, radius: f32) {
        let step = ui.input(|i| {
            let key = |key| if i.key_down(key) { 1.0f32 } else { 0.0 };
            use egui::Key::{A, D, E, Q, S, W};
            Vec3::new(key(D) - key(A), key(E) - key(Q), key(W) - key(S)) * i.stable_dt.min(0.1)
        });
        if step != Vec3::ZERO {
            let up = session.project.scene_up();
            navigation::fly(&mut session.project.pose, up, step * radius * 1.5);
        }
        ui.request_repaint();
    }

    /// True for a place on the line between before and after.
    fn is_on_wipe(&self, session: &Session, at: Option<Pos2>) -> bool {
        let line = self.rect.left() + session.project.scene.wipe * self.rect.width();
        let is_split = session.project.scene.view == View::Split;
        is_split && at.is_some_and(|p| (p.x - line).abs() <= WIPE_REACH)
    }
}
