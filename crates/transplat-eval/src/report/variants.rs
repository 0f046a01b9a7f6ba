//! Variants that are compared with truth.

use transplat_core::settings::{Method, Terms, TransferSettings};

/// The capture as it is, or a method, with a term switched off or without being told the light of the capture.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthVariant {
    pub settings: Option<TransferSettings>,
    pub off: Option<&'static str>,
    pub source: AssumedSource,
}

/// Capture light that a variant assumes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AssumedSource {
    Told,
    Estimated,
    Even,
    /// The estimate, each channel of it as strong as fits the told light best.
    EstimatedFitted,
    /// Even light, each channel of it as strong as fits the true light best.
    EvenFitted,
}

impl AssumedSource {
    const NOT_TOLD: [Self; 4] = [
        Self::Estimated,
        Self::Even,
        Self::EstimatedFitted,
        Self::EvenFitted,
    ];

    pub fn name(self) -> &'static str {
        match self {
            Self::Told => "told",
            Self::Estimated => "estimated",
            Self::Even => "even",
            Self::EstimatedFitted => "estimated, gain fitted",
            Self::EvenFitted => "even, gain fitted",
        }
    }

    pub fn is_fitted(self) -> bool {
        matches!(self, Self::EstimatedFitted | Self::EvenFitted)
    }
}

impl TruthVariant {
    /// The methods; unless that is enough, also without each of their terms; and the default without being told the light of the capture.
    pub fn all(quick: bool, unknown_light: bool) -> Vec<Self> {
        let of = |settings, off, source| Self {
            settings,
            off,
            source,
        };
        let mut all = Vec::new();
        for method in Method::ALL {
            let whole = TransferSettings::of(method);
            all.push(of(Some(whole.clone()), None, AssumedSource::Told));
            for term in Terms::of_method(method).filter(|_| !quick) {
                let without = whole.clone().without(term.name).ok();
                all.push(of(without, Some(term.name), AssumedSource::Told));
            }
        }
        for source in AssumedSource::NOT_TOLD
            .into_iter()
            .filter(|_| unknown_light)
        {
            all.push(of(Some(TransferSettings::default()), None, source));
        }
        all.push(of(None, None, AssumedSource::Told));
        all
    }

    pub fn method(&self) -> &'static str {
        self.settings
            .as_ref()
            .map_or("nothing", |s| s.method.preset())
    }

    pub fn name(&self) -> String {
        match (self.off, self.source) {
            (None, AssumedSource::Told) => self.method().to_owned(),
            (None, source) => format!("{}, light {}", self.method(), source.name()),
            (Some(off), _) => format!("{} without {off}", self.method()),
        }
    }

    /// True for a method with all its terms.
    pub fn is_whole_preset(&self) -> bool {
        self.settings.is_some() && self.off.is_none() && self.source == AssumedSource::Told
    }

    /// True for the program's defaults.
    pub fn is_default(&self) -> bool {
        self.settings == Some(TransferSettings::default()) && self.source == AssumedSource::Told
    }
}
