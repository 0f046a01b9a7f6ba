//! An asset between lights: the stages up to the transfer, as the commands share them.

use std::collections::HashSet;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use glam::DMat3;
use indicatif::{ProgressBar, ProgressStyle};
use transplat_core::color::Encoding;
use transplat_core::environment::{EnvironmentMap, IncidentRadiance};
use transplat_core::load::{
    AssetFile, AssetKind, load_asset, load_bake, load_environment, load_look,
};
use transplat_core::look::Look;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::PreparedTransfer;
use transplat_core::visibility::{BakeInput, BakeSettings, Visibility};

use crate::cli::{AssetArgs, LightArgs, Term};
use crate::device::{Device, Transfer};
use crate::report::Report;

/// A flatness above this makes normals, and so relighting, doubtful.
const DOUBTFUL_FLATNESS: f32 = 0.1;

/// Directions that are enough to tell a normal's sign.
const ORIENTATION_DIRECTIONS: usize = 64;

/// The asset, loaded, and everything the command line says about it.
pub struct Scene {
    pub cloud: SurfelCloud,
    pub file: AssetFile,
    pub look: Look,
    pub device: Device,
}

impl Scene {
    /// Loads the asset and opens the device.
    pub fn load(args: &AssetArgs, look: Look, report: &mut Report) -> Result<Self> {
        let (mut cloud, file) = report.time("load", || load_asset(&args.asset))?;
        if let Some(up) = look.up {
            cloud.up = up;
        }
        if look.linear {
            cloud.encoding = Encoding::StoredLinear;
        }
        let device = report.time("open device", || Device::open(args.device))?;
        report.set("asset", args.asset.display().to_string());
        report.set("surfels", cloud.len());
        report.set("sh_degree", cloud.sh_degree);
        report.set("adapter", device.name());
        if !file.report.left_out.is_empty() {
            report.warn(format!(
                "{}: {} of {} surfels hold values that are no numbers and are left out",
                args.asset.display(),
                file.report.left_out.len(),
                cloud.len()
            ));
        }
        if file.report.kind == AssetKind::Gaussians3d {
            let flatness = file.report.median_flatness.unwrap_or(0.0);
            if flatness > DOUBTFUL_FLATNESS {
                report.warn(format!(
                    "{}: a 3DGS asset whose Gaussians are not flat (median shortest/second axis {flatness:.2}); its normals, and so its relighting, are only rough. 2DGS training gives better ones",
                    args.asset.display()
                ));
            }
        }
        Ok(Self {
            cloud,
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

    /// Loads and projects source and targets. That comes before the bake, so that a wrong file is told before minutes of work.
    pub fn lights(&self, args: &LightArgs, source: &Path, report: &mut Report) -> Result<Lights> {
        let mut light = |path: &Path, degrees: f64| {
            let map = self.load_light(path, report)?;
            self.project(map.as_ref(), degrees, report)
        };
        let source = light(source, self.look.rotate_source)?;
        let mut targets = Vec::new();
        for (name, path) in targets_of(args)? {
            let light = light(&path, self.look.rotate_target)?.scaled(self.target_gain());
            targets.push(Target { name, path, light });
        }
        Ok(Lights { source, targets })
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

    /// The target light's strength as a factor.
    pub fn target_gain(&self) -> f32 {
        self.look.strength_target.exp2()
    }

    /// The turn that brings a light, turned by `degrees` about its own up axis, into the asset's coordinates.
    pub fn asset_from_light(&self, degrees: f64) -> DMat3 {
        self.cloud.up.asset_from_world() * DMat3::from_rotation_z(degrees.to_radians())
    }

    /// A light's map; none for even light.
    pub fn load_light(&self, path: &Path, report: &mut Report) -> Result<Option<EnvironmentMap>> {
        if is_even(path) {
            return Ok(None);
        }
        let map = report.time("load", || load_environment(path))?;
        if map.repaired() > 0 {
            report.warn(format!(
                "{}: {} pixels are negative or no numbers, and count as black",
                path.display(),
                map.repaired()
            ));
        }
        if map.has_clipped_highlights() {
            report.warn(format!(
                "{}: a low-dynamic-range picture; its highlights are clipped, so its light is too even",
                path.display()
            ));
        }
        if map.width() != 2 * map.height() {
            report.warn(format!(
                "{}: {} x {} pixels are not twice as wide as high; it is taken as equirectangular all the same",
                path.display(),
                map.width(),
                map.height()
            ));
        }
        Ok(Some(map))
    }

    fn project(
        &self,
        map: Option<&EnvironmentMap>,
        degrees: f64,
        report: &mut Report,
    ) -> Result<IncidentRadiance> {
        let degree = self.look.transfer.sh_degree;
        match map {
            None => {
                report.skip("projection of an environment", "even light");
                Ok(IncidentRadiance::even(degree))
            }
            Some(map) => report.time("project", || {
                let light = self.device.project_environment(map, degree)?;
                Ok(light.rotated(self.asset_from_light(degrees)))
            }),
        }
    }

    /// Relights by one target: linear SH `[n][K][3]`. For JSON, the change of light is timed as the median of three.
    pub fn relight(
        &self,
        prepared: &PreparedTransfer,
        transfer: &mut Transfer<'_>,
        target: &Target,
        report: &mut Report,
    ) -> Result<Vec<[f32; 3]>> {
        let (name, light) = (&target.name, &target.light);
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

/// The lights of a relight, as the transfer sees them.
pub struct Lights {
    pub source: IncidentRadiance,
    pub targets: Vec<Target>,
}

/// One light to relight by.
pub struct Target {
    /// Of its output.
    pub name: String,
    pub path: PathBuf,
    /// With the strength that was asked for.
    pub light: IncidentRadiance,
}

/// Whether a light's name on the command line stands for uniform white light.
pub fn is_even(path: &Path) -> bool {
    path.as_os_str() == "even"
}

/// The settings: those of a saved look, and what the command line says over it.
pub fn look_of(asset: &AssetArgs, light: Option<&LightArgs>) -> Result<Look> {
    let mut look = match light.and_then(|l| l.look.as_deref()) {
        Some(path) => {
            let look = load_look(path)?;
            look.validate()
                .with_context(|| path.display().to_string())?;
            look
        }
        None => Look::default(),
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
    if let Some(degrees) = light.rotate_source {
        look.rotate_source = degrees;
    }
    if let Some(degrees) = light.rotate_target {
        look.rotate_target = degrees;
    }
    if let Some(stops) = light.strength_target {
        look.strength_target = stops as f32;
    }
    look.validate()?;
    Ok(look)
}

/// The targets on the command line, folders replaced by the environments in them, each with the name of its output.
pub fn targets_of(light: &LightArgs) -> Result<Vec<(String, PathBuf)>> {
    let mut targets: Vec<(String, PathBuf)> = Vec::new();
    let stem = |path: &Path| {
        path.file_stem()
            .map_or_else(|| "target".into(), |s| s.to_string_lossy().into_owned())
    };
    for path in &light.target {
        if !path.is_dir() {
            targets.push((stem(path), path.clone()));
            continue;
        }
        let entries = std::fs::read_dir(path).with_context(|| path.display().to_string())?;
        let mut inside: Vec<PathBuf> = entries
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|p| {
                p.extension().is_some_and(|e| {
                    ["hdr", "exr"].contains(&e.to_string_lossy().to_lowercase().as_str())
                })
            })
            .collect();
        if inside.is_empty() {
            bail!(
                "{}: the folder holds no environment (.hdr, .exr)",
                path.display()
            );
        }
        inside.sort();
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
