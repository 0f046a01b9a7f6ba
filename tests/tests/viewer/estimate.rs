//! A splat whose light nobody tells.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use super::named::choose_side;
use eframe::egui;
use egui_kittest::kittest::Queryable;
use glam::{DMat3, DQuat, DVec3};
use transplat::viewer::Task;
use transplat_core::estimate::LEAST_TRUST;
use transplat_core::files::{load_splat, write_splat};
use transplat_core::response::CameraResponse;
use transplat_core::settings::Method;
use transplat_core::surfels::UpAxis;
use transplat_core::synthetic;
use transplat_tests::driver::{Driver, PATIENCE};
use transplat_tests::{asset, run_json, small_splat};

/// Opens a splat of which nobody says what it was captured under.
fn open_own(d: &mut Driver) -> PathBuf {
    let own = d.folder.path("own.ply");
    fs::copy(asset("teapot.ply"), &own).expect("room for it");
    d.viewer().open(&own);
    own
}

#[test]
fn the_light_is_estimated_where_nobody_tells_it() {
    let mut d = Driver::bundled();
    open_own(&mut d);
    d.settle();
    d.harness
        .get_by_label("Capture light: estimated from the object");
    let session = &d.viewer().session;
    let estimate = session.estimate().cloned().expect("it was asked");
    assert!(estimate.is_told() && estimate.confidence > 0.9);
    assert!(!session.source_is_assumed() && session.canvas.live().has_relit(0));
    assert!(d.folder.path("own.ply.best.light").exists(), "it is kept");
    let toward = |d: &mut Driver| {
        let [source, _] = d.viewer().session.oriented_lights();
        source
            .light
            .light_samples
            .clone()
            .expect("read for best")
            .suns[0]
            .direction
    };
    let before = toward(&mut d);
    // Wherever the asset's up is said to be, its light shines on it from where it did.
    d.after(|v| v.session.object_mut().up = Some(UpAxis::MinusY));
    assert!(toward(&mut d).dot(before) > 0.999);
    for (light, is_even) in [("even", true), ("estimate", false)] {
        d.after(|v| v.session.set_light(0, light.into()));
        assert_eq!(d.viewer().session.source_is_assumed(), is_even);
    }
}

/// The bundled teapot was captured under its city as that lies in its file.
#[test]
fn a_capture_light_that_contradicts_the_object_is_rotated_by_a_click() {
    let mut d = Driver::bundled();
    let rotation = |d: &mut Driver| d.viewer().session.object().source.rotation;
    d.click("Light");
    choose_side(&mut d, "Capture light");
    d.harness.get_by_label("Fits the shading.");
    d.after(|v| v.session.object_mut().source.rotation = 140.0);
    d.harness.get_by_label("Contradicts the shading.");
    d.click("Rotate to fit");
    // Steps of 10 degrees, and a parabola between them.
    assert!(rotation(&mut d).abs() < 3.0, "{}", rotation(&mut d));
    // A light that comes rotated is compared by itself, and the message rotates it.
    d.after(|v| {
        let source = &mut v.session.object_mut().source;
        (source.rotation, source.tilt) = (-70.0, 1.0);
    });
    let warning = "The capture light contradicts the shading of teapot at this rotation.";
    d.harness.get_by_label(warning);
    d.click("Rotate it");
    assert!(rotation(&mut d).abs() < 3.0, "{}", rotation(&mut d));
    d.harness.get_by_label("Fits the shading.");
}

#[test]
fn where_it_cannot_be_told_even_light_stands_in_by_half_and_the_setting_stays() {
    let mut d = Driver::bundled();
    let few = d.folder.write("few.ply", small_splat(30));
    d.after(|v| v.open(Path::new(&few)));
    d.harness.get_by_label("Capture light: unknown");
    let session = &d.viewer().session;
    assert!(session.source_is_assumed() && session.estimate().is_some_and(|e| !e.is_told()));
    assert_eq!(session.oriented_lights()[0].light.trust, LEAST_TRUST);
    let mut told = session.messages.iter();
    assert!(told.any(|m| m.text.contains("cannot be estimated") && m.text.contains("half")));
    assert!(
        session.object().source.is_estimate()
            && session.project.scene_to_save().objects[0]
                .source
                .is_estimate()
    );
    // A file that is no light changes nothing of that.
    let broken = d.folder.write("broken.hdr", "no light");
    d.after(|v| v.session.object_mut().source.strength = 1.5);
    d.after(|v| v.session.set_light(0, broken.into()));
    let session = &d.viewer().session;
    let source = &session.object().source;
    assert!(source.is_estimate() && source.strength == 1.5);
    assert!(
        session
            .messages
            .iter()
            .any(|m| m.text.contains("is estimated from the object instead"))
    );
    // The next asset may tell its light.
    open_own(&mut d);
    d.settle();
    assert!(!d.viewer().session.source_is_assumed());
    // Taken as linear it tells another, which is estimated anew.
    let before = d.viewer().session.estimate().cloned();
    d.after(|v| v.session.object_mut().response = CameraResponse::LINEAR);
    let session = &d.viewer().session;
    assert!(session.object().source.is_estimate() && session.estimate().is_some());
    assert_ne!(
        session.estimate().map(|e| e.confidence),
        before.map(|e| e.confidence)
    );
}

#[test]
fn an_estimate_that_was_cancelled_can_be_asked_for_again() {
    let mut d = Driver::bundled();
    // Preset paper's own bake tells nothing of the light: another is made after it.
    d.viewer().session.project.scene.transfer.method = Method::Harmonic;
    open_own(&mut d);
    let start = Instant::now();
    let is_baked_for = |d: &mut Driver| {
        let mut jobs = d.viewer().session.running_jobs();
        jobs.any(|j| j.label.contains("the capture light"))
    };
    while !is_baked_for(&mut d) {
        d.harness.step();
        assert!(start.elapsed() < PATIENCE, "it is baked for");
    }
    let session = &d.viewer().session;
    assert!(session.project.is_estimating(0) && session.source_is_assumed());
    session.running_jobs().for_each(|j| j.cancel());
    d.settle();
    let session = &d.viewer().session;
    assert!(session.estimate().is_none() && session.source_is_assumed());
    d.after(|v| v.session.ask_for_estimate());
    let session = &d.viewer().session;
    assert!(session.estimate().is_some_and(|e| e.is_told()));
    assert!(!session.source_is_assumed());
    assert_eq!(session.project.scene.transfer.method, Method::Harmonic);
}

#[test]
fn what_was_estimated_is_found_again_and_belongs_to_its_asset() {
    let mut d = Driver::bundled();
    let own = open_own(&mut d);
    d.settle();
    let first = d.viewer().session.estimate().cloned().expect("estimated");
    // Another splat, dropped while nothing of the last one's light fits it, and with a method that has no bake for an estimate.
    d.viewer().session.project.scene.transfer.method = Method::Harmonic;
    let few = d.folder.write("few.ply", small_splat(30));
    d.after(|v| v.open(Path::new(&few)));
    assert!(d.viewer().session.source_is_assumed());
    // A kept estimate needs no bake.
    fs::remove_file(d.folder.path("own.ply.best.bake")).expect("it was kept");
    d.after(|v| v.open(&own));
    let session = &d.viewer().session;
    assert_eq!(session.estimate(), Some(&first));
    assert!(
        !session.source_is_assumed() && !session.state().bakes.contains_key(&Method::Directional)
    );
    // Undone and done again, swapped and swapped back.
    d.after(|v| v.session.set_light(0, "even".into()));
    d.harness.run_steps(12);
    for (key, is_even) in [
        (egui::Key::Z, false),
        (egui::Key::Y, true),
        (egui::Key::Z, false),
    ] {
        d.harness.key_press_modifiers(egui::Modifiers::CTRL, key);
        d.settle();
        assert_eq!(d.viewer().session.source_is_assumed(), is_even, "{key:?}");
    }
    d.after(|v| v.session.swap_lights());
    assert_eq!(d.viewer().session.light(1).path, Path::new("estimate"));
    d.viewer().session.swap_lights();
    // A look without a light of the capture leaves that to the asset.
    let scene = format!(
        "{{\"asset\": {:?}, \"target\": {{\"file\": \"even\"}}}}",
        few
    );
    let scene = d.folder.write("few.json", scene);
    d.after(|v| v.open(Path::new(&scene)));
    d.click("Discard");
    let session = &d.viewer().session;
    assert!(session.object().source.is_estimate() && session.source_is_assumed());
}

#[test]
fn a_capture_that_lies_on_its_side_is_set_upright_and_lit_as_strongly_as_it_was() {
    let mut d = Driver::bundled();
    assert!(!d.viewer().session.project.scene.match_strength);
    // The teapot on its plate, as a trainer whose Y points down would have it.
    let (cloud, _) = load_splat(asset("teapot.ply").as_ref()).expect("the bundled splat");
    let turn = DMat3::from_quat(DQuat::from_rotation_arc(DVec3::Z, DVec3::NEG_Y));
    let lying = synthetic::turned(&cloud, turn);
    let path = d.folder.path("lying.ply");
    write_splat(&lying, &lying.sh, &path).expect("room for it");
    // What is written here names an axis, as files of trainers do not.
    let mut bytes = fs::read(&path).expect("it is there");
    let name = b"Vertical axis";
    let named = bytes.windows(name.len()).position(|w| w == name);
    bytes[named.expect("it is named")] = b'-';
    fs::write(&path, bytes).expect("room for it");
    d.viewer().open(&path);
    // What is told goes again after some seconds.
    let (start, mut told) = (Instant::now(), String::new());
    while !(told.contains("Up axis set") && told.contains("strength of the capture")) {
        d.harness.step();
        let messages = d.viewer().session.messages.iter();
        told = messages.map(|m| m.text.clone()).collect();
        assert!(start.elapsed() < Duration::from_secs(60), "{told}");
        std::thread::sleep(Duration::from_millis(5));
    }
    d.settle();
    let session = &d.viewer().session;
    assert_eq!(session.object().up, Some(UpAxis::MinusY));
    assert!(session.project.scene.match_strength);
    // Without its light it says which way it stands here.
    let delit = d.folder.path("delit.ply");
    d.after(|v| v.export(Task::Delit(delit.clone())));
    let (cloud, file) = load_splat(&delit).expect("a splat");
    assert_eq!((cloud.len(), cloud.sh_degree), (lying.len(), 0));
    assert_eq!(file.report.up, Some(UpAxis::MinusY));
    // One that stands is left, and light that is told is as strong as it is.
    open_own(&mut d);
    d.settle();
    assert_eq!(d.viewer().session.object().up, None);
    let city = asset("city.hdr");
    d.after(|v| v.session.set_light(0, city.into()));
    assert!(!d.viewer().session.project.scene.match_strength);
    // The command says what it takes for granted.
    let told = run_json(&["info", &path.display().to_string()]);
    assert!(told["warnings"].to_string().contains("--up=-y"), "{told}");
}
