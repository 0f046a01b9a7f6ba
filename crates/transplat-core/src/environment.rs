//! Stage *project environment*: a light as an equirectangular map, as SH coefficients of its incident radiance, and as beams.

mod beams;
mod emitter;
mod illumination;
mod map;
mod panorama;
mod radiance;
mod sky;
#[cfg(test)]
mod tests;
mod unfold;

pub use crate::images::{ImageReading, Layout};
pub use beams::{Beam, Beams, MAX_SUNS, Mosaic, SUN_RADIUS, SUN_SHARE};
pub use emitter::{Emitter, FEW, MOST_LIGHTS, MOST_PARTS, Shape};
pub use illumination::Illumination;
pub use map::{EnvironmentMap, INFINITE_RADIANCE, azimuth};
pub use radiance::{IncidentRadiance, project_environment, row_weights};
pub use sky::{Date, PlaceAndTime, Sky, Sun, TURBIDITIES, YEARS};
