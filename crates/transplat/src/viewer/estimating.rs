//! The light of the capture as the object tells it: estimated once an asset, and kept beside its bake.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use transplat_core::estimate::{Estimate, estimate_light};
use transplat_core::export::save_estimate;
use transplat_core::load::load_estimate;
use transplat_core::look::{ESTIMATE, EVEN, is_estimate};
use transplat_core::surfels::{SurfelCloud, UpAxis};
use transplat_core::transfer::Preset;
use transplat_core::visibility::Bake;
use transplat_core::visibility::occlusion::{DIRECTIONS, Occlusion};

use super::baking::{self, Wanted};
use super::jobs::{Handle, Kind};
use super::lights::Light;
use super::session::{Event, Session};
use crate::device::Device;

/// What the estimate was asked for: asset and up axis.
pub type EstimateKey = (u64, UpAxis);

/// An estimate, and the light that it makes where it is good.
pub struct Estimated {
    pub(super) key: EstimateKey,
    pub estimate: Estimate,
    pub light: Option<Light>,
}

impl Session {
    /// Estimates the light of the capture where the settings ask for it.
    pub(super) fn update_estimate(&mut self) {
        let mut asking: Vec<&mut Option<PathBuf>> =
            [&mut self.look.source.file, &mut self.look.target.file]
                .into_iter()
                .filter(|file| file.as_deref().is_some_and(is_estimate))
                .collect();
        if asking.is_empty() {
            return;
        }
        let is_running = self.jobs.is_running(Kind::Estimate);
        let is_bad = self.estimate.as_ref().is_some_and(|e| !e.is_good());
        let was_stopped = self.estimate_asked.is_some() && self.estimate.is_none() && !is_running;
        if is_bad || was_stopped {
            // Even light is what is left; after a cancel, until it is asked for again.
            for file in &mut asking {
                **file = Some(EVEN.into());
            }
            self.estimate_asked = None;
            return;
        }
        let key = (self.asset_id, self.up());
        let Some(asset) = &self.asset else {
            return;
        };
        if self.estimate_asked == Some(key) || is_running {
            return;
        }
        let best = self.bakes.get(&Preset::Best).filter(|b| b.share == 1.0);
        let bake = best.and_then(|b| b.bake.clone());
        if bake.is_none() && self.look.transfer.preset == Preset::Best && self.estimate.is_none() {
            // It is on its way.
            return;
        }
        self.estimate_asked = Some(key);
        let (path, cloud, known) = (
            asset.path.clone(),
            asset.cloud.clone(),
            self.estimate.clone(),
        );
        let device = self.background.fastest();
        let label = format!("estimating the light of {}", asset.name());
        let work = move |handle: &Handle<Event>| {
            let made = known.map_or_else(|| estimate(&device, &path, &cloud, bake, handle), Ok);
            Some(match made.and_then(|e| Estimated::new(key, e)) {
                Ok(estimated) => Event::Estimated(Box::new(estimated)),
                Err(_) if handle.is_cancelled() => return None,
                Err(error) => Event::Failed(format!("the light could not be estimated: {error:#}")),
            })
        };
        self.jobs.start(Kind::Estimate, label, work, Event::Failed);
    }

    pub(super) fn take_estimate(&mut self, estimated: Estimated) {
        let is_new = self.estimate.is_none();
        let estimate = estimated.estimate;
        if is_new {
            self.info(match estimate.obstacle {
                None => format!(
                    "the light of the capture is estimated from the object (confidence {:.0} %); its strength and tint are assumed. Drop the environment of the capture on “captured under”, if there is one",
                    100.0 * estimate.confidence
                ),
                Some(obstacle) => format!(
                    "what it was captured under cannot be told from the object: {}. Even light is assumed. Drop the environment of the capture on “captured under”, if there is one",
                    obstacle.reason()
                ),
            });
        }
        self.estimate = Some(estimate);
        if let Some(light) = estimated.light {
            self.lights.insert(ESTIMATE.into(), Arc::new(light));
        }
    }

    /// What was estimated of the last asset is none of the next one's.
    pub(super) fn forget_estimate(&mut self) {
        self.jobs.cancel(Kind::Estimate);
        self.estimate = None;
        self.estimate_asked = None;
        self.lights.remove(Path::new(ESTIMATE));
    }

    /// Whether the estimate is still to come.
    pub fn is_estimating(&self) -> bool {
        self.estimate.is_none() && self.asset.is_some()
    }
}

impl Estimated {
    fn new(key: EstimateKey, estimate: Estimate) -> Result<Self> {
        let light = if estimate.is_good() {
            Some(Light::estimated(estimate.light.map(key.1))?)
        } else {
            None
        };
        Ok(Self {
            key,
            estimate,
            light,
        })
    }
}

/// Reads the estimate that was kept beside the bake, or makes it; the bake too, where only another preset's is there.
fn estimate(
    device: &Device,
    asset: &Path,
    cloud: &Arc<SurfelCloud>,
    bake: Option<Arc<Bake>>,
    handle: &Handle<Event>,
) -> Result<Estimate> {
    let wanted = Wanted {
        asset,
        cloud,
        preset: Preset::Best,
        directions: DIRECTIONS,
    };
    let files = wanted.cache_files().into_iter();
    let files: Vec<PathBuf> = files.map(|f| f.with_extension("light")).collect();
    if let Some(kept) = files.iter().find_map(|f| load_estimate(f, cloud).ok()) {
        return Ok(kept);
    }
    let estimate = estimate_light(cloud, &*occlusion(device, &wanted, bake, handle)?);
    for folder in files.iter().filter_map(|f| f.parent()) {
        // A missing cache is made; where nothing can be kept, it is estimated again the next time.
        let _ = std::fs::create_dir_all(folder);
    }
    let _ = files
        .iter()
        .find(|f| save_estimate(f, cloud, &estimate).is_ok());
    Ok(estimate)
}

fn occlusion(
    device: &Device,
    wanted: &Wanted<'_>,
    bake: Option<Arc<Bake>>,
    handle: &Handle<Event>,
) -> Result<Arc<Occlusion>> {
    if let Some(Bake::Occlusion(known)) = bake.as_deref() {
        return Ok(known.clone());
    }
    let report = |done: f64| handle.progress(done);
    match baking::bake(device, wanted, None, &report, |_| ())?.bake {
        Bake::Occlusion(made) => Ok(made),
        Bake::Visibility(_) => anyhow::bail!("a bake of the other preset"),
    }
}
