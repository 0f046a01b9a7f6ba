//! WGSL put together: the files of `shaders/`, with what depends on constants and degrees written in front of them.

mod directional;
mod generated;
mod harmonic;
mod shared;
mod text;

use std::fmt::Write;

use transplat_core::bake::harmonic::{
    DIRECTION_BATCH, EDGE_ON, EMPTY, MIN_SLOPE_COSINE, SHARPNESS, TAPS,
};
use transplat_core::bake::patches::PER_PATCH;
use transplat_core::color::{Encoding, MAX_STORED, STORED_OFFSET};
use transplat_core::ground::GROUND_FADE;
use transplat_core::present::{
    Background, CHECKER_EDGE, CHECKER_GREYS, FALSE_COLORS, View, WIPE_LINE,
};
use transplat_core::rasterize::MAX_ALPHA;
use transplat_core::sh::coefficient_count;
use transplat_core::surfels::MIN_ALPHA;

pub use directional::{fits_by_tables, tables, transfer_directional};
pub use generated::sh_basis;
pub use harmonic::{TransferShape, transfer_harmonic};
use shared::trace;
pub use shared::{color, encoding_number, tone_number};
use text::{line, literal};

use crate::WORKGROUP;

/// Source of `project_environment.wgsl` for a degree.
pub fn project_environment(degree: usize) -> String {
    format!(
        "const DEGREE = {degree}u;\nconst K = {}u;\n{}",
        coefficient_count(degree),
        include_str!("../../../shaders/project_environment.wgsl")
    )
}

/// Source of `bake_harmonic.wgsl`.
pub fn bake_harmonic() -> String {
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
        include_str!("../../../shaders/bake_harmonic.wgsl")
    )
}

/// Patches that one dispatch of the bake for the directional method traces.
pub const PATCH_BATCH: usize = 8;

/// Source of `bake_directional.wgsl`.
pub fn bake_directional() -> String {
    format!(
        "const WORKGROUP = {WORKGROUP}u;\nconst PER_PATCH = {PER_PATCH}u;\nconst RAYS = {}u;\n{}\n{}",
        PER_PATCH * PATCH_BATCH,
        trace(3, 4),
        include_str!("../../../shaders/bake_directional.wgsl")
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

#[cfg(test)]
mod tests {
    use super::*;
    use transplat_core::transfer::directional::Nodes;
    use wgpu::naga;

    #[test]
    fn every_shader_is_valid_at_every_degree() {
        let mut sources = vec![
            ("bake_visibility", bake_harmonic()),
            ("bake_occlusion", bake_directional()),
            ("rasterize_project", rasterize_project()),
            ("rasterize_draw", rasterize_draw(true)),
        ];
        for degree in 0..=8 {
            sources.push(("project_environment", project_environment(degree)));
            sources.push(("rasterize_shade", rasterize_shade(degree)));
            for encoding in [Encoding::Stored, Encoding::Linear] {
                let source = transfer_directional(&Nodes::new(degree), encoding);
                sources.push(("transfer_best", source));
            }
            for asset_degree in [0, 2, 8] {
                for (shadow, reflection) in [(true, true), (false, true), (true, false)] {
                    sources.push((
                        "transfer",
                        transfer_harmonic(TransferShape {
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
