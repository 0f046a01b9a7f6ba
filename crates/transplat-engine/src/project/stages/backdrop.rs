//! Backdrops and grading: maps and photographs behind the objects, and LUTs.

use std::path::PathBuf;
use std::sync::Arc;

use transplat_core::files::{load_backplate, load_lut};
use transplat_core::present::{Background, View};
use transplat_gpu::present::{Backdrop, ResidentLut};

use crate::environments::{Environment, SKY_COLUMNS, load_map};
use crate::jobs::Kind;
use crate::language::tr_format;
use crate::project::canvas::Canvas;
use crate::project::{BackdropKey, Project, SOURCE, TARGET};
use crate::words::of_error;
use transplat_core::scene::{EnvironmentLight, Scene};

impl Project {
    /// Reads the maps behind the objects: that of the side that is seen first, then the other's, since before and after are a key apart.
    pub(crate) fn start_backdrops(&mut self, canvas: &Canvas) {
        let view = self.scene.view;
        let is_seen = view.background(self.scene.background) == Background::Environment;
        if !is_seen || self.states.iter().all(|s| s.asset.is_none()) {
            return;
        }
        for side in [TARGET, SOURCE] {
            let (light, settings, _) = self.behind(side, view);
            let (light, settings) = (light.clone(), settings.clone());
            let key = BackdropKey {
                without_suns: settings.without_suns,
                light: light.id,
                is_sky: light.sky.is_some(),
                blur: self.scene.background_blur,
            };
            let kind = Kind::Backdrop(side);
            // One that failed was asked for, and was told.
            if self.jobs.is_running(kind) || !self.backdrops[side].ask(&key) {
                continue;
            }
            let context = canvas.context.clone();
            let label = tr_format!("reading {} for the background", light.name());
            let kept = self.environments.kept_map(light.id);
            let blur = key.blur;
            let work = move |_: &_| {
                let map = match (kept, light.sky) {
                    (Some(map), _) => map,
                    // Made anew for each place of the sun: half as fine as one that is saved.
                    (None, Some(sky)) => Arc::new(sky.map(SKY_COLUMNS / 2)),
                    (None, None) => load_map(&light)?,
                };
                let shown = settings.backdrop(&map, &light.illumination).blurred(blur);
                Ok((map, Backdrop::new(&context, &shown)))
            };
            self.start(kind, label, work, move |project, (map, backdrop)| {
                if !key.is_sky {
                    project.environments.keep_map(key.light, map);
                }
                if project.backdrops[side].accept(key, ()) {
                    project.draw(|live| live.set_backdrop(side, backdrop));
                    if side == TARGET {
                        project.plate.clear();
                    }
                }
            });
        }
    }

    /// Reads the photograph behind the objects, which is shown in the place of the target's map.
    pub(crate) fn start_backplate(&mut self, canvas: &Canvas) {
        let is_seen = self.scene.view.background(self.scene.background) == Background::Backplate;
        let kind = Kind::Backdrop(TARGET);
        let Some(path) = self.scene.plate.clone().filter(|_| is_seen) else {
            return;
        };
        if self.jobs.is_running(kind) || !self.plate.ask(&path) {
            return;
        }
        let (context, file) = (canvas.context.clone(), path.clone());
        let work = move |_: &_| {
            let plate = load_backplate(&file)?;
            let backdrop = Backdrop::of_backplate(&context, &plate);
            Ok(([plate.width, plate.height], backdrop, plate.warnings))
        };
        let label = tr_format!("reading {}", path.display());
        self.start_or_else(kind, label, work, move |project, read| match read {
            Ok((size, backdrop, warnings)) => {
                for warning in warnings {
                    project.info(format!("{}: {warning}", path.display()));
                }
                if project.plate.accept(path, size) {
                    project.draw(|live| live.set_backdrop(TARGET, backdrop));
                    project.backdrops[TARGET].clear();
                }
            }
            Err(error) => {
                project.error(of_error(&error));
                // The photograph before it stays.
                let last = project.plate.made_from().cloned();
                if let Some(last) = last.filter(|_| project.scene.plate.as_ref() == Some(&path)) {
                    project.plate.ask(&last);
                    project.scene.plate = Some(last);
                }
            }
        });
    }

    /// The tables of colours of the pinned look and of the scene.
    fn lut_paths(&self) -> [Option<&PathBuf>; 2] {
        let pinned = self.compared().and_then(|p| p.scene.lut.as_ref());
        [pinned, self.scene.lut.as_ref()]
    }

    /// LUT that a side is graded by, once it is read.
    pub fn graded_by(&self, side: usize, view: View) -> Option<usize> {
        let is_of_pinned = side == SOURCE && view.has_two_sides() && self.compared().is_some();
        let of = if is_of_pinned { SOURCE } else { TARGET };
        let path = self.lut_paths()[of]?;
        self.luts[of].of(path).map(|()| of)
    }

    /// Reads the tables of colours that are asked for.
    pub(crate) fn start_luts(&mut self, canvas: &Canvas) {
        for of in [TARGET, SOURCE] {
            let kind = Kind::Lut(of);
            let Some(path) = self.lut_paths()[of].cloned() else {
                continue;
            };
            if self.jobs.is_running(kind) || !self.luts[of].ask(&path) {
                continue;
            }
            let (context, file) = (canvas.context.clone(), path.clone());
            let work = move |_: &_| Ok(ResidentLut::new(&context, &load_lut(&file)?));
            let label = tr_format!("reading {}", path.display());
            self.start(kind, label, work, move |project, lut| {
                if project.luts[of].accept(path, ()) {
                    project.draw(|live| live.set_lut(of, lut));
                }
            });
        }
    }

    /// Grades the picture by a table of colours, once it is read: one that is broken changes nothing.
    pub fn open_lut(&mut self, path: PathBuf) {
        // The last one that is asked for is taken, however long each takes to read.
        self.jobs.cancel(Kind::Lut(TARGET));
        let Some(canvas) = self.canvas.clone() else {
            return;
        };
        let (context, file) = (canvas.context.clone(), path.clone());
        let work = move |_: &_| {
            let lut = load_lut(&file)?;
            Ok((ResidentLut::new(&context, &lut), lut.warnings))
        };
        let label = tr_format!("reading {}", path.display());
        self.start(Kind::Lut(TARGET), label, work, move |project, read| {
            let (lut, warnings) = read;
            for warning in warnings {
                project.info(format!("{}: {warning}", path.display()));
            }
            // The file may be another one than when it was last read.
            project.luts[SOURCE].clear();
            project.luts[TARGET].set(path.clone(), ());
            canvas.live().set_lut(TARGET, lut);
            project.scene.lut = Some(path);
        });
    }

    /// The light that is seen behind a side, as it is turned, and what it is brought to the source's strength by. Behind a pinned look it
    /// is that look's.
    pub fn behind(&self, side: usize, view: View) -> (&Arc<Environment>, &EnvironmentLight, f32) {
        let pinned = self.compared();
        if let Some(pinned) = pinned.filter(|_| side == SOURCE && view.has_two_sides()) {
            let matched = pinned.scene.matched_object();
            let maps = [&pinned.sources[matched], &pinned.environment];
            let gain = environment_gain(&pinned.scene, maps);
            return (&pinned.environment, &pinned.scene.environment, gain);
        }
        let sides = self.matched_sides();
        let gain = match side {
            SOURCE => 1.0,
            _ => environment_gain(&self.scene, sides.map(|(_, there)| &there.light)),
        };
        let (settings, there) = sides[side];
        (&there.light, settings, gain)
    }
}

fn environment_gain(scene: &Scene, lights: [&Arc<Environment>; 2]) -> f32 {
    let maps = lights.map(|light| &light.illumination);
    scene.environment_gain(maps)
}
