//! Sun and sky: the light of a clear or hazy day, from where the sun stands or from place and time.
//!
//! The sky is that of Hosek and Wilkie ("An Analytic Model for Full Spectral Sky-Dome Radiance", 2012), the sun a black body seen through the
//! atmosphere of Preetham, Shirley and Smits ("A Practical Analytic Model for Daylight", 1999, appendix 2).

mod sun;

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec3, Vec3};
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};
use serde::{Deserialize, Serialize};

use super::emitter::{Emitter, Shape};
use super::illumination::Illumination;
use super::map::EnvironmentMap;
use crate::error::{Result, ensure};
pub use sun::{Date, PlaceAndTime, Sun, YEARS};

/// Sun and sky.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sky {
    /// Where the sun stands.
    pub sun: Sun,
    /// Turbidity of the air: 2 is very clear, 3 clear, 6 hazy, 10 misty.
    pub turbidity: f64,
    /// Albedo of the ground, 0 to 1.
    pub ground_albedo: f64,
    /// True where the sun itself shines; without it the sky is as bright.
    pub sun_shines: bool,
}

/// Turbidities that the sky is known of.
pub const TURBIDITIES: std::ops::RangeInclusive<f64> = 1.0..=10.0;

/// Columns of the map that a sky's light is read from: without its sun it is smooth.
const COLUMNS: usize = 256;

/// Radiance 1 stands for that luminance in cd/m²: a white surface in the noon sun has about that.
const WHITE: f64 = 30_000.0;

/// Lumens of a watt at 555 nm.
const LUMENS: f64 = 683.0;

/// Decades of brightness that the sky falls by for each degree that the sun is below the horizon: to a three-hundredth at the end of civil
/// twilight, as tables of illuminance have it.
const DUSK: f64 = 0.4;

/// The sun below which it is night, in degrees.
const NIGHT: f64 = -18.0;

impl Default for Sky {
    fn default() -> Self {
        Self {
            sun: Sun::At {
                azimuth: -45.0,
                elevation: 40.0,
            },
            turbidity: 3.0,
            ground_albedo: 0.2,
            sun_shines: true,
        }
    }
}

/// A sky, evaluated.
struct Dome {
    state: SkyState,
    toward_sun: DVec3,
    /// Factor of its values.
    scale: f64,
}

impl Dome {
    /// Radiance of a direction above the horizon.
    fn radiance(&self, direction: DVec3) -> [f64; 3] {
        let theta = direction.z.clamp(0.0, 1.0).acos().min(FRAC_PI_2 - 1e-3);
        let gamma = direction.angle_between(self.toward_sun);
        [Channel::R, Channel::G, Channel::B].map(|channel| {
            let value = self.state.radiance(theta as f32, gamma as f32, channel);
            (f64::from(value) * self.scale).max(0.0)
        })
    }
}

impl Sky {
    /// Checks ranges.
    ///
    /// # Errors
    /// Says which setting is out of range.
    pub fn validate(&self) -> Result<()> {
        let (turbidity, albedo) = (self.turbidity, self.ground_albedo);
        ensure(TURBIDITIES.contains(&turbidity), || {
            format!("turbidity {turbidity} is out of range 1 to 10")
        })?;
        ensure((0.0..=1.0).contains(&albedo), || {
            format!("ground_albedo {albedo} is out of range 0 to 1")
        })?;
        self.sun.validate()
    }

    /// The sun as a light, where it is above the horizon.
    pub fn sun(&self) -> Option<Emitter> {
        let [_, elevation] = self.sun.angles();
        let irradiance = sun::irradiance(elevation, self.turbidity);
        let emission = irradiance.map(|e| (e * LUMENS / WHITE) as f32);
        let is_seen = self.sun_shines && emission.iter().any(|e| *e > 0.0);
        is_seen.then(|| Emitter {
            shape: Shape::Distant {
                toward: self.sun.toward().as_vec3(),
                radius: sun::RADIUS.to_radians() as f32,
            },
            emission,
        })
    }

    /// Its light.
    pub fn illumination(&self, degree: usize) -> Illumination {
        self.illumination_with(&self.dome_map(COLUMNS), degree)
    }

    /// Illumination, given a map of its dome: that as a map is read, the sun beside it.
    pub fn illumination_with(&self, dome: &EnvironmentMap, degree: usize) -> Illumination {
        let mut light = Illumination::of(dome, degree);
        light.emitters.extend(self.sun());
        light
    }

    /// A map of that many columns, the sun in it.
    pub fn map(&self, columns: usize) -> EnvironmentMap {
        self.with_sun(self.dome_map(columns))
    }

    /// Map with the sun, given a map of its dome.
    pub fn with_sun(&self, dome: EnvironmentMap) -> EnvironmentMap {
        dome.with_lights(self.sun().as_slice(), Vec3::ZERO)
    }

    /// A map of that many columns without the sun itself.
    pub fn dome_map(&self, columns: usize) -> EnvironmentMap {
        let dome = self.dome();
        let radiance = |d| dome.as_ref().map_or([0.0; 3], |dome| dome.radiance(d));
        let ground = self.ground(&radiance);
        EnvironmentMap::of_directions(columns, columns / 2, |d| {
            let radiance = if d.z > 0.0 { radiance(d) } else { ground };
            radiance.map(|r| r as f32)
        })
    }

    /// The dome, unless it is night.
    fn dome(&self) -> Option<Dome> {
        let [azimuth, elevation] = self.sun.angles();
        if elevation < NIGHT {
            return None;
        }
        let above = elevation.clamp(0.0, 90.0);
        let state = SkyState::new(&SkyParams {
            elevation: (above.to_radians() as f32).min(std::f32::consts::FRAC_PI_2),
            turbidity: self.turbidity as f32,
            albedo: [self.ground_albedo as f32; 3],
        });
        let dusk = 10f64.powf(DUSK * elevation.min(0.0));
        state.ok().map(|state| Dome {
            state,
            toward_sun: sun::toward([azimuth, above]),
            scale: dusk * LUMENS / WHITE,
        })
    }

    /// Radiance of the ground: what falls on it, reflected evenly.
    fn ground(&self, radiance: &impl Fn(DVec3) -> [f64; 3]) -> [f64; 3] {
        const ROWS: usize = 24;
        let mut sum = [0f64; 3];
        for row in 0..ROWS {
            // Of equal shares of the cosine's integral.
            let up = ((row as f64 + 0.5) / ROWS as f64).sqrt();
            let out = (1.0 - up * up).sqrt();
            for column in 0..2 * ROWS {
                let (sin, cos) = (PI * (column as f64 + 0.5) / ROWS as f64).sin_cos();
                let seen = radiance(DVec3::new(out * cos, out * sin, up));
                for (sum, seen) in sum.iter_mut().zip(seen) {
                    *sum += PI * seen / (2 * ROWS * ROWS) as f64;
                }
            }
        }
        let up = self.sun.toward().z.max(0.0);
        let of_sun = self.sun().map_or([0.0; 3], |sun| sun.emission);
        std::array::from_fn(|c| self.ground_albedo / PI * (sum[c] + up * f64::from(of_sun[c])))
    }
}

#[cfg(test)]
mod tests {
    use super::super::radiance::project_environment;
    use super::*;
    use crate::color::luminance;

    fn sky(elevation: f64, turbidity: f64) -> Sky {
        Sky {
            sun: Sun::At {
                azimuth: 30.0,
                elevation,
            },
            turbidity,
            ..Sky::default()
        }
    }

    /// In lux, on the ground: of the sky and of the sun.
    fn lux(sky: &Sky) -> [f64; 2] {
        let dome = sky.dome().expect("day");
        let radiance = |d| dome.radiance(d);
        let white = Sky {
            ground_albedo: 1.0,
            sun_shines: false,
            ..*sky
        };
        let of = |rgb: [f64; 3]| f64::from(luminance(rgb.map(|v| v as f32)));
        let from_sky = PI * of(white.ground(&radiance)) * WHITE;
        let sun = sky.sun().map_or([0.0; 3], |s| s.emission.map(f64::from));
        [from_sky, of(sun) * sky.sun.toward().z.max(0.0) * WHITE]
    }

    /// Illuminance of clear days as handbooks have it: a high sun 80 to 110 thousand lux, the sky 8 to 25 thousand.
    #[test]
    fn a_day_is_as_bright_as_days_are() {
        let [sky_lux, sun_lux] = lux(&sky(60.0, 3.0));
        assert!((8e3..2.5e4).contains(&sky_lux), "{sky_lux}");
        assert!((7e4..1.1e5).contains(&sun_lux), "{sun_lux}");
        // Haze takes from the sun and gives to the sky.
        let [hazy_sky, hazy_sun] = lux(&sky(60.0, 8.0));
        assert!(hazy_sky > sky_lux && hazy_sun < sun_lux);
        // A low sun is redder than a high one, and dimmer.
        let of = |elevation| sky(elevation, 3.0).sun().expect("up").emission;
        let (low, high) = (of(5.0), of(60.0));
        assert!(low[0] / low[2] > 2.0 * high[0] / high[2] && low[1] < 0.5 * high[1]);
        // Above, the sky is blue.
        let dome = sky(30.0, 2.5).dome().expect("day");
        let up = dome.radiance(DVec3::Z);
        assert!(up[2] > 1.5 * up[0], "{up:?}");
    }

    /// Radiances that the authors' own program gives (release 1.4a), in W/m²/sr, of red, green and blue: overhead, at the horizon across from the
    /// sun, beside the sun, and halfway up behind one's back.
    #[test]
    fn the_sky_is_that_of_its_authors() {
        let clear = [
            [2.106_288, 3.705_108, 7.529_882],
            [11.446_718, 14.641_962, 15.752_470],
            [19.574_139, 21.489_550, 23.461_400],
            [2.775_734, 5.208_588, 10.082_802],
        ];
        let hazy = [
            [1.226_094, 1.953_442, 2.902_180],
            [4.930_690, 4.051_641, 2.548_814],
            [127.550_836, 81.652_852, 29.080_506],
            [2.456_423, 3.547_882, 4.593_837],
        ];
        for ([turbidity, ground_albedo, elevation], expected) in
            [([3.0, 0.1, 41.34], clear), ([6.4, 0.35, 8.0], hazy)]
        {
            let sky = Sky {
                ground_albedo,
                ..sky(elevation, turbidity)
            };
            let dome = sky.dome().expect("day");
            let zenith = 90.0 - elevation;
            let beside = 0.02f64.to_degrees();
            // Degrees from the zenith, and from the sun.
            let places: [[f64; 2]; 4] =
                [[0.0, zenith], [89.1, 90.0], [zenith, beside], [45.0, 135.0]];
            for (place, expected) in places.into_iter().zip(expected) {
                let [theta, gamma] = place.map(|angle| angle.to_radians() as f32);
                let channels = [Channel::R, Channel::G, Channel::B];
                for (channel, expected) in channels.into_iter().zip(expected) {
                    let found = f64::from(dome.state.radiance(theta, gamma, channel));
                    // Its numbers are single.
                    let off: f64 = found / expected - 1.0;
                    assert!(off.abs() < 2e-4, "{place:?}: {found} {expected}");
                }
            }
            // And in the unit of the pictures, straight up.
            let up = dome.radiance(DVec3::Z)[1] * WHITE / LUMENS;
            assert!((up / expected[0][1] - 1.0).abs() < 1e-3, "{up}");
        }
    }

    #[test]
    fn nothing_jumps_from_day_to_night() {
        let mut last: Option<[f64; 2]> = None;
        for step in 0..=220 {
            let elevation = 3.0 - 0.1 * f64::from(step);
            let sky = sky(elevation, 3.0);
            let light = sky.illumination(0);
            let both = [
                f64::from(light.radiance.mean_irradiance()),
                f64::from(light.mean_irradiance()),
            ];
            assert!(both.iter().all(|v| v.is_finite() && *v >= 0.0));
            if let Some(last) = last {
                for (now, last) in both.into_iter().zip(last) {
                    assert!(
                        (now - last).abs() < 0.12 * last + 2e-5,
                        "{elevation}: {now} {last}"
                    );
                }
            }
            last = Some(both);
        }
        assert!(sky(-30.0, 3.0).illumination(3).is_black());
    }

    /// The map with the sun in it is the same light.
    #[test]
    fn the_sun_in_the_map_is_as_strong_as_beside_it() {
        for elevation in [1.0, 30.0, 89.0] {
            let sky = sky(elevation, 3.0);
            for columns in [512, 2048] {
                let map = sky.map(columns);
                let seen = project_environment(&map, 2).mean_irradiance();
                let beside = sky.illumination(2).mean_irradiance();
                assert!(
                    (seen / beside - 1.0).abs() < 0.02,
                    "{elevation}: {seen} {beside}"
                );
            }
        }
    }

    #[test]
    fn what_is_out_of_range_is_said() {
        let sky = Sky::default();
        for (sky, what) in [
            (
                Sky {
                    turbidity: 11.0,
                    ..sky
                },
                "turbidity",
            ),
            (
                Sky {
                    ground_albedo: f64::NAN,
                    ..sky
                },
                "ground_albedo",
            ),
            (
                Sky {
                    sun: Sun::At {
                        azimuth: 0.0,
                        elevation: 91.0,
                    },
                    ..sky
                },
                "elevation",
            ),
        ] {
            let why = sky.validate().expect_err(what).to_string();
            assert!(why.contains(what), "{why}");
        }
    }
}
