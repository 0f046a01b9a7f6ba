//! SH products by Gaunt coefficients (paper eq. 4).

use super::bands::coefficient_count;
use super::basis::evaluate_basis;
use super::quadrature::sphere_quadrature;

/// The shadowing operator of one light, `M_kq = sum_p G_kpq L_p` for each channel, `[K][K]` row-major in `k`.
///
/// The sum over `p` is the same for every surfel, so the triple product becomes one matrix-vector product each.
#[derive(Clone, Debug)]
pub struct LightOperator {
    /// Degree of light, visibility and result.
    pub degree: usize,
    /// One symmetric `[K][K]` matrix per channel.
    pub matrices: [Vec<f32>; 3],
    /// True where the three channels are equal.
    pub is_gray: bool,
}

/// Builds the operator of a light with coefficients `[K][3]`.
///
/// `M_kq` is the integral of `Y_k Y_q L`, a polynomial of degree `3 degree`: the quadrature makes it exact without the tensor.
pub fn light_operator(degree: usize, light: &[[f32; 3]]) -> LightOperator {
    let k = coefficient_count(degree);
    let is_gray = light[..k].iter().all(|[r, g, b]| r == g && g == b);
    let mut sums = [vec![0f64; k * k], vec![0f64; k * k], vec![0f64; k * k]];
    let needed = if is_gray { 1 } else { 3 };
    let mut y = vec![0f64; k];
    for (d, w) in sphere_quadrature(3 * degree) {
        evaluate_basis(d, degree, &mut y);
        for (channel, sum) in sums[..needed].iter_mut().enumerate() {
            let radiance: f64 = (0..k).map(|p| f64::from(light[p][channel]) * y[p]).sum();
            for i in 0..k {
                let scaled = w * radiance * y[i];
                for j in 0..=i {
                    sum[i * k + j] += scaled * y[j];
                }
            }
        }
    }
    let mut matrices = sums.map(|sum| {
        let mut matrix = vec![0f32; k * k];
        for i in 0..k {
            for j in 0..=i {
                matrix[i * k + j] = sum[i * k + j] as f32;
                matrix[j * k + i] = sum[i * k + j] as f32;
            }
        }
        matrix
    });
    if is_gray {
        let [one, others @ ..] = &mut matrices;
        others.fill(one.clone());
    }
    LightOperator {
        degree,
        matrices,
        is_gray,
    }
}

/// The tensor `G_kpq`, the integral of `Y_k Y_p Y_q`, dense `[K][K][K]` in f64: the oracle of [`light_operator`].
pub fn triple_product_tensor(degree: usize) -> Vec<f64> {
    let k = coefficient_count(degree);
    let mut tensor = vec![0f64; k * k * k];
    let mut y = vec![0f64; k];
    for (d, w) in sphere_quadrature(3 * degree) {
        evaluate_basis(d, degree, &mut y);
        for i in 0..k {
            for p in 0..k {
                for q in 0..k {
                    tensor[(i * k + p) * k + q] += w * y[i] * y[p] * y[q];
                }
            }
        }
    }
    tensor
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::SQRT_4PI;

    #[test]
    fn degree_three_has_353_entries() {
        let tensor = triple_product_tensor(3);
        assert_eq!(tensor.iter().filter(|g| g.abs() > 1e-12).count(), 353);
    }

    #[test]
    fn operator_is_the_contracted_tensor() {
        for degree in [0, 1, 3, 5] {
            let k = coefficient_count(degree);
            let light: Vec<[f32; 3]> = (0..k)
                .map(|i| [1.0 / (i + 1) as f32, -0.3 * i as f32, ((i * 7) % 5) as f32])
                .collect();
            let tensor = triple_product_tensor(degree);
            let operator = light_operator(degree, &light);
            for channel in 0..3 {
                for i in 0..k {
                    for q in 0..k {
                        let sum: f64 = (0..k)
                            .map(|p| tensor[(i * k + p) * k + q] * f64::from(light[p][channel]))
                            .sum();
                        let got = f64::from(operator.matrices[channel][i * k + q]);
                        // One rounding to f32 of values of a few tens.
                        assert!((got - sum).abs() < 1e-5 * (1.0 + sum.abs()));
                    }
                }
            }
        }
    }

    #[test]
    fn an_even_light_multiplies_by_one() {
        let mut light = vec![[0f32; 3]; 25];
        light[0] = [SQRT_4PI as f32; 3];
        let operator = light_operator(4, &light);
        for i in 0..25 {
            for q in 0..25 {
                let expected = f32::from(u8::from(i == q));
                assert!((operator.matrices[1][i * 25 + q] - expected).abs() < 1e-6);
            }
        }
    }
}
