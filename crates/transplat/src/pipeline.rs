//! A scene between lights: the stages up to the transfer, as the commands share them.

pub mod object;
pub mod settings;

use std::cell::OnceCell;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use glam::{DVec3, Vec3};
use transplat_core::bake::Bake;
use transplat_core::bake::insertion::{InsertionBake, Standing};
use transplat_core::bake::scene::SceneBake;
use transplat_core::bake::surroundings::Placed;
use transplat_core::environment::{EnvironmentMap, Illumination, ImageReading};
use transplat_core::estimate::Estimate;
use transplat_core::files::{inspect_bake, load_environment_as};
use transplat_core::ground::Ground;
use transplat_core::progress::no_progress;
use transplat_core::scene::{
    EnvironmentLight, Object, Scene, is_estimate, is_even, is_file, is_sky,
};
use transplat_core::settings::Method;
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::scene::SceneTransfer;
use transplat_core::transfer::scene::harmonic::HarmonicScene;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use crate::cli::{AssetArgs, LightArgs};
use crate::engine::device::{Device, Transfer};
use crate::engine::estimate::{estimate_in_words, why_not};
use crate::engine::warnings::{
    AMBIGUOUS_SHARE, DOUBTFUL_NORMAL_NOISE, ambiguous_warning, map_warnings, noise_warning,
};
use crate::summary::Summary;
use object::LoadedObject;
use settings::{asset_of, assets_of, not_environments, targets_of};

/// Columns of the map of a sky that is shown.
pub const SKY_COLUMNS: usize = 2048;

/// The objects of a scene, loaded, and everything the command line says about them.
pub struct Pipeline {
    /// Those that are shown.
    pub objects: Vec<LoadedObject>,
    /// The first one, in whose coordinates the scene is, where it is not shown.
    unshown_first: Option<LoadedObject>,
    /// All of them where they stand, in the coordinates of the first one's scene.
    pub cloud: Arc<SurfelCloud>,
    pub scene: Scene,
    pub device: Device,
    /// Those of several objects, once they were needed.
    insertion: OnceCell<Arc<InsertionBake>>,
}

impl Pipeline {
    /// Loads the objects and opens the device.
    pub fn load(args: &AssetArgs, scene: Scene, summary: &mut Summary) -> Result<Self> {
        let assets = assets_of(args, &scene)?;
        let shown = scene.objects.iter().filter(|o| o.shown);
        let mut wholes = Vec::new();
        let mut load = |asset: &Path, object: &Object| {
            LoadedObject::load_part(asset, object.clone(), &mut wholes, summary)
        };
        let mut objects = shown
            .zip(&assets)
            .map(|(object, asset)| load(asset, object))
            .collect::<Result<Vec<_>>>()?;
        let first = &scene.objects[0];
        let unshown_first = (!first.shown)
            .then(|| load(&asset_of(args, &scene, 0)?, first))
            .transpose()?;
        let mut scene = scene;
        take_origins(&mut scene, &mut objects, unshown_first.as_ref());
        let device = summary.time("open device", || Device::open(args.options.device))?;
        let pipeline = Self::of(objects, unshown_first, scene, device);
        summary.set("asset", assets[0].display().to_string());
        summary.set("surfels", pipeline.cloud.len());
        summary.set("sh_degree", pipeline.cloud.sh_degree);
        summary.set("adapter", pipeline.device.name());
        Ok(pipeline)
    }

    /// What is lit are loaded objects, those of the scene that are shown, and its first one if it is not among them.
    pub fn of(
        objects: Vec<LoadedObject>,
        unshown_first: Option<LoadedObject>,
        scene: Scene,
        device: Device,
    ) -> Self {
        let placed = |o: &LoadedObject| o.settings.transform.scene_from_object();
        let each = objects.iter().map(|o| (o.cloud.clone(), placed(o)));
        let cloud = SurfelCloud::whole(&each.collect::<Vec<_>>()).expect("at least one object");
        let cloud = match &unshown_first {
            Some(first) => Arc::new(SurfelCloud {
                up: first.cloud.up,
                origin: first.cloud.origin,
                ..(*cloud).clone()
            }),
            None => cloud,
        };
        Self {
            objects,
            unshown_first,
            cloud,
            scene,
            device,
            insertion: OnceCell::new(),
        }
    }

    /// The first object, in whose coordinates the scene is.
    pub fn first(&self) -> &LoadedObject {
        self.unshown_first.as_ref().unwrap_or(&self.objects[0])
    }

    /// A place that is given in the coordinates of the first object's file.
    pub fn place(&self, at: [f64; 3]) -> Vec3 {
        (DVec3::from_array(at) - self.first().cloud.origin).as_vec3()
    }

    /// Whether there is more than one object as it was captured.
    fn is_composed(&self) -> bool {
        !Arc::ptr_eq(&self.cloud, &self.first().cloud)
    }

    /// Surfels that are not drawn, `[n]` or empty: hidden, or too faint to be seen.
    pub fn hidden(&self) -> Vec<bool> {
        let skips = &self.scene.transfer.skips;
        let of = |o: &LoadedObject| o.settings.hide.unseen(&o.cloud, &o.cloud.bounds(), skips);
        let each: Vec<Vec<bool>> = self.objects.iter().map(of).collect();
        if each.iter().all(Vec::is_empty) {
            return Vec::new();
        }
        let whole = |(mut hidden, o): (Vec<bool>, &LoadedObject)| {
            hidden.resize(o.cloud.len(), false);
            hidden
        };
        let each = each.into_iter().zip(&self.objects);
        each.flat_map(whole).collect()
    }

    /// Bakes what the method needs, or takes the saved bake.
    pub fn bake(&self, saved: Option<&Path>, summary: &mut Summary) -> Result<Bake> {
        let by = (&self.device, &self.scene);
        let is_of_part = self.first().whole.is_some();
        if let Some(path) = saved.filter(|_| self.is_composed() || is_of_part) {
            bail!(
                "{}: a bake is of one object, not of a scene, and of a whole splat, not of what is cut out of one",
                path.display()
            );
        }
        let bake = if self.is_composed() {
            match self.scene.transfer.method {
                Method::Directional => Bake::Scene(Arc::new(self.scene_bake(summary)?)),
                Method::Harmonic => Bake::Harmonic(self.insertion_bake(summary)?.together.clone()),
            }
        } else {
            self.first().bake(by, saved, summary)?
        };
        summary.skipped(bake.left_out());
        summary.set("preset", self.scene.transfer.method.preset());
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
        if let Some(degrees) = bake.normal_noise() {
            summary.set("normals_noise_degrees", degrees);
            if degrees >= DOUBTFUL_NORMAL_NOISE {
                summary.warn(noise_warning(degrees));
            }
        }
        Ok(bake)
    }

    /// The objects' own bakes, and what they see of each other.
    fn scene_bake(&self, summary: &mut Summary) -> Result<SceneBake> {
        let by = (&self.device, &self.scene);
        let placed = self.objects.iter().map(|o| {
            Ok(Placed {
                bake: o.directional_bake(by, None, summary)?,
                scene_from_object: o.settings.transform.scene_from_object(),
                whole: match &o.whole {
                    Some((whole, _)) => Some(whole.directional_bake(by, None, summary)?),
                    None => None,
                },
            })
        });
        let placed = placed.collect::<Result<_>>()?;
        let bar = summary.progress_bar("tracing between objects");
        let progress = |done: f64| {
            bar.set_position((done * 1000.0) as u64);
            ControlFlow::Continue(())
        };
        let trace = || SceneBake::new(placed, &progress);
        Ok(summary.time("surroundings", trace)?)
    }

    /// The same for the harmonic method: the objects' own bakes where they stand, and their shadows on the scene.
    fn insertion_bake(&self, summary: &mut Summary) -> Result<&Arc<InsertionBake>> {
        if let Some(known) = self.insertion.get() {
            return Ok(known);
        }
        let mut objects = Vec::new();
        for object in &self.objects {
            let placed = object.placed();
            let Bake::Harmonic(bake) = placed.bake((&self.device, &self.scene), None, summary)?
            else {
                bail!("the bake is for the other preset");
            };
            objects.push(Standing {
                cloud: placed.cloud,
                bake,
                turn: object.settings.transform.rotation,
            });
        }
        let bar = summary.progress_bar("tracing between objects");
        let progress = |done: f64| {
            bar.set_position((done * 1000.0) as u64);
            ControlFlow::Continue(())
        };
        let shadows = self.scene.transfer.terms.shadow;
        let trace = || InsertionBake::new(objects, shadows, None, &progress);
        let made = summary.time("surroundings", trace)?;
        Ok(self.insertion.get_or_init(|| Arc::new(made)))
    }

    /// Bakes the ground that catches the object's shadow.
    pub fn bake_ground(&self, summary: &mut Summary) -> Result<Ground> {
        let bar = summary.progress_bar("baking the ground");
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
        if let Some(path) = &args.capture.bake {
            inspect_bake(path)?
                .of_method(self.scene.transfer.method)
                .with_context(|| path.display().to_string())?;
        }
        let saved = args.capture.bake.as_deref();
        let mut light = |o: &LoadedObject, path: &Path| self.light_of(o, path, saved, summary);
        let source_of = |o: &LoadedObject| {
            let file = o.settings.source.file.clone();
            file.with_context(|| format!("{}: the light of its capture is missing", o.name()))
        };
        // An estimate needs the bake, and comes last.
        let mut known = Vec::new();
        for object in &self.objects {
            let file = source_of(object)?;
            known.push(is_file(&file).then(|| light(object, &file)).transpose()?);
        }
        // Where nobody tells what that was captured under, what is shown is matched to.
        let first = self.unshown_first.as_ref();
        let first = first.and_then(|o| Some((o, o.settings.source.file.clone()?)));
        let first = first.map(|(o, file)| light(o, &file)).transpose()?;
        let (mut targets, mut failed) = (Vec::new(), Vec::new());
        for (name, path) in targets_of(args, &self.scene)? {
            match light(self.first(), &path) {
                Ok(light) => targets.push(Target { name, path, light }),
                // One of a folder is not to keep the others from being made.
                Err(why) if is_of_folder(args, &path) => failed.push(format!("{why:#}")),
                Err(why) => return Err(why),
            }
        }
        if let (true, Some(why)) = (targets.is_empty(), failed.first()) {
            bail!("no light in the folder can be read; the first: {why}");
        }
        let each = self.objects.iter().zip(known);
        let sources = each.map(|(o, known)| known.map_or_else(|| light(o, &source_of(o)?), Ok));
        let sources = sources.collect::<Result<_>>()?;
        for why in failed {
            summary.fail(format!("a light is skipped: {why}"));
        }
        for folder in args.target.iter().filter(|t| t.is_dir()) {
            if let Some(skipped) = not_environments(folder) {
                summary.note(skipped);
            }
        }
        Ok(Lights {
            sources,
            first,
            targets,
        })
    }

    /// Settings that the method does not know, and that were asked for all the same.
    fn tell_what_is_ignored(&self, summary: &mut Summary) {
        let (scene, plain) = (&self.scene, Scene::default());
        let mut lights = scene.environment_lights();
        let has_no_picture = |l: &EnvironmentLight| l.file.as_deref().is_some_and(|f| !is_file(f));
        if lights.any(|l| l.layout.is_some() && has_no_picture(l)) {
            summary.skip("the light's layout", "it has no picture");
        }
        match scene.transfer.method {
            Method::Harmonic => {
                if self
                    .objects
                    .iter()
                    .any(|o| !o.cloud.outside_from.is_empty())
                {
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

    /// Prepares the transfer from the source light, which no target changes.
    pub fn prepare(
        &self,
        bake: &Bake,
        lights: &Lights,
        summary: &mut Summary,
    ) -> Result<PreparedTransfer> {
        let start = Instant::now();
        let prepared = match bake {
            Bake::Scene(scene) => self.prepare_scene(scene, lights, summary),
            Bake::Harmonic(_) if self.is_composed() => self.prepare_harmonic_scene(lights),
            one => {
                let [source, _] = lights.oriented(self, 0, &lights.targets[0]);
                let by = (&self.device, &self.scene);
                self.objects[0].prepare(one, by, &source, summary)
            }
        }?;
        summary.add_ms("prepare", start.elapsed().as_secs_f64() * 1e3);
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
        Ok(prepared)
    }

    /// Has it ready on its device.
    pub fn transfer(&self, prepared: &PreparedTransfer, summary: &mut Summary) -> Result<Transfer> {
        let (transfer, warning) = self.device.transfer(prepared)?;
        if let Some(warning) = warning {
            summary.warn(warning);
        }
        Ok(transfer)
    }

    /// The first of several objects without the others: the scene that they were put into.
    pub fn scene_alone(&self, prepared: &PreparedTransfer) -> Result<Option<PreparedTransfer>> {
        if !self.scene.first_is_a_place() {
            return Ok(None);
        }
        Ok(prepared.first_alone(&no_progress)?)
    }

    /// Each object under the light of its own capture.
    fn prepare_scene(
        &self,
        bake: &Arc<SceneBake>,
        lights: &Lights,
        summary: &mut Summary,
    ) -> Result<PreparedTransfer> {
        let by = (&self.device, &self.scene);
        let prepare = |(at, object): (usize, &LoadedObject)| -> Result<_> {
            let [source, _] = lights.oriented(self, at, &lights.targets[0]);
            let own = Bake::Directional(bake.objects[at].bake.clone());
            match object.prepare(&own, by, &source, summary)? {
                PreparedTransfer::Directional(transfer) => Ok(transfer),
                _ => bail!("the bake is for the other preset"),
            }
        };
        let each = self.objects.iter().enumerate().map(prepare);
        let scene = SceneTransfer::new(each.collect::<Result<_>>()?, bake.clone());
        Ok(PreparedTransfer::Scene(Arc::new(scene)))
    }

    /// The same as the paper puts objects into a scene.
    fn prepare_harmonic_scene(&self, lights: &Lights) -> Result<PreparedTransfer> {
        let Some(bake) = self.insertion.get() else {
            bail!("the objects are not baked");
        };
        let objects = 0..self.objects.len();
        let sources: Vec<Illumination> = objects
            .map(|at| {
                let [source, _] = lights.oriented(self, at, &lights.targets[0]);
                source
            })
            .collect();
        let sources: Vec<&Illumination> = sources.iter().collect();
        let scene = HarmonicScene::new(bake.clone(), &sources, &self.scene.transfer)?;
        Ok(PreparedTransfer::HarmonicScene(Arc::new(scene)))
    }

    /// A light as its map holds it; where an object's estimate cannot tell, what stands in for it. `saved` is a bake for the method that is
    /// set.
    pub fn light_of(
        &self,
        object: &LoadedObject,
        path: &Path,
        saved: Option<&Path>,
        summary: &mut Summary,
    ) -> Result<Illumination> {
        if is_sky(path) {
            let sky = self.scene.environment.sky().unwrap_or_default();
            return summary.time("project", || Ok(sky.illumination(MAX_DEGREE)));
        }
        let Some(map) = self.load_light(object, path, saved, summary)? else {
            summary.skip("projection of an environment", "even light");
            let estimate = object.known_estimate().filter(|_| is_estimate(path));
            let even = || Illumination::even(MAX_DEGREE);
            return Ok(estimate.map_or_else(even, Estimate::stand_in));
        };
        // Which suns there are, beams tell.
        let method = match self.scene.environment.without_suns {
            true => Method::Directional,
            false => self.scene.transfer.method,
        };
        summary.time("project", || self.device.light(&map, method))
    }

    /// How a light's file is read, where that is set.
    fn reading_of(&self, path: &Path) -> ImageReading {
        let mut lights = self.scene.environment_lights();
        // One of several targets is named by the command line alone.
        match lights.any(|l| l.file.as_deref() == Some(path)) {
            true => self.scene.reading_of(path),
            false => self.scene.environment.reading(),
        }
    }

    /// A light's map; none for even light, and where an object's estimate cannot tell. `saved` is a bake for the method that is set.
    pub fn load_light(
        &self,
        object: &LoadedObject,
        path: &Path,
        saved: Option<&Path>,
        summary: &mut Summary,
    ) -> Result<Option<EnvironmentMap>> {
        if is_even(path) {
            return Ok(None);
        }
        if is_sky(path) {
            let sky = self.scene.environment.sky().unwrap_or_default();
            return Ok(Some(sky.map(SKY_COLUMNS)));
        }
        if is_estimate(path) {
            let estimate = object.estimate((&self.device, &self.scene), saved, summary)?;
            if let Some(obstacle) = estimate.obstacle {
                let why = why_not(self.scene.transfer.method, obstacle);
                let hint = if self.scene.match_strength {
                    ""
                } else {
                    "; nor how strong it was (--match-strength leaves the asset about as bright)"
                };
                summary.warn(format!("the light of the capture {why}{hint}"));
                return Ok(None);
            }
            summary.note(estimate_in_words(estimate, object.cloud.up));
            return Ok(Some(estimate.light.map(object.cloud.up)));
        }
        let reading = self.reading_of(path);
        let map = summary.time("load", || load_environment_as(path, &reading))?;
        for warning in map_warnings(path, &map, &reading) {
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
        self.tell_of_light((prepared, on_gpu), name, light, summary);
        timed(summary, || transfer.change_light(light, part, unseen))?;
        transfer.result()
    }

    /// The same of several objects, each in its own coordinates.
    pub fn relight_objects(
        &self,
        prepared: &PreparedTransfer,
        name: &str,
        (light, part, unseen): (&Illumination, Part, &[bool]),
        summary: &mut Summary,
    ) -> Result<Vec<Relit>> {
        self.tell_of_light((prepared, false), name, light, summary);
        timed(summary, || {
            Ok(prepared.relight_objects(light, part, unseen)?)
        })
    }

    /// Tells what a light leaves out, and how strong it is: lights that are near as they are seen from the middle.
    fn tell_of_light(
        &self,
        (prepared, on_gpu): (&PreparedTransfer, bool),
        name: &str,
        light: &Illumination,
        summary: &mut Summary,
    ) {
        summary.skipped(prepared.left_out_for(light, on_gpu));
        if light.is_black() {
            summary.warn(format!(
                "{name}: the target light is black, and so is the result"
            ));
            return;
        }
        let mean = light
            .at_one_place(self.cloud.bounds().center)
            .mean_irradiance();
        summary.target(name, (mean * prepared.light_gain()).log2());
    }
}

/// Whether a target is one of a folder that was named.
fn is_of_folder(args: &LightArgs, path: &Path) -> bool {
    let mut folders = args.target.iter().filter(|t| t.is_dir());
    folders.any(|folder| path.starts_with(folder))
}

/// Takes over the origins of splats that lie far from that of their file's coordinates.
fn take_origins(
    scene: &mut Scene,
    objects: &mut [LoadedObject],
    unshown_first: Option<&LoadedObject>,
) {
    if let Some(first) = unshown_first {
        scene.take_origin(0, first.cloud.origin, first.cloud.up);
    }
    let shown = (0..scene.objects.len()).filter(|at| scene.objects[*at].shown);
    let shown: Vec<usize> = shown.collect();
    for (at, object) in shown.iter().zip(&*objects) {
        scene.take_origin(*at, object.cloud.origin, object.cloud.up);
    }
    for (at, object) in shown.iter().zip(objects) {
        object.settings.transform = scene.objects[*at].transform;
    }
}

/// Changes the light: three times where that is to be timed.
fn timed<T>(summary: &mut Summary, mut change: impl FnMut() -> Result<T>) -> Result<T> {
    let mut times = Vec::new();
    let mut time = || {
        let start = Instant::now();
        let changed = change();
        times.push(start.elapsed().as_secs_f64() * 1e3);
        changed
    };
    let mut changed = time()?;
    for _ in 1..if summary.json { 3 } else { 1 } {
        drop(changed);
        changed = time()?;
    }
    times.sort_by(f64::total_cmp);
    if summary.ms("transfer").is_none() {
        summary.add_ms("transfer", times[times.len() / 2]);
    }
    Ok(changed)
}

/// How many surfels are about equally open on both sides.
pub fn two_sided(bake: &Bake) -> usize {
    (0..bake.len()).filter(|i| bake.is_two_sided(*i)).count()
}

/// The lights of a relight as their maps hold them, not turned yet.
pub struct Lights {
    /// Of each object.
    pub sources: Vec<Illumination>,
    /// Of the scene's first one, where it is not among them.
    first: Option<Illumination>,
    pub targets: Vec<Target>,
}

impl Lights {
    /// What an object was captured under as it sees that, and the target as the scene does.
    pub fn oriented(&self, pipeline: &Pipeline, at: usize, target: &Target) -> [Illumination; 2] {
        let object = &pipeline.objects[at];
        let source = object
            .settings
            .source
            .orient(&self.sources[at], object.cloud.up);
        [source, self.on_scene(pipeline, target)]
    }

    /// The target as the scene sees it.
    pub fn on_scene(&self, pipeline: &Pipeline, target: &Target) -> Illumination {
        self.in_scene(pipeline, &pipeline.scene, target)
    }

    /// The same where the scene's light is set otherwise.
    pub fn in_scene(&self, pipeline: &Pipeline, scene: &Scene, target: &Target) -> Illumination {
        let first = pipeline.first();
        let [_, target] = scene.lights_on(&first.settings, self.maps(target), pipeline.cloud.up);
        target
    }

    /// What the first object was captured under and the target, as their maps hold them.
    pub fn maps<'a>(&'a self, target: &'a Target) -> [&'a Illumination; 2] {
        let first = self.first.as_ref().unwrap_or(&self.sources[0]);
        [first, &target.light]
    }
}

/// One light to relight by.
pub struct Target {
    /// Of its output.
    pub name: String,
    pub path: PathBuf,
    pub light: Illumination,
}
