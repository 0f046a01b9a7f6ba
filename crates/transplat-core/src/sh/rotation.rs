//! Rotations and reflections of SH vectors, exactly, from one constant matrix a band.
//!
//! A turn about z is cosines and sines of `m phi`. The exchange of y and z is a constant, sparse, symmetric matrix `J` that is
//! its own inverse, and `J Rz(b) J` turns about y. So every rotation is `Rz(a) J Rz(b) J Rz(c)`, and the mirror on the plane with normal
//! `n = (theta, phi)` is `Rz(phi) Mz J Rz(2 theta) J Rz(-phi)`, `Mz` being the mirror z -> -z, `(-1)^(l+m)` in SH.

use std::sync::LazyLock;

use glam::DMat3;
use rayon::prelude::*;

use super::bands::{MAX_COEFFICIENTS, MAX_DEGREE, band, coefficient_count};
use super::basis::{Real, evaluate_basis};
use super::quadrature::sphere_quadrature;

/// One entry of the matrix `J` of a band; `row` and `column` count from the start of the band.
#[derive(Clone, Copy, Debug)]
pub struct ExchangeEntry {
    /// Row in the band, 0 for `m = -l`.
    pub row: usize,
    /// Column in the band.
    pub column: usize,
    /// `integral of Y_row(x, y, z) Y_column(x, z, y)`.
    pub value: f64,
}

static EXCHANGE: LazyLock<Vec<Vec<ExchangeEntry>>> = LazyLock::new(|| {
    let mut dense = vec![[0f64; MAX_COEFFICIENTS]; MAX_COEFFICIENTS];
    for ([x, y, z], w) in sphere_quadrature(2 * MAX_DEGREE) {
        let (mut straight, mut exchanged) = ([0f64; MAX_COEFFICIENTS], [0f64; MAX_COEFFICIENTS]);
        evaluate_basis([x, y, z], MAX_DEGREE, &mut straight);
        evaluate_basis([x, z, y], MAX_DEGREE, &mut exchanged);
        for (row, s) in dense.iter_mut().zip(straight) {
            for (entry, e) in row.iter_mut().zip(exchanged) {
                *entry += w * s * e;
            }
        }
    }
    (0..=MAX_DEGREE)
        .map(|l| {
            let mut entries = Vec::new();
            for i in band(l) {
                for j in band(l) {
                    // Entries are sums of products of square roots of rationals; what is not zero is far above rounding.
                    if dense[i][j].abs() > 1e-10 {
                        entries.push(ExchangeEntry {
                            row: i - band(l).start,
                            column: j - band(l).start,
                            value: dense[i][j],
                        });
                    }
                }
            }
            entries
        })
        .collect()
});

/// The non-zero entries of `J` for band `l`.
pub fn exchange_yz(l: usize) -> &'static [ExchangeEntry] {
    &EXCHANGE[l]
}

/// Turns one band by the angle whose multiples' cosines and sines are given: `cos[m] = cos(m a)`, `m <= l`.
/// The function turns with the angle: a peak at azimuth 0 comes to azimuth `a`.
#[inline(always)]
fn rotate_z<T: Real>(l: usize, cos: &[T], sin: &[T], f: &mut [T]) {
    for m in 1..=l {
        // f holds  p cos(m phi) + q sin(m phi)  with p at +m and q at -m.
        let (p, q) = (f[l + m], f[l - m]);
        f[l + m] = p * cos[m] - q * sin[m];
        f[l - m] = q * cos[m] + p * sin[m];
    }
}

/// Exchanges y and z in one band: those of colour in closed form, the others by the table.
#[inline(always)]
fn exchange<T: Real>(l: usize, f: &mut [T]) {
    let of = |root: f64, over: f64| T::of(root.sqrt() / over);
    match (l, &mut *f) {
        (1, [a, b, _]) => (*a, *b) = (-*b, -*a),
        (2, [a, _, c, d, e]) => {
            (*a, *d) = (-*d, -*a);
            let (half, root) = (T::of(0.5), of(3.0, 2.0));
            (*c, *e) = (-(*c * half + *e * root), *e * half - *c * root);
        }
        (3, [a, _, c, d, e, g, h]) => {
            let (ten, six) = (of(10.0, 4.0), of(6.0, 4.0));
            let (quarter, fifteen) = (T::of(0.25), of(15.0, 4.0));
            let (a0, c0, d0, g0) = (*a, *c, *d, *g);
            *a = d0 * ten - g0 * six;
            *c = d0 * six + g0 * ten;
            *d = a0 * ten + c0 * six;
            *g = c0 * ten - a0 * six;
            (*e, *h) = (-(*e * quarter + *h * fifteen), *h * quarter - *e * fifteen);
        }
        _ => exchange_by_table(l, f),
    }
}

#[inline(always)]
fn exchange_by_table<T: Real>(l: usize, f: &mut [T]) {
    let mut out = [T::of(0.0); 2 * MAX_DEGREE + 1];
    let out = &mut out[..2 * l + 1];
    for e in exchange_yz(l) {
        out[e.row] = out[e.row] + T::of(e.value) * f[e.column];
    }
    f.copy_from_slice(out);
}

/// Cosines and sines of `m a` for `m` up to a degree, from those of `a`.
#[inline(always)]
fn multiples<T: Real>(degree: usize, cos: T, sin: T) -> ([T; MAX_DEGREE + 1], [T; MAX_DEGREE + 1]) {
    let mut c = [T::of(1.0); MAX_DEGREE + 1];
    let mut s = [T::of(0.0); MAX_DEGREE + 1];
    for m in 1..=degree {
        c[m] = c[m - 1] * cos - s[m - 1] * sin;
        s[m] = c[m - 1] * sin + s[m - 1] * cos;
    }
    (c, s)
}

/// The mirror `f(d) -> f(d - 2 (d.n) n)` of one normal, `D(n)` of the paper's eq. 7 applied to SH vectors.
#[derive(Clone, Copy, Debug)]
pub struct Mirror<T> {
    cos: [T; MAX_DEGREE + 1],
    sin: [T; MAX_DEGREE + 1],
    cos_2: [T; MAX_DEGREE + 1],
    sin_2: [T; MAX_DEGREE + 1],
}

impl<T: Real> Mirror<T> {
    /// From `(cos phi, sin phi)` and `(cos theta, sin theta)` of the unit normal, for bands up to a degree; at the pole any azimuth will do.
    #[inline(always)]
    pub fn new(degree: usize, azimuth: (T, T), polar: (T, T)) -> Self {
        let (cos, sin) = multiples(degree, azimuth.0, azimuth.1);
        let (cos_2, sin_2) = multiples(
            degree,
            polar.0 * polar.0 - polar.1 * polar.1,
            polar.0 * polar.1 + polar.0 * polar.1,
        );
        Self {
            cos,
            sin,
            cos_2,
            sin_2,
        }
    }

    /// Mirrors the band `l` of an SH vector, `2 l + 1` values, in place.
    #[inline(always)]
    pub fn reflect_band(&self, l: usize, f: &mut [T]) {
        let minus_sin = self.sin.map(|s| -s);
        rotate_z(l, &self.cos, &minus_sin, f);
        exchange(l, f);
        rotate_z(l, &self.cos_2, &self.sin_2, f);
        exchange(l, f);
        // (-1)^(l + m) with m counted from -l, so the sign is that of the index.
        for value in f.iter_mut().skip(1).step_by(2) {
            *value = -*value;
        }
        rotate_z(l, &self.cos, &self.sin, f);
    }
}

/// Coefficients of `f(R^-1 d)`: the function turned by the rotation `R`, per channel. `K` entries of `[f; C]`.
pub fn rotate_coefficients<const C: usize>(
    rotation: DMat3,
    degree: usize,
    coefficients: &[[f32; C]],
) -> Vec<[f32; C]> {
    // R = Rz(a) Ry(b) Rz(c), and Ry(b) = J Rz(-b) J.
    let z = rotation.z_axis;
    let sin_b = z.x.hypot(z.y);
    let (a, c) = if sin_b > 1e-12 {
        (z.y.atan2(z.x), rotation.y_axis.z.atan2(-rotation.x_axis.z))
    } else {
        // No tilt: R is a turn about z (or that after a half turn about y), and a alone carries it.
        let x = rotation.x_axis * z.z.signum();
        (x.y.atan2(x.x), 0.0)
    };
    let b = sin_b.atan2(z.z);
    let turn = |angle: f64| multiples(degree, angle.cos(), angle.sin());
    let ((cos_a, sin_a), (cos_b, sin_b), (cos_c, sin_c)) = (turn(a), turn(-b), turn(c));
    let mut out = vec![[0f32; C]; coefficient_count(degree)];
    for l in 0..=degree {
        for channel in 0..C {
            let mut f = [0f64; 2 * MAX_DEGREE + 1];
            let f = &mut f[..2 * l + 1];
            for (f, i) in f.iter_mut().zip(band(l)) {
                *f = f64::from(coefficients[i][channel]);
            }
            rotate_z(l, &cos_c, &sin_c, f);
            exchange(l, f);
            rotate_z(l, &cos_b, &sin_b, f);
            exchange(l, f);
            rotate_z(l, &cos_a, &sin_a, f);
            for (f, i) in f.iter().zip(band(l)) {
                out[i][channel] = *f as f32;
            }
        }
    }
    out
}

/// Rotates many functions, `[n][K][3]`.
pub fn rotate_functions(rotation: DMat3, degree: usize, functions: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let each = functions.par_chunks_exact(coefficient_count(degree));
    each.flat_map_iter(|f| rotate_coefficients(rotation, degree, f))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    #[test]
    fn closed_forms_are_what_the_table_says() {
        for l in 0..=4 {
            let f: Vec<f64> = (0..2 * l + 1).map(|i| 1.0 / (1 + i) as f64).collect();
            let (mut fast, mut slow) = (f.clone(), f);
            exchange(l, &mut fast);
            exchange_by_table(l, &mut slow);
            for (a, b) in fast.iter().zip(&slow) {
                assert!((a - b).abs() < 1e-12, "{l}: {fast:?} {slow:?}");
            }
        }
    }

    fn some_function() -> Vec<[f32; 1]> {
        (0..MAX_COEFFICIENTS)
            .map(|i| [((i * 37 + 11) % 23) as f32 / 23.0 - 0.5])
            .collect()
    }

    fn value(f: &[[f32; 1]], d: DVec3) -> f64 {
        let mut y = [0f64; MAX_COEFFICIENTS];
        evaluate_basis(d.to_array(), MAX_DEGREE, &mut y);
        f.iter().zip(y).map(|(f, y)| f64::from(f[0]) * y).sum()
    }

    fn unit() -> impl Strategy<Value = DVec3> {
        (-1.0..1.0, 0.0..std::f64::consts::TAU).prop_map(|(z, phi): (f64, f64)| {
            let r = (1.0 - z * z).sqrt();
            DVec3::new(r * phi.cos(), r * phi.sin(), z)
        })
    }

    #[test]
    fn exchange_is_sparse_and_its_own_inverse() {
        for l in 0..=MAX_DEGREE {
            assert!(exchange_yz(l).len() <= (l + 1) * (l + 1) + l * l);
            for i in 0..2 * l + 1 {
                let mut f = [0f64; 2 * MAX_DEGREE + 1];
                f[i] = 1.0;
                exchange(l, &mut f[..2 * l + 1]);
                exchange(l, &mut f[..2 * l + 1]);
                for (j, v) in f[..2 * l + 1].iter().enumerate() {
                    assert!((v - f64::from(u8::from(i == j))).abs() < 1e-12);
                }
            }
        }
    }

    #[test]
    fn special_rotations_are_not_special() {
        let f = some_function();
        let d = DVec3::new(0.48, -0.6, 0.64);
        for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
            for quarter in 0..4 {
                let r =
                    DMat3::from_axis_angle(axis, f64::from(quarter) * std::f64::consts::FRAC_PI_2);
                let turned = rotate_coefficients(r, MAX_DEGREE, &f);
                let difference = value(&turned, r * d) - value(&f, d);
                assert!(difference.abs() < 1e-5, "{axis} {quarter}: {difference}");
            }
        }
    }

    proptest! {
        #[test]
        fn a_turned_function_has_its_value_at_the_turned_direction(d in unit(), axis in unit(), angle in -7.0..7.0f64) {
            let r = DMat3::from_quat(DQuat::from_axis_angle(axis, angle));
            let f = some_function();
            let turned = rotate_coefficients(r, MAX_DEGREE, &f);
            // Coefficients are stored in f32: 81 of them, each under 0.5, times |Y| <= 2, each off by 2^-25.
            prop_assert!((value(&turned, r * d) - value(&f, d)).abs() < 1e-5);
        }

        #[test]
        fn reflection_is_evaluation_at_the_mirrored_direction(d in unit(), n in unit()) {
            let f = some_function();
            let r = n.x.hypot(n.y);
            let azimuth = if r > 0.0 { (n.x / r, n.y / r) } else { (1.0, 0.0) };
            let mut mirrored: Vec<f64> = f.iter().map(|f| f64::from(f[0])).collect();
            let mirror = Mirror::new(MAX_DEGREE, azimuth, (n.z, r));
            for l in 0..=MAX_DEGREE {
                mirror.reflect_band(l, &mut mirrored[band(l)]);
            }
            let mut y = [0f64; MAX_COEFFICIENTS];
            evaluate_basis(d.to_array(), MAX_DEGREE, &mut y);
            let got: f64 = mirrored.iter().zip(y).map(|(f, y)| f * y).sum();
            prop_assert!((got - value(&f, d - 2.0 * d.dot(n) * n)).abs() < 1e-11);
        }
    }
}
