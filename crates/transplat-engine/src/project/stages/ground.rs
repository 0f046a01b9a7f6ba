//! Stage *ground*: the shadow catcher under the objects.

use anyhow::Context;
use glam::Vec3;
use transplat_core::ground::{GROUND_REACH, Ground};
use transplat_core::surfels::SurfelCloud;

use crate::jobs::{Handle, Kind};
use crate::language::tr;
use crate::object::{GroundKey, GroundLitKey};
use crate::project::{Change, Project};

impl Project {
    /// Bakes it under what is shown where that stands now; the last one serves until then.
    pub(crate) fn start_ground(&mut self) {
        let kind = Kind::Ground;
        if !self.requested.ground {
            return;
        }
        if !self.scene.shadow_catcher || self.shown().next().is_none() {
            // One that was cancelled can be had again.
            if self.ground.current().is_none() && !self.jobs.is_awaited(kind) {
                self.ground.ask_again();
            }
            return;
        }
        let placed = self.shown().map(|(at, object, asset)| {
            let place = object.transform.scene_from_object();
            ((self.states[at].id, place), (asset.cloud.clone(), place))
        });
        let (of, placed): (Vec<_>, Vec<_>) = placed.unzip();
        let (directions, up) = (self.scene.directions, self.scene_up());
        let key: GroundKey = (directions, up, of);
        if !self.jobs.is_awaited(kind) && self.ground.ask(&key) {
            let work = move |handle: &Handle<Change>| {
                let progress = |done| handle.progress(done);
                let cloud = SurfelCloud::whole(&placed).context(tr("Nothing is visible."))?;
                Ok(Ground::bake(&cloud, up, directions, &progress)?)
            };
            self.start(
                kind,
                tr("baking the ground"),
                work,
                move |project, ground| {
                    if project.ground.accept(key, ground) {
                        project.stages.ground += 1;
                    }
                },
            );
        }
    }

    /// Lights the ground that is baked.
    pub(crate) fn light_ground(&mut self) {
        if !self.scene.shadow_catcher || self.shown().next().is_none() {
            return;
        }
        let turn = self.scene.objects[0].transform.rotation;
        let key: GroundLitKey = (self.ground.version(), self.oriented_of(0), turn);
        let Some(ground) = self.ground.get() else {
            return;
        };
        if self.ground_lit.is_asked(&key) {
            return;
        }
        // The source is as the object was captured; the target is the scene's.
        let [source, target] = key.1.each_ref().map(|l| &l.light);
        let place = self.scene.objects[0].transform.scene_from_object();
        let target = target.seen_by(place.inverse());
        let lit = [&**source, &target].map(|light| ground.lit_share(light));
        self.draw(|live| live.set_ground([&lit[0], &lit[1]]));
        self.ground_lit.set(key, ());
    }

    /// The ground for a saved picture, if it is under what stands there now.
    pub fn ground(&self) -> Option<&Ground> {
        let ground = self.ground.current();
        ground.filter(|_| self.scene.shadow_catcher)
    }

    /// Middle of the ground that is shown, its axes, and half its edge.
    pub fn ground_plane(&self) -> Option<(Vec3, [Vec3; 2], f32)> {
        if let Some(ground) = self.ground.get().filter(|_| self.scene.shadow_catcher) {
            return Some((ground.center, ground.axes, ground.half));
        }
        let each = self.scene.objects.iter().zip(&self.states);
        let (first, asset) = each
            .filter_map(|(object, state)| Some((object, state.asset.as_ref()?)))
            .next()?;
        let bounds = self.scene_bounds().unwrap_or(asset.bounds);
        let (center, _) = asset.ground;
        let center = first.transform.scene_from_object().transform_point3(center);
        let world = self.scene_up().asset_from_world().as_mat3();
        let axes = [world.x_axis, world.y_axis];
        Some((center, axes, GROUND_REACH * bounds.radius))
    }
}
