//! The stages on wgpu, one pass a file, each with its CPU twin of the same name in `transplat_core`.
//!
//! No pass depends on the size of a subgroup or waits across workgroups, and long loops are split over dispatches.
//! Assets are worked on in chunks of [`CHUNK`] surfels, so that no binding outgrows what every adapter offers.

pub mod bake;
mod context;
pub mod environment;
mod layout;
pub mod live;
pub mod present;
pub mod rasterize;
pub mod shader;
mod trace;
pub mod transfer;

pub use context::{Context, GpuError, Result, Submission, choose_adapter, device_descriptor};

/// Surfels in a chunk: degree-8 colour of a chunk (972 bytes a surfel) just fits into the 128 MiB that every adapter can bind.
pub const CHUNK: usize = 1 << 17;

/// Threads of a workgroup where a thread works on a surfel: what every adapter offers, and a multiple of every subgroup.
pub const WORKGROUP: usize = 64;
