//! The light of the capture as the object tells it: estimated once an asset, and kept beside its bake.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;
use transplat_core::estimate::{Estimate, estimate_light};
use transplat_core::export::save_estimate;
use transplat_core::load::load_estimate;
use transplat_core::look::ESTIMATE;
use transplat_core::surfels::{SurfelCloud, UpAxis};
use transplat_core::transfer::Preset;
use transplat_core::visibility::Bake;
use transplat_core::visibility::occlusion::{DIRECTIONS, Occlusion};

use super::baking::Wanted;
use super::jobs::{Handle, Kind};
use super::lights::Light;
use super::session::{Event, SOURCE, Session};

/// What the estimate was asked for: asset and up axis.
pub type EstimateKey = (u64, UpAxis);

/// An estimate, and the light that it makes where it is good.
pub struct Estimated {
    pub(super) key: EstimateKey,
    pub estimate: Estimate,
    pub light: Option<Light>,
}

impl Session {
    /// Whether the settings, or the pinned ones, ask for the light that the asset tells of.
    fn asks_for_estimate(&self) -> bool {
        let mut looks = std::iter::once(&self.look).chain(&self.pinned);
        looks.any(|look| look.source.is_estimate() || look.target.is_estimate())
    }

    /// Whether a bake is needed to estimate the light.
    pub(super) fn estimate_needs_bake(&self) -> bool {
        self.estimate.is_none() && self.asks_for_estimate()
    }

    /// Estimates the light of the capture where the settings ask for it, once there is a bake; makes a light of it for the asset's up axis.
    pub(super) fn update_estimate(&mut self) {
        let key = (self.asset_id, self.up());
        let Some(asset) = &self.asset else {
            return;
        };
        if !self.asks_for_estimate()
            || self.estimate_asked == Some(key)
            || self.jobs.is_running(Kind::Estimate)
        {
            return;
        }
        let known = self.estimate.clone();
        let state = self.bakes.get(&Preset::Best).filter(|b| b.share == 1.0);
        let occlusion = match state.and_then(|b| b.bake.as_deref()) {
            Some(Bake::Occlusion(occlusion)) => Some(occlusion.clone()),
            _ => None,
        };
        let (path, cloud) = (asset.path.clone(), asset.cloud.clone());
        let make: Box<dyn FnOnce() -> Estimate + Send> = match (known, occlusion) {
            (Some(known), _) => Box::new(|| known),
            (None, Some(occlusion)) => Box::new(move || estimate(&path, &cloud, &occlusion)),
            // It is on its way.
            (None, None) => return,
        };
        let label = format!("estimating the light of {}", asset.name());
        self.estimate_asked = Some(key);
        let work = move |_: &Handle<Event>| {
            Some(match Estimated::new(key, make()) {
                Ok(estimated) => Event::Estimated(Box::new(estimated)),
                Err(error) => Event::Failed(format!("the light could not be estimated: {error:#}")),
            })
        };
        self.jobs.start(Kind::Estimate, label, work, Event::Failed);
    }

    /// Has the light estimated, also where that was cancelled before or failed.
    pub fn ask_for_estimate(&mut self) {
        self.set_light(SOURCE, ESTIMATE.into());
        if self.estimate.is_none() && !self.is_estimating() {
            self.estimate_asked = None;
            if let Some(state) = self.bakes.get_mut(&Preset::Best) {
                state.asked = state.asked.filter(|_| state.share == 1.0);
            }
        }
    }

    pub(super) fn take_estimate(&mut self, estimated: Estimated) {
        let estimate = &estimated.estimate;
        if !self.estimate_told {
            self.estimate_told = true;
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
        self.estimate = Some(estimated.estimate);
        // One for another up axis than that of now is followed by another.
        if let Some(light) = estimated.light {
            self.lights.insert(ESTIMATE.into(), Arc::new(light));
        }
    }

    /// What was estimated of the last asset is none of the next one's; of that, some of it may have been kept.
    pub(super) fn reset_estimate(&mut self, kept: Option<Estimate>) {
        self.jobs.cancel(Kind::Estimate);
        self.estimate = kept;
        self.estimate_asked = None;
        self.estimate_told = false;
        self.lights
            .insert(ESTIMATE.into(), Arc::new(Light::assumed()));
    }

    /// Whether the estimate is on its way.
    pub fn is_estimating(&self) -> bool {
        self.jobs.is_running(Kind::Estimate)
            || (self.jobs.is_running(Kind::Bake) && self.estimate_needs_bake())
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

/// Where an asset's estimate may be kept: beside its bake.
fn cache_files(asset: &Path, cloud: &Arc<SurfelCloud>) -> Vec<PathBuf> {
    let wanted = Wanted {
        asset,
        cloud,
        preset: Preset::Best,
        directions: DIRECTIONS,
    };
    let files = wanted.cache_files().into_iter();
    files.map(|f| f.with_extension("light")).collect()
}

/// An estimate that was made before.
pub fn kept_estimate(asset: &Path, cloud: &Arc<SurfelCloud>) -> Option<Estimate> {
    let files = cache_files(asset, cloud);
    files.iter().find_map(|f| load_estimate(f, cloud).ok())
}

/// Makes the estimate, and keeps it.
fn estimate(asset: &Path, cloud: &Arc<SurfelCloud>, occlusion: &Occlusion) -> Estimate {
    let estimate = estimate_light(cloud, occlusion);
    let files = cache_files(asset, cloud);
    for folder in files.iter().filter_map(|f| f.parent()) {
        // A missing cache is made; where nothing can be kept, it is estimated again the next time.
        let _ = std::fs::create_dir_all(folder);
    }
    let mut files = files.iter();
    let _ = files.find(|f| save_estimate(f, cloud, &estimate).is_ok());
    estimate
}
