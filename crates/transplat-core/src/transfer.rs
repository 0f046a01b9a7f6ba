//! Stage *transfer*: from the asset's colour under the source light to its colour under the target light, by one of two presets.
//!
//! [`paper`] is the paper's transfer by products of SH series, [`best`] sums over directions. Both prepare all that does not change with
//! the target once.

pub mod best;
pub mod paper;
mod settings;

use std::sync::Arc;

use half::f16;

use crate::color::{Encoding, decode_sh, encode_sh};
use crate::environment::Illumination;
use crate::error::{Error, Result};
use crate::sh::with_degree;
use crate::skips::Skips;
use crate::surfels::SurfelCloud;
use crate::visibility::{Bake, Visibility};

use best::{BestAsset, BestTransfer};
use paper::{PaperAsset, PaperTransfer};
pub use settings::{EPSILON, Preset, Terms, TransferSettings};

/// What of a relit colour is wanted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Part {
    /// All of it.
    #[default]
    Whole,
    /// What is scattered: band 0 under preset `paper`, what is not gloss under `best`.
    Diffuse,
    /// What is mirrored: the other bands under preset `paper`, the lobe under `best`.
    Specular,
}

impl Part {
    /// Which of `k` coefficients preset `paper` has it in.
    pub fn coefficients(self, k: usize) -> std::ops::Range<usize> {
        match self {
            Self::Whole => 0..k,
            Self::Diffuse => 0..1,
            Self::Specular => 1..k,
        }
    }
}

/// A relit asset.
#[derive(Clone, Debug)]
pub struct Relit {
    /// Colour. `[n][K][3]`
    pub sh: Vec<[f32; 3]>,
    /// Degree of the colour: the asset's, or less where its upper bands would be empty.
    pub degree: usize,
    /// How that is to be read.
    pub encoding: Encoding,
    /// By how much what is not gloss has changed (paper eq. 5). `[n]`
    pub tau: Vec<[f32; 3]>,
}

impl Relit {
    /// The same in linear light.
    pub fn linear(self) -> Self {
        if self.encoding == Encoding::Linear {
            return self;
        }
        Self {
            sh: decode_sh(&self.sh, self.degree, self.encoding),
            encoding: Encoding::Linear,
            ..self
        }
    }

    /// The same with all bands up to a degree.
    pub fn of_degree(self, degree: usize) -> Self {
        Self {
            sh: with_degree(self.sh, self.degree, degree),
            degree,
            ..self
        }
    }

    /// Colour as the asset's file stores it. `[n][K][3]`
    pub fn stored(self, cloud: &SurfelCloud) -> Vec<[f32; 3]> {
        if self.encoding == cloud.encoding {
            return self.of_degree(cloud.sh_degree).sh;
        }
        // Encoded, a function of the view needs more bands than it had.
        let degree = if self.degree == 0 { 0 } else { cloud.sh_degree };
        let linear = self.linear().of_degree(degree);
        let stored = encode_sh(linear.sh, degree, cloud.encoding);
        with_degree(stored, degree, cloud.sh_degree)
    }
}

/// An asset under its source light, ready for any other.
#[derive(Clone, Debug)]
pub enum PreparedTransfer {
    /// By preset `paper`.
    Paper(Arc<PaperTransfer>),
    /// By preset `best`.
    Best(Arc<BestTransfer>),
}

impl PreparedTransfer {
    /// Prepares asset and source light.
    ///
    /// # Errors
    /// A setting is out of range, the bake is of another asset or preset, or the light was not read for the preset.
    pub fn new(
        cloud: &SurfelCloud,
        bake: &Bake,
        source: &Illumination,
        settings: &TransferSettings,
    ) -> Result<Self> {
        TransferAsset::default().prepare(cloud, bake, 0, source, settings)
    }

    /// Relights; `part` says what of the colour is wanted.
    ///
    /// # Errors
    /// The light was not read for the preset.
    pub fn relight(&self, target: &Illumination, part: Part) -> Result<Relit> {
        self.relight_seen(target, part, &[])
    }

    /// The same; surfels that are not seen (`[n]` or empty) may stay as captured.
    ///
    /// # Errors
    /// The light was not read for the preset.
    pub fn relight_seen(
        &self,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> Result<Relit> {
        Ok(match self {
            Self::Paper(paper) => paper.relit(paper.relight(&target.radiance), part),
            Self::Best(best) => best.relight_seen(best.light(target.for_best()?), part, unseen),
        })
    }

    /// By how much each surfel's colour changes under a light, gloss apart. `[n]`
    ///
    /// # Errors
    /// The light was not read for the preset.
    pub fn tau(&self, target: &Illumination) -> Result<Vec<[f32; 3]>> {
        Ok(match self {
            Self::Paper(paper) => paper.tau(&paper.relight(&target.radiance)),
            Self::Best(best) => best.tau(best.light(target.for_best()?)),
        })
    }

    /// What target lights are multiplied by: 1 over the source's mean irradiance.
    pub fn light_gain(&self) -> f32 {
        match self {
            Self::Paper(paper) => paper.light_gain,
            Self::Best(best) => best.light_gain,
        }
    }

    /// Bytes that a change of light reads, beside the asset's own colour.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Paper(paper) => paper.bytes(),
            Self::Best(best) => best.bytes(),
        }
    }

    /// The same with all that it holds rounded to half precision: what storing it so would do to the result.
    pub fn rounded_to_half(&self) -> Self {
        match self {
            Self::Paper(paper) => Self::Paper(Arc::new(paper.rounded_to_half())),
            Self::Best(best) => Self::Best(Arc::new(best.rounded_to_half())),
        }
    }

    /// How many of its [`Self::bytes`] that saves.
    pub fn bytes_saved_by_half(&self) -> usize {
        match self {
            Self::Paper(paper) => paper.bytes_saved_by_half(),
            Self::Best(best) => best.bytes_saved_by_half(),
        }
    }

    /// Whether the source was black, and even light was taken in its place.
    pub fn source_was_black(&self) -> bool {
        match self {
            Self::Paper(paper) => paper.source_was_black,
            Self::Best(best) => best.source_was_black,
        }
    }

    /// How much of what surfel `i`'s colour is divided by is epsilon instead of source light, 0 to 1, the mean of the channels.
    pub fn epsilon_share(&self, i: usize) -> f32 {
        match self {
            Self::Paper(paper) => paper.epsilon_share(i),
            Self::Best(best) => best.epsilon_share(i),
        }
    }

    /// How many times surfel `i`'s colour is multiplied under a target of the source's strength that shines on it with its mean irradiance,
    /// the worst channel: noise and error in the capture grow as much.
    pub fn amplification(&self, i: usize) -> f32 {
        match self {
            Self::Paper(paper) => paper.amplification(i),
            Self::Best(best) => best.amplification(i),
        }
    }

    /// Whether the source on surfel `i` is darker than epsilon in some channel: its change is epsilon's, not the light's.
    pub fn is_dark(&self, i: usize) -> bool {
        match self {
            Self::Paper(paper) => paper.is_dark(i),
            Self::Best(best) => best.is_dark(i),
        }
    }

    /// Share of surfels that are dark.
    pub fn dark_share(&self) -> f32 {
        match self {
            Self::Paper(paper) => paper.dark_share,
            Self::Best(best) => best.dark_share(),
        }
    }
}

/// What of an asset's preparation no light changes: kept between changes of the source and of the settings.
#[derive(Debug, Default)]
pub struct TransferAsset {
    paper: Option<PaperAsset>,
    /// And of which bake, leaving out what.
    best: Option<(u64, Skips, Arc<BestAsset>)>,
}

impl TransferAsset {
    /// Prepares asset and source light; `bake_id` is any number that differs between bakes.
    ///
    /// # Errors
    /// As [`PreparedTransfer::new`].
    pub fn prepare(
        &mut self,
        cloud: &SurfelCloud,
        bake: &Bake,
        bake_id: u64,
        source: &Illumination,
        settings: &TransferSettings,
    ) -> Result<PreparedTransfer> {
        settings.validate()?;
        if bake.len() != cloud.len() {
            return Err(Error::Mismatch(format!(
                "the bake is of {} surfels and the asset has {}",
                bake.len(),
                cloud.len()
            )));
        }
        Ok(match bake.of_preset(settings.preset)? {
            Bake::Visibility(visibility) => PreparedTransfer::Paper(Arc::new(
                self.prepare_paper(cloud, visibility, bake_id, source, settings)?,
            )),
            Bake::Occlusion(occlusion) => {
                let asset = match &self.best {
                    Some((id, skips, asset)) if (*id, *skips) == (bake_id, settings.skips) => {
                        asset.clone()
                    }
                    _ => Arc::new(BestAsset::new(cloud, occlusion.clone(), &settings.skips)),
                };
                self.best = Some((bake_id, settings.skips, asset.clone()));
                let best = BestTransfer::new(&asset, source, settings)?;
                PreparedTransfer::Best(Arc::new(best))
            }
        })
    }

    fn prepare_paper(
        &mut self,
        cloud: &SurfelCloud,
        visibility: &Visibility,
        bake_id: u64,
        source: &Illumination,
        settings: &TransferSettings,
    ) -> Result<PaperTransfer> {
        let source = source.radiance.truncated(settings.sh_degree);
        let asset = self.paper.get_or_insert_with(|| PaperAsset::new(cloud));
        asset.prepare(cloud, visibility, bake_id, &source, settings)
    }
}

/// Rounds to half precision, in place; beyond its range to its largest number.
fn round_to_half(values: &mut [[f32; 3]]) {
    for v in values.iter_mut().flatten() {
        *v = f16::from_f32(v.clamp(-HALF_MAX, HALF_MAX)).to_f32();
    }
}

const HALF_MAX: f32 = 65504.0;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenes;
    use crate::visibility::{BakeSettings, no_progress};

    #[test]
    fn each_preset_takes_its_own_bake_and_light_and_says_so() {
        let cloud = scenes::sphere(50);
        let light = Illumination::even(3);
        for preset in Preset::ALL {
            let settings = TransferSettings::of(preset);
            let bake_settings = BakeSettings { directions: 32 };
            for baked in Preset::ALL {
                let bake = Bake::new(&cloud, baked, &bake_settings, &no_progress);
                let bake = bake.expect("not cancelled");
                let result = PreparedTransfer::new(&cloud, &bake, &light, &settings);
                match result {
                    Ok(prepared) => {
                        assert_eq!(baked, preset);
                        // Even light on an even capture leaves it alone.
                        let relit = prepared
                            .relight(&light, Part::Whole)
                            .expect("a light for both");
                        let tau = relit.tau.iter().flatten();
                        assert!(tau.into_iter().all(|t| (t - 1.0).abs() < 0.06));
                        assert_eq!(prepared.dark_share(), 0.0);
                    }
                    Err(error) => {
                        assert_ne!(baked, preset);
                        assert!(error.to_string().contains(baked.name()), "{error}");
                    }
                }
            }
        }
        let bake = Bake::new(&cloud, Preset::Best, &BakeSettings::default(), &no_progress);
        let without = Illumination {
            beams: None,
            ..light
        };
        let settings = TransferSettings::of(Preset::Best);
        let bake = bake.expect("not cancelled");
        assert!(PreparedTransfer::new(&cloud, &bake, &without, &settings).is_err());
        let other = scenes::sphere(60);
        assert!(PreparedTransfer::new(&other, &bake, &Illumination::even(3), &settings).is_err());
    }
}
