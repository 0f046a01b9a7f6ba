//! Numbers that stand for something, on both sides; of plain enums it is the variant's own.

use transplat_core::present::Background;

/// Number of a background in WGSL; on a screen, what is transparent shows the checkerboard.
pub fn background_number(background: Background) -> u32 {
    match background {
        Background::Color(_) => 0,
        Background::Gradient(..) => 1,
        Background::Environment => 2,
        Background::Checker | Background::Transparent => 3,
    }
}
