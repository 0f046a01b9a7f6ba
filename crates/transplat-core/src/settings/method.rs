//! Methods of the transfer, and their presets.

use serde::{Deserialize, Serialize};

/// Method of the transfer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub enum Method {
    /// Products of spherical harmonics: sections 3.2 to 3.5 of the paper, computed without error.
    #[serde(rename = "paper")]
    Harmonic,
    /// Sums over directions, with suns, bounces, two sides and gloss.
    #[default]
    #[serde(rename = "best")]
    Directional,
}

impl Method {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Directional, Self::Harmonic];

    /// The preset: what command line and looks call it.
    pub fn preset(self) -> &'static str {
        match self {
            Self::Harmonic => "paper",
            Self::Directional => "best",
        }
    }

    /// The epsilon that serves it best.
    pub fn epsilon(self) -> f32 {
        match self {
            Self::Harmonic => 0.05,
            Self::Directional => 0.006,
        }
    }
}
