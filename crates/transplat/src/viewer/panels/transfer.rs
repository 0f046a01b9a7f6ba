//! The transfer: its preset, its terms, and what can be doubted of its result.

use eframe::egui::Ui;
use transplat_core::present::Doubt;
use transplat_core::sh::MAX_DEGREE;
use transplat_core::transfer::{EPSILON, TransferSettings};
use transplat_core::visibility::{DEFAULT_DIRECTIONS, DIRECTIONS};

use crate::viewer::annotations::doubt_name;
use crate::viewer::app::Viewer;
use crate::viewer::jobs::Kind;
use crate::viewer::widgets::{Control, fact, name, switch};

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let session = &mut viewer.session;
    ui.horizontal(|ui| {
        name(ui, "Preset");
        ui.label("paper");
    });
    let defaults = TransferSettings::default();
    let transfer = &mut session.look.transfer;
    Control {
        label: "SH degree",
        unit: "",
        tip: "How finely light and visibility are seen: more degrees make shadows and highlights crisper, and cost time.",
        range: 0..=MAX_DEGREE,
        default: defaults.sh_degree,
        decimals: 0,
        logarithmic: false,
    }
    .show(ui, &mut transfer.sh_degree);
    Control {
        label: "Epsilon",
        unit: "",
        tip: "Relative to the source's mean irradiance. More of it calms what was dark in the capture and dampens the relight; less trusts the dark more.",
        range: *EPSILON.start()..=*EPSILON.end(),
        default: defaults.epsilon,
        decimals: 6,
        logarithmic: true,
    }
    .show(ui, &mut transfer.epsilon);
    let terms = &mut transfer.terms;
    switch(
        ui,
        "Self-shadow",
        "The object's own shadows take part in both lights. Off, every surfel sees all of the light.",
        &mut terms.shadow,
    );
    switch(
        ui,
        "Specular",
        "Bands 1 and up: highlights and reflections. Off, the result is matte.",
        &mut terms.specular,
    );
    ui.indent("specular terms", |ui| {
        ui.add_enabled_ui(terms.specular, |ui| {
            switch(
                ui,
                "Reflection",
                "Highlights are mirrored about the normal. Off, they stick to where the light is.",
                &mut terms.reflection,
            );
            switch(
                ui,
                "Attenuation",
                "Each band is as strong as the capture shows it. Off, every surface is a mirror.",
                &mut terms.attenuation,
            );
        });
    });
    let mut directions = viewer.directions_draft.unwrap_or(session.look.directions);
    let response = Control {
        label: "Directions",
        unit: "",
        tip: "Directions that visibility is baked for. More are finer and take longer; the bake runs again.",
        range: *DIRECTIONS.start()..=*DIRECTIONS.end(),
        default: DEFAULT_DIRECTIONS,
        decimals: 0,
        logarithmic: true,
    }
    .show(ui, &mut directions);
    // A bake is too long for every step of a drag.
    if response.dragged() {
        viewer.directions_draft = Some(directions);
    } else {
        viewer.directions_draft = None;
        session.look.directions = directions;
    }
    if session.bake_share < 1.0 && !session.jobs.is_running(Kind::Bake) {
        ui.label("The bake is not finished: shadows are coarse.");
        if ui
            .button("Bake on")
            .on_hover_text("Bakes the object's visibility from the start.")
            .clicked()
        {
            session.rebake();
        }
    }
    ui.separator();
    ui.label("How far the result can be trusted");
    session.wants_doubts = !ui.input(|i| i.pointer.any_down());
    match session.shares {
        Some(shares) => {
            for (doubt, share) in Doubt::ALL.iter().zip(shares) {
                fact(ui, doubt_name(*doubt), format!("{:.1} %", 100.0 * share));
            }
        }
        None => {
            ui.weak("being counted");
        }
    }
    switch(
        ui,
        "Mark them in the picture",
        "Paints doubtful surfels in their colours. (K)",
        &mut session.show_marks,
    );
}
