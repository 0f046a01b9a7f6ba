//! What is open, as what it is lit, and what follows from that: the pipeline's stages, each run when what it reads has changed.

use std::cell::RefCell;
use std::collections::{HashMap, VecDeque};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Instant;

use eframe::egui;
use transplat_core::bake::Bake;
use transplat_core::camera::CameraPose;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::estimate::Estimate;
use transplat_core::ground::Ground;
use transplat_core::look::{EVEN, LightSettings, Look};
use transplat_core::present::{self, Doubt};
use transplat_core::settings::skips::Skipped;
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::surfels::{Hide, UpAxis};
use transplat_core::transfer::{Part, PreparedTransfer, Relit, TransferAsset};
use transplat_gpu::Context;
use transplat_gpu::live::{Live, Passes};
use transplat_gpu::present::Backdrop;
use transplat_gpu::rasterize::ResidentSh;
use transplat_gpu::transfer::GpuTransfer;

use super::adapter::{BackgroundDevice, GpuTimer};
use super::asset::{Asset, LoadedAsset, Reading};
use super::baking::Baked;
use super::jobs::Jobs;
use super::lights::Light;
use super::oriented::{OrientedLight, OrientedLights};
use crate::savings::{Saved, Savings};
use crate::sweep::{Point, in_words};

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
    Estimated {
        asset: u64,
        estimate: Box<Estimate>,
    },
    Prepared(Box<Prepared>),
    /// Relit on the CPU.
    Relit(Box<RelitBy>),
    Backdrop {
        side: usize,
        key: BackdropKey,
        map: Arc<EnvironmentMap>,
        backdrop: Backdrop,
    },
    Ground {
        key: GroundKey,
        ground: Box<Ground>,
    },
    Doubts {
        /// The asset, and which relight of it.
        key: (u64, u64),
        doubts: Vec<Option<Doubt>>,
        readout: Option<Arc<Relit>>,
    },
    /// Files that were chosen to be opened.
    Files(Vec<PathBuf>),
    /// A picture for the clipboard: width, height, straight RGBA bytes.
    Clipboard([usize; 2], Vec<u8>),
    SaveTo(PathBuf, SaveKind),
    /// The desktop shows no dialogs.
    NoDialog,
    LoadFailed(String),
    /// What the extreme cases came to.
    Extremes(String),
    /// What settings cost on the asset, and what they are worth.
    Measured {
        asset: u64,
        points: Vec<Point>,
        savings: Savings,
    },
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

/// A prepared transfer on its way to the screen.
pub struct Prepared {
    pub(super) key: PrepareKey,
    pub prepared: PreparedTransfer,
    /// On the GPU. A driver that computes on the CPU does not get the directional method, which is many times faster there without it.
    pub live: Option<GpuTransfer>,
    pub ms: f64,
}

/// All that a relit asset depends on.
#[derive(Clone, PartialEq)]
pub(super) struct RelitKey {
    pub prepared: u64,
    pub target: OrientedLight,
    pub part: Part,
    /// Which surfels may be left out, as a number that grows when one is to be seen that was not.
    pub unseen: u64,
}

/// An asset that was relit on the CPU, on its way to the screen.
pub struct RelitBy {
    pub(super) key: RelitKey,
    pub relit: Arc<Relit>,
    pub resident: ResidentSh,
    pub ms: f64,
}

/// A method's bake, and how far it is.
#[derive(Default)]
pub struct BakeState {
    pub bake: Option<Arc<Bake>>,
    pub share: f32,
    pub file: Option<PathBuf>,
    pub ms: f64,
    /// Differs between all bakes.
    pub(super) version: u64,
    /// Asset and directions that it was asked for.
    pub(super) asked: Option<(u64, usize)>,
}

/// All that a preparation depends on.
#[derive(Clone, PartialEq)]
pub(super) struct PrepareKey {
    pub asset: u64,
    pub bake: u64,
    pub source: OrientedLight,
    pub settings: TransferSettings,
}

/// All that a map behind the object depends on.
#[derive(Clone, Debug, PartialEq)]
pub struct BackdropKey {
    pub light: u64,
    pub blur: f32,
}

/// All that the ground's bake depends on: asset, directions, up axis.
pub type GroundKey = (u64, usize, UpAxis);

/// A message to the user.
#[derive(Clone, Debug)]
pub struct Message {
    pub text: String,
    pub is_error: bool,
    pub since: Instant,
}

/// Settings that others are compared with, and what the sides were lit by.
#[derive(Clone)]
pub struct Pinned {
    pub look: Look,
    pub sides: [Arc<Light>; 2],
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
    pub prepare: f64,
    /// On the CPU; the GPU's own is in its timer.
    pub relight: Option<f64>,
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
    /// What the asset tells of its light, once it was asked, or from an earlier time.
    pub estimate: Option<Estimate>,
    pub(super) estimate_asked: bool,
    pub(super) estimate_awaited: bool,
    /// Asset and up axis that a light was made of it for.
    pub(super) estimate_shown: Option<(u64, UpAxis)>,
    pub pinned: Option<Pinned>,
    pub against_pinned: bool,
    pub lights: HashMap<PathBuf, Arc<Light>>,
    /// What the sides are lit by: what was asked for last, and could be loaded.
    pub sides: [Arc<Light>; 2],
    /// And by which settings.
    pub(super) resolved: [LightSettings; 2],
    /// What the open asset was to be taken as when it was last loaded again.
    pub(super) reload_asked: Option<Reading>,
    pub bakes: HashMap<Method, BakeState>,
    pub prepared: Option<PreparedTransfer>,
    /// What that leaves out.
    pub transfer_skips: Vec<Skipped>,
    /// What was relit last for a readout, and of which asset and relight it is.
    pub(super) readout: Option<((u64, u64), Arc<Relit>)>,
    /// What settings cost on the asset; empty until it is asked for.
    pub measured: Vec<Point>,
    /// Whether the user has not seen it yet.
    pub measured_is_new: bool,
    /// What the extreme cases came to; empty until it is asked for.
    pub extremes: String,
    /// What leaving something out saves on it.
    pub saved: Vec<Saved>,
    /// And what of that is worth a word.
    pub measured_words: Vec<String>,
    /// Whether a surfel is inspected, and nothing is being dragged.
    pub wants_readout: bool,
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
    pub(super) hidden_version: u64,
    /// Surfels that the last relight left out, and a number for it (see [`RelitKey`]).
    pub(super) unseen: (Arc<Vec<bool>>, u64),
    /// Whether any of them is hidden, and may be shown again; what is too faint never is.
    pub(super) unseen_hides: bool,
    pub(super) hidden_for: Option<(u64, Hide)>,
    pub(super) transfer_asset: Option<Arc<Mutex<TransferAsset>>>,
    pub(super) asset_id: u64,
    pub(super) bake_version: u64,
    oriented: RefCell<OrientedLights>,
    pub(super) requested: Option<PrepareKey>,
    pub(super) relit_for: Option<RelitKey>,
    pub(super) relit_asked: Option<RelitKey>,
    pub(super) relights_on_gpu: bool,
    /// Differs between all relights of whole assets: a part of one is no other.
    pub(super) relit_version: u64,
    pub(super) prepared_version: u64,
    pub(super) doubts_for: Option<(u64, u64)>,
    pub(super) visibility_shown: Option<u64>,
    pub(super) backdrop_for: [Option<BackdropKey>; 2],
    pub(super) backdrop_asked: [Option<BackdropKey>; 2],
    pub(super) ground: Option<Ground>,
    pub(super) ground_for: Option<GroundKey>,
    pub(super) ground_asked: Option<GroundKey>,
    pub(super) ground_lit_for: Option<(GroundKey, [Illumination; 2])>,
    /// Whole maps of the last lights that were seen behind the object.
    pub(super) maps: Vec<(u64, Arc<EnvironmentMap>)>,
    /// Environments that are to be read.
    pub(super) waiting_lights: VecDeque<PathBuf>,
    /// Whether something shows what is doubtful.
    pub wants_doubts: bool,
    /// What was opened and is good, to be remembered.
    pub opened: Vec<PathBuf>,
    /// How many surfels are hidden.
    pub hidden_count: usize,
    /// Files that are being read as lights.
    pub(super) loading: Vec<PathBuf>,
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
        let assumed = Arc::new(Light::assumed());
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
            estimate: None,
            estimate_asked: false,
            estimate_awaited: false,
            estimate_shown: None,
            pinned: None,
            against_pinned: false,
            lights: HashMap::from([&even, &assumed].map(|l| (l.path.clone(), l.clone()))),
            sides: [even.clone(), even],
            resolved: [EVEN, EVEN].map(LightSettings::of),
            reload_asked: None,
            bakes: HashMap::new(),
            prepared: None,
            transfer_skips: Vec::new(),
            readout: None,
            measured: Vec::new(),
            measured_is_new: false,
            extremes: String::new(),
            saved: Vec::new(),
            measured_words: Vec::new(),
            wants_readout: false,
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
            unseen: Default::default(),
            unseen_hides: false,
            hidden_for: None,
            transfer_asset: None,
            asset_id: 0,
            bake_version: 0,
            oriented: RefCell::default(),
            requested: None,
            relit_for: None,
            relit_asked: None,
            relights_on_gpu: true,
            relit_version: 0,
            prepared_version: 0,
            doubts_for: None,
            visibility_shown: None,
            backdrop_for: [None, None],
            backdrop_asked: [None, None],
            ground: None,
            ground_for: None,
            ground_asked: None,
            ground_lit_for: None,
            maps: Vec::new(),
            waiting_lights: VecDeque::new(),
            wants_doubts: false,
            opened: Vec::new(),
            hidden_count: 0,
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

    // ---- what follows from what ----

    /// Takes in what jobs yielded, and starts what is to be done now. Yields what the window has to deal with itself.
    pub fn update(&mut self) -> Vec<Event> {
        let mut left = Vec::new();
        for event in self.jobs.events() {
            left.extend(self.take(event));
        }
        self.update_asset();
        self.start_bake();
        self.update_estimate();
        self.resolve_lights();
        self.start_lights();
        self.start_prepare();
        self.update_hidden();
        self.relight();
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
                self.stages.bake += 1;
                if let Some(why) = baked.complaint {
                    self.error(why);
                }
                let version = self.bake_version;
                let state = self.bakes.entry(baked.bake.method()).or_default();
                *state = BakeState {
                    bake: Some(Arc::new(baked.bake)),
                    share: baked.share,
                    file: baked.file,
                    ms: baked.ms,
                    version,
                    asked: state.asked,
                };
            }
            Event::Light(light) => {
                self.loading.retain(|p| *p != light.path);
                self.stages.project_environment += 1;
                for warning in &light.warnings {
                    self.tell(warning.clone(), false);
                }
                self.opened.push(light.path.clone());
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
                        *settings = self.resolved[side].clone();
                    }
                }
                return Some(Event::LightFailed {
                    path,
                    why: String::new(),
                });
            }
            Event::Estimated { asset, estimate } if asset == self.asset_id => {
                self.estimate = Some(*estimate);
            }
            Event::Prepared(prepared) if prepared.key.asset == self.asset_id => {
                self.stages.prepare += 1;
                self.times.prepare = prepared.ms;
                self.relights_on_gpu = prepared.live.is_some();
                if let Some(live) = prepared.live {
                    self.live().set_transfer(live);
                }
                self.transfer_skips = self
                    .asset
                    .as_ref()
                    .map_or(Vec::new(), |asset| prepared.prepared.left_out(&asset.cloud));
                self.prepared = Some(prepared.prepared);
                self.prepared_version += 1;
            }
            Event::Relit(relit) if relit.key.prepared == self.prepared_version => {
                let tau = present::tau_colors(&relit.relit.tau);
                self.live().set_relit(relit.resident, tau);
                self.times.relight = Some(relit.ms);
                let is_whole = relit.key.part == Part::Whole;
                self.relit_is(relit.key);
                if is_whole && !self.unseen_hides {
                    self.readout = Some(((self.asset_id, self.relit_version), relit.relit));
                }
            }
            Event::Backdrop {
                side,
                key,
                map,
                backdrop,
            } => {
                self.keep_map(key.light, map);
                if self.backdrop_asked[side].as_ref() == Some(&key) {
                    self.live().set_backdrop(side, backdrop);
                    self.backdrop_for[side] = Some(key);
                }
            }
            Event::Ground { key, ground } if self.ground_asked == Some(key) => {
                self.stages.ground += 1;
                self.ground = Some(*ground);
                self.ground_for = Some(key);
            }
            Event::Doubts {
                key,
                doubts,
                readout,
            } if key.0 == self.asset_id => {
                if let Some(relit) = readout.filter(|_| key.1 == self.relit_version) {
                    self.readout = Some((key, relit));
                }
                self.show_doubts(doubts);
            }
            Event::Extremes(told) => self.extremes = told,
            Event::Measured {
                asset,
                points,
                savings,
            } if asset == self.asset_id => {
                self.saved = savings.saved;
                self.measured_words = in_words(&points);
                self.measured = points;
                self.measured_is_new = true;
            }
            Event::Baked { .. }
            | Event::Measured { .. }
            | Event::Estimated { .. }
            | Event::Prepared(_)
            | Event::Relit(_)
            | Event::Ground { .. }
            | Event::Doubts { .. } => {}
            Event::LoadFailed(text) => {
                // What could not be loaded again stays as it was loaded.
                self.look = self.loaded_reading().over(self.look.clone());
                self.error(text);
            }
            Event::Done(text) => self.info(text),
            Event::Failed(text) => self.error(text),
            other => return Some(other),
        }
        None
    }

    /// Source and target as the asset sees them.
    pub fn oriented_lights(&self) -> [OrientedLight; 2] {
        let sides = self.sides.each_ref().map(|side| &**side);
        self.oriented.borrow_mut().of(sides, &self.look, self.up())
    }

    /// The bake of the method that is set, and how far it is.
    pub fn baked(&self) -> Option<&BakeState> {
        self.bakes.get(&self.look.transfer.method)
    }

    /// Bakes that are done, of any method.
    pub fn whole_bakes(&self) -> impl Iterator<Item = &Arc<Bake>> {
        let whole = self.bakes.values().filter(|b| b.share == 1.0);
        whole.filter_map(|b| b.bake.as_ref())
    }

    /// How much of that is done, 0 to 1.
    pub fn bake_share(&self) -> f32 {
        self.baked().map_or(0.0, |b| b.share)
    }

    /// How long the last change of light took.
    pub fn transfer_ms(&self) -> f64 {
        self.times
            .relight
            .unwrap_or_else(|| self.transfer_timer.ms())
    }

    /// The bake itself, as far as it is.
    pub fn bake_so_far(&self) -> Option<&Arc<Bake>> {
        self.baked()?.bake.as_ref()
    }

    /// How the open asset was read.
    pub(super) fn loaded_reading(&self) -> Reading {
        let asset = self.asset.as_ref();
        asset.map_or_else(Reading::default, |a| Reading::of_cloud(&a.cloud))
    }

    /// Keeps a whole map for the next time that it is seen, and of others the last few.
    fn keep_map(&mut self, light: u64, map: Arc<EnvironmentMap>) {
        self.maps.retain(|(id, _)| *id != light);
        self.maps.push((light, map));
        if self.maps.len() > 3 {
            self.maps.remove(0);
        }
    }

    /// The look as it is saved: with asset and camera.
    pub fn look_to_save(&self) -> Look {
        // What is still being read may turn out not to be a light.
        let named = |settings: &LightSettings, side: usize| LightSettings {
            file: Some(self.sides[side].path.clone()),
            ..settings.clone()
        };
        Look {
            asset: self.asset.as_ref().map(|a| a.path.clone()),
            camera: Some(self.pose),
            source: named(&self.look.source, SOURCE),
            target: named(&self.look.target, TARGET),
            ..self.look.clone()
        }
    }

    /// Whether the light of the capture is not known, and even light is assumed.
    pub fn source_is_assumed(&self) -> bool {
        self.sides[SOURCE].is_even
    }

    /// Whether everything that the settings ask for is shown: nothing is being computed.
    pub fn is_settled(&self) -> bool {
        self.jobs.running().is_empty()
    }
}
