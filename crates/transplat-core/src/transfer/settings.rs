//! What the transfer can be asked for: one plain struct for command line, viewer, report and saved looks.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::sh::MAX_DEGREE;

/// Which mathematics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// Sections 3.2 to 3.5 of the paper, computed without error.
    #[default]
    Paper,
    /// Sums over directions; comes with a later version.
    Best,
}

/// Which terms of the paper take part; all of them unless an ablation asks otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Terms {
    /// Self-shadowing (3.3); off, every surfel sees the whole light.
    pub shadow: bool,
    /// Bands 1 and up (3.5); off, the result is matte.
    pub specular: bool,
    /// The mirror of eq. 7; off, highlights stick to where the light is.
    pub reflection: bool,
    /// The attenuation of eq. 9; off, every surface is a mirror.
    pub attenuation: bool,
}

impl Default for Terms {
    fn default() -> Self {
        Self {
            shadow: true,
            specular: true,
            reflection: true,
            attenuation: true,
        }
    }
}

/// Range of epsilon: below a millionth, f32 irradiance is rounding.
pub const EPSILON: std::ops::RangeInclusive<f32> = 1e-6..=1e3;

/// Settings of the transfer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransferSettings {
    /// Which mathematics.
    pub preset: Preset,
    /// Degree of lights and visibility, 0 to 8.
    pub sh_degree: usize,
    /// Added to the source's irradiance and band norms, relative to its mean irradiance.
    pub epsilon: f32,
    /// Terms that take part.
    pub terms: Terms,
}

impl Default for TransferSettings {
    fn default() -> Self {
        Self {
            preset: Preset::Paper,
            sh_degree: 3,
            epsilon: 0.05,
            terms: Terms::default(),
        }
    }
}

impl TransferSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Says which setting is out of range, or that the preset does not exist yet.
    pub fn validate(&self) -> Result<()> {
        if self.preset == Preset::Best {
            return Err(Error::Mismatch(
                "preset best is not in this version yet; use --preset paper".into(),
            ));
        }
        if self.sh_degree > MAX_DEGREE {
            return Err(Error::Mismatch(format!(
                "SH degree {} is out of range 0 to {MAX_DEGREE}",
                self.sh_degree
            )));
        }
        if !EPSILON.contains(&self.epsilon) {
            return Err(Error::Mismatch(format!(
                "epsilon {} is out of range 1e-6 to 1000 (relative to the source's mean irradiance)",
                self.epsilon
            )));
        }
        Ok(())
    }
}
