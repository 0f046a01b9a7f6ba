//! The harmonic method. CPU twin: [`HarmonicTransfer::relight_into`].

use std::sync::Arc;

use transplat_core::sh::LightOperator;
use transplat_core::transfer::harmonic::HarmonicTransfer;
use wgpu::BufferUsages;

use crate::context::{ComputePass, Context, Result};
use crate::layout::gpu_struct;
use crate::shader::{self, TransferShape};
use crate::{CHUNK, WORKGROUP};

gpu_struct! {
    in "transfer_harmonic";
    /// Uniforms of the pass.
    struct TransferParameters {
        count: u32,
        stride: u32,
        unused_a: u32,
        unused_b: u32,
    }
}

gpu_struct! {
    in "transfer_harmonic";
    /// What the transfer needs of a surfel besides its visibility.
    struct TransferSurfel {
        normal: [f32; 4],
        dc_over_irradiance: [f32; 4],
    }
}

struct Chunk {
    count: usize,
    group: wgpu::BindGroup,
    relit: wgpu::Buffer,
}

/// A prepared transfer on the GPU: a new light is one upload of its operator and one dispatch a chunk.
pub struct GpuHarmonic {
    context: Arc<Context>,
    pass: Arc<ComputePass>,
    operator: wgpu::Buffer,
    operator_floats: usize,
    chunks: Vec<Chunk>,
    coefficients: usize,
}

impl GpuHarmonic {
    /// Uploads what does not change with the light.
    ///
    /// # Errors
    /// The driver failed.
    pub fn new(context: &Arc<Context>, prepared: &HarmonicTransfer) -> Result<Self> {
        let shape = TransferShape::of(prepared);
        let pass = context.compute_pass(&shader::transfer_harmonic(shape), "relight");
        let operator_floats = 4 * shape.operator_vectors();
        let operator_usage = if shape.operator_is_uniform() {
            BufferUsages::UNIFORM
        } else {
            BufferUsages::STORAGE
        };
        let operator = context.upload(&vec![0f32; operator_floats], operator_usage);
        let chunks = (0..prepared.surfels)
            .step_by(CHUNK)
            .map(|first| {
                let count = CHUNK.min(prepared.surfels - first);
                upload_chunk(context, &pass, &operator, prepared, shape, first, count)
            })
            .collect();
        context.wait()?;
        Ok(Self {
            context: context.clone(),
            pass,
            operator,
            operator_floats,
            chunks,
            coefficients: prepared.coefficients(),
        })
    }

    /// The last result where it is: linear SH `[count][K][3]` of each chunk.
    pub(crate) fn relit(&self) -> Vec<wgpu::Buffer> {
        self.chunks.iter().map(|c| c.relit.clone()).collect()
    }

    /// Relights without waiting: what is submitted afterwards sees the result.
    pub fn submit(&self, light: &LightOperator) {
        let mut floats: Vec<f32> = light.matrices.concat();
        floats.resize(self.operator_floats, 0.0);
        self.context
            .queue
            .write_buffer(&self.operator, 0, bytemuck::cast_slice(&floats));
        for chunk in &self.chunks {
            let mut encoder = self.context.encoder();
            self.pass.dispatch(
                &mut encoder,
                &chunk.group,
                [chunk.count.div_ceil(WORKGROUP), 1, 1],
            );
            self.context.submit(encoder);
        }
    }

    /// The last result, linear SH `[n][K][3]`.
    ///
    /// # Errors
    /// The driver failed.
    pub fn read(&self) -> Result<Vec<[f32; 3]>> {
        let mut out = Vec::new();
        for chunk in &self.chunks {
            out.extend(
                self.context
                    .read::<[f32; 3]>(&chunk.relit, chunk.count * self.coefficients)?,
            );
        }
        Ok(out)
    }
}

fn upload_chunk(
    context: &Context,
    pass: &ComputePass,
    operator: &wgpu::Buffer,
    p: &HarmonicTransfer,
    shape: TransferShape,
    first: usize,
    count: usize,
) -> Chunk {
    let surfels: Vec<TransferSurfel> = (first..first + count)
        .map(|i| {
            let [r, g, b] = p.dc_over_irradiance[i];
            TransferSurfel {
                normal: p.normals[i].extend(0.0).to_array(),
                dc_over_irradiance: [r, g, b, 0.0],
            }
        })
        .collect();
    // One coefficient of all surfels lies together, so that neighbouring threads read neighbouring words.
    let k = p.visibility.len() / p.surfels.max(1);
    let visibility: Vec<f32> = (0..k)
        .flat_map(|q| (first..first + count).map(move |i| p.visibility[i * k + q]))
        .collect();
    let bands = p.specular_degree;
    let attenuation: Vec<f32> = (0..bands * 3)
        .flat_map(|j| (first..first + count).map(move |i| p.attenuation[i * bands + j / 3][j % 3]))
        .collect();
    let parameters = TransferParameters {
        count: count as u32,
        stride: count as u32,
        ..Default::default()
    };
    let relit = context.storage(count * p.coefficients() * 12);
    let parameters = context.upload(&[parameters], BufferUsages::UNIFORM);
    let surfels = context.upload(&surfels, BufferUsages::STORAGE);
    let visibility = context.upload(&visibility, BufferUsages::STORAGE);
    let attenuation = context.upload(&attenuation, BufferUsages::STORAGE);
    // A layout is made from what the shader uses, so what it leaves out must not be bound.
    let mut bindings = vec![
        ("parameters", &parameters),
        ("surfels", &surfels),
        ("relit", &relit),
        ("operator_of_light", operator),
    ];
    if shape.shadow {
        bindings.push(("visibility", &visibility));
    }
    if bands > 0 {
        bindings.push(("attenuation", &attenuation));
    }
    Chunk {
        count,
        group: context.bind(pass, &bindings),
        relit,
    }
}
