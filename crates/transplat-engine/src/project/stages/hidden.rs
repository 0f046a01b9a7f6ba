//! Hidden surfels, which need no relight.

use std::sync::Arc;

use crate::object::Unseen;
use crate::project::Project;

impl Project {
    /// Hides the surfels that the settings hide.
    pub(crate) fn update_hidden(&mut self, at: usize) {
        let hide = self.scene.objects[at].hide;
        let state = &mut self.states[at];
        let Some(asset) = &state.asset else {
            return;
        };
        let key = (hide, self.scene.transfer.optimizations);
        if !state.hidden.ask(&key) {
            return;
        }
        let unseen = hide.unseen(&asset.cloud, &asset.bounds, &key.1);
        // What was relit may still be drawn; what was not must be relit before it is.
        let is_seen = |i: usize| unseen.get(i).is_none_or(|h| !h);
        let mut skipped_work = state.unseen.surfels.iter().enumerate();
        if skipped_work.any(|(i, was_unseen)| *was_unseen && is_seen(i)) {
            state.unseen = Unseen {
                version: state.unseen.version + 1,
                ..Unseen::default()
            };
        }
        state.hidden.accept(key, Arc::new(unseen));
    }
}
