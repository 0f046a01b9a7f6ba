//! `transplat render`: images of a scene, as captured or relit.

mod frames;

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Result, bail};
use transplat_core::camera::CameraPose;
use transplat_core::files::{check_folder, check_output, load_backplate, load_lut};
use transplat_core::present::{Background, View};
use transplat_core::progress::no_progress;
use transplat_core::scene::{EVEN, MOST_FRAMES, Scene};
use transplat_core::settings::optimizations::SkippedWork;

use super::headless::{Headless, Target};
use super::settings::{check_objects, look_of, name_asset, put, targets_of, with_scene_as_look};
use crate::cli::{RenderArgs, image_format, usage};
use crate::commands::refuse_overwriting;
use crate::summary::Summary;
use frames::{Frame, frames, photographs};
use transplat_engine::layers::Layers;
use transplat_engine::output::{ImageFormat, Sink, make_folder};
use transplat_engine::render::{Lit, Studio};
use transplat_engine::shot::save_layers;
use transplat_engine::video::VideoFormat;

pub fn run(args: &RenderArgs) -> Result<()> {
    if args.part.is_some() {
        return usage("--part is of a --batch");
    }
    let mut summary = Summary::new("render", &args.out);
    let written = draw(args, None, &mut summary)?;
    summary.set("pictures", written);
    let what = match VideoFormat::of(&args.output) {
        Some(_) if args.output.is_file() => format!("{written} frames"),
        _ => pictures_in_words(written),
    };
    summary.finish(&format!("wrote {what} to {}", args.output.display()))
}

/// `1 picture`, `2 pictures`.
pub fn pictures_in_words(count: usize) -> String {
    format!("{count} image{}", if count == 1 { "" } else { "s" })
}

/// Pictures of a batch: names of lights, none as captured or by a look's own, and frames.
pub type Wanted = HashSet<(String, usize)>;

/// Draws what is asked for, or of that what a batch wants, and yields how many pictures that were.
pub fn draw(args: &RenderArgs, wanted: Option<&Wanted>, summary: &mut Summary) -> Result<usize> {
    let (asset, light) = with_scene_as_look(&args.asset, &args.light);
    let args = &RenderArgs {
        asset,
        light,
        ..args.clone()
    };
    let mut scene = settings(args)?;
    name_asset(&mut scene, &args.asset);
    if scene.view.is_of_materials() && targets_of(&args.light, &scene)?.is_empty() {
        // No light changes it, and any will do.
        scene.environment.set_file(EVEN.into());
    }
    if args.layers {
        // What is behind it is the compositor's, but for a photograph that is a layer itself.
        if scene.background != Background::Backplate {
            scene.background = Background::Transparent;
        }
    }
    let targets = targets_of(&args.light, &scene)?;
    let assets = check_objects(&scene, !targets.is_empty())?;
    let mut shown = scene.objects.iter().filter(|o| o.shown);
    let relit = shown.all(|o| o.source.file.is_some());
    let view = view_asked(args, &scene, relit, &targets)?;
    if args.layers && view != View::After {
        return usage(
            "--layers are of what is relit: they need --source and --target, and no other --view",
        );
    }
    if assets.len() > 1 && !relit && args.view.is_none() {
        summary.warn(
            "the capture lights of the objects are missing (\"source\" in the scene): objects are drawn as captured, without shadows on each other",
        );
    }
    if args.animation && scene.animation.keys.len() < 2 {
        return usage(
            "--animation needs a look with two keys of the light or more: set them on the timeline of the window, or write \"animation\" into it",
        );
    }
    let frames_of_light = scene.animation.frames(args.frame_rate);
    if args.animation && frames_of_light > MOST_FRAMES {
        bail!(
            "the animation has {frames_of_light} frames; {MOST_FRAMES} are possible: lower --frame-rate"
        );
    }
    if args.animation && !view.needs_relit() {
        return usage("--animation is of what is relit, and this view is not");
    }
    let mut headless = Headless::load(args.asset.options.device, scene, summary)?;
    let scene = headless.shots.project.scene.clone();
    let frames = frames(args, &headless, summary)?;
    let mut output = ImageOutput::new(args, frames.len(), targets.len())?;
    if wanted.is_some() {
        // A look's own light has no name there.
        output.folder_per_target = !args.light.target.is_empty();
    }
    let cameras = args.camera.cameras.as_deref();
    let photographs = photographs(scene.plate.as_deref());
    let inputs = args
        .light
        .inputs(&scene, &targets)
        .chain(cameras)
        .chain(scene.lut.as_deref())
        .chain(photographs.iter().map(|p| &**p));
    let mut outputs = output.pictures(&targets, &frames);
    if args.layers {
        let looks = outputs.iter().map(|path| look_beside(path));
        outputs.extend(looks.collect::<Vec<_>>());
    }
    refuse_overwriting(inputs, &outputs)?;
    if output.is_file {
        check_output(&args.output)?;
    } else {
        check_folder(&args.output)?;
    }
    // What is wrong with it is told before the work.
    let lut = scene.lut.as_ref().map(|path| load_lut(path));
    let lut = lut.transpose()?.map(Arc::new);
    if let (Some(lut), Some(path)) = (&lut, &scene.lut) {
        for warning in &lut.warnings {
            summary.warn(format!("{}: {warning}", path.display()));
        }
    }
    let linear = output.format == ImageFormat::ExrFloat;
    let is_plain = scene.display.is_identity() && scene.lut.is_none();
    if linear && (scene.false_color || !is_plain) {
        summary.warn("exposure, tone map, LUT and false colours are for PNG; an EXR stays linear");
    }
    let is_seen = view.background(scene.background) == Background::Environment;
    let needs_lights = view.needs_relit() || scene.shadow_catcher || is_seen;
    let read = if needs_lights && relit {
        Some(headless.light(&args.light, summary)?)
    } else {
        None
    };
    let needs_bake = view.needs_relit() || view == View::Visibility;
    if needs_bake {
        if let (None, Some(saved)) = (&read, &args.light.capture.bake) {
            headless.use_bake(saved, summary)?;
        }
        headless.bake(summary)?;
    } else {
        summary.skip("bake", "this view needs no visibility");
    }
    if read.is_some() {
        headless.bake_ground(summary)?;
    }
    let mut studio = headless.shots.studio(view, linear)?;
    headless.warn(summary);
    studio.lut = lut;
    let mut run = RenderRun {
        args,
        wanted,
        frames: &frames,
        output: &output,
        studio,
        plate: None,
        headless,
    };
    if view.needs_relit() {
        return run.relit(&read.unwrap_or_default(), summary);
    }
    if relit {
        summary.skip("transfer", "this view shows no relit colour");
    }
    let named = targets
        .into_iter()
        .map(|(name, path)| Target { name, path });
    let targets = read.unwrap_or_else(|| named.collect());
    run.as_captured(&targets, summary)
}

/// View that is requested.
///
/// # Errors
/// The command line does not say enough.
fn view_asked(
    args: &RenderArgs,
    scene: &Scene,
    relit: bool,
    targets: &[(String, PathBuf)],
) -> Result<View> {
    if relit && targets.is_empty() {
        return usage(
            "a light to relight by is missing: --target, or the target's file in the look",
        );
    }
    if !relit && !targets.is_empty() {
        return usage(
            "the light of the capture is missing: --source, or the source's file in the look; --source estimate stands for one that nobody knows",
        );
    }
    if scene.background == Background::Environment && !relit {
        return usage("--background environment needs --source and --target");
    }
    match (args.view, relit) {
        (None, false) if scene.view == View::After => Ok(View::Before),
        (_, false) if scene.view.needs_relit() => usage("this view needs --source and --target"),
        _ => Ok(scene.view),
    }
}

/// Settings of an image: those of a look, overridden by the command line.
pub fn settings(args: &RenderArgs) -> Result<Scene> {
    let mut scene = look_of(&args.asset.options, Some(&args.light))?;
    put(&mut scene.view, args.view);
    put(&mut scene.background, args.background);
    if let Some(plate) = &args.plate {
        scene.plate = Some(plate.clone());
        scene.background = Background::Backplate;
    }
    if scene.background == Background::Backplate && scene.plate.is_none() {
        return usage("--background plate needs a photograph: --plate, or the plate in the look");
    }
    put(&mut scene.display.tone_map, args.tone_map);
    scene.lut = args.lut.clone().or(scene.lut);
    let exposure = args.exposure.map(|stops| stops.clamp(-60.0, 60.0) as f32);
    put(&mut scene.display.exposure, exposure);
    Ok(scene)
}

/// Files that are not written; a folder would hardly be called so.
const OTHER_PICTURES: [&str; 11] = [
    "jpg", "jpeg", "tif", "tiff", "bmp", "gif", "tga", "hdr", "avi", "mov", "mkv",
];

/// Where pictures go.
struct ImageOutput<'a> {
    path: &'a Path,
    format: ImageFormat,
    is_file: bool,
    folder_per_target: bool,
}

impl<'a> ImageOutput<'a> {
    fn new(args: &'a RenderArgs, frames: usize, targets: usize) -> Result<Self> {
        let path = &args.output;
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        let named = image_format(&extension);
        let is_folder = path.is_dir() || path.to_string_lossy().ends_with('/');
        let is_video = VideoFormat::of(path).is_some() && !is_folder;
        let is_file = is_video || named.is_some() && !is_folder;
        let is_other = OTHER_PICTURES.contains(&&*extension.to_lowercase());
        if is_other && !is_folder {
            bail!(
                "{}: an image is .png or .exr, a video .mp4, .webm or .webp",
                path.display()
            );
        }
        if is_video && targets > 1 {
            bail!(
                "{}: {targets} targets do not fit into one video; make one for each",
                path.display()
            );
        }
        if is_video && (args.layers || args.format == Some(ImageFormat::ExrFloat)) {
            return usage("a video holds display values: neither --layers nor --format exr");
        }
        if is_file && !is_video && frames * targets.max(1) > 1 {
            bail!(
                "{}: {} images do not fit into one file; give a folder",
                path.display(),
                frames * targets.max(1)
            );
        }
        if let (Some(named), Some(asked), true) = (named, args.format, is_file)
            && named != asked
        {
            bail!(
                "{}: the name says {} and --format {}",
                path.display(),
                named.extension(),
                asked.extension()
            );
        }
        let in_folder = args.light.target.iter().any(|t| t.is_dir());
        let asked = args.format.or(named.filter(|_| is_file));
        let layered = args.layers.then_some(ImageFormat::ExrFloat);
        if layered.is_some() && asked.is_some_and(|f| f != ImageFormat::ExrFloat) {
            return usage("--layers are written as .exr");
        }
        Ok(Self {
            path,
            format: asked.or(layered).unwrap_or(ImageFormat::Png8),
            is_file,
            folder_per_target: !is_file && (targets > 1 || in_folder),
        })
    }

    fn folder(&self, target: Option<&str>) -> PathBuf {
        match target {
            Some(name) if self.folder_per_target => self.path.join(name),
            _ => self.path.to_owned(),
        }
    }

    fn picture(&self, target: Option<&str>, frame: usize) -> PathBuf {
        if self.is_file {
            return self.path.to_owned();
        }
        self.folder(target)
            .join(format!("{frame:03}.{}", self.format.extension()))
    }

    /// All pictures that will be written.
    fn pictures(&self, targets: &[(String, PathBuf)], frames: &[Frame]) -> Vec<PathBuf> {
        let names = targets.iter().map(|(name, _)| Some(&**name)).chain([None]);
        names
            .flat_map(|name| {
                frames
                    .iter()
                    .map(move |frame| self.picture(name, frame.number))
            })
            .collect()
    }
}

/// The look that a picture in layers is made by.
fn look_beside(picture: &Path) -> PathBuf {
    picture.with_extension("look.json")
}

struct RenderRun<'a> {
    args: &'a RenderArgs,
    wanted: Option<&'a Wanted>,
    frames: &'a [Frame],
    output: &'a ImageOutput<'a>,
    studio: Studio,
    /// The photograph that is behind it now.
    plate: Option<PathBuf>,
    headless: Headless,
}

impl RenderRun<'_> {
    /// One set of pictures a target, with the bake and the source's part done once.
    fn relit(&mut self, targets: &[Target], summary: &mut Summary) -> Result<usize> {
        self.headless.prepare(summary)?;
        self.headless.relighter(summary)?;
        let mut written = 0;
        if self.args.layers && self.studio.scene.first_is_a_place() {
            summary.time("surroundings", || {
                self.headless.shots.place_alone().map(drop)
            })?;
        }
        let view = self.studio.view;
        for target in targets {
            let light = self.headless.light_by(target, summary)?;
            let unseen = self.headless.shots.project.spared_surfels();
            summary.skipped(SkippedWork::of_unseen(&unseen));
            if self.args.animation {
                written += self.animate(target, &unseen, summary)?;
                continue;
            }
            let requested = (&light, view.part(), &unseen[..]);
            let relit = self.headless.relight(&target.name, requested, summary)?;
            let shots = &mut self.headless.shots;
            let layers = self.args.layers.then(|| shots.layers(relit.clone()));
            let (layers, lit) = (layers.transpose()?, shots.lit_by(view, Some(relit))?);
            written += match &layers {
                Some(layers) => self.take_layers((target, layers), &lit, summary)?,
                None => self.take(Some(&target.name), &lit, summary)?,
            };
        }
        Ok(written)
    }

    /// Frame by frame under the light of its time.
    fn animate(
        &mut self,
        target: &Target,
        unseen: &[bool],
        summary: &mut Summary,
    ) -> Result<usize> {
        let scene = self.headless.shots.project.scene.clone();
        let mut sink = self.sink();
        let bar = summary.progress_bar("drawing");
        let name = Some(&*target.name);
        if !self.output.is_file {
            make_folder(&self.output.folder(name))?;
        }
        for (done, frame) in self.frames.iter().enumerate() {
            bar.set_position((1000 * done / self.frames.len()) as u64);
            if !self.wants(name, frame) {
                continue;
            }
            let now = &mut self.headless.shots.project.scene;
            *now = scene.clone();
            now.go_to(frame.number as f64 / f64::from(self.args.frame_rate));
            let light = self.headless.light_by(target, summary)?;
            let view = self.studio.view;
            let transfer = &mut self.headless.shots.relighter()?.transfer;
            let change = || transfer.change_light(&light, view.part(), unseen);
            summary.time("transfer", change)?;
            let relit = transfer.result()?;
            let lit = self.headless.shots.lit_by(view, Some(relit))?;
            self.take_frame((name, frame), &lit, &mut sink, summary)?;
        }
        self.headless.shots.project.scene = scene;
        let count = sink.count;
        summary.time("export", || sink.finish())?;
        Ok(count)
    }

    /// Draws the capture for each target, with its background and ground.
    fn as_captured(&mut self, targets: &[Target], summary: &mut Summary) -> Result<usize> {
        if targets.is_empty() {
            return self.take(None, &Lit::default(), summary);
        }
        let mut written = 0;
        for target in targets {
            self.headless.light_by(target, summary)?;
            let lit = self.headless.shots.lit_by(self.studio.view, None)?;
            written += self.take(Some(&target.name), &lit, summary)?;
        }
        Ok(written)
    }

    /// Each frame in layers, and the look that they are made by.
    fn take_layers(
        &mut self,
        (target, layers): (&Target, &Layers),
        lit: &Lit,
        summary: &mut Summary,
    ) -> Result<usize> {
        let name = Some(&*target.name);
        if !self.output.is_file {
            make_folder(&self.output.folder(name))?;
        }
        let cloud = self.headless.shots.cloud.clone();
        let mut look = self.headless.shots.project.scene.clone();
        let middle = cloud.bounds().center;
        let factor = usize::from(self.args.supersample);
        for frame in self.frames {
            self.set_backplate(frame, summary)?;
            look.camera = Some(CameraPose::of(&frame.camera, cloud.up, middle));
            look.plate = frame.plate.clone().or(look.plate);
            let path = self.output.picture(name, frame.number);
            let taken = || layers.take(&self.studio, &frame.camera, factor, lit);
            let channels = summary.time("rasterize", taken)?;
            let size = [frame.camera.width, frame.camera.height];
            summary.time("export", || {
                save_layers(&path, &look_beside(&path), &look, size, channels)
            })?;
        }
        Ok(self.frames.len())
    }

    /// Puts the frame's photograph behind it, where there is one.
    fn set_backplate(&mut self, frame: &Frame, summary: &mut Summary) -> Result<()> {
        if frame.plate != self.plate && self.studio.scene.background == Background::Backplate {
            let photograph = frame.plate.as_ref().map(|path| load_backplate(path));
            self.studio.plate = photograph.transpose()?;
            if let (Some(plate), Some(path)) = (&self.studio.plate, &frame.plate) {
                for warning in &plate.warnings {
                    summary.warn(format!("{}: {warning}", path.display()));
                }
            }
            self.plate = frame.plate.clone();
        }
        Ok(())
    }

    fn sink(&self) -> Sink {
        Sink::new(self.output.format, self.args.frame_rate)
    }

    fn wants(&self, target: Option<&str>, frame: &Frame) -> bool {
        let light = target.filter(|_| self.output.folder_per_target);
        let picture = (light.unwrap_or_default().to_owned(), frame.number);
        self.wanted.is_none_or(|wanted| wanted.contains(&picture))
    }

    fn take(&mut self, target: Option<&str>, lit: &Lit, summary: &mut Summary) -> Result<usize> {
        if !self.output.is_file {
            make_folder(&self.output.folder(target))?;
        }
        let bar = summary.progress_bar("drawing");
        let mut sink = self.sink();
        for (done, frame) in self.frames.iter().enumerate() {
            bar.set_position((1000 * done / self.frames.len()) as u64);
            if !self.wants(target, frame) {
                continue;
            }
            self.take_frame((target, frame), lit, &mut sink, summary)?;
        }
        let count = sink.count;
        summary.time("export", || sink.finish())?;
        Ok(count)
    }

    /// Draws a frame, into a file of its own or the film.
    fn take_frame(
        &mut self,
        (target, frame): (Option<&str>, &Frame),
        lit: &Lit,
        sink: &mut Sink,
        summary: &mut Summary,
    ) -> Result<()> {
        self.set_backplate(frame, summary)?;
        let path = self.output.picture(target, frame.number);
        let factor = usize::from(self.args.supersample);
        let raster = summary.time("rasterize", || {
            self.studio.take(&frame.camera, factor, lit, &no_progress)
        })?;
        summary.time("export", || sink.add(&path, &raster))
    }
}
