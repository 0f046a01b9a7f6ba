//! BVH of eight-wide nodes: a ray is tested against eight boxes at once, and against all that is in a leaf.
//!
//! Each ray walks by itself. Those of neighbours in one direction part soon: of sixteen that walked together two were left in a leaf.

use std::ops::Range;

use fearless_simd::f32x8;
use fearless_simd::prelude::*;
use glam::{Vec3, Vec3A};
use obvhs::aabb::Aabb;
use obvhs::bvh2::leaf_collapser::collapse;
use obvhs::bvh2::node::Bvh2Node;
use obvhs::ploc::{PlocBuilder, PlocSearchDistance, SortPrecision};

/// Rays that are asked for together, in one call.
pub const PACKET: usize = 16;

/// Boxes of a node, or things in a leaf, that are tested against a ray at once.
pub(super) const WIDE: usize = 8;

/// A number of each of them.
pub(super) type Wide = [f32; WIDE];

/// Cost of a box beside the things in it, in things: as a full leaf costs what one thing does, leaves are filled.
const BOX_COST: f32 = WIDE as f32;

/// Boxes side by side, in the order of their middles along an axis.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
struct Node {
    /// Lower and upper corners, by axis; what is not there ends before it begins.
    corners: [[Wide; 3]; 2],
    inside: [Inside; WIDE],
    /// Axis of the split.
    axis: u32,
}

/// Content of a box: the node of that number, or with [`LEAF`] the leaf.
#[derive(Clone, Copy, Debug)]
struct Inside(u32);

/// Bit that marks a leaf in [`Inside`].
const LEAF: u32 = 1 << 31;

impl Inside {
    fn leaf(self) -> Option<usize> {
        (self.0 & LEAF != 0).then_some((self.0 & !LEAF) as usize)
    }
}

/// Boxes that a walk has still to look into, and where its ray enters them.
pub type Stack = Vec<Waiting>;

/// Entry of a [`Stack`].
#[derive(Clone, Copy, Debug)]
pub struct Waiting {
    inside: Inside,
    enter: f32,
}

/// In places of a stack that are to be filled.
const NOTHING: Waiting = Waiting {
    inside: Inside(0),
    enter: f32::INFINITY,
};

/// A box of the hierarchy in an order that needs no stack: whatever meets the box goes on with the next one, and whatever does not, with
/// number `skip`.
#[derive(Clone, Copy, Debug)]
pub struct BoxInOrder {
    /// Corner.
    pub min: Vec3,
    /// The opposite one.
    pub max: Vec3,
    /// Index of the node after all that is in the box.
    pub skip: u32,
    /// First of the things in it.
    pub first: u32,
    /// Number of things in it; 0 where it holds boxes.
    pub count: u32,
}

/// The boxes; what is in them lies with whoever built it, leaf by leaf.
#[derive(Clone, Debug)]
pub(super) struct Hierarchy {
    /// The first one holds all.
    nodes: Vec<Node>,
    /// The first thing of each leaf, and behind the last one how many there are. `[leaves + 1]`
    starts: Vec<u32>,
}

/// The box of an ellipse with those half axes.
pub(super) fn ellipse_box(center: Vec3, [a, b]: [Vec3; 2]) -> Aabb {
    let half = Vec3::from_array(std::array::from_fn(|i| {
        // Without end it is everywhere.
        a[i].hypot(b[i]).min(f32::MAX)
    }));
    Aabb {
        min: Vec3A::from(center - half),
        max: Vec3A::from(center + half),
    }
}

/// A ray that crosses more boxes than this on its way through the object is too slow: captures have 3 to 17.
const MOST_CROSSED: f32 = 256.0;

/// Boxes that a ray crosses once they are thinned.
const CROSSED: f32 = 96.0;

/// Every how many-th of some boxes is enough: 1, but where they overlap so much that a ray through the object would cross thousands. A ray
/// crosses a box as often as that is large (Cauchy's formula), within the cube from -1 to 1 that holds the object.
pub(super) fn thinning(boxes: &[Aabb]) -> usize {
    let area = |b: &Aabb| {
        if b.max.cmplt(Vec3A::NEG_ONE).any() || b.min.cmpgt(Vec3A::ONE).any() {
            return 0.0;
        }
        let inside = |v: Vec3A| v.clamp(Vec3A::NEG_ONE, Vec3A::ONE);
        let edges = (inside(b.max) - inside(b.min)).max(Vec3A::ZERO);
        edges.x * edges.y + edges.y * edges.z + edges.z * edges.x
    };
    let crossed = boxes.iter().map(area).sum::<f32>() / 12.0;
    if crossed > MOST_CROSSED {
        (crossed / CROSSED).ceil() as usize
    } else {
        1
    }
}

impl Hierarchy {
    /// Over things that lie in these boxes, and the order, leaf by leaf, that the things have to be brought into.
    pub fn new(boxes: &[Aabb]) -> (Self, Vec<u32>) {
        let mut all = Self {
            nodes: Vec::new(),
            starts: vec![0],
        };
        if boxes.is_empty() {
            return (all, Vec::new());
        }
        let indices = (0..boxes.len() as u32).collect();
        let mut tree = PlocBuilder::new().build(
            PlocSearchDistance::High,
            boxes,
            indices,
            SortPrecision::U64,
            0,
        );
        collapse(&mut tree, WIDE as u32, BOX_COST);
        let mut order = Vec::with_capacity(boxes.len());
        let mut add_leaf = |node: &Bvh2Node| {
            let leaf = all.starts.len() as u32 - 1;
            let things = node.first_index as usize..(node.first_index + node.prim_count) as usize;
            order.extend_from_slice(&tree.primitive_indices[things]);
            all.starts.push(order.len() as u32);
            Inside(leaf | LEAF)
        };
        // Nodes of the tree that become one here, and where that is told of.
        let mut waiting: Vec<(Option<[usize; 2]>, &Bvh2Node)> = vec![(None, &tree.nodes[0])];
        while let Some((told, root)) = waiting.pop() {
            let number = all.nodes.len();
            if let Some([node, k]) = told {
                all.nodes[node].inside[k] = Inside(number as u32);
            }
            let mut children = unfold(&tree.nodes, root);
            let mut node = Node::of(&mut children);
            for (k, child) in children.iter().enumerate() {
                if child.prim_count > 0 {
                    node.inside[k] = add_leaf(child);
                } else {
                    waiting.push((Some([number, k]), child));
                }
            }
            all.nodes.push(node);
        }
        all.nodes.shrink_to_fit();
        all.starts.shrink_to_fit();
        (all, order)
    }

    /// The things of each leaf.
    pub fn leaves(&self) -> impl Iterator<Item = Range<usize>> + '_ {
        (self.starts.windows(2)).map(|w| w[0] as usize..w[1] as usize)
    }

    /// Number of things.
    pub fn things(&self) -> usize {
        self.starts.last().map_or(0, |end| *end as usize)
    }

    /// Number of boxes.
    pub fn len(&self) -> usize {
        // Each is in another one, but for the one that holds all.
        (self.nodes.len() + self.starts.len()).saturating_sub(2)
    }

    /// The boxes, each before those that it holds.
    pub fn boxes_in_order(&self) -> Vec<BoxInOrder> {
        let mut out: Vec<BoxInOrder> = Vec::with_capacity(self.len());
        // A box of a node, or the end of one that holds others.
        enum Step {
            Enter(usize, usize),
            Leave(usize),
        }
        let boxes = |node: usize| {
            let is_there = move |k: &usize| {
                let [min, _] = &self.nodes[node].corners;
                min[0][*k] != f32::INFINITY
            };
            (0..WIDE)
                .filter(is_there)
                .map(move |k| Step::Enter(node, k))
        };
        let mut steps = Vec::new();
        if !self.nodes.is_empty() {
            steps.extend(boxes(0));
        }
        while let Some(step) = steps.pop() {
            match step {
                Step::Leave(place) => out[place].skip = out.len() as u32,
                Step::Enter(node, k) => {
                    let Node {
                        corners, inside, ..
                    } = &self.nodes[node];
                    let [min, max] = corners.map(|side| Vec3::from_array(side.map(|axis| axis[k])));
                    let things = match inside[k].leaf() {
                        Some(leaf) => self.starts[leaf]..self.starts[leaf + 1],
                        None => {
                            steps.push(Step::Leave(out.len()));
                            steps.extend(boxes(inside[k].0 as usize));
                            0..0
                        }
                    };
                    out.push(BoxInOrder {
                        min,
                        max,
                        skip: out.len() as u32 + 1,
                        first: things.start,
                        count: things.end - things.start,
                    });
                }
            }
        }
        out
    }

    /// Begins a walk: `stack` is scratch.
    pub fn enter(&self, stack: &mut Stack) {
        stack.clear();
        if !self.nodes.is_empty() {
            stack.push(Waiting {
                inside: Inside(0),
                enter: f32::NEG_INFINITY,
            });
        }
    }

    /// The next leaf that a ray passes through before its end, near ones first as far as the boxes tell. Inlined, so that it is compiled for the
    /// caller's instruction set; what it called with each leaf would not be.
    #[inline(always)]
    pub fn next_leaf<S: Simd>(&self, ray: &Ray<S>, end: f32, stack: &mut Stack) -> Option<usize> {
        let simd = ray.simd;
        while let Some(Waiting { inside, enter }) = stack.pop() {
            if enter > end {
                continue;
            }
            if let Some(leaf) = inside.leaf() {
                return Some(leaf);
            }
            let node = &self.nodes[inside.0 as usize];
            let (mut enter, mut leave) = (ray.start, f32x8::splat(simd, end));
            for axis in 0..3 {
                let side = ray.side[axis];
                let toward =
                    |corner: &Wide| (load(simd, corner) - ray.origin[axis]) * ray.inverse[axis];
                enter = toward(&node.corners[side][axis]).max(enter);
                leave = toward(&node.corners[1 - side][axis]).min(leave);
            }
            let met = enter.simd_le(leave);
            if !met.any_true() {
                continue;
            }
            let (met, enter): ([i32; WIDE], [f32; WIDE]) = (met.into(), enter.into());
            // The far ones first, so that the near ones are taken up before them. Without a branch: whatever is not met is overwritten.
            let flip = if ray.side[node.axis as usize % 3] == 0 {
                WIDE - 1
            } else {
                0
            };
            let before = stack.len();
            stack.extend_from_slice(&[NOTHING; WIDE]);
            let mut count = 0;
            if let Some(places) = stack.last_chunk_mut::<WIDE>() {
                for k in 0..WIDE {
                    let k = k ^ flip;
                    places[count % WIDE] = Waiting {
                        inside: node.inside[k],
                        enter: enter[k],
                    };
                    count += usize::from(met[k] != 0);
                }
            }
            stack.truncate(before + count);
        }
        None
    }
}

/// The boxes that are side by side in one: its children, the larger ones of which give way to their own.
fn unfold<'a>(nodes: &'a [Bvh2Node], root: &'a Bvh2Node) -> Vec<&'a Bvh2Node> {
    if root.prim_count > 0 {
        return vec![root];
    }
    let children = |of: &Bvh2Node| [0, 1].map(|k| &nodes[of.first_index as usize + k]);
    let mut all = children(root).to_vec();
    while all.len() < WIDE {
        let area = |k: &usize| all[*k].aabb.half_area();
        let with_others = (0..all.len()).filter(|k| all[*k].prim_count == 0);
        let Some(k) = with_others.max_by(|a, b| area(a).total_cmp(&area(b))) else {
            break;
        };
        let [a, b] = children(all[k]);
        all[k] = a;
        all.push(b);
    }
    all
}

impl Node {
    /// Box of some children, which are brought into its order; its content is left open.
    fn of(children: &mut [&Bvh2Node]) -> Self {
        let middle = |node: &Bvh2Node| node.aabb.center();
        let middles = children.iter().map(|node| middle(node));
        let low = middles.clone().fold(Vec3A::INFINITY, Vec3A::min);
        let high = middles.fold(Vec3A::NEG_INFINITY, Vec3A::max);
        let axis = (high - low).max_position();
        children.sort_by(|a, b| middle(a)[axis].total_cmp(&middle(b)[axis]));
        let corner = |side: usize, axis: usize, k: usize| match children.get(k) {
            Some(node) if side == 0 => node.aabb.min[axis],
            Some(node) => node.aabb.max[axis],
            None => [f32::INFINITY, f32::NEG_INFINITY][side],
        };
        let wide = |side, axis| std::array::from_fn(|k| corner(side, axis, k));
        Self {
            corners: [0, 1].map(|side| [0, 1, 2].map(|axis| wide(side, axis))),
            inside: [Inside(0); WIDE],
            axis: axis as u32,
        }
    }
}

/// A ray, each of its numbers for all that it is held against.
pub(super) struct Ray<S: Simd> {
    simd: S,
    origin: [f32x8<S>; 3],
    direction: [f32x8<S>; 3],
    inverse: [f32x8<S>; 3],
    /// On which side of a box it enters that, by axis.
    side: [usize; 3],
    /// Distance before which hits do not count.
    start: f32x8<S>,
}

impl<S: Simd> Ray<S> {
    /// From a place along a unit vector; what it meets nearer than `start` does not count.
    #[inline(always)]
    pub fn new(simd: S, origin: Vec3, direction: Vec3, start: f32) -> Self {
        let wide = |v: f32| f32x8::splat(simd, v);
        let [x, y, z] = direction.to_array();
        let inverse = [inverse(x), inverse(y), inverse(z)];
        let [by_x, by_y, by_z] = inverse;
        let enters_above = |inverse: f32| usize::from(inverse < 0.0);
        Self {
            simd,
            origin: [wide(origin.x), wide(origin.y), wide(origin.z)],
            direction: [wide(x), wide(y), wide(z)],
            inverse: [wide(by_x), wide(by_y), wide(by_z)],
            side: [enters_above(by_x), enters_above(by_y), enters_above(by_z)],
            start: wide(start),
        }
    }
}

/// One over an axis of a direction: along another axis it never divides by zero.
#[inline(always)]
fn inverse(v: f32) -> f32 {
    let tiny = 1e-12f32.copysign(v);
    1.0 / if v.abs() < 1e-12 { tiny } else { v }
}

#[inline(always)]
fn load<S: Simd>(simd: S, wide: &Wide) -> f32x8<S> {
    simd.load_array_ref_f32x8(wide)
}

/// Ellipses side by side: those of a leaf.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Ellipses {
    /// Unit normals, and the half axes over their squared lengths.
    frame: [[Wide; 3]; 3],
    /// Where the middles are along each of these.
    middle: [Wide; 3],
}

/// Where a ray meets the planes of ellipses.
pub(super) struct Meeting<S: Simd> {
    /// Distance along it; infinite where it does not face them.
    pub distance: f32x8<S>,
    /// The square of how far off the middle that is: 1 on the ellipse, and any number or none where it is infinitely far.
    pub off: f32x8<S>,
    /// Cosine to the normal.
    pub facing: f32x8<S>,
}

/// A plane whose normal has a smaller cosine to a ray is not met.
pub(super) const LEAST_FACING: f32 = 1e-6;

impl Ellipses {
    /// As many as are held against a ray at once, at most: middle, unit normal, and half axes over their squared lengths.
    pub fn new(each: impl Iterator<Item = (Vec3, Vec3, [Vec3; 2])>) -> Self {
        let mut all = Self {
            frame: [[[0.0; WIDE]; 3]; 3],
            middle: [[0.0; WIDE]; 3],
        };
        for (k, (center, normal, [a, b])) in each.enumerate() {
            for (i, axis) in [normal, a, b].into_iter().enumerate() {
                (0..3).for_each(|c| all.frame[i][c][k] = axis[c]);
                all.middle[i][k] = center.dot(axis);
            }
        }
        all
    }

    /// Where a ray meets their planes.
    #[inline(always)]
    pub fn meet<S: Simd>(&self, ray: &Ray<S>) -> Meeting<S> {
        let simd = ray.simd;
        let facing = along(simd, &self.frame[0], &ray.direction);
        let from = along(simd, &self.frame[0], &ray.origin);
        let distance = (load(simd, &self.middle[0]) - from) / facing;
        let mut off = f32x8::splat(simd, 0.0);
        for i in 1..3 {
            let from = along(simd, &self.frame[i], &ray.origin) - load(simd, &self.middle[i]);
            let by = along(simd, &self.frame[i], &ray.direction);
            let u = distance.mul_add(by, from);
            off = u.mul_add(u, off);
        }
        let far = f32x8::splat(simd, f32::INFINITY);
        let is_faced = facing.abs().simd_ge(LEAST_FACING);
        Meeting {
            distance: simd.select_f32x8(is_faced, distance, far),
            off,
            facing,
        }
    }
}

/// The dot product of each of some vectors with one.
#[inline(always)]
fn along<S: Simd>(simd: S, [x, y, z]: &[Wide; 3], v: &[f32x8<S>; 3]) -> f32x8<S> {
    let two = load(simd, y).mul_add(v[1], load(simd, x) * v[0]);
    load(simd, z).mul_add(v[2], two)
}

#[cfg(test)]
mod tests {
    use fearless_simd::{Level, dispatch};

    use super::*;

    /// Numbers from -1 to 1.
    fn numbers() -> impl FnMut() -> f32 {
        let mut state = 7u32;
        move || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        }
    }

    fn boxes(count: usize) -> Vec<Aabb> {
        let mut number = numbers();
        let mut place = move || Vec3A::from_array([number(), number(), number()]);
        (0..count)
            .map(|_| {
                let (center, half) = (place(), 0.1 * place().abs());
                Aabb {
                    min: center - half,
                    max: center + half,
                }
            })
            .collect()
    }

    #[test]
    fn a_ray_is_led_to_all_that_it_passes_through() {
        for count in [0, 1, 2, 8, 9, 400] {
            let mut led = 0;
            let boxes = boxes(count);
            let (hierarchy, order) = Hierarchy::new(&boxes);
            let leaves: Vec<_> = hierarchy.leaves().collect();
            assert!(leaves.iter().all(|leaf| leaf.len() <= WIDE));
            let mut sorted = order.clone();
            sorted.sort_unstable();
            assert!(
                sorted.into_iter().eq(0..count as u32),
                "each is in one leaf"
            );
            let mut number = numbers();
            let mut directions: Vec<Vec3> = (0..200)
                .map(|_| Vec3::new(number(), number(), number()).normalize())
                .collect();
            // Also along the axes, on either side of zero.
            directions.extend([Vec3::X, -Vec3::X, Vec3::Y, -Vec3::Y, Vec3::Z, -Vec3::Z]);
            directions.push(Vec3::new(-0.0, 1.0, 0.0));
            let all = count * directions.len();
            for direction in directions {
                let origin = 0.3 * Vec3::new(number(), number(), number());
                let mut met = vec![false; count];
                let mut stack = Vec::new();
                dispatch!(Level::new(), simd => {
                    let ray = Ray::new(simd, origin, direction, 0.1);
                    hierarchy.enter(&mut stack);
                    while let Some(leaf) = hierarchy.next_leaf(&ray, 2.0, &mut stack) {
                        leaves[leaf].clone().for_each(|i| met[order[i] as usize] = true);
                    }
                });
                for (found, each) in met.iter().zip(&boxes) {
                    let [o, d] = [origin, direction].map(|v| v.as_dvec3().to_array());
                    let (mut enter, mut leave) = (0.1f64, 2f64);
                    for axis in 0..3 {
                        let ends = [each.min, each.max].map(|corner| f64::from(corner[axis]));
                        let [a, b] = ends.map(|end| (end - o[axis]) / d[axis]);
                        (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
                    }
                    led += usize::from(*found);
                    // What it passes through by less than rounding, it may miss.
                    assert!(*found || enter + 1e-5 > leave, "{direction} {each:?}");
                }
            }
            // Not to everything: of so many a twentieth, where a three-hundredth is passed through, since leaves of eight that lie anywhere are large.
            assert!(count < 400 || led < all / 10, "{led} of {all}");
        }
    }

    #[test]
    fn what_has_no_end_is_everywhere() {
        // Half axes as a huge surfel has them whose tangents lie along the axes.
        let axes = [Vec3::new(f32::INFINITY, f32::NAN, 0.0), Vec3::Y];
        let mut all = boxes(20);
        all.push(ellipse_box(Vec3::ZERO, axes));
        let (hierarchy, order) = Hierarchy::new(&all);
        let things: u32 = hierarchy.boxes_in_order().iter().map(|b| b.count).sum();
        assert_eq!(things, 21);
        let leaf = hierarchy
            .leaves()
            .position(|leaf| order[leaf].contains(&20));
        let mut stack = Vec::new();
        dispatch!(Level::new(), simd => {
            let ray = Ray::new(simd, Vec3::new(0.3, 0.2, -5.0), Vec3::Z, 0.0);
            hierarchy.enter(&mut stack);
            let mut met = std::iter::from_fn(|| hierarchy.next_leaf(&ray, f32::MAX, &mut stack));
            assert!(met.any(|found| Some(found) == leaf));
        });
    }

    #[test]
    fn boxes_in_order_hold_those_that_follow_until_they_end() {
        for count in [0, 1, 9, 400] {
            let (hierarchy, _) = Hierarchy::new(&boxes(count));
            let all = hierarchy.boxes_in_order();
            assert_eq!(all.len(), hierarchy.len());
            let things: u32 = all.iter().map(|b| b.count).sum();
            assert_eq!(things as usize, count);
            for (i, outer) in all.iter().enumerate() {
                let inside = &all[i + 1..outer.skip as usize];
                assert_eq!(inside.is_empty(), outer.count > 0);
                for b in inside {
                    assert!(b.skip <= outer.skip);
                    assert!(outer.min.cmple(b.min).all() && outer.max.cmpge(b.max).all());
                }
            }
        }
    }
}
