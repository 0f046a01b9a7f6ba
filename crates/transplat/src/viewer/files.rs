//! Files in and out: dialogs, drops, and the bundled scene.

use std::time::Instant;

use super::jobs::Kind;
use super::session::{Event, SaveKind, Session};

/// What the window "By path" asks for.
pub struct PathField {
    pub text: String,
    /// Whether it gets the keyboard.
    pub is_new: bool,
    /// Why it was opened, if not by the user.
    pub note: Option<&'static str>,
}

impl PathField {
    pub fn new(note: Option<&'static str>) -> Self {
        Self {
            text: String::new(),
            is_new: true,
            note,
        }
    }
}

/// What a file dialog is for.
#[derive(Clone, Debug)]
pub enum Dialog {
    Open,
    OpenFolder,
    Save(SaveKind, String),
}

/// Asks the desktop for a file, off the interface's thread. Where no dialog can be shown, the window "By path" serves.
pub fn ask(session: &mut Session, dialog: Dialog) {
    if session.jobs.is_running(Kind::Dialog) {
        return;
    }
    let work = move |_: &_| {
        let start = Instant::now();
        // A person takes longer than this to say no: there was nobody to ask.
        let none = || (start.elapsed().as_secs_f32() < 0.3).then_some(Event::NoDialog);
        Ok(show(dialog).or_else(none))
    };
    let label = "waiting for the file dialog";
    session.start(Kind::Dialog, label, work, |session, event| {
        session.events.extend(event);
    });
}

fn show(dialog: Dialog) -> Option<Event> {
    match dialog {
        Dialog::Open => rfd::FileDialog::new()
            .set_title("Open splats, environments, looks")
            .add_filter(
                "All that opens",
                &["ply", "hdr", "exr", "png", "jpg", "jpeg", "json"],
            )
            .add_filter("Splats", &["ply"])
            .add_filter("Environments", &["hdr", "exr", "png", "jpg", "jpeg"])
            .add_filter("Looks", &["json"])
            .pick_files()
            .map(Event::Files),
        Dialog::OpenFolder => rfd::FileDialog::new()
            .set_title("Open a folder of environments")
            .pick_folder()
            .map(|folder| Event::Files(vec![folder])),
        Dialog::Save(SaveKind::Folder, _) => rfd::FileDialog::new()
            .set_title("Folder for pictures")
            .pick_folder()
            .map(|folder| Event::SaveTo(folder, SaveKind::Folder)),
        Dialog::Save(kind, name) => {
            let (title, filter, extensions): (_, _, &[&str]) = match kind {
                SaveKind::Look => ("Save look", "Look", &["json"]),
                SaveKind::Splat => ("Export relit splat", "Splat", &["ply"]),
                _ => ("Save picture", "Picture", &["png", "exr"]),
            };
            rfd::FileDialog::new()
                .set_title(title)
                .add_filter(filter, extensions)
                .set_file_name(name)
                .save_file()
                .map(|path| Event::SaveTo(path, kind))
        }
    }
}
