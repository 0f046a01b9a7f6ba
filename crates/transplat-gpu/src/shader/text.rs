//! Writing WGSL.

/// An f32 or f64 as a WGSL literal that parses back to the same f32.
pub(super) fn literal(value: f64) -> String {
    format!("f32({:?})", value as f32)
}

macro_rules! line {
    ($out:expr, $($argument:tt)*) => {{
        // Writing to a String cannot fail.
        let _ = writeln!($out, $($argument)*);
    }};
}
pub(super) use line;
