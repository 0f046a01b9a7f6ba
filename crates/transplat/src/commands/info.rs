//! `transplat info`: content of a file, and its oddities.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use glam::{DVec3, Vec3};
use transplat_core::color::luminance;
use transplat_core::crop::proposed_crop;
use transplat_core::environment::{ImageReading, project_environment};
use transplat_core::files::{
    FileKind, SplatFile, SplatKind, file_kind, inspect_bake, load_cameras, load_environment_as,
    load_look, load_lut, load_rig, load_splat, look_text,
};
use transplat_core::lut::Table;
use transplat_core::numeric::quantile;
use transplat_core::scene::{Around, EnvironmentLight, Light, Scene, is_file};
use transplat_core::surfels::SurfelCloud;

use super::headless::Headless;
use crate::cli::InfoArgs;
use crate::summary::Summary;
use transplat_engine::device::Device;
use transplat_engine::device::DeviceChoice;
use transplat_engine::estimate::estimate_in_words;
use transplat_engine::warnings::{asset_warnings, map_warnings, up_warning};

pub fn run(args: &InfoArgs) -> Result<()> {
    let mut summary = Summary::new("info", &args.out);
    let path = &args.file;
    let mut lines = vec![path.display().to_string()];
    let kind = file_kind(path)?;
    if args.estimate_light && !matches!(kind, FileKind::Splat(_)) {
        bail!("{}: --estimate-light is for a splat", path.display());
    }
    match kind {
        FileKind::Splat(_) => {
            if args.estimate_light {
                let device = Device::open(DeviceChoice::Auto)?;
                let mut scene = Scene::default();
                scene.objects[0].asset = Some(path.to_owned());
                let mut headless = Headless::of(scene, device, &mut summary)?;
                let (_, first) = headless.first();
                asset(&first.cloud, &first.file, &mut summary, &mut lines);
                let estimate = headless.estimate_first(None, &mut summary)?;
                lines.push(estimate_in_words(&estimate, headless.shots.cloud.up));
            } else {
                let (cloud, file) = summary.time("load", || load_splat(path))?;
                asset(&cloud, &file, &mut summary, &mut lines);
                if let Some(warning) = up_warning(path, &cloud, &file) {
                    summary.warn(warning);
                }
            }
        }
        FileKind::Hdr | FileKind::Exr | FileKind::Picture => {
            let reading = ImageReading {
                layout: None,
                layer: args.layer.clone(),
            };
            environment(path, &reading, &mut summary, &mut lines)?
        }
        FileKind::Bake => {
            let header = inspect_bake(path)?;
            summary.set("kind", "bake");
            summary.set("surfels", header.surfels);
            summary.set("preset", header.method.preset());
            summary.set("directions", header.directions);
            summary.set("geometry_key", format!("{:016x}", header.geometry_key));
            lines.push(format!(
                "bake for preset {} of {} Gaussians, {} directions, geometry {:016x}",
                header.method.preset(),
                header.surfels,
                header.directions,
                header.geometry_key
            ));
        }
        FileKind::Lut => {
            let lut = load_lut(path)?;
            let edge = |table: Option<&Table>| table.map_or(0, |t| t.size);
            let (curves, cube) = (edge(lut.curves.as_ref()), edge(lut.cube.as_ref()));
            summary.set("kind", "lut");
            summary.set("curve_entries", curves);
            summary.set("cube_edge", cube);
            let of_curves = (curves > 0).then(|| format!("curves of {curves} entries"));
            let of_cube = (cube > 0).then(|| format!("a cube of {cube} x {cube} x {cube}"));
            for warning in &lut.warnings {
                summary.warn(format!("{}: {warning}", path.display()));
            }
            let tables: Vec<String> = of_curves.into_iter().chain(of_cube).collect();
            lines.push(format!("LUT: {}", tables.join(", ")));
        }
        FileKind::Look => {
            let scene = load_look(path)?;
            summary.set("kind", "look");
            let text = look_text(&scene).map_err(anyhow::Error::msg)?;
            summary.set("look", serde_json::from_str::<serde_json::Value>(&text)?);
            look(&scene, &mut summary, &mut lines);
        }
        FileKind::Cameras => {
            let file = load_cameras(path)?;
            summary.set("kind", "cameras");
            summary.set("cameras", file.frames.len());
            lines.push(format!("{} cameras", file.frames.len()));
            if let Some(frame) = file.frames.first() {
                let size = frame.size.map(|[w, h]| format!(", {w} x {h} pixels"));
                lines.push(format!(
                    "the first: {:.1} degrees across{}",
                    frame.fov_x.to_degrees(),
                    size.unwrap_or_default()
                ));
            }
            for warning in file.warnings {
                summary.warn(warning);
            }
        }
        FileKind::Rig => {
            let rig = load_rig(path)?;
            summary.set("kind", "rig");
            summary.set("rig", serde_json::to_value(&rig)?);
            let count = rig.lights.len();
            let lights = if count == 1 { "light" } else { "lights" };
            lines.push(format!("rig of {count} {lights}"));
            lines.extend(rig.lights.iter().enumerate().map(light_line));
            lines.push(match &rig.environment {
                None => "around them whatever there is".into(),
                Some(Around::Nothing) => "nothing around them".into(),
                Some(Around::Uniform { uniform: [r, g, b] }) => {
                    format!("uniform light of {r} {g} {b} around them")
                }
                Some(Around::Sky { .. }) => "sun and sky around them".into(),
                Some(Around::File { file, .. }) => format!("{} around them", file.display()),
            });
        }
    }
    summary.finish(&lines.join("\n  "))
}

/// A light of a rig or a look, by its number from 0.
fn light_line((at, light): (usize, &Light)) -> String {
    let number = at + 1;
    let kind = light.source.kind();
    let [r, g, b] = light.source.emission();
    let mut said = vec![
        format!("light {number}: {}", kind.name()),
        format!("emits {r} {g} {b} {}", kind.unit()),
    ];
    if !light.name.is_empty() {
        said.insert(1, light.name.clone());
    }
    if let Some(position) = light.source.position() {
        let [x, y, z] = position.to_array();
        said.push(format!("at {x:.3},{y:.3},{z:.3}"));
    }
    if light.strength != 0.0 {
        said.push(format!("{:+} stops", light.strength));
    }
    if !light.on {
        said.push("off".into());
    }
    said.join(", ")
}

/// Describes a look in a few lines; the JSON object has all of it.
fn look(scene: &Scene, summary: &mut Summary, lines: &mut Vec<String>) {
    let count = scene.objects.len();
    let objects = if count == 1 { "object" } else { "objects" };
    lines.push(format!("look of {count} {objects}"));
    let file = |light: &EnvironmentLight| {
        let path = light.file.as_ref();
        path.map(|path| path.display().to_string())
    };
    let mut files = Vec::new();
    for (at, object) in scene.objects.iter().enumerate() {
        let called = object.called().unwrap_or_else(|| "any splat".into());
        let mut said = vec![format!("{}: {called}", at + 1)];
        if let Some(asset) = &object.asset {
            said.push(asset.display().to_string());
            files.push(asset);
        }
        if !object.cut.is_empty() {
            let cuts = object.cut.len();
            let times = if cuts == 1 { "box" } else { "boxes" };
            said.push(format!("cut by {cuts} {times}"));
        }
        let source = file(&object.source).unwrap_or_else(|| "unknown".into());
        said.push(format!("captured under {source}"));
        if !object.shown {
            said.push("not shown".into());
        }
        lines.push(said.join(", "));
        files.extend(&object.source.file);
    }
    let target = file(&scene.environment);
    let target = target.or_else(|| file(&scene.objects[0].source).filter(|_| count > 1));
    let target = target.unwrap_or_else(|| "whatever light is named".into());
    lines.push(format!(
        "relit by {target}, preset {}",
        scene.transfer.method.preset()
    ));
    lines.extend(scene.lights.iter().enumerate().map(light_line));
    if let Some(plate) = &scene.plate {
        lines.push(format!("before the photograph {}", plate.display()));
    }
    files.extend(&scene.environment.file);
    files.extend(&scene.plate);
    files.extend(&scene.lut);
    let mut missing: Vec<&PathBuf> = Vec::new();
    for path in files {
        if is_file(path) && !path.exists() && !missing.contains(&path) {
            missing.push(path);
        }
    }
    for path in missing {
        summary.warn(format!("{}: is not there", path.display()));
    }
    lines.push("all its settings: --json".into());
}

fn asset(cloud: &SurfelCloud, file: &SplatFile, summary: &mut Summary, lines: &mut Vec<String>) {
    let found = &file.report;
    let kind = match found.kind {
        SplatKind::Surfels2d => "2DGS",
        SplatKind::Gaussians3d => "3DGS",
    };
    let bounds = cloud.bounds();
    summary.set("kind", kind);
    summary.set("format", found.format.clone());
    summary.set("surfels", cloud.len());
    summary.set("sh_degree", cloud.sh_degree);
    summary.set("up", cloud.up.name());
    let center = (cloud.origin + bounds.center.as_dvec3()).to_array();
    summary.set("center", center.to_vec());
    if cloud.origin != DVec3::ZERO {
        summary.set("origin", cloud.origin.to_array().to_vec());
    }
    summary.set("radius", bounds.radius);
    summary.set("left_out", found.skipped_work.len());
    summary.set("properties", found.properties.clone());
    summary.set("comments", found.comments.clone());
    lines.push(format!(
        "{kind} splat in {}, {} Gaussians, SH degree {}",
        found.format,
        cloud.len(),
        cloud.sh_degree
    ));
    let why = if found.up.is_some() {
        "the file says so"
    } else {
        "assumed; the file does not say: see --up"
    };
    lines.push(format!("up {} ({why})", cloud.up.name()));
    lines.push(format!(
        "centre {:.3?}, radius {:.3}",
        center, bounds.radius
    ));
    if cloud.origin != DVec3::ZERO {
        lines.push(format!(
            "far from the origin of its coordinates: inside, positions are relative to {:?}, which is added again where it is written",
            cloud.origin.to_array()
        ));
    }
    if let Some(corners) = proposed_crop(cloud, &bounds) {
        let corner = |c: Vec3| cloud.origin + (bounds.center + c * bounds.radius).as_dvec3();
        let [low, high] = corners.map(|c| corner(c).to_array());
        lines.push(format!(
            "holds surroundings, it seems: the object lies between {low:.3?} and {high:.3?}"
        ));
        summary.set("object_between", [low, high]);
    }
    let sizes: Vec<f32> = cloud.scales.iter().map(|s| s.max_element()).collect();
    let [small, middle, large] =
        [0.05, 0.5, 0.95].map(|share| quantile(sizes.clone(), share).unwrap_or(0.0));
    lines.push(format!(
        "larger standard deviation: 5 % {small:.5}, median {middle:.5}, 95 % {large:.5}"
    ));
    summary.set("median_scale", middle);
    let faint = cloud.opacities.iter().filter(|o| **o < 1.0 / 255.0).count();
    let median_opacity = quantile(cloud.opacities.clone(), 0.5).unwrap_or(0.0);
    summary.set("median_opacity", median_opacity);
    lines.push(format!(
        "median opacity {median_opacity:.3}; {faint} Gaussians nearly transparent"
    ));
    if let Some(flatness) = found.median_flatness {
        summary.set("median_flatness", flatness);
        lines.push(format!(
            "median shortest/second axis {flatness:.3} (0 is flat; the shortest axis is the normal)"
        ));
    }
    if !cloud.has_view_dependence() {
        lines.push(
            "colour does not depend on the view: there is no specular part to transfer".into(),
        );
    }
    let is_far = |p: &&Vec3| p.distance(bounds.center) > 1.5 * bounds.radius;
    let far = cloud.positions.iter().filter(is_far).count();
    if far > 0 {
        summary.warn(format!("{far} Gaussians float far outside of the object"));
    }
    for warning in asset_warnings(&file.path, file) {
        summary.warn(warning);
    }
    for comment in &found.comments {
        lines.push(format!("comment: {comment}"));
    }
    if !found.properties.is_empty() {
        lines.push(format!("properties: {}", shortened(&found.properties)));
    }
}

/// Property names, with `f_rest_0 .. f_rest_44` told as a range.
fn shortened(names: &[String]) -> String {
    let rest = names.iter().filter(|n| n.starts_with("f_rest_")).count();
    let mut out: Vec<String> = Vec::new();
    let mut is_listed = false;
    for name in names {
        if !name.starts_with("f_rest_") {
            out.push(name.clone());
        } else if !std::mem::replace(&mut is_listed, true) {
            out.push(format!("f_rest_0..{}", rest - 1));
        }
    }
    out.join(" ")
}

fn environment(
    path: &Path,
    reading: &ImageReading,
    summary: &mut Summary,
    lines: &mut Vec<String>,
) -> Result<()> {
    let map = summary.time("load", || load_environment_as(path, reading))?;
    let light = summary.time("project", || project_environment(&map, 3));
    let mean = light.coefficients[0].map(|v| v / transplat_core::sh::SQRT_4PI as f32);
    let luminances = map.pixels().iter().map(|p| luminance(*p));
    let peak = luminances.fold(0f32, f32::max);
    let share = map.brightest_share(0.001);
    summary.set("kind", "environment");
    let [width, height] = map.picture_size();
    summary.set("width", width);
    summary.set("height", height);
    summary.set("mean_radiance", mean.to_vec());
    summary.set("mean_irradiance", light.mean_irradiance());
    summary.set("peak_luminance", peak);
    summary.set("brightest_thousandth_share", share);
    summary.set("repaired", map.repaired());
    summary.set("infinite", map.infinite());
    let from = map.provenance();
    if let Some(layer) = &from.layer {
        summary.set("layer", layer.clone());
        summary.set("layers", from.layers.clone());
    }
    let layout = serde_json::to_value(map.layout())?;
    let layout = layout.as_str().unwrap_or_default();
    summary.set("layout", layout);
    lines.push(format!("environment, {width} x {height} pixels, {layout}"));
    lines.push(format!(
        "mean radiance {mean:.4?}, mean irradiance {:.4}",
        light.mean_irradiance()
    ));
    lines.push(format!("brightest pixel {peak:.1}; the brightest thousandth of the sphere sends {:.0} % of the light", 100.0 * share));
    if share > 0.3 {
        lines.push("most of it comes from one or a few small lamps or a sun: a low SH degree blurs its shadows".into());
    }
    for warning in map_warnings(path, &map, reading) {
        summary.warn(warning);
    }
    if light.is_black() {
        summary.warn("black: it lights nothing");
    }
    Ok(())
}
