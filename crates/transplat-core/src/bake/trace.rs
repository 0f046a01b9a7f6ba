//! Rays against the discs of an asset: which surfel a ray from a surfel towards a direction meets first.
//!
//! What a ray meets close to its start may be the surface that it leaves. Trained surfaces are stacks of translucent surfels: a ray crosses
//! the members above its own from behind, and what else shines on the surface it would meet on its front. So a crossing from behind counts
//! only beyond the reach of the surfel's own stack, any other one from close by on: the other face of a thin plate is met.

use std::sync::atomic::{AtomicUsize, Ordering};

use glam::Vec3;
use multiversion::multiversion;
use rayon::prelude::*;

use super::front::Fronts;
pub use super::hierarchy::{BoxInOrder, PACKET};
use super::hierarchy::{
    Hierarchy, LEAST_FACING, Lanes, Toward, Ways, ellipse_box, lanes, meet_plane,
};
use super::scaled::ScaledObject;
use crate::error::{Error, Result};
use crate::morton::neighborhood_order;
use crate::progress::Progress;
use crate::surfels::SurfelCloud;

/// No surfel: the ray left the object.
pub const MISS: u32 = u32::MAX;

/// Surfels whose rays are packed together.
const NEIGHBORHOOD: usize = 16 * PACKET;

/// A ray starts this many of its surfel's smaller standard deviations off the surface.
pub const START_SCALES: f32 = 0.3;

/// Hits nearer than this many of the surfel's smaller standard deviations do not count.
pub const NEAREST_SCALES: f32 = 1.0;

/// From the front, discs that are left through their fronts belong to the surfel's own stack if they are nearer than this many of its larger
/// standard deviations.
pub const STACK_SCALES: f32 = 2.5;

/// A surfel as rays see it, in units of the object's radius around its centre.
#[derive(Clone, Copy, Debug)]
pub struct RaySurfel {
    /// Centre.
    pub position: Vec3,
    /// Half axes of the disc that casts a shadow; zero where it casts none.
    pub axes: [Vec3; 2],
    /// Unit normal, towards the front.
    pub normal: Vec3,
    /// Smaller standard deviation.
    pub minor: f32,
    /// Larger standard deviation.
    pub major: f32,
    /// Whether it is seen from its front alone.
    pub one_sided: bool,
}

/// Where a ray starts, and how far from there what it meets counts.
#[derive(Clone, Copy, Debug)]
pub struct RayStart {
    /// Where.
    pub origin: Vec3,
    /// Hits nearer than this do not count.
    pub nearest: f32,
    /// The same of discs that are left through their fronts.
    pub stack: f32,
}

impl RaySurfel {
    /// The start of its ray towards a direction.
    pub fn start(&self, direction: Vec3) -> RayStart {
        let in_front = self.normal.dot(direction) >= 0.0;
        let side = if in_front { 1.0 } else { -1.0 };
        let nearest = NEAREST_SCALES * self.minor;
        let stack = STACK_SCALES * self.major;
        RayStart {
            origin: self.position + self.normal * (side * START_SCALES * self.minor),
            nearest,
            stack: if in_front { stack } else { nearest },
        }
    }

    fn casts(&self) -> bool {
        self.axes[0] != Vec3::ZERO && self.axes[1] != Vec3::ZERO
    }
}

/// A disc that casts a shadow.
#[derive(Clone, Copy, Debug)]
pub struct Disc {
    /// Its middle.
    pub center: Vec3,
    /// Unit normal, towards the front.
    pub normal: Vec3,
    /// Half axes over their squared lengths: the disc is where `u^2 + v^2 <= 1`.
    pub inverse_axes: [Vec3; 2],
    /// Which surfel it is of.
    pub surfel: u32,
    /// Whether that is seen from its front alone.
    pub one_sided: bool,
}

/// The discs of an asset in a hierarchy of boxes.
#[derive(Clone, Debug)]
pub struct Tracer {
    hierarchy: Hierarchy,
    /// Leaf by leaf.
    pub discs: Vec<Disc>,
    /// The surfels that rays start from. `[n]`
    pub surfels: Vec<RaySurfel>,
    /// Which side of each is its front.
    pub fronts: Fronts,
    /// Indices of the surfels so that neighbours follow each other. `[n]`
    pub order: Vec<u32>,
    /// Where these coordinates have their origin, in the asset's.
    pub center: Vec3,
    /// What 1 in these coordinates is, in the asset's units.
    pub radius: f32,
}

/// What the rays of a packet met first.
#[derive(Clone, Copy, Debug)]
pub struct Met {
    /// The surfel, or [`MISS`].
    pub surfel: [u32; PACKET],
    /// How far away, in units of the object's radius; of rays that stop at anything, and of those that miss, it says nothing.
    pub distance: [f32; PACKET],
}

impl Met {
    /// Ray by ray.
    pub fn each(&self) -> impl Iterator<Item = (u32, f32)> {
        self.surfel.into_iter().zip(self.distance)
    }
}

/// The origins of [`PACKET`] rays of one direction.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Packet {
    origin: [Lanes; 3],
    /// Hits nearer than this do not count.
    nearest: Lanes,
    /// The same of discs that are left through their fronts.
    stack: Lanes,
}

impl Packet {
    /// At most [`PACKET`] rays; the last one fills what is left.
    fn new(count: usize, start: impl Fn(usize) -> RayStart) -> Self {
        let mut packet = Self {
            origin: [[0.0; PACKET]; 3],
            nearest: [0.0; PACKET],
            stack: [0.0; PACKET],
        };
        for lane in 0..PACKET {
            let start = start(lane.min(count - 1));
            for axis in 0..3 {
                packet.origin[axis][lane] = start.origin[axis];
            }
            packet.nearest[lane] = start.nearest;
            packet.stack[lane] = start.stack;
        }
        packet
    }

    /// Those of the surfels `of`.
    fn from_surfels(surfels: &[RaySurfel], of: &[u32], direction: Vec3) -> Self {
        Self::new(of.len(), |i| surfels[of[i] as usize].start(direction))
    }
}

impl Tracer {
    /// Builds the hierarchy over the surfels that cast shadows.
    pub fn new(cloud: &SurfelCloud, fronts: Fronts) -> Self {
        let object = ScaledObject::new(cloud);
        let surfels: Vec<RaySurfel> = (object.surfels.iter().enumerate())
            .map(|(i, s)| RaySurfel {
                position: s.position,
                axes: s.axes,
                normal: fronts.normal(cloud, i),
                minor: cloud.scales[i].min_element() / object.radius,
                major: cloud.scales[i].max_element() / object.radius,
                one_sided: fronts.of[i].is_one_sided(),
            })
            .collect();
        let casting: Vec<u32> = (0..surfels.len() as u32)
            .filter(|i| surfels[*i as usize].casts())
            .collect();
        let boxes: Vec<_> = casting
            .iter()
            .map(|i| ellipse_box(surfels[*i as usize].position, surfels[*i as usize].axes))
            .collect();
        let (hierarchy, order) = Hierarchy::new(&boxes);
        Self {
            center: object.center,
            radius: object.radius,
            hierarchy,
            discs: order
                .iter()
                .map(|i| disc(casting[*i as usize], &surfels))
                .collect(),
            order: neighborhood_order(&surfels.iter().map(|s| s.position).collect::<Vec<_>>()),
            surfels,
            fronts,
        }
    }

    /// How many boxes there are.
    pub fn box_count(&self) -> usize {
        self.hierarchy.len()
    }

    /// The boxes, each before those that it holds.
    pub fn boxes_in_order(&self) -> Vec<BoxInOrder> {
        self.hierarchy.boxes_in_order()
    }

    /// The surfel that a ray from each of the surfels `of` (at most [`PACKET`]) meets first, or [`MISS`]; `any`: any surfel that it
    /// meets, which is quicker. `stack` is scratch.
    pub fn hits(
        &self,
        of: &[u32],
        direction: Vec3,
        any: bool,
        stack: &mut Vec<u32>,
    ) -> [u32; PACKET] {
        let packet = Packet::from_surfels(&self.surfels, of, direction);
        walk(self, &packet, direction, any, stack).surfel
    }

    /// The same with how far away the surfels are that are met first.
    pub fn met(&self, of: &[u32], direction: Vec3, stack: &mut Vec<u32>) -> Met {
        let packet = Packet::from_surfels(&self.surfels, of, direction);
        walk(self, &packet, direction, false, stack)
    }

    /// What rays towards a direction meet first, or at all, that start anywhere, in these coordinates; at most [`PACKET`].
    pub fn met_from(
        &self,
        starts: &[RayStart],
        direction: Vec3,
        any: bool,
        stack: &mut Vec<u32>,
    ) -> Met {
        let packet = Packet::new(starts.len(), |i| starts[i]);
        walk(self, &packet, direction, any, stack)
    }

    /// Which rays, [`PACKET`] at most, come to their ends without meeting a surfel: each starts somewhere, goes in a direction of its own (a unit
    /// vector), and ends at a distance; all in these coordinates.
    pub fn unblocked(
        &self,
        rays: &[(RayStart, Vec3, f32)],
        stack: &mut Vec<u32>,
    ) -> [bool; PACKET] {
        if rays.is_empty() {
            return [true; PACKET];
        }
        let packet = Packet::new(rays.len(), |i| rays[i].0);
        let ray = |lane: usize| &rays[lane.min(rays.len() - 1)];
        let direction = std::array::from_fn(|axis| lanes(|lane| ray(lane).1[axis]));
        let ends = lanes(|lane| ray(lane).2);
        walk_to(self, &packet, &Ways::new(direction), ends, stack)
    }

    /// A ball that holds where the rays of some surfels start: its middle and its radius, in these coordinates.
    pub(super) fn ball_of_starts(&self, of: &[u32]) -> (Vec3, f32) {
        let surfels = || of.iter().map(|i| &self.surfels[*i as usize]);
        let sum: Vec3 = surfels().map(|s| s.position).sum();
        let middle = sum / of.len().max(1) as f32;
        let reach = |s: &RaySurfel| s.position.distance(middle) + START_SCALES * s.minor;
        (middle, surfels().map(reach).fold(0.0, f32::max))
    }

    /// A ball that holds all that casts a shadow: its middle and its radius, in these coordinates.
    pub fn reach(&self) -> (Vec3, f32) {
        let casting = || self.surfels.iter().filter(|s| s.casts());
        let [low, high] = casting().fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], s| {
            [low.min(s.position), high.max(s.position)]
        });
        let middle = 0.5 * (low + high);
        let farthest = |r: f32, s: &RaySurfel| {
            let [a, b] = s.axes.map(Vec3::length);
            r.max(s.position.distance(middle) + a.max(b))
        };
        if low.x > high.x {
            return (Vec3::ZERO, 0.0);
        }
        (middle, casting().fold(0.0, farthest))
    }

    /// Which surfels of those that are `asked` see all the way out towards a direction. `[n]`, false for the others
    pub fn open_towards(&self, direction: Vec3, asked: impl Fn(u32) -> bool) -> Vec<bool> {
        let of: Vec<u32> = self.order.iter().copied().filter(|i| asked(*i)).collect();
        let packets: Vec<[u32; PACKET]> = of
            .par_chunks(PACKET)
            .map_init(Vec::new, |stack, of| self.hits(of, direction, true, stack))
            .collect();
        let mut open = vec![false; self.surfels.len()];
        for (of, hits) in of.chunks(PACKET).zip(packets) {
            for (surfel, hit) in of.iter().zip(hits) {
                open[*surfel as usize] = hit == MISS;
            }
        }
        open
    }
}

/// Works on things of which neighbours follow each other, those together whose rays are packed together.
///
/// # Errors
/// [`Error::Cancelled`] when `progress` asked for it.
pub(super) fn by_neighborhood<T: Send>(
    all: &mut [T],
    progress: Progress<'_>,
    work: impl Fn(&mut [T]) + Sync,
) -> Result<()> {
    let (count, done) = (all.len(), AtomicUsize::new(0));
    all.par_chunks_mut(NEIGHBORHOOD).try_for_each(|some| {
        let so_far = done.fetch_add(some.len(), Ordering::Relaxed);
        if progress(so_far as f64 / count as f64).is_break() {
            return Err(Error::Cancelled);
        }
        work(some);
        Ok(())
    })
}

/// Place and normal, in units in which both tell alike which surfels are of one surface.
pub(crate) type PlaceAndNormal = [f32; 6];

/// Those of some surfels, of whose surface the normals are given.
pub(crate) fn places_and_normals(surfels: &[RaySurfel], normals: &[Vec3]) -> Vec<PlaceAndNormal> {
    let mean_size: f32 = surfels.iter().map(|s| s.major).sum::<f32>() / surfels.len().max(1) as f32;
    let unit = 1.0 / (3.0 * mean_size).max(1e-12);
    let of_surfel = |(s, n): (&RaySurfel, &Vec3)| {
        let (p, n) = (s.position * unit, *n * 2.0);
        [p.x, p.y, p.z, n.x, n.y, n.z]
    };
    surfels.iter().zip(normals).map(of_surfel).collect()
}

fn disc(i: u32, surfels: &[RaySurfel]) -> Disc {
    let s = &surfels[i as usize];
    Disc {
        center: s.position,
        normal: s.normal,
        inverse_axes: s.axes.map(|a| a / a.length_squared()),
        surfel: i,
        one_sided: s.one_sided,
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn walk(tracer: &Tracer, packet: &Packet, d: Vec3, any: bool, stack: &mut Vec<u32>) -> Met {
    let toward = Toward::new(d);
    let mut farthest: Lanes = [f32::MAX; PACKET];
    let mut hit = [MISS; PACKET];
    let hierarchy = &tracer.hierarchy;
    hierarchy.enter(stack);
    while let Some(discs) = hierarchy.next_leaf(&packet.origin, &toward, &farthest, stack) {
        for disc in &tracer.discs[discs] {
            let facing = disc.normal.dot(d);
            if facing.abs() < LEAST_FACING {
                continue;
            }
            let leaves = disc.one_sided && facing > 0.0;
            let ellipse = (disc.center, disc.normal, disc.inverse_axes);
            let (t, outside) = meet_plane(&packet.origin, d, facing, ellipse);
            for i in 0..PACKET {
                let nearest = if leaves {
                    packet.stack[i]
                } else {
                    packet.nearest[i]
                };
                let met = (outside[i] <= 1.0) & (t[i] > nearest) & (t[i] < farthest[i]);
                // A ray that has met anything is done: no box is nearer than its start.
                let end = if any { -1.0 } else { t[i] };
                farthest[i] = if met { end } else { farthest[i] };
                hit[i] = if met { disc.surfel } else { hit[i] };
            }
        }
    }
    Met {
        surfel: hit,
        distance: farthest,
    }
}

/// Which rays come to their ends.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn walk_to(
    tracer: &Tracer,
    packet: &Packet,
    ways: &Ways,
    mut farthest: Lanes,
    stack: &mut Vec<u32>,
) -> [bool; PACKET] {
    let mut open = [true; PACKET];
    let ([ox, oy, oz], [dx, dy, dz]) = (&packet.origin, &ways.direction);
    let hierarchy = &tracer.hierarchy;
    hierarchy.enter(stack);
    while let Some(discs) = hierarchy.next_leaf_on(&packet.origin, ways, &farthest, stack) {
        for disc in &tracer.discs[discs] {
            let (c, n, [a, b]) = (disc.center, disc.normal, disc.inverse_axes);
            let (cn, ca, cb) = (c.dot(n), c.dot(a), c.dot(b));
            for i in 0..PACKET {
                let facing = n.x * dx[i] + n.y * dy[i] + n.z * dz[i];
                let t = (cn - (ox[i] * n.x + oy[i] * n.y + oz[i] * n.z)) / facing;
                let [x, y, z] = [ox[i] + t * dx[i], oy[i] + t * dy[i], oz[i] + t * dz[i]];
                let u = x * a.x + y * a.y + z * a.z - ca;
                let v = x * b.x + y * b.y + z * b.z - cb;
                let leaves = disc.one_sided & (facing > 0.0);
                let nearest = if leaves {
                    packet.stack[i]
                } else {
                    packet.nearest[i]
                };
                let met = (facing.abs() >= LEAST_FACING)
                    & (u * u + v * v <= 1.0)
                    & (t > nearest)
                    & (t < farthest[i]);
                // A ray that has met anything is done: no box is nearer than its start.
                farthest[i] = if met { -1.0 } else { farthest[i] };
                open[i] &= !met;
            }
        }
    }
    open
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::directional::DirectionalBake;
    use crate::progress::no_progress;
    use crate::synthetic;

    /// Whether a ray comes to its end, by every disc in turn.
    fn comes_to_its_end(tracer: &Tracer, (start, d, distance): &(RayStart, Vec3, f32)) -> bool {
        let (o, d) = (start.origin.as_dvec3(), d.as_dvec3());
        tracer.discs.iter().all(|disc| {
            let (c, n) = (disc.center.as_dvec3(), disc.normal.as_dvec3());
            let facing = n.dot(d);
            let leaves = disc.one_sided && facing > 0.0;
            let nearest = f64::from(if leaves { start.stack } else { start.nearest });
            let t = (c - o).dot(n) / facing;
            let from = o + t * d - c;
            let outside: f64 = (disc.inverse_axes.iter())
                .map(|axis| from.dot(axis.as_dvec3()).powi(2))
                .sum();
            let met = outside <= 1.0 && t > nearest && t < f64::from(*distance);
            facing.abs() < f64::from(LEAST_FACING) || !met
        })
    }

    #[test]
    fn rays_of_all_directions_end_where_every_disc_in_turn_says() {
        let cloud = synthetic::sphere_over_slab(400);
        let tracer = DirectionalBake::tracer(&cloud, &no_progress).expect("not cancelled");
        let (mut differ, mut blocked, mut all) = (0, 0, 0);
        for end in [
            Vec3::Z * 0.9,
            Vec3::new(0.6, -0.3, 0.1),
            Vec3::splat(1e3),
            Vec3::ZERO,
        ] {
            for of in tracer.order.chunks(7) {
                let ray = |i: &u32| {
                    let surfel = &tracer.surfels[*i as usize];
                    let (direction, distance) = (end - surfel.position).normalize_and_length();
                    (surfel.start(direction), direction, distance)
                };
                let rays: Vec<_> = of.iter().map(ray).collect();
                let found = tracer.unblocked(&rays, &mut Vec::new());
                for (ray, found) in rays.iter().zip(found) {
                    let exact = comes_to_its_end(&tracer, ray);
                    differ += usize::from(exact != found);
                    blocked += usize::from(!exact);
                    all += 1;
                }
            }
        }
        // A ray may pass an edge by less than f32 tells.
        assert!(differ * 1000 <= all, "{differ} of {all}");
        assert!(
            blocked * 5 > all && blocked * 5 < 4 * all,
            "{blocked} of {all}"
        );
    }
}
