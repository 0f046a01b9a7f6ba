//! What the report compares.

use transplat_core::transfer::{Preset, Terms, TransferSettings};

/// The capture as it is, or a preset, with a term switched off.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    pub settings: Option<TransferSettings>,
    pub off: Option<&'static str>,
}

impl Variant {
    /// The presets; unless that is enough, also without each of their terms.
    pub fn all(quick: bool) -> Vec<Self> {
        let mut all = Vec::new();
        for preset in Preset::ALL {
            let whole = TransferSettings::of(preset);
            all.push(Self {
                settings: Some(whole.clone()),
                off: None,
            });
            for term in Terms::of_preset(preset).filter(|_| !quick) {
                all.push(Self {
                    settings: whole.clone().without(term.name).ok(),
                    off: Some(term.name),
                });
            }
        }
        all.push(Self {
            settings: None,
            off: None,
        });
        all
    }

    pub fn preset(&self) -> &'static str {
        self.settings
            .as_ref()
            .map_or("nothing", |s| s.preset.name())
    }

    pub fn name(&self) -> String {
        match self.off {
            None => self.preset().to_owned(),
            Some(off) => format!("{} without {off}", self.preset()),
        }
    }

    /// Whether it is what the program does of itself.
    pub fn is_default(&self) -> bool {
        self.settings == Some(TransferSettings::default())
    }
}
