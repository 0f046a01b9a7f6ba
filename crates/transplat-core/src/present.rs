//! Stage *present*: from pictures of surfels to the picture that is shown or saved.

use glam::{DMat3, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::camera::Camera;
use crate::color::Display;
use crate::environment::EnvironmentMap;
use crate::rasterize::{ColorSpace, Raster};
use crate::surfels::SurfelCloud;

/// What a picture shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum View {
    /// The asset relit.
    #[default]
    After,
    /// The asset as it was captured.
    Before,
    /// Left half before, right half after.
    Split,
    /// After minus before in display values; grey is none.
    Difference,
    /// Band 0 of the relit colour alone.
    Diffuse,
    /// Bands 1 and up of the relit colour alone.
    Specular,
    /// World normals, turned to face the eye; 0 to 1 stands for -1 to 1.
    Normals,
    /// Depth along the view: white is the nearest part of the object, dark grey the farthest.
    Depth,
    /// Cosine-weighted open share of each surfel's front side.
    Visibility,
    /// The transfer ratio in stops: blue is -3 and less, white 0, red +3 and more.
    Tau,
}

impl View {
    /// Whether a picture of it needs the asset relit.
    pub fn needs_relit(self) -> bool {
        matches!(
            self,
            Self::After
                | Self::Split
                | Self::Difference
                | Self::Diffuse
                | Self::Specular
                | Self::Tau
        )
    }
}

/// What is behind the object.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// Nothing: the picture keeps its alpha.
    #[default]
    Transparent,
    /// A display-encoded colour.
    Color([f32; 3]),
    /// The target environment.
    Environment,
}

/// Fills what the object leaves open with `behind`, a colour for each pixel in the raster's own space.
pub fn composite(raster: &mut Raster, behind: impl Fn(usize, usize) -> [f32; 3] + Sync) {
    let width = raster.width;
    raster
        .pixels
        .par_iter_mut()
        .enumerate()
        .for_each(|(i, pixel)| {
            let through = 1.0 - pixel[3];
            if through > 0.0 {
                let color = behind(i % width, i / width);
                for (p, c) in pixel.iter_mut().zip(color) {
                    *p += through * c;
                }
                pixel[3] = 1.0;
            }
        });
}

/// An environment as the background of a view: `world_from_asset` undoes the turn of the light, `gain` is its strength.
pub fn environment_behind<'a>(
    map: &'a EnvironmentMap,
    camera: &'a Camera,
    world_from_asset: DMat3,
    gain: f32,
    space: ColorSpace,
) -> impl Fn(usize, usize) -> [f32; 3] + Sync + 'a {
    let turn = world_from_asset.as_mat3();
    move |x, y| {
        let radiance = map.sample(turn * camera.ray(x, y)).map(|v| v * gain);
        match space {
            ColorSpace::Display(display) => display.encode(radiance),
            ColorSpace::Linear => radiance,
        }
    }
}

/// Straight colour and alpha for an 8-bit picture, clamped to what it can hold.
pub fn straight(raster: &Raster) -> Vec<[f32; 4]> {
    raster
        .pixels
        .iter()
        .map(|&[r, g, b, a]| {
            if a <= 0.0 {
                return [0.0; 4];
            }
            [r / a, g / a, b / a, a].map(|v| v.clamp(0.0, 1.0))
        })
        .collect()
}

/// Left half of one picture, right half of the other, with a line between.
pub fn split(left: &Raster, right: &Raster) -> Raster {
    let mut out = right.clone();
    let middle = out.width / 2;
    for y in 0..out.height {
        for x in 0..middle {
            let i = y * out.width + x;
            out.pixels[i] = left.pixels[i];
        }
        if out.width > 2 {
            out.pixels[y * out.width + middle] = [0.5, 0.5, 0.5, 1.0];
        }
    }
    out
}

/// After minus before as display values over `[0, 1]`, 0.5 where they are equal; of linear pictures the plain signed difference.
pub fn difference(before: &Raster, after: &Raster, space: ColorSpace) -> Raster {
    let mut out = after.clone();
    for (out, before) in out.pixels.iter_mut().zip(&before.pixels) {
        let alpha = out[3];
        for c in 0..3 {
            let value = out[c] - before[c];
            out[c] = match space {
                ColorSpace::Display(_) => (0.5 * alpha + value).clamp(0.0, alpha),
                ColorSpace::Linear => value,
            };
        }
    }
    out
}

/// The depth of a picture as its colour. For display it runs from white (nearest in this picture) to dark grey (farthest).
pub fn depth_picture(raster: &Raster, space: ColorSpace) -> Raster {
    let covered = || {
        raster
            .depth
            .iter()
            .zip(&raster.pixels)
            .filter(|(_, p)| p[3] > 0.5)
            .map(|(d, _)| *d)
    };
    let near = covered().fold(f32::INFINITY, f32::min);
    let far = covered().fold(0f32, f32::max);
    let mut out = raster.clone();
    for (pixel, depth) in out.pixels.iter_mut().zip(&raster.depth) {
        let value = match space {
            ColorSpace::Linear => *depth,
            ColorSpace::Display(_) if far > near => {
                (1.0 - 0.8 * (depth - near) / (far - near)).clamp(0.0, 1.0)
            }
            ColorSpace::Display(_) => 1.0,
        };
        let alpha = pixel[3];
        *pixel = [value * alpha, value * alpha, value * alpha, alpha];
    }
    out
}

/// Normals as surfel colours: each turned to face the eye. For display 0 to 1 stands for -1 to 1. `[n][3]`
pub fn normal_colors(cloud: &SurfelCloud, eye: Vec3, space: ColorSpace) -> Vec<[f32; 3]> {
    (0..cloud.len())
        .map(|i| {
            let n = cloud.stored_normal(i);
            let n = if n.dot(cloud.positions[i] - eye) > 0.0 {
                -n
            } else {
                n
            };
            match space {
                ColorSpace::Display(_) => (n * 0.5 + 0.5).to_array(),
                ColorSpace::Linear => n.to_array(),
            }
        })
        .collect()
}

/// The ratio's heat map: stops on the mean of the channels, -3 blue, 0 white, +3 red.
pub fn tau_colors(tau: &[[f32; 3]]) -> Vec<[f32; 3]> {
    tau.iter()
        .map(|t| {
            let mean = (t[0] + t[1] + t[2]) / 3.0;
            let stops = (mean.max(1e-6).log2() / 3.0).clamp(-1.0, 1.0);
            if stops < 0.0 {
                [1.0 + 0.9 * stops, 1.0 + 0.7 * stops, 1.0]
            } else {
                [1.0, 1.0 - 0.75 * stops, 1.0 - 0.9 * stops]
            }
        })
        .collect()
}

/// Parts of relit SH `[n][K][3]`: band 0 alone, or everything else.
pub fn part_of_sh(relit: &[[f32; 3]], k: usize, diffuse: bool) -> Vec<[f32; 3]> {
    relit
        .iter()
        .enumerate()
        .map(|(i, c)| {
            if (i % k == 0) == diffuse {
                *c
            } else {
                [0.0; 3]
            }
        })
        .collect()
}

/// Display values show as they are: for channels that are no colours.
pub const PLAIN: ColorSpace = ColorSpace::Display(Display {
    exposure: 0.0,
    tone_map: crate::color::ToneMap::Srgb,
});

#[cfg(test)]
mod tests {
    use super::*;

    fn raster(pixel: [f32; 4]) -> Raster {
        Raster {
            width: 4,
            height: 1,
            pixels: vec![pixel; 4],
            depth: vec![1.0; 4],
        }
    }

    #[test]
    fn compositing_fills_what_is_open() {
        let mut r = raster([0.25, 0.0, 0.0, 0.25]);
        composite(&mut r, |_, _| [0.0, 1.0, 0.5]);
        assert_eq!(r.pixels[0], [0.25, 0.75, 0.375, 1.0]);
    }

    #[test]
    fn straight_undoes_premultiplication_and_clamps() {
        assert_eq!(
            straight(&raster([0.25, 1.0, 0.0, 0.5]))[0],
            [0.5, 1.0, 0.0, 0.5]
        );
        assert_eq!(straight(&raster([0.0; 4]))[0], [0.0; 4]);
    }

    #[test]
    fn no_difference_is_grey() {
        let r = raster([0.3, 0.9, 0.0, 1.0]);
        assert_eq!(difference(&r, &r, PLAIN).pixels[0], [0.5, 0.5, 0.5, 1.0]);
    }

    #[test]
    fn split_shows_both() {
        let s = split(&raster([1.0; 4]), &raster([0.0, 0.0, 0.0, 1.0]));
        assert_eq!(s.pixels[0], [1.0; 4]);
        assert_eq!(s.pixels[3], [0.0, 0.0, 0.0, 1.0]);
    }

    #[test]
    fn the_parts_of_a_function_sum_to_it() {
        let f = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0], [1.0; 3]];
        let (a, b) = (part_of_sh(&f, 4, true), part_of_sh(&f, 4, false));
        for i in 0..4 {
            for c in 0..3 {
                assert_eq!(a[i][c] + b[i][c], f[i][c]);
            }
        }
    }
}
