//! Which way up a capture stands, told by the ground in it.

use glam::Vec3;

use crate::surfels::{Bounds, SurfelCloud, UpAxis};

/// Surfels that are looked at, at most.
const MOST_SURFELS: usize = 50_000;

/// What is fainter is no ground.
const LEAST_OPACITY: f32 = 0.1;

/// Cosine between an axis and the normals of what lies flat across it.
const FLAT: f32 = 0.9;

/// Thickness of the ground, in the capture's radius.
const THICKNESS: f64 = 0.06;

/// Of all surface, what may lie below the ground: haze, and what shines through.
const MOST_BELOW: f64 = 0.1;

/// Of all surface, the share of ground times that above it, from which on there is ground.
const LEAST_EVIDENCE: f64 = 0.08;

/// How much more evident it is than any other: a room's walls are planes too.
const LEAST_LEAD: f64 = 2.0;

/// Which way is up in a capture whose file does not tell (`told`), where that is another than is assumed: by the ground in it.
pub fn proposed_up(cloud: &SurfelCloud, told: Option<UpAxis>) -> Option<UpAxis> {
    let is_untold = told.is_none();
    let up = is_untold.then(|| up_from_ground(cloud)).flatten();
    up.filter(|up| *up != cloud.up)
}

/// The axis that points up from the ground, where a capture has one: a thin flat layer, much of its surface, with the rest on one side.
/// None for a thing alone, and where walls are as good.
pub fn up_from_ground(cloud: &SurfelCloud) -> Option<UpAxis> {
    let pieces = Piece::of(cloud);
    let places: Vec<Vec3> = pieces.iter().map(|p| p.position).collect();
    let radius = f64::from(Bounds::of(&places).radius);
    if radius <= 0.0 || !radius.is_finite() {
        return None;
    }
    let mut found: Vec<(f64, UpAxis)> = UpAxis::ALL
        .iter()
        .map(|(_, up)| (evidence(&pieces, *up, radius), *up))
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let [(best, up), (second, _), ..] = found[..] else {
        return None;
    };
    (best >= LEAST_EVIDENCE && best >= LEAST_LEAD * second).then_some(up)
}

/// A surfel as a piece of surface.
struct Piece {
    position: Vec3,
    normal: Vec3,
    /// How much surface it is.
    area: f64,
}

impl Piece {
    fn of(cloud: &SurfelCloud) -> Vec<Self> {
        let step = cloud.len().div_ceil(MOST_SURFELS).max(1);
        let seen = (0..cloud.len()).step_by(step);
        seen.filter(|i| cloud.opacities[*i] > LEAST_OPACITY)
            .map(|i| Self {
                position: cloud.positions[i],
                normal: cloud.stored_normal(i),
                area: f64::from(cloud.opacities[i] * cloud.scales[i].element_product()),
            })
            .filter(|piece| piece.area.is_finite())
            .collect()
    }
}

/// Share of the surface that lies in the ground, times what is above it less what is below; 0 where too much is.
fn evidence(pieces: &[Piece], up: UpAxis, radius: f64) -> f64 {
    let up = up.direction();
    let height = |p: &Piece| f64::from(p.position.dot(up));
    let step = radius * THICKNESS / 2.0;
    let layer_of = |p: &Piece| (height(p) / step).floor();
    let is_flat = |p: &Piece| p.normal.dot(up).abs() > FLAT;
    // The layer with most of what lies flat; floaters may be anywhere, so that layers are sorted and not counted from the lowest.
    let mut flat: Vec<(f64, f64)> = (pieces.iter().filter(|p| is_flat(p)))
        .map(|p| (layer_of(p), p.area))
        .collect();
    flat.sort_by(|a, b| a.0.total_cmp(&b.0));
    let layers = flat.chunk_by(|a, b| a.0 == b.0);
    let thickest = layers
        .map(|layer| (layer.iter().map(|(_, area)| area).sum::<f64>(), layer[0].0))
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((_, layer)) = thickest else {
        return 0.0;
    };
    let (bottom, top) = ((layer - 0.5) * step, (layer + 1.5) * step);
    let (mut ground, mut above, mut below, mut total) = (0.0, 0.0, 0.0, 0.0);
    for p in pieces {
        let height = height(p);
        total += p.area;
        if height > top {
            above += p.area;
        } else if height < bottom {
            below += p.area;
        } else if is_flat(p) {
            ground += p.area;
        }
    }
    if below > MOST_BELOW * total {
        return 0.0;
    }
    ground * (above - below) / (total * total)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::{from_points, sheet, sphere, sphere_over_plate, turned};
    use glam::{DMat3, DVec3};

    /// A turn that brings +Z onto an axis.
    fn onto(up: UpAxis) -> DMat3 {
        let turn = glam::DQuat::from_rotation_arc(DVec3::Z, up.direction().as_dvec3());
        DMat3::from_quat(turn)
    }

    #[test]
    fn a_thing_on_the_ground_tells_which_way_is_up() {
        let scene = sphere_over_plate(2000);
        for (name, up) in UpAxis::ALL {
            assert_eq!(
                up_from_ground(&turned(&scene, onto(up))),
                Some(up),
                "{name}"
            );
        }
    }

    #[test]
    fn haze_does_not_hide_the_ground() {
        let mut scene = sphere_over_plate(2000);
        let solid = scene.len();
        scene.add(&sphere(300), 40.0, Vec3::ZERO);
        for opacity in &mut scene.opacities[solid..] {
            *opacity = 0.01;
        }
        assert_eq!(up_from_ground(&scene), Some(UpAxis::PlusZ));
    }

    #[test]
    fn things_alone_and_rooms_tell_nothing() {
        assert_eq!(up_from_ground(&sphere(2000)), None);
        let wall = sheet(30);
        let mut room = from_points(&[], &[], 1.0);
        for (_, side) in UpAxis::ALL {
            let wall = turned(&wall, onto(side));
            room.add(&wall, 1.0, -side.direction());
        }
        assert_eq!(up_from_ground(&room), None);
        assert_eq!(up_from_ground(&from_points(&[], &[], 1.0)), None);
        let point = from_points(&[Vec3::ONE], &[Vec3::Z], 0.0);
        assert_eq!(up_from_ground(&point), None);
    }
}
