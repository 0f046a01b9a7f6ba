//! Transfer curves, tone curves, and SH functions between display-encoded and linear colour. Light is linear everywhere else.

use glam::DVec3;
use multiversion::multiversion;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::sh::{self, MAX_COEFFICIENTS, coefficient_count, evaluate_basis, sphere_quadrature};

/// Light up to which sRGB is linear.
const SRGB_TOE: f32 = 0.003_130_8;

/// Linear value of a display-encoded (sRGB, IEC 61966-2-1) one; odd-symmetric and unbounded.
pub fn srgb_decode(encoded: f32) -> f32 {
    let v = encoded.abs();
    let linear = if v <= 0.04045 {
        v / 12.92
    } else {
        ((v + 0.055) / 1.055).powf(2.4)
    };
    linear.copysign(encoded)
}

/// Display-encoded value of a linear one: the inverse of [`srgb_decode`].
pub fn srgb_encode(linear: f32) -> f32 {
    let v = linear.abs();
    let encoded = if v <= SRGB_TOE {
        v * 12.92
    } else {
        1.055 * v.powf(1.0 / 2.4) - 0.055
    };
    encoded.copysign(linear)
}

/// [`srgb_encode`] of many values that are not negative, in place, to six digits: `x^(5/12)` as `x^(1/2) x^(-1/12)`, which compiles to
/// vector instructions.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
pub fn srgb_encode_all(values: &mut [f32]) {
    for v in values {
        *v = if *v <= SRGB_TOE {
            *v * 12.92
        } else {
            1.055 * srgb_power(*v) - 0.055
        };
    }
}

/// The power that sRGB is above its toe, of many values, in place.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn srgb_powers(values: &mut [f32]) {
    for v in values {
        *v = srgb_power(*v);
    }
}

#[inline(always)]
fn srgb_power(x: f32) -> f32 {
    let x = x.max(1e-6);
    // A twelfth of the exponent, within 3 %, and two steps of third order towards `x y^12 = 1`.
    let mut y = f32::from_bits(0x44c4_902a - x.to_bits() / 12);
    for _ in 0..2 {
        let square = y * y;
        let fourth = square * square;
        let error = 1.0 - x * (fourth * fourth) * fourth;
        y += y * error * (1.0 / 12.0 + 13.0 / 288.0 * error);
    }
    x.sqrt() * y
}

/// [`srgb_decode`] of many values that are not negative, in place, to six digits: `x^(12/5)` as `(x x^(-1/5))^3`.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
pub fn srgb_decode_all(values: &mut [f32]) {
    for v in values {
        let x = (*v + 0.055) / 1.055;
        // As above, towards `x y^5 = 1`; with the offset, x is never small.
        let mut y = f32::from_bits(0x4c2b_b923 - x.to_bits() / 5);
        for _ in 0..2 {
            let square = y * y;
            let error = 1.0 - x * (square * square) * y;
            y += y * error * (1.0 / 5.0 + 3.0 / 25.0 * error);
        }
        let root = x * y;
        *v = if *v <= 0.04045 {
            *v / 12.92
        } else {
            root * root * root
        };
    }
}

/// Weights of linear Rec. 709 red, green and blue in luminance.
pub const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Luminance of linear Rec. 709 colour.
pub fn luminance(rgb: [f32; 3]) -> f32 {
    LUMINANCE[0] * rgb[0] + LUMINANCE[1] * rgb[1] + LUMINANCE[2] * rgb[2]
}

/// Linear Rec. 709 colour of a spectrum, its luminance the integral with the CIE 1931 observer over the wavelength in nanometres, in the fit of
/// Wyman, Sloan and Shirley ("Simple Analytic Approximations to the CIE XYZ Color Matching Functions", 2013). Colours outside the gamut are clipped
/// at 0.
pub fn of_spectrum(power: impl Fn(f64) -> f64) -> [f64; 3] {
    let lobe = |nm: f64, height: f64, middle: f64, widths: [f64; 2]| {
        let off = (nm - middle) / widths[usize::from(nm >= middle)];
        height * (-0.5 * off * off).exp()
    };
    let step = 5.0;
    let mut xyz = DVec3::ZERO;
    for at in 0..=95 {
        let nm = 360.0 + step * f64::from(at);
        xyz += step
            * power(nm)
            * DVec3::new(
                lobe(nm, 1.056, 599.8, [37.9, 31.0])
                    + lobe(nm, 0.362, 442.0, [16.0, 26.7])
                    + lobe(nm, -0.065, 501.1, [20.4, 26.2]),
                lobe(nm, 0.821, 568.8, [46.9, 40.5]) + lobe(nm, 0.286, 530.9, [16.3, 31.1]),
                lobe(nm, 1.217, 437.0, [11.8, 36.0]) + lobe(nm, 0.681, 459.0, [26.0, 13.8]),
            );
    }
    let DVec3 { x, y, z } = xyz;
    let rgb = [
        3.240_970 * x - 1.537_383 * y - 0.498_611 * z,
        -0.969_244 * x + 1.875_968 * y + 0.041_555 * z,
        0.055_630 * x - 0.203_977 * y + 1.056_972 * z,
    ];
    rgb.map(|v| v.max(0.0))
}

/// Spectral radiance of a black body at a wavelength in nanometres, W/m²/sr/nm (Planck's law).
pub fn planck(kelvin: f64, nm: f64) -> f64 {
    let meters = nm * 1e-9;
    1e-9 * 1.191_042_97e-16 / meters.powi(5) / ((0.014_387_77 / (meters * kelvin)).exp() - 1.0)
}

/// Linear colour of a black body, of luminance 1.
pub fn black_body(kelvin: f32) -> [f32; 3] {
    let rgb = of_spectrum(|nm| planck(f64::from(kelvin), nm)).map(|v| v as f32);
    let one = luminance(rgb);
    rgb.map(|v| v / one)
}

/// Tone curve from linear colour to the display's range.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ToneMap {
    /// The sRGB curve alone, clipped at white: with no exposure, what the trainer rendered.
    #[default]
    Srgb,
    /// Khronos PBR Neutral (2024): colours below 0.8 are left alone, highlights are compressed and desaturated.
    Neutral,
    /// AgX (Troy Sobotka, 2022), with the polynomial fit of its contrast curve.
    Agx,
    /// ACES filmic, the fit of Narkowicz (2015).
    Aces,
    /// Linear values shown as they are, without any curve.
    None,
}

/// From linear scene colour to the values that are blended and shown: exposure, then a tone curve and the display's encoding.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Display {
    /// In stops.
    pub exposure: f32,
    /// The tone curve.
    pub tone_map: ToneMap,
}

impl Display {
    /// Display settings that an image is encoded with: false colours are made of the sRGB curve alone, which can be inverted.
    pub fn for_picture(self, false_color: bool) -> Self {
        Self {
            tone_map: if false_color {
                ToneMap::Srgb
            } else {
                self.tone_map
            },
            ..self
        }
    }

    /// True where encoded colour passes unchanged.
    pub fn is_identity(&self) -> bool {
        self.exposure == 0.0 && self.tone_map == ToneMap::Srgb
    }

    /// Display-encoded colour of linear colour. Not clipped above, except by the curve itself.
    pub fn encode(&self, linear: [f32; 3]) -> [f32; 3] {
        let gain = self.gain();
        let c = linear.map(|v| (v * gain).clamp(0.0, MAX_LINEAR));
        match self.tone_map {
            ToneMap::Srgb => c.map(srgb_encode),
            ToneMap::Neutral => neutral(c).map(srgb_encode),
            ToneMap::Agx => agx(c),
            ToneMap::Aces => c
                .map(|x| x.min(1e6))
                .map(|x| (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14))
                .map(|x| srgb_encode(x.clamp(0.0, 1.0))),
            ToneMap::None => c,
        }
    }

    /// [`Display::encode`] of many colours, in place.
    pub fn encode_all(&self, colors: &mut [[f32; 3]]) {
        if self.tone_map != ToneMap::Srgb {
            for color in colors {
                *color = self.encode(*color);
            }
            return;
        }
        let (gain, values) = (self.gain(), colors.as_flattened_mut());
        for v in values.iter_mut() {
            *v = (*v * gain).clamp(0.0, MAX_LINEAR);
        }
        srgb_encode_all(values);
    }

    /// Factor of linear light.
    fn gain(&self) -> f32 {
        self.exposure.exp2()
    }
}

/// Linear values are held below this before a curve, so that squares stay finite in f32.
pub const MAX_LINEAR: f32 = 1e15;

fn neutral([r, g, b]: [f32; 3]) -> [f32; 3] {
    const START: f32 = 0.8 - 0.04;
    const DESATURATION: f32 = 0.15;
    let low = r.min(g).min(b);
    let offset = if low < 0.08 {
        low - 6.25 * low * low
    } else {
        0.04
    };
    let c = [r - offset, g - offset, b - offset];
    let peak = c[0].max(c[1]).max(c[2]);
    if peak < START {
        return c;
    }
    let room = 1.0 - START;
    let new_peak = 1.0 - room * room / (peak + room - START);
    let white = 1.0 - 1.0 / (DESATURATION * (peak - new_peak) + 1.0);
    c.map(|v| (v * new_peak / peak) * (1.0 - white) + new_peak * white)
}

/// Rows of the matrix into AgX's working space.
pub const AGX_INSET: [[f32; 3]; 3] = [
    [0.842_479_06, 0.078_433_6, 0.079_223_745],
    [0.042_328_242, 0.878_468_64, 0.079_166_13],
    [0.042_375_656, 0.078_433_6, 0.879_143],
];
/// Rows of the matrix out of AgX's working space.
pub const AGX_OUTSET: [[f32; 3]; 3] = [
    [1.196_879, -0.098_020_88, -0.099_029_74],
    [-0.052_896_85, 1.151_903_1, -0.098_961_18],
    [-0.052_971_64, -0.098_043_45, 1.151_073_7],
];

/// Logarithms (base 2) of light between which AgX's contrast curve runs.
pub(crate) const AGX_STOPS: [f32; 2] = [-12.473_93, 4.026_069];

/// AgX's contrast curve, from 0 to 1.
pub(crate) fn agx_contrast(x: f32) -> f32 {
    let (x2, x4) = (x * x, x * x * x * x);
    15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x
        - 0.002_32
}

fn agx(c: [f32; 3]) -> [f32; 3] {
    let [low, high] = AGX_STOPS;
    let product =
        |m: &[[f32; 3]; 3], c: [f32; 3]| m.map(|row| row[0] * c[0] + row[1] * c[1] + row[2] * c[2]);
    let curved = product(&AGX_INSET, c).map(|v| {
        let x = ((v.max(1e-10).log2() - low) / (high - low)).clamp(0.0, 1.0);
        agx_contrast(x)
    });
    product(&AGX_OUTSET, curved).map(|v| v.clamp(0.0, 1.0))
}

/// The stored colour's offset: `c(d) = max(0, 1/2 + sum_k sh_k Y_k(d))`.
pub const STORED_OFFSET: f32 = 0.5;

/// Colour that SH coefficients encode.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Encoding {
    /// As trained: display-encoded, with the constant 1/2 left out.
    Stored,
    /// As trained on linear images: linear, with the constant 1/2 left out.
    StoredLinear,
    /// Linear radiance, nothing left out: what the transfer works on.
    Linear,
}

impl Encoding {
    /// Constant that is added to the value of the coefficients.
    pub fn offset(self) -> f32 {
        match self {
            Self::Stored | Self::StoredLinear => STORED_OFFSET,
            Self::Linear => 0.0,
        }
    }

    /// True where light of at least `darkest` times a factor of at least `least` and at most `most` is stored as a power of it: `encode(factor x) = g
    /// (encode(x) + shift) - shift`, with [`Encoding::gains`] of the factor as g and [`Encoding::shift`]. sRGB is a power but for its toe.
    pub fn is_power(self, darkest: f32, [least, most]: [f32; 2]) -> bool {
        // So that nothing is clamped.
        let is_in_range = least >= 0.0 && most <= 1e6;
        let toe = if self == Self::Stored { SRGB_TOE } else { -1.0 };
        is_in_range && darkest * least.min(1.0) > toe
    }

    /// Converts factors of light, in place, to factors of stored values plus [`Encoding::shift`].
    pub fn gains(self, factors: &mut [f32]) {
        if self == Self::Stored {
            srgb_powers(factors);
        }
    }

    /// Shift of stored values. See [`Encoding::is_power`].
    pub fn shift(self) -> f32 {
        match self {
            Self::Stored => self.offset() + 0.055,
            Self::StoredLinear | Self::Linear => self.offset(),
        }
    }

    /// Linear radiance of a value of the coefficients; negative radiance is clamped as the renderer clamps it.
    #[inline]
    pub fn decode(self, value: f32) -> f32 {
        let value = value + self.offset();
        match self {
            Self::Stored => srgb_decode(value.clamp(0.0, MAX_STORED)),
            Self::StoredLinear | Self::Linear => value.max(0.0),
        }
    }

    /// [`Encoding::decode`] of many values, in place.
    pub fn decode_all(self, values: &mut [f32]) {
        for v in values.iter_mut() {
            *v = (*v + self.offset()).max(0.0);
        }
        if self == Self::Stored {
            for v in values.iter_mut() {
                *v = v.min(MAX_STORED);
            }
            srgb_decode_all(values);
        }
    }

    /// The value of the coefficients for linear radiance.
    #[inline]
    pub fn encode(self, linear: f32) -> f32 {
        let mut value = [linear];
        self.encode_all(&mut value);
        value[0]
    }

    /// [`Encoding::encode`] of many values, in place.
    pub fn encode_all(self, values: &mut [f32]) {
        for v in values.iter_mut() {
            *v = v.clamp(0.0, MAX_LINEAR);
        }
        if self == Self::Stored {
            srgb_encode_all(values);
        }
        for v in values {
            *v -= self.offset();
        }
    }
}

/// Passes the values of whole SH functions `[n][K][3]` through a curve, in place: evaluates each on a quadrature, converts each value,
/// projects back.
///
/// The curve is not a polynomial, so the result is the projection on a quadrature of degree `2 * degree + 2`.
pub(crate) fn pass_through(
    functions: &mut [[f32; 3]],
    degree: usize,
    curve: impl Fn([f32; 3]) -> [f32; 3] + Sync,
) {
    let k = coefficient_count(degree);
    // `[samples][K]`, and the same with the weight of each sample folded in.
    let (mut evaluate, mut project): (Vec<f32>, Vec<f32>) = (Vec::new(), Vec::new());
    for (d, w) in sphere_quadrature(if degree == 0 { 0 } else { 2 * degree + 2 }) {
        let mut y = [0f64; MAX_COEFFICIENTS];
        evaluate_basis(d, degree, &mut y);
        evaluate.extend(y[..k].iter().map(|&y| y as f32));
        project.extend(y[..k].iter().map(|&y| (w * y) as f32));
    }
    functions.par_chunks_exact_mut(k).for_each(|function| {
        let mut result = [[0f32; 3]; MAX_COEFFICIENTS];
        for (evaluate, project) in evaluate.chunks_exact(k).zip(project.chunks_exact(k)) {
            let mut value = [0f32; 3];
            for (y, c) in evaluate.iter().zip(function.iter()) {
                for (v, c) in value.iter_mut().zip(c) {
                    *v += y * c;
                }
            }
            let value = curve(value);
            for (p, r) in project.iter().zip(&mut result) {
                for (r, v) in r.iter_mut().zip(value) {
                    *r += p * v;
                }
            }
        }
        function.copy_from_slice(&result[..k]);
    });
}

/// Linear radiance `[n][K][3]` of stored colour of the same shape. Negative radiance is clamped as the renderer clamps it.
pub fn decode_sh(stored: &[[f32; 3]], degree: usize, encoding: Encoding) -> Vec<[f32; 3]> {
    let mut out = stored.to_vec();
    let k = coefficient_count(degree);
    match encoding {
        Encoding::Linear => {}
        Encoding::StoredLinear => out.par_chunks_exact_mut(k).for_each(|f| {
            for c in &mut f[0] {
                *c += STORED_OFFSET * sh::SQRT_4PI as f32;
            }
        }),
        Encoding::Stored => {
            pass_through(&mut out, degree, |value| value.map(|v| encoding.decode(v)))
        }
    }
    out
}

/// Stored colour above this is held to it before decoding: 2^40 in linear light, and no overflow.
pub const MAX_STORED: f32 = 1e5;

/// Stored colour `[n][K][3]` of linear radiance of the same shape, in place: the inverse of [`decode_sh`].
pub fn encode_sh(mut linear: Vec<[f32; 3]>, degree: usize, encoding: Encoding) -> Vec<[f32; 3]> {
    let k = coefficient_count(degree);
    match encoding {
        Encoding::Linear => {}
        Encoding::StoredLinear => linear.par_chunks_exact_mut(k).for_each(|f| {
            for c in &mut f[0] {
                *c -= STORED_OFFSET * sh::SQRT_4PI as f32;
            }
        }),
        Encoding::Stored => pass_through(&mut linear, degree, |value| {
            value.map(|v| encoding.encode(v))
        }),
    }
    linear
}

/// Radiance of one surfel towards one direction, in linear light.
#[inline]
pub fn radiance(function: &[[f32; 3]], degree: usize, encoding: Encoding, d: [f32; 3]) -> [f32; 3] {
    sh::evaluate_sh(function, degree, d).map(|v| encoding.decode(v))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn curves_are_inverse(v in 0f32..100.0) {
            prop_assert!((srgb_encode(srgb_decode(v)) - v).abs() <= 4e-6 * (1.0 + v));
        }

        #[test]
        fn many_are_converted_as_one(v in prop::collection::vec(-12f32..15.0, 33)) {
            let close = |a: f32, b: f32| (a - b).abs() <= 2e-6 * (0.1 + b);
            let values: Vec<f32> = v.iter().map(|v| 10f32.powf(*v)).chain([0.0]).collect();
            let mut encoded = values.clone();
            srgb_encode_all(&mut encoded);
            for (l, e) in values.iter().zip(&encoded) {
                prop_assert!(close(*e, srgb_encode(*l)), "{l}: {e} for {}", srgb_encode(*l));
            }
            let mut decoded = values.clone();
            srgb_decode_all(&mut decoded);
            for (e, l) in values.iter().zip(&decoded) {
                // Far up, the rounded exponent of the f32 curve shows.
                let exact = if *e <= 0.04045 { srgb_decode(*e) } else { ((f64::from(*e) + 0.055) / 1.055).powf(2.4) as f32 };
                prop_assert!(close(*l, exact), "{e}: {l} for {exact}");
            }
        }

        #[test]
        fn every_curve_is_finite_and_non_negative(r in -1e30f32..1e30, g in 0f32..100.0, b in 0f32..1.0, stops in -20f32..20.0) {
            for tone_map in [ToneMap::Srgb, ToneMap::Neutral, ToneMap::Agx, ToneMap::Aces, ToneMap::None] {
                let out = Display { exposure: stops, tone_map }.encode([r, g, b]);
                prop_assert!(out.iter().all(|v| v.is_finite() && *v >= -1e-6), "{tone_map:?} {out:?}");
            }
        }
    }

    #[test]
    fn grey_stays_grey_and_rises() {
        for tone_map in [ToneMap::Srgb, ToneMap::Neutral, ToneMap::Agx, ToneMap::Aces] {
            let mut last = -1.0;
            for i in 0..=40 {
                let [r, g, b] = Display {
                    exposure: 0.0,
                    tone_map,
                }
                .encode([i as f32 * 0.05; 3]);
                assert!((r - g).abs() < 2e-3 && (g - b).abs() < 2e-3, "{tone_map:?}");
                assert!(g >= last - 1e-6, "{tone_map:?} falls at {i}");
                last = g;
            }
        }
    }

    #[test]
    fn conversion_there_and_back_returns_a_gentle_function() {
        // A colour of 0.5 +- 0.1 over the sphere: the curve's own harmonics above degree 3 are all that is lost.
        let mut function = vec![[0f32; 3]; 16];
        function[0] = [0.2, 0.1, -0.1];
        function[2] = [0.12, -0.1, 0.05];
        function[6] = [0.03, 0.05, -0.02];
        for encoding in [Encoding::Stored, Encoding::StoredLinear] {
            let linear = decode_sh(&function, 3, encoding);
            let back = encode_sh(linear, 3, encoding);
            for (a, b) in function.iter().zip(&back) {
                for (a, b) in a.iter().zip(b) {
                    assert!((a - b).abs() < 2e-3, "{a} {b}");
                }
            }
        }
    }

    #[test]
    fn degree_zero_is_converted_exactly() {
        let stored = vec![[0.3f32, -0.5, 2.0]];
        let linear = decode_sh(&stored, 0, Encoding::Stored);
        let y0 = 1.0 / sh::SQRT_4PI as f32;
        for (s, l) in stored[0].iter().zip(linear[0]) {
            assert!((srgb_decode(s * y0 + 0.5) - l * y0).abs() < 1e-6);
        }
    }

    #[test]
    fn daylight_is_white_and_a_candle_is_red() {
        let day = black_body(6500.0);
        assert!(day.iter().all(|v| (v - 1.0).abs() < 0.06), "{day:?}");
        let candle = black_body(1900.0);
        assert!(
            candle[0] > 2.0 * candle[1] && candle[2] < 0.05,
            "{candle:?}"
        );
        let sky = black_body(20_000.0);
        assert!(sky[2] > 1.5 * sky[0], "{sky:?}");
        for kelvin in [1000.0, 3200.0, 40_000.0] {
            assert!((luminance(black_body(kelvin)) - 1.0).abs() < 1e-4);
        }
    }
}
