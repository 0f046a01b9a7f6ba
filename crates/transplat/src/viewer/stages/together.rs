//! Several objects: what they see of each other, and all of them under the target light.

use std::sync::Arc;
use std::time::Instant;

use glam::DMat3;
use transplat_core::bake::Bake;
use transplat_core::bake::scene::SceneBake;
use transplat_core::bake::surroundings::Placed;
use transplat_core::present;
use transplat_core::scene::Transform;
use transplat_core::settings::Method;
use transplat_core::transfer::scene::SceneTransfer;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};
use transplat_gpu::rasterize::ResidentSh;

use crate::viewer::jobs::{Handle, Kind};
use crate::viewer::object::{RelitKey, TogetherKey};
use crate::viewer::session::{Outcome, Session};

impl Session {
    /// The objects that are shown, where they are several and relit together.
    fn members(&self) -> Vec<usize> {
        let shown = |at: &usize| self.scene.objects[*at].shown && self.states[*at].asset.is_some();
        let members: Vec<usize> = (0..self.scene.objects.len()).filter(shown).collect();
        let is_together = self.scene.transfer.method == Method::Directional && self.is_composed();
        if is_together { members } else { Vec::new() }
    }

    /// Whether there is more than one object where it was captured.
    pub fn is_composed(&self) -> bool {
        let mut shown = self.scene.objects.iter().filter(|o| o.shown);
        let first = shown.next();
        shown.next().is_some() || first.is_some_and(|o| o.transform != Transform::default())
    }

    /// Traces what the objects see of each other where they stand now, once they are baked; the last answer serves until then.
    pub(in crate::viewer) fn start_surroundings(&mut self) {
        let members = self.members();
        let placed = members.iter().map(|at| {
            let state = &self.states[*at];
            let made = state.bakes.get(&Method::Directional)?;
            let Bake::Directional(bake) = &*made.current().filter(|b| b.share == 1.0)?.bake else {
                return None;
            };
            let scene_from_object = self.scene.objects[*at].transform.scene_from_object();
            let key = (state.id, made.version(), scene_from_object);
            let bake = bake.clone();
            Some((
                key,
                Placed {
                    bake,
                    scene_from_object,
                },
            ))
        });
        let Some(placed) = placed.collect::<Option<Vec<_>>>().filter(|p| !p.is_empty()) else {
            return;
        };
        let (of, placed): (Vec<_>, Vec<_>) = placed.into_iter().unzip();
        if self.surroundings.of == of || self.jobs.is_running(Kind::Surroundings) {
            return;
        }
        let work = move |handle: &Handle<Outcome>| {
            let progress = |done| handle.progress(done);
            Ok(Arc::new(SceneBake::new(placed, &progress)?))
        };
        let label = "tracing between the objects";
        self.start(Kind::Surroundings, label, work, move |session, bake| {
            session.surroundings.of = of;
            session.surroundings.bake = Some(bake);
            session.surroundings.version += 1;
        });
    }

    /// The objects that are shown, ready to be relit as one scene: where they are several, prepared, and known to each other.
    pub fn scene_transfer(&self) -> Option<(Vec<usize>, SceneTransfer)> {
        let members = self.members();
        let known = &self.surroundings.of;
        let is_same = |(at, of): (&usize, &(u64, u64, _))| self.states[*at].id == of.0;
        let is_known = members.len() == known.len() && members.iter().zip(known).all(is_same);
        let bake = self.surroundings.bake.clone();
        let bake = bake.filter(|_| is_known && !members.is_empty())?;
        let transfers = members.iter().map(|at| {
            let made = self.states[*at].prepared.get()?;
            match &made.prepared {
                PreparedTransfer::Directional(transfer) => Some(transfer.clone()),
                _ => None,
            }
        });
        let transfers = transfers.collect::<Option<Vec<_>>>()?;
        // Of another splat than the preparation's: that is on its way.
        let sizes: Vec<usize> = bake.bakes().map(|b| b.len()).collect();
        let fits = transfers.iter().map(|t| t.asset.bake.len()).eq(sizes);
        fits.then(|| (members, SceneTransfer::new(transfers, bake)))
    }

    /// Relights all objects as one scene, and tells whether that is how they are relit: not before it is known what they see of each other.
    pub(in crate::viewer) fn relight_together(&mut self) -> bool {
        let Some((members, scene)) = self.scene_transfer() else {
            return false;
        };
        let each = || members.iter().map(|at| &self.states[*at]);
        let [_, target] = self.oriented_of(members[0]);
        let part = self.scene.view.part();
        let key: TogetherKey = (
            each().map(|s| s.prepared.version()).collect(),
            self.surroundings.version,
            target,
            part,
            each().map(|s| s.hidden.version()).collect(),
        );
        if self.jobs.is_running(Kind::RelightTogether) || !self.relit_together.ask(&key) {
            return true;
        }
        let turn = self.scene.objects[members[0]].transform.rotation.as_dquat();
        let (context, wanted) = (self.context.clone(), key.clone());
        let ids: Vec<u64> = each().map(|s| s.id).collect();
        let work = move |_: &_| {
            let start = Instant::now();
            // As the scene sees it, whose first object may be turned.
            let light = wanted.2.light.rotated(DMat3::from_quat(turn));
            let relit = scene.relight_objects(&light, part, &[])?;
            let ms = start.elapsed().as_secs_f64() * 1e3;
            let uploaded = relit.into_iter().map(|relit| {
                let upload = ResidentSh::upload(&context, &relit.sh, relit.degree, relit.encoding);
                (upload, Arc::new(relit))
            });
            Ok((uploaded.collect::<Vec<_>>(), ms))
        };
        let label = "relighting the scene";
        self.start(
            Kind::RelightTogether,
            label,
            work,
            move |session, (relit, ms)| {
                if session.relit_together.accept(key, ()) {
                    for (id, relit) in ids.into_iter().zip(relit) {
                        session.show_member(id, part, relit, ms);
                    }
                }
            },
        );
        true
    }

    fn show_member(
        &mut self,
        id: u64,
        part: Part,
        (resident, relit): (ResidentSh, Arc<Relit>),
        ms: f64,
    ) {
        let Some(at) = self.at(id) else {
            return;
        };
        let [_, target] = self.oriented_of(at);
        let state = &self.states[at];
        let key = RelitKey {
            prepared: state.prepared.version(),
            target,
            part,
            unseen: state.unseen.version,
        };
        let relighting = self.relighting(at, &key, Some(ms));
        let state = &mut self.states[at];
        let shown = key.shown();
        state.relit.set(key, relighting);
        let tau = present::tau_colors(&relit.tau);
        if part == Part::Whole {
            state.readout.set(shown, relit);
        }
        self.live().set_relit(at, resident, tau);
    }
}
