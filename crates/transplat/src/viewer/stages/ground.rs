//! The ground that catches an object's shadow.

use transplat_core::ground::Ground;

use crate::viewer::jobs::{Handle, Kind, Work};
use crate::viewer::session::{Outcome, Session};

impl Session {
    pub(in crate::viewer) fn update_ground(&mut self, at: usize) {
        let key = (self.scene.directions, self.up_of(at));
        let state = &mut self.states[at];
        let kind = Kind::Of(state.id, Work::Ground);
        let Some(asset) = state.asset.as_ref().filter(|_| self.scene.shadow_catcher) else {
            // One that was cancelled can be had again.
            if state.ground.current().is_none() && !self.jobs.is_awaited(kind) {
                state.ground.ask_again();
            }
            return;
        };
        if state.ground.ask(&key) {
            self.jobs.cancel(kind);
            let (id, cloud) = (state.id, asset.cloud.clone());
            let (directions, up) = key;
            let work = move |handle: &Handle<Outcome>| {
                let progress = |done| handle.progress(done);
                Ok(Ground::bake(&cloud, up, directions, &progress)?)
            };
            self.start(kind, "baking the ground", work, move |session, ground| {
                if let Some(at) = session.at(id)
                    && session.states[at].ground.accept(key, ground)
                {
                    session.stages.ground += 1;
                }
            });
        }
        self.light_ground(at);
    }

    fn light_ground(&mut self, at: usize) {
        let lights = self.oriented_of(at);
        let ground = &self.states[at].ground;
        let (Some(ground), Some(key)) = (ground.get(), ground.made_from()) else {
            return;
        };
        let key = (*key, lights);
        if self.states[at].ground_lit.is_asked(&key) {
            return;
        }
        let [source, target] = key
            .1
            .each_ref()
            .map(|l| ground.lit_share(&l.light.radiance));
        self.live().set_ground([&source, &target]);
        self.states[at].ground_lit.set(key, ());
    }

    /// The ground for a saved picture.
    pub fn ground(&self) -> Option<&Ground> {
        let ground = self.state().ground.get();
        ground.filter(|_| self.scene.shadow_catcher)
    }
}
