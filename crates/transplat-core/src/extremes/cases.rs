//! The extreme cases.

use glam::{DVec3, Vec2, Vec3};

use super::case::{Case, CaseInput, REFUSED, Trial, bake};
use crate::color::Encoding;
use crate::environment::{EnvironmentMap, Illumination};
use crate::error::Result;
use crate::oracle::difference;
use crate::settings::{Method, TransferSettings};
use crate::sh::coefficient_count;
use crate::surfels::SurfelCloud;
use crate::synthetic;
use crate::transfer::directional::mean_radiance;
use crate::transfer::{Part, PreparedTransfer, Relit};

/// Surfels of the usual scene, about half of them on the ball.
const SURFELS: usize = 60;

/// Relights of a chain there and back.
const CHAIN: usize = 50;

type Check = fn(&Trial<'_>) -> std::result::Result<(), String>;

/// All cases.
pub fn all() -> Vec<Case> {
    let mut cases = lights();
    cases.extend(settings());
    cases.extend(assets());
    cases
}

/// Property that must hold, and its check.
type CaseProperty = (&'static str, Check);

fn case(
    name: &'static str,
    (property, check): CaseProperty,
    make: fn() -> Result<CaseInput>,
) -> Case {
    Case {
        name,
        property,
        make,
        check,
    }
}

const BOUNDED: CaseProperty = ("bounded", bounded);
const SCALE_INVARIANT: CaseProperty = ("scale-invariant", scale_invariant);
const BLACK: CaseProperty = ("black", black);
const AS_AT_UNIT_SCALE: CaseProperty = ("as at scale 1", as_at_unit_scale);
const FINITE: CaseProperty = ("finite", nothing_more);
const IS_REFUSED: CaseProperty = (REFUSED, nothing_more);

fn nothing_more(_: &Trial<'_>) -> std::result::Result<(), String> {
    Ok(())
}

// ---- inputs ----

fn cloud() -> SurfelCloud {
    let mut cloud = synthetic::glossy_sphere_over_plate(SURFELS, 3);
    // As trainers store it.
    cloud.encoding = Encoding::Stored;
    for sh in &mut cloud.sh {
        *sh = sh.map(|v| 0.5 * v);
    }
    cloud
}

/// A map of its directions.
fn map(radiance: impl Fn(DVec3) -> [f32; 3] + Sync) -> EnvironmentMap {
    EnvironmentMap::of_directions(64, 32, radiance)
}

fn sky(d: DVec3) -> [f32; 3] {
    let up = 1.0 + 0.6 * d.z as f32;
    [up, up + 0.2 * d.x as f32, up + 0.3 * d.y as f32]
}

fn other_sky(d: DVec3) -> [f32; 3] {
    let side = 0.4 + 0.5 * (d.x as f32).max(0.0);
    [1.5 * side, side, 0.7 * side]
}

fn usual() -> CaseInput {
    CaseInput {
        cloud: cloud(),
        source: map(sky),
        target: map(other_sky),
        gains: [1.0; 2],
        epsilon: None,
        degree: 3,
    }
}

fn with_source(radiance: impl Fn(DVec3) -> [f32; 3] + Sync) -> Result<CaseInput> {
    Ok(CaseInput {
        source: map(radiance),
        ..usual()
    })
}

fn with_target(radiance: impl Fn(DVec3) -> [f32; 3] + Sync) -> Result<CaseInput> {
    Ok(CaseInput {
        target: map(radiance),
        ..usual()
    })
}

fn with_cloud(change: impl Fn(&mut SurfelCloud)) -> Result<CaseInput> {
    let mut cloud = cloud();
    change(&mut cloud);
    Ok(CaseInput { cloud, ..usual() })
}

fn with_epsilon(epsilon: f32) -> Result<CaseInput> {
    Ok(CaseInput {
        epsilon: Some(epsilon),
        ..usual()
    })
}

fn with_degree(degree: usize) -> Result<CaseInput> {
    Ok(CaseInput { degree, ..usual() })
}

fn strong(gains: [f32; 2]) -> Result<CaseInput> {
    Ok(CaseInput { gains, ..usual() })
}

fn resize(cloud: &mut SurfelCloud, factor: f32) {
    cloud.positions.iter_mut().for_each(|p| *p *= factor);
    cloud.scales.iter_mut().for_each(|s| *s *= factor);
}

/// Radiance of one pixel of the map.
fn pixel(d: DVec3, radiance: f32) -> [f32; 3] {
    let toward = DVec3::new(0.5, -0.3, 0.8).normalize();
    if d.dot(toward) > 0.998 {
        [radiance; 3]
    } else {
        [0.0; 3]
    }
}

// ---- properties ----

fn holds(holds: bool, otherwise: String) -> std::result::Result<(), String> {
    if holds { Ok(()) } else { Err(otherwise) }
}

/// Within what the ratio of the lights allows: what divides is at least epsilon's share.
fn bounded(trial: &Trial<'_>) -> std::result::Result<(), String> {
    let [source, target] = &trial.lights;
    let mean = source.mean_irradiance();
    if trial.source_was_black || mean <= 0.0 {
        return Ok(());
    }
    // No irradiance is above that of the whole light from one side, and bounces at most double it; a truncated series overshoots by half.
    let most = 4.0 * 2.0 * 1.5 * (target.mean_irradiance() / mean).max(1.0);
    let limit = most / trial.settings.epsilon().max(1e-6) + most;
    let largest = trial
        .relit
        .tau
        .iter()
        .flatten()
        .fold(0f32, |a, t| a.max(t.abs()));
    let otherwise = format!("tau is {largest:.1e}, and the lights allow {limit:.1e}");
    holds(largest <= limit, otherwise)
}

fn black(trial: &Trial<'_>) -> std::result::Result<(), String> {
    let linear = trial.relit.clone().linear();
    let largest = linear.sh.iter().flatten().fold(0f32, |a, v| a.max(v.abs()));
    let otherwise = format!("under a black light it still shows {largest:.1e}");
    holds(largest < 1e-4, otherwise)
}

fn same(a: &Relit, b: &Relit, tolerance: f32) -> std::result::Result<(), String> {
    let size = a.sh.iter().flatten().fold(1e-6f32, |s, v| s.max(v.abs()));
    let pairs = a.sh.iter().flatten().zip(b.sh.iter().flatten());
    let off = pairs.fold(0f32, |off, (a, b)| off.max((a - b).abs())) / size;
    let otherwise = format!("differs by {off:.1e} of the largest, {tolerance:.0e} is allowed");
    holds(off <= tolerance, otherwise)
}

fn in_words<T>(result: Result<T>) -> std::result::Result<T, String> {
    result.map_err(|e| e.to_string())
}

/// Checks that the result is that of an even source.
fn as_with_even_light(trial: &Trial<'_>) -> std::result::Result<(), String> {
    let even = Illumination::even(crate::sh::MAX_DEGREE);
    let lights = [&even, &trial.lights[1]];
    let relit = in_words(trial.again(trial.cloud, lights, &trial.settings))?;
    same(&relit, &trial.relit, 1e-6)
}

/// Both lights a thousand times as strong change nothing.
fn scale_invariant(trial: &Trial<'_>) -> std::result::Result<(), String> {
    let stronger = trial.lights.each_ref().map(|l| l.scaled(1e3));
    let relit = in_words(trial.again(trial.cloud, [&stronger[0], &stronger[1]], &trial.settings))?;
    same(&trial.relit, &relit, 1e-4)
}

/// More epsilon never makes the largest change larger.
fn monotone_in_epsilon(trial: &Trial<'_>) -> std::result::Result<(), String> {
    let mut last = f32::INFINITY;
    for epsilon in [1e-6, 1e-4, 1e-2, 1.0, 1e2] {
        let settings = TransferSettings {
            epsilon: Some(epsilon),
            ..trial.settings.clone()
        };
        let [source, target] = &trial.lights;
        let relit = in_words(trial.again(trial.cloud, [source, target], &settings))?;
        // How unlike the change is from surfel to surfel.
        let tau = || relit.tau.iter().map(|t| t[1]);
        let (low, high) = tau().fold((f32::INFINITY, 0f32), |(l, h), t| (l.min(t), h.max(t)));
        let range = high - low;
        if range > 1.02 * last + 1e-4 {
            return Err(format!(
                "at {epsilon} the change ranges over {range}, before {last}"
            ));
        }
        last = range;
    }
    Ok(())
}

/// There and back many times: the directional method is to come back the first time, and what becomes of it is told.
fn comes_back(trial: &Trial<'_>) -> std::result::Result<(), String> {
    let [source, target] = &trial.lights;
    let mut cloud = trial.cloud.clone();
    let normals = trial.bake.normals();
    let start = mean_radiance(&cloud, normals);
    let mut drifts = Vec::new();
    for turn in 1..=CHAIN {
        for lights in [[source, target], [target, source]] {
            let relit = in_words(trial.again(&cloud, lights, &trial.settings))?;
            cloud.sh = relit.stored(&cloud).into();
        }
        let now = mean_radiance(&cloud, normals);
        let outward_sides = || {
            now.iter()
                .zip(&start)
                .flat_map(|(a, b)| a[0].into_iter().zip(b[0]))
        };
        let off: f32 = outward_sides().map(|(a, b)| (a - b) * (a - b)).sum();
        let all: f32 = outward_sides().map(|(_, b)| b * b).sum();
        let drift = (off / all).sqrt();
        if !drift.is_finite() {
            return Err(format!("no numbers after {turn} turns"));
        }
        drifts.push(drift);
    }
    trial.note(format!(
        "drift after 1, 10 and {CHAIN} turns: {:.1e}, {:.1e}, {:.1e}",
        drifts[0],
        drifts[9],
        drifts[CHAIN - 1]
    ));
    // Less than a tenth of a stop is not seen.
    let limit = match trial.settings.method {
        Method::Directional => 0.05,
        Method::Harmonic => f32::INFINITY,
    };
    let otherwise = format!("once there and back it is off by {}", drifts[0]);
    holds(drifts[0] <= limit, otherwise)
}

/// Checks that the result is that of the usual scene, whatever its unit.
fn as_at_unit_scale(trial: &Trial<'_>) -> std::result::Result<(), String> {
    let usual = usual();
    let bake = in_words(bake(&usual.cloud, trial.settings.method))?;
    let prepared = PreparedTransfer::new(&usual.cloud, &bake, &trial.lights[0], &trial.settings);
    let relit = in_words(prepared.and_then(|p| p.relight(&trial.lights[1], Part::Whole)))?;
    let relit = relit.of_degree(usual.cloud.sh_degree);
    // Powers of two round nothing; all else is relative to the object's radius.
    let off = difference(&trial.relit.sh, &relit.sh).0;
    let otherwise = format!("it is {off:.1e} off what it is at scale 1");
    holds(off < 1e-6, otherwise)
}

// ---- the cases ----

fn lights() -> Vec<Case> {
    vec![
        case("the usual scene", BOUNDED, || Ok(usual())),
        case("near-black source", SCALE_INVARIANT, || strong([1e-20; 2])),
        case(
            "black source",
            ("as with uniform white light", as_with_even_light),
            || with_source(|_| [0.0; 3]),
        ),
        case("source without red", BOUNDED, || {
            with_source(|d| {
                let [_, g, b] = sky(d);
                [0.0, g, b]
            })
        }),
        case("source of one colour alone", BOUNDED, || {
            with_source(|d| [sky(d)[0], 0.0, 0.0])
        }),
        case("source from one half", BOUNDED, || {
            with_source(|d| if d.x > 0.0 { sky(d) } else { [0.0; 3] })
        }),
        case("source from below alone", BOUNDED, || {
            with_source(|d| if d.z < 0.0 { [1.0; 3] } else { [0.0; 3] })
        }),
        case("a sun of a million skies as source", BOUNDED, || {
            with_source(|d| {
                let (sun, sky) = (pixel(d, 1e6), sky(d));
                std::array::from_fn(|c| sun[c] + sky[c])
            })
        }),
        case("a sun of a million skies as target", BOUNDED, || {
            with_target(|d| {
                let (sun, sky) = (pixel(d, 1e6), sky(d));
                std::array::from_fn(|c| sun[c] + sky[c])
            })
        }),
        case("a source of one pixel", BOUNDED, || {
            with_source(|d| pixel(d, 1.0))
        }),
        case("a target of one pixel", BOUNDED, || {
            with_target(|d| pixel(d, 1.0))
        }),
        case("black target", BLACK, || with_target(|_| [0.0; 3])),
        case(
            "pixels that are no numbers, negative or 1e30",
            FINITE,
            || {
                with_target(|d| {
                    if d.z > 0.9 {
                        [f32::NAN, f32::INFINITY, -1.0]
                    } else if d.z < -0.9 {
                        [1e30; 3]
                    } else {
                        sky(d)
                    }
                })
            },
        ),
        case("a map of one pixel", BOUNDED, || {
            Ok(CaseInput {
                target: EnvironmentMap::new(1, 1, vec![[2.0, 1.0, 0.5]]),
                ..usual()
            })
        }),
        case("maps of one row and of one column", BOUNDED, || {
            Ok(CaseInput {
                source: EnvironmentMap::new(512, 1, vec![[1.0; 3]; 512]),
                target: EnvironmentMap::new(1, 512, vec![[0.5, 1.0, 1.0]; 512]),
                ..usual()
            })
        }),
        case("a map 16384 pixels wide", BOUNDED, || {
            let (width, height) = (16384, 256);
            let pixels = (0..width * height).map(|i| [0.5 + (i % 7) as f32; 3]);
            Ok(CaseInput {
                target: EnvironmentMap::new(width, height, pixels.collect()),
                ..usual()
            })
        }),
    ]
}

fn settings() -> Vec<Case> {
    vec![
        case("epsilon 0", IS_REFUSED, || with_epsilon(0.0)),
        case("epsilon 1e-6", BOUNDED, || with_epsilon(1e-6)),
        case("epsilon 1e3", BOUNDED, || with_epsilon(1e3)),
        case(
            "epsilon from 1e-6 to 1e2",
            ("monotone", monotone_in_epsilon),
            || Ok(usual()),
        ),
        case("degree 8", SCALE_INVARIANT, || with_degree(8)),
        case("degree 0", BOUNDED, || with_degree(0)),
        case("target 40 stops stronger", FINITE, || {
            strong([1.0, 40f32.exp2()])
        }),
        case("target 40 stops weaker", BLACK, || {
            strong([1.0, (-40f32).exp2()])
        }),
        case("both 40 stops stronger", SCALE_INVARIANT, || {
            strong([40f32.exp2(); 2])
        }),
        case("both 40 stops weaker", SCALE_INVARIANT, || {
            strong([(-40f32).exp2(); 2])
        }),
        case(
            "there and back fifty times",
            ("finite; best comes back once", comes_back),
            || Ok(usual()),
        ),
    ]
}

fn assets() -> Vec<Case> {
    vec![
        case("no surfel", FINITE, || {
            with_cloud(|c| *c = synthetic::sphere(0))
        }),
        case("one surfel", BOUNDED, || {
            with_cloud(|c| *c = synthetic::sphere(1))
        }),
        case("surfels without extent", BOUNDED, || {
            with_cloud(|c| c.scales.iter_mut().step_by(2).for_each(|s| *s = Vec2::ZERO))
        }),
        case("surfels of 1e-20 and of 1e6", BOUNDED, || {
            with_cloud(|c| {
                c.scales
                    .iter_mut()
                    .step_by(3)
                    .for_each(|s| *s = Vec2::splat(1e-20));
                c.scales[1] = Vec2::splat(1e6);
            })
        }),
        case("needles", BOUNDED, || {
            with_cloud(|c| c.scales.iter_mut().for_each(|s| s.y *= 1e-4))
        }),
        case("all transparent", BOUNDED, || {
            with_cloud(|c| c.opacities.fill(0.0))
        }),
        case("all opaque", BOUNDED, || {
            with_cloud(|c| c.opacities.fill(1.0))
        }),
        case("all at one point", BOUNDED, || {
            with_cloud(|c| c.positions.fill(Vec3::ONE))
        }),
        case("all on a line", BOUNDED, || {
            with_cloud(|c| c.positions.iter_mut().for_each(|p| *p = Vec3::X * p.x))
        }),
        case("every surfel buried", BOUNDED, || {
            with_cloud(|c| {
                let mut shell = synthetic::sphere(400);
                shell.scales.iter_mut().for_each(|s| *s *= 1.5);
                shell.sh = vec![[0.1; 3]; coefficient_count(c.sh_degree) * shell.len()].into();
                resize(c, 0.05);
                c.add(&shell, 2.0, Vec3::ZERO);
            })
        }),
        case("coefficients of 1e4", FINITE, || {
            with_cloud(|c| {
                c.sh.iter_mut()
                    .step_by(5)
                    .for_each(|f| *f = [1e4, -1e4, 1e4])
            })
        }),
        case("a black asset", BLACK, || {
            with_cloud(|c| {
                c.encoding = Encoding::StoredLinear;
                c.sh.fill([0.0; 3]);
                let offset = c.encoding.offset();
                let k = coefficient_count(c.sh_degree);
                for f in c.sh.chunks_exact_mut(k) {
                    f[0] = [-offset * crate::sh::SQRT_4PI as f32; 3];
                }
            })
        }),
        case("colour of degree 8", SCALE_INVARIANT, || {
            with_cloud(|c| *c = synthetic::glossy_sphere_over_plate(SURFELS, 8))
        }),
        case("a scene of 2^-20", AS_AT_UNIT_SCALE, || {
            with_cloud(|c| resize(c, (-20f32).exp2()))
        }),
        case("a scene of 2^20", AS_AT_UNIT_SCALE, || {
            with_cloud(|c| resize(c, 20f32.exp2()))
        }),
        case("a thousand radii from the origin", BOUNDED, || {
            with_cloud(|c| {
                c.positions
                    .iter_mut()
                    .for_each(|p| *p += Vec3::new(1e3, -1e3, 1e3))
            })
        }),
        case("detail of 1e-3 at 1e5 from the origin", BOUNDED, || {
            with_cloud(|c| {
                c.positions
                    .iter_mut()
                    .for_each(|p| *p = *p * 1e-2 + Vec3::splat(1e5));
                c.scales.iter_mut().for_each(|s| *s *= 1e-2);
            })
        }),
    ]
}
