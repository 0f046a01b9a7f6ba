//! Up-axis estimation of a capture: by its cameras, by the ground in it, by its stance and the light on it, or by what its kind of file mostly has.

use glam::{DMat4, DVec3, DVec4, Vec3};

use crate::color::luminance;
use crate::sh::SQRT_4PI;
use crate::surfels::{Bounds, SurfelCloud, UpAxis};

/// Surfels that are looked at, at most.
const MOST_SURFELS: usize = 50_000;

/// Opacity below which a surfel is no ground.
const LEAST_OPACITY: f32 = 0.1;

/// Pieces are at most so many radii from the middle.
const FAR: f32 = 2.0;

/// Cosine between an axis and the normals of what lies flat across it.
const FLAT: f32 = 0.9;

/// Thickness of the ground, in the capture's radius.
const THICKNESS: f64 = 0.06;

/// Share of all surface that may lie below the ground: haze, and what shines through.
const MOST_BELOW: f64 = 0.1;

/// Evidence from which on there is ground: its share of all surface times the share above it.
const LEAST_EVIDENCE: f64 = 0.08;

/// Lead over any other plane: a room's walls are planes too.
const LEAST_LEAD: f64 = 2.0;

/// Surfels that the light on a capture is read from, at most.
const MOST_LIT: usize = 3000;

/// Share of the radius within which a surfel's surroundings tell its outward side.
const SURROUNDINGS: f32 = 0.3;

/// Darker colours say little of the light.
const LEAST_COLOR: f32 = 0.02;

/// Fewer cameras may be tilted alike.
const LEAST_CAMERAS: usize = 3;

/// Cosine between an axis and the mean of the cameras' own up from which on it is meant.
const CAMERAS_AGREE: f64 = 0.9;

/// Length of that mean below which they are held all ways; those that look down by 60 degrees from all around have a half.
const CAMERAS_TELL: f64 = 0.4;

/// Evidence of a capture's up axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UpEvidence {
    /// By the ground in it.
    Ground,
    /// By how tall it is, where its light comes from, and what files of its kind mostly have.
    Stance,
}

/// Up axis of a capture whose file has none (`told`), and its evidence. `habit` is the axis that files of its kind mostly have; where they have none,
/// only the ground tells.
pub fn proposed_up(
    cloud: &SurfelCloud,
    told: Option<UpAxis>,
    habit: Option<UpAxis>,
) -> Option<(UpAxis, UpEvidence)> {
    if told.is_some() || cloud.is_empty() {
        return None;
    }
    let by_ground = up_from_ground(cloud).map(|up| (up, UpEvidence::Ground));
    by_ground.or_else(|| Some((up_from_stance(cloud, habit?), UpEvidence::Stance)))
}

/// The axis that is up by how cameras were held, given as [`crate::files::CameraFrame::world_from_camera`]; none where too few say so.
pub fn up_from_cameras(cameras: impl IntoIterator<Item = DMat4>) -> Option<UpAxis> {
    let ups: Vec<DVec3> = (cameras.into_iter())
        .map(|pose| pose.y_axis.truncate().normalize_or_zero())
        .collect();
    // Those that look down from all around lean to all sides, which cancels out.
    let mean = ups.iter().sum::<DVec3>() / ups.len().max(1) as f64;
    if mean.length() < CAMERAS_TELL {
        return None;
    }
    let mean = mean.normalize();
    let along = |up: &UpAxis| mean.dot(up.direction().as_dvec3());
    let up =
        (UpAxis::ALL.map(|(_, up)| up).into_iter()).max_by(|a, b| along(a).total_cmp(&along(b)))?;
    let is_explicit = ups.len() >= LEAST_CAMERAS && along(&up) > CAMERAS_AGREE;
    is_explicit.then_some(up)
}

/// The likeliest axis, by sums of log-odds: of the habit of files, of its stance, of light from above.
fn up_from_stance(cloud: &SurfelCloud, habit: UpAxis) -> UpAxis {
    // Of the axes that are not the usual one, those that tools use are likelier.
    let usual = |up: UpAxis| match up {
        _ if up == habit => 0.5f64,
        UpAxis::PlusZ | UpAxis::PlusY | UpAxis::MinusY => 0.2,
        _ => 0.03,
    };
    let extents = extents(&SurfacePiece::of(cloud, MOST_SURFELS));
    // What is tall stands, and what is flat lies.
    let stance = |up: UpAxis| {
        let along = up.direction().abs().dot(extents);
        let across = (extents.element_product() / along).sqrt();
        let log = f64::from((along / across).ln().clamp(-1.5, 1.5));
        if log > 0.0 { 3.0 * log } else { -2.0 * log }
    };
    let light = light_on(cloud);
    let from_above = |up: UpAxis| 6.0 * f64::from(light.dot(up.direction()));
    let odds = |up: UpAxis| usual(up).ln() + stance(up) + from_above(up);
    let ups = UpAxis::ALL.map(|(_, up)| up);
    let likelier = |a: &UpAxis, b: &UpAxis| odds(*a).total_cmp(&odds(*b));
    ups.into_iter().max_by(likelier).unwrap_or(habit)
}

/// Extents of most of it along each axis; positive.
fn extents(pieces: &[SurfacePiece]) -> Vec3 {
    let each = |axis: usize| {
        let mut values: Vec<f32> = pieces.iter().map(|p| p.position[axis]).collect();
        values.sort_unstable_by(f32::total_cmp);
        let tail = values.len() / 100;
        match (values.get(tail), values.iter().nth_back(tail)) {
            (Some(low), Some(high)) => high - low,
            _ => 0.0,
        }
    };
    let extents = Vec3::from_array(std::array::from_fn(each));
    let least = 1e-3 * extents.max_element();
    extents.max(Vec3::splat(least.max(1e-12)))
}

/// Where the light on a capture comes from, as long as it makes a difference: the slope of the logarithm of its colour over its normals.
fn light_on(cloud: &SurfelCloud) -> Vec3 {
    let pieces = SurfacePiece::of(cloud, MOST_LIT);
    let places: Vec<Vec3> = pieces.iter().map(|p| p.position).collect();
    let reach = SURROUNDINGS * Bounds::of(&places).radius;
    // Not by a few large ones.
    let mut areas: Vec<f64> = pieces.iter().map(|p| p.area).collect();
    areas.sort_unstable_by(f64::total_cmp);
    let most = areas.get(areas.len() * 9 / 10).copied().unwrap_or(1.0);
    let outward = |piece: &SurfacePiece| {
        let around = places.iter().filter(|p| p.distance(piece.position) < reach);
        let (sum, count) = around.fold((Vec3::ZERO, 0.0), |(sum, n), p| (sum + *p, n + 1.0));
        let away = piece.position - sum / f32::max(count, 1.0);
        let side = if piece.normal.dot(away) < 0.0 {
            -1.0
        } else {
            1.0
        };
        side * piece.normal
    };
    let brightness = |piece: &SurfacePiece| {
        let stored = cloud.sh_of(piece.surfel)[0].map(|v| v / SQRT_4PI as f32);
        let color = stored.map(|v| cloud.encoding.decode(v));
        luminance(color).max(LEAST_COLOR).ln()
    };
    // Weighted least squares of a constant and a slope.
    let (mut matrix, mut right) = (DMat4::ZERO, DVec4::ZERO);
    for piece in &pieces {
        let row = outward(piece).extend(1.0).as_dvec4();
        let weight = piece.area.min(most) / most.max(f64::MIN_POSITIVE);
        matrix += DMat4::from_cols(row.x * row, row.y * row, row.z * row, row.w * row) * weight;
        right += row * weight * f64::from(brightness(piece));
    }
    // What lies flat has one slope: none is made up for the others.
    matrix += DMat4::from_diagonal(DVec4::splat(1e-3 * matrix.w_axis.w.max(1e-12)));
    let slope = (matrix.inverse() * right).truncate().as_vec3();
    if slope.is_finite() { slope } else { Vec3::ZERO }
}

/// The axis that points up from the ground, where a capture has one: a thin flat layer, much of its surface, with the rest on one side.
/// None for a thing alone, and where walls are as good.
pub fn up_from_ground(cloud: &SurfelCloud) -> Option<UpAxis> {
    let pieces = SurfacePiece::of(cloud, MOST_SURFELS);
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
struct SurfacePiece {
    position: Vec3,
    normal: Vec3,
    /// Area of its surface.
    area: f64,
    surfel: usize,
}

impl SurfacePiece {
    /// At most so many of a capture.
    fn of(cloud: &SurfelCloud, most: usize) -> Vec<Self> {
        let step = cloud.len().div_ceil(most).max(1);
        let seen = (0..cloud.len()).step_by(step);
        // What floats far outside, or is as large as all of it, is no piece of it.
        let bounds = cloud.bounds();
        let is_of_it = |i: &usize| {
            cloud.positions[*i].distance(bounds.center) <= FAR * bounds.radius
                && cloud.scales[*i].max_element() <= bounds.radius
        };
        seen.filter(|i| cloud.opacities[*i] > LEAST_OPACITY)
            .filter(is_of_it)
            .map(|i| Self {
                position: cloud.positions[i],
                normal: cloud.stored_normal(i),
                area: f64::from(cloud.opacities[i] * cloud.scales[i].element_product()),
                surfel: i,
            })
            .filter(|piece| piece.area.is_finite())
            .collect()
    }
}

/// Share of the surface that lies in the ground, times what is above it less what is below; 0 where too much is.
fn evidence(pieces: &[SurfacePiece], up: UpAxis, radius: f64) -> f64 {
    let up = up.direction();
    let height = |p: &SurfacePiece| f64::from(p.position.dot(up));
    let step = radius * THICKNESS / 2.0;
    let layer_of = |p: &SurfacePiece| (height(p) / step).floor();
    let is_flat = |p: &SurfacePiece| p.normal.dot(up).abs() > FLAT;
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
    use glam::{DMat3, DQuat};

    /// A turn that brings +Z onto an axis.
    fn onto(up: UpAxis) -> DMat3 {
        let turn = DQuat::from_rotation_arc(DVec3::Z, up.direction().as_dvec3());
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
    fn a_tall_thing_in_light_from_above_stands_upright() {
        // Longer than wide, and brighter where it faces up.
        let mut thing = sphere(2000);
        for p in &mut thing.positions {
            p.z *= 2.5;
        }
        let mut lamp = sphere(2000);
        for cloud in [&mut thing, &mut lamp] {
            for i in 0..cloud.len() {
                let up = cloud.stored_normal(i).z * cloud.positions[i].z.signum();
                let up = if cloud.positions[i].z < 0.0 {
                    -up.abs()
                } else {
                    up.abs()
                };
                cloud.sh[i] = [1.0 + 0.6 * up; 3];
            }
        }
        for (name, up) in UpAxis::ALL {
            for cloud in [&thing, &lamp] {
                let turned = turned(cloud, onto(up));
                let found = proposed_up(&turned, None, Some(UpAxis::MinusY));
                assert_eq!(found, Some((up, UpEvidence::Stance)), "{name}");
            }
            // What says nothing stands as files of its kind do.
            let found = proposed_up(&sphere(2000), None, Some(up));
            assert_eq!(found, Some((up, UpEvidence::Stance)), "{name}");
            assert_eq!(proposed_up(&thing, Some(up), Some(UpAxis::PlusZ)), None);
            assert_eq!(proposed_up(&thing, None, None), None);
        }
    }

    #[test]
    fn cameras_that_are_held_level_tell_which_way_is_up() {
        // From all around, looking down by 20 to 60 degrees.
        let camera = |i: usize| {
            let (turn, down) = (0.7 * i as f64, (20.0 + 10.0 * (i % 5) as f64).to_radians());
            let eye = DVec3::new(turn.cos() * down.cos(), turn.sin() * down.cos(), down.sin());
            let right = DVec3::Z.cross(eye).normalize();
            let axes = DMat3::from_cols(right, eye.cross(right), eye);
            DMat4::from_mat3(axes)
        };
        for (name, up) in UpAxis::ALL {
            let turned = |i| DMat4::from_mat3(onto(up)) * camera(i);
            assert_eq!(up_from_cameras((0..40).map(turned)), Some(up), "{name}");
            // A capture that nobody put on an axis, and two cameras, tell nothing.
            let tilt = DMat4::from_quat(DQuat::from_rotation_x(0.7) * DQuat::from_rotation_y(0.6));
            assert_eq!(up_from_cameras((0..40).map(|i| tilt * camera(i))), None);
            assert_eq!(up_from_cameras((0..2).map(turned)), None);
        }
        assert_eq!(up_from_cameras([DMat4::ZERO; 5]), None);
        // Held on their sides, half to the left and half to the right, more or less.
        let on_its_side = |i: usize| {
            let roll = if i.is_multiple_of(2) { 90.0 } else { -80.0f64 };
            camera(i) * DMat4::from_quat(DQuat::from_rotation_z(roll.to_radians()))
        };
        assert_eq!(up_from_cameras((0..40).map(on_its_side)), None);
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
