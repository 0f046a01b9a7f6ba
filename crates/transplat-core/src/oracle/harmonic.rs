//! The paper's transfer of one surfel in f64. Shadowing goes by the explicit tensor, reflection by sampling and projecting,
//! as the paper has them: other ways to the same numbers than production takes.

use glam::DVec3;

use glam::Vec3;
use rayon::prelude::*;

use crate::bake::harmonic::HarmonicBake;
use crate::environment::IncidentRadiance;
use crate::settings::TransferSettings;
use crate::sh::{
    band, coefficient_count, cosine_kernel, evaluate_basis, fibonacci_sphere, sphere_quadrature,
    triple_product_tensor,
};
use crate::transfer::harmonic::UNATTENUATED;

/// Lights and settings as the oracle needs them; made once, since the tensor takes a while.
pub struct OracleHarmonic {
    settings: TransferSettings,
    tensor: Vec<f64>,
    source: Vec<[f64; 3]>,
    target: Vec<[f64; 3]>,
    epsilon: f64,
    /// Directions and weights of the reflection's projection.
    nodes: Vec<([f64; 3], f64)>,
}

impl OracleHarmonic {
    /// Both lights at the settings' degree; the source is not black.
    pub fn new(
        source: &IncidentRadiance,
        target: &IncidentRadiance,
        settings: &TransferSettings,
    ) -> Self {
        let wide = |light: &IncidentRadiance| -> Vec<[f64; 3]> {
            light
                .coefficients
                .iter()
                .map(|c| c.map(f64::from))
                .collect()
        };
        let source = wide(source);
        // pi times the mean radiance, which is the DC over sqrt(4 pi); mean of the channels.
        let mean = source[0].iter().sum::<f64>() / 3.0 * (std::f64::consts::PI / 4.0).sqrt();
        Self {
            settings: settings.clone(),
            tensor: triple_product_tensor(settings.sh_degree),
            source,
            target: wide(target),
            epsilon: f64::from(settings.epsilon()) * mean,
            nodes: sphere_quadrature(2 * settings.sh_degree),
        }
    }

    /// With a reflection that is projected by so many samples, evenly spread over the sphere, as the paper has it.
    pub fn with_samples(mut self, samples: usize) -> Self {
        let weight = 4.0 * std::f64::consts::PI / samples as f64;
        self.nodes = fibonacci_sphere(samples)
            .into_iter()
            .map(|d| (d, weight))
            .collect();
        self
    }

    /// Condition numbers of tau against a relative change of the source light, and one of the visibility (norms of coefficients; the worst channel).
    /// With `E = t.L = g.V` they are `|t| |L| / (E + eps)` and `|g| |V| / (E + eps)`: where the series cancels, `E` is small and neither product is.
    pub fn conditions(&self, normal: [f64; 3], visibility: &[f64]) -> [f64; 2] {
        let degree = self.settings.sh_degree;
        let k = coefficient_count(degree);
        let mut y = vec![0.0; k];
        evaluate_basis(normal, degree, &mut y);
        let kernel: Vec<f64> = (0..=degree)
            .flat_map(|l| band(l).map(move |i| (l, i)))
            .map(|(l, i)| cosine_kernel(l) * y[i])
            .collect();
        let norm = |v: &mut dyn Iterator<Item = f64>| v.map(|v| v * v).sum::<f64>().sqrt();
        let mut worst = [0f64; 2];
        for c in 0..3 {
            let light = |i: usize| self.source[i][c];
            let (mut of_light, mut of_visibility) = (vec![0.0; k], vec![0.0; k]);
            for i in 0..k {
                for p in 0..k {
                    for q in 0..k {
                        let g = kernel[i] * self.tensor[(i * k + p) * k + q];
                        of_light[p] += g * visibility[q];
                        of_visibility[q] += g * light(p);
                    }
                }
            }
            let irradiance: f64 = (0..k).map(|p| of_light[p] * light(p)).sum();
            let divisor = irradiance.max(0.0) + self.epsilon;
            let products = [
                norm(&mut of_light.into_iter()) * norm(&mut (0..k).map(light)),
                norm(&mut of_visibility.into_iter()) * norm(&mut visibility.iter().copied()),
            ];
            for (worst, product) in worst.iter_mut().zip(products) {
                *worst = worst.max(product / divisor);
            }
        }
        worst
    }

    /// The target light as a surface with that normal mirrors it (eq. 7), all of its coefficients' sum: to time it alone.
    pub fn reflection(&self, normal: [f64; 3]) -> f64 {
        let channel = |c: usize| {
            let light: Vec<f64> = self.target.iter().map(|l| l[c]).collect();
            self.mirrored(&light, normal).iter().sum::<f64>()
        };
        (0..3).map(channel).sum()
    }

    /// Eq. 4, with visibility coefficients `[K]`.
    fn shadowed(&self, light: &[[f64; 3]], visibility: &[f64], channel: usize) -> Vec<f64> {
        let k = light.len();
        if !self.settings.terms.shadow {
            return light.iter().map(|l| l[channel]).collect();
        }
        (0..k)
            .map(|i| {
                let mut sum = 0.0;
                for p in 0..k {
                    for q in 0..k {
                        sum += self.tensor[(i * k + p) * k + q] * light[p][channel] * visibility[q];
                    }
                }
                sum
            })
            .collect()
    }

    /// Eq. 3.
    fn irradiance(&self, light: &[f64], normal: [f64; 3]) -> f64 {
        let degree = self.settings.sh_degree;
        let mut y = vec![0.0; light.len()];
        evaluate_basis(normal, degree, &mut y);
        (0..=degree)
            .map(|l| cosine_kernel(l) * band(l).map(|i| light[i] * y[i]).sum::<f64>())
            .sum::<f64>()
            .max(0.0)
    }

    /// Eq. 7, and the projection after it: `f(r(d))` of the function `f`.
    fn mirrored(&self, f: &[f64], n: [f64; 3]) -> Vec<f64> {
        let degree = self.settings.sh_degree;
        let mut out = vec![0.0; f.len()];
        let (mut y, mut y_mirrored) = (vec![0.0; f.len()], vec![0.0; f.len()]);
        for (d, w) in self.nodes.iter().copied() {
            let dn = d[0] * n[0] + d[1] * n[1] + d[2] * n[2];
            let r = std::array::from_fn(|i| d[i] - 2.0 * dn * n[i]);
            evaluate_basis(d, degree, &mut y);
            evaluate_basis(r, degree, &mut y_mirrored);
            let value: f64 = f.iter().zip(&y_mirrored).map(|(f, y)| f * y).sum();
            for (out, y) in out.iter_mut().zip(&y) {
                *out += w * value * y;
            }
        }
        out
    }
}

/// Linear radiance SH of a whole asset under the target light, from its linear colour `[n][K]`, normals and visibility. `[n][K]`
pub fn relight_asset(
    oracle: &OracleHarmonic,
    color: &[[f32; 3]],
    normals: &[Vec3],
    visibility: &HarmonicBake,
) -> Vec<[f64; 3]> {
    let k = color.len() / normals.len().max(1);
    color
        .par_chunks_exact(k.max(1))
        .enumerate()
        .flat_map_iter(|(i, color)| {
            let color: Vec<[f64; 3]> = color.iter().map(|c| c.map(f64::from)).collect();
            let v = visibility_coefficients(visibility, i, oracle.settings.sh_degree);
            let v: Vec<f64> = v.into_iter().map(|(v, _)| v).collect();
            relight_surfel(oracle, &color, normals[i].to_array().map(f64::from), &v)
        })
        .collect()
}

/// Linear radiance SH `[K][3]` of one surfel under the target light, from its linear colour `[K][3]`, normal and visibility.
pub fn relight_surfel(
    oracle: &OracleHarmonic,
    color: &[[f64; 3]],
    normal: [f64; 3],
    visibility: &[f64],
) -> Vec<[f64; 3]> {
    let asset_degree = color.len().isqrt() - 1;
    debug_assert_eq!(coefficient_count(asset_degree), color.len());
    let terms = oracle.settings.terms;
    let mut out = vec![[0.0; 3]; color.len()];
    for c in 0..3 {
        let source = oracle.shadowed(&oracle.source, visibility, c);
        let target = oracle.shadowed(&oracle.target, visibility, c);
        // Eq. 5 and 6.
        let tau = oracle.irradiance(&target, normal)
            / (oracle.irradiance(&source, normal) + oracle.epsilon);
        out[0][c] = tau * color[0][c];
        if !terms.specular {
            continue;
        }
        let seen = if terms.reflection {
            oracle.mirrored(&target, normal)
        } else {
            target
        };
        for l in 1..=asset_degree.min(oracle.settings.sh_degree) {
            let norm = |f: &dyn Fn(usize) -> f64| band(l).map(|i| f(i) * f(i)).sum::<f64>().sqrt();
            // Eq. 9 and 10.
            let source_norm = norm(&|i| oracle.source[i][c]);
            let attenuation = if source_norm <= oracle.epsilon {
                0.0
            } else if terms.attenuation {
                norm(&|i| color[i][c]) / (source_norm + oracle.epsilon)
            } else {
                // A mirror under a source of mean radiance 1, in units of its mean irradiance, as epsilon is.
                f64::from(UNATTENUATED) * f64::from(oracle.settings.epsilon()) / oracle.epsilon
            };
            for i in band(l) {
                out[i][c] = attenuation * seen[i];
            }
        }
    }
    out
}

/// `V_k` and the cosine transfer vector `T_k` of surfel `i`, in pairs, as sums over the lattice. `[K]`
pub fn visibility_coefficients(
    visibility: &HarmonicBake,
    i: usize,
    degree: usize,
) -> Vec<(f64, f64)> {
    let n = visibility.normals[i].as_dvec3();
    let mut sums = vec![(0.0, 0.0); coefficient_count(degree)];
    let mut y = vec![0.0; sums.len()];
    for (j, w) in fibonacci_sphere(visibility.directions)
        .into_iter()
        .enumerate()
    {
        let open = f64::from(visibility.open[i * visibility.directions + j]) / 255.0;
        let cosine = n.dot(DVec3::from_array(w)).max(0.0);
        evaluate_basis(w, degree, &mut y);
        let share = 4.0 * std::f64::consts::PI / visibility.directions as f64;
        for (sum, y) in sums.iter_mut().zip(&y) {
            sum.0 += share * open * y;
            sum.1 += share * open * cosine * y;
        }
    }
    sums
}
