//! The bake of the harmonic method on the GPU. CPU twin: [`transplat_core::bake::harmonic::bake_harmonic`].

use std::sync::Arc;

use glam::Vec3;
use transplat_core::bake::harmonic::{BakeInput, DIRECTION_BATCH, MapFrame as CoreFrame};
use transplat_core::bake::scaled::BakeSurfel as CoreSurfel;
use transplat_core::progress::Progress;
use wgpu::BufferUsages;

use crate::context::{ComputePass, Context, GpuError, Result};
use crate::layout::gpu_struct;
use crate::shader;
use crate::{CHUNK, WORKGROUP};

/// A surfel whose footprint may exceed this many texels is drawn by a workgroup of its own.
const SMALL_TEXELS: f32 = 1024.0;

/// Large surfels in one submission: each may cover a whole map, and drivers stop work that takes seconds.
const LARGE_AT_ONCE: usize = 2048;

/// Directions whose openness is kept on the GPU before it is read back: 128 MiB for a chunk.
const READ_BACK_DIRECTIONS: usize = 1024;

gpu_struct! {
    in "bake_harmonic";
    /// Uniforms of the pass.
    struct HarmonicParameters {
        count: u32,
        resolution: u32,
        batch: u32,
        batches: u32,
    }

    /// A direction and its map's axes.
    struct MapFrame {
        right: [f32; 4],
        up: [f32; 4],
        direction: [f32; 4],
    }

    /// A surfel as occluder and receiver.
    struct BakeSurfel {
        position: [f32; 4],
        axis_a: [f32; 4],
        axis_b: [f32; 4],
        normal: [f32; 4],
    }
}

fn wide(v: Vec3, w: f32) -> [f32; 4] {
    v.extend(w).to_array()
}

/// Surfels on the GPU with how many they are.
type SurfelChunk = (wgpu::Buffer, usize);

struct Baker<'a> {
    context: &'a Context,
    resolution: usize,
    draw_small: Arc<ComputePass>,
    draw_large: Arc<ComputePass>,
    look_up: Arc<ComputePass>,
    small: Vec<SurfelChunk>,
    large: Vec<SurfelChunk>,
    receivers: Vec<SurfelChunk>,
    maps: wgpu::Buffer,
}

/// Bakes openness `[n][N]` in bytes.
///
/// # Errors
/// The driver failed, or `progress` asked to stop.
pub fn bake_harmonic(
    context: &Context,
    input: &BakeInput,
    progress: Progress<'_>,
) -> Result<Vec<u8>> {
    let baker = Baker::new(context, input);
    let directions = input.frames.len();
    let mut open = vec![0u8; input.surfels.len() * directions];
    for first in (0..directions).step_by(READ_BACK_DIRECTIONS) {
        let frames = &input.frames[first..directions.min(first + READ_BACK_DIRECTIONS)];
        let batches = frames.len().div_ceil(DIRECTION_BATCH);
        let results: Vec<wgpu::Buffer> = baker
            .receivers
            .iter()
            .map(|(_, count)| context.storage(count * batches * DIRECTION_BATCH))
            .collect();
        for (batch, frames) in frames.chunks(DIRECTION_BATCH).enumerate() {
            let done = first + batch * DIRECTION_BATCH;
            if progress(done as f64 / directions as f64).is_break() {
                return Err(GpuError::Cancelled);
            }
            baker.bake_batch(frames, batch, batches, &results)?;
        }
        let padded = batches * DIRECTION_BATCH;
        for (chunk, ((_, count), result)) in baker.receivers.iter().zip(&results).enumerate() {
            let bytes: Vec<u8> = context.read(result, count * padded)?;
            let rows = open[chunk * CHUNK * directions..].chunks_exact_mut(directions);
            for (row, bytes) in rows.zip(bytes.chunks_exact(padded)) {
                row[first..first + frames.len()].copy_from_slice(&bytes[..frames.len()]);
            }
        }
    }
    Ok(open)
}

impl<'a> Baker<'a> {
    fn new(context: &'a Context, input: &BakeInput) -> Self {
        let source = shader::BAKE_HARMONIC.source();
        let texel = 2.0 / input.resolution as f32;
        let upload = |surfels: &[&CoreSurfel], at_once: usize| -> Vec<SurfelChunk> {
            let convert = |s: &&CoreSurfel| BakeSurfel {
                position: wide(s.position, s.bias),
                axis_a: wide(s.axes[0], 0.0),
                axis_b: wide(s.axes[1], 0.0),
                normal: wide(s.normal, 0.0),
            };
            let chunks = surfels.chunks(at_once).map(|chunk| {
                let converted: Vec<BakeSurfel> = chunk.iter().map(convert).collect();
                let surfels = context.upload(&converted, BufferUsages::STORAGE);
                (surfels, chunk.len())
            });
            chunks.collect()
        };
        let is_small = |s: &&CoreSurfel| {
            let reach = s.axes[0].length_squared() + s.axes[1].length_squared();
            (2.0 * reach.sqrt() / texel + 2.0).powi(2) <= SMALL_TEXELS
        };
        let receivers: Vec<&CoreSurfel> = input.surfels.iter().collect();
        let casting = input.surfels.iter().filter(|s| s.axes[0] != Vec3::ZERO);
        let (small, large): (Vec<_>, Vec<_>) = casting.partition(is_small);
        Self {
            context,
            resolution: input.resolution,
            draw_small: context.compute_pass(&source, "draw_small"),
            draw_large: context.compute_pass(&source, "draw_large"),
            look_up: context.compute_pass(&source, "look_up"),
            small: upload(&small, CHUNK),
            large: upload(&large, LARGE_AT_ONCE),
            receivers: upload(&receivers, CHUNK),
            maps: context.storage(DIRECTION_BATCH * input.resolution * input.resolution * 4),
        }
    }

    fn bake_batch(
        &self,
        frames: &[CoreFrame],
        batch: usize,
        batches: usize,
        results: &[wgpu::Buffer],
    ) -> Result<()> {
        // A short batch repeats its last direction; what comes of it is dropped at read-back.
        let frames: Vec<MapFrame> = (0..DIRECTION_BATCH)
            .map(|i| &frames[i.min(frames.len() - 1)])
            .map(|f| MapFrame {
                right: wide(f.right, 0.0),
                up: wide(f.up, 0.0),
                direction: wide(f.direction, 0.0),
            })
            .collect();
        let frames = self.context.upload(&frames, BufferUsages::UNIFORM);
        let bind = |pass: &ComputePass, chunk: &SurfelChunk, open: Option<&wgpu::Buffer>| {
            let parameters = HarmonicParameters {
                count: chunk.1 as u32,
                resolution: self.resolution as u32,
                batch: batch as u32,
                batches: batches as u32,
            };
            let parameters = self.context.upload(&[parameters], BufferUsages::UNIFORM);
            let mut bindings = vec![
                ("parameters", &parameters),
                ("frames", &frames),
                ("surfels", &chunk.0),
                ("maps", &self.maps),
                ("finished", &self.maps),
            ];
            bindings.extend(open.map(|open| ("open", open)));
            self.context.bind(pass, &bindings)
        };
        let mut encoder = self.context.encoder();
        encoder.clear_buffer(&self.maps, 0, None);
        for chunk in &self.small {
            let group = bind(&self.draw_small, chunk, None);
            let groups = [chunk.1.div_ceil(WORKGROUP), DIRECTION_BATCH, 1];
            self.draw_small.dispatch(&mut encoder, &group, groups);
        }
        self.context.submit(encoder);
        for chunk in &self.large {
            let group = bind(&self.draw_large, chunk, None);
            let groups = [chunk.1, DIRECTION_BATCH, 1];
            self.context.run(&self.draw_large, &group, groups);
            self.context.wait()?;
        }
        let mut encoder = self.context.encoder();
        for (chunk, result) in self.receivers.iter().zip(results) {
            let group = bind(&self.look_up, chunk, Some(result));
            let groups = [chunk.1.div_ceil(WORKGROUP), 1, 1];
            self.look_up.dispatch(&mut encoder, &group, groups);
        }
        self.context.submit(encoder);
        // Keeps a driver's queue short, and the progress honest.
        self.context.wait()
    }
}
