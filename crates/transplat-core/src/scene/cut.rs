//! Cuts: boxes that separate an object from the rest of its splat.

use glam::Vec3;
use serde::{Deserialize, Serialize};

use crate::error::{Result, ensure};
use crate::surfels::{SurfelCloud, UpAxis};

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
    /// Support that the object inside stands on; its surfels in the box count as outside.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub support: Option<Support>,
}

/// Opacity below which a surfel just over a support is residue of it. (Of an object trained on a desk the surface there is opaque to 99 %; a
/// bound of 0.5 leaves a third of what is seen beside it, and one of 0.7 a sixth.)
const RESIDUE_OPACITY: f32 = 0.9;

/// A flat support, as a desk or the ground, that an object stands on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Support {
    /// Axis of the splat's own coordinates that heights are along.
    pub up: UpAxis,
    /// Height of its surface: what lies below belongs to it.
    pub height: f32,
    /// Height up to which surfels that are not opaque belong to it, too.
    pub residue_up_to: f32,
}

impl Support {
    /// True for a surfel of the support, by its place and opacity.
    pub fn holds(&self, position: Vec3, opacity: f32) -> bool {
        let height = position.dot(self.up.direction());
        height < self.height || (height < self.residue_up_to && opacity < RESIDUE_OPACITY)
    }
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
    /// True for a surfel of the object by its place and opacity: one is on either side of a cut, never on both.
    pub fn keeps(&self, position: Vec3, opacity: f32) -> bool {
        let is_in_box = position.cmpge(self.min).all() && position.cmple(self.max).all();
        let of_support = self.support.is_some_and(|s| s.holds(position, opacity));
        let is_inside = is_in_box && !of_support;
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
        let (min, max) = (self.min, self.max);
        ensure(is_place(min) && is_place(max), || {
            format!("cut: corners {min} and {max}: numbers up to {FARTHEST:e} are expected")
        })?;
        ensure(min.cmple(max).all(), || {
            format!("cut: min not above max is expected, {min} and {max} given")
        })?;
        let Some(support) = self.support else {
            return Ok(());
        };
        let (height, end) = (support.height, support.residue_up_to);
        let good = height.abs() <= FARTHEST && height <= end && end <= FARTHEST;
        ensure(good, || {
            format!(
                "cut: support: height {height}, residue_up_to {end}: numbers up to {FARTHEST:e} are expected, height not above residue_up_to"
            )
        })
    }
}

/// Indices of the surfels that all cuts keep; none where nothing is cut.
pub fn kept(cuts: &[Cut], cloud: &SurfelCloud) -> Option<Vec<usize>> {
    let keeps = |cut: &Cut, i: usize| cut.keeps(cloud.positions[i], cloud.opacities[i]);
    let is_kept = |i: &usize| cuts.iter().all(|cut| keeps(cut, *i));
    (!cuts.is_empty()).then(|| (0..cloud.len()).filter(is_kept).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[test]
    fn each_surfel_is_on_one_side_of_a_box() {
        let cut = Cut {
            keep: Keep::Inside,
            min: Vec3::new(-1.0, 0.0, 2.0),
            max: Vec3::new(1.0, 0.5, 2.0),
            support: None,
        };
        let places = [
            Vec3::new(1.0, 0.5, 2.0),
            Vec3::new(0.0, 0.2, 2.0),
            Vec3::new(0.0, 0.2, 2.1),
            Vec3::new(f32::NAN, 0.2, 2.0),
        ];
        let mut cloud = synthetic::sphere(places.len());
        cloud.positions = places.to_vec();
        let of = |cuts: &[Cut]| kept(cuts, &cloud);
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[cut]), Some(vec![0, 1]));
        assert_eq!(of(&[cut.inverse()]), Some(vec![2, 3]));
        assert_eq!(of(&[cut, cut.inverse()]), Some(vec![]));
    }

    #[test]
    fn what_is_left_of_a_support_is_on_the_other_side() {
        let cut = Cut {
            keep: Keep::Inside,
            min: Vec3::splat(-1.0),
            max: Vec3::ONE,
            support: Some(Support {
                up: UpAxis::MinusY,
                height: -0.5,
                residue_up_to: 0.0,
            }),
        };
        // Heights -0.6, -0.4 and 0.1.
        for (y, opacity, keeps) in [
            (0.6, 1.0, false),
            (0.4, 0.8, false),
            (0.4, 0.95, true),
            (-0.1, 0.1, true),
        ] {
            let place = Vec3::new(0.0, y, 0.0);
            assert_eq!(cut.keeps(place, opacity), keeps, "{y} {opacity}");
            assert_eq!(cut.inverse().keeps(place, opacity), !keeps);
        }
    }

    #[test]
    fn boxes_that_are_none_are_refused() {
        let cut = |min, max| {
            let keep = Keep::Outside;
            let cut = Cut {
                keep,
                min,
                max,
                support: None,
            };
            cut.validate().is_ok()
        };
        assert!(cut(Vec3::ZERO, Vec3::ONE) && cut(Vec3::ONE, Vec3::ONE));
        assert!(!cut(Vec3::ONE, Vec3::ZERO) && !cut(Vec3::NAN, Vec3::ONE));
        assert!(!cut(Vec3::ZERO, Vec3::INFINITY));
        let on = |height, residue_up_to| {
            let support = Support {
                up: UpAxis::PlusZ,
                height,
                residue_up_to,
            };
            let cut = Cut {
                keep: Keep::Inside,
                min: Vec3::ZERO,
                max: Vec3::ONE,
                support: Some(support),
            };
            cut.validate().is_ok()
        };
        assert!(on(0.1, 0.2) && on(0.1, 0.1));
        assert!(!on(0.2, 0.1) && !on(f32::NAN, 0.1) && !on(0.1, 1e30));
    }
}
