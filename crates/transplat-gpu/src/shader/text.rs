//! Writing WGSL.

/// An f32 or f64 as a WGSL literal that parses back to the same f32.
pub(super) fn literal(value: f64) -> String {
    format!("f32({:?})", value as f32)
}

/// A matrix given by rows, as WGSL's columns.
pub(super) fn matrix(rows: [[f32; 3]; 3]) -> String {
    let columns: Vec<String> = (0..3)
        .map(|c| {
            let values: Vec<String> = rows.iter().map(|r| literal(f64::from(r[c]))).collect();
            format!("vec3f({})", values.join(", "))
        })
        .collect();
    format!("mat3x3f({})", columns.join(", "))
}

macro_rules! line {
    ($out:expr, $($argument:tt)*) => {{
        // Writing to a String cannot fail.
        let _ = writeln!($out, $($argument)*);
    }};
}
pub(super) use line;
