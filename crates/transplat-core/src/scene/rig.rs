//! Lights of one's own: what a photographer puts around an object.

use std::path::PathBuf;

use glam::{Affine3A, DVec3};
use serde::{Deserialize, Serialize};

use super::light::{EVEN, EnvironmentLight, MOST_TINT, STOPS};
use crate::color::luminance;
use crate::environment::{Beam, Emitter, Illumination, Shape};
use crate::error::{Error, Result, ensure};
use crate::surfels::UpAxis;

/// A light of one's own, beside the environment.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Written", into = "Written")]
pub struct Light {
    /// For the user.
    pub name: String,
    /// Whether it shines.
    pub on: bool,
    /// Where any light is solo, only those that are shine, and no environment.
    pub solo: bool,
    /// Strength in stops, on top of its emission.
    pub strength: f32,
    /// Colour that its emission is multiplied by, linear.
    pub tint: [f32; 3],
    /// Colour of a black body of that temperature, on top; none is white.
    pub kelvin: Option<f32>,
    /// Where it is, in the Z-up world and the objects' unit, and what it emits, linear RGB in the unit of the pictures.
    pub source: LightSource,
}

/// Where a light is, how it spreads, and what it emits.
#[derive(Clone, Debug, PartialEq)]
pub enum LightSource {
    /// From one direction.
    Directional {
        /// Unit vector towards it.
        to_light: DVec3,
        /// On a surface that faces it, W/m².
        irradiance: [f32; 3],
        /// How wide it is seen, in degrees; the sun's is 0.53. At 0 its shadows are crisp.
        angle_deg: f64,
    },
    /// All around from a point.
    Point {
        /// Where.
        position: DVec3,
        /// W/sr.
        intensity: [f32; 3],
    },
    /// A cone from a point.
    Spot {
        /// Where.
        position: DVec3,
        /// Unit vector along which it shines.
        direction: DVec3,
        /// On its axis, W/sr.
        intensity: [f32; 3],
        /// Angle from the axis from which on it has no light, in degrees.
        cutoff_deg: f64,
        /// And up to which it has all; between them it falls with the angle.
        beam_deg: f64,
    },
    /// A soft box.
    Rect {
        /// Its middle.
        center: DVec3,
        /// Its edges, whole.
        edges: [DVec3; 2],
        /// Unit vector on the side where it shines.
        normal: DVec3,
        /// W/m²/sr.
        radiance: [f32; 3],
    },
    /// A round one.
    Disc {
        /// Its middle.
        center: DVec3,
        /// Its radius.
        radius: f64,
        /// Unit vector on the side where it shines.
        normal: DVec3,
        /// W/m²/sr.
        radiance: [f32; 3],
    },
}

/// Temperatures that a black body's colour is told of.
pub const KELVIN: std::ops::RangeInclusive<f32> = 1000.0..=40_000.0;

/// No place of a light is farther away, in the objects' unit, and none emits more in a channel.
const FARTHEST: f64 = 1e12;
const BRIGHTEST: f32 = 1e30;

impl Light {
    /// As it is.
    pub fn of(source: LightSource) -> Self {
        Self {
            name: String::new(),
            on: true,
            solo: false,
            strength: 0.0,
            tint: [1.0; 3],
            kelvin: None,
            source,
        }
    }

    /// What its emission is multiplied by.
    pub fn gain(&self) -> [f32; 3] {
        let colored = self.kelvin.map_or([1.0; 3], black_body);
        std::array::from_fn(|c| self.tint[c] * colored[c] * self.strength.exp2())
    }

    /// Adds it to what an asset with that up axis is lit by, if it is on.
    pub fn add_to(&self, light: &mut Illumination, asset_up: UpAxis) {
        if !self.on {
            return;
        }
        let to_asset = asset_up.asset_from_world();
        if let LightSource::Directional {
            to_light,
            irradiance,
            angle_deg,
        } = &self.source
            && *angle_deg == 0.0
        {
            let gain = self.gain();
            return light.add(Beam {
                direction: (to_asset * *to_light).as_vec3(),
                energy: std::array::from_fn(|c| irradiance[c] * gain[c]),
            });
        }
        let emitter = self
            .emitter()
            .moved(Affine3A::from_mat3(to_asset.as_mat3()));
        light.emitters.push(emitter);
    }

    /// It in the Z-up world.
    pub fn emitter(&self) -> Emitter {
        let (shape, emission) = match self.source.clone() {
            LightSource::Directional {
                to_light,
                irradiance,
                angle_deg,
            } => {
                let shape = Shape::Distant {
                    toward: to_light.as_vec3(),
                    radius: (0.5 * angle_deg).to_radians() as f32,
                };
                (shape, irradiance)
            }
            LightSource::Point {
                position,
                intensity,
            } => {
                let position = position.as_vec3();
                (Shape::Point { position }, intensity)
            }
            LightSource::Spot {
                position,
                direction,
                intensity,
                cutoff_deg,
                beam_deg,
            } => {
                let shape = Shape::Spot {
                    position: position.as_vec3(),
                    axis: direction.as_vec3(),
                    beam: beam_deg.to_radians() as f32,
                    cutoff: cutoff_deg.to_radians() as f32,
                };
                (shape, intensity)
            }
            LightSource::Rect {
                center,
                edges,
                normal,
                radiance,
            } => {
                let shape = Shape::Area {
                    center: center.as_vec3(),
                    half: edges.map(|e| (0.5 * e).as_vec3()),
                    normal: normal.as_vec3(),
                    is_round: false,
                };
                (shape, radiance)
            }
            LightSource::Disc {
                center,
                radius,
                normal,
                radiance,
            } => {
                let (u, v) = normal.any_orthonormal_pair();
                let shape = Shape::Area {
                    center: center.as_vec3(),
                    half: [u, v].map(|axis| (radius * axis).as_vec3()),
                    normal: normal.as_vec3(),
                    is_round: true,
                };
                (shape, radiance)
            }
        };
        Emitter { shape, emission }.tinted(self.gain())
    }

    pub(super) fn validate(&self) -> Result<()> {
        let strength = self.strength;
        ensure(STOPS.contains(&strength), || {
            format!("strength {strength} is out of range -60 to 60 stops")
        })?;
        let tints = 0.0..=MOST_TINT;
        ensure(self.tint.iter().all(|t| tints.contains(t)), || {
            "tint is out of range 0 to 1000".into()
        })?;
        ensure(self.kelvin.is_none_or(|k| KELVIN.contains(&k)), || {
            "kelvin is out of range 1000 to 40000".into()
        })?;
        let (places, directions, emission) = self.source.parts();
        ensure(
            places.iter().all(|p| p.abs().max_element() <= FARTHEST),
            || format!("it is farther away than {FARTHEST:e}, or nowhere"),
        )?;
        ensure(
            directions.iter().all(|d| (d.length() - 1.0).abs() < 1e-3),
            || "its direction has no length, or is not a number".into(),
        )?;
        ensure(
            emission.iter().all(|e| (0.0..=BRIGHTEST).contains(e)),
            || format!("what it emits is out of range 0 to {BRIGHTEST:e}"),
        )?;
        match self.source {
            LightSource::Directional { angle_deg, .. } => {
                ensure((0.0..=90.0).contains(&angle_deg), || {
                    format!("angle_deg {angle_deg} is out of range 0 to 90")
                })
            }
            LightSource::Spot {
                cutoff_deg,
                beam_deg,
                ..
            } => ensure(
                (0.0..=180.0).contains(&cutoff_deg) && (0.0..=cutoff_deg).contains(&beam_deg),
                || {
                    format!(
                        "beam_deg {beam_deg} and cutoff_deg {cutoff_deg} are to be 0 to 180 from the axis, the beam within the cutoff"
                    )
                },
            ),
            _ => Ok(()),
        }
    }
}

impl LightSource {
    /// What the file calls it.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Directional { .. } => "directional",
            Self::Point { .. } => "point",
            Self::Spot { .. } => "spot",
            Self::Rect { .. } => "rect",
            Self::Disc { .. } => "disc",
        }
    }

    /// Its places and lengths, its directions, and what it emits.
    fn parts(&self) -> (Vec<DVec3>, Vec<DVec3>, [f32; 3]) {
        match self.clone() {
            Self::Directional {
                to_light,
                irradiance,
                ..
            } => (vec![], vec![to_light], irradiance),
            Self::Point {
                position,
                intensity,
            } => (vec![position], vec![], intensity),
            Self::Spot {
                position,
                direction,
                intensity,
                ..
            } => (vec![position], vec![direction], intensity),
            Self::Rect {
                center,
                edges: [u, v],
                normal,
                radiance,
            } => (vec![center, u, v], vec![normal], radiance),
            Self::Disc {
                center,
                radius,
                normal,
                radiance,
            } => (vec![center, DVec3::splat(radius)], vec![normal], radiance),
        }
    }
}

/// Linear colour of a black body, of luminance 1: Planck's law seen by the observer of CIE 1931, in the fit of Wyman, Sloan and Shirley
/// ("Simple Analytic Approximations to the CIE XYZ Color Matching Functions", 2013). What Rec. 709 cannot show is 0.
pub fn black_body(kelvin: f32) -> [f32; 3] {
    let lobe = |nm: f64, height: f64, middle: f64, widths: [f64; 2]| {
        let off = (nm - middle) / widths[usize::from(nm >= middle)];
        height * (-0.5 * off * off).exp()
    };
    let mut xyz = DVec3::ZERO;
    for step in 0..=95 {
        let nm = 360.0 + 5.0 * f64::from(step);
        let meters = nm * 1e-9;
        let power = meters.powi(-5) / ((0.014_387_77 / (meters * f64::from(kelvin))).exp() - 1.0);
        xyz += power
            * DVec3::new(
                lobe(nm, 1.056, 599.8, [37.9, 31.0])
                    + lobe(nm, 0.362, 442.0, [16.0, 26.7])
                    + lobe(nm, -0.065, 501.1, [20.4, 26.2]),
                lobe(nm, 0.821, 568.8, [46.9, 40.5]) + lobe(nm, 0.286, 530.9, [16.3, 31.1]),
                lobe(nm, 1.217, 437.0, [11.8, 36.0]) + lobe(nm, 0.681, 459.0, [26.0, 13.8]),
            );
    }
    let DVec3 { x, y, z } = xyz / xyz.y;
    let rgb = [
        3.240_970 * x - 1.537_383 * y - 0.498_611 * z,
        -0.969_244 * x + 1.875_968 * y + 0.041_555 * z,
        0.055_630 * x - 0.203_977 * y + 1.056_972 * z,
    ];
    let rgb = rgb.map(|v| v.max(0.0) as f32);
    let one = luminance(rgb);
    rgb.map(|v| v / one)
}

/// A light as files have it; what it does not need is left out.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Written {
    #[serde(rename = "type")]
    kind: String,
    #[serde(skip_serializing_if = "String::is_empty")]
    name: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    on: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    solo: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    strength: Option<f32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    tint: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    kelvin: Option<f32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    position: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    center: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    target: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    direction: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    to_light: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    normal: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    edge_u: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    edge_v: Option<DVec3>,
    #[serde(skip_serializing_if = "Option::is_none")]
    radius: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    angle_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    beam_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cutoff_deg: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    irradiance: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    intensity: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    radiance: Option<[f32; 3]>,
}

impl TryFrom<Written> for Light {
    type Error = String;

    fn try_from(of: Written) -> std::result::Result<Self, String> {
        let kind = of.kind.as_str();
        let missing = |what: &str| format!("a light of type {kind:?} needs {what}");
        let unit = |v: DVec3| v.normalize_or_zero();
        // One that is said twice is taken as its place and aim say.
        let along = match (of.position, of.target, of.direction) {
            (Some(position), Some(target), _) => Some(target - position),
            (_, _, direction) => direction,
        };
        let toward = of.to_light.or(of.direction.map(|d| -d));
        let source = match kind {
            "directional" => LightSource::Directional {
                to_light: unit(toward.ok_or_else(|| missing("\"to_light\" or \"direction\""))?),
                irradiance: of.irradiance.ok_or_else(|| missing("\"irradiance\""))?,
                angle_deg: of.angle_deg.unwrap_or(0.0),
            },
            "point" => LightSource::Point {
                position: of.position.ok_or_else(|| missing("\"position\""))?,
                intensity: of.intensity.ok_or_else(|| missing("\"intensity\""))?,
            },
            "spot" => {
                let cutoff_deg = of.cutoff_deg.ok_or_else(|| missing("\"cutoff_deg\""))?;
                LightSource::Spot {
                    position: of.position.ok_or_else(|| missing("\"position\""))?,
                    direction: unit(along.ok_or_else(|| missing("\"direction\" or \"target\""))?),
                    intensity: of.intensity.ok_or_else(|| missing("\"intensity\""))?,
                    cutoff_deg,
                    beam_deg: of.beam_deg.unwrap_or(cutoff_deg),
                }
            }
            "rect" => {
                let u = of.edge_u.ok_or_else(|| missing("\"edge_u\""))?;
                let v = of.edge_v.ok_or_else(|| missing("\"edge_v\""))?;
                LightSource::Rect {
                    center: of.center.ok_or_else(|| missing("\"center\""))?,
                    edges: [u, v],
                    normal: unit(of.normal.unwrap_or(u.cross(v))),
                    radiance: of.radiance.ok_or_else(|| missing("\"radiance\""))?,
                }
            }
            "disc" => LightSource::Disc {
                center: of.center.ok_or_else(|| missing("\"center\""))?,
                radius: of.radius.ok_or_else(|| missing("\"radius\""))?,
                normal: unit(of.normal.ok_or_else(|| missing("\"normal\""))?),
                radiance: of.radiance.ok_or_else(|| missing("\"radiance\""))?,
            },
            other => {
                return Err(format!(
                    "lights are of type directional, point, spot, rect or disc, not {other:?}"
                ));
            }
        };
        Ok(Self {
            name: of.name,
            on: of.on.unwrap_or(true),
            solo: of.solo.unwrap_or(false),
            strength: of.strength.unwrap_or(0.0),
            tint: of.tint.unwrap_or([1.0; 3]),
            kelvin: of.kelvin,
            source,
        })
    }
}

impl From<Light> for Written {
    fn from(light: Light) -> Self {
        let head = Self {
            kind: light.source.kind().into(),
            name: light.name,
            on: (!light.on).then_some(false),
            solo: light.solo.then_some(true),
            strength: (light.strength != 0.0).then_some(light.strength),
            tint: (light.tint != [1.0; 3]).then_some(light.tint),
            kelvin: light.kelvin,
            ..Self::default()
        };
        match light.source {
            LightSource::Directional {
                to_light,
                irradiance,
                angle_deg,
            } => Self {
                to_light: Some(to_light),
                irradiance: Some(irradiance),
                angle_deg: (angle_deg != 0.0).then_some(angle_deg),
                ..head
            },
            LightSource::Point {
                position,
                intensity,
            } => Self {
                position: Some(position),
                intensity: Some(intensity),
                ..head
            },
            LightSource::Spot {
                position,
                direction,
                intensity,
                cutoff_deg,
                beam_deg,
            } => Self {
                position: Some(position),
                direction: Some(direction),
                intensity: Some(intensity),
                cutoff_deg: Some(cutoff_deg),
                beam_deg: Some(beam_deg),
                ..head
            },
            LightSource::Rect {
                center,
                edges: [u, v],
                normal,
                radiance,
            } => Self {
                center: Some(center),
                edge_u: Some(u),
                edge_v: Some(v),
                normal: Some(normal),
                radiance: Some(radiance),
                ..head
            },
            LightSource::Disc {
                center,
                radius,
                normal,
                radiance,
            } => Self {
                center: Some(center),
                radius: Some(radius),
                normal: Some(normal),
                radiance: Some(radiance),
                ..head
            },
        }
    }
}

/// Lights, and what is around them, as a file of their own.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// For the user.
    #[serde(default)]
    pub name: String,
    /// The lights.
    pub lights: Vec<Light>,
    /// What shines from all around; where it is not named, whatever does already.
    #[serde(default, deserialize_with = "named")]
    pub environment: Option<Around>,
    /// For whom it was made; nothing here follows it.
    #[serde(default)]
    pub object: serde::de::IgnoredAny,
    /// How it was exposed; nothing here follows it.
    #[serde(default)]
    pub exposure: serde::de::IgnoredAny,
}

/// What shines from all around the lights of a [`Rig`].
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(rename_all = "lowercase", deny_unknown_fields)]
pub enum Around {
    /// Nothing; `null` in the file.
    #[serde(skip)]
    Nothing,
    /// The same radiance from everywhere, linear RGB.
    #[serde(untagged)]
    Uniform {
        /// That radiance.
        uniform: [f32; 3],
    },
    /// An environment's picture, its radiance multiplied.
    #[serde(untagged)]
    File {
        /// Where it is, as seen from the rig's folder.
        file: PathBuf,
        /// By what.
        #[serde(default = "one")]
        scale: f32,
    },
}

fn one() -> f32 {
    1.0
}

/// What is named, if only to be nothing.
fn named<'de, D: serde::Deserializer<'de>>(
    from: D,
) -> std::result::Result<Option<Around>, D::Error> {
    let around = Option::<Around>::deserialize(from)?;
    Ok(Some(around.unwrap_or(Around::Nothing)))
}

impl Around {
    /// It as the environment of a scene, which keeps its turn; a file is found by `find`.
    pub fn over(
        &self,
        before: &EnvironmentLight,
        find: impl Fn(&PathBuf) -> PathBuf,
    ) -> Result<EnvironmentLight> {
        let even = |tint: [f32; 3]| EnvironmentLight {
            tint,
            ..EnvironmentLight::of(EVEN)
        };
        match self {
            Self::Nothing => Ok(even([0.0; 3])),
            Self::Uniform { uniform } => Ok(even(*uniform)),
            Self::File { file, scale } => {
                ensure(*scale > 0.0 && scale.is_finite(), || {
                    format!("the environment's scale {scale} is not above 0")
                })?;
                let mut light = before.clone();
                light.set_file(find(file));
                light.strength = scale.log2();
                Ok(light)
            }
        }
    }
}

/// Tells which of some lights is wrong.
pub(super) fn validate_all(lights: &[Light]) -> Result<()> {
    for (at, light) in lights.iter().enumerate() {
        light.validate().map_err(|why| {
            let kind = light.source.kind();
            Error::Mismatch(format!("light {} ({kind}): {why}", at + 1))
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> std::result::Result<Light, String> {
        serde_json::from_str(text).map_err(|e| e.to_string())
    }

    #[test]
    fn a_light_comes_back_as_it_was_written() {
        for text in [
            r#"{"type": "point", "position": [0.1, 2, 3], "intensity": [1, 2, 3], "name": "key", "on": false, "kelvin": 3200}"#,
            r#"{"type": "spot", "position": [0, 0, 2], "target": [0, 0, 0], "intensity": [1, 1, 1], "cutoff_deg": 30, "beam_deg": 10}"#,
            r#"{"type": "rect", "center": [0, 0, 2], "edge_u": [1, 0, 0], "edge_v": [0, -1, 0], "radiance": [5, 5, 5], "strength": -1.5}"#,
            r#"{"type": "disc", "center": [0, 0, 2], "radius": 0.4, "normal": [0, 0, -2], "radiance": [5, 5, 5], "solo": true}"#,
            r#"{"type": "directional", "direction": [0, 0, -1], "irradiance": [5, 5, 5], "angle_deg": 0.53, "tint": [1, 0.5, 0.25]}"#,
        ] {
            let light = parsed(text).expect(text);
            assert!(light.validate().is_ok(), "{text}");
            let again = serde_json::to_string(&light).expect("numbers and names");
            assert_eq!(parsed(&again), Ok(light), "{again}");
        }
    }

    #[test]
    fn a_wrong_light_says_what_is_wrong() {
        for (text, what) in [
            (
                r#"{"type": "lamp"}"#,
                "directional, point, spot, rect or disc",
            ),
            (
                r#"{"type": "point", "position": [0, 0, 1]}"#,
                "\"intensity\"",
            ),
            (r#"{"type": "point", "postion": [0, 0, 1]}"#, "postion"),
            (
                r#"{"type": "spot", "position": [0, 0, 1], "intensity": [1, 1, 1], "cutoff_deg": 9}"#,
                "\"target\"",
            ),
        ] {
            let why = parsed(text).expect_err(text);
            assert!(why.contains(what), "{why}");
        }
        for (text, what) in [
            (
                r#"{"type": "point", "position": [0, 0, 1e20], "intensity": [1, 1, 1]}"#,
                "farther",
            ),
            (
                r#"{"type": "point", "position": [0, 0, 1], "intensity": [1, -1, 1]}"#,
                "emits",
            ),
            (
                r#"{"type": "directional", "to_light": [0, 0, 0], "irradiance": [1, 1, 1]}"#,
                "direction",
            ),
            (
                r#"{"type": "spot", "position": [0, 0, 1], "direction": [0, 0, -1], "intensity": [1, 1, 1], "cutoff_deg": 9, "beam_deg": 10}"#,
                "beam",
            ),
        ] {
            let why = validate_all(&[parsed(text).expect(text)])
                .expect_err(text)
                .to_string();
            assert!(why.contains(what) && why.contains("light 1"), "{why}");
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

    #[test]
    fn a_rig_says_what_is_around_it_or_leaves_that() {
        let rig = |around: &str| -> std::result::Result<Rig, _> {
            serde_json::from_str(&format!(
                r#"{{"lights": [], "object": "knot", "exposure": {{"a": 1}}{around}}}"#
            ))
        };
        let around = |text: &str| rig(text).expect(text).environment;
        assert_eq!(around(""), None);
        assert_eq!(around(r#", "environment": null"#), Some(Around::Nothing));
        let uniform = Around::Uniform {
            uniform: [0.1, 0.2, 0.3],
        };
        assert_eq!(
            around(r#", "environment": {"uniform": [0.1, 0.2, 0.3]}"#),
            Some(uniform)
        );
        let file = Around::File {
            file: "a.hdr".into(),
            scale: 4.0,
        };
        assert_eq!(
            around(r#", "environment": {"file": "a.hdr", "scale": 4}"#),
            Some(file.clone())
        );
        let before = EnvironmentLight {
            rotation: 30.0,
            ..EnvironmentLight::of("b.hdr")
        };
        let over = file
            .over(&before, |f| PathBuf::from("x").join(f))
            .expect("a scale");
        assert_eq!(
            (over.file, over.strength, over.rotation),
            (Some("x/a.hdr".into()), 2.0, 30.0)
        );
        let dark = Around::Nothing
            .over(&before, PathBuf::clone)
            .expect("nothing");
        assert_eq!(dark.gain(), [0.0; 3]);
        assert!(rig(r#", "enviroment": null"#).is_err());
    }
}
