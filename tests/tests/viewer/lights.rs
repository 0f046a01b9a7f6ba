//! Lights of one's own, sun and sky, and light over time, as the window has them.

use std::path::{Path, PathBuf};

use super::named::choose_side;
use eframe::egui::{self, Event, Modifiers, PointerButton, Pos2, Rect, accesskit::Role};
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use transplat::viewer::{ImageFormat, Startup, Task};
use transplat_core::camera::Camera;
use transplat_core::environment::{Sky, Sun};
use transplat_core::files::{load_look, load_rig, save_look};
use transplat_core::present::{Background, View};
use transplat_core::rasterize::pick;
use transplat_core::scene::{FixedTo, Light, LightKind, RigPreset, SKY, Scene};
use transplat_core::transfer::PreparedTransfer;
use transplat_tests::driver::Driver;
use transplat_tests::{Folder, args, picture, psnr, run_json};

/// Presses, moves and releases the first button, a frame each.
fn drag(d: &mut Driver, way: &[Pos2]) {
    let button = |pos, pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    d.harness.event(Event::PointerMoved(way[0]));
    d.harness.step();
    d.harness.event(button(way[0], true));
    d.harness.step();
    for at in way {
        d.harness.event(Event::PointerMoved(*at));
        d.harness.step();
    }
    d.harness.event(button(way[way.len() - 1], false));
    d.settle();
}

/// A point in the middle of the viewport.
fn middle(d: &Driver) -> Pos2 {
    let canvas = d.harness.get_by_label("Viewport");
    canvas.rect().center()
}

/// The camera of the viewport, and where that is in the window.
fn camera(d: &mut Driver) -> (Camera, Rect) {
    let canvas = d.harness.get_by_label("Viewport").rect();
    let session = &d.viewer().session;
    let size = [canvas.width() as usize, canvas.height() as usize];
    let radius = session.project.scene_bounds().expect("a scene").radius;
    let camera = Camera::from_pose(
        &session.project.pose,
        session.project.scene_up(),
        size,
        radius,
    );
    (camera, canvas)
}

/// Where a place of the world is seen in the window.
fn seen(d: &mut Driver, place: DVec3) -> Pos2 {
    let (camera, canvas) = camera(d);
    let scene = d.viewer().session.project.world_from_scene().transpose() * place;
    let ([x, y], _) = camera.project(scene.as_vec3());
    canvas.min + egui::vec2(x + 0.5, y + 0.5)
}

/// The object at a point of the window, in the world: where, and its normal.
fn surface(d: &mut Driver, at: Pos2) -> [DVec3; 2] {
    let (camera, canvas) = camera(d);
    let [x, y] = [at.x - canvas.min.x, at.y - canvas.min.y].map(|v| v as usize);
    let session = &d.viewer().session;
    let cloud = &session.asset().expect("a splat").cloud;
    let pick = pick(cloud, &camera, &[], x, y).expect("the object is there");
    let normal = session
        .project
        .scene_normal(0, pick.surfel)
        .expect("it is baked");
    [pick.position, normal].map(|v| session.project.world_from_scene() * v.as_dvec3())
}

/// Cosine between a surface and the one that would mirror the only light to the eye where it is clicked.
fn mirrors(d: &mut Driver, at: Pos2) -> f64 {
    let light = place(d);
    let [there, normal] = surface(d, at);
    let (camera, _) = camera(d);
    let eye = d.viewer().session.project.world_from_scene() * camera.eye.as_dvec3();
    let halfway = (light - there).normalize() + (eye - there).normalize();
    halfway.normalize().dot(normal).abs()
}

/// Position of the only light, or where it comes from.
fn place(d: &mut Driver) -> DVec3 {
    let source = &d.viewer().session.project.scene.lights[0].source;
    let from = |d: DVec3| -d;
    source
        .position()
        .unwrap_or_else(|| source.direction().map_or(DVec3::ZERO, from))
}

#[test]
fn a_light_is_added_placed_and_undone() {
    let mut d = Driver::bundled();
    d.after(|v| v.session.project.scene.background = Background::Color([0.1; 3]));
    let before = d.picture();
    d.click("Light");
    d.click("Placed lights");
    d.click("Add a light");
    d.click("spot light");
    assert_eq!(d.viewer().session.project.scene.lights.len(), 1);
    let lit = d.picture();
    assert!(psnr(&before, &lit) < 30.0, "it shines");

    // Its reflection where it is clicked: the surface there stands halfway between light and eye, to a fifth of a degree.
    let at = middle(&d);
    for to in [at, at + egui::vec2(20.0, -12.0)] {
        d.click("By highlight");
        drag(&mut d, &[to]);
        let cosine = mirrors(&mut d, to);
        assert!(cosine > 0.2f64.to_radians().cos(), "{to}: {cosine}");
    }
    let second = place(&mut d);
    // Beside the object there is nothing to place it by: that is said, and the next click places it.
    d.click("By highlight");
    let viewport = d.harness.get_by_label("Viewport").rect();
    let corner = viewport.left_bottom() + egui::vec2(30.0, -60.0);
    drag(&mut d, &[corner]);
    let messages = &d.viewer().session.messages;
    assert!(
        messages
            .iter()
            .any(|m| m.text.contains("Click or drag on an object"))
    );
    // They lie over the picture for a while.
    d.after(|v| v.session.messages.clear());
    assert_eq!(place(&mut d), second);
    drag(&mut d, &[at + egui::vec2(20.0, -12.0)]);
    assert!(place(&mut d).distance(second) < 1e-9);
    let second = place(&mut d);
    // A click alone orbits again afterwards.
    let azimuth = d.viewer().session.project.pose.azimuth;
    drag(
        &mut d,
        &[at, at + egui::vec2(30.0, 0.0), at + egui::vec2(60.0, 0.0)],
    );
    assert_ne!(d.viewer().session.project.pose.azimuth, azimuth);
    assert_eq!(place(&mut d), second);

    // Off, it is as it was before, but for where the camera is now.
    d.after(|v| v.session.project.scene.lights[0].on = false);
    let off = d.picture();
    d.after(|v| v.session.project.scene.lights.clear());
    assert!(psnr(&off, &d.picture()) > 80.0);
    // Undo brings it back.
    d.harness.key_press_modifiers(Modifiers::CTRL, egui::Key::Z);
    d.settle();
    assert_eq!(d.viewer().session.project.scene.lights.len(), 1);
}

/// The handle of a light that is out of the picture is at its rim; pulled, the light goes along and stays as far away.
#[test]
fn a_light_is_pulled_by_its_handle() {
    let mut d = Driver::bundled();
    d.click("Light");
    d.click("Placed lights");
    d.after(|v| v.session.add_light(LightKind::Rect));
    // In view: behind the object, to its right.
    d.after(|v| {
        let lit = v.session.lit();
        let placed = lit.around(160.0, 25.0, 1.6);
        v.session.project.scene.lights[0]
            .source
            .put(placed.position, placed.aim);
    });
    let (from, lit) = (place(&mut d), d.viewer().session.lit());
    let (_, canvas) = camera(&mut d);
    let at = seen(&mut d, from);
    assert!(canvas.shrink(30.0).contains(at), "{at} {canvas}");
    let steps = [0.0, 10.0, 25.0, 40.0].map(|by| at + egui::vec2(-by, 0.5 * by));
    drag(&mut d, &steps);
    let to = place(&mut d);
    assert!(from.distance(to) > 0.05 * lit.radius, "{from} {to}");
    let far = |p: DVec3| p.distance(lit.center);
    assert!((far(to) / far(from) - 1.0).abs() < 1e-6);
    let now = seen(&mut d, to);
    assert!(now.distance(steps[3]) < 2.0, "{now} {}", steps[3]);
}

#[test]
fn a_light_goes_along_with_what_it_is_fixed_to() {
    let mut d = Driver::bundled();
    d.after(|v| v.session.add_light(LightKind::Spot));
    let world = place(&mut d);
    d.after(|v| v.session.project.pose.azimuth += 90.0);
    assert_eq!(place(&mut d), world, "to the world");
    d.after(|v| v.session.project.scene.lights[0].fixed_to = FixedTo::Camera);
    d.after(|v| v.session.project.pose.azimuth += 90.0);
    let turned = place(&mut d);
    assert!(turned.distance(world) > 0.5, "to the camera");
    // And back with it.
    d.after(|v| v.session.project.pose.azimuth -= 90.0);
    assert!(place(&mut d).distance(world) < 1e-4);
    // Also on a turntable: its second frame is what is seen from behind.
    let folder = d.folder.path("turntable");
    let settings = d.viewer().export_settings();
    settings.size = [120, 90];
    settings.supersample = 1;
    settings.frames = 2;
    settings.folder = folder.display().to_string();
    settings.pattern = "{n}".into();
    d.after(|v| v.export(Task::Turntable));
    d.after(|v| v.session.project.pose.azimuth += 180.0);
    let behind = d.folder.path("behind.png");
    let path = behind.clone();
    d.after(|v| v.export(Task::Screenshot(Some(path))));
    d.after(|v| v.session.project.pose.azimuth -= 180.0);
    let mut frames = walk(&folder);
    frames.sort();
    let [frame, behind] = [&frames[1], &behind].map(|path| picture(path));
    assert!(psnr(&frame, &behind) > 45.0, "{}", psnr(&frame, &behind));
    d.after(|v| v.session.project.scene.lights[0].fixed_to = FixedTo::Object(0));
    d.after(|v| v.session.project.scene.objects[0].transform.translation.x += 2.0);
    let along = place(&mut d) - world;
    assert!((along.length() - 2.0).abs() < 1e-4, "{along}");
}

#[test]
fn rigs_are_taken_opened_and_saved() {
    let mut d = Driver::bundled();
    let mut seen: Vec<(RigPreset, Vec<[f32; 3]>)> = Vec::new();
    for preset in RigPreset::ALL {
        d.after(|v| v.session.take_preset(preset));
        assert!(d.viewer().session.messages.iter().all(|m| !m.is_error));
        let shown = d.picture();
        for (other, earlier) in &seen {
            assert!(psnr(&shown, earlier) < 35.0, "{preset:?} {other:?}");
        }
        seen.push((preset, shown));
    }
    let path = d.folder.path("rig.json");
    d.after(|v| v.session.save_rig(&path));
    let saved = load_rig(&path).expect("its own");
    let scene = d.viewer().session.project.scene.clone();
    // But for the last digit, which text may lose.
    let told = |lights: &[Light]| format!("{lights:.9?}");
    assert_eq!(told(&saved.lights), told(&scene.lights));
    // Opened, it is taken for no look: what else is set stays.
    d.after(|v| {
        v.session.project.scene.lights.clear();
        v.session.project.scene.display.exposure = 1.5;
    });
    d.after(|v| v.open(&path));
    let session = &d.viewer().session;
    assert_eq!(told(&session.project.scene.lights), told(&scene.lights));
    assert_eq!(session.project.scene.display.exposure, 1.5);
    assert_eq!(
        session.project.scene.environment.gain(),
        scene.environment.gain()
    );
    // One that is wrong changes nothing and says why.
    let wrong = d
        .folder
        .write("wrong.json", r#"{"lights": [{"type": "lamp"}]}"#);
    d.after(|v| v.open(wrong.as_ref()));
    let session = &d.viewer().session;
    assert!(
        session
            .messages
            .iter()
            .any(|m| m.is_error && m.text.contains("lamp"))
    );
    assert_eq!(told(&session.project.scene.lights), told(&scene.lights));
    // Nor does a splat where lights are asked for.
    let splat = d.folder.path("teapot.ply");
    d.after(|v| v.session.open_rig(&splat));
    let session = &d.viewer().session;
    let last = session.messages.last().expect("a message");
    assert!(last.is_error && last.text.contains("not a light rig"));
    assert_eq!(told(&session.project.scene.lights), told(&scene.lights));
    // Nor one that is empty.
    let empty = d.folder.write("empty.json", r#"{"lights": []}"#);
    d.after(|v| v.session.open_rig(empty.as_ref()));
    assert_eq!(
        told(&d.viewer().session.project.scene.lights),
        told(&scene.lights)
    );
    // Alone on the command line, it lights the bundled scene.
    let alone = Startup {
        files: vec![path],
        ..Startup::default()
    };
    let mut alone = Driver::open(alone, Folder::empty());
    let session = &alone.viewer().session;
    assert_eq!(told(&session.project.scene.lights), told(&scene.lights));
    assert!(session.project.has_asset());
}

/// Sun and sky, a near light, an environment without its sun: the screen, the saved picture and the commands show the same.
#[test]
fn what_lights_of_ones_own_show_the_commands_show() {
    let mut d = Driver::bundled();
    let settings = d.viewer().export_settings();
    settings.size = [200, 160];
    settings.supersample = 1;
    settings.format = ImageFormat::Png8;
    let sunset = d.folder.path("sunset.hdr");
    let mut drawn: Vec<Vec<[f32; 3]>> = Vec::new();
    for case in 0..3 {
        d.after(|v| {
            let session = &mut v.session;
            match case {
                0 => {
                    session.set_light(1, PathBuf::from(SKY));
                    session.project.scene.environment.sky = Some(Sky {
                        sun: Sun::SOMEWHERE,
                        ..Sky::default()
                    });
                }
                1 => session.add_light(LightKind::Disc),
                _ => session.set_light(1, sunset.clone()),
            }
        });
        if case == 2 {
            let whole = d.picture();
            let lights = d.viewer().session.project.scene.lights.len();
            d.after(|v| v.session.take_out_suns());
            let session = &d.viewer().session;
            assert!(session.project.scene.environment.without_suns);
            assert!(session.project.scene.lights.len() > lights, "it has a sun");
            // It shines as before, from where it was, with the disc of the real one; the picture behind has none.
            d.after(|v| v.session.project.scene.background = Background::Color([0.2; 3]));
            let apart = d.picture();
            d.after(|v| {
                v.session.project.scene.environment.without_suns = false;
                v.session.project.scene.lights.truncate(lights);
            });
            let together = d.picture();
            assert!(
                psnr(&apart, &together) > 38.0,
                "{}",
                psnr(&apart, &together)
            );
            assert!(psnr(&whole, &together) < 60.0);
            d.after(|v| {
                v.session.project.scene.background = Background::Environment;
                v.session.take_out_suns();
            });
        }
        let [look, ours, theirs] =
            ["look.json", "ours.png", "theirs.png"].map(|n| d.folder.name(n));
        let scene = d.viewer().session.project.scene_to_save();
        save_look(look.as_ref(), &scene).expect("room");
        let again = load_look(look.as_ref()).expect("its own");
        let told = |scene: &Scene| format!("{:.6?} {:?}", scene.lights, scene.environment.sky);
        assert_eq!(told(&again), told(&scene));
        let path = ours.clone().into();
        d.after(|v| v.export(Task::Screenshot(Some(path))));
        let line = "render {} --size 200x160 --device cpu -o {}";
        run_json(&args(line, &[&look, &theirs]));
        let [a, b] = [&ours, &theirs].map(|p| picture(p.as_ref()));
        assert!(psnr(&a, &b) > 45.0, "{case}: {}", psnr(&a, &b));
        for other in &drawn {
            assert!(psnr(&a, other) < 35.0, "{case}");
        }
        drawn.push(a);
        std::fs::remove_file(&ours).expect("it was saved");
    }
}

#[test]
fn light_over_time_is_played_and_saved() {
    let mut d = Driver::bundled();
    d.after(|v| v.session.project.scene.environment.rotation = 0.0);
    d.click("View");
    d.click("Timeline");
    d.harness.key_press(egui::Key::Escape);
    d.settle();
    d.click("Set key");
    // The time went on to where the next key belongs.
    d.after(|v| v.session.project.scene.environment.rotation = 90.0);
    d.click("Set key");
    let animation = d.viewer().session.project.scene.animation.clone();
    let keys: Vec<_> = animation
        .keys
        .iter()
        .map(|k| (k.time, k.rotation))
        .collect();
    assert_eq!(keys, [(0.0, 0.0), (2.0, 90.0)]);
    // Halfway along the bar's keys it is halfway between them.
    let bar = d
        .harness
        .get_by_role_and_label(Role::Slider, "Timeline")
        .rect();
    let (start, end) = (bar.left_center(), bar.right_center());
    let shown = 5.0;
    let at = |time: f32| start + egui::vec2(12.0 + time / shown * (end.x - start.x - 24.0), 0.0);
    drag(&mut d, &[at(0.5), at(0.8), at(1.0)]);
    let rotation = d.viewer().session.project.scene.environment.rotation;
    assert!((rotation - 45.0).abs() < 3.0, "{rotation}");
    // That was no step: what is undone is a key, or both where they were set within a second.
    d.harness.key_press_modifiers(Modifiers::CTRL, egui::Key::Z);
    d.settle();
    assert!(d.viewer().session.project.scene.animation.keys.len() < 2);
    d.harness
        .key_press_modifiers(Modifiers::CTRL | Modifiers::SHIFT, egui::Key::Z);
    d.settle();
    assert_eq!(d.viewer().session.project.scene.animation, animation);
    let frames = animated(&mut d, "turned", 2);
    assert_eq!(frames.len(), 5);
    assert!(psnr(&frames[0], &frames[4]) < 35.0);
    // One map behind either side, and in one of them without its suns.
    let sunset = d.folder.path("sunset.hdr");
    d.after(|v| {
        v.session.object_mut().source.file = Some(sunset.clone());
        v.session.set_light(1, sunset);
    });
    d.after(|v| {
        v.session.project.scene.background = Background::Environment;
        v.session.project.scene.view = View::SideBySide;
        v.session.project.scene.environment.without_suns = true;
    });
    assert_eq!(animated(&mut d, "beside", 1).len(), 3);
}

/// Frames of the animation, which the command makes as the window does.
fn animated(d: &mut Driver, name: &str, frame_rate: u32) -> Vec<Vec<[f32; 3]>> {
    let folder = d.folder.path(name);
    let settings = d.viewer().export_settings();
    settings.size = [120, 90];
    settings.supersample = 1;
    settings.frame_rate = frame_rate;
    settings.folder = folder.display().to_string();
    settings.pattern = "{n}".into();
    d.after(|v| v.export(Task::Animation));
    let look = d.folder.name("look.json");
    let scene = d.viewer().session.project.scene_to_save();
    save_look(look.as_ref(), &scene).expect("room");
    let out = d.folder.name(&format!("{name}-of-command"));
    let line = "render {} --animation --frame-rate {} --size 120x90 --device cpu -o {}";
    run_json(&args(line, &[&look, &frame_rate.to_string(), &out]));
    let [ours, theirs] = [folder.as_path(), out.as_ref()].map(|folder| {
        let mut paths = walk(folder);
        paths.sort();
        paths.iter().map(|path| picture(path)).collect::<Vec<_>>()
    });
    assert_eq!(ours.len(), theirs.len());
    for (a, b) in ours.iter().zip(&theirs) {
        assert!(psnr(a, b) > 45.0, "{name}: {}", psnr(a, b));
    }
    ours
}

/// All files in a folder and its folders.
fn walk(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("it was made");
    let paths = entries.map(|entry| entry.expect("readable").path());
    paths
        .flat_map(|path| {
            if path.is_dir() {
                walk(&path)
            } else {
                vec![path]
            }
        })
        .collect()
}

/// A directional light's place by shadow: on the line from where the shadow falls through what throws it.
#[test]
fn a_sun_is_placed_by_its_shadow() {
    let mut d = Driver::bundled();
    d.click("Light");
    d.click("Placed lights");
    d.after(|v| v.session.add_light(LightKind::Directional));
    d.click("By shadow");
    let at = middle(&d);
    let to = at + egui::vec2(12.0, 30.0);
    let [[caster, _], [falls, _]] = [at, to].map(|at| surface(&mut d, at));
    drag(&mut d, &[at, at + egui::vec2(6.0, 10.0), to]);
    let (to_light, wanted) = (place(&mut d), (caster - falls).normalize());
    // As exact as places are that are single.
    assert!(to_light.distance(wanted) < 1e-4, "{to_light} {wanted}");
}

/// Keys that a look comes with are shown; Delete takes the one under the pointer, over the bar else the one at the light's time, and elsewhere the
/// object.
#[test]
fn keys_come_with_a_look_and_go_one_by_one() {
    let mut d = Driver::bundled();
    let bar = |d: &Driver| {
        let bar = d.harness.query_by_role_and_label(Role::Slider, "Timeline");
        bar.map(|bar| bar.rect())
    };
    assert_eq!(bar(&d), None);
    let mut scene = d.viewer().session.project.scene_to_save();
    for time in [0.0, 1.0] {
        let key = scene.light_key(time);
        scene.animation.set(key);
    }
    let look = d.folder.path("keys.json");
    save_look(&look, &scene).expect("room");
    d.after(|v| v.open(&look));
    d.click("Discard");
    let shown = bar(&d).expect("the timeline is shown");
    let left = |d: &mut Driver| {
        let scene = &d.viewer().session.project.scene;
        let times: Vec<f64> = scene.animation.keys.iter().map(|key| key.time).collect();
        (times, scene.objects.len())
    };
    d.after(|v| v.session.project.duplicate(v.session.selected));
    assert_eq!(left(&mut d), (vec![0.0, 1.0], 2));
    // Five seconds are shown, between two tips of a key at either end.
    let second = shown.left_center() + egui::vec2(12.0 + (shown.width() - 24.0) / 5.0, 0.0);
    for (at, expected) in [
        (second, (vec![0.0], 2)),
        (shown.center(), (vec![], 2)),
        (middle(&d), (vec![], 1)),
    ] {
        d.harness.event(Event::PointerMoved(at));
        d.settle();
        d.harness.key_press(egui::Key::Delete);
        d.settle();
        assert_eq!(left(&mut d), expected);
    }
}

/// A click tells what is white of the capture; the light is then so strong and of such a tint that it is.
#[test]
fn what_is_clicked_as_white_is_white_under_the_capture_light() {
    let mut d = Driver::bundled();
    d.after(|v| {
        let source = &mut v.session.object_mut().source;
        (source.strength, source.tint) = (1.0, [1.0, 0.6, 0.4]);
    });
    d.click("Light");
    choose_side(&mut d, "Capture light");
    // Light that bounces from the rest is not the light's: the second click comes nearer.
    let mut surfel = 0;
    for _ in 0..2 {
        d.click("By white");
        let at = middle(&d);
        let (camera, canvas) = camera(&mut d);
        let [x, y] = [at.x - canvas.min.x, at.y - canvas.min.y].map(|v| v as usize);
        let cloud = d.viewer().session.asset().expect("a splat").cloud.clone();
        surfel = pick(&cloud, &camera, &[], x, y)
            .expect("it is there")
            .surfel;
        drag(&mut d, &[at]);
        d.settle();
    }
    let Some(PreparedTransfer::Directional(best)) = d.viewer().session.prepared() else {
        panic!("one object by preset best");
    };
    let white = best.albedo_around(surfel);
    assert!(
        white.iter().all(|a| (a / 0.8 - 1.0).abs() < 0.05),
        "{white:?}"
    );
}
