//! The engine: what the window and the commands ask for work. It knows neither a window nor a command line.

pub mod adapter;
pub mod asset;
pub mod capture;
pub mod environments;
pub mod jobs;
pub mod memory;
pub mod object;
pub mod project;
