//! Opening of a file in the window, by its content; and the lights of the selected object.

use std::path::{Path, PathBuf};

use transplat_core::environment::ImageReading;
use transplat_core::files::{FileKind, file_kind, load_look};
use transplat_core::scene::{ESTIMATE, Object, Scene, is_estimate, is_file};

use super::session::Session;
use transplat_engine::language::tr_format;
use transplat_engine::project::{SOURCE, TARGET};

impl Session {
    /// Opens any file, by what is in it: a splat replaces the asset, an environment becomes the target, a look is applied.
    pub fn open(&mut self, path: &Path) {
        match file_kind(path) {
            Ok(FileKind::Splat(_)) if self.adds_splats && self.project.has_asset() => {
                self.project.add_object(path.to_owned());
            }
            Ok(FileKind::Splat(_)) => {
                self.project.replace_object(self.selected, path.to_owned());
            }
            Ok(FileKind::Cameras) => self.project.open_cameras(path),
            Ok(FileKind::Rig) => self.open_rig(path),
            Ok(FileKind::Look) => match load_look(path) {
                Ok(scene) => {
                    self.opened.push(path.to_owned());
                    // What could not be had may be there now.
                    for state in &mut self.project.states {
                        state.tried = None;
                    }
                    self.apply(scene);
                    if !self.object().shown {
                        self.selected = self.project.scene.matched_object();
                    }
                }
                Err(error) => self.error(error.to_string()),
            },
            Ok(kind) if kind.is_environment() => {
                self.set_light(TARGET, path.to_owned());
            }
            Ok(FileKind::Lut) => self.project.open_lut(path.to_owned()),
            Ok(_) => self.error(tr_format!(
                "{}: a bake loads with its splat. Open the splat.",
                path.display()
            )),
            Err(error) => self.error(error.to_string()),
        }
    }

    /// Takes over a scene's settings. One of a single object whose splat is not open is shown once that is loaded; the splats of several come
    /// one after the other. A look for any splat is for the selected one.
    pub fn apply(&mut self, mut scene: Scene) {
        if let [one] = &scene.objects[..] {
            if one
                .asset
                .as_ref()
                .is_some_and(|path| !self.project.is_open(path))
            {
                self.project.open_scene(scene);
                return;
            }
            if one.asset.is_none() {
                scene.objects = self.with_object_as(one);
                // What is kept is of the objects.
                let (views, looks) = (&self.project.scene.bookmarks, &self.project.scene.variants);
                if scene.bookmarks.is_empty() && scene.variants.is_empty() {
                    (scene.bookmarks, scene.variants) = (views.clone(), looks.clone());
                }
            }
        }
        self.project.take_over(scene);
        // Fewer objects may be there now.
        self.take_notices();
    }

    /// The scene's objects, what is told of any object said of the selected one.
    fn with_object_as(&self, any: &Object) -> Vec<Object> {
        let mut objects = self.project.scene.objects.clone();
        let now = objects[self.selected].clone();
        objects[self.selected] = if objects.len() == 1 {
            Object {
                asset: now.asset,
                ..any.clone()
            }
        } else {
            Object {
                source: any.source.clone(),
                up: any.up,
                response: any.response,
                outside_from: any.outside_from.clone(),
                hide: any.hide,
                ..now
            }
        };
        objects
    }

    /// Puts a light on a side; it is shown once it is loaded.
    pub fn set_light(&mut self, side: usize, path: PathBuf) {
        self.project.environments.request(&path);
        if side == SOURCE && self.project.matches_by_itself && is_file(&path) {
            // Told, it is as strong as it is.
            self.project.scene.match_strength = false;
            self.project.matches_by_itself = false;
        }
        // How a file is read is set once for all that it lights.
        let known = self
            .project
            .environments
            .get(&path)
            .map(|read| read.reading.clone());
        let light = self.side_mut(side);
        light.set_file(path);
        if let (Some(known), true) = (known, light.reading() == ImageReading::default()) {
            light.set_reading(&known);
        }
    }

    /// Sets how the file of a side's light is read, whatever else it lights.
    pub fn set_reading(&mut self, side: usize, reading: &ImageReading) {
        let file = self.side_mut(side).file.clone();
        for light in self.project.scene.environment_lights_mut() {
            if light.file == file {
                light.set_reading(reading);
            }
        }
    }

    /// True while a light is being read, or estimated.
    pub fn is_loading(&self, path: &Path) -> bool {
        let is_estimating = is_estimate(path) && self.project.is_estimating(self.selected);
        is_estimating || self.project.environments.is_awaited(path)
    }

    /// Exchanges the two lights with their turns and strengths.
    pub fn swap_lights(&mut self) {
        let source = &mut self.project.scene.objects[self.selected].source;
        std::mem::swap(source, &mut self.project.scene.environment);
    }

    /// Has the light of the selected object estimated, also where that was cancelled before or failed.
    pub fn ask_for_estimate(&mut self) {
        let at = self.selected;
        self.set_light(SOURCE, ESTIMATE.into());
        self.project.estimate_again(at);
    }
}
