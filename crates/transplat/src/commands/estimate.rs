//! `transplat estimate`: the light of the capture, into a file.

use anyhow::{Result, bail};
use transplat_core::estimate::Estimate;
use transplat_core::files::{ExrFloats, check_output, write_exr};
use transplat_core::rasterize::Raster;
use transplat_core::surfels::UpAxis;

use crate::cli::EstimateArgs;
use crate::commands::refuse_overwriting;
use crate::report::Report;
use crate::scene::{Scene, asset_of, look_of};

pub fn run(args: &EstimateArgs) -> Result<()> {
    let mut report = Report::new("estimate", &args.out);
    let look = look_of(&args.asset.options, None)?;
    let asset = asset_of(&args.asset, &look);
    refuse_overwriting(
        [Some(&*asset), args.bake.as_deref()].into_iter().flatten(),
        [&*args.output],
    )?;
    let extension = args.output.extension().unwrap_or_default();
    if !extension.eq_ignore_ascii_case("exr") {
        bail!("{}: the light is written as .exr", args.output.display());
    }
    check_output(&args.output)?;
    let scene = Scene::load(&args.asset, look, &mut report)?;
    let estimate = scene.estimate(args.bake.as_deref(), &mut report)?;
    if let Some(obstacle) = estimate.obstacle {
        bail!(
            "{}: the light of the capture cannot be told from the splat: {}; with --source estimate, half of the change is made that would be right under even light",
            asset.display(),
            obstacle.reason()
        );
    }
    let map = estimate.light.map(scene.cloud.up);
    let raster = Raster {
        width: map.width(),
        height: map.height(),
        pixels: map
            .pixels()
            .iter()
            .map(|&[r, g, b]| [r, g, b, 1.0])
            .collect(),
        depth: Vec::new(),
    };
    report.time("export", || {
        write_exr(&args.output, &raster, ExrFloats::Full)
    })?;
    report.set("output", args.output.display().to_string());
    report.finish(&format!(
        "wrote {}: {}",
        args.output.display(),
        summary(estimate, scene.cloud.up)
    ))
}

/// For the user.
pub fn summary(estimate: &Estimate, up: UpAxis) -> String {
    let percent = estimate.percent();
    if let Some(obstacle) = estimate.obstacle {
        return format!(
            "the light of the capture cannot be told: {} (confidence {percent:.0} %)",
            obstacle.reason()
        );
    }
    let from = estimate.light.dominant_direction();
    let sun = match estimate.light.sun {
        Some((d, _)) => format!("a sun at {:.2} {:.2} {:.2}", d[0], d[1], d[2]),
        None => "no sun".into(),
    };
    let doubtful = if estimate.may_lie_on_its_side(up) {
        format!(
            "; that is the side or below, with {} up: is it (--up)?",
            up.name()
        )
    } else {
        String::new()
    };
    format!(
        "light mostly from {:.2} {:.2} {:.2} (the asset's coordinates), {sun}, confidence {percent:.0} %; strength and tint are assumed{doubtful}",
        from.x, from.y, from.z
    )
}
