//! Stage *estimate*: the capture light from the object, once a splat, and again when its outside is set or the rest of its capture is hidden or shown.
//! A user-set panorama is compared with the object instead, and completed where it is clipped.

use std::sync::Arc;

use transplat_core::estimate::{
    Advice, Alignment, FoundExposure, align_light, complete_light, estimate_light,
};
use transplat_core::files::is_same_file;
use transplat_core::scene::{EnvironmentLight, Object, wrap};
use transplat_core::settings::Method;
use transplat_core::surfels::UpAxis;

use crate::environments::{Environment, load_map};
use crate::estimate::{make_and_keep, why_not};
use crate::jobs::{Handle, Kind, Work};
use crate::language::{tr, tr_format, tr_later};
use crate::object::{CompletedLight, KnownLightKey, ObjectState};
use crate::project::{Project, Remedy};
use crate::words::of_error;

/// Columns at most of a panorama that is completed: its sun is still some pixels wide.
const MOST_COLUMNS: usize = 4096;

/// For the user, where nobody told the light.
pub const DROP_IT: &str =
    tr_later("Drop the environment of the capture on “Capture light”, if you have it.");

impl Project {
    /// True where the settings request the estimated capture light.
    pub fn asks_for_estimate(&self, at: usize) -> bool {
        if !self.requested.lights || !(self.is_used(at) || at == 0) {
            return false;
        }
        // That of the scene: its first object.
        let is_asked_as_target = at == 0 && self.scene.environment.is_estimate();
        self.scene.objects[at].source.is_estimate() || is_asked_as_target
    }

    /// True where a headless project makes nothing under an object's light yet, since it is being estimated.
    pub(crate) fn waits_for_capture_light(&self, at: usize) -> bool {
        if self.canvas.is_some() {
            return false;
        }
        let is_estimated = self.states[at].estimated.get().is_some();
        (self.asks_for_estimate(at) && !is_estimated) || self.needs_completion(at)
    }

    /// True where an estimate or a completion of the capture light needs a bake.
    pub(crate) fn capture_light_needs_bake(&self, at: usize) -> bool {
        let estimate = self.states[at].estimate.of(&self.is_isolated(at));
        (estimate.is_none() && self.asks_for_estimate(at)) || self.needs_completion(at)
    }

    /// Panorama that an object's capture light is read from, where its clipped highlights are to be completed.
    fn clipped_source(&self, at: usize) -> Option<&Arc<Environment>> {
        let light = self.panorama_of(at)?;
        (self.is_source_clipped(at)? && self.requested.lights && (self.is_used(at) || at == 0))
            .then_some(light)
    }

    /// True where the panorama of an object's capture light is clipped, as set or by its file; none where there is no panorama.
    pub fn is_source_clipped(&self, at: usize) -> Option<bool> {
        let by_file = self.panorama_of(at)?.is_clipped;
        Some(self.scene.objects[at].source.clipped.unwrap_or(by_file))
    }

    /// True where a clipped capture light is to be completed before it serves. The window goes on with it as completed last.
    fn needs_completion(&self, at: usize) -> bool {
        let is_there = || match (self.canvas.is_some(), self.completion_key(at)) {
            (true, _) => self.completed_source(at).is_some(),
            (false, key) => key.is_some_and(|key| self.states[at].completed.of(&key).is_some()),
        };
        self.clipped_source(at).is_some() && !is_there()
    }

    /// All that the completion of a clipped capture light depends on; none before there is a bake.
    fn completion_key(&self, at: usize) -> Option<KnownLightKey> {
        let light = self.clipped_source(at)?;
        let mut settings = EnvironmentLight {
            trust: None,
            ..self.scene.objects[at].source.clone()
        };
        // The unit of a photograph is nobody's: it follows from the shading, and what is set comes on top.
        if light.is_clipped {
            (settings.strength, settings.tint) = (0.0, [1.0; 3]);
        }
        self.known_light_key(at, light, settings)
    }

    /// Capture light as completed last, where it is clipped.
    pub fn completed_source(&self, at: usize) -> Option<&CompletedLight> {
        let light = self.clipped_source(at)?;
        let completed = &self.states[at].completed;
        let made_from = completed.made_from()?;
        completed.get().filter(|_| made_from.light == light.id)
    }

    /// Completes a clipped capture light from the shading, once there is a bake.
    pub(crate) fn update_completion(&mut self, at: usize) {
        let Some(light) = self.clipped_source(at).cloned() else {
            return;
        };
        let has_unit = !light.is_clipped;
        let (Some(key), Some(asset)) = (self.completion_key(at), self.states[at].asset.clone())
        else {
            return;
        };
        let id = self.states[at].id;
        let kind = Kind::Of(id, Work::Complete);
        let Some(own) = self.states[at].whole_directional_bake() else {
            return;
        };
        if self.jobs.is_running(kind) || !self.states[at].completed.ask(&key) {
            return;
        }
        let label = tr_format!("completing the capture light of {}", asset.name());
        let (wanted, raw) = (key.clone(), light);
        let work = move |handle: &Handle<_>| {
            let report = |done| handle.progress(done);
            let (cloud, bake) = asset.under_capture_light(own, wanted.is_isolated)?;
            let map = load_map(&raw)?.reduced(MOST_COLUMNS);
            let to_asset = wanted.settings.map_from_asset(wanted.up).transpose();
            let unit = has_unit.then(|| wanted.settings.gain());
            let made = complete_light(cloud, &bake, &map, unit, to_asset, &report)?;
            Ok(CompletedLight {
                light: Arc::new(raw.completed(&made.map)?),
                gain: made.gain,
                exposure: made.exposure,
            })
        };
        self.start(kind, label, work, move |project, completed| {
            let Some(at) = project.at(id) else {
                return;
            };
            let is_first = project.states[at].completed.get().is_none();
            let (gain, exposure) = (completed.gain, completed.exposure);
            if project.states[at].completed.accept(key, completed) && is_first {
                let text = match exposure {
                    FoundExposure::Unknown => tr_format!(
                        "The shading of {} does not show how bright its capture light was. Set its Strength on the page Capture light.",
                        project.called(at)
                    ),
                    FoundExposure::Known => tr_format!(
                        "The clipped highlights of the capture light are completed from the shading of {name}: {gain:.1} times as much light in all.",
                        name = project.called(at),
                        gain = gain
                    ),
                    FoundExposure::Found(factor) => tr_format!(
                        "The clipped highlights of the capture light are completed from the shading of {name}: {gain:.1} times as much light in all. Its exposure is set, too ({stops:+.1} stops).",
                        name = project.called(at),
                        gain = gain,
                        stops = factor.log2()
                    ),
                };
                project.info(text);
            }
        });
    }

    /// True while an estimate runs whose result is wanted.
    pub fn is_estimate_awaited(&self, at: usize) -> bool {
        let id = self.states[at].id;
        self.jobs.is_awaited(Kind::Of(id, Work::Estimate))
    }

    /// True while the estimate or its bake is under way.
    pub fn is_estimating(&self, at: usize) -> bool {
        self.is_estimate_awaited(at) || self.is_baking_for_estimate(at)
    }

    /// True for an object that the rest of its capture encloses, and that is shown without that: it is relit from the light at its place, not from what
    /// each surfel saw.
    pub fn is_isolated(&self, at: usize) -> bool {
        let is_enclosed = |at: usize| {
            let part = self.states[at].asset.as_ref().and_then(|a| a.part.as_ref());
            part.is_some_and(|part| part.enclosing_light.is_some())
        };
        let objects = &self.scene.objects;
        let Some(file) = objects[at].asset.as_deref().filter(|_| is_enclosed(at)) else {
            return false;
        };
        let is_rest = |(other, object): (usize, &Object)| {
            let is_of_file = object
                .asset
                .as_deref()
                .is_some_and(|f| is_same_file(f, file));
            object.shown && is_of_file && !is_enclosed(other)
        };
        !objects.iter().enumerate().any(is_rest)
    }

    /// Estimates the light of the capture where the settings ask for it, once there is a bake.
    pub(crate) fn update_estimate(&mut self, at: usize) {
        if !self.asks_for_estimate(at) {
            return;
        }
        self.show_estimate(at);
        let is_isolated = self.is_isolated(at);
        if self.states[at].estimate.is_asked(&is_isolated) {
            self.report_if_broken_off(at);
            return;
        }
        let place = self.bake_place(at);
        let is_baked_so = self.is_baked_as_set(at, Method::Directional);
        let state = &mut self.states[at];
        let own = state.whole_directional_bake().filter(|_| is_baked_so);
        let (Some(asset), Some(own), Some(place)) = (&state.asset, own, place) else {
            self.report_if_broken_off(at);
            return;
        };
        state.estimate.ask(&is_isolated);
        let (asset, id) = (asset.clone(), state.id);
        let label = tr_format!("estimating the light of {}", asset.name());
        let kind = Kind::Of(id, Work::Estimate);
        let is_kept = self.canvas.is_some();
        let work = move |handle: &Handle<_>| {
            let report = |done| handle.progress(done);
            let (cloud, bake) = asset.under_capture_light(own, is_isolated)?;
            let part = asset.part.as_ref().filter(|_| is_isolated);
            let shown = part.and_then(|part| part.enclosing_light.as_deref());
            Ok(match is_kept && shown.is_none() {
                true => make_and_keep(&place, cloud, &bake, &report)?,
                false => estimate_light(cloud, &bake, shown, &report)?,
            })
        };
        self.start(kind, label, work, move |project, estimate| {
            if let Some(at) = project.at(id) {
                project.states[at].estimate.accept(is_isolated, estimate);
            }
        });
    }

    /// Estimates the capture light of an object again, also where that was cancelled before or failed.
    pub fn estimate_again(&mut self, at: usize) {
        if self.states[at].estimate.of(&self.is_isolated(at)).is_some() {
            return;
        }
        if !self.is_estimate_awaited(at) {
            self.states[at].estimate.ask_again();
        }
        for method in [self.scene.transfer.method, Method::Directional] {
            let is_awaited = self.is_bake_awaited(at, method);
            if let Some(bake) = self.states[at].bakes.get_mut(&method)
                && !is_awaited
                && bake.current().is_none_or(|b| b.share < 1.0)
            {
                bake.ask_again();
            }
        }
    }

    /// Tells once that what was on its way to an estimate was cancelled, or failed.
    fn report_if_broken_off(&mut self, at: usize) {
        let (is_on_its_way, key) = (self.is_estimating(at), self.is_isolated(at));
        let state = &mut self.states[at];
        let was_awaited = std::mem::replace(&mut state.estimate_awaited, is_on_its_way);
        if was_awaited && !is_on_its_way && state.estimate.of(&key).is_none() {
            let text = tr("The capture light was not estimated.");
            self.offer(text, at, Remedy::Estimate);
        }
    }

    /// Makes a light of the estimate where it is good, upright as the asset is.
    fn show_estimate(&mut self, at: usize) {
        let up = self.up_of(at);
        let path = self.states[at].asset.as_ref().map(|a| &a.path);
        let made_from = self.states[at].estimate.made_from();
        let is_twin = |(other, state): (usize, &ObjectState)| {
            let of_it = state.asset.as_ref().map(|a| &a.path) == path;
            other != at && of_it && state.estimate.made_from() == made_from
        };
        // What one tells, its double tells again.
        let is_known = self.states.iter().enumerate().any(is_twin);
        let state = &mut self.states[at];
        let Some(estimate) = state.estimate.get() else {
            return;
        };
        let key = (state.estimate.version(), up);
        let last = state.estimated.made_from();
        let is_new = last.is_none_or(|(version, _)| *version != key.0);
        if !state.estimated.ask(&key) {
            return;
        }
        let light = Environment::estimated(estimate, up);
        if is_new && !is_known && self.scene.objects[at].source.is_estimate() {
            let message = match estimate.obstacle {
                None if estimate.light.shown.is_some() => tr_format!(
                    "The capture light is estimated from the object and the rest of its capture (confidence {percent:.0} %, trust {trust:.0} %).",
                    percent = estimate.percent(),
                    trust = 100.0 * estimate.trust()
                ),
                None => tr_format!(
                    "The capture light is estimated from the object (confidence {percent:.0} %, trust {trust:.0} %). Its tint is assumed. {drop_it}",
                    percent = estimate.percent(),
                    trust = 100.0 * estimate.trust(),
                    drop_it = tr(DROP_IT)
                ),
                Some(obstacle) => tr_format!(
                    "The capture light {obstacle}. {drop_it}",
                    obstacle = why_not(self.scene.transfer.method, obstacle),
                    drop_it = tr(DROP_IT)
                ),
            };
            let of = (self.scene.objects.len() > 1).then(|| self.called(at));
            self.info(of.map_or(message.clone(), |name| format!("{name}: {message}")));
        }
        match light {
            Ok(light) => {
                self.states[at].estimated.accept(key, Arc::new(light));
            }
            Err(error) => self.error(of_error(&error)),
        }
    }

    /// Key of a panorama that is compared with an object under some settings; none where the bake is not complete.
    fn known_light_key(
        &self,
        at: usize,
        light: &Environment,
        settings: EnvironmentLight,
    ) -> Option<KnownLightKey> {
        let state = &self.states[at];
        state.whole_directional_bake()?;
        let is_read_so = light.reading == self.scene.reading_of(&light.path);
        is_read_so.then_some(KnownLightKey {
            light: light.id,
            settings,
            bake: state.bakes.get(&Method::Directional)?.version(),
            up: self.up_of(at),
            is_isolated: self.is_isolated(at),
        })
    }

    /// All that an alignment depends on; none where the capture light is no panorama, or the bake is not complete.
    fn alignment_key(&self, at: usize) -> Option<KnownLightKey> {
        let settings = &self.scene.objects[at].source;
        let is_asked = self.requested.lights && self.requested.alignment && self.is_used(at);
        if !is_asked || !self.is_baked_as_set(at, Method::Directional) {
            return None;
        }
        // None of these changes what the light is like.
        let settings = EnvironmentLight {
            rotation: 0.0,
            mirror: false,
            strength: 0.0,
            tint: [1.0; 3],
            trust: None,
            clipped: None,
            ..settings.clone()
        };
        self.known_light_key(at, self.panorama_of(at)?, settings)
    }

    /// Panorama that an object's capture light is read from, as it is in its file.
    fn panorama_of(&self, at: usize) -> Option<&Arc<Environment>> {
        let file = self.scene.objects[at].source.file.as_ref()?;
        self.environments.get(file).filter(|light| light.is_file())
    }

    /// Errors of a user-set capture light at every rotation; none before they are known.
    pub fn alignment(&self, at: usize) -> Option<&Alignment> {
        let made = self.states[at].alignment.of(&self.alignment_key(at)?);
        made.and_then(Option::as_ref)
    }

    /// Compares a user-set capture light with the object, once it is prepared: that comes first.
    pub(crate) fn update_alignment(&mut self, at: usize) {
        let is_next = self.canvas.is_none() || self.is_prepared(at);
        let Some(key) = self.alignment_key(at).filter(|_| is_next) else {
            return;
        };
        let (up, is_isolated) = (key.up, key.is_isolated);
        let id = self.states[at].id;
        let kind = Kind::Of(id, Work::Align);
        let Some((asset, own)) = self.states[at]
            .asset
            .clone()
            .zip(self.states[at].whole_directional_bake())
        else {
            return;
        };
        if self.jobs.is_running(kind) || !self.states[at].alignment.ask(&key) {
            return;
        }
        let Some(panorama) = self.panorama_of(at).cloned() else {
            return;
        };
        let lights = [false, true].map(|mirror| {
            let settings = EnvironmentLight {
                mirror,
                ..key.settings.clone()
            };
            settings.orient(&panorama.illumination, UpAxis::PlusZ)
        });
        let label = tr_format!("comparing the capture light with {}", asset.name());
        let work = move |handle: &Handle<_>| {
            let report = |done| handle.progress(done);
            let (cloud, bake) = asset.under_capture_light(own, is_isolated)?;
            let [light, mirrored] = &lights;
            let lights = [light.for_directional()?.1, mirrored.for_directional()?.1];
            Ok(align_light(cloud, &bake, up, lights, &report)?)
        };
        self.start(kind, label, work, move |project, alignment| {
            let Some(at) = project.at(id) else {
                return;
            };
            if project.states[at].alignment.accept(key, alignment) {
                project.advise(at);
            }
        });
    }

    /// Leaves a message where the capture light contradicts the object.
    fn advise(&mut self, at: usize) {
        match self.contradiction(at) {
            Some((text, Some(remedy))) => self.offer(text, at, remedy),
            Some((text, None)) => self.info(text),
            None => {}
        }
    }

    /// Warning that a user-set capture light contradicts the shading of an object, and what may help; none of a double of an earlier one.
    pub fn contradiction(&self, at: usize) -> Option<(String, Option<Remedy>)> {
        let source = &self.scene.objects[at].source;
        let path = self.states[at].path();
        let is_twin = |other: usize| self.states[other].path() == path;
        let alignment = self.alignment(at).filter(|_| !(0..at).any(is_twin))?;
        let name = self.called(at);
        match alignment.advice(source.rotation, source.mirror) {
            Advice::Keep => None,
            Advice::Rotate(..) => {
                let text = tr_format!(
                    "The capture light contradicts the shading of {} at this rotation.",
                    name
                );
                Some((text, Some(Remedy::Align)))
            }
            Advice::Replace => {
                let text = tr_format!(
                    "The capture light fits the shading of {} at no rotation. Is it of another place or time?",
                    name
                );
                Some((text, None))
            }
        }
    }

    /// Rotates a user-set capture light to where it explains the shading best, and mirrors it where that is clearly better. False where no
    /// rotation explains it, or none is known.
    pub fn align_source(&mut self, at: usize) -> bool {
        let source = &self.scene.objects[at].source;
        let fits = |a: &&Alignment| a.advice(source.rotation, source.mirror) != Advice::Replace;
        let Some(alignment) = self.alignment(at).filter(fits) else {
            return false;
        };
        let (rotation, mirror) = alignment.best(source.mirror);
        let source = &mut self.scene.objects[at].source;
        source.rotation = wrap(rotation);
        source.mirror = mirror;
        true
    }
}
