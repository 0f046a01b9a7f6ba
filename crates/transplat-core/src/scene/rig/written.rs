//! Placed lights as files have them.

use glam::DVec3;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::light::{FixedTo, Light, LightSource};

impl Serialize for Light {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        LightRecord::from(self.clone()).serialize(to)
    }
}

impl<'de> Deserialize<'de> for Light {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        let written = LightRecord::deserialize(from)?;
        written.light().map_err(D::Error::custom)
    }
}

/// A light as files have it; what it does not need is left out.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct LightRecord {
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
    fixed_to: Option<FixedTo>,
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
    reach: Option<f64>,
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

impl LightRecord {
    /// The light; says what is missing.
    pub fn light(self) -> Result<Light, String> {
        let of = self;
        let kind = of.kind.as_str();
        let missing = |what: &str| format!("a light of type {kind:?} needs {what}");
        let unit = |v: DVec3| v.normalize_or_zero();
        // One that is said twice is taken as its place and aim say.
        let along = match (of.position, of.target, of.direction) {
            (Some(position), Some(target), _) => Some(target - position),
            (_, _, direction) => direction,
        };
        let to_target = |from: Option<DVec3>| Some(from?.distance(of.target?));
        let reach = |from| of.reach.or_else(|| to_target(from));
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
                    reach: reach(of.position),
                }
            }
            "rect" => {
                let u = of.edge_u.ok_or_else(|| missing("\"edge_u\""))?;
                let v = of.edge_v.ok_or_else(|| missing("\"edge_v\""))?;
                let told = unit(of.normal.unwrap_or(u.cross(v)));
                // It tells the side; where it points is the edges' matter.
                let across = u.cross(v).normalize_or(told);
                LightSource::Rect {
                    center: of.center.ok_or_else(|| missing("\"center\""))?,
                    edges: [u, v],
                    normal: if across.dot(told) < 0.0 {
                        -across
                    } else {
                        across
                    },
                    radiance: of.radiance.ok_or_else(|| missing("\"radiance\""))?,
                    reach: of.reach,
                }
            }
            "disc" => LightSource::Disc {
                center: of.center.ok_or_else(|| missing("\"center\""))?,
                radius: of.radius.ok_or_else(|| missing("\"radius\""))?,
                normal: unit(of.normal.ok_or_else(|| missing("\"normal\""))?),
                radiance: of.radiance.ok_or_else(|| missing("\"radiance\""))?,
                reach: of.reach,
            },
            other => {
                return Err(format!(
                    "lights are of type directional, point, spot, rect or disc, not {other:?}"
                ));
            }
        };
        Ok(Light {
            name: of.name,
            on: of.on.unwrap_or(true),
            solo: of.solo.unwrap_or(false),
            strength: of.strength.unwrap_or(0.0),
            tint: of.tint.unwrap_or([1.0; 3]),
            kelvin: of.kelvin,
            fixed_to: of.fixed_to.unwrap_or_default(),
            source,
        })
    }
}

impl From<Light> for LightRecord {
    fn from(light: Light) -> Self {
        let head = Self {
            kind: light.source.kind().name().into(),
            name: light.name,
            on: (!light.on).then_some(false),
            solo: light.solo.then_some(true),
            strength: (light.strength != 0.0).then_some(light.strength),
            tint: (light.tint != [1.0; 3]).then_some(light.tint),
            kelvin: light.kelvin,
            fixed_to: (light.fixed_to != FixedTo::World).then_some(light.fixed_to),
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
                reach,
            } => Self {
                reach,
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
                reach,
            } => Self {
                reach,
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
                reach,
            } => Self {
                reach,
                center: Some(center),
                radius: Some(radius),
                normal: Some(normal),
                radiance: Some(radiance),
                ..head
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::rig::light::validate_all;

    fn parsed(text: &str) -> Result<Light, String> {
        serde_json::from_str(text).map_err(|e| e.to_string())
    }

    #[test]
    fn a_light_comes_back_as_it_was_written() {
        for text in [
            r#"{"type": "point", "position": [0.1, 2, 3], "intensity": [1, 2, 3], "name": "key", "on": false, "kelvin": 3200, "fixed_to": "camera"}"#,
            r#"{"type": "spot", "position": [0, 0, 2], "target": [0, 0, 0], "intensity": [1, 1, 1], "cutoff_deg": 30, "beam_deg": 10}"#,
            r#"{"type": "rect", "center": [0, 0, 2], "edge_u": [1, 0, 0], "edge_v": [0, -1, 0], "radiance": [5, 5, 5], "strength": -1.5}"#,
            r#"{"type": "disc", "center": [0, 0, 2], "radius": 0.4, "normal": [0, 0, -2], "reach": 1.5, "radiance": [5, 5, 5], "solo": true, "fixed_to": {"object": 1}}"#,
            r#"{"type": "directional", "direction": [0, 0, -1], "irradiance": [5, 5, 5], "angle_deg": 0.53, "tint": [1, 0.5, 0.25]}"#,
        ] {
            let light = parsed(text).expect(text);
            assert!(validate_all(std::slice::from_ref(&light)).is_ok(), "{text}");
            let again = serde_json::to_string(&light).expect("numbers and names");
            assert_eq!(parsed(&again), Ok(light), "{again}");
        }
    }

    /// The normal tells the side that shines, and the edges where it points.
    #[test]
    fn a_soft_box_shines_across_its_edges() {
        let text = |normal: &str| {
            format!(
                r#"{{"type": "rect", "center": [0, 0, 2], "edge_u": [1, 0, 0], "edge_v": [0, 1, 0], "radiance": [5, 5, 5]{normal}}}"#
            )
        };
        for (told, z) in [
            ("", 1.0),
            (r#", "normal": [0.3, 0, 0.1]"#, 1.0),
            (r#", "normal": [0.3, 0, -0.1]"#, -1.0),
        ] {
            let LightSource::Rect { normal, .. } = parsed(&text(told)).expect(told).source else {
                panic!("it is one");
            };
            assert_eq!(normal, z * DVec3::Z, "{told}");
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
            (
                r#"{"type": "disc", "center": [0, 0, 1], "normal": [0, 0, -1], "radius": -1, "radiance": [1, 1, 1]}"#,
                "radius",
            ),
        ] {
            let why = validate_all(&[parsed(text).expect(text)])
                .expect_err(text)
                .to_string();
            assert!(why.contains(what) && why.contains("light 1"), "{why}");
        }
    }
}
