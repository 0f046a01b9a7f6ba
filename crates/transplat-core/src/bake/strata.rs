//! Ray directions in strata, and the hits of one surfel's rays.

use std::f64::consts::PI;

use bytemuck::{Pod, Zeroable};
use glam::{DVec3, Vec3};

use crate::sh::fibonacci_sphere;

/// Patches of the sphere.
pub const STRATA: usize = 128;

/// Directions in a patch, around its middle. The first one knows which surfel its ray meets; light that bounces is smoother than light.
pub const PER_STRATUM: usize = 3;

/// Directions that are traced.
pub const DIRECTIONS: usize = PER_STRATUM * STRATA;

/// Words of 64 directions.
pub const WORDS: usize = DIRECTIONS / 64;

/// Angle between a patch's middle and its directions in degrees: that which spaces them most evenly.
const SPREAD: f64 = 5.5;

/// The directions, the first ones of all patches before the second ones. `[PER_STRATUM][STRATA]`
pub fn directions() -> Vec<Vec3> {
    let middles = fibonacci_sphere(STRATA);
    let around = |place: usize, stratum: usize, middle: DVec3| {
        let east = DVec3::Z.cross(middle).normalize();
        // Neighbours are turned against each other.
        let turn =
            PI * (2.0 * place as f64 / PER_STRATUM as f64 + stratum as f64 / PER_STRATUM as f64);
        let aside = turn.cos() * east + turn.sin() * middle.cross(east);
        let spread = SPREAD.to_radians();
        (middle * spread.cos() + aside * spread.sin()).as_vec3()
    };
    (0..DIRECTIONS)
        .map(|j| {
            around(
                j / STRATA,
                j % STRATA,
                DVec3::from_array(middles[j % STRATA]),
            )
        })
        .collect()
}

/// Bits of a [`Hit`] that name its surfel, and those above them that name its patch.
pub const SURFEL_BITS: u32 = 24;
/// Bits of a patch. See [`SURFEL_BITS`].
pub const STRATUM_BITS: u32 = 7;

/// The largest asset whose surfels a [`Hit`] can name.
pub const MOST_SURFELS: usize = 1 << SURFEL_BITS;

/// A blocked direction: the surfel that is met in the low bits, then the patch, and above all whether it is the surfel's back.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(transparent)]
pub struct Hit(pub u32);

impl Hit {
    const BACK: u32 = 1 << (SURFEL_BITS + STRATUM_BITS);

    pub(super) fn new(stratum: usize, surfel: u32) -> Self {
        Self((stratum as u32) << SURFEL_BITS | surfel)
    }

    /// The surfel that is met.
    #[inline(always)]
    pub fn surfel(self) -> usize {
        (self.0 & (MOST_SURFELS as u32 - 1)) as usize
    }

    /// The patch whose first direction it is.
    #[inline(always)]
    pub fn stratum(self) -> usize {
        (self.0 >> SURFEL_BITS & ((1 << STRATUM_BITS) - 1)) as usize
    }

    /// True where the surfel is hit on its back.
    #[inline(always)]
    pub fn is_back(self) -> bool {
        self.0 & Self::BACK != 0
    }

    /// Hit in a scene, where the object's surfels follow others.
    pub(super) fn counted_from(self, first: u32) -> Self {
        Self(self.0 + first)
    }

    pub(super) fn on(self, back: bool) -> Self {
        Self(self.0 & !Self::BACK | if back { Self::BACK } else { 0 })
    }
}

/// Hits of the rays of one surfel.
#[derive(Clone, Debug, Default)]
pub struct SurfelHits {
    /// Index of the surfel that they start from.
    pub surfel: u32,
    pub(crate) open: [u64; WORDS],
    pub(crate) hits: Vec<Hit>,
    /// True where the back is known to be closed: its rays are not traced any more.
    pub back_is_closed: bool,
    /// Number of directions that were inferred instead of traced.
    pub(crate) told: u16,
}

impl SurfelHits {
    /// Nothing yet.
    pub fn of(surfel: u32) -> Self {
        Self {
            surfel,
            ..Self::default()
        }
    }

    /// Adds what the rays of a patch found: which of its directions are open, and the surfel that is met in the first one, if any is.
    pub fn add(&mut self, stratum: usize, met: Option<u32>, open: [bool; PER_STRATUM]) {
        for (place, open) in open.into_iter().enumerate() {
            self.set_open(place * STRATA + stratum, open);
        }
        self.hits
            .extend(met.map(|surfel| Hit::new(stratum, surfel)));
    }

    pub(super) fn set_open(&mut self, j: usize, open: bool) {
        self.open[j / 64] |= u64::from(open) << (j % 64);
    }

    /// True for a direction on a closed side, given its cosine to the front's normal.
    pub(super) fn is_closed(&self, cosine: f32) -> bool {
        self.back_is_closed && cosine < 0.0
    }
}
