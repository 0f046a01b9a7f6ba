//! WGSL put together: the files of `shaders/`, with what depends on constants and degrees written in front of them.

mod best;

use std::fmt::Write;

use crate::WORKGROUP;
pub use best::{fits_by_tables, tables, transfer_best};
use transplat_core::color::{
    AGX_INSET, AGX_OUTSET, Encoding, MAX_LINEAR, MAX_STORED, STORED_OFFSET, ToneMap,
};
use transplat_core::ground::GROUND_FADE;
use transplat_core::present::{
    Background, CHECKER_EDGE, CHECKER_GREYS, FALSE_COLORS, View, WIPE_LINE,
};
use transplat_core::rasterize::{MAX_ALPHA, MIN_ALPHA};
use transplat_core::sh::{
    SQRT_4PI, band, band_of, basis_constants, coefficient_count, cosine_kernel, exchange_yz,
};
use transplat_core::transfer::paper::{MAX_RADIANCE, PaperTransfer};
use transplat_core::visibility::occlusion::PER_PATCH;
use transplat_core::visibility::trace::{NEAREST_SCALES, STACK_SCALES, START_SCALES};
use transplat_core::visibility::{
    DIRECTION_BATCH, EDGE_ON, EMPTY, MIN_SLOPE_COSINE, SHARPNESS, TAPS,
};

/// An f32 or f64 as a WGSL literal that parses back to the same f32.
fn literal(value: f64) -> String {
    format!("f32({:?})", value as f32)
}

macro_rules! line {
    ($out:expr, $($argument:tt)*) => {{
        // Writing to a String cannot fail.
        let _ = writeln!($out, $($argument)*);
    }};
}
use line;

/// `fn sh_basis(d: vec3f) -> array<f32, K>`: all basis functions up to `degree`, straight out. Twin of `sh::evaluate_basis`.
pub fn sh_basis(degree: usize) -> String {
    let c = basis_constants();
    let k = coefficient_count(degree);
    let mut out = String::new();
    line!(out, "fn sh_basis(d: vec3f) -> array<f32, {k}> {{");
    line!(out, "    var y: array<f32, {k}>;");
    for m in 0..=degree {
        match m {
            0 => line!(out, "    let re_0 = 1.0;\n    let im_0 = 0.0;"),
            _ => {
                let p = m - 1;
                line!(out, "    let re_{m} = re_{p} * d.x - im_{p} * d.y;");
                line!(out, "    let im_{m} = re_{p} * d.y + im_{p} * d.x;");
            }
        }
        for l in m..=degree {
            let value = if l == m {
                literal(c.start[m])
            } else {
                let first = format!("{} * d.z * q_{}_{m}", literal(c.a[l][m]), l - 1);
                if l == m + 1 {
                    first
                } else {
                    format!("{first} - {} * q_{}_{m}", literal(c.b[l][m]), l - 2)
                }
            };
            line!(out, "    let q_{l}_{m} = {value};");
            line!(out, "    y[{}] = q_{l}_{m} * re_{m};", l * l + l + m);
            if m > 0 {
                line!(out, "    y[{}] = q_{l}_{m} * im_{m};", l * l + l - m);
            }
        }
    }
    line!(out, "    return y;\n}}");
    out
}

/// Source of `project_environment.wgsl` for a degree.
pub fn project_environment(degree: usize) -> String {
    format!(
        "const DEGREE = {degree}u;\nconst K = {}u;\n{}",
        coefficient_count(degree),
        include_str!("../../../shaders/project_environment.wgsl")
    )
}

/// Source of `bake_visibility.wgsl`.
pub fn bake_visibility() -> String {
    let taps: Vec<String> = TAPS
        .iter()
        .map(|[x, y]| {
            format!(
                "vec2f({}, {})",
                literal(f64::from(*x)),
                literal(f64::from(*y))
            )
        })
        .collect();
    format!(
        "const WORKGROUP = {WORKGROUP}u;\nconst DIRECTION_BATCH = {DIRECTION_BATCH}u;\nconst TAP_COUNT = {}u;\nconst TAPS = array<vec2f, {}>({});\nconst EMPTY = {};\nconst SHARPNESS = {};\nconst MIN_SLOPE_COSINE = {};\nconst EDGE_ON = {};\n{}",
        TAPS.len(),
        TAPS.len(),
        taps.join(", "),
        literal(f64::from(EMPTY)),
        literal(f64::from(SHARPNESS)),
        literal(f64::from(MIN_SLOPE_COSINE)),
        literal(f64::from(EDGE_ON)),
        include_str!("../../../shaders/bake_visibility.wgsl")
    )
}

/// Patches that one dispatch of the bake for preset `best` traces.
pub const PATCH_BATCH: usize = 8;

/// Source of `bake_occlusion.wgsl`.
pub fn bake_occlusion() -> String {
    format!(
        "const WORKGROUP = {WORKGROUP}u;\nconst PER_PATCH = {PER_PATCH}u;\nconst RAYS = {}u;\n{}\n{}",
        PER_PATCH * PATCH_BATCH,
        trace(3, 4),
        include_str!("../../../shaders/bake_occlusion.wgsl")
    )
}

/// Source of `shared/trace.wgsl`, its buffers bound to those numbers.
fn trace(boxes: usize, discs: usize) -> String {
    format!(
        "const START_SCALES = {};\nconst NEAREST_SCALES = {};\nconst STACK_SCALES = {};\n{}",
        literal(f64::from(START_SCALES)),
        literal(f64::from(NEAREST_SCALES)),
        literal(f64::from(STACK_SCALES)),
        include_str!("../../../shaders/shared/trace.wgsl")
            .replace("BOX_BINDING", &boxes.to_string())
            .replace("DISC_BINDING", &discs.to_string())
    )
}

/// Source of `rasterize_project.wgsl`.
pub fn rasterize_project() -> String {
    format!(
        "const MIN_ALPHA = {};\nconst WORKGROUP = {WORKGROUP}u;\n{}",
        literal(f64::from(MIN_ALPHA)),
        include_str!("../../../shaders/rasterize_project.wgsl")
    )
}

/// Source of `rasterize_draw.wgsl`, with the structs of `rasterize_project.wgsl`.
pub fn rasterize_draw(half_float_target: bool) -> String {
    let project = include_str!("../../../shaders/rasterize_project.wgsl");
    let structs = project.split("@group").next().unwrap_or(project);
    format!(
        "const MIN_ALPHA = {};\nconst MAX_ALPHA = {};\nconst MAX_COLOR = {};\n{structs}\n{}",
        literal(f64::from(MIN_ALPHA)),
        literal(f64::from(MAX_ALPHA)),
        literal(if half_float_target { 6e4 } else { 1e30 }),
        include_str!("../../../shaders/rasterize_draw.wgsl")
    )
}

/// Number of an encoding in WGSL.
pub fn encoding_number(encoding: Encoding) -> u32 {
    match encoding {
        Encoding::Stored => 0,
        Encoding::StoredLinear => 1,
        Encoding::Linear => 2,
    }
}

/// Number of a tone curve in WGSL.
pub fn tone_number(tone_map: ToneMap) -> u32 {
    match tone_map {
        ToneMap::Srgb => 0,
        ToneMap::Neutral => 1,
        ToneMap::Agx => 2,
        ToneMap::Aces => 3,
        ToneMap::None => 4,
    }
}

/// A matrix given by rows, as WGSL's columns.
fn matrix(rows: [[f32; 3]; 3]) -> String {
    let columns: Vec<String> = (0..3)
        .map(|c| {
            let values: Vec<String> = rows.iter().map(|r| literal(f64::from(r[c]))).collect();
            format!("vec3f({})", values.join(", "))
        })
        .collect();
    format!("mat3x3f({})", columns.join(", "))
}

/// Source of `shared/color.wgsl` with its constants.
pub fn color() -> String {
    let mut out = String::new();
    for (name, tone_map) in [
        ("SRGB", ToneMap::Srgb),
        ("NEUTRAL", ToneMap::Neutral),
        ("AGX", ToneMap::Agx),
        ("ACES", ToneMap::Aces),
        ("NONE", ToneMap::None),
    ] {
        line!(out, "const TONE_{name} = {}u;", tone_number(tone_map));
    }
    line!(
        out,
        "const MAX_LINEAR = {};",
        literal(f64::from(MAX_LINEAR))
    );
    line!(out, "const AGX_INSET = {};", matrix(AGX_INSET));
    line!(out, "const AGX_OUTSET = {};", matrix(AGX_OUTSET));
    out + include_str!("../../../shaders/shared/color.wgsl")
}

/// Source of `rasterize_shade.wgsl` for a degree of colour.
pub fn rasterize_shade(degree: usize) -> String {
    let mut out = sh_basis(degree);
    line!(out, "const WORKGROUP = {WORKGROUP}u;");
    line!(out, "const K = {}u;", coefficient_count(degree));
    line!(
        out,
        "const ENCODING_STORED = {}u;",
        encoding_number(Encoding::Stored)
    );
    line!(
        out,
        "const ENCODING_LINEAR = {}u;",
        encoding_number(Encoding::Linear)
    );
    line!(
        out,
        "const STORED_OFFSET = {};",
        literal(f64::from(STORED_OFFSET))
    );
    line!(
        out,
        "const MAX_STORED = {};",
        literal(f64::from(MAX_STORED))
    );
    out + &color() + include_str!("../../../shaders/rasterize_shade.wgsl")
}

/// Number of a view's layout in WGSL.
pub fn layout_number(view: View) -> u32 {
    match view {
        View::Before => 0,
        View::Split => 1,
        View::SideBySide => 2,
        View::Difference => 3,
        View::Depth => 4,
        _ => 5,
    }
}

/// Number of a background in WGSL; on a screen, what is transparent shows the checkerboard.
pub fn background_number(background: Background) -> u32 {
    match background {
        Background::Color(_) => 0,
        Background::Gradient(..) => 1,
        Background::Environment => 2,
        Background::Checker | Background::Transparent => 3,
    }
}

/// Source of `present.wgsl`.
pub fn present() -> String {
    let mut out = color();
    for (name, view) in [
        ("BEFORE", View::Before),
        ("SPLIT", View::Split),
        ("SIDE_BY_SIDE", View::SideBySide),
        ("DIFFERENCE", View::Difference),
        ("DEPTH", View::Depth),
    ] {
        line!(out, "const LAYOUT_{name} = {}u;", layout_number(view));
    }
    let black = [0.0; 3];
    for (name, background) in [
        ("COLOR", Background::Color(black)),
        ("GRADIENT", Background::Gradient(black, black)),
        ("ENVIRONMENT", Background::Environment),
    ] {
        let number = background_number(background);
        line!(out, "const BACKGROUND_{name} = {number}u;");
    }
    let vector = |values: &[f32]| {
        let values: Vec<String> = values.iter().map(|v| literal(f64::from(*v))).collect();
        format!("vec{}f({})", values.len(), values.join(", "))
    };
    line!(out, "const CHECKER_EDGE = {CHECKER_EDGE}u;");
    line!(out, "const CHECKER_GREYS = {};", vector(&CHECKER_GREYS));
    line!(out, "const WIPE_LINE = {};", vector(&WIPE_LINE));
    line!(
        out,
        "const GROUND_FADE = {};",
        literal(f64::from(GROUND_FADE))
    );
    let colors: Vec<String> = FALSE_COLORS
        .iter()
        .map(|(to, [r, g, b])| vector(&[*r, *g, *b, to.min(1e30)]))
        .collect();
    line!(out, "const FALSE_COLOR_COUNT = {}u;", colors.len());
    line!(
        out,
        "const FALSE_COLORS = array<vec4f, {}>({});",
        colors.len(),
        colors.join(", ")
    );
    out + include_str!("../../../shaders/present.wgsl")
}

/// Source of `blit.wgsl`.
pub fn blit() -> String {
    include_str!("../../../shaders/blit.wgsl").to_owned()
}

/// What the transfer's source depends on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransferShape {
    /// Degree of lights and visibility.
    pub light_degree: usize,
    /// Degree of the result.
    pub asset_degree: usize,
    /// Highest band of the specular term.
    pub specular_degree: usize,
    /// Whether visibility is used.
    pub shadow: bool,
    /// Whether the specular term is mirrored.
    pub reflection: bool,
}

impl TransferShape {
    /// That of a prepared transfer.
    pub fn of(p: &PaperTransfer) -> Self {
        Self {
            light_degree: p.light_degree,
            asset_degree: p.asset_degree,
            specular_degree: p.specular_degree,
            shadow: !p.visibility.is_empty(),
            reflection: p.settings.terms.reflection,
        }
    }

    /// `vec4`s of the operator's uniform binding: all three matrices, row by row.
    pub fn operator_vectors(&self) -> usize {
        (3 * coefficient_count(self.light_degree).pow(2)).div_ceil(4)
    }

    /// Whether the operator fits the 64 KiB of a uniform binding, which software drivers read far faster than a storage binding.
    pub fn operator_is_uniform(&self) -> bool {
        self.operator_vectors() * 16 <= 64 << 10
    }
}

/// Source of `transfer_paper.wgsl` for a shape.
pub fn transfer_paper(shape: TransferShape) -> String {
    let k = coefficient_count(shape.light_degree);
    let mut out = sh_basis(shape.light_degree);
    line!(out, "const WORKGROUP = {WORKGROUP}u;");
    line!(out, "const LIGHT_K = {k}u;");
    line!(
        out,
        "const ASSET_K = {}u;",
        coefficient_count(shape.asset_degree)
    );
    line!(
        out,
        "const MAX_RADIANCE = {};",
        literal(f64::from(MAX_RADIANCE))
    );
    let space = if shape.operator_is_uniform() {
        "uniform"
    } else {
        "storage, read"
    };
    line!(
        out,
        "@group(0) @binding(5) var<{space}> operator_of_light: array<vec4f, {}>;",
        shape.operator_vectors()
    );
    line!(
        out,
        "var<private> v: array<f32, {k}>;\nvar<private> s: array<f32, {k}>;"
    );
    out += &shadow_light(shape, k);
    out += &irradiance(k);
    if shape.reflection && shape.specular_degree > 0 {
        out += &mirror(shape.specular_degree);
    }
    out += &prepare(shape, k);
    out += &write_specular(shape);
    out + include_str!("../../../shaders/transfer_paper.wgsl")
}

/// Up to this many coefficients the operator's product is written out, once a channel: constant indices are many times
/// faster on a software driver. Of a higher degree, its compiler would take minutes.
const MAX_STRAIGHT_COEFFICIENTS: usize = 25;

fn shadow_light(shape: TransferShape, k: usize) -> String {
    let at = |i: usize| format!("operator_of_light[{}][{}]", i / 4, i % 4);
    let mut out = String::new();
    for channel in 0..3 {
        line!(out, "fn shadow_light_{channel}() {{");
        if shape.shadow && k > MAX_STRAIGHT_COEFFICIENTS {
            line!(
                out,
                "    for (var k = 0u; k < {k}u; k++) {{\n        var sum = 0.0;"
            );
            line!(out, "        for (var q = 0u; q < {k}u; q++) {{");
            line!(
                out,
                "            let at = ({channel}u * {k}u + k) * {k}u + q;"
            );
            line!(
                out,
                "            sum += operator_of_light[at / 4u][at % 4u] * v[q];\n        }}"
            );
            line!(out, "        s[k] = sum;\n    }}");
        } else {
            for i in 0..k {
                let row = (channel * k + i) * k;
                let sum = if shape.shadow {
                    let terms: Vec<String> = (0..k)
                        .map(|q| format!("{} * v[{q}]", at(row + q)))
                        .collect();
                    terms.join(" + ")
                } else {
                    format!("{} * {}", at(row), literal(SQRT_4PI))
                };
                line!(out, "    s[{i}] = {sum};");
            }
        }
        line!(out, "}}");
    }
    out
}

fn irradiance(k: usize) -> String {
    let terms: Vec<String> = (0..k)
        .filter(|i| cosine_kernel(band_of(*i)) != 0.0)
        .map(|i| {
            format!(
                "{} * basis[{i}] * s[{i}]",
                literal(cosine_kernel(band_of(i)))
            )
        })
        .collect();
    format!(
        "fn irradiance(basis: array<f32, {k}>) -> f32 {{\n    return {};\n}}\n",
        terms.join("\n        + ")
    )
}

/// Cosines and sines for the mirror, and the mirror of each band in place. Twin of `sh::Mirror`.
fn mirror(degree: usize) -> String {
    let mut out = String::new();
    for name in ["cos_1", "sin_1", "cos_2", "sin_2"] {
        line!(out, "var<private> {name}: array<f32, {}>;", degree + 1);
    }
    line!(out, "fn prepare_mirror(n: vec3f) {{");
    line!(
        out,
        "    let r = length(n.xy);\n    let azimuth = select(vec2f(1.0, 0.0), n.xy / r, r > 1e-12);"
    );
    line!(
        out,
        "    let double = vec2f(n.z * n.z - r * r, 2.0 * n.z * r);"
    );
    for (name, base) in [("1", "azimuth"), ("2", "double")] {
        line!(out, "    cos_{name}[0] = 1.0;\n    sin_{name}[0] = 0.0;");
        for m in 1..=degree {
            let p = m - 1;
            line!(
                out,
                "    cos_{name}[{m}] = cos_{name}[{p}] * {base}.x - sin_{name}[{p}] * {base}.y;"
            );
            line!(
                out,
                "    sin_{name}[{m}] = cos_{name}[{p}] * {base}.y + sin_{name}[{p}] * {base}.x;"
            );
        }
    }
    line!(out, "}}");
    for l in 1..=degree {
        out += &mirror_band(l);
    }
    out
}

fn mirror_band(l: usize) -> String {
    let n = 2 * l + 1;
    let first = band(l).start;
    let mut out = String::new();
    line!(out, "fn mirror_band_{l}() {{");
    for i in 0..n {
        line!(out, "    let a_{i} = s[{}];", first + i);
    }
    let turn = |out: &mut String, from: &str, to: &str, name: &str, sign: &str| {
        line!(out, "    let {to}_{l} = {from}_{l};");
        for m in 1..=l {
            let (p, q) = (l + m, l - m);
            let minus = if sign == "-" { "+" } else { "-" };
            line!(
                out,
                "    let {to}_{p} = {from}_{p} * cos_{name}[{m}] {minus} {from}_{q} * sin_{name}[{m}];"
            );
            line!(
                out,
                "    let {to}_{q} = {from}_{q} * cos_{name}[{m}] {sign} {from}_{p} * sin_{name}[{m}];"
            );
        }
    };
    let exchange = |out: &mut String, from: &str, to: &str, sign: bool| {
        for row in 0..n {
            let terms: Vec<String> = exchange_yz(l)
                .iter()
                .filter(|e| e.row == row)
                .map(|e| {
                    let value = if sign && row % 2 == 1 {
                        -e.value
                    } else {
                        e.value
                    };
                    format!("{} * {from}_{}", literal(value), e.column)
                })
                .collect();
            line!(out, "    let {to}_{row} = {};", terms.join(" + "));
        }
    };
    turn(&mut out, "a", "b", "1", "-");
    exchange(&mut out, "b", "c", false);
    turn(&mut out, "c", "d", "2", "+");
    exchange(&mut out, "d", "e", true);
    turn(&mut out, "e", "f", "1", "+");
    for i in 0..n {
        line!(out, "    s[{}] = f_{i};", first + i);
    }
    line!(out, "}}");
    out
}

fn prepare(shape: TransferShape, k: usize) -> String {
    let mut out = String::from("fn prepare(i: u32, n: vec3f) {\n");
    if shape.shadow {
        for q in 0..k {
            line!(
                out,
                "    v[{q}] = visibility[{q}u * parameters.stride + i];"
            );
        }
    }
    if shape.reflection && shape.specular_degree > 0 {
        line!(out, "    prepare_mirror(n);");
    }
    line!(out, "}}");
    out
}

fn write_specular(shape: TransferShape) -> String {
    let mut out = String::from("fn write_specular(i: u32, channel: u32) {\n");
    for l in 1..=shape.asset_degree {
        if l > shape.specular_degree {
            for j in band(l) {
                line!(out, "    store(i, {j}u, channel, 0.0);");
            }
            continue;
        }
        line!(
            out,
            "    let a_{l} = attenuation[({}u + channel) * parameters.stride + i];",
            3 * (l - 1)
        );
        if shape.reflection {
            line!(out, "    mirror_band_{l}();");
        }
        for j in band(l) {
            line!(out, "    store(i, {j}u, channel, a_{l} * s[{j}]);");
        }
    }
    line!(out, "}}");
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use transplat_core::transfer::best::Nodes;
    use wgpu::naga;

    #[test]
    fn every_shader_is_valid_at_every_degree() {
        let mut sources = vec![
            ("bake_visibility", bake_visibility()),
            ("bake_occlusion", bake_occlusion()),
            ("rasterize_project", rasterize_project()),
            ("rasterize_draw", rasterize_draw(true)),
        ];
        for degree in 0..=8 {
            sources.push(("project_environment", project_environment(degree)));
            sources.push(("rasterize_shade", rasterize_shade(degree)));
            for encoding in [Encoding::Stored, Encoding::Linear] {
                let source = transfer_best(&Nodes::new(degree), encoding);
                sources.push(("transfer_best", source));
            }
            for asset_degree in [0, 2, 8] {
                for (shadow, reflection) in [(true, true), (false, true), (true, false)] {
                    sources.push((
                        "transfer",
                        transfer_paper(TransferShape {
                            light_degree: degree,
                            asset_degree,
                            specular_degree: asset_degree.min(degree),
                            shadow,
                            reflection,
                        }),
                    ));
                }
            }
        }
        for (name, source) in sources {
            let module = naga::front::wgsl::parse_str(&source)
                .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(&source)));
            naga::valid::Validator::new(
                naga::valid::ValidationFlags::all(),
                naga::valid::Capabilities::empty(),
            )
            .validate(&module)
            .unwrap_or_else(|e| panic!("{name}: {e:?}"));
        }
    }
}
