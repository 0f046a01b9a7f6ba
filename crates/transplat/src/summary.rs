//! Summary of a command: stages with their times, skipped work, warnings; as text or as one JSON object.

use std::io::Write;
use std::time::Instant;

use anyhow::bail;
use indicatif::{ProgressBar, ProgressStyle};
use serde_json::{Map, Value, json};

use transplat_core::settings::optimizations::{SkippedWork, Stage};

use crate::cli::OutputArgs;
use transplat_engine::words::milliseconds;
use transplat_eval::savings::Saved;

/// Gathers what is told at the end.
#[derive(Default)]
pub struct Summary {
    command: &'static str,
    /// True to show neither progress nor summary.
    pub quiet: bool,
    /// True to measure timings precisely.
    pub json: bool,
    /// Object that is worked on, where there is more than one.
    pub subject: Option<String>,
    fields: Map<String, Value>,
    stages_ms: Map<String, Value>,
    targets: Vec<(String, f32)>,
    notes: Vec<String>,
    skipped: Vec<SkippedWork>,
    /// Savings as they were measured, for programs.
    saved: Vec<Value>,
    warnings: Vec<String>,
    /// Failures beside all else that was done.
    failed: Vec<String>,
}

impl Summary {
    pub fn new(command: &'static str, out: &OutputArgs) -> Self {
        Self {
            command,
            quiet: out.quiet,
            json: out.json,
            ..Self::default()
        }
    }

    /// A progress bar, unless it is to be quiet. See [`progress_bar`].
    pub fn progress_bar(&self, what: &'static str) -> ProgressBar {
        progress_bar(self.quiet, what)
    }

    /// Runs a stage and adds its time to what the stage took before.
    pub fn time<T>(&mut self, stage: &'static str, work: impl FnOnce() -> T) -> T {
        let start = Instant::now();
        let result = work();
        self.add_ms(stage, start.elapsed().as_secs_f64() * 1e3);
        result
    }

    /// Adds to a stage's time.
    pub fn add_ms(&mut self, stage: &'static str, ms: f64) {
        let sum = self.stages_ms.get(stage).and_then(Value::as_f64);
        self.stages_ms
            .insert(stage.into(), json!(sum.unwrap_or(0.0) + ms));
    }

    /// Milliseconds of a stage so far.
    pub fn ms(&self, stage: &str) -> Option<f64> {
        self.stages_ms.get(stage).and_then(Value::as_f64)
    }

    /// Sets a field of the JSON object.
    pub fn set(&mut self, name: &str, value: impl Into<Value>) {
        self.fields.insert(name.into(), value.into());
    }

    /// Notes a target light and how many stops its mean irradiance lies above the source's: strength is not exposure.
    pub fn target(&mut self, name: &str, stops_over_source: f32) {
        let subject = self.subject.as_ref();
        let name = subject.map_or_else(|| name.to_owned(), |of| format!("{of}, {name}"));
        self.targets.push((name, stops_over_source));
    }

    /// Notes something that this scene did not need.
    pub fn skip(&mut self, what: &str, why: &str) {
        self.skipped([SkippedWork {
            max_error: None,
            ..SkippedWork::exact(Stage::Project, what, why)
        }]);
    }

    /// Notes what was left out, and what that saved; each once.
    pub fn skipped(&mut self, all: impl IntoIterator<Item = SkippedWork>) {
        for skipped in all {
            if !self.skipped.contains(&skipped) {
                self.skipped.push(skipped);
            }
        }
    }

    /// Notes a saving as it was measured, in the JSON object alone.
    pub fn saved(&mut self, saved: &Saved) {
        self.saved.push(json!({
            "what": format!("{} ({})", saved.skipped.what, saved.method.preset()),
            "why": saved.skipped.why,
            "time_saved_ms": saved.time_saved_ms,
            "memory_saved_bytes": saved.skipped.bytes,
            "max_error": saved.max_error,
        }));
    }

    fn as_json(&self, skipped: &SkippedWork) -> Value {
        let stage_ms = self.ms(skipped.stage.name());
        json!({
            "what": skipped.what,
            "why": skipped.why,
            "time_saved_ms": stage_ms.and_then(|ms| skipped.saved_ms(ms)),
            "memory_saved_bytes": skipped.bytes,
            // As short as it is; widened, it would have digits of nothing.
            "max_error": skipped.max_error.and_then(|e| e.to_string().parse::<f64>().ok()),
        })
    }

    /// Notes something for people, once.
    pub fn note(&mut self, text: String) {
        if !self.notes.contains(&text) {
            self.notes.push(text);
        }
    }

    /// Warns: at once for people, and in the JSON object.
    pub fn warn(&mut self, text: impl Into<String>) {
        let text = text.into();
        if self.warnings.contains(&text) {
            return;
        }
        if !self.quiet {
            eprintln!("warning: {text}");
        }
        self.warnings.push(text);
    }

    /// Warns of what could not be done where all else is done all the same: the command ends with an error.
    pub fn fail(&mut self, why: String) {
        self.warn(why.clone());
        self.failed.push(why);
    }

    /// Prints the JSON object, or the lines for people. A reader that has left is no error.
    ///
    /// # Errors
    /// Something could not be done ([`Summary::fail`]), or standard output cannot be written.
    pub fn finish(mut self, summary: &str) -> anyhow::Result<()> {
        let failed = std::mem::take(&mut self.failed);
        self.print_all(summary)?;
        match &failed[..] {
            [] => Ok(()),
            some => bail!("all but {} done: {}", some.len(), some.join("; ")),
        }
    }

    fn print_all(self, summary: &str) -> anyhow::Result<()> {
        match self.print(&mut std::io::stdout().lock(), summary) {
            Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
                Err(anyhow::Error::new(error).context("standard output"))
            }
            _ => Ok(()),
        }
    }

    fn print(mut self, out: &mut impl Write, summary: &str) -> std::io::Result<()> {
        if self.json {
            let mut object = Map::new();
            object.insert("command".into(), json!(self.command));
            object.append(&mut self.fields);
            object.insert("stages_ms".into(), Value::Object(self.stages_ms.clone()));
            if let Some(bytes) = memory_bytes("VmHWM:") {
                object.insert("peak_memory_bytes".into(), json!(bytes));
            }
            if !self.targets.is_empty() {
                let told = |(name, stops): &(String, f32)| json!({"name": name, "stops_over_source": stops});
                let targets = self.targets.iter().map(told).collect();
                object.insert("targets".into(), Value::Array(targets));
            }
            let told = self.skipped.iter().map(|s| self.as_json(s));
            let skipped = told.chain(self.saved.iter().cloned()).collect();
            object.insert("skipped".into(), Value::Array(skipped));
            object.insert("warnings".into(), json!(self.warnings));
            writeln!(out, "{}", Value::Object(object))?;
        } else if !self.quiet {
            for (name, stops) in &self.targets {
                writeln!(out, "{name}: {} the source light", compared(*stops))?;
            }
            for note in &self.notes {
                writeln!(out, "{note}")?;
            }
            for entry in &self.skipped {
                let words = entry.in_words(self.ms(entry.stage.name()));
                writeln!(out, "left out: {} ({words})", entry.what)?;
            }
            let stages: Vec<String> = self
                .stages_ms
                .iter()
                .map(|(name, ms)| format!("{name} {}", milliseconds(ms.as_f64().unwrap_or(0.0))))
                .collect();
            if !stages.is_empty() {
                let device = self.fields.get("adapter").and_then(Value::as_str);
                let on = device.map_or(String::new(), |name| format!(" (on {name})"));
                writeln!(out, "{}{on}", stages.join(", "))?;
            }
            writeln!(out, "{summary}")?;
        }
        out.flush()
    }
}

/// A bar on stderr, when that is a terminal and the user did not ask for quiet; it goes when it is dropped.
pub fn progress_bar(quiet: bool, what: &'static str) -> ProgressBar {
    if quiet {
        return ProgressBar::hidden();
    }
    let bar = ProgressBar::new(1000);
    let style = ProgressStyle::with_template("{msg} [{bar:30}] {percent}% {eta}");
    bar.set_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
    bar.set_message(what);
    bar
}

fn compared(stops: f32) -> String {
    if stops.abs() < 0.05 {
        return "as strong as".into();
    }
    let word = if stops < 0.0 { "darker" } else { "brighter" };
    format!("{:.1} stops {word} than", stops.abs())
}

/// A field of this process's memory where the system tells (Linux): `VmRSS:` is what it holds now, `VmHWM:` the most it ever held.
pub fn memory_bytes(field: &str) -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with(field))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}
