//! `transplat report`: error against run time, and methods and single terms against path-traced truth.

mod insertion;

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use transplat_core::bake::harmonic::DEFAULT_DIRECTIONS;
use transplat_core::files::load_environment;
use transplat_core::scene::{Scene, is_file};
use transplat_core::settings::Method;

use crate::cli::{ReportArgs, ReportPart, usage};
use crate::commands::headless::Headless;
use crate::commands::refuse_overwriting;
use crate::commands::settings::look_of;
use crate::summary::{Summary, progress_bar};
use transplat_engine::bundled::{BUNDLED_LIGHTS, BUNDLED_SPLAT, bundled};
use transplat_engine::device::Device;
use transplat_engine::device::DeviceChoice;
use transplat_engine::output::{make_folder, refuse_file};
use transplat_eval::ground_truth::TruthObject;
use transplat_eval::ground_truth::insertion::TruthScene;
use transplat_eval::ground_truth::views::{Views, light};
use transplat_eval::report::page::{Page, write};
use transplat_eval::report::truth::{self, Comparison};
use transplat_eval::report::{Measurement, Steps, extremes, skipped, time};
use transplat_eval::sweep::Subject;

/// Name of the page, beside the tables.
const PAGE: &str = "report.html";

pub fn run(args: &ReportArgs) -> Result<()> {
    let mut summary = Summary::new("report", &args.out);
    let parts = args.parts();
    let of_truth = parts.contains(&ReportPart::Truth);
    if of_truth && args.asset.is_some() && args.ground_truth.is_none() {
        return usage("the part truth of a splat needs --ground-truth DIR");
    }
    if !of_truth && (args.unknown_light || !args.objects.is_empty()) {
        return usage(
            "--objects and --unknown-light are of the part truth (--only truth, --ground-truth)",
        );
    }
    let scenes = match (&args.ground_truth, parts.contains(&ReportPart::Insertion)) {
        (_, false) => Vec::new(),
        (Some(folder), true) => TruthScene::all_in(folder)?,
        (None, true) => return usage("the part insertion needs --ground-truth DIR"),
    };
    let objects = match &args.ground_truth {
        _ if !of_truth => Vec::new(),
        Some(folder) => truth::asked(TruthObject::all_in(folder)?, &args.objects)?,
        None => truth::asked(bundled_objects()?, &args.objects)?,
    };
    let outputs: Vec<PathBuf> = parts
        .iter()
        .flat_map(|part| part.files())
        .map(|name| args.output.join(name))
        .collect();
    let inputs = objects
        .iter()
        .map(|o| o.asset.clone())
        .chain(scenes.iter().flat_map(TruthScene::inputs))
        .chain(args.asset.clone());
    let inputs: Vec<PathBuf> = inputs.collect();
    refuse_overwriting(inputs.iter().map(|p| &**p), &outputs)?;
    refuse_file(&args.output)?;
    let device = Device::open(args.options.device)?;
    summary.set("adapter", device.name());
    let mut page = Page::new("transplat: report");
    page.paragraph(&measured_what(args));
    let mut told = String::new();
    let is_of_subject =
        |part: &ReportPart| !matches!(part, ReportPart::Truth | ReportPart::Insertion);
    let subject = if parts.iter().any(is_of_subject) {
        Some(subject(args, &device, &mut summary)?)
    } else {
        None
    };
    make_folder(&args.output)?;
    let quiet = summary.quiet;
    let steps = |what: &'static str| {
        let bar = progress_bar(quiet, what);
        move |done: f64, what: &str| {
            bar.set_position((1000.0 * done) as u64);
            if bar.is_hidden() && !quiet {
                eprintln!("{:3.0} % {what}", 100.0 * done);
            }
            ControlFlow::Continue(())
        }
    };
    if let Some(subject) = &subject {
        let devices = devices(args.options.device, &mut summary);
        if parts.contains(&ReportPart::Time) {
            page.paragraph(&format!(
                "{} Gaussians of SH degree {}, on {}.",
                subject.cloud.len(),
                subject.cloud.sh_degree,
                device.name()
            ));
            let steps = &steps("measuring settings");
            let how = with_steps(args, steps);
            let measured = || time::run(how, subject, &devices, &mut page);
            let measured = summary.time("sweep", measured)?;
            summary.set("points", measured.points);
            told += &measured.words;
        }
        if parts.contains(&ReportPart::Extremes) {
            let steps = &steps("extreme cases");
            let how = with_steps(args, steps);
            let tried = extremes::run(how, subject, &devices, &mut page)?;
            summary.add_ms("extremes", tried.ms);
            let [cases, failed] = tried.cases;
            summary.set("extreme_cases", cases);
            summary.set("extreme_cases_failed", failed);
            told += &tried.words;
        }
        if parts.contains(&ReportPart::Skipped) {
            let steps = &steps("what was left out");
            let how = with_steps(args, steps);
            let savings = summary.time("skips", || skipped::run(how, subject, &mut page))?;
            savings.saved.iter().for_each(|saved| summary.saved(saved));
            told += &skipped::in_words(&savings);
        }
    }
    if !objects.is_empty() {
        let comparison = Comparison {
            objects: &objects,
            has_unknown_light: args.unknown_light,
            directions: args.options.directions.unwrap_or(DEFAULT_DIRECTIONS),
        };
        let steps = &steps("comparing with the truth");
        let compared = truth::run(&comparison, with_steps(args, steps), &device)?;
        summary.set("pairs", compared.pairs);
        let table = args.output.join(truth::TRUTH_CSV);
        summary.set("table", table.display().to_string());
        let names: Vec<&str> = objects.iter().map(|o| &*o.name).collect();
        page.heading("Against path-traced truth");
        page.paragraph(&format!(
            "{}. Rows, objects and lights by themselves are in {} and {}; images of truth, relight and four times their difference, a row a camera, in pictures/.",
            names.join(", "),
            truth::TRUTH_CSV,
            truth::TRUTH_TABLES
        ));
        page.preformatted(&compared.tables);
        told += &compared.tables;
    }
    if !scenes.is_empty() {
        let table = insertion::run(&scenes, args, &device, &mut summary)?;
        page.heading("Objects put into captured scenes");
        page.paragraph(&format!(
            "PSNR in dB on the object, on ground and on other things that it changes, and on the whole image; the ground's bias, and the share of its true change that is shown. The table is {}, the images are in pictures/SCENE/OBJECT/WAY.",
            insertion::INSERTION_CSV
        ));
        page.preformatted(&table);
        told += &table;
    }
    let html = args.output.join(PAGE);
    write(&html, &page.finish("transplat: report"))?;
    summary.set("page", html.display().to_string());
    summary.finish(&format!("{told}\nwrote {}", args.output.display()))
}

/// The bundled splats with their truth.
fn bundled_objects() -> Result<Vec<TruthObject>> {
    let missing = "the bundled scene is not installed; name a splat with --source and --target";
    let splat = bundled(BUNDLED_SPLAT).context(missing)?;
    TruthObject::all_bundled(splat.parent().context(missing)?)
}

/// The asset between two lights: the bundled scene with its truth unless another is named.
fn subject(args: &ReportArgs, device: &Device, summary: &mut Summary) -> Result<Subject> {
    let Some(asset) = &args.asset else {
        let object = bundled_objects()?.swap_remove(0);
        let (cloud, _) = transplat_core::files::load_splat(&object.asset)?;
        let cloud = Arc::new(cloud);
        let target = object.targets.first().context("a light with truth")?;
        return Ok(Subject {
            map: Some(load_environment(&target.path)?),
            lights: [light(&object.source, device)?, light(target, device)?],
            views: Some(Views::load(&object, &cloud, device)?),
            cloud,
            bakes: Vec::new(),
        });
    };
    let Some(source) = &args.source else {
        return usage(
            "a report on a splat needs --source (an environment, \"estimate\" or \"even\")",
        );
    };
    let target = match &args.target {
        Some(target) => target.clone(),
        None => bundled(BUNDLED_LIGHTS[1]).context("name the light to relight by: --target")?,
    };
    if !is_file(&target) {
        bail!(
            "{}: the target of a report is an environment",
            target.display()
        );
    }
    let mut scene = look_of(&args.options, None)?;
    scene.objects[0].source.set_file(source.clone());
    scene.objects[0].asset = Some(asset.clone());
    let mut headless = Headless::load(args.options.device, scene, summary)?;
    let map = load_environment(&target)?;
    let lights = [
        headless.source_light(summary)?,
        device.light(&map, Method::Directional)?,
    ];
    let up = headless.shots.cloud.up;
    let plain = Scene::default();
    let lights = plain.lights_on(lights.each_ref(), up);
    Ok(Subject {
        cloud: headless.shots.cloud,
        map: Some(map),
        lights,
        views: None,
        bakes: Vec::new(),
    })
}

/// Subject of the figures, for the page.
fn measured_what(args: &ReportArgs) -> String {
    let name = |path: &Path| {
        let name = path.file_name().unwrap_or(path.as_os_str());
        name.to_string_lossy().into_owned()
    };
    let mut what = match (&args.asset, &args.source, &args.target) {
        (Some(asset), Some(source), target) => {
            let target = target.as_deref().unwrap_or(Path::new(BUNDLED_LIGHTS[1]));
            format!(
                "{}, captured under {}, relit by {}",
                name(asset),
                name(source),
                name(target)
            )
        }
        _ => "The bundled scene".to_owned(),
    };
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    what += &format!(
        "; transplat {}, {threads} threads of {}",
        env!("CARGO_PKG_VERSION"),
        std::env::consts::ARCH
    );
    if args.quick {
        what += ", fewer repeats and settings (--quick)";
    }
    what + "."
}

/// The CPU, and the GPU; a driver that computes on the CPU only where it is asked for.
fn devices(choice: DeviceChoice, summary: &mut Summary) -> Vec<Device> {
    let mut devices = vec![Device::Cpu];
    if choice == DeviceChoice::Cpu {
        return devices;
    }
    match Device::gpu(choice == DeviceChoice::Gpu) {
        Ok(device) => devices.push(device),
        Err(error) => summary.skip("the GPU", &error.to_string()),
    }
    devices
}

/// Settings of a part, followed by `steps`.
fn with_steps<'a>(args: &'a ReportArgs, steps: Steps<'a>) -> Measurement<'a> {
    Measurement {
        output: &args.output,
        is_quick: args.quick,
        steps,
    }
}
