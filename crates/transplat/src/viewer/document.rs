//! Document of the window: the file of the work, what of it is saved, and autosaves.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use transplat_core::files::save_look;
use transplat_core::scene::Scene;

use super::history::is_as;

use transplat_engine::language::{tr, tr_format};

/// Beginning of the names of autosaves. They lie beside the work: its paths are relative.
const AUTOSAVE: &str = "autosave ";

/// Autosaves that are kept, and the time from one to the next.
const MOST_AUTOSAVES: usize = 20;
pub const AUTOSAVE_AFTER: Duration = Duration::from_secs(600);

/// Settings that the last save has.
#[derive(Default)]
enum SavedScene {
    /// The scene that is opened next.
    #[default]
    Pending,
    As(Box<Scene>),
    /// Restored work that no file has.
    Nowhere,
}

/// Document that takes over once its scene is shown.
pub struct ComingDocument {
    path: Option<PathBuf>,
    is_saved: bool,
    /// The first splat, by which the scene is recognised.
    splat: Option<PathBuf>,
}

/// File of the work, and what of it is saved.
#[derive(Default)]
pub struct SceneDocument {
    /// The look that *Save* writes; none before the first save.
    pub path: Option<PathBuf>,
    saved: SavedScene,
    pub coming: Option<ComingDocument>,
    /// When the last autosave was made, and of which scene.
    pub autosaved: Option<Instant>,
    pub autosaved_scene: Option<Scene>,
    /// Scene that is shown once the work is saved.
    pub next: Option<NextScene>,
}

/// Scene that takes the place of all that is open.
#[derive(Clone, Debug)]
pub enum NextScene {
    Empty,
    Bundled(&'static str),
    /// A look with its objects.
    Look(PathBuf),
    /// Work that was saved by itself.
    Autosave(PathBuf),
}

/// Work that was saved by itself.
pub struct Autosave {
    pub path: PathBuf,
    pub name: String,
    pub age: Duration,
}

impl SceneDocument {
    /// Starts on a file, or on none, with a scene that is saved or that no file has.
    pub fn begin(&mut self, path: Option<PathBuf>, is_saved: bool) {
        self.path = path;
        self.saved = match is_saved {
            true => SavedScene::Pending,
            false => SavedScene::Nowhere,
        };
        self.coming = None;
    }

    /// Expects the scene of a file, of such a first splat; until it is shown the document stays.
    pub fn expect(&mut self, path: Option<PathBuf>, is_saved: bool, splat: Option<PathBuf>) {
        self.coming = Some(ComingDocument {
            path,
            is_saved,
            splat,
        });
    }

    /// Takes over what was expected where that is shown; forgets it where something else is. Yields whether it was taken over.
    pub fn take_over(&mut self, scene: &Scene) -> bool {
        let Some(coming) = self.coming.take() else {
            return false;
        };
        let is_shown = scene.objects[0].asset == coming.splat;
        if is_shown {
            self.begin(coming.path, coming.is_saved);
        }
        is_shown
    }

    /// Notes that a scene is in the file.
    pub fn note_saved(&mut self, scene: &Scene) {
        self.saved = SavedScene::As(Box::new(scene.clone()));
    }

    /// Leaves the file where its only object is replaced: what is there now is another work.
    pub fn follow(&mut self, scene: &Scene) {
        if let (SavedScene::As(saved), [now]) = (&self.saved, &scene.objects[..])
            && let [last] = &saved.objects[..]
            && last.asset != now.asset
        {
            self.path = None;
        }
    }

    /// Takes the first scene after an opening for the saved one.
    pub fn note_opened(&mut self, scene: &Scene) {
        if matches!(self.saved, SavedScene::Pending) {
            self.note_saved(scene);
        }
    }

    /// True where a scene, with its light at a time of its animation, has changes that are not saved. How it is looked at is none.
    pub fn is_changed(&self, scene: &Scene, time: f64) -> bool {
        match &self.saved {
            SavedScene::Pending => false,
            SavedScene::As(saved) => differs(saved, scene, time),
            SavedScene::Nowhere => true,
        }
    }
}

/// True for scenes that differ in more than how they are looked at, and the time of their light.
pub fn differs(saved: &Scene, scene: &Scene, time: f64) -> bool {
    let mut saved = saved.clone();
    if !saved.animation.keys.is_empty() {
        saved.go_to(time);
    }
    (saved.view, saved.wipe) = (scene.view, scene.wipe);
    !is_as(&saved, scene)
}

pub fn keep(path: &Path, scene: &Scene) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|why| format!("{}: {why}", folder.display()))?;
    save_look(path, scene).map_err(|why| why.to_string())
}

/// File beside the work that names the document it is of.
fn document_note(work: &Path) -> PathBuf {
    work.with_extension("document")
}

/// Notes of which document the work is.
pub fn keep_document(work: &Path, document: Option<&Path>) -> std::io::Result<()> {
    let note = document_note(work);
    match document {
        Some(document) => std::fs::write(note, document.display().to_string()),
        None if note.exists() => std::fs::remove_file(note),
        None => Ok(()),
    }
}

/// Document that the work is of.
pub fn document_of(work: &Path) -> Option<PathBuf> {
    let text = std::fs::read_to_string(document_note(work)).ok()?;
    Some(PathBuf::from(text))
}

/// File of a new autosave beside the work.
pub fn autosave_file(work: &Path, name: &str) -> PathBuf {
    let is_plain = |c: char| c.is_alphanumeric() || " -_.".contains(c);
    let name: String = name.chars().filter(|c| is_plain(*c)).take(60).collect();
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let made = now.unwrap_or_default().as_millis();
    work.with_file_name(format!("{AUTOSAVE}{made:015} {name}.json"))
}

/// Forgets the oldest autosaves; one that cannot be removed stays.
pub fn forget_old_autosaves(work: &Path) {
    let all = work.parent().map(autosaves_in).unwrap_or_default();
    for old in all.iter().skip(MOST_AUTOSAVES) {
        let _ = std::fs::remove_file(&old.path);
    }
}

pub fn autosaves_in(folder: &Path) -> Vec<Autosave> {
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

    /// A look that cannot be shown leaves the document as it is: its file is not written over by what is there.
    #[test]
    fn a_document_is_that_of_the_scene_that_is_shown() {
        let mut document = SceneDocument::default();
        document.begin(Some("a.json".into()), true);
        let mut scene = Scene::default();
        scene.objects[0].asset = Some("a.ply".into());
        document.expect(Some("b.json".into()), true, Some("b.ply".into()));
        assert!(!document.take_over(&scene));
        assert_eq!(document.path, Some("a.json".into()));
        document.expect(Some("b.json".into()), true, Some("b.ply".into()));
        scene.objects[0].asset = Some("b.ply".into());
        assert!(document.take_over(&scene));
        assert_eq!(document.path, Some("b.json".into()));
    }

    #[test]
    fn a_document_is_changed_by_settings_and_not_by_the_view() {
        let mut document = SceneDocument::default();
        let mut scene = Scene::default();
        assert!(!document.is_changed(&scene, 0.0));
        document.note_opened(&scene);
        scene.view = transplat_core::present::View::Split;
        assert!(!document.is_changed(&scene, 0.0));
        scene.display.exposure = 1.0;
        assert!(document.is_changed(&scene, 0.0));
        document.note_opened(&scene);
        assert!(document.is_changed(&scene, 0.0), "it is open already");
        document.note_saved(&scene);
        assert!(!document.is_changed(&scene, 0.0));
    }
}
