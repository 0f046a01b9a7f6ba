//! Colours of surfels towards an eye.

use std::ops::Range;

use glam::Vec3;
use multiversion::multiversion;
use rayon::prelude::*;

use crate::color::{Display, Encoding, STORED_OFFSET};
use crate::color_rows::{ColorRows, weighted_sum};
use crate::lanes::{LANES, Lanes};
use crate::sh::{MAX_COEFFICIENTS, coefficient_count, evaluate_basis};

/// Meaning of an image's colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColorSpace {
    /// Display-encoded, after exposure and tone curve: as splats are trained and blended.
    Display(Display),
    /// Linear radiance, for EXR.
    Linear,
}

/// Surfels that are shaded at once by [`shade`].
const AT_ONCE: usize = 1024;

/// Colour of each surfel towards `eye`, `[n][3]`: SH once a surfel, towards its centre, clamped below at 0 and not above.
pub fn shade(
    positions: &[Vec3],
    sh: &[[f32; 3]],
    degree: usize,
    encoding: Encoding,
    eye: Vec3,
    space: ColorSpace,
) -> Vec<[f32; 3]> {
    let shading = Shading {
        positions,
        sh: Functions::Flat(sh),
        degree,
        encoding,
        gains: None,
        coefficients: 0..coefficient_count(degree),
        eye,
        space,
    };
    let mut colors = vec![[0.0; 3]; positions.len()];
    let chunks = colors.par_chunks_mut(AT_ONCE).enumerate();
    chunks.for_each(|(i, colors)| {
        let first = i * AT_ONCE;
        let surfels: Vec<usize> = (first..first + colors.len()).collect();
        shading.colors(&surfels, colors);
    });
    colors
}

/// Functions of the view, one a surfel.
#[derive(Clone, Copy, Debug)]
pub enum Functions<'a> {
    /// One after the other, `[n][K][3]`.
    Flat(&'a [[f32; 3]]),
    /// `[n][K]`
    Rows(&'a ColorRows),
}

/// SH colour as it is seen from somewhere.
#[derive(Clone, Debug)]
pub struct Shading<'a> {
    /// Positions of the surfels, `[n]`.
    pub positions: &'a [Vec3],
    /// Their colour.
    pub sh: Functions<'a>,
    /// SH degree of `sh`.
    pub degree: usize,
    /// Encoding of `sh`.
    pub encoding: Encoding,
    /// Factor of the light, `[n]`.
    pub gains: Option<&'a [[f32; 3]]>,
    /// Coefficients that take part.
    pub coefficients: Range<usize>,
    /// In the surfels' coordinates.
    pub eye: Vec3,
    /// Meaning of the colours.
    pub space: ColorSpace,
}

impl Shading<'_> {
    /// The colours of some of the surfels.
    pub fn colors(&self, surfels: &[usize], out: &mut [[f32; 3]]) {
        evaluate(self, surfels, out);
        match self.space {
            // What was trained for display passes untouched.
            ColorSpace::Display(display)
                if self.encoding == Encoding::Stored
                    && display.is_identity()
                    && self.gains.is_none() =>
            {
                for v in out.as_flattened_mut() {
                    *v = (*v + STORED_OFFSET).max(0.0);
                }
            }
            space => {
                self.encoding.decode_all(out.as_flattened_mut());
                if let Some(gains) = self.gains {
                    for (out, i) in out.iter_mut().zip(surfels) {
                        *out = std::array::from_fn(|c| out[c] * gains[*i][c]);
                    }
                }
                if let ColorSpace::Display(display) = space {
                    display.encode_all(out);
                }
            }
        }
    }
}

/// The value of each surfel's SH towards it.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn evaluate(shading: &Shading<'_>, surfels: &[usize], out: &mut [[f32; 3]]) {
    let k = coefficient_count(shading.degree);
    let mut basis = [Lanes::ZERO; MAX_COEFFICIENTS];
    for (surfels, out) in surfels.chunks(LANES).zip(out.chunks_mut(LANES)) {
        let mut toward = [Lanes::ZERO; 3];
        for (lane, surfel) in surfels.iter().enumerate() {
            let d = shading.positions[*surfel] - shading.eye;
            for (axis, x) in toward.iter_mut().zip(d.to_array()) {
                axis.0[lane] = x;
            }
        }
        let [x, y, z] = toward;
        let length = (x * x + y * y + z * z).map(f32::sqrt);
        let is_place = |of| length.where_at_most(Lanes::ZERO, of);
        // Where the eye is in the surfel, any direction serves.
        let z = is_place([Lanes::splat(1.0), z]);
        let length = is_place([Lanes::splat(1.0), length]);
        let direction = [x / length, y / length, z / length];
        // Degrees that are written out compile to straight lines.
        match shading.degree {
            0 => evaluate_basis(direction, 0, &mut basis),
            1 => evaluate_basis(direction, 1, &mut basis),
            2 => evaluate_basis(direction, 2, &mut basis),
            3 => evaluate_basis(direction, 3, &mut basis),
            degree => evaluate_basis(direction, degree, &mut basis),
        }
        for (lane, (surfel, out)) in surfels.iter().zip(out).enumerate() {
            let part = shading.coefficients.clone();
            *out = match shading.sh {
                Functions::Flat(sh) => {
                    let function = &sh[surfel * k..][..k][part.clone()];
                    let basis = basis[part].iter().map(|basis| basis.0[lane]);
                    weighted_sum(function.iter().copied().zip(basis))
                }
                Functions::Rows(rows) => rows.weighted(*surfel, part, |q| basis[q].0[lane]),
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{ToneMap, radiance};
    use crate::color_rows::SHORT_FROM;
    use crate::synthetic;

    #[test]
    fn rows_are_shaded_as_what_they_hold() {
        let cloud = synthetic::glossy_sphere_over_plate(40, 3);
        let (n, k) = (cloud.len(), coefficient_count(3));
        let copy = |_: &mut (), first: usize, out: &mut [[f32; 3]]| {
            out.copy_from_slice(&cloud.sh[first * k..][..out.len()]);
        };
        for surfels in [n, SHORT_FROM] {
            let mut rows = ColorRows::new(n, k, surfels);
            rows.fill(|| (), copy);
            let held = rows.values();
            let of_rows = Shading {
                positions: &cloud.positions,
                sh: Functions::Rows(&rows),
                degree: 3,
                encoding: cloud.encoding,
                gains: None,
                // Some of the bands, too.
                coefficients: 0..9,
                eye: Vec3::new(2.0, 1.0, 0.5),
                space: ColorSpace::Linear,
            };
            let as_held = Shading {
                sh: Functions::Flat(&held),
                ..of_rows.clone()
            };
            let all: Vec<usize> = (0..n).rev().collect();
            let colors = |shading: &Shading<'_>| {
                let mut colors = vec![[0.0; 3]; n];
                shading.colors(&all, &mut colors);
                colors
            };
            let (got, expected) = (colors(&of_rows), colors(&as_held));
            for (a, b) in got.iter().flatten().zip(expected.iter().flatten()) {
                // The unit is multiplied by before the sum or behind it.
                assert!((a - b).abs() < 1e-6 * (1.0 + b.abs()), "{a} {b}");
            }
        }
    }

    #[test]
    fn many_are_shaded_as_one() {
        let eye = Vec3::new(2.0, 1.0, 0.5);
        for degree in [0, 1, 2, 3, 5] {
            let mut cloud = synthetic::glossy_sphere_over_plate(40, degree);
            cloud.positions[7] = eye;
            for encoding in [Encoding::Stored, Encoding::StoredLinear, Encoding::Linear] {
                for space in [
                    ColorSpace::Linear,
                    ColorSpace::Display(Display::default()),
                    ColorSpace::Display(Display {
                        exposure: 0.7,
                        tone_map: ToneMap::Srgb,
                    }),
                    ColorSpace::Display(Display {
                        exposure: -0.4,
                        tone_map: ToneMap::Agx,
                    }),
                ] {
                    let got = shade(&cloud.positions, &cloud.sh, degree, encoding, eye, space);
                    for (i, got) in got.iter().enumerate() {
                        let d = (cloud.positions[i] - eye).normalize_or(Vec3::Z);
                        let linear = radiance(cloud.sh_of(i), degree, encoding, d.to_array());
                        let one = match space {
                            ColorSpace::Linear => linear,
                            ColorSpace::Display(display) => display.encode(linear),
                        };
                        for (got, one) in got.iter().zip(one) {
                            // The curve and back is the same to five digits.
                            assert!(
                                (got - one).abs() < 2e-5 * (1.0 + one),
                                "{degree} {encoding:?} {space:?} {i}: {got} {one}"
                            );
                        }
                    }
                }
            }
        }
    }
}
