//! Camera files: `transforms.json` as NeRF-synthetic and nerfstudio write it, and COLMAP's models.

mod colmap;
mod frame;

use std::io::Read;
use std::path::Path;

use glam::{DMat4, DVec4};
use serde::Deserialize;

use super::write::folder_of;
use crate::error::{Error, Result};
use frame::{Offsets, UNSEEN};

pub use frame::{CameraFile, CameraFrame};

#[derive(Deserialize)]
struct File {
    #[serde(flatten)]
    lens: Lens,
    frames: Vec<FrameEntry>,
}

#[derive(Deserialize)]
struct FrameEntry {
    #[serde(flatten)]
    lens: Lens,
    #[serde(default)]
    file_path: Option<String>,
    transform_matrix: [[f64; 4]; 4],
}

/// The frame's own, or that of all; focal length and principal point are in pixels.
#[derive(Clone, Copy, Default, Deserialize)]
struct Lens {
    camera_angle_x: Option<f64>,
    fl_x: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    fl_y: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
}

impl Lens {
    fn or(self, all: Self) -> Self {
        Self {
            camera_angle_x: self.camera_angle_x.or(all.camera_angle_x),
            fl_x: self.fl_x.or(all.fl_x),
            w: self.w.or(all.w),
            h: self.h.or(all.h),
            cx: self.cx.or(all.cx),
            cy: self.cy.or(all.cy),
            fl_y: self.fl_y.or(all.fl_y),
            k1: self.k1.or(all.k1),
            k2: self.k2.or(all.k2),
            k3: self.k3.or(all.k3),
            k4: self.k4.or(all.k4),
            p1: self.p1.or(all.p1),
            p2: self.p2.or(all.p2),
        }
    }

    fn size(self) -> std::result::Result<Option<[usize; 2]>, &'static str> {
        match (self.w, self.h) {
            (Some(w), Some(h)) if (1.0..65536.0).contains(&w) && (1.0..65536.0).contains(&h) => {
                Ok(Some([w as usize, h as usize]))
            }
            (None, None) => Ok(None),
            _ => Err("w and h are not a picture size"),
        }
    }

    fn is_distorted(self) -> bool {
        let terms = [self.k1, self.k2, self.k3, self.k4, self.p1, self.p2];
        terms.into_iter().flatten().any(|k| k.abs() > UNSEEN)
    }

    fn is_stretched(self) -> bool {
        let by_focal = self.fl_x.zip(self.fl_y);
        by_focal.is_some_and(|(x, y)| (y / x - 1.0).abs() > UNSEEN)
    }

    fn fov_x(self) -> std::result::Result<f64, &'static str> {
        let by_focal = || Some(2.0 * (0.5 * self.w? / self.fl_x?).atan());
        let fov = self.camera_angle_x.or_else(by_focal);
        let fov = fov.ok_or("camera_angle_x is missing, or fl_x with w and h")?;
        if fov > 1e-4 && fov < 3.1 {
            Ok(fov)
        } else {
            Err("camera_angle_x is not an angle in radians below pi")
        }
    }
}

/// Loads a camera file: a `transforms.json`, or a COLMAP model by its folder or its `images.txt` or `images.bin`.
///
/// # Errors
/// It cannot be read, is no such file, has no frame, or a pose that cannot be inverted.
pub fn load_cameras(path: &Path) -> Result<CameraFile> {
    let name = path.file_name().unwrap_or_default();
    if path.is_dir() {
        return colmap::load(path);
    }
    if colmap::IMAGES.iter().any(|images| name == *images) {
        return colmap::load(folder_of(path));
    }
    let bytes = super::read::read_all(path, 1 << 28)?;
    let file: File = serde_json::from_slice(&bytes).map_err(|e| {
        Error::invalid(
            path,
            format!(
                "not a transforms.json camera file (camera_angle_x, frames[].transform_matrix): {e}"
            ),
        )
    })?;
    if file.frames.is_empty() {
        return Err(Error::invalid(path, "holds no frames"));
    }
    let mut off = Offsets::default();
    let mut frames = Vec::new();
    for (i, frame) in file.frames.into_iter().enumerate() {
        let lens = frame.lens.or(file.lens);
        let invalid = |why: &str| Error::invalid(path, format!("frame {i}: {why}"));
        let size = lens.size().map_err(invalid)?;
        if let (Some(size), Some(cx), Some(cy)) = (size, lens.cx, lens.cy) {
            off.center(size, [cx, cy]);
        }
        off.distorted |= lens.is_distorted();
        off.stretched |= lens.is_stretched();
        frames.push(CameraFrame {
            picture: frame.file_path,
            world_from_camera: pose(&frame.transform_matrix)
                .ok_or_else(|| invalid("the transform_matrix is not a camera pose"))?,
            fov_x: lens.fov_x().map_err(invalid)?,
            size,
        });
    }
    Ok(CameraFile {
        frames,
        warnings: off.warnings(path),
    })
}

/// Whether a file or folder is meant to be one of cameras, good or not.
pub fn is_camera_file(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default();
    if path.is_dir() {
        return colmap::IMAGES
            .iter()
            .any(|images| path.join(images).is_file());
    }
    if colmap::IMAGES.iter().any(|images| name == *images) {
        return true;
    }
    let mut beginning = Vec::new();
    let file = std::fs::File::open(path);
    let read = file.and_then(|f| f.take(1 << 16).read_to_end(&mut beginning));
    let key = b"\"transform_matrix\"";
    read.is_ok() && beginning.windows(key.len()).any(|w| w == key)
}

fn pose(rows: &[[f64; 4]; 4]) -> Option<DMat4> {
    let m = DMat4::from_cols_array_2d(rows).transpose();
    let affine = m.row(3).abs_diff_eq(DVec4::W, 1e-6);
    (m.is_finite() && affine && m.determinant().abs() > 1e-12).then_some(m)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: &str = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";

    fn load(text: &str) -> Result<CameraFile> {
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        std::fs::write(file.path(), text).expect("room for it");
        load_cameras(file.path())
    }

    #[test]
    fn a_lens_is_all_frames_or_ones_own() {
        let text = format!(
            r#"{{"fl_x": 100, "w": 200, "h": 100, "cx": 100, "cy": 50, "k1": 0, "frames": [
            {{"file_path": "a.jpg", "transform_matrix": {ROWS}}},
            {{"camera_angle_x": 0.5, "transform_matrix": {ROWS}}}]}}"#
        );
        let file = load(&text).expect("a good file");
        assert_eq!(file.size(), Some([200, 100]));
        assert!((file.frames[0].fov_x - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
        assert_eq!(file.frames[0].picture.as_deref(), Some("a.jpg"));
        assert_eq!(file.frames[1].fov_x, 0.5);
        assert!(file.warnings.is_empty(), "{:?}", file.warnings);
        let off = load(&text.replace("\"cx\": 100", "\"cx\": 90")).expect("a good file");
        assert_eq!(off.warnings.len(), 1);
        for bent in ["\"k1\": 0.1", "\"k1\": 0, \"fl_y\": 110"] {
            let off = load(&text.replace("\"k1\": 0", bent)).expect("a good file");
            assert_eq!(off.warnings.len(), 1, "{bent}: {:?}", off.warnings);
        }
        for wrong in [
            text.replace("\"fl_x\": 100,", ""),
            text.replace("\"h\": 100,", ""),
            text.replace("[0,0,0,1]]", "[0,0,0,2]]"),
            r#"{"camera_angle_x": 1, "frames": []}"#.into(),
        ] {
            assert!(load(&wrong).is_err(), "{wrong}");
        }
    }
}
