//! Stages of a project. Each has a key of its inputs, runs when that changes, long ones as jobs, and keeps a result only while its key is current.

mod backdrop;
mod bake;
mod channel;
mod confidence;
mod estimate;
mod ground;
mod hidden;
mod insertion;
mod joint;
mod lights;
mod load;
mod prepare;
mod relight;

pub use estimate::DROP_IT;
