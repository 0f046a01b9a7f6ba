//! Part *extremes* of the report, with a sweep over epsilon.

use std::time::Instant;

use anyhow::{Result, bail};
use transplat_core::bake::Bake;
use transplat_core::bake::harmonic::DEFAULT_DIRECTIONS;
use transplat_core::environment::Illumination;
use transplat_core::extremes::{self, CaseOutcome};
use transplat_core::progress::no_progress;
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::transfer::{Part, PreparedTransfer};

use super::Measurement;
use super::page::{Dot, Page, Plot, write};
use super::tables::quoted;
use crate::sweep::Subject;
use transplat_engine::device::Device;

/// The tables' names.
const CSV: &str = "extremes.csv";
const EPSILON_CSV: &str = "epsilon.csv";

/// Epsilons that are tried.
const EPSILONS: [f32; 10] = [1e-6, 1e-5, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1, 1.0, 1e3];

/// Outcome of the extreme cases.
pub struct Extremes {
    /// Cases by method, and those that failed.
    pub cases: [usize; 2],
    /// Milliseconds that the cases took.
    pub ms: f64,
    /// Summary for people.
    pub words: String,
}

/// Runs the extreme cases, and a sweep over epsilon on a splat.
///
/// # Errors
/// A table cannot be written, or the device failed.
pub fn run(
    how: Measurement<'_>,
    subject: &Subject,
    devices: &[Device],
    page: &mut Page,
) -> Result<Extremes> {
    let gpu = devices.iter().find(|d| matches!(d, Device::Gpu(_)));
    let cases = extremes::all();
    let start = Instant::now();
    let mut outcomes = Vec::new();
    for (i, case) in cases.iter().enumerate() {
        if (how.steps)(i as f64 / cases.len() as f64, case.name).is_break() {
            bail!("cancelled");
        }
        for method in Method::ALL {
            let other = gpu.map(|device| {
                move |prepared: &PreparedTransfer, light: &Illumination| {
                    let relit = device.relight(prepared, light);
                    relit.map_err(|e| format!("{e:#}"))
                }
            });
            let other = other.as_ref().map(|relight| relight as _);
            outcomes.push(extremes::run(case, method, other));
        }
    }
    let ms = 1e3 * start.elapsed().as_secs_f64();
    write(&how.output.join(CSV), &csv(&outcomes))?;
    let failed = outcomes.iter().filter(|o| o.failure.is_some());
    let counts = [outcomes.len(), failed.count()];
    let words = extremes::in_words(&outcomes);
    page.heading("Stiff and extreme cases");
    page.paragraph(&words);
    page.paragraph("f32 and the GPU are compared with the f64 oracle (relative L2 of the relit colour). The condition number is how many times a relative change of the source light is amplified in the ratio tau, at the worst surfel: |t| |L| / (E + epsilon), where the irradiance is E = t.L. Everything is asked to be finite. Bounded: the ratio is within what the lights and epsilon allow. Scale-invariant, as at scale 1: the same colours whatever the unit of light or length. Monotone: a larger epsilon never makes a larger change. Black: no light, no colour. As with even light: a black source tells nothing. There and back, preset best is to come back the first time; the drift after many turns is told and not asked for, because each turn keeps the error of those before. A number is missing where the oracle has no such case (a channel that is missing in the source is filled up, pixels that are no numbers, no surfels) or the ratio is held at its bound.");
    onto(page, &outcomes);
    Ok(Extremes {
        cases: counts,
        ms,
        words: words + &stiffness(how, subject, page)?,
    })
}

/// All outcomes, for programs.
fn csv(outcomes: &[CaseOutcome]) -> String {
    let mut out = String::from("case,property,ok,f32_error,gpu_error,condition_number,note\n");
    let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.3e}"));
    for o in outcomes {
        let name = format!("{} ({})", o.case, o.method.preset());
        out += &format!(
            "{},{},{},{},{},{},{}\n",
            quoted(&name),
            quoted(o.property),
            o.failure.is_none(),
            number(o.f32_error),
            number(o.other_error),
            number(o.condition),
            quoted(o.failure.as_deref().unwrap_or(&o.note)),
        );
    }
    out
}

fn onto(page: &mut Page, outcomes: &[CaseOutcome]) {
    let number = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.1e}"));
    let rows: Vec<(&str, Vec<String>)> = outcomes
        .iter()
        .map(|o| {
            let row = vec![
                o.case.to_owned(),
                o.method.preset().to_owned(),
                o.property.to_owned(),
                if o.failure.is_none() {
                    "holds"
                } else {
                    "fails"
                }
                .to_owned(),
                number(o.f32_error),
                number(o.other_error),
                number(o.condition),
                o.failure.clone().unwrap_or_else(|| o.note.clone()),
            ];
            (if o.failure.is_none() { "" } else { "bad" }, row)
        })
        .collect();
    let head = [
        "case",
        "preset",
        "asked",
        "holds",
        "f32 off f64",
        "GPU off f64",
        "condition",
        "note",
    ];
    page.table("all cases", &head, &rows);
}

/// One epsilon on the asset.
struct Stiff {
    method: Method,
    epsilon: f32,
    is_default: bool,
    psnr_truth: Option<f64>,
    /// By how much what lies in the dark is multiplied: of all surfels the 99th percentile, and the largest.
    amplification: [f32; 2],
    /// Share of surfels whose divisor is epsilon by a tenth and more.
    touched: f32,
}

fn stiffness(how: Measurement<'_>, subject: &Subject, page: &mut Page) -> Result<String> {
    let mut all = Vec::new();
    for method in Method::ALL {
        let bake = Bake::new(&subject.cloud, method, DEFAULT_DIRECTIONS, &no_progress)?;
        let mut epsilons = EPSILONS.to_vec();
        if how.is_quick {
            epsilons.retain(|e| [1e-6, 1e-3, 1e-1, 1e3].contains(e));
        }
        epsilons.push(method.epsilon());
        epsilons.sort_by(f32::total_cmp);
        for epsilon in epsilons {
            all.push(stiff(subject, method, &bake, epsilon)?);
        }
    }
    write(&how.output.join(EPSILON_CSV), &epsilon_csv(&all))?;
    page.heading("Epsilon");
    page.paragraph("Epsilon is added to the source's irradiance, relative to its mean: what the source hardly reaches is multiplied by at most 1 / epsilon. Less is truer where there is light, more calms the dark. Rings mark the defaults.");
    let groups = Method::ALL.map(|m| format!("preset {}", m.preset()));
    let groups = groups.each_ref().map(String::as_str);
    let mut plot = |title: &str, y: &str, log: bool, of: &dyn Fn(&Stiff) -> Option<f64>| {
        let dots: Vec<Dot> = all
            .iter()
            .filter_map(|s| {
                Some(Dot {
                    x: f64::from(s.epsilon),
                    y: of(s)?,
                    label: String::new(),
                    group: Method::ALL.iter().position(|m| *m == s.method)?,
                    is_default: s.is_default,
                    is_joined: true,
                })
            })
            .collect();
        let plot = Plot {
            title,
            x: "epsilon",
            y,
            is_y_logarithmic: log,
            groups: &groups,
            is_front_shared: false,
        };
        page.plot(&plot, &dots)
    };
    plot(
        "error over epsilon",
        "PSNR to the truth in dB",
        false,
        &|s| s.psnr_truth,
    )?;
    plot(
        "amplification over epsilon",
        "times, 99th percentile",
        true,
        &|s| Some(f64::from(s.amplification[0])),
    )?;
    plot("surfels that epsilon touches", "share in %", false, &|s| {
        Some(100.0 * f64::from(s.touched))
    })?;
    let mut words = String::from("Epsilon (defaults):\n");
    for s in all.iter().filter(|s| s.is_default) {
        let truth = s
            .psnr_truth
            .map_or(String::new(), |v| format!(", {v:.2} dB to the truth"));
        words += &format!(
            "  {} {}: touches {:.1} % of the surfels, multiplies by at most {:.0}{truth}\n",
            s.method.preset(),
            s.epsilon,
            100.0 * s.touched,
            s.amplification[1]
        );
    }
    Ok(words)
}

fn stiff(subject: &Subject, method: Method, bake: &Bake, epsilon: f32) -> Result<Stiff> {
    let settings = TransferSettings {
        epsilon: Some(epsilon),
        ..TransferSettings::of(method)
    };
    let n = subject.cloud.len();
    let source = &subject.lights[0];
    let prepared = PreparedTransfer::new(&subject.cloud, bake, source, &settings)?;
    let mut amplifications: Vec<f32> = (0..n).map(|i| prepared.amplification(i)).collect();
    amplifications.sort_by(f32::total_cmp);
    let at = |share: f32| {
        let index = (n.max(1) - 1) as f32 * share;
        amplifications.get(index as usize).copied().unwrap_or(0.0)
    };
    let touched = (0..n).filter(|i| prepared.epsilon_share(*i) > 0.1).count();
    let psnr_truth = match &subject.views {
        Some(views) => Some(views.psnr(|light| Ok(prepared.relight(light, Part::Whole)?))?),
        None => None,
    };
    Ok(Stiff {
        method,
        epsilon,
        is_default: epsilon == method.epsilon(),
        psnr_truth,
        amplification: [at(0.99), at(1.0)],
        touched: touched as f32 / n.max(1) as f32,
    })
}

fn epsilon_csv(all: &[Stiff]) -> String {
    let mut out = String::from(
        "preset,epsilon,is_default,psnr_truth,amplification_99,amplification_max,share_touched\n",
    );
    for s in all {
        let psnr = s.psnr_truth.map_or(String::new(), |v| format!("{v:.3}"));
        out += &format!(
            "{},{},{},{psnr},{:.3},{:.3},{:.5}\n",
            s.method.preset(),
            s.epsilon,
            s.is_default,
            s.amplification[0],
            s.amplification[1],
            s.touched
        );
    }
    out
}
