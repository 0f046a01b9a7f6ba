//! Position of the sun by place and time, and its radiance.

use std::f64::consts::PI;
use std::fmt;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use solar_positioning::time::JulianDate;
use solar_positioning::{Location, SolarPositions};

use crate::color::{of_spectrum, planck};
use crate::error::{Result, ensure};

/// Where the sun stands. North is +y of the map, east +x.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(
    untagged,
    deny_unknown_fields,
    expecting = "a sun has \"azimuth\" and \"elevation\", or \"latitude\", \"longitude\", \"date\" as \"2026-06-21\" and \"hour\" (and \"utc_offset\")"
)]
pub enum Sun {
    /// There.
    At {
        /// Degrees from +x towards +y: 0 is the east, 90 the north.
        azimuth: f64,
        /// Degrees above the horizon.
        elevation: f64,
    },
    /// Where it stands then, seen from there.
    Of(PlaceAndTime),
}

/// A place on the earth, and a time there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlaceAndTime {
    /// Degrees north of the equator.
    pub latitude: f64,
    /// Degrees east of Greenwich.
    pub longitude: f64,
    /// The day.
    pub date: Date,
    /// Local time, in hours.
    pub hour: f64,
    /// Offset of that clock from UTC, in hours.
    #[serde(default)]
    pub utc_offset: f64,
}

/// A day of the calendar; `2026-06-21` in files.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Date {
    /// Year of our era.
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
        Ok(Self {
            year: i32::try_from(year).map_err(|_| wrong())?,
            month,
            day,
        })
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

/// Hours that clocks are ahead of UTC.
const OFFSETS: std::ops::RangeInclusive<f64> = -14.0..=14.0;

/// Seconds that terrestrial time is ahead of the earth's turn, as of the 2020s.
const DELTA_T: f64 = 69.0;

/// Temperature of the sun in kelvin, and radius of its disc in degrees.
const KELVIN: f64 = 5778.0;
pub(super) const RADIUS: f64 = 0.2665;

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

impl Sun {
    /// Munich at midsummer, by its clock.
    pub const SOMEWHERE: Self = Self::Of(PlaceAndTime {
        latitude: 48.14,
        longitude: 11.58,
        date: Date {
            year: 2026,
            month: 6,
            day: 21,
        },
        hour: 10.0,
        utc_offset: 2.0,
    });

    /// Azimuth and elevation in degrees: azimuth from +x towards +y.
    pub fn angles(&self) -> [f64; 2] {
        match self {
            Self::At { azimuth, elevation } => [*azimuth, *elevation],
            // What is not valid was refused.
            Self::Of(of) => of.seen().unwrap_or([0.0, -90.0]),
        }
    }

    /// Unit vector to its middle, in the map.
    pub fn toward(&self) -> DVec3 {
        toward(self.angles())
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// Says what is out of range.
    pub fn validate(&self) -> Result<()> {
        match self {
            Self::At { azimuth, elevation } => ensure(
                azimuth.is_finite() && (-90.0..=90.0).contains(elevation),
                || {
                    format!(
                        "the sun's azimuth {azimuth} and elevation {elevation} (-90 to 90) are to be degrees"
                    )
                },
            ),
            Self::Of(of) => of.validate(),
        }
    }
}

impl PlaceAndTime {
    /// Angles of the sun over the horizon. See [`Sun::angles`].
    fn seen(&self) -> Option<[f64; 2]> {
        let Date { year, month, day } = self.date;
        let midnight = JulianDate::from_utc(year, month, day, 0, 0, 0.0, DELTA_T).ok()?;
        let days = (self.hour - self.utc_offset) / 24.0;
        let then = JulianDate::new(midnight.julian_date() + days, DELTA_T).ok()?;
        let from = Location {
            latitude: self.latitude,
            longitude: self.longitude,
        };
        let seen = SolarPositions::new().at_from_julian(then, from, 0.0, None);
        // From the north, clockwise.
        seen.ok()
            .map(|seen| [90.0 - seen.azimuth(), seen.elevation_angle()])
    }

    fn validate(&self) -> Result<()> {
        let Self {
            latitude,
            longitude,
            date,
            hour,
            utc_offset,
        } = self;
        ensure(
            (-90.0..=90.0).contains(latitude) && (-180.0..=180.0).contains(longitude),
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
            (0.0..=24.0).contains(hour) && OFFSETS.contains(utc_offset),
            || {
                format!(
                    "hour {hour} (0 to 24) and utc_offset {utc_offset} (-14 to 14) are to be hours"
                )
            },
        )
    }
}

/// Unit vector to azimuth and elevation in degrees.
pub(super) fn toward(angles: [f64; 2]) -> DVec3 {
    let [azimuth, elevation] = angles.map(f64::to_radians);
    let (sin, cos) = elevation.sin_cos();
    DVec3::new(cos * azimuth.cos(), cos * azimuth.sin(), sin)
}

/// Irradiance of the sun on a surface that faces it, per channel in watts that are as bright as those of 555 nm, by its elevation in degrees.
pub(super) fn irradiance(elevation: f64, turbidity: f64) -> [f64; 3] {
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
    rgb.map(|e| share * e)
}

/// Absorption by ozone at a wavelength, per centimetre.
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

    fn seen(date: &str, latitude: f64, hour: f64, utc_offset: f64) -> [f64; 2] {
        let sun = Sun::Of(PlaceAndTime {
            latitude,
            longitude: 0.0,
            date: Date::try_from(date.to_owned()).expect("a day"),
            hour,
            utc_offset,
        });
        sun.angles()
    }

    /// Noon in Greenwich is when its clock says so, give or take the equation of time, and as high as the day's declination makes it.
    #[test]
    fn the_sun_stands_where_the_almanac_says() {
        // The solstice: 90 - 51.48 + 23.44; the sun is two minutes late.
        let [azimuth, elevation] = seen("2026-06-21", 51.48, 12.0 + 2.0 / 60.0, 0.0);
        assert!((elevation - 61.96).abs() < 0.05, "{elevation}");
        assert!((azimuth + 90.0).abs() < 0.5, "south: {azimuth}");
        // In the morning it stands in the east, at the equinox just above the horizon.
        let [azimuth, elevation] = seen("2026-03-20", 0.0, 6.5, 0.0);
        assert!(
            azimuth.abs() < 2.0 && (0.0..10.0).contains(&elevation),
            "{azimuth} {elevation}"
        );
        // A clock that is ahead shows the same later.
        let ahead = seen("2026-06-21", 51.48, 14.0, 2.0);
        let same = seen("2026-06-21", 51.48, 12.0, 0.0);
        let off = [0, 1].map(|i| (ahead[i] - same[i]).abs());
        assert!(off.iter().all(|off| *off < 1e-6), "{off:?}");
    }

    #[test]
    fn a_sun_is_told_by_angles_or_by_place_and_time() {
        let read = |text: &str| serde_json::from_str::<Sun>(text);
        let place = r#"{"latitude": 48.1, "longitude": 11.6, "date": "2026-02-28", "hour": 9}"#;
        for text in [place, r#"{"azimuth": 30, "elevation": 10}"#] {
            let sun = read(text).expect(text);
            assert!(sun.validate().is_ok());
            let again = serde_json::to_value(sun).expect("plain data");
            assert_eq!(serde_json::from_value::<Sun>(again).expect(text), sun);
        }
        let no_such_day = read(&place.replace("02-28", "02-30")).expect("it is a date");
        let why = no_such_day.validate().expect_err("no such day");
        assert!(why.to_string().contains("2026-02-30"), "{why}");
        for wrong in [
            place.replace("2026-02-28", "28.2."),
            place.replace('}', r#", "azimuth": 3}"#),
            place.replace('}', r#", "azimuth": 3, "elevation": 3}"#),
            place.replace("hour", "hours"),
            place.replace("hour", "azimuth"),
        ] {
            let why = serde_json::from_str::<Sun>(&wrong)
                .expect_err(&wrong)
                .to_string();
            assert!(why.contains("\"latitude\""), "{wrong}: {why}");
        }
    }
}
