//! Camera response: the curve from scene light to the colours of a capture, and its inverse.

use std::sync::OnceLock;

use glam::{Mat3, Vec3};
use serde::{Deserialize, Deserializer, Serialize};

use crate::color::{
    AGX_INSET, AGX_OUTSET, AGX_STOPS, Encoding, agx_contrast, pass_through, srgb_decode,
    srgb_encode,
};
use crate::error::{Result, ensure};
use crate::surfels::SurfelCloud;

/// Range of the contrast.
pub const CONTRASTS: std::ops::RangeInclusive<f32> = 0.25..=4.0;

/// Scene light that keeps its value under every curve and contrast: an 18 % grey.
const MID_GREY: f32 = 0.18;

/// Response of the camera that a splat was captured with.
///
/// A stored colour in sRGB becomes scene light: the inverse of the curve, divided by its value for the code of mid grey, to the power of the
/// inverse contrast.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraResponse {
    /// Curve of known form.
    pub curve: ResponseCurve,
    /// Power of scene light about mid grey that the curve saw: above 1 for a capture of higher contrast than the scene.
    pub contrast: f32,
}

impl Default for CameraResponse {
    fn default() -> Self {
        Self {
            curve: ResponseCurve::Srgb,
            contrast: 1.0,
        }
    }
}

/// Curve of a camera, a renderer or a video format.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ResponseCurve {
    /// IEC 61966-2-1 alone, as trainers assume.
    #[default]
    Srgb,
    /// None: the splat was trained on linear images.
    Linear,
    /// Camera curve of ITU-R BT.709-6.
    #[serde(rename = "rec709")]
    Rec709,
    /// ACES filmic, the fit of Narkowicz (2015).
    Aces,
    /// AgX (Troy Sobotka, 2022), with the polynomial fit of its contrast curve.
    Agx,
    /// Filmic curve of Hable ("Filmic Tonemapping Operators", 2010), with white at 11.2.
    Hable,
    /// Apple Log (2023). Its primaries are not converted.
    Log,
}

impl ResponseCurve {
    /// All of them, with their names.
    pub const ALL: [(&'static str, Self); 7] = [
        ("sRGB", Self::Srgb),
        ("Linear", Self::Linear),
        ("Rec. 709", Self::Rec709),
        ("ACES", Self::Aces),
        ("AgX", Self::Agx),
        ("Hable", Self::Hable),
        ("Apple Log", Self::Log),
    ];

    /// Scene light of stored colour, at the scale of the curve. Codes above 1 are held to it where the curve ends there.
    fn invert(self, stored: [f32; 3]) -> [f32; 3] {
        let light = match self {
            Self::Srgb => stored.map(srgb_decode),
            Self::Linear => stored,
            Self::Rec709 => stored.map(|v| match v < 0.081 {
                true => v / 4.5,
                false => ((v + 0.099) / 1.099).powf(1.0 / 0.45),
            }),
            Self::Aces => stored.map(|v| {
                let y = srgb_decode(v.min(1.0));
                positive_root([2.43 * y - 2.51, 0.59 * y - 0.03, 0.14 * y])
            }),
            Self::Agx => agx_light(stored),
            Self::Hable => stored.map(hable_light),
            Self::Log => stored.map(apple_log_light),
        };
        light.map(|v| v.max(0.0))
    }
}

/// Root of `a x^2 + b x + c` that is not negative, for `a < 0` and `c >= 0`.
fn positive_root([a, b, c]: [f32; 3]) -> f32 {
    let root = (b * b - 4.0 * a * c).max(0.0).sqrt();
    // Of two forms the one without cancellation.
    match b > 0.0 {
        true => (b + root) / (-2.0 * a),
        false => 2.0 * c / (root - b).max(f32::MIN_POSITIVE),
    }
}

fn hable_light(stored: f32) -> f32 {
    // Shoulder and linear strength, linear angle, toe strength, numerator and denominator.
    let [a, b, c, d, e, f] = [0.15, 0.5, 0.1, 0.2, 0.02, 0.3];
    let curve = |x: f32| (x * (a * x + c * b) + d * e) / (x * (a * x + b) + d * f) - e / f;
    let y = srgb_decode(stored.min(1.0)) * curve(11.2) + e / f;
    // The curve sees twice the light.
    0.5 * positive_root([a * (y - 1.0), b * (y - c), d * (f * y - e)])
}

fn apple_log_light(stored: f32) -> f32 {
    const DARKEST: f32 = -0.056_410_88;
    const BREAK: f32 = 0.01;
    const SQUARE: f32 = 47.287_113;
    let break_code = SQUARE * (BREAK - DARKEST).powi(2);
    match stored < break_code {
        true => (stored.max(0.0) / SQUARE).sqrt() + DARKEST,
        false => ((stored.min(1.0) - 0.693_369_45) / 0.085_504_79).exp2() - 0.009_640_52,
    }
}

fn agx_light(stored: [f32; 3]) -> [f32; 3] {
    /// Steps of the table of the contrast curve's inverse.
    const STEPS: usize = 4096;
    struct Inverse {
        matrices: [Mat3; 2],
        exponents: Vec<f32>,
    }
    static INVERSE: OnceLock<Inverse> = OnceLock::new();
    let inverse = INVERSE.get_or_init(|| {
        let exponent = |step: usize| {
            let curved = step as f32 / STEPS as f32;
            let (mut low, mut high) = (0.0, 1.0);
            for _ in 0..24 {
                let middle = 0.5 * (low + high);
                match agx_contrast(middle) < curved {
                    true => low = middle,
                    false => high = middle,
                }
            }
            0.5 * (low + high)
        };
        Inverse {
            matrices: [AGX_OUTSET, AGX_INSET]
                .map(|rows| Mat3::from_cols_array_2d(&rows).transpose().inverse()),
            exponents: (0..=STEPS).map(exponent).collect(),
        }
    });
    let [after, before] = inverse.matrices;
    let curved = after * Vec3::from_array(stored).min(Vec3::ONE);
    let light = curved.to_array().map(|v| {
        let at = v.clamp(0.0, 1.0) * STEPS as f32;
        let step = (at as usize).min(STEPS - 1);
        let [low, high] = [step, step + 1].map(|i| inverse.exponents[i]);
        let exponent = low + (high - low) * (at - step as f32);
        (AGX_STOPS[0] + exponent * (AGX_STOPS[1] - AGX_STOPS[0])).exp2()
    });
    (before * Vec3::from_array(light)).to_array()
}

impl CameraResponse {
    /// The response of linear colour.
    pub const LINEAR: Self = Self {
        curve: ResponseCurve::Linear,
        contrast: 1.0,
    };

    /// Reads a response, or whether the colour is linear, from a file.
    ///
    /// # Errors
    /// It is neither.
    pub fn of_file<'de, D: Deserializer<'de>>(file: D) -> std::result::Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(
            untagged,
            expecting = "a response {\"curve\", \"contrast\"} is expected"
        )]
        enum Said {
            IsLinear(bool),
            Response(CameraResponse),
        }
        Ok(match Said::deserialize(file)? {
            Said::IsLinear(true) => Self::LINEAR,
            Said::IsLinear(false) => Self::default(),
            Said::Response(response) => response,
        })
    }

    /// True for the one that trainers assume.
    pub fn is_default(&self) -> bool {
        *self == Self::default()
    }

    /// Scene light of the camera's white, where colour of that encoding, already decoded, is clipped there.
    pub fn clipped_at(self, decoded: Encoding) -> Option<f32> {
        (decoded == Encoding::Stored).then(|| self.to_scene_light()([1.0; 3])[0])
    }

    /// Function from stored colour, as it is seen, to scene light.
    pub fn to_scene_light(self) -> impl Fn([f32; 3]) -> [f32; 3] + Sync {
        let grey = self.curve.invert([srgb_encode(MID_GREY); 3])[0];
        let power = 1.0 / self.contrast;
        move |stored| {
            let light = self.curve.invert(stored.map(|v| v.max(0.0)));
            light.map(|v| MID_GREY * (v / grey).powf(power))
        }
    }

    /// Decodes the colours of a splat as they are in its file, in place: they become what a plain sRGB camera, or one without a curve, would have
    /// shown of the scene.
    pub fn decode(mut self, cloud: &mut SurfelCloud) {
        // Of a format that stores linear light there is no curve to undo.
        if cloud.encoding == Encoding::Linear {
            self.curve = ResponseCurve::Linear;
        } else if self.curve == ResponseCurve::Linear {
            cloud.encoding = Encoding::StoredLinear;
        }
        let encoding = cloud.encoding;
        if self.is_default() || self == Self::LINEAR {
            return;
        }
        let to_scene_light = self.to_scene_light();
        pass_through(&mut cloud.sh, cloud.sh_degree, |value| {
            let stored = value.map(|v| v + encoding.offset());
            to_scene_light(stored).map(|v| encoding.encode(v))
        });
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// Says what is expected.
    pub fn validate(&self) -> Result<()> {
        ensure(CONTRASTS.contains(&self.contrast), || {
            let (low, high) = CONTRASTS.into_inner();
            format!(
                "contrast {} of the camera response is out of range {low} to {high}",
                self.contrast
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{Display, ToneMap};
    use crate::synthetic;

    /// A renderer's curve undone gives the scene's light up to a factor.
    #[test]
    fn a_known_curve_is_undone() {
        for (curve, tone_map) in [
            (ResponseCurve::Srgb, ToneMap::Srgb),
            (ResponseCurve::Aces, ToneMap::Aces),
            (ResponseCurve::Agx, ToneMap::Agx),
        ] {
            let shown = |light: [f32; 3]| {
                Display {
                    exposure: 0.0,
                    tone_map,
                }
                .encode(light)
            };
            let response = CameraResponse {
                curve,
                contrast: 1.0,
            };
            let to_scene_light = response.to_scene_light();
            let gain = to_scene_light(shown([0.18; 3]))[0] / 0.18;
            for light in [[0.02, 0.05, 0.03], [0.2, 0.4, 0.1], [0.8, 0.5, 0.7]] {
                let found = to_scene_light(shown(light));
                for c in 0..3 {
                    let ratio = found[c] / (gain * light[c]);
                    assert!((ratio - 1.0).abs() < 0.01, "{curve:?} {light:?} {found:?}");
                }
            }
        }
    }

    #[test]
    fn every_curve_rises_and_keeps_mid_grey() {
        for (name, curve) in ResponseCurve::ALL {
            for contrast in [0.25, 1.0, 1.3, 4.0] {
                let to_scene_light = CameraResponse { curve, contrast }.to_scene_light();
                let grey = to_scene_light([srgb_encode(MID_GREY); 3]);
                assert!(
                    grey.iter().all(|v| (v - MID_GREY).abs() < 1e-3),
                    "{name} {grey:?}"
                );
                let mut last = [0.0; 3];
                for step in 0..=64 {
                    let light = to_scene_light([step as f32 / 64.0; 3]);
                    let rises = (0..3).all(|c| light[c] >= last[c] - 1e-6);
                    assert!(
                        rises && light.iter().all(|v| v.is_finite()),
                        "{name} {light:?}"
                    );
                    last = light;
                }
            }
        }
    }

    /// Contrast is a power: a capture whose linear colours were raised to one is as it was before.
    #[test]
    fn contrast_is_a_power_of_light() {
        let scene = [0.03, 0.18, 0.6];
        let stored = scene.map(|v: f32| srgb_encode(0.18 * (v / 0.18).powf(1.4)));
        let response = CameraResponse {
            contrast: 1.4,
            ..CameraResponse::default()
        };
        let found = response.to_scene_light()(stored);
        for (a, b) in scene.into_iter().zip(found) {
            assert!((a / b - 1.0).abs() < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn plain_captures_are_left_as_they_are() {
        let mut cloud = synthetic::glossy_sphere_over_plate(50, 1);
        cloud.encoding = Encoding::Stored;
        let mut decoded = cloud.clone();
        CameraResponse::default().decode(&mut decoded);
        assert_eq!((&decoded.sh, decoded.encoding), (&cloud.sh, cloud.encoding));
        CameraResponse::LINEAR.decode(&mut decoded);
        assert_eq!(decoded.sh, cloud.sh);
        assert_eq!(decoded.encoding, Encoding::StoredLinear);
    }
}
