//! Joint relight of several objects, and their inter-object visibility.

use std::sync::Arc;
use std::time::Instant;

use glam::DMat3;
use transplat_core::bake::Bake;
use transplat_core::bake::scene::SceneBake;
use transplat_core::bake::surroundings::{Detail, PlacedObject};
use transplat_core::environment::Illumination;
use transplat_core::present;
use transplat_core::scene::{Object, Transform};
use transplat_core::settings::Method;
use transplat_core::settings::optimizations::Optimization;
use transplat_core::transfer::scene::SceneTransfer;
use transplat_core::transfer::{Part, PreparedTransfer, Relit, RelitRows};
use transplat_gpu::live::{Drawing, LiveSh};

use crate::jobs::{Handle, Kind};
use crate::language::tr;
use crate::object::{InterObjectKey, JointKey, OrientedLight, RelitKey};
use crate::project::canvas::Canvas;
use crate::project::{Change, Project};
use crate::splat::Splat;

/// Scenes of fewer surfels are traced finely at once.
const SOON_TRACED: usize = 20_000;

impl Project {
    /// The objects that are shown, where they are several and relit together.
    pub fn members(&self) -> Vec<usize> {
        if self.is_composed() {
            self.shown().map(|(at, ..)| at).collect()
        } else {
            Vec::new()
        }
    }

    /// True where the scene is more than one object where it was captured.
    pub fn is_composed(&self) -> bool {
        let mut shown = self.shown();
        match (shown.next(), shown.next()) {
            (Some((0, first, _)), None) => first.transform != Transform::default(),
            (one, _) => one.is_some(),
        }
    }

    /// Shown objects where they stand, once they are baked for the directional method.
    fn placed(&self) -> Option<(InterObjectKey, Vec<PlacedObject>)> {
        if self.scene.transfer.method != Method::Directional {
            return None;
        }
        let placed = self.members().into_iter().map(|at| {
            let state = &self.states[at];
            let made = state.bakes.get(&Method::Directional)?;
            let Bake::Directional(bake) = &*made.current().filter(|b| b.share == 1.0)?.bake else {
                return None;
            };
            let scene_from_object = self.scene.objects[at].transform.scene_from_object();
            let key = (state.id, made.version(), scene_from_object);
            let part = state.asset.as_ref().and_then(|a| a.part.as_ref());
            let placed = PlacedObject {
                bake: bake.clone(),
                scene_from_object,
                whole: part.and_then(|p| p.capture.known_bake()),
            };
            Some((key, placed))
        });
        let placed = placed.collect::<Option<Vec<_>>>()?;
        Some(placed.into_iter().unzip()).filter(|(of, _): &(Vec<_>, _)| !of.is_empty())
    }

    /// Traces what the objects see of each other where they stand now, first coarsely; the last answer serves until then.
    pub(crate) fn start_inter_object(&mut self) {
        let kind = Kind::Surroundings;
        if self.scene.transfer.method != Method::Directional && self.jobs.is_awaited(kind) {
            self.jobs.cancel(kind);
            self.surroundings.ask_again();
        }
        let Some((of, placed)) = self.placed().filter(|_| self.requested.bakes) else {
            return;
        };
        let surfels: usize = placed.iter().map(|p| p.bake.len()).sum();
        let [coarse, fine] = [Detail::Coarse, Detail::Full].map(|detail| (of.clone(), detail));
        let is_soon_done = surfels < SOON_TRACED || self.canvas.is_none();
        let is_fine_next = is_soon_done || self.surroundings.made_from() == Some(&coarse);
        let next = if is_fine_next { &fine } else { &coarse };
        // One that was cancelled is not begun again.
        if self.surroundings.is_asked(&fine) || self.surroundings.is_asked(next) {
            return;
        }
        if self.jobs.is_awaited(kind) {
            // A coarse one, or one of a few surfels, is soon done, and shown while things move; nobody waits for a fine one of where they
            // were.
            if !self.is_tracing_finely || surfels < SOON_TRACED {
                return;
            }
            self.jobs.cancel(kind);
        }
        // What is known coarsely is shown before it is refined.
        if is_fine_next && !is_soon_done && !self.is_joint_relight_shown() {
            return;
        }
        self.surroundings.ask(next);
        self.is_tracing_finely = next.1 == Detail::Full;
        let key = next.clone();
        let work = move |handle: &Handle<Change>| {
            let progress = |done| handle.progress(done);
            Ok(Arc::new(SceneBake::in_detail(placed, key.1, &progress)?))
        };
        let (label, key) = (tr("tracing between the objects"), next.clone());
        self.start(kind, label, work, move |project, bake| {
            project.surroundings.accept(key, bake);
        });
    }

    /// Version of what is known of the objects among each other.
    fn scene_version(&self) -> u64 {
        match self.scene.transfer.method {
            Method::Directional => self.surroundings.version(),
            Method::Harmonic => self.inserted.version(),
        }
    }

    /// True where the joint relight that is shown is of the current visibility.
    fn is_joint_relight_shown(&self) -> bool {
        let shown = self.joint_relight.current().is_some();
        let of_now = self.joint_relight.made_from();
        shown && of_now.is_some_and(|key| key.1 == self.surroundings.version())
    }

    /// True where visibility between the shown objects is traced finely, as they stand now.
    pub fn is_traced(&self) -> bool {
        if self.scene.transfer.method == Method::Harmonic {
            return self.is_inserted();
        }
        let made_from = self.surroundings.made_from();
        self.placed()
            .is_some_and(|(of, _)| made_from == Some(&(of, Detail::Full)))
    }

    /// The objects that are shown, ready to be relit as one scene: those that are known to each other, and prepared.
    pub fn scene_transfer(&self) -> Option<(Vec<usize>, PreparedTransfer)> {
        let shown = self.members();
        let known: Vec<u64> = match self.scene.transfer.method {
            Method::Directional => {
                let (known, _) = self.surroundings.made_from()?;
                known.iter().map(|(id, ..)| *id).collect()
            }
            Method::Harmonic => {
                let (_, known, _) = self.inserted.made_from()?;
                known.iter().map(|(id, ..)| *id).collect()
            }
        };
        let members = known.iter().map(|id| {
            let at = self.at(*id)?;
            shown.contains(&at).then_some(at)
        });
        let members = members.collect::<Option<Vec<_>>>()?;
        if self.scene.transfer.method == Method::Harmonic {
            let scene = self.inserted.get()?;
            return Some((members, PreparedTransfer::HarmonicScene(scene.clone())));
        }
        let bake = self.surroundings.get()?.clone();
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
        fits.then(|| {
            let scene = SceneTransfer::new(transfers, bake);
            (members, PreparedTransfer::Scene(Arc::new(scene)))
        })
    }

    /// The bake of all that is shown: of the one object as it was captured, or of the scene.
    pub fn shown_bake(&self) -> Option<Arc<Bake>> {
        if !self.is_composed() {
            let (at, ..) = self.shown().next()?;
            return Some(self.baked_of(at)?.bake.clone());
        }
        Some(Arc::new(match self.scene.transfer.method {
            Method::Directional => Bake::Scene(self.surroundings.get()?.clone()),
            Method::Harmonic => Bake::Harmonic(self.insertion.get()?.together.clone()),
        }))
    }

    /// Transfer of all that is shown.
    pub fn shown_transfer(&self) -> Option<PreparedTransfer> {
        if self.is_composed() {
            return self.scene_transfer().map(|(_, transfer)| transfer);
        }
        let (at, ..) = self.shown().next()?;
        Some(self.states[at].prepared.get()?.prepared.clone())
    }

    /// The light that all is relit by, as the scene sees it.
    pub fn target_light(&self) -> Illumination {
        let sides = self.matched_sides();
        let maps = sides.map(|(_, there)| &there.light.illumination);
        let [_, target] = self.scene.lights_on(maps, self.scene_up());
        target
    }

    /// Surfels of all that is shown that are not drawn, `[n]` or empty: hidden, or too faint to be seen.
    pub fn unseen_surfels(&self) -> Vec<bool> {
        let optimizations = &self.scene.transfer.optimizations;
        let unseen = |(_, object, asset): (usize, &Object, &Splat)| {
            let unseen = object
                .hide
                .unseen(&asset.cloud, &asset.bounds, optimizations);
            (unseen, asset.cloud.len())
        };
        let each: Vec<(Vec<bool>, usize)> = self.shown().map(unseen).collect();
        if each.iter().all(|(unseen, _)| unseen.is_empty()) {
            return Vec::new();
        }
        let whole = |(mut unseen, surfels): (Vec<bool>, usize)| {
            unseen.resize(surfels, false);
            unseen
        };
        each.into_iter().flat_map(whole).collect()
    }

    /// Surfels that an image need not relight, `[n]` or empty.
    pub fn spared_surfels(&self) -> Vec<bool> {
        match self.scene.transfer.optimizations.has(Optimization::Unseen) {
            true => self.unseen_surfels(),
            false => Vec::new(),
        }
    }

    /// Relights all objects that are known to each other as one scene. The others are relit alone until it is known what they see.
    pub(crate) fn relight_jointly(&mut self, canvas: &Canvas) {
        let shown = self.members();
        let Some((members, scene)) = self.scene_transfer() else {
            // What is taken away leaves its shadow until the rest is traced anew.
            let mut traces = [Kind::Surroundings, Kind::Insertion].into_iter();
            let waits = traces.any(|kind| self.jobs.is_awaited(kind));
            let stays = |at: &usize| waits && self.together.contains(&self.states[*at].id);
            let stay = shown.into_iter().filter(stays).collect::<Vec<_>>();
            self.keep_joint(&stay);
            return;
        };
        self.keep_joint(&members);
        let each = || members.iter().map(|at| &self.states[*at]);
        let [_, target] = self.oriented_of(members[0]);
        let part = self.scene.view.part();
        // Readout and doubts are of the whole.
        let wants_whole =
            part != Part::Whole && (self.requested.readout || self.shows_confidence());
        let key: JointKey = (
            each().map(|s| s.prepared.version()).collect(),
            self.scene_version(),
            target,
            (part, wants_whole),
            each().map(|s| s.hidden.version()).collect(),
        );
        if self.jobs.is_running(Kind::RelightScene) || !self.joint_relight.ask(&key) {
            return;
        }
        let (target, turn) = self.scene_target(members[0]);
        let context = canvas.context.clone();
        let relit_key = |at: &usize| {
            let [_, target] = self.oriented_of(*at);
            let state = &self.states[*at];
            let key = RelitKey {
                prepared: state.prepared.version(),
                target,
                part,
                unseen: state.unseen.version,
                surroundings: key.1,
                coarse: false,
            };
            (state.id, key)
        };
        let of: Vec<(u64, RelitKey)> = members.iter().map(relit_key).collect();
        let work = move |_: &_| {
            let start = Instant::now();
            let light = target.light.rotated(turn);
            let drawing = Drawing::fastest(&context);
            let kept = |relit: Relit| Arc::new(drawing.kept(relit));
            let shown = scene.relight_objects(&light, part, &[])?;
            let shown: Vec<_> = shown.into_iter().map(kept).collect();
            let ms = start.elapsed().as_secs_f64() * 1e3;
            let uploaded = shown.iter().map(|relit| {
                let there = LiveSh::new(&context, relit, drawing);
                (there, present::tau_colors(&relit.tau))
            });
            let uploaded = uploaded.collect::<Vec<_>>();
            let whole = if part == Part::Whole {
                shown
            } else if wants_whole {
                let whole = scene.relight_objects(&light, Part::Whole, &[])?;
                whole.into_iter().map(kept).collect()
            } else {
                Vec::new()
            };
            Ok((uploaded, whole, ms))
        };
        let label = tr("relighting the scene");
        self.start(
            Kind::RelightScene,
            label,
            work,
            move |project, (shown, whole, ms)| {
                if project.joint_relight.accept(key, ()) {
                    let mut whole = whole.into_iter();
                    for (of, shown) in of.into_iter().zip(shown) {
                        project.show_member(of, shown, whole.next(), ms);
                    }
                }
            },
        );
    }

    /// Notes which objects are relit together. What the last relight of others left is dropped: alone, each is relit anew.
    fn keep_joint(&mut self, members: &[usize]) {
        let ids: Vec<u64> = members.iter().map(|at| self.states[*at].id).collect();
        for id in std::mem::replace(&mut self.together, ids) {
            if let Some(at) = self.at(id).filter(|at| !members.contains(at)) {
                let state = &mut self.states[at];
                state.relit.clear();
                // The window's device has only what was relit together.
                state.prepared.ask_again();
                self.joint_relight.ask_again();
            }
        }
    }

    /// The light as an object sees it, and what turns that to how the scene has it.
    pub(crate) fn scene_target(&self, seen_by: usize) -> (OrientedLight, DMat3) {
        let [_, target] = self.oriented_of(seen_by);
        let turn = self.scene.objects[seen_by].transform.rotation;
        (target, DMat3::from_quat(turn.as_dquat()))
    }

    /// Takes in what was relit of an object: its colour and that of the channel *tau*, and the whole where it is there.
    fn show_member(
        &mut self,
        (id, key): (u64, RelitKey),
        (there, tau): (LiveSh, Vec<[f32; 3]>),
        whole: Option<Arc<RelitRows>>,
        ms: f64,
    ) {
        let Some(at) = self.at(id) else {
            return;
        };
        let relighting = self.relighting(at, &key, Some(ms));
        let state = &mut self.states[at];
        let shown = key.shown();
        state.relit.set(key, relighting);
        if let Some(whole) = whole {
            state.readout.set(shown, whole);
        }
        self.draw(|live| live.set_relit(at, there, tau));
    }
}
