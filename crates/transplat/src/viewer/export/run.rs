//! Running exports.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use transplat_core::camera::{Camera, CameraPose};
use transplat_core::files::folder_of;
use transplat_core::present::{self, Background, View};
use transplat_core::progress::{Progress, tell};
use transplat_core::rasterize::Raster;
use transplat_core::scene::{FixedTo, MOST_FRAMES, Scene};
use transplat_core::transfer::Part;

use super::task::{ExportResult, ExportSettings, ExportSides, Task, Turn};
use crate::viewer::navigation::wrap;
use crate::viewer::session::{Session, SessionChange};
use transplat_engine::delight::Delit;
use transplat_engine::environments::Environment;
use transplat_engine::jobs::Handle;
use transplat_engine::language::{tr, tr_format};
use transplat_engine::output::{ImageFormat, Sink, free_name, make_folder};
use transplat_engine::project::Project;
use transplat_engine::render::{Lit, Studio};
use transplat_engine::shot::{Shots, save_layers};
use transplat_engine::splat::Splat;

/// An export that was asked for: a copy of the project as it was then, and how it is saved.
pub struct Export {
    project: Project,
    /// The pinned look that it is compared with.
    pinned: Option<Project>,
    /// The object that it is named after.
    name: String,
    light_library: Vec<Arc<Environment>>,
    settings: ExportSettings,
}

impl Export {
    /// Takes the project as it is now.
    ///
    /// # Errors
    /// There is nothing to save yet.
    pub fn of(
        session: &mut Session,
        light_library: &[PathBuf],
        settings: ExportSettings,
        task: &Task,
    ) -> Result<Self> {
        let project = &session.project;
        project.check_loaded()?;
        if let Task::Splat(path) | Task::Delit(path) | Task::Screenshot(Some(path)) = task {
            project.check_not_open(path, light_library)?;
        }
        let first = project.shown().next().map(|(at, ..)| at);
        let at = match task {
            Task::Delit(_) => session.selected,
            _ if !project.has_asset() => session.selected,
            _ => first.context(tr("No object is visible, so there is nothing to save."))?,
        };
        let asset = project.states[at].asset.as_ref();
        let Some((asset, baked)) = asset.zip(project.baked_of(at)) else {
            bail!(tr("There is nothing to save yet."));
        };
        let (name, share) = (asset.name(), baked.share);
        let is_delit = matches!(task, Task::Delit(_));
        let is_composed = project.is_composed() && !is_delit;
        let view = project.scene.view;
        let is_each = *task == Task::Screenshot(None) && settings.sides == ExportSides::Each;
        let is_relit = is_each || matches!(task, Task::Splat(_)) || view.needs_relit();
        let is_layered = settings.format == ImageFormat::ExrLayers;
        if is_layered && task.is_of_images() && !is_each && view != View::After {
            bail!(tr("Layers need the relit image. Choose After."));
        }
        let needs_scene = is_composed && (is_relit || view == View::Visibility);
        if needs_scene && project.scene_transfer_of_now().is_none() {
            bail!(tr(
                "The objects are still being prepared. Try again when that is done."
            ));
        }
        let mut copy = match is_delit {
            true => project.copy_of_object(at),
            false => project.copy(),
        };
        let is_compared = !is_delit && view.has_two_sides();
        let pinned = is_compared.then(|| project.copy_of_pinned()).flatten();
        let is_clear = match settings.format {
            ImageFormat::ExrLayers => copy.scene.background != Background::Backplate,
            _ => settings.transparent,
        };
        if is_clear {
            copy.scene.background = Background::Transparent;
        }
        let known = light_library
            .iter()
            .filter_map(|p| project.environments.get(p).cloned());
        let light_library = known.collect();
        if project.is_estimating(at) {
            session.info(tr(
                "The capture light is still being estimated: saved images use an assumed one.",
            ));
        }
        if share < 1.0 {
            let percent = 100.0 * share;
            session.info(tr_format!(
                "The bake is at {percent:.0} %: saved shadows are coarse.",
                percent = percent
            ));
        }
        Ok(Self {
            project: copy,
            pinned,
            name,
            light_library,
            settings,
        })
    }

    /// For the list of jobs.
    pub fn label(&self, task: &Task) -> String {
        let (name, light) = (&self.name, self.project.environment.light.name());
        let lights = self.light_library.len();
        let file = |path: &Path| {
            let name = path.file_name().unwrap_or(path.as_os_str());
            name.to_string_lossy().into_owned()
        };
        match task {
            Task::Screenshot(Some(path)) => tr_format!("image {}", file(path)),
            Task::Screenshot(None) => {
                tr_format!("image of {name}, {light}", name = name, light = light)
            }
            Task::Clipboard => tr_format!("image of {name} for the clipboard", name = name),
            Task::Preview => tr_format!("preview of {name}, {light}", name = name, light = light),
            Task::EachLight => {
                tr_format!(
                    "{lights} images of {name}, one per light",
                    lights = lights,
                    name = name
                )
            }
            Task::ContactSheet => {
                tr_format!(
                    "contact sheet of {name}, {lights} lights",
                    name = name,
                    lights = lights
                )
            }
            Task::Turntable => {
                let as_what = self.settings.video.map_or(tr("images"), |_| tr("video"));
                let frames = self.settings.frames;
                tr_format!(
                    "turntable of {name}, {frames} frames, {as_what}",
                    name = name,
                    frames = frames,
                    as_what = as_what
                )
            }
            Task::Animation => tr_format!("light animation of {name}", name = name),
            Task::Splat(path) => tr_format!("relit splat {}", file(path)),
            Task::Delit(path) => tr_format!("delit splat {}", file(path)),
        }
    }
}

/// An export that runs.
pub(super) struct ExportRun<'a> {
    pub shots: Shots,
    pub light_library: Vec<Arc<Environment>>,
    pub settings: ExportSettings,
    name: String,
    handle: &'a Handle<SessionChange>,
}

impl<'a> ExportRun<'a> {
    /// Has the project of an export ready.
    ///
    /// # Errors
    /// Nothing is shown, or the look that it is compared with cannot be relit.
    pub fn of(export: Export, handle: &'a Handle<SessionChange>) -> Result<Self> {
        let watched = |mut project: Project| {
            project.set_watch(handle.watch());
            project
        };
        let mut shots = Shots::of(watched(export.project))?;
        if let Some(look) = export.pinned {
            let is_linear = export.settings.format.is_linear();
            shots.set_before(watched(look), is_linear)?;
        }
        Ok(Self {
            shots,
            light_library: export.light_library,
            settings: export.settings,
            name: export.name,
            handle,
        })
    }

    /// Makes what a task asks for, but for a contact sheet.
    pub fn make(&mut self, task: &Task) -> Result<ExportResult> {
        let view = self.shots.project.scene.view;
        let target = self.shots.project.environment.light.clone();
        match task {
            Task::Splat(path) => self.write_splat(path),
            Task::Delit(path) => self.write_delit(path),
            Task::Screenshot(Some(path)) => {
                self.save(path, view, &self.step(0, 1))?;
                Ok(ExportResult::Files(vec![path.clone()]))
            }
            Task::Screenshot(None) => {
                let views = match self.settings.sides {
                    // Layers are of what is relit alone.
                    ExportSides::Each if self.settings.format == ImageFormat::ExrLayers => {
                        vec![View::After]
                    }
                    ExportSides::Shown => vec![view],
                    ExportSides::Each => vec![View::Before, View::After],
                };
                self.each(views.into_iter().map(|view| (view, target.clone())))
            }
            Task::Clipboard | Task::Preview => {
                let raster = self.picture(view, &self.step(0, 1))?;
                let bytes = present::straight(&raster)
                    .iter()
                    .flatten()
                    .map(|v| (v * 255.0 + 0.5) as u8)
                    .collect();
                let size = [raster.width, raster.height];
                Ok(match task {
                    Task::Preview => ExportResult::Preview(size, bytes),
                    _ => ExportResult::Picture(size, bytes),
                })
            }
            Task::EachLight => {
                self.need_lights()?;
                let lights = self.light_library.clone();
                self.each(lights.into_iter().map(|light| (view, light)))
            }
            Task::Turntable => {
                let frames = self.settings.frames.max(1);
                let turn = |frame| 360.0 * frame as f64 / frames as f64;
                // The camera's turn changes no light but those that are fixed to it: one relight does for all frames.
                match self.settings.turn {
                    Turn::Camera => self.sequence("", (frames, true), |frame, _, pose| {
                        pose.azimuth = wrap(pose.azimuth + turn(frame));
                    }),
                    Turn::Light => self.sequence("", (frames, false), |frame, scene, _| {
                        scene.environment.rotation += turn(frame);
                    }),
                }
            }
            Task::Animation => {
                let frame_rate = self.settings.frame_rate;
                let frames = self.shots.project.scene.animation.frames(frame_rate);
                if frames > MOST_FRAMES {
                    bail!(tr_format!(
                        "The animation has {frames} frames, and up to {MOST_FRAMES} are possible. Lower the frame rate or its length.",
                        frames = frames,
                        MOST_FRAMES = MOST_FRAMES
                    ));
                }
                self.sequence("_animation", (frames, false), |frame, scene, _| {
                    scene.go_to(frame as f64 / f64::from(frame_rate));
                })
            }
            Task::ContactSheet => bail!("no image"),
        }
    }

    /// A picture of each view and light, by folder and pattern.
    fn each(
        &mut self,
        pictures: impl ExactSizeIterator<Item = (View, Arc<Environment>)>,
    ) -> Result<ExportResult> {
        let count = pictures.len();
        let scene = self.shots.project.scene.clone();
        let mut written = Vec::new();
        for (i, (view, light)) in pictures.enumerate() {
            let progress = self.step(i, count);
            tell(&progress, 0.0)?;
            let path = self.named(&light.name(), view);
            self.shots.project.scene.clone_from(&scene);
            self.shots.light_by(&light);
            self.save(&path, view, &progress)?;
            written.push(path);
        }
        Ok(ExportResult::Files(written))
    }

    pub(super) fn need_lights(&self) -> Result<()> {
        if self.light_library.is_empty() {
            bail!(tr(
                "The light library is empty. Drop environments on the window first."
            ));
        }
        Ok(())
    }

    /// A picture by the light that is set.
    pub(super) fn picture(&mut self, view: View, progress: Progress<'_>) -> Result<Raster> {
        let (studio, lit) = self.set_up(view)?;
        self.take(&studio, &self.shots.project.pose, &lit, progress)
    }

    fn set_up(&mut self, view: View) -> Result<(Studio, Lit)> {
        Ok((self.studio(view)?, self.shots.lit(view)?))
    }

    /// A studio with ground, plate and LUT.
    fn studio(&mut self, view: View) -> Result<Studio> {
        self.shots.project.requested.ground = true;
        let is_linear = self.settings.format.is_linear();
        let mut studio = self.shots.studio(view, is_linear)?;
        studio.load_backplate()?;
        studio.load_lut()?;
        Ok(studio)
    }

    fn save(&mut self, path: &Path, view: View, progress: Progress<'_>) -> Result<()> {
        let (studio, lit) = self.set_up(view)?;
        let pose = self.shots.project.pose;
        match self.settings.format {
            ImageFormat::ExrLayers => self.save_layers(path, &studio, &pose, &lit),
            format => {
                let taken = self.take(&studio, &pose, &lit, progress)?;
                tell(progress, 1.0)?;
                make_folder(folder_of(path))?;
                format.write(path, &taken)
            }
        }
    }

    fn save_layers(
        &mut self,
        path: &Path,
        studio: &Studio,
        pose: &CameraPose,
        lit: &Lit,
    ) -> Result<()> {
        let camera = self.camera(pose);
        let factor = self.settings.supersample;
        let relit = lit.relit.clone().context("nothing is relit")?;
        let channels = (self.shots.layers(relit)?).take(studio, &camera, factor, lit)?;
        let folder = folder_of(path);
        make_folder(folder)?;
        let name = path.with_extension("look");
        let stem = name.file_name().unwrap_or_default();
        let look_path = free_name(folder, &stem.to_string_lossy(), "json");
        let look = Scene {
            camera: Some(*pose),
            ..self.shots.project.scene.clone()
        };
        save_layers(path, &look_path, &look, self.settings.size, channels)
    }

    fn camera(&self, pose: &CameraPose) -> Camera {
        let project = &self.shots.project;
        let radius = project.scene_bounds().map_or(1.0, |b| b.radius);
        Camera::from_pose(pose, project.scene_up(), self.settings.size, radius)
    }

    fn take(
        &self,
        studio: &Studio,
        pose: &CameraPose,
        lit: &Lit,
        progress: Progress<'_>,
    ) -> Result<Raster> {
        studio.take(&self.camera(pose), self.settings.supersample, lit, progress)
    }

    /// A file's name by the pattern; one that is taken gets a number, nothing is written over.
    pub(super) fn named(&self, light: &str, view: View) -> PathBuf {
        let stem = self.stem(light, view, None);
        let folder = Path::new(&self.settings.folder);
        free_name(folder, &stem, self.settings.format.extension())
    }

    /// Name of an image, or of a frame of several, by the pattern.
    fn stem(&self, light: &str, view: View, frame: Option<usize>) -> String {
        let view = serde_json::to_value(view).ok();
        let view = view.as_ref().and_then(|v| v.as_str()).unwrap_or("picture");
        let pattern = match self.settings.pattern.trim() {
            // A file without a name is hidden.
            "" => ExportSettings::default().pattern,
            pattern => pattern.to_owned(),
        };
        let mut stem = pattern
            .replace("{splat}", &self.name)
            // Its name in settings of version 0.1.
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
        if stem.is_empty() {
            return self.name.clone();
        }
        stem
    }

    /// So many frames, each set from how it is now; where the light stays, it is relit once. Film and folder are named as a picture is, with what
    /// they hold behind.
    fn sequence(
        &mut self,
        what: &str,
        (frames, light_stays): (usize, bool),
        set: impl Fn(usize, &mut Scene, &mut CameraPose),
    ) -> Result<ExportResult> {
        let Project {
            scene,
            pose,
            environment,
            ..
        } = &self.shots.project;
        let (scene, from) = (scene.clone(), *pose);
        let mut lights = scene.lights.iter();
        let is_followed = lights.any(|light| light.fixed_to == FixedTo::Camera);
        let light_stays = light_stays && !is_followed;
        let (view, light) = (scene.view, environment.light.name());
        let studio = self.studio(view)?;
        let mut lit = match light_stays {
            true => self.shots.lit(view)?,
            false => Lit::default(),
        };
        let stem = self.stem(&light, view, None) + what;
        let named = |extension| free_name(Path::new(&self.settings.folder), &stem, extension);
        let video = self.settings.video.map(|format| named(format.extension()));
        // A sequence has a folder of its own: in one with others it would be numbered around them.
        let folder = named("");
        let mut sink = Sink::new(self.settings.format, self.settings.frame_rate);
        for frame in 0..frames {
            let progress = self.step(frame, frames);
            tell(&progress, 0.0)?;
            let (mut now, mut pose) = (scene.clone(), from);
            set(frame, &mut now, &mut pose);
            let project = &mut self.shots.project;
            project.scene = now;
            if is_followed {
                project.pose = pose;
                project.followed = None;
                project.bring_lights_along(&from);
            }
            if !light_stays {
                lit = self.shots.lit(view)?;
            }
            let extension = self.settings.format.extension();
            let path = match &video {
                Some(video) => video.clone(),
                None => free_name(&folder, &self.stem(&light, view, Some(frame)), extension),
            };
            if self.settings.format == ImageFormat::ExrLayers {
                self.save_layers(&path, &studio, &pose, &lit)?;
                sink.files.push(path);
                continue;
            }
            let taken = self.take(&studio, &pose, &lit, &progress)?;
            tell(&progress, 1.0)?;
            make_folder(folder_of(&path))?;
            sink.add(&path, &taken)?;
        }
        Ok(ExportResult::Files(sink.finish()?))
    }

    /// The first object that is shown.
    fn asset(&self) -> Result<Splat> {
        let first = self.shots.project.shown().next();
        let (_, _, asset) = first.context(tr("No object is visible."))?;
        Ok(asset.clone())
    }

    fn write_delit(&mut self, path: &Path) -> Result<ExportResult> {
        let (asset, settings) = (self.asset()?, self.settings.clone());
        if settings.materials {
            asset.file.written_format(path).check_materials(path)?;
        }
        let (cloud, whitest) = (self.shots.cloud.clone(), settings.whitest);
        let delit = Delit::of(self.shots.prepared()?, &cloud, settings.delit_as, whitest)?;
        tell(&self.step(0, 1), 0.0)?;
        delit.write(&asset.file, settings.materials, path)?;
        Ok(ExportResult::Delit(
            path.to_owned(),
            delit.warnings(whitest),
        ))
    }

    fn write_splat(&mut self, path: &Path) -> Result<ExportResult> {
        let relit = self.shots.relit(Part::Whole, &[])?;
        tell(&self.step(0, 1), 0.0)?;
        let files = [path.to_owned()];
        self.shots.write_splats(vec![relit], &files, false)?;
        Ok(ExportResult::Files(vec![path.to_owned()]))
    }

    /// The progress of one of so many pictures, as all of theirs.
    pub(super) fn step(
        &self,
        done: usize,
        of: usize,
    ) -> impl Fn(f64) -> ControlFlow<()> + Sync + use<'a> {
        let handle = self.handle;
        move |share| handle.progress((done as f64 + share) / of as f64)
    }
}
