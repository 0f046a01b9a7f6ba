//! The preset `best`: sums over directions instead of products of SH series, and what the asset's own colour under the source light
//! tells of it. `docs/method.md` derives it.
//!
//! Once for an asset: [`BestAsset`]. Once for asset and source light: [`BestTransfer`]. A new light is then sums over light.

mod lobe;
mod nodes;

use std::num::NonZeroUsize;
use std::sync::Arc;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use multiversion::multiversion;
use rayon::prelude::*;

use crate::color::{
    Encoding, MAX_LINEAR, MAX_STORED, STORED_OFFSET, srgb_decode, srgb_encode, srgb_encode_all,
};
use crate::environment::{Beam, Beams};
use crate::sh::coefficient_count;
use crate::surfels::SurfelCloud;
use crate::visibility::occlusion::{
    BACK, DIRECTIONS, HIT_DIRECTIONS, HIT_STRIDE, Occlusion, WORDS, lattice, smoothstep,
};
use crate::visibility::trace::Tracer;
use crate::visibility::{BakeInput, BakeSettings};

use lobe::{Fitted, Gloss, find_gloss, fresnel, mirrored};
use nodes::{Frame, Nodes};

/// Surfels around one that its gloss is pooled over.
const NEIGHBORS: usize = 64;

/// Turns of the fixed point by which light bounces.
const TURNS: usize = 3;

/// The irradiance that every surfel has at least, relative to the mean irradiance of the source.
const EPSILON: f32 = 0.006;

/// The back of a two-sided surfel changes by at most this factor more or less than its front.
const BACK_RANGE: f32 = 4.0;

/// Cosine to the horizon within which a two-sided surfel's sides blend.
const HORIZON: f32 = 0.2;

/// Added to both encoded brightnesses whose ratio scales the residual.
const RESIDUAL_FLOOR: f32 = 0.02;

/// What of an asset no light changes.
#[derive(Debug)]
pub struct BestAsset {
    nodes: Nodes,
    encoding: Encoding,
    occlusion: Arc<Occlusion>,
    tracer: Tracer,
    input: BakeInput,
    order: Vec<u32>,
    lattice: Vec<Vec3>,
    /// The same. `[3][DIRECTIONS]`
    planes: Planes,
    /// For each direction, the nearest that knows what it meets, by its place among those.
    nearest_hit: Vec<u16>,
    /// Stored colour. `[n][K]`
    sh: Vec<[f32; 3]>,
    /// Linear colour at the front's nodes. `[n][Q]`
    colors: Vec<[f32; 3]>,
    /// Mean linear colour of the front and the back: the exitance under the source light, over pi. `[n]`
    means: [Vec<[f32; 3]>; 2],
    neighbors: Vec<u32>,
}

/// A light as a surfel meets it.
struct Incident {
    /// Energy from each direction of the lattice.
    cells: Vec<[f32; 3]>,
    suns: Vec<(Beam, Vec<bool>)>,
    /// Irradiance of front and back. `[n]`
    irradiance: [Vec<[f32; 3]>; 2],
}

/// An asset under its source light, ready for any other.
#[derive(Debug)]
pub struct BestTransfer {
    asset: Arc<BestAsset>,
    light_gain: f32,
    fresnel: Vec<f32>,
    gloss: Vec<Gloss>,
    /// Irradiance, bounced light and epsilon under the source, front and back. `[n]`
    divisor: [Vec<[f32; 3]>; 2],
    mean_irradiance: [f32; 3],
    /// Colour at the nodes that gloss does not explain. `[n][Q]`
    matte: Vec<[f32; 3]>,
    /// Stored colour that the model of the source misses. `[n][K]`
    residual: Vec<[f32; 3]>,
    /// Mean encoded colour that the model of the source has. `[n]`
    encoded_mean: Vec<[f32; 3]>,
}

/// A relit asset.
#[derive(Clone, Debug)]
pub struct Relit {
    /// Colour as the asset's own is stored. `[n][K]`
    pub sh: Vec<[f32; 3]>,
    /// How much the matte part of the front changed. `[n]`
    pub tau: Vec<[f32; 3]>,
}

fn to_linear(encoding: Encoding, value: f32) -> f32 {
    match encoding {
        Encoding::Stored => srgb_decode((value + STORED_OFFSET).clamp(0.0, MAX_STORED)),
        Encoding::StoredLinear => (value + STORED_OFFSET).max(0.0),
        Encoding::Linear => value.max(0.0),
    }
}

/// [`to_stored`] of many values.
fn all_to_stored(encoding: Encoding, linear: &mut [[f32; 3]]) {
    let values = bytemuck::cast_slice_mut::<[f32; 3], f32>(linear);
    for v in values.iter_mut() {
        *v = v.clamp(0.0, MAX_LINEAR);
    }
    let offset = match encoding {
        Encoding::Stored => {
            srgb_encode_all(values);
            STORED_OFFSET
        }
        Encoding::StoredLinear => STORED_OFFSET,
        Encoding::Linear => 0.0,
    };
    for v in values {
        *v -= offset;
    }
}

fn to_stored(encoding: Encoding, linear: f32) -> f32 {
    let linear = linear.clamp(0.0, MAX_LINEAR);
    match encoding {
        Encoding::Stored => srgb_encode(linear) - STORED_OFFSET,
        Encoding::StoredLinear => linear - STORED_OFFSET,
        Encoding::Linear => linear,
    }
}

impl BestAsset {
    /// Takes an asset and its bake.
    pub fn new(cloud: &SurfelCloud, occlusion: Arc<Occlusion>) -> Self {
        let nodes = Nodes::new(cloud.sh_degree);
        let encoding = cloud.encoding;
        let input = BakeInput::new(cloud, &BakeSettings { directions: 16 });
        let lattice = lattice();
        let k = coefficient_count(cloud.sh_degree);
        let q = nodes.count();
        type Seen = (Vec<[f32; 3]>, [[f32; 3]; 2]);
        let per_surfel: Vec<Seen> = cloud
            .sh
            .par_chunks_exact(k)
            .zip(&occlusion.normals)
            .map(|(sh, n)| {
                let mut f = sh.to_vec();
                Frame::new(*n).apply_sh(cloud.sh_degree, &mut f);
                let [front, back] = [&nodes.evaluate, &nodes.evaluate_back].map(|e| {
                    let mut values = nodes.values(e, &f);
                    for v in values.iter_mut().flatten() {
                        *v = to_linear(encoding, *v);
                    }
                    values
                });
                let means = [&front, &back].map(|v| weighted_mean(&nodes.weights, v));
                (front, means)
            })
            .collect();
        let mut colors = Vec::with_capacity(cloud.len() * q);
        let mut means = [Vec::new(), Vec::new()];
        for (c, m) in per_surfel {
            colors.extend(c);
            means[0].push(m[0]);
            means[1].push(m[1]);
        }
        let nearest_hit = lattice
            .iter()
            .map(|d| {
                (0..HIT_DIRECTIONS)
                    .max_by(|a, b| {
                        let cosine = |i: &usize| lattice[i * HIT_STRIDE].dot(*d);
                        cosine(a).total_cmp(&cosine(b))
                    })
                    .unwrap_or(0) as u16
            })
            .collect();
        Self {
            neighbors: neighbors(&input, &occlusion.normals),
            tracer: Tracer::new(&input),
            order: Tracer::order(&input),
            input,
            nodes,
            encoding,
            occlusion,
            planes: planes(lattice.iter().map(|d| d.to_array())),
            lattice,
            nearest_hit,
            sh: cloud.sh.clone(),
            colors,
            means,
        }
    }

    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.occlusion.len()
    }

    /// Whether there is no surfel.
    pub fn is_empty(&self) -> bool {
        self.occlusion.is_empty()
    }

    fn incident(&self, light: &Beams) -> Incident {
        let cells = light.gathered(&self.lattice);
        let suns: Vec<(Beam, Vec<bool>)> = light
            .suns
            .iter()
            .map(|s| {
                let open = self
                    .tracer
                    .open_towards(&self.input, &self.order, s.direction);
                (*s, open)
            })
            .collect();
        let energies = planes(cells.iter().copied());
        let sides: Vec<[[f32; 3]; 2]> = (0..self.len())
            .into_par_iter()
            .map(|i| self.irradiance(i, &energies, &suns))
            .collect();
        Incident {
            cells,
            suns,
            irradiance: [0, 1].map(|s| sides.iter().map(|e| e[s]).collect()),
        }
    }

    /// Irradiance of surfel `i`, front and back.
    fn irradiance(&self, i: usize, cells: &Planes, suns: &[(Beam, Vec<bool>)]) -> [[f32; 3]; 2] {
        let n = self.occlusion.normals[i];
        let mut sides = open_irradiance(n, &self.occlusion.open[i], &self.planes, cells);
        for (sun, open) in suns {
            if open[i] {
                let cosine = n.dot(sun.direction);
                for (s, e) in sides[usize::from(cosine < 0.0)].iter_mut().zip(sun.energy) {
                    *s += cosine.abs() * e;
                }
            }
        }
        sides
    }

    /// Light that bounces to each surfel, front and back, from what the others radiate. `[n]`
    fn gathered(&self, radiance: &[Vec<[f32; 3]>; 2]) -> [Vec<[f32; 3]>; 2] {
        let scale = 4.0 * std::f32::consts::PI / HIT_DIRECTIONS as f32;
        let sides: Vec<[[f32; 3]; 2]> = (0..self.len())
            .into_par_iter()
            .map(|i| {
                let n = self.occlusion.normals[i];
                let mut sides = [[0f32; 3]; 2];
                for hit in self.occlusion.hits_of(i) {
                    let cosine = n.dot(self.lattice[usize::from(hit.direction)]);
                    let b = radiance_of(radiance, hit.surfel);
                    for (s, b) in sides[usize::from(cosine < 0.0)].iter_mut().zip(b) {
                        *s += scale * cosine.abs() * b;
                    }
                }
                sides
            })
            .collect();
        [0, 1].map(|s| sides.iter().map(|e| e[s]).collect())
    }

    /// All that shines on the front of surfel `i`: cells, suns, and what is met where the light is blocked.
    fn beams_of(
        &self,
        i: usize,
        light: &Incident,
        radiance: &[Vec<[f32; 3]>; 2],
        out: &mut Vec<Beam>,
    ) {
        out.clear();
        let n = self.occlusion.normals[i];
        let mut met = [u32::MAX; HIT_DIRECTIONS];
        for hit in self.occlusion.hits_of(i) {
            met[usize::from(hit.direction) / HIT_STRIDE] = hit.surfel;
        }
        let scale = 4.0 * std::f32::consts::PI / DIRECTIONS as f32;
        for (j, (direction, e)) in self.lattice.iter().zip(&light.cells).enumerate() {
            if n.dot(*direction) <= 0.0 {
                continue;
            }
            let energy = if self.occlusion.is_open(i, j) {
                *e
            } else {
                match met[usize::from(self.nearest_hit[j])] {
                    u32::MAX => radiance[0][i],
                    hit => radiance_of(radiance, hit),
                }
                .map(|b| b * scale)
            };
            out.push(Beam {
                direction: *direction,
                energy,
            });
        }
        let above = |sun: &Beam| n.dot(sun.direction) > 0.0;
        let shining = light
            .suns
            .iter()
            .filter(|(sun, open)| open[i] && above(sun));
        out.extend(shining.map(|(sun, _)| *sun));
    }
}

/// Three numbers a direction, as structure of arrays.
type Planes = [Vec<f32>; 3];

fn planes(values: impl Iterator<Item = [f32; 3]> + Clone) -> Planes {
    std::array::from_fn(|c| values.clone().map(|v| v[c]).collect())
}

/// Sum over the open directions of cosine times energy, front and back.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn open_irradiance(
    n: Vec3,
    open: &[u64; WORDS],
    lattice: &Planes,
    cells: &Planes,
) -> [[f32; 3]; 2] {
    const LANES: usize = 16;
    let mut sums = [[[0f32; LANES]; 3]; 2];
    for start in (0..DIRECTIONS).step_by(LANES) {
        let bits = (open[start / 64] >> (start % 64)) as u32;
        let part = |p: &Planes, c: usize| -> [f32; LANES] {
            let mut out = [0f32; LANES];
            out.copy_from_slice(&p[c][start..start + LANES]);
            out
        };
        let (x, y, z) = (part(lattice, 0), part(lattice, 1), part(lattice, 2));
        let mut cosines = [[0f32; LANES]; 2];
        for i in 0..LANES {
            let cosine = n.x * x[i] + n.y * y[i] + n.z * z[i];
            let seen = ((bits >> i) & 1) as f32;
            cosines[0][i] = seen * if cosine > 0.0 { cosine } else { 0.0 };
            cosines[1][i] = seen * if cosine < 0.0 { -cosine } else { 0.0 };
        }
        for c in 0..3 {
            let e = part(cells, c);
            for side in 0..2 {
                for i in 0..LANES {
                    sums[side][c][i] += cosines[side][i] * e[i];
                }
            }
        }
    }
    sums.map(|side| side.map(|lanes| lanes.iter().sum()))
}

fn radiance_of(radiance: &[Vec<[f32; 3]>; 2], hit: u32) -> [f32; 3] {
    radiance[usize::from(hit & BACK != 0)][(hit & !BACK) as usize]
}

fn weighted_mean(weights: &[f32], values: &[[f32; 3]]) -> [f32; 3] {
    let mut sum = [0f32; 3];
    for (w, v) in weights.iter().zip(values) {
        for (s, v) in sum.iter_mut().zip(v) {
            *s += w * v;
        }
    }
    sum
}

/// Share of surfels whose albedo is below the whitest one, so that a few odd ones do not count.
const WHITEST: f32 = 0.95;

/// The asset's whitest albedo as it appears: exitance over irradiance, the mean of the channels.
fn whitest(means: &[[f32; 3]], divisor: &[[f32; 3]]) -> f32 {
    let mut albedos: Vec<f32> = means
        .iter()
        .zip(divisor)
        .map(|(m, d)| std::f32::consts::PI * m.iter().sum::<f32>() / d.iter().sum::<f32>())
        .filter(|a| a.is_finite())
        .collect();
    if albedos.is_empty() {
        return 1.0;
    }
    let index = ((albedos.len() - 1) as f32 * WHITEST) as usize;
    (*albedos.select_nth_unstable_by(index, f32::total_cmp).1).max(1e-12)
}

/// The surfels nearest in place and normal: probably of the same stuff. `[n][min(NEIGHBORS, n - 1)]`
fn neighbors(input: &BakeInput, normals: &[Vec3]) -> Vec<u32> {
    let n = normals.len();
    let mean_size: f32 = input.surfels.iter().map(|s| s.bias).sum::<f32>() / n.max(1) as f32;
    let unit = 1.0 / (3.0 * mean_size).max(1e-12);
    let points: Vec<[f32; 6]> = input
        .surfels
        .iter()
        .zip(normals)
        .map(|(s, n)| {
            let (p, n) = (s.position * unit, *n * 2.0);
            [p.x, p.y, p.z, n.x, n.y, n.z]
        })
        .collect();
    let count = NEIGHBORS.min(n.saturating_sub(1));
    let (Some(wanted), Ok(tree)) = (
        NonZeroUsize::new(count + 1).filter(|_| count > 0),
        ImmutableKdTree::<f32, 6>::new_from_slice(&points),
    ) else {
        return Vec::new();
    };
    points
        .par_iter()
        .enumerate()
        .flat_map_iter(|(i, p)| {
            let found = tree
                .query(p)
                .nearest_n::<SquaredEuclidean<f32>>(wanted)
                .execute();
            let others: Vec<u32> = found
                .into_iter()
                .map(|f| f.item)
                .filter(|j| *j as usize != i)
                .take(count)
                .collect();
            others
        })
        .collect()
}

impl BestTransfer {
    /// Prepares asset and source light.
    pub fn new(asset: &Arc<BestAsset>, source: &Beams) -> Self {
        let mean = source.mean_irradiance();
        let light_gain = (1.0 / mean).clamp(1e-30, 1e30);
        let light = asset.incident(&source.tinted([light_gain; 3]));
        let bounced = asset.gathered(&asset.means);
        let divisor: [Vec<[f32; 3]>; 2] = [0, 1].map(|s| {
            light.irradiance[s]
                .iter()
                .zip(&bounced[s])
                .map(|(e, b)| std::array::from_fn(|c| e[c] + b[c] + EPSILON))
                .collect()
        });
        let white = whitest(&asset.means[0], &divisor[0]);
        let fitted = Fitted {
            white,
            nodes: &asset.nodes,
            normals: &asset.occlusion.normals,
            colors: &asset.colors,
            means: &asset.means[0],
            neighbors: &asset.neighbors,
            two_sided: &asset.occlusion.two_sided,
        };
        let gloss = find_gloss(&fitted, &|i, out| {
            asset.beams_of(i, &light, &asset.means, out)
        });
        let mut transfer = Self {
            asset: asset.clone(),
            light_gain,
            fresnel: fresnel(&asset.nodes),
            gloss,
            divisor,
            mean_irradiance: mean_of(&light.irradiance[0]),
            matte: Vec::new(),
            residual: Vec::new(),
            encoded_mean: Vec::new(),
        };
        transfer.explain(&light);
        transfer
    }

    /// Splits the asset's colour into what gloss explains, what is matte, and what neither shows.
    fn explain(&mut self, light: &Incident) {
        let asset = self.asset.clone();
        let (q, k) = (asset.nodes.count(), coefficient_count(asset.nodes.degree));
        type Part = (Vec<[f32; 3]>, Vec<[f32; 3]>, [f32; 3]);
        let parts: Vec<Part> = (0..asset.len())
            .into_par_iter()
            .map_init(Scratch::default, |scratch, i| {
                let colors = &asset.colors[i * q..][..q];
                let glossy = self.glossy(i, light, &asset.means, scratch);
                let mut matte = colors.to_vec();
                if !glossy.is_empty() {
                    let seen = asset.nodes.values(&asset.nodes.refit, &glossy);
                    for (m, s) in matte.iter_mut().zip(&seen) {
                        *m = std::array::from_fn(|c| (m[c] - s[c]).max(0.0));
                    }
                }
                let stored = self.stored(&matte, &glossy, [1.0; 3]);
                let mean = mean_of(&stored);
                let mut fit = asset.nodes.function(&asset.nodes.fit, &stored);
                Frame::new(asset.occlusion.normals[i]).apply_sh(asset.nodes.degree, &mut fit);
                for (f, s) in fit.iter_mut().zip(&asset.sh[i * k..]) {
                    *f = std::array::from_fn(|c| s[c] - f[c]);
                }
                (matte, fit, mean)
            })
            .collect();
        for (matte, residual, mean) in parts {
            self.matte.extend(matte);
            self.residual.extend(residual);
            self.encoded_mean.push(mean);
        }
    }

    /// What surfel `i` mirrors towards each node. `[Q]`, or empty where that is nothing
    fn glossy(
        &self,
        i: usize,
        light: &Incident,
        radiance: &[Vec<[f32; 3]>; 2],
        scratch: &mut Scratch,
    ) -> Vec<[f32; 3]> {
        let q = self.asset.nodes.count();
        let gloss = &self.gloss[i];
        if gloss.is_matte() {
            return Vec::new();
        }
        self.asset.beams_of(i, light, radiance, &mut scratch.beams);
        scratch.values.resize(3 * q, 0.0);
        mirrored(
            &self.asset.nodes,
            Frame::new(self.asset.occlusion.normals[i]),
            gloss.width,
            &scratch.beams,
            &mut scratch.values,
        );
        (0..q)
            .map(|s| {
                let rise = if gloss.rises { self.fresnel[s] } else { 1.0 };
                std::array::from_fn(|c| rise * gloss.reflectance[c] * scratch.values[c * q + s])
            })
            .collect()
    }

    /// Stored colour of `matte * tau + glossy`, `[Q]`; `glossy` is empty where there is none.
    fn stored(&self, matte: &[[f32; 3]], glossy: &[[f32; 3]], tau: [f32; 3]) -> Vec<[f32; 3]> {
        let mut out: Vec<[f32; 3]> = matte
            .iter()
            .map(|m| std::array::from_fn(|c| m[c] * tau[c]))
            .collect();
        for (o, g) in out.iter_mut().zip(glossy) {
            for c in 0..3 {
                o[c] += g[c];
            }
        }
        all_to_stored(self.asset.encoding, &mut out);
        out
    }

    /// Relights.
    pub fn relight(&self, target: &Beams) -> Relit {
        let asset = &*self.asset;
        let light = asset.incident(&target.tinted([self.light_gain; 3]));
        let (tau, radiance) = self.bounce(&light);
        let k = coefficient_count(asset.nodes.degree);
        let mut sh = vec![[0f32; 3]; asset.len() * k];
        sh.par_chunks_exact_mut(k).enumerate().for_each_init(
            Scratch::default,
            |scratch, (i, out)| {
                self.relight_surfel(i, &light, [tau[0][i], tau[1][i]], &radiance, scratch, out);
            },
        );
        let [tau, _] = tau;
        Relit { sh, tau }
    }

    /// How much the matte light changes on each side, and what each side then radiates: a fixed point, since what one surfel gains lights others.
    #[allow(clippy::type_complexity)]
    fn bounce(&self, light: &Incident) -> ([Vec<[f32; 3]>; 2], [Vec<[f32; 3]>; 2]) {
        let asset = &*self.asset;
        let mean = mean_of(&light.irradiance[0]);
        let start: [f32; 3] = std::array::from_fn(|c| mean[c] / self.mean_irradiance[c].max(1e-12));
        let mut radiance = asset.means.clone().map(|side| {
            side.into_iter()
                .map(|b| std::array::from_fn(|c| b[c] * start[c]))
                .collect::<Vec<[f32; 3]>>()
        });
        let mut tau = [Vec::new(), Vec::new()];
        for _ in 0..TURNS {
            let bounced = asset.gathered(&radiance);
            for s in 0..2 {
                tau[s] = (0..asset.len())
                    .map(|i| {
                        std::array::from_fn(|c| {
                            (light.irradiance[s][i][c] + bounced[s][i][c] + EPSILON)
                                / self.divisor[s][i][c]
                        })
                    })
                    .collect::<Vec<[f32; 3]>>();
                for ((b, m), t) in radiance[s].iter_mut().zip(&asset.means[s]).zip(&tau[s]) {
                    *b = std::array::from_fn(|c| m[c] * t[c]);
                }
            }
        }
        (tau, radiance)
    }

    fn relight_surfel(
        &self,
        i: usize,
        light: &Incident,
        tau: [[f32; 3]; 2],
        radiance: &[Vec<[f32; 3]>; 2],
        scratch: &mut Scratch,
        out: &mut [[f32; 3]],
    ) {
        let asset = &*self.asset;
        let (q, k) = (asset.nodes.count(), out.len());
        let glossy = self.glossy(i, light, radiance, scratch);
        let stored = self.stored(&self.matte[i * q..][..q], &glossy, tau[0]);
        let mean = mean_of(&stored);
        let offset = if asset.encoding == Encoding::Linear {
            0.0
        } else {
            STORED_OFFSET
        };
        let scale: [f32; 3] = std::array::from_fn(|c| {
            let floor = offset + RESIDUAL_FLOOR;
            (mean[c] + floor) / (self.encoded_mean[i][c] + floor)
        });
        let frame = Frame::new(asset.occlusion.normals[i]);
        asset.nodes.fit_into(&stored, out);
        let two_sided = asset.occlusion.two_sided[i];
        if two_sided > 0.0 {
            self.add_back(i, tau, two_sided, out);
        }
        frame.apply_sh(asset.nodes.degree, out);
        for (o, r) in out.iter_mut().zip(&self.residual[i * k..]) {
            for c in 0..3 {
                o[c] += r[c] * scale[c];
            }
        }
    }

    /// What changes of a two-sided surfel's colour because its back has a light of its own.
    fn add_back(&self, i: usize, tau: [[f32; 3]; 2], two_sided: f32, out: &mut [[f32; 3]]) {
        let asset = &*self.asset;
        let k = out.len();
        let mut f = asset.sh[i * k..][..k].to_vec();
        Frame::new(asset.occlusion.normals[i]).apply_sh(asset.nodes.degree, &mut f);
        let ratio: [f32; 3] = std::array::from_fn(|c| {
            (tau[1][c] / tau[0][c].max(1e-12)).clamp(1.0 / BACK_RANGE, BACK_RANGE)
        });
        let sides = [
            (&asset.nodes.evaluate, 1.0),
            (&asset.nodes.evaluate_back, -1.0),
        ];
        for ((evaluate, side), project) in sides.into_iter().zip(&asset.nodes.project) {
            let values: Vec<[f32; 3]> = asset
                .nodes
                .values(evaluate, &f)
                .into_iter()
                .zip(&asset.nodes.to_camera)
                .map(|(v, d)| {
                    let share = two_sided * smoothstep(-HORIZON, HORIZON, -side * d.z);
                    std::array::from_fn(|c| {
                        let front = to_linear(asset.encoding, v[c]) * tau[0][c];
                        to_stored(asset.encoding, front * ratio[c].powf(share))
                            - to_stored(asset.encoding, front)
                    })
                })
                .collect();
            for (o, p) in out.iter_mut().zip(asset.nodes.function(project, &values)) {
                for c in 0..3 {
                    o[c] += p[c];
                }
            }
        }
    }
}

#[derive(Default)]
struct Scratch {
    beams: Vec<Beam>,
    values: Vec<f32>,
}

fn mean_of(values: &[[f32; 3]]) -> [f32; 3] {
    let mut sum = [0f64; 3];
    for v in values {
        for c in 0..3 {
            sum[c] += f64::from(v[c]);
        }
    }
    sum.map(|s| (s / values.len().max(1) as f64) as f32)
}

#[cfg(test)]
mod tests;
