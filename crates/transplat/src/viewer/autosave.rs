//! Autosave: the last work, restored at the next start that names nothing else.

use std::path::{Path, PathBuf};

use transplat_core::files::{is_same_file, load_look, save_look};
use transplat_core::scene::Scene;

use super::app::Viewer;
use transplat_engine::bundled::{BUNDLED_SPLAT, bundled};
use transplat_engine::language::{tr, tr_format};

impl Viewer {
    /// Opens the work of last time; whether there is any.
    pub(super) fn bring_back_work(&mut self) -> bool {
        let Some(path) = self.work.clone().filter(|path| path.is_file()) else {
            return false;
        };
        let first_asset = |scene: Scene| scene.objects.into_iter().find_map(|o| o.asset);
        let why = match load_look(&path).map(first_asset) {
            Ok(Some(asset)) if asset.is_file() => {
                self.session.open(&path);
                self.session.info(tr(
                    "the work of last time; File > Bundled scene starts anew",
                ));
                return true;
            }
            Ok(Some(asset)) => tr_format!("{}: the file is not there", asset.display()),
            Ok(None) => return false,
            Err(error) => error.to_string(),
        };
        let kept = path.display();
        self.session.error(tr_format!(
            "the work of last time ({kept}): {why}",
            kept = kept,
            why = why
        ));
        // What is done from here on does not take its place.
        self.work = None;
        false
    }

    /// Sets the work of last time aside, where the start names something else: what is done now is kept in its place.
    pub(super) fn set_work_aside(&mut self) {
        if let (Some(path), Some(aside)) = (&self.work, self.work_aside())
            && path.is_file()
            && let Err(why) = std::fs::rename(path, &aside)
        {
            self.session.error(tr_format!(
                "{file}: {why}; it is not kept",
                file = path.display(),
                why = why
            ));
            // It is not to be lost to what is done now.
            self.work = None;
        }
    }

    /// Where work is that was set aside.
    pub(super) fn work_aside(&self) -> Option<PathBuf> {
        Some(self.work.as_ref()?.with_file_name("work_before.json"))
    }

    /// Keeps the work as it is now, if anything was done.
    pub fn keep_work(&mut self) {
        let Some(path) = self.work.clone() else {
            return;
        };
        let Some(asset) = self
            .session
            .asset()
            .filter(|_| !self.session.project.is_loading_asset())
        else {
            return;
        };
        let is_bundled = bundled(BUNDLED_SPLAT).is_some_and(|b| is_same_file(&b, &asset.path));
        if is_bundled && !self.history.has_undo(&self.session.project.scene_as_step()) {
            return;
        }
        let scene = self.session.project.scene_to_save();
        if self.kept_work.as_ref() == Some(&scene) {
            return;
        }
        if let Err(why) = keep(&path, &scene) {
            self.session.error(tr_format!(
                "the work cannot be kept for the next start: {why}",
                why = why
            ));
            self.work = None;
        }
        self.kept_work = Some(scene);
    }
}

fn keep(path: &Path, scene: &Scene) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|why| format!("{}: {why}", folder.display()))?;
    save_look(path, scene).map_err(|why| why.to_string())
}
