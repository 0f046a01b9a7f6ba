//! Loading of splats, environments and looks into a project.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};

use glam::DVec3;
use transplat_core::camera::{CameraPose, first_pose, framed};
use transplat_core::estimate::Estimate;
use transplat_core::files::is_same_file;
use transplat_core::scene::{ESTIMATE, EnvironmentLight, Object, Scene, is_even};
use transplat_core::settings::Method;
use transplat_core::up_axis::UpEvidence;
use transplat_gpu::live::{Drawing, LiveSplat};

use crate::capture::Capture;
use crate::environments::{Environment, light_name};
use crate::estimate;
use crate::jobs::{Kind, Work};
use crate::language::{tr, tr_format};
use crate::object::ObjectState;
use crate::project::canvas::Canvas;
use crate::project::stages::DROP_IT;
use crate::project::{Notice, OpenCameras, Project, Remedy};
use crate::reading::Reading;
use crate::splat::{OpenedWith, Splat, name_of, told};
use crate::words::of_error;

impl Project {
    /// Opens a scene of one object: on success it is shown, otherwise everything stays.
    pub fn open_scene(&mut self, scene: Scene) {
        if let Some(path) = scene.objects[0].asset.clone() {
            self.load_splat(0, path, OpenedWith::Scene(Box::new(scene)));
        }
    }

    /// True where a splat of that file is open.
    pub fn is_open(&self, path: &Path) -> bool {
        let mut open = self.states.iter().filter_map(|s| s.asset.as_ref());
        open.any(|asset| asset.path == path)
    }

    /// Shows a scene without a splat.
    pub fn start_empty(&mut self, scene: Scene) {
        self.cameras = None;
        self.arrange(&[None]);
        self.take_over(scene);
    }

    /// Shows a splat in the place of an object.
    pub fn replace_object(&mut self, at: usize, path: PathBuf) {
        // Its capture light is unknown.
        let object = Object {
            source: EnvironmentLight::of(ESTIMATE),
            ..Object::default()
        };
        self.load_splat(at, path, OpenedWith::Object(Box::new(object), None));
    }

    /// Shows a scene: its objects keep what is made of them where they are open already.
    pub fn take_over(&mut self, mut scene: Scene) {
        if scene.objects.len() > 1 {
            for object in &mut scene.objects {
                object.source.file.get_or_insert(ESTIMATE.into());
            }
        }
        scene.light_as_captured();
        let is_whole = |object: &Object| object.asset.as_ref().is_none_or(|p| self.is_open(p));
        let is_whole = scene.objects.iter().all(is_whole);
        match scene.camera.take() {
            Some(camera) => self.pose = camera,
            // All of it, as it comes, until somebody looks elsewhere.
            None if !is_whole => self.framed = Some(self.pose),
            None => {}
        }
        self.match_states(&scene.objects);
        self.scene = scene;
        // Its lights are where they are.
        self.followed = None;
    }

    /// Has a state for each of the objects: that of its splat, where there is one.
    pub(crate) fn match_states(&mut self, objects: &[Object]) {
        let states = &self.states;
        let is_of = |at: usize, object: &Object| states[at].path() == object.asset.as_deref();
        let is_cut_as = |at: usize, object: &Object| {
            let asset = states[at].asset.as_ref();
            asset.is_none_or(|a| a.reading.cut == object.cut)
        };
        let mut of: Vec<Option<usize>> = vec![None; objects.len()];
        for (at, object) in objects.iter().enumerate().take(states.len()) {
            let keeps = object.asset.is_none() || is_of(at, object) && is_cut_as(at, object);
            of[at] = Some(at).filter(|_| keeps);
        }
        for cut_otherwise in [false, true] {
            for (at, object) in objects.iter().enumerate() {
                let is_it = |i: usize| is_of(i, object) && (cut_otherwise || is_cut_as(i, object));
                let is_free = |i: &usize| is_it(*i) && !of.contains(&Some(*i));
                of[at] = of[at].or_else(|| (0..states.len()).find(is_free));
            }
        }
        for at in 0..objects.len().min(states.len()) {
            let is_free = states[at].path().is_none() && !of.contains(&Some(at));
            of[at] = of[at].or(Some(at).filter(|_| is_free));
        }
        self.arrange(&of);
    }

    /// Takes the states in another order, `of` is which one each is now; one that is not named is forgotten.
    pub fn arrange(&mut self, of: &[Option<usize>]) {
        if of.iter().copied().eq((0..self.states.len()).map(Some)) {
            return;
        }
        let last = std::mem::take(&mut self.states);
        let mut last: Vec<_> = last.into_iter().map(Some).collect();
        let mut take = |at: &Option<usize>| last[(*at)?].take();
        let taken = of.iter().map(&mut take);
        self.states = taken
            .map(|state| state.unwrap_or_else(|| ObjectState::new(None)))
            .collect();
        for state in last.into_iter().flatten() {
            self.jobs.cancel_object(state.id);
        }
        self.draw(|live| live.arrange(of));
        self.pinned = None;
    }

    /// Loads what the scene lists and what is not there yet: one splat after the other.
    pub(crate) fn load_missing(&mut self) {
        if self.is_loading_asset() {
            return;
        }
        let each = self.scene.objects.iter().zip(&self.states).enumerate();
        let mut missing = each.filter_map(|(at, (object, state))| {
            let is_needed = at == 0 || self.is_used(at);
            let path = object.asset.as_deref().filter(|_| is_needed)?;
            (state.path() != Some(path)).then(|| (at, path.to_owned()))
        });
        if let Some((at, path)) = missing.next() {
            self.states[at].tried = Some(path.clone());
            self.load_splat(at, path, OpenedWith::Listed);
        }
    }

    /// True for an object whose splat could not be loaded.
    pub fn is_missing(&self, at: usize) -> bool {
        let state = &self.states[at];
        let is_loading = self.jobs.is_awaited(Kind::Of(state.id, Work::Load));
        state.asset.is_none() && state.tried.is_some() && !is_loading
    }

    /// Tries once more to load a splat that could not be had.
    pub fn load_again(&mut self, at: usize) {
        self.states[at].tried = None;
    }

    /// Loads a splat; on success it is shown with the settings, otherwise everything stays.
    pub fn load_splat(&mut self, at: usize, path: PathBuf, opened_with: OpenedWith) {
        let id = self.states[at].id;
        let kind = Kind::Of(id, Work::Load);
        self.jobs.cancel(kind);
        let canvas = self.canvas.clone();
        let label = tr_format!("loading {name}", name = name_of(&path));
        let asked = self.scene.objects[at].clone();
        let object = match &opened_with {
            OpenedWith::Object(object, _) => (**object).clone(),
            OpenedWith::Scene(scene) => scene.objects[0].clone(),
            OpenedWith::Again | OpenedWith::Listed => asked.clone(),
        };
        // One that is doubled is not read twice.
        let is_listed = matches!(opened_with, OpenedWith::Listed);
        let open = self.states.iter().filter_map(|s| s.asset.as_ref());
        let is_it = |a: &&Splat| a.path == path && a.reading == Reading::of(&object);
        let twin = open.filter(is_it).find(|_| is_listed).cloned();
        let capture = self.capture_for(&path, &object);
        let work = move |_: &_| {
            let asset = match twin {
                Some(twin) => Splat {
                    warnings: Vec::new(),
                    ..twin
                },
                None => Splat::load(path, &object, capture)?,
            };
            let Some(Canvas { context, .. }) = &canvas else {
                return Ok((asset, None, None));
            };
            let asset = asset.with_hints();
            let live = LiveSplat::new(context, &asset.cloud, Drawing::fastest(context))?;
            let estimate = estimate::kept(&asset.path, asset.whole_cloud());
            Ok((asset, Some(live), estimate))
        };
        self.start_or_else(kind, label, work, move |project, loaded| {
            // Its object may have been taken away meanwhile.
            let at = project.at(id);
            let Some(at) = at.filter(|at| *at < project.scene.objects.len()) else {
                return;
            };
            match loaded {
                Ok(loaded) => project.show_asset(at, opened_with, &asked, loaded),
                Err(error) => {
                    // What could not be loaded again stays as it was loaded.
                    if let Some(asset) = &project.states[at].asset {
                        asset.reading.give_back(&mut project.scene.objects[at]);
                    }
                    project.error(of_error(&error));
                    project.drop_added(at);
                }
            }
        });
    }

    /// Capture that an object is to be cut out of, where that is open.
    fn capture_for(&mut self, path: &Path, object: &Object) -> Option<Arc<Capture>> {
        if object.cut.is_empty() {
            return None;
        }
        let reading = Reading::of(object);
        let mut known = self.captures.iter().filter_map(Weak::upgrade);
        if let Some(known) = known.find(|c| c.is_of(path, &reading)) {
            return Some(known);
        }
        let is_of_it = |state: &&ObjectState| {
            let asset = state.asset.as_ref().filter(|a| is_same_file(&a.path, path));
            asset.is_some_and(|a| a.reading.is_of_same_capture(&reading))
        };
        let open = self.states.iter().find(is_of_it)?;
        let whole = open.asset.as_ref()?;
        let (cloud, file) = (whole.cloud.clone(), whole.file.clone());
        let bake = open.whole_directional_bake();
        let capture = Arc::new(Capture::new(path.to_owned(), reading, cloud, file, bake));
        self.know_capture(&capture);
        Some(capture)
    }

    /// Notes what objects are cut out of: all parts of one capture share it.
    fn know_capture(&mut self, capture: &Arc<Capture>) {
        self.captures.retain(|c| c.strong_count() > 0);
        let is_it = |c: &Weak<Capture>| std::ptr::eq(c.as_ptr(), Arc::as_ptr(capture));
        if !self.captures.iter().any(is_it) {
            self.captures.push(Arc::downgrade(capture));
        }
    }

    /// Takes away what was put into the scene and cannot be shown.
    fn drop_added(&mut self, at: usize) {
        let is_alone = self.scene.objects.len() == 1;
        if self.states[at].is_added && self.states[at].asset.is_none() && !is_alone {
            self.remove(at);
        }
    }

    /// Shows a loaded splat; nothing of the last one is left.
    fn show_asset(
        &mut self,
        mut at: usize,
        opened_with: OpenedWith,
        asked: &Object,
        (asset, live, estimate): (Splat, Option<LiveSplat>, Option<Estimate>),
    ) {
        if let OpenedWith::Scene(scene) = &opened_with {
            // It has room alone, or would not have come this far.
            self.take_over((**scene).clone());
            at = 0;
        }
        let drawn = self.canvas.as_ref().zip(live);
        let is_taken = drawn.map(|(canvas, live)| canvas.live().set_asset(at, live));
        if let Some(Err(error)) = is_taken {
            self.error(error.to_string());
            self.drop_added(at);
            return;
        }
        self.jobs.cancel_object(self.states[at].id);
        self.stages.load += 1;
        self.notices.push(Notice::Opened(asset.path.clone()));
        if let Some(part) = &asset.part {
            self.know_capture(&part.capture);
        }
        for warning in asset.warnings.clone() {
            self.info(warning);
        }
        let replaced = self.replaced(at, &asset.path, &opened_with);
        let scene_up = self.scene_up();
        let object = &mut self.scene.objects[at];
        let is_unset = match &opened_with {
            OpenedWith::Object(opened, _) => {
                // A look that came meanwhile tells all there is.
                let is_as_asked = object.source == asked.source;
                *object = told((**opened).clone(), asked, object.clone());
                is_as_asked
            }
            // Put into the scene just now.
            OpenedWith::Listed => self.states[at].seeks_room.is_some(),
            OpenedWith::Again | OpenedWith::Scene(_) => false,
        };
        if at == 0 && self.cameras.as_ref().is_none_or(|c| c.is_found) {
            // Those of the last one are nothing to this one.
            self.cameras = asset.cameras.clone().map(|file| OpenCameras {
                path: file.path.clone(),
                file,
                at: 0,
                photograph: None,
                is_found: true,
            });
        }
        let origin = asset.cloud.origin;
        if is_unset {
            // What is there stays around it, wherever its file's coordinates have it.
            let object = &mut self.scene.objects[at];
            let transform = object.transform;
            object.take_origin(origin, DVec3::ZERO);
            object.transform = transform;
            self.propose(at, &asset);
        } else {
            let moved = self.scene.take_origin(at, origin, asset.file_up);
            self.pose.pivot = (self.pose.pivot.as_dvec3() + moved).as_vec3();
            // Lights that are fixed to the camera are moved already.
            self.followed = None;
        }
        let object = &mut self.scene.objects[at];
        object.asset = Some(asset.path.clone());
        if self.canvas.is_some() {
            // Where nobody tells it, and as long as what is told cannot be read.
            object.source.file.get_or_insert(ESTIMATE.into());
        }
        if object.source.file.as_deref().is_some_and(is_even) {
            self.info(tr_format!(
                "The capture light is unknown; uniform white is assumed. {drop_it}",
                drop_it = tr(DROP_IT)
            ));
        }
        self.ground.clear();
        self.ground_lit.clear();
        self.pinned = None;
        let is_twin = |a: &Splat| Arc::ptr_eq(&a.cloud, &asset.cloud);
        let mut others = self.states.iter();
        let twin = others.find(|s| s.asset.as_ref().is_some_and(is_twin));
        // Of other colours it is the same geometry.
        let last = &self.states[at];
        let is_recolored = last
            .asset
            .as_ref()
            .is_some_and(|a| asset.takes_bake_of_recolored(a));
        let same = twin.or(is_recolored.then_some(last));
        let bakes = same.map(ObjectState::kept_bakes).unwrap_or_default();
        let last = &mut self.states[at];
        let (is_added, seeks_room) = (last.is_added, last.seeks_room);
        let mut source = last.source.clone();
        if last.asset.as_ref().is_none_or(|a| a.path != asset.path) {
            source.settings = EnvironmentLight::of(ESTIMATE);
        }
        // A bake that was named belongs to the asset that came with it.
        let saved_bake = last.saved_bake.take_if(|_| last.asset.is_none());
        *last = ObjectState {
            source,
            saved_bake,
            bakes,
            ..ObjectState::new(Some(asset))
        };
        if let Some(estimate) = estimate {
            last.estimate.set(false, estimate);
        }
        self.look_at_opened(&opened_with);
        if let Some(last) = replaced {
            self.take_place(at, last, scene_up);
        }
        if is_added {
            self.notices.push(Notice::Added(at));
            if let Some(small) = seeks_room {
                self.stand_upright(at);
                self.find_room(at, small);
            }
            self.reveal(at);
        }
    }

    /// Sets what nobody told of a splat that is opened, and says so: which way is up, by the ground in it, and where its light is not known
    /// the strength of the light that it is relit by.
    fn propose(&mut self, at: usize, asset: &Splat) {
        let by_cameras = at == 0 && self.set_upright_by_cameras(asset);
        let object = &mut self.scene.objects[at];
        if let (None, Some((up, evidence)), false) = (object.up, asset.proposed_up, by_cameras) {
            object.up = Some(up);
            let name = up.name();
            self.info(match evidence {
                UpEvidence::Ground => tr_format!(
                    "Up axis set to {name}, by its ground. Change it in Objects.",
                    name = name
                ),
                UpEvidence::Stance => tr_format!(
                    "Up axis set to {name}, by its shape. Change it in Objects.",
                    name = name
                ),
            });
        }
        if asset.proposed_crop.is_some() && self.scene.objects[at].hide.is_off() {
            let text = tr("The capture has surroundings around the object.");
            self.offer(text, at, Remedy::Crop);
        }
        let is_unknown = self.scene.objects[at].source.is_estimate();
        if is_unknown && self.scene.objects.len() == 1 && !self.scene.match_strength {
            self.scene.match_strength = true;
            self.matches_by_itself = true;
            let text = tr("The strength of the capture light is unknown, so Match exposure is on.");
            self.offer(text, at, Remedy::KeepStrength);
        }
    }

    /// Points the camera at what was opened, where nobody has pointed it elsewhere.
    fn look_at_opened(&mut self, opened_with: &OpenedWith) {
        let is_alone = self.scene.objects.len() == 1;
        match opened_with {
            OpenedWith::Object(_, Some(camera)) => self.pose = *camera,
            OpenedWith::Object(_, None) if is_alone => self.look_at_all(),
            OpenedWith::Scene(scene) if scene.camera.is_none() => self.look_at_all(),
            OpenedWith::Listed if self.framed == Some(self.pose) => {
                self.look_at_all();
                self.framed = Some(self.pose);
            }
            _ => {}
        }
    }

    fn look_at_all(&mut self) {
        if let Some((points, bounds)) = self.visible_points() {
            self.pose = first_pose(&points, self.scene_up(), &bounds, self.viewport);
            // Lights that are fixed to the camera are where they were told.
            self.followed = None;
        }
    }

    /// Shows all of what is there, from the side that it is seen from.
    pub fn frame_all(&mut self) {
        let (up, size, last) = (self.scene_up(), self.viewport, self.pose);
        if let Some((points, bounds)) = self.visible_points() {
            self.pose = CameraPose {
                orthographic: last.orthographic,
                ..framed(&points, up, &bounds, &last, size)
            };
        }
    }

    /// Reads the environments that wait, and those that the settings name.
    pub(crate) fn start_lights(&mut self) {
        if !self.requested.lights {
            return;
        }
        let lights = self.scene.environment_lights();
        let shown: Vec<&Path> = lights.filter_map(|l| l.file.as_deref()).collect();
        for path in &shown {
            self.environments
                .request_as(path, &self.scene.reading_of(path));
        }
        let next = std::iter::from_fn(|| self.environments.next(&shown));
        for path in next.collect::<Vec<_>>() {
            self.start_light(path);
        }
    }

    /// True where the scene names a light's file.
    fn is_named(&self, path: &Path) -> bool {
        let mut lights = self.scene.environment_lights();
        lights.any(|light| light.file.as_deref() == Some(path))
    }

    fn start_light(&mut self, path: PathBuf) {
        let device = self.device.clone();
        let label = tr_format!("reading {}", light_name(&path));
        let (file, reading) = (path.clone(), self.scene.reading_of(&path));
        // For either method: they are changed with a click.
        let method = Method::Directional;
        let work = move |_: &_| Environment::load(&device.any(), &file, reading, method);
        self.start_or_else(Kind::Light, label, work, move |project, read| match read {
            Ok(read) => {
                project.stages.project_environment += 1;
                // Of those that wait on the shelf the panel tells, once they are taken.
                let is_taken = project.is_named(&path);
                for warning in read.warnings.iter().filter(|_| is_taken) {
                    project.info(warning.clone());
                }
                project.environments.has_read(&path, Some(read));
                project.notices.push(Notice::Opened(path));
            }
            Err(why) => {
                project.environments.has_read(&path, None);
                project.error(of_error(&why));
                project.take_back(&path);
                // One that cannot be read as it was told is a light all the same.
                if project.environments.get(&path).is_none() {
                    project.notices.push(Notice::NoLight(path));
                }
            }
        });
    }

    /// Sets lights that cannot be read back to the last ones.
    fn take_back(&mut self, path: &Path) {
        let mut is_estimated = false;
        let objects = self.scene.objects.iter_mut().zip(&self.states);
        let sources = objects.map(|(object, state)| (&mut object.source, &state.source));
        let environment = (&mut self.scene.environment, &self.environment);
        for (settings, resolved) in sources.chain([environment]) {
            if settings.file.as_deref() == Some(path) {
                *settings = resolved.settings.clone();
                is_estimated |= settings.is_estimate();
            }
        }
        if is_estimated {
            self.info(tr(
                "The capture light is estimated from the object instead.",
            ));
        }
    }

    /// True while a splat is being read.
    pub fn is_loading_asset(&self) -> bool {
        let mut running = self.jobs.running().iter();
        running.any(|job| matches!(job.kind, Kind::Of(_, Work::Load)))
    }
}
