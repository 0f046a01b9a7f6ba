//! Rays against the discs of an asset: which surfel a ray from a surfel towards a direction meets first.
//!
//! Rays of one direction from [`PACKET`] surfels that are neighbours walk the hierarchy together: they meet the same boxes and
//! the same discs, and everything that depends on the direction alone is computed once for all of them.

use glam::{Vec3, Vec3A};
use multiversion::multiversion;
use obvhs::aabb::Aabb;
use obvhs::bvh2::Bvh2;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};
use rayon::prelude::*;

use super::{BakeSurfel, ScaledObject};
use crate::surfels::SurfelCloud;

/// Rays that are traced together.
pub const PACKET: usize = 16;

/// No surfel: the ray left the object.
pub const MISS: u32 = u32::MAX;

/// A ray starts this many of its surfel's standard deviations off the surface.
pub const START_SCALES: f32 = 0.3;

/// Hits nearer than this many of the surfel's standard deviations are its own neighbours.
pub const NEAREST_SCALES: f32 = 2.5;

/// Discs in a leaf of the hierarchy, at most.
const LEAF: u32 = 4;

/// A disc that casts a shadow.
#[derive(Clone, Copy, Debug)]
pub struct Disc {
    /// Its middle.
    pub center: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Half axes over their squared lengths: the disc is where `u^2 + v^2 <= 1`.
    pub inverse_axes: [Vec3; 2],
    /// Which surfel it is of.
    pub surfel: u32,
}

/// A node: the box, and its two children from `first` on, or `count` discs.
#[derive(Clone, Copy, Debug)]
struct Node {
    min: Vec3,
    max: Vec3,
    first: u32,
    count: u32,
}

/// A box of the hierarchy in an order that needs no stack: whatever meets the box goes on with the next one, and whatever does not, with
/// number `skip`.
#[derive(Clone, Copy, Debug)]
pub struct BoxInOrder {
    /// Corner.
    pub min: Vec3,
    /// The opposite one.
    pub max: Vec3,
    /// What follows all that is in the box.
    pub skip: u32,
    /// First of the discs in it.
    pub first: u32,
    /// How many discs are in it; 0 where it holds boxes.
    pub count: u32,
}

/// The discs of an asset in a hierarchy of boxes.
#[derive(Clone, Debug)]
pub struct Tracer {
    nodes: Vec<Node>,
    /// Leaf by leaf.
    pub discs: Vec<Disc>,
    /// The surfels that rays start from, in units of the object's radius. `[n]`
    pub surfels: Vec<BakeSurfel>,
    /// Indices of the surfels so that neighbours follow each other. `[n]`
    pub order: Vec<u32>,
}

/// The origins of [`PACKET`] rays of one direction.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
struct Packet {
    origin: [[f32; PACKET]; 3],
    /// Hits nearer than this do not count.
    nearest: [f32; PACKET],
}

impl Packet {
    /// Rays from the surfels `of`, at most [`PACKET`]; the last one fills what is left.
    fn new(surfels: &[BakeSurfel], of: &[u32], direction: Vec3) -> Self {
        let mut packet = Self {
            origin: [[0.0; PACKET]; 3],
            nearest: [0.0; PACKET],
        };
        for lane in 0..PACKET {
            let surfel = &surfels[of[lane.min(of.len() - 1)] as usize];
            let side = surfel.normal.dot(direction).signum();
            let origin = surfel.position + surfel.normal * (side * START_SCALES * surfel.bias);
            for axis in 0..3 {
                packet.origin[axis][lane] = origin[axis];
            }
            packet.nearest[lane] = NEAREST_SCALES * surfel.bias;
        }
        packet
    }
}

impl Tracer {
    /// Builds the hierarchy over the surfels that cast shadows.
    pub fn new(cloud: &SurfelCloud) -> Self {
        let surfels = ScaledObject::new(cloud).surfels;
        let casting: Vec<u32> = (0..surfels.len() as u32)
            .filter(|i| casts(&surfels[*i as usize]))
            .collect();
        let boxes: Vec<Aabb> = casting
            .iter()
            .map(|i| disc_box(&surfels[*i as usize]))
            .collect();
        let bvh = build(&boxes);
        let discs = bvh
            .primitive_indices
            .iter()
            .map(|i| disc(casting[*i as usize], &surfels))
            .collect();
        let nodes = bvh
            .nodes
            .iter()
            .map(|n| Node {
                min: n.aabb.min.into(),
                max: n.aabb.max.into(),
                first: n.first_index,
                count: n.prim_count,
            })
            .collect();
        let mut keyed: Vec<(u32, u32)> = surfels
            .iter()
            .map(|s| morton(s.position))
            .zip(0..)
            .collect();
        keyed.sort_unstable();
        Self {
            nodes,
            discs,
            order: keyed.into_iter().map(|k| k.1).collect(),
            surfels,
        }
    }

    /// How many boxes there are.
    pub fn box_count(&self) -> usize {
        self.nodes.len()
    }

    /// The boxes, each before those that it holds.
    pub fn boxes_in_order(&self) -> Vec<BoxInOrder> {
        let mut out: Vec<BoxInOrder> = Vec::with_capacity(self.nodes.len());
        // A node, or the end of one that holds others.
        enum Step {
            Enter(u32),
            Leave(usize),
        }
        let mut steps = Vec::new();
        if !self.nodes.is_empty() {
            steps.push(Step::Enter(0));
        }
        while let Some(step) = steps.pop() {
            match step {
                Step::Leave(place) => out[place].skip = out.len() as u32,
                Step::Enter(index) => {
                    let node = &self.nodes[index as usize];
                    if node.count == 0 {
                        steps.push(Step::Leave(out.len()));
                        steps.extend([node.first + 1, node.first].map(Step::Enter));
                    }
                    out.push(BoxInOrder {
                        min: node.min,
                        max: node.max,
                        skip: out.len() as u32 + 1,
                        first: node.first,
                        count: node.count,
                    });
                }
            }
        }
        out
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
        let packet = Packet::new(&self.surfels, of, direction);
        walk(self, &packet, direction, any, stack)
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

fn casts(surfel: &BakeSurfel) -> bool {
    surfel.axes[0] != Vec3::ZERO && surfel.axes[1] != Vec3::ZERO
}

fn build(boxes: &[Aabb]) -> Bvh2 {
    let indices = (0..boxes.len() as u32).collect();
    let mut bvh = PlocBuilder::new().build(
        PlocSearchDistance::High,
        boxes,
        indices,
        SortPrecision::U64,
        0,
    );
    obvhs::bvh2::leaf_collapser::collapse(&mut bvh, LEAF, 1.0);
    bvh
}

fn disc_box(surfel: &BakeSurfel) -> Aabb {
    let [a, b] = surfel.axes;
    let half = Vec3::from_array(std::array::from_fn(|i| a[i].hypot(b[i])));
    Aabb {
        min: Vec3A::from(surfel.position - half),
        max: Vec3A::from(surfel.position + half),
    }
}

fn disc(i: u32, surfels: &[BakeSurfel]) -> Disc {
    let s = &surfels[i as usize];
    Disc {
        center: s.position,
        normal: s.normal,
        inverse_axes: s.axes.map(|a| a / a.length_squared()),
        surfel: i,
    }
}

/// The position's bits interleaved, ten an axis; the object lies in the unit ball.
fn morton(p: Vec3) -> u32 {
    let spread = |v: f32| {
        let mut x = ((v * 0.5 + 0.5).clamp(0.0, 1.0) * 1023.0) as u32;
        x = (x | (x << 16)) & 0x0300_00ff;
        x = (x | (x << 8)) & 0x0300_f00f;
        x = (x | (x << 4)) & 0x030c_30c3;
        (x | (x << 2)) & 0x0924_9249
    };
    spread(p.x) | (spread(p.y) << 1) | (spread(p.z) << 2)
}

type Lanes = [f32; PACKET];

#[inline(always)]
fn lanes(f: impl Fn(usize) -> f32) -> Lanes {
    let mut out = [0.0; PACKET];
    for i in 0..PACKET {
        out[i] = f(i);
    }
    out
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn walk(
    tracer: &Tracer,
    packet: &Packet,
    d: Vec3,
    any: bool,
    stack: &mut Vec<u32>,
) -> [u32; PACKET] {
    // A direction along an axis never divides by zero.
    let inverse = d.to_array().map(|v| {
        let tiny = 1e-12f32.copysign(v);
        1.0 / if v.abs() < 1e-12 { tiny } else { v }
    });
    let [ox, oy, oz] = packet.origin;
    let mut farthest: Lanes = [f32::MAX; PACKET];
    let mut hit = [MISS; PACKET];
    stack.clear();
    if !tracer.nodes.is_empty() {
        stack.push(0);
    }
    while let Some(index) = stack.pop() {
        let node = &tracer.nodes[index as usize];
        if !meets(node, &packet.origin, &inverse, &farthest) {
            continue;
        }
        if node.count == 0 {
            let [a, b] = [node.first, node.first + 1];
            let middle = |i: u32| {
                let n = &tracer.nodes[i as usize];
                (n.min + n.max).dot(d)
            };
            // The nearer one is looked at first.
            if middle(a) < middle(b) {
                stack.extend([b, a]);
            } else {
                stack.extend([a, b]);
            }
            continue;
        }
        for disc in &tracer.discs[node.first as usize..][..node.count as usize] {
            let facing = disc.normal.dot(d);
            if facing.abs() < 1e-6 {
                continue;
            }
            let over = 1.0 / facing;
            let (n, [a, b], c) = (disc.normal, disc.inverse_axes, disc.center);
            let (da, db) = (d.dot(a), d.dot(b));
            let (cn, ca, cb) = (c.dot(n), c.dot(a), c.dot(b));
            let t = lanes(|i| (cn - (ox[i] * n.x + oy[i] * n.y + oz[i] * n.z)) * over);
            let outside = lanes(|i| {
                let u = ox[i] * a.x + oy[i] * a.y + oz[i] * a.z - ca + t[i] * da;
                let v = ox[i] * b.x + oy[i] * b.y + oz[i] * b.z - cb + t[i] * db;
                u * u + v * v
            });
            for i in 0..PACKET {
                let met = (outside[i] <= 1.0) & (t[i] > packet.nearest[i]) & (t[i] < farthest[i]);
                // A ray that has met anything is done: no box is nearer than its start.
                let end = if any { -1.0 } else { t[i] };
                farthest[i] = if met { end } else { farthest[i] };
                hit[i] = if met { disc.surfel } else { hit[i] };
            }
        }
    }
    hit
}

/// Whether any ray of the packet passes through the box before what it has met already.
#[inline(always)]
fn meets(node: &Node, origin: &[Lanes; 3], inverse: &[f32; 3], farthest: &Lanes) -> bool {
    let (mut enter, mut leave) = ([0f32; PACKET], *farthest);
    for axis in 0..3 {
        let (near, far) = if inverse[axis] >= 0.0 {
            (node.min[axis], node.max[axis])
        } else {
            (node.max[axis], node.min[axis])
        };
        for i in 0..PACKET {
            let (a, b) = (
                (near - origin[axis][i]) * inverse[axis],
                (far - origin[axis][i]) * inverse[axis],
            );
            enter[i] = if a > enter[i] { a } else { enter[i] };
            leave[i] = if b < leave[i] { b } else { leave[i] };
        }
    }
    let mut any = 0u32;
    for i in 0..PACKET {
        any |= u32::from(enter[i] <= leave[i]);
    }
    any != 0
}
