//! Scene of a command line: a look with the options over it. Options for an object are the first one's.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use glam::DVec3;
use transplat_core::files::{FileKind, check_readable, file_kind, load_look, load_rig};
use transplat_core::response::ResponseCurve;
use transplat_core::scene::{EVEN, EnvironmentLight, Scene, moved_lights};
use transplat_core::settings::optimizations::Optimizations;

use crate::cli::{AssetArgs, AssetOptions, LightArgs, Rotation, usage};
use transplat_engine::environments::environments_in;
use transplat_engine::names::{beside, name_of};

/// The splats of the objects that are shown; the first object has one in any case.
pub fn assets_of(scene: &Scene) -> Result<Vec<PathBuf>> {
    let shown = scene.objects.iter().filter(|o| o.shown);
    let assets: Option<Vec<PathBuf>> = shown.map(|o| o.asset.clone()).collect();
    match assets {
        Some(assets) if assets.is_empty() => usage("no object of the scene is shown"),
        Some(assets) if scene.objects[0].asset.is_some() => Ok(assets),
        _ => usage("the splat to work on is needed: ASSET, or --look FILE with one in it"),
    }
}

/// Refuses a scene that names a splat that is not there or, where it is to be relit, tells what some of its objects were captured under and
/// not all. Yields the splats.
pub fn check_objects(scene: &Scene, is_relit: bool) -> Result<Vec<PathBuf>> {
    let assets = assets_of(scene)?;
    let shown = scene.objects.iter().filter(|o| o.shown).zip(&assets);
    let mut unset = None;
    for (object, asset) in shown.clone() {
        let (name, found) = (name_of(object, asset), check_readable(asset));
        match assets.len() {
            1 => found?,
            _ => found.with_context(|| format!("the splat of {name}"))?,
        }
        if object.source.file.is_none() {
            unset.get_or_insert(name);
        }
    }
    let is_any_set = shown.map(|(o, _)| o).any(|o| o.source.file.is_some());
    if let (true, true, Some(name)) = (is_relit, is_any_set, unset) {
        return usage(&format!(
            "{name}: the capture light is missing: set \"source\": {{\"file\": ENV|\"estimate\"}} in the look, or --source for the first object",
        ));
    }
    Ok(assets)
}

/// True where a file that may be a splat is a look.
pub fn is_look(path: &Path) -> bool {
    matches!(file_kind(path), Ok(FileKind::Look))
}

/// A scene that is given where a splat could be is what `--look` asks for.
pub fn with_scene_as_look(asset: &AssetArgs, light: &LightArgs) -> (AssetArgs, LightArgs) {
    let (mut asset, mut light) = (asset.clone(), light.clone());
    if light.capture.look.is_none() {
        light.capture.look = asset.asset.take_if(|path| is_look(path));
    }
    (asset, light)
}

/// The scene of a command line, and its lights with the look that is opened: a splat that is named is the first object's.
pub fn scene_of(asset: &AssetArgs, light: &LightArgs) -> Result<(Scene, LightArgs)> {
    let (asset, light) = with_scene_as_look(asset, light);
    let mut scene = look_of(&asset.options, Some(&light))?;
    name_asset(&mut scene, &asset);
    assets_of(&scene)?;
    Ok((scene, light))
}

/// Takes the splat that a command line names for the first object.
pub fn name_asset(scene: &mut Scene, asset: &AssetArgs) {
    let first = &mut scene.objects[0];
    first.asset = asset.asset.clone().or(first.asset.take());
}

/// The settings: those of a saved look, and what the command line says over it.
pub fn look_of(asset: &AssetOptions, light: Option<&LightArgs>) -> Result<Scene> {
    look_over(Scene::default(), asset, light)
}

/// Look over other settings than the defaults; a saved look replaces them.
pub fn look_over(base: Scene, asset: &AssetOptions, light: Option<&LightArgs>) -> Result<Scene> {
    let mut scene = match light.and_then(|l| l.capture.look.as_deref()) {
        Some(path) => load_look(path)?,
        None => base,
    };
    let object = &mut scene.objects[0];
    object.up = asset.up.or(object.up);
    let response = &mut object.response;
    let linear = asset.linear.then_some(ResponseCurve::Linear);
    put(&mut response.curve, asset.capture_curve.or(linear));
    put(
        &mut response.contrast,
        asset.capture_contrast.map(|c| c as f32),
    );
    if !asset.outside_from.is_empty() {
        let places = asset.outside_from.iter();
        let local = |p: &[f64; 3]| (DVec3::from_array(*p) - object.origin).as_vec3();
        object.outside_from = places.map(local).collect();
    }
    put(&mut scene.directions, asset.directions);
    let Some(light) = light else {
        return Ok(scene);
    };
    let transfer = &mut scene.transfer;
    put(&mut transfer.method, light.capture.preset);
    put(
        &mut transfer.sh_degree,
        light.capture.sh_degree.map(usize::from),
    );
    transfer.epsilon = light.capture.epsilon.map(|e| e as f32).or(transfer.epsilon);
    put(
        &mut transfer.glow_above,
        light.capture.glow_above.map(|g| g as f32),
    );
    if light.capture.compute_all {
        transfer.optimizations = Optimizations::NONE;
    }
    for name in &light.capture.without {
        let without = transfer.clone().without(name);
        *transfer = without.with_context(|| format!("--without {name}"))?;
    }
    if let Some(source) = &light.capture.source {
        scene.objects[0].source.set_file(source.clone());
    }
    let of_look = scene.lights.clone();
    if let Some(rig) = &light.rig {
        take_rig(&mut scene, rig, light.target.is_empty())?;
    }
    let kept = if light.rig.is_some() {
        Vec::new()
    } else {
        of_look
    };
    let mut named = scene.lights.split_off(kept.len());
    named.extend(light.light.iter().cloned());
    // What is named here is in the coordinates of the splat's file.
    let first = &scene.objects[0];
    let up = first.up.unwrap_or_default();
    scene.lights.extend(moved_lights(&named, -first.origin, up));
    // What the look says of its own light's picture is nothing to others.
    if let Some(target) = light.target.first() {
        scene.environment.set_file(target.clone());
    }
    let has_rig = light.rig.is_some() || !light.light.is_empty();
    if has_rig && scene.environment.file.is_none() {
        // Lights are enough.
        scene.environment = EnvironmentLight {
            tint: [0.0; 3],
            ..EnvironmentLight::of(EVEN)
        };
    }
    if let Some(Rotation::Degrees(degrees)) = light.capture.rotate_source {
        scene.objects[0].source.rotation = degrees;
    }
    let source = &mut scene.objects[0].source;
    source.trust = light
        .capture
        .trust_source
        .map(|t| t as f32)
        .or(source.trust);
    source.clipped = light.capture.source_clipped.or(source.clipped);
    put(&mut scene.environment.rotation, light.rotate_target);
    let told = light.capture.source_layout;
    scene.objects[0].source.layout = told.or(scene.objects[0].source.layout);
    let of_look = scene.environment.layout.filter(|_| light.target.len() < 2);
    scene.environment.layout = light.target_layout.or(of_look);
    let layer = light.capture.source_layer.clone();
    scene.objects[0].source.layer = layer.or(scene.objects[0].source.layer.take());
    scene.environment.layer = light.layer.clone().or(scene.environment.layer.take());
    let strength = light.strength_target.map(|stops| stops as f32);
    put(&mut scene.environment.strength, strength);
    scene.match_strength |= light.match_strength;
    if light.target.is_empty() {
        scene.light_as_captured();
    }
    scene.validate()?;
    Ok(scene)
}

/// Takes the lights of a rig and, where no target is named, what it has around them: that lies beside it, or beside the light of the capture.
pub fn take_rig(scene: &mut Scene, path: &Path, with_environment: bool) -> Result<()> {
    let rig = load_rig(path)?;
    scene.set_lights(rig.lights);
    let Some(around) = rig.environment.filter(|_| with_environment) else {
        return Ok(());
    };
    let places = [Some(path), scene.objects[0].source.file.as_deref()];
    scene.environment = around.over(&scene.environment, |file| beside(file, places));
    // It is as bright as the rig has it.
    scene.match_strength = false;
    Ok(())
}

/// The targets on the command line, folders replaced by the environments in them, each with the name of its output.
pub fn targets_of(light: &LightArgs, scene: &Scene) -> Result<Vec<(String, PathBuf)>> {
    let mut targets: Vec<(String, PathBuf)> = Vec::new();
    let named = match (&light.target[..], &scene.environment.file) {
        ([], Some(file)) => std::slice::from_ref(file),
        (named, _) => named,
    };
    let stem = |path: &Path| {
        path.file_stem()
            .map_or_else(|| "target".into(), |s| s.to_string_lossy().into_owned())
    };
    for path in named {
        if !path.is_dir() {
            targets.push((stem(path), path.clone()));
            continue;
        }
        let inside = environments_in(path)?;
        if inside.is_empty() {
            bail!(
                "{}: the folder holds no environment (.hdr, .exr)",
                path.display()
            );
        }
        targets.extend(inside.into_iter().map(|p| (stem(&p), p)));
    }
    // What a rig has around its lights is called as the rig.
    if let ([], [(name, _)], Some(rig)) = (&light.target[..], &mut targets[..], &light.rig) {
        *name = stem(rig);
    }
    // Two files of one name must not write over each other.
    let mut taken = HashSet::new();
    for (name, _) in &mut targets {
        let stem = name.clone();
        let mut number = 2;
        while !taken.insert(name.clone()) {
            *name = format!("{stem}-{number}");
            number += 1;
        }
    }
    Ok(targets)
}

/// Sets what the command line says, and leaves what it leaves open.
pub fn put<T>(setting: &mut T, value: Option<T>) {
    if let Some(value) = value {
        *setting = value;
    }
}
