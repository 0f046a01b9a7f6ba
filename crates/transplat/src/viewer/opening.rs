//! What is opened: splats, lights, looks.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use transplat_core::files::{FileKind, file_kind, load_asset, load_look};
use transplat_core::ground::ground_plane;
use transplat_core::look::{ESTIMATE, LightSettings, Look, is_estimate, is_even, is_file};
use transplat_core::settings::Method;
use transplat_core::surfels::{SurfelCloud, is_faint};
use transplat_core::transfer::TransferAsset;
use transplat_gpu::live::LiveAsset;

use super::asset::{Asset, LoadedAsset, Settings};
use super::estimating::{DROP_IT, kept_estimate};
use super::jobs::{Handle, Kind};
use super::lights::{Light, light_name};
use super::navigation;
use super::session::{Event, SOURCE, Session, TARGET};
use crate::scene::asset_warnings;

/// Environments that are read at the same time.
const LIGHTS_AT_ONCE: usize = 2;

fn never_seen(cloud: &SurfelCloud) -> usize {
    let opacities = cloud.opacities.iter();
    opacities.filter(|o| is_faint(**o)).count()
}

impl Session {
    /// Opens any file, by what is in it: a splat replaces the asset, an environment becomes the target, a look is applied.
    pub fn open(&mut self, path: &Path) {
        match file_kind(path) {
            Ok(FileKind::Ply) => {
                self.load_asset(path.to_owned(), Settings::Capture(Box::default()));
            }
            Ok(FileKind::Look) => match load_look(path) {
                Ok(look) => {
                    self.opened.push(path.to_owned());
                    self.apply_look(look);
                }
                Err(error) => self.error(error.to_string()),
            },
            Ok(FileKind::Hdr | FileKind::Exr | FileKind::Picture) => {
                self.set_light(TARGET, path.to_owned());
            }
            Ok(FileKind::Bake) => self.error(format!(
                "{}: a bake is found by itself when it lies beside its splat",
                path.display()
            )),
            Err(error) => self.error(error.to_string()),
        }
    }

    /// Applies a look: at once, or once its asset is loaded.
    pub fn apply_look(&mut self, look: Look) {
        let open = self.asset.as_ref().map(|a| &a.path);
        match &look.asset {
            Some(path) if open != Some(path) => {
                self.load_asset(path.clone(), Settings::Look(Box::new(look)));
            }
            _ => {
                if let Some(camera) = look.camera {
                    self.pose = camera;
                }
                self.look = Look {
                    camera: None,
                    ..look
                };
            }
        }
    }

    /// Loads a splat; on success it is shown with the settings, otherwise everything stays.
    pub fn load_asset(&mut self, path: PathBuf, settings: Settings) {
        self.jobs.cancel(Kind::Load);
        let context = self.context.clone();
        let name = path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let asked = self.look.clone();
        let failed = Event::LoadFailed;
        let work = move |handle: &Handle<Event>| {
            let start = Instant::now();
            let loaded =
                load_asset(&path)
                    .map_err(anyhow::Error::from)
                    .and_then(|(mut cloud, file)| {
                        let file_up = cloud.up;
                        let reading = settings.reading();
                        reading.over(Look::default()).apply_to(&mut cloud);
                        let cloud = Arc::new(cloud);
                        let live = LiveAsset::new(&context, &cloud)?;
                        let estimate = kept_estimate(&path, &cloud);
                        Ok(LoadedAsset {
                            asset: Asset {
                                bounds: cloud.bounds(),
                                never_seen: never_seen(&cloud),
                                ground: ground_plane(&cloud, cloud.up),
                                up: cloud.up,
                                warnings: asset_warnings(&path, &file),
                                load_ms: start.elapsed().as_secs_f64() * 1e3,
                                file_up,
                                file: Arc::new(file),
                                cloud,
                                path,
                            },
                            live,
                            transfer: TransferAsset::default(),
                            estimate,
                            settings,
                            asked,
                        })
                    });
            if handle.is_cancelled() {
                return None;
            }
            Some(match loaded {
                Ok(loaded) => Event::Asset(Box::new(loaded)),
                Err(error) => Event::LoadFailed(format!("{error:#}")),
            })
        };
        self.jobs
            .start(Kind::Load, format!("loading {name}"), work, failed);
    }

    /// Shows a loaded splat; nothing of the last one is left.
    pub(super) fn show_asset(&mut self, loaded: LoadedAsset) {
        let LoadedAsset {
            asset,
            live,
            transfer,
            estimate,
            settings,
            asked,
        } = loaded;
        let is_new = self.asset.as_ref().is_none_or(|a| a.path != asset.path);
        let mut look = settings.over(&asked, &self.look, self.pose);
        // Where nobody tells it, and as long as what is told cannot be read.
        look.source.file.get_or_insert(ESTIMATE.into());
        if is_new {
            self.resolved[SOURCE] = LightSettings::of(ESTIMATE);
        }
        for kind in [
            Kind::Bake(Method::Directional),
            Kind::Bake(Method::Harmonic),
            Kind::Ground,
            Kind::Prepare,
            Kind::Relight,
            Kind::Doubts,
            Kind::Measure,
        ] {
            self.jobs.cancel(kind);
        }
        self.stages.load += 1;
        self.asset_id += 1;
        self.live().set_asset(live);
        self.bakes.clear();
        self.prepared = None;
        // What is still on its way belongs to the last one.
        self.prepared_version += 1;
        self.readout = None;
        self.measured.clear();
        self.measured_words.clear();
        self.saved.clear();
        self.relit_asked = None;
        // A bake that was named belongs to the asset that came with it.
        if self.asset_id > 1 {
            self.bake = None;
        }
        self.pinned = None;
        self.against_pinned = false;
        self.shares = None;
        self.doubts = Arc::default();
        self.ground = None;
        self.ground_for = None;
        self.ground_asked = None;
        self.ground_lit_for = None;
        self.relit_for = None;
        self.transfer_asset = Some(Arc::new(Mutex::new(transfer)));
        self.pose = look.camera.unwrap_or_else(|| {
            let size = self.viewport;
            navigation::first_pose(
                &asset.cloud,
                look.up.unwrap_or(asset.file_up),
                &asset.bounds,
                size,
            )
        });
        self.opened.push(asset.path.clone());
        for warning in asset.warnings.clone() {
            self.info(warning);
        }
        if look.source.file.as_deref().is_some_and(is_even) {
            self.info(format!(
                "what it was captured under is not known: even light is assumed. {DROP_IT}"
            ));
        }
        self.reset_estimate(estimate);
        self.look = Look {
            camera: None,
            asset: Some(asset.path.clone()),
            ..look
        };
        self.asset = Some(asset);
    }

    /// Puts a light on a side; it is shown once it is loaded.
    pub fn set_light(&mut self, side: usize, path: PathBuf) {
        self.request_light(&path);
        let settings = if side == SOURCE {
            &mut self.look.source
        } else {
            &mut self.look.target
        };
        settings.set_file(path);
    }

    /// Has an environment read unless it is there.
    pub fn request_light(&mut self, path: &Path) {
        if is_file(path) && !self.lights.contains_key(path) && !self.is_loading(path) {
            self.waiting_lights.push_back(path.to_owned());
        }
    }

    /// Has an environment read again, whatever is known of it: the file may have changed.
    pub fn reread_light(&mut self, path: &Path) {
        if is_file(path) {
            self.lights.remove(path);
            self.request_light(path);
        }
    }

    /// Reads what waits, those on the two sides first, and few at a time: maps are large.
    pub(super) fn start_lights(&mut self) {
        while self.loading.len() < LIGHTS_AT_ONCE && !self.waiting_lights.is_empty() {
            let wanted = [&self.look.source.file, &self.look.target.file];
            let on_side = |p: &PathBuf| wanted.iter().any(|w| w.as_ref() == Some(p));
            let at = self.waiting_lights.iter().position(on_side).unwrap_or(0);
            if let Some(path) = self.waiting_lights.remove(at) {
                self.start_light(path);
            }
        }
    }

    fn start_light(&mut self, path: PathBuf) {
        self.loading.push(path.clone());
        let background = self.background.clone();
        let label = format!("reading {}", light_name(&path));
        let failed = {
            let path = path.clone();
            move |why: String| Event::LightFailed { path, why }
        };
        let work = move |_: &Handle<Event>| {
            Some(match Light::load(&background, &path) {
                Ok(light) => Event::Light(Box::new(light)),
                Err(error) => Event::LightFailed {
                    path,
                    why: format!("{error:#}"),
                },
            })
        };
        self.jobs.start(Kind::Light, label, work, failed);
    }

    /// Whether a light is being read.
    pub fn is_loading(&self, path: &Path) -> bool {
        let mut all = self.loading.iter().chain(&self.waiting_lights);
        all.any(|p| p == path) || (is_estimate(path) && self.is_estimating())
    }

    /// Exchanges the two lights with their turns and strengths.
    pub fn swap_lights(&mut self) {
        std::mem::swap(&mut self.look.source, &mut self.look.target);
    }
}
