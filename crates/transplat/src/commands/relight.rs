//! `transplat relight`: the asset under another light, as a splat.

use std::path::PathBuf;

use anyhow::{Context, Result};
use transplat_core::color::encode_sh;
use transplat_core::export::{check_output, write_relit_ply};

use crate::cli::RelightArgs;
use crate::report::Report;
use crate::scene::{Scene, look_of};

pub fn run(args: &RelightArgs) -> Result<()> {
    let mut report = Report::new("relight", &args.out);
    let (Some(source), false) = (&args.light.source, args.light.target.is_empty()) else {
        crate::commands::usage(
            "relight needs --source and --target (each an environment, or \"even\")",
        );
    };
    let look = look_of(&args.asset, Some(&args.light))?;
    let many = args.light.target.len() > 1 || args.light.target.iter().any(|t| t.is_dir());
    if many {
        std::fs::create_dir_all(&args.output).with_context(|| args.output.display().to_string())?;
    } else {
        check_output(&args.output)?;
    }
    let scene = Scene::load(&args.asset, look, &mut report)?;
    let lights = scene.lights(&args.light, source, &mut report)?;
    let visibility = scene.bake(args.light.bake.as_deref(), &mut report)?;
    let prepared = scene.prepare(&visibility, &lights.source, &mut report)?;
    let mut transfer = scene.device.transfer(&prepared)?;
    let mut outputs: Vec<PathBuf> = Vec::new();
    for target in &lights.targets {
        let output = if many {
            args.output.join(format!("{}.ply", target.name))
        } else {
            args.output.clone()
        };
        let relit = scene.relight(&prepared, &mut transfer, target, &mut report)?;
        report.time("export", || {
            let stored = encode_sh(relit, scene.cloud.sh_degree, scene.cloud.encoding);
            write_relit_ply(&scene.file, &stored, &output)
        })?;
        outputs.push(output);
    }
    let names: Vec<String> = outputs.iter().map(|o| o.display().to_string()).collect();
    report.set("outputs", names.clone());
    report.finish(&format!("wrote {}", names.join(", ")))
}
