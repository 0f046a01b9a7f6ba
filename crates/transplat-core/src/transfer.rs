//! Stage *transfer*: from a splat's colour under the source light to its colour under the target light, by one of two methods.
//!
//! [`harmonic`] is the paper's transfer by products of SH series, [`directional`] sums over directions. Both prepare all that does not change with
//! the target once.

pub mod cast_shadows;
pub mod directional;
pub mod harmonic;
pub mod materials;
mod relit;
pub mod scene;

use std::sync::Arc;

use crate::bake::Bake;
use crate::color_rows::SHORT_FROM;
use crate::environment::Illumination;
use crate::error::{Error, Result, ensure};
use crate::memory;
use crate::progress::{Progress, no_progress, part, tell};
use crate::settings::optimizations::Optimizations;
use crate::settings::{Method, TransferSettings};
use crate::sh::coefficient_count;
use crate::surfels::SurfelCloud;

use directional::{DirectionalCache, DirectionalTransfer};
use harmonic::{HarmonicCache, HarmonicTransfer};
pub use relit::{Part, Relight, Relit, RelitRows};
use scene::SceneTransfer;
use scene::harmonic::HarmonicScene;

/// An asset under its source light, ready for any other.
#[derive(Clone, Debug)]
pub enum PreparedTransfer {
    /// By the harmonic method.
    Harmonic(Arc<HarmonicTransfer>),
    /// By the directional method.
    Directional(Arc<DirectionalTransfer>),
    /// By the directional method, several objects.
    Scene(Arc<SceneTransfer>),
    /// By the harmonic method, several objects.
    HarmonicScene(Arc<HarmonicScene>),
}

impl std::ops::Deref for PreparedTransfer {
    type Target = dyn Relight;

    fn deref(&self) -> &Self::Target {
        match self {
            Self::Harmonic(harmonic) => &**harmonic,
            Self::Directional(directional) => &**directional,
            Self::Scene(scene) => &**scene,
            Self::HarmonicScene(scene) => &**scene,
        }
    }
}

impl PreparedTransfer {
    /// Prepares asset and source light.
    ///
    /// # Errors
    /// A setting is out of range, the bake is of another asset or method, or the light was not read for the method.
    pub fn new(
        cloud: &SurfelCloud,
        bake: &Bake,
        source: &Illumination,
        settings: &TransferSettings,
    ) -> Result<Self> {
        TransferCache::default().prepare(cloud, bake, 0, source, settings, &no_progress)
    }

    /// Transfer of some of the surfels without the others, given the bake of what they see then. Only the directional method knows how the others lit
    /// those.
    ///
    /// # Errors
    /// The bake is of another number of surfels or another method, or nothing can be cut out of the preparation.
    pub fn part(&self, bake: &Bake, surfels: &[usize]) -> Result<Self> {
        let (baked, taken) = (bake.len(), surfels.len());
        ensure(baked == taken, || {
            format!("the bake is of {baked} Gaussians and the part has {taken}")
        })?;
        match (self, bake) {
            (Self::Directional(whole), Bake::Directional(bake)) => Ok(Self::Directional(Arc::new(
                whole.part(bake.clone(), surfels),
            ))),
            _ => Err(Error::Mismatch("a part of that is not known".into())),
        }
    }

    /// The first of several objects as it is where the others are not; none of a single one.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`] when `progress` asked for it.
    pub fn first_alone(&self, progress: Progress<'_>) -> Result<Option<Self>> {
        Ok(match self {
            Self::Scene(scene) if scene.objects.len() > 1 => {
                Some(Self::Scene(Arc::new(scene.first_alone(progress)?)))
            }
            Self::HarmonicScene(scene) => scene.first_alone().map(Self::Harmonic),
            _ => None,
        })
    }

    /// Relights; `part` says what of the colour is wanted.
    ///
    /// # Errors
    /// The light was not read for the method.
    pub fn relight(&self, target: &Illumination, part: Part) -> Result<Relit> {
        self.relight_seen(target, part, &[])
    }
}

/// The asset's share of the time that a preparation takes by the directional method.
const TAKEN_IN: f64 = 0.2;

/// Part of a preparation that no light changes: kept between changes of the source and of the settings.
#[derive(Debug, Default)]
pub struct TransferCache {
    harmonic: Option<HarmonicCache>,
    /// Directional part with the version of its bake and the optimizations that are on.
    directional: Option<(u64, Optimizations, Arc<DirectionalCache>)>,
}

/// Checks, before a bake begins, that memory has room for bake and transfer of a splat.
///
/// # Errors
/// It does not.
pub fn ensure_room(cloud: &SurfelCloud, method: Method) -> Result<()> {
    let (k, degree) = (coefficient_count(cloud.sh_degree), cloud.sh_degree);
    // Of colour the relit one, and its residual and its values at the nodes, of very many in half of the bits. Measured of a million, degree 3,
    // beside the splat: 0.9 KB.
    let (geometry, colors) = match method {
        Method::Directional => {
            let kept = k + directional::QuadratureNodes::count_of(degree);
            let is_short = cloud.len() >= SHORT_FROM;
            (400, k + if is_short { kept.div_ceil(2) } else { kept })
        }
        Method::Harmonic => (200, 2 * k),
    };
    let each = geometry + size_of::<[f32; 3]>() * colors;
    memory::ensure_room(cloud.len(), each)
        .map_err(|why| Error::Mismatch(format!("it cannot be relit: {why}")))
}

impl TransferCache {
    /// Prepares asset and source light; `bake_id` is any number that differs between bakes.
    ///
    /// # Errors
    /// As [`PreparedTransfer::new`], and [`Error::Cancelled`] when `progress` asked for it.
    pub fn prepare(
        &mut self,
        cloud: &SurfelCloud,
        bake: &Bake,
        bake_id: u64,
        source: &Illumination,
        settings: &TransferSettings,
        progress: Progress<'_>,
    ) -> Result<PreparedTransfer> {
        settings.validate()?;
        let (baked, there) = (bake.len(), cloud.len());
        ensure(baked == there, || {
            format!("the bake is of {baked} Gaussians and the asset has {there}")
        })?;
        ensure_room(cloud, settings.method)?;
        Ok(match bake.of_method(settings.method)? {
            Bake::Harmonic(visibility) => {
                let new = || HarmonicCache::new(cloud);
                let asset = self.harmonic.get_or_insert_with(new);
                let source = source.radiance.truncated(settings.sh_degree);
                let harmonic = asset.prepare(cloud, visibility, bake_id, &source, settings)?;
                PreparedTransfer::Harmonic(Arc::new(harmonic))
            }
            Bake::Directional(directional) => {
                let asset = match &self.directional {
                    Some((id, optimizations, asset))
                        if (*id, *optimizations) == (bake_id, settings.optimizations) =>
                    {
                        asset.clone()
                    }
                    _ => Arc::new(DirectionalCache::new(
                        cloud,
                        directional.clone(),
                        &settings.optimizations,
                    )),
                };
                self.directional = Some((bake_id, settings.optimizations, asset.clone()));
                tell(progress, TAKEN_IN)?;
                let rest = part(progress, TAKEN_IN, 1.0);
                let directional = DirectionalTransfer::prepared(&asset, source, settings, &rest)?;
                PreparedTransfer::Directional(Arc::new(directional))
            }
            Bake::Scene(_) => {
                let why = "the objects of a scene are prepared one by one";
                return Err(Error::Mismatch(why.into()));
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    #[test]
    fn each_method_takes_its_own_bake_and_light_and_says_so() {
        let cloud = synthetic::sphere(50);
        let light = Illumination::even(3);
        let bake = |method| Bake::new(&cloud, method, 32, &no_progress).expect("not cancelled");
        for method in Method::ALL {
            let settings = TransferSettings::of(method);
            for baked in Method::ALL {
                let bake = bake(baked);
                let result = PreparedTransfer::new(&cloud, &bake, &light, &settings);
                match result {
                    Ok(prepared) => {
                        assert_eq!(baked, method);
                        // Even light on an even capture leaves it alone.
                        let relit = prepared
                            .relight(&light, Part::Whole)
                            .expect("a light for both");
                        let tau = relit.tau.iter().flatten();
                        assert!(tau.into_iter().all(|t| (t - 1.0).abs() < 0.06));
                        assert_eq!(prepared.dark_share(), 0.0);
                    }
                    Err(error) => {
                        assert_ne!(baked, method);
                        assert!(error.to_string().contains(baked.preset()), "{error}");
                    }
                }
            }
        }
        let bake = bake(Method::Directional);
        let without = Illumination {
            light_samples: None,
            ..light
        };
        let settings = TransferSettings::of(Method::Directional);
        assert!(PreparedTransfer::new(&cloud, &bake, &without, &settings).is_err());
        let other = synthetic::sphere(60);
        assert!(PreparedTransfer::new(&other, &bake, &Illumination::even(3), &settings).is_err());
    }
}
