//! Variants that are compared with truth.

use transplat_core::settings::{Method, Terms, TransferSettings};

/// A way to relight that is compared with truth.
#[derive(Clone, Debug, PartialEq)]
pub struct TruthVariant {
    pub approach: Approach,
    /// Term that is switched off.
    pub off: Option<&'static str>,
}

/// A method with the light that it takes for the capture's.
#[derive(Clone, Debug, PartialEq)]
pub enum Approach {
    /// The capture as it is.
    Nothing,
    /// A path tracer that takes the captured colour for albedo. It knows shadows, bounced light and no light of the capture.
    Albedo,
    /// A method, by the true capture light.
    Known(TransferSettings),
    /// The default method, by the estimated capture light.
    Estimated(TransferSettings),
    /// The default method, by the estimate with each channel as strong as fits the true capture light best.
    EstimateFitted(TransferSettings),
}

impl TruthVariant {
    fn of(approach: Approach) -> Self {
        Self {
            approach,
            off: None,
        }
    }

    /// The methods; unless that is enough, also without each of their terms; and those that do not know the light of the capture.
    pub fn all(quick: bool, unknown_light: bool) -> Vec<Self> {
        let mut all = Vec::new();
        for method in Method::ALL {
            let whole = TransferSettings::of(method);
            all.push(Self::of(Approach::Known(whole.clone())));
            for term in Terms::of_method(method).filter(|_| !quick) {
                let without = whole.clone().without(term.name);
                all.extend(without.ok().map(|settings| Self {
                    off: Some(term.name),
                    ..Self::of(Approach::Known(settings))
                }));
            }
        }
        if unknown_light {
            let settings = TransferSettings::default;
            all.push(Self::of(Approach::Estimated(settings())));
            all.push(Self::of(Approach::EstimateFitted(settings())));
            all.push(Self::of(Approach::Albedo));
        }
        all.push(Self::of(Approach::Nothing));
        all
    }

    pub fn method(&self) -> &'static str {
        match &self.approach {
            Approach::Nothing => "nothing",
            Approach::Albedo => "albedo",
            Approach::Known(settings)
            | Approach::Estimated(settings)
            | Approach::EstimateFitted(settings) => settings.method.preset(),
        }
    }

    /// The light that it takes for the capture's.
    pub fn source_light(&self) -> &'static str {
        match &self.approach {
            Approach::Nothing | Approach::Known(_) => "told",
            Approach::Albedo => "unknown",
            Approach::Estimated(_) => "estimated",
            Approach::EstimateFitted(_) => "estimated, gain fitted",
        }
    }

    pub fn name(&self) -> String {
        match (self.off, &self.approach) {
            (None, Approach::Nothing | Approach::Known(_)) => self.method().to_owned(),
            (None, _) => format!("{}, light {}", self.method(), self.source_light()),
            (Some(off), _) => format!("{} without {off}", self.method()),
        }
    }

    /// True for a method with all its terms and the true capture light.
    pub fn is_whole_preset(&self) -> bool {
        matches!(self.approach, Approach::Known(_)) && self.off.is_none()
    }

    /// True for the program's defaults with the true capture light.
    pub fn is_default(&self) -> bool {
        self.approach == Approach::Known(TransferSettings::default())
    }
}
