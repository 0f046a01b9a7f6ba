//! The engine: scene, stages, jobs and images, for the window and the commands. It knows neither a window nor a command line.

pub mod adapter;
pub mod bake;
pub mod bundled;
pub mod capture;
pub mod delight;
pub mod device;
pub mod environments;
pub mod estimate;
pub mod jobs;
pub mod language;
pub mod layers;
pub mod memory_trim;
pub mod names;
pub mod object;
pub mod output;
pub mod project;
pub mod reading;
pub mod render;
pub mod shot;
pub mod splat;
pub mod video;
pub mod warnings;
pub mod words;
