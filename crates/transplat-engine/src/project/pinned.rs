//! Pinned look that others are compared with.

use std::sync::Arc;

use transplat_core::color::Display;
use transplat_core::present::View;
use transplat_core::scene::{MOST_KEPT, Scene, Variant};
use transplat_core::transfer::{Part, Relit};
use transplat_gpu::live::{Drawing, LiveSh};

use crate::language::{tr, tr_format};
use crate::project::canvas::Canvas;
use crate::project::{Pinned, Project};

impl Project {
    /// The pinned look, where that is compared with.
    pub fn compared(&self) -> Option<&Pinned> {
        self.pinned.as_ref().filter(|p| p.is_compared)
    }

    /// Keeps the settings as they are, to compare others with them.
    pub fn pin(&mut self) {
        let Some(canvas) = self.canvas.clone() else {
            return;
        };
        let is_relit = (0..self.states.len()).any(|at| canvas.live().has_relit(at));
        if !is_relit {
            self.error(tr("Nothing is relit yet, so there is nothing to pin."));
            return;
        }
        if self.pin_what_is_shown(&canvas, self.scene.display) {
            self.pinned = Some(self.to_pin(true));
            self.keep_look();
        }
    }

    /// Pins one of the looks that are kept: it is shown until it is relit, and then what is shown now is shown again.
    pub fn compare_with(&mut self, at: usize) {
        if self.scene.variants.get(at).is_some() {
            // Another one instead.
            let last = self.comparing.take();
            if let Some([now, _]) = last.filter(|[_, compared]| self.scene == *compared) {
                self.scene = now;
            }
            let now = self.scene.clone();
            self.show_look(at);
            self.comparing = Some([now, self.scene.clone()]);
        }
    }

    /// Pins the look that was to be compared with, once it is relit.
    pub(crate) fn pin_compared(&mut self) {
        let Some([now, compared]) = self.comparing.take() else {
            return;
        };
        if self.scene != compared {
            let taken_back = Scene {
                environment: compared.environment.clone(),
                ..self.scene.clone()
            };
            // Its light could not be read, which was told, or something else was done since.
            if taken_back == compared {
                self.scene = now;
            }
            return;
        }
        if !self.is_relit_as_set() || self.not_final(View::After).is_some() {
            self.comparing = Some([now, compared]);
            return;
        }
        self.pin();
        self.scene = now;
    }

    /// Exchanges the pinned settings with those of now.
    pub fn swap_pinned(&mut self) {
        let Some(canvas) = self.canvas.clone().filter(|_| self.pinned.is_some()) else {
            return;
        };
        // What is on the screen is what is pinned now.
        if self.pin_what_is_shown(&canvas, self.scene.display) {
            let now = self.to_pin(self.compared().is_some());
            if let Some(pinned) = self.pinned.replace(now) {
                let last = std::mem::replace(&mut self.scene, pinned.scene);
                // What is kept belongs to neither of the two.
                (self.scene.bookmarks, self.scene.variants) = (last.bookmarks, last.variants);
            }
        }
    }

    fn to_pin(&self, is_compared: bool) -> Pinned {
        let sources = self.states.iter().map(|s| s.source.light.clone());
        Pinned {
            scene: self.scene.clone(),
            sources: sources.collect(),
            environment: self.environment.light.clone(),
            is_compared,
        }
    }

    fn pin_what_is_shown(&mut self, canvas: &Canvas, display: Display) -> bool {
        if self.scene.view.part() != Part::Whole && !self.together.is_empty() {
            return self.pin_jointly(canvas, display);
        }
        let has_asset = |at: &usize| self.states[*at].asset.is_some();
        let objects: Vec<usize> = (0..self.states.len()).filter(has_asset).collect();
        objects
            .into_iter()
            .all(|at| self.pin_object(at, canvas, display))
    }

    /// Keeps all objects as they are relit together, all parts of them.
    fn pin_jointly(&mut self, canvas: &Canvas, display: Display) -> bool {
        let Some((members, scene)) = self.scene_transfer_of_now() else {
            self.error(tr(
                "The objects are still being prepared. Try again when that is done.",
            ));
            return false;
        };
        let (target, turn) = self.scene_target(members[0]);
        match scene.relight_objects(&target.light.rotated(turn), Part::Whole, &[]) {
            Ok(relit) => {
                for (at, relit) in members.into_iter().zip(relit) {
                    pin_relit(canvas, at, relit, display);
                }
                true
            }
            Err(error) => {
                self.error(error.to_string());
                false
            }
        }
    }

    /// Keeps what is shown relit of an object, all parts of it.
    fn pin_object(&mut self, at: usize, canvas: &Canvas, display: Display) -> bool {
        let state = &self.states[at];
        let (Some(shown), Some(made)) = (state.relit.made_from(), state.prepared.get()) else {
            return false;
        };
        let lacks_none = shown.unseen == state.unseen.version && !state.unseen.has_hidden;
        if shown.part == Part::Whole && lacks_none && !shown.coarse {
            canvas.live().pin(at, display);
            return true;
        }
        let target = &shown.target.light;
        let pinned = if made.on_gpu {
            let mut live = canvas.live();
            let whole = live.relight(at, target, Part::Whole, &[]);
            whole.and_then(|()| {
                live.pin(at, display);
                live.relight(at, target, shown.part, &state.unseen.surfels)
            })
        } else {
            let whole = made.prepared.relight(target, Part::Whole);
            whole.map(|relit| {
                pin_relit(canvas, at, relit, display);
            })
        };
        if let Err(error) = &pinned {
            self.error(error.to_string());
        }
        pinned.is_ok()
    }

    /// Keeps the look as it is, unless it is kept already.
    pub fn keep_look(&mut self) {
        let look = self.scene.look_alone();
        let kept = &self.scene.variants;
        if kept.iter().any(|kept| kept.look == look) {
            return;
        }
        if kept.len() == MOST_KEPT {
            return self.error(tr_format!(
                "A scene holds up to {MOST_KEPT} looks. Remove some first.",
                MOST_KEPT = MOST_KEPT
            ));
        }
        let light = self.environment.light.name();
        let name = free(&light, kept.iter().map(|kept| kept.name.as_str()));
        self.scene.variants.push(Variant { name, look });
    }

    /// Shows a look that was kept, of what is open and from where it is seen.
    pub fn show_look(&mut self, at: usize) {
        if let Some(kept) = self.scene.variants.get(at) {
            self.scene = self.scene.clone().with_look(&kept.look);
        }
    }
}

fn pin_relit(canvas: &Canvas, at: usize, relit: Relit, display: Display) {
    let drawing = Drawing::fastest(&canvas.context);
    let sh = LiveSh::new(&canvas.context, &Arc::new(drawing.kept(relit)), drawing);
    canvas.live().pin_relit(at, sh, display);
}

/// A name that is not taken.
pub fn free<'a>(name: &str, taken: impl Iterator<Item = &'a str> + Clone) -> String {
    let is_free = |name: &String| !taken.clone().any(|taken| taken == name);
    let numbered = (2..).map(|n| format!("{name} {n}"));
    let mut names = std::iter::once(name.to_owned()).chain(numbered);
    names.find(is_free).unwrap_or_default()
}
