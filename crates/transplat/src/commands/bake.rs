//! `transplat bake`: visibility into a file.

use anyhow::Result;
use transplat_core::export::{check_output, save_bake};

use crate::cli::BakeArgs;
use crate::commands::refuse_overwriting;
use crate::report::Report;
use crate::scene::{Scene, asset_of, look_of};

pub fn run(args: &BakeArgs) -> Result<()> {
    let mut report = Report::new("bake", &args.out);
    let look = look_of(&args.asset.options, None)?;
    refuse_overwriting([&*asset_of(&args.asset, &look)], [&*args.output])?;
    check_output(&args.output)?;
    let scene = Scene::load(&args.asset, look, &mut report)?;
    let visibility = scene.bake(None, &mut report)?;
    report.time("export", || {
        save_bake(&args.output, &scene.cloud, &visibility)
    })?;
    report.set("output", args.output.display().to_string());
    let two_sided = visibility.two_sided.iter().filter(|t| **t).count();
    report.finish(&format!(
        "wrote {}: {} surfels, {} directions; {} normals turned, {two_sided} two-sided, {} buried",
        args.output.display(),
        scene.cloud.len(),
        visibility.directions,
        visibility.flipped,
        visibility.buried
    ))
}
