//! An asset between lights: the stages up to the transfer, as the commands share them.

pub mod bake;
pub mod estimate;
pub mod settings;
pub mod warnings;

use std::cell::OnceCell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use indicatif::{ProgressBar, ProgressStyle};
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::patches::DIRECTIONS;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::estimate::{Estimate, estimate_light};
use transplat_core::files::{AssetFile, inspect_bake, load_asset, load_bake, load_environment};
use transplat_core::ground::Ground;
use transplat_core::scene::{Object, Scene, is_estimate, is_even, is_file};
use transplat_core::settings::Method;
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::{SurfelCloud, is_faint};
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use crate::cli::{AssetArgs, LightArgs};
use crate::device::{Device, Transfer};
use crate::summary::Summary;
use bake::Wanted;
use estimate::{estimate_as_json, estimate_in_words, why_not};
use settings::{asset_of, targets_of};
use warnings::{AMBIGUOUS_SHARE, ambiguous_warning, asset_warnings, map_warnings};

/// Directions that are enough to tell a normal's sign.
const ORIENTATION_DIRECTIONS: usize = 64;

/// The asset, loaded, and everything the command line says about it.
pub struct Pipeline {
    pub cloud: Arc<SurfelCloud>,
    pub file: AssetFile,
    pub scene: Scene,
    pub device: Device,
    /// The bake for the directional method, and what it told of the light, once they were needed.
    directional_bake: OnceCell<Arc<DirectionalBake>>,
    estimate: OnceCell<Estimate>,
}

impl Pipeline {
    /// Loads the asset and opens the device.
    pub fn load(args: &AssetArgs, scene: Scene, summary: &mut Summary) -> Result<Self> {
        let asset = asset_of(args, &scene);
        let (cloud, file) = summary.time("load", || load_asset(&asset))?;
        summary.set("asset", asset.display().to_string());
        summary.set("surfels", cloud.len());
        summary.set("sh_degree", cloud.sh_degree);
        for warning in asset_warnings(&asset, &file) {
            summary.warn(warning);
        }
        if !cloud.is_empty() && cloud.opacities.iter().all(|o| is_faint(*o)) {
            summary.warn(format!(
                "{}: all surfels are too faint to be seen (opacity below 1/255); pictures of it are empty",
                asset.display()
            ));
        }
        let device = summary.time("open device", || Device::open(args.options.device))?;
        summary.set("adapter", device.name());
        Ok(Self::of(cloud, file, scene, device))
    }

    /// What is lit is a loaded asset, as the look has it.
    pub fn of(mut cloud: SurfelCloud, file: AssetFile, scene: Scene, device: Device) -> Self {
        let object = &scene.objects[0];
        if let Some(up) = object.up {
            cloud.up = up;
        }
        object.apply_to(&mut cloud);
        Self {
            cloud: Arc::new(cloud),
            file,
            scene,
            device,
            directional_bake: OnceCell::new(),
            estimate: OnceCell::new(),
        }
    }

    /// Its settings: a command's scene has one object.
    pub fn object(&self) -> &Object {
        &self.scene.objects[0]
    }

    /// Bakes what the method needs, or takes the saved bake.
    pub fn bake(&self, saved: Option<&Path>, summary: &mut Summary) -> Result<Bake> {
        let method = self.scene.transfer.method;
        let bake = match (method, saved) {
            (Method::Directional, _) => Bake::Directional(self.directional_bake(saved, summary)?),
            (Method::Harmonic, Some(path)) => self.saved_bake(path, summary)?,
            (Method::Harmonic, None) => {
                self.new_bake(method, self.bake_directions(summary), summary)?
            }
        };
        summary.skipped(bake.left_out());
        summary.set("preset", method.preset());
        summary.set("directions", bake.directions());
        summary.set("bake_bytes_per_surfel", bake.bytes() / bake.len().max(1));
        summary.set("normals_flipped", bake.flipped());
        summary.set("normals_two_sided", two_sided(&bake));
        summary.set("buried", bake.buried());
        if let Some(share) = bake.ambiguous_share() {
            summary.set("normals_ambiguous_share", share);
            if share > AMBIGUOUS_SHARE {
                summary.warn(ambiguous_warning(share));
            }
        }
        Ok(bake)
    }

    fn saved_bake(&self, path: &Path, summary: &mut Summary) -> Result<Bake> {
        summary.skip("bake", "the saved one is used");
        let bake = summary.time("load", || load_bake(path, &self.cloud))?;
        bake.of_method(self.scene.transfer.method)
            .with_context(|| path.display().to_string())?;
        Ok(bake)
    }

    /// The bake for the directional method, made or read once.
    fn directional_bake(
        &self,
        saved: Option<&Path>,
        summary: &mut Summary,
    ) -> Result<Arc<DirectionalBake>> {
        if let Some(known) = self.directional_bake.get() {
            return Ok(known.clone());
        }
        let bake = match saved {
            Some(path) => self.saved_bake(path, summary)?,
            None => self.new_bake(Method::Directional, DIRECTIONS, summary)?,
        };
        let Bake::Directional(bake) = bake else {
            bail!("the bake is for the other preset");
        };
        Ok(self.directional_bake.get_or_init(|| bake).clone())
    }

    fn new_bake(&self, method: Method, directions: usize, summary: &mut Summary) -> Result<Bake> {
        let bar = progress_bar("baking visibility", summary);
        let progress = |done: f64| {
            bar.set_position((done * 1000.0) as u64);
            ControlFlow::Continue(())
        };
        let wanted = Wanted {
            cloud: self.cloud.clone(),
            method,
            directions,
            skips: self.scene.transfer.skips,
            beside: None,
        };
        summary.time("bake", || bake::bake(&self.device, &wanted, &progress))
    }

    /// What the asset tells of the light it was captured under. `saved` is a bake for the method that is set.
    pub fn estimate(&self, saved: Option<&Path>, summary: &mut Summary) -> Result<&Estimate> {
        if let Some(known) = self.estimate.get() {
            return Ok(known);
        }
        let is_for_directional = self.scene.transfer.method == Method::Directional;
        let directional_bake =
            self.directional_bake(saved.filter(|_| is_for_directional), summary)?;
        let estimate = summary.time("estimate", || {
            estimate_light(&self.cloud, &directional_bake)
        });
        summary.set("source_estimate", estimate_as_json(&estimate));
        Ok(self.estimate.get_or_init(|| estimate))
    }

    /// Directions of the harmonic method's bake.
    fn bake_directions(&self, summary: &mut Summary) -> usize {
        let settings = &self.scene.transfer;
        let few = settings.method == Method::Harmonic && !settings.terms.shadow;
        if few && self.scene.directions > ORIENTATION_DIRECTIONS {
            summary.skip(
                "most directions of the bake",
                "without shadows only the normals need it",
            );
            return ORIENTATION_DIRECTIONS;
        }
        self.scene.directions
    }

    /// Bakes the ground that catches the object's shadow.
    pub fn bake_ground(&self, summary: &mut Summary) -> Result<Ground> {
        let bar = progress_bar("baking the ground", summary);
        let progress = |done: f64| {
            bar.set_position((done * 1000.0) as u64);
            ControlFlow::Continue(())
        };
        let (up, directions) = (self.cloud.up, self.scene.directions);
        let bake = || Ground::bake(&self.cloud, up, directions, &progress);
        Ok(summary.time("ground", bake)?)
    }

    /// Loads and projects source and targets. That comes before the bake, so that a wrong file is told before minutes of work.
    pub fn lights(&self, args: &LightArgs, summary: &mut Summary) -> Result<Lights> {
        let Some(source_file) = &self.object().source.file else {
            bail!("no source light");
        };
        if let Some(path) = &args.bake {
            inspect_bake(path)?
                .of_method(self.scene.transfer.method)
                .with_context(|| path.display().to_string())?;
        }
        let saved = args.bake.as_deref();
        let mut light = |path: &Path| self.light_of(path, saved, summary);
        // An estimate needs the bake, and comes last.
        let known = is_file(source_file).then(|| light(source_file));
        let known = known.transpose()?;
        let mut targets = Vec::new();
        for (name, path) in targets_of(args, &self.scene)? {
            let light = light(&path)?;
            targets.push(Target { name, path, light });
        }
        let source = known.map_or_else(|| light(source_file), Ok)?;
        Ok(Lights { source, targets })
    }

    /// Settings that the method does not know, and that were asked for all the same.
    fn tell_what_is_ignored(&self, summary: &mut Summary) {
        let (scene, plain) = (&self.scene, Scene::default());
        match scene.transfer.method {
            Method::Harmonic => {
                if !self.object().outside_from.is_empty() {
                    let why = "preset paper takes the open side for the front";
                    summary.skip("what is outside", why);
                }
            }
            Method::Directional => {
                let why = "preset best sums over directions of its own";
                let degrees = [scene, &plain].map(|s| s.transfer.sh_degree);
                if degrees[0] != degrees[1] && scene.transfer.terms.sums {
                    summary.skip("the light's SH degree", why);
                }
                // The shadow on the ground is baked with them.
                if scene.directions != plain.directions && !scene.shadow_catcher {
                    summary.skip("the number of directions", why);
                }
            }
        }
    }

    /// Prepares the transfer from the source light, which no target changes, and has it ready on its device.
    pub fn prepare(
        &self,
        bake: &Bake,
        lights: &Lights,
        summary: &mut Summary,
    ) -> Result<(PreparedTransfer, Transfer)> {
        let [source, _] = lights.oriented(self, &lights.targets[0]);
        let settings = &self.scene.transfer;
        let prepared = summary.time("prepare", || {
            PreparedTransfer::new(&self.cloud, bake, &source, settings)
        })?;
        if prepared.source_was_black() {
            summary.warn("the source light is black and explains nothing; even light is assumed");
        }
        if prepared.dark_share() > 0.05 {
            summary.warn(format!(
                "{:.0} % of the surfels lie in a source light darker than epsilon; their relit colour follows epsilon more than the light",
                100.0 * prepared.dark_share()
            ));
        }
        summary.set("dark_share", prepared.dark_share());
        self.tell_what_is_ignored(summary);
        summary.skipped(prepared.left_out(&self.cloud));
        let (transfer, warning) = self.device.transfer(&prepared)?;
        if let Some(warning) = warning {
            summary.warn(warning);
        }
        Ok((prepared, transfer))
    }

    /// A light as its map holds it; where an estimate cannot tell, what stands in for it. `saved` is a bake for the method that is set.
    pub fn light_of(
        &self,
        path: &Path,
        saved: Option<&Path>,
        summary: &mut Summary,
    ) -> Result<Illumination> {
        let Some(map) = self.load_light(path, saved, summary)? else {
            summary.skip("projection of an environment", "even light");
            let estimate = self.estimate.get().filter(|_| is_estimate(path));
            let even = || Illumination::even(MAX_DEGREE);
            return Ok(estimate.map_or_else(even, Estimate::stand_in));
        };
        let method = self.scene.transfer.method;
        summary.time("project", || self.device.light(&map, method))
    }

    /// A light's map; none for even light, and where an estimate cannot tell. `saved` is a bake for the method that is set.
    pub fn load_light(
        &self,
        path: &Path,
        saved: Option<&Path>,
        summary: &mut Summary,
    ) -> Result<Option<EnvironmentMap>> {
        if is_even(path) {
            return Ok(None);
        }
        if is_estimate(path) {
            let estimate = self.estimate(saved, summary)?;
            if let Some(obstacle) = estimate.obstacle {
                let why = why_not(self.scene.transfer.method, obstacle);
                summary.warn(format!("the light of the capture {why}"));
                return Ok(None);
            }
            summary.note(estimate_in_words(estimate, self.cloud.up));
            return Ok(Some(estimate.light.map(self.cloud.up)));
        }
        let map = summary.time("load", || load_environment(path))?;
        for warning in map_warnings(path, &map) {
            summary.warn(warning);
        }
        Ok(Some(map))
    }

    /// Relights by one target, or what a view shows of that. For JSON, the change of light is timed as the median of three.
    pub fn relight(
        &self,
        prepared: &PreparedTransfer,
        transfer: &mut Transfer,
        name: &str,
        (light, part, unseen): (&Illumination, Part, &[bool]),
        summary: &mut Summary,
    ) -> Result<Relit> {
        let on_gpu = matches!(transfer, Transfer::Gpu(_));
        summary.skipped(prepared.left_out_for(light, on_gpu));
        if light.is_black() {
            summary.warn(format!(
                "{name}: the target light is black, and so is the result"
            ));
        } else {
            summary.target(
                name,
                (light.mean_irradiance() * prepared.light_gain()).log2(),
            );
        }
        let mut times = Vec::new();
        for _ in 0..if summary.json { 3 } else { 1 } {
            let start = Instant::now();
            transfer.change_light(light, part, unseen)?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
        times.sort_by(f64::total_cmp);
        if summary.ms("transfer").is_none() {
            summary.add_ms("transfer", times[times.len() / 2]);
        }
        transfer.result()
    }
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
    pub fn oriented(&self, pipeline: &Pipeline, target: &Target) -> [Illumination; 2] {
        let maps = [&self.source, &target.light];
        let scene = &pipeline.scene;
        scene.lights_on(pipeline.object(), maps, pipeline.cloud.up)
    }
}

/// One light to relight by.
pub struct Target {
    /// Of its output.
    pub name: String,
    pub path: PathBuf,
    pub light: Illumination,
}

/// A bar on stderr, when that is a terminal and the user did not ask for quiet; it goes when it is dropped.
pub fn progress_bar(what: &'static str, summary: &Summary) -> ProgressBar {
    if summary.quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(1000);
    let style = ProgressStyle::with_template("{msg} [{bar:30}] {percent}% {eta}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_message(what);
    bar
}
