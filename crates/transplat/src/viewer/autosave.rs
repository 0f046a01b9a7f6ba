//! Autosaves, the work of the last session, and the document of the viewer: saved, replaced, restored.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use transplat_core::files::{is_same_file, load_look, save_look};
use transplat_core::scene::Scene;

use super::app::Viewer;
use super::document::{NextScene, differs};
use super::history::History;
use super::questions::Question;
use super::session::SaveKind;
use transplat_engine::bundled::{BUNDLED_SPLAT, bundled};
use transplat_engine::jobs::Kind;
use transplat_engine::language::{tr, tr_format};
use transplat_engine::project::TARGET;

/// Beginning of the names of autosaves. They lie beside the work: its paths are relative.
const AUTOSAVE: &str = "autosave ";

/// Autosaves that are kept, and the time from one to the next.
const MOST_AUTOSAVES: usize = 20;
const AUTOSAVE_AFTER: Duration = Duration::from_secs(600);

/// Work that was saved by itself.
pub struct Autosave {
    pub path: PathBuf,
    pub name: String,
    pub age: Duration,
}

impl Viewer {
    /// Title of the window: the document's name, with a star where something is not saved.
    pub(super) fn document_title(&self) -> String {
        let session = &self.session;
        if !session.project.has_asset() && self.document.path.is_none() {
            return "transplat".into();
        }
        let star = if self.has_unsaved() { "*" } else { "" };
        format!("{}{star} – transplat", self.document_name())
    }

    /// True where something is not saved.
    pub(super) fn has_unsaved(&self) -> bool {
        let scene = self.session.project.scene_as_step();
        self.document.is_changed(&scene, self.timeline.time())
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
        if self.document.coming.is_some() {
            return self.session.info(tr("The scene is still loading."));
        }
        self.document.next = next;
        match self.document.path.clone() {
            Some(path) => self.save_to(&path, SaveKind::Look, true),
            None => self.ask_where(SaveKind::Look, "json"),
        }
    }

    /// Shows the scene that waited for the work to be saved, if it is.
    pub(super) fn show_what_waited(&mut self) {
        if !self.has_unsaved()
            && let Some(next) = self.document.next.take()
        {
            self.show_next(next);
        }
    }

    /// Replaces all that is open, after a question where something is not saved.
    pub(super) fn replace_scene(&mut self, next: NextScene) {
        if self.has_unsaved() {
            self.question = Some(Question::Discard(next));
        } else {
            self.show_next(next);
        }
    }

    /// Replaces all that is open; what was there stays as an autosave, or it stays open.
    pub(super) fn show_next(&mut self, next: NextScene) {
        if !self.autosave() {
            return;
        }
        self.to_add.clear();
        // Discarded work does not come back by itself.
        if let Some(work) = self.work.as_ref().filter(|work| work.is_file()) {
            let _ = std::fs::remove_file(work);
        }
        self.kept_work = None;
        let document = &mut self.document;
        match next {
            NextScene::Empty => {
                let mut scene = self.preferences.scene();
                scene.environment.file = Some(self.session.light(TARGET).path.clone());
                document.begin(None, true);
                document.note_saved(&scene);
                self.session.project.start_empty(scene);
                self.session.selected = 0;
                self.history = History::default();
            }
            NextScene::Bundled(splat) => {
                document.expect(None, true, bundled(splat));
                self.bundled_scene(splat);
            }
            NextScene::Look(path) => {
                document.expect(Some(path.clone()), true, first_splat(&path));
                self.unproven.push(path.clone());
                self.session.open(&path);
            }
            NextScene::Autosave(path) => {
                document.expect(None, false, first_splat(&path));
                self.session.open(&path);
            }
        }
    }

    /// Hands the document over to the scene that is opened, once that is shown or could not be.
    pub(super) fn follow_document(&mut self) {
        let project = &self.session.project;
        if project.is_loading_asset() || !self.to_add.is_empty() {
            return;
        }
        // What was undone belongs to the document before.
        if self.document.take_over(&project.scene) {
            self.history = History::default();
        }
        if project.has_asset() {
            let scene = project.scene_as_step();
            self.document.note_opened(&scene);
            self.document.follow(&scene);
        }
        let asks = self.question.is_some() || self.shown.path_field.is_some();
        if !asks && !self.session.jobs.is_running(Kind::Dialog) {
            self.document.next = None;
        }
    }

    /// Opens the work of last time; whether there is any.
    pub(super) fn restore_work(&mut self) -> bool {
        let Some(path) = self.work.clone().filter(|path| path.is_file()) else {
            return false;
        };
        let first_splat = |scene: &Scene| scene.objects[0].asset.clone();
        let read = load_look(&path);
        let why = match read.as_ref().map(first_splat) {
            Ok(Some(asset)) if asset.is_file() => {
                let document = document_of(&path);
                let is_saved = document.as_ref().is_some_and(|file| {
                    let saved = load_look(file);
                    let same = |work: &Scene| saved.is_ok_and(|saved| !differs(&saved, work, 0.0));
                    read.as_ref().is_ok_and(same)
                });
                self.document.expect(document, is_saved, Some(asset));
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
        self.set_work_aside();
        false
    }

    /// Makes an autosave of the work of last time, where the start names something else.
    pub(super) fn set_work_aside(&mut self) {
        let Some(path) = self.work.clone().filter(|path| path.is_file()) else {
            return;
        };
        let asset = load_look(&path).ok().and_then(|s| s.objects[0].called());
        let name = asset.unwrap_or_else(|| tr("unnamed").into());
        let kept = std::fs::rename(&path, autosave_file(&path, &name));
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

    /// Makes an autosave of the work as it is now, if anything was done; whether nothing of it would be lost.
    pub fn autosave(&mut self) -> bool {
        let Some(work) = self.work.clone().filter(|_| self.has_work()) else {
            return true;
        };
        let scene = self.session.project.scene_to_save();
        if self.document.autosaved_scene.as_ref() == Some(&scene) {
            return true;
        }
        let file = autosave_file(&work, &self.document_name());
        if let Err(why) = save_in_folder(&file, &scene) {
            let text = tr_format!(
                "Could not autosave {file}: {why}",
                file = file.display(),
                why = why
            );
            self.session.error(text);
            return false;
        }
        forget_old_autosaves(&work);
        self.document.autosaved = Some(Instant::now());
        self.document.autosaved_scene = Some(scene);
        true
    }

    /// True where there is work that would be missed: a scene of one's own, or the bundled one with changes.
    fn has_work(&self) -> bool {
        let project = &self.session.project;
        let of_bundled = |asset: &Path| {
            bundled(BUNDLED_SPLAT).is_some_and(|bundled| is_same_file(&bundled, asset))
        };
        let is_bundled = project.scene.objects[0]
            .asset
            .as_deref()
            .is_some_and(of_bundled);
        let is_untouched = is_bundled && !self.history.has_undo(&project.scene_as_step());
        project.has_asset() && !is_untouched
    }

    /// Keeps the work as it is now for the next start, if anything was done.
    pub fn keep_work(&mut self) {
        let is_loading = self.session.project.is_loading_asset();
        let Some(path) = self.work.clone().filter(|_| self.has_work() && !is_loading) else {
            return;
        };
        let scene = self.session.project.scene_to_save();
        if self.kept_work.as_ref() == Some(&scene) {
            return;
        }
        let kept = save_in_folder(&path, &scene).and_then(|()| {
            note_document(&path, self.document.path.as_deref()).map_err(|why| why.to_string())
        });
        self.kept_work = Some(scene);
        if let Err(why) = kept {
            let text = tr_format!(
                "Could not save the session for the next start: {why}",
                why = why
            );
            self.session.error(text);
            self.work = None;
            return;
        }
        let last = *self.document.autosaved.get_or_insert_with(Instant::now);
        if last.elapsed() > AUTOSAVE_AFTER {
            self.autosave();
        }
    }
}

/// The first splat of a look.
fn first_splat(look: &Path) -> Option<PathBuf> {
    let scene = load_look(look).ok()?;
    scene.objects.into_iter().next()?.asset
}

/// Saves a scene, in a folder that is made where it is missing.
fn save_in_folder(path: &Path, scene: &Scene) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|why| format!("{}: {why}", folder.display()))?;
    save_look(path, scene).map_err(|why| why.to_string())
}

/// File beside the work that names the document it is of.
fn document_note(work: &Path) -> PathBuf {
    work.with_extension("document")
}

/// Notes the document that the work is of.
fn note_document(work: &Path, document: Option<&Path>) -> std::io::Result<()> {
    let note = document_note(work);
    match document {
        Some(document) => std::fs::write(note, document.display().to_string()),
        None if note.exists() => std::fs::remove_file(note),
        None => Ok(()),
    }
}

/// Document that the work is of.
fn document_of(work: &Path) -> Option<PathBuf> {
    let text = std::fs::read_to_string(document_note(work)).ok()?;
    Some(PathBuf::from(text))
}

/// File of a new autosave beside the work.
fn autosave_file(work: &Path, name: &str) -> PathBuf {
    let is_plain = |c: char| c.is_alphanumeric() || " -_.".contains(c);
    let name: String = name.chars().filter(|c| is_plain(*c)).take(60).collect();
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let made = now.unwrap_or_default().as_millis();
    work.with_file_name(format!("{AUTOSAVE}{made:015} {name}.json"))
}

/// Forgets the oldest autosaves; one that cannot be removed stays.
fn forget_old_autosaves(work: &Path) {
    let all = work.parent().map(autosaves_in).unwrap_or_default();
    for old in all.iter().skip(MOST_AUTOSAVES) {
        let _ = std::fs::remove_file(&old.path);
    }
}

/// Autosaves in a folder, the newest first.
fn autosaves_in(folder: &Path) -> Vec<Autosave> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut all: Vec<Autosave> = files
        .filter_map(|file| {
            let path = file.path();
            let stem = path.file_stem()?.to_string_lossy().into_owned();
            let (since, name) = stem.strip_prefix(AUTOSAVE)?.split_once(' ')?;
            let made = Duration::from_millis(since.parse().ok()?);
            let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
            Some(Autosave {
                name: name.to_owned(),
                age: now.ok()?.saturating_sub(made),
                path,
            })
        })
        .collect();
    // The names begin with the time, whatever the clock says now.
    all.sort_by(|a, b| b.path.cmp(&a.path));
    all
}

/// Age of something in words.
pub fn age_in_words(age: Duration) -> String {
    match age.as_secs() / 60 {
        0 => tr("just now").into(),
        minutes @ 1..60 => tr_format!("{minutes} min ago", minutes = minutes),
        minutes @ 60..1440 => tr_format!("{hours} h ago", hours = minutes / 60),
        minutes => tr_format!("{days} d ago", days = minutes / 1440),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn autosaves_are_few_and_the_newest_is_first() {
        let folder = tempfile::tempdir().expect("a folder");
        let work = folder.path().join("work.json");
        for i in 0..2 * MOST_AUTOSAVES {
            std::fs::write(autosave_file(&work, "a/teapot"), format!("{i}")).expect("room");
            forget_old_autosaves(&work);
            std::thread::sleep(Duration::from_millis(2));
        }
        let all = autosaves_in(folder.path());
        assert_eq!(all.len(), MOST_AUTOSAVES);
        let newest = std::fs::read_to_string(&all[0].path).expect("it is there");
        assert_eq!(newest, format!("{}", 2 * MOST_AUTOSAVES - 1));
        assert_eq!(all[0].name, "ateapot");
    }
}
