//! Gloss: what a surfel mirrors of all that shines on it, blurred by a lobe, and which lobe its own colour speaks of.
//!
//! The lobe is `((1 + cos) / 2)^p` around the mirrored view, a power of two: a few multiplications instead of an exponential. It keeps
//! its energy (`(p + 1) / 4 pi`), and is dark below the surface's horizon.

use std::f32::consts::PI;

use multiversion::multiversion;
use rayon::prelude::*;

use super::asset::{DirectionalAsset, Radiance};
use super::incident::Incident;
use super::neighbors::Neighbors;
use super::nodes::{BLOCK, Nodes, SurfelFrame, weighted_mean};
use super::rays::Rays;
use crate::numeric::smoothstep;

/// The lobes' widths: the exponents are 2 to these powers. GGX roughness alpha is about `1 / sqrt(p)`.
pub const WIDTHS: [u32; 5] = [3, 4, 5, 6, 7];

/// Light that does not vary over the lobe says nothing of gloss: added to what is divided by, in units of the mean irradiance squared.
pub const RIDGE: f32 = 1e-3;

/// Share of a surfel's colour that gloss may explain.
pub const MOST_GLOSS: f32 = 0.98;

/// No surface mirrors more than that many times what the whitest one scatters.
pub const MOST_REFLECTANCE: f32 = 2.0;

/// Squared correlation of mirrored light and colour from which on the lobe counts.
pub const TRUSTED_CORRELATION: f32 = 0.03;

/// Reflectance, in units of the asset's whitest albedo, between which a surface turns from a coated one into a metal: nothing else
/// mirrors that much, and a metal has no other colour.
pub const METAL: [f32; 2] = [0.15, 0.3];

/// A lobe whose peak is fainter than that share of what the whitest surface scatters of the same light is not seen.
pub const LEAST_GLOSS: f32 = 1e-3;

/// Turns of pooling by which neighbours agree on being a metal: one stuff seldom ends within a few surfels, and where normals are off no
/// single one tells.
pub const METAL_TURNS: usize = 8;

/// Mirrored radiance at the nodes, `[3][Q]` into `out`; the rays are in the world, and `frame` is the surfel's.
pub fn mirrored(nodes: &Nodes, frame: SurfelFrame, width: u32, rays: &Rays, out: &mut [f32]) {
    for start in (0..nodes.count()).step_by(BLOCK) {
        // Unrolled for each width: six times as fast as a loop.
        match width {
            0..=3 => sum_lobes::<3>(nodes, start, frame, rays, out),
            4 => sum_lobes::<4>(nodes, start, frame, rays, out),
            5 => sum_lobes::<5>(nodes, start, frame, rays, out),
            6 => sum_lobes::<6>(nodes, start, frame, rays, out),
            _ => sum_lobes::<7>(nodes, start, frame, rays, out),
        }
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn sum_lobes<const WIDTH: u32>(
    nodes: &Nodes,
    start: usize,
    frame: SurfelFrame,
    rays: &Rays,
    out: &mut [f32],
) {
    let q = nodes.count();
    let count = BLOCK.min(q - start);
    // Half of the mirrored view, so that half of `1 + cos` is one sum.
    let mut half = [[0f32; BLOCK]; 3];
    for axis in 0..3 {
        half[axis].copy_from_slice(&nodes.half_mirrored[axis][start..start + BLOCK]);
    }
    let m = frame.mirror;
    for i in 0..BLOCK {
        let along = 2.0 * (half[0][i] * m.x + half[1][i] * m.y + half[2][i] * m.z);
        half[0][i] -= along * m.x;
        half[1][i] -= along * m.y;
        half[2][i] -= along * m.z;
    }
    // Far from its axis a lobe is nothing; numbers too small for f32's range would only be slow.
    let least = 1e-20f32.powf(0.5f32.powi(WIDTH as i32));
    let mut sum = [[0f32; BLOCK]; 3];
    for ray in rays.lit() {
        let at = |planes: &[[f32; Rays::MOST]; 3]| [0, 1, 2].map(|c| planes[c][usize::from(*ray)]);
        let (d, e) = (at(&rays.direction), at(&rays.energy));
        for i in 0..BLOCK {
            let near = 0.5 + half[0][i] * d[0] + half[1][i] * d[1] + half[2][i] * d[2];
            let mut lobe = if near > least { near } else { least };
            for _ in 0..WIDTH {
                lobe *= lobe;
            }
            for c in 0..3 {
                sum[c][i] += lobe * e[c];
            }
        }
    }
    let scale = peak(WIDTH);
    for c in 0..3 {
        for i in 0..count {
            out[c * q + start + i] = scale * sum[c][i];
        }
    }
}

/// The lobe along its axis, which makes its integral 1.
#[inline(always)]
fn peak(width: u32) -> f32 {
    ((1u32 << width) as f32 + 1.0) / (4.0 * PI)
}

/// The gloss of one surfel.
#[derive(Clone, Copy, Debug, Default)]
pub struct Gloss {
    /// Reflectance, per channel; 0 where the surfel is matte.
    pub reflectance: [f32; 3],
    /// Exponent of the lobe: 2 to this power.
    pub width: u32,
    /// Whether the lobe rises towards grazing view, as it does on all but metals.
    pub rises: bool,
}

impl Gloss {
    /// Whether there is none.
    pub fn is_matte(&self) -> bool {
        self.reflectance == [0.0; 3]
    }

    /// Whether it shows beside what a surface of that albedo scatters.
    fn is_seen(&self, white: f32) -> bool {
        let [r, g, b] = self.reflectance;
        r.max(g).max(b) * peak(self.width) > LEAST_GLOSS * white / PI
    }

    /// Takes away what does not show beside what a surface of that albedo scatters. Returns of how many surfels.
    pub(super) fn take_unseen(all: &mut [Self], white: f32) -> usize {
        let unseen = |g: &&mut Self| !g.is_matte() && !g.is_seen(white);
        all.iter_mut()
            .filter(unseen)
            .map(|g| *g = Self::default())
            .count()
    }
}

/// Sums of a surfel's colour against one lobe.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    /// Mean mirrored light.
    mean: [f32; 3],
    /// Covariance of mirrored light and colour.
    covariance: [f32; 3],
    /// Variance of mirrored light.
    variance: [f32; 3],
}

/// Finds each surfel's gloss: its colour against what it mirrors of the source light, as the view changes. A regression a surfel, width and
/// channel, pooled over its neighbours and drawn to the mean of the channels. It is looked for on the front, and not on leaves.
///
/// `white` is the asset's whitest albedo as it appears: its exposure to the source's is not known otherwise.
pub(super) fn find_gloss(
    asset: &DirectionalAsset,
    (light, radiance): (&Incident<'_>, &[Radiance]),
    white: f32,
) -> Vec<Gloss> {
    let n = asset.bake.len();
    if asset.nodes.degree == 0 || n == 0 {
        return vec![Gloss::default(); n];
    }
    let q = asset.nodes.count();
    let (moments, variances): (Vec<[[Moments; WIDTHS.len()]; 2]>, Vec<[f32; 3]>) = (0..n)
        .into_par_iter()
        .map_init(
            || (Rays::default(), vec![0f32; 3 * q]),
            |(rays, values), i| {
                let colors = &asset.colors_of(i)[..];
                asset.rays_of(i, light, radiance, rays);
                let frame = SurfelFrame::new(asset.bake.normals[i]);
                let mut found = [[Moments::default(); WIDTHS.len()]; 2];
                for (w, width) in WIDTHS.into_iter().enumerate() {
                    mirrored(&asset.nodes, frame, width, rays, values);
                    found[0][w] = moments(asset, (i, colors), values, None);
                    found[1][w] = moments(asset, (i, colors), values, Some(&asset.nodes.rise));
                }
                (found, color_variance(asset, colors, asset.means[i][0]))
            },
        )
        .unzip();
    let metal = regress(asset, &moments, &variances, 0);
    let coated = regress(asset, &moments, &variances, 1);
    choose(asset, white, &moments, &metal, &coated)
}

/// Means over each surfel and its neighbours, by how much they make up of what is seen. `[n]`
pub(super) fn pooled<const N: usize>(
    values: &[[f32; N]],
    neighbors: &Neighbors,
    prominence: &[f32],
) -> Vec<[f32; N]> {
    let mean = |around: &[u32]| {
        let each = || around.iter().map(|j| *j as usize);
        let total: f32 = each().map(|j| prominence[j]).sum();
        let mut sum = [0f32; N];
        for j in each() {
            let share = share_of(prominence[j], total, around.len());
            for (s, v) in sum.iter_mut().zip(values[j]) {
                *s += share * v;
            }
        }
        sum
    };
    let means: Vec<[f32; N]> = neighbors.of_groups().map(mean).collect();
    let surfels = (0..values.len()).into_par_iter();
    surfels.map(|i| means[neighbors.group_of(i)]).collect()
}

/// What one of `count` surfels counts of all; alike where nothing of any is seen.
fn share_of(prominence: f32, total: f32, count: usize) -> f32 {
    if total > 0.0 {
        prominence / total
    } else {
        1.0 / count as f32
    }
}

fn color_variance(asset: &DirectionalAsset, colors: &[[f32; 3]], mean: [f32; 3]) -> [f32; 3] {
    let mut sum = [0f32; 3];
    for (w, c) in asset.nodes.weights.iter().zip(colors) {
        for k in 0..3 {
            sum[k] += w * (c[k] - mean[k]).powi(2);
        }
    }
    sum
}

/// Moments of one lobe, as far as a function of the asset's degree can show it.
fn moments(
    asset: &DirectionalAsset,
    (i, colors): (usize, &[[f32; 3]]),
    values: &[f32],
    rise: Option<&[f32]>,
) -> Moments {
    let nodes = &asset.nodes;
    let q = nodes.count();
    let lit: Vec<[f32; 3]> = (0..q)
        .map(|s| {
            let rise = rise.map_or(1.0, |r| r[s]);
            std::array::from_fn(|c| rise * values[c * q + s])
        })
        .collect();
    let seen = nodes.values(&nodes.refit, &lit);
    let mut found = Moments {
        mean: weighted_mean(&nodes.weights, &seen),
        ..Moments::default()
    };
    for ((s, w), color) in seen.iter().zip(&nodes.weights).zip(colors) {
        for c in 0..3 {
            let off = s[c] - found.mean[c];
            found.covariance[c] += w * off * (color[c] - asset.means[i][0][c]);
            found.variance[c] += w * off * off;
        }
    }
    found
}

/// A regression's result for one surfel.
#[derive(Clone, Copy, Debug, Default)]
struct Regressed {
    reflectance: [f32; 3],
    width: usize,
    correlation: f32,
}

fn regress(
    asset: &DirectionalAsset,
    moments: &[[[Moments; WIDTHS.len()]; 2]],
    variances: &[[f32; 3]],
    kind: usize,
) -> Vec<Regressed> {
    let prominence = &asset.bake.prominence;
    let of_group = |around: &[u32]| -> [Sums; WIDTHS.len()] {
        let each = || around.iter().map(|j| *j as usize);
        let total: f32 = each().map(|j| prominence[j]).sum();
        let mut sums = [Sums::default(); WIDTHS.len()];
        for j in each() {
            let share = share_of(prominence[j], total, around.len());
            let brightness: f32 = asset.means[j][0].iter().map(|c| c * c).sum();
            let unit = share / brightness.max(1e-6);
            for (sums, m) in sums.iter_mut().zip(&moments[j][kind]) {
                for c in 0..3 {
                    sums.num[c] += share * m.covariance[c];
                    sums.den[c] += share * m.variance[c];
                    sums.var[c] += share * variances[j][c];
                    sums.relative[0] += unit * m.covariance[c];
                    sums.relative[1] += unit * m.variance[c];
                    sums.relative[2] += unit * variances[j][c];
                }
            }
        }
        sums
    };
    let sums: Vec<_> = asset.neighbors.of_groups().map(of_group).collect();
    (0..moments.len())
        .into_par_iter()
        .map(|i| {
            let mut best: Option<(f32, Regressed)> = None;
            let sums = &sums[asset.neighbors.group_of(i)];
            for (
                w,
                Sums {
                    num,
                    den,
                    var,
                    relative,
                },
            ) in sums.iter().enumerate()
            {
                let mean = |v: &[f32; 3]| (v[0] + v[1] + v[2]) / 3.0;
                let reflectance: [f32; 3] = std::array::from_fn(|c| {
                    let k = (num[c] + mean(num)) / (den[c] + mean(den) + RIDGE);
                    let most =
                        MOST_GLOSS * asset.means[i][0][c] / moments[i][kind][w].mean[c].max(1e-6);
                    k.clamp(0.0, most.max(0.0))
                });
                let residual: f32 = (0..3)
                    .map(|c| {
                        let k = reflectance[c];
                        var[c] - 2.0 * k * num[c] + k * k * den[c]
                    })
                    .sum();
                if best.is_none_or(|(least, _)| residual < least) {
                    let correlation =
                        relative[0].max(0.0).powi(2) / (relative[1] * relative[2]).max(1e-16);
                    best = Some((
                        residual,
                        Regressed {
                            reflectance,
                            width: w,
                            correlation,
                        },
                    ));
                }
            }
            best.unwrap_or_default().1
        })
        .collect()
}

/// Of surfels around one, by how much they make up of what is seen: covariance of what is seen and what the lobe sees, and their variances;
/// and the three with each surfel's brightness divided out, all channels together.
#[derive(Clone, Copy, Default)]
struct Sums {
    num: [f32; 3],
    den: [f32; 3],
    var: [f32; 3],
    relative: [f32; 3],
}

/// Which of the two each surfel is, and how much of it is believed.
fn choose(
    asset: &DirectionalAsset,
    white: f32,
    moments: &[[[Moments; WIDTHS.len()]; 2]],
    metal: &[Regressed],
    coated: &[Regressed],
) -> Vec<Gloss> {
    let believed = |r: &Regressed, i: usize| {
        let trust =
            smoothstep(0.0, TRUSTED_CORRELATION, r.correlation) * (1.0 - asset.bake.two_sided[i]);
        r.reflectance.map(|k| k * trust)
    };
    let mean = |v: [f32; 3]| (v[0] + v[1] + v[2]) / 3.0;
    // Reflectance and lobe of the stuff around here, each surfel by the light that it mirrors: what is mirrored, the light, and the lobe's
    // width by its weight.
    let own = |(i, metal): (usize, &Regressed)| {
        let k = mean(believed(metal, i));
        let light = mean(moments[i][0][metal.width].mean).max(0.0);
        [k * light, light, k * metal.width as f32, k]
    };
    let mut stuff: Vec<[f32; 4]> = metal.iter().enumerate().map(own).collect();
    for _ in 0..METAL_TURNS {
        stuff = pooled(&stuff, &asset.neighbors, &asset.bake.prominence);
    }
    stuff
        .into_par_iter()
        .enumerate()
        .map(|(i, [mirrored, light, width, weight])| {
            let metallic = smoothstep(METAL[0], METAL[1], mirrored / (white * light).max(1e-9));
            if metallic == 0.0 {
                return Gloss {
                    reflectance: believed(&coated[i], i).map(|k| k.min(MOST_REFLECTANCE * white)),
                    width: WIDTHS[coated[i].width],
                    rises: true,
                };
            }
            let width = (width / weight.max(1e-9)).round() as usize;
            let width = width.min(WIDTHS.len() - 1);
            let k = believed(&metal[i], i);
            Gloss {
                reflectance: std::array::from_fn(|c| {
                    let whole =
                        MOST_GLOSS * asset.means[i][0][c] / moments[i][0][width].mean[c].max(1e-6);
                    (k[c] + (whole - k[c]) * metallic).clamp(0.0, MOST_REFLECTANCE * white)
                }),
                width: WIDTHS[width],
                rises: false,
            }
        })
        .collect()
}
