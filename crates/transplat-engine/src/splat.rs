//! Splat of an open object, and the settings that it is opened with.

use std::borrow::Cow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result};
use glam::{DVec3, Vec3};
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::camera::CameraPose;
use transplat_core::crop::proposed_crop;
use transplat_core::files::{
    CameraFile, SplatFile, SplatFormat, cameras_of_training, load_cameras, load_splat,
};
use transplat_core::ground::ground_plane;
use transplat_core::scene::{Object, Scene, splat_name};
use transplat_core::surfels::{Bounds, SurfelCloud, UpAxis};
use transplat_core::up_axis::{UpEvidence, proposed_up};

use crate::capture::{Capture, CutPart, part_of};
use crate::language::tr;
use crate::reading::Reading;
use crate::warnings::asset_warnings;

/// An asset as it is open.
#[derive(Clone)]
pub struct Splat {
    /// File of the splat.
    pub path: PathBuf,
    /// Settings that it was read with.
    pub reading: Reading,
    /// Surfels of the part that the object is, where it is cut out of a splat.
    pub part: Option<CutPart>,
    /// Gaussians of the object: all of the splat, or the part that is cut out.
    pub cloud: Arc<SurfelCloud>,
    /// Properties of the file, to be written again.
    pub file: Arc<SplatFile>,
    /// Bounding sphere of the Gaussians.
    pub bounds: Bounds,
    /// Oddities of the file, in words.
    pub warnings: Vec<String>,
    /// Losses of each format that it may be written in.
    pub losses: Vec<(SplatFormat, Vec<String>)>,
    /// Milliseconds that loading took.
    pub load_ms: f64,
    /// Up axis as the file says it.
    pub file_up: UpAxis,
    /// Up axis that it seems to stand by, where the file has none.
    pub proposed_up: Option<(UpAxis, UpEvidence)>,
    /// Cameras that its trainer wrote beside it.
    pub cameras: Option<CameraFile>,
    /// Corners of a box around the object, as its settings have them, where it seems to lie in surroundings.
    pub proposed_crop: Option<[Vec3; 2]>,
    /// Up axis that the ground is made for.
    pub up: UpAxis,
    /// Middle and axes of the ground below the object.
    pub ground: (Vec3, [Vec3; 2]),
    /// Reading that was requested last.
    pub reading_asked: Option<Reading>,
}

impl Splat {
    /// Reads a splat as an object's settings say; `open` is the whole, if it was read so already and the object is cut out of it.
    pub fn load(path: PathBuf, object: &Object, open: Option<Arc<Capture>>) -> Result<Self> {
        let start = Instant::now();
        let (capture, warnings) = match open {
            Some(capture) => (capture, Vec::new()),
            None => {
                let (mut cloud, file) = load_splat(&path)?;
                let mut object = object.clone();
                object.take_origin(cloud.origin, DVec3::ZERO);
                object.apply_to(&mut cloud);
                let warnings = asset_warnings(&path, &file);
                let reading = Reading::of(&object);
                let capture =
                    Capture::new(path.clone(), reading, Arc::new(cloud), Arc::new(file), None);
                (Arc::new(capture), warnings)
            }
        };
        let part = if object.cut.is_empty() {
            None
        } else {
            let mut object = object.clone();
            object.take_origin(capture.cloud.origin, DVec3::ZERO);
            let surfels = part_of(&path, &object, &capture.cloud)?;
            Some(CutPart::new(capture.clone(), surfels))
        };
        let (cloud, file) = match &part {
            None => (capture.cloud.clone(), capture.file.clone()),
            Some(CutPart { surfels, .. }) => (
                Arc::new(capture.cloud.selected(surfels)),
                Arc::new(capture.file.part(surfels)),
            ),
        };
        let file_up = cloud.up;
        let reading = Reading {
            outside_from: cloud.outside_from.clone(),
            ..Reading::of(object)
        };
        Ok(Self {
            proposed_crop: None,
            proposed_up: None,
            reading,
            cameras: None,
            part,
            bounds: cloud.bounds(),
            ground: ground_plane(&cloud, file_up),
            up: file_up,
            losses: Vec::new(),
            warnings,
            load_ms: start.elapsed().as_secs_f64() * 1e3,
            file_up,
            file,
            cloud,
            path,
            reading_asked: None,
        })
    }

    /// Adds what only a window shows: proposals for up axis and crop, cameras, and what each format would lose.
    pub fn with_hints(self) -> Self {
        let cloud = &self.cloud;
        let whole = self.part.is_none().then_some(cloud);
        let (explicit, habit) = (self.file.report.up, self.file.usual_up());
        let proposed_up = whole.and_then(|cloud| proposed_up(cloud, explicit, habit));
        let losses = SplatFormat::WRITTEN.map(|(_, format)| (format, format.losses(cloud)));
        Self {
            proposed_crop: whole.and_then(|cloud| proposed_crop(cloud, &self.bounds)),
            proposed_up: proposed_up.filter(|(up, _)| *up != self.file_up),
            cameras: cameras_of_training(&self.path).and_then(|path| load_cameras(&path).ok()),
            losses: losses.to_vec(),
            ..self
        }
    }

    /// All of the splat that it is of.
    pub fn whole_cloud(&self) -> &Arc<SurfelCloud> {
        self.part.as_ref().map_or(&self.cloud, |p| &p.capture.cloud)
    }

    /// Surfels that the light of the capture shone on, with their bake: all of the splat that this is cut out of, or the object alone (`own`).
    ///
    /// # Errors
    /// The whole capture is not baked.
    pub fn under_capture_light(
        &self,
        own: Arc<DirectionalBake>,
        is_isolated: bool,
    ) -> Result<(&Arc<SurfelCloud>, Arc<DirectionalBake>)> {
        match self.part.as_ref().filter(|_| !is_isolated) {
            Some(part) => {
                let bake = part.capture.known_bake();
                let bake = bake.context(tr("the capture is not baked"))?;
                Ok((&part.capture.cloud, bake))
            }
            None => Ok((&self.cloud, own)),
        }
    }

    /// The splat as it stands with an up axis, which may be another than its file's.
    pub fn upright(&self, up: UpAxis) -> Arc<SurfelCloud> {
        if up == self.cloud.up {
            return self.cloud.clone();
        }
        Arc::new(SurfelCloud {
            up,
            ..(*self.cloud).clone()
        })
    }

    /// Takes the bake of what another reading of the same file is cut out of, where the two differ in their colours alone; true where they do.
    pub fn takes_bake_of_recolored(&self, other: &Self) -> bool {
        let response = other.reading.response;
        let reading = Reading {
            response,
            ..self.reading.clone()
        };
        let is_it = self.path == other.path && reading == other.reading;
        if let (true, Some(own), Some(other)) = (is_it, &self.part, &other.part) {
            own.capture.take_bake(&other.capture);
        }
        is_it
    }

    /// For the user.
    pub fn name(&self) -> String {
        name_of(&self.path)
    }
}

/// Origin of a splat that is opened, and what is set along with it.
#[derive(Clone, Debug)]
pub enum OpenedWith {
    /// Properties of the file, and the camera that it is looked at from. What the user changed meanwhile stays.
    Object(Box<Object>, Option<CameraPose>),
    /// The open splat again, its colour taken otherwise: as an object.
    Again,
    /// As the scene lists it.
    Listed,
    /// All settings, of a scene of this one object.
    Scene(Box<Scene>),
}

/// Settings of an object whose splat was opened, from the file's, those when it was asked for and those of now: what the user changed meanwhile wins.
pub fn told(opened: Object, asked: &Object, now: Object) -> Object {
    fn kept<T: PartialEq>(new: T, asked: &T, now: T) -> T {
        if *asked == now { new } else { now }
    }
    let outside_from = kept(opened.outside_from, &asked.outside_from, now.outside_from);
    Object {
        source: kept(opened.source, &asked.source, now.source),
        up: kept(opened.up, &asked.up, now.up),
        response: kept(opened.response, &asked.response, now.response),
        outside_from,
        hide: kept(opened.hide, &asked.hide, now.hide),
        cut: kept(opened.cut, &asked.cut, now.cut),
        ..now
    }
}

/// Names that trainers give to every splat, so that only the folder distinguishes them.
const CALLED_ALIKE: [&str; 4] = ["point_cloud", "source", "splat", "output"];

/// Name of a splat for the user: of its file, or of the nearest folder with a name where trainers call all files alike.
pub fn name_of(path: &Path) -> String {
    let stem = Cow::from(splat_name(path));
    let folders = path.iter().rev().skip(1).map(|f| f.to_string_lossy());
    let is_own = |name: &str| {
        let name = name.to_lowercase();
        let is_name = name.chars().any(char::is_alphanumeric);
        is_name && !CALLED_ALIKE.contains(&&*name) && !name.starts_with("iteration_")
    };
    let mut names = std::iter::once(stem.clone()).chain(folders);
    names.find(|name| is_own(name)).unwrap_or(stem).into_owned()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::name_of;

    #[test]
    fn a_splat_is_called_as_only_it_is() {
        for (path, name) in [
            ("/captures/teapot.ply", "teapot"),
            ("guitar.compressed.ply", "guitar"),
            ("playbot_sog/meta.json", "playbot_sog"),
            (
                "/captures/garden/point_cloud/iteration_30000/point_cloud.ply",
                "garden",
            ),
            ("plant/source.ply", "plant"),
            ("/point_cloud.ply", "point_cloud"),
            ("splat.ply", "splat"),
            ("../output/splat.ply", "splat"),
        ] {
            assert_eq!(name_of(Path::new(path)), name);
        }
    }
}
