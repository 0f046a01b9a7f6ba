//! How far a long stage is, and whether it is to go on.

use std::ops::ControlFlow;

/// Told how far a long stage is, 0 to 1; `Break` cancels it.
pub type Progress<'a> = &'a (dyn Fn(f64) -> ControlFlow<()> + Sync);

/// A [`Progress`] that neither shows nor stops anything.
pub fn no_progress(_: f64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}
