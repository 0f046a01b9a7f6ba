//! A look that others are compared with, beside what it shows relit.

use transplat_core::color::Display;
use transplat_core::transfer::Part;
use transplat_gpu::rasterize::ResidentSh;

use super::session::{Pinned, Session};

impl Session {
    /// Keeps the settings as they are, to compare others with them.
    pub fn pin(&mut self) {
        if !self.live().has_relit() {
            self.error("there is nothing relit to be pinned yet");
            return;
        }
        if self.pin_what_is_shown(self.look.display) {
            self.pinned = Some(self.to_pin());
            self.against_pinned = true;
        }
    }

    /// Exchanges the pinned settings with those of now.
    pub fn swap_pinned(&mut self) {
        // What is on the screen is what is pinned now.
        if self.pinned.is_some() && self.pin_what_is_shown(self.look.display) {
            let now = self.to_pin();
            if let Some(pinned) = self.pinned.replace(now) {
                self.look = pinned.look;
            }
        }
    }

    fn to_pin(&self) -> Pinned {
        Pinned {
            look: self.look.clone(),
            sides: self.sides.clone(),
        }
    }

    /// Keeps what is shown relit, all parts of it.
    fn pin_what_is_shown(&mut self, display: Display) -> bool {
        let (Some(shown), Some(prepared)) = (&self.relit_for, &self.prepared) else {
            return false;
        };
        let unseen = self.unseen.0.clone();
        let lacks_none = shown.unseen == self.unseen.1 && !self.unseen_hides;
        if shown.part == Part::Whole && lacks_none {
            self.live().pin(display);
            return true;
        }
        let pinned = if self.relights_on_gpu {
            let mut live = self.live();
            let whole = live.relight(&shown.target.light, Part::Whole, &[]);
            whole.and_then(|()| {
                live.pin(display);
                live.relight(&shown.target.light, shown.part, &unseen)
            })
        } else {
            let whole = prepared.relight(&shown.target.light, Part::Whole);
            whole.map(|relit| {
                let sh = ResidentSh::upload(&self.context, &relit.sh, relit.degree, relit.encoding);
                self.live().pin_relit(sh, display);
            })
        };
        if let Err(error) = &pinned {
            self.error(error.to_string());
        }
        pinned.is_ok()
    }
}
