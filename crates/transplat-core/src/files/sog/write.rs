//! Writer of SOG version 2, bundled.

use std::io::{Seek, Write};

use image::ImageEncoder;
use image::codecs::webp::WebPEncoder;
use serde_json::json;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

use super::codebook::{codebook, nearest, palette};
use super::layout::{ENTRIES_IN_A_ROW, META, ROTATION_MODE};
use crate::files::packed::{component_share, share_code, without_largest};
use crate::files::written::WritableSplat;
use crate::sh::coefficient_count;

/// The highest degree that the format knows.
pub(in crate::files) const MAX_DEGREE: usize = 3;

/// Entries of the palette of higher SH, at most.
const MAX_ENTRIES: usize = 1 << 16;

/// Writes a splat, of which so many that a picture holds them.
pub(in crate::files) fn write(
    splat: &WritableSplat<'_>,
    out: &mut (impl Write + Seek),
) -> std::io::Result<()> {
    let n = splat.len();
    let gaussians: Vec<_> = (0..n).map(|i| splat.gaussian(i)).collect();
    // Multiples of 4, as its own writer has it.
    let width = ((n as f64).sqrt() / 4.0).ceil() as usize * 4;
    let size = [width, n.div_ceil(width).next_multiple_of(4)];
    let picture = |of: &dyn Fn(usize) -> [u8; 4]| webp(size, n, of);

    let log = |v: f64| v.signum() * v.abs().ln_1p();
    let logs = |a: usize| gaussians.iter().map(move |g| log(g.position[a]));
    let mins: [f64; 3] = std::array::from_fn(|a| logs(a).fold(f64::INFINITY, f64::min));
    let maxs: [f64; 3] = std::array::from_fn(|a| logs(a).fold(f64::NEG_INFINITY, f64::max));
    let means: Vec<[u16; 3]> = (gaussians.iter())
        .map(|g| {
            std::array::from_fn(|a| {
                let span = maxs[a] - mins[a];
                let share = if span > 0.0 {
                    (log(g.position[a]) - mins[a]) / span
                } else {
                    0.0
                };
                (share * f64::from(u16::MAX)).round() as u16
            })
        })
        .collect();
    let byte_of_means = |i: usize, byte: usize| {
        let [x, y, z] = means[i].map(|v| v.to_le_bytes()[byte]);
        [x, y, z, 255]
    };
    let scales = codebook(gaussians.iter().flat_map(|g| g.log_scales));
    let colors = codebook(gaussians.iter().flat_map(|g| g.sh[0]));

    let mut files = vec![
        ("means_l.webp", picture(&|i| byte_of_means(i, 0))?),
        ("means_u.webp", picture(&|i| byte_of_means(i, 1))?),
        (
            "scales.webp",
            picture(&|i| {
                let [x, y, z] = gaussians[i].log_scales.map(|v| nearest(&scales, v));
                [x, y, z, 255]
            })?,
        ),
        (
            "quats.webp",
            picture(&|i| {
                let (largest, others) = without_largest(gaussians[i].rotation);
                let [a, b, c] = others.map(|v| share_code(component_share(v), 8) as u8);
                [a, b, c, ROTATION_MODE + largest as u8]
            })?,
        ),
        (
            "sh0.webp",
            picture(&|i| {
                let [r, g, b] = gaussians[i].sh[0].map(|v| nearest(&colors, v));
                [r, g, b, share_code(gaussians[i].opacity, 8) as u8]
            })?,
        ),
    ];
    let mut meta = json!({
        "version": 2,
        "asset": {"generator": concat!("transplat ", env!("CARGO_PKG_VERSION"))},
        "count": n,
        "means": {"mins": mins, "maxs": maxs, "files": ["means_l.webp", "means_u.webp"]},
        "scales": {"codebook": scales.to_vec(), "files": ["scales.webp"]},
        "quats": {"files": ["quats.webp"]},
        "sh0": {"codebook": colors.to_vec(), "files": ["sh0.webp"]},
    });
    if splat.is_antialiased {
        meta["antialias"] = json!(true);
        meta["model"] = json!("antialiased");
    }
    let degree = splat.degree.min(MAX_DEGREE);
    if degree > 0 {
        let higher = coefficient_count(degree) - 1;
        let vectors: Vec<f32> = (gaussians.iter())
            .flat_map(|g| g.sh[1..=higher].iter().flatten().copied())
            .collect();
        let (centroids, labels) = palette(&vectors, 3 * higher, MAX_ENTRIES);
        let values = codebook(centroids.iter().copied());
        let entries = centroids.len() / (3 * higher);
        let size = [
            ENTRIES_IN_A_ROW * higher,
            entries.div_ceil(ENTRIES_IN_A_ROW),
        ];
        let pixels = centroids.len() / 3;
        let centroid = |i: usize| {
            let [r, g, b] = std::array::from_fn(|c| nearest(&values, centroids[3 * i + c]));
            [r, g, b, 255]
        };
        files.push(("shN_centroids.webp", webp(size, pixels, &centroid)?));
        let label = |i: usize| {
            let [low, high] = labels[i].to_le_bytes();
            [low, high, 0, 255]
        };
        files.push(("shN_labels.webp", picture(&label)?));
        meta["shN"] = json!({
            "count": entries,
            "bands": degree,
            "codebook": values.to_vec(),
            "files": ["shN_centroids.webp", "shN_labels.webp"],
        });
    }
    files.push((META, serde_json::to_vec(&meta)?));
    let mut zip = ZipWriter::new(out);
    // Pictures are compressed already, and some readers know nothing else.
    let stored = SimpleFileOptions::default().compression_method(CompressionMethod::Stored);
    for (name, bytes) in files {
        zip.start_file(name, stored)?;
        zip.write_all(&bytes)?;
    }
    zip.finish()?;
    Ok(())
}

/// A picture of so many pixels, row by row; what is left of it is 0.
fn webp(
    [width, height]: [usize; 2],
    pixels: usize,
    of: &dyn Fn(usize) -> [u8; 4],
) -> std::io::Result<Vec<u8>> {
    let mut raw = vec![0; 4 * width * height];
    for (i, pixel) in raw.as_chunks_mut().0.iter_mut().take(pixels).enumerate() {
        *pixel = of(i);
    }
    let mut bytes = Vec::new();
    let written = WebPEncoder::new_lossless(&mut bytes).write_image(
        &raw,
        width as u32,
        height as u32,
        image::ExtendedColorType::Rgba8,
    );
    written.map_err(std::io::Error::other)?;
    Ok(bytes)
}
