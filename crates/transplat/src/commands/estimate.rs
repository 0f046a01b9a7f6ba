//! `transplat estimate`: the light of the capture, into a file.

use anyhow::{Result, bail};
use transplat_core::files::{check_output, write_environment};

use super::headless::Headless;
use super::settings::{assets_of, look_of, name_asset};
use crate::cli::EstimateArgs;
use crate::commands::refuse_overwriting;
use crate::summary::Summary;
use transplat_engine::estimate::estimate_in_words;

pub fn run(args: &EstimateArgs) -> Result<()> {
    let mut summary = Summary::new("estimate", &args.out);
    let mut scene = look_of(&args.asset.options, None)?;
    name_asset(&mut scene, &args.asset);
    let assets = assets_of(&scene)?;
    let inputs = args.bake.iter().chain(&assets).map(|p| &**p);
    refuse_overwriting(inputs, &[&args.output])?;
    let extension = args.output.extension().unwrap_or_default();
    if !extension.eq_ignore_ascii_case("exr") {
        bail!("{}: the light is written as .exr", args.output.display());
    }
    check_output(&args.output)?;
    let mut headless = Headless::load(args.asset.options.device, scene, &mut summary)?;
    let estimate = headless.estimate_first(args.bake.as_deref(), &mut summary)?;
    if let Some(obstacle) = estimate.obstacle {
        bail!(
            "{}: the capture light cannot be estimated from the object: {}",
            assets[0].display(),
            obstacle.reason()
        );
    }
    let map = estimate.light.map(headless.shots.cloud.up);
    summary.time("export", || write_environment(&args.output, &map))?;
    summary.set("output", args.output.display().to_string());
    summary.finish(&format!(
        "wrote {}: {}",
        args.output.display(),
        estimate_in_words(&estimate, headless.shots.cloud.up)
    ))
}
