//! `transplat relight`: the asset under another light, as a splat.

use std::path::PathBuf;

use anyhow::{Context, Result, bail};
use transplat_core::color::encode_sh;
use transplat_core::export::write_relit_ply;

use crate::cli::RelightArgs;
use crate::report::Report;
use crate::scene::{Scene, look_of, targets_of};

pub fn run(args: &RelightArgs) -> Result<()> {
    let mut report = Report::new("relight", &args.out);
    let (Some(source), false) = (&args.light.source, args.light.target.is_empty()) else {
        crate::commands::usage(
            "relight needs --source and --target (each an environment, or \"even\")",
        );
    };
    let look = look_of(&args.asset, Some(&args.light))?;
    let targets = targets_of(&args.light)?;
    let many = targets.len() > 1 || args.light.target.iter().any(|t| t.is_dir());
    let scene = Scene::load(&args.asset, look, &mut report)?;
    let visibility = scene.bake(args.light.bake.as_deref(), &mut report)?;
    let prepared = scene.prepare(&visibility, source, &mut report)?;
    if many {
        std::fs::create_dir_all(&args.output).with_context(|| args.output.display().to_string())?;
    } else if args.output.is_dir() {
        bail!(
            "{}: is a directory; the name of a .ply is expected for one target",
            args.output.display()
        );
    }
    let mut outputs: Vec<PathBuf> = Vec::new();
    for (name, path) in &targets {
        let output = if many {
            args.output.join(name).with_extension("ply")
        } else {
            args.output.clone()
        };
        let (light, _) = scene.target(path, &mut report)?;
        let relit = scene.relight(&prepared, name, &light, &mut report)?;
        report.time("export", || {
            let stored = encode_sh(relit, scene.cloud.sh_degree, scene.cloud.encoding);
            write_relit_ply(&scene.file, &stored, &output)
        })?;
        outputs.push(output);
    }
    let names: Vec<String> = outputs.iter().map(|o| o.display().to_string()).collect();
    report.set("outputs", names.clone());
    report.finish(&format!("wrote {}", names.join(", ")));
    Ok(())
}
