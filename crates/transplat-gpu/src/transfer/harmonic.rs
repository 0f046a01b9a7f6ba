//! The harmonic method. CPU twin: [`HarmonicTransfer::relight_into`].

use std::sync::Arc;

use transplat_core::sh::LightOperator;
use transplat_core::transfer::harmonic::HarmonicTransfer;
use wgpu::BufferUsages;

use crate::CHUNK;
use crate::context::{ComputePass, Context, Result};
use crate::layout::gpu_struct;
use crate::shader::{self, TransferShape};

gpu_struct! {
    in "transfer_harmonic";
    /// Inputs of a surfel besides its visibility.
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
    pub(crate) prepared: Arc<HarmonicTransfer>,
    pass: Arc<ComputePass>,
    operator: wgpu::Buffer,
    operator_floats: usize,
    chunks: Vec<Chunk>,
}

impl GpuHarmonic {
    /// Uploads what does not change with the light.
    ///
    /// # Errors
    /// The driver failed.
    pub fn new(context: &Arc<Context>, prepared: &Arc<HarmonicTransfer>) -> Result<Self> {
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
                upload_chunk(context, &pass, &operator, prepared, first, count)
            })
            .collect();
        context.wait()?;
        Ok(Self {
            context: context.clone(),
            prepared: prepared.clone(),
            pass,
            operator,
            operator_floats,
            chunks,
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
            self.context.run_each(&self.pass, &chunk.group, chunk.count);
        }
    }

    /// The last result, linear SH `[n][K][3]`.
    ///
    /// # Errors
    /// The driver failed.
    pub fn read(&self) -> Result<Vec<[f32; 3]>> {
        let (mut out, k) = (Vec::new(), self.prepared.coefficients());
        for chunk in &self.chunks {
            out.extend(
                self.context
                    .read::<[f32; 3]>(&chunk.relit, chunk.count * k)?,
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
    let relit = context.storage(count * p.coefficients() * 12);
    let count_on_gpu = context.upload(&[count as u32], BufferUsages::UNIFORM);
    let surfels = context.upload(&surfels, BufferUsages::STORAGE);
    let visibility = context.upload(&visibility, BufferUsages::STORAGE);
    let attenuation = context.upload(&attenuation, BufferUsages::STORAGE);
    let bindings = [
        ("count", &count_on_gpu),
        ("surfels", &surfels),
        ("relit", &relit),
        ("operator_of_light", operator),
        ("visibility", &visibility),
        ("attenuation", &attenuation),
    ];
    Chunk {
        count,
        group: context.bind(pass, &bindings),
        relit,
    }
}
