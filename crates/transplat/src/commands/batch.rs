//! `transplat render --batch`: splats, lights and cameras from a file, each with each, and any part of that.
//!
//! A picture is there, whole, or it is not: so a batch goes on where it was cut off, and parts of it can be drawn by any number of machines
//! that share a folder.

use std::collections::HashSet;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use anyhow::{Context as _, Result, bail};
use serde::Deserialize;
use transplat_core::files::{
    FileKind, file_kind, folder_of, is_same_file, load_cameras, load_look, write_atomically,
};
use transplat_core::scene::{is_estimate, is_file};
use transplat_core::settings::skips::Skips;

use crate::cli::{
    AssetArgs, AssetOptions, BakeArgs, CameraArgs, LightArgs, OutputArgs, RenderArgs, VIEWS,
};
use crate::commands::bake::bake;
use crate::commands::make_folder;
use crate::commands::render::{draw, pictures_in_words};
use crate::pipeline::settings::{environments_in, look_of};
use crate::summary::Summary;

/// Bytes of a batch, at most.
const MOST_BYTES: u64 = 1 << 24;

/// Pictures of a batch, at most: they are counted before they are drawn.
const MOST_PICTURES: usize = 10_000_000;

/// Folder in the output that bakes are kept in, for all parts.
const BAKES: &str = "bakes";

/// What the pictures in the output are drawn with.
const SETTINGS: &str = "settings.txt";

/// The file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Batch {
    splats: Vec<Splat>,
    /// Environments, or folders of them; with none, the splats as they were captured.
    #[serde(default)]
    lights: Vec<PathBuf>,
    /// What the splats were captured under that do not say so themselves.
    source: Option<PathBuf>,
    /// A camera file.
    cameras: Option<PathBuf>,
    /// Or so many views around each.
    turntable: Option<u32>,
    /// All other settings.
    look: Option<PathBuf>,
}

/// A splat, or a look: a scene of several.
#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Splat {
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
struct Picture {
    splat: usize,
    /// Name of its light; none as captured.
    light: Option<String>,
    frame: usize,
}

pub fn run(file: &Path, args: &RenderArgs) -> Result<()> {
    let mut summary = Summary::new("render", &args.out);
    let batch = load(file)?;
    let lights = batch.lights()?;
    let names = stems("splat", batch.splats.iter().map(Splat::asset))?;
    let all = batch.pictures(&lights, args)?;
    let [part, of] = args.part.unwrap_or([1, 1]);
    // Those of one splat and light lie together: a part prepares few.
    let mine = &all[all.len() * (part - 1) / of..all.len() * part / of];
    let extension = args.format.map_or("png", |f| f.extension());
    let is_missing = |p: &&Picture| {
        let folder = args.output.join(&names[p.splat]);
        let folder = folder.join(p.light.as_deref().unwrap_or_default());
        !folder.join(format!("{:03}.{extension}", p.frame)).is_file()
    };
    check_settings(file, args, all.iter().any(|p| !is_missing(&p)))?;
    let missing: Vec<&Picture> = mine.iter().filter(is_missing).collect();
    let mut written = 0;
    let mut failed = Vec::new();
    for (at, splat) in batch.splats.iter().enumerate() {
        let of_it = missing.iter().filter(|p| p.splat == at);
        let only: HashSet<(String, usize)> = of_it
            .map(|p| (p.light.clone().unwrap_or_default(), p.frame))
            .collect();
        if only.is_empty() {
            continue;
        }
        summary.subject = Some(names[at].clone());
        let lit: Vec<&(String, PathBuf)> = (lights.iter())
            .filter(|(name, _)| only.iter().any(|(light, _)| light == name))
            .collect();
        let of = |path: &PathBuf, name: &str| lights.iter().any(|(n, p)| n == name && p == path);
        let mut draw = |lit: Vec<PathBuf>| -> Result<usize> {
            let mut args = batch.arguments(splat, lit, args)?;
            args.light.bake = kept_bake(&args, &names[at], &mut summary)?;
            args.output = args.output.join(&names[at]);
            make_folder(&args.output)?;
            let wanted = only.iter().filter(|(light, _)| {
                lights.is_empty() || args.light.target.iter().any(|path| of(path, light))
            });
            let wanted = wanted.count();
            args.only = Some(only.clone());
            let drawn = draw(&args, &mut summary)?;
            if drawn < wanted {
                bail!("{drawn} of {} were drawn", pictures_in_words(wanted));
            }
            Ok(drawn)
        };
        // What is wrong with one splat or light is not to keep the others from being drawn.
        match draw(lit.iter().map(|(_, path)| path.clone()).collect()) {
            Ok(count) => written += count,
            Err(why) if lit.len() < 2 => failed.push(format!("{}: {why:#}", names[at])),
            Err(_) => {
                for (name, path) in lit {
                    match draw(vec![path.clone()]) {
                        Ok(count) => written += count,
                        Err(why) => failed.push(format!("{}, {name}: {why:#}", names[at])),
                    }
                }
            }
        }
    }
    let there = mine.len() - missing.len();
    summary.set("pictures", written);
    summary.set("pictures_there", there);
    summary.set("pictures_of_batch", all.len());
    if !failed.is_empty() {
        bail!(
            "{} written, {there} were there; not drawn: {}",
            pictures_in_words(written),
            failed.join("; ")
        );
    }
    summary.finish(&format!(
        "wrote {} to {}; {there} were there; the batch has {}{}",
        pictures_in_words(written),
        args.output.display(),
        all.len(),
        if of > 1 {
            format!(", part {part} of {of} has {}", mine.len())
        } else {
            String::new()
        }
    ))
}

/// Reads a batch; its paths are resolved against its own folder.
fn load(path: &Path) -> Result<Batch> {
    let told = || path.display().to_string();
    let bytes = std::fs::metadata(path).with_context(told)?.len();
    if bytes > MOST_BYTES {
        bail!("{}: {bytes} bytes are too many for a batch", path.display());
    }
    let text = std::fs::read(path).with_context(told)?;
    let mut batch: Batch = serde_json::from_slice(&text).with_context(|| {
        format!(
            "{}: not a batch: {{\"splats\": [FILE, {{\"asset\": FILE, \"source\": ENV}}], \"lights\": [ENV], \"turntable\": N}}",
            path.display()
        )
    })?;
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

/// Refuses to add to pictures that were drawn with other settings; which splats and lights there are may change.
fn check_settings(file: &Path, args: &RenderArgs, is_begun: bool) -> Result<()> {
    let told = || file.display().to_string();
    let text = std::fs::read(file).with_context(told)?;
    let mut of_batch: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(&text).with_context(told)?;
    of_batch.retain(|key, _| !["splats", "lights"].contains(&&**key));
    let of_command = RenderArgs {
        output: PathBuf::new(),
        batch: None,
        part: None,
        out: OutputArgs {
            quiet: false,
            json: false,
        },
        ..args.clone()
    };
    let of_batch = serde_json::Value::Object(of_batch);
    let settings = format!("{of_batch:#}\n{of_command:#?}\n");
    make_folder(&args.output)?;
    let kept = args.output.join(SETTINGS);
    match std::fs::read_to_string(&kept) {
        Ok(known) if is_begun && known != settings => bail!(
            "{}: the pictures there were drawn with other settings ({SETTINGS} has them); choose another folder, or remove that file to mix them",
            args.output.display()
        ),
        Ok(known) if known == settings => Ok(()),
        _ => Ok(write_atomically(&kept, |out| {
            out.write_all(settings.as_bytes())
        })?),
    }
}

impl Splat {
    fn asset(&self) -> &Path {
        match self {
            Self::File(asset) | Self::Captured(Captured { asset, .. }) => asset,
        }
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
            Splat::File(asset) => vec![asset],
            Splat::Captured(Captured { asset, source }) => {
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
        let mut each: Vec<PathBuf> = Vec::new();
        for light in lights {
            if !each.iter().any(|known| is_same_file(known, &light)) {
                each.push(light);
            }
        }
        let lights = each;
        if lights.is_empty() && !self.lights.is_empty() {
            bail!("the folders of lights hold no environment (.hdr, .exr)");
        }
        let names = stems("light", lights.iter().map(PathBuf::as_path))?;
        Ok(names.into_iter().zip(lights).collect())
    }

    /// All pictures, those of one splat and light one after the other.
    fn pictures(&self, lights: &[(String, PathBuf)], args: &RenderArgs) -> Result<Vec<Picture>> {
        let of_all = match (&args.camera.cameras, &self.cameras) {
            (Some(cameras), _) | (None, Some(cameras)) => Some(load_cameras(cameras)?.frames.len()),
            (None, None) if args.camera.eye.is_some() => Some(1),
            (None, None) => args.camera.turntable.or(self.turntable).map(|n| n as usize),
        };
        let names: Vec<Option<String>> = match lights {
            [] => vec![None],
            lights => lights.iter().map(|(name, _)| Some(name.clone())).collect(),
        };
        let mut pictures = Vec::new();
        for splat in 0..self.splats.len() {
            let frames = match of_all {
                Some(frames) => frames,
                None if self.has_camera(splat, args)? => 1,
                None => bail!(
                    "{}: a camera is needed: \"cameras\" or \"turntable\" in the batch, or a look with one in it",
                    self.splats[splat].asset().display()
                ),
            };
            if pictures.len() + names.len() * frames > MOST_PICTURES {
                bail!("a batch of more than {MOST_PICTURES} pictures; make several of it");
            }
            for light in &names {
                pictures.extend((0..frames).map(|frame| Picture {
                    splat,
                    light: light.clone(),
                    frame,
                }));
            }
        }
        Ok(pictures)
    }

    /// Whether a look tells where it is seen from.
    fn has_camera(&self, splat: usize, args: &RenderArgs) -> Result<bool> {
        let asset = self.splats[splat].asset();
        let own = matches!(file_kind(asset)?, FileKind::Look).then_some(asset);
        let looks = [args.light.look.as_deref(), self.look.as_deref(), own];
        for look in looks.into_iter().flatten() {
            if load_look(look)?.camera.is_some() {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// What draws a splat under some of the lights; what the command line says wins.
    fn arguments(&self, splat: &Splat, lit: Vec<PathBuf>, args: &RenderArgs) -> Result<RenderArgs> {
        let of_command = args.camera.cameras.is_some()
            || args.camera.turntable.is_some()
            || args.camera.eye.is_some();
        let camera = match of_command {
            true => args.camera.clone(),
            false => CameraArgs {
                cameras: self.cameras.clone(),
                turntable: self.turntable,
                ..args.camera.clone()
            },
        };
        let source = [&args.light.source, &splat.source().cloned(), &self.source];
        let is_look = matches!(file_kind(splat.asset())?, FileKind::Look);
        let args = RenderArgs {
            asset: AssetArgs {
                asset: Some(splat.asset().to_owned()),
                options: args.asset.options.clone(),
            },
            light: LightArgs {
                source: match is_look {
                    // As captured, nothing needs to be told.
                    _ if lit.is_empty() => None,
                    // The objects of a scene tell theirs.
                    true => source[0].clone().or_else(|| source[1].clone()),
                    false => source.into_iter().flatten().next().cloned(),
                },
                target: lit,
                look: match is_look {
                    true => args.light.look.clone(),
                    false => args.light.look.clone().or_else(|| self.look.clone()),
                },
                ..args.light.clone()
            },
            camera,
            batch: None,
            part: None,
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
}

/// The bake of a splat that is to be relit, made by whichever part needs it first; none of what is baked anew each time: scenes, and
/// splats with settings of their own that a bake depends on.
fn kept_bake(args: &RenderArgs, name: &str, summary: &mut Summary) -> Result<Option<PathBuf>> {
    let asset = args.asset.asset.as_deref().unwrap_or(Path::new(""));
    if args.light.target.is_empty() || matches!(file_kind(asset)?, FileKind::Look) {
        return Ok(None);
    }
    let scene = look_of(&args.asset.options, Some(&args.light))?;
    let first = &scene.objects[0];
    let is_plain = first.outside_from.is_empty()
        && first.cut.is_empty()
        && scene.objects.len() == 1
        && scene.transfer.skips == Skips::default();
    if !is_plain || args.view.is_some_and(|view| !view.needs_relit()) {
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
    let mut names: Vec<String> = Vec::new();
    for file in files {
        let name = file.file_stem().unwrap_or_default().to_string_lossy();
        if names.iter().any(|known| **known == name) || (what == "splat" && name == BAKES) {
            bail!(
                "{}: a {what} of the batch is called {name} already; its pictures need a name of their own",
                file.display()
            );
        }
        names.push(name.into_owned());
    }
    Ok(names)
}
