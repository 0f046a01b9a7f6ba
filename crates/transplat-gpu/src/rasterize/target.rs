//! Render target.

use half::slice::HalfFloatSliceExt;
use transplat_core::rasterize::Raster;

use crate::context::{Context, Result};

/// Render target: premultiplied colour, and depth times alpha.
#[derive(Clone, Debug)]
pub struct Target {
    pub(crate) color: wgpu::Texture,
    /// Where it is asked for.
    pub(crate) depth: Option<wgpu::Texture>,
    /// Width and height in pixels.
    pub size: [usize; 2],
}

impl Target {
    /// A target of `size` pixels, which an adapter must be able to hold, with depth or without: as exact as the adapter blends.
    pub fn new(context: &Context, size: [usize; 2], has_depth: bool) -> Self {
        Self::of(context, size, has_depth, context.color_format)
    }

    /// One for a screen of eight bits. Half floats are blended twice as fast as whole ones, and what they lose is far below a step of those.
    pub fn of_screen(context: &Context, size: [usize; 2], has_depth: bool) -> Self {
        Self::of(context, size, has_depth, wgpu::TextureFormat::Rgba16Float)
    }

    fn of(
        context: &Context,
        size: [usize; 2],
        has_depth: bool,
        color_format: wgpu::TextureFormat,
    ) -> Self {
        use wgpu::TextureUsages as Usages;
        let usage = Usages::RENDER_ATTACHMENT | Usages::COPY_SRC | Usages::COPY_DST;
        let texture = |label, format| context.texture(label, size, format, usage);
        Self {
            color: texture("color", color_format),
            depth: has_depth.then(|| texture("depth", context.depth_format)),
            size,
        }
    }

    /// Takes a picture of its size that the CPU drew.
    pub(crate) fn write(&self, context: &Context, raster: &Raster, depth_unit: f32) {
        write_texture(context, &self.color, raster.pixels.as_flattened());
        if let Some(depth) = &self.depth {
            let pixels = raster.pixels.iter().zip(&raster.depth);
            let values: Vec<f32> = pixels.map(|([.., a], d)| a * d / depth_unit).collect();
            write_texture(context, depth, &values);
        }
    }
}

/// Writes a texture's values `[height][width][channels]`; half floats are held to what they can be.
pub(crate) fn write_texture(context: &Context, texture: &wgpu::Texture, values: &[f32]) {
    let format = texture.format();
    let mut halves = Vec::new();
    let bytes: &[u8] = match format {
        wgpu::TextureFormat::Rgba16Float | wgpu::TextureFormat::R16Float => {
            halves.resize(values.len(), half::f16::ZERO);
            let held = values.iter().map(|v| v.min(half::f16::MAX.to_f32()));
            halves.convert_from_f32_slice(&held.collect::<Vec<_>>());
            bytemuck::cast_slice(halves.reinterpret_cast())
        }
        _ => bytemuck::cast_slice(values),
    };
    let pixel_bytes = format.block_copy_size(None).unwrap_or_default();
    let layout = wgpu::TexelCopyBufferLayout {
        offset: 0,
        bytes_per_row: Some(texture.width() * pixel_bytes),
        rows_per_image: None,
    };
    let to = texture.as_image_copy();
    (context.queue).write_texture(to, bytes, layout, texture.size());
}

/// A target's values `[height][width][channels]` as f32.
pub(crate) fn read_texture(context: &Context, texture: &wgpu::Texture) -> Result<Vec<f32>> {
    let (format, height) = (texture.format(), texture.height() as usize);
    let pixel_bytes = format.block_copy_size(None).unwrap_or_default();
    let row_bytes = (texture.width() * pixel_bytes) as usize;
    let padded = row_bytes.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT as usize);
    let copy = |encoder: &mut wgpu::CommandEncoder, buffer: &wgpu::Buffer| {
        let layout = wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some(padded as u32),
            rows_per_image: None,
        };
        let to = wgpu::TexelCopyBufferInfo { buffer, layout };
        encoder.copy_texture_to_buffer(texture.as_image_copy(), to, texture.size());
    };
    let of_row = |row: &[u8]| -> Vec<f32> {
        let row = &row[..row_bytes];
        let as_f32 = |v: &[u8]| half::f16::from_le_bytes([v[0], v[1]]).to_f32();
        match format {
            wgpu::TextureFormat::Rgba8Unorm => row.iter().map(|v| f32::from(*v) / 255.0).collect(),
            wgpu::TextureFormat::Rgba16Float | wgpu::TextureFormat::R16Float => {
                row.chunks_exact(2).map(as_f32).collect()
            }
            _ => bytemuck::pod_collect_to_vec(row),
        }
    };
    context.read_back(padded * height, copy, |bytes| {
        bytes.chunks_exact(padded).flat_map(of_row).collect()
    })
}
