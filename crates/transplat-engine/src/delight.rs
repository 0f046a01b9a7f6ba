//! A splat without its light.

use std::ops::RangeInclusive;
use std::path::Path;

use anyhow::Result;
use serde::{Deserialize, Serialize};
use transplat_core::environment::Illumination;
use transplat_core::files::{SplatFile, write_delit};
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::materials::{Materials, PLAUSIBLE_WHITEST};
use transplat_core::transfer::{Part, PreparedTransfer};

/// Colour of a splat without its light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DelitAs {
    /// Its albedo.
    #[default]
    Albedo,
    /// Appearance under uniform white light.
    Even,
}

/// Range of an albedo that the user may set for the whitest surface.
pub const ALBEDOS: RangeInclusive<f32> = 0.02..=1.0;

/// An asset without its light.
pub struct Delit {
    /// Its surfels, with that colour.
    pub cloud: SurfelCloud,
    /// Albedo, metalness and emission of each surfel.
    pub materials: Materials,
    /// Trust in the capture light: the share of its change that was taken out, in logarithms.
    pub trust: f32,
}

impl Delit {
    /// Takes an asset that is prepared under the light of its capture, and the albedo of the whitest surface where that is known.
    pub fn of(
        prepared: &PreparedTransfer,
        cloud: &SurfelCloud,
        delit_as: DelitAs,
        whitest: Option<f32>,
    ) -> Result<Self> {
        let materials = prepared.materials(whitest);
        let (sh, sh_degree) = match delit_as {
            DelitAs::Albedo => (materials.stored(cloud.encoding), 0),
            DelitAs::Even => {
                let even = Illumination::even(MAX_DEGREE).told([materials.gain; 3]);
                let relit = prepared.relight(&even, Part::Whole)?;
                (relit.stored(cloud), cloud.sh_degree)
            }
        };
        let cloud = SurfelCloud {
            sh: sh.into(),
            sh_degree,
            ..cloud.clone()
        };
        let trust = match prepared {
            PreparedTransfer::Directional(transfer) => transfer.trust,
            _ => 1.0,
        };
        Ok(Self {
            cloud,
            materials,
            trust,
        })
    }

    /// Warnings of an implausible exposure, and of light that is left in it.
    pub fn warnings(&self, whitest: Option<f32>) -> Vec<String> {
        let found = self.materials.whitest;
        let is_plausible = whitest.is_some() || PLAUSIBLE_WHITEST.contains(&found);
        let mut warnings = Vec::new();
        if !is_plausible {
            warnings.push(format!(
                "light and images differ in exposure: the whitest surface would have an albedo of {found:.3}. {:.2} is assumed (--whitest)",
                found * self.materials.gain
            ));
        }
        if self.trust < 1.0 {
            warnings.push(format!(
                "{:.0} % of its light is left in it, since that is not known for sure (--trust-source 1 removes all)",
                100.0 * (1.0 - self.trust)
            ));
        }
        warnings
    }

    /// Writes it in the format that the name says; `file` is what it was read from.
    pub fn write(&self, file: &SplatFile, with_materials: bool, path: &Path) -> Result<()> {
        let materials = with_materials.then_some(&self.materials);
        Ok(write_delit(file, &self.cloud, materials, path)?)
    }
}
