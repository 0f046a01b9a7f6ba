//! Document of the window: the file of the work, what of it is saved, and autosaves.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use transplat_core::files::save_look;
use transplat_core::present::View;
use transplat_core::scene::Scene;

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

/// File of the work, and what of it is saved.
#[derive(Default)]
pub struct SceneDocument {
    /// The look that *Save* writes; none before the first save.
    pub path: Option<PathBuf>,
    saved: SavedScene,
    /// When the last autosave was made.
    pub autosaved: Option<Instant>,
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
    /// The document as it was saved.
    Saved(PathBuf),
}

/// Work that was saved by itself.
pub struct Autosave {
    pub path: PathBuf,
    pub name: String,
    pub age: Duration,
}

/// The settings without how they are looked at.
pub fn settings(scene: &Scene) -> Scene {
    Scene {
        camera: None,
        view: View::After,
        wipe: 0.5,
        ..scene.clone()
    }
}

impl SceneDocument {
    /// Starts on a file, or on none. What is opened next counts as saved.
    pub fn begin(&mut self, path: Option<PathBuf>) {
        self.path = path;
        self.saved = SavedScene::Pending;
    }

    /// Starts with work that no file has.
    pub fn begin_unsaved(&mut self, path: Option<PathBuf>) {
        self.path = path;
        self.saved = SavedScene::Nowhere;
    }

    /// Notes that a scene is in the file.
    pub fn note_saved(&mut self, scene: &Scene) {
        self.saved = SavedScene::As(Box::new(settings(scene)));
    }

    /// Takes the first scene after an opening for the saved one.
    pub fn note_opened(&mut self, scene: &Scene) {
        if matches!(self.saved, SavedScene::Pending) {
            self.note_saved(scene);
        }
    }

    /// True where a scene has changes that are not saved.
    pub fn is_changed(&self, scene: &Scene) -> bool {
        match &self.saved {
            SavedScene::Pending => false,
            SavedScene::As(saved) => **saved != settings(scene),
            SavedScene::Nowhere => true,
        }
    }
}

pub fn keep(path: &Path, scene: &Scene) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder).map_err(|why| format!("{}: {why}", folder.display()))?;
    save_look(path, scene).map_err(|why| why.to_string())
}

/// Copies the work to the autosaves, unless the newest is the same, and forgets the oldest.
pub fn keep_autosave(work: &Path, name: &str) -> std::io::Result<()> {
    let text = std::fs::read(work)?;
    let folder = work.parent().unwrap_or(Path::new("."));
    let all = autosaves_in(folder);
    let newest = all
        .first()
        .and_then(|newest| std::fs::read(&newest.path).ok());
    if newest.as_ref() == Some(&text) {
        return Ok(());
    }
    let is_plain = |c: char| c.is_alphanumeric() || " -_.".contains(c);
    let name: String = name.chars().filter(|c| is_plain(*c)).take(60).collect();
    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let made = now.unwrap_or_default().as_millis();
    let name = format!("{AUTOSAVE}{made:015} {name}.json");
    std::fs::write(work.with_file_name(name), text)?;
    for old in all.iter().skip(MOST_AUTOSAVES - 1) {
        std::fs::remove_file(&old.path)?;
    }
    Ok(())
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
    all.sort_by_key(|autosave| autosave.age);
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
    fn autosaves_are_few_and_each_is_another() {
        let folder = tempfile::tempdir().expect("a folder");
        let work = folder.path().join("work.json");
        for i in 0..2 * MOST_AUTOSAVES {
            std::fs::write(&work, format!("{i}")).expect("room");
            for _ in 0..2 {
                keep_autosave(&work, "a/teapot").expect("room");
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let all = autosaves_in(folder.path());
        assert_eq!(all.len(), MOST_AUTOSAVES);
        let newest = std::fs::read_to_string(&all[0].path).expect("it is there");
        assert_eq!(newest, format!("{}", 2 * MOST_AUTOSAVES - 1));
        assert_eq!(all[0].name, "ateapot");
    }

    #[test]
    fn a_document_is_changed_by_settings_and_not_by_the_view() {
        let mut document = SceneDocument::default();
        let mut scene = Scene::default();
        assert!(!document.is_changed(&scene));
        document.note_opened(&scene);
        scene.view = View::Split;
        assert!(!document.is_changed(&scene));
        scene.display.exposure = 1.0;
        assert!(document.is_changed(&scene));
        document.note_opened(&scene);
        assert!(document.is_changed(&scene), "it is open already");
        document.note_saved(&scene);
        assert!(!document.is_changed(&scene));
    }
}
