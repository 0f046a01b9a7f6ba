//! Moments of a surfel's colour with its specular lobes under the source light, over views.

use super::lobe::{WIDTHS, mirrored, mirrored_by_all};
use super::nodes::{QuadratureNodes, SurfelFrame, product};
use super::rays::Rays;
use crate::sh::coefficient_count;

/// Sums of a surfel's colour against one lobe.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moments {
    /// Mean mirrored light.
    pub mean: [f32; 3],
    /// Covariance of mirrored light and colour.
    pub covariance: [f32; 3],
    /// Variance of mirrored light.
    pub variance: [f32; 3],
}

/// Moments of all lobes, without and with Fresnel term.
pub type AllMoments = [[Moments; WIDTHS.len()]; 2];

/// Scratch for comparing a surfel's colour with its lobes.
#[derive(Default)]
pub struct MomentScratch {
    /// Light that shines on it.
    pub rays: Rays,
    /// Mirrored by each lobe. `[WIDTHS][3][Q]`
    mirrored: Vec<f32>,
    /// Colour of one lobe, channels together. `[Q]`
    lit: Vec<[f32; 3]>,
    /// [`QuadratureNodes::moments`] of that. `[2][K]`
    of_lit: Vec<[f32; 3]>,
    /// Deviation of the colour from its mean, by weight, as values at the nodes. `[Q]`
    off: Vec<[f32; 3]>,
    toward: Vec<[f32; 3]>,
}

impl MomentScratch {
    /// Mean of one lobe, without or with Fresnel term; `rays` are set.
    pub fn mean(
        &mut self,
        (nodes, frame): (&QuadratureNodes, SurfelFrame),
        (width, has_fresnel): (usize, bool),
    ) -> [f32; 3] {
        let (q, k) = (nodes.count(), coefficient_count(nodes.degree));
        self.mirrored.resize(WIDTHS.len() * 3 * q, 0.0);
        mirrored(nodes, frame, WIDTHS[width], &self.rays, &mut self.mirrored);
        let weights = || {
            nodes.moments[usize::from(has_fresnel) * k..]
                .iter()
                .step_by(2 * k)
        };
        std::array::from_fn(|c| {
            let values = self.mirrored[c * q..][..q].iter();
            values.zip(weights()).map(|(v, w)| v * w).sum()
        })
    }

    /// Moments of a colour `[Q]` of that mean and each lobe, as it is and as it rises, as far as a function of the asset's degree can show it, and
    /// the
    /// colour's variance; `rays` are set.
    pub fn moments(
        &mut self,
        (nodes, frame): (&QuadratureNodes, SurfelFrame),
        colors: &[[f32; 3]],
        mean: [f32; 3],
    ) -> (AllMoments, [f32; 3]) {
        let (q, k) = (nodes.count(), coefficient_count(nodes.degree));
        self.mirrored.resize(WIDTHS.len() * 3 * q, 0.0);
        self.lit.resize(q, [0.0; 3]);
        self.of_lit.resize(2 * k, [0.0; 3]);
        self.toward.resize(2 * q, [0.0; 3]);
        mirrored_by_all(nodes, frame, &self.rays, &mut self.mirrored);
        self.off.clear();
        let weighed = nodes.weights.iter().zip(colors);
        self.off
            .extend(weighed.map(|(w, color)| std::array::from_fn(|c| w * (color[c] - mean[c]))));
        product(&nodes.covariance, &self.off, &mut self.toward);
        let mut found = [[Moments::default(); WIDTHS.len()]; 2];
        for (width, mirrored) in self.mirrored.chunks_exact(3 * q).enumerate() {
            for (s, lit) in self.lit.iter_mut().enumerate() {
                *lit = std::array::from_fn(|c| mirrored[c * q + s]);
            }
            product(&nodes.moments, &self.lit, &mut self.of_lit);
            for (kind, found) in found.iter_mut().enumerate() {
                let of_lit = &self.of_lit[kind * k..][..k];
                let found = &mut found[width];
                found.mean = of_lit[0];
                for s in &of_lit[1..] {
                    for c in 0..3 {
                        found.variance[c] += s[c] * s[c];
                    }
                }
                for (l, t) in self.lit.iter().zip(&self.toward[kind * q..]) {
                    for c in 0..3 {
                        found.covariance[c] += l[c] * t[c];
                    }
                }
            }
        }
        (found, color_variance(nodes, colors, mean))
    }
}

fn color_variance(nodes: &QuadratureNodes, colors: &[[f32; 3]], mean: [f32; 3]) -> [f32; 3] {
    let mut sum = [0f32; 3];
    for (w, c) in nodes.weights.iter().zip(colors) {
        for k in 0..3 {
            sum[k] += w * (c[k] - mean[k]).powi(2);
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::environment::LightSample;
    use crate::sh::lattice;

    #[test]
    fn all_lobes_at_once_are_each_of_them_and_so_are_their_means() {
        for degree in [1, 3, 5] {
            let nodes = QuadratureNodes::new(degree);
            let q = nodes.count();
            let frame = SurfelFrame::new(Vec3::new(0.3, -0.5, 0.8).normalize());
            let mut held = MomentScratch::default();
            for (ray, direction) in lattice(60).into_iter().enumerate() {
                let energy = [0, 1, 2].map(|c| 1.0 + ((ray * 7 + c) as f32).sin());
                held.rays.set(ray, &LightSample { direction, energy });
            }
            let colors: Vec<[f32; 3]> = (0..q).map(|s| [s as f32, 1.0, (s * s) as f32]).collect();
            let (moments, _) = held.moments((&nodes, frame), &colors, [0.0; 3]);
            let together = held.mirrored.clone();
            let mut alone = vec![0f32; 3 * q];
            for (width, together) in together.chunks_exact(3 * q).enumerate() {
                mirrored(&nodes, frame, WIDTHS[width], &held.rays, &mut alone);
                // Sums of sixty, of the same products.
                for (a, b) in together.iter().zip(&alone) {
                    assert!((a - b).abs() <= 1e-5 * b.abs(), "degree {degree}: {a} {b}");
                }
                for has_fresnel in [false, true] {
                    let mean = held.mean((&nodes, frame), (width, has_fresnel));
                    let found = moments[usize::from(has_fresnel)][width].mean;
                    for (a, b) in mean.iter().zip(&found) {
                        assert!((a - b).abs() <= 1e-5 * b.abs(), "degree {degree}: {a} {b}");
                    }
                }
            }
        }
    }
}
