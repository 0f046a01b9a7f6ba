//! Part *time* of the report: error against run time.

use anyhow::Result;

use super::Measurement;
use super::page::{Dot, Page, Plot, write};
use super::tables::quoted;
use crate::sweep::{self, Effort, Point, STAGES, Stage, Subject, Sweep};
use transplat_engine::device::Device;
use transplat_engine::words::milliseconds;

/// The table's name.
const CSV: &str = "error_vs_time.csv";

/// Error against run time.
pub struct ErrorOverTime {
    /// Settings that were measured, by device and stage.
    pub points: usize,
    /// Summary for people.
    pub words: String,
}

/// Measures settings on devices.
///
/// # Errors
/// The table cannot be written, or a device failed.
pub fn run(
    how: Measurement<'_>,
    subject: &Subject,
    devices: &[Device],
    page: &mut Page,
) -> Result<ErrorOverTime> {
    let effort = match how.is_quick {
        true => Effort::Quick,
        false => Effort::Full,
    };
    let points = Sweep::run(subject, devices, effort, how.steps)?;
    write(&how.output.join(CSV), &csv(&points))?;
    let words = sweep::in_words(&points);
    onto(page, &points, &words)?;
    Ok(ErrorOverTime {
        points: points.len(),
        words: summary(&points, &words),
    })
}

/// All points, for programs; what does not apply is empty.
fn csv(points: &[Point]) -> String {
    let mut out = String::from(
        "setting,device,stage,time_ms,time_spread_ms,memory_bytes,rel_l2,max_abs,psnr_numeric,psnr_truth,on_front,is_default\n",
    );
    for p in points {
        let or_empty =
            |v: Option<f64>, digits: usize| v.map_or(String::new(), |v| format!("{v:.digits$}"));
        let small = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.3e}"));
        out += &format!(
            "{},{},{},{},{},{},{},{},{},{},{},{}\n",
            quoted(&p.setting.name),
            quoted(&p.device),
            p.stage.name(),
            or_empty(p.time.map(|t| t.ms), 3),
            or_empty(p.time.and_then(|t| t.spread_ms), 3),
            p.memory_bytes.map_or(String::new(), |b| b.to_string()),
            small(p.numeric.map(|n| n.rel_l2)),
            small(p.numeric.map(|n| n.max_abs)),
            or_empty(p.numeric.and_then(|n| n.psnr), 2),
            or_empty(p.psnr_truth, 3),
            p.on_front,
            p.setting.is_default,
        );
    }
    out
}

/// Plots and tables, stage by stage.
fn onto(page: &mut Page, points: &[Point], words: &[String]) -> Result<()> {
    page.heading("Error against run time");
    page.paragraph(
        "Two errors, never mixed. Numerical: against the f64 oracle of the same mathematics with everything at its best (SH degree 8, visibility by rays in 2048 directions), on a thinned asset. Model: against path-traced pictures, on the whole asset. Times are medians; the spread is half the distance between the quartiles. A grey line joins the front, what nothing beats in both, where the error is that which counts: to the truth, if there is any. Each stage, device and preset has a front of its own, but by truth the transfers of both presets share one; what differs by less than 0.01 dB or 1 % is equally near. Rings mark the defaults. A bake that is not done yet has the rest filled from the nearest rays, and so holds more.",
    );
    page.paragraph("What the next steps from the defaults buy:");
    page.list(words);
    let mut devices: Vec<&str> = points.iter().map(|p| &*p.device).collect();
    devices.dedup();
    devices.sort_unstable();
    devices.dedup();
    for stage in STAGES {
        for device in &devices {
            let here = |p: &&Point| p.stage == stage && p.device == *device;
            let these: Vec<&Point> = points.iter().filter(here).collect();
            if these.len() > 1 {
                plots(page, stage, device, &these)?;
            }
        }
    }
    let head = [
        "setting",
        "device",
        "time",
        "spread",
        "memory",
        "relative L2",
        "largest",
        "PSNR to oracle",
        "PSNR to truth",
        "front",
    ];
    for stage in STAGES {
        let these = points.iter().filter(|p| p.stage == stage);
        let rows: Vec<(&str, Vec<String>)> = these
            .map(|p| {
                let class = if p.setting.is_default { "default" } else { "" };
                (class, row(p))
            })
            .collect();
        if !rows.is_empty() {
            page.table(stage.name(), &head, &rows);
        }
    }
    Ok(())
}

fn row(p: &Point) -> Vec<String> {
    let decibels = |v: Option<f64>| v.map_or(String::new(), |v| format!("{v:.2} dB"));
    vec![
        p.setting.name.clone(),
        p.device.clone(),
        p.time.map_or(String::new(), |t| milliseconds(t.ms)),
        p.time
            .and_then(|t| t.spread_ms)
            .map_or(String::new(), milliseconds),
        p.memory_bytes
            .map_or(String::new(), |b| format!("{:.1} MB", b as f64 / 1e6)),
        p.numeric
            .map_or(String::new(), |n| format!("{:.1e}", n.rel_l2)),
        p.numeric
            .map_or(String::new(), |n| format!("{:.1e}", n.max_abs)),
        decibels(p.numeric.and_then(|n| n.psnr)),
        decibels(p.psnr_truth),
        if p.on_front {
            "yes".into()
        } else {
            String::new()
        },
    ]
}

/// The model's error over time, and the numerical one.
fn plots(page: &mut Page, stage: Stage, device: &str, points: &[&Point]) -> Result<()> {
    let groups = ["preset best", "preset paper", "both presets"];
    let group = |p: &Point| match p.setting.method() {
        "best" => 0,
        "paper" => 1,
        _ => 2,
    };
    let mut add =
        |what: &str, y: &str, is_y_logarithmic: bool, of: &dyn Fn(&Point) -> Option<f64>| {
            let has_truth = points.iter().any(|p| p.psnr_truth.is_some());
            let dots: Vec<Dot> = points
                .iter()
                .filter_map(|p| {
                    Some(Dot {
                        x: p.time?.ms,
                        y: of(p)?,
                        label: p.setting.name.clone(),
                        group: group(p),
                        is_default: p.setting.is_default,
                        // The front is that of the error which counts.
                        is_joined: p.on_front && has_truth != is_y_logarithmic,
                    })
                })
                .collect();
            let title = format!("{}, {device}: {what}", stage.name());
            let plot = Plot {
                title: &title,
                x: "time in ms",
                y,
                is_y_logarithmic,
                groups: &groups,
                is_front_shared: stage == Stage::Transfer && !is_y_logarithmic,
            };
            page.plot(&plot, &dots)
        };
    add("to path-traced truth", "PSNR in dB", false, &|p| {
        p.psnr_truth
    })?;
    add("to the f64 oracle", "relative L2", true, &|p| {
        p.numeric.map(|n| n.rel_l2)
    })
}

/// For a terminal.
fn summary(points: &[Point], words: &[String]) -> String {
    let mut out = String::from("Error against run time (defaults):\n");
    for p in points.iter().filter(|p| p.setting.is_default) {
        let time = p.time.map_or(String::new(), |t| milliseconds(t.ms));
        let truth = p
            .psnr_truth
            .map_or(String::new(), |v| format!(", {v:.2} dB to the truth"));
        let numeric = p.numeric.map_or(String::new(), |n| {
            format!(", {:.1e} off the oracle", n.rel_l2)
        });
        let front = if p.numeric.is_some() && !p.on_front {
            ", not on the front"
        } else {
            ""
        };
        out += &format!(
            "  {} ({}), {}: {time}{truth}{numeric}{front}\n",
            p.stage.name(),
            p.device,
            p.setting.name
        );
    }
    out.push_str("What the next steps buy:\n");
    for line in words {
        out += &format!("  {line}\n");
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sweep::{Numeric, Setting, Timing};
    use transplat_core::settings::TransferSettings;

    #[test]
    fn the_table_leaves_empty_what_does_not_apply() {
        let whole = Point {
            setting: Setting::plain(TransferSettings::default()),
            device: "a, b".into(),
            stage: Stage::Transfer,
            time: Some(Timing {
                ms: 1.5,
                spread_ms: Some(0.25),
            }),
            memory_bytes: Some(7),
            numeric: Some(Numeric {
                rel_l2: 1e-6,
                max_abs: 2e-5,
                psnr: None,
            }),
            psnr_truth: Some(33.0),
            on_front: true,
        };
        let empty = Point {
            time: None,
            memory_bytes: None,
            numeric: None,
            psnr_truth: None,
            on_front: false,
            ..whole.clone()
        };
        let csv = csv(&[whole, empty]);
        let lines: Vec<&str> = csv.lines().collect();
        assert_eq!(
            lines[1],
            "preset best,\"a, b\",transfer,1.500,0.250,7,1.000e-6,2.000e-5,,33.000,true,false"
        );
        assert_eq!(lines[2], "preset best,\"a, b\",transfer,,,,,,,,false,false");
    }
}
