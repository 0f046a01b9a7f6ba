//! How much of a surfel is seen from a direction: what the surfels between let through, as the camera sees them, translucent and soft.

use glam::Vec3;
use multiversion::multiversion;
use obvhs::aabb::Aabb;

use super::hierarchy::{Hierarchy, LEAST_FACING, Lanes, PACKET, Toward, ellipse_box, meet_plane};
use super::scaled::ScaledObject;
use crate::morton::neighborhood_order;
use crate::surfels::SurfelCloud;

/// A surfel ends where its opacity falls below this: many that are fainter make a surface together, and each costs time.
pub(crate) const LEAST_OPACITY: f32 = 0.1;

/// It never reaches farther than this many standard deviations.
pub(crate) const MOST_REACH: f32 = 2.0;

/// A ray of which less than this is left is done.
const DARK: f32 = 0.01;

/// A surfel with its soft rim.
#[derive(Clone, Copy, Debug)]
struct Veil {
    center: Vec3,
    normal: Vec3,
    /// Unit tangents over the standard deviations.
    inverse_axes: [Vec3; 2],
    opacity: f32,
    /// Squared standard deviations at which it ends.
    reach_squared: f32,
    surfel: u32,
}

/// The surfels of an asset as a camera sees them, in a hierarchy of boxes.
#[derive(Clone, Debug)]
pub(super) struct Veils {
    hierarchy: Hierarchy,
    veils: Vec<Veil>,
    /// Centres in units of the object's radius. `[n]`
    pub positions: Vec<Vec3>,
    /// What 1 in these units is, in scene units.
    pub radius: f32,
    /// Indices of the surfels so that neighbours follow each other. `[n]`
    pub order: Vec<u32>,
}

impl Veils {
    /// Builds the hierarchy.
    pub fn new(cloud: &SurfelCloud) -> Self {
        let object = ScaledObject::new(cloud);
        let positions: Vec<Vec3> = object.surfels.iter().map(|s| s.position).collect();
        let (all, boxes): (Vec<Veil>, Vec<Aabb>) = (0..cloud.len())
            .filter_map(|i| {
                let opacity = cloud.opacities[i];
                let [u, v] = cloud.tangents[i];
                let scale = cloud.scales[i] / object.radius;
                let reach_squared =
                    (2.0 * (opacity / LEAST_OPACITY).ln()).min(MOST_REACH * MOST_REACH);
                // A line or a point covers nothing.
                if reach_squared.is_nan() || reach_squared <= 0.0 || scale.min_element() < 1e-9 {
                    return None;
                }
                let reach = reach_squared.sqrt();
                let axes = [u * (scale.x * reach), v * (scale.y * reach)];
                let veil = Veil {
                    center: positions[i],
                    normal: u.cross(v),
                    inverse_axes: [u / scale.x, v / scale.y],
                    opacity,
                    reach_squared,
                    surfel: i as u32,
                };
                Some((veil, ellipse_box(positions[i], axes)))
            })
            .unzip();
        let (hierarchy, order) = Hierarchy::new(&boxes);
        Self {
            hierarchy,
            veils: order.iter().map(|i| all[*i as usize]).collect(),
            order: neighborhood_order(&positions),
            radius: object.radius,
            positions,
        }
    }

    /// What of the light from a direction far away reaches the centres of the surfels `of`, at most [`PACKET`], 0 to 1. `stack` is scratch.
    pub fn transmittance(
        &self,
        of: &[u32],
        direction: Vec3,
        stack: &mut Vec<u32>,
    ) -> [f32; PACKET] {
        let of = std::array::from_fn(|lane| of[lane.min(of.len() - 1)]);
        transmittance(self, &of, direction, stack)
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn transmittance(
    veils: &Veils,
    of: &[u32; PACKET],
    d: Vec3,
    stack: &mut Vec<u32>,
) -> [f32; PACKET] {
    let mut origin = [[0f32; PACKET]; 3];
    for lane in 0..PACKET {
        for axis in 0..3 {
            origin[axis][lane] = veils.positions[of[lane] as usize][axis];
        }
    }
    let toward = Toward::new(d);
    let mut farthest: Lanes = [f32::MAX; PACKET];
    let mut through = [1f32; PACKET];
    let hierarchy = &veils.hierarchy;
    hierarchy.enter(stack);
    while let Some(inside) = hierarchy.next_leaf(&origin, &toward, &farthest, stack) {
        for veil in &veils.veils[inside] {
            let facing = veil.normal.dot(d);
            if facing.abs() < LEAST_FACING {
                continue;
            }
            let ellipse = (veil.center, veil.normal, veil.inverse_axes);
            let (t, off) = meet_plane(&origin, d, facing, ellipse);
            for i in 0..PACKET {
                // exp(-off / 2) to 2 % of the peak, without the exponential.
                let mut falloff = 1.0 - off[i] * (1.0 / 32.0);
                for _ in 0..4 {
                    falloff *= falloff;
                }
                let met = (off[i] <= veil.reach_squared) & (t[i] > 0.0) & (of[i] != veil.surfel);
                through[i] *= 1.0 - if met { veil.opacity * falloff } else { 0.0 };
                farthest[i] = if through[i] < DARK { -1.0 } else { farthest[i] };
            }
        }
    }
    through
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle;
    use crate::synthetic;

    #[test]
    fn it_is_what_all_surfels_between_let_through() {
        let mut cloud = synthetic::sphere_over_plate(300);
        for (i, o) in cloud.opacities.iter_mut().enumerate() {
            *o = 0.05 + 0.9 * ((i * 7 % 11) as f32 / 11.0);
            // No two in one plane: either may be in front of the other.
            cloud.positions[i].z += 0.02 * ((i * 5 % 13) as f32 / 13.0);
        }
        let veils = Veils::new(&cloud);
        let mut stack = Vec::new();
        let (mut off, mut far, mut count) = (0f64, 0, 0);
        for d in [Vec3::Z, Vec3::new(0.48, -0.6, 0.64), -Vec3::Y] {
            for of in veils.order.chunks(PACKET) {
                let through = veils.transmittance(of, d, &mut stack);
                for (i, got) in of.iter().zip(through) {
                    let exact = oracle::transmittance(&cloud, *i as usize, d.as_dvec3());
                    let error = (f64::from(got) - exact).abs();
                    off += error;
                    far += usize::from(error > 0.2);
                    count += 1;
                }
            }
        }
        // The falloff is off by 2 %; what passes a rim may round to either side of it.
        assert!(off < 0.01 * f64::from(count), "{}", off / f64::from(count));
        assert!(far * 100 < count as usize, "{far} of {count}");
    }
}
