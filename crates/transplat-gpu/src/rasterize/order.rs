//! The order in which surfels are drawn, farthest first: sorted by the CPU, or by the adapter from what it has projected.

use std::sync::Arc;

use glam::Vec3;
use transplat_core::camera::Camera;
use transplat_core::rasterize::depth_order;
use wgpu::BufferUsages;

use crate::context::{ComputePass, Context, Result};
use crate::layout::gpu_struct;
use crate::shader::{self, DIGIT_BITS, SORT_KEYS, SORT_WORKGROUP};

/// Of a key: a positive float has no sign.
const KEY_BITS: usize = 31;

gpu_struct! {
    in "rasterize_order";
    /// What a round of the sort works on.
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
    pub(super) surfels: wgpu::Buffer,
    pub(super) drawn: Drawn,
}

/// How many surfels are drawn.
#[derive(Clone, Debug)]
pub(super) enum Drawn {
    Count(usize),
    /// What the adapter found, as an indirect draw takes it.
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
        let mut order = depth_order(positions, camera, hidden);
        order.reverse();
        Self {
            drawn: Drawn::Count(order.len()),
            surfels: context.upload(&order, BufferUsages::STORAGE),
        }
    }
}

/// Sorts on the adapter, for so many surfels.
pub(crate) struct Sorter {
    count: usize,
    make_keys: Arc<ComputePass>,
    count_digits: Arc<ComputePass>,
    sum_counts: Arc<ComputePass>,
    move_keys: Arc<ComputePass>,
    move_surfels: Arc<ComputePass>,
    /// Keys with their surfels, and those of the next round.
    pairs: [wgpu::Buffer; 2],
    counts: wgpu::Buffer,
    totals: wgpu::Buffer,
    hidden: wgpu::Buffer,
    order: Order,
}

impl Sorter {
    /// Makes room.
    pub fn new(context: &Context, count: usize) -> Self {
        let source = shader::RASTERIZE_ORDER.source();
        let pass = |entry| context.compute_pass(&source, entry);
        let digits = 1 << DIGIT_BITS;
        let usage = BufferUsages::STORAGE | BufferUsages::INDIRECT | BufferUsages::COPY_SRC;
        Self {
            count,
            make_keys: pass("make_keys"),
            count_digits: pass("count_digits"),
            sum_counts: pass("sum_counts"),
            move_keys: pass("move_keys"),
            move_surfels: pass("move_surfels"),
            pairs: [(); 2].map(|()| context.storage(8 * count)),
            counts: context.storage(4 * digits * blocks(count)),
            totals: context.storage(4 * digits),
            hidden: context.storage(4 * count.div_ceil(32)),
            order: Order {
                surfels: context.storage(4 * count),
                drawn: Drawn::Indirect(context.upload(&[4u32, 0, 0, 0], usage)),
            },
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
        let Drawn::Indirect(drawn) = &self.order.drawn else {
            return self.order.clone();
        };
        let start: [u32; 4] = [4, 0, 0, 0];
        (context.queue).write_buffer(drawn, 0, bytemuck::cast_slice(&start));
        let blocks = blocks(self.count);
        let parameters = |shift: usize| {
            let parameters = OrderParameters {
                count: self.count as u32,
                blocks: blocks as u32,
                shift: shift as u32,
                width: size[0] as f32,
                height: size[1] as f32,
            };
            context.upload(&[parameters], BufferUsages::STORAGE)
        };
        let mut encoder = context.encoder();
        let [first, second] = &self.pairs;
        let bindings = [
            ("parameters", &parameters(0)),
            ("projected", projected),
            ("hidden", &self.hidden),
            ("moved", first),
            ("drawn", drawn),
        ];
        let group = context.bind(&self.make_keys, &bindings);
        self.make_keys
            .dispatch(&mut encoder, &group, [blocks, 1, 1]);
        let (mut from, mut to) = (first, second);
        for shift in (0..KEY_BITS).step_by(DIGIT_BITS) {
            let is_last = shift + DIGIT_BITS >= KEY_BITS;
            let parameters = parameters(shift);
            let moves = match is_last {
                true => (&self.move_surfels, ("order", &self.order.surfels)),
                false => (&self.move_keys, ("moved", to)),
            };
            let common = [
                ("parameters", &parameters),
                ("pairs", from),
                ("counts", &self.counts),
                ("totals", &self.totals),
            ];
            let of = |these: &[usize]| these.iter().map(|i| common[*i]).collect::<Vec<_>>();
            let group = context.bind(&self.count_digits, &of(&[0, 1, 2]));
            (self.count_digits).dispatch(&mut encoder, &group, [blocks, 1, 1]);
            let group = context.bind(&self.sum_counts, &of(&[0, 2, 3]));
            (self.sum_counts).dispatch(&mut encoder, &group, [1 << DIGIT_BITS, 1, 1]);
            let (pass, target) = moves;
            let group = context.bind(pass, &[of(&[0, 1, 2, 3]), vec![target]].concat());
            pass.dispatch(&mut encoder, &group, [blocks, 1, 1]);
            (from, to) = (to, from);
        }
        context.submit(encoder);
        self.order.clone()
    }

    /// What was put in order last.
    pub fn read(&self, context: &Context) -> Result<Vec<u32>> {
        let read = |buffer: &wgpu::Buffer| {
            let copy = |encoder: &mut wgpu::CommandEncoder, to: &wgpu::Buffer| {
                encoder.copy_buffer_to_buffer(buffer, 0, to, 0, buffer.size());
            };
            context.read_back(buffer.size() as usize, copy, |bytes| {
                bytemuck::pod_collect_to_vec::<u8, u32>(bytes)
            })
        };
        let mut order = read(&self.order.surfels)?;
        if let Drawn::Indirect(drawn) = &self.order.drawn {
            order.truncate(read(drawn)?[1] as usize);
        }
        Ok(order)
    }
}

/// Blocks of so many keys.
fn blocks(count: usize) -> usize {
    count.div_ceil(SORT_WORKGROUP * SORT_KEYS).max(1)
}
