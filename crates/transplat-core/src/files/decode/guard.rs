//! Guard between a decoder that panics and the program.

use std::cell::Cell;
use std::fmt::Display;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Once;

thread_local! {
    /// Decoders that run on this thread, one within the other.
    static RUNNING: Cell<usize> = const { Cell::new(0) };
}

/// Runs a decoder. A panic in it becomes an error, and nothing of it is printed.
pub fn guarded<T, E: Display>(
    what: &str,
    decode: impl FnOnce() -> Result<T, E>,
) -> Result<T, String> {
    static QUIET: Once = Once::new();
    QUIET.call_once(|| {
        let usual = std::panic::take_hook();
        std::panic::set_hook(Box::new(move |panic| {
            if RUNNING.get() == 0 {
                usual(panic);
            }
        }));
    });
    RUNNING.set(RUNNING.get() + 1);
    let decoded = catch_unwind(AssertUnwindSafe(decode));
    RUNNING.set(RUNNING.get() - 1);
    match decoded {
        Ok(decoded) => decoded.map_err(|e| e.to_string()),
        Err(_) => Err(format!(
            "{what} is broken, or of a variant that is not read"
        )),
    }
}
