//! What the settings say of the splat itself: which way is up, what its colour is, where its outside.

use std::sync::Arc;

use transplat_core::ground::ground_plane;
use transplat_core::surfels::SurfelCloud;

use crate::viewer::asset::OpenedWith;
use crate::viewer::jobs::{Kind, Work};
use crate::viewer::session::Session;

impl Session {
    pub(in crate::viewer) fn update_asset(&mut self, at: usize) {
        let up = self.up_of(at);
        let object = &mut self.scene.objects[at];
        let state = &mut self.states[at];
        let is_loading = self.jobs.is_running(Kind::Of(state.id, Work::Load));
        let Some(asset) = &mut state.asset else {
            return;
        };
        if asset.up != up {
            asset.up = up;
            asset.ground = ground_plane(&asset.cloud, up);
            state.ground.clear();
        }
        if asset.cloud.outside_from != object.outside_from {
            let cloud = Arc::new(SurfelCloud {
                outside_from: object.outside_from.clone(),
                ..(*asset.cloud).clone()
            });
            asset.cloud = cloud.clone();
            self.live().set_cloud(at, &cloud);
            return;
        }
        let (wanted, loaded) = (object.linear, asset.is_linear());
        if wanted == loaded {
            asset.reload_asked = None;
        } else if !is_loading && asset.reload_asked == Some(wanted) {
            // It was cancelled.
            object.linear = loaded;
        } else if !is_loading {
            asset.reload_asked = Some(wanted);
            let (path, object) = (asset.path.clone(), Box::new(object.clone()));
            self.load_asset(at, path, OpenedWith::Again(object));
        }
    }
}
