//! The channel *visibility*, made when it is asked for.

use transplat_core::present::View;
use transplat_core::settings::Method;

use crate::viewer::session::Session;

impl Session {
    pub(in crate::viewer) fn update_visibility(&mut self, at: usize) {
        let method = self.scene.transfer.method;
        let state = &mut self.states[at];
        let Some(made) = state.bakes.get(&method) else {
            return;
        };
        let Some(bake) = made.get().filter(|_| self.scene.view == View::Visibility) else {
            return;
        };
        // Among others it sees less.
        let traced = self.surroundings.made_from().map(|(of, _)| of);
        let among = traced.and_then(|of| of.iter().position(|(id, ..)| *id == state.id));
        let among = among.filter(|_| method == Method::Directional);
        let among = among.filter(|_| self.together.contains(&state.id));
        let scene = among.zip(self.surroundings.get());
        let key = (
            method,
            made.version(),
            scene.map(|_| self.surroundings.version()),
        );
        if state.visibility.ask(&key) {
            let open = match scene {
                Some((object, scene)) => scene.openness_of(object),
                None => bake.bake.openness(),
            };
            let colors = open.into_iter().map(|o| [o; 3]).collect();
            self.live().set_visibility(at, colors);
        }
    }
}
