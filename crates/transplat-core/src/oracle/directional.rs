//! The directional method in f64, in the world's frame and without any of production's shortcuts.

mod relight;

use std::f64::consts::PI;

use glam::DVec3;

use super::pooling::{pooled, smoothstep};
use super::rays::first_hit;
use crate::bake::directional::DirectionalBake;
use crate::bake::strata::{DIRECTIONS, PER_STRATUM, STRATA, directions};
use crate::color::Encoding;
use crate::environment::LightSamples;
use crate::sh::{MAX_COEFFICIENTS, coefficient_count, evaluate_basis, gauss_legendre};
use crate::surfels::SurfelCloud;
use crate::transfer::directional::{
    FIT_FLOOR, FIT_RIDGE, LOBE_TRUST, METAL, METAL_TURNS, MOST_GLOSS, MOST_REFLECTANCE, NEIGHBORS,
    NORMAL_OVER_GRAZING, RIDGE, TRUSTED_CORRELATION, TURNS, WIDTHS,
};
use crate::transfer::materials::WHITEST;

type Rgb = [f64; 3];
/// Front and back.
type FrontAndBack = [Rgb; 2];

/// One asset under one source, with every intermediate result.
pub struct OracleDirectional<'a> {
    cloud: &'a SurfelCloud,
    bake: &'a DirectionalBake,
    directions: Vec<DVec3>,
    epsilon: f64,
    /// To the camera in the surfel's frame, and the area of each.
    nodes: Vec<(DVec3, f64)>,
    means: Vec<FrontAndBack>,
    divisor: Vec<FrontAndBack>,
    light_gain: f64,
    specular_lobe: Vec<SpecularLobe>,
    source: OracleLight,
    trust: f64,
}

#[derive(Default)]
struct OracleLight {
    /// Direction and energy of each of the bake's directions.
    sky: Vec<(DVec3, Rgb)>,
    /// Suns, with the surfels that each reaches.
    suns: Vec<(DVec3, Rgb, Vec<bool>)>,
    irradiance: Vec<FrontAndBack>,
    /// Mean over the sphere of the irradiance where nothing blocks it.
    mean: Rgb,
}

#[derive(Clone, Copy)]
struct SpecularLobe {
    reflectance: Rgb,
    exponent: f64,
    has_fresnel: bool,
}

fn rgb(f: impl Fn(usize) -> f64) -> Rgb {
    std::array::from_fn(f)
}

impl<'a> OracleDirectional<'a> {
    /// Prepares asset and source light, all terms on.
    pub fn new(
        cloud: &'a SurfelCloud,
        bake: &'a DirectionalBake,
        source: &LightSamples,
        epsilon: f32,
    ) -> Self {
        let mut nodes = Vec::new();
        let degree = cloud.sh_degree;
        let (heights, azimuths) = (degree + 1, 2 * (degree + 1));
        for (row, (x, w)) in gauss_legendre(heights).into_iter().enumerate() {
            let z = 0.5 * (x + 1.0);
            let r = (1.0 - z * z).sqrt();
            for column in 0..azimuths {
                let phi = 2.0 * PI * (column as f64 + 0.5 * (row % 2) as f64) / azimuths as f64;
                let area = 0.5 * w * 2.0 * PI / azimuths as f64;
                nodes.push((DVec3::new(r * phi.cos(), r * phi.sin(), z), area));
            }
        }
        let total: f64 = source
            .suns
            .iter()
            .chain(&source.cells)
            .flat_map(|b| b.energy)
            .map(f64::from)
            .sum();
        let mut oracle = Self {
            cloud,
            bake,
            directions: directions().iter().map(|d| d.as_dvec3()).collect(),
            epsilon: f64::from(epsilon),
            nodes,
            means: Vec::new(),
            divisor: Vec::new(),
            // Four times the mean over the sphere of a clamped cosine is 1.
            light_gain: 12.0 / total,
            specular_lobe: Vec::new(),
            source: OracleLight::default(),
            trust: 1.0,
        };
        oracle.source = oracle.light(source);
        oracle.means = (0..cloud.len())
            .map(|i| [1.0, -1.0].map(|side| oracle.mean_over_nodes(&oracle.colors(i, side))))
            .collect();
        oracle.divisor = (0..cloud.len())
            .map(|i| oracle.gathered(i, &oracle.source, &oracle.means))
            .collect();
        oracle.specular_lobe = oracle.fit_lobes();
        oracle
    }

    fn n(&self, i: usize) -> DVec3 {
        self.bake.normals[i].as_dvec3()
    }

    /// A node's direction to the camera in the world: the mirror that brings z to the normal.
    fn node(&self, i: usize, local: DVec3) -> DVec3 {
        let difference = self.n(i) - DVec3::Z;
        let mirror = difference.try_normalize().unwrap_or(DVec3::X);
        local - 2.0 * mirror * local.dot(mirror)
    }

    /// Stored value of surfel `i`'s SH towards a camera.
    fn stored(&self, f: &[Rgb], to_camera: DVec3) -> Rgb {
        let mut y = [0f64; MAX_COEFFICIENTS];
        evaluate_basis((-to_camera).to_array(), self.cloud.sh_degree, &mut y);
        rgb(|c| f.iter().zip(y).map(|(f, y)| f[c] * y).sum())
    }

    fn sh(&self, i: usize) -> Vec<Rgb> {
        let sh = self.cloud.sh_of(i);
        sh.iter().map(|f| f.map(f64::from)).collect()
    }

    fn decode(&self, stored: f64) -> f64 {
        let encoded = (stored + f64::from(self.cloud.encoding.offset())).max(0.0);
        match self.cloud.encoding {
            Encoding::Stored if encoded <= 0.04045 => encoded / 12.92,
            Encoding::Stored => ((encoded + 0.055) / 1.055).powf(2.4),
            Encoding::StoredLinear | Encoding::Linear => encoded,
        }
    }

    fn encode(&self, linear: f64) -> f64 {
        let linear = linear.max(0.0);
        let encoded = match self.cloud.encoding {
            Encoding::Stored if linear <= 0.003_130_8 => 12.92 * linear,
            Encoding::Stored => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
            Encoding::StoredLinear | Encoding::Linear => linear,
        };
        encoded - f64::from(self.cloud.encoding.offset())
    }

    /// Linear colour at the nodes of one side.
    fn colors(&self, i: usize, side: f64) -> Vec<Rgb> {
        let f = self.sh(i);
        self.nodes
            .iter()
            .map(|(v, _)| {
                let v = self.node(i, DVec3::new(v.x, v.y, side * v.z));
                self.stored(&f, v).map(|s| self.decode(s))
            })
            .collect()
    }

    fn mean_over_nodes(&self, values: &[Rgb]) -> Rgb {
        let total: f64 = self.nodes.iter().map(|(v, a)| a * v.z).sum();
        rgb(|c| {
            let sum: f64 = self
                .nodes
                .iter()
                .zip(values)
                .map(|((v, a), x)| a * v.z * x[c])
                .sum();
            sum / total
        })
    }

    fn light(&self, light_samples: &LightSamples) -> OracleLight {
        let mut sums = vec![(DVec3::ZERO, [0f64; 3]); DIRECTIONS];
        for cell in &light_samples.cells {
            let d = cell.direction.as_dvec3();
            let nearest = (0..DIRECTIONS)
                .max_by(|a, b| {
                    self.directions[*a]
                        .dot(d)
                        .total_cmp(&self.directions[*b].dot(d))
                })
                .unwrap_or(0);
            let e = cell.energy.map(|e| self.light_gain * f64::from(e));
            sums[nearest].0 += d * e.iter().sum::<f64>();
            sums[nearest].1 = rgb(|c| sums[nearest].1[c] + e[c]);
        }
        let sky = sums
            .into_iter()
            .zip(&self.directions)
            .map(|((toward, e), d)| (toward.normalize_or(*d), e))
            .collect();
        let suns = light_samples
            .suns
            .iter()
            .map(|sun| {
                let d = sun.direction.as_dvec3();
                let sees = |i| first_hit(&self.bake.tracer.surfels, i, d).is_none();
                (
                    d,
                    sun.energy.map(|e| self.light_gain * f64::from(e)),
                    (0..self.cloud.len()).map(sees).collect(),
                )
            })
            .collect();
        let mut light = OracleLight {
            sky,
            suns,
            ..OracleLight::default()
        };
        let total: Rgb = rgb(|c| {
            let all = light.sky.iter().map(|(_, e)| e[c]);
            all.chain(light.suns.iter().map(|(_, e, _)| e[c])).sum()
        });
        light.mean = total.map(|t| t / 4.0);
        let least = light.mean.map(|m| self.epsilon * m);
        light.irradiance = (0..self.cloud.len())
            .map(|i| {
                [1.0, -1.0].map(|side| {
                    let mut e = least;
                    let mut add = |d: DVec3, energy: &Rgb| {
                        let cosine = (side * self.n(i).dot(d)).max(0.0);
                        e = rgb(|c| e[c] + cosine * energy[c]);
                    };
                    for (j, (d, energy)) in light.sky.iter().enumerate() {
                        if self.bake.directional_visibility.is_open(i, j) {
                            add(*d, energy);
                        }
                    }
                    for (d, energy, open) in &light.suns {
                        // A back that is closed was not asked.
                        if open[i] && (side > 0.0 || self.bake.two_sided[i] > 0.0) {
                            add(*d, energy);
                        }
                    }
                    e
                })
            })
            .collect();
        light
    }

    /// All irradiance, with what bounces.
    fn gathered(&self, i: usize, light: &OracleLight, radiance: &[FrontAndBack]) -> FrontAndBack {
        let mut e = light.irradiance[i];
        for hit in self.bake.directional_visibility.hits_of(i) {
            let cosine = self.n(i).dot(self.directions[hit.stratum()]);
            let b = radiance[hit.surfel()][usize::from(hit.is_back())];
            let side = &mut e[usize::from(cosine < 0.0)];
            *side = rgb(|c| side[c] + 4.0 * PI / STRATA as f64 * cosine.abs() * b[c]);
        }
        e
    }

    /// Oracle with a low-confidence source. See [`crate::environment::Illumination::trust`].
    pub fn trusting(mut self, trust: f32) -> Self {
        self.trust = f64::from(trust);
        for specular_lobe in self.specular_lobe.iter_mut().filter(|_| trust < LOBE_TRUST) {
            specular_lobe.reflectance = [0.0; 3];
        }
        self
    }

    fn tau(&self, light: &OracleLight) -> Vec<FrontAndBack> {
        let start = rgb(|c| light.mean[c] / self.source.mean[c]);
        let mut tau = vec![[start; 2]; self.cloud.len()];
        for _ in 0..TURNS {
            let radiance = self.changed(&tau);
            tau = (0..self.cloud.len())
                .map(|i| {
                    let e = self.gathered(i, light, &radiance);
                    [0, 1].map(|s| rgb(|c| e[s][c] / self.divisor[i][s][c]))
                })
                .collect();
        }
        tau.into_iter()
            .map(|sides| sides.map(|t| t.map(|v| v.powf(self.trust))))
            .collect()
    }

    fn changed(&self, tau: &[FrontAndBack]) -> Vec<FrontAndBack> {
        let all = self.means.iter().zip(tau);
        all.map(|(m, t)| [0, 1].map(|s| rgb(|c| m[s][c] * t[s][c])))
            .collect()
    }

    /// All that shines on the front of surfel `i`.
    fn rays(&self, i: usize, light: &OracleLight, radiance: &[FrontAndBack]) -> Vec<(DVec3, Rgb)> {
        let n = self.n(i);
        let share = 4.0 * PI / DIRECTIONS as f64;
        let mut rays = Vec::new();
        for p in 0..STRATA {
            let hit = self
                .bake
                .directional_visibility
                .hits_of(i)
                .iter()
                .find(|h| h.stratum() == p);
            let met = hit.map_or(radiance[i][0], |h| {
                radiance[h.surfel()][usize::from(h.is_back())]
            });
            let (mut toward, mut energy) = (DVec3::ZERO, [0f64; 3]);
            for j in (0..PER_STRATUM).map(|place| place * STRATA + p) {
                if n.dot(self.directions[j]) <= 0.0 {
                    continue;
                }
                let (d, e) = if self.bake.directional_visibility.is_open(i, j) {
                    light.sky[j]
                } else {
                    (self.directions[j], met.map(|b| share * b))
                };
                toward += d * e.iter().sum::<f64>();
                energy = rgb(|c| energy[c] + e[c]);
            }
            if energy.iter().sum::<f64>() > 0.0 {
                rays.push((toward.normalize(), energy));
            }
        }
        let suns = light
            .suns
            .iter()
            .filter(|(d, _, open)| open[i] && n.dot(*d) > 0.0);
        rays.extend(suns.map(|(d, e, _)| (*d, *e)));
        rays
    }

    /// Radiance that the surfel mirrors towards each node.
    fn mirrored(&self, i: usize, rays: &[(DVec3, Rgb)], exponent: f64) -> Vec<Rgb> {
        let n = self.n(i);
        self.nodes
            .iter()
            .map(|(v, _)| {
                let v = self.node(i, *v);
                let mirror = 2.0 * n * n.dot(v) - v;
                let mut sum = [0f64; 3];
                for (d, e) in rays {
                    let lobe = (0.5 + 0.5 * mirror.dot(*d)).max(0.0).powf(exponent);
                    let lobe = (exponent + 1.0) / (4.0 * PI) * lobe;
                    sum = rgb(|c| sum[c] + lobe * e[c]);
                }
                sum
            })
            .collect()
    }

    fn rise(&self, node: usize) -> f64 {
        let grazing = (1.0 - self.nodes[node].0.z).powi(5);
        1.0 + (1.0 / f64::from(NORMAL_OVER_GRAZING) - 1.0) * grazing
    }

    /// The least-squares fit of values at the nodes, as SH in the world.
    fn fit(&self, i: usize, values: &[Rgb]) -> Vec<Rgb> {
        let k = coefficient_count(self.cloud.sh_degree);
        let weights: Vec<f64> = self
            .nodes
            .iter()
            .map(|(v, a)| a * (v.z + FIT_FLOOR))
            .collect();
        let total: f64 = weights.iter().sum();
        let mut rows = vec![vec![0f64; k + 3]; k];
        for ((v, _), (w, value)) in self.nodes.iter().zip(weights.iter().zip(values)) {
            let mut y = [0f64; MAX_COEFFICIENTS];
            evaluate_basis((-self.node(i, *v)).to_array(), self.cloud.sh_degree, &mut y);
            for a in 0..k {
                for b in 0..k {
                    rows[a][b] += w / total * y[a] * y[b];
                }
                for c in 0..3 {
                    rows[a][k + c] += w / total * y[a] * value[c];
                }
            }
        }
        for (a, row) in rows.iter_mut().enumerate().skip(1) {
            row[a] += FIT_RIDGE / (4.0 * PI);
        }
        for pivot in 0..k {
            let top = rows[pivot]
                .iter()
                .map(|v| v / rows[pivot][pivot])
                .collect::<Vec<f64>>();
            for (a, row) in rows.iter_mut().enumerate() {
                let factor = row[pivot];
                for (v, t) in row.iter_mut().zip(&top) {
                    *v = if a == pivot { *t } else { *v - factor * t };
                }
            }
        }
        rows.iter().map(|row| rgb(|c| row[k + c])).collect()
    }

    /// Values at the front's nodes of a function.
    fn at_nodes(&self, i: usize, f: &[Rgb]) -> Vec<Rgb> {
        let nodes = self.nodes.iter();
        nodes
            .map(|(v, _)| self.stored(f, self.node(i, *v)))
            .collect()
    }

    /// The surfels around one and itself, each with how much it makes up of what is seen of them; alike where nothing is.
    fn around(&self, i: usize) -> Vec<(usize, f64)> {
        let around = self.neighbors(i);
        let visible_weight = |j: &usize| f64::from(self.bake.visible_weight[*j]);
        let all: f64 = around.iter().map(visible_weight).sum();
        let share = |j: &usize| match all > 0.0 {
            true => visible_weight(j) / all,
            false => 1.0 / around.len() as f64,
        };
        around.iter().map(|j| (*j, share(j))).collect()
    }

    fn neighbors(&self, i: usize) -> Vec<usize> {
        let n = self.cloud.len();
        let mean_size = self
            .bake
            .tracer
            .surfels
            .iter()
            .map(|s| f64::from(s.major))
            .sum::<f64>()
            / n as f64;
        let distance = |j: usize| {
            let surfels = &self.bake.tracer.surfels;
            let place = |i: usize| surfels[i].position.as_dvec3() / (3.0 * mean_size);
            (place(i) - place(j)).length_squared() + 4.0 * (self.n(i) - self.n(j)).length_squared()
        };
        let mut others: Vec<usize> = (0..n).filter(|j| *j != i).collect();
        others.sort_by(|a, b| distance(*a).total_cmp(&distance(*b)));
        others.truncate(NEIGHBORS);
        others.push(i);
        others
    }

    fn fit_lobes(&self) -> Vec<SpecularLobe> {
        let n = self.cloud.len();
        let around: Vec<Vec<(usize, f64)>> = (0..n).map(|i| self.around(i)).collect();
        let white = {
            let sum = |of: &[FrontAndBack], i: usize| of[i][0].iter().sum::<f64>();
            let light = (0..n).map(|i| [PI * sum(&self.means, i), sum(&self.divisor, i)]);
            let light = pooled(&around, &light.collect::<Vec<_>>());
            let mut all: Vec<(f64, f64)> = (light.iter().zip(&self.bake.visible_weight))
                .map(|([exitance, irradiance], p)| (exitance / irradiance, f64::from(*p)))
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut below = 0.0;
            let whitest = all.iter().find(|(_, share)| {
                below += share;
                below >= f64::from(WHITEST)
            });
            whitest.map_or(1.0, |w| w.0)
        };
        // Mean, covariance with the colour and variance of what each lobe mirrors, without and with its rise; and the colour's variance.
        let moments: Vec<Vec<[[Rgb; 3]; 2]>> = (0..n)
            .map(|i| {
                let rays = self.rays(i, &self.source, &self.means);
                let colors = self.colors(i, 1.0);
                WIDTHS
                    .iter()
                    .map(|width| {
                        let plain = self.mirrored(i, &rays, f64::from(1u32 << width));
                        [false, true].map(|has_fresnel| {
                            let lit: Vec<Rgb> = (0..plain.len())
                                .map(|s| {
                                    plain[s].map(|v| if has_fresnel { self.rise(s) * v } else { v })
                                })
                                .collect();
                            let seen = self.at_nodes(i, &self.fit(i, &lit));
                            self.moments(&seen, &colors, self.means[i][0])
                        })
                    })
                    .collect()
            })
            .collect();
        let variances: Vec<Rgb> = (0..n)
            .map(|i| {
                let colors = self.colors(i, 1.0);
                self.moments(&colors, &colors, self.means[i][0])[2]
            })
            .collect();
        let regressed: Vec<[(Rgb, usize, f64); 2]> = (0..n)
            .map(|i| [0, 1].map(|kind| self.regress((i, &around[i]), kind, &moments, &variances)))
            .collect();
        let believed = |i: usize, kind: usize| {
            let (k, _, correlation) = regressed[i][kind];
            let trust = smoothstep(0.0, f64::from(TRUSTED_CORRELATION), correlation);
            k.map(|k| k * trust * (1.0 - f64::from(self.bake.two_sided[i])))
        };
        let mean = |v: Rgb| v.iter().sum::<f64>() / 3.0;
        let mut stuff: Vec<[f64; 4]> = (0..n)
            .map(|i| {
                let w = regressed[i][0].1;
                let k = mean(believed(i, 0));
                let light = mean(moments[i][w][0][0]).max(0.0);
                [k * light, light, k * w as f64, k]
            })
            .collect();
        for _ in 0..METAL_TURNS {
            stuff = pooled(&around, &stuff);
        }
        (0..n)
            .map(|i| {
                let [mirrored, light, width, weight] = stuff[i];
                let [low, high] = METAL.map(f64::from);
                let metallic = smoothstep(low, high, mirrored / (white * light).max(1e-9));
                let most = f64::from(MOST_REFLECTANCE) * white;
                if metallic == 0.0 {
                    return SpecularLobe {
                        reflectance: believed(i, 1).map(|k| k.min(most)),
                        exponent: f64::from(1u32 << WIDTHS[regressed[i][1].1]),
                        has_fresnel: true,
                    };
                }
                let width = ((width / weight.max(1e-9)).round() as usize).min(WIDTHS.len() - 1);
                let k = believed(i, 0);
                SpecularLobe {
                    reflectance: rgb(|c| {
                        let m = moments[i][width][0][0][c].max(1e-6);
                        let whole = f64::from(MOST_GLOSS) * self.means[i][0][c] / m;
                        (k[c] + (whole - k[c]) * metallic).clamp(0.0, most)
                    }),
                    exponent: f64::from(1u32 << WIDTHS[width]),
                    has_fresnel: false,
                }
            })
            .collect()
    }

    fn moments(&self, seen: &[Rgb], colors: &[Rgb], color_mean: Rgb) -> [Rgb; 3] {
        let mean = self.mean_over_nodes(seen);
        let product = |f: &dyn Fn(usize, usize) -> f64| {
            let values: Vec<Rgb> = (0..seen.len()).map(|s| rgb(|c| f(s, c))).collect();
            self.mean_over_nodes(&values)
        };
        let off = |s: usize, c: usize| seen[s][c] - mean[c];
        [
            mean,
            product(&|s, c| off(s, c) * (colors[s][c] - color_mean[c])),
            product(&|s, c| off(s, c) * off(s, c)),
        ]
    }

    fn regress(
        &self,
        (i, around): (usize, &[(usize, f64)]),
        kind: usize,
        moments: &[Vec<[[Rgb; 3]; 2]>],
        variances: &[Rgb],
    ) -> (Rgb, usize, f64) {
        let pooled = |f: &dyn Fn(usize, usize) -> f64| {
            rgb(|c| around.iter().map(|(j, share)| share * f(*j, c)).sum())
        };
        let var = pooled(&|j, c| variances[j][c]);
        let unit = |j: usize| {
            1.0 / self.means[j][0]
                .iter()
                .map(|m| m * m)
                .sum::<f64>()
                .max(1e-6)
        };
        let mut best: Option<(f64, (Rgb, usize, f64))> = None;
        for w in 0..WIDTHS.len() {
            let of = |j: usize| &moments[j][w][kind];
            let (num, den) = (pooled(&|j, c| of(j)[1][c]), pooled(&|j, c| of(j)[2][c]));
            let mean = |v: Rgb| v.iter().sum::<f64>() / 3.0;
            let k = rgb(|c| {
                let k = (num[c] + mean(num)) / (den[c] + mean(den) + f64::from(RIDGE));
                let m = of(i)[0][c].max(1e-6);
                k.clamp(
                    0.0,
                    (f64::from(MOST_GLOSS) * self.means[i][0][c] / m).max(0.0),
                )
            });
            let residual: f64 = (0..3)
                .map(|c| var[c] - 2.0 * k[c] * num[c] + k[c] * k[c] * den[c])
                .sum();
            let sum = |f: &dyn Fn(usize, usize) -> f64| {
                let all = around.iter().flat_map(|j| (0..3).map(move |c| (*j, c)));
                all.map(|((j, share), c)| share * unit(j) * f(j, c))
                    .sum::<f64>()
            };
            let (a, b) = (sum(&|j, c| of(j)[1][c]), sum(&|j, c| of(j)[2][c]));
            let correlation = a.max(0.0).powi(2) / (b * sum(&|j, c| variances[j][c])).max(1e-16);
            if best.is_none_or(|(least, _)| residual < least) {
                best = Some((residual, (k, w, correlation)));
            }
        }
        best.map_or(([0.0; 3], 0, 0.0), |b| b.1)
    }

    /// Mirrored light with its reflectance, towards each node.
    fn specular(&self, i: usize, light: &OracleLight, radiance: &[FrontAndBack]) -> Vec<Rgb> {
        let specular_lobe = self.specular_lobe[i];
        let rays = self.rays(i, light, radiance);
        let mirrored = self.mirrored(i, &rays, specular_lobe.exponent);
        let rise = |s: usize| {
            if specular_lobe.has_fresnel {
                self.rise(s)
            } else {
                1.0
            }
        };
        (0..mirrored.len())
            .map(|s| rgb(|c| rise(s) * specular_lobe.reflectance[c] * mirrored[s][c]))
            .collect()
    }

    /// Condition number of the tau of surfel `i`'s front against a relative change of the source's samples (norms over the samples; the worst
    /// channel): `|t| |L| / divisor`, `t` the cosines of the samples that reach it. No sample is negative, and nothing cancels.
    pub fn condition(&self, i: usize) -> f64 {
        let n = self.n(i);
        let sky = self.source.sky.iter().enumerate();
        let sky = sky.map(|(j, (d, e))| (*d, *e, self.bake.directional_visibility.is_open(i, j)));
        let suns = self.source.suns.iter();
        let suns = suns.map(|(d, e, open)| (*d, *e, open[i]));
        let light_samples: Vec<(DVec3, Rgb, bool)> = sky.chain(suns).collect();
        let cosines = light_samples.iter().map(|(d, _, open)| {
            let cosine = if *open { n.dot(*d).max(0.0) } else { 0.0 };
            cosine * cosine
        });
        let cosines = cosines.sum::<f64>().sqrt();
        (0..3)
            .map(|c| {
                let light: f64 = light_samples.iter().map(|(_, e, _)| e[c] * e[c]).sum();
                cosines * light.sqrt() / self.divisor[i][0][c].max(1e-300)
            })
            .fold(0.0, f64::max)
    }
}
