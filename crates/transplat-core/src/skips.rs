//! What a scene does not need: the stages find it out from their input and leave it out, unless they are told to do it all the same.

use crate::environment::Illumination;
use crate::sh::coefficient_count;
use crate::surfels::SurfelCloud;
use crate::transfer::best::{BestTransfer, Nodes, TURNS};
use crate::transfer::paper::PaperTransfer;
use crate::transfer::{PreparedTransfer, Preset, Terms, TransferSettings};
use crate::visibility::Bake;
use crate::visibility::occlusion::CLOSED_SIDES_ERROR;

/// What the stages may leave out; all of it unless a test or a measurement wants to know what that saves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Skips {
    /// Bake of preset `best`: rays into sides of surfels that the first rays found closed.
    pub closed_sides: bool,
    /// Bakes: where nothing blocks anything.
    pub open_object: bool,
    /// Transfer and drawing: SH bands in which the result holds nothing.
    pub empty_bands: bool,
    /// Transfer of preset `paper` on the CPU: two of the three channels of a grey light.
    pub gray_light: bool,
    /// Transfer of preset `best`: the pass for suns, where the light has none.
    pub suns: bool,
    /// Transfer of preset `best`: all turns of the bounce but one, where no light bounces.
    pub bounces: bool,
    /// Transfer of preset `best`: the lobe of surfels that show no gloss.
    pub matte: bool,
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
        matte: false,
        unseen: false,
    };

    /// All of them.
    pub const ALL: [Skip; 8] = {
        const PAPER: &[Preset] = &[Preset::Paper];
        const BEST: &[Preset] = &[Preset::Best];
        const BOTH: &[Preset] = &Preset::ALL;
        [
            Skip {
                name: "closed-sides",
                presets: BEST,
                stage: Stage::Bake,
                needed: "rays on both sides of every surfel: no side is closed",
                of: |s| &mut s.closed_sides,
            },
            Skip {
                name: "open-object",
                presets: BOTH,
                stage: Stage::Bake,
                needed: "visibility: surfels block each other's light",
                of: |s| &mut s.open_object,
            },
            Skip {
                name: "empty-bands",
                presets: BOTH,
                stage: Stage::Transfer,
                needed: "all SH bands: there is something in each",
                of: |s| &mut s.empty_bands,
            },
            Skip {
                name: "gray-light",
                presets: PAPER,
                stage: Stage::Transfer,
                needed: "three channels: the light has a colour",
                of: |s| &mut s.gray_light,
            },
            Skip {
                name: "suns",
                presets: BEST,
                stage: Stage::Transfer,
                needed: "rays to suns: the light has one",
                of: |s| &mut s.suns,
            },
            Skip {
                name: "bounces",
                presets: BEST,
                stage: Stage::Transfer,
                needed: "all turns of the bounce: surfels light each other",
                of: |s| &mut s.bounces,
            },
            Skip {
                name: "matte",
                presets: BEST,
                stage: Stage::Transfer,
                needed: "a lobe on every surfel: all of them show gloss",
                of: |s| &mut s.matte,
            },
            Skip {
                name: "unseen",
                presets: BEST,
                stage: Stage::Transfer,
                needed: "every surfel: none is too faint to be seen",
                of: |s| &mut s.unseen,
            },
        ]
    };
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
            matte: true,
            unseen: true,
        }
    }
}

/// One of the [`Skips`].
pub struct Skip {
    /// Its name.
    pub name: &'static str,
    /// Presets that have it.
    pub presets: &'static [Preset],
    /// The stage that is quicker for it.
    pub stage: Stage,
    /// What a scene needs where it does not apply.
    pub needed: &'static str,
    /// Its switch.
    pub of: fn(&mut Skips) -> &mut bool,
}

/// A stage of the pipeline, as what is told of it calls it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Reading a light.
    Project,
    /// Of the asset.
    Bake,
    /// For asset and source light.
    Prepare,
    /// To another light.
    Transfer,
}

impl Stage {
    /// As the program calls it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Project => "project",
            Self::Bake => "bake",
            Self::Prepare => "prepare",
            Self::Transfer => "transfer",
        }
    }
}

/// Something that a stage left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Skipped {
    /// What, for people.
    pub what: String,
    /// And why.
    pub why: String,
    /// By which of the [`Skips`], where it can be done all the same.
    pub skip: Option<&'static str>,
    /// The stage that is quicker for it.
    pub stage: Stage,
    /// Which part of the stage's work it was, 0 to 1, where that can be told.
    pub share: Option<f32>,
    /// Bytes that were not allocated.
    pub bytes: usize,
    /// The relative error that it may make, over all surfels (single ones may be off by more), as its stage knows it: 0 where the result is
    /// the same, none where it is a choice and no approximation.
    pub max_error: Option<f32>,
}

impl Skipped {
    /// Something that changes nothing, of a stage.
    pub fn exact(stage: Stage, what: impl Into<String>, why: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            why: why.into(),
            skip: None,
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
            words += &format!("; colours are off by about {:.2} %", 100.0 * error);
        }
        words
    }

    /// Milliseconds that it saved, estimated from what the rest of the stage took.
    pub fn saved_ms(&self, stage_ms: f64) -> Option<f64> {
        let share = f64::from(self.share?);
        (share < 1.0).then(|| stage_ms * share / (1.0 - share))
    }
}

/// What a ray into a closed side costs, in mean rays: it meets something soon. (0.5 to 0.9 as measured.)
const CLOSED_RAY_COST: f32 = 0.75;

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
    let mut out: Vec<Skipped> = Terms::of_preset(settings.preset)
        .filter(|term| !*(term.of)(&mut terms))
        .map(|term| Skipped {
            max_error: None,
            ..Skipped::exact(Stage::Transfer, term.name, "switched off")
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
            skip: Some("empty-bands"),
            // Stored colour, its residual, and the result.
            bytes: 3 * empty_bytes(n, cloud.sh_degree, degree) + 2 * node_bytes,
            ..Skipped::exact(Stage::Transfer, what, why)
        });
    }
    if settings.terms.lobe && settings.skips.matte && best.glossy_surfels < n {
        let (what, why) = if best.glossy_surfels > 0 {
            let matte = 100.0 * (n - best.glossy_surfels) as f32 / n as f32;
            let what = format!("the lobe of {matte:.0} % of the surfels");
            (what, "their colour shows no gloss")
        } else if best.trust < 1.0 {
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
    if best.turns() < TURNS && settings.terms.bounce && settings.terms.shadow {
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
        PreparedTransfer::Paper(paper) => {
            let is_gray = (light.radiance.coefficients.iter())
                .take(coefficient_count(paper.light_degree))
                .all(|[r, g, b]| r == g && g == b);
            if is_gray && paper.settings.skips.gray_light && !on_gpu {
                let why = "the light is grey";
                out.push(Skipped {
                    skip: Some("gray-light"),
                    ..Skipped::exact(Stage::Transfer, "two of three channels", why)
                });
            }
        }
        PreparedTransfer::Best(best) => {
            let suns = light.beams.as_ref().map_or(0, |b| b.suns.len());
            let Terms { sums, suns: on, .. } = best.settings.terms;
            if suns == 0 && sums && on && best.settings.skips.suns {
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
