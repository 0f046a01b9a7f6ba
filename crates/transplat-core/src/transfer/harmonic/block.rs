//! The transfer's kernel: [`LANES`] surfels at a time as structure of arrays, compiled for several instruction sets.

use glam::Vec3;
use multiversion::multiversion;

use crate::lanes::{LANES, Lanes, mirror_of};
use crate::sh::{
    LightOperator, MAX_COEFFICIENTS, Real, SQRT_4PI, band, band_of, coefficient_count,
    cosine_kernel, evaluate_basis,
};

/// Radiance beyond this is held to it.
pub const MAX_RADIANCE: f32 = 1e15;

/// The prepared data of [`LANES`] surfels; the last block repeats its last surfel.
#[derive(Clone, Debug)]
pub(super) struct Block {
    normal: [Lanes; 3],
    dc_over_irradiance: [Lanes; 3],
    /// `[K]`; empty where the shadow term is off.
    visibility: Vec<Lanes>,
    /// `[specular_degree][3]`
    attenuation: Vec<[Lanes; 3]>,
}

/// Degrees of a transfer, and what it writes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    pub light_degree: usize,
    pub asset_degree: usize,
    /// The highest band that the specular term writes; 0 where there is none.
    pub specular_degree: usize,
    /// True where the specular term is mirrored about the normal.
    pub reflects: bool,
}

/// Rows that blocks are gathered from.
pub(super) struct BlockRows<'a> {
    /// `[n]`
    pub normals: &'a [Vec3],
    /// `[n][K]`; empty where the shadow term is off.
    pub visibility: &'a [f32],
    /// `[n][3]`
    pub dc_over_irradiance: &'a [[f32; 3]],
    /// `[n][specular_degree][3]`
    pub attenuation: &'a [[f32; 3]],
}

impl Block {
    pub(super) fn new(p: &BlockRows<'_>, extent: Extent, first: usize) -> Self {
        let gather = |value: &dyn Fn(usize) -> f32| {
            Lanes(std::array::from_fn(|lane| {
                value((first + lane).min(p.normals.len() - 1))
            }))
        };
        let k = coefficient_count(extent.light_degree);
        let kept = if p.visibility.is_empty() { 0 } else { k };
        let bands = extent.specular_degree;
        Self {
            normal: std::array::from_fn(|axis| gather(&|i| p.normals[i][axis])),
            dc_over_irradiance: std::array::from_fn(|c| gather(&|i| p.dc_over_irradiance[i][c])),
            visibility: (0..kept)
                .map(|q| gather(&|i| p.visibility[i * k + q]))
                .collect(),
            attenuation: (0..bands)
                .map(|l| std::array::from_fn(|c| gather(&|i| p.attenuation[i * bands + l][c])))
                .collect(),
        }
    }
}

/// Relights one block into `out` `[surfels][K][3]` (fewer than [`LANES`] surfels in the last block).
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2", "aarch64+neon"))]
pub(super) fn relight_block(p: Extent, light: &LightOperator, block: &Block, out: &mut [[f32; 3]]) {
    let degree = p.light_degree;
    let asset_k = coefficient_count(p.asset_degree);
    let [x, y, z] = block.normal;
    let mut cosine_basis = [Lanes::ZERO; MAX_COEFFICIENTS];
    evaluate_basis([x, y, z], degree, &mut cosine_basis);
    let k = coefficient_count(degree);
    for (i, y) in cosine_basis[..k].iter_mut().enumerate() {
        *y = *y * Lanes::of(cosine_kernel(band_of(i)));
    }
    let reflect = p.reflects && p.specular_degree > 0;
    let mirror = reflect.then(|| mirror_of(degree, [x, y, z]));
    let mut result = [Lanes::ZERO; MAX_COEFFICIENTS];
    let (mut shadowed, mut irradiance) = ([Lanes::ZERO; MAX_COEFFICIENTS], Lanes::ZERO);
    for channel in 0..3 {
        // The channels of a grey light are one.
        if channel == 0 || !light.is_gray {
            let matrix = &light.matrices[channel];
            shadow(matrix, &block.visibility, &mut shadowed[..k]);
            irradiance = Lanes::ZERO;
            for (y, l) in cosine_basis[..k].iter().zip(&shadowed[..k]) {
                irradiance = irradiance + *y * *l;
            }
            irradiance = irradiance.map2(Lanes::ZERO, |e, zero| if e > zero { e } else { zero });
            if let Some(mirror) = &mirror {
                for l in 1..=p.specular_degree {
                    mirror.reflect_band(l, &mut shadowed[band(l)]);
                }
            }
        }
        result[0] = block.dc_over_irradiance[channel] * irradiance;
        for l in 1..=p.specular_degree {
            for (r, f) in result[band(l)].iter_mut().zip(&shadowed[band(l)]) {
                *r = block.attenuation[l - 1][channel] * *f;
            }
        }
        for (i, lanes) in result[..asset_k].iter().enumerate() {
            for (surfel, v) in out.chunks_exact_mut(asset_k).zip(lanes.0) {
                surfel[i][channel] = v.clamp(-MAX_RADIANCE, MAX_RADIANCE);
            }
        }
    }
}

/// `shadowed_k = sum_q M_kq V_q`; without visibility, V is the constant 1.
#[inline(always)]
fn shadow(matrix: &[f32], visibility: &[Lanes], shadowed: &mut [Lanes]) {
    let k = shadowed.len();
    if visibility.is_empty() {
        for (s, row) in shadowed.iter_mut().zip(matrix.chunks_exact(k)) {
            *s = Lanes([row[0] * SQRT_4PI as f32; LANES]);
        }
        return;
    }
    for (s, row) in shadowed.iter_mut().zip(matrix.chunks_exact(k)) {
        let mut sum = Lanes::ZERO;
        for (m, v) in row.iter().zip(visibility) {
            sum = sum + Lanes([*m; LANES]) * *v;
        }
        *s = sum;
    }
}
