//! The channel *visibility*, made when it is asked for.

use transplat_core::present::View;

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
        let key = (method, made.version());
        if state.visibility.ask(&key) {
            let colors = bake.bake.openness().iter().map(|o| [*o; 3]).collect();
            self.live().set_visibility(at, colors);
        }
    }
}
