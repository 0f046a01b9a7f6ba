//! The harmonic method (paper 3.3 to 3.5): products of SH series of light and visibility, and reflection of the specular bands.
//!
//! Everything that does not change with the target is prepared once; a new light is then one matrix-vector product,
//! one dot product and one mirror a surfel and channel. Surfels are worked on in blocks.

mod block;

use std::f32::consts::PI;
use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::materials::{Material, Materials};
use super::relit::{Part, Relight, Relit, empty_bytes, switched_off};
use crate::bake::harmonic::HarmonicBake;
use crate::color::{Encoding, decode_sh};
use crate::environment::{Illumination, IncidentRadiance};
use crate::error::{Error, Result};
use crate::lanes::LANES;
use crate::numeric::over;
use crate::settings::TransferSettings;
use crate::settings::optimizations::{Optimization, SkippedWork, Stage};
use crate::sh::{
    LightOperator, MAX_COEFFICIENTS, SQRT_4PI, band, coefficient_count, cosine_kernel,
    evaluate_basis, light_operator,
};
use crate::surfels::SurfelCloud;

pub use block::MAX_RADIANCE;
use block::{Block, BlockRows, Extent, relight_block};

/// A target light stronger than the source by more than this is held to it, so that no result overflows.
const MAX_RELATIVE_LIGHT: f32 = 1e12;

/// The attenuation when that term is off: a mirror under a source of mean radiance 1, in units of its mean irradiance.
pub const UNATTENUATED: f32 = PI;

/// Inputs of the GPU pass and the CPU kernel: everything of splat and source light that a change of target does not touch.
#[derive(Clone, Debug)]
pub struct HarmonicTransfer {
    /// Settings it was prepared with.
    pub settings: TransferSettings,
    /// Number of surfels.
    pub surfels: usize,
    /// The middle of the asset: lights that are near are as they are seen from there.
    pub center: Vec3,
    /// Degree of lights and visibility.
    pub light_degree: usize,
    /// Degree of the result: the asset's, or less where its upper bands would be empty.
    pub asset_degree: usize,
    /// The highest band that the specular term writes; 0 where there is none.
    pub specular_degree: usize,
    /// Unit normals, two-sided surfels turned to the side that the source lights more. `[n]`
    pub normals: Vec<Vec3>,
    /// Visibility coefficients `[n][K]`; empty where the shadow term is off.
    pub visibility: Arc<Vec<f32>>,
    /// Linear DC of the asset over `E_S + eps`, per channel. `[n][3]`
    pub dc_over_irradiance: Vec<[f32; 3]>,
    /// Attenuation `A_l` (paper eq. 9) of bands 1 to `specular_degree`, per channel. `[n][specular_degree][3]`
    pub attenuation: Vec<[f32; 3]>,
    /// Factor of target lights: 1 over the source's mean irradiance.
    pub light_gain: f32,
    /// True where the source was black, and even light was taken in its place.
    pub source_was_black: bool,
    /// Share of surfels whose source irradiance is below epsilon in some channel: their ratio is epsilon's, not the light's.
    pub dark_share: f32,
    /// Linear DC of the asset `[n][3]`, to tell the ratio tau.
    pub dc: Vec<[f32; 3]>,
    /// True where the source on a surfel is darker than epsilon, `[n]`.
    dark: Vec<bool>,
    blocks: Vec<Block>,
}

/// Part of a preparation that no light changes: kept between changes of the source and of the settings.
#[derive(Clone, Debug)]
pub struct HarmonicCache {
    /// Linear radiance SH `[n][K][3]`.
    linear: Arc<Vec<[f32; 3]>>,
    has_view_dependence: bool,
    /// Visibility coefficients `[n][K]` of the degree last asked for, and of which bake.
    visibility: Option<(usize, u64, Arc<Vec<f32>>)>,
}

impl HarmonicCache {
    /// Decodes the asset's colour.
    pub fn new(cloud: &SurfelCloud) -> Self {
        Self {
            linear: Arc::new(decode_sh(&cloud.sh, cloud.sh_degree, cloud.encoding)),
            has_view_dependence: cloud.has_view_dependence(),
            visibility: None,
        }
    }

    /// Prepares asset and source light; `bake` is any number that differs between bakes.
    ///
    /// # Errors
    /// As [`HarmonicTransfer::new`].
    pub fn prepare(
        &mut self,
        cloud: &SurfelCloud,
        visibility: &HarmonicBake,
        bake: u64,
        source: &IncidentRadiance,
        settings: &TransferSettings,
    ) -> Result<HarmonicTransfer> {
        if source.degree != settings.sh_degree {
            return Err(Error::Mismatch(format!(
                "the source light has SH degree {}, and the settings ask for {}",
                source.degree, settings.sh_degree
            )));
        }
        let light_degree = settings.sh_degree;
        let v = match &self.visibility {
            _ if !settings.terms.shadow => Arc::default(),
            Some((d, b, kept)) if (*d, *b) == (light_degree, bake) => kept.clone(),
            _ => {
                let new = Arc::new(visibility.coefficients(light_degree));
                self.visibility = Some((light_degree, bake, new.clone()));
                new
            }
        };
        let source_was_black = source.is_black();
        let source = if source_was_black {
            IncidentRadiance::even(light_degree)
        } else {
            source.clone()
        };
        let mean = source.mean_irradiance();
        let light_gain = (1.0 / mean).clamp(1e-30, 1e30);
        let source = source.scaled(light_gain);
        let specular_degree = if settings.terms.specular && self.has_view_dependence {
            explained_degree(&source, settings).min(cloud.sh_degree)
        } else {
            0
        };
        let linear = &self.linear;
        let operator = light_operator(light_degree, &source.coefficients);
        let per_surfel: Vec<(Vec3, [f32; 3])> = (0..cloud.len())
            .into_par_iter()
            .map(|i| {
                let shadowed = shadowed_light(&operator, &v, i);
                let (n, two_sided) = (visibility.normals[i], visibility.two_sided[i]);
                let front = irradiance(&shadowed, light_degree, n);
                if two_sided {
                    let back = irradiance(&shadowed, light_degree, -n);
                    if back.iter().sum::<f32>() > front.iter().sum() {
                        return (-n, back);
                    }
                }
                (n, front)
            })
            .collect();
        let k = coefficient_count(cloud.sh_degree);
        let dc: Vec<[f32; 3]> = linear.chunks_exact(k).map(|f| f[0]).collect();
        let dark: Vec<bool> = per_surfel
            .iter()
            .map(|(_, e)| e.iter().any(|e| *e < settings.epsilon()))
            .collect();
        let dark_count = dark.iter().filter(|d| **d).count();
        let mut prepared = HarmonicTransfer {
            settings: settings.clone(),
            center: cloud.bounds().center,
            surfels: cloud.len(),
            light_degree,
            asset_degree: if settings.optimizations.has(Optimization::EmptyBands) {
                specular_degree
            } else {
                cloud.sh_degree
            },
            specular_degree,
            normals: per_surfel.iter().map(|s| s.0).collect(),
            visibility: v,
            dc_over_irradiance: per_surfel
                .iter()
                .zip(&dc)
                .map(|((_, e), dc)| {
                    std::array::from_fn(|c| bounded(dc[c] / (e[c] + settings.epsilon())))
                })
                .collect(),
            attenuation: attenuation(linear, k, specular_degree, &source, settings),
            light_gain,
            source_was_black,
            dark_share: dark_count as f32 / cloud.len().max(1) as f32,
            dc,
            dark,
            blocks: Vec::new(),
        };
        prepared.make_blocks();
        Ok(prepared)
    }
}

impl HarmonicTransfer {
    /// Prepares asset and source light.
    ///
    /// # Errors
    /// The source's degree is not the settings'.
    pub fn new(
        cloud: &SurfelCloud,
        visibility: &HarmonicBake,
        source: &IncidentRadiance,
        settings: &TransferSettings,
    ) -> Result<Self> {
        HarmonicCache::new(cloud).prepare(cloud, visibility, 0, source, settings)
    }

    /// Transfer under targets that are shadowed by another bake, whose first surfels are these.
    pub(super) fn shadowed_as(&self, bake: &HarmonicBake) -> Self {
        let mut shadowed = self.clone();
        if self.settings.terms.shadow {
            let mut visibility = bake.coefficients(self.light_degree);
            visibility.truncate(self.visibility.len());
            shadowed.visibility = Arc::new(visibility);
            shadowed.make_blocks();
        }
        shadowed
    }

    fn make_blocks(&mut self) {
        let rows = BlockRows {
            normals: &self.normals,
            visibility: &self.visibility,
            dc_over_irradiance: &self.dc_over_irradiance,
            attenuation: &self.attenuation,
        };
        let extent = self.extent();
        self.blocks = (0..self.surfels.div_ceil(LANES))
            .into_par_iter()
            .map(|b| Block::new(&rows, extent, b * LANES))
            .collect();
    }

    fn extent(&self) -> Extent {
        Extent {
            light_degree: self.light_degree,
            asset_degree: self.asset_degree,
            specular_degree: self.specular_degree,
            reflects: self.settings.terms.reflection,
        }
    }

    /// Coefficients of the result, per surfel.
    pub fn coefficients(&self) -> usize {
        coefficient_count(self.asset_degree)
    }

    /// The target light in units of the source's mean irradiance, as the operator that shadows it: `M_kq = sum_p G_kpq L_p`, per channel.
    /// Bands that it lacks are dark, those beyond the transfer's degree are ignored.
    ///
    /// With `shadow` off, the visibility is the constant 1, whose only coefficient is the DC: the same operator serves.
    pub fn light(&self, target: &IncidentRadiance) -> LightOperator {
        let relative: Vec<[f32; 3]> = (0..coefficient_count(self.light_degree))
            .map(|i| target.coefficients.get(i).copied().unwrap_or([0.0; 3]))
            .map(|c| {
                c.map(|v| (v * self.light_gain).clamp(-MAX_RELATIVE_LIGHT, MAX_RELATIVE_LIGHT))
            })
            .collect();
        let mut operator = light_operator(self.light_degree, &relative);
        operator.is_gray &= self.settings.optimizations.has(Optimization::GrayLight);
        operator
    }

    /// Relights: linear radiance SH into `sh` `[n][K][3]`, and the transfer ratio into `tau` `[n][3]` while the surfels are at hand.
    fn relight_into(&self, light: &LightOperator, sh: &mut [[f32; 3]], tau: &mut [[f32; 3]]) {
        let (k, extent) = (self.coefficients(), self.extent());
        sh.par_chunks_mut(LANES * k)
            .zip(tau.par_chunks_mut(LANES))
            .zip(self.dc.par_chunks(LANES))
            .zip(&self.blocks)
            .for_each(|(((sh, tau), dc), block)| {
                relight_block(extent, light, block, sh);
                ratios(sh.chunks_exact(k), dc, tau);
            });
    }

    /// Relights surfel `i` alone: linear radiance SH `[K][3]`.
    ///
    /// # Panics
    /// If there is no such surfel.
    pub fn relight_one(&self, light: &LightOperator, i: usize) -> Vec<[f32; 3]> {
        let k = self.coefficients();
        let (block, lane) = (i / LANES, i % LANES);
        let count = LANES.min(self.surfels - block * LANES);
        let mut out = vec![[0f32; 3]; count * k];
        relight_block(self.extent(), light, &self.blocks[block], &mut out);
        out[lane * k..][..k].to_vec()
    }

    /// Relights into a new vector.
    pub fn relight(&self, target: &IncidentRadiance) -> Vec<[f32; 3]> {
        let mut sh = vec![[0f32; 3]; self.surfels * self.coefficients()];
        let mut tau = vec![[0f32; 3]; self.surfels];
        self.relight_into(&self.light(target), &mut sh, &mut tau);
        sh
    }

    /// A part of a result `[n][K][3]` that was computed elsewhere, with what belongs to it.
    pub fn relit(&self, sh: Vec<[f32; 3]>, part: Part) -> Relit {
        let mut tau = vec![[0f32; 3]; self.surfels];
        ratios(sh.chunks_exact(self.coefficients()), &self.dc, &mut tau);
        self.part_of(sh, tau, part)
    }

    fn part_of(&self, mut sh: Vec<[f32; 3]>, tau: Vec<[f32; 3]>, part: Part) -> Relit {
        let k = self.coefficients();
        let wanted = part.coefficients(k);
        if wanted != (0..k) {
            for function in sh.chunks_exact_mut(k) {
                function[..wanted.start].fill([0.0; 3]);
                function[wanted.end..].fill([0.0; 3]);
            }
        }
        Relit {
            sh,
            degree: self.asset_degree,
            encoding: Encoding::Linear,
            tau,
            shadows: Vec::new(),
        }
    }
}

impl Relight for HarmonicTransfer {
    fn relight_after(
        &self,
        last: Option<Relit>,
        target: &Illumination,
        part: Part,
        _: &[bool],
    ) -> Result<Relit> {
        let (mut sh, mut tau) = last.map_or_else(Default::default, |last| (last.sh, last.tau));
        sh.resize(self.surfels * self.coefficients(), [0.0; 3]);
        tau.resize(self.surfels, [0.0; 3]);
        let target = self.light(&target.at_one_place(self.center).radiance);
        self.relight_into(&target, &mut sh, &mut tau);
        Ok(self.part_of(sh, tau, part))
    }

    /// All of it: the parts are bands of one result.
    fn computed_part(&self, _: Part) -> Part {
        Part::Whole
    }

    fn tau(&self, target: &Illumination) -> Result<Vec<[f32; 3]>> {
        Ok(self.relight_seen(target, Part::Whole, &[])?.tau)
    }

    /// Materials of the diffuse part; this method does not separate the specular lobe.
    fn materials(&self, whitest: Option<f32>) -> Materials {
        let per_dc = PI * self.light_gain / SQRT_4PI as f32;
        let each = self.dc_over_irradiance.iter().zip(&self.normals);
        let each = each.map(|(dc, normal)| Material {
            normal: *normal,
            base_color: dc.map(|v| per_dc * v),
            metallic: 0.0,
            roughness: 1.0,
            reflectance: [0.0; 3],
            emission_share: 0.0,
            emission: [0.0; 3],
        });
        // What hardly any light reaches says nothing of how white it is.
        let lit = self.dark.iter().map(|dark| f32::from(u8::from(!dark)));
        Materials::of(each.collect(), lit, whitest)
    }

    fn skipped_work(&self, cloud: &SurfelCloud) -> Vec<SkippedWork> {
        let mut out = switched_off(&self.settings);
        let degree = self.specular_degree;
        if degree == cloud.sh_degree {
            return out;
        }
        let bytes = empty_bytes(self.surfels, cloud.sh_degree, self.asset_degree);
        let may_skip = self.settings.optimizations.has(Optimization::EmptyBands);
        let skip = may_skip.then_some(Optimization::EmptyBands);
        if degree > 0 {
            let what = format!("SH bands above {degree} of the asset");
            let why = "the source light has nothing there (see SH degree)";
            out.push(SkippedWork {
                bytes,
                skip,
                max_error: None,
                ..SkippedWork::exact(Stage::Transfer, what, why)
            });
        } else if self.settings.terms.specular {
            let why = if self.settings.sh_degree == 0 {
                "the light has degree 0"
            } else if !cloud.has_view_dependence() {
                "the asset's colour does not depend on the view"
            } else {
                "the source light is uniform: it shows no highlights"
            };
            out.push(SkippedWork {
                bytes,
                skip,
                ..SkippedWork::exact(Stage::Transfer, "specular transfer", why)
            });
        }
        out
    }

    fn skipped_work_for(&self, light: &Illumination, on_gpu: bool) -> Option<SkippedWork> {
        if !light.emitters.is_empty() {
            let why = "preset paper has one light for all Gaussians: lights are as they are seen from the object's middle";
            return Some(SkippedWork {
                max_error: None,
                ..SkippedWork::exact(Stage::Transfer, "how near lights are", why)
            });
        }
        let is_gray = (light.radiance.coefficients.iter())
            .take(coefficient_count(self.light_degree))
            .all(|[r, g, b]| r == g && g == b);
        (is_gray && self.settings.optimizations.has(Optimization::GrayLight) && !on_gpu).then(
            || SkippedWork {
                skip: Some(Optimization::GrayLight),
                ..SkippedWork::exact(
                    Stage::Transfer,
                    "two of three channels",
                    "the light is grey",
                )
            },
        )
    }

    fn light_gain(&self) -> f32 {
        self.light_gain
    }

    fn source_was_black(&self) -> bool {
        self.source_was_black
    }

    fn dark_share(&self) -> f32 {
        self.dark_share
    }

    fn is_dark(&self, i: usize) -> bool {
        self.dark[i]
    }

    fn amplification(&self, i: usize) -> f32 {
        let of = |c: usize| over(self.dc_over_irradiance[i][c], self.dc[i][c]);
        of(0).max(of(1)).max(of(2))
    }

    fn epsilon_share(&self, i: usize) -> f32 {
        let share = |c: usize| {
            let of_epsilon = self.settings.epsilon() * self.dc_over_irradiance[i][c];
            over(of_epsilon, self.dc[i][c]).clamp(0.0, 1.0)
        };
        (share(0) + share(1) + share(2)) / 3.0
    }

    fn bytes(&self) -> usize {
        size_of_val(&self.normals[..])
            + size_of_val(&self.visibility[..])
            + size_of_val(&self.dc_over_irradiance[..])
            + size_of_val(&self.attenuation[..])
    }
}

/// The transfer ratio tau (paper eq. 5) of each surfel: its relit DC over the captured one.
fn ratios<'a>(relit: impl Iterator<Item = &'a [[f32; 3]]>, dc: &[[f32; 3]], tau: &mut [[f32; 3]]) {
    for ((tau, f), dc) in tau.iter_mut().zip(relit).zip(dc) {
        *tau = std::array::from_fn(|c| over(f[0][c], dc[c]));
    }
}

fn bounded(v: f32) -> f32 {
    v.clamp(-MAX_RADIANCE, MAX_RADIANCE)
}

/// `L^shad_k = sum_pq G_kpq L_p V_q` (paper eq. 4) of surfel `i`, `[K][3]`; without visibility the light itself.
fn shadowed_light(operator: &LightOperator, visibility: &[f32], i: usize) -> Vec<[f32; 3]> {
    let k = coefficient_count(operator.degree);
    let mut out = vec![[0f32; 3]; k];
    for (c, matrix) in operator.matrices.iter().enumerate() {
        for (row, out) in matrix.chunks_exact(k).zip(&mut out) {
            out[c] = if visibility.is_empty() {
                row[0] * SQRT_4PI as f32
            } else {
                row.iter()
                    .zip(&visibility[i * k..])
                    .map(|(m, v)| m * v)
                    .sum()
            };
        }
    }
    out
}

/// `E(n) = sum_l A_l sum_m L_lm Y_lm(n)` (paper eq. 3), clamped below at 0: a truncated series may dip under it.
fn irradiance(light: &[[f32; 3]], degree: usize, n: Vec3) -> [f32; 3] {
    let mut y = [0f32; MAX_COEFFICIENTS];
    evaluate_basis(n.to_array(), degree, &mut y);
    let mut e = [0f32; 3];
    for l in 0..=degree {
        let a = cosine_kernel(l) as f32;
        for i in band(l) {
            for (e, light) in e.iter_mut().zip(light[i]) {
                *e += a * y[i] * light;
            }
        }
    }
    e.map(|e| e.max(0.0))
}

/// `||f_l||` of one channel.
fn band_norm(f: &[[f32; 3]], l: usize, c: usize) -> f32 {
    f[band(l)].iter().map(|v| v[c] * v[c]).sum::<f32>().sqrt()
}

/// The highest band that the source explains in some channel.
fn explained_degree(source: &IncidentRadiance, settings: &TransferSettings) -> usize {
    let explained = |l: usize| {
        (0..3).any(|c| explains(band_norm(&source.coefficients, l, c), settings.epsilon()))
    };
    (1..=source.degree)
        .rev()
        .find(|l| explained(*l))
        .unwrap_or(0)
}

/// True where a band of the source, with its norm in units of the source's mean irradiance, explains the splat's specular lobe.
///
/// Below epsilon it does not: eq. 9 would divide the asset's view dependence by epsilon alone, and turn it into chrome (an even
/// light has no such band at all). The paper is silent on this; here such a band transfers nothing.
pub fn explains(source_band_norm: f32, epsilon: f32) -> bool {
    source_band_norm > epsilon
}

/// `A_l = ||c_l|| / (||L_S,l|| + eps)` (paper eq. 9), per channel. `[n][degree][3]`
fn attenuation(
    linear: &[[f32; 3]],
    k: usize,
    degree: usize,
    source: &IncidentRadiance,
    settings: &TransferSettings,
) -> Vec<[f32; 3]> {
    if degree == 0 {
        return Vec::new();
    }
    let norms = |l: usize| std::array::from_fn(|c| band_norm(&source.coefficients, l, c));
    let source_norms = &(0..=degree).map(norms).collect::<Vec<[f32; 3]>>();
    linear
        .par_chunks_exact(k)
        .flat_map_iter(|f| {
            (1..=degree).map(move |l| {
                std::array::from_fn(|c| {
                    if !explains(source_norms[l][c], settings.epsilon()) {
                        0.0
                    } else if settings.terms.attenuation {
                        bounded(band_norm(f, l, c) / (source_norms[l][c] + settings.epsilon()))
                    } else {
                        UNATTENUATED
                    }
                })
            })
        })
        .collect()
}

#[cfg(test)]
mod tests;
