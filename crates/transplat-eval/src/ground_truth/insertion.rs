//! Truth of objects put into captured scenes.
//!
//! A scene's folder holds `scene.ply`; `scene.json`, which names its light (`environment`), that of the objects' captures
//! (`object_source_environment`), cameras (as a camera file) and per object (`inserts.<name>`) `asset` and `object_to_scene` (rows of a 4x4 matrix:
//! one scale, a turn, a move); `gt/without` and `gt/with_<name>/*.exr` (linear, premultiplied), a picture a camera; `masks/<name>/*.png` (red: the
//! object; green: ground that it changes; blue: the same on other things); and optionally `received/<name>.hdr`, the light at the object. Assets
//! are `dev/<asset>` and lights `envs/<name>` of a folder above.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use glam::{Affine3A, Mat4};
use serde::Deserialize;
use transplat_core::camera::{Camera, NEAR};
use transplat_core::color::srgb_encode;
use transplat_core::files::{load_cameras, load_image, load_json, load_picture};
use transplat_core::scene::{EnvironmentLight, Object, Scene, Transform};

use super::there;
use crate::metrics::ComparedImage;

/// A scene with its truth.
pub struct TruthScene {
    /// Name of the scene.
    pub name: String,
    folder: PathBuf,
    root: PathBuf,
    file: SceneFile,
}

#[derive(Deserialize)]
struct SceneFile {
    environment: String,
    object_source_environment: String,
    inserts: BTreeMap<String, Insert>,
}

#[derive(Deserialize)]
struct Insert {
    asset: String,
    object_to_scene: [[f32; 4]; 4],
}

/// A view of it: the camera, and the truth.
pub struct TruthView {
    /// Camera of the images.
    pub camera: Camera,
    /// Image with the object.
    pub with: ComparedImage,
    /// Image without the object.
    pub without: ComparedImage,
    /// The object, ground that it changes, and other things that it changes. `[height][width]`
    pub masks: [Vec<bool>; 3],
}

impl TruthScene {
    /// All scenes in a folder: that folder's, or those of the folders in its folder `insert`.
    ///
    /// # Errors
    /// There is none, or one cannot be read.
    pub fn all_in(folder: &Path) -> Result<Vec<Self>> {
        if folder.join("scene.json").is_file() {
            return Ok(vec![Self::load(folder)?]);
        }
        let inside = folder.join("insert");
        let entries = std::fs::read_dir(&inside).with_context(|| {
            format!(
                "{}: neither scene.json nor a folder insert with scenes is there",
                folder.display()
            )
        })?;
        let folders = entries.filter_map(|entry| Some(entry.ok()?.path()));
        let mut folders: Vec<PathBuf> =
            folders.filter(|f| f.join("scene.json").is_file()).collect();
        folders.sort();
        if folders.is_empty() {
            bail!("{}: holds no scene (scene.json)", inside.display());
        }
        folders.iter().map(|f| Self::load(f)).collect()
    }

    fn load(folder: &Path) -> Result<Self> {
        let path = folder.join("scene.json");
        let file: SceneFile = load_json(&path, "scene with truth")?;
        let folder = folder.canonicalize()?;
        let light = Path::new("envs").join(&file.environment);
        let root = folder
            .ancestors()
            .find(|above| above.join(&light).is_file());
        let root = root.with_context(|| {
            format!(
                "{}: no folder above has {}",
                path.display(),
                light.display()
            )
        })?;
        Ok(Self {
            name: folder
                .file_name()
                .unwrap_or_default()
                .to_string_lossy()
                .into_owned(),
            root: root.to_owned(),
            folder,
            file,
        })
    }

    /// The objects that are put into it.
    pub fn inserts(&self) -> impl Iterator<Item = &String> {
        self.file.inserts.keys()
    }

    /// Files that it is made of.
    pub fn inputs(&self) -> Vec<PathBuf> {
        let assets = self.file.inserts.values().map(|i| self.asset(i));
        assets.chain([self.folder.join("scene.ply")]).collect()
    }

    fn asset(&self, insert: &Insert) -> PathBuf {
        self.root.join("dev").join(&insert.asset)
    }

    /// The scene with one of the objects, as the program reads scenes.
    ///
    /// # Errors
    /// A file is missing, or the object stands where none can.
    pub fn with(&self, insert: &str) -> Result<Scene> {
        let name = insert;
        let insert = &self.file.inserts[name];
        let matrix = Mat4::from_cols_array_2d(&insert.object_to_scene).transpose();
        let (scale, rotation, translation) =
            Affine3A::from_mat4(matrix).to_scale_rotation_translation();
        let light = |name: &str| -> Result<_> {
            Ok(EnvironmentLight::of(there(
                self.root.join("envs").join(name),
            )?))
        };
        let captured = Object {
            asset: Some(there(self.folder.join("scene.ply"))?),
            source: light(&self.file.environment)?,
            ..Object::default()
        };
        let inserted = Object {
            name: Some(name.into()),
            asset: Some(there(self.asset(insert))?),
            source: light(&self.file.object_source_environment)?,
            transform: Transform {
                scale: scale.x,
                rotation: rotation.normalize(),
                translation,
            },
            ..Object::default()
        };
        let scene = Scene {
            objects: vec![captured, inserted],
            environment: light(&self.file.environment)?,
            ..Scene::default()
        };
        scene.validate()?;
        Ok(scene)
    }

    /// The light that arrives at an object, where it is known.
    pub fn received(&self, insert: &str) -> Option<PathBuf> {
        let path = self.folder.join("received").join(format!("{insert}.hdr"));
        path.is_file().then_some(path)
    }

    /// The views with an object; `radius` is the scene's.
    ///
    /// # Errors
    /// A picture cannot be read, or is of another size than the rest.
    pub fn views(&self, insert: &str, radius: f32) -> Result<Vec<TruthView>> {
        let cameras = self.folder.join("scene.json");
        let file = load_cameras(&cameras)?;
        let size = file.size();
        let [width, height] = size.with_context(|| format!("{}: no size", cameras.display()))?;
        let frames = file.frames.iter().enumerate();
        frames
            .map(|(number, frame)| {
                let picture = |folder: &str| -> Result<ComparedImage> {
                    let path = self.folder.join(folder).join(format!("{number:02}.exr"));
                    let raster = load_picture(&path)?;
                    if (raster.width, raster.height) != (width, height) {
                        bail!("{}: {width} x {height} pixels are expected", path.display());
                    }
                    Ok(ComparedImage::of_linear(&raster))
                };
                let near = NEAR * radius;
                Ok(TruthView {
                    camera: frame.camera([width, height], near),
                    with: picture(&format!("gt/with_{insert}"))?,
                    without: picture("gt/without")?,
                    masks: self.masks(insert, number, width * height)?,
                })
            })
            .collect()
    }

    fn masks(&self, insert: &str, number: usize, pixels: usize) -> Result<[Vec<bool>; 3]> {
        let folder = self.folder.join("masks").join(insert);
        let path = folder.join(format!("{number:02}.png"));
        // As any image, its values come decoded.
        let mask = load_image(&path, None)?;
        if mask.pixels.len() != pixels {
            bail!("{}: {pixels} pixels are expected", path.display());
        }
        let above = [0.5, 0.0, 0.0];
        Ok(std::array::from_fn(|c| {
            let each = mask.pixels.iter();
            each.map(|p| srgb_encode(p[c]) > above[c]).collect()
        }))
    }
}
