//! Captures that open objects are cut out of.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use anyhow::{Result, bail};
use glam::Vec3;
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::strata::DIRECTIONS;
use transplat_core::capture_environment::CaptureEnvironment;
use transplat_core::environment::Illumination;
use transplat_core::files::{SplatFile, is_same_file};
use transplat_core::progress::{Progress, no_progress};
use transplat_core::scene::{Object, kept};
use transplat_core::settings::optimizations::Optimizations;
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{PreparedTransfer, TransferCache};

use crate::bake::{self, BakePlace, BakeRequest, PartOf};
use crate::device::Device;
use crate::language::tr;
use crate::reading::Reading;

/// A splat as a whole, shared by the objects that are cut out of it.
pub struct Capture {
    /// File of the splat.
    pub path: PathBuf,
    /// Settings that it was read with.
    pub reading: Reading,
    /// All of its Gaussians.
    pub cloud: Arc<SurfelCloud>,
    /// Properties of the file.
    pub file: Arc<SplatFile>,
    /// For the directional method, once it was needed.
    bake: OnceLock<Arc<DirectionalBake>>,
    /// Held by who makes it.
    baking: Mutex<()>,
    /// Cache of its transfer and, while parts wait for it, the transfer itself.
    preparing: Mutex<Preparing>,
    /// Number of parts that wait for it.
    waiting: AtomicUsize,
}

#[derive(Default)]
struct Preparing {
    asset: TransferCache,
    made: Option<(Illumination, TransferSettings, PreparedTransfer)>,
}

impl Capture {
    /// A capture, with its bake where that is known.
    pub fn new(
        path: PathBuf,
        reading: Reading,
        cloud: Arc<SurfelCloud>,
        file: Arc<SplatFile>,
        bake: Option<Arc<DirectionalBake>>,
    ) -> Self {
        Self {
            path,
            reading,
            cloud,
            file,
            bake: bake.map_or_else(OnceLock::new, OnceLock::from),
            baking: Mutex::default(),
            preparing: Mutex::default(),
            waiting: AtomicUsize::new(0),
        }
    }

    /// True for a splat of this file that was read with these settings.
    pub fn is_of(&self, path: &Path, reading: &Reading) -> bool {
        is_same_file(&self.path, path) && self.reading.is_of_same_capture(reading)
    }

    /// Its bake, if it is there.
    pub fn known_bake(&self) -> Option<Arc<DirectionalBake>> {
        self.bake.get().cloned()
    }

    /// Takes the bake of another reading of the same splat, whose Gaussians lie where its own do.
    pub fn take_bake(&self, other: &Self) {
        if let Some(bake) = other.known_bake() {
            self.bake.get_or_init(|| bake);
        }
    }

    /// Its bake, made once, or read from where that of the splat is kept; who else needs it meanwhile waits.
    fn bake(
        &self,
        device: &Device,
        optimizations: Optimizations,
        progress: Progress<'_>,
    ) -> Result<Arc<DirectionalBake>> {
        let _baking = self.baking.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = self.known_bake() {
            return Ok(known);
        }
        let wanted = BakeRequest {
            cloud: self.cloud.clone(),
            method: Method::Directional,
            directions: DIRECTIONS,
            optimizations,
            part_of: None,
            place: Some(BakePlace::cached(&self.path)),
        };
        let made = bake::refined(device, &wanted, None, progress, |_| ())?;
        match &*made.bake {
            Bake::Directional(bake) => Ok(self.bake.get_or_init(|| bake.clone()).clone()),
            Bake::Harmonic(_) | Bake::Scene(_) => bail!(tr("The bake is for the other method.")),
        }
    }

    /// Does something with its transfer, which is made once for all parts that ask for it at a time.
    fn with_transfer<T>(
        &self,
        source: &Illumination,
        settings: &TransferSettings,
        take: impl FnOnce(&PreparedTransfer) -> Result<T>,
    ) -> Result<T> {
        let Some(bake) = self.known_bake() else {
            bail!(tr("the capture is not baked"));
        };
        self.waiting.fetch_add(1, Ordering::SeqCst);
        let mut kept = self
            .preparing
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        self.waiting.fetch_sub(1, Ordering::SeqCst);
        let made = kept.made.take();
        let prepared = match made.filter(|(s, t, _)| (s, t) == (source, settings)) {
            Some((.., prepared)) => prepared,
            // There is one bake for as long as the splat is open.
            None => {
                let bake = Bake::Directional(bake);
                kept.asset
                    .prepare(&self.cloud, &bake, 0, source, settings, &no_progress)?
            }
        };
        let taken = take(&prepared);
        if self.waiting.load(Ordering::SeqCst) > 0 {
            kept.made = Some((source.clone(), settings.clone(), prepared));
        }
        taken
    }
}

/// Object that is cut out of a capture.
#[derive(Clone)]
pub struct CutPart {
    /// Splat that it is cut out of.
    pub capture: Arc<Capture>,
    /// Indices of its surfels.
    pub surfels: Arc<[usize]>,
    /// Environment as the rest of the capture shows it, where that encloses the part as a room does.
    pub enclosing_light: Option<Arc<CaptureEnvironment>>,
}

impl CutPart {
    /// Some surfels of a capture.
    pub fn new(capture: Arc<Capture>, surfels: Arc<[usize]>) -> Self {
        let white = capture.reading.response.clipped_at(capture.cloud.encoding);
        let shown = CaptureEnvironment::around(&capture.cloud, &surfels, white);
        Self {
            enclosing_light: shown.map(Arc::new),
            capture,
            surfels,
        }
    }

    /// Bake of the whole that the part's bake needs.
    pub fn of_whole(
        &self,
        device: &Device,
        optimizations: Optimizations,
        progress: Progress<'_>,
    ) -> Result<PartOf> {
        Ok(PartOf {
            whole: self.capture.bake(device, optimizations, progress)?,
            surfels: self.surfels.clone(),
        })
    }

    /// Prepares its transfer by its own bake for the directional method: it was lit among the rest.
    pub fn prepare(
        &self,
        bake: &Bake,
        source: &Illumination,
        settings: &TransferSettings,
    ) -> Result<PreparedTransfer> {
        let part = |whole: &PreparedTransfer| Ok(whole.part(bake, &self.surfels)?);
        self.capture.with_transfer(source, settings, part)
    }
}

/// The surfels of a splat that an object is which is cut out of it.
///
/// # Errors
/// None of them are left.
pub fn part_of(asset: &Path, object: &Object, whole: &SurfelCloud) -> Result<Arc<[usize]>> {
    let surfels = kept(&object.cut, whole).unwrap_or_default();
    if surfels.is_empty() {
        let places = || whole.positions.iter().copied();
        let [low, high] = [Vec3::min, Vec3::max].map(|end| {
            let end = places().reduce(end).unwrap_or_default();
            whole.origin + end.as_dvec3()
        });
        bail!(
            "{}: nothing of it is on the kept side of its cut; its Gaussians lie between {low} and {high}",
            asset.display()
        );
    }
    Ok(surfels.into())
}
