//! Optimizations: work that a scene does not need, found from its input, and the switches that force it.

use super::method::Method;

/// Optimizations that are on: all of them unless a test or a measurement compares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Optimizations([bool; Optimization::ALL.len()]);

// The last variant: each has its place.
const _: () = assert!(Optimization::Unseen as usize + 1 == Optimization::ALL.len());

impl Optimizations {
    /// Nothing is left out.
    pub const NONE: Self = Self([false; Optimization::ALL.len()]);

    /// True where an optimization is on.
    pub fn has(self, skip: Optimization) -> bool {
        self.0[skip as usize]
    }

    /// All but that.
    pub fn without(mut self, skip: Optimization) -> Self {
        self.0[skip as usize] = false;
        self
    }
}

impl Default for Optimizations {
    fn default() -> Self {
        Self([true; Optimization::ALL.len()])
    }
}

/// Something that a stage may leave out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Optimization {
    /// Bake of the directional method: rays into sides of surfels that the first rays found closed.
    ClosedSides,
    /// Bakes: where nothing blocks anything.
    OpenObject,
    /// Bake of the directional method: rays of surfels beside one that sees nearly the same.
    SharedVisibility,
    /// Bake of the directional method on the CPU: of many surfels, rays of which the nearest ones all leave or are all blocked.
    InferredRays,
    /// Preparing the directional method: of very many surfels, to ask each what it is made of.
    SharedLobes,
    /// Transfer and drawing: SH bands in which the result holds nothing.
    EmptyBands,
    /// Transfer of the harmonic method on the CPU: two of the three channels of a grey light.
    GrayLight,
    /// Transfer of the directional method: the pass for suns, where the light has none.
    Suns,
    /// Transfer of the directional method: all turns of the bounce but one, where no light bounces.
    Bounces,
    /// Transfer of the directional method: the lobe of surfels that show no gloss.
    DiffuseSurfels,
    /// Transfer and drawing: surfels that are hidden or too faint to be seen.
    Unseen,
}

impl Optimization {
    /// All of them, in their order.
    pub const ALL: [Self; 11] = [
        Self::ClosedSides,
        Self::OpenObject,
        Self::SharedVisibility,
        Self::InferredRays,
        Self::SharedLobes,
        Self::EmptyBands,
        Self::GrayLight,
        Self::Suns,
        Self::Bounces,
        Self::DiffuseSurfels,
        Self::Unseen,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::ClosedSides => "closed-sides",
            Self::OpenObject => "open-object",
            Self::SharedVisibility => "shared-sight",
            Self::InferredRays => "agreed-rays",
            Self::SharedLobes => "shared-gloss",
            Self::EmptyBands => "empty-bands",
            Self::GrayLight => "gray-light",
            Self::Suns => "suns",
            Self::Bounces => "bounces",
            Self::DiffuseSurfels => "matte",
            Self::Unseen => "unseen",
        }
    }

    /// Methods that have it.
    pub fn methods(self) -> &'static [Method] {
        match self {
            Self::OpenObject | Self::EmptyBands => &Method::ALL,
            Self::GrayLight => &[Method::Harmonic],
            Self::ClosedSides
            | Self::SharedVisibility
            | Self::InferredRays
            | Self::SharedLobes
            | Self::Suns
            | Self::Bounces
            | Self::DiffuseSurfels
            | Self::Unseen => &[Method::Directional],
        }
    }

    /// The stage that is quicker for it.
    pub fn stage(self) -> Stage {
        match self {
            Self::ClosedSides | Self::OpenObject | Self::SharedVisibility | Self::InferredRays => {
                Stage::Bake
            }
            Self::SharedLobes => Stage::Prepare,
            Self::EmptyBands
            | Self::GrayLight
            | Self::Suns
            | Self::Bounces
            | Self::DiffuseSurfels
            | Self::Unseen => Stage::Transfer,
        }
    }

    /// True for optimizations that spare single rays of a bake.
    pub fn is_of_rays(self) -> bool {
        matches!(
            self,
            Self::ClosedSides | Self::SharedVisibility | Self::InferredRays
        )
    }

    /// Reason why a scene cannot use it, in words.
    pub fn needed(self) -> &'static str {
        match self {
            Self::ClosedSides => "rays on both sides of every Gaussian: no side is closed",
            Self::OpenObject => "visibility: Gaussians block each other's light",
            Self::SharedVisibility => {
                "rays of every Gaussian: there are not so many, or no two see the same"
            }
            Self::InferredRays => {
                "rays in every direction: there are not so many Gaussians, or none that agree"
            }
            Self::SharedLobes => "the specular lobe of every Gaussian: there are not so many",
            Self::EmptyBands => "all SH bands: there is something in each",
            Self::GrayLight => "three channels: the light has a colour",
            Self::Suns => "rays to suns: the light has one",
            Self::Bounces => "all turns of the bounce: Gaussians light each other",
            Self::DiffuseSurfels => {
                "a specular lobe on every Gaussian: all of them show highlights"
            }
            Self::Unseen => "every Gaussian: all are visible",
        }
    }
}

/// A stage of the pipeline, as what is told of it calls it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Reading a light.
    Project,
    /// Bake of a splat.
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
pub struct SkippedWork {
    /// What, for people.
    pub what: String,
    /// Reason that it was skipped.
    pub why: String,
    /// Optimization that skipped it, where the work can be forced.
    pub skip: Option<Optimization>,
    /// The stage that is quicker for it.
    pub stage: Stage,
    /// Share of the stage's work, 0 to 1, where that is known.
    pub share: Option<f32>,
    /// Bytes that were not allocated.
    pub bytes: usize,
    /// The relative error that it may make, over all surfels (single ones may be off by more), as its stage knows it: 0 where the result is
    /// the same, none where it is a choice and no approximation.
    pub max_error: Option<f32>,
}

impl SkippedWork {
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

    /// Surfels that nobody sees (`[n]` or empty), which are neither relit nor drawn.
    pub fn of_unseen(unseen: &[bool]) -> Option<Self> {
        let count = unseen.iter().filter(|u| **u).count();
        let why = format!("{count} are hidden or nearly transparent");
        (count > 0).then(|| Self {
            skip: Some(Optimization::Unseen),
            share: Some(count as f32 / unseen.len() as f32),
            ..Self::exact(Stage::Transfer, "Gaussians that nobody sees", why)
        })
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
