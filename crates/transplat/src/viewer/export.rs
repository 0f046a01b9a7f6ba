//! Pictures and splats out, off the interface's thread: each picture goes the way of `transplat render` with the same look.

use std::cell::{OnceCell, RefCell};
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use serde::{Deserialize, Serialize};
use transplat_core::bake::Bake;
use transplat_core::camera::{Camera, CameraPose};
use transplat_core::color::{Display, Encoding};
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::files::{
    AssetFile, ExrFloats, PngBits, write_exr, write_png, write_relit, write_splat,
};
use transplat_core::ground::Ground;
use transplat_core::present::{self, Background, View};
use transplat_core::rasterize::Raster;
use transplat_core::scene::Scene;
use transplat_core::settings::Method;
use transplat_core::surfels::{SurfelCloud, UpAxis};
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use super::adapter::BackgroundDevice;
use super::environments::{Environment, load_map};
use super::jobs::{Handle, Kind};
use super::navigation::wrap;
use super::session::{Event, Outcome, Pinned, SOURCE, Session, TARGET};
use crate::commands::render::MAX_SAMPLES;
use crate::device::Transfer;
use crate::picture::{Backdrop, Lit, Studio, lit_ground};

/// Format of saved pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Format {
    #[default]
    Png8,
    Png16,
    ExrHalf,
    ExrFloat,
}

impl Format {
    pub const ALL: [(&'static str, Self); 4] = [
        ("PNG, 8 bit", Self::Png8),
        ("PNG, 16 bit", Self::Png16),
        ("EXR, half", Self::ExrHalf),
        ("EXR, float", Self::ExrFloat),
    ];

    pub fn is_linear(self) -> bool {
        matches!(self, Self::ExrHalf | Self::ExrFloat)
    }

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
        }
    }
}

/// What is saved.
#[derive(Clone, Debug, PartialEq)]
pub enum Task {
    /// One picture (or one a side); into a named file, or by folder and pattern.
    Screenshot(Option<PathBuf>),
    /// The same to the clipboard.
    Clipboard,
    /// One file a light of the shelf.
    EachLight,
    /// One file with a picture a light of the shelf.
    ContactSheet,
    /// Numbered frames.
    Turntable,
    /// The relit splat.
    Splat(PathBuf),
}

impl Task {
    /// The settings that it is done with: a file's extension decides on its format, and a clipboard holds display values.
    fn settings(&self, settings: &ExportSettings) -> Result<ExportSettings> {
        let mut settings = settings.clone();
        match self {
            Self::Clipboard => settings.format = Format::Png8,
            Self::Screenshot(Some(path)) => {
                let extension = path.extension().unwrap_or_default().to_string_lossy();
                let format = match &*extension.to_lowercase() {
                    "png" => Format::Png8,
                    "exr" => Format::ExrHalf,
                    _ => bail!("{}: a picture is .png or .exr", path.display()),
                };
                if settings.format.is_linear() != format.is_linear() {
                    settings.format = format;
                }
            }
            _ => {}
        }
        Ok(settings)
    }
}

/// What an export made.
enum Made {
    Files(Vec<PathBuf>),
    /// Width, height, straight RGBA bytes.
    Picture([usize; 2], Vec<u8>),
}

/// Everything that an export reads, as it was when it was asked for, and what is made of it once.
struct Snapshot {
    /// Of the look's source: no target changes it.
    prepared: OnceCell<PreparedTransfer>,
    /// That on its device.
    transfer: RefCell<Option<Transfer>>,
    /// What the pinned look shows: its lights are its own.
    pinned_relit: OnceCell<Relit>,
    /// Blurred maps by light.
    maps: RefCell<HashMap<u64, Arc<EnvironmentMap>>>,
    device: BackgroundDevice,
    cloud: Arc<SurfelCloud>,
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
    let composed = match composed(session, &task) {
        Ok(composed) => composed,
        Err(error) => {
            session.error(error.to_string());
            return;
        }
    };
    // What is told of one object where the scene is several: the first that is shown.
    let of_scene = session.shown().next().filter(|_| composed.is_some());
    let at = of_scene.map_or(session.selected, |(at, ..)| at);
    let state = &session.states[at];
    let (Some(asset), Some(baked)) = (&state.asset, session.baked_of(at)) else {
        session.error("there is nothing to save yet");
        return;
    };
    let (bake, share) = (baked.bake.clone(), baked.share);
    let mut scene = session.scene.clone();
    if settings.transparent {
        scene.background = Background::Transparent;
    }
    let snapshot = Snapshot {
        prepared: OnceCell::new(),
        transfer: RefCell::default(),
        pinned_relit: OnceCell::new(),
        maps: RefCell::default(),
        device: session.background.clone(),
        cloud: asset.cloud.clone(),
        file: asset.file.clone(),
        name: asset.name(),
        pose: session.pose,
        up: session.up_of(at),
        radius: asset.bounds.radius,
        bake,
        bakes: state.whole_bakes().cloned().collect(),
        ground: session.ground().cloned(),
        hidden: {
            let hide = &session.scene.objects[at].hide;
            let skips = &session.scene.transfer.skips;
            hide.unseen(&asset.cloud, &asset.bounds, skips)
        },
        captures: vec![asset.path.clone()],
        object: at,
        is_composed: false,
        lights: [SOURCE, TARGET].map(|side| session.light(side).clone()),
        shelf: shelf
            .iter()
            .filter_map(|p| session.environments.get(p).cloned())
            .collect(),
        pinned: session.compared().cloned(),
        settings,
        scene,
    };
    let snapshot = match composed {
        Some(composed) => composed.over(session, snapshot),
        None => snapshot,
    };
    if snapshot.is_composed && session.compared().is_some() && snapshot.scene.view.has_two_sides() {
        session.info(
            "of several objects, what is saved shows the capture beside it, and not what is pinned",
        );
    }
    if share < 1.0 {
        let percent = 100.0 * share;
        session.info(format!(
            "the bake is at {percent:.0} %: the shadows of what is saved are coarse"
        ));
    }
    let waiting = shelf.iter().filter(|p| session.is_loading(p)).count();
    if waiting > 0 && matches!(task, Task::EachLight | Task::ContactSheet) {
        session.info(format!(
            "{waiting} lights of the shelf are still being read and are left out"
        ));
    }
    let label = match &task {
        Task::Splat(path) => format!("writing {}", path.display()),
        Task::Clipboard => "drawing a picture for the clipboard".into(),
        _ => "drawing pictures".to_owned(),
    };
    let work = move |handle: &Handle<Outcome>| snapshot.run(&task, handle);
    session.start(Kind::Export, label, work, |session, made| match made {
        Made::Files(paths) => session.info(saved(&paths)),
        Made::Picture(size, bytes) => session.events.push(Event::Clipboard(size, bytes)),
    });
}

/// All objects of a scene, to be saved as one.
struct Composed {
    cloud: Arc<SurfelCloud>,
    hidden: Vec<bool>,
    captures: Vec<PathBuf>,
    /// With the bake; none where nothing relit is to be saved.
    prepared: Option<(PreparedTransfer, Bake)>,
}

/// What of a scene is to be saved where it is more than an object as it was captured.
fn composed(session: &Session, task: &Task) -> Result<Option<Composed>> {
    if !session.is_composed() {
        return Ok(None);
    }
    let Some(cloud) = session.whole_cloud() else {
        bail!("no object is shown: there is nothing to save");
    };
    // As things stand now, and not as they stood before the last move.
    let prepared = session.scene_transfer().filter(|_| session.is_traced());
    let prepared = prepared.map(|(_, scene)| {
        let bake = Bake::Scene(scene.bake.clone());
        (PreparedTransfer::Scene(Arc::new(scene)), bake)
    });
    let view = session.scene.view;
    let needs_scene =
        matches!(task, Task::Splat(_)) || view.needs_relit() || view == View::Visibility;
    if needs_scene && prepared.is_none() {
        match session.scene.transfer.method {
            Method::Directional => {
                bail!("the objects are still being prepared; try again when that is done")
            }
            Method::Harmonic => bail!(
                "of several objects, preset paper is saved by the command line alone: transplat render LOOK --preset paper"
            ),
        }
    }
    let skips = &session.scene.transfer.skips;
    let hidden = session.shown().flat_map(|(_, object, asset)| {
        let mut hidden = object.hide.unseen(&asset.cloud, &asset.bounds, skips);
        hidden.resize(asset.cloud.len(), false);
        hidden
    });
    let captures = session.shown().map(|(.., a)| a.path.clone());
    Ok(Some(Composed {
        hidden: hidden.collect(),
        captures: captures.collect(),
        cloud: Arc::new(SurfelCloud {
            up: session.scene_up(),
            ..(*cloud).clone()
        }),
        prepared,
    }))
}

impl Composed {
    /// What is saved of one object, as that of all.
    fn over(self, session: &Session, one: Snapshot) -> Snapshot {
        let source = session.states[0].source.light.clone();
        let [_, target] = one.lights;
        let (prepared, bake) = match self.prepared {
            Some((prepared, bake)) => (OnceCell::from(prepared), Arc::new(bake)),
            None => (OnceCell::new(), one.bake),
        };
        Snapshot {
            prepared,
            bake,
            bakes: Vec::new(),
            cloud: self.cloud,
            hidden: self.hidden,
            captures: self.captures,
            up: session.scene_up(),
            radius: session.scene_bounds().map_or(one.radius, |b| b.radius),
            object: 0,
            is_composed: true,
            lights: [source, target],
            // It is of single objects.
            pinned: None,
            ..one
        }
    }
}

impl Snapshot {
    fn run(mut self, task: &Task, handle: &Handle<Outcome>) -> Result<Made> {
        if let Task::Splat(path) = task {
            return self.write_splat(path, handle);
        }
        let [width, height] = self.settings.size;
        let factor = self.settings.supersample;
        if width * height * factor * factor > MAX_SAMPLES {
            bail!(
                "a picture of {width} x {height} with {factor} x {factor} samples a pixel is too large; {MAX_SAMPLES} samples are possible"
            );
        }
        if self.scene.shadow_catcher && self.ground.is_none() {
            let report = |_| handle.progress(0.0);
            self.ground = Some(Ground::bake(
                &self.cloud,
                self.up,
                self.scene.directions,
                &report,
            )?);
        }
        if let Some(bake) = self.missing_bake(handle)? {
            self.bakes.push(bake);
        }
        match task {
            Task::Screenshot(Some(path)) => {
                let raster = self.picture(self.scene.view, &self.lights[TARGET])?;
                handle_step(handle, 0, 1)?;
                self.write(path, &raster)?;
                Ok(Made::Files(vec![path.clone()]))
            }
            Task::Screenshot(None) => {
                let views = match self.settings.sides {
                    ExportSides::Shown => vec![self.scene.view],
                    ExportSides::Each => vec![View::Before, View::After],
                };
                let pictures = views.into_iter().map(|view| (view, &self.lights[TARGET]));
                self.each(handle, pictures)
            }
            Task::Clipboard => {
                let raster = self.picture(self.scene.view, &self.lights[TARGET])?;
                let bytes = present::straight(&raster)
                    .iter()
                    .flatten()
                    .map(|v| (v * 255.0 + 0.5) as u8)
                    .collect();
                Ok(Made::Picture([raster.width, raster.height], bytes))
            }
            Task::EachLight => {
                self.need_shelf()?;
                let lights = self.shelf.iter();
                self.each(handle, lights.map(|light| (self.scene.view, light)))
            }
            Task::ContactSheet => self.contact_sheet(handle),
            Task::Turntable => self.turntable(handle),
            Task::Splat(_) => bail!("not a picture"),
        }
    }

    /// A picture of each view and light, by folder and pattern.
    fn each<'a>(
        &self,
        handle: &Handle<Outcome>,
        pictures: impl ExactSizeIterator<Item = (View, &'a Arc<Environment>)>,
    ) -> Result<Made> {
        let count = pictures.len();
        let mut written = Vec::new();
        for (i, (view, light)) in pictures.enumerate() {
            handle_step(handle, i, count)?;
            let raster = self.picture(view, light)?;
            handle_step(handle, i, count)?;
            let path = self.named(&light.name(), view, None);
            self.write(&path, &raster)?;
            written.push(path);
        }
        Ok(Made::Files(written))
    }

    /// The bake of a pinned look whose method has none yet.
    fn missing_bake(&self, handle: &Handle<Outcome>) -> Result<Option<Arc<Bake>>> {
        let Some(Pinned { scene, .. }) = &self.pinned else {
            return Ok(None);
        };
        let method = scene.transfer.method;
        let mut there = self.bakes.iter().chain([&self.bake]);
        if there.any(|bake| bake.method() == method) {
            return Ok(None);
        }
        let report = |done| handle.progress(done);
        let bake = Bake::new(&self.cloud, method, scene.directions, &report)?;
        Ok(Some(Arc::new(bake)))
    }

    fn need_shelf(&self) -> Result<()> {
        if self.shelf.is_empty() {
            bail!("the shelf holds no light yet; drop environments on the window first");
        }
        Ok(())
    }

    fn picture(&self, view: View, target: &Arc<Environment>) -> Result<Raster> {
        let studio = self.studio(view)?;
        let lit = self.lit(&self.scene, view, target)?;
        self.take(&studio, &self.pose, &lit)
    }

    fn take(&self, studio: &Studio, pose: &CameraPose, lit: &Lit) -> Result<Raster> {
        let camera = Camera::from_pose(pose, self.up, self.settings.size, self.radius);
        studio.take(&camera, self.settings.supersample, lit)
    }

    fn studio(&self, view: View) -> Result<Studio> {
        let linear = self.settings.format.is_linear();
        let (painter, _) = self.device.fastest().painter(&self.cloud)?;
        let mut studio = Studio::new(&self.cloud, self.scene.clone(), view, linear, painter);
        studio.hidden = self.hidden.clone();
        if view == View::Visibility {
            studio.openness = self.bake.openness().iter().map(|o| [*o; 3]).collect();
        }
        studio.ground = self.ground.clone();
        Ok(studio)
    }

    /// Relights by a target: the source's part is the same for all of them.
    fn relit(
        &self,
        scene: &Scene,
        target: &Environment,
        part: Part,
    ) -> Result<(&PreparedTransfer, Relit)> {
        let maps = [&self.lights[SOURCE].illumination, &target.illumination];
        let [source, target] = scene.lights_on(&scene.objects[self.object], maps, self.up);
        if self.prepared.get().is_none() {
            let prepared = self.prepare(scene, &source)?;
            let _ = self.prepared.set(prepared);
        }
        let prepared = self.prepared.get().context("a transfer is prepared")?;
        // A turntable of the light has many targets and one source.
        let mut transfer = self.transfer.borrow_mut();
        let transfer = match &mut *transfer {
            Some(kept) => kept,
            none => none.insert(self.device.fastest().transfer(prepared)?.0),
        };
        transfer.change_light(&target, part, &[])?;
        Ok((prepared, transfer.result()?))
    }

    fn prepare(&self, scene: &Scene, source: &Illumination) -> Result<PreparedTransfer> {
        let (cloud, settings) = (&self.cloud, &scene.transfer);
        // A pinned look may be of the other method.
        let mut bakes = [&self.bake].into_iter().chain(&self.bakes);
        let bake = bakes.find(|bake| bake.method() == settings.method);
        let bake = bake.context("the pinned look's preset is not baked")?;
        Ok(PreparedTransfer::new(cloud, bake, source, settings)?)
    }

    /// A light's map as it is seen behind the object.
    fn backdrop_map(&self, light: &Environment) -> Result<Arc<EnvironmentMap>> {
        if let Some(map) = self.maps.borrow().get(&light.id) {
            return Ok(map.clone());
        }
        let map = Arc::new(load_map(light)?.blurred(self.scene.background_blur));
        // A sheet of many lights is not to hold all their maps.
        let mut maps = self.maps.borrow_mut();
        if maps.len() >= 2 {
            maps.clear();
        }
        maps.insert(light.id, map.clone());
        Ok(map)
    }

    fn maps_of<'a>(&self, pinned: &'a Pinned) -> [&'a Illumination; 2] {
        [&pinned.sources[self.object], &pinned.environment].map(|light| &light.illumination)
    }

    /// What the lights make of the asset, for a view.
    fn lit(&self, scene: &Scene, view: View, target: &Arc<Environment>) -> Result<Lit> {
        let source = &self.lights[SOURCE];
        let object = &scene.objects[self.object];
        let maps = [&source.illumination, &target.illumination];
        let mut lit = if view.needs_relit() {
            let (prepared, relit) = self.relit(scene, target, view.part())?;
            Lit::of(view, relit, &self.cloud, &self.bake, prepared)
        } else {
            Lit::default()
        };
        if let (Some(pinned), true) = (&self.pinned, view.has_two_sides()) {
            let scene = &pinned.scene;
            if self.pinned_relit.get().is_none() {
                let object = &scene.objects[self.object];
                let [source, target] = scene.lights_on(object, self.maps_of(pinned), self.up);
                let prepared = self.prepare(scene, &source)?;
                let mut transfer = self.device.fastest().transfer(&prepared)?.0;
                transfer.change_light(&target, Part::Whole, &[])?;
                let _ = self.pinned_relit.set(transfer.result()?);
            }
            let relit = self
                .pinned_relit
                .get()
                .context("the pinned look is relit")?;
            lit.before = Some((relit.clone(), scene.display));
        }
        if let Some(ground) = &self.ground {
            lit.ground = lit_ground(ground, scene, object, maps, self.up);
        }
        if view.background(scene.background) == Background::Environment {
            let matched = scene.match_gain(object, maps);
            // Behind a pinned look is that look's light.
            let left = match &self.pinned {
                Some(pinned) if view.has_two_sides() => {
                    let scene = &pinned.scene;
                    let object = &scene.objects[self.object];
                    let gain = scene.match_gain(object, self.maps_of(pinned));
                    (&pinned.environment, &scene.environment, gain)
                }
                _ => (source, &object.source, 1.0),
            };
            let sides = [left, (target, &scene.environment, matched)];
            for (side, (light, settings, gain)) in sides.into_iter().enumerate() {
                if view.backdrops()[side] {
                    let map = self.backdrop_map(light)?;
                    lit.backdrops[side] = Some(Backdrop::new(map, settings, self.up, gain));
                }
            }
        }
        Ok(lit)
    }

    fn write(&self, path: &Path, raster: &Raster) -> Result<()> {
        if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        }
        let (width, height) = (raster.width, raster.height);
        let png = |bits| write_png(path, width, height, &present::straight(raster), bits);
        match self.settings.format {
            Format::Png8 => png(PngBits::Eight)?,
            Format::Png16 => png(PngBits::Sixteen)?,
            Format::ExrHalf => write_exr(path, raster, ExrFloats::Half)?,
            Format::ExrFloat => write_exr(path, raster, ExrFloats::Full)?,
        }
        Ok(())
    }

    /// A file's name by the pattern; one that is taken gets a number, nothing is written over.
    fn named(&self, light: &str, view: View, frame: Option<usize>) -> PathBuf {
        let view = serde_json::to_value(view).ok();
        let view = view.as_ref().and_then(|v| v.as_str()).unwrap_or("picture");
        let mut stem = self
            .settings
            .pattern
            .replace("{asset}", &self.name)
            .replace("{light}", light)
            .replace("{view}", view)
            .replace(['/', '\\'], "-");
        if let Some(frame) = frame {
            let number = format!("{frame:03}");
            if stem.contains("{n}") {
                stem = stem.replace("{n}", &number);
            } else {
                stem = format!("{stem}_{number}");
            }
        }
        let stem = stem.replace("{n}", "");
        free_name(
            Path::new(&self.settings.folder),
            &stem,
            self.settings.format.extension(),
        )
    }

    /// Pictures in rows, as wide as high about, each with its light's map in the corner.
    fn contact_sheet(&self, handle: &Handle<Outcome>) -> Result<Made> {
        self.need_shelf()?;
        let count = self.shelf.len();
        let columns = (count as f64).sqrt().ceil() as usize;
        let rows = count.div_ceil(columns);
        let [width, height] = self.settings.size;
        if width * columns * height * rows > MAX_SAMPLES {
            bail!("{count} pictures of {width} x {height} make too large a sheet; lower the size");
        }
        let blank = if self.settings.format.is_linear() {
            0.0
        } else {
            0.1
        };
        let mut sheet = Raster {
            width: width * columns,
            height: height * rows,
            pixels: vec![[blank, blank, blank, 1.0]; width * columns * height * rows],
            depth: Vec::new(),
        };
        for (i, light) in self.shelf.iter().enumerate() {
            handle_step(handle, i, count)?;
            let mut picture = self.picture(self.scene.view, light)?;
            self.add_map(&mut picture, light);
            let origin = (i / columns) * height * sheet.width + (i % columns) * width;
            for (y, row) in picture.pixels.chunks_exact(width).enumerate() {
                sheet.pixels[origin + y * sheet.width..][..width].copy_from_slice(row);
            }
        }
        let path = self.named("lights", self.scene.view, None);
        self.write(&path, &sheet)?;
        Ok(Made::Files(vec![path]))
    }

    fn add_map(&self, picture: &mut Raster, light: &Environment) {
        let edge = picture.width.min(picture.height) / 20;
        let room = picture.height - edge;
        let height = (picture.width / 8).min(room);
        let width = 2 * height;
        if width < 2 || width + edge > picture.width {
            return;
        }
        let map = EnvironmentMap::reduced(&light.small, width);
        let display = Display::default();
        for y in 0..height {
            for x in 0..width {
                let (mx, my) = (x * map.width() / width, y * map.height() / height);
                let radiance =
                    map.pixels()[my * map.width() + mx].map(|v| v * light.thumbnail_gain);
                let [r, g, b] = if self.settings.format.is_linear() {
                    radiance
                } else {
                    display.encode(radiance).map(|v| v.min(1.0))
                };
                let at = (picture.height - edge - height + y) * picture.width + edge + x;
                picture.pixels[at] = [r, g, b, 1.0];
            }
        }
    }

    fn turntable(&self, handle: &Handle<Outcome>) -> Result<Made> {
        let frames = self.settings.frames.max(1);
        let target = &self.lights[TARGET];
        let view = self.scene.view;
        let studio = self.studio(view)?;
        // The camera's turn changes no light: one relight does for all frames.
        let fixed = match self.settings.turn {
            Turn::Camera => Some(self.lit(&self.scene, view, target)?),
            Turn::Light => None,
        };
        let mut written = Vec::new();
        for frame in 0..frames {
            handle_step(handle, frame, frames)?;
            let turn = 360.0 * frame as f64 / frames as f64;
            let mut pose = self.pose;
            let turned;
            let lit = match &fixed {
                Some(lit) => {
                    pose.azimuth = wrap(pose.azimuth + turn);
                    lit
                }
                None => {
                    let mut scene = self.scene.clone();
                    scene.environment.rotation += turn;
                    turned = self.lit(&scene, view, target)?;
                    &turned
                }
            };
            let raster = self.take(&studio, &pose, lit)?;
            let path = self.named(&target.name(), view, Some(frame));
            self.write(&path, &raster)?;
            written.push(path);
        }
        Ok(Made::Files(written))
    }

    fn write_splat(&self, path: &Path, handle: &Handle<Outcome>) -> Result<Made> {
        let written = path.canonicalize().ok();
        let is_it = |capture: &PathBuf| capture.canonicalize().ok() == written;
        if path.exists() && self.captures.iter().any(is_it) {
            bail!(
                "{}: is the capture itself and would be lost; choose another name",
                path.display()
            );
        }
        let target = &self.lights[TARGET];
        let (_, relit) = self.relit(&self.scene, target, Part::Whole)?;
        handle_step(handle, 0, 1)?;
        if self.is_composed {
            let stored = relit.stored_as(self.cloud.sh_degree, Encoding::Stored);
            write_splat(&self.cloud, &stored, path)?;
        } else {
            write_relit(&self.file, &relit.stored(&self.cloud), path)?;
        }
        Ok(Made::Files(vec![path.to_owned()]))
    }
}

fn handle_step(handle: &Handle<Outcome>, done: usize, of: usize) -> Result<()> {
    if handle.progress(done as f64 / of as f64).is_break() {
        bail!("cancelled");
    }
    Ok(())
}

/// For the user.
fn saved(paths: &[PathBuf]) -> String {
    match paths {
        [one] => format!("saved {}", one.display()),
        [first, .., last] => format!(
            "saved {} pictures, {} to {}",
            paths.len(),
            first.display(),
            last.file_name().unwrap_or_default().to_string_lossy()
        ),
        [] => "nothing was saved".into(),
    }
}

/// `folder/stem.extension`, or with the first number that is free.
pub fn free_name(folder: &Path, stem: &str, extension: &str) -> PathBuf {
    let plain = folder.join(format!("{stem}.{extension}"));
    if !plain.exists() {
        return plain;
    }
    (2..)
        .map(|i| folder.join(format!("{stem}-{i}.{extension}")))
        .find(|p| !p.exists())
        .unwrap_or(plain)
}
