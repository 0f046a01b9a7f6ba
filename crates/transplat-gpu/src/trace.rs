//! BVH of a splat's discs on the GPU, for `shared/trace.wgsl`.

use transplat_core::bake::trace::{BoxInOrder, Tracer};
use wgpu::BufferUsages;

use crate::context::{Context, Result};
use crate::layout::gpu_struct;

gpu_struct! {
    in "bake_directional";
    /// A box and what is in it.
    struct TraceBox {
        low: [f32; 3],
        skip: u32,
        high: [f32; 3],
        discs: u32,
    }

    /// A disc.
    struct TraceDisc {
        center: [f32; 3],
        surfel: u32,
        normal: [f32; 3],
        one_sided: u32,
        axis_a: [f32; 4],
        axis_b: [f32; 4],
    }
}

/// The boxes and discs of an asset.
pub(crate) struct ResidentTracer {
    pub boxes: wgpu::Buffer,
    pub discs: wgpu::Buffer,
    pub box_count: usize,
}

/// The first disc of a box, and in the upper bits how many.
fn packed(b: &BoxInOrder) -> u32 {
    debug_assert!(b.first < 1 << 28 && b.count < 16);
    b.first | b.count << 28
}

impl ResidentTracer {
    /// Checks that there is room for it.
    pub fn check_fits(context: &Context, tracer: &Tracer) -> Result<()> {
        let (discs, boxes) = (tracer.disc_count(), tracer.box_count());
        context.check_fits("the surfels' discs", discs * size_of::<TraceDisc>())?;
        context.check_fits("the discs' boxes", boxes * size_of::<TraceBox>())
    }

    pub fn upload(context: &Context, tracer: &Tracer) -> Self {
        let boxes: Vec<TraceBox> = tracer
            .boxes_in_order()
            .iter()
            .map(|b| TraceBox {
                low: b.min.to_array(),
                skip: b.skip,
                high: b.max.to_array(),
                discs: packed(b),
            })
            .collect();
        let discs: Vec<TraceDisc> = tracer
            .discs()
            .map(|d| TraceDisc {
                center: d.center.to_array(),
                surfel: d.surfel,
                normal: d.normal.to_array(),
                one_sided: u32::from(d.one_sided),
                axis_a: d.inverse_axes[0].extend(0.0).to_array(),
                axis_b: d.inverse_axes[1].extend(0.0).to_array(),
            })
            .collect();
        Self {
            boxes: context.upload(&boxes, BufferUsages::STORAGE),
            discs: context.upload(&discs, BufferUsages::STORAGE),
            box_count: boxes.len(),
        }
    }
}
