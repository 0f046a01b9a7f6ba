//! An asset as it is open, and with which settings it is opened.

use std::path::PathBuf;
use std::sync::Arc;

use glam::Vec3;
use transplat_core::camera::CameraPose;
use transplat_core::color::Encoding;
use transplat_core::estimate::Estimate;
use transplat_core::files::AssetFile;
use transplat_core::look::{ESTIMATE, LightSettings, Look};
use transplat_core::surfels::{Bounds, Hide, SurfelCloud, UpAxis};
use transplat_core::transfer::TransferAsset;
use transplat_gpu::live::LiveAsset;

/// An asset as it is open.
pub struct Asset {
    pub path: PathBuf,
    pub cloud: Arc<SurfelCloud>,
    pub file: Arc<AssetFile>,
    pub bounds: Bounds,
    pub warnings: Vec<String>,
    pub load_ms: f64,
    /// Surfels that are too faint to be seen, or broken.
    pub never_seen: usize,
    /// Up axis as the file says it.
    pub file_up: UpAxis,
    /// Up axis that the ground is made for.
    pub up: UpAxis,
    pub ground: (Vec3, [Vec3; 2]),
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
}

/// A loaded asset on its way to the screen.
pub struct LoadedAsset {
    pub asset: Asset,
    pub live: LiveAsset,
    pub transfer: TransferAsset,
    /// What was kept of an estimate of its light.
    pub estimate: Option<Estimate>,
    pub settings: Settings,
    /// The settings as they were when it was asked for.
    pub asked: Look,
}

/// What a splat is opened with.
#[derive(Clone, Debug)]
pub enum Settings {
    /// What is told of its capture; everything else stays as it is when the splat is there, and so does what was changed meanwhile.
    Capture(Box<Capture>),
    /// The open splat again, read otherwise.
    Again(Reading),
    /// All settings.
    Look(Box<Look>),
}

/// What of the settings the splat itself is: another one, and it is loaded again.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Reading {
    /// Whether its colour is linear.
    pub linear: bool,
    /// Places that see its outside.
    pub outside_from: Vec<Vec3>,
}

impl Reading {
    /// As a look has it.
    pub fn of(look: &Look) -> Self {
        Self {
            linear: look.linear,
            outside_from: look.outside_from.clone(),
        }
    }

    /// As an open splat has it.
    pub fn of_cloud(cloud: &SurfelCloud) -> Self {
        Self {
            linear: cloud.encoding == Encoding::StoredLinear,
            outside_from: cloud.outside_from.clone(),
        }
    }

    /// That look, the splat read so.
    pub fn over(self, look: Look) -> Look {
        Look {
            linear: self.linear,
            outside_from: self.outside_from,
            ..look
        }
    }
}

/// What is told of a splat's capture.
#[derive(Clone, Debug)]
pub struct Capture {
    /// Its light; estimated from the splat where nobody knows it.
    pub source: LightSettings,
    /// Its up axis, where the file is not to be believed.
    pub up: Option<UpAxis>,
    /// How it is read.
    pub reading: Reading,
    /// What of it is hidden.
    pub hide: Hide,
    /// Where it is looked at from; all of it otherwise.
    pub camera: Option<CameraPose>,
}

impl Default for Capture {
    fn default() -> Self {
        Self {
            source: LightSettings::of(ESTIMATE),
            up: None,
            reading: Reading::default(),
            hide: Hide::default(),
            camera: None,
        }
    }
}

impl Settings {
    pub fn reading(&self) -> Reading {
        match self {
            Self::Capture(capture) => capture.reading.clone(),
            Self::Again(reading) => reading.clone(),
            Self::Look(look) => Reading::of(look),
        }
    }

    /// The look that the splat is shown with, given that of when it was asked for and that of now.
    pub fn over(self, asked: &Look, now: &Look, pose: CameraPose) -> Look {
        /// What the user changed while the splat was loading wins.
        fn kept<T: PartialEq>(new: T, asked: &T, now: T) -> T {
            if *asked == now { new } else { now }
        }
        let now = now.clone();
        match self {
            Self::Capture(capture) => {
                let [before, after] = [asked, &now].map(Reading::of);
                kept(capture.reading, &before, after).over(Look {
                    source: kept(capture.source, &asked.source, now.source),
                    up: kept(capture.up, &asked.up, now.up),
                    hide: kept(capture.hide, &asked.hide, now.hide),
                    camera: capture.camera,
                    ..now
                })
            }
            // What was asked for meanwhile is loaded next.
            Self::Again(_) => Look {
                camera: Some(pose),
                ..now
            },
            Self::Look(look) => *look,
        }
    }
}
