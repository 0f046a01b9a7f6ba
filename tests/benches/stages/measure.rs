//! Times of stages, kept and compared.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use serde_json::{Value, json};

use super::floor::{Rates, Work};

/// Repeats of what is quick, and how many seconds all of them may take.
const REPEATS: usize = 15;
const PATIENCE: f64 = 3.0;

/// Where a stage was measured: device, stage, what of, surfels, pixels.
type Key = (String, String, String, usize, usize);

/// A median time and what half of the repeats spread, in ms; the most memory that the process held, in MiB.
#[derive(Clone, Copy)]
pub struct Row {
    ms: f64,
    spread_ms: f64,
    peak_mib: f64,
    /// What it has to do, and how long that takes at best, in ms.
    floor: Option<(Work, f64)>,
}

/// What is measured so far.
pub struct Bench {
    /// Of each device.
    rates: BTreeMap<String, Rates>,
    /// What the next stage has to do.
    work: Option<Work>,
    rows: BTreeMap<Key, Row>,
    before: BTreeMap<Key, Row>,
    of: String,
    surfels: usize,
    pixels: usize,
}

impl Bench {
    /// Compares with figures of before.
    pub fn new(before: BTreeMap<Key, Row>) -> Self {
        Self {
            rates: BTreeMap::new(),
            work: None,
            rows: BTreeMap::new(),
            before,
            of: String::new(),
            surfels: 0,
            pixels: 0,
        }
    }

    /// What a device can do, against which its stages are held.
    pub fn device(&mut self, name: &str, rates: Rates) {
        println!("{name}: {}", rates.told());
        self.rates.insert(name.into(), rates);
    }

    /// What the next stage has to do.
    pub fn given(&mut self, work: Work) -> &mut Self {
        self.work = Some(work);
        self
    }

    /// What is measured from here on.
    pub fn at(&mut self, of: &str, size: [usize; 2]) {
        self.of = of.into();
        self.size(size);
        println!(
            "\n{} {of}\n{:<5}{:<26}{:>10}{:>9}{:>9}{:>10}",
            size[0], "", "", "ms", "spread", "MiB", "floors"
        );
    }

    /// Surfels and pixels from here on.
    pub fn size(&mut self, [surfels, pixels]: [usize; 2]) {
        (self.surfels, self.pixels) = (surfels, pixels);
    }

    /// Measures a stage and gives its last result.
    pub fn time<T>(&mut self, device: &str, stage: &str, mut work: impl FnMut() -> T) -> T {
        self.time_of(device, stage, || (), |()| work())
    }

    /// The same with an input that is made before the clock starts.
    pub fn time_of<I, T>(
        &mut self,
        device: &str,
        stage: &str,
        mut input: impl FnMut() -> I,
        mut work: impl FnMut(I) -> T,
    ) -> T {
        forget_peak();
        let begin = Instant::now();
        let mut times = Vec::new();
        let result = loop {
            let made = input();
            let start = Instant::now();
            let result = work(made);
            times.push(start.elapsed().as_secs_f64() * 1e3);
            let spent = begin.elapsed().as_secs_f64();
            // The first one warms up and compiles, where there is time for a second.
            let patience = if times.len() == 1 {
                5.0 * PATIENCE
            } else {
                PATIENCE
            };
            if times.len() > REPEATS || spent > patience {
                break result;
            }
        };
        if times.len() > 1 {
            times.remove(0);
        }
        times.sort_by(f64::total_cmp);
        let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
        let row = Row {
            ms: at(0.5),
            spread_ms: at(0.75) - at(0.25),
            peak_mib: peak_mib(),
            floor: self.work.take().and_then(|work| {
                let rates = self.rates.get(device)?;
                Some((work, rates.floor_ms(work)))
            }),
        };
        let key = (
            device.to_owned(),
            stage.to_owned(),
            self.of.clone(),
            self.surfels,
            self.pixels,
        );
        let pixels = match self.pixels {
            0 => String::new(),
            all => format!(" {:.1} MP", all as f64 * 1e-6),
        };
        let ratio = self
            .before
            .get(&key)
            .map(|b| format!("  x {:.2}", row.ms / b.ms));
        let floors = row.floor.map(|(_, least)| format!("{:.1}", row.ms / least));
        println!(
            "{device:<5}{:<26}{:>10.3}{:>9.3}{:>9.0}{:>10}{}",
            format!("{stage}{pixels}"),
            row.ms,
            row.spread_ms,
            row.peak_mib,
            floors.unwrap_or_default(),
            ratio.unwrap_or_default()
        );
        self.rows.insert(key, row);
        result
    }

    /// With which power of the number of surfels each stage grows, from the smallest to the largest.
    pub fn report_growth(&self) {
        let mut by_stage: BTreeMap<_, Vec<(usize, f64)>> = BTreeMap::new();
        for ((device, stage, of, surfels, pixels), row) in &self.rows {
            let stage = (device, stage, of, pixels);
            by_stage.entry(stage).or_default().push((*surfels, row.ms));
        }
        println!("\ntime grows with this power of the number of surfels");
        for ((device, stage, of, pixels), points) in by_stage {
            let (Some(first), Some(last)) = (points.first(), points.last()) else {
                continue;
            };
            if last.0 > first.0 {
                let power = (last.1 / first.1).ln() / (last.0 as f64 / first.0 as f64).ln();
                println!("{device:<5}{stage:<26}{of:<10}{pixels:>9} px {power:>6.2}");
            }
        }
    }

    /// Keeps the figures.
    pub fn write(&self, path: &Path) {
        let rows: Vec<Value> = self.rows.iter().map(|((device, stage, of, surfels, pixels), row)| {
            json!({
                "device": device, "stage": stage, "of": of, "surfels": surfels, "pixels": pixels,
                "ms": row.ms, "spread_ms": row.spread_ms, "peak_mib": row.peak_mib,
                "bytes": row.floor.map(|(work, _)| work.bytes),
                "operations": row.floor.map(|(work, _)| work.operations),
                "floor_ms": row.floor.map(|(_, least)| least),
            })
        }).collect();
        let text = serde_json::to_string_pretty(&rows).expect("numbers and names");
        std::fs::write(path, text + "\n").unwrap_or_else(|e| panic!("{}: {e}", path.display()));
    }
}

/// Figures that were kept.
pub fn read_rows(path: &Path) -> BTreeMap<Key, Row> {
    let wrong = |what: &dyn std::fmt::Display| -> ! { panic!("{}: {what}", path.display()) };
    let text = std::fs::read_to_string(path).unwrap_or_else(|e| wrong(&e));
    let rows: Vec<Value> = serde_json::from_str(&text).unwrap_or_else(|e| wrong(&e));
    rows.iter()
        .map(|row| {
            let text = |name: &str| row[name].as_str().unwrap_or_default().to_owned();
            let number = |name: &str| row[name].as_f64().unwrap_or(f64::NAN);
            let key = (
                text("device"),
                text("stage"),
                text("of"),
                number("surfels") as usize,
                number("pixels") as usize,
            );
            let row = Row {
                ms: number("ms"),
                spread_ms: number("spread_ms"),
                peak_mib: number("peak_mib"),
                floor: None,
            };
            (key, row)
        })
        .collect()
}

/// Linux counts the peak from here on.
fn forget_peak() {
    let _ = std::fs::write("/proc/self/clear_refs", "5");
}

/// The most memory that the process held, in MiB; not a number where nobody tells.
fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|l| l.starts_with("VmHWM:"));
    let kib = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    kib.map_or(f64::NAN, |kib| kib / 1024.0)
}
