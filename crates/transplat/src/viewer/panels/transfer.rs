//! Settings of the transfer: preset, numbers and terms.

use eframe::egui::Ui;
use transplat_core::bake::harmonic::{DEFAULT_DIRECTIONS, DIRECTIONS};
use transplat_core::settings::{EPSILON, GLOW_ABOVE, GLOW_RANGE, Method, Terms, TransferSettings};
use transplat_core::sh::MAX_DEGREE;

use crate::viewer::app::Viewer;
use crate::viewer::widgets::{Control, advanced, choice};
use transplat_engine::language::tr;

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let transfer = &mut viewer.session.project.scene.transfer;
    choice(
        ui,
        tr("Method"),
        tr(
            "Directional: crisp shadows, bounced light and highlights. Harmonic: softer and fastest.",
        ),
        &mut transfer.method,
        &[
            (tr("Directional (accurate)"), Method::Directional),
            (tr("Harmonic (TranSplat paper)"), Method::Harmonic),
        ],
    );
    advanced(ui, |ui| numbers_and_terms(ui, viewer));
}

/// Terms that a relight is made of.
fn numbers_and_terms(ui: &mut Ui, viewer: &mut Viewer) {
    let transfer = &mut viewer.session.project.scene.transfer;
    let method = transfer.method;
    // What has no effect now keeps its place, so that nothing moves under the mouse.
    let by_series = method == Method::Harmonic || !transfer.terms.sums;
    ui.add_enabled_ui(by_series, |ui| {
        Control {
            label: tr("SH degree"),
            tip: tr("SH degree of light and visibility. Higher is crisper and slower."),
            ..Control::of(0..=MAX_DEGREE, TransferSettings::default().sh_degree)
        }
        .show(ui, &mut transfer.sh_degree);
    });
    let mut epsilon = transfer.epsilon();
    Control {
        label: tr("Regularization"),
        tip: tr("Reduces noise in areas the capture light barely reached (epsilon). Higher relights less."),
        decimals: 6,
        logarithmic: true,
        ..Control::of(EPSILON, method.epsilon())
    }
    .show(ui, &mut epsilon);
    // The method's own stays the method's own.
    if epsilon != transfer.epsilon() {
        transfer.epsilon = (epsilon != method.epsilon()).then_some(epsilon);
    }
    ui.checkbox(&mut transfer.terms.shadow, tr("Self-shadow"))
        .on_hover_text(tr("Shadows of the object on itself, in both lights."));
    match method {
        Method::Directional => directional_terms(ui, transfer),
        Method::Harmonic => {
            harmonic_terms(ui, &mut transfer.terms);
            directions(ui, viewer);
        }
    }
}

fn directional_terms(ui: &mut Ui, transfer: &mut TransferSettings) {
    let terms = &mut transfer.terms;
    ui.checkbox(&mut terms.sums, tr("Directional integration"))
        .on_hover_text(tr(
            "Integrates light over many directions. Off, by spherical harmonics: softer and faster.",
        ));
    ui.checkbox(&mut terms.suns, tr("Suns"))
        .on_hover_text(tr("Extracts suns from the environment, for crisp shadows."));
    ui.checkbox(&mut terms.bounce, tr("Bounced light"))
        .on_hover_text(tr("Light bounced between Gaussians."));
    ui.checkbox(&mut terms.pixel_shadows, tr("Pixel shadows"))
        .on_hover_text(tr(
            "Traces the edges of shadows at each pixel. Off, a Gaussian is lit or shadowed as a whole.",
        ));
    ui.checkbox(&mut terms.two_sided, tr("Two-sided"))
        .on_hover_text(tr(
            "Lights thin sheets such as leaves from the visible side.",
        ));
    ui.checkbox(&mut terms.lobe, tr("Specular"))
        .on_hover_text(tr(
            "Highlights and reflections, as far as the capture shows them.",
        ));
    ui.checkbox(&mut terms.residual, tr("Residual"))
        .on_hover_text(tr("Keeps captured detail that no other term explains."));
    ui.checkbox(&mut terms.emission, tr("Emission"))
        .on_hover_text(tr(
            "Keeps lamps and screens as bright as captured. Off, they are relit like paint.",
        ));
    ui.add_enabled_ui(terms.emission, |ui| {
        Control {
            label: tr("Emission threshold"),
            tip: tr("Brightness from which a surface counts as a lamp, in multiples of the whitest. See the channel Emission."),
            decimals: 2,
            logarithmic: true,
            ..Control::of(GLOW_RANGE, GLOW_ABOVE)
        }
        .show(ui, &mut transfer.glow_above);
    });
}

fn harmonic_terms(ui: &mut Ui, terms: &mut Terms) {
    ui.checkbox(&mut terms.specular, tr("Specular"))
        .on_hover_text(tr("SH bands 1 and up: highlights and reflections."));
    ui.indent("specular terms", |ui| {
        ui.add_enabled_ui(terms.specular, |ui| {
            ui.checkbox(&mut terms.reflection, tr("Reflection"))
                .on_hover_text(tr("Aligns highlights with the reflected direction."));
            ui.checkbox(&mut terms.attenuation, tr("Attenuation"))
                .on_hover_text(tr(
                    "Limits reflections to what the capture shows. Off, everything is glossy.",
                ));
        });
    });
}

fn directions(ui: &mut Ui, viewer: &mut Viewer) {
    let session = &mut viewer.session;
    let mut directions = viewer
        .directions_draft
        .unwrap_or(session.project.scene.directions);
    let response = Control {
        label: tr("Directions"),
        tip: tr("Directions of the visibility bake. More are finer and take longer."),
        logarithmic: true,
        ..Control::of(DIRECTIONS, DEFAULT_DIRECTIONS)
    }
    .show(ui, &mut directions);
    // A bake is too long for every step of a drag.
    if response.dragged() {
        viewer.directions_draft = Some(directions);
    } else {
        viewer.directions_draft = None;
        session.project.scene.directions = directions;
    }
}
