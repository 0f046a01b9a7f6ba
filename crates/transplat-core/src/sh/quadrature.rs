//! Quadrature on the sphere: an exact product rule, and an equal-weight lattice.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};

/// Unit directions with weights that sum to `4 pi`: Gauss-Legendre in height times uniform in azimuth, exact for every product of
/// harmonics whose degrees sum to `degree`.
pub fn sphere_quadrature(degree: usize) -> Vec<([f64; 3], f64)> {
    let azimuths = degree + 1;
    let mut nodes = Vec::new();
    for (z, w) in gauss_legendre(degree / 2 + 1) {
        let r = (1.0 - z * z).sqrt();
        for j in 0..azimuths {
            let (sin, cos) = (2.0 * PI * (j as f64 + 0.5) / azimuths as f64).sin_cos();
            nodes.push(([r * cos, r * sin, z], w * 2.0 * PI / azimuths as f64));
        }
    }
    nodes
}

/// Nodes and weights of Gauss-Legendre quadrature on [-1, 1], by Newton's method on `P_n`.
pub(crate) fn gauss_legendre(n: usize) -> Vec<(f64, f64)> {
    (0..n)
        .map(|i| {
            let mut x = (PI * (i as f64 + 0.75) / (n as f64 + 0.5)).cos();
            let mut slope = 1.0;
            for _ in 0..100 {
                let (mut p0, mut p1) = (1.0, x);
                for k in 2..=n {
                    let k = k as f64;
                    (p0, p1) = (p1, ((2.0 * k - 1.0) * x * p1 - (k - 1.0) * p0) / k);
                }
                slope = n as f64 * (x * p1 - p0) / (x * x - 1.0);
                let step = p1 / slope;
                x -= step;
                if step.abs() < 1e-15 {
                    break;
                }
            }
            (x, 2.0 / ((1.0 - x * x) * slope * slope))
        })
        .collect()
}

/// `n` unit vectors in equal areas of the sphere along a golden-angle spiral: each stands for `4 pi / n`.
pub fn fibonacci_sphere(n: usize) -> Vec<[f64; 3]> {
    let golden_angle = PI * (3.0 - 5f64.sqrt());
    (0..n)
        .map(|i| {
            let z = 1.0 - (2 * i + 1) as f64 / n as f64;
            let r = (1.0 - z * z).sqrt();
            let (sin, cos) = (golden_angle * i as f64).sin_cos();
            [r * cos, r * sin, z]
        })
        .collect()
}

/// [`fibonacci_sphere`] in f32.
pub fn lattice(n: usize) -> Vec<Vec3> {
    fibonacci_sphere(n)
        .into_iter()
        .map(|d| DVec3::from_array(d).as_vec3())
        .collect()
}

/// An order of the lattice's directions in which every beginning of it covers the sphere: indices by their reversed binary digits.
pub fn refining_order(directions: usize) -> Vec<usize> {
    let bits = directions.next_power_of_two().trailing_zeros();
    (0..1usize << bits)
        .map(|i| {
            i.reverse_bits()
                .checked_shr(usize::BITS - bits)
                .unwrap_or(0)
        })
        .filter(|i| *i < directions)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monomials_are_integrated_exactly() {
        for degree in 0..=24 {
            let q = sphere_quadrature(degree);
            let sum: f64 = q.iter().map(|(_, w)| w).sum();
            assert!((sum - 4.0 * PI).abs() < 1e-12);
            // The integral of z^k is 4 pi / (k + 1) for even k, that of x^k the same by symmetry.
            let even = degree - degree % 2;
            let exact = 4.0 * PI / (even + 1) as f64;
            for axis in 0..3 {
                let got: f64 = q.iter().map(|(d, w)| w * d[axis].powi(even as i32)).sum();
                assert!(
                    (got - exact).abs() < 1e-12,
                    "degree {degree} axis {axis}: {got} for {exact}"
                );
            }
        }
    }

    #[test]
    fn lattice_is_balanced() {
        let n = 256;
        let mut mean = [0f64; 3];
        for d in fibonacci_sphere(n) {
            assert!((d.iter().map(|v| v * v).sum::<f64>() - 1.0).abs() < 1e-14);
            for (m, v) in mean.iter_mut().zip(d) {
                *m += v / n as f64;
            }
        }
        assert!(mean.iter().all(|m| m.abs() < 2e-3), "{mean:?}");
    }
}
