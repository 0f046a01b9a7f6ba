//! Stage *project environment*: a light as an equirectangular map, and as SH coefficients of its incident radiance.

mod beams;
mod illumination;

use std::f64::consts::PI;

use glam::{DMat3, Vec3};
use rayon::prelude::*;

use crate::color::luminance;
use crate::sh::{
    MAX_DEGREE, SQRT_4PI, band_of, basis_constants, coefficient_count, rotate_coefficients,
};

pub use beams::{Beam, Beams, MAX_SUNS, Mosaic, SUN_RADIUS, SUN_SHARE};
pub use illumination::Illumination;

/// No light is brighter; sums of pixels stay finite.
const MAX_RADIANCE: f32 = 1e15;

/// An equirectangular map of linear RGB radiance, Z up; row 0 is the zenith, the image centre looks at +X, +Y is a quarter from the left.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    width: usize,
    height: usize,
    pixels: Vec<[f32; 3]>,
    repaired: usize,
    clipped: bool,
}

impl EnvironmentMap {
    /// A map from its pixels, row by row. Values that are no numbers, negative or beyond any light are replaced by the nearest possible and counted.
    ///
    /// # Panics
    /// If the number of pixels is not `width * height`, or is zero.
    pub fn new(width: usize, height: usize, mut pixels: Vec<[f32; 3]>) -> Self {
        assert!(width * height == pixels.len() && !pixels.is_empty());
        let repaired = pixels
            .par_iter_mut()
            .filter_map(|pixel| {
                let bad = pixel.iter().any(|v| !(0.0..=MAX_RADIANCE).contains(v));
                if bad {
                    *pixel = pixel.map(|v| {
                        if v.is_finite() {
                            v.clamp(0.0, MAX_RADIANCE)
                        } else {
                            0.0
                        }
                    });
                }
                bad.then_some(())
            })
            .count();
        Self {
            width,
            height,
            pixels,
            repaired,
            clipped: false,
        }
    }

    /// Marks a map that came from a low-dynamic-range picture, whose highlights are clipped.
    pub(crate) fn with_clipped_highlights(mut self) -> Self {
        self.clipped = true;
        self
    }

    /// Uniform white light, for an asset whose light nobody knows.
    pub fn even() -> Self {
        Self::new(2, 1, vec![[1.0; 3]; 2])
    }

    /// What is shown behind the object where the light is even: middle grey. White would blind, and nobody knows what was there.
    pub fn even_backdrop() -> Self {
        Self::new(2, 1, vec![[0.18; 3]; 2])
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Radiance `[height][width]`, row by row from the zenith.
    pub fn pixels(&self) -> &[[f32; 3]] {
        &self.pixels
    }

    /// How many pixels were no numbers, negative or beyond any light, and were replaced.
    pub fn repaired(&self) -> usize {
        self.repaired
    }

    /// Whether the highlights are clipped because the file was a low-dynamic-range picture.
    pub fn has_clipped_highlights(&self) -> bool {
        self.clipped
    }

    /// Exact solid angle of one pixel of a row, in steradians.
    pub fn pixel_solid_angle(&self, row: usize) -> f64 {
        let edge = |row: usize| (PI * row as f64 / self.height as f64).cos();
        2.0 * PI / self.width as f64 * (edge(row) - edge(row + 1))
    }

    /// Share of all light (by luminance, 0 to 1) that comes from the brightest part of the sphere of that relative size.
    pub fn brightest_share(&self, sphere_share: f64) -> f64 {
        let mut pixels: Vec<(f32, f64)> = Vec::with_capacity(self.pixels.len());
        for (row, colors) in self.pixels.chunks_exact(self.width).enumerate() {
            let omega = self.pixel_solid_angle(row);
            pixels.extend(colors.iter().map(|c| (luminance(*c), omega)));
        }
        pixels.par_sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        let (mut total, mut brightest, mut angle) = (0.0, 0.0, 0.0);
        for (luminance, omega) in pixels {
            total += f64::from(luminance) * omega;
            if angle < sphere_share * 4.0 * PI {
                brightest = total;
                angle += omega;
            }
        }
        if total > 0.0 { brightest / total } else { 0.0 }
    }

    /// Direction of a pixel's centre.
    pub fn direction(&self, column: usize, row: usize) -> [f64; 3] {
        let (sin_t, cos_t) = (PI * (row as f64 + 0.5) / self.height as f64).sin_cos();
        let (sin_p, cos_p) = azimuth(column, self.width).sin_cos();
        [sin_t * cos_p, sin_t * sin_p, cos_t]
    }

    /// The map with at most `width` columns, twice as wide as high, each pixel the mean over its solid angle: for thumbnails and backgrounds.
    pub fn reduced(&self, width: usize) -> Self {
        if width >= self.width {
            return self.clone();
        }
        let height = (width / 2).clamp(1, self.height);
        let rows: Vec<f32> = (0..self.height)
            .map(|row| self.pixel_solid_angle(row) as f32)
            .collect();
        let span = |i: usize, of: usize, to: usize| (i * of / to, ((i + 1) * of).div_ceil(to));
        let pixels = (0..height)
            .into_par_iter()
            .flat_map_iter(|y| {
                let (top, bottom) = span(y, self.height, height);
                let rows = &rows;
                (0..width).map(move |x| {
                    let (left, right) = span(x, self.width, width);
                    let (mut sum, mut total) = ([0f32; 3], 0f32);
                    for row in top..bottom {
                        for p in &self.pixels[row * self.width..][left..right] {
                            for (s, v) in sum.iter_mut().zip(p) {
                                *s += rows[row] * v;
                            }
                        }
                        total += rows[row] * (right - left) as f32;
                    }
                    sum.map(|s| s / total)
                })
            })
            .collect();
        Self {
            clipped: self.clipped,
            ..Self::new(width, height, pixels)
        }
    }

    /// The map blurred by a Gaussian on the sphere, `sigma` in degrees: at a resolution at which that is a few pixels, along the parallels
    /// and then along the meridians. Round within a sixth of its width, near the poles too.
    pub fn blurred(&self, sigma: f32) -> Self {
        if sigma <= 0.0 {
            return self.clone();
        }
        // A standard deviation is three pixels.
        let small = self.reduced(((1080.0 / sigma) as usize).clamp(48, 2048));
        let (w, h) = (small.width, small.height);
        let sigma_rows = sigma / 180.0 * h as f32;
        let kernel = |sigma: f32, most: usize| -> Vec<f32> {
            let reach = ((3.0 * sigma).ceil() as usize).min(most);
            let raw: Vec<f32> = (0..=reach)
                .map(|i| (-0.5 * (i as f32 / sigma).powi(2)).exp())
                .collect();
            let total = 2.0 * raw.iter().sum::<f32>() - raw[0];
            raw.iter().map(|v| v / total).collect()
        };
        // Along the parallels first: near a pole that is a whole ring.
        let rings: Vec<[f32; 3]> = (0..h)
            .into_par_iter()
            .flat_map_iter(|y| {
                let sine = (PI * (y as f64 + 0.5) / h as f64).sin() as f32;
                let across = kernel(sigma / 360.0 * w as f32 / sine, w / 2);
                let small = &small;
                (0..w).map(move |x| {
                    let at = |offset: isize| {
                        small.pixels[y * w + (x as isize + offset).rem_euclid(w as isize) as usize]
                    };
                    let mut sum = at(0).map(|v| v * across[0]);
                    for (i, k) in across.iter().enumerate().skip(1) {
                        let (a, b) = (at(i as isize), at(-(i as isize)));
                        sum = std::array::from_fn(|c| sum[c] + k * (a[c] + b[c]));
                    }
                    sum
                })
            })
            .collect();
        // Then along the meridians, each ring weighed by its size; over a pole one comes down on the other side.
        let down = kernel(sigma_rows, h);
        let pixels = (0..w * h)
            .into_par_iter()
            .map(|i| {
                let (mut sum, mut total) = ([0f32; 3], 0f32);
                let reach = down.len() as isize - 1;
                for offset in -reach..=reach {
                    let (mut x, mut y) = (i % w, (i / w) as isize + offset);
                    if y < 0 {
                        (x, y) = ((x + w / 2) % w, -1 - y);
                    } else if y >= h as isize {
                        (x, y) = ((x + w / 2) % w, 2 * h as isize - 1 - y);
                    }
                    let y = y.clamp(0, h as isize - 1) as usize;
                    let weight = down[offset.unsigned_abs()] * small.pixel_solid_angle(y) as f32;
                    total += weight;
                    for (s, v) in sum.iter_mut().zip(rings[y * w + x]) {
                        *s += weight * v;
                    }
                }
                sum.map(|s| s / total)
            })
            .collect();
        Self {
            clipped: self.clipped,
            ..Self::new(w, h, pixels)
        }
    }

    /// Radiance from direction `d` (unit), interpolated between pixels; for backgrounds, not for integrals.
    pub fn sample(&self, d: Vec3) -> [f32; 3] {
        let (w, h) = (self.width as f32, self.height as f32);
        let u = (0.5 - d.y.atan2(d.x) / std::f32::consts::TAU).rem_euclid(1.0) * w - 0.5;
        let v = d.z.clamp(-1.0, 1.0).acos() / std::f32::consts::PI * h - 0.5;
        let (column, row) = (u.floor(), v.floor());
        let (fu, fv) = (u - column, v - row);
        let texel = |dx: f32, dy: f32| {
            let x = (column + dx).rem_euclid(w) as usize % self.width;
            let y = (row + dy).clamp(0.0, h - 1.0) as usize;
            self.pixels[y * self.width + x]
        };
        let (a, b, c, d) = (
            texel(0.0, 0.0),
            texel(1.0, 0.0),
            texel(0.0, 1.0),
            texel(1.0, 1.0),
        );
        std::array::from_fn(|i| {
            let top = a[i] + (b[i] - a[i]) * fu;
            let bottom = c[i] + (d[i] - c[i]) * fu;
            top + (bottom - top) * fv
        })
    }
}

/// Azimuth `atan2(y, x)` of a column's centre: u = 1/2 - azimuth / 2 pi.
pub fn azimuth(column: usize, width: usize) -> f64 {
    PI * (1.0 - (2 * column + 1) as f64 / width as f64)
}

/// A light as the transfer sees it: SH coefficients of incident radiance `L` to a degree.
#[derive(Clone, Debug, PartialEq)]
pub struct IncidentRadiance {
    /// Degree of the expansion.
    pub degree: usize,
    /// `[K][3]`, linear RGB.
    pub coefficients: Vec<[f32; 3]>,
}

impl IncidentRadiance {
    /// Radiance 1 from everywhere.
    pub fn even(degree: usize) -> Self {
        let mut coefficients = vec![[0f32; 3]; coefficient_count(degree)];
        coefficients[0] = [SQRT_4PI as f32; 3];
        Self {
            degree,
            coefficients,
        }
    }

    /// The light turned by `rotation` (world to world).
    pub fn rotated(&self, rotation: DMat3) -> Self {
        Self {
            degree: self.degree,
            coefficients: rotate_coefficients(rotation, self.degree, &self.coefficients),
        }
    }

    /// The light mirrored left to right in its own map: `f(x, -y, z)`, which turns the sign of all coefficients with m < 0.
    pub fn mirrored(&self) -> Self {
        let mut out = self.clone();
        for (i, c) in out.coefficients.iter_mut().enumerate() {
            let l = band_of(i);
            if i < l * l + l {
                *c = c.map(|v| -v);
            }
        }
        out
    }

    /// The light's bands up to `degree`; missing ones are dark.
    pub fn truncated(&self, degree: usize) -> Self {
        let mut coefficients = self.coefficients.clone();
        coefficients.resize(coefficient_count(degree), [0.0; 3]);
        Self {
            degree,
            coefficients,
        }
    }

    /// The light with each channel multiplied.
    pub fn tinted(&self, gain: [f32; 3]) -> Self {
        Self {
            degree: self.degree,
            coefficients: self
                .coefficients
                .iter()
                .map(|c| std::array::from_fn(|i| c[i] * gain[i]))
                .collect(),
        }
    }

    /// The light with its strength multiplied.
    pub fn scaled(&self, gain: f32) -> Self {
        self.tinted([gain; 3])
    }

    /// Irradiance on a surface that sees everything, averaged over all normals and the three channels: `pi` times the mean radiance.
    pub fn mean_irradiance(&self) -> f32 {
        let dc = self.coefficients[0].iter().sum::<f32>() / 3.0;
        (PI / SQRT_4PI) as f32 * dc
    }

    /// Whether the light is black.
    pub fn is_black(&self) -> bool {
        self.coefficients.iter().flatten().all(|v| *v == 0.0)
    }
}

/// Projects a map on the basis: every pixel's centre with its exact solid angle: a sun is a few pixels wide, and point samples miss it.
///
/// A row is first reduced to its Fourier sums over azimuth, of which all its coefficients are made. Sums are kept in f64.
pub fn project_environment(map: &EnvironmentMap, degree: usize) -> IncidentRadiance {
    assert!(degree <= MAX_DEGREE);
    let k = coefficient_count(degree);
    let waves: Vec<[(f32, f32); MAX_DEGREE + 1]> = (0..map.width)
        .map(|column| {
            std::array::from_fn(|m| {
                let (sin, cos) = (m as f64 * azimuth(column, map.width)).sin_cos();
                (cos as f32, sin as f32)
            })
        })
        .collect();
    let sums = map
        .pixels
        .par_chunks_exact(map.width)
        .enumerate()
        .fold(
            || vec![[0f64; 3]; k],
            |mut sums, (row, pixels)| {
                let fourier = fourier_sums(pixels, &waves, degree);
                for (i, weight) in row_weights(map, row, degree).into_iter().enumerate() {
                    let center = band_of(i) * (band_of(i) + 1);
                    let wave = &fourier[i.abs_diff(center)];
                    for (sum, (cos, sin)) in sums[i].iter_mut().zip(wave) {
                        *sum += weight * if i >= center { cos } else { sin };
                    }
                }
                sums
            },
        )
        .reduce(
            || vec![[0f64; 3]; k],
            |mut a, b| {
                for (a, b) in a.iter_mut().flatten().zip(b.iter().flatten()) {
                    *a += b;
                }
                a
            },
        );
    IncidentRadiance {
        degree,
        coefficients: sums.iter().map(|c| c.map(|v| v as f32)).collect(),
    }
}

type FourierSums = [[(f64, f64); 3]; MAX_DEGREE + 1];

/// `sum over the row of L cos(m phi), L sin(m phi)`, per channel.
fn fourier_sums(
    pixels: &[[f32; 3]],
    waves: &[[(f32, f32); MAX_DEGREE + 1]],
    degree: usize,
) -> FourierSums {
    let mut total: FourierSums = Default::default();
    // Short f32 sums inside long f64 ones: fast, and no loss that grows with the width.
    for (pixels, waves) in pixels.chunks(32).zip(waves.chunks(32)) {
        let mut part = [[(0f32, 0f32); 3]; MAX_DEGREE + 1];
        for (pixel, wave) in pixels.iter().zip(waves) {
            for m in 0..=degree {
                for c in 0..3 {
                    part[m][c].0 += pixel[c] * wave[m].0;
                    part[m][c].1 += pixel[c] * wave[m].1;
                }
            }
        }
        for m in 0..=degree {
            for c in 0..3 {
                total[m][c].0 += f64::from(part[m][c].0);
                total[m][c].1 += f64::from(part[m][c].1);
            }
        }
    }
    total
}

/// Solid angle times `q(l,|m|) sin^|m|(theta)` of one row, for each coefficient: what its Fourier sums are multiplied by. `[K]`
pub fn row_weights(map: &EnvironmentMap, row: usize, degree: usize) -> Vec<f64> {
    let legendre = legendre_row(map, row, degree);
    let weight = map.pixel_solid_angle(row);
    (0..coefficient_count(degree))
        .map(|i| {
            let l = band_of(i);
            weight * legendre[l][i.abs_diff(l * l + l)]
        })
        .collect()
}

/// `q(l,m) sin^m(theta)` at the height of a row, with the basis's normalisation.
fn legendre_row(
    map: &EnvironmentMap,
    row: usize,
    degree: usize,
) -> [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1] {
    let constants = basis_constants();
    let (sin, z) = (PI * (row as f64 + 0.5) / map.height as f64).sin_cos();
    let mut q = [[0f64; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    for m in 0..=degree {
        q[m][m] = constants.start[m] * sin.powi(m as i32);
        for l in m + 1..=degree {
            let below = if l > m + 1 { q[l - 2][m] } else { 0.0 };
            q[l][m] = constants.a[l][m] * z * q[l - 1][m] - constants.b[l][m] * below;
        }
    }
    q
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle;
    use crate::sh::evaluate_sh;

    fn test_map(width: usize, height: usize) -> EnvironmentMap {
        let pixels = (0..width * height)
            .map(|i| {
                let v = ((i * 7919) % 1013) as f32 / 1013.0;
                [v, v * v, if i % 97 == 0 { 500.0 } else { 0.1 }]
            })
            .collect();
        EnvironmentMap::new(width, height, pixels)
    }

    #[test]
    fn projection_agrees_with_the_oracle() {
        for (w, h) in [(64, 32), (37, 19), (1, 1), (2, 200)] {
            let map = test_map(w, h);
            let exact = oracle::project_environment(&map, MAX_DEGREE);
            let got = project_environment(&map, MAX_DEGREE);
            // Short sums of 32 terms in f32: 32 * 2^-24 of the light's total, times |Y| <= 2.
            let bound = 4e-6 * exact[0].iter().fold(0f64, |a, b| a.max(*b));
            for (e, g) in exact
                .iter()
                .flatten()
                .zip(got.coefficients.iter().flatten())
            {
                assert!((e - f64::from(*g)).abs() <= bound, "{e} {g}");
            }
        }
    }

    #[test]
    fn an_even_map_has_a_dc_and_nothing_else() {
        let map = EnvironmentMap::new(256, 128, vec![[2.0, 1.0, 0.5]; 256 * 128]);
        let light = project_environment(&map, 6);
        assert!((light.coefficients[0][1] - SQRT_4PI as f32).abs() < 1e-5);
        for c in light.coefficients[1..].iter().flatten() {
            // Pixel centres stand for pixels: an error of (pi / 128)^2 / 24 of the light, halved by symmetry.
            assert!(c.abs() < 1e-3, "{c}");
        }
    }

    #[test]
    fn solid_angles_cover_the_sphere() {
        let map = test_map(48, 24);
        let sum: f64 = (0..24).map(|r| map.pixel_solid_angle(r) * 48.0).sum();
        assert!((sum - 4.0 * PI).abs() < 1e-12);
    }

    #[test]
    fn conventions_are_blenders() {
        // One bright pixel; where is it seen, by SH and by look-up?
        let at = |column: usize, row: usize| {
            let mut pixels = vec![[0f32; 3]; 64 * 32];
            pixels[row * 64 + column] = [100.0; 3];
            EnvironmentMap::new(64, 32, pixels)
        };
        for (column, row, d) in [
            (32, 16, Vec3::X),
            (16, 16, Vec3::Y),
            (48, 16, Vec3::NEG_Y),
            (0, 16, Vec3::NEG_X),
            (10, 0, Vec3::Z),
            (10, 31, Vec3::NEG_Z),
        ] {
            let map = at(column, row);
            let light = project_environment(&map, 4);
            let value = |d: Vec3| evaluate_sh(&light.coefficients, 4, d.to_array())[0];
            for other in [
                Vec3::X,
                Vec3::Y,
                Vec3::Z,
                Vec3::NEG_X,
                Vec3::NEG_Y,
                Vec3::NEG_Z,
            ] {
                assert!(other == d || value(other) < value(d) / 2.0);
            }
            let [x, y, z] = map.direction(column, row).map(|v| v as f32);
            assert!(map.sample(Vec3::new(x, y, z))[0] > 99.0);
        }
    }

    #[test]
    fn the_brightest_share_of_an_even_map_is_its_size_and_of_a_lamp_all() {
        let even = EnvironmentMap::new(100, 50, vec![[1.0; 3]; 5000]);
        assert!((even.brightest_share(0.25) - 0.25).abs() < 0.001);
        let mut pixels = vec![[0f32; 3]; 5000];
        pixels[2050] = [1.0; 3];
        let lamp = EnvironmentMap::new(100, 50, pixels);
        assert_eq!(lamp.brightest_share(0.001), 1.0);
    }

    #[test]
    fn bad_pixels_are_counted_and_black() {
        let map = EnvironmentMap::new(
            2,
            2,
            vec![
                [f32::NAN, 1.0, 1.0],
                [-1.0, 2.0, 0.0],
                [f32::INFINITY; 3],
                [1.0; 3],
            ],
        );
        assert_eq!(map.repaired(), 3);
        assert_eq!(map.pixels()[0], [0.0, 1.0, 1.0]);
        assert_eq!(map.pixels()[1], [0.0, 2.0, 0.0]);
        let light = project_environment(&map, 8);
        assert!(light.coefficients.iter().flatten().all(|v| v.is_finite()));
        let huge = EnvironmentMap::new(64, 32, vec![[f32::MAX; 3]; 64 * 32]);
        assert_eq!(huge.repaired(), 64 * 32);
        let light = project_environment(&huge, 8);
        assert!(light.coefficients.iter().flatten().all(|v| v.is_finite()));
    }

    #[test]
    fn reducing_and_blurring_keep_the_light() {
        let map = test_map(200, 100);
        let light = project_environment(&map, 2);
        for (changed, tolerance) in [
            (map.reduced(64), 0.02),
            (map.blurred(6.0), 0.02),
            // A wide blur takes from the higher bands what it should: exp(-l(l+1) sigma^2 / 2); band 0 stays.
            (map.blurred(40.0), 0.05),
        ] {
            assert_eq!(changed.width(), 2 * changed.height());
            let found = project_environment(&changed, 2);
            for c in 0..3 {
                let (a, b) = (light.coefficients[0][c], found.coefficients[0][c]);
                assert!((a - b).abs() < tolerance * a, "{a} {b}");
            }
        }
        assert_eq!(map.blurred(0.0).pixels(), map.pixels());
    }

    #[test]
    fn a_blurred_point_is_round_at_every_latitude() {
        for row in [2, 30, 64] {
            let mut pixels = vec![[0f32; 3]; 256 * 128];
            pixels[row * 256 + 40] = [1e3; 3];
            let map = EnvironmentMap::new(256, 128, pixels);
            let point = Vec3::from_array(map.direction(40, row).map(|v| v as f32));
            let blurred = map.blurred(8.0);
            let (a, b) = point.any_orthonormal_pair();
            let at = |axis: Vec3, degrees: f32| {
                let (sin, cos) = degrees.to_radians().sin_cos();
                blurred.sample(point * cos + axis * sin)[0]
            };
            let around = [a, b, -a, -b].map(|axis| at(axis, 8.0));
            // exp(-1/2) of the peak; at the pole a spot is drawn towards it.
            let shares = around.map(|value| value / at(a, 0.0));
            let mean = shares.iter().sum::<f32>() / 4.0;
            assert!((mean - 0.607).abs() < 0.1, "row {row}: {shares:?}");
            assert!(
                shares.iter().all(|s| (s - 0.607).abs() < 0.3),
                "row {row}: {shares:?}"
            );
        }
    }

    #[test]
    fn mirroring_mirrors() {
        let light = project_environment(&test_map(64, 32), 4);
        let mirrored = light.mirrored();
        for d in crate::sh::fibonacci_sphere(20) {
            let d = d.map(|v| v as f32);
            let a = evaluate_sh(&light.coefficients, 4, [d[0], -d[1], d[2]]);
            let b = evaluate_sh(&mirrored.coefficients, 4, d);
            assert!((a[0] - b[0]).abs() < 1e-4 * (1.0 + a[0].abs()));
        }
    }
}
