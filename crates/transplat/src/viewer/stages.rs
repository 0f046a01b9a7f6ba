//! The pipeline's stages as the viewer runs them: each when what it reads has changed, long ones as jobs.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use transplat_core::bake::harmonic::BakeSettings;
use transplat_core::bake::patches;
use transplat_core::files::inspect_bake;
use transplat_core::ground::{Ground, ground_plane};
use transplat_core::present::{self, Background, Doubt, View};
use transplat_core::settings::Method;
use transplat_core::transfer::{Part, PreparedTransfer};
use transplat_gpu::present::Backdrop;
use transplat_gpu::rasterize::ResidentSh;
use transplat_gpu::transfer::GpuTransfer;
use transplat_gpu::{Context, GpuError};

use super::asset::{Reading, Settings};
use super::baking::{self, Baked};
use super::jobs::{Handle, Kind, beside_the_rest};
use super::lights::load_map;
use super::session::{
    BackdropKey, Event, PrepareKey, Prepared, RelitBy, RelitKey, SOURCE, Session, TARGET,
};

/// How much of a mark covers a surfel's colour.
const MARK_WEIGHT: f32 = 0.75;

impl Session {
    /// Follows what the settings say of the asset itself: which way is up, what its colour is, and where its outside.
    pub(super) fn update_asset(&mut self) {
        let up = self.up();
        let (wanted, loaded) = (Reading::of(&self.look), self.loaded_reading());
        let is_loading = self.jobs.is_running(Kind::Load);
        let Some(asset) = &mut self.asset else {
            return;
        };
        if asset.up != up {
            asset.up = up;
            asset.ground = ground_plane(&asset.cloud, up);
            self.ground = None;
        }
        if wanted == loaded {
            self.reload_asked = None;
        } else if !is_loading && self.reload_asked.as_ref() == Some(&wanted) {
            // It was cancelled.
            self.look = loaded.over(self.look.clone());
        } else if !is_loading {
            self.reload_asked = Some(wanted.clone());
            let path = asset.path.clone();
            self.load_asset(path, Settings::Again(wanted));
        }
    }

    /// The lights that the settings name, where they are loaded.
    pub(super) fn resolve_lights(&mut self) {
        for side in [SOURCE, TARGET] {
            let settings = if side == SOURCE {
                &self.look.source
            } else {
                &self.look.target
            };
            let Some(file) = settings.file.clone() else {
                continue;
            };
            match self.lights.get(&file) {
                Some(light) => {
                    if light.id != self.sides[side].id {
                        self.sides[side] = light.clone();
                    }
                    if self.resolved[side] != *settings {
                        self.resolved[side] = settings.clone();
                    }
                }
                None => self.request_light(&file),
            }
        }
    }

    /// Asset and directions of a method's bake.
    fn bake_key(&self, method: Method) -> (u64, usize) {
        let directions = match method {
            Method::Harmonic => self.look.directions,
            Method::Directional => patches::DIRECTIONS,
        };
        (self.asset_id, directions)
    }

    /// Whether a bake runs whose result is wanted.
    pub(super) fn is_baking(&self) -> bool {
        let mut methods = Method::ALL.into_iter();
        methods.any(|method| self.jobs.is_awaited(Kind::Bake(method)))
    }

    /// Whether the directional bake is next, for the estimate, once that of the method that is set is done.
    pub(super) fn directional_is_next(&self) -> bool {
        let asked = self.bakes.get(&Method::Directional).and_then(|b| b.asked);
        self.estimate_needs_bake() && asked != Some(self.bake_key(Method::Directional))
    }

    /// Breaks off what is being baked; it is asked for again when it is wanted.
    fn cancel_bakes(&mut self) {
        for method in Method::ALL {
            if !self.jobs.is_awaited(Kind::Bake(method)) {
                continue;
            }
            self.jobs.cancel(Kind::Bake(method));
            if let Some(state) = self.bakes.get_mut(&method) {
                state.asked = None;
            }
        }
    }

    /// Starts the bake for the method that is set, and after it what the estimate of the light needs.
    pub(super) fn start_bake(&mut self) {
        if self.asset.is_none() {
            return;
        }
        let method = self.look.transfer.method;
        let is_asked = |method| {
            let state = self.bakes.get(&method);
            state.is_some_and(|b| b.asked == Some(self.bake_key(method)))
        };
        let is_for_estimate =
            method != Method::Directional && self.jobs.is_awaited(Kind::Bake(Method::Directional));
        let method = if !is_asked(method) {
            method
        } else if self.directional_is_next() && self.bake_share() == 1.0 {
            Method::Directional
        } else {
            if is_for_estimate && !self.estimate_needs_bake() {
                self.cancel_bakes();
            }
            return;
        };
        self.cancel_bakes();
        let Some(asset) = &self.asset else {
            return;
        };
        let key @ (_, directions) = self.bake_key(method);
        let state = self.bakes.entry(method).or_default();
        (state.asked, state.share) = (Some(key), 0.0);
        let (background, path, cloud) = (
            self.background.clone(),
            asset.path.clone(),
            asset.cloud.clone(),
        );
        // One of the other method is kept until that is set.
        let is_other =
            |file: &PathBuf| inspect_bake(file).is_ok_and(|header| header.method != method);
        let saved = self.bake.take_if(|file| !is_other(file));
        let what = if method == self.look.transfer.method {
            "the visibility"
        } else {
            "what tells the light"
        };
        let label = format!("baking {what} of {}", asset.name());
        let (id, skips) = (self.asset_id, self.look.transfer.skips);
        let work = move |handle: &Handle<Event>| {
            let event = |baked: Baked| Event::Baked {
                asset: id,
                baked: Box::new(baked),
            };
            let wanted = baking::Wanted {
                asset: &path,
                cloud: &cloud,
                method,
                directions,
                skips,
            };
            let report = |done: f64| handle.progress(done);
            let preview = |baked: Baked| handle.send(event(baked));
            let device = background.fastest();
            let saved = saved.as_deref();
            match beside_the_rest(|| baking::bake(&device, &wanted, saved, &report, preview)) {
                Ok(baked) => Some(event(baked)),
                Err(_) if handle.is_cancelled() => None,
                Err(error) => Some(Event::Failed(format!("the bake failed: {error:#}"))),
            }
        };
        self.jobs
            .start(Kind::Bake(method), label, work, Event::Failed);
    }

    /// Starts the bake again after it was cancelled.
    pub fn rebake(&mut self) {
        if let Some(state) = self.bakes.get_mut(&self.look.transfer.method) {
            state.asked = None;
        }
    }

    pub(super) fn start_prepare(&mut self) {
        let (Some(asset), Some(transfer), Some(state)) =
            (&self.asset, self.transfer_asset.clone(), self.baked())
        else {
            return;
        };
        let Some(bake) = state.bake.clone() else {
            return;
        };
        if self.jobs.is_running(Kind::Prepare) {
            return;
        }
        let [source, target] = self.oriented_lights();
        let key = PrepareKey {
            asset: self.asset_id,
            bake: state.version,
            source,
            settings: self.look.transfer.clone(),
        };
        if self.requested.as_ref() == Some(&key) {
            return;
        }
        let (context, cloud) = (self.context.clone(), asset.cloud.clone());
        self.requested = Some(key.clone());
        let work = move |_: &Handle<Event>| {
            let start = Instant::now();
            let mut transfer = transfer.lock().unwrap_or_else(|p| p.into_inner());
            let made = transfer
                .prepare(&cloud, &bake, key.bake, &key.source.light, &key.settings)
                .map_err(anyhow::Error::from)
                .and_then(|prepared| Ok((on_gpu(&context, &prepared)?, prepared)));
            if let Ok((Some(live), _)) = &made {
                live.warm_up(&target.light);
            }
            Some(match made {
                Ok((live, prepared)) => Event::Prepared(Box::new(Prepared {
                    key,
                    prepared,
                    live,
                    ms: start.elapsed().as_secs_f64() * 1e3,
                })),
                Err(error) => Event::Failed(format!("{error:#}")),
            })
        };
        self.jobs
            .start(Kind::Prepare, "preparing the transfer", work, Event::Failed);
    }

    pub(super) fn relight(&mut self) {
        let Some(prepared) = self.prepared.clone() else {
            return;
        };
        let [_, target] = self.oriented_lights();
        let part = prepared.computed_part(self.look.view.part());
        let mut key = RelitKey {
            prepared: self.prepared_version,
            target,
            part,
            unseen: self.unseen.1,
        };
        if self.relit_for.as_ref() == Some(&key) {
            return;
        }
        // Now that it runs, it leaves out what is not seen now.
        if !Arc::ptr_eq(&self.unseen.0, &self.hidden) && self.look.transfer.skips.unseen {
            self.unseen = (self.hidden.clone(), self.unseen.1 + 1);
            self.unseen_hides = !self.look.hide.is_off();
            key.unseen = self.unseen.1;
        }
        if !self.relights_on_gpu {
            self.start_relight(prepared, key);
            return;
        }
        let start = Instant::now();
        let unseen = self.unseen.0.clone();
        let relit = self.live().relight(&key.target.light, key.part, &unseen);
        if let Err(error) = relit {
            self.error(error.to_string());
        }
        self.transfer_timer
            .measure(&self.context, start, self.jobs.context());
        self.times.relight = None;
        self.relit_is(key);
    }

    /// Relights on the CPU, one light after the other: the newest there is whenever the last one is done.
    fn start_relight(&mut self, prepared: PreparedTransfer, key: RelitKey) {
        if self.relit_asked.as_ref() == Some(&key) || self.jobs.is_running(Kind::Relight) {
            return;
        }
        self.relit_asked = Some(key.clone());
        let (context, unseen) = (self.context.clone(), self.unseen.0.clone());
        let work = move |_: &Handle<Event>| {
            let start = Instant::now();
            let relit = match prepared.relight_seen(&key.target.light, key.part, &unseen) {
                Ok(relit) => relit,
                Err(error) => return Some(Event::Failed(error.to_string())),
            };
            let ms = start.elapsed().as_secs_f64() * 1e3;
            Some(Event::Relit(Box::new(RelitBy {
                resident: ResidentSh::upload(&context, &relit.sh, relit.degree, relit.encoding),
                relit: Arc::new(relit),
                key,
                ms,
            })))
        };
        self.jobs
            .start(Kind::Relight, "relighting", work, Event::Failed);
    }

    /// Notes what is shown relit from now on.
    pub(super) fn relit_is(&mut self, key: RelitKey) {
        let gain = self.prepared.as_ref().map_or(1.0, |p| p.light_gain());
        let stops = (key.target.light.mean_irradiance() * gain).log2();
        let named = [&self.look.source.file, &self.look.target.file];
        let known = named
            .iter()
            .zip(&self.sides)
            .all(|(file, side)| file.as_ref().is_none_or(|f| *f == side.path));
        self.stops_over_source = (stops.is_finite() && known).then_some(stops);
        let is_other = |last: &RelitKey| last.prepared != key.prepared || last.target != key.target;
        if self.relit_for.as_ref().is_none_or(is_other) {
            self.relit_version += 1;
        }
        self.relit_for = Some(key);
    }

    pub(super) fn update_hidden(&mut self) {
        let Some(asset) = &self.asset else {
            return;
        };
        let key = (self.asset_id, self.look.hide);
        if self.hidden_for == Some(key) {
            return;
        }
        let skips = &self.look.transfer.skips;
        let hide = &self.look.hide;
        self.hidden = Arc::new(hide.unseen(&asset.cloud, &asset.bounds, skips));
        self.hidden_count = match hide.is_off() {
            true => 0,
            false => {
                let hidden = hide.hidden(&asset.cloud, &asset.bounds);
                hidden.into_iter().filter(|h| *h).count()
            }
        };
        self.hidden_version += 1;
        let is_other_asset = self
            .hidden_for
            .is_none_or(|(asset, _)| asset != self.asset_id);
        self.hidden_for = Some(key);
        // What was relit may still be drawn; what was not must be relit before it is.
        let seen = |i: usize| self.hidden.get(i).is_none_or(|h| !h);
        let lacks = |(i, was_unseen): (usize, &bool)| *was_unseen && seen(i);
        if is_other_asset || self.unseen.0.iter().enumerate().any(lacks) {
            self.unseen = (Arc::default(), self.unseen.1 + 1);
            self.unseen_hides = false;
        }
    }

    pub(super) fn update_ground(&mut self) {
        let Some(asset) = &self.asset else {
            return;
        };
        if !self.look.shadow_catcher {
            self.ground_asked = self.ground_for;
            return;
        }
        let key = (self.asset_id, self.look.directions, asset.up);
        if self.ground_asked != Some(key) {
            self.jobs.cancel(Kind::Ground);
            self.ground_asked = Some(key);
            let (_, directions, up) = key;
            let cloud = asset.cloud.clone();
            let work = move |handle: &Handle<Event>| {
                let settings = BakeSettings { directions };
                let ground = Ground::bake(&cloud, up, &settings, &|done| handle.progress(done));
                let ground = Box::new(ground.ok()?);
                Some(Event::Ground { key, ground })
            };
            self.jobs
                .start(Kind::Ground, "baking the ground", work, Event::Failed);
        }
        if let (Some(ground), Some(ground_key)) = (&self.ground, self.ground_for) {
            let up = self.up();
            let oriented = [
                self.look
                    .source
                    .orient(&self.sides[SOURCE].illumination, up),
                self.look
                    .target
                    .orient(&self.sides[TARGET].illumination, up),
            ];
            let lit_for = (ground_key, oriented);
            if self.ground_lit_for.as_ref() != Some(&lit_for) {
                let lit = [0, 1].map(|side| ground.lit_share(&lit_for.1[side].radiance));
                self.live().set_ground([&lit[0], &lit[1]]);
                self.ground_lit_for = Some(lit_for);
            }
        }
    }

    /// The ground for a saved picture.
    pub fn ground(&self) -> Option<Ground> {
        self.ground.clone().filter(|_| self.look.shadow_catcher)
    }

    /// Reads the maps behind the object: that of the side that is seen first, then the other's, since before and after are a key apart.
    pub(super) fn start_backdrops(&mut self) {
        if self.look.view.background(self.look.background) != Background::Environment
            || self.asset.is_none()
        {
            return;
        }
        for side in [TARGET, SOURCE] {
            let light = self.behind(side, self.look.view).0.clone();
            let key = BackdropKey {
                light: light.id,
                blur: self.look.background_blur,
            };
            let kind = Kind::Backdrop(side);
            // One that failed was asked for, and was told.
            if self.backdrop_asked[side].as_ref() == Some(&key) || self.jobs.is_running(kind) {
                continue;
            }
            self.backdrop_asked[side] = Some(key.clone());
            let context = self.context.clone();
            let name = light.name();
            let kept = self.maps.iter().find(|(id, _)| *id == light.id);
            let kept = kept.map(|(_, map)| map.clone());
            let work = move |_: &Handle<Event>| {
                let map = match kept.map_or_else(|| load_map(&light), Ok) {
                    Ok(map) => map,
                    Err(error) => return Some(Event::Failed(format!("{error:#}"))),
                };
                let backdrop = Backdrop::new(&context, &map.blurred(key.blur));
                Some(Event::Backdrop {
                    side,
                    key,
                    map,
                    backdrop,
                })
            };
            let label = format!("reading {name} for the background");
            self.jobs.start(kind, label, work, Event::Failed);
        }
    }

    /// Channels that are made of more than what is on the GPU: when they are asked for.
    pub(super) fn update_channels(&mut self) {
        if self.asset.is_none() {
            return;
        }
        if self.look.view == View::Visibility
            && let Some(state) = self.baked()
            && let Some(bake) = &state.bake
            && self.visibility_shown != Some(state.version)
        {
            let version = state.version;
            let colors = bake.openness().iter().map(|o| [*o; 3]).collect();
            self.live().set_visibility(colors);
            self.visibility_shown = Some(version);
        }
        self.start_doubts();
    }

    pub(super) fn start_doubts(&mut self) {
        let (Some(asset), Some(bake), Some(prepared)) =
            (&self.asset, self.bake_so_far(), &self.prepared)
        else {
            return;
        };
        let key = (self.asset_id, self.relit_version);
        let readout = self.wants_readout && self.readout.as_ref().is_none_or(|(of, _)| *of != key);
        let doubts = self.wants_doubts || self.show_marks || self.look.view == View::Doubts;
        let wanted = readout || (doubts && self.doubts_for != Some(key));
        if !wanted || self.jobs.is_running(Kind::Doubts) {
            return;
        }
        let Some(shown) = self.relit_for.clone() else {
            return;
        };
        // What is shown may still be of the last preparation.
        if shown.prepared != self.prepared_version {
            return;
        }
        let (cloud, bake, prepared) = (asset.cloud.clone(), bake.clone(), prepared.clone());
        self.doubts_for = Some(key);
        // What was relit on the GPU is not here.
        let work = move |_: &Handle<Event>| {
            let made = if readout {
                let relit = prepared.relight(&shown.target.light, Part::Whole);
                relit.map(|r| (r.tau.clone(), Some(Arc::new(r))))
            } else {
                prepared.tau(&shown.target.light).map(|tau| (tau, None))
            };
            let (tau, readout) = match made {
                Ok(made) => made,
                Err(error) => return Some(Event::Failed(error.to_string())),
            };
            let doubts = present::doubts(&cloud, &bake, &prepared, &tau);
            Some(Event::Doubts {
                key,
                doubts,
                readout,
            })
        };
        self.jobs.start(
            Kind::Doubts,
            "counting doubtful surfels",
            work,
            Event::Failed,
        );
    }

    pub(super) fn show_doubts(&mut self, doubts: Vec<Option<Doubt>>) {
        let n = doubts.len().max(1) as f32;
        let share = |which: Doubt| doubts.iter().filter(|d| **d == Some(which)).count() as f32 / n;
        self.shares = Some(Doubt::ALL.map(share));
        let marks = doubts.iter().map(|d| match d {
            None => [0.0; 4],
            Some(doubt) => {
                let [r, g, b] = doubt.color();
                [r, g, b, MARK_WEIGHT]
            }
        });
        self.live()
            .set_doubts(present::doubt_colors(&doubts), marks);
        self.doubts = Arc::new(doubts);
    }
}

/// A transfer on the GPU, if that is where it runs: the directional method is many times faster without a driver that computes on the CPU, and
/// what the adapter has no room for is relit on the CPU as well.
fn on_gpu(
    context: &Arc<Context>,
    prepared: &PreparedTransfer,
) -> Result<Option<GpuTransfer>, GpuError> {
    if context.is_software() && matches!(prepared, PreparedTransfer::Directional(_)) {
        return Ok(None);
    }
    match GpuTransfer::new(context, prepared) {
        Err(_) if !context.is_lost() => Ok(None),
        made => made.map(Some),
    }
}
