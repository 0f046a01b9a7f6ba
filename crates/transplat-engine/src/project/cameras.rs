//! Cameras of a file, each with its photograph behind the objects.

use std::path::{Path, PathBuf};

use glam::Vec3;
use transplat_core::camera::CameraPose;
use transplat_core::files::{CameraFile, CameraFrame, folder_of, image_size, load_cameras};
use transplat_core::present::Background;
use transplat_core::up_axis::up_from_cameras;

use crate::jobs::Kind;
use crate::language::{tr, tr_format};
use crate::project::{Notice, OpenCameras, Project};
use crate::render::photographs_named;
use crate::splat::Splat;

/// Folders, seen from that of a camera file, in which photographs lie.
const FOLDERS: [&str; 6] = ["", "images", "..", "../images", "../..", "../../images"];

impl Project {
    /// Opens a camera file and looks through its first camera.
    pub fn open_cameras(&mut self, path: &Path) {
        self.jobs.cancel(Kind::Cameras);
        let path = path.to_owned();
        let file = path.clone();
        let work = move |_: &_| Ok(load_cameras(&file)?);
        self.start(
            Kind::Cameras,
            tr("reading cameras"),
            work,
            move |project, file| {
                project.show_cameras(&path, file);
            },
        );
    }

    fn show_cameras(&mut self, path: &Path, file: CameraFile) {
        self.notices.push(Notice::Opened(path.to_owned()));
        let first = self.states.first().and_then(|s| s.asset.clone());
        let placed = first
            .as_ref()
            .map(|asset| file.clone().placed_for(&asset.cloud));
        for warning in &placed.as_ref().unwrap_or(&file).warnings {
            self.info(warning.clone());
        }
        self.info(tr_format!(
            "{}: {} cameras. Choose one in the panel Camera.",
            path.display(),
            file.frames.len()
        ));
        self.cameras = Some(OpenCameras {
            path: path.to_owned(),
            file,
            at: 0,
            photograph: None,
            is_found: false,
        });
        if let Some(asset) = first {
            self.set_upright_by_cameras(&asset);
        }
        // One that sees nothing shows nothing, and what is seen now would be lost.
        if placed.is_none_or(|file| file.sees) {
            self.look_through(0);
        }
    }

    /// Sets the first object upright as the cameras that are open were held, where nobody said which way is up; what was proposed before was a
    /// worse guess. Whether the cameras tell.
    pub fn set_upright_by_cameras(&mut self, asset: &Splat) -> bool {
        let object = &mut self.scene.objects[0];
        let proposed = asset.proposed_up.map(|(up, _)| up);
        let is_chosen = object.up.is_some() && object.up != proposed;
        if asset.file.report.up.is_some() || is_chosen {
            return false;
        }
        let frames = self.cameras.iter().flat_map(|open| &open.file.frames);
        let Some(up) = up_from_cameras(frames.map(|f| f.world_from_camera)) else {
            return false;
        };
        if up != object.up.unwrap_or(asset.file_up) {
            object.up = Some(up);
            self.info(tr_format!(
                "Up axis set to {name}, by its cameras. Change it in Objects.",
                name = up.name()
            ));
        }
        true
    }

    /// Looks through a camera of the file that is open, its photograph behind the objects where that is found.
    pub fn look_through(&mut self, at: usize) {
        let middle = self.scene_bounds().map_or(Vec3::ZERO, |b| b.center);
        let up = self.scene_up();
        let Some(cameras) = &mut self.cameras else {
            return;
        };
        let Some(frame) = cameras.file.frames.get(at).cloned() else {
            return;
        };
        // Where they are is told in the coordinates of their file.
        let first = self.states.first().and_then(|s| s.asset.as_ref());
        let placed = first.map(|asset| cameras.file.clone().placed_for(&asset.cloud));
        let frame = placed.map_or(frame, |file| file.frames[at].clone());
        cameras.at = at;
        let found = photograph(&cameras.path, &frame);
        let last = std::mem::replace(&mut cameras.photograph, found.clone());
        let is_behind = self.scene.background == Background::Backplate;
        if found.is_none() && is_behind && last.is_some() && self.scene.plate == last {
            // That of another camera would lie; one that the user chose stays.
            self.scene.plate = None;
            self.scene.background = Background::default();
        }
        if let Some(photograph) = &found {
            if last.as_ref() != found.as_ref() {
                self.info(tr_format!(
                    "{}: photograph of this camera shown as the background.",
                    photograph.display()
                ));
            }
            self.set_backplate(photograph.clone());
        } else if let Some(picture) = &frame.picture {
            self.info(tr_format!(
                "{picture}: photograph not found beside the camera file or in images/.",
                picture = picture
            ));
        }
        // An angle of view is across the whole photograph.
        let behind = self.scene.plate.as_ref();
        let behind = behind.filter(|_| self.scene.background == Background::Backplate);
        let size = frame.size.or_else(|| image_size(behind?).ok());
        if let Some(size) = size.filter(|_| found.is_some()) {
            self.notices.push(Notice::PictureSize(size));
        }
        let camera = frame.camera(size.unwrap_or([800, 800]), 1e-3);
        self.pose = CameraPose {
            aperture: self.pose.aperture,
            ..CameraPose::of(&camera, up, middle)
        };
    }

    /// Shows a photograph behind the objects.
    pub fn set_backplate(&mut self, path: PathBuf) {
        self.scene.plate = Some(path);
        self.scene.background = Background::Backplate;
    }
}

/// A camera's photograph, if it is near its file.
fn photograph(cameras: &Path, frame: &CameraFrame) -> Option<PathBuf> {
    let folder = if cameras.is_dir() {
        cameras
    } else {
        folder_of(cameras)
    };
    let picture = Path::new(frame.picture.as_deref()?);
    let names = [picture, Path::new(picture.file_name()?)];
    let places = FOLDERS.iter().map(|place| folder.join(place));
    let files = places.flat_map(|place| names.map(|name| place.join(name)));
    files
        .flat_map(|file| photographs_named(&file).collect::<Vec<_>>())
        .find(|p| p.is_file())
}
