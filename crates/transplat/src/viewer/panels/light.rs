//! Panel *Light*: capture and target light, their rotation and strength.

use eframe::egui::{self, Button, Role, Ui};
use transplat_core::environment::{ImageReading, Layout, PlaceAndTime, Sun, TURBIDITIES};
use transplat_core::estimate::Advice;
use transplat_core::response::{CameraResponse, ResponseCurve};
use transplat_core::scene::{EVEN, EnvironmentLight, SKY, is_even};
use transplat_core::surfels::UpAxis;

use super::lights::choose_way;
use crate::viewer::app::Viewer;
use crate::viewer::session::{SIDES, Session};
use crate::viewer::tabs::LightPage;
use crate::viewer::viewport::Placing;
use crate::viewer::widgets::{
    Control, advanced, angle, button, choice, fact, file, name, named, number,
};
use transplat_engine::environments::Environment;
use transplat_engine::estimate::instead;
use transplat_engine::language::{tr, tr_format};
use transplat_engine::project::stages::DROP_IT;
use transplat_engine::project::{SOURCE, TARGET};

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    ui.horizontal_wrapped(|ui| {
        let lights = match viewer.session.project.scene.lights.len() {
            0 => tr("Placed lights").to_owned(),
            n => format!("{} {n}", tr("Placed lights")),
        };
        let pages = [
            (LightPage::RelitBy, tr(SIDES[TARGET])),
            (LightPage::Lights, &lights),
            (LightPage::CapturedUnder, tr(SIDES[SOURCE])),
        ];
        // As wide as their names: shared out evenly, the longest would widen the panel.
        for (page, name) in pages {
            if ui
                .add(Button::selectable(viewer.shown.light == page, name))
                .clicked()
            {
                viewer.shown.light = page;
            }
        }
    });
    let side = match viewer.shown.light {
        LightPage::RelitBy => TARGET,
        LightPage::CapturedUnder => SOURCE,
        LightPage::Lights => return super::lights::show(ui, viewer),
    };
    let session = &mut viewer.session;
    let light = session.light(side).clone();
    if side == SOURCE && session.project.scene.objects.len() > 1 {
        ui.strong(session.project.called(session.selected));
    }
    if side == SOURCE && !light.is_file() {
        source_without_file(ui, session);
    } else if !light.is_file() {
        ui.label(light.name());
    } else {
        file(ui, &light.path);
    }
    if side == TARGET {
        sky(ui, session);
    }
    if !light.is_even {
        let turned = viewer.maps[side].show(ui, &mut viewer.session, side);
        viewer.preferences.knows_how_to_turn_the_light |= turned;
    }
    let session = &mut viewer.session;
    for warning in &light.warnings {
        ui.colored_label(ui.visuals().warn_fg_color, warning);
    }
    // It is asked where the picture has not the shape of a panorama, and can be said of any.
    if has_odd_shape(&light) {
        reading(ui, session, side);
    }
    if side == SOURCE {
        other_sources(ui, session);
    }
    let settings = session.side_mut(side);
    angle(
        ui,
        tr("Rotation"),
        if side == SOURCE {
            tr(
                "Rotates the capture light about the up axis until it fits the highlights in the splat.",
            )
        } else {
            tr("Rotates the light about the up axis. (shift + right drag)")
        },
        &mut settings.rotation,
    );
    angle(
        ui,
        tr("Tilt"),
        tr("Tilts the light up or down."),
        &mut settings.tilt,
    );
    Control {
        label: tr("Strength"),
        unit: tr(" stops"),
        tip: if side == SOURCE {
            tr("Strength of the capture light. A stronger one leaves a darker object.")
        } else {
            tr("Strength of the light. The exposure of the image is in the panel Look.")
        },
        decimals: 2,
        ..Control::of(-8.0..=8.0, 0.0)
    }
    .show(ui, &mut settings.strength);
    if side == TARGET {
        match_strength(ui, session);
    }
    let settings = session.side_mut(side);
    ui.horizontal(|ui| {
        name(ui, tr("Tint"));
        egui::Frame::new()
            .stroke(ui.visuals().widgets.noninteractive.bg_stroke)
            .show(ui, |ui| {
                ui.color_edit_button_rgb(&mut settings.tint)
                    .on_hover_text(tr("Tint of the light."));
            });
        if settings.tint != [1.0; 3] && ui.small_button(tr("white")).clicked() {
            settings.tint = [1.0; 3];
        }
    });
    if side == SOURCE {
        by_click(ui, &mut viewer.viewport.placing);
        by_shading(ui, session);
        clipped(ui, session);
        trust(
            ui,
            &mut session.object_mut().source,
            light.illumination.trust,
        );
        camera_response(ui, &mut session.object_mut().response);
    }
    advanced(ui, |ui| lying(ui, viewer, side));
}

/// Sets the capture light by a click on the object.
fn by_click(ui: &mut Ui, placing: &mut Option<Placing>) {
    ui.horizontal_wrapped(|ui| {
        let ways = [
            (
                Placing::White,
                tr("By white"),
                tr("Click what is white on the object: sets strength and tint. Esc ends."),
            ),
            (
                Placing::CapturedHighlight,
                tr("By highlight"),
                tr("Click a highlight of the capture: rotates the light to where it came from. Esc ends."),
            ),
        ];
        choose_way(ui, placing, &ways);
    });
}

/// Rotates a user-set capture light to where it explains the shading of the object.
fn by_shading(ui: &mut Ui, session: &mut Session) {
    let at = session.selected;
    let Some(alignment) = session.project.alignment(at) else {
        return;
    };
    let source = &session.object().source;
    let advice = alignment.advice(source.rotation, source.mirror);
    let text = match advice {
        Advice::Keep => tr("Fits the shading."),
        Advice::Rotate(..) => tr("Contradicts the shading."),
        Advice::Replace => tr("Fits at no rotation."),
    };
    let tip = tr(
        "Rotates the light to where it explains the shading of the object best, and mirrors it where that explains far more.",
    );
    ui.horizontal_wrapped(|ui| {
        if advice != Advice::Replace && button(ui, tr("Rotate to fit"), tip) {
            session.project.align_source(at);
        }
        match advice {
            Advice::Keep => ui.weak(text),
            Advice::Rotate(..) | Advice::Replace => {
                ui.colored_label(ui.visuals().warn_fg_color, text)
            }
        };
    });
}

/// Switches the completion of a clipped panorama.
fn clipped(ui: &mut Ui, session: &mut Session) {
    let Some(was_clipped) = session.project.is_source_clipped(session.selected) else {
        return;
    };
    let mut is_clipped = was_clipped;
    ui.checkbox(&mut is_clipped, tr("Complete clipped highlights"))
        .on_hover_text(tr(
            "The highlights of this image are clipped, as those of photographs are. How bright they were is estimated from the shading of the object.",
        ));
    if is_clipped != was_clipped {
        session.object_mut().source.clipped = Some(is_clipped);
    }
}

/// Trust in the capture light, by its confidence where nobody set it.
fn trust(ui: &mut Ui, source: &mut EnvironmentLight, by_confidence: f32) {
    let mut percent = 100.0 * source.trust.unwrap_or(by_confidence);
    let before = percent;
    Control {
        label: tr("Trust"),
        unit: " %",
        tip: tr(
            "How much of the captured light is replaced. An estimate is trusted by its confidence; what is left keeps the captured shading.",
        ),
        ..Control::of(0.0..=100.0, 100.0 * by_confidence)
    }
    .show(ui, &mut percent);
    if percent != before {
        source.trust = Some(percent / 100.0);
    }
    let is_partly = percent < 99.5;
    if is_partly && ui.small_button(tr("Use 100 %")).clicked() {
        source.trust = Some(1.0);
    }
}

/// Curve and contrast of the camera that the splat was captured with.
fn camera_response(ui: &mut Ui, response: &mut CameraResponse) {
    ui.separator();
    let tip = tr("Tone curve that the training images were stored with. It is undone.");

    choice(
        ui,
        tr("Tone curve"),
        tip,
        &mut response.curve,
        &ResponseCurve::ALL,
    );
    Control {
        label: tr("Contrast"),
        tip: tr(
            "Contrast of the capture over that of the scene. It is undone. A phone's automatic mode has about 1.3.",
        ),
        decimals: 2,
        ..Control::of(0.5..=2.0, 1.0)
    }
    .show(ui, &mut response.contrast);
}

/// Suns of the picture as lights of one's own, or in it again.
fn suns(ui: &mut Ui, session: &mut Session) {
    if session.project.scene.environment.without_suns {
        let tip = tr("Restores the suns of the environment. Edited suns stay as placed lights.");
        if button(ui, tr("Restore suns"), tip) {
            session.put_suns_back();
        }
        return;
    }
    let tip = tr(
        "Turns the suns of the environment into placed lights that you can edit. The sky stays.",
    );
    if button(ui, tr("Convert suns to lights"), tip) {
        session.take_out_suns();
    }
}

/// Settings of the map's mirror and up axis, and of what it is locked to.
fn lying(ui: &mut Ui, viewer: &mut Viewer, side: usize) {
    let session = &mut viewer.session;
    let settings = session.side_mut(side);
    ui.checkbox(&mut settings.mirror, tr("Mirrored"))
        .on_hover_text(tr("Mirrors the environment left to right."));
    let tip = tr("Up axis of the map; +z is an upright panorama.");
    let mut axes = UpAxis::ALL;
    axes.sort_by_key(|(_, axis)| *axis != UpAxis::default());
    choice(ui, tr("Up in the map"), tip, &mut settings.up, &axes);
    let light = session.light(side).clone();
    if light.is_file() && !has_odd_shape(&light) {
        reading(ui, session, side);
    }
    if side == TARGET {
        let locked = &mut viewer.viewport.light_locked_to_camera;
        let response = ui
            .horizontal(|ui| {
                name(ui, tr("Attach to"));
                let world = ui.selectable_value(locked, false, tr("world"));
                world | ui.selectable_value(locked, true, tr("camera"))
            })
            .inner;
        response.on_hover_text(tr("Rotates the light with the camera."));
    }
    if side == TARGET && light.is_file() {
        suns(ui, session);
    }
    if light.size[0] > 0 {
        let size = tr_format!("{} x {} pixels", light.size[0], light.size[1]);
        fact(ui, tr("holds"), size);
    }
    if side == TARGET && !is_even(&light.path) && ui.button(tr("Use uniform white")).clicked() {
        session.set_light(side, EVEN.into());
    }
}

/// Where the sun stands, and how clear the air is; or a button that takes sun and sky.
fn sky(ui: &mut Ui, session: &mut Session) {
    let Some(mut sky) = session.project.scene.environment.sky() else {
        let tip = tr("Physical sun and sky, by azimuth and elevation or by location and time.");
        if button(ui, tr("Sun and sky"), tip) {
            session.set_light(TARGET, SKY.into());
            // It is as bright as the hour makes it.
            session.project.scene.match_strength = false;
        }
        return;
    };
    let [azimuth, elevation] = sky.sun.angles();
    let mut is_of_place = matches!(sky.sun, Sun::Of(_));
    let ways = [(tr("Manual"), false), (tr("By date and location"), true)];
    let tip = tr("Sets the sun by angles, or by date and location (+Y is north).");
    if choice(ui, tr("Sun"), tip, &mut is_of_place, &ways) {
        sky.sun = match is_of_place {
            true => Sun::SOMEWHERE,
            false => Sun::At { azimuth, elevation },
        };
    }
    match &mut sky.sun {
        Sun::At { azimuth, elevation } => {
            let tip = tr("Azimuth of the sun: 0° is east, 90° north.");
            angle(ui, tr("Azimuth"), tip, azimuth);
            Control {
                label: tr("Elevation"),
                unit: "°",
                tip: tr("Elevation of the sun. Below 0° it is dusk."),
                decimals: 1,
                ..Control::of(-12.0..=90.0, 40.0)
            }
            .show(ui, elevation);
        }
        Sun::Of(of) => {
            place_and_time(ui, of);
            let stands = match elevation < 0.0 {
                true => tr_format!("{:.0}° below the horizon", -elevation),
                false => tr_format!("{elevation:.0}° above the horizon", elevation = elevation),
            };
            fact(ui, tr("sun"), stands);
        }
    }
    Control {
        label: tr("Haze"),
        tip: tr("Turbidity of the air: 2 is very clear, 3 clear, 6 hazy, 10 misty."),
        decimals: 1,
        ..Control::of(TURBIDITIES, 3.0)
    }
    .show(ui, &mut sky.turbidity);
    Control {
        label: tr("Ground"),
        tip: tr("Albedo of the ground: snow 0.8, sand 0.4, grass 0.2."),
        decimals: 2,
        ..Control::of(0.0..=1.0, 0.2)
    }
    .show(ui, &mut sky.ground_albedo);
    ui.checkbox(&mut sky.sun_shines, tr("Sun"))
        .on_hover_text(tr("Adds the sun to the sky."));
    let environment = &mut session.project.scene.environment;
    if environment.sky != Some(sky) && environment.sky() != Some(sky) {
        environment.sky = Some(sky);
    }
}

/// Place, day and clock that the sun is seen by.
fn place_and_time(ui: &mut Ui, of: &mut PlaceAndTime) {
    Control {
        label: tr("Time of day"),
        unit: tr(" h"),
        tip: tr("Local time in hours."),
        decimals: 2,
        ..Control::of(0.0..=24.0, 12.0)
    }
    .show(ui, &mut of.hour);
    Control {
        label: tr("Month"),
        tip: tr("Month of the year."),
        ..Control::of(1..=12, 6)
    }
    .show(ui, &mut of.date.month);
    let days = of.date.days_of_month();
    Control {
        label: tr("Day"),
        tip: tr("Day of the month."),
        ..Control::of(1..=days, 21)
    }
    .show(ui, &mut of.date.day);
    of.date.day = of.date.day.min(days);
    ui.horizontal(|ui| {
        name(ui, tr("Location"));
        let degrees = |ui: &mut Ui, value: &mut f64, most: f64, text: &str, tip: &str| {
            let drag = number(value, -most..=most)
                .speed(0.1)
                .max_decimals(2)
                .prefix(text)
                .suffix("°");
            let drag = ui.add(drag).on_hover_text(tip);
            named(&drag, Role::SpinButton, tip);
        };
        let (north, east) = (tr("north "), tr("east "));
        degrees(
            ui,
            &mut of.latitude,
            90.0,
            north,
            tr("Degrees north of the equator."),
        );
        degrees(
            ui,
            &mut of.longitude,
            180.0,
            east,
            tr("Degrees east of Greenwich."),
        );
    });
    ui.horizontal(|ui| {
        name(ui, tr("Time zone"));
        let drag = number(&mut of.utc_offset, -14.0..=14.0)
            .speed(0.05)
            .max_decimals(2)
            .prefix("UTC ");
        let tip = tr("Hours ahead of UTC.");
        named(&ui.add(drag).on_hover_text(tip), Role::SpinButton, tip);
    });
}

/// True where a light's file may be meant otherwise: its image is not twice as wide as high, or one of several layers.
fn has_odd_shape(light: &Environment) -> bool {
    light.is_file() && (light.size[0] != 2 * light.size[1] || light.layers.len() > 1)
}

/// Settings of reading a light's file: layer and layout.
fn reading(ui: &mut Ui, session: &mut Session, side: usize) {
    let mut reading = session.side_mut(side).reading();
    let layers = session.light(side).layers.clone();
    if layers.len() > 1 {
        let named = |layer: &String| match layer.is_empty() {
            true => tr("unnamed").to_owned(),
            false => layer.clone(),
        };
        let names: Vec<String> = layers.iter().map(named).collect();
        let names = names.iter().map(String::as_str);
        let each = names.zip(layers.iter().cloned().map(Some));
        let choices: Vec<_> = [(tr("from its name"), None)]
            .into_iter()
            .chain(each)
            .collect();
        let tip = tr("Layer of the OpenEXR file.");
        if choice(ui, tr("Layer"), tip, &mut reading.layer, &choices) {
            session.set_reading(side, &reading);
        }
    }
    let mut layout = reading.layout;
    let layouts = [
        (tr("from its shape"), None),
        (tr("panorama"), Some(Layout::Equirectangular)),
        (tr("cube cross"), Some(Layout::CubeCross)),
        (tr("cube column"), Some(Layout::CubeColumn)),
        (tr("angular map"), Some(Layout::AngularMap)),
        (tr("mirror ball"), Some(Layout::MirrorBall)),
    ];
    let tip = tr(
        "Layout of the image: panorama, cube cross, cube column, angular map, or the photograph of a mirror ball cut to its outline.",
    );
    if choice(ui, tr("Layout"), tip, &mut layout, &layouts) {
        session.set_reading(side, &ImageReading { layout, ..reading });
    }
}

/// Stand-ins for the capture light without a file.
fn other_sources(ui: &mut Ui, session: &mut Session) {
    let is_wished = session.object().source.is_estimate();
    let is_there = session.estimate().is_some() || is_on_its_way(session);
    let even = session.object().source.file.as_deref().is_some_and(is_even);
    ui.horizontal_wrapped(|ui| {
        let tip = tr("Light estimated from the object's shading.");
        if !(is_wished && is_there) && button(ui, tr("Estimate from the object"), tip) {
            session.ask_for_estimate();
        }
        let tip = tr("Treats the capture light as uniform white. Captured shading stays under the new light.");
        if !even && button(ui, tr("Use uniform white"), tip) {
            session.set_light(SOURCE, EVEN.into());
        }
    });
}

fn is_on_its_way(session: &Session) -> bool {
    session.object().source.is_estimate() && session.project.is_estimating(session.selected)
}

/// Explains the capture light where nobody set it.
fn source_without_file(ui: &mut Ui, session: &mut Session) {
    let estimate = session.estimate();
    let estimate = estimate.filter(|_| session.object().source.is_estimate());
    ui.label(match estimate {
        _ if is_on_its_way(session) => tr("Unknown: being estimated from the object."),
        Some(estimate) if estimate.light.shown.is_some() => {
            tr("Estimated from the object and the rest of its capture.")
        }
        Some(estimate) if estimate.is_told() => tr("Estimated from the object."),
        Some(_) => tr("Could not be estimated from this object."),
        None if session.object().source.is_estimate() => tr("Unknown."),
        None => tr("Unknown: uniform white is assumed."),
    });
    if let Some(estimate) = estimate {
        if estimate.may_lie_on_its_side(session.up()) {
            ui.weak(tr(
                "Most light comes from the side or below: check the up axis (panel Objects).",
            ));
        }
        match estimate.obstacle {
            Some(obstacle) => {
                let so = instead(session.project.scene.transfer.method, obstacle);
                ui.weak(tr_format!(
                    "{reason}: {so}.",
                    reason = obstacle.reason(),
                    so = so
                ));
            }
            None => {
                fact(ui, tr("confidence"), format!("{:.0} %", estimate.percent()));
                let sun = if estimate.light.sun.is_some() {
                    tr("found")
                } else {
                    tr("none found")
                };
                fact(ui, tr("sun"), sun);
                if estimate.light.shown.is_none() {
                    ui.weak(tr("Strength and tint are guesses. Adjust them below."));
                }
            }
        }
    }
    let part = (session.state().asset.as_ref()).and_then(|asset| asset.part.as_ref());
    let is_enclosed = part.is_some_and(|part| part.enclosing_light.is_some());
    if is_enclosed && !session.project.is_isolated(session.selected) {
        ui.weak(tr(
            "Hide or remove the rest of the capture: the light estimate then uses it.",
        ));
    }
    ui.weak(tr(DROP_IT));
}

fn match_strength(ui: &mut Ui, session: &mut Session) {
    let text = tr("Match exposure");
    ui.checkbox(&mut session.project.scene.match_strength, text).on_hover_text(tr("Scales the new light to the mean irradiance of the capture light. The strength above comes on top. (M)"));
    // In a line of its own, so that nothing moves as it changes.
    let difference = match session.stops_over_source() {
        Some(stops) if stops.abs() < 0.05 => tr("As strong as the capture light").into(),
        Some(stops) => {
            let by = stops.abs();
            match stops < 0.0 {
                true => tr_format!("{:.1} stops darker than the capture light", by),
                false => tr_format!("{:.1} stops brighter than the capture light", by),
            }
        }
        None => String::new(),
    };
    ui.weak(difference);
}
