//! `transplat report`: presets and single terms against path-traced truth.

mod tables;
mod unknown;
mod variants;

use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use rayon::prelude::*;
use transplat_core::camera::{Camera, NEAR};
use transplat_core::environment::Illumination;
use transplat_core::export::{PngBits, write_atomically, write_png};
use transplat_core::load::{load_asset, load_cameras, load_environment, load_picture};
use transplat_core::present::PLAIN;
use transplat_core::rasterize::Raster;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{Part, PreparedTransfer, Preset, Relit};
use transplat_core::visibility::{Bake, BakeSettings, no_progress};

use crate::cli::ReportArgs;
use crate::commands::refuse_overwriting;
use crate::device::{Device, Paint, Painter};
use crate::metrics::Picture;
use crate::report::Report;
use crate::scene::progress_bar;
use crate::truth::{TruthLight, TruthObject};

use tables::{RoundTrip, Row, csv, markdown};
use unknown::Unknown;
use variants::Variant;

/// Changes of light whose median time is told.
const REPEATS: usize = 3;

/// What the difference in the pictures is multiplied by.
const DIFFERENCE_SCALE: f32 = 4.0;

pub fn run(args: &ReportArgs) -> Result<()> {
    let mut report = Report::new("report", &args.out);
    let mut objects = TruthObject::all_in(&args.ground_truth)?;
    for asked in &args.objects {
        if !objects.iter().any(|o| o.name == *asked) {
            let names: Vec<&str> = objects.iter().map(|o| &*o.name).collect();
            bail!("--objects {asked}: there are {}", names.join(", "));
        }
    }
    if !args.objects.is_empty() {
        objects.retain(|o| args.objects.contains(&o.name));
    }
    let table = args.output.join("truth.csv");
    let summary = args.output.join("truth.md");
    refuse_overwriting(objects.iter().map(|o| &*o.asset), [&*table, &*summary])?;
    let pictures = args.output.join("pictures");
    std::fs::create_dir_all(&pictures).with_context(|| pictures.display().to_string())?;
    let device = Device::open(args.device)?;
    report.set("adapter", device.name());
    let variants = Variant::all(args.quick, args.unknown_light);
    let bar = progress_bar("comparing with the truth", &report);
    let (mut rows, mut round_trips, mut estimates) = (Vec::new(), Vec::new(), Vec::new());
    for (i, object) in objects.iter().enumerate() {
        bar.set_position((1000 * i / objects.len()) as u64);
        if bar.is_hidden() && !report.is_quiet() {
            eprintln!("{} ({} of {})", object.name, i + 1, objects.len());
        }
        let scene = TruthScene::load(object, &device)
            .with_context(|| format!("the object {}", object.name))?;
        let unknown = args
            .unknown_light
            .then(|| scene.unknown(&device))
            .transpose()?;
        for variant in &variants {
            let light = unknown.as_ref().and_then(|u| u.light(variant.source));
            let prepared = scene.prepare(variant, light.as_ref())?;
            rows.extend(scene.score(variant, prepared.as_ref(), &device, &pictures)?);
            if let Some(prepared) = prepared.filter(|_| variant.is_whole_preset()) {
                round_trips.push(scene.round_trip(variant, &prepared, &device)?);
            }
        }
        estimates.extend(unknown.map(|u| u.told));
    }
    bar.finish_and_clear();
    write(&table, &csv(&rows))?;
    let text = markdown(&rows, &round_trips, &estimates, &variants);
    write(&summary, &text)?;
    report.set(
        "pairs",
        rows.iter().filter(|r| r.variant == variants[0]).count(),
    );
    report.set("table", table.display().to_string());
    report.finish(&format!(
        "{text}\nwrote {}, {} and the pictures in {}",
        table.display(),
        summary.display(),
        pictures.display()
    ))
}

fn write(path: &Path, text: &str) -> Result<()> {
    Ok(write_atomically(path, |out| {
        out.write_all(text.as_bytes())
    })?)
}

/// The truth under one light.
struct TruthTarget {
    light: TruthLight,
    illumination: Illumination,
    /// One a camera.
    pictures: Vec<Picture>,
    /// Pixels that the object covers for the most part.
    masks: Vec<Vec<bool>>,
}

/// An object, ready to be relit and compared.
struct TruthScene<'a> {
    object: &'a TruthObject,
    cloud: Arc<SurfelCloud>,
    painter: Painter,
    cameras: Vec<Camera>,
    source: Illumination,
    targets: Vec<TruthTarget>,
    bakes: Vec<Bake>,
}

impl<'a> TruthScene<'a> {
    fn load(object: &'a TruthObject, device: &Device) -> Result<Self> {
        let (cloud, _) = load_asset(&object.asset)?;
        let cloud = Arc::new(cloud);
        let file = load_cameras(&object.cameras)?;
        let light = |light: &TruthLight| -> Result<Illumination> {
            device.light(&load_environment(&light.path)?, Preset::Best)
        };
        let targets = object
            .targets
            .iter()
            .map(|target| {
                let rasters = load_pictures(&object.pictures(target)?, file.frames.len())?;
                Ok(TruthTarget {
                    light: target.clone(),
                    illumination: light(target)?,
                    pictures: rasters.iter().map(Picture::of_linear).collect(),
                    masks: rasters
                        .iter()
                        .map(|r| r.pixels.iter().map(|p| p[3] > 0.5).collect())
                        .collect(),
                })
            })
            .collect::<Result<Vec<TruthTarget>>>()?;
        let near = NEAR * cloud.bounds().radius;
        let first = targets.first().and_then(|t| t.pictures.first());
        let size = first.map(|p| [p.width, p.height]).or(file.size);
        let size = size.with_context(|| format!("{}: no size", object.cameras.display()))?;
        let bakes =
            Preset::ALL.map(|p| Bake::new(&cloud, p, &BakeSettings::default(), &no_progress));
        Ok(Self {
            object,
            painter: device.painter(&cloud)?.0,
            cameras: file
                .frames
                .iter()
                .map(|f| Camera::from_opengl_pose(f.world_from_camera, file.fov_x, size, near))
                .collect(),
            source: light(&object.source)?,
            targets,
            bakes: bakes.into_iter().collect::<transplat_core::Result<_>>()?,
            cloud,
        })
    }

    fn bake(&self, preset: Preset) -> Result<&Bake> {
        let of_preset = self.bakes.iter().find(|b| b.preset() == preset);
        of_preset.context("a bake for each preset")
    }

    /// Prepares from a light of the capture; from the one that is told where none is given.
    fn prepare(
        &self,
        variant: &Variant,
        light: Option<&Illumination>,
    ) -> Result<Option<PreparedTransfer>> {
        let Some(settings) = &variant.settings else {
            return Ok(None);
        };
        let bake = self.bake(settings.preset)?;
        let light = light.unwrap_or(&self.source);
        let prepared = PreparedTransfer::new(&self.cloud, bake, light, settings)?;
        Ok(Some(prepared))
    }

    fn unknown(&self, device: &Device) -> Result<Unknown> {
        let bake = self.bake(Preset::Best)?;
        Unknown::new(&self.object.name, &self.cloud, bake, &self.source, device)
    }

    /// Relights by the light of the capture, which should return it.
    fn round_trip(
        &self,
        variant: &Variant,
        prepared: &PreparedTransfer,
        device: &Device,
    ) -> Result<RoundTrip> {
        let (relit, _) = relight(device, prepared, &self.source)?;
        let (captured, back) = (self.pictures(None)?, self.pictures(Some(&relit))?);
        let scores: Vec<f64> = captured
            .iter()
            .zip(&back)
            .map(|(a, b)| b.psnr(a, None))
            .collect::<Result<_>>()?;
        Ok(RoundTrip {
            object: self.object.name.clone(),
            preset: variant.preset(),
            psnr: scores.iter().sum::<f64>() / scores.len() as f64,
        })
    }

    /// Relights by all targets and compares; of what the program does of itself it writes the pictures, too.
    fn score(
        &self,
        variant: &Variant,
        prepared: Option<&PreparedTransfer>,
        device: &Device,
        folder: &Path,
    ) -> Result<Vec<Row>> {
        let mut rows = Vec::new();
        for target in &self.targets {
            let (relit, ms) = match prepared {
                Some(prepared) => {
                    let (relit, ms) = relight(device, prepared, &target.illumination)?;
                    (Some(relit), Some(ms))
                }
                None => (None, None),
            };
            let ours = self.pictures(relit.as_ref())?;
            if variant.is_default() {
                let name = format!("{}_{}.png", self.object.name, target.light.name);
                write_side_by_side(&folder.join(name), &target.pictures, &ours)?;
            }
            rows.push(self.row(variant, target, &ours, ms)?);
        }
        Ok(rows)
    }

    fn pictures(&self, relit: Option<&Relit>) -> Result<Vec<Picture>> {
        let (sh, encoding) = match relit {
            Some(relit) => (&relit.sh, relit.encoding),
            None => (&self.cloud.sh, self.cloud.encoding),
        };
        self.cameras
            .iter()
            .map(|camera| {
                let paint = Paint::Sh { sh, encoding };
                let raster = self.painter.draw(camera, paint, PLAIN, &[])?;
                Ok(Picture::of_display(&raster))
            })
            .collect()
    }

    fn row(
        &self,
        variant: &Variant,
        target: &TruthTarget,
        ours: &[Picture],
        transfer_ms: Option<f64>,
    ) -> Result<Row> {
        let scores: Vec<[f64; 4]> = ours
            .par_iter()
            .zip(&target.pictures)
            .zip(&target.masks)
            .map(|((ours, truth), mask)| {
                Ok([
                    ours.psnr(truth, None)?,
                    ours.psnr(truth, Some(mask))?,
                    ours.ssim(truth)?,
                    truth.perceptual(ours)?,
                ])
            })
            .collect::<Result<_>>()?;
        let mean = |i: usize| scores.iter().map(|s| s[i]).sum::<f64>() / scores.len() as f64;
        Ok(Row {
            object: self.object.name.clone(),
            source: self.object.source.name.clone(),
            target: target.light.name.clone(),
            variant: variant.clone(),
            psnr: mean(0),
            psnr_mask: mean(1),
            ssim: mean(2),
            perceptual: mean(3),
            transfer_ms,
        })
    }
}

/// The true pictures under one light, which are of one size and show the object.
fn load_pictures(paths: &[PathBuf], cameras: usize) -> Result<Vec<Raster>> {
    let folder = paths.first().and_then(|p| p.parent());
    let folder = folder.map_or(String::new(), |f| f.display().to_string());
    if paths.len() != cameras {
        bail!("{folder}: {} pictures for {cameras} cameras", paths.len());
    }
    let mut rasters: Vec<Raster> = Vec::new();
    for path in paths {
        let told = || path.display().to_string();
        let raster = load_picture(path)?;
        if let Some(first) = rasters.first()
            && (first.width, first.height) != (raster.width, raster.height)
        {
            bail!(
                "{}: {} x {} pixels, and the first picture has {} x {}",
                told(),
                raster.width,
                raster.height,
                first.width,
                first.height
            );
        }
        if !raster.pixels.iter().flatten().all(|v| v.is_finite()) {
            bail!("{}: holds values that are no numbers", told());
        }
        if !raster.pixels.iter().any(|p| p[3] > 0.5) {
            bail!("{}: shows nothing of the object", told());
        }
        rasters.push(raster);
    }
    Ok(rasters)
}

/// Relights, and tells how long a change of light takes.
fn relight(
    device: &Device,
    prepared: &PreparedTransfer,
    light: &Illumination,
) -> Result<(Relit, f64)> {
    let mut transfer = device.transfer(prepared)?.0;
    let mut times = Vec::new();
    for _ in 0..REPEATS {
        let start = Instant::now();
        transfer.change_light(light, Part::Whole)?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok((transfer.result()?, times[REPEATS / 2]))
}

/// A row a camera: the truth, ours, and how far they are apart.
fn write_side_by_side(path: &Path, truth: &[Picture], ours: &[Picture]) -> Result<()> {
    let Some(first) = truth.first() else {
        return Ok(());
    };
    let (width, height) = (first.width, first.height);
    let mut pixels = Vec::with_capacity(3 * width * height * truth.len());
    for (truth, ours) in truth.iter().zip(ours) {
        for (t, o) in truth
            .pixels
            .chunks_exact(width)
            .zip(ours.pixels.chunks_exact(width))
        {
            let opaque = |v: &[f32; 3]| [v[0], v[1], v[2], 1.0];
            pixels.extend(t.iter().map(opaque));
            pixels.extend(o.iter().map(opaque));
            pixels.extend(t.iter().zip(o).map(|(t, o)| {
                let d = |c: usize| (DIFFERENCE_SCALE * (t[c] - o[c]).abs()).min(1.0);
                [d(0), d(1), d(2), 1.0]
            }));
        }
    }
    let rows = height * truth.len();
    Ok(write_png(path, 3 * width, rows, &pixels, PngBits::Eight)?)
}
