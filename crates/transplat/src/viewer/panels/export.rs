//! Panel *Export*.

use eframe::egui::{self, RichText, Ui};
use transplat_core::files::SplatFormat;
use transplat_core::transfer::materials::WHITEST_ALBEDO;

use crate::viewer::app::Viewer;
use crate::viewer::export::task::{ExportSides, Task, Turn};
use crate::viewer::files::ask;
use crate::viewer::session::{Dialog, SaveKind};
use crate::viewer::style::small;
use crate::viewer::widgets::{button, choice, heading, name, named, number};
use transplat_engine::delight::{ALBEDOS, DelitAs};
use transplat_engine::language::{tr, tr_format};
use transplat_engine::output::ImageFormat;
use transplat_engine::video::{VideoFormat, has_ffmpeg};

/// Room for the button that chooses a folder, and the gap before it.
const CHOOSE_WIDTH: f32 = 40.0;

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    heading(ui, tr("Image"));
    picture(ui, viewer);
    place(ui, viewer);
    let mut task = tasks(ui);
    heading(ui, tr("Turntable and animation"));
    task = task.or(turntable(ui, viewer));
    heading(ui, tr("Relit splat"));
    splat_format(ui, viewer);
    let tip = tr("Saves the relit splat for any viewer. (ctrl + E)");
    if button(ui, tr("Export relit splat…"), tip) {
        viewer.ask_where(SaveKind::Splat, viewer.splat_ending());
    }
    heading(ui, tr("Splat without light"));
    delit(ui, viewer);
    if let Some(task) = task {
        viewer.export(task);
    }
}

/// The splat without its light.
fn delit(ui: &mut Ui, viewer: &mut Viewer) {
    let settings = &mut viewer.preferences.export;
    choice(
        ui,
        tr("Delit colour"),
        tr(
            "Albedo for programs that light splats themselves, or the object under uniform white light.",
        ),
        &mut settings.delit_as,
        &[
            (tr("albedo"), DelitAs::Albedo),
            (tr("uniform white"), DelitAs::Even),
        ],
    );
    ui.horizontal(|ui| {
        let mut is_explicit = settings.whitest.is_some();
        ui.checkbox(&mut is_explicit, tr("Brightest albedo"))
            .on_hover_text(tr("Albedo of the brightest surface. Automatic by default."));
        let mut whitest = settings.whitest.unwrap_or(WHITEST_ALBEDO as f32);
        ui.add_enabled_ui(is_explicit, |ui| {
            let drag = ui.add(number(&mut whitest, ALBEDOS).speed(0.005));
            named(&drag, egui::Role::SpinButton, tr("Brightest albedo"));
        });
        settings.whitest = is_explicit.then_some(whitest);
    });
    ui.checkbox(&mut settings.materials, tr("With materials"))
        .on_hover_text(tr("Adds normal, base colour, metallic, roughness, reflectance and emission of each Gaussian to PLY and GLB."));
    let tip = tr("Saves the selected object without its capture light.");
    if button(ui, tr("Export delit…"), tip) {
        viewer.ask_where(SaveKind::Delit, viewer.splat_ending());
    }
}

/// In which format a relit splat is written, and what of it that loses.
fn splat_format(ui: &mut Ui, viewer: &mut Viewer) {
    let written = SplatFormat::WRITTEN.map(|(_, format)| (format.name(), Some(format)));
    let options: Vec<_> = std::iter::once((tr("same as input"), None))
        .chain(written)
        .collect();
    let format = &mut viewer.preferences.export.splat;
    let text = tr(
        "A PLY keeps every property of the capture. The file name can choose another format: .ply, .compressed.ply, .spz, .sog, .splat, .glb.",
    );
    choice(ui, tr("Splat format"), text, format, &options);
    let (Some(format), Some(asset)) = (*format, viewer.session.asset()) else {
        return;
    };
    if format != asset.file.format {
        let losses = asset.losses.iter().find(|(f, _)| *f == format);
        for loss in losses.iter().flat_map(|(_, losses)| losses) {
            ui.label(
                RichText::new(loss)
                    .font(small())
                    .color(ui.visuals().weak_text_color()),
            );
        }
    }
}

/// Settings of an image.
fn picture(ui: &mut Ui, viewer: &mut Viewer) {
    let settings = &mut viewer.preferences.export;
    ui.horizontal(|ui| {
        name(ui, tr("Size"));
        for (i, name) in [tr("Width"), tr("Height")].into_iter().enumerate() {
            let drag = number(&mut settings.size[i], 1..=16384);
            let response = ui.add(drag).on_hover_text(tr_format!(
                "{name} of saved images. Very large ones are drawn in tiles.",
                name = name
            ));
            named(
                &response,
                egui::Role::SpinButton,
                tr_format!("Image {name}", name = name),
            );
        }
        if button(ui, tr("Viewport"), tr("Sets the size of the viewport.")) {
            settings.size = viewer.session.project.viewport;
        }
    });
    choice(
        ui,
        tr("Format"),
        tr("PNG has exposure and tone mapping; EXR is linear with premultiplied alpha."),
        &mut settings.format,
        &ImageFormat::ALL.map(|(name, format)| (tr(name), format)),
    );
    choice(
        ui,
        tr("Samples"),
        tr("Samples per pixel along each edge. More give smoother edges."),
        &mut settings.supersample,
        &[("2 x 2", 2), ("1 x 1", 1), ("3 x 3", 3), ("4 x 4", 4)],
    );
    ui.checkbox(&mut settings.transparent, tr("Transparent background"))
        .on_hover_text(tr("Removes the background; a caught shadow stays."));
    choice(
        ui,
        tr("Before and after"),
        tr("Saves the view as shown, or before and after separately."),
        &mut settings.sides,
        &[
            (tr("as shown"), ExportSides::Shown),
            (tr("before and after"), ExportSides::Each),
        ],
    );
}

/// Where pictures go, and what they are called.
fn place(ui: &mut Ui, viewer: &mut Viewer) {
    let settings = &mut viewer.preferences.export;
    ui.horizontal(|ui| {
        let label = name(ui, tr("Folder"));
        let room = ui.available_width() - CHOOSE_WIDTH;
        let field = egui::TextEdit::singleline(&mut settings.folder).desired_width(room);
        ui.add(field)
            .labelled_by(label.id)
            .on_hover_text(tr("Folder for saved images."));
        let choose = ui.button("…").on_hover_text(tr("Choose a folder."));
        named(&choose, egui::Role::Button, tr("Choose the folder"));
        if choose.clicked() {
            ask(
                &mut viewer.session,
                Dialog::Save(SaveKind::Folder, String::new()),
            );
        }
    });
    ui.horizontal(|ui| {
        let label = name(ui, tr("Name"));
        let room = ui.available_width();
        let field = egui::TextEdit::singleline(&mut settings.pattern).desired_width(room);
        ui.add(field).labelled_by(label.id).on_hover_text(tr(
            "Name of images. {splat}, {light}, {view} and {n} (the frame number) are filled in.",
        ));
    });
}

/// Buttons of what can be saved at once.
fn tasks(ui: &mut Ui) -> Option<Task> {
    let mut task = None;
    ui.horizontal_wrapped(|ui| {
        if button(ui, tr("Save image"), tr("Saves the image as shown. (F12)")) {
            task = Some(Task::Screenshot(None));
        }
        let tip = tr(
            "Shows a small preview of the saved image, with depth of field, samples and background.",
        );
        if button(ui, tr("Preview"), tip) {
            task = Some(Task::Preview);
        }
        let tip = tr("Copies the image to the clipboard. (ctrl + shift + C)");
        if button(ui, tr("Copy"), tip) {
            task = Some(Task::Clipboard);
        }
        let tip = tr("Saves one file for each light of the library.");
        if button(ui, tr("One per light"), tip) {
            task = Some(Task::EachLight);
        }
        let tip = tr("Saves one sheet with an image for each light of the library.");
        if button(ui, tr("Contact sheet"), tip) {
            task = Some(Task::ContactSheet);
        }
    });
    task
}

/// A whole turn, in numbered frames or as a film.
fn turntable(ui: &mut Ui, viewer: &mut Viewer) -> Option<Task> {
    let settings = &mut viewer.preferences.export;
    ui.horizontal(|ui| {
        name(ui, tr("Orbit"));
        let drag = number(&mut settings.frames, 2..=10_000).suffix(tr(" frames"));
        let response = ui.add(drag).on_hover_text(tr("Frames of a full turn."));
        named(&response, egui::Role::SpinButton, tr("Turntable frames"));
        ui.selectable_value(&mut settings.turn, Turn::Camera, tr("camera"))
            .on_hover_text(tr("The camera orbits the object."));
        ui.selectable_value(&mut settings.turn, Turn::Light, tr("light"))
            .on_hover_text(tr("The light orbits the object."));
    });
    let formats = [
        (tr("Numbered images"), None),
        (tr("Video (MP4)"), Some(VideoFormat::Mp4)),
        (tr("Video (WebM)"), Some(VideoFormat::WebM)),
        (tr("Video (WebP)"), Some(VideoFormat::WebP)),
    ];
    let can_encode = has_ffmpeg();
    let formats = match can_encode || settings.video.is_some() {
        true => &formats[..],
        false => &formats[..1],
    };
    choice(
        ui,
        tr("Output"),
        tr("Numbered images in the format above, or a video. WebM and WebP can be transparent."),
        &mut settings.video,
        formats,
    );
    if !can_encode {
        ui.weak(tr("Install ffmpeg to save videos."));
    }
    if settings.video.is_some() || viewer.session.project.scene.animation.keys.len() > 1 {
        let drag = number(&mut settings.frame_rate, 1..=240).suffix(tr(" fps"));
        let response = ui.add(drag).on_hover_text(tr("Frame rate of the video."));
        named(&response, egui::Role::SpinButton, tr("Frame rate"));
    }
    let mut task = None;
    ui.horizontal(|ui| {
        if button(ui, tr("Save turntable"), tr("Saves a full turn.")) {
            task = Some(Task::Turntable);
        }
        let has_keys = viewer.session.project.scene.animation.keys.len() > 1;
        ui.add_enabled_ui(has_keys, |ui| {
            let tip = tr("Saves the light animation from the first key to the last.");
            if button(ui, tr("Save animation"), tip) {
                task = Some(Task::Animation);
            }
        });
    });
    task
}
