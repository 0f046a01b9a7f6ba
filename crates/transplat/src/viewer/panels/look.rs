//! Panel *Look*: tone curve, LUT, background, and terms of the transfer.

use std::path::Path;

use eframe::egui::{self, TextEdit, Ui};
use transplat_core::color::ToneMap;
use transplat_core::present::{Background, View};
use transplat_core::scene::{BLUR, DIFFERENCE_SCALE};

use super::transfer;
use crate::viewer::app::Viewer;
use crate::viewer::files::ask;
use crate::viewer::session::{Dialog, SaveKind};
use crate::viewer::widgets::{Control, button, choice, named};
use transplat_engine::language::tr;

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    display(ui, viewer);
    ui.separator();
    background(ui, viewer);
    ui.separator();
    transfer::show(ui, viewer);
    ui.separator();
    kept(ui, viewer);
}

/// The look as one of several, and what is to be known of it.
fn kept(ui: &mut Ui, viewer: &mut Viewer) {
    let tip = tr("Saves light and look in the library. (P also pins it.)");
    if button(ui, tr("Add look"), tip) {
        viewer.session.project.keep_look();
    }
    let label = ui.label(tr("Note"));
    let note = &mut viewer.session.project.scene.note;
    let edit = TextEdit::multiline(note)
        .desired_rows(2)
        .desired_width(f32::INFINITY);
    ui.add(edit)
        .labelled_by(label.id)
        .on_hover_text(tr("Note that is saved with the look."));
}

fn display(ui: &mut Ui, viewer: &mut Viewer) {
    let scene = &mut viewer.session.project.scene;
    Control {
        label: tr("Exposure"),
        unit: tr(" stops"),
        tip: tr("Exposure of the image. The panel Light sets the strength of the light."),
        decimals: 2,
        ..Control::of(-8.0..=8.0, 0.0)
    }
    .show(ui, &mut scene.display.exposure);
    choice(
        ui,
        tr("Tone mapping"),
        tr("Maps bright colours to the screen. sRGB at exposure 0 shows the capture unchanged."),
        &mut scene.display.tone_map,
        &[
            (tr("sRGB"), ToneMap::Srgb),
            (tr("Khronos PBR neutral"), ToneMap::Neutral),
            (tr("AgX"), ToneMap::Agx),
            (tr("ACES"), ToneMap::Aces),
            (tr("none (linear)"), ToneMap::None),
        ],
    );
    lut(ui, viewer);
    let scene = &mut viewer.session.project.scene;
    ui.checkbox(&mut scene.false_color, tr("False-colour exposure"))
        .on_hover_text(tr("Shows stops from middle grey in false colours."));
    if scene.view == View::Difference {
        Control {
            label: tr("Difference scale"),
            tip: tr("Scale of the difference. Grey is none."),
            decimals: 1,
            logarithmic: true,
            ..Control::of(DIFFERENCE_SCALE, 1.0)
        }
        .show(ui, &mut scene.difference_scale);
    }
}

/// The table of colours over the whole picture.
fn lut(ui: &mut Ui, viewer: &mut Viewer) {
    ui.horizontal(|ui| {
        let tip = tr(
            "LUT (.cube) applied last, to the view, saved PNGs and videos. Drop one on the window.",
        );
        if button(ui, tr("LUT…"), tip) {
            ask(
                &mut viewer.session,
                Dialog::Save(SaveKind::Lut, String::new()),
            );
        }
        let file = viewer.session.project.scene.lut.clone();
        let Some(file) = file else {
            ui.weak(tr("none"));
            return;
        };
        let none = ui.button("×").on_hover_text(tr("No LUT."));
        named(&none, egui::Role::Button, tr("No LUT"));
        if none.clicked() {
            viewer.session.project.scene.lut = None;
        }
        ui.weak(file_name(&file))
            .on_hover_text(file.display().to_string());
    });
}

fn file_name(file: &Path) -> String {
    let name = file.file_name().unwrap_or(file.as_os_str());
    name.to_string_lossy().into_owned()
}

fn background(ui: &mut Ui, viewer: &mut Viewer) {
    let scene = &mut viewer.session.project.scene;
    let all = [
        (tr("environment"), Background::Environment),
        (tr("colour"), Background::Color([0.18; 3])),
        (tr("gradient"), Background::Gradient([0.32; 3], [0.12; 3])),
        (tr("checkerboard"), Background::Checker),
        (tr("transparent"), Background::Transparent),
        (tr("photograph"), Background::Backplate),
    ];
    // Of each kind there is one here, whatever its colours are.
    let kind = std::mem::discriminant(&scene.background);
    let mut chosen = scene.background;
    for (_, background) in all {
        if std::mem::discriminant(&background) == kind {
            chosen = background;
        }
    }
    let tip = tr("Background. A transparent one shows as a checkerboard here.");
    if choice(ui, tr("Background"), tip, &mut chosen, &all) {
        scene.background = chosen;
    }
    match &mut scene.background {
        Background::Environment => {
            Control {
                label: tr("Blur"),
                unit: "°",
                tip: tr("Blurs the environment behind the object; the light on it stays."),
                decimals: 1,
                ..Control::of(0.0..=30.0f32.min(*BLUR.end()), 0.3)
            }
            .show(ui, &mut scene.background_blur);
        }
        Background::Color(color) => color_field(ui, tr("Colour"), color),
        Background::Gradient(top, bottom) => {
            color_field(ui, tr("Top"), top);
            color_field(ui, tr("Bottom"), bottom);
        }
        Background::Backplate => plate(ui, viewer),
        Background::Checker | Background::Transparent => {}
    }
    let scene = &mut viewer.session.project.scene;
    ui.checkbox(&mut scene.shadow_catcher, tr("Shadow catcher"))
        .on_hover_text(tr(
            "Catches the object's shadow on the ground, also in saved images.",
        ));
}

/// The photograph behind the objects.
fn plate(ui: &mut Ui, viewer: &mut Viewer) {
    ui.horizontal(|ui| {
        let file = viewer.session.project.scene.plate.as_ref();
        let name = file.map_or(tr("none yet").into(), |file| file_name(file));
        let tip = tr("Photo behind the objects. Drop its transforms.json or COLMAP folder to match the camera.");
        if button(ui, tr("Backplate…"), tip) {
            ask(
                &mut viewer.session,
                Dialog::Save(SaveKind::Backplate, String::new()),
            );
        }
        ui.weak(name);
    });
}

/// A display-encoded colour.
fn color_field(ui: &mut Ui, label: &str, color: &mut [f32; 3]) {
    ui.horizontal(|ui| {
        let mut bytes = color.map(|v| (v * 255.0).round() as u8);
        if ui
            .color_edit_button_srgb(&mut bytes)
            .on_hover_text(tr("Colour of the background."))
            .changed()
        {
            *color = bytes.map(|b| f32::from(b) / 255.0);
        }
        ui.label(label);
    });
}
