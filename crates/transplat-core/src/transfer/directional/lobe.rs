//! Specular lobe: cosine lobes of several widths with an optional Fresnel term.
//!
//! It is `((1 + cos) / 2)^p` around the mirrored view, a power of two: a few multiplications instead of an exponential. It keeps
//! its energy (`(p + 1) / 4 pi`), and is dark below the surface's horizon.

use std::f32::consts::PI;

use multiversion::multiversion;

use super::nodes::{BLOCK, QuadratureNodes, SurfelFrame};
use super::rays::Rays;

/// The lobes' widths: the exponents are 2 to these powers. GGX roughness alpha is about `1 / sqrt(p)`.
pub const WIDTHS: [u32; 5] = [3, 4, 5, 6, 7];

/// Mirrored radiance at the nodes, `[3][Q]` into `out`; the rays are in the world, and `frame` is the surfel's.
pub fn mirrored(
    nodes: &QuadratureNodes,
    frame: SurfelFrame,
    width: u32,
    rays: &Rays,
    out: &mut [f32],
) {
    for start in (0..nodes.count()).step_by(BLOCK) {
        let at = (start, frame);
        // Unrolled for each width: six times as fast as a loop.
        match width {
            0..=3 => sum_lobes::<3, 1, BLOCK>(nodes, at, rays, out),
            4 => sum_lobes::<4, 1, BLOCK>(nodes, at, rays, out),
            5 => sum_lobes::<5, 1, BLOCK>(nodes, at, rays, out),
            6 => sum_lobes::<6, 1, BLOCK>(nodes, at, rays, out),
            _ => sum_lobes::<7, 1, BLOCK>(nodes, at, rays, out),
        }
    }
}

/// Evaluates lobes of all [`WIDTHS`], `[WIDTHS][3][Q]`: one lobe is the square of the one before, three and two at once and few nodes, so that their
/// sums stay in registers.
pub(super) fn mirrored_by_all(
    nodes: &QuadratureNodes,
    frame: SurfelFrame,
    rays: &Rays,
    out: &mut [f32],
) {
    const FEW: usize = 8;
    const { assert!(matches!(WIDTHS, [3, 4, 5, 6, 7])) };
    let (first, rest) = out.split_at_mut(3 * 3 * nodes.count());
    for start in (0..nodes.count()).step_by(FEW) {
        sum_lobes::<3, 3, FEW>(nodes, (start, frame), rays, first);
        sum_lobes::<6, 2, FEW>(nodes, (start, frame), rays, rest);
    }
}

/// Sums the first nodes from `start` on by lobes of consecutive widths, `[LOBES][3][Q]`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn sum_lobes<const WIDTH: u32, const LOBES: usize, const NODES: usize>(
    nodes: &QuadratureNodes,
    at: (usize, SurfelFrame),
    rays: &Rays,
    out: &mut [f32],
) {
    let (start, frame) = at;
    let q = nodes.count();
    let count = NODES.min(q - start);
    // Half of the mirrored view, so that half of `1 + cos` is one sum.
    let mut half = [[0f32; NODES]; 3];
    for axis in 0..3 {
        half[axis].copy_from_slice(&nodes.half_mirrored[axis][start..start + NODES]);
    }
    let m = frame.mirror;
    for i in 0..NODES {
        let along = 2.0 * (half[0][i] * m.x + half[1][i] * m.y + half[2][i] * m.z);
        half[0][i] -= along * m.x;
        half[1][i] -= along * m.y;
        half[2][i] -= along * m.z;
    }
    // Far from its axis a lobe is nothing; numbers too small for f32's range would only be slow.
    let least = FAINTEST.powf(0.5f32.powi(WIDTH as i32));
    let least_root = FAINTEST.sqrt();
    let mut sum = [[[0f32; NODES]; 3]; LOBES];
    for ray in rays.lit() {
        let at = |planes: &[[f32; Rays::MOST]; 3]| [0, 1, 2].map(|c| planes[c][usize::from(*ray)]);
        let (d, e) = (at(&rays.direction), at(&rays.energy));
        let mut lobe = [0f32; NODES];
        for i in 0..NODES {
            let near = 0.5 + half[0][i] * d[0] + half[1][i] * d[1] + half[2][i] * d[2];
            lobe[i] = if near > least { near } else { least };
            for _ in 0..WIDTH {
                lobe[i] *= lobe[i];
            }
        }
        for (width, sum) in sum.iter_mut().enumerate() {
            if width > 0 {
                for l in &mut lobe {
                    let root = if *l > least_root { *l } else { least_root };
                    *l = root * root;
                }
            }
            for c in 0..3 {
                for i in 0..NODES {
                    sum[c][i] += lobe[i] * e[c];
                }
            }
        }
    }
    for (l, (sum, out)) in sum.iter().zip(out.chunks_exact_mut(3 * q)).enumerate() {
        let scale = peak(WIDTH + l as u32);
        for c in 0..3 {
            for i in 0..count {
                out[c * q + start + i] = scale * sum[c][i];
            }
        }
    }
}

/// A lobe counts as at least that everywhere.
const FAINTEST: f32 = 1e-20;

/// The lobe along its axis, which makes its integral 1.
#[inline(always)]
pub(super) fn peak(width: u32) -> f32 {
    ((1u32 << width) as f32 + 1.0) / (4.0 * PI)
}
