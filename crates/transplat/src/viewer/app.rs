//! State of the window, files and drops.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use eframe::egui;
use transplat_core::camera::CameraPose;
use transplat_core::files::{FileKind, SplatFormat, check_folder, file_kind, file_of, load_look};
use transplat_core::scene::{ESTIMATE, EVEN, Scene, is_file};
use transplat_core::settings::optimizations::{Optimization, SkippedWork, Stage};
use transplat_gpu::Context;

use super::bookmarks::Thumbnails;
use super::document::{NextScene, SceneDocument};
use super::export;
use super::export::task::{ExportSettings, Task};
use super::files::{PathField, ask};
use super::history::History;
use super::light_library::LightLibrary;
use super::light_map::LightMap;
use super::preferences::Preferences;
use super::probes::ProbeBall;
use super::questions::Question;
use super::session::{Dialog, Event, SaveKind, Session};
use super::style;
use super::tabs::LightPage;
use super::timeline::Timeline;
use super::viewport::Viewport;
use super::widgets::Grab;
use transplat_engine::bundled::{BUNDLED_FIRST_LIGHT, BUNDLED_LIGHTS, BUNDLED_SPLAT, bundled};
use transplat_engine::delight::DelitAs;
use transplat_engine::environments::{environments_in, not_environments};
use transplat_engine::language::{tr, tr_format};
use transplat_engine::project::{SOURCE, TARGET};
use transplat_engine::splat::OpenedWith;
use transplat_engine::words::of_error;
use transplat_eval::savings::Saved;

/// True for a look that names its splats.
fn has_objects(scene: &Scene) -> bool {
    scene.objects.iter().any(|object| object.asset.is_some())
}

/// Where the preferences are kept.
pub(super) const STORAGE_KEY: &str = "preferences";

/// Seconds that a drop waits for the pointer's position.
const DROP_WAIT_S: f64 = 0.15;

/// Height in pixels of a screen that is called large, and how much larger text is there.
const LARGE_SCREEN: f32 = 1400.0;
const LARGE_TEXT: f32 = 1.25;

/// Points of the screen that the window's frame and a task bar need.
const SCREEN_MARGIN: egui::Vec2 = egui::vec2(0.0, 64.0);

/// Files and settings that the viewer opens with.
#[derive(Default)]
pub struct Startup {
    /// Splats, environments, folders and looks in any order.
    pub files: Vec<PathBuf>,
    /// Puts the settings of the command line over those that were kept.
    pub settings: Option<Box<dyn FnOnce(Scene) -> Scene>>,
    /// A saved bake of the splat.
    pub bake: Option<PathBuf>,
    /// Where the work is kept for the next start.
    pub work: Option<PathBuf>,
    /// True where bakes are saved beside their splats for now, whatever the preferences say.
    pub bakes_beside: bool,
    /// Where compiled pipelines are kept.
    pub pipelines: Option<PathBuf>,
    /// Gets what ended the window against the user's will.
    pub fatal: Arc<Mutex<Option<String>>>,
}

/// Panels beside the viewport that are open.
#[derive(Default)]
pub struct Shown {
    pub help: bool,
    pub about: bool,
    pub panels: bool,
    /// Page of the panel Light.
    pub light: LightPage,
    pub path_field: Option<PathField>,
}

/// Fate of exports when the window is to be closed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Quitting {
    /// When the window was to be closed.
    pub since: Instant,
    /// True once the exports are awaited; until then the window asks.
    pub waits: bool,
}

/// The viewer.
pub struct Viewer {
    /// Project, and the state of its window.
    pub session: Session,
    pub(super) preferences: Preferences,
    pub(super) viewport: Viewport,
    pub(super) directions_draft: Option<usize>,
    pub(super) light_library: LightLibrary,
    /// Thumbnails of kept looks and views.
    pub(super) pictures: Thumbnails,
    pub(super) history: History,
    pub(super) probes: [Option<ProbeBall>; 2],
    pub(super) maps: [LightMap; 2],
    pub(super) rig_map: LightMap,
    pub(super) timeline: Timeline,
    /// Rotation and tilt of the lights when a probe ball was grabbed.
    pub(super) grabbed_balls: [Grab<(f64, f64)>; 4],
    pub(super) shown: Shown,
    /// Files that were opened by the user and are not known to be good yet.
    pub(super) unproven: Vec<PathBuf>,
    pub(super) dropped: Vec<PathBuf>,
    pub(super) dropped_at: f64,
    /// Splats that were opened with another one, to be put beside it once that is there.
    pub(super) to_add: Vec<PathBuf>,
    /// Files that wait for a question or for a scene that is opened.
    pub(super) to_open: Vec<PathBuf>,
    pub(super) clipboard: Option<arboard::Clipboard>,
    pub(super) lost: bool,
    pub(super) quitting: Option<Quitting>,
    /// True where work that relighting needs was cancelled.
    pub(super) is_stopped: bool,
    pub(super) settings_for_once: bool,
    /// A picture as it would be saved.
    pub(super) preview: Option<egui::TextureHandle>,
    /// Scene and camera of the last preview, and of the next one.
    pub(super) previewed: Option<(Scene, CameraPose)>,
    asked_preview: Option<(Scene, CameraPose)>,
    /// Question that waits for its answer.
    pub(super) question: Option<Question>,
    /// File of the work.
    pub(super) document: SceneDocument,
    /// Lights that the sides had when they were last put on the shelf.
    pub(super) last_lights: [u64; 2],
    /// Where the look is kept should the device be lost.
    pub recovery: Option<PathBuf>,
    /// Where the work is kept for the next start, and what of it was last.
    pub(super) work: Option<PathBuf>,
    pub(super) kept_work: Option<Scene>,
    pub(super) fatal: Arc<Mutex<Option<String>>>,
    pub(super) title: String,
    /// True where no settings of an earlier start were found.
    is_first_start: bool,
    /// When there is to be a frame at the latest, so that the work is kept.
    pub(super) keeps_at: Option<Instant>,
    /// True once the window was fitted to the screen.
    is_fitted: bool,
}

impl Viewer {
    /// A viewer in a window.
    ///
    /// # Errors
    /// The window was not made with wgpu.
    pub fn new(
        cc: &eframe::CreationContext<'_>,
        startup: Startup,
    ) -> Result<Self, Box<dyn std::error::Error + Send + Sync>> {
        let state = cc
            .wgpu_render_state
            .as_ref()
            .ok_or("the window has no wgpu")?;
        let (device, queue) = (state.device.clone(), state.queue.clone());
        let context = Context::from_device(&state.adapter, device, queue);
        let context = Arc::new(context.with_pipelines_in(startup.pipelines.as_deref()));
        style::apply(&cc.egui_ctx);
        let kept = cc.storage.and_then(|s| s.get_string(STORAGE_KEY));
        let is_first_start = kept.is_none();
        // What an older or newer program kept differently is left.
        let preferences: Preferences = kept
            .and_then(|text| serde_json::from_str(&text).ok())
            .unwrap_or_default();
        let egui = cc.egui_ctx.clone();
        let mut session = Session::new(
            context,
            state.target_format,
            Arc::new(move |after| egui.request_repaint_after(after)),
            preferences.scene(),
        );
        session.overlays.grid = preferences.grid;
        session.project.bakes_are_beside = preferences.bakes_beside || startup.bakes_beside;
        let mut viewer = Self {
            light_library: LightLibrary::default(),
            session,
            viewport: Viewport::default(),
            directions_draft: None,
            pictures: Thumbnails::default(),
            history: History::default(),
            probes: [None, None],
            maps: Default::default(),
            rig_map: LightMap::default(),
            timeline: Timeline::default(),
            grabbed_balls: Default::default(),
            shown: Shown {
                panels: true,
                light: LightPage::RelitBy,
                ..Shown::default()
            },
            unproven: Vec::new(),
            dropped: Vec::new(),
            dropped_at: 0.0,
            to_add: Vec::new(),
            to_open: Vec::new(),
            clipboard: None,
            lost: false,
            quitting: None,
            is_stopped: false,
            settings_for_once: false,
            preview: None,
            previewed: None,
            asked_preview: None,
            question: None,
            document: SceneDocument::default(),
            last_lights: [0; 2],
            recovery: directories::ProjectDirs::from("", "", "transplat")
                .map(|d| d.cache_dir().join("recovered_look.json")),
            work: startup.work.clone(),
            kept_work: None,
            fatal: startup.fatal.clone(),
            title: String::new(),
            is_first_start,
            keeps_at: None,
            is_fitted: false,
            preferences,
        };
        // What is spoken before is English.
        if let Some(language) = viewer.preferences.language.take() {
            viewer.speak(Some(language));
        }
        viewer.first_scene(startup);
        Ok(viewer)
    }

    fn first_scene(&mut self, mut startup: Startup) {
        for file in &mut startup.files {
            let whole = std::path::absolute(&*file).unwrap_or_else(|_| file.clone());
            *file = file_of(&whole).into_owned();
        }
        let lights = BUNDLED_LIGHTS.iter().filter_map(|name| bundled(name));
        let lights: Vec<PathBuf> = lights.collect();
        let kept = self.preferences.light_library.clone();
        for path in kept.as_ref().unwrap_or(&lights) {
            // What is on a disk that is not there now comes back with it.
            if path.is_file() {
                self.light_library.add(&mut self.session, path);
            } else {
                self.light_library.absent.push(path.clone());
            }
        }
        let is_named = !startup.files.is_empty() || startup.settings.is_some();
        if is_named || startup.bake.is_some() {
            self.set_work_aside();
        } else if self.restore_work() {
            return;
        }
        let mut scene = self.session.project.scene.clone();
        self.settings_for_once = startup.settings.is_some();
        if let Some(settings) = startup.settings {
            scene = settings(scene);
        }
        let camera = scene.camera.take();
        for light in scene.environment_lights_mut() {
            if let Some(file) = light.file.as_mut().filter(|f| is_file(f)) {
                *file = std::path::absolute(&*file).unwrap_or_else(|_| file.clone());
            }
        }
        self.session.state_mut().saved_bake = startup.bake;
        let is = |file: &PathBuf, test: fn(FileKind) -> bool| file_kind(file).is_ok_and(test);
        let is_look = |kind| kind == FileKind::Look;
        let mut files = startup.files.iter();
        let splat = files.find(|f| is(f, FileKind::is_splat)).cloned();
        if splat.is_none() && scene.objects.len() > 1 {
            let assets = scene.objects.iter().filter_map(|o| o.asset.clone());
            self.unproven.extend(assets);
            self.session.apply(Scene { camera, ..scene });
            for file in startup.files {
                self.open(&file);
            }
            return;
        }
        // A look beside a splat is for that splat.
        scene.objects.truncate(1);
        let by_look = startup.files.iter().any(|f| is(f, is_look));
        let is_explicit = scene.objects[self.session.selected].asset.is_some();
        let nothing_named = splat.is_none() && !is_explicit && !by_look;
        let first = match nothing_named {
            true => bundled(BUNDLED_FIRST_LIGHT),
            false => lights.get(1).cloned(),
        };
        let first = first.unwrap_or_else(|| EVEN.into());
        scene.environment.file.get_or_insert(first);
        let object = &mut scene.objects[self.session.selected];
        // The light is known only where somebody tells it, as for the bundled scene.
        let known = lights.first().filter(|_| nothing_named).cloned();
        let source = known.unwrap_or_else(|| ESTIMATE.into());
        object.source.file.get_or_insert(source);
        let asset = splat.clone().or(object.asset.take());
        let opened_with = OpenedWith::Object(Box::new(object.clone()), camera);
        self.session.project.scene = scene;
        if let Some(asset) = &asset {
            self.unproven.push(asset.clone());
        }
        match asset.or_else(|| bundled(BUNDLED_SPLAT).filter(|_| nothing_named)) {
            Some(asset) => {
                (self.session)
                    .project
                    .load_splat(self.session.selected, asset, opened_with)
            }
            None if nothing_named => self.session.error(tr(
                "The bundled scene is not installed. Drop a splat on the window.",
            )),
            None => {}
        }
        for file in startup.files {
            match (&splat, load_look(&file)) {
                (Some(own), _) if *own == file => {}
                (Some(_), _) if is(&file, FileKind::is_splat) => self.to_add.push(file),
                (Some(_), Ok(mut scene)) if is(&file, is_look) => {
                    scene.objects.truncate(1);
                    scene.objects[0].asset = None;
                    self.session.apply(scene);
                }
                _ => self.open(&file),
            }
        }
    }

    // ---- files ----

    /// Opens a file or a folder of environments, as if it had been dropped.
    pub fn open(&mut self, path: &Path) {
        let path = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        if self.question.is_some() || self.document.coming.is_some() {
            // One after the other.
            return self.to_open.push(path);
        }
        // A folder may be a splat, or hold cameras.
        let path = file_of(&path).into_owned();
        let kind = file_kind(&path);
        if path.is_dir() && kind.is_err() {
            match environments_in(&path) {
                Ok(inside) if inside.is_empty() => self.session.error(tr_format!(
                    "{}: no environments (.hdr, .exr) in this folder.",
                    path.display()
                )),
                Ok(inside) => {
                    for light in inside {
                        self.light_library.add(&mut self.session, &light);
                    }
                    if let Some(skipped) = not_environments(&path) {
                        self.session.info(skipped);
                    }
                }
                Err(error) => self.session.error(of_error(&error)),
            }
            return;
        }
        if let Ok(kind) = kind {
            self.unproven.push(path.clone());
            if kind == FileKind::Look {
                if load_look(&path).is_ok_and(|scene| has_objects(&scene)) {
                    return self.replace_scene(NextScene::Look(path));
                }
                // What waits belongs to the scene before.
                self.to_add.clear();
            }
            if kind.is_splat() {
                let is_one_of_several = self.session.project.scene.objects.len() > 1;
                if is_one_of_several && !self.session.adds_splats {
                    self.question = Some(Question::AddOrReplace(path));
                    return;
                }
                if !self.session.adds_splats {
                    self.autosave();
                }
            }
            if kind.is_environment() {
                self.session.project.environments.request_again(&path);
                self.light_library.add(&mut self.session, &path);
            }
        }
        self.session.open(&path);
    }

    pub(super) fn open_dropped(&mut self, context: &egui::Context) {
        let now = context.input(|i| i.time);
        let dropped = context.input(|i| i.raw.dropped_files.clone());
        if !dropped.is_empty() {
            self.dropped
                .extend(dropped.iter().map(|f| f.path().to_owned()));
            self.dropped_at = now;
        }
        if self.dropped.is_empty() {
            return;
        }
        // The system tells where the pointer is only after the drop.
        let moved = context.input(|i| i.pointer.delta() != egui::Vec2::ZERO);
        if !moved && now - self.dropped_at < DROP_WAIT_S {
            context.request_repaint_after_secs(0.05);
            return;
        }
        let at = context.pointer_latest_pos();
        let slot = [SOURCE, TARGET].into_iter().find(|side| {
            self.light_library.slots[*side]
                .zip(at)
                .is_some_and(|(rect, at)| rect.contains(at))
        });
        let dropped = std::mem::take(&mut self.dropped).into_iter();
        let is_light = |path: &PathBuf| file_kind(path).is_ok_and(FileKind::is_environment);
        let (lights, others): (Vec<_>, Vec<_>) =
            dropped.partition(|path| slot.is_some() && is_light(path));
        // A splat first: the light of the capture is told for it.
        self.open_all(others);
        for (path, side) in lights.into_iter().zip(slot.into_iter().cycle()) {
            self.session.project.environments.request_again(&path);
            self.light_library.add(&mut self.session, &path);
            self.session.set_light(side, path);
        }
    }

    /// Opens what is opened together: splats are put beside the first of them.
    pub fn open_all(&mut self, paths: Vec<PathBuf>) {
        let mut has_splat = false;
        for path in paths {
            let path = std::path::absolute(&path).unwrap_or(path);
            let is_splat = file_kind(&path).is_ok_and(FileKind::is_splat);
            match is_splat && has_splat {
                true => self.to_add.push(path),
                false => self.open(&path),
            }
            has_splat |= is_splat;
        }
    }

    /// Fits the window to the screen, and on a large screen that the system does not scale makes the text of the first start larger.
    pub(super) fn fit_screen(&mut self, context: &egui::Context) {
        let (screen, is_free) = context.input(|i| {
            let viewport = i.viewport();
            let fills = [viewport.maximized, viewport.fullscreen];
            (viewport.monitor_size, !fills.contains(&Some(true)))
        });
        let Some(screen) = screen.filter(|_| !self.is_fitted) else {
            return;
        };
        self.is_fitted = true;
        let scale = context.pixels_per_point();
        if self.is_first_start && scale == 1.0 && screen.y >= LARGE_SCREEN {
            context.set_zoom_factor(LARGE_TEXT);
        }
        let (size, room) = (context.content_rect().size(), screen - SCREEN_MARGIN);
        if is_free && (size.x > room.x || size.y > room.y) {
            context.send_viewport_cmd(egui::ViewportCommand::InnerSize(size.min(room)));
        }
    }

    /// Puts the next of the splats that were opened together into the scene.
    pub(super) fn add_next(&mut self) {
        if self.question.is_some() || self.session.project.is_loading_asset() {
            return;
        }
        if self.document.coming.is_none() && !self.to_open.is_empty() {
            let path = self.to_open.remove(0);
            return self.open(&path);
        }
        if self.to_add.is_empty() {
            return;
        }
        let path = self.to_add.remove(0);
        match self.session.project.has_asset() {
            true => {
                self.unproven.push(path.clone());
                self.session.project.add_beside(path);
            }
            false => self.open(&path),
        }
    }

    /// Writes to a file that the user named: never over what is open, and over anything else only when `replace` says so.
    pub(super) fn save_to(&mut self, path: &Path, kind: SaveKind, replace: bool) {
        match kind {
            SaveKind::Folder if path.is_file() => {
                let why = tr("This is a file. Choose a folder.");
                return self.session.error(format!("{}: {why}", path.display()));
            }
            SaveKind::Folder => {
                if let Err(error) = check_folder(path) {
                    return self.session.error(error.to_string());
                }
                self.preferences.export.folder = path.display().to_string();
                return;
            }
            SaveKind::Backplate => return self.session.project.set_backplate(path.to_owned()),
            SaveKind::Lut => return self.session.project.open_lut(path.to_owned()),
            SaveKind::OpenRig => return self.session.open_rig(path),
            _ => {}
        }
        if path.is_dir() {
            let why = tr("This is a folder. Enter a file name.");
            self.session.error(format!("{}: {why}", path.display()));
            return;
        }
        // A picture's name may say another format.
        let (wanted, may_differ) = match kind {
            SaveKind::Look | SaveKind::Rig => ("json", false),
            SaveKind::Environment => ("exr", transplat_core::files::is_environment_name(path)),
            SaveKind::Splat | SaveKind::Delit => {
                (self.splat_ending(), SplatFormat::of_name(path).is_some())
            }
            _ => (self.preferences.export.format.extension(), true),
        };
        let asked = path;
        let path = match path.extension() {
            Some(e) if may_differ || e.eq_ignore_ascii_case(wanted) => path.to_owned(),
            _ => path.with_added_extension(wanted),
        };
        let project = &self.session.project;
        if let Err(why) = project.check_not_open(&path, &self.light_library.paths) {
            self.session.error(why.to_string());
        } else if path.exists() && !(replace && path == asked) {
            self.question = Some(Question::Overwrite(path, kind));
        } else {
            match kind {
                SaveKind::Look => self.save_look(&path),
                SaveKind::Rig => self.session.save_rig(&path),
                SaveKind::Environment => self.session.save_environment(path),
                SaveKind::Splat => self.export(Task::Splat(path)),
                SaveKind::Delit => self.export(Task::Delit(path)),
                _ => self.export(Task::Screenshot(Some(path))),
            }
        }
    }

    fn save_look(&mut self, path: &Path) {
        match transplat_core::files::save_look(path, &self.session.project.scene_to_save()) {
            Ok(()) => {
                self.preferences.remember(path);
                self.document.path = Some(path.to_owned());
                let scene = self.session.project.scene_as_step().into_owned();
                self.document.note_saved(&scene);
                self.session.info(tr_format!("Saved {}.", path.display()));
                self.show_what_waited();
            }
            Err(error) => self.session.error(error.to_string()),
        }
    }

    pub(super) fn asset_name(&self) -> String {
        if self.session.project.scene.objects.len() > 1 {
            return self.document_name();
        }
        let asset = self.session.asset();
        asset.map_or_else(|| "splat".into(), |a| a.name())
    }

    /// Asks where a look or a splat is to be saved.
    pub(super) fn ask_where(&mut self, kind: SaveKind, extension: &str) {
        let asset = self.asset_name();
        let of = match (kind, self.preferences.export.delit_as) {
            (SaveKind::Delit, DelitAs::Albedo) => "albedo".into(),
            (SaveKind::Delit, DelitAs::Even) => "even".into(),
            _ => self.session.light(TARGET).name(),
        };
        let name = match kind {
            SaveKind::Look => format!("{}.{extension}", self.document_name()),
            _ => format!("{asset}_{of}.{extension}"),
        };
        ask(&mut self.session, Dialog::Save(kind, name));
    }

    /// Ending of a relit splat's file: by the chosen format, or as the capture came.
    pub(super) fn splat_ending(&self) -> &'static str {
        let own = self.session.asset().map(|asset| asset.file.format);
        let own = own.filter(|_| self.session.project.scene.objects.len() == 1);
        let format = self.preferences.export.splat.or(own);
        let ending = format.and_then(SplatFormat::ending);
        ending.map_or("ply", |ending| &ending[1..])
    }

    /// Starts an export.
    pub fn export(&mut self, task: Task) {
        let settings = self.preferences.export.clone();
        if matches!(task, Task::Preview) {
            let session = &self.session;
            self.asked_preview = Some((session.project.scene.clone(), session.project.pose));
        }
        export::start(
            &mut self.session,
            &self.light_library.paths,
            &settings,
            task,
        );
    }

    /// The settings of exports.
    pub fn export_settings(&mut self) -> &mut ExportSettings {
        &mut self.preferences.export
    }

    pub(super) fn deal_with(&mut self, context: &egui::Context, event: Event) {
        match event {
            Event::Files(paths) => {
                self.open_all(paths);
            }
            // The dialog has asked.
            Event::SaveTo(path, kind) => self.save_to(&path, kind, true),
            Event::NoLight(path) => self.light_library.forget(&path),
            Event::PictureSize(size) => self.preferences.export.size = size,
            Event::Light(path) => self.light_library.add(&mut self.session, &path),
            Event::NoDialog(dialog) => {
                let folder = self.session.folder_of(&dialog);
                self.shown.path_field = Some(PathField::of(dialog, &folder));
            }
            Event::Clipboard(size, bytes) => self.copy(size, bytes),
            Event::Preview(size, bytes) => {
                let picture = egui::ColorImage::from_rgba_unmultiplied(size, &bytes);
                let options = egui::TextureOptions::LINEAR;
                self.preview = Some(context.load_texture("preview", picture, options));
                self.previewed = self.asked_preview.clone();
            }
        }
    }

    fn copy(&mut self, [width, height]: [usize; 2], bytes: Vec<u8>) {
        // The clipboard's owner serves it: it lives as long as the window.
        if self.clipboard.is_none() {
            self.clipboard = arboard::Clipboard::new().ok();
        }
        let image = arboard::ImageData {
            width,
            height,
            bytes: bytes.into(),
        };
        let copied = self.clipboard.as_mut().map(|c| c.set_image(image));
        match copied {
            Some(Ok(())) => self.session.info(tr_format!(
                "Copied {width} x {height} pixels.",
                width = width,
                height = height
            )),
            Some(Err(error)) => self.session.error(tr_format!(
                "Could not copy the image: {error}",
                error = error
            )),
            None => self.session.error(tr(
                "Could not copy: no clipboard is available. Save the image instead (F12).",
            )),
        }
    }

    /// Adds files to the recent ones once they have proven good.
    pub(super) fn remember_opened(&mut self) {
        for path in std::mem::take(&mut self.session.opened) {
            if self.unproven.contains(&path) {
                self.unproven.retain(|p| *p != path);
                self.preferences.remember(&path);
            }
        }
    }

    /// Adds the lights of both sides to the shelf.
    pub(super) fn store_lights(&mut self) {
        for side in [SOURCE, TARGET] {
            let light = &self.session.light(side);
            if light.is_file() && self.last_lights[side] != light.id {
                self.last_lights[side] = light.id;
                let path = light.path.clone();
                self.light_library.add(&mut self.session, &path);
            }
        }
    }

    // ---- what tests read ----

    /// The lights on the shelf.
    pub fn light_library(&self) -> &[PathBuf] {
        &self.light_library.paths
    }

    /// Work that this scene did not need, with the reasons.
    pub fn skipped_work(&self) -> Vec<SkippedWork> {
        let session = &self.session;
        let mut out = Vec::new();
        if session.asset().is_none() {
            return out;
        }
        let state = session.state();
        out.extend(state.hidden.get().and_then(|h| SkippedWork::of_unseen(h)));
        if session.source_is_assumed() {
            out.push(SkippedWork::exact(
                Stage::Project,
                tr("projecting the capture light"),
                tr("its light is uniform"),
            ));
        }
        let baked = session.baked();
        if baked.is_some_and(|b| b.file.is_some() && b.ms < 1000.0)
            && session.project.stages.bake <= 1
        {
            out.push(SkippedWork::exact(
                Stage::Bake,
                tr("bake"),
                tr("a saved one is used"),
            ));
        } else if let Some(baked) = baked {
            out.extend(baked.bake.skipped_work());
        }
        if let Some(made) = state.prepared.get() {
            out.extend(made.skipped_work.iter().cloned());
            let [_, target] = session.oriented_lights();
            out.extend(made.prepared.skipped_work_for(&target.light, made.on_gpu));
        }
        out
    }

    /// Why something was left out, and what that saved: as it was measured on this object, or else estimated from what the stage took.
    pub fn skipped_work_in_words(&self, skipped: &SkippedWork) -> String {
        let method = self.session.project.scene.transfer.method;
        let is_it = |s: &&Saved| s.skipped.skip == skipped.skip && s.method == method;
        let measured = self.session.measured().into_iter();
        let mut measured = measured.flat_map(|m| &m.saved);
        // What is hidden has changed since.
        let is_kept = skipped.skip.is_some_and(|s| s != Optimization::Unseen);
        match measured.find(is_it).filter(|_| is_kept) {
            Some(saved) => format!("{}; {}", skipped.why, saved.in_words()),
            None => skipped.in_words(self.stage_ms(skipped.stage)),
        }
    }

    /// Milliseconds that the stage of something left out took when it last ran.
    fn stage_ms(&self, stage: Stage) -> Option<f64> {
        let session = &self.session;
        match stage {
            Stage::Bake => session.baked().map(|b| b.ms),
            Stage::Transfer => Some(session.transfer_ms()),
            Stage::Prepare => session.state().prepared.get().map(|p| p.ms),
            Stage::Project => None,
        }
    }

    /// A device that is gone takes the window with it; the look is kept.
    pub(super) fn check_device(&mut self, context: &egui::Context) {
        if self.lost || !self.session.canvas.context.is_lost() {
            return;
        }
        self.lost = true;
        let kept = self.recovery.clone().filter(|path| {
            let folder = path.parent();
            let made = folder.is_none_or(|f| std::fs::create_dir_all(f).is_ok());
            made && transplat_core::files::save_look(path, &self.session.project.scene_to_save())
                .is_ok()
        });
        let mut text =
            tr("The graphics driver stopped: it was updated or reset, or ran out of memory")
                .to_owned();
        if let Some(path) = kept {
            text += &tr_format!(
                ". Your work is saved in {}: restart and open that file.",
                path.display()
            );
            self.preferences.remember(&path);
        }
        *self.fatal.lock().unwrap_or_else(|p| p.into_inner()) = Some(text);
        context.send_viewport_cmd(egui::ViewportCommand::Close);
    }
}
