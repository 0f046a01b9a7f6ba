//! `transplat relight`: the asset under another light, as a splat.

use std::path::PathBuf;

use anyhow::{Result, bail};
use transplat_core::files::{check_output, write_relit};
use transplat_core::transfer::Part;

use crate::cli::{RelightArgs, usage};
use crate::commands::{make_folder, refuse_overwriting};
use crate::pipeline::Pipeline;
use crate::pipeline::settings::{asset_of, look_of, targets_of};
use crate::summary::Summary;

pub fn run(args: &RelightArgs) -> Result<()> {
    let mut summary = Summary::new("relight", &args.out);
    let scene = look_of(&args.asset.options, Some(&args.light))?;
    let named = targets_of(&args.light, &scene)?;
    if scene.objects[0].source.file.is_none() || named.is_empty() {
        usage(
            "relight needs --source and --target (each an environment; --source estimate for a light that nobody knows)",
        );
    }
    let asset = asset_of(&args.asset, &scene);
    let many = args.light.target.len() > 1
        || args.light.target.iter().any(|t| t.is_dir())
        || args.output.to_string_lossy().ends_with('/');
    let output = |name: &str| {
        if many {
            args.output.join(format!("{name}.ply"))
        } else {
            args.output.clone()
        }
    };
    let extension = args.output.extension().filter(|_| !args.output.is_dir());
    let is_named_as_file = extension.is_some_and(|e| e.eq_ignore_ascii_case("ply"));
    if many && is_named_as_file {
        bail!(
            "{}: more than one splat may be written; give a folder",
            args.output.display()
        );
    }
    let outputs: Vec<PathBuf> = named.iter().map(|(name, _)| output(name)).collect();
    let inputs = args.light.inputs(&scene, &named).chain([&*asset]);
    refuse_overwriting(inputs, &outputs)?;
    if !many {
        check_output(&args.output)?;
    }
    if !many && extension.is_some() && !is_named_as_file {
        bail!(
            "{}: a splat is written as .ply; a folder ends with a slash",
            args.output.display()
        );
    }
    let pipeline = Pipeline::load(&args.asset, scene, &mut summary)?;
    let lights = pipeline.lights(&args.light, &mut summary)?;
    if many {
        make_folder(&args.output)?;
    }
    let bake = pipeline.bake(args.light.bake.as_deref(), &mut summary)?;
    let (prepared, mut transfer) = pipeline.prepare(&bake, &lights, &mut summary)?;
    for (target, output) in lights.targets.iter().zip(&outputs) {
        let [_, light] = lights.oriented(&pipeline, target);
        let wanted = (&light, Part::Whole, &[][..]);
        let relit =
            pipeline.relight(&prepared, &mut transfer, &target.name, wanted, &mut summary)?;
        summary.time("export", || {
            let stored = relit.stored(&pipeline.cloud);
            write_relit(&pipeline.file, &stored, output)
        })?;
    }
    let names: Vec<String> = outputs.iter().map(|o| o.display().to_string()).collect();
    summary.set("outputs", names.clone());
    summary.finish(&format!("wrote {}", names.join(", ")))
}
