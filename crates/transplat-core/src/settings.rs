//! Settings of the transfer: one plain struct for command line, viewer, report and looks.

mod method;
pub mod optimizations;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result, ensure};
use crate::sh::MAX_DEGREE;

pub use method::Method;
use optimizations::Optimizations;

/// Terms that take part; all of them unless an ablation switches them off.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Terms {
    /// Self-shadowing (3.3); off, every surfel sees the whole light.
    pub shadow: bool,
    /// The harmonic method: bands 1 and up (3.5); off, the result is matte.
    pub specular: bool,
    /// The harmonic method: the mirror of eq. 7; off, highlights stick to where the light is.
    pub reflection: bool,
    /// The harmonic method: the attenuation of eq. 9; off, every surface is a mirror.
    pub attenuation: bool,
    /// The directional method: light is summed over directions; off, it is an SH series first.
    pub sums: bool,
    /// The directional method: compact bright sources are taken out and cast crisp shadows; off, they are sky.
    pub suns: bool,
    /// The directional method: edges of shadows are traced at the pixel; off, a surfel is lit or shadowed as a whole.
    pub pixel_shadows: bool,
    /// The directional method: light that bounces off other surfels; off, what blocks the light is black.
    pub bounce: bool,
    /// The directional method: thin surfels are lit from both sides; off, the front's light serves both.
    pub two_sided: bool,
    /// The directional method: a specular lobe; off, all colour is matte.
    pub lobe: bool,
    /// The directional method: what no term explains of the capture is kept; off, it is left out.
    pub residual: bool,
    /// The directional method: what shines by itself keeps doing so; off, it is taken for paint.
    #[serde(rename = "glow", alias = "emission")]
    pub emission: bool,
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
            pixel_shadows: true,
            bounce: true,
            two_sided: true,
            lobe: true,
            residual: true,
            emission: true,
        }
    }
}

/// One of the [`Terms`]: its name, what has it, and where its switch is.
pub struct Term {
    /// As the command line calls it.
    pub name: &'static str,
    /// Methods that have it.
    pub methods: &'static [Method],
    /// Its switch.
    pub of: fn(&mut Terms) -> &mut bool,
}

impl Term {
    const fn new(
        name: &'static str,
        methods: &'static [Method],
        of: fn(&mut Terms) -> &mut bool,
    ) -> Self {
        Self { name, methods, of }
    }
}

impl Terms {
    /// All of them.
    pub const ALL: [Term; 12] = {
        const HARMONIC: &[Method] = &[Method::Harmonic];
        const DIRECTIONAL: &[Method] = &[Method::Directional];
        [
            Term::new("shadow", &Method::ALL, |t| &mut t.shadow),
            Term::new("specular", HARMONIC, |t| &mut t.specular),
            Term::new("reflection", HARMONIC, |t| &mut t.reflection),
            Term::new("attenuation", HARMONIC, |t| &mut t.attenuation),
            Term::new("sums", DIRECTIONAL, |t| &mut t.sums),
            Term::new("suns", DIRECTIONAL, |t| &mut t.suns),
            Term::new("pixel-shadows", DIRECTIONAL, |t| &mut t.pixel_shadows),
            Term::new("bounce", DIRECTIONAL, |t| &mut t.bounce),
            Term::new("two-sided", DIRECTIONAL, |t| &mut t.two_sided),
            Term::new("lobe", DIRECTIONAL, |t| &mut t.lobe),
            Term::new("residual", DIRECTIONAL, |t| &mut t.residual),
            Term::new("glow", DIRECTIONAL, |t| &mut t.emission),
        ]
    };

    /// Terms of a method.
    pub fn of_method(method: Method) -> impl Iterator<Item = &'static Term> {
        const ALL: &[Term] = &Terms::ALL;
        ALL.iter().filter(move |t| t.methods.contains(&method))
    }
}

/// Range of epsilon: below a millionth, f32 irradiance is rounding.
pub const EPSILON: std::ops::RangeInclusive<f32> = 1e-6..=1e3;

/// Brightness that paint explains, in times of the whitest surface.
pub const GLOW_ABOVE: f32 = 1.2;

/// Range of that limit, from all that is bright to hardly anything.
pub const GLOW_RANGE: std::ops::RangeInclusive<f32> = 0.05..=100.0;

/// Settings of the transfer.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TransferSettings {
    /// Method of the transfer.
    #[serde(rename = "preset")]
    pub method: Method,
    /// Degree of lights and visibility, 0 to 8, where they are SH series: in the harmonic method, and in the directional one without its sums.
    pub sh_degree: usize,
    /// Light that is added to the source's on every surfel, relative to its mean irradiance; the method's own if there is none.
    pub epsilon: Option<f32>,
    /// Terms that take part.
    pub terms: Terms,
    /// Brightness from which a surface emits light, in times of the whitest surface in the same light (the directional method).
    pub glow_above: f32,
    /// Optimizations that are on; no file keeps them.
    #[serde(skip)]
    pub optimizations: Optimizations,
}

impl Default for TransferSettings {
    fn default() -> Self {
        Self {
            method: Method::default(),
            sh_degree: 3,
            epsilon: None,
            terms: Terms::default(),
            glow_above: GLOW_ABOVE,
            optimizations: Optimizations::default(),
        }
    }
}

impl TransferSettings {
    /// The defaults of a method.
    pub fn of(method: Method) -> Self {
        Self {
            method,
            ..Self::default()
        }
    }

    /// Settings with one of the method's terms switched off.
    ///
    /// # Errors
    /// The method has no such term; says which it has.
    pub fn without(mut self, name: &str) -> Result<Self> {
        let Some(term) = Terms::of_method(self.method).find(|t| t.name == name) else {
            let there: Vec<&str> = Terms::of_method(self.method).map(|t| t.name).collect();
            return Err(Error::Mismatch(format!(
                "preset {} has no term {name}; it has {}",
                self.method.preset(),
                there.join(", ")
            )));
        };
        *(term.of)(&mut self.terms) = false;
        Ok(self)
    }

    /// The epsilon that counts.
    pub fn epsilon(&self) -> f32 {
        self.epsilon.unwrap_or(self.method.epsilon())
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// Says which setting is out of range.
    pub fn validate(&self) -> Result<()> {
        let (degree, epsilon) = (self.sh_degree, self.epsilon());
        ensure(degree <= MAX_DEGREE, || {
            format!("SH degree {degree} is out of range 0 to {MAX_DEGREE}")
        })?;
        ensure(EPSILON.contains(&epsilon), || {
            format!(
                "epsilon {epsilon} is out of range 1e-6 to 1000 (relative to the source's mean irradiance)"
            )
        })?;
        ensure(GLOW_RANGE.contains(&self.glow_above), || {
            let limit = self.glow_above;
            format!(
                "an emission threshold of {limit} is out of range 0.05 to 100 (times the whitest surface)"
            )
        })
    }
}
