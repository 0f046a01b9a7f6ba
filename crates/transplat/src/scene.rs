//! An asset between lights: the stages up to the transfer, as the commands share them.

use std::collections::HashSet;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use transplat_core::color::Encoding;
use transplat_core::environment::{EnvironmentMap, IncidentRadiance};
use transplat_core::ground::Ground;
use transplat_core::load::{
    AssetFile, AssetKind, load_asset, load_bake, load_environment, load_look,
};
use transplat_core::look::{Look, is_even};
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::PreparedTransfer;
use transplat_core::visibility::{BakeInput, BakeSettings, Visibility};

use crate::cli::{AssetArgs, AssetOptions, LightArgs, Term};
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
}

impl Scene {
    /// Loads the asset and opens the device.
    pub fn load(args: &AssetArgs, look: Look, report: &mut Report) -> Result<Self> {
        let asset = asset_of(args, &look);
        let (mut cloud, file) = report.time("load", || load_asset(&asset))?;
        if let Some(up) = look.up {
            cloud.up = up;
        }
        if look.linear {
            cloud.encoding = Encoding::StoredLinear;
        }
        let device = report.time("open device", || Device::open(args.options.device))?;
        report.set("asset", asset.display().to_string());
        report.set("surfels", cloud.len());
        report.set("sh_degree", cloud.sh_degree);
        report.set("adapter", device.name());
        for warning in asset_warnings(&asset, &file) {
            report.warn(warning);
        }
        Ok(Self {
            cloud: Arc::new(cloud),
            file,
            look,
            device,
        })
    }

    /// Bakes visibility, or takes the saved bake.
    pub fn bake(&self, saved: Option<&Path>, report: &mut Report) -> Result<Visibility> {
        let visibility = if let Some(path) = saved {
            report.skip("bake", "the saved one is used");
            report.time("load", || load_bake(path, &self.cloud))?
        } else {
            let mut settings = BakeSettings {
                directions: self.look.directions,
            };
            if !self.look.transfer.terms.shadow && settings.directions > ORIENTATION_DIRECTIONS {
                settings.directions = ORIENTATION_DIRECTIONS;
                report.skip(
                    "most directions of the bake",
                    "without shadows only the normals need it",
                );
            }
            let bar = progress_bar("baking visibility", report);
            let progress = |done: f64| {
                bar.set_position((done * 1000.0) as u64);
                ControlFlow::Continue(())
            };
            let open = report.time("bake", || {
                let input = BakeInput::new(&self.cloud, &settings);
                self.device
                    .bake_visibility(&input, &progress)
                    .map(|open| Visibility::from_open(&self.cloud, settings.directions, open))
            })?;
            bar.finish_and_clear();
            open
        };
        report.set("directions", visibility.directions);
        report.set("normals_flipped", visibility.flipped);
        report.set(
            "normals_two_sided",
            visibility.two_sided.iter().filter(|t| **t).count(),
        );
        report.set("buried", visibility.buried);
        Ok(visibility)
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
        let mut light = |path: &Path| {
            let map = self.load_light(path, report)?;
            self.project(map.as_ref(), report)
        };
        let Some(source_file) = &self.look.source.file else {
            bail!("no source light");
        };
        let source_map = light(source_file)?;
        let mut targets = Vec::new();
        for (name, path) in targets_of(args, &self.look)? {
            let radiance = light(&path)?;
            targets.push(Target {
                name,
                path,
                radiance,
            });
        }
        Ok(Lights {
            source: source_map,
            targets,
        })
    }

    /// Prepares the transfer from the source light.
    pub fn prepare(
        &self,
        visibility: &Visibility,
        source: &IncidentRadiance,
        report: &mut Report,
    ) -> Result<PreparedTransfer> {
        let prepared = report.time("prepare", || {
            PreparedTransfer::new(&self.cloud, visibility, source, &self.look.transfer)
        })?;
        if prepared.source_was_black {
            report.warn("the source light is black and explains nothing; even light is assumed");
        }
        if prepared.dark_share > 0.05 {
            report.warn(format!(
                "{:.0} % of the surfels lie in a source light darker than epsilon; their relit colour follows epsilon more than the light",
                100.0 * prepared.dark_share
            ));
        }
        report.set("dark_share", prepared.dark_share);
        let terms = self.look.transfer.terms;
        if !terms.shadow {
            report.skip("self-shadowing", "--without shadow");
        }
        if prepared.specular_degree > 0 && prepared.specular_degree < self.cloud.sh_degree {
            report.skip(
                &format!("SH bands above {} of the asset", prepared.specular_degree),
                "the source light has nothing there (see --sh-degree)",
            );
        }
        if !terms.specular {
            report.skip("specular transfer", "--without specular");
        } else if prepared.specular_degree == 0 {
            report.skip(
                "specular transfer",
                if self.look.transfer.sh_degree == 0 {
                    "the light has degree 0"
                } else if !self.cloud.has_view_dependence() {
                    "the asset's colour does not depend on the view"
                } else {
                    "the source light is even: it tells nothing of gloss"
                },
            );
        }
        Ok(prepared)
    }

    /// A light's map; none for even light.
    pub fn load_light(&self, path: &Path, report: &mut Report) -> Result<Option<EnvironmentMap>> {
        if is_even(path) {
            return Ok(None);
        }
        let map = report.time("load", || load_environment(path))?;
        for warning in map_warnings(path, &map) {
            report.warn(warning);
        }
        Ok(Some(map))
    }

    /// A map's light, of the highest degree: a look takes the bands that it wants.
    fn project(
        &self,
        map: Option<&EnvironmentMap>,
        report: &mut Report,
    ) -> Result<IncidentRadiance> {
        match map {
            None => {
                report.skip("projection of an environment", "even light");
                Ok(IncidentRadiance::even(MAX_DEGREE))
            }
            Some(map) => report.time("project", || {
                self.device.project_environment(map, MAX_DEGREE)
            }),
        }
    }

    /// Relights by one target: linear SH `[n][K][3]`. For JSON, the change of light is timed as the median of three.
    pub fn relight(
        &self,
        prepared: &PreparedTransfer,
        transfer: &mut Transfer<'_>,
        name: &str,
        light: &IncidentRadiance,
        report: &mut Report,
    ) -> Result<Vec<[f32; 3]>> {
        if light.is_black() {
            report.warn(format!(
                "{name}: the target light is black, and so is the result"
            ));
        } else {
            report.target(name, (light.mean_irradiance() * prepared.light_gain).log2());
        }
        let mut times = Vec::new();
        for _ in 0..if report.is_json() { 3 } else { 1 } {
            let start = Instant::now();
            transfer.change_light(&prepared.light(light))?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        if report.ms("transfer").is_none() {
            report.add_ms("transfer", times[times.len() / 2]);
        }
        transfer.result()
    }
}

/// The lights of a relight as their maps hold them, of the highest degree, not turned yet.
pub struct Lights {
    pub source: IncidentRadiance,
    pub targets: Vec<Target>,
}

impl Lights {
    /// Source and target as the asset sees them.
    pub fn oriented(&self, scene: &Scene, target: &Target) -> [IncidentRadiance; 2] {
        scene
            .look
            .lights(&self.source, &target.radiance, scene.cloud.up)
    }
}

/// One light to relight by.
pub struct Target {
    /// Of its output.
    pub name: String,
    pub path: PathBuf,
    pub radiance: IncidentRadiance,
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
            crate::commands::usage(
                "the splat to work on is needed: ASSET, or --look FILE with one in it",
            )
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
    if let Some(directions) = asset.directions {
        look.directions = directions;
    }
    let Some(light) = light else {
        return Ok(look);
    };
    let transfer = &mut look.transfer;
    if let Some(preset) = light.preset {
        transfer.preset = preset;
    }
    if let Some(degree) = light.sh_degree {
        transfer.sh_degree = usize::from(degree);
    }
    if let Some(epsilon) = light.epsilon {
        transfer.epsilon = epsilon as f32;
    }
    for term in &light.without {
        match term {
            Term::Shadow => transfer.terms.shadow = false,
            Term::Specular => transfer.terms.specular = false,
            Term::Reflection => transfer.terms.reflection = false,
            Term::Attenuation => transfer.terms.attenuation = false,
            other => bail!(
                "--without {}: a term of preset best, which is not in this version yet; preset paper has shadow, specular, reflection and attenuation",
                clap::ValueEnum::to_possible_value(other)
                    .map_or(String::new(), |v| v.get_name().to_owned())
            ),
        }
    }
    if let Some(source) = &light.source {
        look.source.file = Some(source.clone());
    }
    if let [target] = &light.target[..] {
        look.target.file = Some(target.clone());
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
