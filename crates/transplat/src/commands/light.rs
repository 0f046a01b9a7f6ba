//! `transplat light`: placed lights and their environment as one environment, for other programs.

use std::path::PathBuf;

use anyhow::{Result, bail};
use glam::DVec3;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::files::{
    FileKind, check_output, file_kind, is_environment_name, load_look, write_environment,
};
use transplat_core::scene::{EVEN, EnvironmentLight, Scene, is_estimate, is_even, is_file};
use transplat_core::settings::Method;
use transplat_core::sh::MAX_DEGREE;

use super::headless::{Headless, read_map};
use crate::cli::PanoramaArgs;
use crate::commands::refuse_overwriting;
use crate::commands::settings::{assets_of, take_rig};
use crate::summary::Summary;
use transplat_engine::device::Device;

pub fn run(args: &PanoramaArgs) -> Result<()> {
    let mut summary = Summary::new("light", &args.out);
    if !is_environment_name(&args.output) {
        bail!(
            "{}: an environment is written as .hdr or .exr",
            args.output.display()
        );
    }
    let mut scene = if file_kind(&args.rig)? == FileKind::Rig {
        let mut scene = Scene::default();
        take_rig(&mut scene, &args.rig, args.target.is_none())?;
        scene
    } else {
        let mut scene = load_look(&args.rig)?;
        scene.light_as_captured();
        scene
    };
    if let Some(target) = &args.target {
        scene.environment.set_file(target.clone());
    }
    if scene.environment.file.is_none() {
        summary.note(
            "nothing is around the lights: neither the rig nor --target names an environment"
                .into(),
        );
        scene.environment = EnvironmentLight {
            tint: [0.0; 3],
            ..EnvironmentLight::of(EVEN)
        };
    }
    scene.validate()?;
    let files = scene.environment_lights().filter_map(|l| l.file.clone());
    let files: Vec<PathBuf> = files.filter(|file| is_file(file)).collect();
    let inputs = files.iter().map(|p| &**p).chain([&*args.rig]);
    refuse_overwriting(inputs, &[&args.output])?;
    check_output(&args.output)?;
    let source = scene.objects[0].source.file.as_deref();
    if scene.match_strength && source.is_some_and(is_estimate) {
        scene.match_strength = false;
        summary.warn("how strong the capture's light was is not known, and the environment keeps its own strength");
    }
    let place = place(args, &scene, &mut summary)?;
    let columns = args.columns;
    let around = match scene.environment.sky() {
        Some(sky) => sky.dome_map(columns),
        None => map_of(&scene, &scene.environment, &mut summary)?,
    };
    let light = match scene.environment.sky() {
        Some(sky) => sky.illumination(MAX_DEGREE),
        None => light_of(&around, &mut summary)?,
    };
    let source = match scene.match_strength {
        true => {
            let map = map_of(&scene, &scene.objects[0].source, &mut summary)?;
            light_of(&map, &mut summary)?
        }
        false => Illumination::even(0),
    };
    for (at, light) in scene.lights.iter().enumerate() {
        if light.source.position() == Some(place) {
            let number = at + 1;
            summary.warn(format!(
                "light {number} stands where the lights are seen from (--at), and is not in the map"
            ));
        }
    }
    let map = summary.time("draw", || {
        let maps = [&source, &light];
        let all = scene.light_in_world(maps);
        Ok::<_, anyhow::Error>(scene.panorama(&around, maps, &all, place, columns))
    })?;
    if map.pixels().iter().all(|p| *p == [0.0; 3]) {
        summary.warn(
            "the map is black: no light is on that is seen from there, and nothing is around them",
        );
    }
    summary.time("export", || write_environment(&args.output, &map))?;
    summary.set("seen_from", place.to_array());
    summary.set("output", args.output.display().to_string());
    let is_near = scene
        .lights
        .iter()
        .any(|l| l.on && l.source.position().is_some());
    let near = if is_near {
        let [x, y, z] = place.to_array();
        format!("; what is near is as it is seen from {x:.3},{y:.3},{z:.3}")
    } else {
        String::new()
    };
    summary.finish(&format!("wrote {}{near}", args.output.display()))
}

/// Where the lights are seen from: where that is told, in the middle of a look's splats, or of a rig's own coordinates.
fn place(args: &PanoramaArgs, scene: &Scene, summary: &mut Summary) -> Result<DVec3> {
    if let Some([x, y, z]) = args.at {
        return Ok(DVec3::new(x.into(), y.into(), z.into()));
    }
    if scene.objects.iter().all(|o| o.asset.is_none()) {
        return Ok(DVec3::ZERO);
    }
    assets_of(scene)?;
    let headless = Headless::load(args.options.device, scene.clone(), summary)?;
    let cloud = &headless.shots.cloud;
    let world_from_scene = cloud.up.asset_from_world().transpose();
    Ok(world_from_scene * cloud.bounds().center.as_dvec3())
}

fn map_of(
    scene: &Scene,
    light: &EnvironmentLight,
    summary: &mut Summary,
) -> Result<EnvironmentMap> {
    match light.file.as_deref() {
        None => Ok(EnvironmentMap::even()),
        Some(file) if is_even(file) => Ok(EnvironmentMap::even()),
        Some(file) if is_estimate(file) => bail!(
            "the light of a capture that is to be estimated is written by transplat estimate; name that file here"
        ),
        Some(file) => read_map(file, &scene.reading_of(file), summary),
    }
}

fn light_of(map: &EnvironmentMap, summary: &mut Summary) -> Result<Illumination> {
    summary.time("project", || Device::Cpu.light(map, Method::Directional))
}
