//! Fit of a surfel's specular lobe, by the views of its colour under the source light.

use std::f32::consts::PI;

use rayon::prelude::*;

use super::asset::{DirectionalCache, Radiance};
use super::incident::Incident;
use super::lobe::{WIDTHS, peak};
use super::moments::{AllMoments, MomentScratch};
use super::neighbors::Neighbors;
use super::nodes::SurfelFrame;
use crate::numeric::smoothstep;

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

/// The gloss of one surfel.
#[derive(Clone, Copy, Debug, Default)]
pub struct SpecularLobe {
    /// Reflectance, per channel; 0 where the surfel is matte.
    pub reflectance: [f32; 3],
    /// Exponent of the lobe: 2 to this power.
    pub width: u32,
    /// True where a Fresnel term raises the lobe towards grazing view, as on all but metals.
    pub has_fresnel: bool,
}

impl SpecularLobe {
    /// True without a specular lobe.
    pub fn is_diffuse(&self) -> bool {
        self.reflectance == [0.0; 3]
    }

    /// True where it shows beside the diffuse colour of a surface of that albedo.
    fn is_seen(&self, white: f32) -> bool {
        let [r, g, b] = self.reflectance;
        r.max(g).max(b) * peak(self.width) > LEAST_GLOSS * white / PI
    }

    /// Takes away what does not show beside what a surface of that albedo scatters. Returns of how many surfels.
    pub(super) fn take_unseen(all: &mut [Self], white: f32) -> usize {
        let unseen = |g: &&mut Self| !g.is_diffuse() && !g.is_seen(white);
        all.iter_mut()
            .filter(unseen)
            .map(|g| *g = Self::default())
            .count()
    }
}

/// Finds each surfel's gloss: its colour against what it mirrors of the source light, as the view changes. A regression a surfel that is asked, width
/// and
/// channel, pooled over its neighbours and drawn to the mean of the channels. It is looked for on the front, and not on leaves.
///
/// `white` is the asset's whitest albedo as it appears: its exposure to the source's is not known otherwise.
pub(super) fn fit_lobes(
    asset: &DirectionalCache,
    (light, radiance): (&Incident<'_>, &[Radiance]),
    white: f32,
) -> Vec<SpecularLobe> {
    let n = asset.bake.len();
    if asset.nodes.degree == 0 || n == 0 {
        return vec![SpecularLobe::default(); n];
    }
    let (moments, variances): (Vec<AllMoments>, Vec<[f32; 3]>) =
        (asset.neighbors.asked().par_iter())
            .map_init(MomentScratch::default, |held, i| {
                let i = *i as usize;
                let colors = &asset.colors_of(i)[..];
                asset.rays_of(i, light, radiance, &mut held.rays);
                let frame = SurfelFrame::new(asset.bake.normals[i]);
                held.moments((&asset.nodes, frame), colors, asset.means[i][0])
            })
            .unzip();
    let metal = regress(asset, (&moments, &variances), 0);
    let coated = regress(asset, (&moments, &variances), 1);
    choose(asset, (light, radiance), white, &moments, [&metal, &coated])
}

/// Means over each surfel and its neighbours, by how much they make up of what is seen. `[n]`
pub(super) fn pooled<const N: usize>(
    values: &[[f32; N]],
    neighbors: &Neighbors,
    visible_weight: &[f32],
) -> Vec<[f32; N]> {
    let mean = |around: &[u32]| {
        let each = || around.iter().map(|j| *j as usize);
        let total: f32 = each().map(|j| visible_weight[j]).sum();
        let mut sum = [0f32; N];
        for j in each() {
            let share = share_of(visible_weight[j], total, around.len());
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

/// Weight of one of `count` surfels; equal where nothing of any is seen.
fn share_of(visible_weight: f32, total: f32, count: usize) -> f32 {
    if total > 0.0 {
        visible_weight / total
    } else {
        1.0 / count as f32
    }
}

/// A regression's result for one surfel.
#[derive(Clone, Copy, Debug, Default)]
struct Regressed {
    reflectance: [f32; 3],
    width: usize,
    correlation: f32,
}

fn regress(
    asset: &DirectionalCache,
    (moments, variances): (&[AllMoments], &[[f32; 3]]),
    kind: usize,
) -> Vec<Regressed> {
    let visible_weight = &asset.bake.visible_weight;
    let of_group = |around: &[u32]| -> [LobeSums; WIDTHS.len()] {
        // Only those that are asked are anyone's neighbours.
        let each = || {
            let surfels = around.iter().map(|j| *j as usize);
            surfels.filter_map(|j| Some((j, asset.neighbors.place_of(j)?)))
        };
        let total: f32 = each().map(|(j, _)| visible_weight[j]).sum();
        let mut sums = [LobeSums::default(); WIDTHS.len()];
        for (j, at) in each() {
            let share = share_of(visible_weight[j], total, around.len());
            let brightness: f32 = asset.means[j][0].iter().map(|c| c * c).sum();
            let unit = share / brightness.max(1e-6);
            for (sums, m) in sums.iter_mut().zip(&moments[at][kind]) {
                for c in 0..3 {
                    sums.num[c] += share * m.covariance[c];
                    sums.den[c] += share * m.variance[c];
                    sums.var[c] += share * variances[at][c];
                    sums.relative[0] += unit * m.covariance[c];
                    sums.relative[1] += unit * m.variance[c];
                    sums.relative[2] += unit * variances[at][c];
                }
            }
        }
        sums
    };
    let sums: Vec<_> = asset.neighbors.of_groups().map(of_group).collect();
    (0..asset.bake.len())
        .into_par_iter()
        .map(|i| {
            let own = asset.neighbors.place_of(i).map(|at| &moments[at][kind]);
            let mut best: Option<(f32, Regressed)> = None;
            let sums = &sums[asset.neighbors.group_of(i)];
            for (
                w,
                LobeSums {
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
                    let most = own.map_or(f32::INFINITY, |own| {
                        most_of(asset.means[i][0][c], own[w].mean[c])
                    });
                    k.clamp(0.0, most)
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

/// Sums over surfels around one, by visible weight: covariance of what is seen and what the lobe sees, and their variances; and the three with each
/// surfel's brightness divided out, all channels together.
#[derive(Clone, Copy, Default)]
struct LobeSums {
    num: [f32; 3],
    den: [f32; 3],
    var: [f32; 3],
    relative: [f32; 3],
}

/// Reflectance at most, where a surfel of that mean colour mirrors that mean light.
fn most_of(mean: f32, mirrored: f32) -> f32 {
    (MOST_GLOSS * mean / mirrored.max(1e-6)).max(0.0)
}

/// Chooses one of the two lobes for each surfel, and its confidence.
fn choose(
    asset: &DirectionalCache,
    (light, radiance): (&Incident<'_>, &[Radiance]),
    white: f32,
    moments: &[AllMoments],
    [metal, coated]: [&[Regressed]; 2],
) -> Vec<SpecularLobe> {
    let believed = |r: &Regressed, most: [f32; 3], i: usize| -> [f32; 3] {
        let trust =
            smoothstep(0.0, TRUSTED_CORRELATION, r.correlation) * (1.0 - asset.bake.two_sided[i]);
        std::array::from_fn(|c| {
            let k = r.reflectance[c];
            trust * if k > most[c] { most[c] } else { k }
        })
    };
    // Of those that were asked it is bounded as it is.
    const UNBOUNDED: [f32; 3] = [f32::INFINITY; 3];
    let mean = |v: [f32; 3]| (v[0] + v[1] + v[2]) / 3.0;
    // Reflectance and lobe of the stuff around here, each surfel by the light that it mirrors: what is mirrored, the light, and the lobe's
    // width by its weight. Nobody asks those that were not asked.
    let own = |(i, metal): (usize, &Regressed)| {
        let Some(at) = asset.neighbors.place_of(i) else {
            return [0.0; 4];
        };
        let k = mean(believed(metal, UNBOUNDED, i));
        let light = mean(moments[at][0][metal.width].mean).max(0.0);
        [k * light, light, k * metal.width as f32, k]
    };
    let mut stuff: Vec<[f32; 4]> = metal.iter().enumerate().map(own).collect();
    for _ in 0..METAL_TURNS {
        stuff = pooled(&stuff, &asset.neighbors, &asset.bake.visible_weight);
    }
    stuff
        .into_par_iter()
        .enumerate()
        .map_init(
            MomentScratch::default,
            |held, (i, [shown, shining, width, weight])| {
                let metallic = smoothstep(METAL[0], METAL[1], shown / (white * shining).max(1e-9));
                let is_metal = metallic > 0.0;
                let regressed = &[coated, metal][usize::from(is_metal)][i];
                let width = match is_metal {
                    true => ((width / weight.max(1e-9)).round() as usize).min(WIDTHS.len() - 1),
                    false => regressed.width,
                };
                let specular_lobe = |k: [f32; 3]| SpecularLobe {
                    reflectance: k.map(|k| k.clamp(0.0, MOST_REFLECTANCE * white)),
                    width: WIDTHS[width],
                    has_fresnel: !is_metal,
                };
                let at = asset.neighbors.place_of(i);
                let k = believed(regressed, UNBOUNDED, i);
                // Bounds only lower it.
                let is_known = at.is_some() || !specular_lobe(k).is_seen(white);
                if !is_metal && is_known {
                    return specular_lobe(k);
                }
                let mean = match at {
                    Some(at) => moments[at][usize::from(!is_metal)][width].mean,
                    None => {
                        asset.rays_of(i, light, radiance, &mut held.rays);
                        let frame = SurfelFrame::new(asset.bake.normals[i]);
                        held.mean((&asset.nodes, frame), (width, !is_metal))
                    }
                };
                let most: [f32; 3] =
                    std::array::from_fn(|c| most_of(asset.means[i][0][c], mean[c]));
                let k = match at {
                    Some(_) => k,
                    None => believed(regressed, most, i),
                };
                specular_lobe(std::array::from_fn(|c| k[c] + (most[c] - k[c]) * metallic))
            },
        )
        .collect()
}
