//! Parts of the report: each measures, writes its tables, and shows them on the page.

pub mod extremes;
pub mod page;
pub mod skipped;
mod tables;
pub mod time;
pub mod truth;
mod unknown;
mod variants;

use std::ops::ControlFlow;
use std::path::Path;

/// Share that is done, 0 to 1, and what comes next. It may be broken off.
pub type Steps<'a> = &'a (dyn Fn(f64, &str) -> ControlFlow<()> + Sync);

/// Measuring settings of a part, and the folder of its tables.
#[derive(Clone, Copy)]
pub struct Measurement<'a> {
    /// Folder of the tables.
    pub output: &'a Path,
    /// True for fewer repeats and settings.
    pub is_quick: bool,
    /// Follows it.
    pub steps: Steps<'a>,
}
