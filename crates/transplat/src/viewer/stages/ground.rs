//! The ground that catches an object's shadow.

use transplat_core::bake::harmonic::BakeSettings;
use transplat_core::ground::Ground;

use crate::viewer::jobs::{Handle, Kind, Work};
use crate::viewer::session::{Outcome, Session};

impl Session {
    pub(in crate::viewer) fn update_ground(&mut self, at: usize) {
        let key = (self.scene.directions, self.up_of(at));
        let state = &mut self.states[at];
        let Some(asset) = state.asset.as_ref().filter(|_| self.scene.shadow_catcher) else {
            return;
        };
        let kind = Kind::Of(state.id, Work::Ground);
        if state.ground.ask(&key) {
            self.jobs.cancel(kind);
            let (id, cloud) = (state.id, asset.cloud.clone());
            let (directions, up) = key;
            let work = move |handle: &Handle<Outcome>| {
                let settings = BakeSettings { directions };
                let progress = |done| handle.progress(done);
                Ok(Ground::bake(&cloud, up, &settings, &progress)?)
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
        let (up, state) = (self.up_of(at), &self.states[at]);
        let (Some(ground), Some(key), Some(lights)) = (
            state.ground.get(),
            state.ground.made_from(),
            state.lights.made_from(),
        ) else {
            return;
        };
        let key = (*key, lights.clone());
        if state.ground_lit.is_asked(&key) {
            return;
        }
        let [source, target] = self.sides_of(at).map(|(settings, there)| {
            let light = settings.orient(&there.light.illumination, up);
            ground.lit_share(&light.radiance)
        });
        self.live().set_ground([&source, &target]);
        self.states[at].ground_lit.set(key, ());
    }

    /// The ground for a saved picture.
    pub fn ground(&self) -> Option<&Ground> {
        let ground = self.state().ground.get();
        ground.filter(|_| self.scene.shadow_catcher)
    }
}
