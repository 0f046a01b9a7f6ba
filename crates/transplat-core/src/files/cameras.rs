//! Camera files: `transforms.json` as NeRF-synthetic and nerfstudio write it, `cameras.json` of the reference trainer, and COLMAP's models.

mod colmap;
mod frame;
mod transforms;

use std::path::{Path, PathBuf};

use super::read::read_all;
use super::write::folder_of;
use crate::error::{Error, Result};

use frame::MOST_BYTES;
pub use frame::{CameraFile, CameraFrame};

/// Folders of a capture that hold a COLMAP model.
const MODELS: [&str; 4] = ["", "sparse/0", "sparse", "colmap/sparse/0"];

/// Files of cameras that lie in a folder of a capture or of a training.
const FILES: [&str; 3] = ["transforms.json", "transforms_train.json", REFERENCE];

/// The file of cameras that the reference trainer writes beside its results (Kerbl et al. 2023).
const REFERENCE: &str = "cameras.json";

/// Loads a camera file: a `transforms.json`, a `cameras.json`, a COLMAP model by its `images.txt` or `images.bin`, or a folder with one of them.
///
/// # Errors
/// It cannot be read, is no such file, has no frame, or a pose that cannot be inverted.
pub fn load_cameras(path: &Path) -> Result<CameraFile> {
    if path.is_dir() {
        // One that may not be read is not empty.
        std::fs::read_dir(path).map_err(Error::io(path))?;
        return match file_in(path) {
            Some(found) if is_colmap(&found) => colmap::load(folder_of(&found)),
            Some(found) => load_cameras(&found),
            None => Err(Error::invalid(
                path,
                format!(
                    "no cameras are in this folder; a COLMAP model (images.bin or images.txt, here or in sparse/0), {} is expected",
                    FILES.join(" or ")
                ),
            )),
        };
    }
    if is_colmap(path) {
        return colmap::load(folder_of(path));
    }
    let text = read_all(path, MOST_BYTES)?;
    let file = match begins_as_list(&text) {
        true => transforms::of_reference(path, &text),
        false => transforms::parse(path, &text),
    }?;
    if file.frames.is_empty() {
        return Err(Error::invalid(path, "holds no frames"));
    }
    Ok(file)
}

/// The camera file in a folder of a capture, if there is one.
pub(super) fn file_in(folder: &Path) -> Option<PathBuf> {
    let models = MODELS.iter().map(|model| folder.join(model));
    let models = models.flat_map(|model| colmap::IMAGES.map(|images| model.join(images)));
    let files = FILES.iter().map(|file| folder.join(file));
    models.chain(files).find(|file| file.is_file())
}

/// The cameras that the reference trainer wrote for a splat: beside it, or above the folders of its iteration.
pub fn cameras_of_training(splat: &Path) -> Option<PathBuf> {
    let splat = std::path::absolute(splat).ok()?;
    let folders = splat.parent()?.ancestors().take(3);
    let mut files = folders.map(|folder| folder.join(REFERENCE));
    let found = files.find(|file| file.is_file())?;
    read_all(&found, MOST_BYTES)
        .ok()
        .filter(|text| begins_as_list(text))?;
    Some(found)
}

/// True for the name of a COLMAP model's file.
pub(super) fn is_colmap(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default();
    colmap::IMAGES.iter().any(|images| name == *images) && path.is_file()
}

/// True for a text that begins as a list of objects in JSON, such as `cameras.json`.
pub(super) fn begins_as_list(text: &[u8]) -> bool {
    let text = text.strip_prefix("\u{feff}".as_bytes()).unwrap_or(text);
    let list = text.trim_ascii_start().strip_prefix(b"[");
    list.is_some_and(|first| first.trim_ascii_start().starts_with(b"{"))
}

/// True for a text that names poses as `transforms.json` does.
pub(super) fn has_poses(text: &[u8]) -> bool {
    let key = b"\"transform_matrix\"";
    text.windows(key.len()).take(1 << 16).any(|w| w == key)
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

    /// A frame's own lens counts, in whatever words; files as Python writes them are read.
    #[test]
    fn what_a_frame_says_of_its_lens_counts() {
        let of = |all: &str, own: &str| {
            let rows = ROWS.replace(",[0,0,0,1]]", "]");
            let text = format!(
                "\u{feff}{{{all}, \"w\": 200, \"h\": 100, \"frames\": [{{{own}, \"sharpness\": NaN, \"transform_matrix\": {rows}}}]}}"
            );
            load(&text).expect(&text).frames[0].fov_x
        };
        let quarter = std::f64::consts::FRAC_PI_2;
        for (all, own) in [
            ("\"camera_angle_x\": 0.3", "\"fl_x\": 100"),
            ("\"camera_angle_x\": 0.3", "\"fl_y\": 100"),
            ("\"fl_x\": 33", "\"camera_angle_x\": 1.5707963267948966"),
            ("\"fl_y\": 100", "\"fl_z\": 1"),
            (
                "\"camera_angle_y\": 0.9272952180016122",
                "\"sharp\": Infinity",
            ),
        ] {
            let fov = of(all, own);
            assert!((fov - quarter).abs() < 1e-9, "{all} {own}: {fov}");
        }
    }

    #[test]
    fn cameras_of_the_reference_trainer_look_where_they_did() {
        let text = r#"[{"id": 0, "img_name": "a", "width": 200, "height": 100, "position": [1, 2, -3],
            "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 100, "fy": 100}]"#;
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("cameras.json"), text).expect("room for it");
        let file = load_cameras(folder.path()).expect("a good file");
        let camera = file.frames[0].camera([200, 100], 0.1);
        // Four ahead along z, one to the right, and one down.
        let ([x, y], depth) = camera.project(glam::Vec3::new(2.0, 3.0, 1.0));
        assert!(
            (depth - 4.0).abs() < 1e-6 && (x - 124.5).abs() < 1e-3,
            "{x} {depth}"
        );
        assert!((y - 74.5).abs() < 1e-3, "{y}");
        let splat = folder
            .path()
            .join("point_cloud/iteration_7000/point_cloud.ply");
        assert!(cameras_of_training(&splat).is_some_and(|f| f.ends_with("cameras.json")));
    }

    #[test]
    fn cameras_that_see_nothing_are_told_and_looked_for_where_the_splat_is() {
        let cloud = crate::synthetic::sphere(200);
        let folder = tempfile::tempdir().expect("a folder");
        // From four away on +z; or from there, all of it twice as large and moved aside by 100.
        let path = folder.path().join("transforms.json");
        let load = |x: f64, z: f64| {
            let rows = format!("[[1,0,0,{x}],[0,1,0,0],[0,0,1,{z}],[0,0,0,1]]");
            let text =
                format!(r#"{{"camera_angle_x": 0.7, "frames": [{{"transform_matrix": {rows}}}]}}"#);
            std::fs::write(&path, text).expect("room for it");
            load_cameras(&path).expect("a good file").placed_for(&cloud)
        };
        assert!(load(0.0, 4.0).warnings.is_empty());
        let lost = load(100.0, 8.0).warnings;
        assert!(lost[0].contains("see nothing"), "{lost:?}");
        let parser = r#"{"transform": [[1,0,0,-100],[0,1,0,0],[0,0,1,0]], "scale": 0.5}"#;
        std::fs::write(folder.path().join("dataparser_transforms.json"), parser).expect("room");
        let placed = load(100.0, 8.0);
        let said = &placed.warnings[0];
        assert!(said.contains("dataparser_transforms.json"), "{said}");
        let at = placed.frames[0].world_from_camera.w_axis;
        assert!(at.x.abs() < 1e-9 && (at.z - 4.0).abs() < 1e-9, "{at}");
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
        for bent in [
            "\"k1\": 0.1",
            "\"k1\": 0, \"fl_y\": 110",
            "\"k1\": 0, \"camera_model\": \"OPENCV_FISHEYE\"",
        ] {
            let off = load(&text.replace("\"k1\": 0", bent)).expect("a good file");
            assert_eq!(off.warnings.len(), 1, "{bent}: {:?}", off.warnings);
        }
        for wrong in [
            text.replace("\"fl_x\": 100,", ""),
            text.replace("\"h\": 100,", ""),
            text.replace("[0,0,0,1]]", "[0,0,0,2]]"),
            text.replace("[0,0,1,3]", "[0,0,NaN,3]"),
            text.replace(",[0,0,0,1]]", ",[0,0,0,1],[0,0,0,1]]"),
            r#"{"camera_angle_x": 1, "frames": []}"#.into(),
        ] {
            assert!(load(&wrong).is_err(), "{wrong}");
        }
    }
}
