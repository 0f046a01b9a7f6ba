//! Looks and views that are kept with the scene.

use std::path::PathBuf;

use eframe::egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable;
use transplat::viewer::{Startup, Task};
use transplat_core::files::{load_look, load_lut, save_look};
use transplat_core::present::{Background, View};
use transplat_tests::driver::Driver;
use transplat_tests::{Folder, picture, psnr, small_lut, small_splat};

#[test]
fn a_kept_look_and_a_kept_view_come_back_as_they_were() {
    let mut d = Driver::bundled();
    let before = d.picture();
    let (scene, pose) = {
        let session = &mut d.viewer().session;
        session.project.keep_look();
        session.keep_view();
        // What is kept already is not kept twice.
        session.project.keep_look();
        session.keep_view();
        (session.project.scene.clone(), session.project.pose)
    };
    assert_eq!((scene.variants.len(), scene.bookmarks.len()), (1, 1));
    assert_eq!(scene.variants[0].name, "sunset");
    let city = d.folder.path("city.hdr");
    d.after(|v| {
        v.session.set_light(1, city);
        v.session.project.scene.display.exposure = 1.0;
        v.session.project.pose.azimuth += 70.0;
        v.session.project.scene.note = "brighter".into();
    });
    assert!(psnr(&before, &d.picture()) < 25.0);
    // What is compared and how is no part of it.
    d.viewer().session.project.scene.wipe = 0.3;
    d.click("Looks 1");
    d.click("Look sunset");
    d.click("Views 1");
    d.click("View view");
    let session = &d.viewer().session;
    assert_eq!(session.project.pose, pose);
    assert_eq!(session.project.scene.look_alone(), scene.variants[0].look);
    assert_eq!(session.project.scene.wipe, 0.3);
    assert_eq!(session.project.scene.objects, scene.objects);
    assert!(psnr(&before, &d.picture()) > 60.0);
    // It is all in the look that is saved.
    let saved = d.viewer().session.project.scene_to_save();
    let path = d.folder.path("kept.json");
    save_look(&path, &saved).expect("room");
    let back = load_look(&path).expect("its own file");
    assert_eq!(back.bookmarks, scene.bookmarks);
    let light = back.variants[0].look.environment.file.as_deref();
    assert!(light.is_some_and(|l| l.ends_with("sunset.hdr")));
    // A look for any splat takes nothing of it away.
    d.folder
        .write("plain.json", r#"{"display": {"exposure": 0.5}}"#);
    let plain = d.folder.path("plain.json");
    d.after(|v| v.open(&plain));
    assert_eq!(d.viewer().session.project.scene.variants, scene.variants);
}

#[test]
fn keys_go_from_look_to_look_and_from_view_to_view() {
    let mut d = Driver::bundled();
    for (i, azimuth) in [10.0, 80.0, 150.0].into_iter().enumerate() {
        d.after(|v| {
            v.session.project.pose.azimuth = azimuth;
            v.session.project.scene.display.exposure = i as f32;
            v.session.project.keep_look();
        });
        d.harness.key_press_modifiers(Modifiers::CTRL, Key::B);
        d.settle();
    }
    let names = |d: &mut Driver| -> Vec<String> {
        let kept = &d.viewer().session.project.scene.variants;
        kept.iter().map(|kept| kept.name.clone()).collect()
    };
    assert_eq!(names(&mut d), ["sunset", "sunset 2", "sunset 3"]);
    assert_eq!(d.viewer().session.project.scene.bookmarks.len(), 3);
    d.harness.key_press(Key::PageDown);
    d.settle();
    assert_eq!(d.viewer().session.project.pose.azimuth, 10.0);
    d.harness.key_press(Key::PageUp);
    d.harness.key_press(Key::PageUp);
    d.settle();
    assert_eq!(d.viewer().session.project.pose.azimuth, 80.0);
    d.harness.key_press_modifiers(Modifiers::CTRL, Key::PageUp);
    d.settle();
    let session = &d.viewer().session;
    assert_eq!(session.project.scene.display.exposure, 1.0);
    assert_eq!(session.project.pose.azimuth, 80.0);
}

#[test]
fn a_pinned_look_is_compared_with_and_swapped() {
    let mut d = Driver::bundled();
    let a = d.picture();
    d.click("Pin");
    let interior = d.folder.path("interior.hdr");
    d.viewer().session.set_light(1, interior);
    let b = d.picture();
    assert!(psnr(&a, &b) < 35.0);
    // All of the split is its left side: the pinned look, but for the background behind it.
    d.viewer().session.project.scene.background = Background::Color([0.0; 3]);
    d.viewer().session.project.scene.view = View::Split;
    d.viewer().session.project.scene.wipe = 1.0;
    let left = d.picture();
    d.viewer().session.project.scene.view = View::After;
    let right = d.picture();
    assert!(psnr(&left, &right) < 35.0);
    d.viewer().session.project.swap_pinned();
    d.viewer().session.project.scene.background = Background::Color([0.0; 3]);
    let swapped = d.picture();
    assert!(psnr(&left, &swapped) > 50.0, "{}", psnr(&left, &swapped));
    // Pinned while a channel is shown, it is the whole colour all the same.
    d.viewer().session.project.scene.view = View::Diffuse;
    d.picture();
    d.viewer().session.project.pin();
    d.viewer().session.project.scene.view = View::Split;
    d.viewer().session.project.scene.wipe = 1.0;
    let whole = d.picture();
    assert!(psnr(&left, &whole) > 50.0, "{}", psnr(&left, &whole));
}

#[test]
fn any_kept_look_can_be_compared_with() {
    let mut d = Driver::bundled();
    let sunset = d.picture();
    d.after(|v| v.session.project.pin());
    assert_eq!(d.viewer().session.project.scene.variants.len(), 1);
    let city = d.folder.path("city.hdr");
    d.after(|v| v.session.set_light(1, city.clone()));
    let under_city = d.picture();
    d.after(|v| {
        v.session.project.pin();
        v.session.project.scene.display.exposure = 0.5;
    });
    let now = d.viewer().session.project.scene.clone();
    // The first one again, which is not what is shown.
    d.after(|v| v.session.project.compare_with(0));
    d.settle();
    assert_eq!(d.viewer().session.project.scene, now);
    let pinned = d
        .viewer()
        .session
        .project
        .pinned
        .clone()
        .expect("it is pinned");
    assert_eq!(pinned.scene.look_alone(), now.variants[0].look);
    // A key takes the two in turn, and what is kept stays.
    d.harness.key_press(Key::T);
    assert!(psnr(&sunset, &d.picture()) > 60.0);
    assert_eq!(d.viewer().session.project.scene.variants, now.variants);
    d.harness.key_press(Key::T);
    d.settle();
    assert_eq!(d.viewer().session.project.scene, now);
    d.after(|v| v.session.project.scene.display.exposure = 0.0);
    assert!(psnr(&under_city, &d.picture()) > 60.0);
}

/// Each look has its own table of colours, on the screen and in what is saved.
#[test]
fn looks_are_compared_by_their_own_tables_of_colours() {
    let mut d = Driver::bundled();
    d.viewer().session.overlays.grid = false;
    let plain = d.picture();
    d.after(|v| v.session.project.pin());
    let lut = PathBuf::from(d.folder.write("small.cube", small_lut()));
    d.after(|v| v.open(&lut));
    let graded = d.picture();
    let table = load_lut(&lut).expect("a table");
    let expected: Vec<[f32; 3]> = plain.iter().map(|p| table.apply(*p)).collect();
    // Of colours that were rounded to 8 bits before.
    assert!(psnr(&graded, &expected) > 48.0 && psnr(&graded, &plain) < 25.0);
    let size = d.viewer().session.project.viewport;
    let saved = d.folder.path("split.png");
    for (wipe, expected) in [(1.0, &plain), (0.0, &graded)] {
        d.after(|v| {
            v.session.project.scene.view = View::Split;
            v.session.project.scene.wipe = wipe;
            v.export_settings().size = size;
            v.export_settings().supersample = 1;
        });
        // The wipe's line is a column of pixels, and what another table makes of it is below 25 dB.
        let shown = psnr(&d.picture(), expected);
        assert!(shown > 33.0, "{wipe}: {shown}");
        d.after(|v| v.export(Task::Screenshot(Some(saved.clone()))));
        let found = psnr(&picture(&saved), expected);
        assert!(found > 33.0, "saved, {wipe}: {found}");
        std::fs::remove_file(&saved).expect("it was saved");
    }
    // One that is broken is told, and changes nothing that is seen.
    let broken = PathBuf::from(d.folder.write("broken.cube", "LUT_3D_SIZE 2\n0 0 0\n"));
    d.after(|v| {
        v.session.project.scene.view = View::After;
        v.open(&broken);
    });
    assert!(psnr(&d.picture(), &graded) > 60.0);
    let told = &d.viewer().session.messages;
    assert!(
        told.iter()
            .any(|m| m.is_error && m.text.contains("holds 1 colours"))
    );
}

#[test]
fn history_goes_back_to_any_step() {
    let mut d = Driver::bundled();
    let start = d.viewer().session.project.scene.clone();
    let dwell = |d: &mut Driver| {
        // Steps are of what has stayed for a second.
        for _ in 0..80 {
            d.harness.step();
        }
        d.settle();
    };
    dwell(&mut d);
    for stops in [1.0, 2.0] {
        d.after(|v| v.session.project.scene.display.exposure = stops);
        dwell(&mut d);
    }
    d.click("Edit");
    d.click("History");
    d.click("exposure 1");
    assert_eq!(d.viewer().session.project.scene.display.exposure, 1.0);
    for (key, stops) in [(Key::Z, 0.0), (Key::Y, 1.0), (Key::Y, 2.0)] {
        d.harness.key_press_modifiers(Modifiers::CTRL, key);
        d.settle();
        assert_eq!(d.viewer().session.project.scene.display.exposure, stops);
    }
    d.viewer().session.project.scene.display.exposure = 0.0;
    assert_eq!(d.viewer().session.project.scene, start);
}

/// A menu entry asks before it discards work, which can be had back, its looks too.
#[test]
fn discarded_work_comes_back_from_an_autosave() {
    let folder = Folder::empty();
    folder.write("small.ply", small_splat(100));
    let startup = Startup {
        files: vec![folder.path("small.ply")],
        work: Some(folder.path("kept/work.json")),
        ..Startup::default()
    };
    let mut d = Driver::open(startup, folder);
    // Nothing is changed yet: nothing is asked. A light beside it is a change.
    let path = d.folder.path("small.ply");
    d.harness.key_press_modifiers(Modifiers::CTRL, Key::N);
    d.settle();
    assert!(d.viewer().session.asset().is_none());
    d.after(|v| v.open(&path));
    assert!(d.viewer().session.asset().is_some());
    d.after(|v| {
        v.session.project.scene.environment.rotation = 70.0;
        v.session.project.keep_look();
    });
    let scene = d.viewer().session.project.scene.clone();
    d.harness.key_press_modifiers(Modifiers::CTRL, Key::N);
    d.settle();
    d.click("Cancel");
    assert_eq!(d.viewer().session.project.scene, scene);
    d.harness.key_press_modifiers(Modifiers::CTRL, Key::N);
    d.settle();
    d.click("Discard");
    let session = &d.viewer().session;
    assert!(session.asset().is_none() && session.project.scene.variants.is_empty());
    d.harness.get_by_label("Drop a splat here");
    // It is there at the next start, too.
    let folder = Folder::empty();
    let startup = Startup {
        work: Some(d.folder.path("kept/work.json")),
        ..Startup::default()
    };
    let mut again = Driver::open(startup, folder);
    again.click("File");
    again.click("Autosaves");
    // The newest is the first.
    let mut autosaves = again.harness.get_all_by_label("small, just now");
    autosaves.next().expect("an autosave").click();
    drop(autosaves);
    again.settle();
    let back = &again.viewer().session.project.scene;
    assert_eq!(back.environment.rotation, 70.0);
    assert_eq!(back.variants.len(), 1);
}

/// A document is saved where it was opened, and reverted to that.
#[test]
fn a_document_is_saved_and_reverted() {
    let mut d = Driver::bundled();
    let path = d.folder.path("teapot.json");
    let scene = d.viewer().session.project.scene_to_save();
    save_look(&path, &scene).expect("room");
    d.after(|v| v.open(&path));
    d.click("Discard");
    d.after(|v| v.session.project.scene.display.exposure = 1.0);
    d.harness.key_press_modifiers(Modifiers::CTRL, Key::S);
    d.settle();
    let exposure = |path| load_look(path).expect("its own file").display.exposure;
    assert_eq!(exposure(&path), 1.0);
    d.after(|v| v.session.project.scene.display.exposure = -1.0);
    d.click("File");
    d.click("Revert");
    d.click("Revert");
    assert_eq!(d.viewer().session.project.scene.display.exposure, 1.0);
    assert_eq!(exposure(&path), 1.0);
}
