//! Measures the method: error against run time, savings of optimizations, distance to path-traced truth.

pub mod ground_truth;
pub mod metrics;
pub mod report;
pub mod savings;
pub mod sweep;
