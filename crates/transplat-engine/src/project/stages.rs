//! The stages of a project: each has a key, all that its value depends on, and runs when that has changed; long ones
//! as jobs, whose result is taken in where it is still asked for.

mod asset;
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
mod prepare;
mod relight;

pub use estimate::DROP_IT;
