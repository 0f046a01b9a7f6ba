//! Estimated capture light: made, saved beside the bake, and described in words.

use std::path::Path;
use std::sync::Arc;

use transplat_core::bake::directional::DirectionalBake;
use transplat_core::estimate::{Estimate, Obstacle, estimate_light};
use transplat_core::files::{load_estimate, save_estimate};
use transplat_core::progress::Progress;
use transplat_core::settings::Method;
use transplat_core::surfels::{SurfelCloud, UpAxis};

use super::bake::{BakePlace, keep};

/// Ending of an estimate's file, beside the bake.
const SUFFIX: &str = "best.light";

/// An estimate that was made before.
pub fn kept(asset: &Path, cloud: &Arc<SurfelCloud>) -> Option<Estimate> {
    let files = BakePlace::cached(asset).files(cloud, SUFFIX);
    files.iter().find_map(|f| load_estimate(f, cloud).ok())
}

/// Makes the estimate, and keeps it.
///
/// # Errors
/// `progress` asked to stop.
pub fn make_and_keep(
    place: &BakePlace,
    cloud: &Arc<SurfelCloud>,
    bake: &DirectionalBake,
    progress: Progress<'_>,
) -> transplat_core::Result<Estimate> {
    let estimate = estimate_light(cloud, bake, None, progress)?;
    // Where nothing can be kept, it is estimated again the next time.
    let _ = keep(&place.files(cloud, SUFFIX), |file| {
        save_estimate(file, cloud, &estimate)
    });
    Ok(estimate)
}

/// Consequence, for the user, where the capture light cannot be estimated.
pub fn instead(method: Method, obstacle: Obstacle) -> &'static str {
    match (method, obstacle) {
        (Method::Harmonic, _) | (_, Obstacle::EvenLight) => "uniform white light is assumed",
        (Method::Directional, _) => {
            "half of the change for a capture under uniform white light is applied"
        }
    }
}

/// Why the light of the capture cannot be told, and what is done then, for the user.
pub fn why_not(method: Method, obstacle: Obstacle) -> String {
    let (why, instead) = (obstacle.reason(), instead(method, obstacle));
    format!("cannot be estimated from the object: {why}; {instead}")
}

/// An estimate for the user.
pub fn estimate_in_words(estimate: &Estimate, up: UpAxis) -> String {
    let percent = estimate.percent();
    if let Some(obstacle) = estimate.obstacle {
        return format!(
            "the capture light cannot be estimated: {} (confidence {percent:.0} %)",
            obstacle.reason()
        );
    }
    let from = estimate.light.dominant_direction();
    let sun = match estimate.light.sun {
        Some((d, _)) => format!("a sun at {:.2} {:.2} {:.2}", d[0], d[1], d[2]),
        None => "no sun".into(),
    };
    let known = match estimate.light.shown {
        Some(_) => "the rest of the capture shows some of it",
        None => "its tint is assumed",
    };
    let low_confidence = if estimate.may_lie_on_its_side(up) {
        format!(
            "; that is the side or below, with {} up: is it (--up)?",
            up.name()
        )
    } else {
        String::new()
    };
    format!(
        "light mostly from {:.2} {:.2} {:.2} (the asset's coordinates), {sun}, confidence {percent:.0} %, trust {:.0} %; {known}{low_confidence}",
        from.x,
        from.y,
        from.z,
        100.0 * estimate.trust()
    )
}

/// An estimate for programs.
pub fn estimate_as_json(estimate: &Estimate) -> serde_json::Value {
    let light = &estimate.light;
    let sun = light.sun.filter(|_| estimate.is_told());
    serde_json::json!({
        "confidence": estimate.confidence,
        "trust": estimate.trust(),
        "is_good": estimate.is_told(),
        "obstacle": estimate.obstacle,
        "uses_capture_environment": light.shown.is_some(),
        "dominant_direction": estimate.is_told().then(|| light.dominant_direction().to_array()),
        "sun_direction": sun.map(|(direction, _)| direction),
        "sun_irradiance": sun.map(|(_, energy)| energy),
    })
}
