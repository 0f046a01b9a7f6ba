//! Rigs: lights of one's own with what is around them, as a file.

mod light;
mod written;

use std::path::PathBuf;

use serde::Deserialize;
use serde::de::IgnoredAny;

use super::light::{EVEN, EnvironmentLight};
use crate::error::{Result, ensure};
pub(super) use light::validate_all;
pub use light::{KELVIN, Light, LightSource};

/// Lights, and what is around them, as a file of their own.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// The lights.
    pub lights: Vec<Light>,
    /// What shines from all around; where it is not named, whatever does already.
    #[serde(default, deserialize_with = "named")]
    pub environment: Option<Around>,
    // What it is called, for what it was made and how it was exposed: nothing here follows that.
    #[serde(default, rename = "name")]
    _name: IgnoredAny,
    #[serde(default, rename = "object")]
    _object: IgnoredAny,
    #[serde(default, rename = "exposure")]
    _exposure: IgnoredAny,
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

#[cfg(test)]
mod tests {
    use super::*;

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
