//! A look: all settings of a relight in one readable file (JSON).

use serde::{Deserialize, Serialize};

use crate::color::Display;
use crate::error::{Error, Result};
use crate::present::{Background, View};
use crate::surfels::UpAxis;
use crate::transfer::TransferSettings;
use crate::visibility::{DEFAULT_DIRECTIONS, DIRECTIONS};

/// Every setting that changes the picture; what a file leaves out keeps its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Look {
    /// The mathematics.
    pub transfer: TransferSettings,
    /// Turn of the source light about the up axis, in degrees, counter-clockwise seen from above.
    pub rotate_source: f64,
    /// The same for the target light.
    pub rotate_target: f64,
    /// Strength of the target light, in stops.
    pub strength_target: f32,
    /// The asset's up axis, where the file's own is not to be believed.
    pub up: Option<UpAxis>,
    /// The asset's colour is linear already.
    pub linear: bool,
    /// Directions of the bake.
    pub directions: usize,
    /// Exposure and tone curve.
    pub display: Display,
    /// What is shown.
    pub view: View,
    /// What is behind it.
    pub background: Background,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            transfer: TransferSettings::default(),
            rotate_source: 0.0,
            rotate_target: 0.0,
            strength_target: 0.0,
            up: None,
            linear: false,
            directions: DEFAULT_DIRECTIONS,
            display: Display::default(),
            view: View::default(),
            background: Background::default(),
        }
    }
}

/// Range of exposure and strength in stops: 18 orders of magnitude either way.
pub const STOPS: std::ops::RangeInclusive<f32> = -60.0..=60.0;

impl Look {
    /// Checks the ranges.
    ///
    /// # Errors
    /// Says which setting is out of range.
    pub fn validate(&self) -> Result<()> {
        self.transfer.validate()?;
        if !DIRECTIONS.contains(&self.directions) {
            return Err(Error::Mismatch(format!(
                "{} visibility directions are out of range {} to {}",
                self.directions,
                DIRECTIONS.start(),
                DIRECTIONS.end()
            )));
        }
        for (name, stops) in [
            ("exposure", self.display.exposure),
            ("strength of the target", self.strength_target),
        ] {
            if !STOPS.contains(&stops) {
                return Err(Error::Mismatch(format!(
                    "{name} {stops} is out of range -60 to 60 stops"
                )));
            }
        }
        for degrees in [self.rotate_source, self.rotate_target] {
            if !degrees.is_finite() {
                return Err(Error::Mismatch("a light's turn is not a number".into()));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_partial_look_keeps_the_defaults_and_a_misspelt_one_is_refused() {
        let look: Look = serde_json::from_str(
            r#"{"transfer": {"epsilon": 0.1, "terms": {"shadow": false}}, "up": "-y"}"#,
        )
        .expect("a good look");
        assert_eq!(look.transfer.sh_degree, 3);
        assert!(!look.transfer.terms.shadow && look.transfer.terms.specular);
        assert_eq!(look.up, Some(UpAxis::MinusY));
        for misspelt in [
            r#"{"epsilom": 1}"#,
            r#"{"transfer": {"terms": {"shadows": false}}}"#,
            r#"{"display": {"exposur": 1}}"#,
        ] {
            assert!(
                serde_json::from_str::<Look>(misspelt).is_err(),
                "{misspelt}"
            );
        }
        let bright: Look =
            serde_json::from_str(r#"{"display": {"exposure": 500}}"#).expect("a look");
        assert!(bright.validate().is_err() && look.validate().is_ok());
        let text = serde_json::to_string(&look).expect("plain data");
        assert_eq!(
            serde_json::from_str::<Look>(&text).expect("its own text"),
            look
        );
    }
}
