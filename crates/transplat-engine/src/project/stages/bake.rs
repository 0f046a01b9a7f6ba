//! Stage *bake*: visibility for the method that is set, and for the estimate.

use std::path::PathBuf;

use anyhow::Context as _;
use transplat_core::bake::strata;
use transplat_core::files::inspect_bake;
use transplat_core::settings::Method;

use crate::bake::{self, BakePlace, BakeRequest, Baked};
use crate::jobs::{Handle, Kind, Work};
use crate::language::{tr, tr_format};
use crate::object::BakeKey;
use crate::project::{Change, Project};

/// Directions that are enough to tell a normal's sign.
const ORIENTATION_DIRECTIONS: usize = 64;

impl Project {
    /// Bake of the method that is set, whole or in part.
    pub fn baked_of(&self, at: usize) -> Option<&Baked> {
        let method = self.scene.transfer.method;
        self.states[at].bakes.get(&method)?.get()
    }

    /// Directions of a method's bake.
    pub fn directions(&self, method: Method) -> usize {
        match method {
            // Without shadows only the normals need it.
            Method::Harmonic if !self.requested.all_terms && !self.scene.transfer.terms.shadow => {
                self.scene.directions.min(ORIENTATION_DIRECTIONS)
            }
            Method::Harmonic => self.scene.directions,
            Method::Directional => strata::DIRECTIONS,
        }
    }

    fn bake_key(&self, at: usize, method: Method) -> BakeKey {
        let is_isolated = method == Method::Directional && self.is_isolated(at);
        (self.directions(method), is_isolated)
    }

    /// True where what is baked of an object, whole or in part, is with or without its capture as the scene is now.
    pub(crate) fn is_baked_as_set(&self, at: usize, method: Method) -> bool {
        let (_, is_isolated) = self.bake_key(at, method);
        let bake = self.states[at].bakes.get(&method);
        bake.and_then(|b| b.made_from())
            .is_some_and(|(_, baked_so)| *baked_so == is_isolated)
    }

    fn is_bake_asked(&self, at: usize, method: Method) -> bool {
        let bake = self.states[at].bakes.get(&method);
        bake.is_some_and(|b| b.is_asked(&self.bake_key(at, method)))
    }

    /// True while a bake runs whose result is wanted.
    pub fn is_bake_awaited(&self, at: usize, method: Method) -> bool {
        let id = self.states[at].id;
        self.jobs.is_awaited(Kind::Of(id, Work::Bake(method)))
    }

    /// True while a bake of any method runs whose result is wanted.
    pub fn is_baking(&self, at: usize) -> bool {
        let mut methods = Method::ALL.into_iter();
        methods.any(|method| self.is_bake_awaited(at, method))
    }

    /// True while the bake for the estimate runs, or comes next after that of the method that is set.
    pub fn is_baking_for_estimate(&self, at: usize) -> bool {
        let method = Method::Directional;
        let is_next = !self.is_bake_asked(at, method);
        self.capture_light_needs_bake(at)
            && (self.is_bake_awaited(at, method) || (is_next && self.is_baking(at)))
    }

    /// Breaks off what is being baked; it is asked for again when it is wanted.
    fn cancel_bakes(&mut self, at: usize) {
        for method in Method::ALL {
            if self.is_bake_awaited(at, method) {
                let state = &mut self.states[at];
                self.jobs.cancel(Kind::Of(state.id, Work::Bake(method)));
                state.bakes.entry(method).or_default().ask_again();
            }
        }
    }

    /// Starts the bake for the method that is set, and after it what the estimate of the light needs.
    pub(crate) fn start_bake(&mut self, at: usize) {
        if self.states[at].asset.is_none() {
            return;
        }
        let set = self.scene.transfer.method;
        let is_wanted = |method| !self.is_bake_asked(at, method);
        let for_estimate = Method::Directional;
        let is_requested = self.requested.bakes && self.is_used(at) && self.needs_own_bake(at);
        if is_requested && is_wanted(set) {
            self.bake(at, set, tr("the visibility"));
        } else if self.capture_light_needs_bake(at) {
            let is_next = !is_requested || self.states[at].bake_share(set) == 1.0;
            if is_wanted(for_estimate) && is_next {
                self.bake(at, for_estimate, tr("the capture light"));
            }
        } else if set != for_estimate && self.is_bake_awaited(at, for_estimate) {
            self.cancel_bakes(at);
        }
    }

    /// Place of the bakes of an object's splat.
    pub(super) fn bake_place(&self, at: usize) -> Option<BakePlace> {
        let asset = self.states[at].asset.as_ref()?;
        Some(BakePlace {
            splat: asset.path.clone(),
            is_beside: self.bakes_are_beside,
            is_part: asset.part.is_some(),
        })
    }

    fn bake(&mut self, at: usize, method: Method, what: &str) {
        self.cancel_bakes(at);
        let key = self.bake_key(at, method);
        let place = self.bake_place(at);
        let state = &mut self.states[at];
        let Some(asset) = &state.asset else {
            return;
        };
        state.bakes.entry(method).or_default().ask(&key);
        // One of the other method is kept until that is set.
        let is_other = |file: &PathBuf| inspect_bake(file).is_ok_and(|h| h.method != method);
        let is_seen = self.canvas.is_some();
        let is_set = method == self.scene.transfer.method;
        let saved = state.saved_bake.take_if(|file| match is_seen {
            true => !is_other(file),
            false => is_set,
        });
        let is_read = saved.is_some();
        // The paper's bake of a part cannot be told from that of the whole.
        let is_saved = is_seen && (asset.part.is_none() || method == Method::Directional);
        let part = asset.part.clone();
        let (directions, is_isolated) = key;
        let part = part.filter(|_| method == Method::Directional && !is_isolated);
        let mut wanted = BakeRequest {
            cloud: asset.cloud.clone(),
            method,
            directions,
            optimizations: self.scene.transfer.optimizations,
            part_of: None,
            place: place.filter(|_| is_saved),
        };
        let label = tr_format!(
            "baking {what} of {asset}",
            asset = asset.name(),
            what = what
        );
        let (id, device) = (state.id, self.device.clone());
        let take = move |project: &mut Self, baked: Baked| project.take_bake(id, key, baked);
        let work = move |handle: &Handle<Change>| {
            let preview = |baked: Baked| {
                handle.send(Box::new(move |project: &mut Self| take(project, baked)));
            };
            let (device, progress) = (device.fastest(), |done: f64| handle.progress(done));
            let saved = saved.as_deref();
            if let Some(part) = &part {
                let of_whole = part.of_whole(&device, wanted.optimizations, &progress);
                wanted.part_of = Some(of_whole.context(tr("The bake failed"))?);
            }
            if !is_seen {
                return bake::whole(&device, &wanted, saved, &progress);
            }
            bake::refined(&device, &wanted, saved, &progress, preview)
                .context(tr("The bake failed"))
        };
        let what = match is_seen || !is_read {
            true => Work::Bake(method),
            false => Work::Load,
        };
        self.start(Kind::Of(id, what), label, work, take);
    }

    fn take_bake(&mut self, id: u64, key: BakeKey, mut baked: Baked) {
        let Some(at) = self.at(id) else {
            return;
        };
        let bakes = &mut self.states[at].bakes;
        let bake = bakes.entry(baked.bake.method()).or_default();
        let complaint = baked.complaint.take();
        if bake.accept(key, baked) {
            self.stages.bake += 1;
        }
        if let Some(why) = complaint {
            self.error(why);
        }
    }

    /// True for an object that stays coarse because its bake or preparation was cancelled.
    pub fn is_stopped(&self, at: usize) -> bool {
        let (state, method) = (&self.states[at], self.scene.transfer.method);
        let is_whole = state.bake_share(method) == 1.0;
        let preparing = Kind::Of(state.id, Work::Prepare);
        state.asset.is_some()
            && if is_whole {
                !self.is_prepared(at) && !self.jobs.is_running(preparing)
            } else {
                self.is_bake_asked(at, method) && !self.is_baking(at)
            }
    }

    /// Starts again what was cancelled: the bake, and what follows from it.
    pub fn rebake(&mut self, at: usize) {
        let method = self.scene.transfer.method;
        let state = &mut self.states[at];
        if state.bake_share(method) == 1.0 {
            state.prepared.ask_again();
        } else if let Some(bake) = state.bakes.get_mut(&method) {
            bake.ask_again();
        }
        self.surroundings.ask_again();
        self.insertion.ask_again();
    }
}
