//! Cameras in JSON: `transforms.json` (NeRF-synthetic, nerfstudio), and `cameras.json` of the reference trainer.

use std::f64::consts::FRAC_PI_2;
use std::path::Path;

use glam::{DAffine3, DMat3, DMat4, DVec3, DVec4};
use serde::Deserialize;

use super::frame::{CameraFile, CameraFrame, MOST_BYTES, Offsets, Placement, UNSEEN};
use crate::error::{Error, Result};
use crate::files::decode;
use crate::files::read::read_all;
use crate::files::write::folder_of;

/// File of nerfstudio's transform of the cameras before training, beside theirs.
const DATAPARSER: &str = "dataparser_transforms.json";

#[derive(Deserialize)]
struct File {
    #[serde(flatten)]
    lens: JsonLens,
    frames: Vec<FrameEntry>,
    applied_transform: Option<MatrixRows>,
}

#[derive(Deserialize)]
struct FrameEntry {
    #[serde(flatten)]
    lens: JsonLens,
    #[serde(default)]
    file_path: Option<String>,
    transform_matrix: MatrixRows,
}

/// Rows of a matrix of 3 x 4 or 4 x 4; what is no number is none.
type MatrixRows = Vec<Vec<Option<f64>>>;

#[derive(Deserialize)]
struct Dataparser {
    transform: MatrixRows,
    scale: f64,
}

/// A camera of the reference trainer: OpenCV axes, camera to world.
#[derive(Deserialize)]
struct ReferenceCamera {
    #[serde(default)]
    img_name: Option<String>,
    width: f64,
    height: f64,
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    fx: Option<f64>,
    fy: Option<f64>,
}

/// The frame's own, or that of all; focal length and principal point are in pixels.
#[derive(Clone, Default, Deserialize)]
struct JsonLens {
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    w: Option<f64>,
    h: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    camera_model: Option<String>,
    is_fisheye: Option<bool>,
}

impl JsonLens {
    /// Fills missing values from those of all frames.
    fn or(self, all: &Self) -> Self {
        // Of a field of view whichever a frame has itself counts.
        let all_of_view = match self.has_view() {
            true => Self::default(),
            false => all.clone(),
        };
        Self {
            camera_angle_x: self.camera_angle_x.or(all_of_view.camera_angle_x),
            camera_angle_y: self.camera_angle_y.or(all_of_view.camera_angle_y),
            fl_x: self.fl_x.or(all_of_view.fl_x),
            fl_y: self.fl_y.or(all_of_view.fl_y),
            w: self.w.or(all.w),
            h: self.h.or(all.h),
            cx: self.cx.or(all.cx),
            cy: self.cy.or(all.cy),
            k1: self.k1.or(all.k1),
            k2: self.k2.or(all.k2),
            k3: self.k3.or(all.k3),
            k4: self.k4.or(all.k4),
            p1: self.p1.or(all.p1),
            p2: self.p2.or(all.p2),
            camera_model: self.camera_model.or(all.camera_model.clone()),
            is_fisheye: self.is_fisheye.or(all.is_fisheye),
        }
    }

    fn has_view(&self) -> bool {
        let views = [
            self.camera_angle_x,
            self.camera_angle_y,
            self.fl_x,
            self.fl_y,
        ];
        views.into_iter().any(|v| v.is_some())
    }

    fn size(&self) -> std::result::Result<Option<[usize; 2]>, &'static str> {
        match (self.w, self.h) {
            (Some(w), Some(h)) if (1.0..65536.0).contains(&w) && (1.0..65536.0).contains(&h) => {
                Ok(Some([w as usize, h as usize]))
            }
            (None, None) => Ok(None),
            _ => Err("w and h are not the size of an image"),
        }
    }

    fn is_distorted(&self) -> bool {
        let terms = [self.k1, self.k2, self.k3, self.k4, self.p1, self.p2];
        terms.into_iter().flatten().any(|k| k.abs() > UNSEEN)
    }

    fn is_stretched(&self) -> bool {
        let by_focal = self.fl_x.zip(self.fl_y);
        by_focal.is_some_and(|(x, y)| (y / x - 1.0).abs() > UNSEEN)
    }

    /// The model that is no pinhole with or without distortion, by its name.
    fn unlike_pinhole(&self) -> Option<String> {
        const PINHOLES: [&str; 5] = [
            "PINHOLE",
            "SIMPLE_PINHOLE",
            "OPENCV",
            "RADIAL",
            "SIMPLE_RADIAL",
        ];
        let model = self.camera_model.clone().map(|m| m.to_ascii_uppercase());
        let model = model.filter(|m| !PINHOLES.contains(&m.as_str()));
        model.or_else(|| self.is_fisheye.filter(|is| *is).map(|_| "FISHEYE".into()))
    }

    /// Horizontal field of view, by whichever of angles and focal lengths is there; pixels are taken for square.
    fn fov_x(&self) -> std::result::Result<f64, &'static str> {
        let of_focal = |focal: f64| Some(2.0 * (0.5 * self.w? / focal).atan());
        let of_angle_y = |angle: f64| of_focal(0.5 * self.h? / (0.5 * angle).tan());
        let fov = self
            .camera_angle_x
            .or_else(|| of_focal(self.fl_x?))
            .or_else(|| of_focal(self.fl_y?))
            .or_else(|| of_angle_y(self.camera_angle_y?));
        let fov = fov.ok_or("camera_angle_x is missing, or fl_x (or fl_y) with w and h")?;
        if fov > 1e-4 && fov < 3.1 {
            Ok(fov)
        } else {
            Err("its field of view is no angle in radians below pi")
        }
    }
}

/// Reads a `transforms.json`.
pub fn parse(path: &Path, text: &[u8]) -> Result<CameraFile> {
    let file: File = decode::json(text).map_err(|why| {
        let what =
            "no file of cameras (transforms.json: camera_angle_x, frames[].transform_matrix)";
        Error::invalid(path, format!("{what}: {why}"))
    })?;
    let mut off = Offsets::default();
    let mut frames = Vec::new();
    for (i, frame) in file.frames.into_iter().enumerate() {
        let lens = frame.lens.or(&file.lens);
        let invalid = |why: &str| Error::invalid(path, format!("frame {i}: {why}"));
        let size = lens.size().map_err(invalid)?;
        if let (Some(size), Some(cx), Some(cy)) = (size, lens.cx, lens.cy) {
            off.center(size, [cx, cy]);
        }
        off.distorted |= lens.is_distorted();
        off.stretched |= lens.is_stretched();
        let other = lens.unlike_pinhole();
        let fov_x = match (lens.fov_x(), &other) {
            // A panorama has no focal length.
            (Err(_), Some(model)) if !lens.has_view() && model == "EQUIRECTANGULAR" => FRAC_PI_2,
            (fov_x, _) => fov_x.map_err(invalid)?,
        };
        if let Some(model) = other {
            off.other_lens(&model, fov_x);
        }
        frames.push(CameraFrame {
            picture: frame.file_path,
            world_from_camera: pose(&frame.transform_matrix)
                .ok_or_else(|| invalid("the transform_matrix is not a camera pose"))?,
            fov_x,
            size,
        });
    }
    let beside = folder_of(path).join(DATAPARSER);
    let placements = [
        dataparser(&beside),
        file.applied_transform.as_ref().and_then(undone),
    ];
    Ok(CameraFile {
        frames,
        warnings: off.warnings(path),
        sees: true,
        path: path.to_owned(),
        placements: placements.into_iter().flatten().collect(),
    })
}

/// Transform of the cameras that nerfstudio trained in.
fn dataparser(path: &Path) -> Option<Placement> {
    let text = path.is_file().then(|| read_all(path, MOST_BYTES).ok())??;
    let Dataparser { transform, scale } = decode::json(&text).ok()?;
    let moved = pose(&transform)?;
    (scale > 0.0 && scale.is_finite()).then(|| Placement {
        splat_from_cameras: DAffine3::from_scale(DVec3::splat(scale)) * DAffine3::from_mat4(moved),
        what: format!("as {} has them", path.display()),
    })
}

/// Cameras as they were before a transform was applied to them.
fn undone(transform: &MatrixRows) -> Option<Placement> {
    let applied = DAffine3::from_mat4(pose(transform)?);
    Some(Placement {
        splat_from_cameras: applied.inverse(),
        what: "with the file's applied_transform undone".into(),
    })
}

/// Reads a `cameras.json` of the reference trainer.
pub fn of_reference(path: &Path, text: &[u8]) -> Result<CameraFile> {
    let cameras: Vec<ReferenceCamera> = decode::json(text).map_err(|why| {
        let what = "no file of cameras (cameras.json: position, rotation, fx, fy, width, height)";
        Error::invalid(path, format!("{what}: {why}"))
    })?;
    let mut off = Offsets::default();
    let mut frames = Vec::new();
    for (i, camera) in cameras.into_iter().enumerate() {
        let invalid = |why: &str| Error::invalid(path, format!("camera {i}: {why}"));
        let lens = JsonLens {
            fl_x: camera.fx,
            fl_y: camera.fy,
            w: Some(camera.width),
            h: Some(camera.height),
            ..JsonLens::default()
        };
        off.stretched |= lens.is_stretched();
        let axes = DMat3::from_cols_array_2d(&camera.rotation).transpose();
        let axes = axes * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
        let place = DMat4::from_translation(DVec3::from_array(camera.position));
        let pose = place * DMat4::from_mat3(axes);
        if !(pose.is_finite() && pose.determinant().abs() > 1e-12) {
            return Err(invalid("its rotation and position are no camera pose"));
        }
        frames.push(CameraFrame {
            picture: camera.img_name,
            world_from_camera: pose,
            fov_x: lens.fov_x().map_err(invalid)?,
            size: lens.size().map_err(invalid)?,
        });
    }
    Ok(CameraFile {
        frames,
        warnings: off.warnings(path),
        sees: true,
        path: path.to_owned(),
        placements: Vec::new(),
    })
}

fn pose(rows: &MatrixRows) -> Option<DMat4> {
    let mut values = [[0.0, 0.0, 0.0, 1.0]; 4];
    if !(3..=4).contains(&rows.len()) || rows.iter().any(|row| row.len() != 4) {
        return None;
    }
    for (row, given) in values.iter_mut().zip(rows) {
        for (value, given) in row.iter_mut().zip(given) {
            *value = (*given)?;
        }
    }
    let m = DMat4::from_cols_array_2d(&values).transpose();
    let affine = m.row(3).abs_diff_eq(DVec4::W, 1e-6);
    (m.is_finite() && affine && m.determinant().abs() > 1e-12).then_some(m)
}
