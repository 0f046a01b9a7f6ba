//! Support of an object that is cut out of a capture: the desk or ground that it stands on, some of which the box still holds.

use glam::Vec3;

use crate::scene::{Cut, Support};
use crate::surfels::{SurfelCloud, UpAxis};

/// By how much the box is widened to all sides where the support is looked for, of its largest edge; and how far below its bottom and above
/// that the surface may lie.
const AROUND: f32 = 0.25;
const BELOW: f32 = 0.3;
const ABOVE: f32 = 0.35;

/// Opacity at least of the support's own surfels, and cosine between their normals and the up axis.
const OPAQUE: f32 = 0.5;
const FLAT: f32 = 0.85;

/// Height of a bin, of the box's largest edge.
const BIN: f32 = 0.01;

/// Share of the widened box's base that the surface covers at least.
const COVERED: f32 = 0.1;

/// Height over the surface up to which faint surfels are residue, of the box's largest edge. (Of an object trained on a desk, it holds nine
/// tenths of the opacity that is seen beside the object.)
const RESIDUE: f32 = 0.065;

/// Share of the object's area that its residue is at most: more is no residue.
const MOST: f32 = 0.5;

/// Support of what a cut keeps inside, where some of it is left in the box; `up` is the up axis of the cloud's coordinates.
pub fn support_of(cloud: &SurfelCloud, cut: &Cut, up: UpAxis) -> Option<Support> {
    let axis = up.direction();
    let edge = (cut.max - cut.min).max_element();
    let bottom = f32::min(cut.min.dot(axis), cut.max.dot(axis));
    let lowest = bottom - BELOW * edge;
    let bin = BIN * edge;
    let aside = AROUND * edge * (Vec3::ONE - axis.abs());
    let (low, high) = (cut.min - aside, cut.max + aside);
    let is_around = |p: Vec3| {
        let beyond = (low - p).max(p - high);
        // Along the up axis, the bins decide.
        (beyond * (Vec3::ONE - axis.abs())).max_element() <= 0.0
    };
    // A Gaussian covers as much as a disc of twice its variance.
    let area =
        |i: usize| std::f32::consts::TAU * cloud.opacities[i] * cloud.scales[i].element_product();
    let mut covered = vec![0.0; ((BELOW + ABOVE) / BIN) as usize];
    for i in 0..cloud.len() {
        let position = cloud.positions[i];
        let is_surface = cloud.opacities[i] > OPAQUE
            && cloud.stored_normal(i).dot(axis).abs() > FLAT
            && is_around(position);
        let at = (position.dot(axis) - lowest) / bin;
        if let (true, Some(sum)) = (is_surface && at >= 0.0, covered.get_mut(at as usize)) {
            *sum += area(i);
        }
    }
    let most = (0..covered.len()).max_by(|a, b| covered[*a].total_cmp(&covered[*b]))?;
    let size = high - low;
    let base = size.element_product() / size.dot(axis).abs();
    if covered[most] < COVERED * base {
        return None;
    }
    // A surface is rough by a bin.
    let height = lowest + (most as f32 + 1.5) * bin;
    let support = Support {
        up,
        height,
        faint_up_to: height + RESIDUE * edge,
    };
    let (mut all, mut left) = (0.0, 0.0);
    for i in 0..cloud.len() {
        let (position, opacity) = (cloud.positions[i], cloud.opacities[i]);
        if cut.keeps(position, opacity) {
            all += area(i);
            left += f32::from(u8::from(support.holds(position, opacity))) * area(i);
        }
    }
    (left > 0.0 && left < MOST * all).then_some(support)
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::scene::{Keep, kept};
    use crate::synthetic;

    /// A ball of radius 0.5 that stands on a plate at height 0, with faint discs beside it; and how many of these there are.
    fn ball_on_a_plate() -> (SurfelCloud, usize) {
        let mut cloud = synthetic::sphere_over_plate(2000);
        for i in 0..2000 {
            cloud.positions[i].z -= 0.2;
        }
        let before = cloud.len();
        let discs = synthetic::from_points(
            &[Vec3::new(0.4, 0.1, 0.03), Vec3::new(-0.1, 0.45, 0.04)],
            &[Vec3::Z, Vec3::X],
            0.05,
        );
        cloud.add(&discs, 1.0, Vec3::ZERO);
        cloud.opacities[before..].fill(0.3);
        cloud.scales[before..].fill(Vec2::splat(0.05));
        (cloud, 2)
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
        let (cloud, discs) = ball_on_a_plate();
        let all = cloud.len();
        // A box that ends above the plate, and one that holds some of it.
        for low in [0.01, -0.1] {
            let cut = around(low);
            let support = support_of(&cloud, &cut, UpAxis::PlusZ).expect("a plate");
            assert!(support.height.abs() < 0.03, "{support:?}");
            let part = Cut {
                support: Some(support),
                ..cut
            };
            let kept = kept(&[part], &cloud).expect("a cut");
            // The discs and the plate are gone. The ball stays, but for where it touches the plate.
            assert!(kept.iter().all(|i| *i < 2000), "{low}");
            let of_ball = (0..2000).filter(|i| cut.keeps(cloud.positions[*i], 1.0));
            assert!(kept.len() as f32 > 0.95 * of_ball.count() as f32, "{low}");
        }
        assert!(all > 2000 + discs);
    }

    #[test]
    fn an_object_that_hangs_or_is_clean_has_no_residue() {
        let (cloud, discs) = ball_on_a_plate();
        let up = UpAxis::PlusZ;
        // Without the discs, in a box over the plate.
        let clean: Vec<usize> = (0..cloud.len() - discs).collect();
        assert_eq!(support_of(&cloud.selected(&clean), &around(0.03), up), None);
        // Without the plate.
        let ball: Vec<usize> = (0..2000).chain(cloud.len() - discs..cloud.len()).collect();
        assert_eq!(support_of(&cloud.selected(&ball), &around(0.01), up), None);
        let none = synthetic::from_points(&[], &[], 1.0);
        assert_eq!(support_of(&none, &around(0.0), up), None);
    }
}
