//! What a surfel's colour has to do with what it mirrors of the source light, as the view changes.

use super::lobe::{WIDTHS, mirrored, mirrored_by_all};
use super::nodes::{Nodes, SurfelFrame, product};
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

/// Those of all lobes, as they are and as they rise.
pub type AllMoments = [[Moments; WIDTHS.len()]; 2];

/// What a surfel's colour is held against its lobes in.
#[derive(Default)]
pub struct Asked {
    /// What shines on it.
    pub rays: Rays,
    /// Mirrored by each lobe. `[WIDTHS][3][Q]`
    mirrored: Vec<f32>,
    /// The same of one lobe, channels together. `[Q]`
    lit: Vec<[f32; 3]>,
    /// [`Nodes::moments`] of that. `[2][K]`
    of_lit: Vec<[f32; 3]>,
    /// How much the colour is off its mean, by weight, and what that is to values at the nodes. `[Q]`
    off: Vec<[f32; 3]>,
    toward: Vec<[f32; 3]>,
}

impl Asked {
    /// What one lobe shows on the mean, as it is or as it rises; `rays` are set.
    pub fn mean(
        &mut self,
        (nodes, frame): (&Nodes, SurfelFrame),
        (width, rises): (usize, bool),
    ) -> [f32; 3] {
        let (q, k) = (nodes.count(), coefficient_count(nodes.degree));
        self.mirrored.resize(WIDTHS.len() * 3 * q, 0.0);
        mirrored(nodes, frame, WIDTHS[width], &self.rays, &mut self.mirrored);
        let weights = || {
            nodes.moments[usize::from(rises) * k..]
                .iter()
                .step_by(2 * k)
        };
        std::array::from_fn(|c| {
            let values = self.mirrored[c * q..][..q].iter();
            values.zip(weights()).map(|(v, w)| v * w).sum()
        })
    }

    /// Moments of a colour `[Q]` of that mean and each lobe, as it is and as it rises, as far as a function of the asset's degree can show it, and the
    /// colour's variance; `rays` are set.
    pub fn moments(
        &mut self,
        (nodes, frame): (&Nodes, SurfelFrame),
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
                let [mean, spread @ ..] = &self.of_lit[kind * k..][..k] else {
                    continue;
                };
                let found = &mut found[width];
                found.mean = *mean;
                for s in spread {
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

fn color_variance(nodes: &Nodes, colors: &[[f32; 3]], mean: [f32; 3]) -> [f32; 3] {
    let mut sum = [0f32; 3];
    for (w, c) in nodes.weights.iter().zip(colors) {
        for k in 0..3 {
            sum[k] += w * (c[k] - mean[k]).powi(2);
        }
    }
    sum
}
