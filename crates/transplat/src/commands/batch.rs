//! `transplat render --batch`: splats by lights by cameras from a file, or a part of that.
//!
//! A picture is there, whole, or it is not: so a batch goes on where it was cut off, and parts of it can be drawn by any number of machines
//! that share a folder.

use std::collections::{BTreeSet, HashSet};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use anyhow::{Context as _, Error, Result, bail};
use serde::Deserialize;
use serde_json::json;
use transplat_core::environment::ImageReading;
use transplat_core::files::{
    folder_of, load_cameras, load_environment_as, load_json, load_look, look_text, write_atomically,
};
use transplat_core::scene::{is_estimate, is_file};
use transplat_core::settings::optimizations::Optimizations;

use crate::cli::{
    AssetArgs, AssetOptions, BakeArgs, CameraArgs, CaptureArgs, LightArgs, OutputArgs, RenderArgs,
    VIEWS,
};
use crate::commands::bake::bake;
use crate::commands::render::{Wanted, draw, pictures_in_words, settings};
use crate::commands::settings::{is_look, look_of};
use crate::summary::Summary;
use transplat_engine::environments::environments_in;
use transplat_engine::output::make_folder;

/// Bytes of a batch, at most.
const MOST_BYTES: u64 = 1 << 24;

/// Pictures of a batch, at most: they are counted before they are drawn.
const MOST_PICTURES: usize = 1_000_000;

/// Folder in the output that bakes are kept in, for all parts.
const BAKES: &str = "bakes";

/// Name of the file with the settings that the output was drawn by.
const SETTINGS: &str = "settings.json";

/// The file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Batch {
    splats: Vec<BatchSplat>,
    /// Environments, or folders of them; with none, the splats as they were captured.
    #[serde(default)]
    lights: Vec<PathBuf>,
    /// Capture light of splats without one of their own.
    source: Option<PathBuf>,
    /// A camera file.
    cameras: Option<PathBuf>,
    /// Or so many views around each.
    turntable: Option<u32>,
    /// All other settings, of splats that are no looks.
    look: Option<PathBuf>,
}

/// A splat, or a look: a scene of several.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum BatchSplat {
    File(PathBuf),
    Captured(Captured),
}

#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Captured {
    asset: PathBuf,
    source: Option<PathBuf>,
}

/// A picture to be drawn.
struct BatchImage {
    splat: usize,
    /// Index of the light; none as captured, or by the light of a look.
    light: Option<usize>,
    frame: usize,
}

pub fn run(file: &Path, args: &RenderArgs) -> Result<()> {
    let mut summary = Summary::new("render", &args.out);
    let batch = load(file)?;
    let lights = batch.lights()?;
    let names = stems("splat", batch.splats.iter().map(BatchSplat::asset))?;
    let all = batch.pictures(lights.len(), args)?;
    let light_of = |p: &BatchImage| p.light.map_or("", |at| &*lights[at].0);
    let extension = args.format.map_or("png", |f| f.extension());
    let is_there = |p: &BatchImage| {
        let folder = args.output.join(&names[p.splat]).join(light_of(p));
        let picture = folder.join(format!("{:03}.{extension}", p.frame));
        picture.is_file()
    };
    batch.keep_settings(args, || all.iter().any(is_there))?;
    let [part, of] = args.part.unwrap_or([1, 1]);
    // Those of one splat and light lie together: a part prepares few.
    let mine = &all[all.len() * (part - 1) / of..all.len() * part / of];
    let missing: Vec<&BatchImage> = mine.iter().filter(|p| !is_there(p)).collect();
    // What is wrong with one splat or light is not to keep the others from being drawn.
    let mut failed = Vec::new();
    let mut bad_lights = HashSet::new();
    for at in missing
        .iter()
        .filter_map(|p| p.light)
        .collect::<BTreeSet<_>>()
    {
        let (name, path) = &lights[at];
        let reading = ImageReading {
            layout: args.light.target_layout,
            layer: args.light.layer.clone(),
        };
        if let Some(Err(why)) = is_file(path).then(|| load_environment_as(path, &reading)) {
            failed.push(format!("{name}: {why}"));
            bad_lights.insert(at);
        }
    }
    let mut written = 0;
    for of_splat in missing.chunk_by(|a, b| a.splat == b.splat) {
        let at = of_splat[0].splat;
        let is_good = |p: &&&BatchImage| p.light.is_none_or(|light| !bad_lights.contains(&light));
        let good: Vec<&BatchImage> = of_splat.iter().filter(is_good).copied().collect();
        if good.is_empty() {
            continue;
        }
        let used: BTreeSet<usize> = good.iter().filter_map(|p| p.light).collect();
        let used = used.into_iter().map(|at| lights[at].1.clone()).collect();
        let wanted: Wanted = (good.iter().map(|p| (light_of(p).to_owned(), p.frame))).collect();
        summary.subject = Some(names[at].clone());
        let drawn = batch.draw(at, &names[at], (used, &wanted), args, &mut summary);
        match drawn {
            Ok(count) => written += count,
            Err(why) => failed.push(format!("{}: {why:#}", names[at])),
        }
    }
    let there = mine.len() - missing.len();
    summary.set("pictures", written);
    summary.set("pictures_there", there);
    summary.set("pictures_of_batch", all.len());
    summary.set("failed", failed.clone());
    let part = match of {
        1 => String::new(),
        _ => format!(", part {part} of {of} has {}", mine.len()),
    };
    summary.finish(&format!(
        "wrote {} to {}; {there} were there; the batch has {}{part}",
        pictures_in_words(written),
        args.output.display(),
        all.len(),
    ))?;
    if !failed.is_empty() {
        bail!("not drawn: {}", failed.join("; "));
    }
    Ok(())
}

/// Reads a batch; its paths are resolved against its own folder.
fn load(path: &Path) -> Result<Batch> {
    let told = || path.display().to_string();
    let bytes = std::fs::metadata(path).with_context(told)?.len();
    if bytes > MOST_BYTES {
        bail!("{}: {bytes} bytes are too many for a batch", path.display());
    }
    let mut batch: Batch = load_json(
        path,
        "batch ({\"splats\": [FILE, {\"asset\": FILE, \"source\": ENV}], \"lights\": [ENV], \"turntable\": N})",
    )?;
    if batch.splats.is_empty() {
        bail!("{}: names no splats", path.display());
    }
    if batch.turntable.is_some_and(|views| !VIEWS.contains(&views)) {
        let (least, most) = VIEWS.into_inner();
        bail!(
            "{}: a turntable has {least} to {most} views",
            path.display()
        );
    }
    if batch.cameras.is_some() && batch.turntable.is_some() {
        bail!(
            "{}: has cameras and a turntable; one of them is meant",
            path.display()
        );
    }
    if batch.lights.iter().any(|light| is_estimate(light)) {
        bail!(
            "{}: an estimate is no light of a batch, which is for all its splats",
            path.display()
        );
    }
    let folder = folder_of(path);
    batch.paths().filter(|p| is_file(p)).for_each(|p| {
        *p = folder.join(&*p);
    });
    Ok(batch)
}

impl BatchSplat {
    fn asset(&self) -> &Path {
        match self {
            Self::File(asset) | Self::Captured(Captured { asset, .. }) => asset,
        }
    }

    fn is_look(&self) -> bool {
        is_look(self.asset())
    }

    fn source(&self) -> Option<&PathBuf> {
        match self {
            Self::File(_) => None,
            Self::Captured(captured) => captured.source.as_ref(),
        }
    }
}

impl Batch {
    fn paths(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let of_splats = self.splats.iter_mut().flat_map(|splat| match splat {
            BatchSplat::File(asset) => vec![asset],
            BatchSplat::Captured(Captured { asset, source }) => {
                [asset].into_iter().chain(source).collect()
            }
        });
        let others = [&mut self.source, &mut self.cameras, &mut self.look];
        of_splats
            .chain(self.lights.iter_mut())
            .chain(others.into_iter().flatten())
    }

    /// Its lights, folders replaced by what is in them, with their names.
    fn lights(&self) -> Result<Vec<(String, PathBuf)>> {
        let mut lights = Vec::new();
        for path in &self.lights {
            match path.is_dir() {
                true => lights.extend(environments_in(path)?),
                false => lights.push(path.clone()),
            }
        }
        // One that is named, and lies in a folder that is named too, is meant once.
        let mut known = HashSet::new();
        lights.retain(|light| known.insert(light.canonicalize().unwrap_or_else(|_| light.clone())));
        if lights.is_empty() && !self.lights.is_empty() {
            bail!("the folders of lights hold no environment (.hdr, .exr)");
        }
        let names = stems("light", lights.iter().map(PathBuf::as_path))?;
        Ok(names.into_iter().zip(lights).collect())
    }

    /// All pictures, those of one splat and light one after the other.
    fn pictures(&self, lights: usize, args: &RenderArgs) -> Result<Vec<BatchImage>> {
        let camera = self.camera(args);
        let of_all = match (&camera.cameras, camera.eye) {
            (Some(cameras), _) => Some(load_cameras(cameras)?.frames.len()),
            (None, Some(_)) => Some(1),
            (None, None) => camera.turntable.map(|views| views as usize),
        };
        let lights: Vec<Option<usize>> = match lights {
            0 => vec![None],
            count => (0..count).map(Some).collect(),
        };
        let mut pictures = Vec::new();
        for (splat, named) in self.splats.iter().enumerate() {
            let frames = match of_all {
                Some(frames) => frames,
                None if self.has_camera(named, args)? => 1,
                None => bail!(
                    "{}: a camera is needed: \"cameras\" or \"turntable\" in the batch, or a look with one in it",
                    named.asset().display()
                ),
            };
            if pictures.len() + lights.len() * frames > MOST_PICTURES {
                bail!("a batch of more than {MOST_PICTURES} images; split it");
            }
            for light in lights.iter().copied() {
                let of_frame = |frame| BatchImage {
                    splat,
                    light,
                    frame,
                };
                pictures.extend((0..frames).map(of_frame));
            }
        }
        Ok(pictures)
    }

    /// The cameras; what the command line says wins.
    fn camera(&self, args: &RenderArgs) -> CameraArgs {
        let told = &args.camera;
        if told.cameras.is_some() || told.turntable.is_some() || told.eye.is_some() {
            return told.clone();
        }
        CameraArgs {
            cameras: self.cameras.clone(),
            turntable: self.turntable,
            ..told.clone()
        }
    }

    /// The look of splats that are none themselves.
    fn look<'a>(&'a self, args: &'a RenderArgs) -> Option<&'a PathBuf> {
        args.light.capture.look.as_ref().or(self.look.as_ref())
    }

    /// True where a look has a camera.
    fn has_camera(&self, splat: &BatchSplat, args: &RenderArgs) -> Result<bool> {
        let look = match splat.is_look() {
            true => Some(splat.asset()),
            false => self.look(args).map(PathBuf::as_path),
        };
        Ok(match look {
            Some(look) => load_look(look)?.camera.is_some(),
            None => false,
        })
    }

    /// Arguments that draw a splat under some of the lights; the command line wins.
    fn arguments(
        &self,
        splat: &BatchSplat,
        lit: Vec<PathBuf>,
        args: &RenderArgs,
    ) -> Result<RenderArgs> {
        let is_look = splat.is_look();
        // The objects of a scene tell theirs, and as captured nothing needs to be told.
        let of_batch = self.source.as_ref().filter(|_| !is_look);
        let source = args
            .light
            .capture
            .source
            .as_ref()
            .or(splat.source())
            .or(of_batch);
        let args = RenderArgs {
            asset: AssetArgs {
                asset: Some(splat.asset().to_owned()),
                options: args.asset.options.clone(),
            },
            light: LightArgs {
                capture: CaptureArgs {
                    source: source.filter(|_| !lit.is_empty()).cloned(),
                    look: self.look(args).filter(|_| !is_look).cloned(),
                    ..args.light.capture.clone()
                },
                target: lit,
                ..args.light.clone()
            },
            camera: self.camera(args),
            ..args.clone()
        };
        let told = look_of(&args.asset.options, Some(&args.light))?;
        if !is_look && !args.light.target.is_empty() && told.objects[0].source.file.is_none() {
            bail!(
                "what it was captured under is missing: \"source\" of the splat or of the batch; \"estimate\" stands for a light that nobody knows"
            );
        }
        Ok(args)
    }

    /// Draws what is wanted of a splat, and yields how many pictures that were.
    fn draw(
        &self,
        splat: usize,
        name: &str,
        (lit, wanted): (Vec<PathBuf>, &Wanted),
        args: &RenderArgs,
        summary: &mut Summary,
    ) -> Result<usize> {
        let mut args = self.arguments(&self.splats[splat], lit, args)?;
        args.light.capture.bake = kept_bake(&args, name, summary)?;
        args.output = args.output.join(name);
        make_folder(&args.output)?;
        let drawn = draw(&args, Some(wanted), summary)?;
        if drawn < wanted.len() {
            bail!("{drawn} of {} were drawn", pictures_in_words(wanted.len()));
        }
        Ok(drawn)
    }

    /// Refuses to add to pictures that were drawn with other settings; which splats and lights there are may change.
    fn keep_settings(&self, args: &RenderArgs, is_begun: impl Fn() -> bool) -> Result<()> {
        let mut look = settings(&RenderArgs {
            light: LightArgs {
                capture: CaptureArgs {
                    look: self.look(args).cloned(),
                    ..args.light.capture.clone()
                },
                ..args.light.clone()
            },
            ..args.clone()
        })?;
        look.objects[0].source.file = None;
        let look: serde_json::Value = serde_json::from_str(&look_text(&look).map_err(Error::msg)?)?;
        let camera = self.camera(args);
        let cameras = camera.cameras.as_ref().and_then(|path| path.file_name());
        let settings = json!({
            "look": look,
            "size": args.size,
            "supersample": args.supersample,
            "device": format!("{:?}", args.asset.options.device),
            "cameras": cameras.map(|name| name.to_string_lossy()),
            "turntable": camera.turntable,
            "eye": camera.eye,
            "look_at": camera.look_at,
            "fov": camera.fov,
            "aperture": camera.aperture,
        });
        let settings = format!("{settings:#}\n");
        make_folder(&args.output)?;
        let kept = args.output.join(SETTINGS);
        match std::fs::read_to_string(&kept) {
            Ok(known) if known == settings => Ok(()),
            Ok(_) if is_begun() => bail!(
                "{}: the images there were drawn with other settings ({SETTINGS}); choose another folder, or remove that file to mix them",
                args.output.display()
            ),
            _ => Ok(write_atomically(&kept, |out| {
                out.write_all(settings.as_bytes())
            })?),
        }
    }
}

/// The bake of a splat that is to be relit, made by whichever part needs it first; none of what is baked anew each time: scenes, and
/// splats with settings of their own that a bake depends on.
fn kept_bake(args: &RenderArgs, name: &str, summary: &mut Summary) -> Result<Option<PathBuf>> {
    let asset = args.asset.asset.as_deref().unwrap_or(Path::new(""));
    if args.light.target.is_empty() || is_look(asset) {
        return Ok(None);
    }
    let scene = look_of(&args.asset.options, Some(&args.light))?;
    let first = &scene.objects[0];
    let is_plain = first.outside_from.is_empty()
        && first.cut.is_empty()
        && scene.objects.len() == 1
        && scene.transfer.optimizations == Optimizations::default();
    if !is_plain || !args.view.unwrap_or(scene.view).needs_relit() {
        return Ok(None);
    }
    let folder = args.output.join(BAKES);
    make_folder(&folder)?;
    let preset = scene.transfer.method.preset();
    // Of the splat as it is now.
    let told = std::fs::metadata(asset).with_context(|| asset.display().to_string())?;
    let changed = told.modified().ok();
    let changed = changed.and_then(|time| Some(time.duration_since(UNIX_EPOCH).ok()?.as_millis()));
    let stamp = format!("{:x}-{:x}", told.len(), changed.unwrap_or_default());
    let file = folder.join(format!("{name}.{stamp}.{preset}.{}.bake", scene.directions));
    if !file.is_file() {
        let options = BakeArgs {
            asset: AssetArgs {
                asset: Some(asset.to_owned()),
                options: AssetOptions {
                    directions: Some(scene.directions),
                    ..args.asset.options.clone()
                },
            },
            preset: Some(scene.transfer.method),
            output: file.clone(),
            out: OutputArgs {
                quiet: args.out.quiet,
                json: false,
            },
        };
        bake(&options, summary)?;
    }
    Ok(Some(file))
}

/// The names that files give to folders of pictures; two of one name are refused, since a part of the batch would not know which is which.
fn stems<'a>(what: &str, files: impl Iterator<Item = &'a Path>) -> Result<Vec<String>> {
    let mut known = HashSet::from([BAKES.to_owned(), SETTINGS.to_owned()]);
    let named = |file: &Path| {
        let name = file.file_stem().unwrap_or_default().to_string_lossy();
        if !known.insert(name.to_string()) {
            bail!(
                "{}: the batch has a {what} called {name} already; rename one of them",
                file.display()
            );
        }
        Ok(name.into_owned())
    };
    files.map(named).collect()
}
