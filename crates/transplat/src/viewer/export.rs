//! Pictures and splats out, off the interface's thread: each picture goes the way of `transplat render` with the same look.

mod label;
mod run;
mod sheet;

use std::cell::{OnceCell, RefCell};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use transplat_core::bake::Bake;
use transplat_core::camera::CameraPose;
use transplat_core::environment::EnvironmentMap;
use transplat_core::files::{AssetFile, SplatFormat};
use transplat_core::ground::Ground;
use transplat_core::lut::Lut;
use transplat_core::present::{Background, View};
use transplat_core::scene::Scene;
use transplat_core::surfels::{SurfelCloud, UpAxis};
use transplat_core::transfer::{PreparedTransfer, Relit};

use super::session::{Event, Outcome, Session};
use crate::engine::adapter::StageDevice;
use crate::engine::asset::reading_of;
use crate::engine::capture::Part;
use crate::engine::delight::DelitAs;
use crate::engine::device::Transfer;
use crate::engine::environments::Environment;
use crate::engine::film::{FRAME_RATE, FilmFormat};
use crate::engine::jobs::{Handle, Kind};
use crate::engine::names::name_of;
use crate::engine::project::{Pinned, SOURCE, TARGET, Whole};
use crate::language::{tr, tr_format, tr_later};

/// Format of saved pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Format {
    /// 8 bits a channel, as on the screen.
    #[default]
    Png8,
    /// 16 bits.
    Png16,
    /// Linear, 16-bit floats.
    ExrHalf,
    /// Linear, 32-bit floats.
    ExrFloat,
    /// Plate, objects, shadow, depth, normals and ids, each a layer.
    ExrLayers,
}

impl Format {
    /// All of them, with their names.
    pub const ALL: [(&'static str, Self); 5] = [
        (tr_later("PNG, 8 bit"), Self::Png8),
        (tr_later("PNG, 16 bit"), Self::Png16),
        (tr_later("EXR, half"), Self::ExrHalf),
        (tr_later("EXR, float"), Self::ExrFloat),
        (tr_later("EXR, layers"), Self::ExrLayers),
    ];

    /// Whether it holds linear light.
    pub fn is_linear(self) -> bool {
        matches!(self, Self::ExrHalf | Self::ExrFloat | Self::ExrLayers)
    }

    /// Of the files.
    pub fn extension(self) -> &'static str {
        if self.is_linear() { "exr" } else { "png" }
    }
}

/// Which sides are saved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ExportSides {
    /// What is shown.
    #[default]
    Shown,
    /// Before and after, a picture each.
    Each,
}

/// What turns on a turntable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Turn {
    #[default]
    Camera,
    Light,
}

/// How pictures are saved; kept from start to start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ExportSettings {
    pub size: [usize; 2],
    pub format: Format,
    pub supersample: usize,
    pub transparent: bool,
    pub sides: ExportSides,
    pub pattern: String,
    pub folder: String,
    pub frames: usize,
    pub turn: Turn,
    /// A turntable as a film, or as numbered pictures.
    pub film: Option<FilmFormat>,
    /// Of the film, a second.
    pub frame_rate: u32,
    /// What a relit splat is written as; nothing is as it came.
    pub splat: Option<SplatFormat>,
    /// What the colour of a splat without its light is.
    pub delit_as: DelitAs,
    /// The albedo of its whitest surface, if that is known.
    pub whitest: Option<f32>,
    /// Whether it comes with what its surfels are made of.
    pub materials: bool,
}

impl Default for ExportSettings {
    fn default() -> Self {
        let folders = directories::UserDirs::new();
        let folder = folders.map(|d| d.picture_dir().unwrap_or(d.home_dir()).to_owned());
        Self {
            size: [1920, 1080],
            format: Format::default(),
            supersample: 2,
            transparent: false,
            sides: ExportSides::default(),
            pattern: "{asset}_{light}_{view}".into(),
            folder: folder.map_or(".".into(), |f| f.display().to_string()),
            frames: 36,
            turn: Turn::default(),
            film: None,
            frame_rate: FRAME_RATE,
            splat: None,
            delit_as: DelitAs::default(),
            whitest: None,
            materials: false,
        }
    }
}

/// Pixels along the longer edge of a preview.
const PREVIEW_EDGE: usize = 640;

/// What is saved.
#[derive(Clone, Debug, PartialEq)]
pub enum Task {
    /// One picture (or one a side); into a named file, or by folder and pattern.
    Screenshot(Option<PathBuf>),
    /// The same to the clipboard.
    Clipboard,
    /// The same in the window, as small as it can be looked at.
    Preview,
    /// One file a light of the shelf.
    EachLight,
    /// One file with a picture a light of the shelf.
    ContactSheet,
    /// Numbered frames, or a film.
    Turntable,
    /// The same of the light as its keys have it over time.
    Animation,
    /// The relit splat.
    Splat(PathBuf),
    /// The selected object's splat without its light.
    Delit(PathBuf),
}

impl Task {
    /// The settings that it is done with: a file's extension decides on its format, and a clipboard holds display values.
    fn settings(&self, settings: &ExportSettings) -> Result<ExportSettings> {
        let mut settings = settings.clone();
        match self {
            Self::Clipboard => settings.format = Format::Png8,
            Self::Preview => {
                settings.format = Format::Png8;
                let longer = settings.size[0].max(settings.size[1]).max(PREVIEW_EDGE);
                let scaled = |edge: usize| (edge * PREVIEW_EDGE / longer).max(1);
                settings.size = settings.size.map(scaled);
            }
            // A film holds display values too.
            Self::Turntable | Self::Animation if settings.film.is_some() => {
                settings.format = Format::Png8;
            }
            Self::Screenshot(Some(path)) => {
                let extension = path.extension().unwrap_or_default().to_string_lossy();
                let format = match &*extension.to_lowercase() {
                    "png" => Format::Png8,
                    "exr" => Format::ExrHalf,
                    _ => bail!(tr_format!("{}: a picture is .png or .exr", path.display())),
                };
                if settings.format.is_linear() != format.is_linear() {
                    settings.format = format;
                }
            }
            Self::ContactSheet if settings.format == Format::ExrLayers => {
                bail!(tr("a contact sheet has no layers: choose another format"))
            }
            _ => {}
        }
        Ok(settings)
    }
}

impl Task {
    /// For the list of jobs.
    fn label(&self, of: &Snapshot) -> String {
        let (name, light) = (&of.name, of.lights[TARGET].name());
        let lights = of.shelf.len();
        let file = |path: &Path| {
            let name = path.file_name().unwrap_or(path.as_os_str());
            name.to_string_lossy().into_owned()
        };
        match self {
            Self::Screenshot(Some(path)) => tr_format!("picture {}", file(path)),
            Self::Screenshot(None) => {
                tr_format!("picture of {name}, {light}", name = name, light = light)
            }
            Self::Clipboard => tr_format!("picture of {name} for the clipboard", name = name),
            Self::Preview => tr_format!("preview of {name}, {light}", name = name, light = light),
            Self::EachLight => {
                tr_format!(
                    "{lights} pictures of {name}, one per light",
                    lights = lights,
                    name = name
                )
            }
            Self::ContactSheet => {
                tr_format!(
                    "contact sheet of {name}, {lights} lights",
                    name = name,
                    lights = lights
                )
            }
            Self::Turntable => {
                let as_what = of.settings.film.map_or(tr("pictures"), |_| tr("film"));
                let frames = of.settings.frames;
                tr_format!(
                    "turntable of {name}, {frames} frames, {as_what}",
                    name = name,
                    frames = frames,
                    as_what = as_what
                )
            }
            Self::Animation => tr_format!("light over time on {name}", name = name),
            Self::Splat(path) => tr_format!("relit splat {}", file(path)),
            Self::Delit(path) => tr_format!("delit splat {}", file(path)),
        }
    }
}

/// What an export made.
enum Made {
    Files(Vec<PathBuf>),
    /// A splat without its light, and what is to be known of it.
    Delit(PathBuf, Vec<String>),
    /// Width, height, straight RGBA bytes: for the clipboard, or to be looked at.
    Picture([usize; 2], Vec<u8>),
    Preview([usize; 2], Vec<u8>),
}

/// Everything that an export reads, as it was when it was asked for, and what is made of it once.
struct Snapshot {
    /// Of the look's source: no target changes it.
    prepared: OnceCell<PreparedTransfer>,
    /// That on its device.
    transfer: RefCell<Option<Transfer>>,
    /// What the pinned look shows: its lights are its own.
    pinned_relit: OnceCell<Relit>,
    pinned_lut: OnceCell<Option<Arc<Lut>>>,
    /// Blurred maps by light, and whether their suns are taken out.
    maps: RefCell<HashMap<(u64, bool), Arc<EnvironmentMap>>>,
    device: StageDevice,
    cloud: Arc<SurfelCloud>,
    /// That the cloud is yet to be made of, where it is all objects.
    whole: Option<Whole>,
    /// What that is cut out of.
    part: Option<Part>,
    file: Arc<AssetFile>,
    name: String,
    scene: Scene,
    pose: CameraPose,
    up: UpAxis,
    radius: f32,
    /// Of the look's method.
    bake: Arc<Bake>,
    /// Whole ones of any method.
    bakes: Vec<Arc<Bake>>,
    ground: Option<Ground>,
    /// Surfels that are not drawn, `[n]` or empty.
    hidden: Vec<bool>,
    /// Files that it is made of.
    captures: Vec<PathBuf>,
    /// The objects in it: what they are called, and how many surfels each has.
    objects: Vec<(String, usize)>,
    /// The scene that the others were put into, without them.
    scene_alone: OnceCell<Option<PreparedTransfer>>,
    /// Which of the look's objects it is; the first one where it is all of them.
    object: usize,
    is_composed: bool,
    lights: [Arc<Environment>; 2],
    shelf: Vec<Arc<Environment>>,
    /// A pinned look, where that is compared with.
    pinned: Option<Pinned>,
    settings: ExportSettings,
}

/// Starts an export; what cannot be started is told.
pub fn start(session: &mut Session, shelf: &[PathBuf], settings: &ExportSettings, task: Task) {
    let settings = match task.settings(settings) {
        Ok(settings) => settings,
        Err(error) => {
            session.error(error.to_string());
            return;
        }
    };
    let listed = session.project.scene.objects.iter().enumerate();
    let mut awaited = listed.filter(|(at, object)| {
        let is_listed = object.shown && object.asset.is_some();
        // One that is to be read in another way is still what it was.
        let asset = session.project.states[*at].asset.as_ref();
        let is_there = asset.is_some_and(|a| a.reading() == reading_of(object));
        is_listed && !is_there && !session.project.is_missing(*at)
    });
    if let Some(name) = awaited.next().map(|(at, _)| session.project.called(at)) {
        session.error(tr_format!(
            "{name} is still being loaded; try again when that is done",
            name = name
        ));
        return;
    }
    let composed = match composed(session, &task) {
        Ok(composed) => composed,
        Err(error) => {
            session.error(error.to_string());
            return;
        }
    };
    // What is told of one object where the scene is several: the first that is shown.
    let of_scene = session
        .project
        .shown()
        .next()
        .filter(|_| composed.is_some());
    let at = of_scene.map_or(session.selected, |(at, ..)| at);
    let state = &session.project.states[at];
    let (Some(asset), Some(baked)) = (&state.asset, session.project.baked_of(at)) else {
        session.error(tr("there is nothing to save yet"));
        return;
    };
    let (bake, share) = (baked.bake.clone(), baked.share);
    let mut scene = session.project.scene.clone();
    let is_layered = settings.format == Format::ExrLayers;
    let is_clear = if is_layered {
        scene.background != Background::Plate
    } else {
        settings.transparent
    };
    if is_clear {
        scene.background = Background::Transparent;
    }
    let snapshot = Snapshot {
        prepared: OnceCell::new(),
        transfer: RefCell::default(),
        pinned_relit: OnceCell::new(),
        pinned_lut: OnceCell::new(),
        maps: RefCell::default(),
        device: session.project.device.clone(),
        cloud: asset.cloud.clone(),
        whole: None,
        part: asset.part.clone(),
        file: asset.file.clone(),
        name: asset.name(),
        pose: session.project.pose,
        up: session.project.up_of(at),
        radius: asset.bounds.radius,
        bake,
        bakes: state.whole_bakes().cloned().collect(),
        ground: session.project.ground().cloned(),
        hidden: {
            let hide = &session.project.scene.objects[at].hide;
            let skips = &session.project.scene.transfer.skips;
            hide.unseen(&asset.cloud, &asset.bounds, skips)
        },
        captures: {
            let all = session
                .project
                .states
                .iter()
                .filter_map(|s| s.asset.as_ref());
            all.map(|a| a.path.clone()).collect()
        },
        objects: vec![(asset.name(), asset.cloud.len())],
        scene_alone: OnceCell::new(),
        object: at,
        is_composed: false,
        lights: [SOURCE, TARGET].map(|side| session.light(side).clone()),
        shelf: shelf
            .iter()
            .filter_map(|p| session.project.environments.get(p).cloned())
            .collect(),
        pinned: session.project.compared().cloned(),
        settings,
        scene,
    };
    let snapshot = match composed {
        Some(composed) => composed.over(session, snapshot),
        None => snapshot,
    };
    if snapshot.is_composed
        && session.project.compared().is_some()
        && snapshot.scene.view.has_two_sides()
    {
        session.info(tr(
            "of several objects, what is saved shows the capture beside it, and not what is pinned",
        ));
    }
    if share < 1.0 {
        let percent = 100.0 * share;
        session.info(tr_format!(
            "the bake is at {percent:.0} %: the shadows of what is saved are coarse",
            percent = percent
        ));
    }
    let waiting = shelf.iter().filter(|p| session.is_loading(p)).count();
    if waiting > 0 && matches!(task, Task::EachLight | Task::ContactSheet) {
        session.info(tr_format!(
            "{waiting} lights of the shelf are still being read and are left out",
            waiting = waiting
        ));
    }
    let label = task.label(&snapshot);
    let work = move |handle: &Handle<Outcome>| snapshot.run(&task, handle);
    session.start(Kind::Export, label, work, |session, made| match made {
        Made::Files(paths) => session.info(saved(&paths)),
        Made::Delit(path, warnings) => {
            session.info(saved(&[path]));
            warnings
                .into_iter()
                .for_each(|warning| session.info(warning));
        }
        Made::Picture(size, bytes) => session.events.push(Event::Clipboard(size, bytes)),
        Made::Preview(size, bytes) => session.events.push(Event::Preview(size, bytes)),
    });
}

/// All objects of a scene, to be saved as one.
struct Composed {
    whole: Whole,
    hidden: Vec<bool>,
    captures: Vec<PathBuf>,
    objects: Vec<(String, usize)>,
    /// With the bake; none where nothing relit is to be saved.
    prepared: Option<(PreparedTransfer, Arc<Bake>)>,
}

/// What of a scene is to be saved where it is more than an object as it was captured.
fn composed(session: &Session, task: &Task) -> Result<Option<Composed>> {
    // What one is made of is the same among others.
    if !session.project.is_composed() || matches!(task, Task::Delit(_)) {
        return Ok(None);
    }
    if session.project.shown().next().is_none() {
        bail!(tr("no object is shown: there is nothing to save"));
    }
    // As things stand now, and not as they stood before the last move.
    let prepared = session.project.scene_transfer().filter(|(members, _)| {
        session.project.is_traced() && members.iter().all(|at| session.project.is_prepared(*at))
    });
    let prepared = prepared
        .map(|(_, scene)| scene)
        .zip(session.project.shown_bake());
    let view = session.project.scene.view;
    let needs_scene =
        matches!(task, Task::Splat(_)) || view.needs_relit() || view == View::Visibility;
    if needs_scene && prepared.is_none() {
        bail!(tr(
            "the objects are still being prepared; try again when that is done"
        ));
    }
    let captures = session.project.shown().map(|(.., a)| a.path.clone());
    let objects = session.project.shown();
    let objects = objects.map(|(_, o, a)| (name_of(o, &a.path), a.cloud.len()));
    Ok(Some(Composed {
        hidden: session.project.unseen_surfels(),
        captures: captures.collect(),
        objects: objects.collect(),
        whole: session.project.whole(),
        prepared,
    }))
}

impl Composed {
    /// What is saved of one object, as that of all.
    fn over(self, session: &Session, one: Snapshot) -> Snapshot {
        let source = session.project.states[0].source.light.clone();
        let [_, target] = one.lights;
        let (prepared, bake) = match self.prepared {
            Some((prepared, bake)) => (OnceCell::from(prepared), bake),
            None => (OnceCell::new(), one.bake),
        };
        Snapshot {
            prepared,
            bake,
            bakes: Vec::new(),
            whole: Some(self.whole),
            hidden: self.hidden,
            captures: self.captures,
            objects: self.objects,
            up: session.project.scene_up(),
            radius: session
                .project
                .scene_bounds()
                .map_or(one.radius, |b| b.radius),
            object: 0,
            is_composed: true,
            lights: [source, target],
            // It is of single objects.
            pinned: None,
            ..one
        }
    }
}

/// For the user.
fn saved(paths: &[PathBuf]) -> String {
    match paths {
        [one] => tr_format!("saved {}", one.display()),
        [first, .., last] => tr_format!(
            "saved {} pictures, {} to {}",
            paths.len(),
            first.display(),
            last.file_name().unwrap_or_default().to_string_lossy()
        ),
        [] => tr("nothing was saved").into(),
    }
}

/// `folder/stem.extension`, or with the first number that is free.
pub fn free_name(folder: &Path, stem: &str, extension: &str) -> PathBuf {
    let named = |stem: &str| match extension {
        "" => folder.join(stem),
        extension => folder.join(format!("{stem}.{extension}")),
    };
    let plain = named(stem);
    if !plain.exists() {
        return plain;
    }
    (2..)
        .map(|i| named(&format!("{stem}-{i}")))
        .find(|p| !p.exists())
        .unwrap_or(plain)
}
