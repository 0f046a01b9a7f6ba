//! Prefix of a WGSL file: constants and generated code.

use std::fmt::Write;

/// Constants and code, in their order.
#[derive(Default)]
pub(super) struct Source(String);

impl Source {
    /// A count or a number that stands for something.
    pub fn count(mut self, name: &str, value: impl TryInto<u32>) -> Self {
        // What does not fit is found when the shader is compiled.
        let value = value.try_into().unwrap_or(u32::MAX);
        self.constant(name, format_args!("{value}u"));
        self
    }

    /// Defines a flag.
    pub fn flag(mut self, name: &str, value: bool) -> Self {
        self.constant(name, value);
        self
    }

    /// A number.
    pub fn number(mut self, name: &str, value: f32) -> Self {
        self.constant(name, literal(f64::from(value)));
        self
    }

    /// A vector of up to four numbers.
    pub fn vector(mut self, name: &str, values: &[f32]) -> Self {
        self.constant(name, vector(values));
        self
    }

    /// A matrix, given by rows.
    pub fn matrix(mut self, name: &str, rows: [[f32; 3]; 3]) -> Self {
        let columns: [String; 3] = std::array::from_fn(|c| vector(&rows.map(|r| r[c])));
        self.constant(name, format_args!("mat3x3f({})", columns.join(", ")));
        self
    }

    /// An array of vectors, and how many there are: of `TAPS`, `TAP_COUNT`.
    pub fn vectors<const N: usize>(mut self, name: &str, values: &[[f32; N]]) -> Self {
        let all: Vec<String> = values.iter().map(|v| vector(v)).collect();
        let (count, all) = (values.len(), all.join(", "));
        self.constant(name, format_args!("array<vec{N}f, {count}>({all})"));
        self.count(&format!("{}_COUNT", name.trim_end_matches('S')), count)
    }

    /// Generated code.
    pub fn code(mut self, code: impl AsRef<str>) -> Self {
        self.0 += code.as_ref();
        self
    }

    /// All of it.
    pub fn text(self) -> String {
        self.0
    }

    fn constant(&mut self, name: &str, value: impl std::fmt::Display) {
        // Writing to a String cannot fail.
        let _ = writeln!(self.0, "const {name} = {value};");
    }
}

fn vector(values: &[f32]) -> String {
    let all: Vec<String> = values.iter().map(|v| literal(f64::from(*v))).collect();
    format!("vec{}f({})", values.len(), all.join(", "))
}

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
