//! Session: a project in the window, with selection, overlays, messages, and the window's own jobs.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::{Arc, Weak};
use std::time::Instant;

use anyhow::Result;
use transplat_core::bake::Bake;
use transplat_core::estimate::Estimate;
use transplat_core::scene::{EnvironmentLight, Object, Scene};
use transplat_core::surfels::{SurfelCloud, UpAxis};
use transplat_core::transfer::PreparedTransfer;
use transplat_gpu::Context;
use transplat_gpu::live::{Drawing, Live};

use transplat_engine::bake::Baked;
use transplat_engine::bundled::is_bundled;
use transplat_engine::environments::Environment;
use transplat_engine::jobs::{Handle, Job, Jobs, Kind, Wake};
use transplat_engine::language::tr_later;
use transplat_engine::object::{ObjectState, OrientedLight};
use transplat_engine::project::canvas::Canvas;
use transplat_engine::project::{Notice, Project, Remedy, SOURCE};
use transplat_engine::splat::Splat;
use transplat_engine::words::of_error;
use transplat_eval::savings::Saved;
use transplat_eval::sweep::Point;

/// Names of the two sides of the light.
pub const SIDES: [&str; 2] = [tr_later("Capture light"), tr_later("New light")];

/// Change that a job makes to the session.
pub type SessionChange = Box<dyn FnOnce(&mut Session) + Send>;

/// Event that the window handles itself.
pub enum Event {
    /// Files that were chosen to be opened.
    Files(Vec<PathBuf>),
    /// A picture for the clipboard: width, height, straight RGBA bytes.
    Clipboard([usize; 2], Vec<u8>),
    /// A picture to be looked at: width, height, straight RGBA bytes.
    Preview([usize; 2], Vec<u8>),
    SaveTo(PathBuf, SaveKind),
    /// The desktop shows no dialogs.
    NoDialog(Dialog),
    /// A file that is no light.
    NoLight(PathBuf),
    /// A light for the shelf.
    Light(PathBuf),
    /// The size of what pictures are drawn over.
    PictureSize([usize; 2]),
}

/// Purpose of a path that was chosen in a dialog.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SaveKind {
    Look,
    Splat,
    /// A splat without its light.
    Delit,
    Screenshot,
    Folder,
    /// A photograph to be shown behind the objects.
    Backplate,
    /// Lights of one's own.
    Rig,
    /// Placed lights, to be opened.
    OpenRig,
    /// All the light as one environment.
    Environment,
    /// A table of colours to grade the picture by.
    Lut,
}

/// Purpose of a file dialog.
#[derive(Clone, Debug)]
pub enum Dialog {
    Open,
    OpenFolder,
    Save(SaveKind, String),
}

/// A message to the user.
#[derive(Clone, Debug)]
pub struct Message {
    pub text: String,
    pub is_error: bool,
    pub since: Instant,
    /// Remedy that it offers, and the state of the object that it is about.
    pub offer: Option<(u64, Remedy)>,
}

/// Overlays of the picture.
pub struct Overlays {
    /// Handles on the selected object.
    pub handles: bool,
    /// Handles on lights of one's own, where the panel is about them; and whether it is.
    pub light_handles: bool,
    pub lights: bool,
    /// Arrow of the capture light, where the panel is about that.
    pub capture_light: bool,
    pub marks: bool,
    pub grid: bool,
}

impl Default for Overlays {
    fn default() -> Self {
        Self {
            handles: true,
            light_handles: true,
            lights: false,
            capture_light: false,
            marks: false,
            grid: false,
        }
    }
}

/// Measurements on an object.
pub struct Measured {
    /// The splat that was measured.
    pub cloud: Weak<SurfelCloud>,
    /// Run time and error of settings.
    pub points: Vec<Point>,
    /// Savings of optimizations.
    pub saved: Vec<Saved>,
    /// Remarks on the settings.
    pub words: Vec<String>,
    /// True where the user has not seen it yet.
    pub is_new: bool,
}

/// A project in the window, and what the window adds.
pub struct Session {
    pub project: Project,
    /// Canvas that draws the project.
    pub canvas: Canvas,
    /// Work for the window itself: exports, dialogs, measurements.
    pub jobs: Jobs<SessionChange>,
    /// The object that the panels are about.
    pub selected: usize,
    /// The light of one's own that is chosen; one too many stands for the last.
    pub selected_light: usize,
    /// True where a splat that is opened is put into the scene.
    pub adds_splats: bool,
    pub overlays: Overlays,
    pub messages: Vec<Message>,
    /// Measurements of objects, by the number of their state.
    pub(super) measured: HashMap<u64, Measured>,
    /// Result of the extreme cases; empty until they are tried.
    pub extremes: String,
    pub(super) events: Vec<Event>,
    /// Folder that images are saved in.
    pub image_folder: PathBuf,
    /// Files that were opened and are good, to be remembered.
    pub opened: Vec<PathBuf>,
}

impl Session {
    /// An empty scene on a window's device.
    pub fn new(
        context: Arc<Context>,
        window: eframe::wgpu::TextureFormat,
        wake: Wake,
        scene: Scene,
    ) -> Self {
        let live = Live::new(&context, window, Drawing::fastest(&context));
        let canvas = Canvas::new(context, live);
        Self {
            jobs: Jobs::new(wake.clone()),
            project: Project::on_canvas(canvas.clone(), wake, scene),
            canvas,
            selected: 0,
            selected_light: 0,
            adds_splats: false,
            overlays: Overlays::default(),
            messages: Vec::new(),
            measured: HashMap::new(),
            extremes: String::new(),
            events: Vec::new(),
            image_folder: PathBuf::new(),
            opened: Vec::new(),
        }
    }

    pub fn info(&mut self, text: impl Into<String>) {
        self.tell(text.into(), false, None);
    }

    pub fn error(&mut self, text: impl Into<String>) {
        self.tell(text.into(), true, None);
    }

    fn tell(&mut self, text: String, is_error: bool, offer: Option<(u64, Remedy)>) {
        self.messages.retain(|m| m.text != text);
        self.messages.push(Message {
            text,
            is_error,
            since: Instant::now(),
            offer,
        });
    }

    /// Brings the project up to date. Yields what the window has to deal with itself.
    pub fn update(&mut self) -> Vec<Event> {
        for outcome in self.jobs.events() {
            outcome(self);
        }
        // Marks in the picture ask for them, too.
        self.project.requested.confidence |= self.overlays.marks;
        self.project.update();
        self.take_notices();
        self.forget_measured();
        std::mem::take(&mut self.events)
    }

    /// Shows what the project has to say, and follows its changes.
    pub(super) fn take_notices(&mut self) {
        for notice in std::mem::take(&mut self.project.notices) {
            match notice {
                Notice::Info(text) => self.info(text),
                Notice::Offer(text, at, remedy) => {
                    let of = self.project.states.get(at).map(|state| (state.id, remedy));
                    self.tell(text, false, of);
                }
                Notice::Error(text) => self.error(text),
                Notice::Opened(path) => self.opened.push(path),
                Notice::NoLight(path) => self.events.push(Event::NoLight(path)),
                Notice::PictureSize(size) => self.events.push(Event::PictureSize(size)),
                Notice::Added(at) => self.selected = at,
                Notice::Removed(at) => self.selected -= usize::from(self.selected > at),
            }
        }
        let last = self.project.scene.objects.len() - 1;
        self.selected = self.selected.min(last);
    }

    /// Folder that a dialog begins in: that of the splat, or of images where the splat comes with the program.
    pub fn folder_of(&self, dialog: &Dialog) -> PathBuf {
        let is_of_images = matches!(
            dialog,
            Dialog::Save(SaveKind::Screenshot | SaveKind::Folder, _)
        );
        let own = self.asset().and_then(|asset| asset.path.parent());
        let own = own.filter(|own| !is_of_images && !is_bundled(own));
        own.unwrap_or(&self.image_folder).to_owned()
    }

    /// Its settings.
    pub fn object(&self) -> &Object {
        &self.project.scene.objects[self.selected]
    }

    /// Settings of the selected object, to be changed.
    pub fn object_mut(&mut self) -> &mut Object {
        &mut self.project.scene.objects[self.selected]
    }

    /// State of the selected object.
    pub fn state(&self) -> &ObjectState {
        &self.project.states[self.selected]
    }

    /// State of the selected object, to be changed.
    pub fn state_mut(&mut self) -> &mut ObjectState {
        &mut self.project.states[self.selected]
    }

    /// Its splat, once there is one.
    pub fn asset(&self) -> Option<&Splat> {
        self.state().asset.as_ref()
    }

    /// Its up axis as it is set.
    pub fn up(&self) -> UpAxis {
        self.project.up_of(self.selected)
    }

    /// The settings of a side's light.
    pub fn side(&self, side: usize) -> &EnvironmentLight {
        match side {
            SOURCE => &self.object().source,
            _ => &self.project.scene.environment,
        }
    }

    /// Settings of a side's light, to be changed.
    pub fn side_mut(&mut self, side: usize) -> &mut EnvironmentLight {
        match side {
            SOURCE => &mut self.object_mut().source,
            _ => &mut self.project.scene.environment,
        }
    }

    /// Environment of a side.
    pub fn light(&self, side: usize) -> &Arc<Environment> {
        match side {
            SOURCE => &self.state().source.light,
            _ => &self.project.environment.light,
        }
    }

    /// Source and target as the asset sees them.
    pub fn oriented_lights(&self) -> [OrientedLight; 2] {
        self.project.oriented_of(self.selected)
    }

    /// The bake of the method that is set, and how far it is.
    pub fn baked(&self) -> Option<&Baked> {
        self.project.baked_of(self.selected)
    }

    /// Share of the bake that is done, 0 to 1.
    pub fn bake_share(&self) -> f32 {
        let method = self.project.scene.transfer.method;
        self.state().bake_share(method)
    }

    /// The bake itself, as far as it is.
    pub fn bake_so_far(&self) -> Option<&Arc<Bake>> {
        self.baked().map(|b| &b.bake)
    }

    /// The transfer that is prepared.
    pub fn prepared(&self) -> Option<&PreparedTransfer> {
        self.state().prepared.get().map(|p| &p.prepared)
    }

    /// Estimate of the capture light, once it was requested or from an earlier time.
    pub fn estimate(&self) -> Option<&Estimate> {
        self.state().estimate.get()
    }

    /// Milliseconds of the last change of light.
    pub fn transfer_ms(&self) -> f64 {
        let relit = self.state().relit.get();
        let on_cpu = relit.and_then(|r| r.cpu_ms);
        on_cpu.unwrap_or_else(|| self.canvas.timers.transfer.ms())
    }

    /// Stops of the target's mean irradiance over the source's, as they are shown.
    pub fn stops_over_source(&self) -> Option<f32> {
        let matched = self.project.scene.matched_object();
        self.project.states[matched].relit.get()?.stops_over_source
    }

    /// True where the capture light is not known, and uniform white light is assumed.
    pub fn source_is_assumed(&self) -> bool {
        self.light(SOURCE).is_even
    }

    /// Takes the selected object out of the scene, unless it is the only one or locked.
    pub fn remove_object(&mut self) {
        self.project.remove_unlocked(self.selected);
        self.take_notices();
    }

    /// Jobs of the project and of the window, those of the project first.
    pub fn running_jobs(&self) -> impl Iterator<Item = &Job> {
        let own = self.jobs.running().iter();
        self.project.jobs.running().iter().chain(own)
    }

    /// True once everything that the settings ask for is shown and nothing is being computed.
    pub fn is_settled(&self) -> bool {
        self.running_jobs().next().is_none() && self.project.is_relit_as_set()
    }

    /// Starts a job, gives its result to `take`, and reports its error.
    pub fn start<T: Send + 'static>(
        &mut self,
        kind: Kind,
        label: impl Into<String>,
        work: impl FnOnce(&Handle<SessionChange>) -> Result<T> + Send + 'static,
        take: impl FnOnce(&mut Self, T) + Send + 'static,
    ) {
        let finish = |result| -> SessionChange {
            Box::new(|session: &mut Self| match result {
                Ok(made) => take(session, made),
                Err(error) => session.error(of_error(&error)),
            })
        };
        self.jobs.start(kind, label, work, finish);
    }
}
