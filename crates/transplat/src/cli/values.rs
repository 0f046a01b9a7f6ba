//! Values of command-line options.

use std::ops::RangeInclusive;
use std::str::FromStr;

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};

use transplat_core::bake::harmonic::DIRECTIONS;
use transplat_core::camera::APERTURE;
use transplat_core::files::parse_json;
use transplat_core::present::Background;
use transplat_core::response::CONTRASTS;
use transplat_core::scene::Light;
use transplat_core::settings::{EPSILON, GLOW_RANGE};
use transplat_core::surfels::UpAxis;

use transplat_engine::delight::{ALBEDOS, DelitAs};
use transplat_engine::device::DeviceChoice;

pub(super) fn parse_up(text: &str) -> Result<UpAxis, String> {
    let is = |name: &str| name.eq_ignore_ascii_case(text);
    let is_it = |&(name, _): &(&str, UpAxis)| is(name) || name.strip_prefix('+').is_some_and(is);
    let found = UpAxis::ALL.into_iter().find(is_it);
    found
        .map(|(_, axis)| axis)
        .ok_or_else(|| "one of +x, -x, +y, -y, +z, -z is expected".into())
}

/// A value that is good.
fn parsed<T: FromStr>(text: &str, is_good: impl Fn(&T) -> bool, asked: &str) -> Result<T, String> {
    let value = text.parse().ok().filter(is_good);
    value.ok_or_else(|| format!("{asked} is expected"))
}

pub(super) fn parse_directions(text: &str) -> Result<usize, String> {
    let (least, most) = DIRECTIONS.into_inner();
    let asked = format!("a number from {least} to {most}");
    parsed(text, |n: &usize| DIRECTIONS.contains(n), &asked)
}

/// Parses an enum by the name that saved looks use.
pub(super) fn parse_named<T: serde::de::DeserializeOwned>(text: &str) -> Result<T, String> {
    serde_json::from_value(serde_json::Value::String(text.to_owned()))
        .map_err(|e| e.to_string().replace("unknown variant ", "not known: "))
}

pub(super) fn parse_finite(text: &str) -> Result<f64, String> {
    parsed(text, |v: &f64| v.abs() < 1e6, "a number")
}

/// Rotation of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rotation {
    /// In degrees about the up axis.
    Degrees(f64),
    /// To where it explains the capture best.
    Fit,
}

pub(super) fn parse_rotation(text: &str) -> Result<Rotation, String> {
    match text {
        "fit" => Ok(Rotation::Fit),
        _ => parse_finite(text).map(Rotation::Degrees),
    }
}

pub(super) fn parse_gain(text: &str) -> Result<f64, String> {
    parsed(
        text,
        |v: &f64| (0.0..=20.0).contains(v),
        "a number of stops from 0 to 20",
    )
}

pub(super) fn parse_share(text: &str) -> Result<f64, String> {
    parsed(
        text,
        |v: &f64| (0.0..=1.0).contains(v),
        "a number from 0 to 1",
    )
}

pub(super) fn parse_contrast(text: &str) -> Result<f64, String> {
    let (least, most) = CONTRASTS.into_inner();
    let is_good = |v: &f64| CONTRASTS.contains(&(*v as f32));
    parsed(text, is_good, &format!("a number from {least} to {most}"))
}

pub(super) fn parse_rows(text: &str) -> Result<usize, String> {
    parsed(
        text,
        |n: &usize| (8..=2048).contains(n),
        "a number from 8 to 2048",
    )
}

pub(super) fn parse_light(text: &str) -> Result<Light, String> {
    parse_json(text).map_err(|why| {
        format!("not a light as a rig lists them ({why}); a file of lights is for --rig")
    })
}

pub(super) fn parse_columns(text: &str) -> Result<usize, String> {
    parsed(
        text,
        |n: &usize| (64..=8192).contains(n) && n.is_multiple_of(2),
        "an even number from 64 to 8192",
    )
}

pub(super) fn parse_epsilon(text: &str) -> Result<f64, String> {
    let is_good = |v: &f64| EPSILON.contains(&(*v as f32));
    parsed(text, is_good, "a number from 1e-6 to 1000")
}

pub(super) fn parse_albedo(text: &str) -> Result<f64, String> {
    let is_good = |v: &f64| ALBEDOS.contains(&(*v as f32));
    parsed(text, is_good, "a number from 0.02 to 1")
}

pub(super) fn parse_glow(text: &str) -> Result<f64, String> {
    let is_good = |v: &f64| GLOW_RANGE.contains(&(*v as f32));
    parsed(text, is_good, "a number from 0.05 to 100")
}

pub(super) fn parse_fov(text: &str) -> Result<f64, String> {
    let is_good = |v: &f64| (1.0..=170.0).contains(v);
    parsed(text, is_good, "an angle from 1 to 170 degrees")
}

pub(super) fn parse_aperture(text: &str) -> Result<f64, String> {
    parsed(text, |v| APERTURE.contains(v), "a number from 0 to 0.2")
}

pub(super) fn parse_point(text: &str) -> Result<[f64; 3], String> {
    let values: Result<Vec<f64>, _> = text.split(',').map(|v| v.trim().parse::<f64>()).collect();
    values
        .ok()
        .and_then(|v| <[f64; 3]>::try_from(v).ok())
        .filter(|v| v.iter().all(|v| (*v as f32).is_finite()))
        .ok_or_else(|| "three numbers X,Y,Z are expected".into())
}

pub(super) fn parse_size(text: &str) -> Result<[usize; 2], String> {
    let size = text
        .split_once(['x', 'X'])
        .and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    size.filter(|s: &[usize; 2]| s.iter().all(|v| (1..=16384).contains(v)))
        .ok_or_else(|| "WIDTHxHEIGHT is expected, each from 1 to 16384".into())
}

/// Views around an object.
pub const VIEWS: RangeInclusive<u32> = 1..=100_000;

pub(super) fn parse_views(text: &str) -> Result<u32, String> {
    let views = text.parse().ok().filter(|views| VIEWS.contains(views));
    views.ok_or_else(|| format!("expected 1 to {} views", VIEWS.end()))
}

/// Parts of a batch, at most.
const MOST_PARTS: usize = 1_000_000;

pub(super) fn parse_part(text: &str) -> Result<[usize; 2], String> {
    let parts = text.split_once('/');
    let numbers = parts.and_then(|(k, n)| Some([k.trim().parse().ok()?, n.trim().parse().ok()?]));
    match numbers {
        Some([part, of]) if (1..=of).contains(&part) && of <= MOST_PARTS => Ok([part, of]),
        _ => Err(format!(
            "expected a part and how many there are, such as 1/8, from 1 to that many, {MOST_PARTS} at most"
        )),
    }
}

pub(super) fn parse_frames(text: &str) -> Result<[usize; 2], String> {
    let range = match text.split_once('-') {
        Some((a, b)) => a.parse().ok().zip(b.parse().ok()),
        None => text.parse().ok().map(|a| (a, a)),
    };
    range
        .filter(|(a, b)| a <= b)
        .map(|(a, b)| [a, b])
        .ok_or_else(|| "A-B is expected, the first and the last frame".into())
}

pub(super) fn parse_background(text: &str) -> Result<Background, String> {
    Ok(match text {
        "transparent" => Background::Transparent,
        "environment" => Background::Environment,
        "checker" => Background::Checker,
        "plate" => Background::Backplate,
        "black" => Background::Color([0.0; 3]),
        "white" => Background::Color([1.0; 3]),
        _ => {
            let digits = text
                .strip_prefix('#')
                .filter(|d| d.len() == 6)
                .and_then(|d| u32::from_str_radix(d, 16).ok())
                .ok_or("transparent, black, white, #rrggbb, checker, environment or plate (of the look) is expected")?;
            Background::Color([16, 8, 0].map(|shift| (digits >> shift & 255) as f32 / 255.0))
        }
    })
}

/// Parses one of some words, each with its value and its help.
fn one_of<T: Clone + Send + Sync + 'static>(
    words: &[(&'static str, T, &'static str)],
) -> impl TypedValueParser<Value = T> + use<T> {
    let words = words.to_vec();
    let known = words.iter();
    let known = known.map(|(word, _, help)| PossibleValue::new(*word).help(*help));
    PossibleValuesParser::new(known).try_map(move |word| {
        let found = words.iter().find(|(known, ..)| *known == word);
        found.map(|(_, value, _)| value.clone()).ok_or("not known")
    })
}

pub(super) fn delit_as() -> impl TypedValueParser<Value = DelitAs> {
    let even = "What it looks like under light from everywhere";
    one_of(&[
        ("albedo", DelitAs::Albedo, "Its albedo"),
        ("even", DelitAs::Even, even),
    ])
}

pub(super) fn device_choice() -> impl TypedValueParser<Value = DeviceChoice> {
    let [auto, gpu, cpu] = [
        "The GPU where there is one, else the CPU",
        "A GPU; a software Vulkan driver counts",
        "The CPU, without any graphics driver",
    ];
    one_of(&[
        ("auto", DeviceChoice::Auto, auto),
        ("gpu", DeviceChoice::Gpu, gpu),
        ("cpu", DeviceChoice::Cpu, cpu),
    ])
}

#[cfg(test)]
mod tests {
    use super::*;
    use transplat_core::color::ToneMap;
    use transplat_core::present::View;

    #[test]
    fn values_are_read_as_the_help_says() {
        assert_eq!(parse_size("640x480"), Ok([640, 480]));
        assert!(parse_size("640x0").is_err());
        assert_eq!(parse_frames("3-7"), Ok([3, 7]));
        assert_eq!(parse_frames("3"), Ok([3, 3]));
        assert!(parse_frames("7-3").is_err());
        assert_eq!(
            parse_background("#ff0000"),
            Ok(Background::Color([1.0, 0.0, 0.0]))
        );
        assert_eq!(parse_up("-y"), Ok(UpAxis::MinusY));
        assert_eq!(parse_named::<View>("tau"), Ok(View::Tau));
        assert!(parse_named::<ToneMap>("agx2").is_err());
        assert_eq!(parse_point("1,-2,3.5"), Ok([1.0, -2.0, 3.5]));
    }
}
