//! Documents and autosaves of the viewer: saving, replacing, restoring.

use std::time::Instant;

use transplat_core::files::{is_same_file, load_look};
use transplat_core::scene::Scene;

use super::app::Viewer;
use super::document::{
    AUTOSAVE_AFTER, Autosave, NextScene, autosaves_in, keep, keep_autosave, settings,
};
use super::questions::Question;
use super::session::SaveKind;
use transplat_engine::bundled::{BUNDLED_SPLAT, bundled};
use transplat_engine::language::{tr, tr_format};

impl Viewer {
    /// Title of the window: the document's name, with a star where something is not saved.
    pub(super) fn document_title(&self) -> String {
        let session = &self.session;
        if session.asset().is_none() && self.document.path.is_none() {
            return "transplat".into();
        }
        let is_changed = self.document.is_changed(&session.project.scene);
        let star = if is_changed { "*" } else { "" };
        format!("{}{star} – transplat", self.document_name())
    }

    /// Name of the document, or of the first object where it has none.
    pub(super) fn document_name(&self) -> String {
        let stem = self
            .document
            .path
            .as_ref()
            .and_then(|path| path.file_stem());
        stem.map_or_else(
            || self.session.project.called(0),
            |stem| stem.to_string_lossy().into_owned(),
        )
    }

    /// Saves to the document's file, or asks for one; and then shows another scene, if one waits for that.
    pub(super) fn save_document(&mut self, next: Option<NextScene>) {
        self.document.next = next;
        match self.document.path.clone() {
            Some(path) => self.save_to(&path, SaveKind::Look, true),
            None => self.ask_where(SaveKind::Look, "json"),
        }
    }

    /// Replaces all that is open, after a question where something is not saved.
    pub(super) fn replace_scene(&mut self, next: NextScene) {
        if self.document.is_changed(&self.session.project.scene) {
            self.question = Some(Question::Discard(next));
        } else {
            self.show_next(next);
        }
    }

    /// Replaces all that is open; what was there stays as an autosave.
    pub(super) fn show_next(&mut self, next: NextScene) {
        self.autosave();
        self.to_add.clear();
        // Discarded work does not come back by itself.
        if let Some(work) = self.work.as_ref().filter(|work| work.is_file()) {
            let _ = std::fs::remove_file(work);
        }
        self.kept_work = None;
        match next {
            NextScene::Empty => {
                self.document.begin(None);
                self.session.project.start_empty(self.preferences.scene());
                self.session.selected = 0;
            }
            NextScene::Bundled(splat) => {
                self.document.begin(None);
                self.bundled_scene(splat);
            }
            NextScene::Look(path) | NextScene::Saved(path) => {
                self.document.begin(Some(path.clone()));
                self.unproven.push(path.clone());
                self.session.open(&path);
            }
            NextScene::Autosave(path) => {
                self.document.begin_unsaved(None);
                self.session.open(&path);
            }
        }
    }

    /// Opens the work of last time; whether there is any.
    pub(super) fn restore_work(&mut self) -> bool {
        let Some(path) = self.work.clone().filter(|path| path.is_file()) else {
            return false;
        };
        let first_asset = |scene: &Scene| scene.objects.iter().find_map(|o| o.asset.clone());
        let read = load_look(&path);
        let why = match read.as_ref().map(first_asset) {
            Ok(Some(asset)) if asset.is_file() => {
                let document = self.preferences.document.clone();
                let is_saved = document.as_ref().is_some_and(|file| {
                    let saved = load_look(file);
                    let same = |work: &Scene| saved.is_ok_and(|s| settings(&s) == settings(work));
                    read.as_ref().is_ok_and(same)
                });
                match is_saved {
                    true => self.document.begin(document),
                    false => self.document.begin_unsaved(document),
                }
                self.session.open(&path);
                self.session.info(tr("Restored your last session."));
                return true;
            }
            Ok(Some(asset)) => tr_format!("{}: file not found", asset.display()),
            Ok(None) => return false,
            Err(error) => error.to_string(),
        };
        self.session.error(tr_format!(
            "Could not restore your last session from {work}: {why}",
            work = path.display(),
            why = why
        ));
        // What is done from here on does not take its place.
        self.work = None;
        false
    }

    /// Makes an autosave of the work of last time, where the start names something else.
    pub(super) fn set_work_aside(&mut self) {
        let Some(path) = self.work.clone().filter(|path| path.is_file()) else {
            return;
        };
        let asset = load_look(&path).ok().and_then(|s| s.objects[0].called());
        let name = asset.unwrap_or_else(|| tr("unnamed").into());
        let kept = keep_autosave(&path, &name).and_then(|()| std::fs::remove_file(&path));
        if let Err(why) = kept {
            self.session.error(tr_format!(
                "Could not autosave {file}: {why}",
                file = path.display(),
                why = why
            ));
            // It is not to be lost to what is done now.
            self.work = None;
        }
    }

    /// Autosaves, the newest first.
    pub(super) fn autosaves(&self) -> Vec<Autosave> {
        let folder = self.work.as_ref().and_then(|work| work.parent());
        folder.map(autosaves_in).unwrap_or_default()
    }

    /// Makes an autosave of the work as it is now.
    pub fn autosave(&mut self) {
        self.keep_work();
        let name = self.document_name();
        self.document.autosaved = Some(Instant::now());
        if let Some(work) = self.work.clone().filter(|work| work.is_file())
            && let Err(why) = keep_autosave(&work, &name)
        {
            let file = work.display();
            self.session.error(tr_format!(
                "Could not autosave {file}: {why}",
                file = file,
                why = why
            ));
        }
    }

    /// Keeps the work as it is now for the next start, if anything was done.
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
        let last = *self.document.autosaved.get_or_insert_with(Instant::now);
        match keep(&path, &scene) {
            Ok(()) if last.elapsed() > AUTOSAVE_AFTER => {
                self.kept_work = Some(scene);
                self.autosave();
                return;
            }
            Ok(()) => {}
            Err(why) => {
                self.session.error(tr_format!(
                    "Could not save the session for the next start: {why}",
                    why = why
                ));
                self.work = None;
            }
        }
        self.kept_work = Some(scene);
    }
}
