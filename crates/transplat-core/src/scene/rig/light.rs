//! Placed lights: sun, point, spot, and area lights.

use glam::{Affine3A, DVec3};
use serde::{Deserialize, Serialize};

use crate::color::black_body;
use crate::environment::{Emitter, Illumination, LightSample, MOST_LIGHTS, Shape};
use crate::error::{Error, Result, ensure};
use crate::scene::light::{MOST_TINT, STOPS};
use crate::surfels::UpAxis;

/// A light of one's own, beside the environment.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// For the user.
    pub name: String,
    /// True where it shines.
    pub on: bool,
    /// Where any light is solo, only those that are shine, and no environment.
    pub solo: bool,
    /// Strength in stops, on top of its emission.
    pub strength: f32,
    /// Colour that its emission is multiplied by, linear.
    pub tint: [f32; 3],
    /// Colour of a black body of that temperature, on top; none is white.
    pub kelvin: Option<f32>,
    /// Parent that it moves along with.
    pub fixed_to: FixedTo,
    /// Where it is, in the Z-up world and the objects' unit, and what it emits, linear RGB in the unit of the pictures.
    pub source: LightSource,
}

/// Parent of a light. Its place is in the world's coordinates all the same.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FixedTo {
    /// Nothing: it stays where it stands.
    #[default]
    World,
    /// Where the objects are seen from.
    Camera,
    /// An object of the scene, by its number from 0.
    Object(usize),
}

impl FixedTo {
    /// Parent once an object is taken out of the scene.
    #[must_use]
    pub fn without_object(self, gone: usize) -> Self {
        match self {
            Self::Object(of) if of == gone => Self::World,
            Self::Object(of) if of > gone => Self::Object(of - 1),
            other => other,
        }
    }
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
        /// Angular diameter, in degrees; the sun's is 0.53. At 0 its shadows are crisp.
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
        /// Angle up to which it has all; between them it falls with the angle.
        beam_deg: f64,
        /// Distance to its target along its direction; none where that is not set.
        reach: Option<f64>,
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
        /// Distance to its target along its direction; none where that is not set.
        reach: Option<f64>,
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
        /// Distance to its target along its direction; none where that is not set.
        reach: Option<f64>,
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
            fixed_to: FixedTo::World,
            source,
        }
    }

    /// Factor of its emission.
    pub fn gain(&self) -> [f32; 3] {
        let colored = self.kelvin.map_or([1.0; 3], black_body);
        std::array::from_fn(|c| self.tint[c] * colored[c] * self.strength.exp2())
    }

    /// True where it comes from one direction alone, without a disc.
    pub fn is_directional_sample(&self) -> bool {
        matches!(self.source, LightSource::Directional { angle_deg, .. } if angle_deg == 0.0)
    }

    /// Adds it to what an asset with that up axis is lit by.
    pub fn add_to(&self, light: &mut Illumination, asset_up: UpAxis) {
        let to_asset = asset_up.asset_from_world();
        if let LightSource::Directional {
            to_light,
            irradiance,
            ..
        } = &self.source
            && self.is_directional_sample()
        {
            let gain = self.gain();
            return light.add(LightSample {
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
                ..
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
                ..
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
                ..
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

    fn validate(&self) -> Result<()> {
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
        ensure(
            self.source
                .reach()
                .is_none_or(|r| (0.0..=FARTHEST).contains(&r)),
            || "reach is out of range 0 to 1e12".into(),
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
                        "beam_deg {beam_deg} and cutoff_deg {cutoff_deg} must be 0 to 180 from the axis, the beam within the cutoff"
                    )
                },
            ),
            LightSource::Disc { radius, .. } => ensure(radius >= 0.0, || {
                format!("radius {radius} is less than nothing")
            }),
            LightSource::Point { .. } | LightSource::Rect { .. } => Ok(()),
        }
    }
}

impl LightSource {
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
                ..
            } => (vec![center, u, v], vec![normal], radiance),
            Self::Disc {
                center,
                radius,
                normal,
                radiance,
                ..
            } => (vec![center, DVec3::splat(radius)], vec![normal], radiance),
        }
    }
}

/// Tells which of some lights is wrong, or that they are too many.
pub fn validate_all(lights: &[Light]) -> Result<()> {
    ensure(lights.len() <= MOST_LIGHTS, || {
        format!("more than {MOST_LIGHTS} lights")
    })?;
    for (at, light) in lights.iter().enumerate() {
        light.validate().map_err(|why| {
            let kind = light.source.kind().name();
            Error::Mismatch(format!("light {} ({kind}): {why}", at + 1))
        })?;
    }
    Ok(())
}
