//! The files of `shaders/`, each with the constants that it shares with the CPU whatever it is compiled for.

use std::collections::BTreeSet;

use transplat_core::bake::harmonic::{
    DIRECTION_BATCH, EDGE_ON, EMPTY, MIN_SLOPE_COSINE, SHARPNESS, TAPS,
};
use transplat_core::bake::strata::{
    DIRECTIONS, PER_STRATUM, STRATA, STRATUM_BITS, SURFEL_BITS, WORDS,
};
use transplat_core::bake::trace::{MISS, NEAREST_SCALES, STACK_SCALES, START_SCALES};
use transplat_core::color::{
    AGX_INSET, AGX_OUTSET, Encoding, MAX_LINEAR, MAX_STORED, STORED_OFFSET, ToneMap,
};
use transplat_core::environment::MAX_SUNS;
use transplat_core::ground::GROUND_FADE;
use transplat_core::present::{
    Background, CHECKER_EDGE, CHECKER_GREYS, FALSE_COLORS, View, WIPE_LINE,
};
use transplat_core::rasterize::{LEAST_COMPENSATION, LOW_PASS_VARIANCE, MARGIN, MAX_ALPHA};
use transplat_core::surfels::MIN_ALPHA;
use transplat_core::transfer::directional::{
    BACK_RANGE, HORIZON, LEAST_IRRADIANCE, RESIDUAL_FLOOR,
};
use transplat_core::transfer::harmonic::MAX_RADIANCE;

use super::source::Source;
use crate::{CHUNK, WORKGROUP};

/// Patches that one dispatch of the bake for the directional method traces.
pub const STRATUM_BATCH: usize = 8;

/// Threads that sort a block of keys.
pub const SORT_WORKGROUP: usize = 256;

/// Keys of each of them.
pub const SORT_KEYS: usize = 16;

/// Bits of a key that a round sorts by.
pub const DIGIT_BITS: usize = 4;

/// Where no pixel is: the centre of a low-pass that is not to be seen.
const NOWHERE: f32 = 1e15;

/// Number of a background in WGSL; on a screen, what is transparent shows the checkerboard.
pub fn background_number(background: Background) -> u32 {
    match background {
        Background::Color(_) => 0,
        Background::Gradient(..) => 1,
        Background::Environment => 2,
        Background::Checker | Background::Transparent => 3,
        Background::Backplate => 4,
    }
}

/// A file of `shaders/`.
pub struct File {
    /// Its path there, without extension.
    pub name: &'static str,
    pub text: &'static str,
    /// Writes its constants.
    constants: fn(Source) -> Source,
}

macro_rules! file {
    ($name:literal, $constants:expr) => {
        File {
            name: $name,
            text: include_str!(concat!("../../../../shaders/", $name, ".wgsl")),
            constants: $constants,
        }
    };
}

pub(super) static PROJECT_ENVIRONMENT: File = file!("project_environment", |s| s);

pub static BAKE_HARMONIC: File = file!("bake_harmonic", |s| s
    .count("WORKGROUP", WORKGROUP)
    .count("DIRECTION_BATCH", DIRECTION_BATCH)
    .vectors("TAPS", &TAPS)
    .number("EMPTY", EMPTY)
    .number("SHARPNESS", SHARPNESS)
    .number("MIN_SLOPE_COSINE", MIN_SLOPE_COSINE)
    .number("EDGE_ON", EDGE_ON));

pub static BAKE_DIRECTIONAL: File = file!("bake_directional", |s| s
    .count("WORKGROUP", WORKGROUP)
    .count("SURFEL_BITS", SURFEL_BITS)
    .count("PER_STRATUM", PER_STRATUM)
    .count("RAYS", PER_STRATUM * STRATUM_BATCH));

pub(super) static TRANSFER_HARMONIC: File = file!("transfer_harmonic", |s| s
    .count("WORKGROUP", WORKGROUP)
    .number("MAX_RADIANCE", MAX_RADIANCE));

pub(super) static TRANSFER_DIRECTIONAL: File = file!("transfer_directional", |s| s
    .count("WORKGROUP", WORKGROUP)
    .count("DIRECTIONS", DIRECTIONS)
    .count("STRATA", STRATA)
    .count("SURFEL_BITS", SURFEL_BITS)
    .count("STRATUM_BITS", STRATUM_BITS)
    .count("OPEN_VECTORS", WORDS / 2)
    .count("MAX_SUNS", MAX_SUNS)
    .count("UNSEEN_VECTORS", CHUNK / 128)
    .count("LIGHT_SAMPLES", MAX_SUNS + DIRECTIONS)
    .count("ENCODING_STORED", Encoding::Stored as u32)
    .number("MAX_STORED", MAX_STORED)
    .number("LEAST_IRRADIANCE", LEAST_IRRADIANCE)
    .number("RESIDUAL_FLOOR", RESIDUAL_FLOOR)
    .number("BACK_RANGE", BACK_RANGE)
    .number("HORIZON", HORIZON));

pub static RASTERIZE_PROJECT: File = file!("rasterize_project", |s| s
    .number("MIN_ALPHA", MIN_ALPHA)
    .number("LOW_PASS_VARIANCE", LOW_PASS_VARIANCE)
    .number("MARGIN", MARGIN)
    .number("LEAST_COMPENSATION", LEAST_COMPENSATION)
    .number("NOWHERE", NOWHERE)
    .count("WORKGROUP", WORKGROUP));

pub static RASTERIZE_ORDER: File = file!("rasterize_order", |s| s
    .count("WORKGROUP", SORT_WORKGROUP)
    .count("KEYS", SORT_KEYS)
    .count("DIGITS", 1usize << DIGIT_BITS));

pub(super) static RASTERIZE_DRAW: File = file!("rasterize_draw", |s| s
    .number("MIN_ALPHA", MIN_ALPHA)
    .number("MAX_ALPHA", MAX_ALPHA));

pub(super) static RASTERIZE_SHADE: File = file!("rasterize_shade", |s| s
    .count("WORKGROUP", WORKGROUP)
    .count("ENCODING_STORED", Encoding::Stored as u32)
    .count("ENCODING_LINEAR", Encoding::Linear as u32)
    .number("STORED_OFFSET", STORED_OFFSET)
    .number("MAX_STORED", MAX_STORED));

pub static PRESENT: File = file!("present", |s| {
    let number = background_number;
    let black = [0.0; 3];
    let bands = FALSE_COLORS.map(|(to, [r, g, b])| [r, g, b, to.min(1e30)]);
    s.count("LAYOUT_BEFORE", View::Before as u32)
        .count("LAYOUT_SPLIT", View::Split as u32)
        .count("LAYOUT_SIDE_BY_SIDE", View::SideBySide as u32)
        .count("LAYOUT_DIFFERENCE", View::Difference as u32)
        .count("LAYOUT_DEPTH", View::Depth as u32)
        .count("BACKGROUND_COLOR", number(Background::Color(black)))
        .count(
            "BACKGROUND_GRADIENT",
            number(Background::Gradient(black, black)),
        )
        .count("BACKGROUND_ENVIRONMENT", number(Background::Environment))
        .count("BACKGROUND_PLATE", number(Background::Backplate))
        .count("CHECKER_EDGE", CHECKER_EDGE)
        .vector("CHECKER_GREYS", &CHECKER_GREYS)
        .vector("WIPE_LINE", &WIPE_LINE)
        .number("GROUND_FADE", GROUND_FADE)
        .vectors("FALSE_COLORS", &bands)
});

pub static BLIT: File = file!("blit", |s| s);

static COLOR: File = file!("shared/color", |s| s
    .count("TONE_SRGB", ToneMap::Srgb as u32)
    .count("TONE_NEUTRAL", ToneMap::Neutral as u32)
    .count("TONE_AGX", ToneMap::Agx as u32)
    .count("TONE_ACES", ToneMap::Aces as u32)
    .count("TONE_NONE", ToneMap::None as u32)
    .number("MAX_LINEAR", MAX_LINEAR)
    .matrix("AGX_INSET", AGX_INSET)
    .matrix("AGX_OUTSET", AGX_OUTSET));

static SURFEL: File = file!("shared/surfel", |s| s);

static TRACE: File = file!("shared/trace", |s| s
    .count("MISS", MISS)
    .number("START_SCALES", START_SCALES)
    .number("NEAREST_SCALES", NEAREST_SCALES)
    .number("STACK_SCALES", STACK_SCALES));

/// Files that others import.
static SHARED: [&File; 3] = [&COLOR, &SURFEL, &TRACE];

impl File {
    /// The shader, the same whatever it is for.
    pub fn source(&'static self) -> String {
        self.after(Source::default())
    }

    /// The shader: what depends on what it is for, and the file with all that it imports (each once, with its own constants).
    pub(super) fn after(&'static self, source: Source) -> String {
        let mut out = source.text();
        self.append(&mut BTreeSet::new(), &mut out);
        out
    }

    fn append(&'static self, there: &mut BTreeSet<&'static str>, out: &mut String) {
        if !there.insert(self.name) {
            return;
        }
        *out += &(self.constants)(Source::default()).text();
        for line in self.text.lines() {
            let import = line.strip_prefix("#import ");
            match import.and_then(|name| SHARED.into_iter().find(|f| f.name == name.trim())) {
                Some(imported) => imported.append(there, out),
                // An unknown name stays, and is told by the compiler.
                None => {
                    *out += line;
                    out.push('\n');
                }
            }
        }
    }
}
