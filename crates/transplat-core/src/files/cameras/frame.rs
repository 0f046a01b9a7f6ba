//! What a camera file holds.

use std::path::Path;

use glam::DMat4;

use crate::camera::Camera;

/// Cameras of a file.
#[derive(Clone, Debug)]
pub struct CameraFile {
    /// At least one, in the file's order; COLMAP's by the names of their pictures.
    pub frames: Vec<CameraFrame>,
    /// What of it this program's cameras cannot be, for the user.
    pub warnings: Vec<String>,
}

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
}

/// How far lenses are from the pinhole with its axis in the middle that cameras are here.
#[derive(Default)]
pub struct Offsets {
    /// Share of the picture's width.
    center: f64,
    pub distorted: bool,
    pub stretched: bool,
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

    /// What is to be told of a file's lenses.
    pub fn warnings(&self, path: &Path) -> Vec<String> {
        let mut told = Vec::new();
        let mut tell = |what: &str| {
            told.push(format!(
                "{}: {what}; undistort the photographs first, pictures are a little off otherwise",
                path.display()
            ));
        };
        if self.center > UNSEEN {
            tell("the optical axis is not in the middle of the picture");
        }
        if self.distorted {
            tell("the lens is distorted");
        }
        if self.stretched {
            tell("pixels are not square");
        }
        told
    }
}
