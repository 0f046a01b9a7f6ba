//! `transplat bake`: visibility into a file.

use anyhow::Result;
use transplat_core::files::{check_output, save_bake};

use super::headless::{Headless, two_sided};
use super::settings::{assets_of, look_of, name_asset};
use crate::cli::BakeArgs;
use crate::commands::refuse_overwriting;
use crate::summary::Summary;

pub fn run(args: &BakeArgs) -> Result<()> {
    let mut summary = Summary::new("bake", &args.out);
    let told = bake(args, &mut summary)?;
    summary.finish(&told)
}

/// Bakes, and says what was written.
pub fn bake(args: &BakeArgs, summary: &mut Summary) -> Result<String> {
    let mut scene = look_of(&args.asset.options, None)?;
    name_asset(&mut scene, &args.asset);
    scene.transfer.method = args.preset.unwrap_or_default();
    let assets = assets_of(&scene)?;
    refuse_overwriting(assets.iter().map(|a| &**a), &[&args.output])?;
    check_output(&args.output)?;
    let mut headless = Headless::load(args.asset.options.device, scene, summary)?;
    let bake = headless.bake(summary)?;
    summary.time("export", || {
        save_bake(&args.output, &headless.shots.cloud, &bake)
    })?;
    summary.set("output", args.output.display().to_string());
    Ok(format!(
        "wrote {} for preset {}: {} Gaussians of {} bytes, {} directions; {} normals turned, {} two-sided, {} buried",
        args.output.display(),
        bake.method().preset(),
        bake.len(),
        bake.bytes() / bake.len().max(1),
        bake.directions(),
        bake.flipped(),
        two_sided(&bake),
        bake.buried()
    ))
}
