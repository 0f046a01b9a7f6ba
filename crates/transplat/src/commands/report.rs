//! `transplat report`: presets and single terms against path-traced truth.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use rayon::prelude::*;
use transplat_core::camera::{Camera, NEAR};
use transplat_core::environment::Illumination;
use transplat_core::export::{PngBits, write_png};
use transplat_core::load::{load_asset, load_cameras, load_environment, load_picture};
use transplat_core::present::PLAIN;
use transplat_core::rasterize::Raster;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{Part, PreparedTransfer, Preset, Relit, Terms, TransferSettings};
use transplat_core::visibility::{Bake, BakeSettings, no_progress};

use crate::cli::ReportArgs;
use crate::commands::refuse_overwriting;
use crate::device::{Device, Paint, Painter};
use crate::metrics::Picture;
use crate::report::{Report, milliseconds};
use crate::scene::progress_bar;
use crate::truth::{TruthLight, TruthObject};

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
    let variants = Variant::all(args.quick);
    let bar = progress_bar("comparing with the truth", &report);
    let mut rows = Vec::new();
    for (i, object) in objects.iter().enumerate() {
        bar.set_position((1000 * i / objects.len()) as u64);
        let scene = TruthScene::load(object, &device)
            .with_context(|| format!("the object {}", object.name))?;
        for variant in &variants {
            rows.extend(scene.score(variant, &device, &pictures)?);
        }
    }
    bar.finish_and_clear();
    write(&table, &csv(&rows))?;
    let text = markdown(&rows, &variants);
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
    std::fs::write(path, text).with_context(|| path.display().to_string())
}

/// What is compared: the capture as it is, or a preset with terms switched off.
#[derive(Clone, Debug, PartialEq)]
struct Variant {
    settings: Option<TransferSettings>,
    off: Vec<&'static str>,
}

impl Variant {
    /// The presets; unless that is enough, also with each of their terms off.
    fn all(quick: bool) -> Vec<Self> {
        let mut all = Vec::new();
        for preset in Preset::ALL {
            let whole = TransferSettings::of(preset);
            all.push(Self {
                settings: Some(whole.clone()),
                off: Vec::new(),
            });
            for term in Terms::of_preset(preset).filter(|_| !quick) {
                let mut settings = whole.clone();
                *(term.of)(&mut settings.terms) = false;
                all.push(Self {
                    settings: Some(settings),
                    off: vec![term.name],
                });
            }
        }
        all.push(Self {
            settings: None,
            off: Vec::new(),
        });
        all
    }

    fn preset(&self) -> &'static str {
        self.settings
            .as_ref()
            .map_or("nothing", |s| s.preset.name())
    }

    fn name(&self) -> String {
        match &self.off[..] {
            [] => self.preset().to_owned(),
            off => format!("{} without {}", self.preset(), off.join(", ")),
        }
    }

    /// Whether it is what the program does of itself.
    fn is_default(&self) -> bool {
        self.settings == Some(TransferSettings::default())
    }
}

/// One line of the table.
#[derive(Clone, Debug)]
struct Row {
    object: String,
    source: String,
    target: String,
    variant: Variant,
    psnr: f64,
    psnr_mask: f64,
    ssim: f64,
    perceptual: f64,
    transfer_ms: Option<f64>,
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

    /// Relights by all targets and compares; of what the program does of itself it writes the pictures, too.
    fn score(&self, variant: &Variant, device: &Device, folder: &Path) -> Result<Vec<Row>> {
        let prepared = match &variant.settings {
            Some(settings) => {
                let of_preset = self.bakes.iter().find(|b| b.preset() == settings.preset);
                let bake = of_preset.context("a bake for each preset")?;
                let prepared = PreparedTransfer::new(&self.cloud, bake, &self.source, settings)?;
                Some(prepared)
            }
            None => None,
        };
        let mut rows = Vec::new();
        for target in &self.targets {
            let (relit, ms) = match &prepared {
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
    let mut transfer = device.transfer(prepared)?;
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

fn csv(rows: &[Row]) -> String {
    let mut out = String::from(
        "object,source,target,preset,terms_off,psnr,psnr_mask,ssim,perceptual,transfer_ms\n",
    );
    for r in rows {
        let ms = r.transfer_ms.map_or(String::new(), |ms| format!("{ms:.2}"));
        // Writing to a string does not fail.
        let _ = writeln!(
            out,
            "{},{},{},{},{},{:.3},{:.3},{:.5},{:.2},{ms}",
            r.object,
            r.source,
            r.target,
            r.variant.preset(),
            r.variant.off.join(" "),
            r.psnr,
            r.psnr_mask,
            r.ssim,
            r.perceptual,
        );
    }
    out
}

/// What each term carries, and each pair of the presets.
fn markdown(rows: &[Row], variants: &[Variant]) -> String {
    let of = |variant: &Variant| -> Vec<&Row> {
        rows.iter().filter(|r| r.variant == *variant).collect()
    };
    let mean = |rows: &[&Row], value: &dyn Fn(&Row) -> f64| {
        rows.iter().map(|r| value(r)).sum::<f64>() / rows.len().max(1) as f64
    };
    let mut out = String::from(
        "| transfer | PSNR | to its preset | worst pair | PSNR in the mask | SSIM | SSIMULACRA2 | new light |\n|---|---|---|---|---|---|---|---|\n",
    );
    for variant in variants {
        let these = of(variant);
        let whole = variants
            .iter()
            .find(|v| v.off.is_empty() && v.preset() == variant.preset());
        let whole = whole.map_or(Vec::new(), of);
        let gains = || these.iter().zip(&whole).map(|(a, b)| a.psnr - b.psnr);
        let worst = gains().fold(f64::INFINITY, f64::min);
        let (gain, worst) = if variant.off.is_empty() {
            (String::new(), String::new())
        } else {
            let gain = gains().sum::<f64>() / these.len().max(1) as f64;
            (format!("{gain:+.2}"), format!("{worst:+.2}"))
        };
        let times: Vec<f64> = these.iter().filter_map(|r| r.transfer_ms).collect();
        let time = if times.is_empty() {
            String::new()
        } else {
            milliseconds(times.iter().sum::<f64>() / times.len() as f64)
        };
        let _ = writeln!(
            out,
            "| {} | {:.2} | {gain} | {worst} | {:.2} | {:.4} | {:.1} | {time} |",
            variant.name(),
            mean(&these, &|r| r.psnr),
            mean(&these, &|r| r.psnr_mask),
            mean(&these, &|r| r.ssim),
            mean(&these, &|r| r.perceptual),
        );
    }
    let wholes: Vec<&Variant> = variants.iter().filter(|v| v.off.is_empty()).collect();
    let names: Vec<String> = wholes.iter().map(|v| v.name()).collect();
    let _ = writeln!(
        out,
        "\n| object | target | {} |\n|---|---|{}",
        names.join(" | "),
        "---|".repeat(names.len())
    );
    for first in of(wholes[0]) {
        let scores: Vec<String> = wholes
            .iter()
            .filter_map(|v| {
                let same = |r: &&Row| {
                    r.variant == **v && r.object == first.object && r.target == first.target
                };
                rows.iter().find(same).map(|r| format!("{:.2}", r.psnr))
            })
            .collect();
        let _ = writeln!(
            out,
            "| {} | {} | {} |",
            first.object,
            first.target,
            scores.join(" | ")
        );
    }
    out
}
