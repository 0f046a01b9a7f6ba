//! Sun and sky: the light of a clear or hazy day, from where the sun stands or from place and time.
//!
//! The sky is that of Hosek and Wilkie ("An Analytic Model for Full Spectral Sky-Dome Radiance", 2012), the sun a black body seen through the
//! atmosphere of Preetham, Shirley and Smits ("A Practical Analytic Model for Daylight", 1999, appendix 2).

use std::f64::consts::{FRAC_PI_2, PI};
use std::fmt;

use glam::{DVec3, Vec3};
use hw_skymodel::rgb::{Channel, SkyParams, SkyState};
use serde::{Deserialize, Serialize};
use solar_positioning::time::JulianDate;
use solar_positioning::{Location, SolarPositions};

use super::beams::Beams;
use super::emitter::{Emitter, Shape};
use super::illumination::Illumination;
use super::map::EnvironmentMap;
use super::radiance::project_environment;
use crate::color::{of_spectrum, planck};
use crate::error::{Result, ensure};

/// Sun and sky.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Sky {
    /// Where the sun stands.
    pub sun: Sun,
    /// How hazy the air is: 2 is very clear, 3 clear, 6 hazy, 10 misty.
    pub turbidity: f64,
    /// How much of the light the ground reflects, 0 to 1.
    pub ground_albedo: f64,
    /// Whether the sun itself shines; without it the sky is as bright.
    pub sun_shines: bool,
}

/// Where the sun stands. North is +y of the map, east +x.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "SunWritten", into = "SunWritten")]
pub enum Sun {
    /// There.
    At {
        /// Degrees from +x towards +y: 0 is the east, 90 the north.
        azimuth: f64,
        /// Degrees above the horizon.
        elevation: f64,
    },
    /// Where it stands then, seen from there.
    Of {
        /// Degrees north of the equator.
        latitude: f64,
        /// Degrees east of Greenwich.
        longitude: f64,
        /// The day.
        date: Date,
        /// What the clock there shows, in hours.
        hour: f64,
        /// How many hours that clock is ahead of UTC.
        utc_offset: f64,
    },
}

/// It as files have it: either angles, or place and time.
#[derive(Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct SunWritten {
    #[serde(skip_serializing_if = "Option::is_none")]
    azimuth: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    elevation: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    latitude: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    longitude: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    date: Option<Date>,
    #[serde(skip_serializing_if = "Option::is_none")]
    hour: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    utc_offset: Option<f64>,
}

impl TryFrom<SunWritten> for Sun {
    type Error = &'static str;

    fn try_from(of: SunWritten) -> std::result::Result<Self, Self::Error> {
        let time = (of.date, of.hour, of.utc_offset.unwrap_or_default());
        match (of.azimuth, of.elevation, of.latitude, of.longitude, time) {
            (Some(azimuth), Some(elevation), None, None, (None, None, _)) => {
                Ok(Self::At { azimuth, elevation })
            }
            (None, None, Some(latitude), Some(longitude), (Some(date), Some(hour), utc_offset)) => {
                Ok(Self::Of {
                    latitude,
                    longitude,
                    date,
                    hour,
                    utc_offset,
                })
            }
            _ => Err(
                "a sun has \"azimuth\" and \"elevation\", or \"latitude\", \"longitude\", \"date\" and \"hour\" (and \"utc_offset\")",
            ),
        }
    }
}

impl From<Sun> for SunWritten {
    fn from(sun: Sun) -> Self {
        let none = Self::default();
        match sun {
            Sun::At { azimuth, elevation } => Self {
                azimuth: Some(azimuth),
                elevation: Some(elevation),
                ..none
            },
            Sun::Of {
                latitude,
                longitude,
                date,
                hour,
                utc_offset,
            } => Self {
                latitude: Some(latitude),
                longitude: Some(longitude),
                date: Some(date),
                hour: Some(hour),
                utc_offset: Some(utc_offset),
                ..none
            },
        }
    }
}

/// A day of the calendar; `2026-06-21` in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Date {
    /// Of our era.
    pub year: i32,
    /// From 1.
    pub month: u32,
    /// From 1.
    pub day: u32,
}

impl fmt::Display for Date {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:04}-{:02}-{:02}", self.year, self.month, self.day)
    }
}

impl From<Date> for String {
    fn from(date: Date) -> Self {
        date.to_string()
    }
}

impl TryFrom<String> for Date {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<Self, String> {
        let wrong = || format!("{text:?} is no day as 2026-06-21");
        let mut parts = text.splitn(3, '-').map(str::parse::<u32>);
        let mut next = || parts.next().and_then(std::result::Result::ok);
        let (Some(year), Some(month), Some(day)) = (next(), next(), next()) else {
            return Err(wrong());
        };
        let date = Self {
            year: i32::try_from(year).map_err(|_| wrong())?,
            month,
            day,
        };
        date.is_valid().then_some(date).ok_or_else(wrong)
    }
}

impl Date {
    /// Days of its month.
    pub fn days_of_month(self) -> u32 {
        let is_leap = self.year % 4 == 0 && (self.year % 100 != 0 || self.year % 400 == 0);
        match self.month {
            2 if is_leap => 29,
            2 => 28,
            4 | 6 | 9 | 11 => 30,
            _ => 31,
        }
    }

    fn is_valid(self) -> bool {
        YEARS.contains(&self.year)
            && (1..=12).contains(&self.month)
            && (1..=self.days_of_month()).contains(&self.day)
    }
}

/// Years of which a sun is told.
pub const YEARS: std::ops::RangeInclusive<i32> = 1900..=2100;

/// Turbidities that the sky is known of.
pub const TURBIDITIES: std::ops::RangeInclusive<f64> = 1.0..=10.0;

/// Hours that clocks are ahead of UTC.
const OFFSETS: std::ops::RangeInclusive<f64> = -14.0..=14.0;

/// Columns of the map that a sky's light is read from: without its sun it is smooth.
const COLUMNS: usize = 256;

/// Radiance 1 stands for that luminance in cd/m²: a white surface in the noon sun has about that.
const WHITE: f64 = 30_000.0;

/// Lumens of a watt at 555 nm.
const LUMENS: f64 = 683.0;

/// Of the sun, in kelvin, and radius of its disc in degrees.
const KELVIN: f64 = 5778.0;
const RADIUS: f64 = 0.2665;

/// Centimetres of ozone overhead (Preetham et al.).
const OZONE_CM: f64 = 0.35;

/// Wavelengths in nanometres with what ozone absorbs there, per centimetre (Preetham et al., table 2, every 20 to 40 nm).
const OZONE: [[f64; 2]; 16] = [
    [440.0, 0.0],
    [460.0, 0.006],
    [480.0, 0.014],
    [500.0, 0.03],
    [520.0, 0.048],
    [540.0, 0.075],
    [560.0, 0.103],
    [570.0, 0.12],
    [580.0, 0.12],
    [600.0, 0.125],
    [620.0, 0.105],
    [640.0, 0.079],
    [660.0, 0.057],
    [680.0, 0.036],
    [710.0, 0.018],
    [760.0, 0.007],
];

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

impl Sun {
    /// Munich at midsummer, by its clock.
    pub const SOMEWHERE: Self = Self::Of {
        latitude: 48.14,
        longitude: 11.58,
        date: Date {
            year: 2026,
            month: 6,
            day: 21,
        },
        hour: 10.0,
        utc_offset: 2.0,
    };

    /// Azimuth and elevation in degrees: azimuth from +x towards +y.
    pub fn angles(&self) -> [f64; 2] {
        match *self {
            Self::At { azimuth, elevation } => [azimuth, elevation],
            Self::Of {
                latitude,
                longitude,
                date,
                hour,
                utc_offset,
            } => {
                let midnight =
                    JulianDate::from_utc(date.year, date.month, date.day, 0, 0, 0.0, 69.0);
                let then = midnight.and_then(|d| {
                    JulianDate::new(d.julian_date() + (hour - utc_offset) / 24.0, 69.0)
                });
                let seen = then.and_then(|then| {
                    let from = Location {
                        latitude,
                        longitude,
                    };
                    SolarPositions::new().at_from_julian(then, from, 0.0, None)
                });
                // What is not valid was refused.
                seen.map_or([0.0, -90.0], |seen| {
                    // From the north, clockwise.
                    [90.0 - seen.azimuth(), seen.elevation_angle()]
                })
            }
        }
    }

    fn validate(&self) -> Result<()> {
        match *self {
            Self::At { azimuth, elevation } => ensure(
                azimuth.is_finite() && (-90.0..=90.0).contains(&elevation),
                || {
                    format!(
                        "the sun's azimuth {azimuth} and elevation {elevation} (-90 to 90) are to be degrees"
                    )
                },
            ),
            Self::Of {
                latitude,
                longitude,
                date,
                hour,
                utc_offset,
            } => {
                ensure(
                    (-90.0..=90.0).contains(&latitude) && (-180.0..=180.0).contains(&longitude),
                    || {
                        format!(
                            "latitude {latitude} (-90 to 90) and longitude {longitude} (-180 to 180) are to be degrees"
                        )
                    },
                )?;
                ensure(date.is_valid(), || {
                    let (first, last) = YEARS.into_inner();
                    format!("{date} is no day of the years {first} to {last}")
                })?;
                ensure(
                    (0.0..=24.0).contains(&hour) && OFFSETS.contains(&utc_offset),
                    || {
                        format!(
                            "hour {hour} (0 to 24) and utc_offset {utc_offset} (-14 to 14) are to be hours"
                        )
                    },
                )
            }
        }
    }
}

/// A sky, evaluated.
struct Dome {
    state: SkyState,
    toward_sun: DVec3,
    /// What its values are multiplied by.
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

    /// Unit vector to the middle of the sun, in the map.
    pub fn toward_sun(&self) -> DVec3 {
        let [azimuth, elevation] = self.sun.angles().map(f64::to_radians);
        let (sin, cos) = elevation.sin_cos();
        DVec3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin)
    }

    /// The sun as a light, where it is above the horizon.
    pub fn sun(&self) -> Option<Emitter> {
        let [_, elevation] = self.sun.angles();
        let emission = sun_irradiance(elevation, self.turbidity);
        let is_seen = self.sun_shines && emission.iter().any(|e| *e > 0.0);
        is_seen.then(|| Emitter {
            shape: Shape::Distant {
                toward: self.toward_sun().as_vec3(),
                radius: RADIUS.to_radians() as f32,
            },
            emission,
        })
    }

    /// Its light: the dome as a map is read, the sun beside it.
    pub fn illumination(&self, degree: usize) -> Illumination {
        let map = self.dome_map(COLUMNS);
        let mut light = Illumination::new(project_environment(&map, degree), Some(Beams::of(&map)));
        light.emitters.extend(self.sun());
        light
    }

    /// A map of that many columns, the sun in it.
    pub fn map(&self, columns: usize) -> EnvironmentMap {
        let sun = self.sun();
        self.dome_map(columns)
            .with_lights(sun.as_slice(), Vec3::ZERO)
    }

    /// The same without the sun itself.
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
        let at = Self {
            sun: Sun::At {
                azimuth,
                elevation: above,
            },
            ..*self
        };
        state.ok().map(|state| Dome {
            state,
            toward_sun: at.toward_sun(),
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
        let up = self.toward_sun().z.max(0.0);
        let of_sun = self.sun().map_or([0.0; 3], |sun| sun.emission);
        std::array::from_fn(|c| self.ground_albedo / PI * (sum[c] + up * f64::from(of_sun[c])))
    }
}

/// Irradiance of the sun on a surface that faces it, in the unit of the pictures.
fn sun_irradiance(elevation: f64, turbidity: f64) -> [f32; 3] {
    // Its upper half is up for a while.
    let share = ((elevation + RADIUS) / (2.0 * RADIUS)).clamp(0.0, 1.0);
    if share == 0.0 {
        return [0.0; 3];
    }
    let zenith = (90.0 - elevation.max(0.0)).clamp(0.0, 90.0);
    let air = 1.0 / (zenith.to_radians().cos() + 0.15 * (93.885 - zenith).powf(-1.253));
    let dust = (0.046_08 * turbidity - 0.045_86).max(0.0);
    let seen = PI * RADIUS.to_radians().powi(2);
    let rgb = of_spectrum(|nm| {
        let microns = nm * 1e-3;
        let rayleigh = 0.008_735 * microns.powf(-4.08);
        let aerosol = dust * microns.powf(-1.3);
        let depth = air * (rayleigh + aerosol + ozone(nm) * OZONE_CM);
        seen * planck(KELVIN, nm) * (-depth).exp()
    });
    rgb.map(|e| (share * e * LUMENS / WHITE) as f32)
}

/// What ozone absorbs at a wavelength, per centimetre.
fn ozone(nm: f64) -> f64 {
    let after = OZONE.partition_point(|[at, _]| *at < nm);
    match after {
        0 => 0.0,
        _ if after == OZONE.len() => OZONE[OZONE.len() - 1][1],
        _ => {
            let ([a, low], [b, high]) = (OZONE[after - 1], OZONE[after]);
            low + (high - low) * (nm - a) / (b - a)
        }
    }
}

#[cfg(test)]
mod tests {
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
        [from_sky, of(sun) * sky.toward_sun().z.max(0.0) * WHITE]
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

    /// Noon in Greenwich is when its clock says so, give or take the equation of time, and as high as the day's declination makes it.
    #[test]
    fn the_sun_stands_where_the_almanac_says() {
        let sun = |date: &str, latitude: f64, hour: f64| {
            let date = Date::try_from(date.to_owned()).expect("a day");
            let of = Sun::Of {
                latitude,
                longitude: 0.0,
                date,
                hour,
                utc_offset: 0.0,
            };
            of.angles()
        };
        // The solstice: 90 - 51.48 + 23.44; the sun is two minutes late.
        let [azimuth, elevation] = sun("2026-06-21", 51.48, 12.0 + 2.0 / 60.0);
        assert!((elevation - 61.96).abs() < 0.05, "{elevation}");
        assert!((azimuth + 90.0).abs() < 0.5, "south: {azimuth}");
        // In the morning it stands in the east, at the equinox just above the horizon.
        let [azimuth, elevation] = sun("2026-03-20", 0.0, 6.5);
        assert!(
            azimuth.abs() < 2.0 && (0.0..10.0).contains(&elevation),
            "{azimuth} {elevation}"
        );
        // A clock that is ahead shows the same later.
        let ahead = Sun::Of {
            latitude: 51.48,
            longitude: 0.0,
            date: Date::try_from("2026-06-21".to_owned()).expect("a day"),
            hour: 14.0,
            utc_offset: 2.0,
        };
        let same = sun("2026-06-21", 51.48, 12.0);
        assert!(
            ahead
                .angles()
                .iter()
                .zip(same)
                .all(|(a, b)| (a - b).abs() < 1e-6)
        );
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
        let text =
            r#"{"sun": {"latitude": 48.1, "longitude": 11.6, "date": "2026-02-30", "hour": 9}}"#;
        let why = serde_json::from_str::<Sky>(text).expect_err("no such day");
        assert!(why.to_string().contains("2026-02-30"), "{why}");
        let right = text.replace("02-30", "02-28");
        let sky: Sky = serde_json::from_str(&right).expect("a day");
        assert!(sky.validate().is_ok());
        let again = serde_json::to_string(&sky).expect("plain data");
        assert_eq!(serde_json::from_str::<Sky>(&again).expect(&again), sky);
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
