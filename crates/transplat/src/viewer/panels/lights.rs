//! Page *lights* of the panel *Light*: placed lights.

use eframe::egui::{self, Role, Ui};
use glam::DVec3;
use transplat_core::scene::{FixedTo, Light, LightKind, LightSource, RigTarget, SUN_DEG};

use crate::viewer::app::Viewer;
use crate::viewer::files::ask;
use crate::viewer::light_handles::color_of;
use crate::viewer::rigs::{RIGS, called, kind_name};
use crate::viewer::session::{Dialog, SaveKind, Session};
use crate::viewer::viewport::Placing;
use crate::viewer::widgets::{Control, angle, choice, entry, name, named, number};
use transplat_engine::language::{tr, tr_format};

/// Characters of a name.
const LONGEST_NAME: usize = 64;

/// Kelvin that a slider shows; daylight is in the middle of what is asked for.
const SHOWN_KELVIN: std::ops::RangeInclusive<f32> = 1500.0..=12_000.0;
const DAYLIGHT: f32 = 5600.0;

/// Distances that a slider puts a light at, in radii of all that is shown.
const AWAY: std::ops::RangeInclusive<f64> = 0.1..=30.0;

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    map(ui, viewer);
    ui.horizontal(|ui| {
        ui.menu_button(tr("Add a light"), |ui| {
            for kind in LightKind::ALL {
                if entry(ui, kind_name(kind)) {
                    viewer.session.add_light(kind);
                }
            }
        });
        ui.menu_button(tr("Rigs"), |ui| rigs(ui, viewer));
        ui.checkbox(&mut viewer.session.overlays.light_handles, tr("Handles"))
            .on_hover_text(tr("Shows handles on placed lights: drag a light around its target, its arrow in and out, the cross to aim."));
    });
    let session = &mut viewer.session;
    if session.project.scene.lights.is_empty() {
        ui.weak(tr(
            "No placed lights yet. They add to the new light and cast shadows.",
        ));
        return;
    }
    list(ui, session);
    ui.separator();
    let Some(at) = session.chosen_light() else {
        return;
    };
    rename(ui, session, at);
    how_bright(ui, &mut session.project.scene.lights[at]);
    let placing = &mut viewer.viewport.placing;
    where_it_is(ui, session, at);
    let RigTarget { radius, .. } = session.lit();
    extent(ui, &mut session.project.scene.lights[at].source, radius);
    by_click(ui, placing);
    fixed_to(ui, session, at);
}

/// The lights as directions around what they shine at.
fn map(ui: &mut Ui, viewer: &mut Viewer) {
    let session = &mut viewer.session;
    let (RigTarget { center, .. }, chosen) = (session.lit(), session.chosen_light());
    let lights = session.project.scene.lights.iter().enumerate();
    let lights: Vec<_> = lights
        .filter(|(_, light)| light.on)
        .map(|(at, light)| {
            let toward = toward(light, center).as_vec3();
            (toward, color_of(light), chosen == Some(at))
        })
        .collect();
    let pointed = viewer.rig_map.show_lights(ui, session, lights.into_iter());
    if let (Some(toward), Some(at)) = (pointed, chosen) {
        let aim = session.project.scene.lights[at].source.aim(center);
        session.put_light(at, aim, toward.as_dvec3(), 0.0);
    }
}

/// Unit vector from what a light shines at towards it.
fn toward(light: &Light, center: DVec3) -> DVec3 {
    let source = &light.source;
    match source.position() {
        Some(position) => (position - source.aim(center)).normalize_or(DVec3::Z),
        None => -source.direction().unwrap_or(-DVec3::Z),
    }
}

fn rigs(ui: &mut Ui, viewer: &mut Viewer) {
    for (preset, name) in RIGS {
        if entry(ui, tr(name)) {
            viewer.session.take_preset(preset);
        }
    }
    ui.separator();
    if entry(ui, tr("Open…")) {
        let dialog = Dialog::Save(SaveKind::OpenRig, String::new());
        ask(&mut viewer.session, dialog);
    }
    ui.add_enabled_ui(!viewer.session.project.scene.lights.is_empty(), |ui| {
        if entry(ui, tr("Save rig…")) {
            let dialog = Dialog::Save(SaveKind::Rig, "rig.json".into());
            ask(&mut viewer.session, dialog);
        }
        if entry(ui, tr("Save as environment…")) {
            let name = format!("{}_light.exr", viewer.asset_name());
            let dialog = Dialog::Save(SaveKind::Environment, name);
            ask(&mut viewer.session, dialog);
        }
        if entry(ui, tr("Remove all")) {
            viewer.session.project.scene.set_lights(Vec::new());
        }
    });
}

fn list(ui: &mut Ui, session: &mut Session) {
    let chosen = session.chosen_light();
    let (mut removed, mut doubled) = (None, None);
    for at in 0..session.project.scene.lights.len() {
        let light = &mut session.project.scene.lights[at];
        let title = called(light).to_owned();
        ui.horizontal(|ui| {
            let on = ui
                .checkbox(&mut light.on, "")
                .on_hover_text(tr("On or off."));
            let label = tr_format!("Turn on {called}", called = title);
            named(&on, Role::CheckBox, label);
            let solo = ui
                .selectable_label(light.solo, tr("solo"))
                .on_hover_text(tr("Only solo lights are on, without the environment."));
            if solo.clicked() {
                light.solo = !light.solo;
            }
            let (dot, _) = ui.allocate_exact_size(egui::vec2(12.0, 12.0), egui::Sense::hover());
            ui.painter()
                .circle_filled(dot.center(), 5.0, color_of(light));
            let row = ui.selectable_label(chosen == Some(at), called(light));
            if row.clicked() {
                session.selected_light = at;
            }
            row.on_hover_text(tr("Selects this light."));
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                let small = |ui: &mut Ui, text: &str, name: String, tip: &str| {
                    let button = ui.small_button(text).on_hover_text(tip);
                    named(&button, Role::Button, name);
                    button.clicked()
                };
                let name = tr_format!("Remove {called}", called = title);
                if small(ui, "×", name, tr("Removes the light.")) {
                    removed = Some(at);
                }
                let name = tr_format!("Duplicate {called}", called = title);
                if small(ui, "+", name, tr("Duplicates the light.")) {
                    doubled = Some(at);
                }
            });
        });
    }
    if let Some(at) = doubled {
        session.duplicate_light(at);
    }
    if let Some(at) = removed {
        session.project.scene.remove_light(at);
        if session.selected_light > at {
            session.selected_light -= 1;
        }
    }
}

fn rename(ui: &mut Ui, session: &mut Session, at: usize) {
    let light = &mut session.project.scene.lights[at];
    ui.horizontal(|ui| {
        name(ui, tr("Name"));
        let edit = egui::TextEdit::singleline(&mut light.name)
            .hint_text(kind_name(light.source.kind()))
            .char_limit(LONGEST_NAME)
            .desired_width(f32::INFINITY);
        let edit = ui.add(edit);
        named(&edit, Role::TextInput, tr("Name"));
    });
}

/// Strength and colour.
fn how_bright(ui: &mut Ui, light: &mut Light) {
    Control {
        label: tr("Strength"),
        unit: tr(" stops"),
        tip: tr("Strength in stops, on top of the power."),
        decimals: 2,
        ..Control::of(-8.0..=8.0, 0.0)
    }
    .show(ui, &mut light.strength);
    ui.horizontal(|ui| {
        name(ui, tr("Power"));
        let unit = light.source.kind().unit();
        let emission = light.source.emission_mut();
        let most = emission.iter().copied().fold(0.0, f32::max);
        let mut shown = most;
        let speed = f64::from(0.01 * most.max(1e-3));
        let drag = number(&mut shown, 0.0..=1e30)
            .speed(speed)
            .max_decimals(4)
            .suffix(format!(" {unit}"));
        let drag = ui
            .add(drag)
            .on_hover_text(tr("Power of the light, before its strength."));
        named(&drag, Role::SpinButton, tr("Power"));
        if drag.changed() && shown != most {
            *emission = if most > 0.0 {
                emission.map(|e| e * (shown / most))
            } else {
                [shown; 3]
            };
        }
    });
    ui.horizontal(|ui| {
        name(ui, tr("Colour"));
        let mut has_kelvin = light.kelvin.is_some();
        let check = ui.checkbox(&mut has_kelvin, tr("warmth")).on_hover_text(tr(
            "Colour temperature: candles 1900 K, bulbs 2800 K, daylight 5600 K, shade 8000 K.",
        ));
        if check.changed() {
            light.kelvin = has_kelvin.then_some(DAYLIGHT);
        }
        egui::Frame::new()
            .stroke(ui.visuals().widgets.noninteractive.bg_stroke)
            .show(ui, |ui| {
                ui.color_edit_button_rgb(&mut light.tint)
                    .on_hover_text(tr("Tint of the light."));
            });
        if light.tint != [1.0; 3] && ui.small_button(tr("white")).clicked() {
            light.tint = [1.0; 3];
        }
    });
    if let Some(kelvin) = &mut light.kelvin {
        let tip = tr("Lower is redder, higher is bluer.");
        Control {
            label: tr("Temperature"),
            unit: " K",
            tip,
            logarithmic: true,
            ..Control::of(SHOWN_KELVIN, DAYLIGHT)
        }
        .show(ui, kelvin);
    }
}

/// Where it stands, as seen from what it shines at, and in the world.
fn where_it_is(ui: &mut Ui, session: &mut Session, at: usize) {
    let RigTarget { center, radius, .. } = session.lit();
    let light = &session.project.scene.lights[at];
    let aim = light.source.aim(center);
    let toward = toward(light, center);
    let azimuth = toward.y.atan2(toward.x).to_degrees();
    let height = toward.z.clamp(-1.0, 1.0).asin().to_degrees();
    let (mut new_azimuth, mut new_height) = (azimuth, height);
    angle(
        ui,
        tr("Azimuth"),
        tr("Azimuth of the light."),
        &mut new_azimuth,
    );
    Control {
        label: tr("Elevation"),
        unit: "°",
        tip: tr("Elevation of the light seen from its target."),
        decimals: 1,
        ..Control::of(-89.0..=89.0, 30.0)
    }
    .show(ui, &mut new_height);
    if (new_azimuth - azimuth).abs() > 1e-6 || new_height != height {
        let (sin, cos) = new_height.to_radians().sin_cos();
        let turn = new_azimuth.to_radians();
        let toward = DVec3::new(cos * turn.cos(), cos * turn.sin(), sin);
        session.put_light(at, aim, toward, 0.0);
    }
    let source = &mut session.project.scene.lights[at].source;
    let Some(position) = source.position() else {
        return;
    };
    let away = position.distance(aim);
    let mut radii = away / radius;
    Control {
        label: tr("Distance"),
        unit: "",
        tip: tr("Distance from the target, in radii of the scene."),
        decimals: 2,
        logarithmic: true,
        ..Control::of(AWAY, 3.0)
    }
    .show(ui, &mut radii);
    if (radii * radius - away).abs() > 1e-9 * away && radii > 0.0 {
        source.put(aim + radii * radius * toward, aim);
    }
    let mut place = source.position().unwrap_or_default();
    ui.horizontal(|ui| {
        name(ui, tr("Position"));
        let axes = ["x", "y", "z"].into_iter().zip(place.as_mut());
        for (axis, value) in axes {
            let decimals = (3.0 - radius.log10()).clamp(0.0, 9.0) as usize;
            let drag = number(value, -1e12..=1e12)
                .speed(radius / 200.0)
                .max_decimals(decimals)
                .prefix(format!("{axis} "));
            let drag = ui
                .add(drag)
                .on_hover_text(tr("Position in the world, z up, in scene units."));
            named(
                &drag,
                Role::SpinButton,
                tr_format!("Position {axis}", axis = axis),
            );
        }
    });
    if source.position() != Some(place) {
        source.put(place, aim);
    }
}

/// Slider of a light's size, or of its cone's angle.
fn extent(ui: &mut Ui, source: &mut LightSource, radius: f64) {
    let length = |ui: &mut Ui, label: &str, value: &mut f64| {
        Control {
            label,
            tip: tr("Size of the light in scene units. Larger lights cast softer shadows at the same power."),
            decimals: 3,
            logarithmic: true,
            ..Control::of(0.02 * radius..=10.0 * radius, radius)
        }
        .show(ui, value);
    };
    if let Some(before) = source.size() {
        let mut size = before;
        if source.kind() == LightKind::Disc {
            length(ui, tr("Diameter"), &mut size[0]);
            size[1] = size[0];
        } else {
            length(ui, tr("Width"), &mut size[0]);
            length(ui, tr("Height"), &mut size[1]);
        }
        if size != before && size.iter().all(|s| *s > 0.0) {
            source.resize(size);
        }
    }
    match source {
        LightSource::Directional { angle_deg, .. } => {
            Control {
                label: tr("Disc"),
                unit: "°",
                tip: tr("Angular diameter; the sun's is 0.53°. Wider suns cast softer shadows."),
                decimals: 2,
                ..Control::of(0.0..=20.0, SUN_DEG)
            }
            .show(ui, angle_deg);
        }
        LightSource::Spot {
            cutoff_deg,
            beam_deg,
            ..
        } => {
            let mut soft = 1.0 - *beam_deg / cutoff_deg.max(1e-6);
            let before = (*cutoff_deg, soft);
            Control {
                label: tr("Cone"),
                unit: "°",
                tip: tr("Angle from the axis to the edge of the cone."),
                decimals: 1,
                ..Control::of(1.0..=85.0, 25.0)
            }
            .show(ui, cutoff_deg);
            Control {
                label: tr("Soft edge"),
                tip: tr("Softness of the edge; 0 is hard."),
                decimals: 2,
                ..Control::of(0.0..=1.0, 0.3)
            }
            .show(ui, &mut soft);
            if before != (*cutoff_deg, soft) {
                *beam_deg = (1.0 - soft).clamp(0.0, 1.0) * *cutoff_deg;
            }
        }
        _ => {}
    }
}

/// Placed by a click or a drag in the picture.
fn by_click(ui: &mut Ui, placing: &mut Option<Placing>) {
    ui.horizontal_wrapped(|ui| {
        let ways = [
            (
                Placing::Highlight,
                tr("By highlight"),
                tr("Click or drag on the object where the light should reflect. Esc ends."),
            ),
            (
                Placing::Shadow,
                tr("By shadow"),
                tr("Drag from the shadow caster to where its shadow should fall. Esc ends."),
            ),
            (
                Placing::Aim,
                tr("Aim"),
                tr("Click on the object to aim the light there. Esc ends."),
            ),
        ];
        choose_way(ui, placing, &ways);
    });
}

/// Buttons of the ways that the next click on an object may set a light, each with its name and tip.
pub fn choose_way(ui: &mut Ui, placing: &mut Option<Placing>, ways: &[(Placing, &str, &str)]) {
    for (way, text, tip) in ways {
        let is_on = *placing == Some(*way);
        if ui
            .selectable_label(is_on, *text)
            .on_hover_text(*tip)
            .clicked()
        {
            *placing = (!is_on).then_some(*way);
        }
    }
}

fn fixed_to(ui: &mut Ui, session: &mut Session, at: usize) {
    let objects: Vec<String> = (0..session.project.scene.objects.len())
        .map(|of| session.project.called(of))
        .collect();
    let mut options = vec![
        (tr("world"), FixedTo::World),
        (tr("camera"), FixedTo::Camera),
    ];
    let each = objects.iter().enumerate();
    options.extend(each.map(|(of, called)| (called.as_str(), FixedTo::Object(of))));
    let tip = tr("Moves the light along with the camera or an object.");
    let light = &mut session.project.scene.lights[at];
    choice(ui, tr("Attach to"), tip, &mut light.fixed_to, &options);
}
