//! Support of an object that is cut out of a capture: the desk or ground that it stands on, some of which the box still holds.

use glam::Vec3;

use crate::scene::{Cut, Support};
use crate::surfels::{SurfelCloud, UpAxis};

/// Widening of the box across the up axis, to either side, of its largest edge: a desk goes on beside what stands on it.
const AROUND: f32 = 0.25;

/// Bins of height below the bottom of the box and above it, and the height of one, of the box's largest edge: where a box is drawn by hand.
const BINS_BELOW: usize = 30;
const BINS_ABOVE: usize = 35;
const BIN: f32 = 0.01;

/// Opacity at least of the support's own surfels, and cosine between their normals and the up axis.
const OPAQUE: f32 = 0.5;
const FLAT: f32 = 0.85;

/// Share of the widened box's base that the surface covers at least: less is a part of the object.
const COVERED: f32 = 0.1;

/// Height over the surface up to which what is not opaque is residue, of the box's height. (On a desk it holds nine tenths of the opacity that is
/// seen beside the object.)
const RESIDUE: f32 = 0.065;

/// Share of the area in the box that is residue at most: where it is more, the box is about something else.
const MOST: f32 = 0.5;

/// Support of what a cut keeps inside, where some of it is left in the box; `up` is the up axis of the cloud's coordinates.
pub fn support_of(cloud: &SurfelCloud, cut: &Cut, up: UpAxis) -> Option<Support> {
    let axis = up.direction();
    let across = Vec3::ONE - axis.abs();
    let size = cut.max - cut.min;
    let (edge, box_height) = (size.max_element(), size.dot(axis.abs()));
    let lowest = f32::min(cut.min.dot(axis), cut.max.dot(axis)) - BINS_BELOW as f32 * BIN * edge;
    let aside = AROUND * edge * across;
    let (low, high) = (cut.min - aside, cut.max + aside);
    let is_around = |p: Vec3| ((low - p).max(p - high) * across).max_element() <= 0.0;
    // A Gaussian covers as much as a disc of twice its variance.
    let area =
        |i: usize| std::f32::consts::TAU * cloud.opacities[i] * cloud.scales[i].element_product();
    let mut covered = [0.0; BINS_BELOW + BINS_ABOVE];
    for i in 0..cloud.len() {
        let position = cloud.positions[i];
        let is_surface = cloud.opacities[i] > OPAQUE
            && cloud.stored_normal(i).dot(axis).abs() > FLAT
            && is_around(position);
        let at = (position.dot(axis) - lowest) / (BIN * edge);
        if let (true, Some(sum)) = (is_surface && at >= 0.0, covered.get_mut(at as usize)) {
            *sum += area(i);
        }
    }
    let most = (0..covered.len()).max_by(|a, b| covered[*a].total_cmp(&covered[*b]))?;
    let widened = high - low;
    // The two extents across the up axis: along it the factor is 1.
    let base = (widened * across + axis.abs()).element_product();
    let is_covered = base > 0.0 && covered[most] >= COVERED * base;
    // The middle of the next bin: half of the surface's own Gaussians lie above the middle of theirs.
    let height = lowest + (most as f32 + 1.5) * BIN * edge;
    let support = Support {
        up,
        height,
        residue_up_to: height + RESIDUE * box_height,
    };
    let (mut all, mut left) = (0.0, 0.0);
    for i in 0..cloud.len() {
        let (position, opacity) = (cloud.positions[i], cloud.opacities[i]);
        if cut.keeps(position, opacity) {
            all += area(i);
            if support.holds(position, opacity) {
                left += area(i);
            }
        }
    }
    (is_covered && left > 0.0 && left < MOST * all).then_some(support)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::{Keep, kept};
    use crate::synthetic;

    /// Surfels of the ball, and discs beside it.
    const BALL: usize = 2000;
    const DISCS: usize = 2;

    /// A ball of radius 0.5 that stands on a plate at height 0, with two discs beside it that are not opaque.
    fn ball_on_a_plate() -> SurfelCloud {
        let mut cloud = synthetic::sphere_over_plate(BALL);
        for p in &mut cloud.positions[..BALL] {
            p.z -= 0.2;
        }
        let before = cloud.len();
        let discs = synthetic::from_points(
            &[Vec3::new(0.4, 0.1, 0.03), Vec3::new(-0.1, 0.45, 0.04)],
            &[Vec3::Z, Vec3::X],
            0.05,
        );
        cloud.add(&discs, 1.0, Vec3::ZERO);
        cloud.opacities[before..].fill(0.3);
        cloud
    }

    fn around(low: f32) -> Cut {
        Cut {
            keep: Keep::Inside,
            min: Vec3::new(-0.55, -0.55, low),
            max: Vec3::new(0.55, 0.55, 1.1),
            support: None,
        }
    }

    #[test]
    fn what_is_left_of_a_plate_is_found_above_it_and_below() {
        let cloud = ball_on_a_plate();
        // A box that ends above the plate, and one that holds some of it.
        for low in [0.01, -0.1] {
            let cut = around(low);
            let support = support_of(&cloud, &cut, UpAxis::PlusZ).expect("a plate");
            // Within two bins of the plate.
            let bin = BIN * (cut.max - cut.min).max_element();
            assert!(support.height.abs() <= 2.0 * bin, "{support:?}");
            let part = Cut {
                support: Some(support),
                ..cut
            };
            let kept = kept(&[part], &cloud).expect("a cut");
            // The discs and the plate are gone. The ball stays, but for where it touches the plate.
            assert!(kept.iter().all(|i| *i < BALL), "{low}");
            let of_ball = (0..BALL).filter(|i| cut.keeps(cloud.positions[*i], 1.0));
            assert!(kept.len() as f32 > 0.95 * of_ball.count() as f32, "{low}");
        }
    }

    #[test]
    fn a_support_is_found_along_any_axis() {
        let mut cloud = ball_on_a_plate();
        // Half a turn about x: what was up is down.
        let turned = |v: Vec3| Vec3::new(v.x, -v.y, -v.z);
        cloud.positions.iter_mut().for_each(|p| *p = turned(*p));
        for t in cloud.tangents.iter_mut().flatten() {
            *t = turned(*t);
        }
        let cut = Cut {
            min: Vec3::new(-0.55, -0.55, -1.1),
            max: Vec3::new(0.55, 0.55, -0.01),
            ..around(0.0)
        };
        let support = support_of(&cloud, &cut, UpAxis::MinusZ);
        let upright = support_of(&ball_on_a_plate(), &around(0.01), UpAxis::PlusZ);
        assert_eq!(support.map(|s| s.height), upright.map(|s| s.height));
        assert!(support.is_some());
        // The other way round the plate is a ceiling.
        assert_eq!(support_of(&cloud, &cut, UpAxis::PlusZ), None);
    }

    #[test]
    fn an_object_that_hangs_or_is_clean_has_no_residue() {
        let cloud = ball_on_a_plate();
        let up = UpAxis::PlusZ;
        // Without the discs, in a box over the plate.
        let clean: Vec<usize> = (0..cloud.len() - DISCS).collect();
        assert_eq!(support_of(&cloud.selected(&clean), &around(0.03), up), None);
        // Without the plate.
        let ball: Vec<usize> = (0..BALL).chain(cloud.len() - DISCS..cloud.len()).collect();
        assert_eq!(support_of(&cloud.selected(&ball), &around(0.01), up), None);
        // A box around the plate itself, and one of no size.
        let plate = Cut {
            min: Vec3::new(-2.0, -2.0, -0.05),
            max: Vec3::new(2.0, 2.0, 0.3),
            ..around(0.0)
        };
        assert_eq!(support_of(&cloud, &plate, up), None);
        let none = Cut {
            min: Vec3::ZERO,
            max: Vec3::ZERO,
            ..around(0.0)
        };
        assert_eq!(support_of(&cloud, &none, up), None);
        let nothing = synthetic::from_points(&[], &[], 1.0);
        assert_eq!(support_of(&nothing, &around(0.0), up), None);
    }
}
