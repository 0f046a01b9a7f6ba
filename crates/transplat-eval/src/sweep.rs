//! Sweep over settings: run time of each stage, and error of the result.
//!
//! Two errors, never mixed. *Numerical*: against the f64 oracle of the same mathematics with everything at its best, on a thinned asset, since
//! the oracle asks every surfel about every other. *Model*: against path-traced truth, where there is any, on the whole asset.

mod reference;
mod settings;
mod subject;

use std::time::Instant;

use anyhow::{Context, Result, bail};
use transplat_core::bake::Bake;
use transplat_core::bake::harmonic::{BakeInput, DEFAULT_DIRECTIONS, HarmonicBake, bake_receivers};
use transplat_core::environment::EnvironmentMap;
use transplat_core::oracle;
use transplat_core::progress::no_progress;
pub use transplat_core::settings::optimizations::Stage;
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{Part, PreparedTransfer};

use reference::Reference;
pub use settings::{MapBake, Setting};
pub use subject::{Effort, Numeric, Subject};
use transplat_engine::device::Device;

/// One setting of one stage on one device.
#[derive(Clone, Debug)]
pub struct Point {
    /// Setting that was measured.
    pub setting: Setting,
    /// Name of the device.
    pub device: String,
    /// Stage that was measured.
    pub stage: Stage,
    /// Run time.
    pub time: Option<Timing>,
    /// Memory of the result.
    pub memory_bytes: Option<usize>,
    /// Error against the f64 reference.
    pub numeric: Option<Numeric>,
    /// PSNR in dB to path-traced truth, the mean over lights and views.
    pub psnr_truth: Option<f64>,
    /// True where nothing that was measured is both quicker and nearer.
    pub on_front: bool,
}

/// The stages that are measured.
pub const STAGES: [Stage; 4] = [Stage::Project, Stage::Bake, Stage::Prepare, Stage::Transfer];

/// A median time with what repeats spread: half the distance between the quartiles.
#[derive(Clone, Copy, Debug)]
pub struct Timing {
    /// Median, in milliseconds.
    pub ms: f64,
    /// Spread of repeats, in milliseconds.
    pub spread_ms: Option<f64>,
}

/// Repeats of what is quick, and how long all of them may take in seconds.
const REPEATS: usize = 9;
const PATIENCE: f64 = 2.0;

/// Runs once for the result, and again for the time.
fn timed<T>(mut work: impl FnMut() -> Result<T>) -> Result<(T, Timing)> {
    let start = Instant::now();
    let result = work()?;
    let first = start.elapsed().as_secs_f64();
    let mut times = Vec::new();
    while times.len() < REPEATS && start.elapsed().as_secs_f64() < PATIENCE {
        let start = Instant::now();
        work()?;
        times.push(start.elapsed().as_secs_f64());
    }
    // What took too long to be repeated was not warmed up either.
    if times.is_empty() {
        times.push(first);
    }
    times.sort_by(f64::total_cmp);
    let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize] * 1e3;
    let spread = 0.5 * (at(0.75) - at(0.25));
    Ok((
        result,
        Timing {
            ms: at(0.5),
            spread_ms: (times.len() > 2).then_some(spread),
        },
    ))
}

/// Measures, and tells how far it is; a `Break` ends it.
pub struct Sweep<'a> {
    subject: &'a Subject,
    devices: &'a [Device],
    effort: Effort,
    reference: Reference,
    progress: &'a (dyn Fn(f64, &str) -> std::ops::ControlFlow<()> + Sync),
    points: Vec<Point>,
    planned: usize,
}

impl<'a> Sweep<'a> {
    /// Measures all that the effort asks for; `devices` has the CPU first.
    pub fn run(
        subject: &'a Subject,
        devices: &'a [Device],
        effort: Effort,
        progress: &'a (dyn Fn(f64, &str) -> std::ops::ControlFlow<()> + Sync),
    ) -> Result<Vec<Point>> {
        if progress(0.0, "the f64 reference").is_break() {
            bail!("cancelled");
        }
        let mut sweep = Self {
            subject,
            devices,
            effort,
            reference: Reference::new(subject)?,
            progress,
            points: Vec::new(),
            planned: settings::count(subject, devices.len(), effort),
        };
        if let Some(map) = &subject.map {
            sweep.project(map)?;
        }
        let bakes = if effort == Effort::Offered {
            let [directional, harmonic] = [Method::Directional, Method::Harmonic];
            [
                sweep.default_bake(directional)?,
                sweep.default_bake(harmonic)?,
            ]
        } else {
            [sweep.bakes_of_directional()?, sweep.bakes_of_harmonic()?]
        };
        sweep.transfers(&bakes)?;
        Ok(mark_front(sweep.points))
    }

    /// Tells what is next.
    fn next(&self, what: &str) -> Result<()> {
        let done = self.points.len() as f64 / self.planned.max(1) as f64;
        if (self.progress)(done.min(1.0), what).is_break() {
            bail!("cancelled");
        }
        Ok(())
    }

    fn project(&mut self, map: &EnvironmentMap) -> Result<()> {
        let exact = oracle::project_environment(map, MAX_DEGREE);
        for (setting, samples) in settings::projections() {
            self.next(&setting.name)?;
            let Some(samples) = samples else {
                for device in self.devices {
                    let (light, time) = timed(|| device.project_environment(map, MAX_DEGREE))?;
                    self.points.push(Point {
                        time: Some(time),
                        memory_bytes: Some(size_of_val(map.pixels())),
                        numeric: Some(reference::errors(&light.coefficients, &exact)),
                        ..Point::of(&setting, device, Stage::Project)
                    });
                }
                continue;
            };
            let (got, time) = timed(|| Ok(oracle::project_samples(map, MAX_DEGREE, samples)))?;
            self.points.push(Point {
                time: Some(time),
                numeric: Some(reference::errors(&got, &exact)),
                ..Point::of(&setting, &Device::Cpu, Stage::Project)
            });
        }
        Ok(())
    }

    /// Bakes for the harmonic method; the default ones of the whole asset and of the thinned one.
    fn bakes_of_harmonic(&mut self) -> Result<[Bake; 2]> {
        let mut default = None;
        let settings = TransferSettings::of(Method::Harmonic);
        for (setting, map_bake) in settings::map_bakes(&self.subject.cloud, self.effort) {
            let devices = if setting.is_default {
                self.devices
            } else {
                &self.devices[..1]
            };
            for device in devices {
                self.next(&setting.name)?;
                let mut time = None;
                let mut bake = |cloud: &SurfelCloud| -> Result<Bake> {
                    let start = Instant::now();
                    let baked = bake_maps(device, cloud, map_bake)?;
                    time.get_or_insert(Timing {
                        ms: start.elapsed().as_secs_f64() * 1e3,
                        spread_ms: None,
                    });
                    Ok(baked)
                };
                let whole = bake(&self.subject.cloud)?;
                let thinned = bake(&self.reference.cloud)?;
                let (numeric, psnr_truth) = self.relit(&settings, &whole, &thinned)?;
                self.points.push(Point {
                    time,
                    memory_bytes: Some(whole.bytes()),
                    numeric,
                    psnr_truth,
                    ..Point::of(&setting, device, Stage::Bake)
                });
                if setting.is_default {
                    default = Some([whole, thinned]);
                }
            }
        }
        default.context("the default bake is among them")
    }

    /// A method's bake as it is by default, of the whole asset and of the thinned one.
    fn default_bake(&self, method: Method) -> Result<[Bake; 2]> {
        self.next(&format!("bake for preset {}", method.preset()))?;
        let bake = |cloud| Bake::new(cloud, method, DEFAULT_DIRECTIONS, &no_progress);
        let known = self.subject.bakes.iter().find(|b| b.method() == method);
        Ok([
            match known {
                Some(bake) => bake.clone(),
                None => bake(&self.subject.cloud)?,
            },
            match method {
                Method::Directional => self.reference.directional.clone(),
                Method::Harmonic => bake(&self.reference.cloud)?,
            },
        ])
    }

    /// Stages of the bake for the directional method; the whole one of the whole asset, and of the thinned one.
    fn bakes_of_directional(&mut self) -> Result<[Bake; 2]> {
        let settings = TransferSettings::of(Method::Directional);
        self.next("bake for preset best")?;
        let mut stages = Vec::new();
        for cloud in [&*self.subject.cloud, &self.reference.cloud] {
            stages.push(settings::staged_bakes(cloud)?);
        }
        let (mut wholes, thinned) = (stages.swap_remove(0), stages.swap_remove(0));
        for (i, (share, ms, bake)) in wholes.iter().enumerate() {
            let setting = settings::staged(*share);
            self.next(&setting.name)?;
            let (numeric, psnr_truth) = self.relit(&settings, bake, &thinned[i].2)?;
            self.points.push(Point {
                time: Some(Timing {
                    ms: *ms,
                    spread_ms: None,
                }),
                memory_bytes: Some(bake.bytes()),
                numeric,
                psnr_truth,
                ..Point::of(&setting, &Device::Cpu, Stage::Bake)
            });
        }
        let directional = wholes.pop().context("a whole bake")?.2;
        Ok([directional, self.reference.directional.clone()])
    }

    fn transfers(&mut self, bakes: &[[Bake; 2]; 2]) -> Result<()> {
        let subject = self.subject;
        let (cloud, source) = (&subject.cloud, &subject.lights[0]);
        for setting in settings::transfers(self.effort) {
            let wanted = &setting.settings;
            let [whole, thinned] = match wanted.method {
                Method::Directional => &bakes[0],
                Method::Harmonic => &bakes[1],
            };
            let (whole, thinned) = (&*setting.blurred(whole), &*setting.blurred(thinned));
            let is_blurred = setting.visibility_degree.is_some();
            let only_cpu = setting.samples.is_some() || is_blurred;
            let devices = if only_cpu {
                &self.devices[..1]
            } else {
                self.devices
            };
            for device in devices {
                self.next(&setting.name)?;
                let prepare = || Ok(PreparedTransfer::new(cloud, whole, source, wanted)?);
                if setting.is_default && matches!(device, Device::Cpu) {
                    let (prepared, time) = timed(prepare)?;
                    self.points.push(Point {
                        time: Some(time),
                        memory_bytes: Some(prepared.bytes()),
                        ..Point::of(&setting, device, Stage::Prepare)
                    });
                }
                let prepared = prepare()?;
                let mut transfer = device.transfer_here(&prepared)?;
                let (_, mut time) =
                    timed(|| transfer.change_light(&subject.lights[1], Part::Whole, &[]))?;
                if let Some(samples) = setting.samples {
                    time.ms += self.reference.reflection_ms(&prepared, subject, samples);
                }
                // It is not what it would take if it were made for that.
                let time = Some(time).filter(|_| !is_blurred);
                let (numeric, psnr_truth) = self.relit_by(device, &setting, &prepared, thinned)?;
                self.points.push(Point {
                    time,
                    memory_bytes: Some(prepared.bytes()),
                    numeric,
                    psnr_truth,
                    ..Point::of(&setting, device, Stage::Transfer)
                });
            }
        }
        Ok(())
    }

    /// Both errors of a method as it is by default, on a bake of the whole asset and one of the thinned.
    fn relit(&self, settings: &TransferSettings, whole: &Bake, thinned: &Bake) -> Result<Errors> {
        let source = &self.subject.lights[0];
        let prepared = PreparedTransfer::new(&self.subject.cloud, whole, source, settings)?;
        let setting = Setting::plain(settings.clone());
        self.relit_by(&Device::Cpu, &setting, &prepared, thinned)
    }

    fn relit_by(
        &self,
        device: &Device,
        setting: &Setting,
        prepared: &PreparedTransfer,
        thinned: &Bake,
    ) -> Result<Errors> {
        let [source, target] = &self.subject.lights;
        let reference = &self.reference;
        let small = PreparedTransfer::new(&reference.cloud, thinned, source, &setting.settings)?;
        let relit = match setting.samples {
            Some(samples) => reference.relit_by_samples(&small, thinned, self.subject, samples)?,
            None => device.relight(&small, target)?,
        };
        let psnr_truth = match &self.subject.views {
            Some(views) if setting.samples.is_none() => {
                Some(views.psnr(|light| device.relight(prepared, light))?)
            }
            _ => None,
        };
        let numeric = reference.compare(setting.settings.method, &relit)?;
        Ok((Some(numeric), psnr_truth))
    }
}

/// A point's `numeric` and `psnr_truth`.
type Errors = (Option<Numeric>, Option<f64>);

/// A bake for the harmonic method; another softness than the default is the CPU's alone.
fn bake_maps(device: &Device, cloud: &SurfelCloud, how: MapBake) -> Result<Bake> {
    let directions = how.directions;
    let mut input = BakeInput::new(cloud, directions);
    input.resolution = how.resolution;
    let open = match device {
        Device::Cpu => bake_receivers(&input, &input.surfels, how.softness, &no_progress)?,
        gpu => gpu.bake_harmonic(&input, &no_progress)?,
    };
    let bake = HarmonicBake::from_open(cloud, directions, open);
    Ok(Bake::Harmonic(bake.into()))
}

impl Point {
    /// A point that is not measured yet.
    fn of(setting: &Setting, device: &Device, stage: Stage) -> Self {
        Self {
            setting: setting.clone(),
            device: device.name(),
            stage,
            time: None,
            memory_bytes: None,
            numeric: None,
            psnr_truth: None,
            on_front: false,
        }
    }

    /// Error of a point, less is better: by truth where there is one, else by the oracle.
    fn error(&self) -> Option<f64> {
        match (self.psnr_truth, self.numeric) {
            (Some(psnr), _) => Some(-psnr),
            (None, Some(numeric)) => Some(numeric.rel_l2),
            _ => None,
        }
    }

    /// True where two points can be compared: one stage and device, and one method unless both have truth.
    fn is_beside(&self, other: &Self) -> bool {
        let is_transfer = self.stage == Stage::Transfer && self.psnr_truth.is_some();
        self.stage == other.stage
            && self.device == other.device
            && self.psnr_truth.is_some() == other.psnr_truth.is_some()
            && (is_transfer || self.setting.method() == other.setting.method())
    }

    /// True where it is nearer than another by 0.01 dB or 1 %: less is luck.
    fn is_nearer_than(&self, other: &Self) -> bool {
        match (self.error(), other.error()) {
            (Some(a), Some(b)) if self.psnr_truth.is_some() => a < b - 0.01,
            (Some(a), Some(b)) => a < 0.99 * b,
            _ => false,
        }
    }
}

/// Marks what nothing beats in both: from the quickest on, each that is nearer than all before it.
fn mark_front(mut points: Vec<Point>) -> Vec<Point> {
    let key = |p: &Point| Some((p.time?.ms, p.error()?));
    let mut order: Vec<(usize, (f64, f64))> = (points.iter().enumerate())
        .filter_map(|(i, p)| Some((i, key(p)?)))
        .collect();
    order.sort_by(|(_, a), (_, b)| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut front: Vec<usize> = Vec::new();
    for (i, _) in order {
        let point = &points[i];
        let mut quicker = front.iter().map(|j| &points[*j]);
        if quicker.all(|q| !q.is_beside(point) || point.is_nearer_than(q)) {
            front.push(i);
        }
    }
    for i in front {
        points[i].on_front = true;
    }
    points
}

fn percent(error: f64) -> String {
    let percent = 100.0 * error;
    if percent < 0.01 {
        "under 0.01 %".to_owned()
    } else {
        format!("{percent:.2} %")
    }
}

/// In words: what the next steps from each default buy, and for how much.
pub fn in_words(points: &[Point]) -> Vec<String> {
    let mut out = Vec::new();
    for default in points.iter().filter(|p| p.setting.is_default) {
        // Of the other method, only what the user would take of it.
        let is_offered = |p: &&Point| {
            p.is_beside(default)
                && p.on_front
                && (p.setting.is_default || p.setting.method() == default.setting.method())
        };
        for other in points.iter().filter(is_offered) {
            let (Some(a), Some(b)) = (default.time, other.time) else {
                continue;
            };
            let (ratio, is_slower) = (b.ms / a.ms, b.ms > a.ms);
            let errors = [default, other].map(|p| p.numeric.map(|n| percent(n.rel_l2)));
            let gain = match ([default, other].map(|p| p.psnr_truth), errors) {
                ([Some(a), Some(b)], _) => format!("{:+.2} dB to the truth", b - a),
                (_, [Some(a), Some(b)]) => format!("off by {b} instead of {a}"),
                _ => continue,
            };
            if other.setting.name == default.setting.name {
                continue;
            }
            let cost = if is_slower {
                format!("{ratio:.1} times the time")
            } else {
                format!("{:.0} % of the time", 100.0 * ratio)
            };
            out.push(format!(
                "{} ({}): {} instead of {}: {gain}, {cost}",
                default.stage.name(),
                default.device,
                other.setting.name,
                default.setting.name
            ));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(name: &str, ms: f64, psnr: f64) -> Point {
        let setting = Setting {
            name: name.into(),
            is_default: name == "default",
            ..Setting::plain(TransferSettings::default())
        };
        Point {
            time: Some(Timing {
                ms,
                spread_ms: None,
            }),
            psnr_truth: Some(psnr),
            ..Point::of(&setting, &Device::Cpu, Stage::Transfer)
        }
    }

    #[test]
    fn the_front_is_what_nothing_beats_and_is_told_in_words() {
        let points = mark_front(vec![
            point("quick", 1.0, 20.0),
            point("default", 2.0, 30.0),
            point("beaten", 3.0, 29.0),
            point("slow", 4.0, 31.0),
            point("slower and nearer by luck", 5.0, 31.005),
        ]);
        let front: Vec<bool> = points.iter().map(|p| p.on_front).collect();
        assert_eq!(front, [true, true, false, true, false]);
        let words = in_words(&points);
        assert_eq!(words.len(), 2, "{words:?}");
        assert!(words[0].contains("quick instead of default: -10.00 dB"));
        assert!(words[1].contains("+1.00 dB to the truth, 2.0 times the time"));
    }

    #[test]
    fn what_is_slow_is_run_once_and_what_is_quick_often() {
        let mut runs = 0;
        let (_, time) = timed(|| {
            runs += 1;
            Ok(())
        })
        .expect("it does not fail");
        assert!(runs == REPEATS + 1 && time.ms < 10.0 && time.spread_ms.is_some());
    }
}
