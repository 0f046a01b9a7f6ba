//! SH basis functions, by the normalised recurrence over the associated Legendre functions.

use std::ops::{Add, Mul, Neg, Sub};

use glam::Vec3A;
use std::sync::LazyLock;

use super::bands::{MAX_COEFFICIENTS, MAX_DEGREE, coefficient_count};

/// Number type of the SH code: `f32`, `f64`, or a vector of lanes that computes several surfels at once.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// The nearest value to `x`.
    fn of(x: f64) -> Self;
}

impl Real for f32 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x as f32
    }
}

/// Three numbers at once.
impl Real for Vec3A {
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self::splat(x as f32)
    }
}

impl Real for f64 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x
    }
}

/// Constants of the recurrence `q(l,m) = a(l,m) z q(l-1,m) - b(l,m) q(l-2,m)`, started at `q(m,m)`.
/// `q` is normalised: `Y(l,m) = q(l,|m|) * (Re or Im of (x + iy)^|m|)`.
#[derive(Debug)]
pub struct BasisConstants {
    /// `a(l,m)`, indexed `[l][m]`, `m < l`.
    pub a: [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1],
    /// `b(l,m)`, indexed `[l][m]`, `m < l`; zero where `q(l-2,m)` does not exist.
    pub b: [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1],
    /// `q(m,m)`, with the factor `sqrt 2` of real harmonics for `m > 0`.
    pub start: [f64; MAX_DEGREE + 1],
}

static CONSTANTS: LazyLock<BasisConstants> = LazyLock::new(|| {
    let mut c = BasisConstants {
        a: Default::default(),
        b: Default::default(),
        start: Default::default(),
    };
    let mut q = (1.0 / (4.0 * std::f64::consts::PI)).sqrt();
    for m in 0..=MAX_DEGREE {
        if m > 0 {
            q *= -((2 * m + 1) as f64 / (2 * m) as f64).sqrt();
        }
        c.start[m] = if m > 0 { q * 2f64.sqrt() } else { q };
        for l in m + 1..=MAX_DEGREE {
            let (l_, m_) = (l as f64, m as f64);
            let span = l_ * l_ - m_ * m_;
            c.a[l][m] = ((4.0 * l_ * l_ - 1.0) / span).sqrt();
            if l > m + 1 {
                let below = (l_ - 1.0) * (l_ - 1.0) - m_ * m_;
                c.b[l][m] = ((2.0 * l_ + 1.0) * below / ((2.0 * l_ - 3.0) * span)).sqrt();
            }
        }
    }
    c
});

/// The recurrence's constants, from which the WGSL of the GPU passes is written too.
pub fn basis_constants() -> &'static BasisConstants {
    &CONSTANTS
}

/// Evaluates all basis functions up to `degree` at the unit vector `d`; `out` has at least `(degree + 1)^2` entries.
#[inline(always)]
pub fn evaluate_basis<T: Real>(d: [T; 3], degree: usize, out: &mut [T]) {
    let c = basis_constants();
    let [x, y, z] = d;
    let (mut re, mut im) = (T::of(1.0), T::of(0.0));
    let out = &mut out[..coefficient_count(degree)];
    for m in 0..=degree {
        if m > 0 {
            (re, im) = (re * x - im * y, re * y + im * x);
        }
        let (mut below, mut q) = (T::of(0.0), T::of(c.start[m]));
        for l in m..=degree {
            if l > m {
                (below, q) = (q, T::of(c.a[l][m]) * z * q - T::of(c.b[l][m]) * below);
            }
            out[l * l + l + m] = q * re;
            if m > 0 {
                out[l * l + l - m] = q * im;
            }
        }
    }
}

/// Value at the unit vector `d` of a function with coefficients `[K][3]`.
pub fn evaluate_sh(coefficients: &[[f32; 3]], degree: usize, d: [f32; 3]) -> [f32; 3] {
    let mut basis = [0f32; MAX_COEFFICIENTS];
    evaluate_basis(d, degree, &mut basis);
    let mut sum = [0f32; 3];
    for (c, y) in coefficients[..coefficient_count(degree)].iter().zip(basis) {
        for (s, c) in sum.iter_mut().zip(c) {
            *s += c * y;
        }
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::sphere_quadrature;

    #[test]
    fn basis_is_orthonormal() {
        let mut gram = vec![0f64; MAX_COEFFICIENTS * MAX_COEFFICIENTS];
        for (d, w) in sphere_quadrature(2 * MAX_DEGREE) {
            let mut y = [0f64; MAX_COEFFICIENTS];
            evaluate_basis(d, MAX_DEGREE, &mut y);
            for i in 0..MAX_COEFFICIENTS {
                for j in 0..MAX_COEFFICIENTS {
                    gram[i * MAX_COEFFICIENTS + j] += w * y[i] * y[j];
                }
            }
        }
        for i in 0..MAX_COEFFICIENTS {
            for j in 0..MAX_COEFFICIENTS {
                let expected = f64::from(u8::from(i == j));
                assert!((gram[i * MAX_COEFFICIENTS + j] - expected).abs() < 1e-13);
            }
        }
    }

    #[test]
    fn low_bands_are_the_trainers() {
        // The constants and signs that 3DGS and 2DGS training code uses, bands 0 to 3 along a generic direction.
        let (x, y, z) = (0.36f64, -0.48, 0.8);
        let pi = std::f64::consts::PI;
        let c1 = (3.0 / (4.0 * pi)).sqrt();
        let c2 = (15.0 / (4.0 * pi)).sqrt();
        let c3 = (35.0 / (32.0 * pi)).sqrt();
        let expected = [
            (0, (1.0 / (4.0 * pi)).sqrt()),
            (1, -c1 * y),
            (2, c1 * z),
            (3, -c1 * x),
            (4, c2 * x * y),
            (5, -c2 * y * z),
            (6, (5.0 / (16.0 * pi)).sqrt() * (3.0 * z * z - 1.0)),
            (7, -c2 * x * z),
            (8, c2 / 2.0 * (x * x - y * y)),
            (9, -c3 * y * (3.0 * x * x - y * y)),
            (15, -c3 * x * (x * x - 3.0 * y * y)),
        ];
        let mut got = [0f64; 16];
        evaluate_basis([x, y, z], 3, &mut got);
        for (i, value) in expected {
            assert!(
                (got[i] - value).abs() < 1e-14,
                "coefficient {i}: {} for {value}",
                got[i]
            );
        }
    }

    #[test]
    fn f32_follows_f64() {
        for (d, _) in sphere_quadrature(16) {
            let mut exact = [0f64; MAX_COEFFICIENTS];
            let mut single = [0f32; MAX_COEFFICIENTS];
            evaluate_basis(d, MAX_DEGREE, &mut exact);
            evaluate_basis(d.map(|v| v as f32), MAX_DEGREE, &mut single);
            for (e, s) in exact.iter().zip(single) {
                // |Y| <= 2, eight steps of recurrence with a rounding of 2^-24 each, amplified by a(l,m) z ~ 2.
                assert!((e - f64::from(s)).abs() < 4e-6);
            }
        }
    }
}
