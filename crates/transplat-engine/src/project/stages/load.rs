//! Stage *load*: settings that change how the splat itself is read.

use std::sync::Arc;

use transplat_core::estimate::Estimate;
use transplat_core::ground::ground_plane;
use transplat_core::settings::Method;
use transplat_core::surfels::SurfelCloud;

use crate::estimate;
use crate::jobs::{Kind, Work};
use crate::language::tr;
use crate::project::Project;
use crate::reading::Reading;
use crate::splat::OpenedWith;

impl Project {
    /// Follows the settings that change how the splat is read.
    pub(crate) fn update_asset(&mut self, at: usize) {
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
        }
        let wanted = Reading::of(object);
        if wanted == asset.reading {
            asset.reading_asked = None;
            return;
        }
        if is_loading {
            return;
        }
        if asset.reading_asked.as_ref() == Some(&wanted) {
            // It was cancelled.
            asset.reading.give_back(object);
            return;
        }
        let now = &asset.reading;
        let is_only_outside = (wanted.response, &wanted.cut) == (now.response, &now.cut);
        asset.reading_asked = Some(wanted);
        if is_only_outside && asset.part.is_none() {
            self.set_outside(at);
        } else {
            let path = asset.path.clone();
            self.load_splat(at, path, OpenedWith::Again);
        }
    }

    /// Takes other places that see the outside: the splat stays, what was made of its fronts goes.
    fn set_outside(&mut self, at: usize) {
        let outside_from = self.scene.objects[at].outside_from.clone();
        let state = &self.states[at];
        let Some(asset) = &state.asset else {
            return;
        };
        let (id, path, last) = (state.id, asset.path.clone(), asset.cloud.clone());
        let work = move |_: &_| {
            let cloud = Arc::new(SurfelCloud {
                outside_from,
                ..(*last).clone()
            });
            let estimate = estimate::kept(&path, &cloud);
            Ok((cloud, estimate))
        };
        let kind = Kind::Of(id, Work::Load);
        self.start(
            kind,
            tr("finding outer surfaces"),
            work,
            move |project, made| {
                project.take_outside(id, made);
            },
        );
    }

    fn take_outside(&mut self, id: u64, (cloud, kept): (Arc<SurfelCloud>, Option<Estimate>)) {
        let Some(at) = self.at(id) else {
            return;
        };
        for work in [Work::Bake(Method::Directional), Work::Estimate] {
            self.jobs.cancel(Kind::Of(id, work));
        }
        self.draw(|live| live.set_cloud(at, &cloud));
        self.pinned = None;
        let state = &mut self.states[at];
        if let Some(bake) = state.bakes.get_mut(&Method::Directional) {
            bake.clear();
        }
        state.estimate.clear();
        if let Some(kept) = kept {
            state.estimate.set(false, kept);
        }
        state.estimated.clear();
        state.estimate_awaited = false;
        if let Some(asset) = &mut state.asset {
            asset.reading.outside_from = cloud.outside_from.clone();
            asset.cloud = cloud;
        }
    }
}
