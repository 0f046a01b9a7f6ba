//! Numbers that stand for something, on both sides.

use transplat_core::color::{Encoding, ToneMap};
use transplat_core::present::{Background, View};

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
