//! Stage *transfer* on the GPU. CPU twin: [`transplat_core::transfer`].

pub mod directional;
pub mod harmonic;
