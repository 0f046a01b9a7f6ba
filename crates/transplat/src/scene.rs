//! An asset between lights: the stages up to the transfer, as the commands share them.

use std::cell::OnceCell;
use std::collections::HashSet;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use glam::Vec3;
use indicatif::{ProgressBar, ProgressStyle};
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::harmonic::{BakeInput, BakeSettings, HarmonicBake};
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::estimate::{Estimate, Obstacle, estimate_light};
use transplat_core::files::{
    AssetFile, AssetKind, inspect_bake, load_asset, load_bake, load_environment, load_look,
};
use transplat_core::ground::Ground;
use transplat_core::look::{Look, is_estimate, is_even, is_file};
use transplat_core::progress::Progress;
use transplat_core::settings::Method;
use transplat_core::settings::skips::Skips;
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::{SurfelCloud, is_faint};
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use crate::cli::{AssetArgs, AssetOptions, LightArgs};
use crate::commands;
use crate::device::{Device, Transfer};
use crate::report::Report;

/// A flatness above this makes normals, and so relighting, doubtful.
const DOUBTFUL_FLATNESS: f32 = 0.1;

/// Directions that are enough to tell a normal's sign.
const ORIENTATION_DIRECTIONS: usize = 64;

/// The asset, loaded, and everything the command line says about it.
pub struct Scene {
    pub cloud: Arc<SurfelCloud>,
    pub file: AssetFile,
    pub look: Look,
    pub device: Device,
    /// The bake for the directional method, and what it told of the light, once they were needed.
    directional_bake: OnceCell<Arc<DirectionalBake>>,
    estimate: OnceCell<Estimate>,
}

impl Scene {
    /// Loads the asset and opens the device.
    pub fn load(args: &AssetArgs, look: Look, report: &mut Report) -> Result<Self> {
        let asset = asset_of(args, &look);
        let (cloud, file) = report.time("load", || load_asset(&asset))?;
        report.set("asset", asset.display().to_string());
        report.set("surfels", cloud.len());
        report.set("sh_degree", cloud.sh_degree);
        for warning in asset_warnings(&asset, &file) {
            report.warn(warning);
        }
        if !cloud.is_empty() && cloud.opacities.iter().all(|o| is_faint(*o)) {
            report.warn(format!(
                "{}: all surfels are too faint to be seen (opacity below 1/255); pictures of it are empty",
                asset.display()
            ));
        }
        let device = report.time("open device", || Device::open(args.options.device))?;
        report.set("adapter", device.name());
        Ok(Self::of(cloud, file, look, device))
    }

    /// What is lit is a loaded asset, as the look has it.
    pub fn of(mut cloud: SurfelCloud, file: AssetFile, look: Look, device: Device) -> Self {
        if let Some(up) = look.up {
            cloud.up = up;
        }
        look.apply_to(&mut cloud);
        Self {
            cloud: Arc::new(cloud),
            file,
            look,
            device,
            directional_bake: OnceCell::new(),
            estimate: OnceCell::new(),
        }
    }

    /// Bakes what the method needs, or takes the saved bake.
    pub fn bake(&self, saved: Option<&Path>, report: &mut Report) -> Result<Bake> {
        let method = self.look.transfer.method;
        let bake = self.bake_of_method(method, saved, report)?;
        for skipped in bake.left_out() {
            report.skipped(skipped);
        }
        report.set("preset", method.preset());
        report.set("directions", bake.directions());
        report.set("bake_bytes_per_surfel", bake.bytes() / bake.len().max(1));
        report.set("normals_flipped", bake.flipped());
        report.set("normals_two_sided", two_sided(&bake));
        report.set("buried", bake.buried());
        if let Some(share) = bake.ambiguous_share() {
            report.set("normals_ambiguous_share", share);
            if share > AMBIGUOUS_SHARE {
                report.warn(ambiguous_warning(share));
            }
        }
        Ok(bake)
    }

    fn bake_of_method(
        &self,
        method: Method,
        saved: Option<&Path>,
        report: &mut Report,
    ) -> Result<Bake> {
        Ok(if method == Method::Directional {
            Bake::Directional(self.directional_bake(saved, report)?)
        } else if let Some(path) = saved {
            self.saved_bake(path, report)?
        } else {
            let directions = self.bake_directions(report);
            if self.look.transfer.skips.open_object
                && let Some(open) = report.time("bake", || {
                    HarmonicBake::of_open_object(&self.cloud, directions)
                })
            {
                return Ok(Bake::Harmonic(open));
            }
            let open = self.with_progress(report, |progress| {
                let input = BakeInput::new(&self.cloud, &BakeSettings { directions });
                self.device.bake_harmonic(&input, progress)
            })?;
            Bake::Harmonic(HarmonicBake::from_open(&self.cloud, directions, open))
        })
    }

    fn saved_bake(&self, path: &Path, report: &mut Report) -> Result<Bake> {
        report.skip("bake", "the saved one is used");
        let bake = report.time("load", || load_bake(path, &self.cloud))?;
        bake.of_method(self.look.transfer.method)
            .with_context(|| path.display().to_string())?;
        Ok(bake)
    }

    /// The bake for the directional method, made or read once.
    fn directional_bake(
        &self,
        saved: Option<&Path>,
        report: &mut Report,
    ) -> Result<Arc<DirectionalBake>> {
        if let Some(known) = self.directional_bake.get() {
            return Ok(known.clone());
        }
        let directional_bake = match saved
            .map(|path| self.saved_bake(path, report))
            .transpose()?
        {
            Some(Bake::Directional(saved)) => saved,
            _ => Arc::new(self.with_progress(report, |progress| {
                let (by, skips) = (&self.device, &self.look.transfer.skips);
                by.bake_directional(&self.cloud, (&[1], skips), progress, |_, _| ())
            })?),
        };
        Ok(self
            .directional_bake
            .get_or_init(|| directional_bake)
            .clone())
    }

    fn with_progress<T>(
        &self,
        report: &mut Report,
        bake: impl FnOnce(Progress<'_>) -> Result<T>,
    ) -> Result<T> {
        let bar = progress_bar("baking visibility", report);
        let progress = |done: f64| {
            bar.set_position((done * 1000.0) as u64);
            ControlFlow::Continue(())
        };
        let made = report.time("bake", || bake(&progress))?;
        bar.finish_and_clear();
        Ok(made)
    }

    /// What the asset tells of the light it was captured under. `saved` is a bake for the method that is set.
    pub fn estimate(&self, saved: Option<&Path>, report: &mut Report) -> Result<&Estimate> {
        if let Some(known) = self.estimate.get() {
            return Ok(known);
        }
        let is_for_directional = self.look.transfer.method == Method::Directional;
        let directional_bake =
            self.directional_bake(saved.filter(|_| is_for_directional), report)?;
        let estimate = report.time("estimate", || {
            estimate_light(&self.cloud, &directional_bake)
        });
        report.set("source_estimate", told_of(&estimate));
        Ok(self.estimate.get_or_init(|| estimate))
    }

    /// Directions of the harmonic method's bake.
    fn bake_directions(&self, report: &mut Report) -> usize {
        let settings = &self.look.transfer;
        let few = settings.method == Method::Harmonic && !settings.terms.shadow;
        if few && self.look.directions > ORIENTATION_DIRECTIONS {
            report.skip(
                "most directions of the bake",
                "without shadows only the normals need it",
            );
            return ORIENTATION_DIRECTIONS;
        }
        self.look.directions
    }

    /// Bakes the ground that catches the object's shadow.
    pub fn bake_ground(&self, report: &mut Report) -> Result<Ground> {
        let bar = progress_bar("baking the ground", report);
        let progress = |done: f64| {
            bar.set_position((done * 1000.0) as u64);
            ControlFlow::Continue(())
        };
        let settings = BakeSettings {
            directions: self.look.directions,
        };
        let ground = report.time("ground", || {
            Ground::bake(&self.cloud, self.cloud.up, &settings, &progress)
        })?;
        bar.finish_and_clear();
        Ok(ground)
    }

    /// Loads and projects source and targets. That comes before the bake, so that a wrong file is told before minutes of work.
    pub fn lights(&self, args: &LightArgs, report: &mut Report) -> Result<Lights> {
        let Some(source_file) = &self.look.source.file else {
            bail!("no source light");
        };
        if let Some(path) = &args.bake {
            inspect_bake(path)?
                .of_method(self.look.transfer.method)
                .with_context(|| path.display().to_string())?;
        }
        let saved = args.bake.as_deref();
        let mut light = |path: &Path| self.light_of(path, saved, report);
        // An estimate needs the bake, and comes last.
        let known = is_file(source_file).then(|| light(source_file));
        let known = known.transpose()?;
        let mut targets = Vec::new();
        for (name, path) in targets_of(args, &self.look)? {
            let light = light(&path)?;
            targets.push(Target { name, path, light });
        }
        let source = known.map_or_else(|| light(source_file), Ok)?;
        Ok(Lights { source, targets })
    }

    /// Settings of the other method that were asked for all the same.
    fn tell_what_directional_ignores(&self, report: &mut Report) {
        let (look, plain) = (&self.look, Look::default());
        if look.transfer.method != Method::Directional {
            if !look.outside_from.is_empty() {
                report.skip(
                    "what is outside",
                    "preset paper takes the open side for the front",
                );
            }
            return;
        }
        let why = "preset best sums over directions of its own";
        if look.transfer.sh_degree != plain.transfer.sh_degree && look.transfer.terms.sums {
            report.skip("the light's SH degree", why);
        }
        // The shadow on the ground is baked with them.
        if look.directions != plain.directions && !look.shadow_catcher {
            report.skip("the number of directions", why);
        }
    }

    /// Prepares the transfer from the source light.
    pub fn prepare(
        &self,
        bake: &Bake,
        source: &Illumination,
        report: &mut Report,
    ) -> Result<PreparedTransfer> {
        let settings = &self.look.transfer;
        let prepared = report.time("prepare", || {
            PreparedTransfer::new(&self.cloud, bake, source, settings)
        })?;
        if prepared.source_was_black() {
            report.warn("the source light is black and explains nothing; even light is assumed");
        }
        if prepared.dark_share() > 0.05 {
            report.warn(format!(
                "{:.0} % of the surfels lie in a source light darker than epsilon; their relit colour follows epsilon more than the light",
                100.0 * prepared.dark_share()
            ));
        }
        report.set("dark_share", prepared.dark_share());
        self.tell_what_directional_ignores(report);
        for skipped in prepared.left_out(&self.cloud) {
            report.skipped(skipped);
        }
        Ok(prepared)
    }

    /// A light as its map holds it; where an estimate cannot tell, what stands in for it. `saved` is a bake for the method that is set.
    pub fn light_of(
        &self,
        path: &Path,
        saved: Option<&Path>,
        report: &mut Report,
    ) -> Result<Illumination> {
        let map = self.load_light(path, saved, report)?;
        let light = self.light(map.as_ref(), report)?;
        let untold = is_estimate(path) && map.is_none();
        let estimate = self.estimate.get().filter(|_| untold);
        Ok(estimate.map_or(light, Estimate::stand_in))
    }

    /// A light's map; none for even light, and where an estimate cannot tell. `saved` is a bake for the method that is set.
    pub fn load_light(
        &self,
        path: &Path,
        saved: Option<&Path>,
        report: &mut Report,
    ) -> Result<Option<EnvironmentMap>> {
        if is_even(path) {
            return Ok(None);
        }
        if is_estimate(path) {
            let estimate = self.estimate(saved, report)?;
            if let Some(obstacle) = estimate.obstacle {
                report.warn(format!(
                    "the light of the capture cannot be told from the splat: {}; {}",
                    obstacle.reason(),
                    what_stands_in(self.look.transfer.method, obstacle)
                ));
                return Ok(None);
            }
            report.note(commands::estimate::summary(estimate, self.cloud.up));
            return Ok(Some(estimate.light.map(self.cloud.up)));
        }
        let map = report.time("load", || load_environment(path))?;
        for warning in map_warnings(path, &map) {
            report.warn(warning);
        }
        Ok(Some(map))
    }

    /// A map's light.
    fn light(&self, map: Option<&EnvironmentMap>, report: &mut Report) -> Result<Illumination> {
        match map {
            None => {
                report.skip("projection of an environment", "even light");
                Ok(Illumination::even(MAX_DEGREE))
            }
            Some(map) => report.time("project", || {
                self.device.light(map, self.look.transfer.method)
            }),
        }
    }

    /// Relights by one target, or what a view shows of that. For JSON, the change of light is timed as the median of three.
    pub fn relight(
        &self,
        prepared: &PreparedTransfer,
        transfer: &mut Transfer,
        name: &str,
        (light, part, unseen): (&Illumination, Part, &[bool]),
        report: &mut Report,
    ) -> Result<Relit> {
        let on_gpu = matches!(transfer, Transfer::Gpu(_));
        if let Some(skipped) = prepared.left_out_for(light, on_gpu) {
            report.skipped(skipped);
        }
        if light.is_black() {
            report.warn(format!(
                "{name}: the target light is black, and so is the result"
            ));
        } else {
            report.target(
                name,
                (light.mean_irradiance() * prepared.light_gain()).log2(),
            );
        }
        let mut times = Vec::new();
        for _ in 0..if report.is_json() { 3 } else { 1 } {
            let start = Instant::now();
            transfer.change_light(light, part, unseen)?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        if report.ms("transfer").is_none() {
            report.add_ms("transfer", times[times.len() / 2]);
        }
        transfer.result()
    }
}

/// Share of what is seen whose front may be a guess before a warning is due.
pub const AMBIGUOUS_SHARE: f32 = 0.05;

/// For the user.
pub fn ambiguous_warning(share: f32) -> String {
    format!(
        "which side is the front is a guess on {:.0} % of what is seen; --outside-from X,Y,Z, a place that sees the outside, tells it for what is seen from there",
        100.0 * share
    )
}

/// What is done where the light of the capture cannot be told, for the user.
pub fn what_stands_in(method: Method, obstacle: Obstacle) -> &'static str {
    match (method, obstacle) {
        (Method::Harmonic, _) | (_, Obstacle::EvenLight) => "even light is assumed",
        (Method::Directional, _) => {
            "half of the change is made that would be right for a capture under even light"
        }
    }
}

/// An estimate for programs.
pub fn told_of(estimate: &Estimate) -> serde_json::Value {
    let light = &estimate.light;
    let sun = light.sun.filter(|_| estimate.is_good());
    serde_json::json!({
        "confidence": estimate.confidence,
        "is_good": estimate.is_good(),
        "obstacle": estimate.obstacle,
        "dominant_direction": estimate.is_good().then(|| light.dominant_direction().to_array()),
        "sun_direction": sun.map(|(direction, _)| direction),
        "sun_irradiance": sun.map(|(_, energy)| energy),
    })
}

/// How many surfels are about equally open on both sides.
pub fn two_sided(bake: &Bake) -> usize {
    (0..bake.len()).filter(|i| bake.is_two_sided(*i)).count()
}

/// The lights of a relight as their maps hold them, not turned yet.
pub struct Lights {
    pub source: Illumination,
    pub targets: Vec<Target>,
}

impl Lights {
    /// Source and target as the asset sees them.
    pub fn oriented(&self, scene: &Scene, target: &Target) -> [Illumination; 2] {
        scene
            .look
            .lights(&self.source, &target.light, scene.cloud.up)
    }
}

/// One light to relight by.
pub struct Target {
    /// Of its output.
    pub name: String,
    pub path: PathBuf,
    pub light: Illumination,
}

/// What is odd about an asset.
pub fn asset_warnings(path: &Path, file: &AssetFile) -> Vec<String> {
    let mut warnings = Vec::new();
    let found = &file.report;
    if !found.left_out.is_empty() {
        warnings.push(format!(
            "{}: {} surfels hold values that are no numbers and are left out",
            path.display(),
            found.left_out.len(),
        ));
    }
    if found.kind == AssetKind::Gaussians3d {
        let flatness = found.median_flatness.unwrap_or(0.0);
        if flatness > DOUBTFUL_FLATNESS {
            warnings.push(format!(
                "{}: a 3DGS asset whose Gaussians are not flat (median shortest/second axis {flatness:.2}); its normals, and so its relighting, are only rough. 2DGS training gives better ones",
                path.display()
            ));
        }
    }
    warnings
}

/// What is odd about an environment.
pub fn map_warnings(path: &Path, map: &EnvironmentMap) -> Vec<String> {
    let mut warnings = Vec::new();
    if map.repaired() > 0 {
        warnings.push(format!(
            "{}: {} pixels are negative or no numbers, and count as black",
            path.display(),
            map.repaired()
        ));
    }
    if map.has_clipped_highlights() {
        warnings.push(format!(
            "{}: a low-dynamic-range picture; its highlights are clipped, so its light is too even",
            path.display()
        ));
    }
    if map.width() != 2 * map.height() {
        warnings.push(format!(
            "{}: {} x {} pixels are not twice as wide as high; it is taken as equirectangular all the same",
            path.display(),
            map.width(),
            map.height()
        ));
    }
    warnings
}

/// The asset that is asked for, by the command line or else by the look.
pub fn asset_of(args: &AssetArgs, look: &Look) -> PathBuf {
    args.asset
        .clone()
        .or_else(|| look.asset.clone())
        .unwrap_or_else(|| {
            commands::usage("the splat to work on is needed: ASSET, or --look FILE with one in it")
        })
}

/// The settings: those of a saved look, and what the command line says over it.
pub fn look_of(asset: &AssetOptions, light: Option<&LightArgs>) -> Result<Look> {
    look_over(Look::default(), asset, light)
}

/// The same over other settings than the defaults; a saved look replaces them.
pub fn look_over(base: Look, asset: &AssetOptions, light: Option<&LightArgs>) -> Result<Look> {
    let mut look = match light.and_then(|l| l.look.as_deref()) {
        Some(path) => load_look(path)?,
        None => base,
    };
    if let Some(up) = asset.up {
        look.up = Some(up);
    }
    look.linear |= asset.linear;
    if !asset.outside_from.is_empty() {
        look.outside_from = asset
            .outside_from
            .iter()
            .map(|p| Vec3::from_array(*p))
            .collect();
    }
    if let Some(directions) = asset.directions {
        look.directions = directions;
    }
    let Some(light) = light else {
        return Ok(look);
    };
    let transfer = &mut look.transfer;
    if let Some(method) = light.preset {
        transfer.method = method;
    }
    if let Some(degree) = light.sh_degree {
        transfer.sh_degree = usize::from(degree);
    }
    if let Some(epsilon) = light.epsilon {
        transfer.epsilon = Some(epsilon as f32);
    }
    if light.compute_all {
        transfer.skips = Skips::NONE;
    }
    for name in &light.without {
        let without = transfer.clone().without(name);
        *transfer = without.with_context(|| format!("--without {name}"))?;
    }
    if let Some(source) = &light.source {
        look.source.set_file(source.clone());
    }
    if let [target] = &light.target[..] {
        look.target.set_file(target.clone());
    }
    if let Some(degrees) = light.rotate_source {
        look.source.rotation = degrees;
    }
    if let Some(degrees) = light.rotate_target {
        look.target.rotation = degrees;
    }
    if let Some(stops) = light.strength_target {
        look.target.strength = stops as f32;
    }
    look.match_strength |= light.match_strength;
    look.validate()?;
    Ok(look)
}

/// The targets on the command line, folders replaced by the environments in them, each with the name of its output.
pub fn targets_of(light: &LightArgs, look: &Look) -> Result<Vec<(String, PathBuf)>> {
    let mut targets: Vec<(String, PathBuf)> = Vec::new();
    let named = match (&light.target[..], &look.target.file) {
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

/// The environments (.hdr, .exr) in a folder, sorted by name.
pub fn environments_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut inside: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|p| {
            p.extension().is_some_and(|e| {
                ["hdr", "exr"].contains(&e.to_string_lossy().to_lowercase().as_str())
            })
        })
        .collect();
    inside.sort();
    Ok(inside)
}

/// A bar on stderr, when that is a terminal and the user did not ask for quiet.
pub fn progress_bar(what: &'static str, report: &Report) -> ProgressBar {
    if report.is_quiet() {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(1000);
    let style = ProgressStyle::with_template("{msg} [{bar:30}] {percent}% {eta}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_message(what);
    bar
}
