//! Path-traced truth to measure a relight against: a folder of objects, each with its splat, cameras and true images.
//!
//! `MANIFEST.json` names the objects of each set (`sets.<set>.objects.<object>`): `source_env`, `targets`, and optionally `source_ply`
//! (`source.ply`) and `gt_of`, another object whose cameras and pictures serve. Lights are `envs/<light>.hdr` or `.exr`, cameras
//! `<set>/<object>/transforms_test.json`, pictures `<set>/<object>/gt/<light>/*.exr` (linear, premultiplied), one a camera.

pub mod insertion;
pub mod views;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use serde::Deserialize;
use transplat_core::files::load_json;

use transplat_engine::bundled::{BUNDLED_SPLAT, BUNDLED_TRAINED_SPLAT};

/// One object with its truth.
#[derive(Clone, Debug)]
pub struct TruthObject {
    /// With its set's, where two sets have one of that name.
    pub name: String,
    set: String,
    /// Splat of the object.
    pub asset: PathBuf,
    /// Cameras of the true images.
    pub cameras: PathBuf,
    /// Capture light.
    pub source: TruthLight,
    /// Target lights with true images.
    pub targets: Vec<TruthLight>,
    /// Folder of the pictures, one folder a light.
    pictures: PathBuf,
}

/// A light by its name and file.
#[derive(Clone, Debug)]
pub struct TruthLight {
    /// Name of the light.
    pub name: String,
    /// Its environment.
    pub path: PathBuf,
}

#[derive(Deserialize)]
struct Manifest {
    sets: BTreeMap<String, Set>,
}

#[derive(Deserialize)]
struct Set {
    objects: BTreeMap<String, ObjectFile>,
}

#[derive(Deserialize)]
struct ObjectFile {
    source_env: String,
    targets: Vec<String>,
    source_ply: Option<String>,
    gt_of: Option<String>,
}

impl TruthObject {
    /// All objects of a folder.
    ///
    /// # Errors
    /// The manifest cannot be read, or names what is not there.
    pub fn all_in(folder: &Path) -> Result<Vec<Self>> {
        let path = folder.join("MANIFEST.json");
        let name = || path.display().to_string();
        let manifest: Manifest = load_json(&path, "manifest of path-traced truth")?;
        let mut all = Vec::new();
        for (set, objects) in &manifest.sets {
            for (name, object) in &objects.objects {
                all.push(Self::of(folder, set, name, object)?);
            }
        }
        // Where two sets have an object of one name, the set's belongs to it.
        let names: Vec<String> = all.iter().map(|o: &Self| o.name.clone()).collect();
        for object in &mut all {
            if names.iter().filter(|n| **n == object.name).count() > 1 {
                object.name = format!("{}_{}", object.set, object.name);
            }
        }
        if all.is_empty() {
            bail!("{}: names no object", name());
        }
        Ok(all)
    }

    fn of(folder: &Path, set_name: &str, name: &str, object: &ObjectFile) -> Result<Self> {
        let set = folder.join(set_name);
        let light = |name: &str| -> Result<TruthLight> {
            let named = |extension: &str| folder.join("envs").join(format!("{name}.{extension}"));
            let path = ["hdr", "exr"].map(named).into_iter().find(|p| p.is_file());
            Ok(TruthLight {
                name: name.to_owned(),
                path: path.with_context(|| {
                    format!("{}: the light {name} is missing", named("hdr").display())
                })?,
            })
        };
        let asset = object.source_ply.as_deref().unwrap_or("source.ply");
        let truth = set.join(object.gt_of.as_deref().unwrap_or(name));
        let pictures = truth.join("gt");
        let is_there = |l: &&String| pictures.join(l).is_dir() && **l != object.source_env;
        if !object.targets.iter().any(|l| is_there(&l)) {
            bail!(
                "{}: holds no image of {name} under any of its targets",
                pictures.display()
            );
        }
        Ok(Self {
            name: name.to_owned(),
            set: set_name.to_owned(),
            asset: there(set.join(name).join(asset))?,
            cameras: there(truth.join("transforms_test.json"))?,
            source: light(&object.source_env)?,
            targets: object
                .targets
                .iter()
                .filter(is_there)
                .map(|l| light(l))
                .collect::<Result<_>>()?,
            pictures,
        })
    }

    /// The bundled splats', in the folder of the assets: the bundled scene's first.
    ///
    /// # Errors
    /// Some of it is missing.
    pub fn all_bundled(assets: &Path) -> Result<Vec<Self>> {
        let each = [BUNDLED_SPLAT, BUNDLED_TRAINED_SPLAT].into_iter();
        each.map(|splat| Self::bundled(assets, splat.trim_end_matches(".ply")))
            .collect()
    }

    fn bundled(assets: &Path, name: &str) -> Result<Self> {
        let file = |name: &str| there(assets.join(name));
        let light = |name: &str| -> Result<TruthLight> {
            Ok(TruthLight {
                name: name.to_owned(),
                path: file(&format!("{name}.hdr"))?,
            })
        };
        Ok(Self {
            name: name.to_owned(),
            set: String::new(),
            asset: file(&format!("{name}.ply"))?,
            cameras: file(&format!("{name}_cameras.json"))?,
            source: light("city")?,
            targets: vec![light("sunset")?, light("interior")?],
            pictures: assets.join("truth").join(name),
        })
    }

    /// The true pictures under a light, in the cameras' order.
    ///
    /// # Errors
    /// There is none.
    pub fn pictures(&self, light: &TruthLight) -> Result<Vec<PathBuf>> {
        let folder = self.pictures.join(&light.name);
        let entries = std::fs::read_dir(&folder).with_context(|| folder.display().to_string())?;
        let mut found: Vec<PathBuf> = entries
            .filter_map(|e| Some(e.ok()?.path()))
            .filter(|p| p.extension().is_some_and(|e| e.eq_ignore_ascii_case("exr")))
            .collect();
        // By their numbers, as cameras are: r_2 before r_10.
        found.sort_by_cached_key(|p| {
            let stem = p.file_stem().unwrap_or_default().to_string_lossy();
            let digits = stem.trim_start_matches(|c: char| !c.is_ascii_digit());
            (digits.parse::<u64>().ok(), p.clone())
        });
        if found.is_empty() {
            bail!("{}: holds no .exr image", folder.display());
        }
        Ok(found)
    }
}

/// A path, if there is a file.
fn there(path: PathBuf) -> Result<PathBuf> {
    if !path.is_file() {
        bail!("{}: is missing", path.display());
    }
    Ok(path)
}
