//! Saved looks and views of the scene, and their pages of the light library.

use eframe::egui::{
    self, Align2, Color32, ColorImage, Popup, PopupCloseBehavior, Rect, Sense, TextureHandle, Ui,
    vec2,
};
use transplat_core::camera::CameraPose;
use transplat_core::present::View;
use transplat_core::scene::{Bookmark, MOST_KEPT, Scene, Transform};

use super::session::Session;
use super::thumbnail::{NAME_HEIGHT, THUMBNAIL, add_button, paint_thumbnail};
use super::widgets::{entry, named};
use transplat_engine::language::{tr, tr_format};
use transplat_engine::project::pinned::free;

/// Pixels of a picture.
const PIXELS: [usize; 2] = [224, 112];

impl Session {
    /// Keeps where it is seen from, unless it is kept already.
    pub fn keep_view(&mut self) {
        let kept = &self.project.scene.bookmarks;
        if kept.iter().any(|kept| kept.camera == self.project.pose) {
            return;
        }
        if kept.len() == MOST_KEPT {
            return self.error(tr_format!(
                "A scene holds up to {MOST_KEPT} views. Remove some first.",
                MOST_KEPT = MOST_KEPT
            ));
        }
        let name = free(tr("view"), kept.iter().map(|kept| kept.name.as_str()));
        let camera = self.project.pose;
        self.project.scene.bookmarks.push(Bookmark { name, camera });
    }

    /// Looks from where a view was kept.
    pub fn show_view(&mut self, at: usize) {
        if let Some(kept) = self.project.scene.bookmarks.get(at) {
            self.project.pose = kept.camera;
        }
    }

    /// The look that is shown, of those that are kept.
    fn shown_look(&self) -> Option<usize> {
        let look = self.project.scene.look_alone();
        self.project
            .scene
            .variants
            .iter()
            .position(|kept| kept.look == look)
    }

    fn shown_view(&self) -> Option<usize> {
        let is_it = |kept: &Bookmark| kept.camera == self.project.pose;
        self.project.scene.bookmarks.iter().position(is_it)
    }

    /// Shows the next of the looks that are kept, or the one before.
    pub fn next_look(&mut self, is_forward: bool) {
        let next = next(
            self.shown_look(),
            self.project.scene.variants.len(),
            is_forward,
        );
        next.into_iter().for_each(|at| self.project.show_look(at));
    }

    /// Looks from the next of the views that are kept, or the one before.
    pub fn next_view(&mut self, is_forward: bool) {
        let next = next(
            self.shown_view(),
            self.project.scene.bookmarks.len(),
            is_forward,
        );
        next.into_iter().for_each(|at| self.show_view(at));
    }

    /// A small picture of the look that is shown, from anywhere.
    fn small_picture(&self, pose: &CameraPose) -> Option<ColorImage> {
        let mut frame = self.frame_from(pose, PIXELS, View::After)?;
        frame.presentation.ground.grid = None;
        frame.marks = false;
        let mut live = self.canvas.live();
        live.frame(&frame);
        let (pixels, size) = live.read_screen().ok()?;
        let byte = |v: f32| (v * 255.0).round() as u8;
        let pixels = pixels
            .iter()
            .map(|[r, g, b]| Color32::from_rgb(byte(*r), byte(*g), byte(*b)));
        (size == PIXELS).then(|| ColorImage::new(size, pixels.collect()))
    }
}

/// The number after one, around the end; the first one where there was none.
fn next(at: Option<usize>, count: usize, is_forward: bool) -> Option<usize> {
    let at = match (at, is_forward) {
        (Some(at), true) => at + 1,
        (Some(at), false) => at + count - 1,
        (None, true) => 0,
        (None, false) => count.checked_sub(1)?,
    };
    at.checked_rem(count)
}

/// Subject of a thumbnail.
struct ThumbnailSubject {
    kept: KeptEntry,
    objects: Vec<CardPlace>,
}

enum KeptEntry {
    Look(Box<Scene>),
    View(CameraPose),
}

/// An object by its number, where it stands, and whether it is shown.
type CardPlace = (u64, Transform, bool);

fn placed(session: &Session) -> Vec<CardPlace> {
    let each = session
        .project
        .scene
        .objects
        .iter()
        .zip(&session.project.states);
    each.map(|(object, state)| (state.id, object.transform, object.shown))
        .collect()
}

/// Action on something kept.
#[derive(Clone, Copy)]
enum Wish {
    Show,
    Compare,
    Update,
    Left,
    Right,
    Remove,
}

/// Pictures of what is kept, of the objects as they stand: a look once it was shown, a view under the light of the time.
#[derive(Default)]
pub struct Thumbnails(Vec<(ThumbnailSubject, TextureHandle)>);

impl Thumbnails {
    /// The looks that are kept.
    pub fn looks(&self, ui: &mut Ui, session: &mut Session) {
        let shown = session.shown_look();
        let objects = placed(session);
        let mut wished = None;
        for at in 0..session.project.scene.variants.len() {
            let picture = self.of_look(&session.project.scene.variants[at].look, &objects);
            let kept = &mut session.project.scene.variants[at];
            let note = kept.look.note.clone();
            let pinned = session.project.pinned.as_ref().filter(|p| p.is_compared);
            let is_pinned = pinned.is_some_and(|p| p.scene.look_alone() == kept.look);
            let badge = is_pinned.then_some(tr("pinned"));
            let card = Card {
                what: tr("Look"),
                replace: tr("Replace by current look"),
                tip: if note.is_empty() {
                    tr("Click: use this look. Right-click: more.").into()
                } else {
                    tr_format!(
                        "{note}\n\nClick: use this look. Right-click: more.",
                        note = note
                    )
                },
                is_shown: shown == Some(at),
                badge,
                compares: true,
            };
            let wish = card.show(ui, &mut kept.name, picture.as_ref());
            wished = wish.map(|wish| (at, wish)).or(wished);
        }
        if add(
            ui,
            tr("Add look"),
            tr("Saves light and look in the library. (P also pins it.)"),
        ) {
            session.project.keep_look();
        }
        if session.project.scene.variants.is_empty() {
            explain_empty(
                ui,
                tr("Saved looks appear here, to return to and to compare."),
            );
        }
        match wished {
            Some((at, Wish::Show)) => session.project.show_look(at),
            Some((at, Wish::Compare)) => session.project.compare_with(at),
            Some((at, Wish::Update)) => {
                session.project.scene.variants[at].look = session.project.scene.look_alone()
            }
            Some((at, wish)) => rearrange(&mut session.project.scene.variants, at, wish),
            None => {}
        }
    }

    /// The views that are kept.
    pub fn views(&self, ui: &mut Ui, session: &mut Session) {
        let shown = session.shown_view();
        let objects = placed(session);
        let mut wished = None;
        for at in 0..session.project.scene.bookmarks.len() {
            let picture = self.of_view(&session.project.scene.bookmarks[at].camera, &objects);
            let kept = &mut session.project.scene.bookmarks[at];
            let card = Card {
                what: tr("View"),
                replace: tr("Replace by current view"),
                tip: tr("Click: use this view. Right-click: more.").into(),
                is_shown: shown == Some(at),
                badge: None,
                compares: false,
            };
            let wish = card.show(ui, &mut kept.name, picture.as_ref());
            wished = wish.map(|wish| (at, wish)).or(wished);
        }
        if add(
            ui,
            tr("Add view"),
            tr("Saves the view in the library. (ctrl + B)"),
        ) {
            session.keep_view();
        }
        if session.project.scene.bookmarks.is_empty() {
            explain_empty(ui, tr("Saved views appear here."));
        }
        match wished {
            Some((at, Wish::Show)) => session.show_view(at),
            Some((at, Wish::Update)) => {
                session.project.scene.bookmarks[at].camera = session.project.pose
            }
            Some((at, wish)) => rearrange(&mut session.project.scene.bookmarks, at, wish),
            None => {}
        }
    }

    fn of_look(&self, look: &Scene, objects: &[CardPlace]) -> Option<TextureHandle> {
        self.find(
            objects,
            |kept| matches!(kept, KeptEntry::Look(of) if **of == *look),
        )
    }

    fn of_view(&self, pose: &CameraPose, objects: &[CardPlace]) -> Option<TextureHandle> {
        self.find(
            objects,
            |kept| matches!(kept, KeptEntry::View(of) if of == pose),
        )
    }

    fn find(
        &self,
        objects: &[CardPlace],
        is_it: impl Fn(&KeptEntry) -> bool,
    ) -> Option<TextureHandle> {
        let mut all = self.0.iter();
        let found = all.find(|(of, _)| of.objects == objects && is_it(&of.kept));
        found.map(|(_, picture)| picture.clone())
    }

    /// Draws what has no picture yet and can have one now, one at a time; the viewport is drawn after it.
    pub fn draw(&mut self, context: &egui::Context, session: &Session) {
        let scene = &session.project.scene;
        if scene.variants.is_empty() && scene.bookmarks.is_empty() || !session.is_settled() {
            return;
        }
        if session.project.not_final(View::After).is_some() {
            return;
        }
        let objects = placed(session);
        let shown = session.shown_look().map(|at| &scene.variants[at].look);
        let shown = shown.filter(|look| self.of_look(look, &objects).is_none());
        let shown = shown.map(|look| {
            (
                KeptEntry::Look(Box::new(look.clone())),
                session.project.pose,
            )
        });
        let views = scene.bookmarks.iter().map(|kept| kept.camera);
        let views = views.filter(|pose| self.of_view(pose, &objects).is_none());
        let views = views.map(|pose| (KeptEntry::View(pose), pose));
        let mut missing = shown.into_iter().chain(views);
        let Some((kept, pose)) = missing.next() else {
            return;
        };
        if missing.next().is_some() {
            context.request_repaint();
        }
        let Some(picture) = session.small_picture(&pose) else {
            return;
        };
        let texture = context.load_texture("kept", picture, egui::TextureOptions::LINEAR);
        // What was removed may come back by undo.
        if self.0.len() > 2 * MOST_KEPT {
            drop(self.0.remove(0));
        }
        self.0.push((ThumbnailSubject { kept, objects }, texture));
    }
}

/// Something kept, as it is shown.
struct Card {
    what: &'static str,
    replace: &'static str,
    tip: String,
    is_shown: bool,
    badge: Option<&'static str>,
    /// True where others can be compared with it.
    compares: bool,
}

impl Card {
    /// Shows it, and yields the action that was chosen; its name is changed in place.
    fn show(self, ui: &mut Ui, name: &mut String, picture: Option<&TextureHandle>) -> Option<Wish> {
        let inside = ui.vertical(|ui| {
            ui.set_width(THUMBNAIL.x);
            ui.add_space(NAME_HEIGHT);
            let (rect, response) = ui.allocate_exact_size(THUMBNAIL, Sense::click());
            named(
                &response,
                egui::Role::Button,
                format!("{} {name}", self.what),
            );
            paint_thumbnail(ui, rect, picture, self.is_shown, response.hovered());
            if picture.is_none() {
                let font = egui::FontId::proportional(11.0);
                let color = ui.visuals().weak_text_color();
                let text = tr("preview after\nfirst use");
                ui.painter()
                    .text(rect.center(), Align2::CENTER_CENTER, text, font, color);
            }
            if let Some(badge) = self.badge {
                paint_badge(ui, rect, badge);
            }
            ui.add(egui::Label::new(egui::RichText::new(&*name).small()).truncate());
            response.on_hover_text(format!("{name}\n{}", self.tip))
        });
        let response = inside.inner;
        let mut wish = response.clicked().then_some(Wish::Show);
        Popup::context_menu(&response)
            .close_behavior(PopupCloseBehavior::CloseOnClickOutside)
            .show(|ui| {
                ui.horizontal(|ui| {
                    let label = ui.label(tr("Name"));
                    let edit = egui::TextEdit::singleline(name).desired_width(120.0);
                    let edit = ui.add(edit).labelled_by(label.id);
                    if edit.lost_focus() && ui.input(|i| i.key_pressed(egui::Key::Enter)) {
                        ui.close();
                    }
                });
                if self.compares && entry(ui, tr("Compare")) {
                    wish = Some(Wish::Compare);
                }
                for (name, what) in [
                    (self.replace, Wish::Update),
                    (tr("Move left"), Wish::Left),
                    (tr("Move right"), Wish::Right),
                    (tr("Remove"), Wish::Remove),
                ] {
                    if entry(ui, name) {
                        wish = Some(what);
                    }
                }
            });
        wish
    }
}

/// Moves one of a list, or takes it out.
fn rearrange<T>(list: &mut Vec<T>, at: usize, wish: Wish) {
    match wish {
        Wish::Left if at > 0 => list.swap(at, at - 1),
        Wish::Right if at + 1 < list.len() => list.swap(at, at + 1),
        Wish::Remove => {
            list.remove(at);
        }
        _ => {}
    }
}

fn paint_badge(ui: &Ui, rect: Rect, text: &str) {
    let painter = ui.painter();
    let font = egui::FontId::proportional(10.0);
    let text = painter.layout_no_wrap(text.into(), font, Color32::WHITE);
    let size = text.size() + vec2(8.0, 2.0);
    let place = Rect::from_min_size(rect.left_top() + vec2(3.0, 3.0), size);
    painter.rect_filled(place, 3.0, Color32::from_black_alpha(170));
    painter.galley(place.min + vec2(4.0, 1.0), text, Color32::WHITE);
}

/// Says what an empty page is for.
fn explain_empty(ui: &mut Ui, text: &str) {
    ui.vertical(|ui| {
        ui.add_space(NAME_HEIGHT + 0.4 * THUMBNAIL.y);
        ui.weak(text);
    });
}

fn add(ui: &mut Ui, name: &str, tip: &str) -> bool {
    let response = add_button(ui, name).on_hover_text(tip);
    response.clicked()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_steps_around_what_is_kept() {
        assert_eq!(next(None, 0, true), None);
        assert_eq!(next(None, 0, false), None);
        assert_eq!(next(None, 3, true), Some(0));
        assert_eq!(next(None, 3, false), Some(2));
        assert_eq!(next(Some(2), 3, true), Some(0));
        assert_eq!(next(Some(0), 3, false), Some(2));
    }

    #[test]
    fn names_are_told_apart() {
        let taken = ["view", "view 2"];
        assert_eq!(free("view", taken.iter().copied()), "view 3");
        assert_eq!(free("dusk", taken.iter().copied()), "dusk");
    }
}
