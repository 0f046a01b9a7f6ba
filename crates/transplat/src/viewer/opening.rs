//! What is opened: splats, environments, looks.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use transplat_core::estimate::Estimate;
use transplat_core::files::{FileKind, file_kind, load_asset, load_look};
use transplat_core::ground::ground_plane;
use transplat_core::scene::{ESTIMATE, EnvironmentLight, Object, Scene, is_estimate, is_even};
use transplat_gpu::live::LiveAsset;

use super::asset::{Asset, OpenedWith};
use super::environments::{Environment, light_name};
use super::jobs::{Kind, Work};
use super::navigation;
use super::object::ObjectState;
use super::session::{Event, Session, TARGET};
use super::stages::DROP_IT;
use crate::pipeline::estimate;
use crate::pipeline::warnings::asset_warnings;

impl Session {
    /// Opens any file, by what is in it: a splat replaces the asset, an environment becomes the target, a look is applied.
    pub fn open(&mut self, path: &Path) {
        match file_kind(path) {
            Ok(FileKind::Ply) if self.adds_splats && self.asset().is_some() => {
                self.add_object(path.to_owned());
            }
            Ok(FileKind::Ply) => {
                // Nothing is told of it: its light is estimated.
                let object = Object {
                    source: EnvironmentLight::of(ESTIMATE),
                    ..Object::default()
                };
                let opened_with = OpenedWith::Object(Box::new(object), None);
                self.load_asset(self.selected, path.to_owned(), opened_with);
            }
            Ok(FileKind::Look) => match load_look(path) {
                Ok(scene) => {
                    self.opened.push(path.to_owned());
                    self.apply(scene);
                }
                Err(error) => self.error(error.to_string()),
            },
            Ok(FileKind::Hdr | FileKind::Exr | FileKind::Picture) => {
                self.set_light(TARGET, path.to_owned());
            }
            Ok(FileKind::Bake) => self.error(format!(
                "{}: a bake is found by itself when it lies beside its splat",
                path.display()
            )),
            Err(error) => self.error(error.to_string()),
        }
    }

    /// Takes over a scene's settings: at once, or once its assets are loaded.
    pub fn apply(&mut self, scene: Scene) {
        let count = scene.objects.len().max(self.states.len());
        self.states.resize_with(count, || ObjectState::new(None));
        let open = |at: usize| self.states.get(at)?.asset.as_ref().map(|a| &a.path);
        let mut assets = scene.objects.iter().map(|o| o.asset.as_ref()).enumerate();
        let missing = assets.find(|(at, asset)| asset.is_some() && *asset != open(*at));
        match missing {
            Some((at, Some(path))) => {
                let path = path.clone();
                self.load_asset(at, path, OpenedWith::Scene(Box::new(scene)));
            }
            _ => {
                let mut scene = scene;
                scene.light_as_captured();
                if let Some(camera) = scene.camera {
                    self.pose = camera;
                }
                self.scene = Scene {
                    camera: None,
                    ..scene
                };
                self.selected = self.selected.min(self.scene.objects.len() - 1);
            }
        }
    }

    /// Loads a splat; on success it is shown with the settings, otherwise everything stays.
    pub fn load_asset(&mut self, at: usize, path: PathBuf, opened_with: OpenedWith) {
        let id = self.states[at].id;
        let kind = Kind::Of(id, Work::Load);
        self.jobs.cancel(kind);
        let context = self.context.clone();
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let label = format!("loading {name}");
        let is_scene = matches!(opened_with, OpenedWith::Scene(_));
        let (object, asked) = (opened_with.object(at).clone(), self.scene.clone());
        let work = move |_: &_| {
            let start = Instant::now();
            let (mut cloud, file) = load_asset(&path)?;
            let file_up = cloud.up;
            object.apply_to(&mut cloud);
            let cloud = Arc::new(cloud);
            let live = LiveAsset::new(&context, &cloud)?;
            let estimate = estimate::kept(&path, &cloud);
            let asset = Asset {
                bounds: cloud.bounds(),
                ground: ground_plane(&cloud, cloud.up),
                up: cloud.up,
                warnings: asset_warnings(&path, &file),
                load_ms: start.elapsed().as_secs_f64() * 1e3,
                file_up,
                file: Arc::new(file),
                cloud,
                path,
                reading_asked: None,
            };
            Ok((asset, live, estimate))
        };
        self.start_or_else(kind, label, work, move |session, loaded| {
            let Some(at) = session.at(id) else {
                return;
            };
            let is_gone = at >= session.scene.objects.len() && !is_scene;
            match loaded {
                // Its object was taken away meanwhile.
                Ok(_) if is_gone => {}
                Ok(loaded) => {
                    let scene = opened_with.over(at, &asked, &session.scene, session.pose);
                    let is_added = at >= session.scene.objects.len();
                    let is_taken = session.show_asset(at, scene, loaded);
                    if is_added && is_taken {
                        session.selected = at;
                    }
                    if is_scene && is_taken {
                        // The next of its splats.
                        session.apply(session.scene.clone());
                    }
                }
                Err(error) => {
                    // What could not be loaded again stays as it was loaded.
                    let object = session.scene.objects.get_mut(at);
                    if let (Some(asset), Some(object)) = (&session.states[at].asset, object) {
                        asset.give_back(object);
                    }
                    session.error(format!("{error:#}"));
                }
            }
        });
    }

    /// Shows a loaded splat; nothing of the last one is left. Whether the adapter takes it.
    fn show_asset(
        &mut self,
        at: usize,
        mut scene: Scene,
        (asset, live, estimate): (Asset, LiveAsset, Option<Estimate>),
    ) -> bool {
        let object = &mut scene.objects[at];
        object.asset = Some(asset.path.clone());
        // Where nobody tells it, and as long as what is told cannot be read.
        object.source.file.get_or_insert(ESTIMATE.into());
        let source_is_even = object.source.file.as_deref().is_some_and(is_even);
        let size = self.viewport;
        self.pose = scene.camera.take().unwrap_or_else(|| {
            let up = object.up.unwrap_or(asset.file_up);
            navigation::first_pose(&asset.cloud, up, &asset.bounds, size)
        });
        let is_taken = self.live().set_asset(at, live);
        if let Err(error) = is_taken {
            self.error(error.to_string());
            return false;
        }
        let last = &self.states[at];
        self.jobs.cancel_object(last.id);
        self.stages.load += 1;
        self.opened.push(asset.path.clone());
        for warning in asset.warnings.clone() {
            self.info(warning);
        }
        if source_is_even {
            self.info(format!(
                "what it was captured under is not known: even light is assumed. {DROP_IT}"
            ));
        }
        // The ground is that of the last one shown.
        for state in &mut self.states {
            state.ground_lit.clear();
        }
        let last = &mut self.states[at];
        let mut source = last.source.clone();
        if last.asset.as_ref().is_none_or(|a| a.path != asset.path) {
            source.settings = EnvironmentLight::of(ESTIMATE);
        }
        // A bake that was named belongs to the asset that came with it.
        let saved_bake = last.saved_bake.take_if(|_| last.asset.is_none());
        *last = ObjectState {
            source,
            saved_bake,
            ..ObjectState::new(Some(asset))
        };
        if let Some(estimate) = estimate {
            last.estimate.set((), estimate);
        }
        self.pinned = None;
        self.scene = scene;
        self.selected = self.selected.min(self.scene.objects.len() - 1);
        true
    }

    /// Puts a light on a side; it is shown once it is loaded.
    pub fn set_light(&mut self, side: usize, path: PathBuf) {
        self.environments.request(&path);
        self.side_mut(side).set_file(path);
    }

    /// Reads the environments that wait, and those that the settings name.
    pub(super) fn start_lights(&mut self) {
        let sources = self.scene.objects.iter().map(|o| &o.source);
        let lights = sources.chain([&self.scene.environment]);
        let shown: Vec<&Path> = lights.filter_map(|l| l.file.as_deref()).collect();
        for path in &shown {
            self.environments.request(path);
        }
        let next = std::iter::from_fn(|| self.environments.next(&shown));
        for path in next.collect::<Vec<_>>() {
            self.start_light(path);
        }
    }

    fn start_light(&mut self, path: PathBuf) {
        let background = self.background.clone();
        let label = format!("reading {}", light_name(&path));
        let file = path.clone();
        let work = move |_: &_| Environment::load(&background, &file);
        self.start_or_else(Kind::Light, label, work, move |session, read| match read {
            Ok(read) => {
                session.stages.project_environment += 1;
                for warning in read.warnings.clone() {
                    session.info(warning);
                }
                session.environments.has_read(&path, Some(read));
                session.opened.push(path);
            }
            Err(why) => {
                session.environments.has_read(&path, None);
                session.error(format!("{why:#}"));
                session.take_back(&path);
                session.events.push(Event::NoLight(path));
            }
        });
    }

    /// What cannot be read changes nothing.
    fn take_back(&mut self, path: &Path) {
        let objects = self.scene.objects.iter_mut().zip(&self.states);
        let sources = objects.map(|(object, state)| (&mut object.source, &state.source));
        let environment = (&mut self.scene.environment, &self.environment);
        for (settings, resolved) in sources.chain([environment]) {
            if settings.file.as_deref() == Some(path) {
                *settings = resolved.settings.clone();
            }
        }
    }

    /// Whether a splat is being read.
    pub(super) fn is_loading_asset(&self) -> bool {
        let mut running = self.jobs.running().iter();
        running.any(|job| matches!(job.kind, Kind::Of(_, Work::Load)))
    }

    /// Whether a light is being read, or estimated.
    pub fn is_loading(&self, path: &Path) -> bool {
        let is_estimating = is_estimate(path) && self.is_estimating(self.selected);
        is_estimating || self.environments.is_awaited(path)
    }

    /// Exchanges the two lights with their turns and strengths.
    pub fn swap_lights(&mut self) {
        let source = &mut self.scene.objects[self.selected].source;
        std::mem::swap(source, &mut self.scene.environment);
    }
}
