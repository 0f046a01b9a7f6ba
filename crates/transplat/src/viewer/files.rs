//! File dialogs, drops, and the bundled scene.

use std::path::{Path, PathBuf};
use std::time::Instant;

use transplat_core::files::{SPLAT_ENDINGS, percent_decoded};

use super::session::{Dialog, Event, SaveKind, Session};
use transplat_engine::jobs::Kind;
use transplat_engine::language::tr;

/// State of the window "Path".
pub struct PathField {
    pub text: String,
    /// True where it gets the keyboard.
    pub is_new: bool,
    /// The dialog that it stands for, if it is one.
    pub dialog: Option<Dialog>,
}

impl PathField {
    /// For anything.
    pub fn new() -> Self {
        Self {
            text: String::new(),
            is_new: true,
            dialog: None,
        }
    }

    /// In the place of a dialog, with what it would propose.
    pub fn of(dialog: Dialog, folder: &Path) -> Self {
        let text = match &dialog {
            Dialog::Open
            | Dialog::OpenFolder
            | Dialog::Save(SaveKind::OpenRig | SaveKind::Backplate | SaveKind::Lut, _) => {
                String::new()
            }
            Dialog::Save(SaveKind::Folder, _) => folder.display().to_string(),
            Dialog::Save(_, name) => folder.join(name).display().to_string(),
        };
        Self {
            text,
            dialog: Some(dialog),
            ..Self::new()
        }
    }

    /// Actions for the path: nothing stands for opening it. Enter does the first.
    pub fn actions(&self) -> Vec<(&'static str, Option<SaveKind>)> {
        match self.dialog {
            None => vec![
                (tr("Open"), None),
                (tr("Save look"), Some(SaveKind::Look)),
                (tr("Save image"), Some(SaveKind::Screenshot)),
                (tr("Export splat"), Some(SaveKind::Splat)),
                (tr("Export delit"), Some(SaveKind::Delit)),
            ],
            Some(Dialog::Open | Dialog::OpenFolder) => vec![(tr("Open"), None)],
            Some(Dialog::Save(SaveKind::Look, _)) => vec![(tr("Save look"), Some(SaveKind::Look))],
            Some(Dialog::Save(SaveKind::Rig, _)) => {
                vec![(tr("Save rig"), Some(SaveKind::Rig))]
            }
            Some(Dialog::Save(SaveKind::OpenRig, _)) => {
                vec![(tr("Open rig"), Some(SaveKind::OpenRig))]
            }
            Some(Dialog::Save(SaveKind::Environment, _)) => {
                vec![(tr("Save as environment"), Some(SaveKind::Environment))]
            }
            Some(Dialog::Save(SaveKind::Splat, _)) => {
                vec![(tr("Export splat"), Some(SaveKind::Splat))]
            }
            Some(Dialog::Save(SaveKind::Delit, _)) => {
                vec![(tr("Export delit"), Some(SaveKind::Delit))]
            }
            Some(Dialog::Save(SaveKind::Screenshot, _)) => {
                vec![(tr("Save image"), Some(SaveKind::Screenshot))]
            }
            Some(Dialog::Save(SaveKind::Folder, _)) => {
                vec![(tr("Save images there"), Some(SaveKind::Folder))]
            }
            Some(Dialog::Save(SaveKind::Backplate, _)) => {
                vec![(tr("Use as backplate"), Some(SaveKind::Backplate))]
            }
            Some(Dialog::Save(SaveKind::Lut, _)) => {
                vec![(tr("Apply LUT"), Some(SaveKind::Lut))]
            }
        }
    }
}

/// The path that somebody typed or pasted: quotes around it are dropped, `file://` is decoded, and `~` is the home folder.
pub fn path_as_typed(text: &str) -> PathBuf {
    let text = text.trim();
    let quoted = |quote: char| text.strip_prefix(quote)?.strip_suffix(quote);
    let text = quoted('"').or_else(|| quoted('\'')).unwrap_or(text);
    if let Some(uri) = text.strip_prefix("file://") {
        // On Windows the drive follows the slash.
        let path = percent_decoded(uri);
        return match cfg!(windows) {
            true => path.trim_start_matches('/').into(),
            false => path.into(),
        };
    }
    let home = text.strip_prefix("~/").zip(std::env::home_dir());
    home.map_or_else(|| text.into(), |(below, home)| home.join(below))
}

/// Asks the desktop for a file, off the interface's thread. Where no dialog can be shown, the window "Path" serves.
pub fn ask(session: &mut Session, dialog: Dialog) {
    if session.jobs.is_running(Kind::Dialog) {
        return;
    }
    let folder = session.folder_of(&dialog);
    let work = move |_: &_| {
        let start = Instant::now();
        // A person takes longer than this to say no: there was nobody to ask.
        let none =
            || (start.elapsed().as_secs_f32() < 0.3).then(|| Event::NoDialog(dialog.clone()));
        Ok(show(dialog.clone(), &folder).or_else(none))
    };
    let label = tr("waiting for the file dialog");
    session.start(Kind::Dialog, label, work, |session, event| {
        session.events.extend(event);
    });
}

/// Endings of environments that are opened.
const ENVIRONMENTS: [&str; 5] = ["hdr", "exr", "png", "jpg", "jpeg"];

/// Endings of splats that are saved.
const SPLATS: [&str; 5] = ["ply", "spz", "sog", "splat", "glb"];

fn show(dialog: Dialog, folder: &Path) -> Option<Event> {
    let new = || rfd::FileDialog::new().set_directory(folder);
    match dialog {
        Dialog::Open => new()
            .set_title(tr("Open splats, environments, looks"))
            .add_filter(
                tr("All supported files"),
                &[
                    &SPLAT_ENDINGS[..],
                    &ENVIRONMENTS,
                    &["json", "bin", "txt", "cube"],
                ]
                .concat(),
            )
            .add_filter(tr("Splats"), &[&SPLAT_ENDINGS[..], &["json"]].concat())
            .add_filter(tr("Environments"), &ENVIRONMENTS)
            .add_filter(tr("LUTs"), &["cube"])
            .add_filter(tr("Looks and cameras"), &["json", "bin", "txt"])
            .pick_files()
            .map(Event::Files),
        Dialog::OpenFolder => new()
            .set_title(tr("Open a folder of environments"))
            .pick_folder()
            .map(|folder| Event::Files(vec![folder])),
        Dialog::Save(SaveKind::Folder, _) => new()
            .set_title(tr("Folder for images"))
            .pick_folder()
            .map(|folder| Event::SaveTo(folder, SaveKind::Folder)),
        Dialog::Save(SaveKind::Backplate, _) => new()
            .set_title(tr("Backplate"))
            .add_filter(tr("Photographs"), &ENVIRONMENTS)
            .pick_file()
            .map(|file| Event::SaveTo(file, SaveKind::Backplate)),
        Dialog::Save(SaveKind::OpenRig, _) => new()
            .set_title(tr("Open rig"))
            .add_filter(tr("Lights"), &["json"])
            .pick_file()
            .map(|file| Event::SaveTo(file, SaveKind::OpenRig)),
        Dialog::Save(SaveKind::Lut, _) => new()
            .set_title(tr("LUT"))
            .add_filter(tr("LUTs"), &["cube"])
            .pick_file()
            .map(|file| Event::SaveTo(file, SaveKind::Lut)),
        Dialog::Save(kind, name) => {
            let (title, filter, extensions): (_, _, &[&str]) = match kind {
                SaveKind::Look => (tr("Save look"), tr("Look"), &["json"]),
                SaveKind::Rig => (tr("Save rig"), tr("Lights"), &["json"]),
                SaveKind::Environment => (
                    tr("Save as environment"),
                    tr("Environment"),
                    &["exr", "hdr"],
                ),
                SaveKind::Splat => (tr("Export relit splat"), tr("Splat"), &SPLATS),
                SaveKind::Delit => (tr("Export delit"), tr("Splat"), &SPLATS),
                _ => (tr("Save image"), tr("Image"), &["png", "exr"]),
            };
            new()
                .set_title(title)
                .add_filter(filter, extensions)
                .set_file_name(name)
                .save_file()
                .map(|path| Event::SaveTo(path, kind))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pasted_path_is_what_it_names() {
        let as_typed = |text| path_as_typed(text).display().to_string();
        assert_eq!(as_typed(" /a b/c.hdr "), "/a b/c.hdr");
        assert_eq!(as_typed("'/a b/c.hdr'"), "/a b/c.hdr");
        assert_eq!(as_typed("\"it's.hdr\""), "it's.hdr");
        if cfg!(unix) {
            assert_eq!(as_typed("file:///a%20b/%C3%A9.hdr"), "/a b/é.hdr");
        }
        let home = std::env::home_dir().map(|home| home.join("a.hdr"));
        assert_eq!(Some(path_as_typed("~/a.hdr")), home);
    }

    /// Enter does the first.
    #[test]
    fn a_path_in_the_place_of_a_dialog_is_for_what_the_dialog_was_for() {
        let actions = |dialog| PathField::of(dialog, Path::new("folder")).actions();
        for kind in [
            SaveKind::Look,
            SaveKind::Rig,
            SaveKind::Environment,
            SaveKind::Splat,
            SaveKind::Screenshot,
            SaveKind::Folder,
            SaveKind::Backplate,
            SaveKind::OpenRig,
            SaveKind::Lut,
        ] {
            let asked = actions(Dialog::Save(kind, "name".into()));
            assert!(matches!(asked[..], [(_, Some(does))] if does == kind));
        }
        for dialog in [Dialog::Open, Dialog::OpenFolder] {
            assert!(matches!(actions(dialog)[..], [(_, None)]));
        }
        let field = PathField::of(
            Dialog::Save(SaveKind::Look, "a.json".into()),
            Path::new("folder"),
        );
        assert_eq!(Path::new(&field.text), Path::new("folder").join("a.json"));
    }
}
