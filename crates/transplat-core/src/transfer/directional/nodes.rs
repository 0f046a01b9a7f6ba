//! Quadrature nodes of a surfel's colour: directions of the hemisphere that cameras can see it from.
//!
//! They lie in the surfel's own frame, so that one set of matrices serves all surfels. The frame is the mirror that exchanges the
//! normal and the z axis: its own inverse, and cheap to apply to SH vectors.

use std::f64::consts::PI;

use glam::{Vec3, Vec3A};
use multiversion::multiversion;

use crate::sh::{
    MAX_COEFFICIENTS, Mirror, Real, coefficient_count, evaluate_basis, gauss_legendre,
};

/// Ridge of the fit on each coefficient above the DC, as a share of the constant function's weight: it settles what the visible hemisphere leaves
/// open.
pub const FIT_RIDGE: f64 = 0.02;

/// Weight of a grazing direction in the fit, beside the cosine by which the others count.
pub const FIT_FLOOR: f64 = 0.1;

/// Reflectance of a rough dielectric along its normal over that at grazing view, with which the lobe rises (Schlick 1994). Smooth glass
/// has 0.04; rough surfaces rise less.
pub const NORMAL_OVER_GRAZING: f32 = 0.1;

/// Nodes that are worked on at once: all of them up to degree 3.
pub(super) const BLOCK: usize = 32;

/// The quadrature and its matrices for one degree of the asset's colour.
#[derive(Clone, Debug)]
pub struct QuadratureNodes {
    /// Degree of the colour.
    pub degree: usize,
    /// Directions to the camera in the surfel's frame, z up. `[Q]`
    pub to_camera: Vec<Vec3>,
    /// Half of each, mirrored about the normal, an axis after the other; filled up to whole blocks. `[3][Q and more]`
    pub half_mirrored: [Vec<f32>; 3],
    /// Cosine-weighted quadrature over the hemisphere, sums to 1. `[Q]`
    pub weights: Vec<f32>,
    /// Value of each basis function at a node, as seen from there. `[K][Q]`
    pub evaluate: Vec<f32>,
    /// The least-squares fit of values at the nodes. `[Q][K]`
    pub fit: Vec<f32>,
    /// Fitted values at the nodes. `[Q][Q]`, values first
    pub refit: Vec<f32>,
    /// Moments of values at the nodes as the colour's degree shows them: their weighted mean, then K - 1 numbers whose squares add up to their
    /// variance; and those of values with Fresnel term. `[Q][2][K]`, values first
    pub moments: Vec<f32>,
    /// Factors of a weighted deviation at the nodes that make its sum with values there their covariance with how the values are shown, less its
    /// mean; and with Fresnel term. `[Q][2][Q]`
    pub covariance: Vec<f32>,
    /// Factor on a coated surface's lobe, which rises towards grazing view. `[Q]`
    pub rise: Vec<f32>,
    /// Basis functions in the same directions on the back. `[K][Q]`
    pub evaluate_back: Vec<f32>,
    /// Projection of values at the nodes of the front, and of the back. `[Q][K]` each
    pub project: [Vec<f32>; 2],
    /// Product of a function with a factor on the nodes of a height, those of the front before those of the back: a number for each pair of bands l
    /// <= l' of each order m >= 0, in [`QuadratureNodes::bands`]' order. `[pairs][2 heights]`
    by_height: Vec<f32>,
}

impl QuadratureNodes {
    /// Nodes for colour of a degree: `degree + 1` heights times twice as many azimuths.
    pub fn new(degree: usize) -> Self {
        let k = coefficient_count(degree);
        let (heights, azimuths) = (degree + 1, 2 * (degree + 1));
        let (mut to_camera, mut areas) = (Vec::new(), Vec::new());
        for (row, (x, w)) in gauss_legendre(heights).into_iter().enumerate() {
            let z = 0.5 * (x + 1.0);
            let r = (1.0 - z * z).sqrt();
            for column in 0..azimuths {
                let stagger = 0.5 * (row % 2) as f64;
                let phi = 2.0 * PI * (column as f64 + stagger) / azimuths as f64;
                to_camera.push([r * phi.cos(), r * phi.sin(), z]);
                areas.push(0.5 * w * 2.0 * PI / azimuths as f64);
            }
        }
        // Colour is a function of the direction from camera to surfel.
        let basis = |side: f64| -> Vec<f64> {
            to_camera
                .iter()
                .flat_map(|v| {
                    let mut y = [0f64; MAX_COEFFICIENTS];
                    evaluate_basis([-v[0], -v[1], -side * v[2]], degree, &mut y);
                    y[..k].to_vec()
                })
                .collect()
        };
        let (front, back) = (basis(1.0), basis(-1.0));
        let fit_weights: Vec<f64> = to_camera
            .iter()
            .zip(&areas)
            .map(|(v, a)| a * (v[2] + FIT_FLOOR))
            .collect();
        let fit = least_squares(&front, k, &fit_weights);
        let q = to_camera.len();
        let mut refit = vec![0f64; q * q];
        for a in 0..q {
            for b in 0..q {
                refit[a * q + b] = (0..k)
                    .map(|i| front[a * k + i] * fit[i * q + b])
                    .sum::<f64>();
            }
        }
        let total: f64 = to_camera.iter().zip(&areas).map(|(v, a)| a * v[2]).sum();
        let weights: Vec<f64> = (to_camera.iter().zip(&areas))
            .map(|(v, a)| a * v[2] / total)
            .collect();
        let rise: Vec<f64> = (to_camera.iter())
            .map(|v| 1.0 + (1.0 / f64::from(NORMAL_OVER_GRAZING) - 1.0) * (1.0 - v[2]).powi(5))
            .collect();
        let spread = spread(&front, k, &weights, &fit);
        let risen = |at: usize, kind: usize| if kind == 1 { rise[at] } else { 1.0 };
        let by_height = Self::bands(degree)
            .flat_map(|(m, a, b)| (0..2 * heights).map(move |h| (m, a, b, h)))
            .map(|(m, a, b, h)| {
                let basis = [&front, &back][h / heights];
                let ring = (h % heights) * azimuths..(h % heights + 1) * azimuths;
                let at = |s: usize, l: usize| basis[s * k + l * (l + 1) + m];
                ring.map(|s| areas[s] * at(s, a) * at(s, b)).sum::<f64>() as f32
            })
            .collect();
        let filling = q.next_multiple_of(BLOCK) - q;
        let project = |basis: &[f64]| -> Vec<f32> {
            (0..q * k)
                .map(|i| (areas[i / k] * basis[i]) as f32)
                .collect()
        };
        Self {
            degree,
            moments: (0..q * 2 * k)
                .map(|i| (i / (2 * k), i / k % 2, i % k))
                .map(|(s, kind, i)| (risen(s, kind) * spread[i * q + s]) as f32)
                .collect(),
            covariance: (0..q * 2 * q)
                .map(|i| (i / (2 * q), i / q % 2, i % q))
                .map(|(seen, kind, s)| (risen(s, kind) * (refit[seen * q + s] - spread[s])) as f32)
                .collect(),
            weights: weights.iter().map(|w| *w as f32).collect(),
            rise: rise.iter().map(|r| *r as f32).collect(),
            half_mirrored: std::array::from_fn(|axis| {
                let sign = if axis == 2 { 0.5 } else { -0.5 };
                let half = to_camera.iter().map(|v| (sign * v[axis]) as f32);
                half.chain(std::iter::repeat_n(0.0, filling)).collect()
            }),
            project: [project(&front), project(&back)],
            by_height,
            evaluate: transposed(&front, q),
            evaluate_back: transposed(&back, q),
            fit: transposed(&fit, k),
            refit: transposed(&refit, q),
            to_camera: to_camera
                .iter()
                .map(|v| Vec3::from_array(v.map(|v| v as f32)))
                .collect(),
        }
    }

    /// Number of nodes Q for colour of a degree.
    pub fn count_of(degree: usize) -> usize {
        2 * (degree + 1).pow(2)
    }

    /// Number of nodes Q.
    pub fn count(&self) -> usize {
        self.to_camera.len()
    }

    /// Orders m >= 0 with each pair of bands that have them.
    fn bands(degree: usize) -> impl Iterator<Item = (usize, usize, usize)> {
        let of_order =
            move |m| (m..=degree).flat_map(move |a| (a..=degree).map(move |b| (m, a, b)));
        (0..=degree).flat_map(of_order)
    }

    /// Heights of the front's nodes over the horizon, as cosines.
    pub fn heights(&self) -> impl Iterator<Item = f32> {
        let azimuths = 2 * (self.degree + 1);
        self.to_camera.iter().step_by(azimuths).map(|d| d.z)
    }

    /// Multiplies a function `[K]` in the surfel's frame by a factor that depends on the height alone, those of the front before those of the back,
    /// and adds it to `out`. Nodes of a height are as many as it takes for orders not to mix.
    #[inline(always)]
    pub fn add_by_height<T: Real>(&self, factors: &[T], function: &[T], out: &mut [T]) {
        let each = self.by_height.chunks_exact(factors.len());
        for ((m, a, b), heights) in Self::bands(self.degree).zip(each) {
            let weighted = |sum, (f, h): (&T, &f32)| sum + *f * T::of(f64::from(*h));
            let both = factors.iter().zip(heights).fold(T::of(0.0), weighted);
            let [a, b] = [a, b].map(|l| l * (l + 1));
            let mut add = |to: usize, from: usize| out[to] = out[to] + both * function[from];
            for order in [m as isize, -(m as isize)] {
                let [a, b] = [a, b].map(|l| l.wrapping_add_signed(order));
                add(a, b);
                if a != b {
                    add(b, a);
                }
                if m == 0 {
                    break;
                }
            }
        }
    }

    /// Values `[Q][3]` of a function `[K][3]` in the surfel's frame, by one of the matrices `[K][Q]`.
    pub fn values(&self, evaluate: &[f32], function: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut out = vec![[0.0; 3]; self.count()];
        product(evaluate, function, &mut out);
        out
    }

    /// Function `[K][3]` of values `[Q][3]` by one of the matrices `[Q][K]`.
    pub fn function(&self, matrix: &[f32], values: &[[f32; 3]]) -> Vec<[f32; 3]> {
        let mut out = vec![[0.0; 3]; coefficient_count(self.degree)];
        product(matrix, values, &mut out);
        out
    }

    /// The fit of values `[Q][3]` into `out`, `[K][3]`.
    pub fn fit_into(&self, values: &[[f32; 3]], out: &mut [[f32; 3]]) {
        product(&self.fit, values, out);
    }
}

/// `vector [n][3]` times `matrix [n][rows]`: rows are next to each other, so that they are lanes.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2", "aarch64+neon"))]
pub(super) fn product(matrix: &[f32], vector: &[[f32; 3]], out: &mut [[f32; 3]]) {
    const LANES: usize = 16;
    let rows = out.len();
    for start in (0..rows).step_by(LANES) {
        let count = LANES.min(rows - start);
        let mut sum = [[0f32; LANES]; 3];
        if count == LANES {
            for (row, v) in matrix.chunks_exact(rows).zip(vector) {
                let mut lanes = [0f32; LANES];
                lanes.copy_from_slice(&row[start..start + LANES]);
                for c in 0..3 {
                    for i in 0..LANES {
                        sum[c][i] += lanes[i] * v[c];
                    }
                }
            }
        } else {
            for (row, v) in matrix.chunks_exact(rows).zip(vector) {
                for c in 0..3 {
                    for i in 0..count {
                        sum[c][i] += row[start + i] * v[c];
                    }
                }
            }
        }
        for i in 0..count {
            out[start + i] = [sum[0][i], sum[1][i], sum[2][i]];
        }
    }
}

fn transposed(matrix: &[f64], rows: usize) -> Vec<f32> {
    let columns = matrix.len() / rows;
    (0..matrix.len())
        .map(|i| matrix[(i % rows) * columns + i / rows] as f32)
        .collect()
}

/// `(Y^T W Y + R)^-1 Y^T W`, `[K][Q]`, by Gauss-Jordan elimination; the matrix is positive definite.
fn least_squares(basis: &[f64], k: usize, weights: &[f64]) -> Vec<f64> {
    let q = weights.len();
    let total: f64 = weights.iter().sum();
    let width = k + q;
    let mut rows = vec![0f64; k * width];
    for i in 0..k {
        for j in 0..k {
            rows[i * width + j] = (0..q)
                .map(|s| weights[s] / total * basis[s * k + i] * basis[s * k + j])
                .sum();
        }
        if i > 0 {
            rows[i * width + i] += FIT_RIDGE / (4.0 * PI);
        }
        for s in 0..q {
            rows[i * width + k + s] = weights[s] / total * basis[s * k + i];
        }
    }
    for pivot in 0..k {
        let scale = 1.0 / rows[pivot * width + pivot];
        for v in &mut rows[pivot * width..][..width] {
            *v *= scale;
        }
        let row = rows[pivot * width..][..width].to_vec();
        for other in (0..k).filter(|o| *o != pivot) {
            let factor = rows[other * width + pivot];
            for (v, p) in rows[other * width..][..width].iter_mut().zip(&row) {
                *v -= factor * p;
            }
        }
    }
    (0..k)
        .flat_map(|i| rows[i * width + k..(i + 1) * width].to_vec())
        .collect()
}

/// Moments of fitted values at the nodes, `[K][Q]`: their weighted mean, and K - 1 rows whose results' squares add up to their variance, by
/// Cholesky's factor of the basis functions' covariance.
fn spread(basis: &[f64], k: usize, weights: &[f64], fit: &[f64]) -> Vec<f64> {
    let q = weights.len();
    let mean = |i: usize| -> f64 { (0..q).map(|s| weights[s] * basis[s * k + i]).sum() };
    let means: Vec<f64> = (0..k).map(mean).collect();
    let covariance = |i: usize, j: usize| -> f64 {
        let off = |s: usize, i: usize| basis[s * k + i] - means[i];
        (0..q).map(|s| weights[s] * off(s, i) * off(s, j)).sum()
    };
    // The first function is the constant, which has none.
    let mut factor = vec![0f64; k * k];
    for j in 1..k {
        for i in j..k {
            let known: f64 = (1..j).map(|m| factor[i * k + m] * factor[j * k + m]).sum();
            let rest = covariance(i, j) - known;
            factor[i * k + j] = match i == j {
                true => rest.max(0.0).sqrt(),
                false => rest / factor[j * k + j].max(1e-12),
            };
        }
    }
    let of_mean = |s: usize| -> f64 { (0..k).map(|i| means[i] * fit[i * q + s]).sum() };
    let of_row =
        |j: usize, s: usize| -> f64 { (j..k).map(|i| factor[i * k + j] * fit[i * q + s]).sum() };
    (0..k * q)
        .map(|at| (at / q, at % q))
        .map(|(j, s)| if j == 0 { of_mean(s) } else { of_row(j, s) })
        .collect()
}

/// The frame of a surfel: the mirror that exchanges its normal and the z axis.
#[derive(Clone, Copy, Debug)]
pub struct SurfelFrame {
    /// Unit normal of the mirror.
    pub mirror: Vec3,
}

impl SurfelFrame {
    /// The frame of a surfel with that unit normal.
    pub fn new(normal: Vec3) -> Self {
        // The difference loses its digits where the two are close; any mirror through the axis will do there.
        let difference = normal - Vec3::Z;
        Self {
            mirror: if difference.length_squared() > 1e-10 {
                difference.normalize()
            } else {
                Vec3::X
            },
        }
    }

    /// A direction from the world into the frame, or back.
    #[cfg(test)]
    pub fn apply(&self, d: Vec3) -> Vec3 {
        d - self.mirror * (2.0 * d.dot(self.mirror))
    }

    /// An SH function `[K][3]` from the world into the frame, or back.
    pub fn apply_sh(&self, degree: usize, function: &mut [[f32; 3]]) {
        let m = self.mirror;
        let r = m.x.hypot(m.y);
        let azimuth = if r > 1e-12 {
            (m.x / r, m.y / r)
        } else {
            (1.0, 0.0)
        };
        let [cos, sin, z, r] = [azimuth.0, azimuth.1, m.z, r].map(Vec3A::splat);
        let mirror = Mirror::new(degree, (cos, sin), (z, r));
        // The three channels at once.
        let mut band = [Vec3A::ZERO; 2 * crate::sh::MAX_DEGREE + 1];
        for l in 1..=degree {
            let range = crate::sh::band(l);
            for (b, f) in band.iter_mut().zip(&function[range.clone()]) {
                *b = Vec3A::from_array(*f);
            }
            mirror.reflect_band(l, &mut band[..2 * l + 1]);
            for (f, b) in function[range].iter_mut().zip(band) {
                *f = b.to_array();
            }
        }
    }
}

/// Weighted sum of colours; the weights sum to 1.
pub(super) fn weighted_mean(weights: &[f32], values: &[[f32; 3]]) -> [f32; 3] {
    let mut sum = [0f32; 3];
    for (w, v) in weights.iter().zip(values) {
        for (s, v) in sum.iter_mut().zip(v) {
            *s += w * v;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::evaluate_sh;

    fn function(degree: usize) -> Vec<[f32; 3]> {
        (0..coefficient_count(degree))
            .map(|i| std::array::from_fn(|c| ((i * 7 + c * 3) as f32).sin() / (1 + i) as f32))
            .collect()
    }

    #[test]
    fn a_fit_of_a_functions_own_values_is_close_to_it_where_it_is_seen() {
        for degree in 0..=4 {
            let nodes = QuadratureNodes::new(degree);
            let f = function(degree);
            let values = nodes.values(&nodes.evaluate, &f);
            let back = nodes.values(&nodes.evaluate, &nodes.function(&nodes.fit, &values));
            for (a, b) in values.iter().zip(&back) {
                // The ridge draws it a little towards the constant.
                assert!((a[0] - b[0]).abs() < 0.1, "degree {degree}: {a:?} {b:?}");
            }
        }
    }

    /// Of a few values: mean, variance, and covariance with a colour, of what their fit shows, once as they are and once as they rise.
    #[test]
    fn moments_of_values_are_those_of_what_their_fit_shows() {
        for degree in [1, 2, 3, 4, 8] {
            let nodes = QuadratureNodes::new(degree);
            let (q, k) = (nodes.count(), coefficient_count(degree));
            let wave =
                |s: usize, turn: f32| [(s as f32 * turn).sin(), (s as f32 * turn).cos(), 0.3];
            let values: Vec<[f32; 3]> = (0..q).map(|s| wave(s, 0.7)).collect();
            let colors: Vec<[f32; 3]> = (0..q).map(|s| wave(s, 0.4)).collect();
            let mean = weighted_mean(&nodes.weights, &colors);
            let weighed = nodes.weights.iter().zip(&colors);
            let off: Vec<[f32; 3]> = weighed
                .map(|(w, color)| std::array::from_fn(|c| w * (color[c] - mean[c])))
                .collect();
            let (mut of_values, mut toward) = (vec![[0.0; 3]; 2 * k], vec![[0.0; 3]; 2 * q]);
            product(&nodes.moments, &values, &mut of_values);
            product(&nodes.covariance, &off, &mut toward);
            for kind in 0..2 {
                let rise = |s: usize| if kind == 1 { nodes.rise[s] } else { 1.0 };
                let lit: Vec<[f32; 3]> = (0..q).map(|s| values[s].map(|v| rise(s) * v)).collect();
                let seen = nodes.values(&nodes.refit, &lit);
                let seen_mean = weighted_mean(&nodes.weights, &seen);
                for c in 0..3 {
                    let sum = |of: &dyn Fn(usize) -> f32| (0..q).map(of).sum::<f32>();
                    let variance = sum(&|s| nodes.weights[s] * (seen[s][c] - seen_mean[c]).powi(2));
                    let covariance = sum(&|s| off[s][c] * (seen[s][c] - seen_mean[c]));
                    let of = &of_values[kind * k..][..k];
                    let squares: f32 = of[1..].iter().map(|v| v[c] * v[c]).sum();
                    let summed = sum(&|s| values[s][c] * toward[kind * q + s][c]);
                    // Sums of up to fifty numbers about 1, of which rise makes 10.
                    for (a, b) in [
                        (of[0][c], seen_mean[c]),
                        (squares, variance),
                        (summed, covariance),
                    ] {
                        assert!(
                            (a - b).abs() < 1e-4,
                            "degree {degree}, {kind}, {c}: {a} {b}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn the_frame_is_its_own_inverse_and_turns_functions_with_directions() {
        for n in [
            Vec3::Z,
            -Vec3::Z,
            Vec3::X,
            Vec3::new(1e-6, 0.0, 1.0),
            Vec3::new(0.3, -0.5, 0.2),
        ] {
            let n = n.normalize();
            let frame = SurfelFrame::new(n);
            assert!((frame.apply(n) - Vec3::Z).length() < 1e-5);
            let d = Vec3::new(0.6, -0.64, 0.48);
            assert!((frame.apply(frame.apply(d)) - d).length() < 1e-6);
            let f = function(3);
            let mut turned = f.clone();
            frame.apply_sh(3, &mut turned);
            let (a, b) = (
                evaluate_sh(&f, 3, d.to_array()),
                evaluate_sh(&turned, 3, frame.apply(d).to_array()),
            );
            assert!((a[1] - b[1]).abs() < 1e-5, "{n}: {a:?} {b:?}");
        }
    }

    #[test]
    fn a_factor_by_height_is_the_same_at_the_nodes() {
        for degree in 0..=4 {
            let nodes = QuadratureNodes::new(degree);
            let f = function(degree);
            let heights: Vec<f32> = nodes.heights().collect();
            let factor = |h: usize| Vec3A::new((h as f32).sin(), 1.0 / (1 + h) as f32, h as f32);
            let factors: Vec<Vec3A> = (0..2 * heights.len()).map(factor).collect();
            let mut fast = vec![Vec3A::ZERO; f.len()];
            let f_at_once: Vec<Vec3A> = f.iter().map(|v| Vec3A::from_array(*v)).collect();
            nodes.add_by_height(&factors, &f_at_once, &mut fast);
            let mut slow = vec![[0.0; 3]; f.len()];
            let sides = [&nodes.evaluate, &nodes.evaluate_back];
            for (side, evaluate) in sides.into_iter().enumerate() {
                let mut values = nodes.values(evaluate, &f);
                for (s, v) in values.iter_mut().enumerate() {
                    let height = s / (2 * (degree + 1));
                    assert_eq!(heights[height], nodes.to_camera[s].z);
                    let factor = factors[side * heights.len() + height];
                    *v = (Vec3A::from_array(*v) * factor).to_array();
                }
                for (sum, v) in slow
                    .iter_mut()
                    .zip(nodes.function(&nodes.project[side], &values))
                {
                    *sum = std::array::from_fn(|c| sum[c] + v[c]);
                }
            }
            for (a, b) in fast.iter().zip(&slow) {
                assert!(
                    (0..3).all(|c| (a[c] - b[c]).abs() < 1e-4),
                    "{degree}: {a:?} {b:?}"
                );
            }
        }
    }

    #[test]
    fn the_two_sides_project_a_function_exactly() {
        let nodes = QuadratureNodes::new(3);
        let f = function(3);
        let front = nodes.function(&nodes.project[0], &nodes.values(&nodes.evaluate, &f));
        let back = nodes.function(&nodes.project[1], &nodes.values(&nodes.evaluate_back, &f));
        for ((f, a), b) in f.iter().zip(front).zip(back) {
            assert!((f[2] - a[2] - b[2]).abs() < 1e-5, "{f:?} {a:?} {b:?}");
        }
    }
}
