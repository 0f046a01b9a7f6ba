//! An object of the scene that a command works on: its splat, its bakes, and what it tells of its light.

use std::cell::{OnceCell, RefCell};
use std::collections::HashSet;
use std::ops::ControlFlow;
use std::path::Path;
use std::rc::Rc;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use glam::{DVec3, Vec3};
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::patches::DIRECTIONS;
use transplat_core::environment::Illumination;
use transplat_core::estimate::{Estimate, estimate_light};
use transplat_core::files::{
    AssetFile, CameraFile, cameras_of_training, is_same_file, load_asset, load_bake, load_cameras,
};
use transplat_core::progress::no_progress;
use transplat_core::scene::{Object, Scene, kept};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::surfels::{SurfelCloud, is_faint};
use transplat_core::transfer::PreparedTransfer;

use crate::engine::bake::{self, PartOf, Wanted};
use crate::engine::device::Device;
use crate::engine::estimate::estimate_as_json;
use crate::engine::warnings::{asset_warnings, up_warning, up_warning_by_cameras};
use crate::summary::Summary;

/// Directions that are enough to tell a normal's sign.
const ORIENTATION_DIRECTIONS: usize = 64;

/// Characters of a file's name that is made of an object's: systems have room for 255 bytes, and a character may have four.
const LONGEST_FILE_NAME: usize = 60;

/// An object, loaded.
pub struct LoadedObject {
    /// Its settings.
    pub settings: Object,
    pub cloud: Arc<SurfelCloud>,
    pub file: AssetFile,
    /// What it was cut out of, and which of the surfels there it is.
    pub whole: Option<(Rc<LoadedObject>, Arc<[usize]>)>,
    /// The bake for the directional method, and what it told of the light, once they were needed.
    directional_bake: OnceCell<Arc<DirectionalBake>>,
    estimate: OnceCell<Estimate>,
    /// How it was prepared last for parts of it: from what, and how.
    prepared_for_parts: RefCell<Option<(Illumination, TransferSettings, PreparedTransfer)>>,
}

impl LoadedObject {
    /// Loads an object of a scene: a whole splat, or what its settings cut out of one, which may be among those that are loaded already.
    pub fn load_part(
        asset: &Path,
        settings: Object,
        wholes: &mut Vec<Rc<Self>>,
        summary: &mut Summary,
    ) -> Result<Self> {
        if settings.cut.is_empty() {
            return Self::load(asset, settings, summary);
        }
        // However it is spelled: parts of one capture share it.
        let is_it = |o: &Rc<Self>| {
            let read = |o: &Object| (o.up, o.linear, o.outside_from.clone());
            is_same_file(&o.file.path, asset) && read(&o.settings) == read(&settings)
        };
        let whole = match wholes.iter().find(|o| is_it(o)) {
            Some(whole) => whole.clone(),
            None => {
                let all = Object {
                    cut: Vec::new(),
                    ..settings.clone()
                };
                let whole = Rc::new(Self::load(asset, all, summary)?);
                wholes.push(whole.clone());
                whole
            }
        };
        let mut settings = settings;
        settings.take_origin(whole.cloud.origin, DVec3::ZERO);
        let surfels = part_of(asset, &settings, &whole.cloud)?;
        Ok(Self {
            cloud: Arc::new(whole.cloud.selected(&surfels)),
            file: whole.file.part(&surfels),
            settings,
            whole: Some((whole, surfels)),
            directional_bake: OnceCell::new(),
            estimate: OnceCell::new(),
            prepared_for_parts: RefCell::default(),
        })
    }

    /// Loads a splat, and tells what is odd about it.
    pub fn load(asset: &Path, settings: Object, summary: &mut Summary) -> Result<Self> {
        let (cloud, file) = summary.time("load", || load_asset(asset))?;
        for warning in asset_warnings(asset, &file) {
            summary.warn(warning);
        }
        if settings.up.is_none() && file.report.up.is_none() {
            // As its trainer's cameras were held, or else as it stands.
            let cameras = cameras_of_training(asset).and_then(|path| load_cameras(&path).ok());
            let warning = match &cameras {
                Some(cameras) => up_warning_by_cameras(asset, cloud.up, cameras),
                None => up_warning(asset, &cloud, &file),
            };
            warning
                .into_iter()
                .for_each(|warning| summary.warn(warning));
        }
        if !cloud.is_empty() && cloud.opacities.iter().all(|o| is_faint(*o)) {
            summary.warn(format!(
                "{}: all surfels are too faint to be seen (opacity below 1/255); pictures of it are empty",
                asset.display()
            ));
        }
        Ok(Self::of(cloud, file, settings))
    }

    /// That it lies on its side by its cameras, where nobody said which way is up.
    pub fn up_warning_by_cameras(&self, cameras: &CameraFile) -> Option<String> {
        let is_told = self.file.report.up.is_some() || self.settings.up.is_some();
        let warning = || up_warning_by_cameras(&self.file.path, self.cloud.up, cameras);
        (!is_told).then(warning).flatten()
    }

    /// A splat as its settings say.
    pub fn of(mut cloud: SurfelCloud, file: AssetFile, mut settings: Object) -> Self {
        settings.take_origin(cloud.origin, DVec3::ZERO);
        if let Some(up) = settings.up {
            cloud.up = up;
        }
        settings.apply_to(&mut cloud);
        Self {
            cloud: Arc::new(cloud),
            file,
            settings,
            whole: None,
            directional_bake: OnceCell::new(),
            estimate: OnceCell::new(),
            prepared_for_parts: RefCell::default(),
        }
    }

    /// The same where it stands.
    pub fn placed(&self) -> Self {
        Self {
            settings: self.settings.clone(),
            cloud: Arc::new(self.settings.transform.place(&self.cloud)),
            file: self.file.clone(),
            whole: None,
            directional_bake: OnceCell::new(),
            estimate: OnceCell::new(),
            prepared_for_parts: RefCell::default(),
        }
    }

    /// What it is called.
    pub fn name(&self) -> String {
        name_of(&self.settings, &self.file.path)
    }

    /// Bakes what the method needs, or takes the saved bake.
    pub fn bake(
        &self,
        (device, scene): (&Device, &Scene),
        saved: Option<&Path>,
        summary: &mut Summary,
    ) -> Result<Bake> {
        let method = scene.transfer.method;
        Ok(match (method, saved) {
            (Method::Directional, _) => {
                Bake::Directional(self.directional_bake((device, scene), saved, summary)?)
            }
            (Method::Harmonic, Some(path)) => self.saved_bake(path, method, summary)?,
            (Method::Harmonic, None) => {
                let directions = bake_directions(scene, summary);
                self.new_bake((device, scene), method, directions, summary)?
            }
        })
    }

    fn saved_bake(&self, path: &Path, method: Method, summary: &mut Summary) -> Result<Bake> {
        summary.skip("bake", "the saved one is used");
        let bake = summary.time("load", || load_bake(path, &self.cloud))?;
        bake.of_method(method)
            .with_context(|| path.display().to_string())?;
        Ok(bake)
    }

    /// The bake for the directional method, made or read once.
    pub fn directional_bake(
        &self,
        (device, scene): (&Device, &Scene),
        saved: Option<&Path>,
        summary: &mut Summary,
    ) -> Result<Arc<DirectionalBake>> {
        if let Some(known) = self.directional_bake.get() {
            return Ok(known.clone());
        }
        let bake = match saved {
            Some(path) => self.saved_bake(path, scene.transfer.method, summary)?,
            None => self.new_bake((device, scene), Method::Directional, DIRECTIONS, summary)?,
        };
        let Bake::Directional(bake) = bake else {
            bail!("the bake is for the other preset");
        };
        Ok(self.directional_bake.get_or_init(|| bake).clone())
    }

    fn new_bake(
        &self,
        (device, scene): (&Device, &Scene),
        method: Method,
        directions: usize,
        summary: &mut Summary,
    ) -> Result<Bake> {
        let part_of = match (&self.whole, method) {
            (Some((whole, surfels)), Method::Directional) => Some(PartOf {
                whole: whole.directional_bake((device, scene), None, summary)?,
                surfels: surfels.clone(),
            }),
            _ => None,
        };
        let bar = summary.progress_bar("baking visibility");
        let progress = |done: f64| {
            bar.set_position((done * 1000.0) as u64);
            ControlFlow::Continue(())
        };
        let wanted = Wanted {
            cloud: self.cloud.clone(),
            method,
            directions,
            skips: scene.transfer.skips,
            part_of,
            beside: None,
        };
        summary.time("bake", || bake::bake(device, &wanted, &progress))
    }

    /// What the asset tells of the light it was captured under. `saved` is a bake for the method that is set.
    pub fn estimate(
        &self,
        (device, scene): (&Device, &Scene),
        saved: Option<&Path>,
        summary: &mut Summary,
    ) -> Result<&Estimate> {
        if let Some((whole, _)) = &self.whole {
            return whole.estimate((device, scene), None, summary);
        }
        if let Some(known) = self.estimate.get() {
            return Ok(known);
        }
        let is_for_directional = scene.transfer.method == Method::Directional;
        let saved = saved.filter(|_| is_for_directional);
        let directional_bake = self.directional_bake((device, scene), saved, summary)?;
        let estimate = summary.time("estimate", || {
            estimate_light(&self.cloud, &directional_bake, &no_progress)
        })?;
        summary.set("source_estimate", estimate_as_json(&estimate));
        Ok(self.estimate.get_or_init(|| estimate))
    }

    /// That, once it was made.
    pub fn known_estimate(&self) -> Option<&Estimate> {
        let told_by = self.whole.as_ref().map_or(self, |(whole, _)| whole);
        told_by.estimate.get()
    }

    /// Prepares its transfer by its own bake: a part was lit among the rest.
    pub fn prepare(
        &self,
        bake: &Bake,
        by: (&Device, &Scene),
        source: &Illumination,
        summary: &mut Summary,
    ) -> Result<PreparedTransfer> {
        let settings = &by.1.transfer;
        match (&self.whole, settings.method) {
            (Some((whole, surfels)), Method::Directional) => {
                let of_whole = Bake::Directional(whole.directional_bake(by, None, summary)?);
                let mut kept = whole.prepared_for_parts.borrow_mut();
                let known = kept.take();
                let known = known.filter(|(s, t, _)| (s, t) == (source, settings));
                let prepared = match known {
                    Some((.., prepared)) => prepared,
                    None => PreparedTransfer::new(&whole.cloud, &of_whole, source, settings)?,
                };
                let part = prepared.part(bake, surfels)?;
                *kept = Some((source.clone(), settings.clone(), prepared));
                Ok(part)
            }
            _ => Ok(PreparedTransfer::new(&self.cloud, bake, source, settings)?),
        }
    }
}

/// Which surfels of a splat an object is that is cut out of it.
pub fn part_of(asset: &Path, object: &Object, whole: &SurfelCloud) -> Result<Arc<[usize]>> {
    let surfels = kept(&object.cut, &whole.positions).unwrap_or_default();
    if surfels.is_empty() {
        let places = || whole.positions.iter().copied();
        let [low, high] = [Vec3::min, Vec3::max].map(|end| {
            let end = places().reduce(end).unwrap_or_default();
            whole.origin + end.as_dvec3()
        });
        bail!(
            "{}: nothing of it is on the kept side of its cut; its surfels lie between {low} and {high}",
            asset.display()
        );
    }
    Ok(surfels.into())
}

/// What an object is called: as its splat's file without the ending, where nobody calls it otherwise.
pub fn name_of(object: &Object, asset: &Path) -> String {
    let of_file = Object {
        asset: Some(asset.to_owned()),
        ..object.clone()
    };
    of_file.called().unwrap_or_default()
}

/// What something is called as a file's name without the ending, on any system.
pub fn as_file_name(name: &str) -> String {
    let as_file = |c: char| {
        if c.is_alphanumeric() || "-_ .".contains(c) {
            c
        } else {
            '_'
        }
    };
    let file: String = name.chars().take(LONGEST_FILE_NAME).map(as_file).collect();
    // Hidden, it would not be found.
    match file.strip_prefix('.') {
        Some(rest) => format!("_{rest}"),
        None => file,
    }
}

/// Names, those that were there before with a number.
pub fn told_apart(names: impl Iterator<Item = String>) -> Vec<String> {
    let mut taken = HashSet::new();
    let free = |name: String| {
        let numbered = (2..).map(|n| format!("{name}-{n}"));
        let mut free = std::iter::once(name.clone()).chain(numbered);
        free.find(|n| taken.insert(n.clone())).unwrap_or_default()
    };
    names.map(free).collect()
}

/// Directions of the harmonic method's bake.
fn bake_directions(scene: &Scene, summary: &mut Summary) -> usize {
    let settings = &scene.transfer;
    let few = settings.method == Method::Harmonic && !settings.terms.shadow;
    if few && scene.directions > ORIENTATION_DIRECTIONS {
        summary.skip(
            "most directions of the bake",
            "without shadows only the normals need it",
        );
        return ORIENTATION_DIRECTIONS;
    }
    scene.directions
}
