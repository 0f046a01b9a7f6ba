//! Objects of the scene: their list, and the place of the selected one.

use std::f32::consts::PI;

use eframe::egui::{self, Ui};
use glam::{EulerRot, Quat};
use transplat_core::scene::{FARTHEST, SCALES, Transform};

use crate::viewer::app::Viewer;
use crate::viewer::session::Session;
use crate::viewer::widgets::{button, name, named, number};
use transplat_engine::language::{tr, tr_format};

/// Characters of a name.
const LONGEST_NAME: usize = 64;

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let session = &mut viewer.session;
    for at in 0..session.project.scene.objects.len() {
        row(ui, session, at);
    }
    ui.horizontal(|ui| {
        ui.checkbox(&mut session.adds_splats, tr("Add to scene")).on_hover_text(
            tr("Adds each opened splat to the scene without asking."),
        );
        ui.checkbox(&mut session.overlays.handles, tr("Handles")).on_hover_text(
            tr("Shows handles on the selected object: arrows move, rings rotate, the circle scales. Ctrl: in steps."),
        );
    });
    ui.horizontal(|ui| {
        if button(
            ui,
            tr("Duplicate"),
            tr("Duplicates the selected object beside it. (ctrl + D)"),
        ) {
            session.project.duplicate(session.selected);
        }
        let several = session.project.scene.objects.len() > 1;
        ui.add_enabled_ui(several && !session.object().locked, |ui| {
            let tip = tr("Removes the selected object. (Delete)");
            if button(ui, tr("Remove"), tip) {
                session.remove_object();
            }
        });
        ui.add_enabled_ui(several, |ui| {
            let tip = tr("Saves the light at the selected object as an environment, and adds it to the library.");
            if button(ui, tr("Save light probe"), tip) {
                session.save_light_here(&viewer.preferences.export.folder);
            }
        });
    });
    rename(ui, session);
    let is_locked = session.object().locked;
    ui.add_enabled_ui(!is_locked, |ui| stand(ui, session));
}

/// An object of the list.
fn row(ui: &mut Ui, session: &mut Session, at: usize) {
    let called = session.project.called(at);
    ui.horizontal(|ui| {
        let object = &mut session.project.scene.objects[at];
        let shown = ui.checkbox(&mut object.shown, "").on_hover_text(tr(
            "Visible. Hidden objects cast no shadow and reflect no light.",
        ));
        named(
            &shown,
            egui::Role::CheckBox,
            tr_format!("Show {called}", called = called),
        );
        let lock = ui
            .selectable_label(object.locked, tr("Lock"))
            .on_hover_text(tr(
                "A locked object stays where it stands, and is not removed.",
            ));
        if lock.clicked() {
            object.locked = !object.locked;
        }
        let chosen = ui.selectable_label(session.selected == at, &called);
        if chosen.clicked() {
            session.selected = at;
        }
        chosen.on_hover_text(tr("Selects this object."));
        if session.project.is_missing(at)
            && button(
                ui,
                tr("Load"),
                tr("The file could not be loaded. Tries again."),
            )
        {
            session.project.load_again(at);
        }
    });
}

/// Field of the selected object's name: layers and files are named so.
fn rename(ui: &mut Ui, session: &mut Session) {
    let called = session.project.called(session.selected);
    ui.horizontal(|ui| {
        name(ui, tr("Name"));
        let object = session.object_mut();
        let mut text = object.name.clone().unwrap_or_default();
        let edit = egui::TextEdit::singleline(&mut text)
            .hint_text(called)
            .char_limit(LONGEST_NAME)
            .desired_width(f32::INFINITY);
        let edit = ui.add(edit);
        if edit.changed() {
            object.name = (!text.trim().is_empty()).then_some(text);
        }
        let tip = tr("Name of the object, its layer and its files.");
        named(&edit.on_hover_text(tip), egui::Role::TextInput, tr("Name"));
    });
}

/// Where the selected object stands.
fn stand(ui: &mut Ui, session: &mut Session) {
    let step = session
        .project
        .scene_bounds()
        .map_or(0.01, |b| b.radius / 200.0);
    let mut transform = session.object().transform;
    ui.horizontal(|ui| {
        name(ui, tr("Position"));
        for (axis, value) in ["x", "y", "z"]
            .into_iter()
            .zip(transform.translation.as_mut())
        {
            let drag = number(value, -FARTHEST..=FARTHEST)
                .speed(step)
                .max_decimals(3)
                .prefix(format!("{axis} "));
            let drag = ui.add(drag).on_hover_text(tr(
                "Position in the coordinates of the first object. Ctrl: in steps.",
            ));
            named(
                &drag,
                egui::Role::SpinButton,
                tr_format!("Position {axis}", axis = axis),
            );
        }
    });
    let (z, y, x) = transform.rotation.to_euler(EulerRot::ZYX);
    // Never minus nothing.
    let mut degrees = [x, y, z].map(|a| (a * 1800.0 / PI).round() / 10.0 + 0.0);
    let mut turned = false;
    ui.horizontal(|ui| {
        name(ui, tr("Rotation"));
        for (axis, value) in ["x", "y", "z"].into_iter().zip(&mut degrees) {
            let drag = number(value, -360.0..=360.0)
                .speed(0.5)
                .max_decimals(1)
                .prefix(format!("{axis} "))
                .suffix("°");
            let drag = ui.add(drag).on_hover_text(tr(
                "Rotation about the scene's axes, x first. Ctrl: in steps.",
            ));
            named(
                &drag,
                egui::Role::SpinButton,
                tr_format!("Rotation {axis}", axis = axis),
            );
            turned |= drag.changed();
        }
    });
    if turned {
        let [x, y, z] = degrees.map(|a| a * PI / 180.0);
        transform.rotation = Quat::from_euler(EulerRot::ZYX, z, y, x).normalize();
    }
    let mut drops = false;
    ui.horizontal(|ui| {
        name(ui, tr("Scale"));
        let speed = 0.005 * transform.scale;
        let scale = number(&mut transform.scale, SCALES);
        let drag = ui.add(scale.speed(speed).max_decimals(4));
        named(
            &drag.on_hover_text(tr("Scale of the object. 1 is as captured.")),
            egui::Role::SpinButton,
            tr("Scale"),
        );
        if button(ui, tr("Reset"), tr("Resets to where it was captured.")) {
            transform = Transform::default();
        }
    });
    ui.horizontal(|ui| {
        name(ui, "");
        let tip = tr("Drops the object onto what is below it.");
        drops = button(ui, tr("Drop to ground"), tip);
    });
    if transform.validate().is_ok() {
        session.object_mut().transform = transform;
    }
    if drops {
        session.project.drop_to_ground(session.selected);
    }
}
