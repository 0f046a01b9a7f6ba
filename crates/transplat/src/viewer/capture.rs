//! What open objects are cut out of.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use anyhow::{Result, bail};
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::patches::DIRECTIONS;
use transplat_core::environment::Illumination;
use transplat_core::files::AssetFile;
use transplat_core::progress::Progress;
use transplat_core::settings::skips::Skips;
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{PreparedTransfer, TransferAsset};

use crate::device::Device;
use crate::pipeline::bake::{self, PartOf, Wanted};

/// A splat as a whole, shared by the objects that are cut out of it.
pub struct Capture {
    pub cloud: Arc<SurfelCloud>,
    pub file: Arc<AssetFile>,
    /// For the directional method, once it was needed.
    bake: OnceLock<Arc<DirectionalBake>>,
    /// Held by who makes it.
    baking: Mutex<()>,
}

impl Capture {
    pub fn new(
        cloud: Arc<SurfelCloud>,
        file: Arc<AssetFile>,
        bake: Option<Arc<DirectionalBake>>,
    ) -> Self {
        Self {
            cloud,
            file,
            bake: bake.map_or_else(OnceLock::new, OnceLock::from),
            baking: Mutex::default(),
        }
    }

    /// Its bake, if it is there.
    pub fn known_bake(&self) -> Option<Arc<DirectionalBake>> {
        self.bake.get().cloned()
    }

    /// Its bake, made once, or read from where that of the splat is kept; who else needs it meanwhile waits.
    fn bake(
        &self,
        device: &Device,
        path: &Path,
        skips: Skips,
        progress: Progress<'_>,
    ) -> Result<Arc<DirectionalBake>> {
        let _baking = self.baking.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = self.known_bake() {
            return Ok(known);
        }
        let wanted = Wanted {
            cloud: self.cloud.clone(),
            method: Method::Directional,
            directions: DIRECTIONS,
            skips,
            part_of: None,
            beside: Some(path.to_owned()),
        };
        let made = bake::refined(device, &wanted, None, progress, |_| ())?;
        match &*made.bake {
            Bake::Directional(bake) => Ok(self.bake.get_or_init(|| bake.clone()).clone()),
            Bake::Harmonic(_) | Bake::Scene(_) => bail!("the bake is for the other preset"),
        }
    }
}

/// What an object is that is cut out of a capture.
#[derive(Clone)]
pub struct Part {
    pub capture: Arc<Capture>,
    /// Which of its surfels.
    pub surfels: Arc<[usize]>,
}

impl Part {
    /// What its bake needs of the whole.
    pub fn of_whole(
        &self,
        device: &Device,
        path: &Path,
        skips: Skips,
        progress: Progress<'_>,
    ) -> Result<PartOf> {
        Ok(PartOf {
            whole: self.capture.bake(device, path, skips, progress)?,
            surfels: self.surfels.clone(),
        })
    }

    /// Prepares its transfer by its own bake for the directional method: it was lit among the rest.
    pub fn prepare(
        &self,
        transfer: &mut TransferAsset,
        bake: &Bake,
        source: &Illumination,
        settings: &TransferSettings,
    ) -> Result<PreparedTransfer> {
        let Some(whole) = self.capture.known_bake() else {
            bail!("what it is cut out of is not baked");
        };
        // There is one for as long as the splat is open.
        let (cloud, of_whole) = (&self.capture.cloud, Bake::Directional(whole));
        let prepared = transfer.prepare(cloud, &of_whole, 0, source, settings)?;
        Ok(prepared.part(bake, &self.surfels)?)
    }
}

/// Where a part's bake may be kept: never in the place of the whole's.
pub fn kept_beside(path: &Path, part: Option<&Part>, method: Method) -> Option<PathBuf> {
    let is_told_apart = part.is_none() || method == Method::Directional;
    is_told_apart.then(|| path.to_owned())
}
