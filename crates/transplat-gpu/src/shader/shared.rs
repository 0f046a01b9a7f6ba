//! Sources of `shaders/shared`, and what they share with the CPU.

use std::fmt::Write;

use transplat_core::bake::trace::{NEAREST_SCALES, STACK_SCALES, START_SCALES};
use transplat_core::color::{AGX_INSET, AGX_OUTSET, Encoding, MAX_LINEAR, ToneMap};

use super::text::{line, literal, matrix};

/// Source of `shared/trace.wgsl`, its buffers bound to those numbers.
pub(super) fn trace(boxes: usize, discs: usize) -> String {
    format!(
        "const START_SCALES = {};\nconst NEAREST_SCALES = {};\nconst STACK_SCALES = {};\n{}",
        literal(f64::from(START_SCALES)),
        literal(f64::from(NEAREST_SCALES)),
        literal(f64::from(STACK_SCALES)),
        include_str!("../../../../shaders/shared/trace.wgsl")
            .replace("BOX_BINDING", &boxes.to_string())
            .replace("DISC_BINDING", &discs.to_string())
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
    out + include_str!("../../../../shaders/shared/color.wgsl")
}
