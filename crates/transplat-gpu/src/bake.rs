//! Stage *bake* on the GPU. CPU twin: [`transplat_core::bake`].

pub mod directional;
pub mod harmonic;
