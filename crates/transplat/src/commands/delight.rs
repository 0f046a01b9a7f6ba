//! `transplat delight`: an asset without its light.

use std::path::PathBuf;

use anyhow::Result;
use transplat_core::files::{check_output, losses};
use transplat_core::scene::{EVEN, Transform};

use super::headless::Headless;
use super::settings::{check_objects, scene_of};
use crate::cli::{DelightArgs, LightArgs, usage};
use crate::commands::{called_as_a_splat, refuse_overwriting};
use crate::summary::Summary;
use transplat_engine::delight::Delit;

pub fn run(args: &DelightArgs) -> Result<()> {
    let mut summary = Summary::new("delight", &args.out);
    let light = LightArgs {
        capture: args.capture.clone(),
        target: vec![PathBuf::from(EVEN)],
        ..LightArgs::default()
    };
    let (mut scene, light) = scene_of(&args.asset, &light)?;
    refuse_overwriting(light.inputs(&scene, &[]), &[&args.output])?;
    let others = scene.objects.len() - 1;
    if others > 0 {
        summary.warn(format!(
            "of the {} objects of the look the first is taken",
            others + 1
        ));
    }
    // What it is made of is the same wherever it stands.
    scene.objects.truncate(1);
    scene.objects[0].shown = true;
    scene.objects[0].transform = Transform::default();
    check_objects(&scene, true)?;
    if scene.objects[0].source.file.is_none() {
        return usage(
            "delight needs --source, the light of the capture (an environment; estimate for one that nobody knows)",
        );
    }
    let format = called_as_a_splat(&args.output)?;
    if args.materials {
        format.check_materials(&args.output)?;
    }
    check_output(&args.output)?;
    let mut headless = Headless::load(args.asset.options.device, scene, &mut summary)?;
    headless.light(&light, &mut summary)?;
    let prepared = headless.prepare(&mut summary)?;
    let (cloud, (_, asset)) = (&headless.shots.cloud, headless.first());
    let whitest = args.whitest.map(|w| w as f32);
    let delit = summary.time("delight", || {
        Delit::of(&prepared, cloud, args.delit_as, whitest)
    })?;
    for warning in delit.warnings(whitest) {
        summary.warn(warning);
    }
    let share = |is: &dyn Fn(usize) -> bool| {
        let count = (0..delit.materials.each.len()).filter(|i| is(*i)).count();
        count as f32 / delit.materials.each.len().max(1) as f32
    };
    let emissive = share(&|i| delit.materials.each[i].emission_share > 0.5);
    let metallic = share(&|i| delit.materials.each[i].metallic > 0.5);
    let (whitest, gain) = (delit.materials.whitest, delit.materials.gain);
    if let Some(lost) = losses(&asset.file, &delit.cloud, &args.output) {
        summary.warn(format!("{}: {lost}", args.output.display()));
    }
    summary.time("export", || {
        delit.write(&asset.file, args.materials, &args.output)
    })?;
    summary.set("trust", delit.trust);
    summary.set("whitest_albedo", whitest * gain);
    summary.set("glowing_share", emissive);
    summary.set("metallic_share", metallic);
    summary.set("output", args.output.display().to_string());
    summary.finish(&format!(
        "wrote {}: whitest albedo {:.2}, {:.1} % of the Gaussians metal, {:.1} % shining by themselves",
        args.output.display(),
        whitest * gain,
        100.0 * metallic,
        100.0 * emissive
    ))
}
