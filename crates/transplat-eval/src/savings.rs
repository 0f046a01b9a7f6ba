//! Savings of optimizations: each measured once with and once without.

use std::ops::ControlFlow;
use std::time::Instant;

use anyhow::{Result, bail};
use transplat_core::bake::Bake;
use transplat_core::bake::harmonic::DEFAULT_DIRECTIONS;
use transplat_core::camera::{Camera, CameraPose};
use transplat_core::present::PLAIN;
use transplat_core::progress::no_progress;
use transplat_core::rasterize::{rasterize, shade};
use transplat_core::settings::optimizations::{Optimization, Optimizations, SkippedWork, Stage};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::surfels::SurfelFilter;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use crate::sweep::Subject;
use transplat_engine::words::milliseconds;

/// Per cent of a stage's time that repeats differ by.
const NOISE: f64 = 3.0;

/// Pixels along the edge of the picture in which errors are looked for.
const SIZE: usize = 400;

/// Something that was left out, and what that was worth.
#[derive(Clone, Debug)]
pub struct Saved {
    /// Work that is skipped.
    pub skipped: SkippedWork,
    /// Method that skips it.
    pub method: Method,
    /// Milliseconds that the stage took less; negative where that is lost in the noise.
    pub time_saved_ms: f64,
    /// Milliseconds that the stage took.
    pub time_ms: f64,
    /// Largest difference of a channel of a pixel, display-encoded, 0 to 1.
    pub max_error: f64,
}

impl Saved {
    /// The time with its share of what the stage would have taken; what measuring cannot tell is not told.
    pub fn time_in_words(&self) -> String {
        let all = self.time_saved_ms + self.time_ms;
        let share = 100.0 * self.time_saved_ms / all.max(1e-9);
        if share < NOISE {
            return "no time to speak of".into();
        }
        format!("{} ({share:.0} %)", milliseconds(self.time_saved_ms))
    }

    /// Nothing where there is none.
    pub fn memory_in_words(&self) -> String {
        match self.skipped.bytes {
            0 => String::new(),
            bytes => format!("{:.1} MB", bytes as f64 / 1e6),
        }
    }

    /// Largest difference of a pixel.
    pub fn error_in_words(&self) -> String {
        if self.max_error == 0.0 {
            "the image is the same".into()
        } else {
            format!("a pixel differs by up to {:.1e}", self.max_error)
        }
    }

    /// All of that.
    pub fn in_words(&self) -> String {
        let memory = match self.memory_in_words() {
            memory if memory.is_empty() => memory,
            memory => format!(" and {memory}"),
        };
        format!(
            "saved {} in the {}{memory}; {}",
            self.time_in_words(),
            self.skipped.stage.name(),
            self.error_in_words()
        )
    }
}

/// Optimizations of a scene, measured.
#[derive(Clone, Debug, Default)]
pub struct Savings {
    /// Optimizations with their savings.
    pub saved: Vec<Saved>,
    /// Optimizations that do not apply, by method, with the reason.
    pub needed: Vec<(Method, &'static str)>,
}

/// An asset with some skips, ready to be relit.
struct Run {
    optimizations: Optimizations,
    bake: Bake,
    prepared: PreparedTransfer,
    relit: Relit,
    skipped_work: Vec<SkippedWork>,
    unseen: Vec<bool>,
}

/// Measures on the CPU what leaving out saves on an asset between two lights; `progress` may break off.
pub fn measure(
    subject: &Subject,
    repeats: usize,
    progress: &(dyn Fn(f64, &str) -> ControlFlow<()> + Sync),
) -> Result<Savings> {
    let mut savings = Savings::default();
    let all = Optimization::ALL.into_iter();
    let of_method = |p: Method| all.clone().filter(move |s| s.methods().contains(&p));
    let steps: usize = Method::ALL.map(|p| 1 + of_method(p).count()).iter().sum();
    let mut done = 0.0;
    for method in Method::ALL {
        let mut next = |what: &str| -> Result<()> {
            if progress(done / steps as f64, what).is_break() {
                bail!("cancelled");
            }
            done += 1.0;
            Ok(())
        };
        next("as it is")?;
        // A kept bake does not know what was left out of it.
        let with = run(subject, method, Optimizations::default(), None)?;
        let skipped_work = |skip| {
            with.skipped_work
                .iter()
                .find(|s| s.skip == Some(skip))
                .cloned()
        };
        let is_open = skipped_work(Optimization::OpenObject).is_some();
        for skip in of_method(method) {
            next(skip.name())?;
            match skipped_work(skip) {
                Some(skipped) => {
                    let saved = compare(subject, method, &with, (skip, skipped), repeats)?;
                    savings.saved.push(saved);
                }
                // Without any rays there are none to spare.
                None if skip.is_of_rays() && is_open => {}
                None => savings.needed.push((method, skip.needed())),
            }
        }
    }
    Ok(savings)
}

/// With something left out, and with it done all the same.
fn compare(
    subject: &Subject,
    method: Method,
    with: &Run,
    (skip, skipped): (Optimization, SkippedWork),
    repeats: usize,
) -> Result<Saved> {
    let forced = Optimizations::default().without(skip);
    let is_bake = skip.stage() == Stage::Bake;
    // The bake is the same unless it is what is forced.
    let kept = (!is_bake).then_some(&with.bake);
    let each = [with, &run(subject, method, forced, kept)?];
    let [time_ms, forced_ms] = if is_bake {
        let again = |i: usize| bake(subject, method, each[i].optimizations).map(drop);
        alternating(repeats.div_ceil(7), again)?
    } else {
        alternating(repeats, |i| each[i].relight(subject).map(drop))?
    };
    let [ours, theirs] = each.map(|run| picture(subject, run));
    let pairs = ours.iter().flatten().zip(theirs.iter().flatten());
    Ok(Saved {
        skipped,
        method,
        time_saved_ms: forced_ms - time_ms,
        time_ms,
        max_error: pairs.fold(0.0, |e, (a, b)| e.max(f64::from((a - b).abs()))),
    })
}

/// Median milliseconds of two works that take turns, so that what else the machine does slows both.
fn alternating(repeats: usize, work: impl Fn(usize) -> Result<()>) -> Result<[f64; 2]> {
    let mut times = [Vec::new(), Vec::new()];
    for _ in 0..repeats {
        for (i, times) in times.iter_mut().enumerate() {
            let start = Instant::now();
            work(i)?;
            times.push(start.elapsed().as_secs_f64() * 1e3);
        }
    }
    Ok(times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[times.len() / 2]
    }))
}

fn bake(subject: &Subject, method: Method, optimizations: Optimizations) -> Result<Bake> {
    let cloud = &subject.cloud;
    let made = Bake::with_optimizations(
        cloud,
        method,
        DEFAULT_DIRECTIONS,
        &optimizations,
        &no_progress,
    );
    Ok(made?)
}

fn run(
    subject: &Subject,
    method: Method,
    optimizations: Optimizations,
    kept: Option<&Bake>,
) -> Result<Run> {
    let cloud = &subject.cloud;
    let settings = TransferSettings {
        optimizations,
        ..TransferSettings::of(method)
    };
    let bake = kept.map_or_else(
        || bake(subject, method, optimizations),
        |kept| Ok(kept.clone()),
    )?;
    let [source, target] = &subject.lights;
    let prepared = PreparedTransfer::new(cloud, &bake, source, &settings)?;
    let unseen = SurfelFilter::default().unseen(cloud, &cloud.bounds(), &optimizations);
    let relit = prepared.relight_seen(target, Part::Whole, &unseen)?;
    let mut skipped_work = bake.skipped_work();
    skipped_work.extend(prepared.skipped_work(cloud));
    skipped_work.extend(prepared.skipped_work_for(target, false));
    skipped_work.extend(SkippedWork::of_unseen(&unseen));
    Ok(Run {
        optimizations,
        bake,
        prepared,
        relit,
        skipped_work,
        unseen,
    })
}

impl Run {
    fn relight(&self, subject: &Subject) -> Result<Relit> {
        let (target, unseen) = (&subject.lights[1], &self.unseen);
        Ok(self.prepared.relight_seen(target, Part::Whole, unseen)?)
    }
}

/// The relit asset from one side.
fn picture(subject: &Subject, run: &Run) -> Vec<[f32; 3]> {
    let cloud = &subject.cloud;
    let bounds = cloud.bounds();
    let pose = CameraPose::around(&bounds, -60.0, 30.0, 3.5, 35.0);
    let camera = Camera::from_pose(&pose, cloud.up, [SIZE, SIZE], bounds.radius);
    let (sh, degree, encoding) = (&run.relit.sh, run.relit.degree, run.relit.encoding);
    let colors = shade(&cloud.positions, sh, degree, encoding, camera.eye, PLAIN);
    let raster = rasterize(cloud, &camera, &colors, &run.unseen);
    let pixels = raster.pixels.iter();
    pixels.map(|[r, g, b, _]| [*r, *g, *b]).collect()
}
