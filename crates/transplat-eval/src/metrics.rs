//! Image metrics: PSNR, SSIM, perceptual difference.

use anyhow::{Result, bail};
use fast_ssim2::{PixelDescriptor, PixelSlice, compute_ssimulacra2};
use transplat_core::color::srgb_encode;
use transplat_core::rasterize::Raster;

/// A picture as a display shows it on black: display-encoded, 0 to 1.
#[derive(Clone, Debug)]
pub struct ComparedImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `[height][width]`
    pub pixels: Vec<[f32; 3]>,
}

/// Both error and noise below this are the same picture.
const LEAST_ERROR: f64 = 1e-10;

/// Standard deviation of the window that SSIM looks through, in pixels, and its half width (Wang et al. 2004).
const WINDOW: f64 = 1.5;
const WINDOW_RADIUS: usize = 5;

impl ComparedImage {
    /// Display values of surfels that were blended in display-encoded colour.
    pub fn of_display(raster: &Raster) -> Self {
        Self::map(raster, |[r, g, b, _]| [r, g, b])
    }

    /// Display values of a linear, premultiplied image: its colour is clipped, encoded, and laid on black by its alpha.
    pub fn of_linear(raster: &Raster) -> Self {
        Self::map(raster, |[r, g, b, a]| {
            let a = a.clamp(0.0, 1.0);
            [r, g, b].map(|v| a * srgb_encode((v / a.max(1e-6)).clamp(0.0, 1.0)))
        })
    }

    fn map(raster: &Raster, f: impl Fn([f32; 4]) -> [f32; 3]) -> Self {
        Self {
            width: raster.width,
            height: raster.height,
            pixels: raster
                .pixels
                .iter()
                .map(|p| f(*p).map(|v| v.clamp(0.0, 1.0)))
                .collect(),
        }
    }

    fn check(&self, other: &Self) -> Result<()> {
        if (self.width, self.height) != (other.width, other.height) {
            bail!(
                "an image of {} x {} pixels cannot be compared with one of {} x {}",
                self.width,
                self.height,
                other.width,
                other.height
            );
        }
        Ok(())
    }

    /// Peak signal to noise ratio in dB over the pixels of a mask (`[height][width]`), or all.
    ///
    /// # Errors
    /// The pictures differ in size, the mask is empty, or a value is no number.
    pub fn psnr(&self, other: &Self, mask: Option<&[bool]>) -> Result<f64> {
        self.check(other)?;
        let (mut sum, mut count) = (0f64, 0usize);
        for (i, (a, b)) in self.pixels.iter().zip(&other.pixels).enumerate() {
            if mask.is_none_or(|m| m[i]) {
                let error: f64 = (0..3).map(|c| f64::from(a[c] - b[c]).powi(2)).sum();
                sum += error / 3.0;
                count += 1;
            }
        }
        if count == 0 || !sum.is_finite() {
            bail!("nothing to be compared, or no numbers");
        }
        Ok(-10.0 * (sum / count as f64).max(LEAST_ERROR).log10())
    }

    /// Structural similarity (Wang et al. 2004), the mean of the channels; 1 is the same picture.
    ///
    /// # Errors
    /// The pictures differ in size.
    pub fn ssim(&self, other: &Self) -> Result<f64> {
        self.check(other)?;
        let mut sum = 0f64;
        for c in 0..3 {
            let plane = |p: &Self| -> Vec<f64> { p.pixels.iter().map(|v| v[c].into()).collect() };
            let (a, b) = (plane(self), plane(other));
            let product = |x: &[f64], y: &[f64]| -> Vec<f64> {
                let products: Vec<f64> = x.iter().zip(y).map(|(x, y)| x * y).collect();
                self.blurred(&products)
            };
            let (aa, bb, ab) = (product(&a, &a), product(&b, &b), product(&a, &b));
            let (a, b) = (self.blurred(&a), self.blurred(&b));
            for i in 0..a.len() {
                let (va, vb) = (aa[i] - a[i] * a[i], bb[i] - b[i] * b[i]);
                let covariance = ab[i] - a[i] * b[i];
                sum += (2.0 * a[i] * b[i] + 1e-4) * (2.0 * covariance + 9e-4)
                    / ((a[i] * a[i] + b[i] * b[i] + 1e-4) * (va + vb + 9e-4));
            }
        }
        Ok(sum / (3 * self.pixels.len()).max(1) as f64)
    }

    /// A plane seen through the window, mirrored at the edges.
    fn blurred(&self, plane: &[f64]) -> Vec<f64> {
        let radius = WINDOW_RADIUS as isize;
        let weights: Vec<f64> = (-radius..=radius)
            .map(|i| (-0.5 * (i as f64 / WINDOW).powi(2)).exp())
            .collect();
        let total: f64 = weights.iter().sum();
        let mirrored = |i: isize, n: usize| -> usize {
            let n = n as isize;
            let i = i.rem_euclid(2 * n);
            (if i < n { i } else { 2 * n - 1 - i }) as usize
        };
        let (w, h) = (self.width, self.height);
        let along = |from: &[f64], at: &dyn Fn(usize, usize, isize) -> usize| -> Vec<f64> {
            (0..w * h)
                .map(|i| {
                    let taps = weights.iter().zip(-radius..=radius);
                    taps.map(|(k, d)| k * from[at(i % w, i / w, d)])
                        .sum::<f64>()
                        / total
                })
                .collect()
        };
        let rows = along(plane, &|x, y, d| y * w + mirrored(x as isize + d, w));
        along(&rows, &|x, y, d| mirrored(y as isize + d, h) * w + x)
    }

    /// SSIMULACRA2 (Sneyers 2023): 100 is the same picture, 90 cannot be told apart side by side, 50 is a visible difference; it may be
    /// negative.
    ///
    /// # Errors
    /// The pictures differ in size or are smaller than 8 x 8.
    pub fn perceptual(&self, other: &Self) -> Result<f64> {
        self.check(other)?;
        let bytes = |p: &Self| -> Vec<u8> {
            let values = p.pixels.iter().flatten();
            values.map(|v| (255.0 * v + 0.5) as u8).collect()
        };
        let (a, b) = (bytes(self), bytes(other));
        let (width, height) = (self.width as u32, self.height as u32);
        let (stride, kind) = (3 * self.width, PixelDescriptor::RGB8_SRGB);
        let slice = |bytes| PixelSlice::new(bytes, width, height, stride, kind);
        let explained = |e: &dyn std::fmt::Display| anyhow::anyhow!("SSIMULACRA2: {e}");
        let (a, b) = (slice(&a), slice(&b));
        let (a, b) = (a.map_err(|e| explained(&e))?, b.map_err(|e| explained(&e))?);
        compute_ssimulacra2(&a, &b).map_err(|e| explained(&e))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(f: impl Fn(usize, usize) -> f32) -> ComparedImage {
        let (width, height) = (32, 24);
        ComparedImage {
            width,
            height,
            pixels: (0..width * height)
                .map(|i| [f(i % width, i / width); 3])
                .collect(),
        }
    }

    #[test]
    fn a_picture_is_most_like_itself() {
        let a = picture(|x, y| 0.5 + 0.4 * ((x * y) as f32 * 0.1).sin());
        assert_eq!(a.psnr(&a, None).expect("one size"), 100.0);
        assert!((a.ssim(&a).expect("one size") - 1.0).abs() < 1e-12);
        assert!(a.perceptual(&a).expect("one size") > 99.9);
        let noisy = picture(|x, y| {
            0.5 + 0.4 * ((x * y) as f32 * 0.1).sin() + 0.05 * ((x * 7 + y * 13) as f32).sin()
        });
        let worse = picture(|x, y| 0.5 + 0.4 * ((x + y) as f32 * 0.1).cos());
        let scores = |p: &ComparedImage| {
            [
                p.psnr(&a, None).expect("one size"),
                p.ssim(&a).expect("one size"),
                p.perceptual(&a).expect("one size"),
            ]
        };
        for (near, far) in scores(&noisy).into_iter().zip(scores(&worse)) {
            assert!(near > far, "{near} {far}");
        }
    }

    #[test]
    fn psnr_is_its_formula_and_minds_the_mask() {
        let (a, b) = (
            picture(|_, _| 0.5),
            picture(|x, _| if x < 16 { 0.6 } else { 0.5 }),
        );
        assert!((a.psnr(&b, None).expect("one size") - 10.0 * 200f64.log10()).abs() < 1e-3);
        let left: Vec<bool> = (0..32 * 24).map(|i| i % 32 < 16).collect();
        assert!((a.psnr(&b, Some(&left)).expect("one size") - 20.0).abs() < 1e-3);
        let other = ComparedImage {
            width: 24,
            height: 32,
            ..a.clone()
        };
        assert!(a.psnr(&other, None).is_err() && a.ssim(&other).is_err());
    }

    #[test]
    fn what_is_transparent_is_black_and_colour_is_encoded_before_it_is_laid_on() {
        let raster = Raster {
            width: 2,
            height: 1,
            pixels: vec![[0.1, 0.2, 0.4, 0.5], [0.0; 4]],
            depth: Vec::new(),
        };
        let picture = ComparedImage::of_linear(&raster);
        assert!((picture.pixels[0][1] - 0.5 * srgb_encode(0.4)).abs() < 1e-6);
        assert_eq!(picture.pixels[1], [0.0; 3]);
    }
}
