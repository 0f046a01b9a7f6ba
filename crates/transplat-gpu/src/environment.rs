//! Stage *project environment* on the GPU. CPU twin: [`transplat_core::environment::project_environment`].

use transplat_core::environment::{EnvironmentMap, IncidentRadiance, azimuth, row_weights};
use transplat_core::sh::coefficient_count;
use wgpu::BufferUsages;

use crate::context::{Context, Result};
use crate::layout::gpu_struct;
use crate::shader;

/// Pixels are uploaded and summed in pieces of at most this many bytes.
const PIECE_BYTES: usize = 64 << 20;

gpu_struct! {
    in "project_environment";
    /// Uniforms of the pass.
    struct ProjectParameters {
        width: u32,
        first_row: u32,
    }
}

/// Projects a map: rows on the GPU, their sum in f64.
///
/// # Errors
/// The driver failed.
pub fn project_environment(
    context: &Context,
    map: &EnvironmentMap,
    degree: usize,
) -> Result<IncidentRadiance> {
    let k = coefficient_count(degree);
    let (width, height) = (map.width(), map.height());
    let pass = context.compute_pass(&shader::project_environment(degree), "project_rows");
    let azimuths: Vec<[f32; 2]> = (0..width)
        .map(|column| {
            let (sin, cos) = azimuth(column, width).sin_cos();
            [cos as f32, sin as f32]
        })
        .collect();
    let weights: Vec<f32> = (0..height)
        .flat_map(|row| row_weights(map, row, degree))
        .map(|w| w as f32)
        .collect();
    let azimuths = context.upload(&azimuths, BufferUsages::STORAGE);
    let weights = context.upload(&weights, BufferUsages::STORAGE);
    let row_sums = context.storage(height * k * 12);
    let rows_at_once = (PIECE_BYTES / (12 * width)).clamp(1, 1 << 15);
    for (piece, pixels) in map.pixels().chunks(rows_at_once * width).enumerate() {
        let parameters = ProjectParameters {
            width: width as u32,
            first_row: (piece * rows_at_once) as u32,
        };
        let parameters = context.upload(&[parameters], BufferUsages::UNIFORM);
        let pixels_on_gpu = context.upload(pixels, BufferUsages::STORAGE);
        let bind_group = context.bind(
            &pass,
            &[
                ("parameters", &parameters),
                ("pixels", &pixels_on_gpu),
                ("azimuths", &azimuths),
                ("row_weights", &weights),
                ("row_sums", &row_sums),
            ],
        );
        context.run(&pass, &bind_group, [pixels.len() / width, 1, 1]);
        context.wait()?;
    }
    let rows: Vec<[f32; 3]> = context.read(&row_sums, height * k)?;
    let mut sums = vec![[0f64; 3]; k];
    for (i, value) in rows.iter().enumerate() {
        for (sum, v) in sums[i % k].iter_mut().zip(value) {
            *sum += f64::from(*v);
        }
    }
    Ok(IncidentRadiance {
        degree,
        coefficients: sums.iter().map(|c| c.map(|v| v as f32)).collect(),
    })
}
