//! An asset as it is open, and with which settings it is opened.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use glam::Vec3;
use transplat_core::camera::CameraPose;
use transplat_core::color::Encoding;
use transplat_core::files::{AssetFile, load_asset};
use transplat_core::ground::ground_plane;
use transplat_core::scene::{Object, Scene};
use transplat_core::surfels::{Bounds, SurfelCloud, UpAxis};

use crate::pipeline::warnings::asset_warnings;

/// An asset as it is open.
#[derive(Clone)]
pub struct Asset {
    pub path: PathBuf,
    pub cloud: Arc<SurfelCloud>,
    pub file: Arc<AssetFile>,
    pub bounds: Bounds,
    pub warnings: Vec<String>,
    pub load_ms: f64,
    /// Up axis as the file says it.
    pub file_up: UpAxis,
    /// Up axis that the ground is made for.
    pub up: UpAxis,
    pub ground: (Vec3, [Vec3; 2]),
    /// How it was to be read when that was last asked for: whether its colour is linear, and from where its outside is seen.
    pub(super) reading_asked: Option<(bool, Vec<Vec3>)>,
}

impl Asset {
    /// Reads a splat as an object's settings say.
    pub fn load(path: PathBuf, object: &Object) -> Result<Self> {
        let start = Instant::now();
        let (mut cloud, file) = load_asset(&path)?;
        let file_up = cloud.up;
        object.apply_to(&mut cloud);
        Ok(Self {
            bounds: cloud.bounds(),
            ground: ground_plane(&cloud, file_up),
            up: file_up,
            warnings: asset_warnings(&path, &file),
            load_ms: start.elapsed().as_secs_f64() * 1e3,
            file_up,
            file: Arc::new(file),
            cloud: Arc::new(cloud),
            path,
            reading_asked: None,
        })
    }

    /// For the user.
    pub fn name(&self) -> String {
        self.path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned()
    }

    /// Sets how it is read to how it was.
    pub fn give_back(&self, object: &mut Object) {
        object.linear = self.is_linear();
        object.outside_from.clone_from(&self.cloud.outside_from);
    }

    /// Whether it was read as an object's settings say.
    pub fn is_read_as(&self, object: &Object) -> bool {
        object.linear == self.is_linear() && object.outside_from == self.cloud.outside_from
    }

    /// Whether its colour was taken for linear.
    pub fn is_linear(&self) -> bool {
        self.cloud.encoding == Encoding::StoredLinear
    }
}

/// What a splat is opened with.
#[derive(Clone, Debug)]
pub enum OpenedWith {
    /// What is told of it, and where it is looked at from; everything else stays as it is when the splat is there, and so does what was
    /// changed meanwhile.
    Object(Box<Object>, Option<CameraPose>),
    /// The open splat again, its colour taken otherwise: as an object.
    Again,
    /// As the scene lists it.
    Listed,
    /// All settings, of a scene of this one object.
    Scene(Box<Scene>),
}

/// What is told of an object whose splat is opened, given what was set when that was asked for and what is set now: what the user changed
/// meanwhile wins.
pub fn told(opened: Object, asked: &Object, now: Object) -> Object {
    fn kept<T: PartialEq>(new: T, asked: &T, now: T) -> T {
        if *asked == now { new } else { now }
    }
    let outside_from = kept(opened.outside_from, &asked.outside_from, now.outside_from);
    Object {
        source: kept(opened.source, &asked.source, now.source),
        up: kept(opened.up, &asked.up, now.up),
        linear: kept(opened.linear, &asked.linear, now.linear),
        outside_from,
        hide: kept(opened.hide, &asked.hide, now.hide),
        ..now
    }
}
