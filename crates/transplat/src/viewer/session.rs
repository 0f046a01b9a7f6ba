//! What is open, as what it is lit, and what follows from that: the pipeline's stages, each run when what it reads has changed.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};
use std::time::Instant;

use eframe::egui;
use transplat_core::camera::Camera;
use transplat_core::environment::IncidentRadiance;
use transplat_core::ground::{GROUND_REACH, Ground, ground_plane};
use transplat_core::load::{AssetFile, FileKind, file_kind, load_asset, load_look};
use transplat_core::look::{CameraPose, EVEN, LightSettings, Look, is_even};
use transplat_core::present::{self, Background, Doubt, View};
use transplat_core::surfels::{Bounds, Hide, SurfelCloud, UpAxis};
use transplat_core::transfer::{PreparedTransfer, TransferAsset, TransferSettings};
use transplat_core::visibility::{BakeSettings, Visibility};
use transplat_gpu::Context;
use transplat_gpu::live::{Frame, Live, LiveAsset, LiveTransfer, Passes};
use transplat_gpu::present::{Backdrop, BackdropLight, GroundPlane, Presentation};

use super::baking::{self, Baked};
use super::jobs::{Jobs, Kind};
use super::lights::{Light, light_name, load_map};
use super::navigation;
use crate::device::Device;
use crate::picture::half;
use crate::scene::asset_warnings;

/// How much of a mark covers a surfel's colour.
const MARK_WEIGHT: f32 = 0.75;

/// Directions of the stand-in for a bake that has not begun to arrive.
const OPEN_DIRECTIONS: usize = 16;

/// An asset as it is open.
pub struct Asset {
    pub path: PathBuf,
    pub cloud: Arc<SurfelCloud>,
    pub file: Arc<AssetFile>,
    pub bounds: Bounds,
    pub warnings: Vec<String>,
    pub load_ms: f64,
    /// Up axis as the file says it.
    pub file_up: UpAxis,
    /// Up axis that the ground is made for.
    up: UpAxis,
    ground: (glam::Vec3, [glam::Vec3; 2]),
}

impl Asset {
    /// For the user.
    pub fn name(&self) -> String {
        self.path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    }
}

/// How the two sides of the light are called.
pub const SIDES: [&str; 2] = ["captured under", "relit by"];

/// The two sides' numbers.
pub const SOURCE: usize = 0;
/// See [`SOURCE`].
pub const TARGET: usize = 1;

/// Shares of surfels whose relit colour is doubtful, `[Doubt::ALL]`.
pub type Shares = [f32; Doubt::ALL.len()];

/// What jobs yield.
pub enum Event {
    Asset(Box<LoadedAsset>),
    Baked {
        asset: u64,
        baked: Box<Baked>,
    },
    Light(Box<Light>),
    LightFailed {
        path: PathBuf,
        why: String,
    },
    Prepared(Box<Prepared>),
    Backdrop {
        side: usize,
        key: BackdropKey,
        backdrop: Backdrop,
    },
    Ground {
        asset: u64,
        directions: usize,
        ground: Box<Ground>,
    },
    Doubts {
        key: (u64, u64),
        doubts: Vec<Option<Doubt>>,
    },
    /// Files that were chosen to be opened.
    Files(Vec<PathBuf>),
    /// A picture for the clipboard: width, height, straight RGBA bytes.
    Clipboard([usize; 2], Vec<u8>),
    SaveTo(PathBuf, SaveKind),
    Done(String),
    Failed(String),
}

/// What a path that was chosen in a dialog is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SaveKind {
    Look,
    Splat,
    Screenshot,
    Folder,
}

/// A loaded asset on its way to the screen.
pub struct LoadedAsset {
    asset: Asset,
    live: LiveAsset,
    transfer: TransferAsset,
    settings: Settings,
}

/// What a splat is opened with.
#[derive(Clone, Debug)]
pub enum Settings {
    /// What is told of its capture; everything else stays as it is when the splat is there.
    Capture {
        /// Its light; even where nobody knows it.
        source: LightSettings,
        /// Its up axis, where the file is not to be believed.
        up: Option<UpAxis>,
        /// Whether its colour is linear.
        linear: bool,
        /// What of it is hidden.
        hide: Hide,
        /// Where it is looked at from; all of it otherwise.
        camera: Option<CameraPose>,
    },
    /// All settings.
    Look(Box<Look>),
}

impl Default for Settings {
    fn default() -> Self {
        Self::Capture {
            source: LightSettings {
                file: Some(EVEN.into()),
                ..LightSettings::default()
            },
            up: None,
            linear: false,
            hide: Hide::default(),
            camera: None,
        }
    }
}

impl Settings {
    fn is_linear(&self) -> bool {
        match self {
            Self::Capture { linear, .. } => *linear,
            Self::Look(look) => look.linear,
        }
    }

    /// The look that the splat is shown with, given that of now.
    fn over(self, now: &Look) -> Look {
        match self {
            Self::Capture {
                source,
                up,
                linear,
                hide,
                camera,
            } => Look {
                source,
                up,
                linear,
                hide,
                camera,
                ..now.clone()
            },
            Self::Look(look) => *look,
        }
    }
}

/// A prepared transfer on its way to the screen.
pub struct Prepared {
    key: PrepareKey,
    prepared: PreparedTransfer,
    live: LiveTransfer,
    ms: f64,
}

/// All that a preparation depends on.
#[derive(Clone, PartialEq)]
struct PrepareKey {
    asset: u64,
    bake: u64,
    source: IncidentRadiance,
    settings: TransferSettings,
}

/// All that a map behind the object depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct BackdropKey(PathBuf, f32);

/// A message to the user.
#[derive(Clone, Debug)]
pub struct Message {
    pub text: String,
    pub is_error: bool,
    pub since: Instant,
}

/// How often the stages before the GPU's own ran, beside [`Passes`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stages {
    pub load: usize,
    pub project_environment: usize,
    pub bake: usize,
    pub prepare: usize,
    pub ground: usize,
}

/// How long the stages last took, in milliseconds.
#[derive(Clone, Copy, Debug, Default)]
pub struct Times {
    pub bake: f64,
    pub prepare: f64,
}

/// A device of the jobs' own, opened when the first of them needs it: a window cannot be resized while another thread submits to its queue.
#[derive(Clone)]
pub struct BackgroundDevice {
    window: Arc<Context>,
    own: Arc<OnceLock<Option<Arc<Context>>>>,
}

impl BackgroundDevice {
    fn new(window: &Arc<Context>) -> Self {
        Self {
            window: window.clone(),
            own: Arc::default(),
        }
    }

    /// The adapter, software or not; none where it gives no second device.
    pub fn gpu(&self) -> Option<Arc<Context>> {
        let open = || self.window.sibling().ok().map(Arc::new);
        self.own.get_or_init(open).clone()
    }

    /// Where long work is the faster: the adapter if it is a real one, else the CPU.
    pub fn fastest(&self) -> Device {
        if self.window.is_software() {
            return Device::Cpu;
        }
        self.gpu().map_or(Device::Cpu, Device::Gpu)
    }
}

/// Measures how long submitted work takes on the adapter: a thread waits for it, and meanwhile no other is measured.
#[derive(Default)]
pub struct GpuTimer {
    micros: Arc<AtomicU64>,
    waiting: Arc<AtomicBool>,
}

impl GpuTimer {
    /// The last that is finished, from its first command to its end on the adapter.
    pub fn ms(&self) -> f64 {
        self.micros.load(Ordering::Relaxed) as f64 / 1e3
    }

    /// Measures what began at `start` and has just been submitted.
    pub fn measure(&self, context: &Arc<Context>, start: Instant, egui: &egui::Context) {
        if self.waiting.swap(true, Ordering::Relaxed) {
            return;
        }
        let (micros, waiting) = (self.micros.clone(), self.waiting.clone());
        let (context, egui) = (context.clone(), egui.clone());
        let submission = context.last_submission();
        std::thread::spawn(move || {
            context.finish(&submission);
            micros.store(start.elapsed().as_micros() as u64, Ordering::Relaxed);
            waiting.store(false, Ordering::Relaxed);
            egui.request_repaint();
        });
    }
}

/// Everything that is open, and the settings.
pub struct Session {
    pub frame_timer: GpuTimer,
    pub transfer_timer: GpuTimer,
    /// A saved bake that the command line names.
    pub bake: Option<PathBuf>,
    pub context: Arc<Context>,
    /// Where jobs compute.
    pub background: BackgroundDevice,
    pub live: Arc<Mutex<Live>>,
    pub jobs: Jobs<Event>,
    pub asset: Option<Asset>,
    pub look: Look,
    pub pose: CameraPose,
    /// Settings that are compared with.
    pub pinned: Option<Look>,
    pub against_pinned: bool,
    pub lights: HashMap<PathBuf, Arc<Light>>,
    /// What the sides are lit by: what was asked for last, and could be loaded.
    pub sides: [Arc<Light>; 2],
    pub visibility: Option<Arc<Visibility>>,
    pub bake_share: f32,
    pub bake_file: Option<PathBuf>,
    pub prepared: Option<Arc<PreparedTransfer>>,
    pub messages: Vec<Message>,
    pub shares: Option<Shares>,
    pub doubts: Arc<Vec<Option<Doubt>>>,
    pub times: Times,
    pub show_marks: bool,
    pub grid: bool,
    pub stages: Stages,
    /// How many stops the target's mean irradiance is over the source's, as they are shown.
    pub stops_over_source: Option<f32>,
    /// Pixels of the viewport as it was last shown.
    pub viewport: [usize; 2],
    pub hidden: Arc<Vec<bool>>,
    hidden_version: u64,
    hidden_for: Option<(u64, Hide)>,
    transfer_asset: Option<Arc<Mutex<TransferAsset>>>,
    asset_id: u64,
    bake_version: u64,
    baked_for: Option<(u64, usize)>,
    requested: Option<PrepareKey>,
    relit_for: Option<(u64, IncidentRadiance)>,
    relit_version: u64,
    prepared_version: u64,
    doubts_for: Option<(u64, u64)>,
    visibility_shown: Option<u64>,
    backdrop_for: [Option<BackdropKey>; 2],
    backdrop_asked: [Option<BackdropKey>; 2],
    ground: Option<Ground>,
    ground_for: Option<(u64, usize)>,
    ground_lit_for: Option<(u64, usize, IncidentRadiance)>,
    /// Files that are being read as lights.
    loading: Vec<PathBuf>,
}

impl Session {
    /// An empty session on a window's device.
    pub fn new(
        context: Arc<Context>,
        window: eframe::wgpu::TextureFormat,
        egui: &egui::Context,
        look: Look,
    ) -> Self {
        let even = Arc::new(Light::even());
        Self {
            frame_timer: GpuTimer::default(),
            transfer_timer: GpuTimer::default(),
            bake: None,
            live: Arc::new(Mutex::new(Live::new(&context, window))),
            background: BackgroundDevice::new(&context),
            context,
            jobs: Jobs::new(egui),
            asset: None,
            look,
            pose: CameraPose {
                pivot: glam::Vec3::ZERO,
                azimuth: 0.0,
                elevation: 20.0,
                distance: 3.0,
                fov: 35.0,
                orthographic: false,
            },
            pinned: None,
            against_pinned: false,
            lights: HashMap::from([(even.path.clone(), even.clone())]),
            sides: [even.clone(), even],
            visibility: None,
            bake_share: 0.0,
            bake_file: None,
            prepared: None,
            messages: Vec::new(),
            shares: None,
            doubts: Arc::default(),
            times: Times::default(),
            show_marks: false,
            grid: true,
            stages: Stages::default(),
            stops_over_source: None,
            viewport: [960, 600],
            hidden: Arc::default(),
            hidden_version: 0,
            hidden_for: None,
            transfer_asset: None,
            asset_id: 0,
            bake_version: 0,
            baked_for: None,
            requested: None,
            relit_for: None,
            relit_version: 0,
            prepared_version: 0,
            doubts_for: None,
            visibility_shown: None,
            backdrop_for: [None, None],
            backdrop_asked: [None, None],
            ground: None,
            ground_for: None,
            ground_lit_for: None,
            loading: Vec::new(),
        }
    }

    pub fn live(&self) -> MutexGuard<'_, Live> {
        // A poisoned lock guards pictures, nothing that could be half-written.
        self.live
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    pub fn passes(&self) -> Passes {
        self.live().passes()
    }

    pub fn info(&mut self, text: impl Into<String>) {
        self.tell(text.into(), false);
    }

    pub fn error(&mut self, text: impl Into<String>) {
        self.tell(text.into(), true);
    }

    fn tell(&mut self, text: String, is_error: bool) {
        self.messages.retain(|m| m.text != text);
        self.messages.push(Message {
            text,
            is_error,
            since: Instant::now(),
        });
    }

    /// The asset's up axis as it is set.
    pub fn up(&self) -> UpAxis {
        let file = self.asset.as_ref().map(|a| a.file_up);
        self.look.up.or(file).unwrap_or_default()
    }

    // ---- opening ----

    /// Opens any file, by what is in it: a splat replaces the asset, an environment becomes the target, a look is applied.
    pub fn open(&mut self, path: &Path) {
        match file_kind(path) {
            Ok(FileKind::Ply) => {
                self.load_asset(path.to_owned(), Settings::default());
            }
            Ok(FileKind::Look) => match load_look(path) {
                Ok(look) => self.apply_look(look),
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

    /// Applies a look: at once, or once its asset is loaded.
    pub fn apply_look(&mut self, look: Look) {
        let open = self.asset.as_ref().map(|a| &a.path);
        match &look.asset {
            Some(path) if open != Some(path) || look.linear != self.look.linear => {
                self.load_asset(path.clone(), Settings::Look(Box::new(look)));
            }
            _ => {
                if let Some(camera) = look.camera {
                    self.pose = camera;
                }
                self.look = Look {
                    camera: None,
                    ..look
                };
            }
        }
    }

    /// Loads a splat; on success it is shown with the settings, otherwise everything stays.
    pub fn load_asset(&mut self, path: PathBuf, settings: Settings) {
        self.jobs.cancel(Kind::Load);
        let context = self.context.clone();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let failed = |why: String| Event::Failed(why);
        let work = move |handle: &super::jobs::Handle<Event>| {
            let start = Instant::now();
            let loaded =
                load_asset(&path)
                    .map_err(anyhow::Error::from)
                    .and_then(|(mut cloud, file)| {
                        let file_up = cloud.up;
                        if settings.is_linear() {
                            cloud.encoding = transplat_core::color::Encoding::StoredLinear;
                        }
                        let cloud = Arc::new(cloud);
                        let live = LiveAsset::new(&context, &cloud)?;
                        let transfer = TransferAsset::new(&cloud);
                        Ok(LoadedAsset {
                            asset: Asset {
                                bounds: cloud.bounds(),
                                ground: ground_plane(&cloud, cloud.up),
                                up: cloud.up,
                                warnings: asset_warnings(&path, &file),
                                load_ms: start.elapsed().as_secs_f64() * 1e3,
                                file_up,
                                file: Arc::new(file),
                                cloud,
                                path,
                            },
                            live,
                            transfer,
                            settings,
                        })
                    });
            if handle.is_cancelled() {
                return None;
            }
            Some(match loaded {
                Ok(loaded) => Event::Asset(Box::new(loaded)),
                Err(error) => Event::Failed(format!("{error:#}")),
            })
        };
        self.jobs
            .start(Kind::Load, format!("loading {name}"), work, failed);
    }

    /// Puts a light on a side; it is shown once it is loaded.
    pub fn set_light(&mut self, side: usize, path: PathBuf) {
        self.request_light(&path);
        let settings = if side == SOURCE {
            &mut self.look.source
        } else {
            &mut self.look.target
        };
        settings.file = Some(path);
    }

    /// Starts reading an environment unless it is there.
    pub fn request_light(&mut self, path: &Path) {
        if self.lights.contains_key(path) || self.loading.iter().any(|p| p == path) {
            return;
        }
        self.loading.push(path.to_owned());
        let (background, path) = (self.background.clone(), path.to_owned());
        let label = format!("reading {}", light_name(&path));
        let failed = {
            let path = path.clone();
            move |why: String| Event::LightFailed { path, why }
        };
        let work = move |_: &super::jobs::Handle<Event>| {
            Some(match Light::load(&background, &path) {
                Ok(light) => Event::Light(Box::new(light)),
                Err(error) => Event::LightFailed {
                    path,
                    why: format!("{error:#}"),
                },
            })
        };
        self.jobs.start(Kind::Light, label, work, failed);
    }

    /// Whether a light is being read.
    pub fn is_loading(&self, path: &Path) -> bool {
        self.loading.iter().any(|p| p == path)
    }

    /// Exchanges the two lights with their turns and strengths.
    pub fn swap_lights(&mut self) {
        std::mem::swap(&mut self.look.source, &mut self.look.target);
    }

    // ---- what follows from what ----

    /// Takes in what jobs yielded, and starts what is to be done now. Yields what the window has to deal with itself.
    pub fn update(&mut self) -> Vec<Event> {
        let mut left = Vec::new();
        for event in self.jobs.events() {
            left.extend(self.take(event));
        }
        self.resolve_lights();
        self.update_asset();
        self.start_bake();
        self.start_prepare();
        self.relight();
        self.update_hidden();
        self.update_ground();
        self.start_backdrops();
        self.update_channels();
        if let Some(error) = self.context.take_error() {
            self.error(error.to_string());
        }
        left
    }

    fn take(&mut self, event: Event) -> Option<Event> {
        match event {
            Event::Asset(loaded) => self.show_asset(*loaded),
            Event::Baked { asset, baked } if asset == self.asset_id => {
                self.bake_version += 1;
                self.bake_share = baked.share;
                self.times.bake = baked.ms;
                self.stages.bake += 1;
                if let Some(why) = baked.not_kept {
                    self.error(format!("the bake could not be kept: {why}"));
                }
                self.bake_file = baked.file;
                self.visibility = Some(Arc::new(baked.visibility));
            }
            Event::Light(light) => {
                self.loading.retain(|p| *p != light.path);
                self.stages.project_environment += 1;
                for warning in &light.warnings {
                    self.tell(warning.clone(), false);
                }
                self.lights.insert(light.path.clone(), Arc::new(*light));
            }
            Event::LightFailed { path, why } => {
                self.loading.retain(|p| *p != path);
                self.error(why);
                // What cannot be read changes nothing.
                for (side, settings) in [&mut self.look.source, &mut self.look.target]
                    .into_iter()
                    .enumerate()
                {
                    if settings.file.as_ref() == Some(&path) {
                        settings.file = Some(self.sides[side].path.clone());
                    }
                }
                return Some(Event::LightFailed {
                    path,
                    why: String::new(),
                });
            }
            Event::Prepared(prepared) if prepared.key.asset == self.asset_id => {
                self.stages.prepare += 1;
                self.times.prepare = prepared.ms;
                self.live().set_transfer(prepared.live);
                self.prepared = Some(Arc::new(prepared.prepared));
                self.prepared_version += 1;
            }
            Event::Backdrop {
                side,
                key,
                backdrop,
            } => {
                if self.backdrop_asked[side].as_ref() == Some(&key) {
                    self.live().set_backdrop(side, Some(backdrop));
                    self.backdrop_for[side] = Some(key);
                }
            }
            Event::Ground {
                asset,
                directions,
                ground,
            } if asset == self.asset_id => {
                self.stages.ground += 1;
                self.ground = Some(*ground);
                self.ground_for = Some((asset, directions));
            }
            Event::Doubts { key, doubts } if key.0 == self.asset_id => self.show_doubts(doubts),
            Event::Baked { .. }
            | Event::Prepared(_)
            | Event::Ground { .. }
            | Event::Doubts { .. } => {}
            Event::Done(text) => self.info(text),
            Event::Failed(text) => self.error(text),
            other => return Some(other),
        }
        None
    }

    fn show_asset(&mut self, loaded: LoadedAsset) {
        let LoadedAsset {
            asset,
            live,
            transfer,
            settings,
        } = loaded;
        let look = settings.over(&self.look);
        for kind in [Kind::Bake, Kind::Ground, Kind::Prepare, Kind::Doubts] {
            self.jobs.cancel(kind);
        }
        self.stages.load += 1;
        self.asset_id += 1;
        self.live().set_asset(live);
        self.visibility = Some(Arc::new(Visibility::all_open(
            &asset.cloud,
            OPEN_DIRECTIONS,
        )));
        self.bake_version += 1;
        self.bake_share = 0.0;
        self.bake_file = None;
        self.prepared = None;
        self.pinned = None;
        self.against_pinned = false;
        self.shares = None;
        self.doubts = Arc::default();
        self.ground = None;
        self.ground_for = None;
        self.ground_lit_for = None;
        self.relit_for = None;
        self.transfer_asset = Some(Arc::new(Mutex::new(transfer)));
        self.pose = look.camera.unwrap_or_else(|| {
            let size = self.viewport;
            navigation::first_pose(
                &asset.cloud,
                look.up.unwrap_or(asset.file_up),
                &asset.bounds,
                size,
            )
        });
        for warning in asset.warnings.clone() {
            self.info(warning);
        }
        self.look = Look {
            camera: None,
            asset: Some(asset.path.clone()),
            ..look
        };
        self.asset = Some(asset);
    }

    /// The ground lies under another side of the asset when that is turned.
    fn update_asset(&mut self) {
        let up = self.up();
        let Some(asset) = &mut self.asset else {
            return;
        };
        if asset.up != up {
            asset.up = up;
            asset.ground = ground_plane(&asset.cloud, up);
            self.ground = None;
            self.ground_for = None;
        }
    }

    /// The lights that the settings name, where they are loaded.
    fn resolve_lights(&mut self) {
        for side in [SOURCE, TARGET] {
            let settings = if side == SOURCE {
                &self.look.source
            } else {
                &self.look.target
            };
            let Some(file) = settings.file.clone() else {
                continue;
            };
            if self.sides[side].path == file {
                continue;
            }
            match self.lights.get(&file) {
                Some(light) => self.sides[side] = light.clone(),
                None => self.request_light(&file),
            }
        }
    }

    fn start_bake(&mut self) {
        let Some(asset) = &self.asset else {
            return;
        };
        let key = (self.asset_id, self.look.directions);
        if self.baked_for == Some(key) {
            return;
        }
        self.jobs.cancel(Kind::Bake);
        self.baked_for = Some(key);
        let (id, directions) = key;
        let (background, path, cloud) = (
            self.background.clone(),
            asset.path.clone(),
            asset.cloud.clone(),
        );
        let saved = self.bake.take();
        let label = format!("baking the visibility of {}", asset.name());
        let work = move |handle: &super::jobs::Handle<Event>| {
            let event = |baked: Baked| Event::Baked {
                asset: id,
                baked: Box::new(baked),
            };
            let report = |done: f64| handle.progress(done);
            let preview = |baked: Baked| handle.send(event(baked));
            match baking::bake(
                &background.fastest(),
                &path,
                &cloud,
                directions,
                saved.as_deref(),
                &report,
                preview,
            ) {
                Ok(baked) => Some(event(baked)),
                Err(_) if handle.is_cancelled() => None,
                Err(error) => Some(Event::Failed(format!("the bake failed: {error:#}"))),
            }
        };
        // The reporting closure is shared with the bake's own threads.
        self.jobs.start(Kind::Bake, label, work, Event::Failed);
    }

    /// Source and target as the asset sees them.
    pub fn oriented_lights(&self) -> [IncidentRadiance; 2] {
        let maps = [&self.sides[SOURCE].radiance, &self.sides[TARGET].radiance];
        self.look.lights(maps[0], maps[1], self.up())
    }

    fn start_prepare(&mut self) {
        let (Some(asset), Some(visibility)) = (&self.asset, &self.visibility) else {
            return;
        };
        if self.jobs.is_running(Kind::Prepare) {
            return;
        }
        let [source, _] = self.oriented_lights();
        let key = PrepareKey {
            asset: self.asset_id,
            bake: self.bake_version,
            source,
            settings: self.look.transfer.clone(),
        };
        let Some(transfer) = self.transfer_asset.clone() else {
            return;
        };
        if self.requested.as_ref() == Some(&key) {
            return;
        }
        self.requested = Some(key.clone());
        let (context, cloud, visibility) = (
            self.context.clone(),
            asset.cloud.clone(),
            visibility.clone(),
        );
        let work = move |_: &super::jobs::Handle<Event>| {
            let start = Instant::now();
            let mut transfer = transfer.lock().unwrap_or_else(|p| p.into_inner());
            let prepared =
                transfer.prepare(&cloud, &visibility, key.bake, &key.source, &key.settings);
            let made = prepared
                .map_err(anyhow::Error::from)
                .and_then(|p| Ok((LiveTransfer::new(&context, &p)?, p)));
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

    fn relight(&mut self) {
        let Some(prepared) = self.prepared.clone() else {
            return;
        };
        let [_, target] = self.oriented_lights();
        // Beyond the transfer's degree nothing is read.
        let target = target.truncated(prepared.light_degree);
        let key = (self.prepared_version, target);
        if self.relit_for.as_ref() == Some(&key) {
            return;
        }
        let start = Instant::now();
        self.live().relight(&prepared.light(&key.1));
        self.transfer_timer
            .measure(&self.context, start, self.jobs.context());
        let stops = (key.1.mean_irradiance() * prepared.light_gain).log2();
        self.stops_over_source = stops.is_finite().then_some(stops);
        self.relit_for = Some(key);
        self.relit_version += 1;
    }

    fn update_hidden(&mut self) {
        let Some(asset) = &self.asset else {
            return;
        };
        let key = (self.asset_id, self.look.hide);
        if self.hidden_for == Some(key) {
            return;
        }
        self.hidden = Arc::new(if self.look.hide.is_off() {
            Vec::new()
        } else {
            self.look.hide.hidden(&asset.cloud, &asset.bounds)
        });
        self.hidden_version += 1;
        self.hidden_for = Some(key);
    }

    fn update_ground(&mut self) {
        let Some(asset) = &self.asset else {
            return;
        };
        if !self.look.shadow_catcher {
            return;
        }
        let key = (self.asset_id, self.look.directions);
        if self.ground_for != Some(key) && !self.jobs.is_running(Kind::Ground) {
            let (id, directions) = key;
            let (cloud, up) = (asset.cloud.clone(), asset.up);
            let work = move |handle: &super::jobs::Handle<Event>| {
                let settings = BakeSettings { directions };
                match Ground::bake(&cloud, up, &settings, &|done| handle.progress(done)) {
                    Ok(ground) => Some(Event::Ground {
                        asset: id,
                        directions,
                        ground: Box::new(ground),
                    }),
                    Err(_) => None,
                }
            };
            self.jobs
                .start(Kind::Ground, "baking the ground", work, Event::Failed);
        }
        if let Some(ground) = &self.ground {
            let light = &self.sides[TARGET].radiance;
            let target = self.look.target.orient(light, self.up());
            let lit_for = (self.asset_id, self.look.directions, target);
            if self.ground_lit_for.as_ref() != Some(&lit_for) {
                let lit = ground.lit_share(&lit_for.2);
                self.live().set_ground(&lit);
                self.ground_lit_for = Some(lit_for);
            }
        }
    }

    /// The ground for a saved picture.
    pub fn ground(&self) -> Option<Ground> {
        self.ground.clone().filter(|_| self.look.shadow_catcher)
    }

    fn start_backdrops(&mut self) {
        if self.look.background != Background::Environment {
            return;
        }
        for side in [SOURCE, TARGET] {
            let shown = match self.look.view {
                View::Before => side == SOURCE,
                View::Split | View::SideBySide => true,
                _ => side == TARGET,
            };
            let key = BackdropKey(self.sides[side].path.clone(), self.look.background_blur);
            let kind = Kind::Backdrop(side);
            if !shown
                || self.backdrop_for[side].as_ref() == Some(&key)
                || self.jobs.is_running(kind)
            {
                continue;
            }
            if self.backdrop_asked[side].as_ref() == Some(&key) {
                // It failed, and was told.
                continue;
            }
            self.backdrop_asked[side] = Some(key.clone());
            let (context, light) = (self.context.clone(), self.sides[side].clone());
            let work = move |_: &super::jobs::Handle<Event>| {
                Some(match load_map(&light) {
                    Ok(map) => {
                        let map = map.blurred(key.1);
                        let backdrop = Backdrop::new(&context, &map);
                        Event::Backdrop {
                            side,
                            key,
                            backdrop,
                        }
                    }
                    Err(error) => Event::Failed(format!("{error:#}")),
                })
            };
            let label = format!("reading {} for the background", self.sides[side].name());
            self.jobs.start(kind, label, work, Event::Failed);
        }
    }

    /// Channels that are made of more than what is on the GPU: when they are asked for.
    fn update_channels(&mut self) {
        if self.asset.is_none() {
            return;
        }
        if self.look.view == View::Visibility
            && self.visibility_shown != Some(self.bake_version)
            && let Some(visibility) = &self.visibility
        {
            let colors = visibility.openness().iter().map(|o| [*o; 3]).collect();
            self.live().set_visibility(colors);
            self.visibility_shown = Some(self.bake_version);
        }
        self.start_doubts();
    }

    fn start_doubts(&mut self) {
        let (Some(asset), Some(visibility), Some(prepared)) =
            (&self.asset, &self.visibility, &self.prepared)
        else {
            return;
        };
        let key = (self.asset_id, self.relit_version);
        if self.doubts_for == Some(key) || self.jobs.is_running(Kind::Doubts) {
            return;
        }
        let Some((_, target)) = self.relit_for.clone() else {
            return;
        };
        self.doubts_for = Some(key);
        let (cloud, visibility, prepared) =
            (asset.cloud.clone(), visibility.clone(), prepared.clone());
        let work = move |_: &super::jobs::Handle<Event>| {
            let tau = prepared.tau(&prepared.relight(&target));
            let doubts = present::doubts(&cloud, &visibility, &prepared, &tau);
            Some(Event::Doubts { key, doubts })
        };
        self.jobs.start(
            Kind::Doubts,
            "counting doubtful surfels",
            work,
            Event::Failed,
        );
    }

    fn show_doubts(&mut self, doubts: Vec<Option<Doubt>>) {
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

    /// Keeps the settings as they are, to compare others with them.
    pub fn pin(&mut self) {
        self.pinned = Some(self.look.clone());
        self.against_pinned = true;
        let display = self.look.display;
        self.live().pin(display);
    }

    /// Exchanges the pinned settings with those of now.
    pub fn swap_pinned(&mut self) {
        if let Some(pinned) = self.pinned.take() {
            let now = std::mem::replace(&mut self.look, pinned);
            // What is on the screen is what is pinned now.
            let display = now.display;
            self.live().pin(display);
            self.pinned = Some(now);
        }
    }

    /// What a viewport of a size shows with the settings as they are.
    pub fn frame(&self, size: [usize; 2], view: View) -> Option<Frame> {
        let asset = self.asset.as_ref()?;
        let up = self.up();
        let whole = Camera::from_pose(&self.pose, up, size, asset.bounds.radius);
        let camera = if view == View::SideBySide {
            half(&whole)
        } else {
            whole
        };
        let look = &self.look;
        let matched = look.match_gain(&self.sides[SOURCE].radiance, &self.sides[TARGET].radiance);
        let light = |settings: &LightSettings, gain: f32| BackdropLight {
            map_from_asset: settings.map_from_asset(up),
            gain: settings.gain().map(|g| g * gain),
        };
        let (center, axes) = asset.ground;
        let ready = |side: usize| {
            let shown = &self.backdrop_for[side];
            shown.as_ref().is_some_and(|k| k.0 == self.sides[side].path)
        };
        let side = if view == View::Before { SOURCE } else { TARGET };
        // Until its map is read, an environment behind the object is a plain grey.
        let background = match look.background {
            Background::Environment if !ready(side) => Background::Color([0.25; 3]),
            other => other,
        };
        Some(Frame {
            presentation: Presentation {
                camera,
                size,
                view,
                wipe: look.wipe,
                difference_scale: look.difference_scale,
                display: look.display,
                false_color: look.false_color,
                background,
                lights: [light(&look.source, 1.0), light(&look.target, matched)],
                ground: GroundPlane {
                    center,
                    axes,
                    half: GROUND_REACH * asset.bounds.radius,
                    catches: look.shadow_catcher && self.ground_lit_for.is_some(),
                    grid: self.grid.then(|| grid_spacing(asset.bounds.radius)),
                },
                bounds: asset.bounds,
                depth_unit: 1.0,
            },
            against_pinned: self.against_pinned,
            marks: self.show_marks,
            hidden: (self.hidden.clone(), self.hidden_version),
        })
    }

    /// The look as it is saved: with asset and camera.
    pub fn look_to_save(&self) -> Look {
        Look {
            asset: self.asset.as_ref().map(|a| a.path.clone()),
            camera: Some(self.pose),
            source: self.named(SOURCE),
            target: self.named(TARGET),
            ..self.look.clone()
        }
    }

    fn named(&self, side: usize) -> LightSettings {
        let settings = if side == SOURCE {
            &self.look.source
        } else {
            &self.look.target
        };
        let mut settings = settings.clone();
        settings.file = Some(self.sides[side].path.clone());
        settings
    }

    /// Whether the light of the capture is not known, and even light is assumed.
    pub fn source_is_assumed(&self) -> bool {
        is_even(&self.sides[SOURCE].path)
    }

    /// Whether everything that the settings ask for is shown: nothing is being computed.
    pub fn is_settled(&self) -> bool {
        self.jobs.running().is_empty()
    }
}

/// A round spacing of the grid, about a fifth of the object's radius.
pub fn grid_spacing(radius: f32) -> f32 {
    let raw = radius / 4.0;
    let power = 10f32.powf(raw.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0];
    let step = steps.iter().find(|s| **s * power >= raw).unwrap_or(&10.0);
    step * power
}
