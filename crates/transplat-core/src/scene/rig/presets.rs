//! Rig presets, as they are known from studios.

use glam::DVec3;

use super::light::Light;
use super::placing::{LightKind, Placed};

/// A rig to begin with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RigPreset {
    /// A key light, one that fills its shadows, and one from behind.
    ThreePoint,
    /// Two strips from behind: the outline glows.
    Rim,
    /// A wide soft box overhead, and light from all around.
    Overcast,
    /// A low warm sun under a blue sky.
    GoldenHour,
    /// A large soft box overhead, white walls at the sides.
    ProductTable,
}

/// Target of a rig: its middle and radius in the Z-up world, and the azimuth that it is seen from, in degrees.
#[derive(Clone, Copy, Debug)]
pub struct RigTarget {
    /// The middle.
    pub center: DVec3,
    /// Radius from there.
    pub radius: f64,
    /// Where the camera is.
    pub seen_from: f64,
}

/// Irradiance of the main light: a white surface that faces it has radiance 1.
pub const KEY: f32 = std::f32::consts::PI;

impl RigTarget {
    /// A place around it: degrees to the right of where it is seen from, degrees above the horizon, and how many radii away.
    pub fn around(&self, right: f64, above: f64, radii: f64) -> Placed {
        let azimuth = (self.seen_from + right).to_radians();
        let (sin, cos) = above.to_radians().sin_cos();
        let toward = DVec3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin);
        Placed {
            position: self.center + radii * self.radius * toward,
            aim: self.center,
            radius: self.radius,
        }
    }
}

impl RigPreset {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::ThreePoint,
        Self::Rim,
        Self::Overcast,
        Self::GoldenHour,
        Self::ProductTable,
    ];

    /// Its lights around what they are to light, and the radiance of what is around them.
    pub(super) fn lights(self, lit: RigTarget) -> (Vec<Light>, [f32; 3]) {
        let light = |name: &str, kind, [right, above, radii]: [f64; 3], share: f32| {
            let placed = lit.around(right, above, radii);
            Light {
                name: name.into(),
                ..Light::placed(kind, placed, share * KEY)
            }
        };
        let of_size = |mut light: Light, width: f64, height: f64| {
            light.source.resize([width, height]);
            light
        };
        match self {
            Self::ThreePoint => (
                vec![
                    light("key", LightKind::Rect, [45.0, 40.0, 3.0], 1.0),
                    light("fill", LightKind::Rect, [-55.0, 15.0, 3.5], 0.3),
                    light("back", LightKind::Spot, [-150.0, 45.0, 3.5], 0.8),
                ],
                [0.02; 3],
            ),
            Self::Rim => {
                let strip = |name, right| {
                    let strip = light(name, LightKind::Rect, [right, 20.0, 2.5], 1.2);
                    of_size(strip, 0.35 * lit.radius, 2.5 * lit.radius)
                };
                (
                    vec![strip("rim right", 140.0), strip("rim left", -140.0)],
                    [0.015; 3],
                )
            }
            Self::Overcast => {
                let sky = light("overcast sky", LightKind::Rect, [0.0, 90.0, 4.0], 0.55);
                (
                    vec![of_size(sky, 8.0 * lit.radius, 8.0 * lit.radius)],
                    [0.3, 0.31, 0.33],
                )
            }
            Self::GoldenHour => {
                let mut sun = light("sun", LightKind::Directional, [65.0, 9.0, 10.0], 0.9);
                sun.kelvin = Some(2800.0);
                (vec![sun], [0.17, 0.2, 0.27])
            }
            Self::ProductTable => {
                let top = light("top", LightKind::Rect, [0.0, 80.0, 3.0], 0.8);
                let side = |name, right, share| {
                    let wall = light(name, LightKind::Rect, [right, 10.0, 2.5], share);
                    of_size(wall, 1.5 * lit.radius, 2.0 * lit.radius)
                };
                (
                    vec![
                        of_size(top, 3.0 * lit.radius, 3.0 * lit.radius),
                        side("right", 80.0, 0.35),
                        side("left", -80.0, 0.25),
                    ],
                    [0.12; 3],
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::rig::light::validate_all;

    /// Of anything, however large and wherever: the light on its middle is the same.
    #[test]
    fn rigs_fit_what_they_light() {
        let lit = |center: DVec3, radius| RigTarget {
            center,
            radius,
            seen_from: 30.0,
        };
        for preset in RigPreset::ALL {
            let sums = [
                (DVec3::ZERO, 1.0),
                (DVec3::new(3.0, -2.0, 5.0), 0.01),
                (DVec3::new(-1e3, 2e3, 0.0), 1e3),
            ]
            .map(|(center, radius)| {
                let (lights, _) = preset.lights(lit(center, radius));
                assert!(validate_all(&lights).is_ok(), "{preset:?}");
                let made = lights.iter().map(|light| {
                    let emitter = light.emitter();
                    emitter.emission[1] * emitter.shape.facing(center.as_vec3(), 0.0)
                });
                made.sum::<f32>()
            });
            assert!((0.3 * KEY..3.0 * KEY).contains(&sums[0]), "{preset:?}");
            for sum in sums {
                assert!((sum / sums[0] - 1.0).abs() < 1e-2, "{preset:?}: {sums:?}");
            }
        }
    }
}
