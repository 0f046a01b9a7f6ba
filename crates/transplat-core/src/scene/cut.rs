//! Cuts: boxes that separate an object from the rest of its splat.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::error::{Result, ensure};

/// Largest distance of a place from the origin, on each axis.
pub const FARTHEST: f32 = 1e12;

/// The most boxes that an object is cut along.
pub const MOST_CUTS: usize = 256;

/// A box that a splat is cut along: along the axes of its own coordinates, in its units.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cut {
    /// Side of it that the object is on.
    pub keep: Keep,
    /// Least corner.
    pub min: Vec3,
    /// Greatest corner.
    pub max: Vec3,
}

/// A side of a box.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Keep {
    /// Inside of the box.
    Inside,
    /// Outside of the box.
    Outside,
}

impl Cut {
    /// True for a surfel of the object by its place: one is on either side of a box, never on both.
    pub fn keeps(&self, position: Vec3) -> bool {
        let is_inside = position.cmpge(self.min).all() && position.cmple(self.max).all();
        is_inside == (self.keep == Keep::Inside)
    }

    /// Cut with the same box that keeps the other side.
    pub fn inverse(&self) -> Self {
        Self {
            keep: match self.keep {
                Keep::Inside => Keep::Outside,
                Keep::Outside => Keep::Inside,
            },
            ..*self
        }
    }

    pub(super) fn validate(&self) -> Result<()> {
        let is_place = |p: Vec3| p.abs().max_element() <= FARTHEST;
        let good = is_place(self.min) && is_place(self.max) && self.min.cmple(self.max).all();
        ensure(good, || {
            format!(
                "cut: two corners of three numbers up to {FARTHEST:e} are expected, min not above max"
            )
        })
    }
}

/// Indices of the places that all cuts keep; none where nothing is cut.
pub fn kept(cuts: &[Cut], positions: &[Vec3]) -> Option<Vec<usize>> {
    let is_kept = |i: &usize| cuts.iter().all(|cut| cut.keeps(positions[*i]));
    (!cuts.is_empty()).then(|| (0..positions.len()).filter(is_kept).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_surfel_is_on_one_side_of_a_box() {
        let cut = Cut {
            keep: Keep::Inside,
            min: Vec3::new(-1.0, 0.0, 2.0),
            max: Vec3::new(1.0, 0.5, 2.0),
        };
        let places = [
            Vec3::new(1.0, 0.5, 2.0),
            Vec3::new(0.0, 0.2, 2.0),
            Vec3::new(0.0, 0.2, 2.1),
            Vec3::new(f32::NAN, 0.2, 2.0),
        ];
        let of = |cuts: &[Cut]| kept(cuts, &places);
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[cut]), Some(vec![0, 1]));
        assert_eq!(of(&[cut.inverse()]), Some(vec![2, 3]));
        assert_eq!(of(&[cut, cut.inverse()]), Some(vec![]));
    }

    #[test]
    fn boxes_that_are_none_are_refused() {
        let cut = |min, max| {
            let keep = Keep::Outside;
            Cut { keep, min, max }.validate().is_ok()
        };
        assert!(cut(Vec3::ZERO, Vec3::ONE) && cut(Vec3::ONE, Vec3::ONE));
        assert!(!cut(Vec3::ONE, Vec3::ZERO) && !cut(Vec3::NAN, Vec3::ONE));
        assert!(!cut(Vec3::ZERO, Vec3::INFINITY));
    }
}
