//! Document of the window: the file of the work, and what of it is saved.

use std::path::PathBuf;
use std::time::Instant;

use transplat_core::scene::Scene;

use super::history::is_as;

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
    /// Document of a scene that is being opened.
    pub coming: Option<ComingDocument>,
    /// Time of the last autosave.
    pub autosaved: Option<Instant>,
    /// Scene of the last autosave.
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

#[cfg(test)]
mod tests {
    use super::*;

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
