//! Looks and views that are kept with the scene.

use eframe::egui::{Key, Modifiers};
use transplat_core::files::{load_look, save_look};
use transplat_tests::driver::Driver;
use transplat_tests::psnr;

#[test]
fn a_kept_look_and_a_kept_view_come_back_as_they_were() {
    let mut d = Driver::bundled();
    let before = d.picture();
    let (scene, pose) = {
        let session = &mut d.viewer().session;
        session.keep_look();
        session.keep_view();
        // What is kept already is not kept twice.
        session.keep_look();
        session.keep_view();
        (session.scene.clone(), session.pose)
    };
    assert_eq!((scene.variants.len(), scene.bookmarks.len()), (1, 1));
    assert_eq!(scene.variants[0].name, "sunset");
    let city = d.folder.path("city.hdr");
    d.after(|v| {
        v.session.set_light(1, city);
        v.session.scene.display.exposure = 1.0;
        v.session.pose.azimuth += 70.0;
        v.session.scene.note = "brighter".into();
    });
    assert!(psnr(&before, &d.picture()) < 25.0);
    // What is compared and how is no part of it.
    d.viewer().session.scene.wipe = 0.3;
    d.click("Looks 1");
    d.click("Look sunset");
    d.click("Views 1");
    d.click("View view");
    let session = &d.viewer().session;
    assert_eq!(session.pose, pose);
    assert_eq!(session.scene.look_alone(), scene.variants[0].look);
    assert_eq!(session.scene.wipe, 0.3);
    assert_eq!(session.scene.objects, scene.objects);
    assert!(psnr(&before, &d.picture()) > 60.0);
    // It is all in the look that is saved.
    let saved = d.viewer().session.scene_to_save();
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
    assert_eq!(d.viewer().session.scene.variants, scene.variants);
}

#[test]
fn keys_go_from_look_to_look_and_from_view_to_view() {
    let mut d = Driver::bundled();
    for (i, azimuth) in [10.0, 80.0, 150.0].into_iter().enumerate() {
        d.after(|v| {
            v.session.pose.azimuth = azimuth;
            v.session.scene.display.exposure = i as f32;
            v.session.keep_look();
        });
        d.harness.key_press_modifiers(Modifiers::CTRL, Key::B);
        d.settle();
    }
    let names = |d: &mut Driver| -> Vec<String> {
        let kept = &d.viewer().session.scene.variants;
        kept.iter().map(|kept| kept.name.clone()).collect()
    };
    assert_eq!(names(&mut d), ["sunset", "sunset 2", "sunset 3"]);
    assert_eq!(d.viewer().session.scene.bookmarks.len(), 3);
    d.harness.key_press(Key::PageDown);
    d.settle();
    assert_eq!(d.viewer().session.pose.azimuth, 10.0);
    d.harness.key_press(Key::PageUp);
    d.harness.key_press(Key::PageUp);
    d.settle();
    assert_eq!(d.viewer().session.pose.azimuth, 80.0);
    d.harness.key_press_modifiers(Modifiers::CTRL, Key::PageUp);
    d.settle();
    let session = &d.viewer().session;
    assert_eq!(session.scene.display.exposure, 1.0);
    assert_eq!(session.pose.azimuth, 80.0);
}

#[test]
fn any_kept_look_can_be_compared_with() {
    let mut d = Driver::bundled();
    let sunset = d.picture();
    d.after(|v| v.session.pin());
    assert_eq!(d.viewer().session.scene.variants.len(), 1);
    let city = d.folder.path("city.hdr");
    d.after(|v| v.session.set_light(1, city.clone()));
    let under_city = d.picture();
    d.after(|v| {
        v.session.pin();
        v.session.scene.display.exposure = 0.5;
    });
    let now = d.viewer().session.scene.clone();
    // The first one again, which is not what is shown.
    d.after(|v| v.session.compare_with(0));
    d.settle();
    assert_eq!(d.viewer().session.scene, now);
    let pinned = d.viewer().session.pinned.clone().expect("it is pinned");
    assert_eq!(pinned.scene.look_alone(), now.variants[0].look);
    // A key takes the two in turn.
    d.harness.key_press(Key::T);
    assert!(psnr(&sunset, &d.picture()) > 60.0);
    d.harness.key_press(Key::T);
    d.settle();
    assert_eq!(d.viewer().session.scene, now);
    d.after(|v| v.session.scene.display.exposure = 0.0);
    assert!(psnr(&under_city, &d.picture()) > 60.0);
}

#[test]
fn history_goes_back_to_any_step() {
    let mut d = Driver::bundled();
    let start = d.viewer().session.scene.clone();
    let dwell = |d: &mut Driver| {
        // Steps are of what has stayed for a second.
        for _ in 0..80 {
            d.harness.step();
        }
        d.settle();
    };
    dwell(&mut d);
    for stops in [1.0, 2.0] {
        d.after(|v| v.session.scene.display.exposure = stops);
        dwell(&mut d);
    }
    d.click("Edit");
    d.click("History");
    d.click("exposure 1");
    assert_eq!(d.viewer().session.scene.display.exposure, 1.0);
    for (key, stops) in [(Key::Z, 0.0), (Key::Y, 1.0), (Key::Y, 2.0)] {
        d.harness.key_press_modifiers(Modifiers::CTRL, key);
        d.settle();
        assert_eq!(d.viewer().session.scene.display.exposure, stops);
    }
    d.viewer().session.scene.display.exposure = 0.0;
    assert_eq!(d.viewer().session.scene, start);
}
