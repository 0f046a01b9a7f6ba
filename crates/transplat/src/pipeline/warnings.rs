//! What is odd about what was loaded or made, for the user.

use std::path::Path;

use transplat_core::environment::EnvironmentMap;
use transplat_core::files::{AssetFile, AssetKind};
use transplat_core::surfels::SurfelCloud;
use transplat_core::upright::{UpEvidence, proposed_up};

/// A flatness above this makes normals, and so relighting, doubtful. Trained objects of 0.05 and 0.13 are relit as well as surfels; made rounder, to
/// 0.26, and their turns jittered by 15 degrees, they lose 0.4 and 0.8 dB.
pub const DOUBTFUL_FLATNESS: f32 = 0.35;

/// Share of what is seen whose front may be a guess before a warning is due.
pub const AMBIGUOUS_SHARE: f32 = 0.05;

/// For the user.
pub fn ambiguous_warning(share: f32) -> String {
    format!(
        "which side is the front is a guess on {:.0} % of what is seen; --outside-from X,Y,Z, a place that sees the outside, tells it for what is seen from there",
        100.0 * share
    )
}

/// What is odd about an asset.
pub fn asset_warnings(path: &Path, file: &AssetFile) -> Vec<String> {
    let mut warnings = Vec::new();
    let found = &file.report;
    if !found.left_out.is_empty() {
        warnings.push(format!(
            "{}: {} surfels hold values that are no numbers and are left out",
            path.display(),
            found.left_out.len(),
        ));
    }
    if found.kind == AssetKind::Gaussians3d {
        let flatness = found.median_flatness.unwrap_or(0.0);
        if flatness > DOUBTFUL_FLATNESS {
            warnings.push(format!(
                "{}: a 3DGS asset whose Gaussians are not flat (median shortest/second axis {flatness:.2}); its normals, and so its relighting, are only rough",
                path.display()
            ));
        }
    }
    warnings
}

/// That an asset lies on its side, it seems, where its file does not say which way is up.
pub fn up_warning(path: &Path, cloud: &SurfelCloud, file: &AssetFile) -> Option<String> {
    let (up, evidence) = proposed_up(cloud, file.report.up, file.usual_up())?;
    let (path, name) = (path.display(), up.name());
    let why = match evidence {
        UpEvidence::Ground => format!("the ground in it faces {name}"),
        UpEvidence::Stance => {
            format!("by how it stands, the light on it and its kind of file, {name} is up")
        }
    };
    (up != cloud.up).then(|| format!("{path}: lies on its side, it seems: {why} (--up={name})"))
}

/// What is odd about an environment.
pub fn map_warnings(path: &Path, map: &EnvironmentMap) -> Vec<String> {
    let mut warnings = Vec::new();
    if map.repaired() > 0 {
        warnings.push(format!(
            "{}: {} pixels are negative or no numbers, and count as black",
            path.display(),
            map.repaired()
        ));
    }
    if map.has_clipped_highlights() {
        warnings.push(format!(
            "{}: a low-dynamic-range picture; its highlights are clipped, so its light is too even",
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
