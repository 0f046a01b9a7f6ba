//! What a scene does not need: the stages find it out from their input and leave it out, unless they are told to do it all the same.

use crate::environment::Illumination;
use crate::sh::coefficient_count;
use crate::surfels::SurfelCloud;
use crate::transfer::best::{BestTransfer, Nodes, TURNS};
use crate::transfer::paper::PaperTransfer;
use crate::transfer::{PreparedTransfer, Terms, TransferSettings};
use crate::visibility::Bake;
use crate::visibility::occlusion::CLOSED_SIDES_ERROR;

/// What the stages may leave out; all of it unless a test or a measurement wants to know what that saves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Skips {
    /// Bake of preset `best`: rays into sides of surfels that the first rays found closed.
    pub closed_sides: bool,
    /// Bakes, and shadows of preset `best`: all of them, where nothing blocks anything.
    pub open_object: bool,
    /// Transfer and drawing: SH bands in which the result holds nothing.
    pub empty_bands: bool,
    /// Transfer of preset `paper`: two of the three channels of a grey light.
    pub gray_light: bool,
    /// Transfer of preset `best`: the pass for suns, where the light has none.
    pub suns: bool,
    /// Transfer of preset `best`: all turns of the bounce but one, where no light bounces.
    pub bounces: bool,
    /// Transfer and drawing: surfels that are hidden or too faint to be seen.
    pub unseen: bool,
}

impl Skips {
    /// Nothing is left out.
    pub const NONE: Self = Self {
        closed_sides: false,
        open_object: false,
        empty_bands: false,
        gray_light: false,
        suns: false,
        bounces: false,
        unseen: false,
    };

    /// All of them with their names.
    pub const ALL: [Skip; 7] = [
        Skip("closed-sides", |s| &mut s.closed_sides),
        Skip("open-object", |s| &mut s.open_object),
        Skip("empty-bands", |s| &mut s.empty_bands),
        Skip("gray-light", |s| &mut s.gray_light),
        Skip("suns", |s| &mut s.suns),
        Skip("bounces", |s| &mut s.bounces),
        Skip("unseen", |s| &mut s.unseen),
    ];
}

impl Default for Skips {
    fn default() -> Self {
        Self {
            closed_sides: true,
            open_object: true,
            empty_bands: true,
            gray_light: true,
            suns: true,
            bounces: true,
            unseen: true,
        }
    }
}

/// One of the [`Skips`]: its name, and where its switch is.
pub struct Skip(pub &'static str, pub fn(&mut Skips) -> &mut bool);

/// Something that a stage left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Skipped {
    /// What, for people.
    pub what: String,
    /// And why.
    pub why: String,
    /// The stage that is quicker for it, as the program calls it.
    pub stage: &'static str,
    /// Which part of the stage's work it was, 0 to 1, where that can be told.
    pub share: Option<f32>,
    /// Bytes that were not allocated.
    pub bytes: usize,
    /// The largest error that it may make, relative; 0 where the result is the same, none where it is a choice and no approximation.
    pub max_error: Option<f32>,
}

impl Skipped {
    /// Something that changes nothing, of a stage.
    pub fn exact(stage: &'static str, what: impl Into<String>, why: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            why: why.into(),
            stage,
            share: None,
            bytes: 0,
            max_error: Some(0.0),
        }
    }

    /// Why, and what it saved and cost, for people; `stage_ms` is what the rest of the stage took, where that is known.
    pub fn in_words(&self, stage_ms: Option<f64>) -> String {
        let mut words = self.why.clone();
        if let Some(ms) = stage_ms.and_then(|ms| self.saved_ms(ms)) {
            words += &match ms {
                1000.0.. => format!("; saved about {:.1} s", ms / 1e3),
                _ => format!("; saved about {ms:.0} ms"),
            };
        }
        if self.bytes > 0 {
            words += &format!("; saved {:.1} MB", self.bytes as f64 / 1e6);
        }
        if let Some(error) = self.max_error.filter(|e| *e > 0.0) {
            words += &format!("; error up to {:.1} %", 100.0 * error);
        }
        words
    }

    /// Milliseconds that it saved, estimated from what the rest of the stage took.
    pub fn saved_ms(&self, stage_ms: f64) -> Option<f64> {
        let share = f64::from(self.share?);
        (share < 1.0).then(|| stage_ms * share / (1.0 - share))
    }
}

/// What a bake left out.
pub fn of_bake(bake: &Bake) -> Vec<Skipped> {
    let mut out = Vec::new();
    let (open_object, closed) = match bake {
        Bake::Visibility(v) => (v.open_object_error, 0.0),
        Bake::Occlusion(o) => (o.open_object_error, o.closed_share),
    };
    if open_object.is_some() {
        let why = "no surfel blocks the light of another in any direction that was asked";
        out.push(Skipped {
            max_error: open_object,
            ..Skipped::exact("bake", "the bake", why)
        });
    }
    if closed > 0.0 {
        let why = format!(
            "{:.0} % of the rays would start on sides that are closed",
            100.0 * closed
        );
        out.push(Skipped {
            share: Some(closed),
            max_error: Some(CLOSED_SIDES_ERROR),
            ..Skipped::exact("bake", "rays into closed sides", why)
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
    let mut out: Vec<Skipped> = Terms::of_preset(settings.preset)
        .filter(|term| !*(term.of)(&mut terms))
        .map(|term| Skipped {
            max_error: None,
            ..Skipped::exact("transfer", term.name, "switched off")
        })
        .collect();
    match prepared {
        PreparedTransfer::Paper(paper) => of_paper(paper, settings, cloud, &mut out),
        PreparedTransfer::Best(best) => of_best(best, settings, cloud, &mut out),
    }
    out
}

fn of_paper(
    paper: &PaperTransfer,
    settings: &TransferSettings,
    cloud: &SurfelCloud,
    out: &mut Vec<Skipped>,
) {
    let degree = paper.specular_degree;
    if degree == cloud.sh_degree {
        return;
    }
    let bytes = empty_bytes(paper.surfels, cloud.sh_degree, paper.asset_degree);
    if degree > 0 {
        let what = format!("SH bands above {degree} of the asset");
        let why = "the source light has nothing there (see SH degree)";
        out.push(Skipped {
            bytes,
            max_error: None,
            ..Skipped::exact("transfer", what, why)
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
            ..Skipped::exact("transfer", "specular transfer", why)
        });
    }
}

fn of_best(
    best: &BestTransfer,
    settings: &TransferSettings,
    cloud: &SurfelCloud,
    out: &mut Vec<Skipped>,
) {
    let (n, asset) = (best.asset.len(), &best.asset);
    let degree = asset.nodes.degree;
    if degree < cloud.sh_degree {
        let what = format!("SH bands above {degree}");
        let why = "the asset's colour has nothing there";
        let node_bytes = 12 * n * (Nodes::count_of(cloud.sh_degree) - asset.nodes.count());
        out.push(Skipped {
            // Stored colour, its residual, and the result.
            bytes: 3 * empty_bytes(n, cloud.sh_degree, degree) + 2 * node_bytes,
            ..Skipped::exact("transfer", what, why)
        });
    }
    if settings.terms.lobe && best.glossy_surfels < n {
        let (what, why) = if best.glossy_surfels > 0 {
            let matte = 100.0 * (n - best.glossy_surfels) as f32 / n as f32;
            let what = format!("the lobe of {matte:.0} % of the surfels");
            (what, "their colour shows no gloss")
        } else if cloud.has_view_dependence() {
            ("specular lobe".into(), "the asset's colour shows no gloss")
        } else {
            let why = "the asset's colour does not depend on the view";
            ("specular lobe".into(), why)
        };
        out.push(Skipped::exact("transfer", what, why));
    }
    if settings.terms.shadow && !best.settings.terms.shadow {
        let why = "no surfel blocks the light of another";
        out.push(Skipped {
            max_error: asset.occlusion.open_object_error,
            ..Skipped::exact("transfer", "shadows", why)
        });
    }
    if best.turns() < TURNS && settings.terms.bounce && settings.terms.shadow {
        let why = "no light bounces between surfels";
        out.push(Skipped::exact("transfer", "turns of the bounce", why));
    }
}

/// What a transfer leaves out for a light.
pub fn of_light(prepared: &PreparedTransfer, light: &Illumination) -> Vec<Skipped> {
    let mut out = Vec::new();
    match prepared {
        PreparedTransfer::Paper(paper) => {
            let is_gray = (light.radiance.coefficients.iter())
                .take(coefficient_count(paper.light_degree))
                .all(|[r, g, b]| r == g && g == b);
            if is_gray && paper.settings.skips.gray_light {
                let why = "the light is grey";
                out.push(Skipped::exact("transfer", "two of three channels", why));
            }
        }
        PreparedTransfer::Best(best) => {
            let suns = light.beams.as_ref().map_or(0, |b| b.suns.len());
            let Terms { sums, suns: on, .. } = best.settings.terms;
            if suns == 0 && sums && on && best.settings.skips.suns {
                let why = "the light has no sun";
                out.push(Skipped::exact("transfer", "rays to suns", why));
            }
        }
    }
    out
}

/// Bytes of colour that `n` surfels do not have in the bands above a degree.
fn empty_bytes(n: usize, degree: usize, filled: usize) -> usize {
    12 * n * (coefficient_count(degree) - coefficient_count(filled))
}
