//! The order in which surfels are drawn, farthest first: sorted by the CPU, or by the adapter from what it has projected.

use std::sync::Arc;

use glam::Vec3;
use transplat_core::camera::Camera;
use transplat_core::rasterize::depth_order;
use wgpu::BufferUsages;

use crate::context::{ComputePass, Context, Result};
use crate::layout::gpu_struct;
use crate::shader::{self, DIGIT_BITS, SORT_KEYS, SORT_WORKGROUP};

/// Bits of a key: a positive float has no sign.
const KEY_BITS: usize = 31;

gpu_struct! {
    in "rasterize_order";
    /// Parameters of a round of the sort.
    struct OrderParameters {
        count: u32,
        blocks: u32,
        shift: u32,
        width: f32,
        height: f32,
    }
}

/// Surfels in the order in which they are drawn, farthest first.
#[derive(Clone, Debug)]
pub struct Order {
    /// Key and index of each surfel.
    pub(super) surfels: wgpu::Buffer,
    pub(super) drawn: DrawnCount,
}

/// Count of surfels that are drawn.
#[derive(Clone, Debug)]
pub(super) enum DrawnCount {
    Count(usize),
    /// Count on the adapter, as an indirect draw takes it.
    Indirect(wgpu::Buffer),
}

impl Order {
    /// Sorts what is in front of the camera and not hidden on the CPU; `hidden` `[n]` or empty.
    pub(crate) fn of(
        context: &Context,
        positions: &[Vec3],
        camera: &Camera,
        hidden: &[bool],
    ) -> Self {
        let order = depth_order(positions, camera, hidden);
        let surfels: Vec<[u32; 2]> = order.iter().rev().map(|surfel| [0, *surfel]).collect();
        Self {
            drawn: DrawnCount::Count(surfels.len()),
            surfels: context.upload(&surfels, BufferUsages::STORAGE),
        }
    }
}

/// The passes of the sort.
struct OrderPasses {
    make_keys: Arc<ComputePass>,
    count_digits: Arc<ComputePass>,
    sum_counts: Arc<ComputePass>,
    move_keys: Arc<ComputePass>,
}

impl OrderPasses {
    fn new(context: &Context) -> Self {
        let source = shader::RASTERIZE_ORDER.source();
        let pass = |entry| context.compute_pass(&source, entry);
        Self {
            make_keys: pass("make_keys"),
            count_digits: pass("count_digits"),
            sum_counts: pass("sum_counts"),
            move_keys: pass("move_keys"),
        }
    }
}

/// Sorts on the adapter, for so many surfels.
pub(crate) struct Sorter {
    count: usize,
    passes: OrderPasses,
    /// Surfels that are left out, a bit each.
    hidden: wgpu::Buffer,
    /// Keys with their surfels: before the first round, and after the last.
    pairs: wgpu::Buffer,
    /// Arguments of an indirect draw.
    drawn: wgpu::Buffer,
    /// Bind groups of each round's three passes.
    rounds: Vec<[wgpu::BindGroup; 3]>,
}

impl Sorter {
    /// Compiles what all of them run; no frame waits for it.
    pub fn warm_up(context: &Context) {
        OrderPasses::new(context);
    }

    /// Makes room.
    pub fn new(context: &Context, count: usize) -> Self {
        let passes = OrderPasses::new(context);
        let digits = 1 << DIGIT_BITS;
        let [pairs, other] = [(); 2].map(|()| context.storage(8 * count));
        let counts = context.storage(4 * digits * blocks(count));
        let totals = context.storage(4 * digits);
        let (mut from, mut to) = (&pairs, &other);
        let round = |shift: usize| {
            let parameters = OrderParameters {
                shift: shift as u32,
                ..parameters_of(count, [0; 2])
            };
            let parameters = context.upload(&[parameters], BufferUsages::STORAGE);
            let parameters = ("parameters", &parameters);
            let [counts, totals] = [("counts", &counts), ("totals", &totals)];
            let [pairs, moved] = [("pairs", from), ("moved", to)];
            (from, to) = (to, from);
            [
                context.bind(&passes.count_digits, &[parameters, pairs, counts]),
                context.bind(&passes.sum_counts, &[parameters, counts, totals]),
                context.bind(
                    &passes.move_keys,
                    &[parameters, pairs, counts, totals, moved],
                ),
            ]
        };
        let rounds: Vec<_> = (0..KEY_BITS).step_by(DIGIT_BITS).map(round).collect();
        // They end where they began.
        const { assert!(KEY_BITS.div_ceil(DIGIT_BITS).is_multiple_of(2)) };
        let usage = BufferUsages::STORAGE | BufferUsages::INDIRECT | BufferUsages::COPY_SRC;
        Self {
            count,
            hidden: context.storage(4 * count.div_ceil(32)),
            drawn: context.upload(&NOTHING_DRAWN, usage),
            rounds,
            passes,
            pairs,
        }
    }

    /// For how many surfels it has room.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Sets which surfels are left out; `[n]` or empty.
    pub fn hide(&self, context: &Context, hidden: &[bool]) {
        let mut bits = vec![0u32; self.count.div_ceil(32)];
        for (i, _) in hidden.iter().enumerate().filter(|(_, hidden)| **hidden) {
            bits[i / 32] |= 1 << (i % 32);
        }
        (context.queue).write_buffer(&self.hidden, 0, bytemuck::cast_slice(&bits));
    }

    /// Puts what is projected, and on a picture of such a size, in order.
    pub fn sort(&self, context: &Context, projected: &wgpu::Buffer, size: [usize; 2]) -> Order {
        let nothing = bytemuck::cast_slice(&NOTHING_DRAWN);
        (context.queue).write_buffer(&self.drawn, 0, nothing);
        let parameters = [parameters_of(self.count, size)];
        let bindings = [
            (
                "parameters",
                &context.upload(&parameters, BufferUsages::STORAGE),
            ),
            ("projected", projected),
            ("hidden", &self.hidden),
            ("moved", &self.pairs),
            ("drawn", &self.drawn),
        ];
        let OrderPasses {
            make_keys,
            count_digits,
            sum_counts,
            move_keys,
        } = &self.passes;
        let mut encoder = context.encoder();
        let per_block = [blocks(self.count), 1, 1];
        let group = context.bind(make_keys, &bindings);
        make_keys.dispatch(&mut encoder, &group, per_block);
        for [count, sum, moves] in &self.rounds {
            count_digits.dispatch(&mut encoder, count, per_block);
            sum_counts.dispatch(&mut encoder, sum, [1 << DIGIT_BITS, 1, 1]);
            move_keys.dispatch(&mut encoder, moves, per_block);
        }
        context.submit(encoder);
        Order {
            surfels: self.pairs.clone(),
            drawn: DrawnCount::Indirect(self.drawn.clone()),
        }
    }

    /// The surfels that were put in order last.
    pub fn read(&self, context: &Context) -> Result<Vec<u32>> {
        let read = |buffer: &wgpu::Buffer| {
            let copy = |encoder: &mut wgpu::CommandEncoder, to: &wgpu::Buffer| {
                encoder.copy_buffer_to_buffer(buffer, 0, to, 0, buffer.size());
            };
            context.read_back(buffer.size() as usize, copy, |bytes| {
                bytemuck::pod_collect_to_vec::<u8, u32>(bytes)
            })
        };
        let [_, drawn, ..] = read(&self.drawn)?[..] else {
            return Ok(Vec::new());
        };
        let pairs = read(&self.pairs)?;
        let surfels = pairs.chunks_exact(2).map(|pair| pair[1]);
        Ok(surfels.take(drawn as usize).collect())
    }
}

/// Four corners of no quad, as an indirect draw takes it.
const NOTHING_DRAWN: [u32; 4] = [4, 0, 0, 0];

fn parameters_of(count: usize, [width, height]: [usize; 2]) -> OrderParameters {
    OrderParameters {
        count: count as u32,
        blocks: blocks(count) as u32,
        shift: 0,
        width: width as f32,
        height: height as f32,
    }
}

/// Blocks of so many keys.
fn blocks(count: usize) -> usize {
    count.div_ceil(SORT_WORKGROUP * SORT_KEYS).max(1)
}
