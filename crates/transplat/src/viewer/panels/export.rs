//! Pictures and splats out.

use eframe::egui::{self, Ui};

use crate::film::FilmFormat;
use crate::viewer::app::Viewer;
use crate::viewer::export::{ExportSides, Format, Task, Turn};
use crate::viewer::files::ask;
use crate::viewer::session::{Dialog, SaveKind};
use crate::viewer::widgets::{button, choice, named, number};

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    picture(ui, viewer);
    place(ui, viewer);
    let mut task = tasks(ui);
    ui.separator();
    task = task.or(turntable(ui, viewer));
    ui.separator();
    let tip = "As PLY, with every property that the capture has: any other viewer shows it relit. (ctrl + E)";
    if button(ui, "Export relit splat…", tip) {
        viewer.ask_where(SaveKind::Splat, "ply");
    }
    if let Some(task) = task {
        viewer.export(task);
    }
}

/// What a picture is made of.
fn picture(ui: &mut Ui, viewer: &mut Viewer) {
    let settings = &mut viewer.preferences.export;
    ui.horizontal(|ui| {
        for (i, name) in ["Width", "Height"].into_iter().enumerate() {
            let drag = number(&mut settings.size[i], 1..=16384).suffix(" px");
            let response = ui.add(drag).on_hover_text(format!(
                "{name} of saved pictures; beyond the largest texture they are drawn in tiles."
            ));
            named(&response, egui::Role::SpinButton, format!("Picture {name}"));
        }
        if button(ui, "as here", "The viewport's own size.") {
            settings.size = viewer.session.viewport;
        }
    });
    choice(
        ui,
        "Format",
        "PNG is for screens, with exposure and tone mapping; EXR is linear light with premultiplied alpha.",
        &mut settings.format,
        &Format::ALL,
    );
    choice(
        ui,
        "Samples",
        "Samples a pixel along each edge: more give smoother edges and take longer.",
        &mut settings.supersample,
        &[("2 x 2", 2), ("1 x 1", 1), ("3 x 3", 3), ("4 x 4", 4)],
    );
    ui.checkbox(&mut settings.transparent, "Transparent background")
        .on_hover_text("Leaves out what is behind the object; a caught shadow stays.");
    choice(
        ui,
        "Sides",
        "What is shown, or before and after as a picture each.",
        &mut settings.sides,
        &[
            ("as shown", ExportSides::Shown),
            ("before and after", ExportSides::Each),
        ],
    );
}

/// Where pictures go, and what they are called.
fn place(ui: &mut Ui, viewer: &mut Viewer) {
    let settings = &mut viewer.preferences.export;
    ui.horizontal(|ui| {
        let field = egui::TextEdit::singleline(&mut settings.folder).desired_width(150.0);
        let label = ui.label("Folder");
        ui.add(field)
            .labelled_by(label.id)
            .on_hover_text("Where pictures are saved.");
        let choose = ui.button("…").on_hover_text("Choose a folder.");
        named(&choose, egui::Role::Button, "Choose the folder");
        if choose.clicked() {
            ask(
                &mut viewer.session,
                Dialog::Save(SaveKind::Folder, String::new()),
            );
        }
    });
    ui.horizontal(|ui| {
        let label = ui.label("Name");
        let field = egui::TextEdit::singleline(&mut settings.pattern).desired_width(180.0);
        ui.add(field).labelled_by(label.id).on_hover_text("Name of pictures: {asset}, {light}, {view} and {n} (the frame's number) stand for what they say.");
    });
}

/// What can be saved at once.
fn tasks(ui: &mut Ui) -> Option<Task> {
    let mut task = None;
    ui.horizontal_wrapped(|ui| {
        if button(ui, "Save picture", "As it is shown. (F12)") {
            task = Some(Task::Screenshot(None));
        }
        let tip =
            "How the picture will be saved, in small: with depth of field, samples and background.";
        if button(ui, "Preview", tip) {
            task = Some(Task::Preview);
        }
        let tip = "The picture to the clipboard. (ctrl + shift + C)";
        if button(ui, "Copy", tip) {
            task = Some(Task::Clipboard);
        }
        let tip = "A file for each light of the shelf.";
        if button(ui, "One per light", tip) {
            task = Some(Task::EachLight);
        }
        let tip = "One file with a picture for each light of the shelf.";
        if button(ui, "Contact sheet", tip) {
            task = Some(Task::ContactSheet);
        }
    });
    task
}

/// A whole turn, in numbered frames or as a film.
fn turntable(ui: &mut Ui, viewer: &mut Viewer) -> Option<Task> {
    let settings = &mut viewer.preferences.export;
    ui.horizontal(|ui| {
        let drag = number(&mut settings.frames, 2..=10_000).suffix(" frames");
        let response = ui.add(drag).on_hover_text("Frames of a whole turn.");
        named(&response, egui::Role::SpinButton, "Turntable frames");
        ui.selectable_value(&mut settings.turn, Turn::Camera, "camera")
            .on_hover_text("The camera goes round the object.");
        ui.selectable_value(&mut settings.turn, Turn::Light, "light")
            .on_hover_text("The light goes round the object.");
    });
    choice(
        ui,
        "Saved as",
        "Numbered pictures in the format above; or a film, which the program ffmpeg makes where it is installed. WebM and WebP can be transparent.",
        &mut settings.film,
        &[
            ("numbered pictures", None),
            ("film, MP4", Some(FilmFormat::Mp4)),
            ("film, WebM", Some(FilmFormat::WebM)),
            ("film, WebP", Some(FilmFormat::WebP)),
        ],
    );
    if settings.film.is_some() {
        let drag = number(&mut settings.frame_rate, 1..=240).suffix(" frames a second");
        let response = ui.add(drag).on_hover_text("How fast the film is played.");
        named(&response, egui::Role::SpinButton, "Frame rate");
    }
    button(ui, "Save turntable", "A whole turn.").then_some(Task::Turntable)
}
