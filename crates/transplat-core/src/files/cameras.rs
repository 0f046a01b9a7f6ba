//! Camera files: NeRF-synthetic `transforms*.json`.

use std::path::Path;

use glam::{DMat4, DVec4};
use serde::Deserialize;

use crate::error::{Error, Result};

/// A camera file: one field of view, many poses.
#[derive(Clone, Debug)]
pub struct CameraFile {
    /// Horizontal field of view in radians.
    pub fov_x: f64,
    /// Picture size in pixels, where the file gives one.
    pub size: Option<[usize; 2]>,
    /// The poses in order: camera to world, OpenGL axes (x right, y up, looking along -z).
    pub frames: Vec<DMat4>,
}

#[derive(Deserialize)]
struct File {
    camera_angle_x: f64,
    w: Option<f64>,
    h: Option<f64>,
    frames: Vec<FrameEntry>,
}

#[derive(Deserialize)]
struct FrameEntry {
    transform_matrix: [[f64; 4]; 4],
}

/// Loads a camera file.
///
/// # Errors
/// It cannot be read, is not such a JSON file, has no frame, or a pose that cannot be inverted.
pub fn load_cameras(path: &Path) -> Result<CameraFile> {
    let bytes = super::read::read_all(path, 1 << 28)?;
    let file: File = serde_json::from_slice(&bytes).map_err(|e| {
        Error::invalid(
            path,
            format!(
                "not a transforms.json camera file (camera_angle_x, frames[].transform_matrix): {e}"
            ),
        )
    })?;
    if !(file.camera_angle_x > 1e-4 && file.camera_angle_x < 3.1) {
        return Err(Error::invalid(
            path,
            "camera_angle_x is not an angle in radians below pi",
        ));
    }
    if file.frames.is_empty() {
        return Err(Error::invalid(path, "holds no frames"));
    }
    let size = match (file.w, file.h) {
        (Some(w), Some(h)) if (1.0..65536.0).contains(&w) && (1.0..65536.0).contains(&h) => {
            Some([w as usize, h as usize])
        }
        (None, None) => None,
        _ => return Err(Error::invalid(path, "w and h are not a picture size")),
    };
    let mut frames = Vec::new();
    for (i, frame) in file.frames.iter().enumerate() {
        let m = DMat4::from_cols_array_2d(&frame.transform_matrix).transpose();
        let affine = m.row(3).abs_diff_eq(DVec4::W, 1e-6);
        if !(m.is_finite() && affine && m.determinant().abs() > 1e-12) {
            return Err(Error::invalid(
                path,
                format!("the transform_matrix of frame {i} is not a camera pose"),
            ));
        }
        frames.push(m);
    }
    Ok(CameraFile {
        fov_x: file.camera_angle_x,
        size,
        frames,
    })
}
