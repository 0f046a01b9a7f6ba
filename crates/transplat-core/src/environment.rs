//! Stage *project environment*: a light as equirectangular map, as SH coefficients of its incident radiance, and as light samples.

mod emitter;
mod illumination;
mod light_samples;
mod map;
mod panorama;
mod radiance;
mod sky;
#[cfg(test)]
mod tests;
mod unfold;

pub use crate::images::{ImageReading, Layout};
pub use emitter::{Emitter, FEW, MOST_LIGHTS, MOST_PARTS, Shape};
pub use illumination::Illumination;
pub use light_samples::{LightSample, LightSamples, MAX_SUNS, Mosaic, SUN_RADIUS, SUN_SHARE};
pub use map::{EnvironmentMap, INFINITE_RADIANCE, azimuth};
pub use radiance::{IncidentRadiance, project_environment, row_weights};
pub use sky::{Date, PlaceAndTime, Sky, Sun, TURBIDITIES, YEARS};
