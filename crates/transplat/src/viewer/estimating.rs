//! The light of the capture as the object tells it: estimated once an asset, and kept beside its bake.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::patches::DIRECTIONS;
use transplat_core::estimate::{Estimate, estimate_light};
use transplat_core::files::{load_estimate, save_estimate};
use transplat_core::look::ESTIMATE;
use transplat_core::settings::Method;
use transplat_core::settings::skips::Skips;
use transplat_core::surfels::SurfelCloud;

use super::baking::{self, Wanted};
use super::jobs::{Handle, Kind};
use super::lights::Light;
use super::session::{Event, SOURCE, Session};
use crate::scene::what_stands_in;

/// For the user, where nobody told the light.
pub const DROP_IT: &str =
    "Drop the environment of the capture on “captured under”, if there is one";

impl Session {
    /// Whether the settings ask for the light that the asset tells of.
    fn asks_for_estimate(&self) -> bool {
        self.look.source.is_estimate() || self.look.target.is_estimate()
    }

    /// Whether a bake is needed to estimate the light.
    pub(super) fn estimate_needs_bake(&self) -> bool {
        self.estimate.is_none() && self.asks_for_estimate()
    }

    /// Estimates the light of the capture where the settings ask for it, once there is a bake.
    pub(super) fn update_estimate(&mut self) {
        if !self.asks_for_estimate() {
            return;
        }
        self.show_estimate();
        if self.estimate.is_some() || self.estimate_asked {
            return;
        }
        let bake = self
            .whole_bakes()
            .find(|b| b.method() == Method::Directional);
        let (Some(asset), Some(Bake::Directional(directional))) = (&self.asset, bake.map(|b| &**b))
        else {
            let is_on_its_way = self.is_estimating();
            if std::mem::replace(&mut self.estimate_awaited, is_on_its_way) && !is_on_its_way {
                self.info("the light of the capture was not estimated, and is not known. The panel Source light has it estimated again");
            }
            return;
        };
        let directional = directional.clone();
        let (path, cloud) = (asset.path.clone(), asset.cloud.clone());
        let label = format!("estimating the light of {}", asset.name());
        self.estimate_asked = true;
        let id = self.asset_id;
        let work = move |_: &Handle<Event>| {
            let estimate = Box::new(estimate(&path, &cloud, &directional));
            Some(Event::Estimated {
                asset: id,
                estimate,
            })
        };
        self.jobs.start(Kind::Estimate, label, work, Event::Failed);
    }

    /// Makes a light of the estimate where it is good, upright as the asset is.
    fn show_estimate(&mut self) {
        let shown = (self.asset_id, self.up());
        let Some(estimate) = self
            .estimate
            .as_ref()
            .filter(|_| self.estimate_shown != Some(shown))
        else {
            return;
        };
        let message = match estimate.obstacle {
            None => format!(
                "the light of the capture is estimated from the object (confidence {:.0} %); its strength and tint are assumed. {DROP_IT}",
                estimate.percent()
            ),
            Some(obstacle) => format!(
                "what it was captured under cannot be told from the object: {}; {}. {DROP_IT}",
                obstacle.reason(),
                what_stands_in(self.look.transfer.method, obstacle)
            ),
        };
        let light = if estimate.is_good() {
            Light::estimated(estimate.light.map(shown.1))
        } else {
            Ok(Light::standing_in(estimate.stand_in()))
        };
        let is_new = self
            .estimate_shown
            .is_none_or(|(asset, _)| asset != shown.0);
        if is_new && self.look.source.is_estimate() {
            self.info(message);
        }
        self.estimate_shown = Some(shown);
        match light {
            Ok(light) => {
                self.lights.insert(ESTIMATE.into(), Arc::new(light));
            }
            Err(error) => self.error(format!("{error:#}")),
        }
    }

    /// Has the light estimated, also where that was cancelled before or failed.
    pub fn ask_for_estimate(&mut self) {
        self.set_light(SOURCE, ESTIMATE.into());
        if self.estimate.is_some() {
            return;
        }
        if !self.jobs.is_awaited(Kind::Estimate) {
            self.estimate_asked = false;
        }
        if self.bake_share() < 1.0 && !self.is_baking() {
            self.rebake();
        }
        if !self.jobs.is_awaited(Kind::Bake(Method::Directional))
            && let Some(state) = self.bakes.get_mut(&Method::Directional)
        {
            state.asked = state.asked.filter(|_| state.share == 1.0);
        }
    }

    /// What was estimated of the last asset is none of the next one's; of that, some of it may have been kept.
    pub(super) fn reset_estimate(&mut self, kept: Option<Estimate>) {
        self.jobs.cancel(Kind::Estimate);
        self.estimate = kept;
        self.estimate_asked = false;
        self.estimate_awaited = false;
        self.estimate_shown = None;
        self.lights
            .insert(ESTIMATE.into(), Arc::new(Light::assumed()));
    }

    /// Whether the estimate is on its way.
    pub fn is_estimating(&self) -> bool {
        let needs_bake = self.estimate_needs_bake();
        self.jobs.is_awaited(Kind::Estimate)
            || (needs_bake && self.jobs.is_awaited(Kind::Bake(Method::Directional)))
            || (needs_bake && self.is_baking() && self.directional_is_next())
    }
}

/// Where an asset's estimate may be kept: beside its bake.
fn cache_files(asset: &Path, cloud: &Arc<SurfelCloud>) -> Vec<PathBuf> {
    let wanted = Wanted {
        asset,
        cloud,
        method: Method::Directional,
        directions: DIRECTIONS,
        skips: Skips::default(),
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
fn estimate(asset: &Path, cloud: &Arc<SurfelCloud>, directional: &DirectionalBake) -> Estimate {
    let estimate = estimate_light(cloud, directional);
    // Where nothing can be kept, it is estimated again the next time.
    let _ = baking::keep(&cache_files(asset, cloud), |file| {
        save_estimate(file, cloud, &estimate)
    });
    estimate
}
