//! Interface of a transfer, and its result.

use std::sync::Arc;

use glam::{Affine3A, DMat3, Quat};

use super::cast_shadows::{CastShadows, PlacedShadows};
use super::materials::Materials;
use crate::color::{Encoding, decode_sh, encode_sh};
use crate::color_rows::ColorRows;
use crate::environment::Illumination;
use crate::error::Result;
use crate::settings::optimizations::{SkippedWork, Stage};
use crate::settings::{Terms, TransferSettings};
use crate::sh::{coefficient_count, rotate_functions, with_degree};
use crate::surfels::SurfelCloud;

/// An asset under its source light, ready for any other, whatever the method.
pub trait Relight: std::fmt::Debug + Send + Sync {
    /// Relights; `part` says what of the colour is wanted, and surfels that are not seen (`[n]` or empty) may stay as captured.
    ///
    /// # Errors
    /// The light was not read for the method.
    fn relight_seen(&self, target: &Illumination, part: Part, unseen: &[bool]) -> Result<Relit> {
        self.relight_after(None, target, part, unseen)
    }

    /// Relights into the memory of a result that is not needed any more.
    ///
    /// # Errors
    /// The light was not read for the method.
    fn relight_after(
        &self,
        last: Option<Relit>,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> Result<Relit>;

    /// Relights to be kept and drawn, the colour of very many surfels in sixteen bits a number.
    ///
    /// # Errors
    /// The light was not read for the method.
    fn relight_rows(
        &self,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> Result<RelitRows> {
        self.relight_seen(target, part, unseen).map(RelitRows::of)
    }

    /// Relights each object of a scene, in its own coordinates; a single one is a scene of one.
    ///
    /// # Errors
    /// The light was not read for the method.
    fn relight_objects(
        &self,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> Result<Vec<Relit>> {
        Ok(vec![self.relight_seen(target, part, unseen)?])
    }

    /// Part of the colour that a transfer computes to show another.
    fn computed_part(&self, shown: Part) -> Part;

    /// By how much each surfel's colour changes under a light, gloss apart. `[n]`
    ///
    /// # Errors
    /// The light was not read for the method.
    fn tau(&self, target: &Illumination) -> Result<Vec<[f32; 3]>>;

    /// Relights coarsely, for what is shown while the light changes; none where nothing is quicker than a relight. `[n]`
    ///
    /// # Errors
    /// The light was not read for the method.
    fn coarse_tau(&self, _target: &Illumination) -> Result<Option<Vec<[f32; 3]>>> {
        Ok(None)
    }

    /// Materials of the surfels, from capture light and images; `whitest` is the albedo of the whitest of them, if that is known.
    fn materials(&self, whitest: Option<f32>) -> Materials;

    /// Factor of target lights: 1 over the source's mean irradiance.
    fn light_gain(&self) -> f32;

    /// True where the source was black, and even light was taken in its place.
    fn source_was_black(&self) -> bool;

    /// Bytes that a change of light reads, beside the asset's own colour.
    fn bytes(&self) -> usize;

    /// Work that is skipped whatever the light; `cloud` is the splat that was prepared.
    fn skipped_work(&self, cloud: &SurfelCloud) -> Vec<SkippedWork>;

    /// Work that is skipped for a light, beside that; the GPU works on all channels at once, and gains nothing by a grey one.
    fn skipped_work_for(&self, light: &Illumination, on_gpu: bool) -> Option<SkippedWork>;

    /// Share of epsilon in the divisor of surfel `i`'s colour, 0 to 1, the mean of the channels.
    fn epsilon_share(&self, i: usize) -> f32;

    /// Shadows that a light casts at the pixel on surfels whose diffuse light it changes by `tau`, `[n]`; none where no edge of one is.
    ///
    /// # Errors
    /// The light was not read for the method.
    fn shadows(
        &self,
        _target: &Illumination,
        _tau: &[[f32; 3]],
    ) -> Result<Option<Arc<CastShadows>>> {
        Ok(None)
    }

    /// Factor of surfel `i`'s colour under a target of the source's strength that shines on it with its mean irradiance, the worst channel: noise and
    /// error in the capture grow as much.
    fn amplification(&self, i: usize) -> f32;

    /// True where the source on surfel `i` is darker than epsilon in some channel: its change is epsilon's, not the light's.
    fn is_dark(&self, i: usize) -> bool;

    /// Share of surfels that are dark.
    fn dark_share(&self) -> f32;
}

/// Part of a relit colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Part {
    /// All of it.
    #[default]
    Whole,
    /// Diffuse part: band 0 under the harmonic method, all but the lobe under the directional one.
    Diffuse,
    /// Specular part: the other bands under the harmonic method, the lobe under the directional one.
    Specular,
}

impl Part {
    /// Coefficients, of `k`, that the harmonic method has it in.
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
    /// Encoding of the coefficients.
    pub encoding: Encoding,
    /// By how much what is not gloss has changed (paper eq. 5). `[n]`
    pub tau: Vec<[f32; 3]>,
    /// Shadows that are cast at the pixel; no file has them.
    pub shadows: Vec<PlacedShadows>,
}

/// A relit asset as it is kept to be drawn, never to be exported: the colour of very many surfels is in sixteen bits.
#[derive(Clone, Debug)]
pub struct RelitRows {
    /// Colour. `[n][K]`
    pub sh: ColorRows,
    /// As that of [`Relit`].
    pub degree: usize,
    /// Encoding of the coefficients.
    pub encoding: Encoding,
    /// As that of [`Relit`]. `[n]`
    pub tau: Vec<[f32; 3]>,
    /// As that of [`Relit`].
    pub shadows: Vec<PlacedShadows>,
}

impl RelitRows {
    /// All of a result as it is.
    pub fn whole(relit: Relit) -> Self {
        Self::with(ColorRows::whole, relit)
    }

    /// As the trait's [`Relight::relight_rows`] has it.
    pub fn of(relit: Relit) -> Self {
        Self::with(ColorRows::of, relit)
    }

    fn with(rows: fn(Vec<[f32; 3]>, usize) -> ColorRows, relit: Relit) -> Self {
        Self {
            sh: rows(relit.sh, coefficient_count(relit.degree)),
            degree: relit.degree,
            encoding: relit.encoding,
            tau: relit.tau,
            shadows: relit.shadows,
        }
    }

    /// Relit colour that is kept in full precision.
    pub(super) fn into_whole(self) -> Relit {
        Relit {
            sh: self.sh.into_values(),
            degree: self.degree,
            encoding: self.encoding,
            tau: self.tau,
            shadows: self.shadows,
        }
    }
}

impl Relit {
    /// Colour in linear light.
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

    /// Colour with all bands up to a degree.
    pub fn of_degree(self, degree: usize) -> Self {
        Self {
            sh: with_degree(self.sh, self.degree, degree),
            degree,
            ..self
        }
    }

    /// Colour of a splat that is moved to a place: turned with it.
    pub fn placed(mut self, scene_from_object: Affine3A) -> Self {
        for shadows in &mut self.shadows {
            *shadows = shadows.clone().moved(0, scene_from_object);
        }
        let (_, turn, _) = scene_from_object.to_scale_rotation_translation();
        self.turned(turn)
    }

    /// Colour of a rotated splat.
    pub(super) fn turned(mut self, turn: Quat) -> Self {
        if turn != Quat::IDENTITY {
            let turn = DMat3::from_quat(turn.as_dquat());
            self.sh = rotate_functions(turn, self.degree, &self.sh);
        }
        self
    }

    /// Results of one degree and encoding as one, surfels after surfels.
    pub(super) fn together(each: impl Iterator<Item = Self>) -> Option<Self> {
        each.reduce(|mut all, one| {
            let first = all.tau.len();
            let shadows = one.shadows.into_iter();
            all.shadows
                .extend(shadows.map(|s| s.moved(first, Affine3A::IDENTITY)));
            all.sh.extend(one.sh);
            all.tau.extend(one.tau);
            all
        })
    }

    /// Colour as the asset's file stores it. `[n][K][3]`
    pub fn stored(self, cloud: &SurfelCloud) -> Vec<[f32; 3]> {
        self.stored_as(cloud.sh_degree, cloud.encoding)
    }

    /// Colour as a splat of that degree stores it. `[n][K][3]`
    pub fn stored_as(self, sh_degree: usize, encoding: Encoding) -> Vec<[f32; 3]> {
        if self.encoding == encoding {
            return self.of_degree(sh_degree).sh;
        }
        // Encoded, a function of the view needs more bands than it had.
        let degree = if self.degree == 0 { 0 } else { sh_degree };
        let linear = self.linear().of_degree(degree);
        let stored = encode_sh(linear.sh, degree, encoding);
        with_degree(stored, degree, sh_degree)
    }
}

/// Terms that are switched off.
pub(super) fn switched_off(settings: &TransferSettings) -> Vec<SkippedWork> {
    let mut terms = settings.terms;
    Terms::of_method(settings.method)
        .filter(|term| !*(term.of)(&mut terms))
        .map(|term| SkippedWork {
            max_error: None,
            ..SkippedWork::exact(Stage::Transfer, term.name, "switched off")
        })
        .collect()
}

/// Bytes of colour that `n` surfels do not have in the bands above a degree.
pub(super) fn empty_bytes(n: usize, degree: usize, filled: usize) -> usize {
    12 * n * (coefficient_count(degree) - coefficient_count(filled))
}
