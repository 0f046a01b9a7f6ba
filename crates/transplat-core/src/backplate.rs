//! Backplate: a photograph behind the objects, by the camera that they are seen by. It is framed by its shorter edge, as the camera's field of view
//! is.

use rayon::prelude::*;

use crate::camera::Camera;
use crate::color::srgb_encode;
use crate::environment::INFINITE_RADIANCE;
use crate::images::Image;
use crate::rasterize::ColorSpace;

/// A photograph.
#[derive(Clone, Debug, PartialEq)]
pub struct Backplate {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Linear. `[height][width]`
    pub pixels: Vec<[f32; 3]>,
    /// Remarks on reading it, for the user.
    pub warnings: Vec<String>,
}

impl Backplate {
    /// An image; what is no number or below black in it is black.
    pub fn of(mut image: Image) -> Self {
        let shown = |v: &mut f32| {
            *v = match *v {
                f32::INFINITY => INFINITE_RADIANCE,
                _ if v.is_nan() => 0.0,
                v => v.max(0.0),
            }
        };
        image.pixels.iter_mut().flatten().for_each(shown);
        Self {
            width: image.width,
            height: image.height,
            pixels: image.pixels,
            warnings: image.provenance.warnings,
        }
    }

    /// Pixels of the plate in one of an image of that size.
    pub fn scale(size: [usize; 2], picture: [usize; 2]) -> f32 {
        let shorter = |[width, height]: [usize; 2]| width.min(height).max(1) as f32;
        shorter(size) / shorter(picture)
    }

    /// Plate of at most so many pixels along the shorter edge, by box filtering.
    pub fn reduced(&self, shorter_edge: usize) -> Self {
        let shorter = self.width.min(self.height);
        if shorter <= shorter_edge {
            return self.clone();
        }
        let scaled = |edge: usize| (edge * shorter_edge).div_ceil(shorter).max(1);
        let (width, height) = (scaled(self.width), scaled(self.height));
        let span = |i: usize, of: usize, to: usize| i * of / to..((i + 1) * of).div_ceil(to);
        let pixel = |i: usize| {
            let rows = span(i / width, self.height, height);
            let columns = span(i % width, self.width, width);
            let count = (rows.len() * columns.len()) as f32;
            let mut sum = [0f32; 3];
            for row in rows {
                for p in &self.pixels[row * self.width..][columns.clone()] {
                    for (s, v) in sum.iter_mut().zip(p) {
                        *s += v;
                    }
                }
            }
            sum.map(|s| s / count)
        };
        Self {
            width,
            height,
            pixels: (0..width * height).into_par_iter().map(pixel).collect(),
            warnings: self.warnings.clone(),
        }
    }

    /// Its colour at a pixel of a camera's picture, in that picture's own space; none beyond its edges.
    pub fn at(&self, camera: &Camera, x: usize, y: usize, space: ColorSpace) -> Option<[f32; 3]> {
        let [width, height] = [self.width, self.height].map(|v| v as f32);
        let scale = Self::scale([self.width, self.height], [camera.width, camera.height]);
        let [cx, cy] = camera.principal_point();
        let u = (x as f32 - cx) * scale + 0.5 * width;
        let v = (y as f32 - cy) * scale + 0.5 * height;
        if !(0.0..=width).contains(&u) || !(0.0..=height).contains(&v) {
            return None;
        }
        let along = |at: f32, size: usize| {
            let at = (at - 0.5).clamp(0.0, (size - 1) as f32);
            let low = at as usize;
            (low, (low + 1).min(size - 1), at - low as f32)
        };
        let (left, right, s) = along(u, self.width);
        let (top, bottom, t) = along(v, self.height);
        let radiance = std::array::from_fn(|c| {
            let value = |x: usize, y: usize| self.pixels[y * self.width + x][c];
            let row = |y: usize| value(left, y) * (1.0 - s) + value(right, y) * s;
            row(top) * (1.0 - t) + row(bottom) * t
        });
        Some(match space {
            ColorSpace::Linear => radiance,
            ColorSpace::Display(_) => radiance.map(|v| srgb_encode(v).clamp(0.0, 1.0)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::present::PLAIN;
    use glam::Vec3;

    fn plate(width: usize, height: usize) -> Backplate {
        let pixel = |i: usize| [(i % width) as f32, (i / width) as f32, 0.25];
        Backplate {
            warnings: Vec::new(),
            width,
            height,
            pixels: (0..width * height).map(pixel).collect(),
        }
    }

    fn camera(width: usize, height: usize) -> Camera {
        Camera::look_at(Vec3::X, Vec3::ZERO, Vec3::Z, 1.0, [width, height], 0.1)
    }

    #[test]
    fn a_picture_of_its_size_shows_each_of_its_pixels() {
        let plate = plate(7, 4);
        let camera = camera(7, 4);
        for (x, y) in [(0, 0), (6, 3), (3, 2)] {
            let found = plate.at(&camera, x, y, ColorSpace::Linear);
            assert_eq!(found, Some([x as f32, y as f32, 0.25]));
        }
        let [.., grey] = plate.at(&camera, 1, 1, PLAIN).expect("inside");
        assert!((grey - srgb_encode(0.25)).abs() < 1e-6);
    }

    #[test]
    fn a_wider_picture_shows_it_by_its_shorter_edge_and_nothing_beside_it() {
        let (plate, camera) = (plate(8, 8), camera(32, 16));
        assert_eq!(plate.at(&camera, 7, 8, ColorSpace::Linear), None);
        assert!(plate.at(&camera, 8, 8, ColorSpace::Linear).is_some());
        assert!(plate.at(&camera, 23, 0, ColorSpace::Linear).is_some());
        assert_eq!(plate.at(&camera, 24, 0, ColorSpace::Linear), None);
    }

    #[test]
    fn a_reduced_one_has_the_same_mean() {
        let plate = plate(12, 6);
        let small = plate.reduced(2);
        assert_eq!((small.width, small.height), (4, 2));
        for c in 0..3 {
            let mean =
                |p: &Backplate| p.pixels.iter().map(|v| v[c]).sum::<f32>() / p.pixels.len() as f32;
            assert!((mean(&plate) - mean(&small)).abs() < 1e-5);
        }
        assert_eq!(plate.reduced(6), plate);
    }
}
