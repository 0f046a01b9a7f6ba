//! Questions that are answered before anything else is done.

use std::path::PathBuf;

use eframe::egui::{self, Ui};

use super::document::NextScene;
use super::session::SaveKind;
use transplat_engine::language::{tr, tr_format};

/// Question to the user.
#[derive(Clone, Debug)]
pub enum Question {
    /// A file would be written over.
    Overwrite(PathBuf, SaveKind),
    /// Unsaved work would be closed.
    Discard(NextScene),
    /// The document would go back to its file.
    Revert(PathBuf),
    /// A splat is opened in a scene of several objects.
    AddOrReplace(PathBuf),
}

/// Answer to a question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    Overwrite,
    Save,
    Discard,
    Add,
    Replace,
    Cancel,
}

/// Window of a question: nothing lies over it.
pub fn modal(name: &str) -> egui::Modal {
    egui::Modal::new(egui::Id::unique(name))
}

impl Question {
    /// Shows the question about the named work and the named selected object. Yields the answer once there is one.
    pub fn ask(&self, context: &egui::Context, work: &str, selected: &str) -> Option<Answer> {
        let window = modal("question").show(context, |ui| {
            ui.set_max_width(420.0);
            match self {
                Self::Overwrite(path, _) => {
                    ui.label(tr_format!("{} exists already.", path.display()));
                    let answers = [
                        (Answer::Overwrite, tr("Replace file")),
                        (Answer::Cancel, tr("Keep file")),
                    ];
                    buttons(ui, &answers, Answer::Cancel)
                }
                Self::Discard(_) => {
                    ui.label(tr_format!("{name} has unsaved changes.", name = work));
                    ui.weak(tr("Discarded work stays in File > Autosaves."));
                    let answers = [
                        (Answer::Save, tr("Save")),
                        (Answer::Discard, tr("Discard")),
                        (Answer::Cancel, tr("Cancel")),
                    ];
                    buttons(ui, &answers, Answer::Save)
                }
                Self::Revert(_) => {
                    ui.label(tr_format!("Revert {name} to its file?", name = work));
                    ui.weak(tr("Discarded work stays in File > Autosaves."));
                    let answers = [
                        (Answer::Discard, tr("Revert")),
                        (Answer::Cancel, tr("Cancel")),
                    ];
                    buttons(ui, &answers, Answer::Cancel)
                }
                Self::AddOrReplace(path) => {
                    let name = path.file_name().unwrap_or_default().display();
                    ui.label(tr_format!(
                        "Add {name} to the scene, or replace an object?",
                        name = name
                    ));
                    let replace = tr_format!("Replace {called}", called = selected);
                    let answers = [
                        (Answer::Add, tr("Add to scene")),
                        (Answer::Replace, &*replace),
                        (Answer::Cancel, tr("Cancel")),
                    ];
                    buttons(ui, &answers, Answer::Add)
                }
            }
        });
        let closes = window.should_close();
        window.inner.or(closes.then_some(Answer::Cancel))
    }
}

/// Buttons of the answers; Enter presses the default one.
fn buttons(ui: &mut Ui, answers: &[(Answer, &str)], default: Answer) -> Option<Answer> {
    let mut given = None;
    ui.horizontal(|ui| {
        for (answer, name) in answers {
            let button = ui.button(*name);
            // Enter that was for something else is no answer: the first frame has no focus yet.
            if *answer == default && ui.memory(|m| m.focused().is_none()) {
                button.request_focus();
            }
            if button.clicked() {
                given = Some(*answer);
            }
        }
    });
    given
}
