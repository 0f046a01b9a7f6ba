//! Project: an open scene, its stages, their jobs, and their results.

mod by_click;
mod cameras;
pub mod canvas;
mod composition;
mod copy;
mod follow;
mod open;
pub mod pinned;
mod settled;
pub mod stages;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};

use anyhow::{Result, bail};
use glam::{Affine3A, DVec3, Vec3};
use transplat_core::bake::insertion::InsertionBake;
use transplat_core::camera::CameraPose;
use transplat_core::derived::Derived;
use transplat_core::files::{CameraFile, is_same_file};
use transplat_core::ground::Ground;
use transplat_core::scene::{EnvironmentLight, Object, Scene, Transform, is_estimate, is_sky};
use transplat_core::surfels::{Bounds, SurfelCloud, UpAxis};
use transplat_core::transfer::scene::harmonic::HarmonicScene;
use transplat_gpu::live::Live;

use super::adapter::StageDevice;
use super::capture::Capture;
use super::device::Device;
use super::environments::{Environment, Environments, Resolved};
use super::jobs::{Handle, Jobs, Kind, Wake, Watch};
use super::object::{
    Followed, GroundKey, GroundLitKey, InsertedKey, InsertionKey, InterObjectStage, JointKey,
    ObjectState,
};
use super::splat::Splat;
use crate::language::{tr, tr_format};
use crate::words::of_error;
use canvas::Canvas;

/// The two sides' numbers.
pub const SOURCE: usize = 0;

/// Index of the target side. See [`SOURCE`].
pub const TARGET: usize = 1;

/// A change that a job makes to the project.
pub type Change = Box<dyn FnOnce(&mut Project) + Send>;

/// A message to the client of a project, or a change that it follows.
#[derive(Clone, Debug)]
pub enum Notice {
    /// A message.
    Info(String),
    /// A message about the object of this number that offers a remedy.
    Offer(String, usize, Remedy),
    /// An error: what failed, why, and what to do.
    Error(String),
    /// A file was opened and is good.
    Opened(PathBuf),
    /// A file that was to be a light is none.
    NoLight(PathBuf),
    /// A photograph of this size is shown behind the objects.
    PictureSize([usize; 2]),
    /// The object of this number was added and is shown.
    Added(usize),
    /// The object of this number was removed.
    Removed(usize),
}

/// Action that a message about an object offers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Remedy {
    /// Hides the surroundings of the object.
    Crop,
    /// Leaves the new light as strong as it is.
    KeepStrength,
    /// Gives the object the scale of its file.
    ResetScale,
    /// Lets the object be moved and removed.
    Unlock,
    /// Estimates the capture light of the object again.
    Estimate,
    /// Rotates the capture light of the object to where it explains the shading.
    Align,
    /// Moves the residue under an object that is cut out to the rest of its capture.
    RemoveResidue,
}

impl Remedy {
    /// Label of the button.
    pub fn name(self) -> &'static str {
        match self {
            Self::Crop => tr("Crop to the object"),
            Self::KeepStrength => tr("Turn off"),
            Self::ResetScale => tr("Keep its scale"),
            Self::Unlock => tr("Unlock"),
            Self::Estimate => tr("Estimate again"),
            Self::Align => tr("Rotate it"),
            Self::RemoveResidue => tr("Remove residue"),
        }
    }
}

/// Results that are made only where the client wants them.
#[derive(Clone, Copy, Debug, Default)]
pub struct Requested {
    /// Visibility, of each object and between them.
    pub bakes: bool,
    /// Capture lights and the target light.
    pub lights: bool,
    /// Comparison of user-set capture lights with the objects.
    pub alignment: bool,
    /// Transfers, which need both.
    pub transfers: bool,
    /// The ground that catches shadows, if the scene has one.
    pub ground: bool,
    /// Bakes serve terms that are off now, too.
    pub all_terms: bool,
    /// Low-confidence surfels are marked.
    pub confidence: bool,
    /// A surfel is inspected, and nothing is being dragged.
    pub readout: bool,
}

/// Counts of runs of the stages before the GPU's own, beside [`transplat_gpu::live::Passes`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StageCounts {
    /// Splats that were loaded.
    pub load: usize,
    /// Environments that were projected onto SH.
    pub project_environment: usize,
    /// Bakes, previews among them.
    pub bake: usize,
    /// Transfers that were prepared.
    pub prepare: usize,
    /// Grounds that were baked.
    pub ground: usize,
}

/// All that a map behind the objects depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct BackdropKey {
    /// Number of the environment.
    pub light: u64,
    /// One of a sky is shown until the next is there: the sun moves slowly.
    pub is_sky: bool,
    /// True where its suns are extracted.
    pub without_suns: bool,
    /// Blur, in degrees.
    pub blur: f32,
}

/// Settings that others are compared with, and what the objects were lit by.
#[derive(Clone)]
pub struct Pinned {
    /// Settings when they were pinned.
    pub scene: Scene,
    /// Capture light of each object.
    pub sources: Vec<Arc<Environment>>,
    /// Target light.
    pub environment: Arc<Environment>,
    /// True where it takes the place of the capture.
    pub is_compared: bool,
}

/// All that is shown, to be put together beside the interface.
pub struct Whole {
    each: Vec<(Arc<SurfelCloud>, Affine3A)>,
    /// Up axis and origin of the first object, in whose coordinates they stand.
    up: UpAxis,
    origin: DVec3,
}

impl Whole {
    /// As one splat; none where nothing is shown.
    pub fn cloud(&self) -> Option<Arc<SurfelCloud>> {
        let whole = SurfelCloud::whole(&self.each)?;
        let is_upright = whole.up == self.up && whole.origin == self.origin;
        let turned = || SurfelCloud {
            up: self.up,
            origin: self.origin,
            ..(*whole).clone()
        };
        Some(if is_upright {
            whole
        } else {
            Arc::new(turned())
        })
    }
}

/// Cameras of a file that is open.
pub struct OpenCameras {
    /// The file.
    pub path: PathBuf,
    /// Its cameras.
    pub file: CameraFile,
    /// The one that was chosen last.
    pub at: usize,
    /// The photograph that was shown with it, if that was found.
    pub photograph: Option<PathBuf>,
    /// True for one found beside the first object's splat, which nobody opened.
    pub is_found: bool,
}

/// A scene as it is open, and all that is made of it.
pub struct Project {
    /// Where it is shown; none where nobody looks on.
    pub canvas: Option<Canvas>,
    /// Where stages compute.
    pub device: StageDevice,
    /// Work off the client's thread.
    pub jobs: Jobs<Change>,
    /// The settings.
    pub scene: Scene,
    /// Pose of the camera.
    pub pose: CameraPose,
    /// True where the lights' strengths are matched because nobody set the source's.
    pub matches_by_itself: bool,
    /// Where a scene that is still being opened was last looked at from, by itself.
    pub framed: Option<CameraPose>,
    /// State of each of the scene's objects.
    pub states: Vec<ObjectState>,
    /// Captures that objects are cut out of.
    pub captures: Vec<Weak<Capture>>,
    /// Camera and objects that lights are fixed to, as they were last seen.
    pub followed: Option<Followed>,
    /// Environments that were read or are to be.
    pub environments: Environments,
    /// Target light of the scene.
    pub environment: Resolved,
    /// Inter-object visibility.
    pub surroundings: InterObjectStage,
    /// True while the trace of [`Project::surroundings`] that runs is the fine one.
    pub is_tracing_finely: bool,
    /// The objects as preset paper puts them into a scene.
    pub insertion: Derived<InsertionKey, Arc<InsertionBake>>,
    /// Joint transfer of preset paper.
    pub inserted: Derived<InsertedKey, Arc<HarmonicScene>>,
    /// Joint relight that is shown.
    pub joint_relight: Derived<JointKey, ()>,
    /// True where bakes are saved beside their splats, not in the user's cache.
    pub bakes_are_beside: bool,
    /// Milliseconds from which on a relight is shown coarsely first.
    pub coarse_from_ms: f64,
    /// The objects that are shown as they were relit together, by their states.
    pub together: Vec<u64>,
    /// The ground that catches the objects' shadow.
    pub ground: Derived<GroundKey, Ground>,
    /// Shadow on the ground under the lights that are set.
    pub ground_lit: Derived<GroundLitKey, ()>,
    /// Maps behind both sides.
    pub backdrops: [Derived<BackdropKey, ()>; 2],
    /// The photograph behind the objects by its file, and its size.
    pub plate: Derived<PathBuf, [usize; 2]>,
    /// Tables of colours: that of the pinned look, and the scene's.
    pub luts: [Derived<PathBuf, ()>; 2],
    /// Cameras of a file that was opened.
    pub cameras: Option<OpenCameras>,
    /// Look that others are compared with.
    pub pinned: Option<Pinned>,
    /// Scene to be shown again once another one is pinned to be compared with, and that one.
    pub comparing: Option<[Scene; 2]>,
    /// Pixels of the viewport as it was last shown.
    pub viewport: [usize; 2],
    /// Counts of stages so far.
    pub stages: StageCounts,
    /// Results that the client shows now.
    pub requested: Requested,
    /// Notices since the client last took them.
    pub notices: Vec<Notice>,
}

impl Project {
    /// A scene that is shown in a window, of which nothing is made yet.
    pub fn on_canvas(canvas: Canvas, wake: Wake, scene: Scene) -> Self {
        let device = StageDevice::beside(&canvas.context);
        Self {
            canvas: Some(canvas),
            requested: Requested {
                bakes: true,
                alignment: true,
                lights: true,
                transfers: true,
                ground: true,
                all_terms: true,
                ..Requested::default()
            },
            ..Self::new(device, Jobs::new(wake), scene)
        }
    }

    /// A scene without a window, of which nothing is made yet. Jobs run where they are started, followed by `watch`.
    pub fn headless(device: Device, watch: Watch, scene: Scene) -> Self {
        Self::new(StageDevice::Chosen(device), Jobs::at_once(watch), scene)
    }

    /// Has a headless project's jobs followed by `watch`.
    pub fn set_watch(&mut self, watch: Watch) {
        self.jobs = Jobs::at_once(watch);
    }

    fn new(device: StageDevice, jobs: Jobs<Change>, scene: Scene) -> Self {
        Self {
            canvas: None,
            device,
            jobs,
            states: scene
                .objects
                .iter()
                .map(|_| ObjectState::new(None))
                .collect(),
            scene,
            captures: Vec::new(),
            pose: CameraPose {
                pivot: Vec3::ZERO,
                azimuth: 0.0,
                elevation: 20.0,
                distance: 3.0,
                fov: 35.0,
                orthographic: false,
                roll: 0.0,
                aperture: 0.0,
            },
            matches_by_itself: false,
            framed: None,
            followed: None,
            environments: Environments::default(),
            environment: Resolved::default(),
            surroundings: InterObjectStage::default(),
            is_tracing_finely: false,
            insertion: Derived::default(),
            inserted: Derived::default(),
            joint_relight: Derived::default(),
            bakes_are_beside: false,
            coarse_from_ms: 250.0,
            together: Vec::new(),
            ground: Derived::default(),
            ground_lit: Derived::default(),
            backdrops: Default::default(),
            plate: Derived::default(),
            luts: Default::default(),
            cameras: None,
            pinned: None,
            comparing: None,
            viewport: [960, 600],
            stages: StageCounts::default(),
            requested: Requested::default(),
            notices: Vec::new(),
        }
    }

    /// Leaves a message to the client.
    pub fn info(&mut self, text: impl Into<String>) {
        self.notices.push(Notice::Info(text.into()));
    }

    /// Leaves a message about an object to the client that offers a remedy.
    pub fn offer(&mut self, text: impl Into<String>, at: usize, remedy: Remedy) {
        self.notices.push(Notice::Offer(text.into(), at, remedy));
    }

    /// Does what a message about an object offered.
    pub fn apply_remedy(&mut self, at: usize, remedy: Remedy) {
        match remedy {
            Remedy::Crop => self.crop_to_object(at),
            Remedy::KeepStrength => {
                self.scene.match_strength = false;
                self.matches_by_itself = false;
            }
            Remedy::ResetScale => self.scale_about_middle(at, 1.0),
            Remedy::Unlock => self.scene.objects[at].locked = false,
            Remedy::Estimate => self.estimate_again(at),
            Remedy::RemoveResidue => self.remove_residue(at, true),
            Remedy::Align => {
                self.align_source(at);
            }
        }
    }

    /// Hides what lies around an object in its capture, where that was found.
    pub fn crop_to_object(&mut self, at: usize) {
        let proposed = self.states[at].asset.as_ref().and_then(|a| a.proposed_crop);
        if let Some([low, high]) = proposed {
            let hide = &mut self.scene.objects[at].hide;
            (hide.crop, hide.crop_min, hide.crop_max) = (true, low, high);
            self.frame_all();
        }
    }

    /// Leaves an error to the client.
    pub fn error(&mut self, text: impl Into<String>) {
        self.notices.push(Notice::Error(text.into()));
    }

    /// The scene's, in whose coordinates camera and lights are: the first object's.
    pub fn scene_up(&self) -> UpAxis {
        self.up_of(0)
    }

    /// True where any splat is open.
    pub fn has_asset(&self) -> bool {
        self.states.iter().any(|s| s.asset.is_some())
    }

    /// True for objects that are worked on: in a window each is, since it may be shown next.
    fn is_used(&self, at: usize) -> bool {
        self.canvas.is_some() || self.scene.objects[at].shown
    }

    /// The objects that are there and shown: their numbers, settings and splats.
    pub fn shown(&self) -> impl Iterator<Item = (usize, &Object, &Splat)> + Clone {
        let each = self.scene.objects.iter().zip(&self.states).enumerate();
        let shown = each.filter(|(_, (object, _))| object.shown);
        shown.filter_map(|(at, (object, state))| Some((at, object, state.asset.as_ref()?)))
    }

    /// All that is shown as one splat, in the scene's coordinates; none where nothing is.
    pub fn whole(&self) -> Whole {
        let each = self.shown();
        let each = each.map(|(_, o, a)| (a.cloud.clone(), o.transform.scene_from_object()));
        Whole {
            each: each.collect(),
            up: self.scene_up(),
            origin: self.scene.objects[0].origin,
        }
    }

    /// Places of all surfels that are seen, and a sphere around them; none where there are none.
    pub fn visible_points(&self) -> Option<(Vec<Vec3>, Bounds)> {
        let (mut points, mut spheres) = (Vec::new(), Vec::new());
        for (_, object, asset) in self.shown() {
            let place = object.transform.scene_from_object();
            let there = |p: &Vec3| place.transform_point3(*p);
            if object.hide.is_off() {
                points.extend(asset.cloud.positions.iter().map(there));
                spheres.push(asset.bounds.transformed(place));
                continue;
            }
            let hidden = object.hide.hidden(&asset.cloud, &asset.bounds);
            let visible: Vec<usize> = (0..hidden.len()).filter(|i| !hidden[*i]).collect();
            if !visible.is_empty() {
                points.extend(visible.iter().map(|i| there(&asset.cloud.positions[*i])));
                let bounds = asset.cloud.selected(&visible).bounds();
                spheres.push(bounds.transformed(place));
            }
        }
        let bounds = match &spheres[..] {
            [one] => *one,
            _ => Bounds::around(spheres.into_iter())?,
        };
        Some((points, bounds))
    }

    /// Where the objects that are shown are.
    pub fn scene_bounds(&self) -> Option<Bounds> {
        let bounds = self.shown().map(|(_, object, asset)| {
            if object.transform == Transform::default() {
                asset.bounds
            } else {
                let place = object.transform.scene_from_object();
                asset.bounds.transformed(place)
            }
        });
        let mut few = bounds.clone();
        match (few.next(), few.next()) {
            (one, None) => one,
            _ => Bounds::around(bounds),
        }
    }

    /// Up axis of an object.
    pub fn up_of(&self, at: usize) -> UpAxis {
        let file = self.states[at].asset.as_ref().map(|a| a.file_up);
        self.scene.objects[at].up.or(file).unwrap_or_default()
    }

    /// Source and target light of an object: the settings, and the environment in use.
    pub fn sides_of(&self, at: usize) -> [(&EnvironmentLight, &Resolved); 2] {
        [
            (&self.scene.objects[at].source, &self.states[at].source),
            (&self.scene.environment, &self.environment),
        ]
    }

    /// Source and target light of the object that *Match exposure* matches.
    pub fn matched_sides(&self) -> [(&EnvironmentLight, &Resolved); 2] {
        self.sides_of(self.scene.matched_object())
    }

    /// Light of a file, or the estimate of the object's light, which is assumed until there is one.
    pub fn light_of(&self, at: usize, file: &Path) -> Option<Arc<Environment>> {
        if is_estimate(file) {
            let estimated = self.states[at].estimated.get().cloned();
            return Some(estimated.unwrap_or_else(Environment::assumed));
        }
        if is_sky(file) {
            return self.environments.sky().cloned();
        }
        self.environments.get(file).cloned()
    }

    /// Unit normal of a surfel of one of the objects, in the scene: none before it is baked.
    pub fn scene_normal(&self, object: usize, surfel: usize) -> Option<Vec3> {
        let normal = self.baked_of(object)?.bake.normals().get(surfel)?;
        Some(self.scene.objects[object].transform.rotation * *normal)
    }

    /// Takes in what jobs yielded, and starts what is to be done now.
    pub fn update(&mut self) {
        self.take_changes();
        if self.states.len() != self.scene.objects.len() {
            self.match_states(&self.scene.objects.clone());
        }
        let objects = 0..self.scene.objects.len();
        self.follow();
        self.load_missing();
        for at in objects.clone() {
            self.update_asset(at);
            self.start_bake(at);
            self.update_estimate(at);
            self.update_completion(at);
        }
        self.resolve_lights();
        self.start_lights();
        for at in objects {
            self.orient_lights(at);
            self.start_prepare(at);
            self.update_alignment(at);
        }
        self.start_inter_object();
        self.start_insertion();
        self.start_inserted();
        self.start_ground();
        if let Some(canvas) = self.canvas.clone() {
            self.show(&canvas);
        }
    }

    /// Shows on a canvas what there is.
    fn show(&mut self, canvas: &Canvas) {
        for at in 0..self.scene.objects.len() {
            self.update_hidden(at);
        }
        self.relight_jointly(canvas);
        self.light_ground();
        for at in 0..self.scene.objects.len() {
            if !self.together.contains(&self.states[at].id) {
                self.relight(at, canvas);
            }
            self.update_channel(at);
            self.start_confidence(at);
        }
        self.start_backdrops(canvas);
        self.start_backplate(canvas);
        self.start_luts(canvas);
        self.pin_compared();
        if let Some(error) = canvas.context.take_error() {
            self.error(error.to_string());
        }
    }

    /// Changes what is drawn, where anything is.
    fn draw(&self, change: impl FnOnce(&mut Live)) {
        if let Some(canvas) = &self.canvas {
            change(&mut canvas.live());
        }
    }

    /// Makes all that is requested, where jobs are done at once.
    ///
    /// # Errors
    /// What could not be made; nothing is begun after it.
    pub fn settle(&mut self) -> Result<()> {
        loop {
            let done = self.jobs.count();
            self.update();
            for notice in std::mem::take(&mut self.notices) {
                if let Notice::Error(why) = notice {
                    bail!(why);
                }
            }
            if self.jobs.count() == done {
                return Ok(());
            }
        }
    }

    /// Starts a job, gives its result to `take`, and reports its error.
    pub fn start<T: Send + 'static>(
        &mut self,
        kind: Kind,
        label: impl Into<String>,
        work: impl FnOnce(&Handle<Change>) -> Result<T> + Send + 'static,
        take: impl FnOnce(&mut Self, T) + Send + 'static,
    ) {
        self.start_or_else(kind, label, work, |project, result| match result {
            Ok(made) => take(project, made),
            Err(error) => project.error(of_error(&error)),
        });
    }

    /// Starts a job and gives its result or its error to `take`.
    pub fn start_or_else<T: Send + 'static>(
        &mut self,
        kind: Kind,
        label: impl Into<String>,
        work: impl FnOnce(&Handle<Change>) -> Result<T> + Send + 'static,
        take: impl FnOnce(&mut Self, Result<T>) + Send + 'static,
    ) {
        let has_failed = || self.notices.iter().any(|n| matches!(n, Notice::Error(_)));
        if self.canvas.is_none() && has_failed() {
            return;
        }
        let finish = |result| -> Change { Box::new(|project: &mut Self| take(project, result)) };
        self.jobs.start(kind, label, work, finish);
        if self.canvas.is_none() {
            self.take_changes();
        }
    }

    /// Takes in what jobs yielded.
    fn take_changes(&mut self) {
        for change in self.jobs.events() {
            change(self);
        }
    }

    /// The object whose state has a number, unless another splat has taken its place.
    pub fn at(&self, id: u64) -> Option<usize> {
        self.states.iter().position(|s| s.id == id)
    }

    /// The scene as it is saved: with asset and camera.
    pub fn scene_to_save(&self) -> Scene {
        let mut scene = self.scene.clone();
        // What is still being read may turn out not to be a light.
        for (object, state) in scene.objects.iter_mut().zip(&self.states) {
            // What could not be opened here may be elsewhere.
            if let Some(asset) = &state.asset {
                object.asset = Some(asset.path.clone());
                let light = &state.source.light;
                object.source.file = Some(light.path.clone());
                object.source.set_reading(&light.reading);
            }
        }
        let light = &self.environment.light;
        if scene.environment.file.as_ref() != Some(&light.path) {
            // The rest is said of what is still being read.
            let of_last = &self.environment.settings;
            scene.environment.sky = of_last.sky;
            scene.environment.without_suns = of_last.without_suns;
        }
        scene.environment.file = Some(light.path.clone());
        scene.environment.set_reading(&light.reading);
        scene.camera = Some(self.pose);
        scene
    }

    /// Checks that a file may be written over, given others that are open beside the project's.
    ///
    /// # Errors
    /// It is there, and open.
    pub fn check_not_open(&self, path: &Path, others: &[PathBuf]) -> Result<()> {
        let files = self.open_files();
        let is_open = files.iter().chain(others).any(|p| is_same_file(p, path));
        if path.exists() && is_open {
            bail!(tr_format!(
                "{}: this file is open in the scene. Choose another name.",
                path.display()
            ));
        }
        Ok(())
    }

    /// Splats, bakes and lights that are open.
    pub fn open_files(&self) -> Vec<PathBuf> {
        let mut files = vec![self.environment.light.path.clone()];
        for state in &self.states {
            files.push(state.source.light.path.clone());
            files.extend(state.asset.as_ref().map(|a| a.path.clone()));
            let bakes = state.bakes.values().filter_map(Derived::get);
            files.extend(bakes.filter_map(|b| b.file.clone()));
        }
        files.extend(self.scene.plate.clone());
        files.extend(self.scene.lut.clone());
        files
    }
}
