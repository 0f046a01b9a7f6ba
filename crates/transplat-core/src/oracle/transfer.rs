//! The paper's transfer of one surfel in f64. Shadowing goes by the explicit tensor, reflection by sampling and projecting,
//! as the paper has them: other ways to the same numbers than production takes.

use crate::environment::IncidentRadiance;
use crate::sh::{
    SphereQuadrature, band, coefficient_count, cosine_kernel, evaluate_basis, triple_product_tensor,
};
use crate::transfer::TransferSettings;
use crate::transfer::paper::UNATTENUATED;

/// What the oracle needs of lights and settings; made once, since the tensor takes a while.
pub struct OracleTransfer {
    settings: TransferSettings,
    tensor: Vec<f64>,
    source: Vec<[f64; 3]>,
    target: Vec<[f64; 3]>,
    epsilon: f64,
}

impl OracleTransfer {
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
        }
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
        for (d, w) in SphereQuadrature::exact(2 * degree).nodes() {
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

/// Linear radiance SH `[K][3]` of one surfel under the target light, from its linear colour `[K][3]`, normal and visibility.
pub fn relight_surfel(
    oracle: &OracleTransfer,
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
