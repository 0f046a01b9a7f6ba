//! Stage *bake*: visibility from the geometry alone, in a form for each method.

pub mod directional;
pub mod directional_visibility;
pub mod harmonic;
mod hierarchy;
mod inferred_visibility;
pub mod insertion;
pub mod open_object;
pub mod outward_side;
pub mod scaled;
pub mod scene;
pub mod strata;
pub mod surroundings;
pub mod trace;
pub(crate) mod transmittance;
pub mod visibility_clusters;

use std::sync::Arc;

use glam::Vec3;

use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::settings::Method;
use crate::settings::optimizations::{Optimization, Optimizations, SkippedWork, Stage};
use crate::sh::lattice;
use crate::surfels::SurfelCloud;

use directional::{CLOSED_SIDES_ERROR, DirectionalBake};
use harmonic::HarmonicBake;
use inferred_visibility::INFERRED_ERROR;
use scene::SceneBake;
use visibility_clusters::SHARED_VISIBILITY_ERROR;

/// Cost of a ray into a closed side, in mean rays: it soon hits something. (0.5 to 0.9 on the objects of the report.)
const CLOSED_RAY_COST: f32 = 0.75;

/// Share of a bake that rays which others tell of would take, over their share of all directions: many of the others are of closed backs, and
/// are not traced either.
const AGREED_RAY_COST: f32 = 0.85;

/// Share of a bake that its rays take, where many surfels share them: the rest finds fronts, and who shares.
const RAYS_OF_BAKE: f32 = 0.75;

/// Checks that a bake for a method serves another.
pub(crate) fn check_method(baked: Method, wanted: Method) -> Result<()> {
    if baked == wanted {
        return Ok(());
    }
    Err(Error::Mismatch(format!(
        "the bake is for preset {}, and the preset is {}; `transplat bake --preset {}` makes the other",
        baked.preset(),
        wanted.preset(),
        wanted.preset()
    )))
}

/// Visibility of a splat or a scene, as a method needs it.
#[derive(Clone, Debug)]
pub enum Bake {
    /// For the harmonic method.
    Harmonic(Arc<HarmonicBake>),
    /// For the directional method.
    Directional(Arc<DirectionalBake>),
    /// For the directional method, of several objects.
    Scene(Arc<SceneBake>),
}

impl Bake {
    /// Bakes on the CPU from start to end; `directions` are the harmonic method's.
    ///
    /// # Errors
    /// The asset is too large, or [`Error::Cancelled`] when `progress` asked for it.
    pub fn new(
        cloud: &SurfelCloud,
        method: Method,
        directions: usize,
        progress: Progress<'_>,
    ) -> Result<Self> {
        Self::with_optimizations(
            cloud,
            method,
            directions,
            &Optimizations::default(),
            progress,
        )
    }

    /// Bakes with some optimizations switched off.
    ///
    /// # Errors
    /// As [`Bake::new`].
    pub fn with_optimizations(
        cloud: &SurfelCloud,
        method: Method,
        directions: usize,
        optimizations: &Optimizations,
        progress: Progress<'_>,
    ) -> Result<Self> {
        if progress(0.0).is_break() {
            return Err(Error::Cancelled);
        }
        Ok(match method {
            Method::Directional => {
                let stages = (&[1][..], optimizations);
                let baked = DirectionalBake::bake_in_stages(cloud, stages, progress, |_, _| ())?;
                Self::Directional(Arc::new(baked))
            }
            Method::Harmonic => {
                let open = || HarmonicBake::of_open_object(cloud, directions);
                Self::Harmonic(Arc::new(
                    match optimizations
                        .has(Optimization::OpenObject)
                        .then(open)
                        .flatten()
                    {
                        Some(open) => open,
                        None => harmonic::bake(cloud, directions, progress)?,
                    },
                ))
            }
        })
    }

    /// Work that was skipped.
    pub fn skipped_work(&self) -> Vec<SkippedWork> {
        let mut out = Vec::new();
        let (open_object, [closed, followers, inferred_visibility]) = match self {
            Self::Harmonic(v) => (v.open_object_error, [0.0; 3]),
            Self::Directional(o) => {
                let followers = o
                    .directional_visibility
                    .visibility_clusters
                    .follower_share();
                (
                    o.open_object_error,
                    [o.closed_share, followers, o.inferred_share],
                )
            }
            // An object's own rays are told of where it is baked.
            Self::Scene(_) => (None, [0.0; 3]),
        };
        if let Self::Directional(bake) = self
            && bake.tracer.thinning > 1
        {
            let why = format!(
                "the splats are so large that each ray would cross hundreds of them: it meets every {}th",
                bake.tracer.thinning
            );
            out.push(SkippedWork {
                max_error: None,
                ..SkippedWork::exact(Stage::Bake, "most of what rays meet", why)
            });
        }
        if open_object.is_some() {
            let why = "no Gaussian blocks the light of another in any direction that was asked";
            out.push(SkippedWork {
                max_error: open_object,
                skip: Some(Optimization::OpenObject),
                ..SkippedWork::exact(Stage::Bake, "the bake", why)
            });
        }
        let spared = [
            (
                CLOSED_RAY_COST * closed,
                (Optimization::ClosedSides, CLOSED_SIDES_ERROR),
                "rays into closed sides",
                (closed, "rays would start on sides that are closed"),
            ),
            (
                RAYS_OF_BAKE * followers,
                (Optimization::SharedVisibility, SHARED_VISIBILITY_ERROR),
                "rays of neighbours",
                (
                    followers,
                    "Gaussians lie beside one that sees nearly the same",
                ),
            ),
            (
                AGREED_RAY_COST * inferred_visibility,
                (Optimization::InferredRays, INFERRED_ERROR),
                "rays that their neighbours predict",
                (
                    inferred_visibility,
                    "rays follow the nearest ones, which are all open or all blocked",
                ),
            ),
        ];
        let spared = spared.into_iter().filter(|(share, ..)| *share > 0.0);
        out.extend(
            spared.map(|(share, (skip, error), what, (of, why))| SkippedWork {
                share: Some(share),
                skip: Some(skip),
                max_error: Some(error),
                ..SkippedWork::exact(
                    Stage::Bake,
                    what,
                    format!("{:.0} % of the {why}", 100.0 * of),
                )
            }),
        );
        out
    }

    /// The method that it is for.
    pub fn method(&self) -> Method {
        match self {
            Self::Harmonic(_) => Method::Harmonic,
            Self::Directional(_) | Self::Scene(_) => Method::Directional,
        }
    }

    /// The bake, if it is for a method.
    ///
    /// # Errors
    /// It is for the other one.
    pub fn of_method(&self, method: Method) -> Result<&Self> {
        check_method(self.method(), method)?;
        Ok(self)
    }

    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.normals().len()
    }

    /// True without any surfel.
    pub fn is_empty(&self) -> bool {
        self.normals().is_empty()
    }

    /// Directions that were asked.
    pub fn directions(&self) -> usize {
        match self {
            Self::Harmonic(v) => v.directions,
            Self::Directional(_) | Self::Scene(_) => strata::DIRECTIONS,
        }
    }

    /// Bytes that it takes in a file, beside the head.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Harmonic(v) => v.open.len(),
            Self::Directional(o) => {
                size_of_val(&o.tracer.outward_sides.of[..]) + o.directional_visibility.bytes()
            }
            Self::Scene(s) => s.bytes(),
        }
    }

    /// Unit normals, turned to the open side. `[n]`
    pub fn normals(&self) -> &[Vec3] {
        match self {
            Self::Harmonic(v) => &v.normals,
            Self::Directional(o) => &o.normals,
            Self::Scene(s) => &s.normals,
        }
    }

    /// True where both sides of surfel `i` are about equally open.
    pub fn is_two_sided(&self, i: usize) -> bool {
        match self {
            Self::Harmonic(v) => v.two_sided[i],
            Self::Directional(o) => o.two_sided[i] > 0.5,
            Self::Scene(s) => s.of_surfel(i, |o, i| o.two_sided[i] > 0.5),
        }
    }

    /// True where the outward side of surfel `i` is little better than a guess, and matters.
    pub fn is_ambiguous(&self, i: usize) -> bool {
        match self {
            Self::Harmonic(v) => v.two_sided[i],
            Self::Directional(o) => o.is_ambiguous(i),
            Self::Scene(s) => s.of_surfel(i, DirectionalBake::is_ambiguous),
        }
    }

    /// Share of what is seen of the asset that is ambiguous, 0 to 1, the worst object's; the harmonic method does not tell what is seen.
    pub fn ambiguous_share(&self) -> Option<f32> {
        match self {
            Self::Harmonic(_) => None,
            Self::Directional(o) => Some(o.ambiguous_share),
            Self::Scene(s) => s.bakes().map(|o| o.ambiguous_share).reduce(f32::max),
        }
    }

    /// Angle between a surfel's own normal and its surface's, in degrees, below which half of what is seen is: the worst object's; the
    /// harmonic method does not tell what is seen.
    pub fn normal_noise(&self) -> Option<f32> {
        match self {
            Self::Harmonic(_) => None,
            Self::Directional(o) => Some(o.normal_noise),
            Self::Scene(s) => s.bakes().map(|o| o.normal_noise).reduce(f32::max),
        }
    }

    /// Number of stored normals that pointed to the closed side.
    pub fn flipped(&self) -> usize {
        match self {
            Self::Harmonic(v) => v.flipped,
            Self::Directional(o) => o.flipped,
            Self::Scene(s) => s.bakes().map(|o| o.flipped).sum(),
        }
    }

    /// Surfels that are closed on both sides.
    pub fn buried(&self) -> usize {
        match self {
            Self::Harmonic(v) => v.buried,
            Self::Directional(o) => o.buried,
            Self::Scene(s) => s.bakes().map(|o| o.buried).sum(),
        }
    }

    /// Openness of each direction around surfel `i`, 0 to 1.
    pub fn seen_by(&self, i: usize) -> Vec<(Vec3, f32)> {
        match self {
            Self::Harmonic(v) => lattice(v.directions)
                .into_iter()
                .zip(&v.open[i * v.directions..])
                .map(|(d, open)| (d, f32::from(*open) / 255.0))
                .collect(),
            Self::Directional(o) => o.directional_visibility.seen_by(i),
            Self::Scene(s) => s.seen_by(i),
        }
    }

    /// Cosine-weighted share of the front side's hemisphere that is open, `[n]`, 0 to 1: ambient occlusion.
    pub fn openness(&self) -> Vec<f32> {
        match self {
            Self::Harmonic(v) => v.openness(),
            Self::Directional(o) => o.openness(),
            Self::Scene(s) => s.openness(),
        }
    }
}
