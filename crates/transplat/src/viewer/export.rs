//! Exports of images and splats, in the background, from a copy of the project.

mod caption;
mod run;
mod sheet;
pub mod task;

use std::path::PathBuf;

use super::session::{Event, Session, SessionChange};
use run::{Export, ExportRun};
use sheet::contact_sheet;
use task::{ExportResult, ExportSettings, Task};
use transplat_engine::jobs::{Handle, Kind};
use transplat_engine::language::{tr, tr_format};

/// Starts an export; reports why one cannot be started.
pub fn start(
    session: &mut Session,
    light_library: &[PathBuf],
    settings: &ExportSettings,
    task: Task,
) {
    let settings = task.settings(settings);
    let export = settings.and_then(|settings| Export::of(session, light_library, settings, &task));
    let export = match export {
        Ok(export) => export,
        Err(why) => {
            session.error(why.to_string());
            return;
        }
    };
    let waiting = light_library
        .iter()
        .filter(|p| session.is_loading(p))
        .count();
    if waiting > 0 && matches!(task, Task::EachLight | Task::ContactSheet) {
        session.info(tr_format!(
            "{waiting} lights of the library are still loading and are skipped.",
            waiting = waiting
        ));
    }
    let label = export.label(&task);
    let work = move |handle: &Handle<SessionChange>| {
        let mut run = ExportRun::of(export, handle)?;
        match task {
            Task::ContactSheet => contact_sheet(&mut run),
            task => run.make(&task),
        }
    };
    session.start(Kind::Export, label, work, |session, made| match made {
        ExportResult::Files(paths) => session.info(saved(&paths)),
        ExportResult::Delit(path, warnings) => {
            session.info(saved(&[path]));
            warnings
                .into_iter()
                .for_each(|warning| session.info(warning));
        }
        ExportResult::Picture(size, bytes) => session.events.push(Event::Clipboard(size, bytes)),
        ExportResult::Preview(size, bytes) => session.events.push(Event::Preview(size, bytes)),
    });
}

/// For the user.
fn saved(paths: &[PathBuf]) -> String {
    match paths {
        [one] => tr_format!("Saved {}.", one.display()),
        [first, .., last] => tr_format!(
            "Saved {} images, {} to {}.",
            paths.len(),
            first.display(),
            last.file_name().unwrap_or_default().to_string_lossy()
        ),
        [] => tr("Nothing was saved.").into(),
    }
}
