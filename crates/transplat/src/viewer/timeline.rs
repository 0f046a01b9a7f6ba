//! Timeline under the image: keys of the light.

use eframe::egui::{self, Align2, Color32, Rect, RichText, Role, Sense, Stroke, Ui, pos2, vec2};
use lucide_icons::Icon;
use transplat_core::scene::{Ease, LONGEST, LightKey, MOST_KEYS};

use super::session::Session;
use super::style;
use super::widgets::{named, number};
use transplat_engine::language::{tr, tr_format};

/// Height of the panel.
pub const HEIGHT: f32 = 48.0;

/// Points from a key's middle to its tips, and how near it is taken.
const TIP: f32 = 6.0;
const REACH: f32 = 8.0;

/// Seconds that the bar shows at least, and beyond the last key, relative to it.
const LEAST_SHOWN: f64 = 5.0;
const BEYOND: f64 = 1.2;

/// Seconds between ticks of the bar, the first of them that leaves room for their numbers.
const TICKS: [f64; 7] = [1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 300.0];
const MOST_TICKS: f64 = 12.0;

/// Where a second key is put while there is none, in seconds after the first.
const NEXT: f64 = 2.0;

/// The light's time.
#[derive(Default)]
pub struct Timeline {
    pub is_shown: bool,
    /// In seconds.
    time: f64,
    is_playing: bool,
    /// The key that is dragged.
    held: Option<usize>,
    is_scrubbed: bool,
    /// Seconds that the bar shows, as long as something is dragged in it.
    shown: Option<f64>,
    /// Where the pointer is over the bar: the time of the key under it, or else the light's.
    pointed: Option<f64>,
    had_keys: bool,
}

impl Timeline {
    /// True while the light moves, and is no step to come back to.
    pub fn is_moving(&self) -> bool {
        self.is_playing || self.is_scrubbed || self.held.is_some()
    }

    /// Goes on, where it plays; it is shown where there were no keys and are some now.
    pub fn play(&mut self, context: &egui::Context, session: &mut Session) {
        let seconds = session.project.scene.animation.seconds();
        // Keys that a look comes with are not to be overlooked.
        let has_keys = !session.project.scene.animation.keys.is_empty();
        let had_keys = std::mem::replace(&mut self.had_keys, has_keys);
        self.is_shown |= has_keys && !had_keys;
        if !self.is_shown {
            self.let_go();
            (self.is_playing, self.pointed) = (false, None);
        }
        self.is_playing &= session.project.scene.animation.keys.len() > 1 && seconds > 0.0;
        // What is compared meanwhile is to stay as it is.
        if self.is_playing && session.project.comparing.is_none() {
            let gone = f64::from(context.input(|i| i.stable_dt)).min(0.5);
            self.time = (self.time + gone) % seconds;
            session.project.scene.go_to(self.time);
            context.request_repaint();
        }
    }

    /// The time that the light is at, in seconds.
    pub fn time(&self) -> f64 {
        self.time
    }

    /// If the pointer is over the bar, removes the key under it, or else that at its time. Returns whether the pointer is there.
    pub fn remove_pointed(&self, session: &mut Session) -> bool {
        if let Some(time) = self.pointed {
            remove_key(session, time);
        }
        self.pointed.is_some()
    }

    fn let_go(&mut self) {
        (self.held, self.shown) = (None, None);
        self.is_scrubbed = false;
    }

    /// The buttons and the bar.
    pub fn show(&mut self, ui: &mut Ui, session: &mut Session) {
        ui.horizontal_centered(|ui| {
            self.buttons(ui, session);
            self.bar(ui, session);
        });
    }

    fn buttons(&mut self, ui: &mut Ui, session: &mut Session) {
        let can_play = session.project.scene.animation.keys.len() > 1;
        let (icon, tip) = match self.is_playing {
            true => (Icon::Pause, tr("Pauses the animation.")),
            false => (Icon::Play, tr("Plays the light animation in a loop.")),
        };
        let text = RichText::new(char::from(icon)).font(style::icon());
        let play = ui.add_enabled(can_play, egui::Button::new(text));
        let name = if self.is_playing {
            tr("Pause")
        } else {
            tr("Play")
        };
        named(&play, Role::Button, name);
        if play.on_hover_text(tip).clicked() {
            self.is_playing = !self.is_playing;
        }
        let mut time = self.time;
        let drag = number(&mut time, 0.0..=LONGEST)
            .speed(0.02)
            .fixed_decimals(2)
            .suffix(tr(" s"));
        let drag = ui.add(drag).on_hover_text(tr("Time in seconds."));
        named(&drag, Role::SpinButton, tr("Time"));
        if drag.changed() {
            self.scrub(session, time);
        }
        let tip =
            tr("Sets a key of the light at this time: rotation, strength, sun and placed lights.");
        let key = ui.button(tr("Set key")).on_hover_text(tip);
        if key.clicked() {
            self.set_key(session);
        }
        let at = session.project.scene.animation.key_at(self.time);
        ui.add_enabled_ui(at.is_some(), |ui| {
            let tip = tr("Removes the key at this time. (Delete over the bar)");
            if ui.button(tr("Remove key")).on_hover_text(tip).clicked() {
                remove_key(session, self.time);
            }
        });
        // Always there, so that the bar beside it stays where it is.
        ui.add_enabled_ui(at.is_some(), |ui| {
            let keys = &mut session.project.scene.animation.keys;
            let key = at.and_then(|at| keys.get_mut(at));
            let mut is_smooth = key.as_ref().is_none_or(|key| key.ease == Ease::Smooth);
            ui.checkbox(&mut is_smooth, tr("Smooth"))
                .on_hover_text(tr("Eases in and out between this key and the next."));
            if let Some(key) = key {
                key.ease = if is_smooth {
                    Ease::Smooth
                } else {
                    Ease::Linear
                };
            }
        });
    }

    /// Keeps the light as it is; the second key is put a while after the first, if it would take its place.
    fn set_key(&mut self, session: &mut Session) {
        let keys = &session.project.scene.animation.keys;
        if keys.len() >= MOST_KEYS && session.project.scene.animation.key_at(self.time).is_none() {
            return session.error(tr_format!(
                "A scene holds up to {MOST_KEYS} keys. Remove some first.",
                MOST_KEYS = MOST_KEYS
            ));
        }
        let here = session.project.scene.animation.key_at(self.time);
        let (ease, is_first) = (here.map(|at| keys[at].ease), keys.is_empty());
        self.time = (100.0 * self.time).round() / 100.0;
        let key = session.project.scene.light_key(self.time);
        session.project.scene.animation.set(LightKey {
            ease: ease.unwrap_or_default(),
            ..key
        });
        if is_first {
            self.time = (self.time + NEXT).min(LONGEST);
        }
    }

    fn scrub(&mut self, session: &mut Session, time: f64) {
        self.time = time.clamp(0.0, LONGEST);
        session.project.scene.go_to(self.time);
    }

    /// Time from left to right with its keys; dragged, the light goes along, and keys are moved.
    fn bar(&mut self, ui: &mut Ui, session: &mut Session) {
        let size = vec2(ui.available_width().max(80.0), ui.available_height());
        let (rect, response) = ui.allocate_exact_size(size, Sense::click_and_drag());
        named(&response, Role::Slider, tr("Timeline"));
        let keys = &session.project.scene.animation.keys;
        // Under the pointer it does not stretch.
        let fitting = BEYOND * session.project.scene.animation.seconds();
        let shown = self
            .shown
            .unwrap_or(fitting.max(LEAST_SHOWN).max(self.time));
        let line = Rect::from_center_size(rect.center(), vec2(rect.width() - 4.0 * TIP, 4.0));
        let x = |time: f64| line.left() + (time / shown) as f32 * line.width();
        let painter = ui.painter_at(rect);
        let visuals = ui.visuals();
        let faint = visuals.widgets.inactive.bg_fill;
        painter.rect_filled(line, 2.0, faint);
        let step = TICKS.into_iter().find(|step| shown / step <= MOST_TICKS);
        let step = step.unwrap_or(LONGEST);
        for tick in 0..=(shown / step) as usize {
            let time = tick as f64 * step;
            let at = pos2(x(time), line.bottom() + 4.0);
            painter.vline(at.x, line.bottom()..=at.y, Stroke::new(1.0, faint));
            let color = visuals.weak_text_color();
            let text = format!("{time}");
            painter.text(at, Align2::CENTER_TOP, text, style::small(), color);
        }
        for (at, key) in keys.iter().enumerate() {
            let is_here = session.project.scene.animation.key_at(self.time) == Some(at);
            let color = match is_here {
                true => Color32::from_rgb(255, 214, 90),
                false => visuals.text_color(),
            };
            let at = pos2(x(key.time), line.center().y);
            let tips = [
                vec2(0.0, -TIP),
                vec2(TIP, 0.0),
                vec2(0.0, TIP),
                vec2(-TIP, 0.0),
            ];
            let tips = tips.map(|tip| at + tip).to_vec();
            painter.add(egui::Shape::convex_polygon(tips, color, Stroke::NONE));
        }
        let under = |at: egui::Pos2| {
            let mut keys = keys.iter();
            keys.position(|key| (x(key.time) - at.x).abs() < REACH)
        };
        let time_under = |at| under(at).map(|key| keys[key].time);
        self.pointed = (response.hover_pos()).map(|at| time_under(at).unwrap_or(self.time));
        let now = x(self.time);
        let hand = Stroke::new(1.5, visuals.selection.bg_fill);
        painter.vline(now, rect.y_range(), hand);
        let Some(at) = response.interact_pointer_pos() else {
            return self.let_go();
        };
        let time = f64::from((at.x - line.left()) / line.width()) * shown;
        let time = (time.clamp(0.0, LONGEST) * 100.0).round() / 100.0;
        if response.drag_started() {
            let pressed = ui.input(|i| i.pointer.press_origin()).unwrap_or(at);
            self.held = under(pressed);
        }
        if response.drag_stopped() {
            return self.let_go();
        }
        self.shown = response.dragged().then_some(shown);
        self.held = self.held.filter(|held| *held < keys.len());
        self.is_playing &= !response.dragged();
        if let (Some(held), true) = (self.held, response.dragged()) {
            // Keys stay in their order.
            let keys = &mut session.project.scene.animation.keys;
            let after = held.checked_sub(1).map_or(0.0, |i| keys[i].time + 0.01);
            let before = keys.get(held + 1).map_or(LONGEST, |key| key.time - 0.01);
            if after <= before {
                keys[held].time = time.clamp(after, before);
            }
            self.time = keys[held].time;
            session.project.scene.go_to(self.time);
        } else if response.dragged() || response.clicked() {
            let time = time_under(at).unwrap_or(time);
            self.is_scrubbed = response.dragged();
            self.scrub(session, time);
        }
    }
}

fn remove_key(session: &mut Session, time: f64) {
    let animation = &mut session.project.scene.animation;
    if let Some(at) = animation.key_at(time) {
        animation.keys.remove(at);
    }
}
