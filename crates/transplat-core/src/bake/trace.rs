//! Ray tracing against surfel discs: first hits from a surfel towards a direction, and shadow rays.
//!
//! What a ray meets close to its start may be the surface that it leaves. Trained surfaces are stacks of translucent surfels: a ray crosses
//! the members above its own from behind, and what else shines on the surface it would meet on its front. So a crossing from behind counts
//! only beyond the reach of the surfel's own stack, any other one from close by on: the other face of a thin plate is met.

use std::sync::atomic::{AtomicUsize, Ordering};

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x8};
use glam::Vec3;
use rayon::prelude::*;

pub use super::hierarchy::{BoxInOrder, PACKET, Stack};
use super::hierarchy::{Ellipses, Hierarchy, Ray, WIDE, Wide, ellipse_box, thinning};
use super::outward_side::OutwardSides;
use super::scaled::{OCCLUDER_REACH, ScaledObject};
use crate::error::{Error, Result};
use crate::morton::neighborhood_order;
use crate::progress::Progress;
use crate::surfels::SurfelCloud;

/// No surfel: the ray left the object.
pub const MISS: u32 = u32::MAX;

/// Surfels whose rays in one direction follow each other: they meet the same boxes, which are in the cache then.
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
    /// True where it is seen from its front alone.
    pub one_sided: bool,
    /// 0 to 1.
    pub opacity: f32,
}

/// Where a ray starts, and how far from there what it meets counts.
#[derive(Clone, Copy, Debug)]
pub struct RayStart {
    /// Where.
    pub origin: Vec3,
    /// Hits nearer than this do not count.
    pub nearest: f32,
    /// Least distance of discs that are left through their fronts.
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
    /// Index of the surfel.
    pub surfel: u32,
    /// True where the surfel is seen from its front alone.
    pub one_sided: bool,
}

/// The discs of a leaf, side by side.
#[derive(Clone, Copy, Debug)]
struct Discs {
    ellipses: Ellipses,
    surfel: [u32; WIDE],
    /// The cosine of a ray from which on it leaves one that is seen from its front alone.
    front: Wide,
}

/// The discs of an asset in a hierarchy of boxes.
#[derive(Clone, Debug)]
pub struct Tracer {
    hierarchy: Hierarchy,
    /// By leaf.
    discs: Vec<Discs>,
    /// The surfels that rays start from. `[n]`
    pub surfels: Vec<RaySurfel>,
    /// Outward side of each surfel.
    pub outward_sides: OutwardSides,
    /// Indices of the surfels so that neighbours follow each other. `[n]`
    pub order: Vec<u32>,
    /// Rays are traced against every how many-th disc: 1, but where they overlap so much that each would cross thousands.
    pub thinning: usize,
    /// Where these coordinates have their origin, in the asset's.
    pub center: Vec3,
    /// Length of the unit of these coordinates, in the splat's units.
    pub radius: f32,
}

/// First hits of some rays.
#[derive(Clone, Copy, Debug)]
pub struct FirstHits {
    /// The surfel, or [`MISS`].
    pub surfel: [u32; PACKET],
    /// Distances, in units of the object's radius; undefined for rays that stop at anything, and for misses.
    pub distance: [f32; PACKET],
}

impl FirstHits {
    /// Ray by ray.
    pub fn each(&self) -> impl Iterator<Item = (u32, f32)> {
        self.surfel.into_iter().zip(self.distance)
    }
}

impl Tracer {
    /// Builds the hierarchy over the surfels that cast shadows.
    pub fn new(cloud: &SurfelCloud, outward_sides: OutwardSides) -> Self {
        let object = ScaledObject::new(cloud);
        let surfels: Vec<RaySurfel> = (object.surfels.par_iter().enumerate())
            .map(|(i, s)| RaySurfel {
                position: s.position,
                axes: s.axes,
                normal: outward_sides.normal(cloud, i),
                minor: cloud.scales[i].min_element() / object.radius,
                major: cloud.scales[i].max_element() / object.radius,
                one_sided: outward_sides.of[i].is_one_sided(),
                opacity: cloud.opacities[i],
            })
            .collect();
        let casting: Vec<u32> = (0..surfels.len() as u32)
            .filter(|i| surfels[*i as usize].casts())
            .collect();
        let boxes: Vec<_> = casting
            .par_iter()
            .map(|i| ellipse_box(surfels[*i as usize].position, surfels[*i as usize].axes))
            .collect();
        let thinning = thinning(&boxes);
        let casting: Vec<u32> = casting.into_iter().step_by(thinning).collect();
        let boxes: Vec<_> = boxes.into_iter().step_by(thinning).collect();
        let (hierarchy, order) = Hierarchy::new(&boxes);
        Self {
            center: object.center,
            radius: object.radius,
            discs: (hierarchy.leaves().collect::<Vec<_>>().into_par_iter())
                .map(|leaf| {
                    let discs = order[leaf]
                        .iter()
                        .map(|i| disc(casting[*i as usize], &surfels));
                    Discs::of(&discs.collect::<Vec<_>>())
                })
                .collect(),
            hierarchy,
            thinning,
            order: neighborhood_order(&surfels.iter().map(|s| s.position).collect::<Vec<_>>()),
            surfels,
            outward_sides,
        }
    }

    /// Number of boxes.
    pub fn box_count(&self) -> usize {
        self.hierarchy.len()
    }

    /// The boxes, each before those that it holds.
    pub fn boxes_in_order(&self) -> Vec<BoxInOrder> {
        self.hierarchy.boxes_in_order()
    }

    /// The discs, leaf by leaf.
    pub fn discs(&self) -> impl Iterator<Item = Disc> + '_ {
        let surfels = self.discs.iter().flat_map(|discs| discs.surfel);
        let surfels = surfels.filter(|i| *i != MISS);
        surfels.map(|i| disc(i, &self.surfels))
    }

    /// Number of discs.
    pub fn disc_count(&self) -> usize {
        self.hierarchy.things()
    }

    /// The surfel that a ray from each of the surfels `of` (at most [`PACKET`]) meets first, or [`MISS`]; `any`: any surfel that it
    /// meets, which is quicker. `stack` is scratch.
    pub fn hits(&self, of: &[u32], direction: Vec3, any: bool, stack: &mut Stack) -> [u32; PACKET] {
        let starts = of.iter().map(|i| &self.surfels[*i as usize]);
        let rays = starts.map(|surfel| (surfel.start(direction), direction, f32::MAX));
        self.walk(rays, any, stack).surfel
    }

    /// First hits with their distances.
    pub fn met(&self, of: &[u32], direction: Vec3, stack: &mut Stack) -> FirstHits {
        let starts = of.iter().map(|i| &self.surfels[*i as usize]);
        let rays = starts.map(|surfel| (surfel.start(direction), direction, f32::MAX));
        self.walk(rays, false, stack)
    }

    /// First hits, or any, of rays towards a direction that start anywhere in these coordinates; at most [`PACKET`].
    pub fn met_from(
        &self,
        starts: &[RayStart],
        direction: Vec3,
        any: bool,
        stack: &mut Stack,
    ) -> FirstHits {
        let starts = starts.iter().copied();
        self.walk(starts.map(|start| (start, direction, f32::MAX)), any, stack)
    }

    /// Traces shadow rays, [`PACKET`] at most: true for those that reach their ends. Each starts somewhere, goes in a direction of its own (a unit
    /// vector), and ends at a distance; all in these coordinates.
    pub fn unblocked(&self, rays: &[(RayStart, Vec3, f32)], stack: &mut Stack) -> [bool; PACKET] {
        let met = self.walk(rays.iter().copied(), true, stack);
        met.surfel.map(|surfel| surfel == MISS)
    }

    /// Transmittance of a shadow ray through soft surfels, 0 to 1. The ray starts somewhere, goes in a direction (a unit vector), and ends at a
    /// distance; all in these coordinates.
    pub fn transmittance(
        &self,
        start: RayStart,
        direction: Vec3,
        end: f32,
        stack: &mut Stack,
    ) -> f32 {
        dispatch!(Level::new(), simd => transmittance(simd, self, start, direction, end, stack))
    }

    /// Finds the first hits of rays before their ends, or `any` of their hits.
    fn walk(
        &self,
        rays: impl Iterator<Item = (RayStart, Vec3, f32)>,
        any: bool,
        stack: &mut Stack,
    ) -> FirstHits {
        let mut met = FirstHits {
            surfel: [MISS; PACKET],
            distance: [f32::MAX; PACKET],
        };
        let found = met.surfel.iter_mut().zip(&mut met.distance);
        dispatch!(Level::new(), simd => for ((surfel, distance), ray) in found.zip(rays) {
            (*surfel, *distance) = first(simd, self, ray, any, stack);
        });
        met
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

    /// Surfels among the `asked` that see all the way out towards a direction. `[n]`, false for the others
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

/// Works on things of which neighbours follow each other, those together whose rays follow each other.
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

/// Places and normals of some surfels, given the normals of their surface.
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

impl Discs {
    fn of(discs: &[Disc]) -> Self {
        let each = discs.iter().map(|d| (d.center, d.normal, d.inverse_axes));
        let is_one_sided = |k: usize| discs.get(k).is_some_and(|d| d.one_sided);
        let front = |k| if is_one_sided(k) { 0.0 } else { f32::INFINITY };
        Self {
            ellipses: Ellipses::new(each),
            surfel: std::array::from_fn(|k| discs.get(k).map_or(MISS, |d| d.surfel)),
            front: std::array::from_fn(front),
        }
    }
}

/// A shadow ray of which less than this is left is blocked.
const DARK: f32 = 0.01;

/// Distances at which a ray hits the discs of a leaf, infinite where it does not, and squared distances from their centres over their reach.
#[inline(always)]
fn hits_of_leaf<S: Simd>(simd: S, start: &RayStart, discs: &Discs, ray: &Ray<S>) -> [f32x8<S>; 2] {
    let [nearest, behind_stack, none, one] =
        [start.nearest, start.stack, f32::INFINITY, 1.0].map(|v| f32x8::splat(simd, v));
    let hits = discs.ellipses.meet(ray);
    let from_behind = hits.facing.simd_gt(simd.load_array_ref_f32x8(&discs.front));
    let nearest = simd.select_f32x8(from_behind, behind_stack, nearest);
    let counts = hits.distance.simd_gt(nearest) & hits.off.simd_le(one);
    [simd.select_f32x8(counts, hits.distance, none), hits.off]
}

/// Light that is left along a ray, 0 to 1.
#[inline(always)]
fn transmittance<S: Simd>(
    simd: S,
    tracer: &Tracer,
    start: RayStart,
    direction: Vec3,
    end: f32,
    stack: &mut Stack,
) -> f32 {
    let hierarchy = &tracer.hierarchy;
    let ray = Ray::new(simd, start.origin, direction, start.nearest);
    let mut through = 1.0;
    hierarchy.enter(stack);
    while let Some(leaf) = hierarchy.next_leaf(&ray, end, stack) {
        let discs = &tracer.discs[leaf];
        let [hits, off] = hits_of_leaf(simd, &start, discs, &ray);
        if !hits.simd_lt(end).any_true() {
            continue;
        }
        let (hits, off): ([f32; WIDE], [f32; WIDE]) = (hits.into(), off.into());
        for ((distance, off), surfel) in hits.into_iter().zip(off).zip(discs.surfel) {
            if distance < end {
                // Each that is kept lets through what those do together that it stands for.
                let opaque = 1.0
                    - (1.0 - tracer.surfels[surfel as usize].opacity).powi(tracer.thinning as i32);
                let variance = OCCLUDER_REACH * OCCLUDER_REACH * off;
                through *= 1.0 - opaque * (-0.5 * variance).exp();
            }
        }
        if through < DARK {
            return 0.0;
        }
    }
    through
}

/// First hit of a ray before its end, or `any` of its hits, with its distance.
#[inline(always)]
fn first<S: Simd>(
    simd: S,
    tracer: &Tracer,
    (start, direction, mut end): (RayStart, Vec3, f32),
    any: bool,
    stack: &mut Stack,
) -> (u32, f32) {
    let hierarchy = &tracer.hierarchy;
    let ray = Ray::new(simd, start.origin, direction, start.nearest);
    let mut hit = MISS;
    hierarchy.enter(stack);
    while let Some(leaf) = hierarchy.next_leaf(&ray, end, stack) {
        let discs = &tracer.discs[leaf];
        let [hits, _] = hits_of_leaf(simd, &start, discs, &ray);
        if !hits.simd_lt(end).any_true() {
            continue;
        }
        let hits: [f32; WIDE] = hits.into();
        for (distance, surfel) in hits.into_iter().zip(discs.surfel) {
            if distance < end {
                (hit, end) = (surfel, distance);
            }
        }
        if any {
            break;
        }
    }
    (hit, end)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::directional::DirectionalBake;
    use crate::bake::hierarchy::LEAST_FACING;
    use crate::progress::no_progress;
    use crate::sh::lattice;
    use crate::synthetic;

    /// Whether a ray comes to its end, by every disc in turn.
    fn comes_to_its_end(tracer: &Tracer, (start, d, distance): &(RayStart, Vec3, f32)) -> bool {
        let (o, d) = (start.origin.as_dvec3(), d.as_dvec3());
        tracer.discs().all(|disc| {
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

    /// Thinned discs of splats as large as the object block the rays that all of them block, and no others.
    #[test]
    fn thinned_discs_block_what_all_block() {
        let mut cloud = synthetic::sphere(4000);
        assert_eq!(
            Tracer::new(&cloud, OutwardSides::unknown(&cloud)).thinning,
            1
        );
        cloud.scales.fill(glam::Vec2::splat(0.5));
        let tracer = Tracer::new(&cloud, OutwardSides::unknown(&cloud));
        assert!(tracer.thinning > 4, "{}", tracer.thinning);
        assert!(tracer.disc_count() < 1200);
        let is_blocked = |i: u32, d: Vec3| {
            let start = tracer.surfels[i as usize].start(d);
            tracer.surfels.iter().any(|s| {
                let over = s.normal.dot(d);
                let distance = (s.position - start.origin).dot(s.normal) / over;
                let at = start.origin + distance * d - s.position;
                let [u, v] = s.axes.map(|a| at.dot(a) / a.length_squared());
                distance > start.stack && u * u + v * v <= 1.0
            })
        };
        let (mut agree, mut count) = (0, 0);
        for d in lattice(12) {
            for of in tracer.order.chunks(PACKET).step_by(40) {
                let met = tracer.hits(of, d, true, &mut Vec::new());
                for (i, met) in of.iter().zip(met) {
                    agree += u32::from((met != MISS) == is_blocked(*i, d));
                    count += 1;
                }
            }
        }
        // Rays that graze the object meet few.
        assert!(20 * agree > 19 * count, "{agree} of {count}");
    }
}
