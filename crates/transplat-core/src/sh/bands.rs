//! SH degrees, bands and coefficient counts.

/// The highest degree that any part of the program handles.
pub const MAX_DEGREE: usize = 8;

/// Coefficients of all bands up to [`MAX_DEGREE`].
pub const MAX_COEFFICIENTS: usize = coefficient_count(MAX_DEGREE);

/// `sqrt(4 pi)`: the DC coefficient of the constant function 1.
pub const SQRT_4PI: f64 = 3.544_907_701_811_032;

/// Number of coefficients of all bands up to `degree`: `(degree + 1)^2`.
pub const fn coefficient_count(degree: usize) -> usize {
    (degree + 1) * (degree + 1)
}

/// The coefficients of band `l`, as a range of indices.
pub const fn band(l: usize) -> std::ops::Range<usize> {
    l * l..(l + 1) * (l + 1)
}

/// The band that coefficient `i` belongs to.
pub const fn band_of(i: usize) -> usize {
    i.isqrt()
}

/// Functions of one degree, `[n][K][3]`, as those of another: bands that they lack are empty, and those beyond are cut off.
pub fn with_degree<T>(functions: T, degree: usize, wanted: usize) -> T
where
    T: AsRef<[[f32; 3]]> + From<Vec<[f32; 3]>>,
{
    if degree == wanted {
        return functions;
    }
    let (k, wanted) = (coefficient_count(degree), coefficient_count(wanted));
    let each = functions.as_ref().chunks_exact(k);
    let kept = each.flat_map(|f| (0..wanted).map(|i| f.get(i).copied().unwrap_or_default()));
    Vec::from_iter(kept).into()
}

/// Factors `A_l` by which the clamped cosine filters band `l` (paper eq. 3; Ramamoorthi and Hanrahan 2001).
pub fn cosine_kernel(l: usize) -> f64 {
    use std::f64::consts::PI;
    match l {
        0 => PI,
        1 => 2.0 * PI / 3.0,
        _ if l % 2 == 1 => 0.0,
        _ => {
            // A_l = 2 pi (-1)^(l/2 - 1) / ((l + 2)(l - 1)) * l! / (2^l (l/2)!^2)
            let binomial: f64 = (1..=l / 2)
                .map(|k| (l / 2 + k) as f64 / (4 * k) as f64)
                .product();
            let sign = if (l / 2) % 2 == 1 { 1.0 } else { -1.0 };
            2.0 * PI * sign / ((l + 2) as f64 * (l - 1) as f64) * binomial
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    #[test]
    fn cosine_kernel_has_the_published_values() {
        let published = [
            PI,
            2.0 * PI / 3.0,
            PI / 4.0,
            0.0,
            -PI / 24.0,
            0.0,
            PI / 64.0,
            0.0,
            -PI / 128.0,
        ];
        for (l, expected) in published.into_iter().enumerate() {
            let got = cosine_kernel(l);
            assert!(
                (got - expected).abs() < 1e-14,
                "band {l}: {got} for {expected}"
            );
        }
    }

    #[test]
    fn bands_partition_the_indices() {
        for i in 0..MAX_COEFFICIENTS {
            assert!(band(band_of(i)).contains(&i));
        }
    }
}
