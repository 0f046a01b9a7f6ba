//! `transplat relight`: splats under another light, as splats.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use transplat_core::color::Encoding;
use transplat_core::environment::Illumination;
use transplat_core::files::{
    FileKind, SplatFormat, check_folder, check_output, file_kind, losses, write_relit, write_splat,
};
use transplat_core::scene::Scene;
use transplat_core::transfer::{Part, PreparedTransfer};

use super::headless::Headless;
use super::settings::{assets_of, check_objects, look_of, targets_of, with_scene_as_look};
use crate::cli::{RelightArgs, usage};
use crate::commands::refuse_overwriting;
use crate::summary::Summary;
use transplat_engine::device::Transfer;
use transplat_engine::names::{as_file_name, distinct_names, name_of};
use transplat_engine::output::make_folder;
use transplat_engine::splat::Splat;

pub fn run(args: &RelightArgs) -> Result<()> {
    let mut summary = Summary::new("relight", &args.out);
    let (asset, light) = with_scene_as_look(&args.asset, &args.light);
    let scene = look_of(&asset.options, Some(&light))?;
    check_objects(&asset, &scene, true)?;
    let named = targets_of(&light, &scene)?;
    let shown = || scene.objects.iter().filter(|o| o.shown);
    if shown().any(|o| o.source.file.is_none()) || named.is_empty() {
        return usage(
            "relight needs --source and --target (each an environment; --source estimate for a light that nobody knows)",
        );
    }
    let assets = assets_of(&asset, &scene)?;
    let names = object_names(&scene, &assets);
    let is_for_many = light.target.len() > 1 || light.target.iter().any(|t| t.is_dir());
    let objects = names.into_iter().zip(endings(&assets)).collect();
    let output = SplatOutput::new(&args.output, objects, is_for_many)?;
    let outputs: Vec<PathBuf> = named.iter().flat_map(|(t, _)| output.files(t)).collect();
    let inputs = light
        .inputs(&scene, &named)
        .chain(assets.iter().map(|a| &**a));
    refuse_overwriting(inputs, &outputs)?;
    output.check_name()?;
    if output.is_file {
        check_output(&args.output)?;
    } else {
        check_folder(&args.output)?;
    }
    let mut headless = Headless::load(&asset, scene, &mut summary)?;
    let targets = headless.light(&light, &mut summary)?;
    let (prepared, _) = headless.prepare(&mut summary)?;
    let mut transfer = headless.transfer(&prepared, &mut summary)?;
    for target in &targets {
        let light = headless.light_by(target, &mut summary)?;
        let files = output.files(&target.name);
        for folder in files
            .iter()
            .filter_map(|f| f.parent())
            .filter(|_| !output.is_file)
        {
            make_folder(folder)?;
        }
        let by = (&prepared, &mut transfer);
        let files = (&files[..], output.is_file);
        write(&headless, by, (&target.name, &light), files, &mut summary)?;
    }
    let written = targets.iter().flat_map(|t| output.files(&t.name));
    let names: Vec<String> = written.map(|o| o.display().to_string()).collect();
    summary.set("outputs", names.clone());
    summary.finish(&format!("wrote {}", names.join(", ")))
}

/// Writes what a light makes of the scene: each object into a file of its own, as it was captured, or all into one, where they stand.
fn write(
    headless: &Headless,
    (prepared, transfer): (&PreparedTransfer, &mut Transfer),
    (name, light): (&str, &Illumination),
    (files, is_one_of_all): (&[PathBuf], bool),
    summary: &mut Summary,
) -> Result<()> {
    let is_scene = matches!(
        prepared,
        PreparedTransfer::Scene(_) | PreparedTransfer::HarmonicScene(_)
    );
    if is_scene && !is_one_of_all {
        let relit = headless.relight_objects(prepared, name, light, summary)?;
        for (((at, _, asset), relit), file) in headless.project.shown().zip(relit).zip(files) {
            let cloud = asset.upright(headless.project.up_of(at));
            summary.time("export", || {
                write_relit(&asset.file, &cloud, &relit.stored(&cloud), file)
            })?;
            warn_of_losses(asset, file, summary);
        }
        return Ok(());
    }
    let wanted = (light, Part::Whole, &[][..]);
    let relit = headless.relight(prepared, transfer, name, wanted, summary)?;
    let (cloud, (_, asset)) = (&headless.cloud, headless.first());
    summary.time("export", || {
        if is_scene {
            let stored = relit.stored_as(cloud.sh_degree, Encoding::Stored);
            write_splat(cloud, &stored, &files[0])
        } else {
            write_relit(&asset.file, cloud, &relit.stored(cloud), &files[0])
        }
    })?;
    if !is_scene {
        warn_of_losses(asset, &files[0], summary);
    }
    Ok(())
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

fn warn_of_losses(asset: &Splat, path: &Path, summary: &mut Summary) {
    if let Some(lost) = losses(&asset.file, &asset.cloud, path) {
        summary.warn(format!("{}: {lost}", path.display()));
    }
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
            is_file: !is_for_many && !is_of_several && !path.to_string_lossy().ends_with('/'),
            is_for_many,
            objects,
        })
    }

    /// Refuses a file that is called as no splat is.
    fn check_name(&self) -> Result<()> {
        let extension = self.path.extension().filter(|_| !self.path.is_dir());
        let is_splat = SplatFormat::of_name(self.path).is_some();
        let is_folder = self.is_for_many || self.path.to_string_lossy().ends_with('/');
        if extension.is_some() && !is_splat && !is_folder {
            bail!(
                "{}: a splat is written as .ply, .compressed.ply, .spz, .sog, .splat or .glb; a folder ends with a slash",
                self.path.display()
            );
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
