//! What the transfer can be asked for: one plain struct for command line, viewer, report and saved looks.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::sh::MAX_DEGREE;
use crate::skips::Skips;

/// Which mathematics.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Preset {
    /// Sections 3.2 to 3.5 of the paper, computed without error.
    Paper,
    /// Sums over directions, with suns, bounces, two sides and gloss.
    #[default]
    Best,
}

impl Preset {
    /// Both of them.
    pub const ALL: [Self; 2] = [Self::Best, Self::Paper];

    /// As command line and looks call it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Best => "best",
        }
    }

    /// The epsilon that serves it best.
    pub fn epsilon(self) -> f32 {
        match self {
            Self::Paper => 0.05,
            Self::Best => 0.006,
        }
    }
}

/// Which terms take part; all of them unless an ablation asks otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Terms {
    /// Self-shadowing (3.3); off, every surfel sees the whole light.
    pub shadow: bool,
    /// Preset `paper`: bands 1 and up (3.5); off, the result is matte.
    pub specular: bool,
    /// Preset `paper`: the mirror of eq. 7; off, highlights stick to where the light is.
    pub reflection: bool,
    /// Preset `paper`: the attenuation of eq. 9; off, every surface is a mirror.
    pub attenuation: bool,
    /// Preset `best`: light is summed over directions; off, it is an SH series first.
    pub sums: bool,
    /// Preset `best`: compact bright sources are taken out and cast crisp shadows; off, they are sky.
    pub suns: bool,
    /// Preset `best`: light that bounces off other surfels; off, what blocks the light is black.
    pub bounce: bool,
    /// Preset `best`: thin surfels are lit from both sides; off, the front's light serves both.
    pub two_sided: bool,
    /// Preset `best`: a specular lobe; off, all colour is matte.
    pub lobe: bool,
    /// Preset `best`: what no term explains of the capture is kept; off, it is left out.
    pub residual: bool,
}

impl Default for Terms {
    fn default() -> Self {
        Self {
            shadow: true,
            specular: true,
            reflection: true,
            attenuation: true,
            sums: true,
            suns: true,
            bounce: true,
            two_sided: true,
            lobe: true,
            residual: true,
        }
    }
}

/// One of the [`Terms`]: its name, what has it, and where its switch is.
pub struct Term {
    /// As the command line calls it.
    pub name: &'static str,
    /// Presets that have it.
    pub presets: &'static [Preset],
    /// Its switch.
    pub of: fn(&mut Terms) -> &mut bool,
}

impl Term {
    const fn new(
        name: &'static str,
        presets: &'static [Preset],
        of: fn(&mut Terms) -> &mut bool,
    ) -> Self {
        Self { name, presets, of }
    }
}

impl Terms {
    /// All of them.
    pub const ALL: [Term; 10] = {
        const PAPER: &[Preset] = &[Preset::Paper];
        const BEST: &[Preset] = &[Preset::Best];
        [
            Term::new("shadow", &Preset::ALL, |t| &mut t.shadow),
            Term::new("specular", PAPER, |t| &mut t.specular),
            Term::new("reflection", PAPER, |t| &mut t.reflection),
            Term::new("attenuation", PAPER, |t| &mut t.attenuation),
            Term::new("sums", BEST, |t| &mut t.sums),
            Term::new("suns", BEST, |t| &mut t.suns),
            Term::new("bounce", BEST, |t| &mut t.bounce),
            Term::new("two-sided", BEST, |t| &mut t.two_sided),
            Term::new("lobe", BEST, |t| &mut t.lobe),
            Term::new("residual", BEST, |t| &mut t.residual),
        ]
    };

    /// Those that a preset has.
    pub fn of_preset(preset: Preset) -> impl Iterator<Item = &'static Term> {
        const ALL: &[Term] = &Terms::ALL;
        ALL.iter().filter(move |t| t.presets.contains(&preset))
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
    /// Degree of lights and visibility, 0 to 8, where they are SH series: in preset `paper`, and in `best` without its sums.
    pub sh_degree: usize,
    /// Light that is added to the source's on every surfel, relative to its mean irradiance; the preset's own if there is none.
    pub epsilon: Option<f32>,
    /// Terms that take part.
    pub terms: Terms,
    /// What may be left out where a scene does not need it; no file keeps that.
    #[serde(skip)]
    pub skips: Skips,
}

impl Default for TransferSettings {
    fn default() -> Self {
        Self {
            preset: Preset::default(),
            sh_degree: 3,
            epsilon: None,
            terms: Terms::default(),
            skips: Skips::default(),
        }
    }
}

impl TransferSettings {
    /// The defaults of a preset.
    pub fn of(preset: Preset) -> Self {
        Self {
            preset,
            ..Self::default()
        }
    }

    /// The same with one of the preset's terms switched off.
    ///
    /// # Errors
    /// The preset has no such term; says which it has.
    pub fn without(mut self, name: &str) -> Result<Self> {
        let Some(term) = Terms::of_preset(self.preset).find(|t| t.name == name) else {
            let there: Vec<&str> = Terms::of_preset(self.preset).map(|t| t.name).collect();
            return Err(Error::Mismatch(format!(
                "preset {} has no term {name}; it has {}",
                self.preset.name(),
                there.join(", ")
            )));
        };
        *(term.of)(&mut self.terms) = false;
        Ok(self)
    }

    /// The epsilon that counts.
    pub fn epsilon(&self) -> f32 {
        self.epsilon.unwrap_or(self.preset.epsilon())
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// Says which setting is out of range.
    pub fn validate(&self) -> Result<()> {
        if self.sh_degree > MAX_DEGREE {
            return Err(Error::Mismatch(format!(
                "SH degree {} is out of range 0 to {MAX_DEGREE}",
                self.sh_degree
            )));
        }
        if !EPSILON.contains(&self.epsilon()) {
            return Err(Error::Mismatch(format!(
                "epsilon {} is out of range 1e-6 to 1000 (relative to the source's mean irradiance)",
                self.epsilon()
            )));
        }
        Ok(())
    }
}
