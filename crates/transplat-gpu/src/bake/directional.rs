//! The rays of the directional method's bake. CPU twin: [`transplat_core::bake::directional`].

use std::sync::Arc;

use transplat_core::bake::strata::{
    MOST_SURFELS, PER_STRATUM, STRATA, SURFEL_BITS, SurfelHits, directions,
};
use transplat_core::bake::trace::Tracer;
use transplat_core::progress::Progress;
use wgpu::BufferUsages;

use crate::context::{ComputePass, Context, GpuError, Result};
use crate::layout::gpu_struct;
use crate::shader::{self, STRATUM_BATCH};
use crate::trace::ResidentTracer;
use crate::{CHUNK, WORKGROUP};

gpu_struct! {
    in "bake_directional";
    /// Uniforms of the pass.
    struct DirectionalParameters {
        count: u32,
        box_count: u32,
    }

    /// A surfel that rays start from.
    struct DirectionalBakeSurfel {
        position: [f32; 3],
        minor: f32,
        normal: [f32; 3],
        major: f32,
    }
}

/// An asset's rays on the GPU.
pub struct GpuTracer {
    context: Arc<Context>,
    pass: Arc<ComputePass>,
    tracer: Arc<Tracer>,
    resident: ResidentTracer,
    found: wgpu::Buffer,
}

impl GpuTracer {
    /// Uploads the boxes and the discs.
    ///
    /// # Errors
    /// It is too large for the adapter, or the driver failed.
    pub fn new(context: &Arc<Context>, tracer: &Arc<Tracer>) -> Result<Self> {
        ResidentTracer::check_fits(context, tracer)?;
        let resident = ResidentTracer::upload(context, tracer);
        context.wait()?;
        Ok(Self {
            pass: context.compute_pass(&shader::BAKE_DIRECTIONAL.source(), "trace_strata"),
            resident,
            found: context.storage(4 * STRATUM_BATCH * CHUNK.min(tracer.order.len())),
            context: context.clone(),
            tracer: tracer.clone(),
        })
    }

    /// Traces the rays of some patches from some surfels, of which neighbours follow each other, and adds what they find.
    ///
    /// # Errors
    /// The driver failed, or `progress` asked to stop.
    pub fn trace(
        &self,
        strata: &[usize],
        found: &mut [SurfelHits],
        progress: Progress<'_>,
    ) -> Result<()> {
        let all = directions();
        let mut chunks: Vec<RayChunk<'_>> = (found.chunks_mut(CHUNK))
            .map(|found| self.chunk(found))
            .collect();
        for (batch, of_batch) in strata.chunks(STRATUM_BATCH).enumerate() {
            let done = (batch * STRATUM_BATCH) as f64 / strata.len() as f64;
            if progress(done).is_break() {
                return Err(GpuError::Cancelled);
            }
            let mut rays = vec![[0f32; 4]; STRATUM_BATCH * PER_STRATUM];
            for (i, ray) in rays
                .iter_mut()
                .enumerate()
                .take(of_batch.len() * PER_STRATUM)
            {
                let (stratum, place) = (of_batch[i / PER_STRATUM], i % PER_STRATUM);
                *ray = all[place * STRATA + stratum].extend(0.0).to_array();
            }
            let rays = self.context.upload(&rays, BufferUsages::UNIFORM);
            for chunk in &mut chunks {
                self.trace_chunk(chunk, of_batch, &rays)?;
            }
        }
        Ok(())
    }

    fn chunk<'a>(&self, found: &'a mut [SurfelHits]) -> RayChunk<'a> {
        let context = &self.context;
        let of_surfel = |f: &SurfelHits| {
            let s = &self.tracer.surfels[f.surfel as usize];
            DirectionalBakeSurfel {
                position: s.position.to_array(),
                minor: s.minor,
                normal: s.normal.to_array(),
                major: s.major,
            }
        };
        let surfels: Vec<DirectionalBakeSurfel> = found.iter().map(of_surfel).collect();
        let closed = found.iter().map(|f| u32::from(f.back_is_closed));
        let parameters = DirectionalParameters {
            count: found.len() as u32,
            box_count: self.resident.box_count as u32,
        };
        RayChunk {
            parameters: context.upload(&[parameters], BufferUsages::UNIFORM),
            surfels: context.upload(&surfels, BufferUsages::STORAGE),
            closed: context.upload(&closed.collect::<Vec<u32>>(), BufferUsages::STORAGE),
            found,
        }
    }

    fn trace_chunk(
        &self,
        chunk: &mut RayChunk<'_>,
        strata: &[usize],
        rays: &wgpu::Buffer,
    ) -> Result<()> {
        let context = &self.context;
        let count = chunk.found.len();
        let bindings = [
            ("parameters", &chunk.parameters),
            ("directions", rays),
            ("surfels", &chunk.surfels),
            ("boxes", &self.resident.boxes),
            ("discs", &self.resident.discs),
            ("found", &self.found),
            ("closed", &chunk.closed),
        ];
        let group = context.bind(&self.pass, &bindings);
        let groups = [count.div_ceil(WORKGROUP), strata.len(), 1];
        context.run(&self.pass, &group, groups);
        let read: Vec<u32> = context.read(&self.found, count * strata.len())?;
        for (stratum, row) in strata.iter().zip(read.chunks_exact(count)) {
            for (found, packed) in chunk.found.iter_mut().zip(row) {
                let open =
                    std::array::from_fn(|place| packed >> (SURFEL_BITS as usize + place) & 1 == 1);
                let met = (packed >> 31 == 1).then_some(packed & (MOST_SURFELS as u32 - 1));
                found.add(*stratum, met, open);
            }
        }
        Ok(())
    }
}

/// Some of the surfels, and what they found.
struct RayChunk<'a> {
    parameters: wgpu::Buffer,
    surfels: wgpu::Buffer,
    closed: wgpu::Buffer,
    found: &'a mut [SurfelHits],
}
