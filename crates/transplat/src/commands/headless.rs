//! Headless projects: what commands ask of the engine, and what they report of it.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use glam::{DVec3, Vec3};
use indicatif::ProgressBar;
use transplat_core::bake::Bake;
use transplat_core::environment::{EnvironmentMap, Illumination, ImageReading};
use transplat_core::estimate::{Estimate, FoundExposure};
use transplat_core::files::{
    CameraFile, cameras_of_training, inspect_bake, load_cameras, load_environment_as, losses,
};
use transplat_core::scene::{
    ESTIMATE, EnvironmentLight, Object, Scene, is_estimate, is_even, is_file,
};
use transplat_core::settings::Method;
use transplat_core::surfels::{UpAxis, is_faint};
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use super::settings::targets_of;
use crate::cli::{LightArgs, Rotation};
use crate::summary::{Summary, progress_bar};
use transplat_engine::device::{Device, DeviceChoice, Transfer};
use transplat_engine::environments::{Environment, not_environments};
use transplat_engine::estimate::{estimate_as_json, estimate_in_words, why_not};
use transplat_engine::jobs::{Kind, Watch, Work};
use transplat_engine::names::name_of;
use transplat_engine::project::Project;
use transplat_engine::shot::{Relighter, Shots};
use transplat_engine::splat::Splat;
use transplat_engine::warnings::{
    AMBIGUOUS_SHARE, DOUBTFUL_NORMAL_NOISE, ambiguous_warning, map_warnings, noise_warning,
    up_warning, up_warning_by_cameras,
};

/// One light to relight by.
pub struct Target {
    /// Name of its output.
    pub name: String,
    /// A file, or the name of a light that needs none.
    pub path: PathBuf,
}

/// Shots of a headless project on the device that the user chose, reported to a summary.
pub struct Headless {
    pub shots: Shots,
    bar: Bar,
}

impl Headless {
    /// Opens a device and loads the objects of a scene.
    pub fn load(device: DeviceChoice, scene: Scene, summary: &mut Summary) -> Result<Self> {
        let device = summary.time("open device", || Device::open(device))?;
        let headless = Self::of(scene, device, summary)?;
        let (_, asset) = headless.shown().next().context("an object is shown")?;
        summary.set("asset", asset.path.display().to_string());
        summary.set("surfels", headless.shots.cloud.len());
        summary.set("sh_degree", headless.shots.cloud.sh_degree);
        summary.set("adapter", headless.shots.device.name());
        Ok(headless)
    }

    /// Loads the objects of a scene on a device that is open, and reports what is odd about them.
    pub fn of(mut scene: Scene, device: Device, summary: &mut Summary) -> Result<Self> {
        let shown = scene.objects.iter().filter(|o| o.shown);
        let mut known = shown.filter(|o| o.source.file.is_some());
        if let (None, Some(first)) = (&scene.objects[0].source.file, known.next()) {
            // What is shown is what strengths are matched to.
            scene.objects[0].source = first.source.clone();
        }
        let bar = Bar::default();
        let watch = bar.watch(summary.quiet);
        let mut project = Project::headless(device, watch, scene);
        settle(&mut project, &bar, summary)?;
        let shots = Shots::of(project)?;
        let headless = Self { shots, bar };
        for (object, asset) in headless.used() {
            report_asset(object, asset, summary);
        }
        Ok(headless)
    }

    /// Makes what is requested, and notes what that took.
    fn settle(&mut self, summary: &mut Summary) -> Result<()> {
        settle(&mut self.shots.project, &self.bar, summary)
    }

    /// The objects that are loaded: those that are shown, and the first one in any case.
    fn used(&self) -> impl Iterator<Item = (&Object, &Splat)> {
        let each = self
            .shots
            .project
            .scene
            .objects
            .iter()
            .zip(&self.shots.project.states);
        each.filter_map(|(object, state)| Some((object, state.asset.as_ref()?)))
    }

    /// The objects that are shown.
    pub fn shown(&self) -> impl Iterator<Item = (&Object, &Splat)> + Clone {
        self.shots
            .project
            .shown()
            .map(|(_, object, asset)| (object, asset))
    }

    /// The first object, in whose coordinates the scene is.
    pub fn first(&self) -> (&Object, &Splat) {
        self.used().next().expect("it is loaded")
    }

    /// A place that is given in the coordinates of the first object's file.
    pub fn place(&self, at: [f64; 3]) -> Vec3 {
        let (_, first) = self.first();
        (DVec3::from_array(at) - first.cloud.origin).as_vec3()
    }

    /// Takes a saved bake for the method that is set.
    pub fn use_bake(&mut self, saved: &Path, summary: &mut Summary) -> Result<()> {
        inspect_bake(saved)?
            .of_method(self.shots.project.scene.transfer.method)
            .with_context(|| saved.display().to_string())?;
        let (_, first) = self.first();
        if self.shots.project.is_composed() || first.part.is_some() {
            bail!(
                "{}: a bake is of one object, not of a scene, and of a whole splat, not of what is cut out of one",
                saved.display()
            );
        }
        self.shots.project.states[0].saved_bake = Some(saved.to_owned());
        summary.skip("bake", "the saved one is used");
        Ok(())
    }

    /// Reads source and targets, before the bake: a wrong file is reported before minutes of work.
    pub fn light(&mut self, args: &LightArgs, summary: &mut Summary) -> Result<Vec<Target>> {
        if let Some(saved) = &args.capture.bake {
            self.use_bake(saved, summary)?;
        }
        let mut sources = Vec::new();
        for (object, asset) in self.used() {
            let file = object.source.file.clone();
            let name = || name_of(object, &asset.path);
            sources.push(
                file.with_context(|| format!("{}: the light of its capture is missing", name()))?,
            );
        }
        for path in &sources {
            self.read_light(path, summary)?;
        }
        let (mut targets, mut failed) = (Vec::new(), Vec::new());
        for (name, path) in targets_of(args, &self.shots.project.scene)? {
            match self.read_light(&path, summary) {
                Ok(()) => targets.push(Target { name, path }),
                // One of a folder is not to keep the others from being made.
                Err(why) if is_of_folder(args, &path) => failed.push(format!("{why:#}")),
                Err(why) => return Err(why),
            }
        }
        if let (true, Some(why)) = (targets.is_empty(), failed.first()) {
            bail!("no light in the folder can be read; the first: {why}");
        }
        if args.capture.rotate_source == Some(Rotation::Fit) {
            self.align_source(summary)?;
        }
        // The first one last: it is what the scene is lit by then.
        let estimates = targets.iter().skip(1).filter(|t| is_estimate(&t.path));
        for target in estimates.chain(targets.first()) {
            self.shots.project.scene.environment.file = Some(target.path.clone());
            self.estimate(summary)?;
        }
        for why in failed {
            summary.fail(format!("a light is skipped: {why}"));
        }
        for folder in args.target.iter().filter(|t| t.is_dir()) {
            if let Some(skipped) = not_environments(folder) {
                summary.note(skipped);
            }
        }
        Ok(targets)
    }

    /// Rotates the first object's capture light to where it explains the shading best.
    fn align_source(&mut self, summary: &mut Summary) -> Result<()> {
        let requested = &mut self.shots.project.requested;
        (requested.bakes, requested.lights, requested.alignment) = (true, true, true);
        self.settle(summary)?;
        if !self.shots.project.align_source(0) {
            bail!(
                "--rotate-source fit takes preset best, and as --source a panorama of the capture that explains the shading of the splat at some rotation"
            );
        }
        let source = &self.shots.project.scene.objects[0].source;
        summary.set("source_rotation", source.rotation);
        summary.set("source_mirrored", source.mirror);
        let mirrored = if source.mirror { ", mirrored" } else { "" };
        summary.note(format!(
            "the capture light fits best rotated by {:.0} degrees{mirrored}",
            source.rotation
        ));
        Ok(())
    }

    /// Reads a light's file, where it is one that was not read yet.
    pub fn read_light(&mut self, path: &Path, summary: &mut Summary) -> Result<()> {
        if is_even(path) {
            summary.skip("projection of an environment", "even light");
        }
        if !is_file(path) || self.shots.project.environments.get(path).is_some() {
            return Ok(());
        }
        let reading = self.reading_of(path);
        let map = read_map(path, &reading, summary)?;
        // Which suns there are, beams tell.
        let method = match self.shots.project.scene.environment.without_suns {
            true => Method::Directional,
            false => self.shots.project.scene.transfer.method,
        };
        let made = summary.time("project", || {
            Environment::of_map(&self.shots.device, path, &map, reading, method)
        })?;
        self.shots.project.environments.has_read(path, Some(made));
        Ok(())
    }

    /// Layout and layer by which a light's file is read.
    pub fn reading_of(&self, path: &Path) -> ImageReading {
        let scene = &self.shots.project.scene;
        let mut lights = scene.environment_lights();
        // One of several targets is named by the command line alone.
        match lights.any(|l| l.file.as_deref() == Some(path)) {
            true => scene.reading_of(path),
            false => scene.environment.reading(),
        }
    }

    /// Estimates the light of the capture where the scene asks for it, and reports that.
    fn estimate(&mut self, summary: &mut Summary) -> Result<()> {
        self.shots.project.requested.lights = true;
        self.settle(summary)?;
        for (at, state) in self.shots.project.states.iter().enumerate() {
            if let Some(completed) = self.shots.project.completed_source(at) {
                summary.set("source_completed_gain", completed.gain);
                let factor = completed.exposure.found();
                summary.set("source_completed_exposure", factor);
                let exposure = factor.map(|f| format!(", exposure {:+.1} stops", f.log2()));
                if completed.exposure == FoundExposure::Unknown {
                    summary.warn(
                        "the shading does not show how bright the capture light was: set the strength of the source",
                    );
                }
                summary.note(format!(
                    "the clipped highlights of the capture light are completed from the shading: {:.1} times as much light in all{}",
                    completed.gain,
                    exposure.unwrap_or_default()
                ));
            }
            let estimate = state.estimate.get();
            let Some(estimate) = estimate.filter(|_| self.shots.project.asks_for_estimate(at))
            else {
                continue;
            };
            let up = self.shots.project.up_of(at);
            report_estimate(estimate, &self.shots.project.scene, up, summary);
            if estimate.obstacle.is_some() {
                summary.skip("projection of an environment", "even light");
            }
        }
        Ok(())
    }

    /// Estimates the light of the first object's capture, whatever is known of that. `saved` is a bake for the method that is set.
    pub fn estimate_first(
        &mut self,
        saved: Option<&Path>,
        summary: &mut Summary,
    ) -> Result<Estimate> {
        if let Some(saved) = saved {
            self.use_bake(saved, summary)?;
        }
        self.shots.project.scene.objects[0].source = EnvironmentLight::of(ESTIMATE);
        self.shots.project.requested.lights = true;
        self.settle(summary)?;
        let estimate = self.shots.project.states[0].estimate.get().cloned();
        let estimate = estimate.context("the light is estimated")?;
        summary.set("source_estimate", estimate_as_json(&estimate));
        Ok(estimate)
    }

    /// The light of the first object's capture, as its map holds it.
    pub fn source_light(&mut self, summary: &mut Summary) -> Result<Illumination> {
        if let Some(path) = self.shots.project.scene.objects[0].source.file.clone() {
            self.read_light(&path, summary)?;
        }
        self.estimate(summary)?;
        Ok(self.shots.project.states[0]
            .source
            .light
            .illumination
            .clone())
    }

    /// Bakes what the method needs, and tells what that found.
    pub fn bake(&mut self, summary: &mut Summary) -> Result<Arc<Bake>> {
        let requested = &mut self.shots.project.requested;
        (requested.bakes, requested.alignment) = (true, true);
        self.settle(summary)?;
        for at in 0..self.shots.project.states.len() {
            if let Some((why, remedy)) = self.shots.project.contradiction(at) {
                let help = match remedy {
                    Some(_) if at == 0 => " --rotate-source fit rotates it.",
                    _ => "",
                };
                summary.warn(format!("{why}{help}"));
            }
        }
        let bake = self
            .shots
            .project
            .shown_bake()
            .context("the objects are baked")?;
        summary.skipped(bake.skipped_work());
        summary.set("preset", bake.method().preset());
        summary.set("directions", bake.directions());
        summary.set("bake_bytes_per_surfel", bake.bytes() / bake.len().max(1));
        summary.set("normals_flipped", bake.flipped());
        summary.set("normals_two_sided", two_sided(&bake));
        summary.set("buried", bake.buried());
        if let Some(share) = bake.ambiguous_share() {
            summary.set("normals_ambiguous_share", share);
            if share > AMBIGUOUS_SHARE {
                summary.warn(ambiguous_warning(share));
            }
        }
        if let Some(degrees) = bake.normal_noise() {
            summary.set("normals_noise_degrees", degrees);
            if degrees >= DOUBTFUL_NORMAL_NOISE {
                summary.warn(noise_warning(degrees));
            }
        }
        let scene = &self.shots.project.scene;
        let needs_few = bake.method() == Method::Harmonic && !scene.transfer.terms.shadow;
        if needs_few && bake.directions() < scene.directions {
            summary.skip(
                "most directions of the bake",
                "without shadows only the normals need it",
            );
        }
        Ok(bake)
    }

    /// Bakes the ground that catches the objects' shadow, where the scene has one.
    pub fn bake_ground(&mut self, summary: &mut Summary) -> Result<()> {
        self.shots.project.requested.ground = true;
        self.settle(summary)
    }

    /// Bakes and prepares the transfer from the source light, which no target changes.
    pub fn prepare(&mut self, summary: &mut Summary) -> Result<PreparedTransfer> {
        self.bake(summary)?;
        self.shots.project.requested.transfers = true;
        self.settle(summary)?;
        let prepared = self.shots.project.shown_transfer();
        let prepared = prepared.context("the objects are prepared")?;
        if prepared.source_was_black() {
            summary.warn(
                "the capture light is black and explains nothing; uniform white light is assumed",
            );
        }
        if prepared.dark_share() > 0.05 {
            summary.warn(format!(
                "{:.0} % of the Gaussians lie in a source light darker than epsilon; their relit colour follows epsilon more than the light",
                100.0 * prepared.dark_share()
            ));
        }
        summary.set("dark_share", prepared.dark_share());
        self.report_ignored(summary);
        summary.skipped(prepared.skipped_work(&self.shots.cloud));
        Ok(prepared)
    }

    /// Settings that the method does not know, and that were asked for all the same.
    fn report_ignored(&self, summary: &mut Summary) {
        let (scene, plain) = (&self.shots.project.scene, Scene::default());
        let mut lights = scene.environment_lights();
        let has_no_picture = |l: &EnvironmentLight| l.file.as_deref().is_some_and(|f| !is_file(f));
        if lights.any(|l| l.layout.is_some() && has_no_picture(l)) {
            summary.skip("the light's layout", "it has no image");
        }
        match scene.transfer.method {
            Method::Harmonic => {
                let mut shown = self.shown();
                if shown.any(|(_, asset)| !asset.cloud.outside_from.is_empty()) {
                    let why = "preset paper takes the open side for the front";
                    summary.skip("what is outside", why);
                }
            }
            Method::Directional => {
                let why = "preset best sums over directions of its own";
                let degrees = [scene, &plain].map(|s| s.transfer.sh_degree);
                if degrees[0] != degrees[1] && scene.transfer.terms.sums {
                    summary.skip("the light's SH degree", why);
                }
                // The shadow on the ground is baked with them.
                if scene.directions != plain.directions && !scene.shadow_catcher {
                    summary.skip("the number of directions", why);
                }
            }
        }
    }

    /// Lights the scene by a target, and yields that as the scene sees it.
    pub fn light_by(&mut self, target: &Target, summary: &mut Summary) -> Result<Illumination> {
        self.shots.project.scene.environment.file = Some(target.path.clone());
        self.settle(summary)?;
        Ok(self.shots.project.target_light())
    }

    /// Relights by one target, or what a view shows of that. For JSON, the change of light is timed as the median of three.
    pub fn relight(
        &mut self,
        name: &str,
        (light, part, unseen): (&Illumination, Part, &[bool]),
        summary: &mut Summary,
    ) -> Result<Relit> {
        self.report_light(name, light, summary)?;
        let transfer = &mut self.shots.relighter()?.transfer;
        timed(summary, || transfer.change_light(light, part, unseen))?;
        transfer.result()
    }

    /// Relights by one target what is written as splats: all as one, or each object in its own coordinates.
    pub fn relight_splats(
        &mut self,
        name: &str,
        light: &Illumination,
        is_each: bool,
        summary: &mut Summary,
    ) -> Result<Vec<Relit>> {
        if !is_each {
            let requested = (light, Part::Whole, &[][..]);
            return Ok(vec![self.relight(name, requested, summary)?]);
        }
        self.report_light(name, light, summary)?;
        timed(summary, || self.shots.relit_objects(light))
    }

    /// Writes relit splats, and warns of what their formats lose.
    pub fn write_splats(
        &self,
        relit: Vec<Relit>,
        files: &[PathBuf],
        is_each: bool,
        summary: &mut Summary,
    ) -> Result<()> {
        summary.time("export", || self.shots.write_splats(relit, files, is_each))?;
        // Several in one are written as they are in memory.
        let is_one_of_all = self.shots.project.is_composed() && !is_each;
        for ((_, asset), file) in self.shown().zip(files).filter(|_| !is_one_of_all) {
            if let Some(lost) = losses(&asset.file, &asset.cloud, file) {
                summary.warn(format!("{}: {lost}", file.display()));
            }
        }
        Ok(())
    }

    /// Reports the work that a light skips, and its strength: near lights as they are seen from the middle.
    fn report_light(
        &mut self,
        name: &str,
        light: &Illumination,
        summary: &mut Summary,
    ) -> Result<()> {
        let middle = self.shots.cloud.bounds().center;
        let relighter = self.relighter(summary)?;
        let on_gpu = matches!(relighter.transfer, Transfer::Gpu { .. });
        summary.skipped(relighter.prepared.skipped_work_for(light, on_gpu));
        if light.is_black() {
            summary.warn(format!(
                "{name}: the target light is black, and so is the result"
            ));
        } else {
            let mean = light.at_one_place(middle).mean_irradiance();
            summary.target(name, (mean * relighter.prepared.light_gain()).log2());
        }
        Ok(())
    }

    /// Has what relights ready on its device.
    pub fn relighter(&mut self, summary: &mut Summary) -> Result<&mut Relighter> {
        self.shots.relighter()?;
        self.warn(summary);
        self.shots.relighter()
    }

    /// Warns of what is done on another device than the chosen one.
    pub fn warn(&mut self, summary: &mut Summary) {
        for warning in self.shots.warnings.drain(..) {
            summary.warn(warning);
        }
    }
}

/// Progress bar of the stage that runs, where one is shown.
#[derive(Clone, Default)]
struct Bar(Arc<Mutex<Option<(Kind, ProgressBar)>>>);

impl Bar {
    fn watch(&self, quiet: bool) -> Watch {
        let bar = self.clone();
        Arc::new(move |kind, done| {
            if let Some(what) = label_of(kind) {
                bar.show(kind, done, || progress_bar(quiet, what));
            }
            ControlFlow::Continue(())
        })
    }

    fn show(&self, kind: Kind, done: f64, begin: impl FnOnce() -> ProgressBar) {
        let mut shown = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let last = shown.take().filter(|(of, _)| *of == kind);
        let (_, bar) = shown.insert(last.unwrap_or_else(|| (kind, begin())));
        bar.set_position((done * 1000.0) as u64);
    }

    fn end(&self) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = None;
    }
}

fn settle(project: &mut Project, bar: &Bar, summary: &mut Summary) -> Result<()> {
    let settled = project.settle();
    bar.end();
    for (kind, ms) in project.jobs.take_times() {
        summary.add_ms(stage_of(kind), ms);
    }
    settled
}

/// Label of the progress bar of a kind of work.
fn label_of(kind: Kind) -> Option<&'static str> {
    Some(match kind {
        Kind::Of(_, Work::Bake(_)) => "baking visibility",
        Kind::Surroundings | Kind::Insertion => "tracing between objects",
        Kind::Ground => "baking the ground",
        _ => return None,
    })
}

/// The stage that a kind of work is, by its name in the JSON object.
fn stage_of(kind: Kind) -> &'static str {
    match kind {
        Kind::Of(_, Work::Load) => "load",
        Kind::Of(_, Work::Bake(_)) => "bake",
        Kind::Of(_, Work::Estimate) => "estimate",
        Kind::Of(_, Work::Align) => "align",
        Kind::Of(_, Work::Complete) => "complete",
        Kind::Surroundings | Kind::Insertion => "surroundings",
        Kind::Ground => "ground",
        _ => "prepare",
    }
}

/// Warns of what is odd about a splat.
fn report_asset(object: &Object, asset: &Splat, summary: &mut Summary) {
    for warning in &asset.warnings {
        summary.warn(warning.clone());
    }
    let (path, file, cloud) = (&asset.path, &asset.file, asset.whole_cloud());
    if object.up.is_none() && file.report.up.is_none() {
        // As its trainer's cameras were held, or else as it stands.
        let cameras = cameras_of_training(path).and_then(|path| load_cameras(&path).ok());
        let warning = match &cameras {
            Some(cameras) => up_warning_by_cameras(path, cloud.up, cameras),
            None => up_warning(path, cloud, file),
        };
        warning
            .into_iter()
            .for_each(|warning| summary.warn(warning));
    }
    if !cloud.is_empty() && cloud.opacities.iter().all(|o| is_faint(*o)) {
        summary.warn(format!(
            "{}: all Gaussians are transparent (opacity below 1/255); its images are empty",
            path.display()
        ));
    }
}

/// Warns of a splat that lies on its side by its cameras, unless its up axis is explicit.
pub fn up_warning_of(object: &Object, asset: &Splat, cameras: &CameraFile) -> Option<String> {
    let is_explicit = asset.file.report.up.is_some() || object.up.is_some();
    let warning = || up_warning_by_cameras(&asset.path, asset.file_up, cameras);
    (!is_explicit).then(warning).flatten()
}

/// Reports an estimate of the light of a capture.
pub fn report_estimate(estimate: &Estimate, scene: &Scene, up: UpAxis, summary: &mut Summary) {
    summary.set("source_estimate", estimate_as_json(estimate));
    let Some(obstacle) = estimate.obstacle else {
        summary.note(estimate_in_words(estimate, up));
        return;
    };
    let why = why_not(scene.transfer.method, obstacle);
    let hint = if scene.match_strength {
        ""
    } else {
        "; nor how strong it was (--match-strength leaves the asset about as bright)"
    };
    summary.warn(format!("the light of the capture {why}{hint}"));
}

/// Reads a light's map, and tells what is odd about it.
pub fn read_map(
    path: &Path,
    reading: &ImageReading,
    summary: &mut Summary,
) -> Result<EnvironmentMap> {
    let map = summary.time("load", || load_environment_as(path, reading))?;
    for warning in map_warnings(path, &map, reading) {
        summary.warn(warning);
    }
    Ok(map)
}

/// True for a target in a folder on the command line.
fn is_of_folder(args: &LightArgs, path: &Path) -> bool {
    let mut folders = args.target.iter().filter(|t| t.is_dir());
    folders.any(|folder| path.starts_with(folder))
}

/// Changes the light: three times where that is to be timed.
fn timed<T>(summary: &mut Summary, mut change: impl FnMut() -> Result<T>) -> Result<T> {
    let mut times = Vec::new();
    let mut time = || {
        let start = Instant::now();
        let changed = change();
        times.push(start.elapsed().as_secs_f64() * 1e3);
        changed
    };
    let mut changed = time()?;
    for _ in 1..if summary.json { 3 } else { 1 } {
        drop(changed);
        changed = time()?;
    }
    times.sort_by(f64::total_cmp);
    if summary.ms("transfer").is_none() {
        summary.add_ms("transfer", times[times.len() / 2]);
    }
    Ok(changed)
}

/// Number of surfels that are about equally open on both sides.
pub fn two_sided(bake: &Bake) -> usize {
    (0..bake.len()).filter(|i| bake.is_two_sided(*i)).count()
}
