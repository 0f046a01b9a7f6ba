//! `transplat probe`: the light at a place in a scene, as its splat shows it, into a file.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use glam::Vec3;
use transplat_core::bake::Bake;
use transplat_core::bake::strata::DIRECTIONS;
use transplat_core::capture_environment::CaptureEnvironment;
use transplat_core::environment::EnvironmentMap;
use transplat_core::estimate::{Estimate, estimate_light};
use transplat_core::files::{check_output, write_environment};
use transplat_core::probe::{Beyond, Probe, RadianceToward};
use transplat_core::progress::no_progress;
use transplat_core::scene::{EnvironmentLight, Transform, is_estimate, is_even, is_sky};
use transplat_core::settings::Method;
use transplat_core::surfels::SurfelCloud;

use super::headless::{Headless, read_map, report_estimate};
use super::settings::scene_of;
use crate::cli::{LightArgs, ProbeArgs, usage};
use crate::commands::refuse_overwriting;
use crate::summary::Summary;
use transplat_engine::bake::{self, BakeRequest};
use transplat_engine::device::Painter;
use transplat_engine::environments::SKY_COLUMNS;
use transplat_engine::names::{as_file_name, distinct_names, name_of};
use transplat_engine::output::make_folder;
use transplat_engine::render::light_at;
use transplat_engine::words::percent;

/// Share of the sphere that may be open before it is worth a warning that nothing is known of it.
const OPEN: f64 = 0.01;

/// Share of the light that may be clipped before it is worth a warning.
const CLIPPED: f64 = 0.005;

/// Distance from which on radiance is sky, in medians of the surfels' distances.
const FAR: f32 = 6.0;

pub fn run(args: &ProbeArgs) -> Result<()> {
    let mut summary = Summary::new("probe", &args.out);
    let (scene, light) = scene_of(&args.asset, &LightArgs::default())?;
    let inputs = light.inputs(&scene, &[]).map(PathBuf::from);
    let beyond = [&args.environment, &args.clipped_like];
    let beyond = beyond.into_iter().flatten().cloned();
    let inputs: Vec<PathBuf> = inputs.chain(beyond).collect();
    let is_file = args.at.len() == 1;
    let extension = args.output.extension().unwrap_or_default();
    if is_file && !extension.eq_ignore_ascii_case("exr") {
        bail!("{}: the light is written as .exr", args.output.display());
    }
    let headless = Headless::load(args.asset.options.device, scene, &mut summary)?;
    let places = args.at.iter().map(|at| place(&headless, at));
    let places: Vec<Place> = places.collect::<Result<_>>()?;
    let outputs: Vec<PathBuf> = if is_file {
        vec![args.output.clone()]
    } else {
        if extension.eq_ignore_ascii_case("exr") && !args.output.is_dir() {
            bail!(
                "{}: {} places do not fit into one file; give a folder",
                args.output.display(),
                places.len()
            );
        }
        let shown = headless.shown();
        let called: Vec<String> = shown.map(|(o, asset)| name_of(o, &asset.path)).collect();
        let called = |(i, place): (usize, &Place)| match place.object {
            Some(object) => as_file_name(&called[object]),
            None => format!("{i:03}"),
        };
        let names = distinct_names(places.iter().enumerate().map(called));
        let file = |name| args.output.join(format!("{name}.exr"));
        names.into_iter().map(file).collect()
    };
    refuse_overwriting(inputs.iter().map(|p| &**p), &outputs)?;
    if is_file {
        check_output(&args.output)?;
    } else {
        make_folder(&args.output)?;
    }
    let without = args
        .without
        .iter()
        .map(|name| object_named(&headless, name));
    let without: Vec<usize> = without.collect::<Result<_>>()?;
    let environment = args.environment.clone().map(EnvironmentLight::of);
    let environment = environment
        .or_else(|| Some(headless.first().0.source.clone()).filter(|s| s.file.is_some()));
    let is_requested = args.clipped_like.as_deref().is_some_and(is_estimate) && without.is_empty();
    let mut completed = Vec::new();
    for place in &places {
        let object = place.object.filter(|_| is_requested);
        completed.push(match object {
            Some(object) => completed_around(&headless, object, args.rows, &mut summary)?,
            None => None,
        });
    }
    let is_needed = |light: &EnvironmentLight| {
        let is_estimate = light.file.as_deref().is_some_and(is_estimate);
        !is_estimate || completed.iter().any(Option::is_none)
    };
    let environment = environment.filter(is_needed);
    let first = places.first().context("there is a place")?.at;
    let around = ProbeEnvironment::load(&headless, first, environment, &mut summary)?;
    let like = (args.clipped_like.clone().map(EnvironmentLight::of)).filter(is_needed);
    let like = ProbeEnvironment::load(&headless, first, like, &mut summary)?;
    let (painter, warning) = headless.shots.device.painter(&headless.shots.cloud)?;
    if let Some(warning) = warning {
        summary.warn(warning);
    }
    let mut told = Vec::new();
    for ((place, output), completed) in places.iter().zip(&outputs).zip(completed) {
        let without = without.iter().chain(&place.object).copied();
        let lights = Lights {
            around: around.as_ref(),
            clipped_gain: (args.clipped_gain as f32).exp2(),
            clipped_like: like.as_ref(),
        };
        let mut probe = summary.time("probe", || {
            seen(&headless, (&painter, without), place.at, args.rows, &lights)
        })?;
        tell(
            &probe,
            place.at,
            around.is_some() || completed.is_some(),
            like.is_some() || args.clipped_gain > 0.0 || completed.is_some(),
            &mut summary,
        );
        let is_completed = completed.is_some();
        probe.map = completed.unwrap_or(probe.map);
        summary.time("export", || write_environment(output, &probe.map))?;
        told.push(serde_json::json!({
            "at": (headless.first().1.cloud.origin + place.at.as_dvec3()).to_array(),
            "open_share": probe.open_share,
            "clipped_share": probe.clipped_share,
            "clipped_light": probe.clipped_light,
            "is_completed": is_completed,
        }));
    }
    summary.set("places", told);
    let names: Vec<String> = outputs.iter().map(|o| o.display().to_string()).collect();
    summary.set("outputs", names.clone());
    summary.finish(&format!("wrote {}", names.join(", ")))
}

/// Where a probe is, and the object that it is of, if any.
struct Place {
    at: Vec3,
    object: Option<usize>,
}

/// Coordinates, or the middle of an object, which is left out then.
fn place(headless: &Headless, at: &str) -> Result<Place> {
    let numbers: Option<Vec<f64>> = at.split(',').map(|v| v.trim().parse().ok()).collect();
    if let Some(&[x, y, z]) = numbers.as_deref() {
        let at = headless.place([x, y, z]);
        if !at.is_finite() {
            return usage("--at: three numbers X,Y,Z are expected, or the name of an object");
        }
        return Ok(Place { at, object: None });
    }
    let which = object_named(headless, at)?;
    let (object, asset) = headless.shown().nth(which).context("it is shown")?;
    let scene_from_object = object.transform.scene_from_object();
    Ok(Place {
        at: scene_from_object.transform_point3(asset.cloud.bounds().center),
        object: Some(which),
    })
}

fn object_named(headless: &Headless, name: &str) -> Result<usize> {
    let shown = headless.shown();
    let names = distinct_names(shown.map(|(o, asset)| name_of(o, &asset.path)));
    let found = names.iter().position(|n| n == name);
    found.with_context(|| {
        format!(
            "{name}: no place X,Y,Z, and no object of the scene; those are {}",
            names.join(", ")
        )
    })
}

/// An environment around a scene.
pub struct ProbeEnvironment {
    map: EnvironmentMap,
    settings: EnvironmentLight,
}

/// Light beyond what the splat shows.
#[derive(Default)]
pub struct Lights<'a> {
    /// Where it is open.
    pub around: Option<&'a ProbeEnvironment>,
    /// Factor of clipped radiance; 0 where none is set.
    pub clipped_gain: f32,
    /// Environment that clipped radiance is taken from.
    pub clipped_like: Option<&'a ProbeEnvironment>,
}

impl ProbeEnvironment {
    /// Reads one that settings name, if they do.
    pub fn load(
        headless: &Headless,
        place: Vec3,
        settings: Option<EnvironmentLight>,
        summary: &mut Summary,
    ) -> Result<Option<Self>> {
        let Some((settings, file)) = settings.and_then(|s| Some((s.clone(), s.file?))) else {
            return Ok(None);
        };
        let map = if is_estimate(&file) {
            estimated_near(headless, place, summary)?
        } else if is_even(&file) {
            EnvironmentMap::even()
        } else if is_sky(&file) {
            let sky = headless.shots.project.scene.environment.sky();
            sky.unwrap_or_default().map(SKY_COLUMNS)
        } else {
            read_map(&file, &headless.reading_of(&file), summary)?
        };
        Ok(Some(Self { map, settings }))
    }

    /// Radiance from a direction of the scene.
    fn radiance(&self, headless: &Headless) -> impl Fn(Vec3) -> [f32; 3] {
        let turn = self
            .settings
            .map_from_asset(headless.shots.cloud.up)
            .as_mat3();
        let gain = self.settings.gain();
        move |d| {
            let radiance = self.map.sample(turn * d);
            std::array::from_fn(|c| gain[c] * radiance[c])
        }
    }
}

/// Light at a shown object that the rest of its capture encloses, completed by its own shading.
fn completed_around(
    headless: &Headless,
    object: usize,
    rows: usize,
    summary: &mut Summary,
) -> Result<Option<EnvironmentMap>> {
    let (settings, asset) = headless.shown().nth(object).context("it is shown")?;
    let part = (asset.part.as_ref()).filter(|_| settings.transform == Transform::default());
    let Some(shown) = part.and_then(|part| part.enclosing_light.as_deref()) else {
        return Ok(None);
    };
    let estimate = estimated(headless, asset.cloud.clone(), Some(shown), summary)?;
    let up = headless.shots.project.scene_up();
    let map = || estimate.light.map(up).reduced(2 * rows);
    Ok(estimate.is_told().then(map))
}

/// Estimate of the light on some surfels.
fn estimated(
    headless: &Headless,
    cloud: Arc<SurfelCloud>,
    shown: Option<&CaptureEnvironment>,
    summary: &mut Summary,
) -> Result<Estimate> {
    let scene = &headless.shots.project.scene;
    let wanted = BakeRequest {
        cloud,
        method: Method::Directional,
        directions: DIRECTIONS,
        optimizations: scene.transfer.optimizations,
        part_of: None,
        place: None,
    };
    let bake = || bake::bake(&headless.shots.device, &wanted, &no_progress);
    let Bake::Directional(bake) = summary.time("bake", bake)? else {
        bail!("the bake is for the other method");
    };
    let estimate = || estimate_light(&wanted.cloud, &bake, shown, &no_progress);
    let estimate = summary.time("estimate", estimate)?;
    let up = headless.shots.project.scene_up();
    report_estimate(&estimate, scene, up, summary);
    Ok(estimate)
}

/// The light that a scene was captured under, as what is lit of it tells: a sky that was captured with it lies far away, and shines itself.
fn estimated_near(
    headless: &Headless,
    place: Vec3,
    summary: &mut Summary,
) -> Result<EnvironmentMap> {
    let (_, asset) = headless.first();
    let cloud = &asset.cloud;
    let distance = |i: usize| cloud.positions[i].distance(place);
    let mut distances: Vec<f32> = (0..cloud.len()).map(distance).collect();
    let middle = distances.len() / 2;
    let (_, median, _) = distances.select_nth_unstable_by(middle, f32::total_cmp);
    let reach = FAR * *median;
    let taken: Vec<usize> = (0..cloud.len()).filter(|i| distance(*i) < reach).collect();
    let near = Arc::new(cloud.selected(&taken));
    let estimate = estimated(headless, near, None, summary)?;
    let up = headless.shots.project.scene_up();
    Ok(match estimate.obstacle {
        Some(_) => EnvironmentMap::even(),
        None => estimate.light.map(up),
    })
}

/// The light at a place, some objects left out.
pub fn seen(
    headless: &Headless,
    (painter, without): (&Painter, impl Iterator<Item = usize>),
    at: Vec3,
    rows: usize,
    lights: &Lights<'_>,
) -> Result<Probe> {
    let cloud = &headless.shots.cloud;
    let mut hidden = vec![false; cloud.len()];
    let firsts = headless.shown().scan(0, |next, (_, asset)| {
        let first = *next;
        *next += asset.cloud.len();
        Some(first..*next)
    });
    let ranges: Vec<_> = firsts.collect();
    for object in without {
        hidden[ranges[object].clone()].fill(true);
    }
    let [around, like] =
        [lights.around, lights.clipped_like].map(|light| light.map(|l| l.radiance(headless)));
    let beyond = Beyond {
        environment: around.as_ref().map(|f| f as RadianceToward<'_>),
        clipped_gain: lights.clipped_gain,
        clipped_like: like.as_ref().map(|f| f as RadianceToward<'_>),
    };
    light_at((cloud, painter, &hidden), (at, rows), beyond)
}

/// Tells what the scene does not show.
fn tell(probe: &Probe, at: Vec3, knows_around: bool, mends_clipped: bool, summary: &mut Summary) {
    if probe.open_share > OPEN && !knows_around {
        summary.warn(format!(
            "{at}: the scene is open in {} of all directions, and the light there is unknown; set it with --environment",
            percent(probe.open_share)
        ));
    }
    if probe.clipped_light > CLIPPED && !mends_clipped {
        summary.warn(format!(
            "{at}: {} of all directions are clipped at white ({} of the scene's light, as it is): it was brighter there; --clipped-gain STOPS or --clipped-like estimate|ENV brings some of it back",
            percent(probe.clipped_share),
            percent(probe.clipped_light)
        ));
    }
}
