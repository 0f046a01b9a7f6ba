//! Part *skipped* of the report: optimizations and their savings.

use anyhow::Result;

use super::Measurement;
use super::page::{Page, write};
use super::tables::quoted;
use crate::savings::{self, Saved, Savings};
use crate::sweep::Subject;

/// The table's name.
const CSV: &str = "skipped.csv";

/// Repeats of a transfer, whose median counts.
const REPEATS: [usize; 2] = [5, 21];

/// Measures with and without each thing that can be left out.
///
/// # Errors
/// The table cannot be written, or the device failed.
pub fn run(how: Measurement<'_>, subject: &Subject, page: &mut Page) -> Result<Savings> {
    let repeats = REPEATS[usize::from(!how.is_quick)];
    let savings = savings::measure(subject, repeats, how.steps)?;
    write(&how.output.join(CSV), &csv(&savings.saved))?;
    onto(page, &savings);
    Ok(savings)
}

fn name(saved: &Saved) -> String {
    format!("{} ({})", saved.skipped.what, saved.method.preset())
}

fn csv(saved: &[Saved]) -> String {
    let mut out = String::from("what,why,time_saved_ms,memory_saved_bytes,max_error\n");
    for s in saved {
        out += &format!(
            "{},{},{:.3},{},{:.3e}\n",
            quoted(&name(s)),
            quoted(&s.skipped.why),
            s.time_saved_ms,
            s.skipped.bytes,
            s.max_error
        );
    }
    out
}

/// Summary for people.
pub fn in_words(savings: &Savings) -> String {
    let mut out = String::from("Left out of this scene:\n");
    if savings.saved.is_empty() {
        out += "  nothing: it needs everything\n";
    }
    for s in &savings.saved {
        out += &format!("  {}: {}\n", name(s), s.in_words());
    }
    out
}

fn onto(page: &mut Page, savings: &Savings) {
    page.heading("What this scene does not need");
    page.paragraph("Each row was measured by doing it all the same: how much longer the stage took, and the largest difference that made to a pixel (display-encoded, 0 to 1).");
    let rows: Vec<(&str, Vec<String>)> = (savings.saved.iter())
        .map(|s| {
            let row = vec![
                name(s),
                s.skipped.why.clone(),
                s.skipped.stage.name().to_owned(),
                s.time_in_words(),
                s.memory_in_words(),
                format!("{:.1e}", s.max_error),
            ];
            ("", row)
        })
        .collect();
    let head = [
        "left out",
        "why",
        "stage",
        "time saved",
        "memory saved",
        "largest error",
    ];
    page.table("Left out", &head, &rows);
    page.paragraph("What it does need:");
    let needed = savings.needed.iter();
    let needed: Vec<String> = needed
        .map(|(method, why)| format!("{why} ({})", method.preset()))
        .collect();
    page.list(&needed);
}
