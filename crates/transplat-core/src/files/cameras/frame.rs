//! Cameras of a file: frames, and their lens warnings.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat4, DVec3};

use crate::camera::Camera;
use crate::surfels::{SurfelCloud, is_faint};

/// Cameras of a file.
#[derive(Clone, Debug)]
pub struct CameraFile {
    /// At least one, in the file's order; COLMAP's by the names of their pictures.
    pub frames: Vec<CameraFrame>,
    /// Warnings of properties that this program's cameras lack.
    pub warnings: Vec<String>,
    /// True where any camera sees anything of the splat that they were placed for.
    pub sees: bool,
    /// Where it was read.
    pub path: PathBuf,
    /// Where its splat may be in other coordinates, the likeliest first.
    pub(super) placements: Vec<Placement>,
}

/// Coordinates of a splat that are not those of its cameras' file.
#[derive(Clone, Debug)]
pub(super) struct Placement {
    pub splat_from_cameras: DAffine3,
    /// For the user: the cameras are placed so.
    pub what: String,
}

/// The most bytes of a file in JSON.
pub(super) const MOST_BYTES: u64 = 1 << 28;

/// Surfels that are looked for, at most.
const LOOKED_FOR: usize = 2000;

/// A camera of a file.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraFrame {
    /// Its picture's file, as the camera file has it.
    pub picture: Option<String>,
    /// Camera to world, OpenGL axes (x right, y up, looking along -z).
    pub world_from_camera: DMat4,
    /// Horizontal field of view in radians.
    pub fov_x: f64,
    /// Picture size in pixels, where the file gives one.
    pub size: Option<[usize; 2]>,
}

impl CameraFrame {
    /// The camera for a picture of a size; one of other proportions than its own is framed by its shorter edge, as photographs are.
    pub fn camera(&self, size: [usize; 2], near: f32) -> Camera {
        let own = self.size.unwrap_or(size);
        let mut fov_x = self.fov_x;
        if own[0] * size[1] != own[1] * size[0] {
            let in_shorter_edges = |[w, h]: [usize; 2]| w as f64 / w.min(h) as f64;
            let wider = in_shorter_edges(size) / in_shorter_edges(own);
            fov_x = 2.0 * (wider * (0.5 * fov_x).tan()).atan();
        }
        Camera::from_opengl_pose(self.world_from_camera, fov_x, size, near)
    }
}

impl CameraFile {
    /// Picture size of the first frame, where the file gives one.
    pub fn size(&self) -> Option<[usize; 2]> {
        self.frames.first().and_then(|f| f.size)
    }

    /// The cameras in the coordinates of a splat. Where none of them sees any of it, they are placed as what lies beside their file says, if
    /// that helps; either is said.
    pub fn placed_for(mut self, cloud: &SurfelCloud) -> Self {
        let origin = DAffine3::from_translation(-cloud.origin);
        let step = cloud.len().div_ceil(LOOKED_FOR).max(1);
        let seen = (0..cloud.len())
            .filter(|i| !is_faint(cloud.opacities[*i]))
            .step_by(step);
        let places: Vec<DVec3> = seen.map(|i| cloud.positions[i].as_dvec3()).collect();
        let placed = |place: &DAffine3| -> Vec<CameraFrame> {
            let place = origin * *place;
            self.frames
                .iter()
                .map(|frame| frame.placed(place))
                .collect()
        };
        let sees = |frames: &[CameraFrame]| {
            let mut frames = frames.iter();
            places.is_empty() || frames.any(|f| places.iter().any(|p| f.sees(*p)))
        };
        let mut frames = placed(&DAffine3::IDENTITY);
        if !sees(&frames) {
            let mut others = self
                .placements
                .iter()
                .map(|p| (placed(&p.splat_from_cameras), p));
            let path = self.path.display();
            let warning = match others.find(|(frames, _)| sees(frames)) {
                Some((found, placement)) => {
                    frames = found;
                    format!(
                        "{path}: as they are, the cameras see nothing of the splat; they are placed {}",
                        placement.what
                    )
                }
                None => {
                    self.sees = false;
                    format!(
                        "{path}: its {} cameras see nothing of the splat: their coordinates differ, or they are of another capture. Put the dataparser_transforms.json of the training beside them, or use --turntable or --eye",
                        frames.len()
                    )
                }
            };
            self.warnings.push(warning);
        }
        self.frames = frames;
        self
    }
}

impl CameraFrame {
    /// Camera in other coordinates, its axes of unit length.
    fn placed(&self, there_from_here: DAffine3) -> Self {
        if there_from_here == DAffine3::IDENTITY {
            return self.clone();
        }
        let pose = DMat4::from(there_from_here) * self.world_from_camera;
        let axis = |i: usize| pose.col(i).truncate().normalize_or_zero().extend(0.0);
        Self {
            world_from_camera: DMat4::from_cols(axis(0), axis(1), axis(2), pose.w_axis),
            ..self.clone()
        }
    }

    /// True where a place is in its image.
    fn sees(&self, place: DVec3) -> bool {
        let [x, y, depth] = {
            let local = self.world_from_camera.inverse().transform_point3(place);
            [local.x, local.y, -local.z]
        };
        let across = (0.5 * self.fov_x).tan();
        let [w, h] = self.size.unwrap_or([1, 1]).map(|v| v as f64);
        depth > 0.0 && x.abs() < across * depth && y.abs() < across * h / w * depth
    }
}

/// Offsets of lenses from the pinhole with its axis in the middle that cameras are here.
#[derive(Default)]
pub struct Offsets {
    /// Share of the picture's width.
    center: f64,
    pub distorted: bool,
    pub stretched: bool,
    /// A lens that is no pinhole at all, and the field of view in radians of the pinhole that stands for it.
    other: Option<(String, f64)>,
}

/// Shares of a picture's width below which nobody sees that it is off.
pub const UNSEEN: f64 = 2e-3;

impl Offsets {
    /// Takes in where a lens's axis meets its picture, in pixels.
    pub fn center(&mut self, size: [usize; 2], at: [f64; 2]) {
        for (size, at) in size.into_iter().zip(at) {
            let off = (at / size as f64 - 0.5).abs();
            self.center = self.center.max(off);
        }
    }

    /// Takes in a lens that is no pinhole, by the name of its model; the first is told.
    pub fn other_lens(&mut self, model: &str, fov_x: f64) {
        self.other.get_or_insert((model.to_owned(), fov_x));
    }

    /// Warnings of a file's lenses.
    pub fn warnings(&self, path: &Path) -> Vec<String> {
        let mut told = Vec::new();
        if let Some((model, fov_x)) = &self.other {
            told.push(format!(
                "{}: the lens {model} is drawn as a pinhole of {:.0} degrees across, which bends nothing; undistort the photographs first to lay them over each other",
                path.display(),
                fov_x.to_degrees()
            ));
        }
        let mut tell = |what: &str| {
            told.push(format!(
                "{}: {what}; undistort the photographs first, or images are slightly off",
                path.display()
            ));
        };
        if self.center > UNSEEN {
            tell("the principal point is off the image centre");
        }
        if self.distorted && self.other.is_none() {
            tell("the lens is distorted");
        }
        if self.stretched {
            tell("pixels are not square");
        }
        told
    }
}
