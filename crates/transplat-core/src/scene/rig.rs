//! Rig: placed lights with the environment around them, as a file.

mod light;
mod placing;
mod presets;
mod written;

use std::path::PathBuf;

use serde::de::{Error as _, IgnoredAny};
use serde::{Deserialize, Serialize};

use super::light::{EVEN, EnvironmentLight, MOST_TINT, SKY};
use crate::environment::Sky;
use crate::error::{Result, ensure};
pub(super) use light::validate_all;
pub use light::{FixedTo, KELVIN, Light, LightSource};
pub use placing::{LightKind, Placed, SUN_DEG};
pub use presets::{KEY, RigPreset, RigTarget};

/// Lights, and what is around them, as a file of their own.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// The lights.
    #[serde(default)]
    pub lights: Vec<Light>,
    /// Environment around the lights; none leaves the one that is there.
    #[serde(
        default,
        deserialize_with = "named",
        serialize_with = "written",
        skip_serializing_if = "Option::is_none"
    )]
    pub environment: Option<Around>,
    // What it is called, for what it was made and how it was exposed: nothing here follows that.
    #[serde(default, rename = "name", skip_serializing)]
    _name: IgnoredAny,
    #[serde(default, rename = "object", skip_serializing)]
    _object: IgnoredAny,
    #[serde(default, rename = "exposure", skip_serializing)]
    _exposure: IgnoredAny,
}

impl Rig {
    /// Checks its lights and what is around them.
    ///
    /// # Errors
    /// Says which of them is wrong.
    pub fn validate(&self) -> Result<()> {
        validate_all(&self.lights)?;
        match &self.environment {
            Some(Around::Sky { sky }) => sky.validate(),
            Some(Around::Uniform { uniform }) => {
                let in_range = |v| (0.0..=MOST_TINT).contains(v);
                ensure(uniform.iter().all(in_range), || {
                    format!(
                        "the environment's \"uniform\" {uniform:?} is out of range 0 to {MOST_TINT}"
                    )
                })
            }
            Some(Around::File { scale, .. }) => ensure(*scale > 0.0 && scale.is_finite(), || {
                format!("the environment's scale {scale} is not above 0")
            }),
            _ => Ok(()),
        }
    }

    /// Rig of lights, and the environment around them.
    pub fn of(lights: Vec<Light>, environment: Option<Around>) -> Self {
        Self {
            lights,
            environment,
            ..Self::default()
        }
    }
}

/// Environment around the lights of a [`Rig`].
#[derive(Clone, Debug, PartialEq)]
pub enum Around {
    /// Nothing; `null` in the file.
    Nothing,
    /// Uniform radiance, linear RGB.
    Uniform {
        /// Radiance from everywhere.
        uniform: [f32; 3],
    },
    /// Sun and sky.
    Sky {
        /// Which.
        sky: Sky,
    },
    /// An environment's picture, its radiance multiplied.
    File {
        /// Where it is, as seen from the rig's folder.
        file: PathBuf,
        /// By what.
        scale: f32,
    },
}

/// It as files have it: one of its parts.
#[derive(Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct AroundWritten {
    #[serde(skip_serializing_if = "Option::is_none")]
    uniform: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    sky: Option<Sky>,
    #[serde(skip_serializing_if = "Option::is_none")]
    file: Option<PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scale: Option<f32>,
}

impl AroundWritten {
    fn of(around: &Around) -> Option<Self> {
        let none = Self::default();
        Some(match around.clone() {
            Around::Nothing => return None,
            Around::Uniform { uniform } => Self {
                uniform: Some(uniform),
                ..none
            },
            Around::Sky { sky } => Self {
                sky: Some(sky),
                ..none
            },
            Around::File { file, scale } => Self {
                file: Some(file),
                scale: Some(scale),
                ..none
            },
        })
    }

    fn around(self) -> std::result::Result<Around, &'static str> {
        match (self.uniform, self.sky, self.file, self.scale) {
            (Some(uniform), None, None, None) => Ok(Around::Uniform { uniform }),
            (None, Some(sky), None, None) => Ok(Around::Sky { sky }),
            (None, None, Some(file), scale) => Ok(Around::File {
                file,
                scale: scale.unwrap_or(1.0),
            }),
            _ => Err(
                "the environment of a rig is null, or has one of \"uniform\", \"sky\" and \"file\" (with its \"scale\")",
            ),
        }
    }
}

/// Reads a field that is named, if only to be nothing.
fn named<'de, D: serde::Deserializer<'de>>(
    from: D,
) -> std::result::Result<Option<Around>, D::Error> {
    let written = Option::<AroundWritten>::deserialize(from)?;
    let around = written.map_or(Ok(Around::Nothing), AroundWritten::around);
    around.map(Some).map_err(D::Error::custom)
}

/// Nothing is `null` there.
fn written<S: serde::Serializer>(
    around: &Option<Around>,
    to: S,
) -> std::result::Result<S::Ok, S::Error> {
    around.as_ref().and_then(AroundWritten::of).serialize(to)
}

impl RigPreset {
    /// The rig around what it is to light.
    pub fn rig(self, lit: RigTarget) -> Rig {
        let (lights, uniform) = self.lights(lit);
        Rig::of(lights, Some(Around::Uniform { uniform }))
    }
}

impl Around {
    /// It as the environment of a scene, which keeps its turn; a file is found by `find`.
    pub fn over(
        &self,
        before: &EnvironmentLight,
        find: impl Fn(&PathBuf) -> PathBuf,
    ) -> EnvironmentLight {
        let even = |tint: [f32; 3]| EnvironmentLight {
            tint,
            ..EnvironmentLight::of(EVEN)
        };
        match self {
            Self::Nothing => even([0.0; 3]),
            Self::Uniform { uniform } => even(*uniform),
            Self::Sky { sky } => EnvironmentLight {
                rotation: before.rotation,
                sky: Some(*sky),
                ..EnvironmentLight::of(SKY)
            },
            Self::File { file, scale } => {
                let mut light = before.clone();
                light.set_file(find(file));
                light.strength = scale.log2();
                light
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rig_says_what_is_around_it_or_leaves_that() {
        let rig = |around: &str| -> std::result::Result<Rig, String> {
            let text =
                format!(r#"{{"lights": [], "object": "knot", "exposure": {{"a": 1}}{around}}}"#);
            let rig: Rig = serde_json::from_str(&text).map_err(|e| e.to_string())?;
            rig.validate().map_err(|e| e.to_string())?;
            Ok(rig)
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
        let over = file.over(&before, |f| PathBuf::from("x").join(f));
        assert_eq!(
            (over.file, over.strength, over.rotation),
            (Some("x/a.hdr".into()), 2.0, 30.0)
        );
        let dark = Around::Nothing.over(&before, PathBuf::clone);
        assert_eq!(dark.gain(), [0.0; 3]);
        assert!(rig(r#", "enviroment": null"#).is_err());
        for (around, what) in [
            (r#"{"uniform": [1, 1]}"#, "length 2"),
            (r#"{"uniform": [1, -1, 1]}"#, "\"uniform\""),
            (r#"{"uniform": [1, 1, 1], "file": "a.hdr"}"#, "one of"),
            (
                r#"{"sky": {"sun": {"latitude": 50, "longitude": 9, "date": "2026-02-31", "hour": 3}}}"#,
                "2026-02-31",
            ),
            (r#"{"sky": {"sun": {"azimuth": 50}}}"#, "elevation"),
            (r#"{"file": "a.hdr", "scale": 0}"#, "scale 0"),
        ] {
            let why = rig(&format!(r#", "environment": {around}"#));
            let why = why.expect_err(around);
            assert!(why.contains(what), "{why}");
        }
        // And comes back as it was written.
        let sky = Around::Sky {
            sky: Sky::default(),
        };
        for around in [None, Some(Around::Nothing), Some(file), Some(sky)] {
            let rig = Rig::of(Vec::new(), around);
            let text = serde_json::to_string(&rig).expect("plain data");
            assert_eq!(serde_json::from_str::<Rig>(&text).expect(&text), rig);
        }
    }
}
