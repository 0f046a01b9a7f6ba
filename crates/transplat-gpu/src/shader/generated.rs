//! WGSL that no shader language can express in few lines. `cargo run --package transplat-gpu --example shaders -- FOLDER` prints what comes out.

pub mod directional;
pub mod harmonic;
pub mod sh;
