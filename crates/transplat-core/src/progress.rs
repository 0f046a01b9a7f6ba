//! Progress of a long stage, and its cancellation.

use std::ops::ControlFlow;

use crate::error::{Error, Result};

/// Told how far a long stage is, 0 to 1; `Break` cancels it.
pub type Progress<'a> = &'a (dyn Fn(f64) -> ControlFlow<()> + Sync);

/// A [`Progress`] that neither shows nor stops anything.
pub fn no_progress(_: f64) -> ControlFlow<()> {
    ControlFlow::Continue(())
}

/// The progress of a part of a stage, as the whole's: where that part begins and ends.
pub fn part(progress: Progress<'_>, from: f64, to: f64) -> impl Fn(f64) -> ControlFlow<()> + Sync {
    move |done| progress(from + (to - from) * done)
}

/// Tells how far a stage is.
///
/// # Errors
/// [`Error::Cancelled`] when it is not to go on.
pub fn tell(progress: Progress<'_>, done: f64) -> Result<()> {
    match progress(done) {
        ControlFlow::Continue(()) => Ok(()),
        ControlFlow::Break(()) => Err(Error::Cancelled),
    }
}
