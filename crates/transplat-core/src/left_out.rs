//! What the stages left out of a scene, for whoever tells it.

use crate::bake::Bake;
use crate::bake::directional::CLOSED_SIDES_ERROR;
use crate::environment::Illumination;
use crate::settings::skips::{Skipped, Stage};
use crate::settings::{Terms, TransferSettings};
use crate::sh::coefficient_count;
use crate::surfels::SurfelCloud;
use crate::transfer::PreparedTransfer;
use crate::transfer::directional::{DirectionalTransfer, Nodes, TURNS};
use crate::transfer::harmonic::HarmonicTransfer;

/// What a ray into a closed side costs, in mean rays: it meets something soon. (0.5 to 0.9 as measured.)
const CLOSED_RAY_COST: f32 = 0.75;

/// What a bake left out.
pub fn of_bake(bake: &Bake) -> Vec<Skipped> {
    let mut out = Vec::new();
    let (open_object, closed) = match bake {
        Bake::Harmonic(v) => (v.open_object_error, 0.0),
        Bake::Directional(o) => (o.open_object_error, o.closed_share),
    };
    if open_object.is_some() {
        let why = "no surfel blocks the light of another in any direction that was asked";
        out.push(Skipped {
            max_error: open_object,
            skip: Some("open-object"),
            ..Skipped::exact(Stage::Bake, "the bake", why)
        });
    }
    if closed > 0.0 {
        let why = format!(
            "{:.0} % of the rays would start on sides that are closed",
            100.0 * closed
        );
        out.push(Skipped {
            share: Some(CLOSED_RAY_COST * closed),
            skip: Some("closed-sides"),
            max_error: Some(CLOSED_SIDES_ERROR),
            ..Skipped::exact(Stage::Bake, "rays into closed sides", why)
        });
    }
    out
}

/// What a transfer leaves out, whatever the light.
pub fn of_transfer(
    prepared: &PreparedTransfer,
    settings: &TransferSettings,
    cloud: &SurfelCloud,
) -> Vec<Skipped> {
    let mut terms = settings.terms;
    let mut out: Vec<Skipped> = Terms::of_method(settings.method)
        .filter(|term| !*(term.of)(&mut terms))
        .map(|term| Skipped {
            max_error: None,
            ..Skipped::exact(Stage::Transfer, term.name, "switched off")
        })
        .collect();
    match prepared {
        PreparedTransfer::Harmonic(harmonic) => of_harmonic(harmonic, settings, cloud, &mut out),
        PreparedTransfer::Directional(directional) => {
            of_directional(directional, settings, cloud, &mut out)
        }
    }
    out
}

fn of_harmonic(
    harmonic: &HarmonicTransfer,
    settings: &TransferSettings,
    cloud: &SurfelCloud,
    out: &mut Vec<Skipped>,
) {
    let degree = harmonic.specular_degree;
    if degree == cloud.sh_degree {
        return;
    }
    let bytes = empty_bytes(harmonic.surfels, cloud.sh_degree, harmonic.asset_degree);
    if degree > 0 {
        let what = format!("SH bands above {degree} of the asset");
        let why = "the source light has nothing there (see SH degree)";
        out.push(Skipped {
            bytes,
            skip: settings.skips.empty_bands.then_some("empty-bands"),
            max_error: None,
            ..Skipped::exact(Stage::Transfer, what, why)
        });
    } else if settings.terms.specular {
        let why = if settings.sh_degree == 0 {
            "the light has degree 0"
        } else if !cloud.has_view_dependence() {
            "the asset's colour does not depend on the view"
        } else {
            "the source light is even: it tells nothing of gloss"
        };
        out.push(Skipped {
            bytes,
            skip: settings.skips.empty_bands.then_some("empty-bands"),
            ..Skipped::exact(Stage::Transfer, "specular transfer", why)
        });
    }
}

fn of_directional(
    directional: &DirectionalTransfer,
    settings: &TransferSettings,
    cloud: &SurfelCloud,
    out: &mut Vec<Skipped>,
) {
    let (n, asset) = (directional.asset.len(), &directional.asset);
    let degree = asset.nodes.degree;
    if degree < cloud.sh_degree {
        let what = format!("SH bands above {degree}");
        let why = "the asset's colour has nothing there";
        let node_bytes = 12 * n * (Nodes::count_of(cloud.sh_degree) - asset.nodes.count());
        out.push(Skipped {
            skip: Some("empty-bands"),
            // Stored colour, its residual, and the result.
            bytes: 3 * empty_bytes(n, cloud.sh_degree, degree) + 2 * node_bytes,
            ..Skipped::exact(Stage::Transfer, what, why)
        });
    }
    if settings.terms.lobe && settings.skips.matte && directional.glossy_surfels < n {
        let (what, why) = if directional.glossy_surfels > 0 {
            let matte = 100.0 * (n - directional.glossy_surfels) as f32 / n as f32;
            let what = format!("the lobe of {matte:.0} % of the surfels");
            (what, "their colour shows no gloss")
        } else if directional.trust < 1.0 {
            let why = "what is mirrored is not told from paint where the source light is not known";
            ("specular lobe".into(), why)
        } else if cloud.has_view_dependence() {
            ("specular lobe".into(), "the asset's colour shows no gloss")
        } else {
            let why = "the asset's colour does not depend on the view";
            ("specular lobe".into(), why)
        };
        out.push(Skipped {
            skip: Some("matte"),
            ..Skipped::exact(Stage::Transfer, what, why)
        });
    }
    if directional.turns() < TURNS && settings.terms.bounce && settings.terms.shadow {
        let why = "no light bounces between surfels";
        out.push(Skipped {
            skip: Some("bounces"),
            ..Skipped::exact(Stage::Transfer, "turns of the bounce", why)
        });
    }
}

/// What a transfer leaves out for a light; the GPU works on all channels at once, and gains nothing by a grey one.
pub fn of_light(prepared: &PreparedTransfer, light: &Illumination, on_gpu: bool) -> Vec<Skipped> {
    let mut out = Vec::new();
    match prepared {
        PreparedTransfer::Harmonic(harmonic) => {
            let is_gray = (light.radiance.coefficients.iter())
                .take(coefficient_count(harmonic.light_degree))
                .all(|[r, g, b]| r == g && g == b);
            if is_gray && harmonic.settings.skips.gray_light && !on_gpu {
                let why = "the light is grey";
                out.push(Skipped {
                    skip: Some("gray-light"),
                    ..Skipped::exact(Stage::Transfer, "two of three channels", why)
                });
            }
        }
        PreparedTransfer::Directional(directional) => {
            let suns = light.beams.as_ref().map_or(0, |b| b.suns.len());
            let Terms { sums, suns: on, .. } = directional.settings.terms;
            if suns == 0 && sums && on && directional.settings.skips.suns {
                let why = "the light has no sun";
                out.push(Skipped {
                    skip: Some("suns"),
                    ..Skipped::exact(Stage::Transfer, "rays to suns", why)
                });
            }
        }
    }
    out
}

/// What is neither relit nor drawn, of surfels that nobody sees (`[n]` or empty).
pub fn of_unseen(unseen: &[bool]) -> Vec<Skipped> {
    let count = unseen.iter().filter(|u| **u).count();
    if count == 0 {
        return Vec::new();
    }
    let why = format!("{count} are hidden, or too faint for any pixel");
    vec![Skipped {
        skip: Some("unseen"),
        share: Some(count as f32 / unseen.len() as f32),
        ..Skipped::exact(Stage::Transfer, "surfels that nobody sees", why)
    }]
}

/// Bytes of colour that `n` surfels do not have in the bands above a degree.
fn empty_bytes(n: usize, degree: usize, filled: usize) -> usize {
    12 * n * (coefficient_count(degree) - coefficient_count(filled))
}
