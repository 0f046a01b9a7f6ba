//! An asset as it is open, and with which settings it is opened.

use std::path::PathBuf;
use std::sync::Arc;

use glam::Vec3;
use transplat_core::camera::CameraPose;
use transplat_core::color::Encoding;
use transplat_core::files::AssetFile;
use transplat_core::scene::{Object, Scene};
use transplat_core::surfels::{Bounds, SurfelCloud, UpAxis};

/// An asset as it is open.
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
    /// The open splat again, its colour taken otherwise.
    Again(Box<Object>),
    /// All settings.
    Scene(Box<Scene>),
}

impl OpenedWith {
    /// How the splat `at` in the scene is read.
    pub fn object(&self, at: usize) -> &Object {
        match self {
            Self::Object(object, _) | Self::Again(object) => object,
            Self::Scene(scene) => &scene.objects[at],
        }
    }

    /// The scene that the splat is shown in, given that of when it was asked for and that of now.
    pub fn over(self, at: usize, asked: &Scene, now: &Scene, pose: CameraPose) -> Scene {
        /// What the user changed while the splat was loading wins.
        fn kept<T: PartialEq>(new: T, asked: &T, now: T) -> T {
            if *asked == now { new } else { now }
        }
        let mut now = now.clone();
        match self {
            Self::Object(opened, camera) => {
                let (asked, object) = (&asked.objects[at], now.objects[at].clone());
                now.objects[at] = Object {
                    source: kept(opened.source, &asked.source, object.source),
                    up: kept(opened.up, &asked.up, object.up),
                    linear: kept(opened.linear, &asked.linear, object.linear),
                    outside_from: kept(
                        opened.outside_from,
                        &asked.outside_from,
                        object.outside_from,
                    ),
                    hide: kept(opened.hide, &asked.hide, object.hide),
                    ..object
                };
                now.camera = camera;
                now
            }
            // What was asked for meanwhile is loaded next.
            Self::Again(_) => Scene {
                camera: Some(pose),
                ..now
            },
            Self::Scene(scene) => *scene,
        }
    }
}
