//! Part *truth* of the report: methods and single terms against path-traced truth.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use rayon::prelude::*;
use transplat_core::bake::Bake;
use transplat_core::environment::Illumination;
use transplat_core::files::{PngBits, load_splat, write_png};
use transplat_core::progress::no_progress;
use transplat_core::settings::Method;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use super::Measurement;
use super::page::write;
use super::tables::{LightEstimate, RoundTrip, TruthRow, csv, markdown};
use super::unknown::Unknown;
use super::variants::{Approach, TruthVariant};
use crate::ground_truth::TruthObject;
use crate::ground_truth::views::{TruthTarget, Views, light};
use crate::metrics::ComparedImage;
use transplat_engine::device::Device;
use transplat_engine::output::make_folder;

/// Changes of light whose median time is told.
const REPEATS: usize = 3;

/// Factor of the difference in the images.
const DIFFERENCE_SCALE: f32 = 4.0;

/// Selects objects by name; all where no name is given.
pub fn asked(mut objects: Vec<TruthObject>, asked: &[String]) -> Result<Vec<TruthObject>> {
    for asked in asked {
        if !objects.iter().any(|o| o.name == *asked) {
            let names: Vec<&str> = objects.iter().map(|o| &*o.name).collect();
            bail!("--objects {asked}: there are {}", names.join(", "));
        }
    }
    if !asked.is_empty() {
        objects.retain(|o| asked.contains(&o.name));
    }
    Ok(objects)
}

/// Comparison with path-traced truth.
pub struct Comparison<'a> {
    /// Objects with their truth.
    pub objects: &'a [TruthObject],
    /// True to compare estimated and even capture light, too.
    pub has_unknown_light: bool,
    /// Directions of the harmonic method's bake.
    pub directions: usize,
}

/// Result of a comparison.
pub struct Compared {
    /// Pairs of an object and a target light.
    pub pairs: usize,
    /// Tables for people.
    pub tables: String,
}

/// Compares objects with their truth; writes `truth.csv`, `truth.md` and images.
///
/// # Errors
/// A file cannot be read or written, or the device failed.
pub fn run(of: &Comparison<'_>, how: Measurement<'_>, device: &Device) -> Result<Compared> {
    let pictures = how.output.join("pictures");
    make_folder(&pictures)?;
    let variants = TruthVariant::all(how.is_quick, of.has_unknown_light);
    let (objects, directions) = (of.objects, of.directions);
    let mut rows: Vec<TruthRow> = Vec::new();
    let mut round_trips: Vec<RoundTrip> = Vec::new();
    let mut estimates: Vec<LightEstimate> = Vec::new();
    for (i, object) in objects.iter().enumerate() {
        if (how.steps)(i as f64 / objects.len() as f64, &object.name).is_break() {
            bail!("cancelled");
        }
        let scene = TruthSubject::load(object, device, directions)
            .with_context(|| format!("the object {}", object.name))?;
        let unknown = of.has_unknown_light.then(|| scene.unknown()).transpose()?;
        for variant in &variants {
            let prepared = scene.prepare(variant, unknown.as_ref())?;
            rows.extend(scene.score(variant, prepared.as_ref(), device, &pictures)?);
            if let Some(prepared) = prepared.filter(|_| variant.is_whole_preset()) {
                round_trips.push(scene.round_trip(variant, &prepared, device)?);
            }
        }
        estimates.extend(unknown.map(|u| u.estimate));
    }
    write(&how.output.join(TRUTH_CSV), &csv(&rows))?;
    let tables = markdown(&rows, &round_trips, &estimates, &variants);
    write(&how.output.join(TRUTH_TABLES), &tables)?;
    let of_first = rows.iter().filter(|r| r.variant == variants[0]);
    Ok(Compared {
        pairs: of_first.count(),
        tables,
    })
}

/// Name of the table that [`run`] writes.
pub const TRUTH_CSV: &str = "truth.csv";
/// Name of the text that [`run`] writes.
pub const TRUTH_TABLES: &str = "truth.md";

/// An object, ready to be relit and compared.
struct TruthSubject<'a> {
    object: &'a TruthObject,
    cloud: Arc<SurfelCloud>,
    views: Views,
    source: Illumination,
    bakes: Vec<Bake>,
}

impl<'a> TruthSubject<'a> {
    fn load(object: &'a TruthObject, device: &Device, directions: usize) -> Result<Self> {
        let (cloud, _) = load_splat(&object.asset)?;
        let cloud = Arc::new(cloud);
        let bakes = Method::ALL.map(|p| Bake::new(&cloud, p, directions, &no_progress));
        Ok(Self {
            object,
            views: Views::load(object, &cloud, device)?,
            source: light(&object.source, device)?,
            bakes: bakes.into_iter().collect::<transplat_core::Result<_>>()?,
            cloud,
        })
    }

    fn bake(&self, method: Method) -> Result<&Bake> {
        let of_method = self.bakes.iter().find(|b| b.method() == method);
        of_method.context("a bake for each preset")
    }

    fn prepare(
        &self,
        variant: &TruthVariant,
        unknown: Option<&Unknown>,
    ) -> Result<Option<PreparedTransfer>> {
        if let Approach::Known(settings) = &variant.approach {
            let bake = self.bake(settings.method)?;
            let prepared = PreparedTransfer::new(&self.cloud, bake, &self.source, settings)?;
            return Ok(Some(prepared));
        }
        let bake = self.bake(Method::Directional)?;
        let prepared = unknown.map(|u| u.prepare(&variant.approach, &self.cloud, bake));
        Ok(prepared.transpose()?.flatten())
    }

    fn unknown(&self) -> Result<Unknown> {
        let bake = self.bake(Method::Directional)?;
        Unknown::new(self.object, &self.cloud, bake, &self.source)
    }

    /// Relights by the light of the capture, which should return it.
    fn round_trip(
        &self,
        variant: &TruthVariant,
        prepared: &PreparedTransfer,
        device: &Device,
    ) -> Result<RoundTrip> {
        let (relit, _) = relight(device, prepared, &self.source)?;
        let captured = self.views.pictures(None)?.into_iter();
        let pairs = captured.zip(self.views.pictures(Some(&relit))?);
        let scores = pairs.map(|(captured, back)| back.psnr(&captured, None));
        let scores = scores.collect::<Result<Vec<f64>>>()?;
        Ok(RoundTrip {
            object: self.object.name.clone(),
            method: variant.method(),
            psnr: scores.iter().sum::<f64>() / scores.len() as f64,
        })
    }

    /// Relights by all targets and compares; of what the program does of itself it writes the pictures, too.
    fn score(
        &self,
        variant: &TruthVariant,
        prepared: Option<&PreparedTransfer>,
        device: &Device,
        folder: &Path,
    ) -> Result<Vec<TruthRow>> {
        let mut rows = Vec::new();
        for target in &self.views.targets {
            let relit = prepared.map(|p| relight(device, p, &target.illumination));
            let (relit, ms) = relit.transpose()?.unzip();
            let ours = self.views.pictures(relit.as_ref())?;
            if variant.is_default() {
                let name = format!("{}_{}.png", self.object.name, target.light.name);
                write_side_by_side(&folder.join(name), &target.pictures, &ours)?;
            }
            rows.push(self.row(variant, target, &ours, ms)?);
        }
        Ok(rows)
    }

    fn row(
        &self,
        variant: &TruthVariant,
        target: &TruthTarget,
        ours: &[ComparedImage],
        transfer_ms: Option<f64>,
    ) -> Result<TruthRow> {
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
        Ok(TruthRow {
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

/// Relights, and tells how long a change of light takes.
fn relight(
    device: &Device,
    prepared: &PreparedTransfer,
    light: &Illumination,
) -> Result<(Relit, f64)> {
    let mut transfer = device.transfer_here(prepared)?;
    let mut times = Vec::new();
    for _ in 0..REPEATS {
        let start = Instant::now();
        transfer.change_light(light, Part::Whole, &[])?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    Ok((transfer.result()?, times[REPEATS / 2]))
}

/// A row a camera: the truth, ours, and how far they are apart.
fn write_side_by_side(path: &Path, truth: &[ComparedImage], ours: &[ComparedImage]) -> Result<()> {
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
