//! Crop box of the object in a capture of its surroundings: what was photographed from all around is densest there.

use glam::{Mat3, Vec3};

use crate::numeric::quantile;
use crate::surfels::{Bounds, SurfelCloud};

/// Surfels that are looked at, at most.
const MOST_SURFELS: usize = 50_000;

/// Opacity below which surfels are haze.
const LEAST_OPACITY: f32 = 0.1;

/// By how much a ball around what is densest shrinks from turn to turn, and how often.
const SHRINK: f32 = 0.85;
const TURNS: usize = 40;

/// Twice as far around an object there is less than this many times as much: around a place on a plain there is four times as much.
const MOST_AROUND: f32 = 2.0;

/// Share of all that the object is at least, so that no lump of the surroundings is taken for one.
const LEAST_SHARE: f32 = 0.2;

/// Least reach of the surroundings, in radii of the object: a table that it stands on is none.
const LEAST_RATIO: f32 = 4.0;

/// Share of what lies around that is along one line at most: a neck or a mast is no surroundings.
const MOST_ALONG: f32 = 0.8;

/// Share of the object's surfels that may lie beyond each side of the box, and room around the others, of its size.
const BEYOND: f32 = 0.01;
const ROOM: f32 = 0.05;

/// The corners of a box around the object where a capture holds a room or a landscape besides, in the capture's radius around its centre, as
/// [`crate::surfels::SurfelFilter`] has them; nothing where there is no more than the object.
pub fn proposed_crop(cloud: &SurfelCloud, bounds: &Bounds) -> Option<[Vec3; 2]> {
    let step = cloud.len().div_ceil(MOST_SURFELS).max(1);
    let looked_at = (0..cloud.len()).step_by(step);
    let places = looked_at.filter(|i| cloud.opacities[*i] > LEAST_OPACITY);
    let places: Vec<Vec3> = places
        .map(|i| (cloud.positions[i] - bounds.center) / bounds.radius)
        .filter(|p| p.is_finite())
        .collect();
    let mut middle = middle_of(&places)?;
    let farthest = quantile(distances(&places, middle), 0.99)?;
    let mut reach = farthest;
    let mut found: Option<(f32, Vec<Vec3>, f32)> = None;
    for _ in 0..TURNS {
        reach *= SHRINK;
        let within = near(&places, middle, reach);
        if (within.len() as f32) < LEAST_SHARE * places.len() as f32 {
            break;
        }
        middle = middle_of(&within)?;
        let object = near(&places, middle, reach);
        let around = near(&places, middle, 2.0 * reach).len() as f32 / object.len().max(1) as f32;
        if found.as_ref().is_none_or(|(least, ..)| around < *least)
            && reach < farthest / LEAST_RATIO
        {
            found = Some((around, object, reach));
        }
    }
    let (around, object, reach) = found?;
    let corner = |share: f32| {
        let along = |axis: usize| quantile(object.iter().map(|p| p[axis]).collect(), share);
        Some(Vec3::new(along(0)?, along(1)?, along(2)?))
    };
    let (low, high) = (corner(BEYOND)?, corner(1.0 - BEYOND)?);
    let size = high - low;
    let room = Vec3::splat(ROOM * size.max_element());
    let away = places.iter().map(|p| *p - middle);
    let beyond = away.filter(|d| d.length() > 2.0 * reach);
    let is_around = largest_share_along(beyond) < MOST_ALONG;
    (around < MOST_AROUND && is_around).then_some([low - room, high + room])
}

fn near(places: &[Vec3], middle: Vec3, reach: f32) -> Vec<Vec3> {
    let is_near = |p: &Vec3| p.distance(middle) < reach;
    places.iter().copied().filter(is_near).collect()
}

fn distances(places: &[Vec3], from: Vec3) -> Vec<f32> {
    places.iter().map(|p| p.distance(from)).collect()
}

/// The largest share of directions' squares along any one line, 0 to 1.
fn largest_share_along(directions: impl Iterator<Item = Vec3>) -> f32 {
    let (mut sum, mut count) = (Mat3::ZERO, 0.0);
    for d in directions {
        let d = d.normalize_or_zero();
        sum += Mat3::from_cols(d * d.x, d * d.y, d * d.z);
        count += 1.0;
    }
    let mut line = Vec3::new(1.0, 0.9, 0.8);
    for _ in 0..20 {
        line = (sum * line).normalize_or_zero();
    }
    line.dot(sum * line) / f32::max(count, 1.0)
}

/// The median along each axis.
fn middle_of(places: &[Vec3]) -> Option<Vec3> {
    let along = |axis: usize| quantile(places.iter().map(|p| p[axis]).collect(), 0.5);
    Some(Vec3::new(along(0)?, along(1)?, along(2)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    /// A ball beside the middle of a room that is so many times as wide.
    fn ball_in_a_room(times: f32) -> SurfelCloud {
        let mut cloud = synthetic::sphere(2000);
        cloud.positions.iter_mut().for_each(|p| p.x += 0.5);
        let mut walls = synthetic::sphere(3000);
        for p in &mut walls.positions {
            *p *= times / p.abs().max_element();
        }
        let of = |o: SurfelCloud| (std::sync::Arc::new(o), glam::Affine3A::IDENTITY);
        let whole = SurfelCloud::whole(&[of(cloud), of(walls)]).expect("two objects");
        (*whole).clone()
    }

    #[test]
    fn the_box_is_around_the_object_in_a_room() {
        for times in [6.0, 20.0, 200.0] {
            let cloud = ball_in_a_room(times);
            let bounds = cloud.bounds();
            let corners = proposed_crop(&cloud, &bounds).expect("a box");
            let [low, high] = corners.map(|c| bounds.center + c * bounds.radius);
            let (middle, size) = (0.5 * (low + high), high - low);
            assert!(middle.distance(Vec3::new(0.5, 0.0, 0.0)) < 0.2, "{middle}");
            assert!(
                size.min_element() > 1.9 && size.max_element() < 2.6,
                "{size}"
            );
        }
    }

    #[test]
    fn an_object_alone_or_on_a_plate_is_not_cropped() {
        for cloud in [
            synthetic::sphere(2000),
            synthetic::sphere_over_plate(2000),
            synthetic::sheet(900),
            ball_in_a_room(2.0),
        ] {
            assert_eq!(proposed_crop(&cloud, &cloud.bounds()), None);
        }
        // A dense ball with a long neck.
        let mut neck = ball_in_a_room(20.0);
        for p in neck.positions.iter_mut().skip(2000) {
            *p = Vec3::new(0.02 * p.x, 0.02 * p.y, p.z.abs());
        }
        assert_eq!(proposed_crop(&neck, &neck.bounds()), None);
        let none = synthetic::from_points(&[], &[], 1.0);
        assert_eq!(proposed_crop(&none, &none.bounds()), None);
    }
}
