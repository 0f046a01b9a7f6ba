//! `transplat relight`: splats under another light, as splats.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use transplat_core::files::{FileKind, SplatFormat, check_folder, check_output, file_kind};
use transplat_core::scene::Scene;

use super::headless::Headless;
use super::settings::{check_objects, scene_of, targets_of};
use crate::cli::{RelightArgs, usage};
use crate::commands::refuse_overwriting;
use crate::summary::Summary;
use transplat_engine::names::{as_file_name, distinct_names, name_of};

pub fn run(args: &RelightArgs) -> Result<()> {
    let mut summary = Summary::new("relight", &args.out);
    let (scene, light) = scene_of(&args.asset, &args.light)?;
    let assets = check_objects(&scene, true)?;
    let named = targets_of(&light, &scene)?;
    let shown = || scene.objects.iter().filter(|o| o.shown);
    if shown().any(|o| o.source.file.is_none()) || named.is_empty() {
        return usage(
            "relight needs --source and --target (each an environment; --source estimate for a light that nobody knows)",
        );
    }
    let names = object_names(&scene, &assets);
    let is_for_many = light.target.len() > 1 || light.target.iter().any(|t| t.is_dir());
    let objects = names.into_iter().zip(endings(&assets)).collect();
    let output = SplatOutput::new(&args.output, objects, is_for_many)?;
    let outputs: Vec<PathBuf> = named.iter().flat_map(|(t, _)| output.files(t)).collect();
    output.check(light.inputs(&scene, &named), &outputs)?;
    let mut headless = Headless::load(args.asset.options.device, scene, &mut summary)?;
    let targets = headless.light(&light, &mut summary)?;
    headless.prepare(&mut summary)?;
    // One of all holds them where they stand; else each is written as it was captured.
    let is_each = headless.shots.project.is_composed() && !output.is_file;
    let mut written = Vec::new();
    for target in &targets {
        let light = headless.light_by(target, &mut summary)?;
        let files = output.files(&target.name);
        let relit = headless.relight_splats(&target.name, &light, is_each, &mut summary)?;
        headless.write_splats(relit, &files, is_each, &mut summary)?;
        written.extend(files.iter().map(|file| file.display().to_string()));
    }
    summary.set("outputs", written.clone());
    summary.finish(&format!("wrote {}", written.join(", ")))
}

/// A name for each object's file: its own, or its splat's; no two are the same.
fn object_names(scene: &Scene, assets: &[PathBuf]) -> Vec<String> {
    let shown = scene.objects.iter().filter(|o| o.shown).zip(assets);
    distinct_names(shown.map(|(object, asset)| as_file_name(&name_of(object, asset))))
}

/// The ending of each asset's files: that of the format that it came in.
fn endings(assets: &[PathBuf]) -> impl Iterator<Item = &'static str> {
    let ending = |asset: &PathBuf| match file_kind(asset) {
        Ok(FileKind::Splat(format)) => format.ending(),
        _ => None,
    };
    assets
        .iter()
        .map(move |asset| ending(asset).unwrap_or(".ply"))
}

fn ends_with_slash(path: &Path) -> bool {
    path.to_string_lossy().ends_with('/')
}

/// Where splats go: one file, or a folder with one a light and object.
struct SplatOutput<'a> {
    path: &'a Path,
    is_file: bool,
    is_for_many: bool,
    /// Name and ending of each object's file.
    objects: Vec<(String, &'static str)>,
}

impl<'a> SplatOutput<'a> {
    fn new(
        path: &'a Path,
        objects: Vec<(String, &'static str)>,
        is_for_many: bool,
    ) -> Result<Self> {
        let is_splat = !path.is_dir() && SplatFormat::of_name(path).is_some();
        if is_for_many && is_splat {
            bail!(
                "{}: more than one splat may be written; give a folder",
                path.display()
            );
        }
        let is_of_several = objects.len() > 1 && !is_splat;
        Ok(Self {
            path,
            is_for_many,
            is_file: !is_for_many && !is_of_several && !ends_with_slash(path),
            objects,
        })
    }

    /// Refuses files that are inputs, or that cannot be written.
    fn check<'b>(&self, inputs: impl Iterator<Item = &'b Path>, files: &[PathBuf]) -> Result<()> {
        refuse_overwriting(inputs, files)?;
        let path = self.path;
        let is_splat = SplatFormat::of_name(path).is_some();
        let is_folder = self.is_for_many || path.is_dir() || ends_with_slash(path);
        if path.extension().is_some() && !is_splat && !is_folder {
            bail!(
                "{}: a splat is written as .ply, .compressed.ply, .spz, .sog, .splat or .glb; a folder ends with a slash",
                path.display()
            );
        }
        match self.is_file {
            true => check_output(path)?,
            false => check_folder(path)?,
        }
        Ok(())
    }

    /// The files of a light.
    fn files(&self, target: &str) -> Vec<PathBuf> {
        let in_folder = |folder: &Path| {
            let each = self.objects.iter();
            each.map(|(name, ending)| folder.join(format!("{name}{ending}")))
                .collect()
        };
        match (&self.objects[..], self.is_file) {
            (_, true) => vec![self.path.to_owned()],
            ([(_, ending)], false) => vec![self.path.join(format!("{target}{ending}"))],
            (_, false) if self.is_for_many => in_folder(&self.path.join(target)),
            (_, false) => in_folder(self.path),
        }
    }
}
