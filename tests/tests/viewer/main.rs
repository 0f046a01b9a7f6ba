//! The viewer's own interface, driven without a window on the adapter that the tests have.

mod composing;
mod dropping;
mod estimate;
mod gestures;
mod keeping;
mod lights;
mod live;
mod named;

use std::fs;
use std::path::PathBuf;
use std::time::Duration;

use eframe::egui;
use transplat::viewer::{Startup, Task};
use transplat_core::color::ToneMap;
use transplat_core::present::{Background, View};
use transplat_core::scene::{EVEN, Object, Scene};
use transplat_core::settings::Method;
use transplat_core::surfels::UpAxis;
use transplat_tests::driver::Driver;
use transplat_tests::{Folder, args, asset, psnr, run_json, small_lut, small_splat};

#[test]
fn controls_run_what_they_touch_and_nothing_else() {
    let mut d = Driver::bundled();
    let first = d.picture();
    let at_rest = d.viewer().session.canvas.passes();
    d.settle();
    assert_eq!(
        d.viewer().session.canvas.passes(),
        at_rest,
        "nothing runs while nothing changes"
    );

    // A turn of the light: one transfer, one colouring, one drawing; the map is not read again, nothing is sorted or projected.
    let stages = d.viewer().session.project.stages;
    d.viewer().session.project.scene.environment.rotation = 120.0;
    let turned = d.picture();
    let after_turn = d.viewer().session.canvas.passes();
    assert_eq!(after_turn.transfer, at_rest.transfer + 1);
    assert_eq!(after_turn.shade, at_rest.shade + 1);
    assert_eq!(after_turn.draw, at_rest.draw + 1);
    assert_eq!(
        (after_turn.sort, after_turn.project),
        (at_rest.sort, at_rest.project)
    );
    assert_eq!(after_turn.backdrop, at_rest.backdrop);
    assert_eq!(
        d.viewer().session.project.stages,
        stages,
        "no projection, no preparation"
    );
    assert!(psnr(&first, &turned) < 30.0);

    // Exposure: no transfer.
    d.viewer().session.project.scene.display.exposure = 1.0;
    let exposed = d.picture();
    let after_exposure = d.viewer().session.canvas.passes();
    assert_eq!(after_exposure.transfer, after_turn.transfer);
    assert_eq!(after_exposure.shade, after_turn.shade + 1);
    assert!(psnr(&turned, &exposed) < 25.0);

    // Another environment of the shelf: it was projected when it came onto the shelf; a transfer and a backdrop.
    let interior = d.folder.path("interior.hdr");
    d.viewer().session.set_light(1, interior);
    d.picture();
    let after_light = d.viewer().session.canvas.passes();
    assert_eq!(after_light.transfer, after_exposure.transfer + 1);
    assert_eq!(after_light.backdrop, after_exposure.backdrop + 1);
    assert_eq!(
        (after_light.sort, after_light.project),
        (at_rest.sort, at_rest.project)
    );

    // One that is new to the program is projected once.
    let fresh = d.folder.path("fresh.hdr");
    fs::copy(asset("city.hdr"), &fresh).expect("room for it");
    let projections = d.viewer().session.project.stages.project_environment;
    d.viewer().open(&fresh);
    d.picture();
    assert_eq!(
        d.viewer().session.project.stages.project_environment,
        projections + 1
    );

    // The camera: no transfer.
    let before_orbit = d.viewer().session.canvas.passes();
    d.viewer().session.project.pose.azimuth += 20.0;
    d.picture();
    let orbited = d.viewer().session.canvas.passes();
    assert_eq!(orbited.transfer, before_orbit.transfer);
    assert_eq!(orbited.sort, before_orbit.sort + 1);
    assert_eq!(orbited.project, before_orbit.project + 1);

    // What is hidden needs no transfer, and is left out of the next one; what is seen again does.
    let whole = d.picture();
    d.viewer().session.object_mut().hide.crop = true;
    d.viewer().session.object_mut().hide.crop_max.z = 0.0;
    let cropped = d.picture();
    assert_eq!(
        d.viewer().session.canvas.passes().transfer,
        orbited.transfer
    );
    assert!(psnr(&whole, &cropped) < 30.0);
    d.viewer().session.project.scene.environment.rotation = 60.0;
    d.picture();
    d.viewer().session.object_mut().hide.crop = false;
    let released = d.picture();
    assert_eq!(
        d.viewer().session.canvas.passes().transfer,
        orbited.transfer + 2
    );
    d.viewer().session.project.scene.environment.rotation = 0.0;
    d.picture();
    d.viewer().session.project.scene.environment.rotation = 60.0;
    assert!(psnr(&released, &d.picture()) > 60.0);

    // Moving the wipe only presents.
    d.viewer().session.project.scene.view = View::Split;
    d.picture();
    let split = d.viewer().session.canvas.passes();
    d.viewer().session.project.scene.wipe = 0.3;
    d.picture();
    let wiped = d.viewer().session.canvas.passes();
    assert_eq!((wiped.draw, wiped.shade), (split.draw, split.shade));
    assert_eq!(wiped.present, split.present + 1);
}

#[test]
fn what_is_saved_is_what_is_shown_and_what_render_makes() {
    let mut d = Driver::bundled();
    let size = d.viewer().session.project.viewport;
    let folder = d.folder.path("out");
    fs::create_dir_all(&folder).expect("room for it");
    let environment = Background::Environment;
    let black = Background::Color([0.0; 3]);
    let cases = [
        (View::After, environment),
        (View::Before, environment),
        (View::Split, environment),
        (
            View::SideBySide,
            Background::Gradient([0.4, 0.5, 0.6], [0.1; 3]),
        ),
        (View::Difference, Background::Checker),
        (View::Depth, Background::Color([0.1, 0.2, 0.1])),
        (View::Normals, black),
        (View::Visibility, black),
        (View::Diffuse, black),
        (View::Specular, black),
        (View::Tau, black),
        (View::Confidence, black),
    ];
    let lut = PathBuf::from(d.folder.write("small.cube", small_lut()));
    for (i, (view, background)) in cases.into_iter().enumerate() {
        {
            let session = &mut d.viewer().session;
            session.overlays.grid = false;
            session.project.pose.orthographic = i % 4 == 1;
            let scene = &mut session.project.scene;
            scene.view = view;
            scene.background = background;
            scene.background_blur = 4.0;
            scene.objects[0].source.rotation = -20.0;
            scene.environment.rotation = 40.0;
            scene.environment.tilt = 15.0;
            scene.environment.mirror = i % 3 == 0;
            scene.environment.up = if i % 3 == 2 {
                UpAxis::PlusY
            } else {
                UpAxis::PlusZ
            };
            scene.environment.tint = [1.0, 0.9, 0.8];
            scene.environment.strength = 0.5;
            scene.match_strength = i % 2 == 1;
            scene.wipe = 0.4;
            scene.difference_scale = 2.0;
            scene.shadow_catcher = i < 3;
            scene.objects[0].hide.min_opacity = 0.2;
            scene.false_color = view == View::Diffuse;
            scene.lut = (i != 1).then(|| lut.clone());
            scene.display.tone_map = if view == View::Split {
                ToneMap::Agx
            } else {
                ToneMap::Srgb
            };
        }
        let shown = d.picture();
        let settings = d.viewer().export_settings();
        settings.size = size;
        settings.supersample = 1;
        let saved = folder.join(format!("{i}.png"));
        d.after(|v| v.export(Task::Screenshot(Some(saved.clone()))));
        let saved_picture = transplat_tests::picture(&saved);
        // 8 bits on the screen and in the file, and maps as half floats on the adapter.
        let found = psnr(&shown, &saved_picture);
        assert!(
            found > 40.0,
            "{view:?}: the screen and the file: {found:.1} dB"
        );

        let scene = folder.join("look.json");
        let to_save = d.viewer().session.project.scene_to_save();
        transplat_core::files::save_look(&scene, &to_save).expect("it is written");
        let rendered = folder.join(format!("{i}-render.png"));
        let [look, out] = [&scene, &rendered].map(|p| p.display().to_string());
        let size = format!("{}x{}", size[0], size[1]);
        let bake = d.folder.name("teapot.ply.best.bake");
        run_json(&args(
            "render --look {} --size {} --device auto --bake {} -o {}",
            &[&look, &size, &bake, &out],
        ));
        let found = psnr(&saved_picture, &transplat_tests::picture(&rendered));
        assert!(
            found > 100.0,
            "{view:?}: the saved picture and render: {found:.1} dB"
        );
    }
}

#[test]
fn a_look_restores_everything() {
    let mut d = Driver::bundled();
    {
        let session = &mut d.viewer().session;
        session.project.scene.environment.rotation = -70.0;
        session.project.scene.environment.mirror = true;
        session.object_mut().source.tilt = 5.0;
        session.project.scene.transfer.sh_degree = 4;
        session.project.scene.transfer.terms.specular = false;
        session.project.scene.display.tone_map = ToneMap::Neutral;
        session.project.scene.match_strength = true;
        session.project.scene.view = View::Split;
        session.project.pose.azimuth = 77.0;
        session.project.pose.orthographic = true;
    }
    let before = d.picture();
    let expected = d.viewer().session.project.scene_to_save();
    let path = d.folder.path("my.json");
    transplat_core::files::save_look(&path, &expected).expect("it is written");
    let text = fs::read_to_string(&path).expect("it is there");
    assert!(
        text.contains("\"teapot.ply\"") && text.contains("\"sunset.hdr\""),
        "paths are relative: {text}"
    );

    {
        let session = &mut d.viewer().session;
        session.project.scene = Default::default();
        session.object_mut().source.file = Some(EVEN.into());
        session.project.scene.environment.file = Some(EVEN.into());
        session.project.pose.azimuth = 0.0;
    }
    assert!(psnr(&before, &d.picture()) < 30.0);
    d.after(|v| v.open(&path));
    d.click("Discard");
    let after = d.picture();
    assert!(psnr(&before, &after) > 60.0);
    let canonical = |mut scene: Scene| {
        let object = &mut scene.objects[0];
        for path in [
            &mut object.asset,
            &mut object.source.file,
            &mut scene.environment.file,
        ] {
            *path = path.as_ref().and_then(|p| p.canonicalize().ok());
        }
        scene
    };
    let restored = canonical(d.viewer().session.project.scene_to_save());
    assert_eq!(restored, canonical(expected));
}

#[test]
fn panels_change_settings_and_picture() {
    let mut d = Driver::bundled();
    d.click("Look");
    d.click("Advanced");
    let first = d.picture();
    d.click("Self-shadow");
    assert!(!d.viewer().session.project.scene.transfer.terms.shadow);
    assert!(psnr(&first, &d.picture()) < 40.0);
    d.click("Self-shadow");
    assert!(
        psnr(&first, &d.picture()) > 60.0,
        "switched back it is as it was"
    );

    // Each method has its own terms, and what is switched back is as it was.
    d.click("Specular");
    assert!(!d.viewer().session.project.scene.transfer.terms.lobe);
    assert!(psnr(&first, &d.picture()) < 50.0);
    d.click("Specular");
    d.after(|v| v.session.project.scene.transfer.method = Method::Harmonic);
    let paper = d.picture();
    assert!(psnr(&first, &paper) < 45.0);
    d.click("Specular");
    assert!(!d.viewer().session.project.scene.transfer.terms.specular);
    assert!(psnr(&paper, &d.picture()) < 50.0);
    d.click("Specular");
    let bakes = d.viewer().session.project.stages.bake;
    d.viewer().session.project.scene.transfer.method = Method::Directional;
    assert!(psnr(&first, &d.picture()) > 60.0);
    assert_eq!(
        d.viewer().session.project.stages.bake,
        bakes,
        "both are kept"
    );

    // Compare and channels.
    for (label, view) in [
        ("Before", View::Before),
        ("Split", View::Split),
        ("Side by side", View::SideBySide),
        ("Difference", View::Difference),
        ("After", View::After),
    ] {
        d.click(label);
        assert_eq!(d.viewer().session.project.scene.view, view);
    }
    let mut seen = vec![first.clone()];
    for (label, view) in [
        ("Diffuse", View::Diffuse),
        ("Specular", View::Specular),
        ("Normals", View::Normals),
        ("Depth", View::Depth),
        ("Ambient occlusion", View::Visibility),
        ("Ratio tau", View::Tau),
        ("Doubts", View::Confidence),
    ] {
        d.viewer().session.project.scene.view = view;
        let picture = d.picture();
        for other in &seen {
            assert!(psnr(other, &picture) < 45.0, "{label} looks like another");
        }
        seen.push(picture);
    }
    d.viewer().session.project.scene.view = View::After;
}

#[test]
fn the_shelf_and_the_matching_toggle_change_the_light() {
    let mut d = Driver::bundled();
    d.settle();
    let stops = |d: &mut Driver| {
        d.viewer()
            .session
            .stops_over_source()
            .expect("known lights")
    };
    // The matching toggle says by how much, and does it.
    let before = stops(&mut d);
    assert!(before.abs() > 0.05);
    d.viewer().session.project.scene.match_strength = true;
    d.picture();
    let matched = stops(&mut d);
    assert!(matched.abs() < 0.01, "{matched}");
    d.viewer().session.project.scene.match_strength = false;

    // The shelf: click, key and swap.
    let target = |d: &mut Driver| d.viewer().session.light(1).name();
    d.click("Swap lights");
    assert_eq!(target(&mut d), "city");
    let position = d
        .viewer()
        .light_library()
        .iter()
        .position(|p| p.ends_with("interior.hdr"))
        .expect("on the shelf");
    let key = egui::Key::from_name(&(position + 1).to_string()).expect("one of nine");
    d.harness.key_press(key);
    d.settle();
    assert_eq!(target(&mut d), "interior");
}

#[test]
fn what_is_seen_of_the_splat_can_be_said_to_be_its_outside() {
    let mut d = Driver::bundled();
    let bakes = |d: &mut Driver| d.viewer().session.project.stages.bake;
    let before = bakes(&mut d);
    d.click("Objects");
    d.click("Use this side as outside");
    let session = &d.viewer().session;
    let told = session.object().outside_from.clone();
    assert_eq!(told.len(), 1);
    let cloud = &session.asset().expect("an asset").cloud;
    assert_eq!(cloud.outside_from, told);
    assert!(session.canvas.live().has_relit(0) && bakes(&mut d) > before);
    assert_eq!(
        d.viewer().session.project.scene_to_save().objects[0].outside_from,
        told
    );
    // What is said while the splat is loaded again is not lost.
    let more = glam::Vec3::new(0.0, 0.0, 9.0);
    d.viewer().session.object_mut().outside_from.push(more);
    d.harness.step();
    d.viewer().session.object_mut().outside_from.pop();
    d.settle();
    assert_eq!(d.viewer().session.object().outside_from, told);
    d.click("Forget 1 view");
    let session = &d.viewer().session;
    assert!(session.object().outside_from.is_empty());
    let cloud = &session.asset().expect("an asset").cloud;
    assert!(cloud.outside_from.is_empty());
}

/// What was done is there at the next start that names nothing else; where its splat is gone that is said, and what was kept stays.
#[test]
fn the_work_of_last_time_comes_back() {
    let folder = Folder::empty();
    folder.write("small.ply", small_splat(100));
    let [work, splat] = ["kept/work.json", "small.ply"].map(|n| folder.path(n));
    let started = |files: &[&PathBuf]| Startup {
        files: files.iter().map(|f| (*f).clone()).collect(),
        work: Some(work.clone()),
        ..Startup::default()
    };
    let mut d = Driver::open(started(&[&splat]), Folder::empty());
    d.after(|v| v.session.project.scene.environment.rotation = 70.0);
    d.viewer().keep_work();
    let mut d = Driver::open(started(&[]), Folder::empty());
    let session = &d.viewer().session;
    assert_eq!(session.asset().map(|a| a.cloud.len()), Some(100));
    assert!((session.project.scene.environment.rotation - 70.0).abs() < 1e-6);
    // A start that names something else sets it aside.
    let mut d = Driver::open(started(&[&splat]), Folder::empty());
    assert!(d.viewer().session.project.scene.environment.rotation == 0.0 && !work.exists());
    d.click("File");
    d.click("Autosaves");
    d.click("small, just now");
    assert!((d.viewer().session.project.scene.environment.rotation - 70.0).abs() < 1e-6);
    d.viewer().keep_work();
    fs::rename(&splat, folder.path("moved.ply")).expect("it is there");
    let mut d = Driver::open(started(&[]), Folder::empty());
    let mut messages = d.viewer().session.messages.iter();
    assert!(messages.any(|m| m.is_error && m.text.contains("small.ply")));
    // It is an autosave then, and is not written over.
    d.after(|v| v.session.project.scene.environment.rotation = 10.0);
    d.viewer().keep_work();
    let folder = fs::read_dir(work.parent().expect("a folder")).expect("it is there");
    let rotations: Vec<f64> = folder
        .flatten()
        .filter(|file| file.path() != work)
        .filter_map(|file| transplat_core::files::load_look(&file.path()).ok())
        .map(|look| look.environment.rotation)
        .collect();
    assert!(
        rotations.iter().any(|r| (r - 70.0).abs() < 1e-6),
        "{rotations:?}"
    );
}

#[test]
fn keys_and_the_mouse_do_what_the_sheet_says() {
    let mut d = Driver::bundled();
    let middle = egui::pos2(330.0, 280.0);
    let drag = |d: &mut Driver, button, modifiers: egui::Modifiers, by: egui::Vec2| {
        let press = |pressed, pos| egui::Event::PointerButton {
            pos,
            button,
            pressed,
            modifiers,
        };
        d.harness.event(egui::Event::ModifiersChanged(modifiers));
        d.harness.hover_at(middle);
        d.harness.step();
        d.harness.event(press(true, middle));
        d.harness.step();
        for i in 1..=4 {
            d.harness.hover_at(middle + by * (i as f32 / 4.0));
            d.harness.step();
        }
        d.harness.event(press(false, middle + by));
        d.harness.step();
        d.settle();
    };
    let pose = d.viewer().session.project.pose;
    drag(
        &mut d,
        egui::PointerButton::Primary,
        egui::Modifiers::NONE,
        egui::vec2(80.0, 20.0),
    );
    let orbited = d.viewer().session.project.pose;
    // All of the drag counts, its first and last frame too: 0.4 degrees a point.
    let turned = (orbited.azimuth - pose.azimuth).abs();
    assert!((turned - 32.0).abs() < 0.5, "{turned}");
    assert_eq!(orbited.pivot, pose.pivot);
    drag(
        &mut d,
        egui::PointerButton::Middle,
        egui::Modifiers::NONE,
        egui::vec2(80.0, 20.0),
    );
    let panned = d.viewer().session.project.pose;
    assert!(panned.pivot != pose.pivot && panned.azimuth == orbited.azimuth);
    let light = d.viewer().session.project.scene.environment.clone();
    drag(
        &mut d,
        egui::PointerButton::Secondary,
        egui::Modifiers::SHIFT,
        egui::vec2(60.0, 10.0),
    );
    let turned = d.viewer().session.project.scene.environment.clone();
    assert!(turned.rotation != light.rotation && turned.tilt != light.tilt);
    assert_eq!(d.viewer().session.project.pose, panned, "the camera stays");

    d.harness.key_press(egui::Key::ArrowLeft);
    d.settle();
    let nudged = d.viewer().session.project.scene.environment.rotation;
    assert!((nudged - turned.rotation - 5.0).abs() < 1e-9);
    d.harness
        .key_press_modifiers(egui::Modifiers::SHIFT, egui::Key::ArrowRight);
    d.settle();
    let fine = d.viewer().session.project.scene.environment.rotation;
    assert!((nudged - fine - 1.0).abs() < 1e-9);
    // Presses that come between two frames all count.
    let press = egui::Event::Key {
        key: egui::Key::ArrowRight,
        physical_key: None,
        pressed: true,
        repeat: false,
        modifiers: egui::Modifiers::NONE,
    };
    let events = &mut d.harness.input_mut().events;
    events.extend(std::iter::repeat_n(press, 3));
    d.settle();
    let thrice = d.viewer().session.project.scene.environment.rotation;
    assert!((fine - thrice - 15.0).abs() < 1e-9, "{fine} {thrice}");

    // What stays for a second is a step to come back to, also where nothing else makes a frame; then the window rests.
    d.viewer().session.messages.clear();
    d.settle();
    d.viewer().session.project.scene.difference_scale = 3.0;
    let mut rests = || {
        d.harness.step();
        let root = &d.harness.output().viewport_output[&egui::ViewportId::ROOT];
        root.repaint_delay > Duration::from_secs(2)
    };
    let frames = (0..40).find(|_| rests()).expect("the window rests");
    assert!(frames > 3, "{frames} frames of a quarter of a second");

    // Undo and redo of a setting.
    d.viewer().session.project.scene.transfer.sh_degree = 6;
    d.harness.run_steps(12);
    d.settle();
    d.harness
        .key_press_modifiers(egui::Modifiers::CTRL, egui::Key::Z);
    d.settle();
    assert_eq!(d.viewer().session.project.scene.transfer.sh_degree, 3);
    d.harness
        .key_press_modifiers(egui::Modifiers::CTRL, egui::Key::Y);
    d.settle();
    assert_eq!(d.viewer().session.project.scene.transfer.sh_degree, 6);

    // Before while B is held.
    let after = d.picture();
    d.harness.key_down(egui::Key::B);
    let before = d.picture();
    d.harness.key_up(egui::Key::B);
    let again = d.picture();
    assert!(psnr(&after, &before) < 40.0 && psnr(&after, &again) > 60.0);
}

/// A scene has room for another object before its splat is there, and what is shown and kept of the first stays.
#[test]
fn a_scene_grows_and_shrinks() {
    let mut d = Driver::bundled();
    let alone = d.picture();
    // One that is nothing yet.
    let object = Object {
        asset: None,
        ..d.viewer().session.project.scene.objects[0].clone()
    };
    d.viewer().session.project.scene.objects.push(object);
    assert!(psnr(&alone, &d.picture()) > 60.0);
    d.viewer().session.project.pin();
    assert!(d.viewer().session.project.compared().is_some());
    d.viewer().session.project.scene.objects.truncate(1);
    assert!(psnr(&alone, &d.picture()) > 60.0);
}

#[test]
fn exports_write_what_they_say() {
    let mut d = Driver::bundled();
    let folder = d.folder.path("out");
    let settings = d.viewer().export_settings();
    settings.folder = folder.display().to_string();
    settings.size = [80, 60];
    settings.supersample = 1;
    settings.frames = 3;
    let count = |suffix: &str| {
        let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
        entries
            .filter(|e| e.file_name().to_string_lossy().ends_with(suffix))
            .count()
    };
    d.after(|v| v.export(Task::Screenshot(None)));
    assert_eq!(count(".png"), 1);
    let lights = d.viewer().light_library().len();
    d.after(|v| v.export(Task::EachLight));
    // The one of the screenshot's light is there already: nothing is written over.
    assert_eq!(count(".png"), 1 + lights);
    // Each sequence is numbered from 0 in a folder of its own.
    for again in ["", "-2"] {
        d.after(|v| v.export(Task::Turntable));
        for frame in 0..3 {
            let name = format!("teapot_sunset_after{again}/teapot_sunset_after_00{frame}.png");
            assert!(folder.join(&name).is_file(), "{name}");
        }
    }
    assert_eq!(count(".png"), 1 + lights);
    d.after(|v| v.export(Task::ContactSheet));
    assert_eq!(count(".png"), 2 + lights);
    // Below each picture is its light's name, and behind that nothing where nothing is wanted.
    d.viewer().export_settings().transparent = true;
    d.viewer().export_settings().pattern = "clear".into();
    d.after(|v| v.export(Task::ContactSheet));
    let sheet = image::open(folder.join("clear.png"))
        .expect("a sheet")
        .into_rgba8();
    let columns = (lights as f64).sqrt().ceil() as u32;
    assert_eq!(sheet.width(), 80 * columns);
    assert_eq!(
        sheet.height(),
        (60 + 14) * (lights as u32).div_ceil(columns)
    );
    let caption = image::imageops::crop_imm(&sheet, 0, 60, 80, 14).to_image();
    let written = caption.pixels().filter(|p| p[3] > 0 && p[0] > 128).count();
    assert!((20..600).contains(&written), "{written}");
    d.viewer().export_settings().transparent = false;
    let relit = d.folder.path("relit.ply");
    d.after(|v| v.export(Task::Splat(relit.clone())));
    let bytes = |path| fs::metadata(path).expect("it is there").len();
    assert_eq!(bytes(d.folder.path("teapot.ply")), bytes(relit));
    // A file's extension decides what is in it.
    for (name, start) in [
        ("a.exr", &[0x76, 0x2f, 0x31, 0x01][..]),
        ("a.png", b"\x89PNG"),
    ] {
        let path = folder.join(name);
        d.after(|v| v.export(Task::Screenshot(Some(path.clone()))));
        assert!(
            fs::read(&path).expect("it is there").starts_with(start),
            "{name}"
        );
    }
    d.viewer().session.messages.clear();
    // A sheet of pictures that are far wider than high.
    d.viewer().export_settings().size = [400, 30];
    d.after(|v| v.export(Task::ContactSheet));
    assert!(!d.viewer().session.messages.iter().any(|m| m.is_error));
    // The capture itself is not written over.
    let capture = d.folder.path("teapot.ply");
    let bytes = fs::read(&capture).expect("it is there");
    d.after(|v| v.export(Task::Splat(capture.clone())));
    assert_eq!(fs::read(&capture).expect("it is there"), bytes);
    assert!(d.viewer().session.messages.iter().any(|m| m.is_error));
}

#[test]
fn a_lost_device_keeps_the_look_and_closes_the_window() {
    let mut d = Driver::bundled();
    let recovery = d.folder.path("cache/recovered.json");
    d.viewer().recovery = Some(recovery.clone());
    d.viewer().session.project.scene.environment.rotation = 33.0;
    d.viewer().session.canvas.context.destroy();
    let closed = (0..50).any(|_| {
        d.harness.step();
        std::thread::sleep(Duration::from_millis(10));
        let viewports = d.harness.output().viewport_output.values();
        let mut commands = viewports.flat_map(|v| &v.commands);
        commands.any(|c| *c == egui::ViewportCommand::Close)
    });
    assert!(closed, "the window is told to close");
    let scene = transplat_core::files::load_look(&recovery).expect("the look is kept");
    assert_eq!(scene.environment.rotation, 33.0);
}

/// The whole window, both themes, at a quarter of its size: what is laid out, not how letters are drawn. A new look of the window is
/// taken over with `UPDATE_PICTURES=1 cargo test --package transplat-tests --test viewer the_window`.
#[test]
fn the_window_looks_as_it_did() {
    let mut d = Driver::bundled();
    for (name, theme) in [("dark", egui::Theme::Dark), ("light", egui::Theme::Light)] {
        d.harness.ctx.set_theme(theme);
        // What differs from machine to machine is said at the window's lower edge.
        d.after(|v| v.session.messages.clear());
        let window = d.harness.render().expect("the driver works");
        let cut = image::imageops::crop_imm(&window, 0, 0, window.width(), window.height() - 24)
            .to_image();
        let (width, height) = (cut.width() / 4, cut.height() / 4);
        let small =
            image::imageops::resize(&cut, width, height, image::imageops::FilterType::Triangle);
        let small = image::DynamicImage::from(small).into_rgb8();
        let path = transplat_tests::root().join(format!("tests/pictures/window_{name}.png"));
        if std::env::var_os("UPDATE_PICTURES").is_some() {
            small.save(&path).expect("it is written");
        }
        let folder = Folder::empty();
        let now = folder.path("now.png");
        small.save(&now).expect("it is written");
        let found = psnr(
            &transplat_tests::picture(&now),
            &transplat_tests::picture(&path),
        );
        // A panel that is missing or moved by its height falls below 20; the sampling of the picture differs by driver.
        assert!(found > 28.0, "{name}: {found:.1} dB");
    }
}
