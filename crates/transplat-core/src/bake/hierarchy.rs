//! A hierarchy of boxes, walked by packets of rays of one direction: they start from neighbours, meet the same boxes, and share all that
//! depends on the direction alone.

use std::ops::Range;

use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Rays that walk together.
pub const PACKET: usize = 16;

/// A number of each ray of a packet.
pub(super) type Lanes = [f32; PACKET];

/// Things in a leaf, at most.
const LEAF: u32 = 4;

/// A node: the box, and its two children from `first` on, or `count` things.
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
    /// First of the things in it.
    pub first: u32,
    /// How many things are in it; 0 where it holds boxes.
    pub count: u32,
}

/// The boxes; what is in them lies with whoever built it.
#[derive(Clone, Debug)]
pub(super) struct Hierarchy {
    nodes: Vec<Node>,
}

/// The box of an ellipse with those half axes.
pub(super) fn ellipse_box(center: Vec3, [a, b]: [Vec3; 2]) -> Aabb {
    let half = Vec3::from_array(std::array::from_fn(|i| a[i].hypot(b[i])));
    Aabb {
        min: Vec3A::from(center - half),
        max: Vec3A::from(center + half),
    }
}

impl Hierarchy {
    /// Over things that lie in these boxes, and the order, leaf by leaf, that the things have to be brought into.
    pub fn new(boxes: &[Aabb]) -> (Self, Vec<u32>) {
        let indices = (0..boxes.len() as u32).collect();
        let mut bvh = PlocBuilder::new().build(
            PlocSearchDistance::High,
            boxes,
            indices,
            SortPrecision::U64,
            0,
        );
        collapse(&mut bvh, LEAF, 1.0);
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
        (Self { nodes }, bvh.primitive_indices)
    }

    /// How many boxes there are.
    pub fn len(&self) -> usize {
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

    /// Begins a walk: `stack` is scratch.
    pub fn enter(&self, stack: &mut Vec<u32>) {
        stack.clear();
        if !self.nodes.is_empty() {
            stack.push(0);
        }
    }

    /// The things of the next leaf that a ray passes through before it is done, near ones first as far as the boxes tell. `farthest` is how far
    /// each ray still goes. Inlined, so that it is compiled for the caller's instruction set; a closure would not be.
    #[inline(always)]
    pub fn next_leaf(
        &self,
        origin: &[Lanes; 3],
        toward: &Toward,
        farthest: &Lanes,
        stack: &mut Vec<u32>,
    ) -> Option<Range<usize>> {
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            if !meets(node, origin, &toward.inverse, farthest) {
                continue;
            }
            let first = node.first as usize;
            if node.count > 0 {
                return Some(first..first + node.count as usize);
            }
            let [a, b] = [node.first, node.first + 1];
            let middle = |i: u32| {
                let n = &self.nodes[i as usize];
                (n.min + n.max).dot(toward.direction)
            };
            // The nearer one is looked at first.
            if middle(a) < middle(b) {
                stack.extend([b, a]);
            } else {
                stack.extend([a, b]);
            }
        }
        None
    }

    /// The same of rays that each have a direction of their own, in no order.
    #[inline(always)]
    pub fn next_leaf_on(
        &self,
        origin: &[Lanes; 3],
        ways: &Ways,
        farthest: &Lanes,
        stack: &mut Vec<u32>,
    ) -> Option<Range<usize>> {
        while let Some(index) = stack.pop() {
            let node = &self.nodes[index as usize];
            if !meets_any(node, origin, &ways.inverse, farthest) {
                continue;
            }
            let first = node.first as usize;
            if node.count > 0 {
                return Some(first..first + node.count as usize);
            }
            stack.extend([node.first, node.first + 1]);
        }
        None
    }
}

/// Rays that each have a direction of their own, an axis after the other.
pub(super) struct Ways {
    /// Unit vectors.
    pub direction: [Lanes; 3],
    inverse: [Lanes; 3],
}

impl Ways {
    /// Along unit vectors.
    pub fn new(direction: [Lanes; 3]) -> Self {
        let inverse = direction.map(|axis| axis.map(inverse));
        Self { direction, inverse }
    }
}

/// Where the rays of a packet go.
pub(super) struct Toward {
    direction: Vec3,
    inverse: [f32; 3],
}

impl Toward {
    /// Towards a unit vector.
    pub fn new(direction: Vec3) -> Self {
        let inverse = direction.to_array().map(inverse);
        Self { direction, inverse }
    }
}

/// One over an axis of a direction: along another axis it never divides by zero.
#[inline(always)]
fn inverse(v: f32) -> f32 {
    let tiny = 1e-12f32.copysign(v);
    1.0 / if v.abs() < 1e-12 { tiny } else { v }
}

/// The numbers of a packet's rays.
#[inline(always)]
pub(super) fn lanes(f: impl Fn(usize) -> f32) -> Lanes {
    let mut out = [0.0; PACKET];
    for i in 0..PACKET {
        out[i] = f(i);
    }
    out
}

/// How far each ray goes until it meets the plane of an ellipse, which it faces with that cosine, and the square of how far off the centre
/// that is: 1 on the ellipse with half axes over their squared lengths.
#[inline(always)]
pub(super) fn meet_plane(
    [ox, oy, oz]: &[Lanes; 3],
    d: Vec3,
    facing: f32,
    (c, n, [a, b]): (Vec3, Vec3, [Vec3; 2]),
) -> (Lanes, Lanes) {
    let over = 1.0 / facing;
    let (da, db) = (d.dot(a), d.dot(b));
    let (cn, ca, cb) = (c.dot(n), c.dot(a), c.dot(b));
    let t = lanes(|i| (cn - (ox[i] * n.x + oy[i] * n.y + oz[i] * n.z)) * over);
    let outside = lanes(|i| {
        let u = ox[i] * a.x + oy[i] * a.y + oz[i] * a.z - ca + t[i] * da;
        let v = ox[i] * b.x + oy[i] * b.y + oz[i] * b.z - cb + t[i] * db;
        u * u + v * v
    });
    (t, outside)
}

/// A plane whose normal has a smaller cosine to a ray is not met.
pub(super) const LEAST_FACING: f32 = 1e-6;

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

/// The same of rays that each have a direction of their own.
#[inline(always)]
fn meets_any(node: &Node, origin: &[Lanes; 3], inverse: &[Lanes; 3], farthest: &Lanes) -> bool {
    let (mut enter, mut leave) = ([0f32; PACKET], *farthest);
    for axis in 0..3 {
        let (low, high) = (node.min[axis], node.max[axis]);
        for i in 0..PACKET {
            let (a, b) = (
                (low - origin[axis][i]) * inverse[axis][i],
                (high - origin[axis][i]) * inverse[axis][i],
            );
            let (near, far) = if a < b { (a, b) } else { (b, a) };
            enter[i] = if near > enter[i] { near } else { enter[i] };
            leave[i] = if far < leave[i] { far } else { leave[i] };
        }
    }
    let mut any = 0u32;
    for i in 0..PACKET {
        any |= u32::from(enter[i] <= leave[i]);
    }
    any != 0
}
