//! Subject of the sweep, and its effort.

use std::sync::Arc;

use transplat_core::bake::Bake;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::surfels::SurfelCloud;

use crate::ground_truth::views::Views;

/// Splat between two lights that is measured.
pub struct Subject {
    /// Surfels of the splat.
    pub cloud: Arc<SurfelCloud>,
    /// The target light as its file has it, where reading it is to be measured.
    pub map: Option<EnvironmentMap>,
    /// Source and target as the asset sees them.
    pub lights: [Illumination; 2],
    /// Truth, where there is any.
    pub views: Option<Views>,
    /// Bakes of the whole asset that are there already.
    pub bakes: Vec<Bake>,
}

/// Error against the f64 oracle.
#[derive(Clone, Copy, Debug)]
pub struct Numeric {
    /// L2 norm of the difference over that of the oracle's.
    pub rel_l2: f64,
    /// Largest absolute error.
    pub max_abs: f64,
    /// PSNR of the image in dB; none where there is none.
    pub psnr: Option<f64>,
}

/// Effort of a sweep.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Settings that the viewer offers.
    Offered,
    /// Few settings and repeats.
    Quick,
    /// All settings.
    Full,
}
