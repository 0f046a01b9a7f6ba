//! Panel *Camera*.

use eframe::egui::{self, Ui};
use transplat_core::camera::{APERTURE, FIELD_OF_VIEW, FOV};

use crate::viewer::app::Viewer;
use crate::viewer::navigation;
use crate::viewer::session::Session;
use crate::viewer::widgets::{Control, button, name, named, number};
use transplat_engine::language::{tr, tr_format};

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    ui.horizontal_wrapped(|ui| {
        for (name, viewpoint) in navigation::VIEWPOINTS {
            let name = tr(name);
            if button(ui, name, tr("Moves the view to this side.")) {
                navigation::look_from(&mut viewer.session.project.pose, viewpoint);
            }
        }
        if button(ui, tr("Frame"), tr("Shows all of the object. (F)")) {
            viewer.session.project.frame_all();
        }
        let tip = tr("Saves the view in the library. (ctrl + B)");
        if button(ui, tr("Add view"), tip) {
            viewer.session.keep_view();
        }
    });
    let session = &mut viewer.session;
    cameras(ui, session);
    ui.horizontal(|ui| {
        let tip = tr("Parallel lines stay parallel in an orthographic view. (O)");
        ui.selectable_value(
            &mut session.project.pose.orthographic,
            false,
            tr("perspective"),
        )
        .on_hover_text(tip);
        ui.selectable_value(
            &mut session.project.pose.orthographic,
            true,
            tr("orthographic"),
        )
        .on_hover_text(tip);
    });
    let mut fov = session.project.pose.fov;
    let changed = Control {
        label: tr("Field of view"),
        unit: "°",
        tip: tr("Field of view of the shorter edge."),
        decimals: 1,
        ..Control::of(*FOV.start()..=120.0, FIELD_OF_VIEW)
    }
    .show(ui, &mut fov)
    .changed();
    if changed {
        navigation::set_fov(&mut session.project.pose, fov);
    }
    let mut percent = 100.0 * session.project.pose.aperture;
    let last = percent;
    Control {
        label: tr("Depth of field"),
        unit: " %",
        tip: tr("Aperture as a share of the focus distance. Double-click the object to focus. Visible in saved images and Preview."),
        decimals: 2,
        ..Control::of(0.0..=100.0 * *APERTURE.end(), 0.0)
    }
    .show(ui, &mut percent);
    if percent != last {
        session.project.pose.aperture = percent / 100.0;
    }
    ui.checkbox(&mut session.overlays.grid, tr("Grid"))
        .on_hover_text(tr("A grid on the ground. (shift + G)"));
    ui.checkbox(&mut viewer.preferences.probes, tr("Reference balls"))
        .on_hover_text(tr("Shows a grey and a mirror ball under each light. (L)"));
}

/// The cameras of a file that is open.
fn cameras(ui: &mut Ui, session: &mut Session) {
    let Some(open) = &session.project.cameras else {
        return;
    };
    let (count, mut at) = (open.file.frames.len(), open.at + 1);
    let picture = open.file.frames[open.at].picture.clone();
    let mut chosen = false;
    ui.horizontal(|ui| {
        name(ui, tr("Camera"));
        let drag = number(&mut at, 1..=count).suffix(tr_format!(" of {count}", count = count));
        let response = ui.add(drag).on_hover_text(tr(
            "Views through an imported camera, with its photo as backplate.",
        ));
        chosen = response.changed();
        named(&response, egui::Role::SpinButton, tr("Imported camera"));
        chosen |= button(
            ui,
            tr("View through"),
            tr("Returns to the imported camera."),
        );
        ui.weak(picture.unwrap_or_default());
    });
    if chosen {
        session.project.look_through(at - 1);
    }
}
