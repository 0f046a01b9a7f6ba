//! Environment map in equirectangular layout.

use std::f64::consts::PI;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::color::luminance;
use crate::images::{Image, Layout, Provenance};

/// An equirectangular map of linear RGB radiance, Z up; row 0 is the zenith, the image centre looks at +X, +Y is a quarter from the left.
#[derive(Clone, Debug)]
pub struct EnvironmentMap {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<[f32; 3]>,
    repaired: usize,
    infinite: usize,
    clipped: bool,
    layout: Layout,
    picture_size: [usize; 2],
    provenance: Provenance,
}

/// Radiance of an infinitely bright pixel: the largest number of 16 bits, since suns are written by overflowing those.
pub const INFINITE_RADIANCE: f32 = 65504.0;

impl EnvironmentMap {
    /// No light is brighter; sums of pixels stay finite.
    pub(super) const BRIGHTEST: f32 = 1e15;

    /// A map from its pixels, row by row. Values that are no numbers, negative or beyond any light are replaced by the nearest possible and
    /// counted; infinite ones by [`INFINITE_RADIANCE`].
    ///
    /// # Panics
    /// If the number of pixels is not `width * height`, or is zero.
    pub fn new(width: usize, height: usize, mut pixels: Vec<[f32; 3]>) -> Self {
        assert!(width * height == pixels.len() && !pixels.is_empty());
        // Pixels that were replaced, and those of them that were infinite alone.
        let count = |pixel: &mut [f32; 3]| {
            if pixel.iter().all(|v| (0.0..=Self::BRIGHTEST).contains(v)) {
                return [0, 0];
            }
            let is_infinite = pixel.iter().all(|v| *v >= 0.0) && pixel.contains(&f32::INFINITY);
            *pixel = pixel.map(|v| match v {
                f32::INFINITY => INFINITE_RADIANCE,
                _ if v.is_finite() => v.clamp(0.0, Self::BRIGHTEST),
                _ => 0.0,
            });
            [usize::from(!is_infinite), usize::from(is_infinite)]
        };
        let sum = |a: [usize; 2], b: [usize; 2]| [a[0] + b[0], a[1] + b[1]];
        let [repaired, infinite] = pixels.par_iter_mut().map(count).reduce(|| [0; 2], sum);
        Self {
            width,
            height,
            pixels,
            repaired,
            infinite,
            clipped: false,
            layout: Layout::default(),
            picture_size: [width, height],
            provenance: Provenance::default(),
        }
    }

    /// A map of an image, whatever its layout is.
    ///
    /// # Panics
    /// As [`EnvironmentMap::new`].
    pub fn of_image(image: Image) -> Self {
        Self {
            clipped: image.is_clipped,
            provenance: image.provenance,
            ..Self::new(image.width, image.height, image.pixels)
        }
    }

    /// A map, given its pixels by column and row, that this one is a picture of in another layout.
    pub(super) fn read_as(
        &self,
        layout: Layout,
        [width, height]: [usize; 2],
        pixel: impl Fn(usize, usize) -> [f32; 3] + Sync,
    ) -> Self {
        let pixels = (0..width * height).into_par_iter();
        let pixels = pixels.map(|i| pixel(i % width, i / width)).collect();
        Self {
            repaired: self.repaired,
            infinite: self.infinite,
            clipped: self.clipped,
            layout,
            picture_size: [self.width, self.height],
            provenance: self.provenance.clone(),
            ..Self::new(width, height, pixels)
        }
    }

    /// The map with other pixels, which are not clipped.
    ///
    /// # Panics
    /// As [`EnvironmentMap::new`].
    pub fn with_pixels(&self, pixels: Vec<[f32; 3]>) -> Self {
        Self {
            repaired: self.repaired,
            infinite: self.infinite,
            layout: self.layout,
            picture_size: self.picture_size,
            provenance: self.provenance.clone(),
            ..Self::new(self.width, self.height, pixels)
        }
    }

    /// Layout of the image that it was made from.
    pub fn layout(&self) -> Layout {
        self.layout
    }

    /// Width and height of that picture in pixels.
    pub fn picture_size(&self) -> [usize; 2] {
        self.picture_size
    }

    /// The part of its file that was read, and what reading it assumed.
    pub fn provenance(&self) -> &Provenance {
        &self.provenance
    }

    /// A map of what comes from each pixel's direction.
    ///
    /// # Panics
    /// If it has no pixel.
    pub fn of_directions(
        width: usize,
        height: usize,
        radiance: impl Fn(DVec3) -> [f32; 3] + Sync,
    ) -> Self {
        let blank = Self::new(width, height, vec![[0.0; 3]; width * height]);
        let direction = |i| DVec3::from_array(blank.direction(i % width, i / width));
        let pixels = (0..width * height).into_par_iter();
        let pixels = pixels.map(|i| radiance(direction(i)));
        Self::new(width, height, pixels.collect())
    }

    /// Uniform white light, for an asset whose light nobody knows.
    pub fn even() -> Self {
        Self::new(2, 1, vec![[1.0; 3]; 2])
    }

    /// Backdrop of even light: middle grey. White would blind, and nobody knows what was there.
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

    /// Number of pixels that were NaN, negative or beyond any light, and were replaced.
    pub fn repaired(&self) -> usize {
        self.repaired
    }

    /// Number of pixels that were infinitely bright, and are read as [`INFINITE_RADIANCE`].
    pub fn infinite(&self) -> usize {
        self.infinite
    }

    /// True where the highlights are clipped because the file was a low-dynamic-range image.
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
        direction(column, row, [self.width, self.height])
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
        bilinear(texel, [fu, fv])
    }
}

/// Interpolates between four texels, given by offsets of column and row, at a place between them.
pub(super) fn bilinear(texel: impl Fn(f32, f32) -> [f32; 3], [fu, fv]: [f32; 2]) -> [f32; 3] {
    let [[a, b], [c, d]] = [0.0, 1.0].map(|dy| [0.0, 1.0].map(|dx| texel(dx, dy)));
    std::array::from_fn(|i| {
        let top = a[i] + (b[i] - a[i]) * fu;
        let bottom = c[i] + (d[i] - c[i]) * fu;
        top + (bottom - top) * fv
    })
}

/// Direction of a pixel's centre in a panorama of that width and height.
pub(super) fn direction(column: usize, row: usize, [width, height]: [usize; 2]) -> [f64; 3] {
    direction_at([column as f64 + 0.5, row as f64 + 0.5], [width, height]).to_array()
}

/// Direction of a point of a map, in pixels from its upper left corner.
pub(super) fn direction_at([x, y]: [f64; 2], [width, height]: [usize; 2]) -> DVec3 {
    let (sin_t, cos_t) = (PI * y / height as f64).sin_cos();
    let (sin_p, cos_p) = (PI * (1.0 - 2.0 * x / width as f64)).sin_cos();
    DVec3::new(sin_t * cos_p, sin_t * sin_p, cos_t)
}

/// Azimuth `atan2(y, x)` of a column's centre: u = 1/2 - azimuth / 2 pi.
pub fn azimuth(column: usize, width: usize) -> f64 {
    PI * (1.0 - (2 * column + 1) as f64 / width as f64)
}
