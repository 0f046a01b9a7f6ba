//! Warnings of files and results, for the user.

use std::path::Path;

use transplat_core::environment::{EnvironmentMap, INFINITE_RADIANCE, ImageReading, Layout};
use transplat_core::files::{CameraFile, SplatFile};
use transplat_core::surfels::{SurfelCloud, UpAxis};
use transplat_core::up_axis::{UpEvidence, proposed_up, up_from_cameras};

/// Noise of the normals, in degrees, above which relighting is only rough. Trained objects have 0.3 to 1.2, of chrome 2.2; a plant made rounder,
/// its turns jittered by 15 degrees, has 3.8 and is relit 0.4 dB worse; captures from nature have 2 to 5.
pub const DOUBTFUL_NORMAL_NOISE: f32 = 3.0;

/// Share of what is seen whose front may be a guess before a warning is due.
pub const AMBIGUOUS_SHARE: f32 = 0.05;

/// For the user.
pub fn ambiguous_warning(share: f32) -> String {
    format!(
        "the normal orientation of {:.0} % of the visible surface is uncertain; --outside-from X,Y,Z sets it for what that place sees",
        100.0 * share
    )
}

/// For the user.
pub fn noise_warning(degrees: f32) -> String {
    format!(
        "the normals are noisy, half of what is seen by {degrees:.0} degrees and more: shading and highlights, and so the relighting, are only rough"
    )
}

/// Warnings of a splat's file.
pub fn asset_warnings(path: &Path, file: &SplatFile) -> Vec<String> {
    let found = &file.report;
    let said = |what: &String| format!("{}: {what}", path.display());
    let mut warnings: Vec<String> = found.warnings.iter().map(said).collect();
    if !found.skipped_work.is_empty() {
        warnings.push(format!(
            "{}: {} of {} Gaussians hold values that are no numbers and are left out",
            path.display(),
            found.skipped_work.len(),
            found.vertices
        ));
    }
    warnings
}

/// Warning that a splat seems to lie on its side, where its file has no up axis.
pub fn up_warning(path: &Path, cloud: &SurfelCloud, file: &SplatFile) -> Option<String> {
    let (up, evidence) = proposed_up(cloud, file.report.up, file.usual_up())?;
    let name = up.name();
    let why = match evidence {
        UpEvidence::Ground => format!("the ground in it faces {name}"),
        UpEvidence::Stance => {
            format!("by how it stands, the light on it and its kind of file, {name} is up")
        }
    };
    (up != cloud.up).then(|| lies_on_its_side(path, &why, up))
}

/// Warning that a splat lies on its side by the cameras of a file.
pub fn up_warning_by_cameras(path: &Path, up: UpAxis, cameras: &CameraFile) -> Option<String> {
    let held = up_from_cameras(cameras.frames.iter().map(|f| f.world_from_camera))?;
    let why = format!("its cameras were held with {} up", held.name());
    (held != up).then(|| lies_on_its_side(path, &why, held))
}

fn lies_on_its_side(path: &Path, why: &str, up: UpAxis) -> String {
    let (path, name) = (path.display(), up.name());
    format!("{path}: lies on its side, it seems: {why} (--up={name})")
}

/// Warnings of an environment, and of what reading it assumed.
pub fn map_warnings(path: &Path, map: &EnvironmentMap, reading: &ImageReading) -> Vec<String> {
    let said = |what: &String| format!("{}: {what}", path.display());
    let mut warnings: Vec<String> = map.provenance().warnings.iter().map(said).collect();
    let read_as = match map.layout() {
        _ if reading.layout.is_some() => None,
        Layout::Equirectangular => None,
        Layout::CubeCross => Some("a cube that is unfolded to a cross, by its empty squares"),
        Layout::CubeColumn => {
            Some("the faces of a cube below each other, as its envmap attribute says")
        }
        Layout::AngularMap | Layout::MirrorBall => Some(
            "an angular map, by the disc in it; for a mirror ball set the layout (panel Light; --source-layout, --target-layout)",
        ),
    };
    if let Some(what) = read_as {
        warnings.push(format!("{}: taken for {what}", path.display()));
    }
    if map.repaired() > 0 {
        warnings.push(format!(
            "{}: {} pixels are negative or no numbers, and count as black",
            path.display(),
            map.repaired()
        ));
    }
    if map.infinite() > 0 {
        warnings.push(format!(
            "{}: {} pixels are infinitely bright, and are read as {INFINITE_RADIANCE}, the most that 16 bits hold; a sun may be stronger",
            path.display(),
            map.infinite()
        ));
    }
    if map.has_clipped_highlights() {
        warnings.push(format!(
            "{}: a low-dynamic-range image; its highlights are clipped",
            path.display()
        ));
    }
    if map.width() != 2 * map.height() {
        warnings.push(format!(
            "{}: {} x {} pixels are not twice as wide as high; it is taken as equirectangular all the same",
            path.display(),
            map.width(),
            map.height()
        ));
    }
    warnings
}
