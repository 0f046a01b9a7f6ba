//! Scenes of several objects in the window.

use std::path::Path;

use eframe::egui;
use glam::{Quat, Vec3};
use transplat::viewer::{ImageFormat, Startup, Task};
use transplat_core::color::{Encoding, decode_sh, encode_sh};
use transplat_core::files::{
    load_environment, load_look, load_picture, load_splat, save_look, write_splat,
};
use transplat_core::present::{Background, View};
use transplat_core::scene::{Scene, Transform};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::surfels::{Bounds, SurfelCloud, UpAxis};
use transplat_core::synthetic;
use transplat_engine::project::Remedy;
use transplat_tests::driver::Driver;
use transplat_tests::{Folder, args, asset, picture, psnr, run_json};

fn write(folder: &Folder, name: &str, cloud: &SurfelCloud) {
    let stored = encode_sh(cloud.sh.to_vec(), cloud.sh_degree, Encoding::Stored);
    write_splat(cloud, &stored, &folder.path(name)).expect("room");
}

/// A ball of which each surfel has a colour of its own, another one from each side: it shows how it is turned.
fn colored_ball() -> SurfelCloud {
    let mut ball = synthetic::sphere(800);
    let sides = |(dc, p): (&[f32; 3], &Vec3)| {
        let along = p.to_array().map(|x| 0.3 * x);
        [*dc, along, [0.0; 3], along.map(|x| -x)]
    };
    ball.sh = ball
        .sh
        .iter()
        .zip(&ball.positions)
        .flat_map(sides)
        .collect();
    ball.sh_degree = 1;
    ball
}

/// A grey ball over a plate.
fn ball_over_plate() -> Driver {
    over_plate(&synthetic::sphere(800))
}

/// A ball over a plate, turned, both captured under even light and lit by a city.
fn over_plate(ball: &SurfelCloud) -> Driver {
    let folder = Folder::empty();
    write(&folder, "plate.ply", &synthetic::sheet(30));
    write(&folder, "ball.ply", ball);
    std::fs::copy(asset("city.hdr"), folder.path("city.hdr")).expect("room");
    let scene = r#"{"version": 3, "target": {"file": "city.hdr"}, "objects": [
        {"asset": "plate.ply", "source": {"file": "even"}},
        {"name": "the ball", "asset": "ball.ply", "source": {"file": "even"},
         "transform": {"scale": 0.4, "rotation": [0, 0, 0.6, 0.8], "translation": [0, 0, 0.5]}}]}"#;
    folder.write("scene.json", scene);
    let startup = Startup {
        files: vec![folder.path("scene.json")],
        ..Startup::default()
    };
    Driver::open(startup, folder)
}

#[test]
fn a_scene_is_shown_and_saved_as_the_command_line_draws_it() {
    let mut d = ball_over_plate();
    assert_eq!(d.viewer().session.project.states.len(), 2);
    let [look, ours, theirs] = ["look.json", "ours.png", "theirs.png"].map(|n| d.folder.name(n));
    let scene = d.viewer().session.project.scene_to_save();
    save_look(look.as_ref(), &scene).expect("room");
    assert_eq!(load_look(look.as_ref()).expect("its own").objects.len(), 2);
    let settings = d.viewer().export_settings();
    settings.size = [200, 160];
    settings.transparent = true;
    settings.supersample = 1;
    let path = ours.clone().into();
    d.after(|v| v.export(Task::Screenshot(Some(path))));
    let line = "render {} --size 200x160 --background transparent --device cpu -o {}";
    run_json(&args(line, &[&look, &theirs]));
    let [a, b] = [&ours, &theirs].map(|p| picture(p.as_ref()));
    assert!(psnr(&a, &b) > 45.0, "{}", psnr(&a, &b));
    // In layers, the same again, with the look that makes it.
    d.viewer().export_settings().format = ImageFormat::ExrLayers;
    let [layers, theirs] = ["layers.exr", "layers_theirs.exr"].map(|n| d.folder.path(n));
    let path = layers.clone();
    d.after(|v| v.export(Task::Screenshot(Some(path))));
    let beside = d.folder.name("layers.look.json");
    let out = theirs.display().to_string();
    let line = "render {} --size 200x160 --layers --device cpu -o {}";
    run_json(&args(line, &[&beside, &out]));
    let [a, b] = [&layers, &theirs].map(|p| load_picture(p).expect("a picture").pixels);
    let opaque = |p: &Vec<[f32; 4]>| p.iter().map(|p| [p[0], p[1], p[2]]).collect::<Vec<_>>();
    assert!(psnr(&opaque(&a), &opaque(&b)) > 45.0);
    d.viewer().export_settings().format = ImageFormat::Png8;
    // A comparison has the pinned look at its left: here all of it.
    let compared = d.folder.path("compared.png");
    let path = compared.clone();
    d.viewer().session.project.pin();
    d.after(|v| {
        let scene = &mut v.session.project.scene;
        scene.environment.strength -= 2.0;
        (scene.view, scene.wipe) = (View::Split, 1.0);
    });
    d.after(|v| v.export(Task::Screenshot(Some(path))));
    let [a, b] = [Path::new(&ours), &compared].map(picture);
    assert!(psnr(&a, &b) > 45.0, "{}", psnr(&a, &b));
    d.viewer().session.project.scene.view = View::After;
    // All of it as one splat.
    let merged = d.folder.path("merged.ply");
    let path = merged.clone();
    d.after(|v| v.export(Task::Splat(path)));
    let (cloud, _) = load_splat(&merged).expect("a splat");
    assert_eq!(cloud.len(), 900 + 800);
    // What is hidden is not saved, selected or not.
    d.after(|v| {
        v.session.selected = 1;
        v.session.object_mut().shown = false;
    });
    let plate = d.folder.path("plate_relit.ply");
    let path = plate.clone();
    d.after(|v| v.export(Task::Splat(path)));
    let (cloud, _) = load_splat(&plate).expect("a splat");
    assert_eq!(cloud.len(), 900);
}

/// By preset paper, too: lit by a probe, with a shadow on what is near, also where an object was moved.
#[test]
fn a_scene_of_preset_paper_is_what_the_command_line_draws() {
    let mut d = over_plate(&colored_ball());
    let settings = d.viewer().export_settings();
    settings.size = [200, 160];
    settings.transparent = true;
    settings.supersample = 1;
    d.after(|v| v.session.project.scene.transfer = TransferSettings::of(Method::Harmonic));
    let mut drawn = Vec::new();
    for at in [Vec3::new(0.0, 0.0, 0.5), Vec3::new(0.4, 0.2, 0.6)] {
        d.after(|v| v.session.project.scene.objects[1].transform.translation = at);
        let [look, ours, theirs] =
            ["look.json", "ours.png", "theirs.png"].map(|n| d.folder.name(n));
        let scene = d.viewer().session.project.scene_to_save();
        save_look(look.as_ref(), &scene).expect("room");
        let path = ours.clone().into();
        d.after(|v| v.export(Task::Screenshot(Some(path))));
        let line = "render {} --size 200x160 --background transparent --device cpu -o {}";
        run_json(&args(line, &[&look, &theirs]));
        let [a, b] = [&ours, &theirs].map(|p| picture(p.as_ref()));
        assert!(psnr(&a, &b) > 45.0, "{at}: {}", psnr(&a, &b));
        drawn.push(a);
        std::fs::remove_file(&ours).expect("it was saved");
    }
    assert!(psnr(&drawn[0], &drawn[1]) < 35.0);
    // What is on the screen is the same, each object in coordinates of its own.
    let [look, relit] = ["look.json", "relit"].map(|n| d.folder.name(n));
    run_json(&args("relight {} --device cpu -o {}", &[&look, &relit]));
    let path = d.folder.path("relit").join("the ball.ply");
    let (theirs, _) = load_splat(&path).expect("the command's");
    let theirs = decode_sh(&theirs.sh, 1, theirs.encoding);
    let session = &mut d.viewer().session;
    session.selected = 1;
    for (i, theirs) in theirs.chunks_exact(4).enumerate() {
        let (_, ours) = session.relit_surfel(i).expect("it is relit");
        for (a, b) in ours.as_flattened().iter().zip(theirs.as_flattened()) {
            assert!((a - b).abs() < 0.01, "surfel {i}: {ours:?} {theirs:?}");
        }
    }
    // It has the ball's shadow, too: alone, a plate of one normal changes by the same everywhere.
    session.selected = 0;
    let taus = (0..900).map(|i| session.relit_surfel(i).expect("it is relit").0[1]);
    let (low, high) = taus.fold((f32::MAX, 0f32), |(a, b), t| (a.min(t), b.max(t)));
    assert!(low < 0.8 * high, "{low} of {high}");
}

#[test]
fn objects_are_moved_doubled_hidden_and_taken_away_and_come_back() {
    let mut d = ball_over_plate();
    let first = d.picture();
    let session = &mut d.viewer().session;
    session.selected = 1;
    let at_rest = session.canvas.passes();
    // Moved, everything is relit, drawn and sorted anew.
    session.project.scene.objects[1].transform.translation = Vec3::new(0.3, 0.0, 0.9);
    let moved = d.picture();
    assert!(psnr(&first, &moved) < 35.0);
    assert!(d.viewer().session.canvas.passes().transfer > at_rest.transfer);
    // Down on the plate: the ball's lowest point is on it.
    d.after(|v| v.session.project.drop_to_ground(v.session.selected));
    let foot = |d: &mut Driver| {
        let object = &d.viewer().session.project.scene.objects[1];
        object.transform.translation.z - 0.4
    };
    assert!(foot(&mut d).abs() < 0.02, "{}", foot(&mut d));
    let dropped = d.picture();
    let scene = d.viewer().session.project.scene.clone();
    d.after(|v| v.session.project.duplicate(v.session.selected));
    assert_eq!(
        (
            d.viewer().session.project.states.len(),
            d.viewer().session.selected
        ),
        (3, 2)
    );
    let doubled = d.picture();
    assert!(psnr(&dropped, &doubled) < 40.0);
    d.after(|v| v.session.remove_object());
    assert!(psnr(&dropped, &d.picture()) > 50.0);
    assert_eq!(d.viewer().session.project.scene, scene);
    // The first one away, and back: as another one's loading and undoing does it.
    d.after(|v| {
        v.session.selected = 0;
        v.session.remove_object();
    });
    assert_eq!(
        d.viewer().session.project.scene.objects[0].name.as_deref(),
        Some("the ball")
    );
    let alone = d.picture();
    assert!(psnr(&dropped, &alone) < 35.0);
    let back = scene.clone();
    d.after(|v| v.session.apply(back));
    assert_eq!(d.viewer().session.project.scene.objects.len(), 2);
    assert!(psnr(&dropped, &d.picture()) > 50.0);
    // A look of fewer objects is applied while the last one is selected.
    let mut fewer = scene.clone();
    fewer.objects.truncate(1);
    let session = &mut d.viewer().session;
    session.selected = 1;
    session.apply(fewer);
    assert_eq!(session.selected, 0);
    let back = scene.clone();
    d.after(|v| v.session.apply(back));
    // What is not shown leaves no shadow, and neither does what is gone.
    d.after(|v| v.session.project.scene.objects[1].shown = false);
    let hidden = d.picture();
    assert!(psnr(&dropped, &hidden) < 35.0);
    d.after(|v| {
        v.session.selected = 1;
        v.session.remove_object();
    });
    let plate = d.picture();
    assert!(psnr(&hidden, &plate) > 45.0, "{}", psnr(&hidden, &plate));
    let mut back = scene.clone();
    back.objects[1].shown = false;
    d.after(|v| v.session.apply(back));
    // The light at the ball: the plate below it, the sky above; on the shelf and in a file.
    let out = d.folder.name("lights");
    d.viewer().export_settings().folder = out.clone();
    let lights = d.viewer().light_library().len();
    d.viewer().session.selected = 1;
    d.after(|v| v.session.save_light_here(&out));
    assert_eq!(d.viewer().light_library().len(), lights + 1);
    let saved = d.folder.path("lights").join("light_at_the ball.exr");
    assert!(load_environment(&saved).is_ok_and(|map| map.width() == 256));
    // What is opened is put into the scene, and replaces nothing.
    let ball = d.folder.path("ball.ply");
    d.after(|v| {
        v.session.adds_splats = true;
        v.open(Path::new(&ball));
    });
    let session = &d.viewer().session;
    assert_eq!((session.project.states.len(), session.selected), (3, 2));
    assert!(
        session.messages.iter().all(|m| !m.is_error),
        "{:?}",
        session.messages
    );
}

/// A scene is in the units of its first object, and splats are in any: what is added is as large as what is there, or as its file has it where
/// that may be meant.
#[test]
fn what_is_added_stands_upright_and_in_other_units_is_made_as_large_as_the_scene() {
    let mut d = ball_over_plate();
    let mut giant = synthetic::sphere(200);
    let mut speck = giant.clone();
    for (cloud, scale) in [(&mut giant, 1000.0), (&mut speck, 1e-4)] {
        cloud.positions.iter_mut().for_each(|p| *p *= scale);
        cloud.scales.iter_mut().for_each(|s| *s *= scale);
    }
    let meant = SurfelCloud {
        up: UpAxis::PlusY,
        ..synthetic::sphere(200)
    };
    // A ball on the ground, on its side, of which the file says nothing.
    let onto_y = glam::DMat3::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    let lying = synthetic::turned(&synthetic::sphere_over_plate(2000), onto_y);
    d.after(|v| v.session.adds_splats = true);
    let radius = |d: &mut Driver| {
        d.viewer()
            .session
            .project
            .scene_bounds()
            .expect("a scene")
            .radius
    };
    for (name, cloud, up, is_scaled) in [
        ("giant.ply", &giant, UpAxis::PlusZ, true),
        ("speck.ply", &speck, UpAxis::PlusZ, true),
        ("meant.ply", &meant, UpAxis::PlusY, false),
        ("lying.ply", &lying, UpAxis::PlusY, false),
    ] {
        write(&d.folder, name, cloud);
        let (before, file) = (radius(&mut d), d.folder.path(name));
        if name == "lying.ply" {
            let bytes = std::fs::read(&file).expect("it was written");
            let comment = b"comment Vertical axis: +z\n";
            let at = bytes.windows(comment.len()).position(|w| w == comment);
            let (head, tail) = bytes.split_at(at.expect("its comment"));
            let unset = [head, &tail[comment.len()..]].concat();
            d.folder.write(name, unset);
        }
        d.viewer().session.messages.clear();
        d.after(|v| v.open(&file));
        let session = &d.viewer().session;
        let is_said = session
            .messages
            .iter()
            .any(|m| m.text.contains("scale was matched"));
        assert_eq!(is_said, is_scaled, "{name}: {:?}", session.messages);
        let (object, state) = (session.object(), session.project.states.last());
        assert_eq!(object.transform.scale == 1.0, !is_scaled, "{name}");
        let own = state
            .and_then(|s| s.asset.as_ref())
            .expect("it is there")
            .bounds;
        let own = own.transformed(object.transform.scene_from_object());
        if is_scaled {
            assert!((own.radius / before - 1.0).abs() < 0.01, "{name}");
        }
        // What is up in it is up in the scene.
        let up = object.transform.rotation * up.direction();
        assert!(up.dot(Vec3::Z) > 0.9999, "{name}: {up}");
        // As large as the others and beside them, not within.
        assert!(!is_scaled || radius(&mut d) > 1.3 * before, "{name}");
    }
}

#[test]
fn what_cannot_be_loaded_stops_nothing_else_and_is_not_forgotten() {
    let folder = Folder::empty();
    write(&folder, "plate.ply", &synthetic::sheet(20));
    std::fs::copy(asset("city.hdr"), folder.path("city.hdr")).expect("room");
    let scene = r#"{"version": 3, "target": {"file": "city.hdr"}, "objects": [
        {"asset": "gone.ply", "source": {"file": "even"}},
        {"asset": "plate.ply", "source": {"file": "even"}}]}"#;
    folder.write("scene.json", scene);
    let startup = Startup {
        files: vec![folder.path("scene.json")],
        ..Startup::default()
    };
    let mut d = Driver::open(startup, folder);
    let session = &d.viewer().session;
    let told = session.messages.iter().filter(|m| m.is_error);
    assert!(told.clone().count() == 1 && told.clone().all(|m| m.text.contains("gone.ply")));
    assert!(session.project.states[1].asset.is_some() && session.project.is_missing(0));
    let saved = session.project.scene_to_save();
    assert!(
        saved.objects[0]
            .asset
            .as_ref()
            .is_some_and(|p| p.ends_with("gone.ply"))
    );
    // What does not stand is picture enough for what does.
    let without = d.picture();
    write(&d.folder, "gone.ply", &synthetic::sphere(400));
    d.after(|v| v.session.project.load_again(0));
    assert!(d.viewer().session.project.states[0].asset.is_some());
    assert!(psnr(&without, &d.picture()) < 35.0);
    // What is added and is no splat leaves nothing behind.
    d.folder.write("bad.ply", "ply\nformat ascii 1.0\n");
    let bad = d.folder.path("bad.ply");
    d.after(|v| {
        v.session.adds_splats = true;
        v.open(&bad);
    });
    let session = &d.viewer().session;
    assert_eq!(
        (
            session.project.scene.objects.len(),
            session.project.states.len()
        ),
        (2, 2)
    );
}

#[test]
fn all_that_is_added_arrives_and_what_is_changed_meanwhile_stays() {
    let mut d = ball_over_plate();
    let [ball, plate] = ["ball.ply", "plate.ply"].map(|n| d.folder.path(n));
    let pose = {
        let session = &mut d.viewer().session;
        session.project.pose.azimuth = 33.0;
        session.project.pose
    };
    let before = d.viewer().session.project.scene.clone();
    d.after(|v| {
        v.session.adds_splats = true;
        v.open(&ball);
        v.open(&plate);
        v.session.project.scene.environment.rotation = 40.0;
        v.session.project.scene.objects[0].name = Some("ground".into());
    });
    let session = &d.viewer().session;
    assert_eq!(session.project.states.len(), 4);
    assert!(session.project.states.iter().all(|s| s.asset.is_some()));
    assert_eq!(session.project.scene.environment.rotation, 40.0);
    assert_eq!(
        session.project.scene.objects[0].name.as_deref(),
        Some("ground")
    );
    // The plate came beside the scene, since it is as large; all is seen, from the same side.
    let aside = session.project.scene.objects[3].transform.translation;
    assert!(aside.length() > 1.0, "{aside}");
    assert_eq!(session.project.pose.azimuth, pose.azimuth);
    assert!(session.project.pose.distance > pose.distance);
    // Back, and forth: what was taken away is loaded again, where the camera is.
    let four = d.viewer().session.project.scene.clone();
    for scene in [before, four] {
        let count = scene.objects.len();
        let scene = Scene {
            camera: Some(pose),
            ..scene
        };
        d.after(|v| v.session.apply(scene));
        let session = &d.viewer().session;
        assert_eq!(
            (session.project.states.len(), session.project.pose),
            (count, pose)
        );
        assert!(session.project.states.iter().all(|s| s.asset.is_some()));
    }
}

/// The light stays with the scene: an object that is turned in it is lit from where it was lit before.
#[test]
fn an_object_that_is_turned_keeps_the_light_where_it_is() {
    let mut d = ball_over_plate();
    let session = &mut d.viewer().session;
    session.project.scene.objects[0].shown = false;
    let straight = d.picture();
    // A grey ball looks the same however it is turned.
    d.viewer().session.project.scene.objects[1].transform = Transform {
        rotation: Quat::from_rotation_x(2.0),
        ..d.viewer().session.project.scene.objects[1].transform
    };
    let turned = d.picture();
    assert!(
        psnr(&straight, &turned) > 30.0,
        "{}",
        psnr(&straight, &turned)
    );
    d.viewer().session.project.scene.environment.rotation = 90.0;
    let other = d.picture();
    assert!(psnr(&straight, &other) < psnr(&straight, &turned));
}

/// A photograph with its camera: the object is drawn over it where that camera would see it, in the window as on the command line.
#[test]
fn a_photograph_is_seen_behind_the_objects_by_its_own_camera() {
    let mut d = ball_over_plate();
    let photo = d.folder.path("photo.png");
    let gradient = image::RgbImage::from_fn(120, 90, |x, y| image::Rgb([2 * x as u8, y as u8, 90]));
    gradient.save(&photo).expect("room");
    // From five in front of the scene and one above it, rolled.
    let (sin, cos) = 0.3f64.sin_cos();
    let rows = format!(
        "[[{cos},{},0,0],[0,0,-1,-5],[{sin},{cos},0,1],[0,0,0,1]]",
        -sin
    );
    let text = format!(
        r#"{{"camera_angle_x": 0.6, "w": 120, "h": 90, "frames": [{{"file_path": "photo", "transform_matrix": {rows}}}]}}"#
    );
    let cameras = d.folder.write("transforms.json", &text);
    let path = d.folder.path("transforms.json");
    d.after(|v| v.open(&path));
    let session = &d.viewer().session;
    let told: Vec<_> = session.messages.iter().filter(|m| m.is_error).collect();
    assert!(told.is_empty(), "{told:?}");
    assert_eq!(session.project.scene.background, Background::Backplate);
    assert!(
        session
            .project
            .scene
            .plate
            .as_ref()
            .is_some_and(|p| p.ends_with("photo.png"))
    );
    assert!(
        session.project.pose.roll.abs() > 10.0,
        "{:?}",
        session.project.pose
    );
    let settings = d.viewer().export_settings();
    settings.size = [120, 90];
    settings.supersample = 1;
    let [ours, theirs, look] = ["ours.png", "theirs.png", "plate.json"].map(|n| d.folder.name(n));
    let path = ours.clone().into();
    d.after(|v| v.export(Task::Screenshot(Some(path))));
    let scene = d.viewer().session.project.scene_to_save();
    save_look(look.as_ref(), &scene).expect("room");
    let line = "render --look {} --cameras {} --plate {} --device cpu -o {}";
    let photo = photo.display().to_string();
    run_json(&args(line, &[&look, &cameras, &photo, &theirs]));
    let [a, b] = [&ours, &theirs].map(|p| picture(p.as_ref()));
    assert!(psnr(&a, &b) > 45.0, "{}", psnr(&a, &b));
    // In the corner there is the photograph and nothing else.
    assert_eq!(b[0], picture(photo.as_ref())[0]);
    // On the screen the same, as large as there is room.
    let shown = d.picture();
    let size = d.viewer().session.project.viewport;
    d.viewer().export_settings().size = size;
    let large = d.folder.name("large.png");
    let path = large.clone().into();
    d.after(|v| v.export(Task::Screenshot(Some(path))));
    let [width, height] = size;
    // Beside the photograph the screen shows a checkerboard, a file nothing.
    let inside = |p: &[[f32; 3]]| -> Vec<[f32; 3]> {
        let half = height * 2 / 3 - 2;
        let columns = width / 2 - half..width / 2 + half;
        let rows = p.chunks_exact(width);
        rows.flat_map(|row| row[columns.clone()].to_vec()).collect()
    };
    let large = picture(large.as_ref());
    let alike = psnr(&inside(&shown), &inside(&large));
    assert!(alike > 38.0, "{alike}");
    // Another camera whose photograph is not there does not stand before that one; what the user chose stays behind any.
    let text = text.replace("\"photo\"", "\"elsewhere\"");
    let others = d.folder.path("others.json");
    std::fs::write(&others, text).expect("room");
    let plate = |d: &mut Driver| d.viewer().session.project.scene.plate.clone();
    d.after(|v| v.session.project.look_through(0));
    assert!(plate(&mut d).is_some());
    let chosen = d.folder.path("photo chosen.png");
    std::fs::copy(&photo, &chosen).expect("room");
    d.after(|v| v.session.project.set_backplate(chosen.clone()));
    d.after(|v| v.open(&others));
    assert_eq!(plate(&mut d).as_ref(), Some(&chosen));
    // One that cannot be read leaves it there.
    d.after(|v| v.session.project.set_backplate(others));
    assert_eq!(plate(&mut d).as_ref(), Some(&chosen));
    let last = d.viewer().session.messages.last();
    assert!(last.is_some_and(|m| m.is_error && m.text.contains("where an image")));
}

/// A ball over a plate that were captured as one, under even light and lit by a city.
fn one_capture() -> Driver {
    let folder = Folder::empty();
    write(&folder, "capture.ply", &synthetic::sphere_over_slab(600));
    std::fs::copy(asset("city.hdr"), folder.path("city.hdr")).expect("room");
    let scene =
        r#"{"asset": "capture.ply", "source": {"file": "even"}, "target": {"file": "city.hdr"}}"#;
    folder.write("scene.json", scene);
    let startup = Startup {
        files: vec![folder.path("scene.json")],
        ..Startup::default()
    };
    Driver::open(startup, folder)
}

#[test]
fn what_is_cut_out_stays_as_it_was_until_it_is_moved_and_is_put_back_by_undo() {
    let mut d = one_capture();
    let whole = d.picture();
    let bounds = d.viewer().session.asset().expect("a splat").bounds;
    // An empty box and one around all are told, and change nothing.
    let cut = |d: &mut Driver, low: f32| {
        d.after(|v| {
            let hide = &mut v.session.object_mut().hide;
            hide.crop = true;
            (hide.crop_min, hide.crop_max) = (Vec3::splat(-2.0), Vec3::splat(2.0));
            hide.crop_min.z = (low - bounds.center.z) / bounds.radius;
            v.session.project.cut_out(v.session.selected);
        });
    };
    for low in [-1.9, 1.9] {
        cut(&mut d, low);
        assert_eq!(d.viewer().session.project.scene.objects.len(), 1);
    }
    // The ball is above 0.2.
    cut(&mut d, 0.1);
    let session = &d.viewer().session;
    assert_eq!((session.project.states.len(), session.selected), (2, 1));
    assert_eq!(session.asset().map(|a| a.cloud.len()), Some(600));
    assert_eq!(session.object().name.as_deref(), Some("capture, cut out"));
    let apart = d.picture();
    assert!(psnr(&whole, &apart) > 45.0, "{}", psnr(&whole, &apart));
    // Moved away it takes its shadow along.
    d.after(|v| v.session.object_mut().transform.translation = Vec3::new(0.0, 0.0, 30.0));
    let moved = d.picture();
    assert!(psnr(&whole, &moved) < 35.0);
    // Saved, opened again, and drawn by the command line.
    let [look, ours, theirs] = ["look.json", "ours.png", "theirs.png"].map(|n| d.folder.name(n));
    save_look(look.as_ref(), &d.viewer().session.project.scene_to_save()).expect("room");
    let settings = d.viewer().export_settings();
    settings.size = [200, 160];
    settings.transparent = true;
    settings.supersample = 1;
    let path = ours.clone().into();
    d.after(|v| v.export(Task::Screenshot(Some(path))));
    let line = "render {} --size 200x160 --background transparent --device cpu -o {}";
    run_json(&args(line, &[&look, &theirs]));
    let [a, b] = [&ours, &theirs].map(|p| picture(p.as_ref()));
    assert!(psnr(&a, &b) > 45.0, "{}", psnr(&a, &b));
    // Put together again, as undo does it.
    let mut back = d.viewer().session.project.scene.clone();
    back.objects.pop();
    back.objects[0].cut.clear();
    d.after(|v| v.session.apply(back));
    assert!(psnr(&whole, &d.picture()) > 50.0);
    assert_eq!(d.viewer().session.project.states.len(), 1);
    let messages = &d.viewer().session.messages;
    assert!(messages.iter().all(|m| !m.is_error), "{messages:?}");
}

/// A box that ends below the surface of a plate: what is left of that is offered, goes to the rest, and comes back.
#[test]
fn residue_of_a_support_goes_to_the_rest() {
    let mut d = one_capture();
    let bounds = d.viewer().session.asset().expect("a splat").bounds;
    let corner = |c: Vec3| (c - bounds.center) / bounds.radius;
    d.after(|v| {
        let hide = &mut v.session.object_mut().hide;
        hide.crop = true;
        hide.crop_min = corner(Vec3::new(-0.6, -0.6, -0.05));
        hide.crop_max = corner(Vec3::new(0.6, 0.6, 1.3));
        v.session.project.cut_out(v.session.selected);
    });
    let counts = |d: &mut Driver| {
        let states = &d.viewer().session.project.states;
        let of = |at: usize| states[at].asset.as_ref().map_or(0, |a| a.cloud.len());
        [of(0), of(1)]
    };
    let [rest, part] = counts(&mut d);
    assert!(part > 600, "{part}");
    let offer = |d: &mut Driver| d.viewer().session.messages.iter().find_map(|m| m.offer);
    let (_, remedy) = offer(&mut d).expect("an offer");
    assert_eq!(remedy, Remedy::RemoveResidue);
    d.after(|v| v.session.project.apply_remedy(1, remedy));
    assert_eq!(counts(&mut d), [rest + part - 600, 600]);
    assert_eq!(d.viewer().session.project.is_residue_removed(1), Some(true));
    d.after(|v| v.session.project.remove_residue(1, false));
    assert_eq!(counts(&mut d), [rest, part]);
}

/// Splats that are named or dropped together are one scene, beside each other.
#[test]
fn what_is_opened_together_stands_side_by_side() {
    let folder = Folder::empty();
    let names = ["one.ply", "two.ply", "three.ply", "four.ply", "five.ply"];
    for (name, scale) in names.into_iter().zip([1.0, 0.5, 1.5, 1.0, 0.7]) {
        let mut ball = synthetic::sphere(300);
        ball.positions.iter_mut().for_each(|p| *p *= scale);
        ball.scales.iter_mut().for_each(|s| *s *= scale);
        write(&folder, name, &ball);
    }
    let paths = names.map(|name| folder.path(name)).to_vec();
    let startup = Startup {
        files: paths.clone(),
        ..Startup::default()
    };
    let check = |d: &mut Driver, count: usize| {
        let session = &d.viewer().session;
        let of = session.project.shown().map(|(_, object, asset)| {
            let placed = object.transform.scene_from_object();
            asset.bounds.transformed(placed)
        });
        let bounds: Vec<_> = of.collect();
        assert_eq!(bounds.len(), count);
        // They stand on one ground, however large they are.
        let up = session.project.scene_up().direction();
        let foot = |b: &Bounds| b.center.dot(up) - b.radius;
        for b in &bounds {
            let apart = (foot(b) - foot(&bounds[0])).abs();
            assert!(apart < 0.15 * bounds[0].radius, "{bounds:?}");
        }
        for (i, a) in bounds.iter().enumerate() {
            for b in &bounds[..i] {
                let apart = (a.center - b.center).length();
                assert!(apart > 0.9 * (a.radius + b.radius), "{a:?} {b:?}");
            }
        }
    };
    let mut d = Driver::open(startup, folder);
    check(&mut d, 5);
    // In a window with one object, the first of them takes its place as ever.
    let mut d = Driver::bundled();
    d.after(|v| v.open_all(paths));
    check(&mut d, 5);
}

/// In a scene of several a splat replaces an object only where that is answered, and stands upright either way, also in the place of the
/// first, whose up axis was another.
#[test]
fn a_splat_that_is_opened_among_others_is_asked_about() {
    let mut d = ball_over_plate();
    let ball = d.folder.path("other.ply");
    write(&d.folder, "other.ply", &synthetic::sphere(300));
    let scene = d.viewer().session.project.scene.clone();
    d.after(|v| v.open(&ball));
    d.click("Cancel");
    assert_eq!(d.viewer().session.project.scene, scene);
    d.after(|v| v.open(&ball));
    d.click("Add to scene");
    assert_eq!(d.viewer().session.project.scene.objects.len(), 3);
    // In the place of the first: what stands on it stays upright in the world.
    let in_world = |d: &mut Driver, at: usize, v: Vec3| {
        let project = &d.viewer().session.project;
        let turned = project.scene.objects[at].transform.rotation * v;
        project.world_from_scene() * turned.as_dvec3()
    };
    d.after(|v| {
        v.session.selected = 0;
        v.session.object_mut().up = Some(UpAxis::PlusZ);
    });
    let last = in_world(&mut d, 1, Vec3::Z);
    d.after(|v| v.open(&ball));
    d.click("Replace plate");
    let project = &d.viewer().session.project;
    assert_eq!(project.called(0), "other");
    let up = project.up_of(0);
    assert!(in_world(&mut d, 0, up.direction()).z > 0.999);
    assert!(in_world(&mut d, 1, Vec3::Z).dot(last) > 0.999);
    // Where the first goes whose up axis is another, the rest stands as it stood.
    d.after(|v| v.session.project.scene.objects[1].up = Some(UpAxis::PlusY));
    let last = in_world(&mut d, 1, Vec3::Z);
    d.after(|v| v.session.project.remove(0));
    assert!(in_world(&mut d, 0, Vec3::Z).dot(last) > 0.999);
}

/// G moves the object with the pointer: a click ends it, and Esc puts the object back.
#[test]
fn an_object_follows_the_pointer_after_a_key() {
    let mut d = ball_over_plate();
    d.after(|v| v.session.selected = 1);
    let place = |d: &mut Driver| d.viewer().session.project.scene.objects[1].transform;
    let from = place(&mut d);
    let at = egui::pos2(330.0, 280.0);
    let go = |d: &mut Driver, to: egui::Pos2| {
        d.harness.hover_at(to);
        d.harness.step();
        d.harness.step();
    };
    go(&mut d, at);
    d.harness.key_press(egui::Key::G);
    d.harness.step();
    go(&mut d, at + egui::vec2(40.0, 0.0));
    let moved = place(&mut d);
    assert!(moved.translation.distance(from.translation) > 0.05);
    d.harness.key_press(egui::Key::Z);
    go(&mut d, at + egui::vec2(40.0, -30.0));
    let along = place(&mut d).translation - from.translation;
    assert!(
        along.z.abs() > 0.02 && along.truncate().length() < 1e-4,
        "{along}"
    );
    d.harness.key_press(egui::Key::Escape);
    d.settle();
    assert_eq!(place(&mut d), from);
    d.harness.key_press(egui::Key::S);
    d.harness.step();
    go(&mut d, at + egui::vec2(150.0, 0.0));
    d.harness.drag_at(at + egui::vec2(150.0, 0.0));
    d.harness.drop_at(at + egui::vec2(150.0, 0.0));
    d.settle();
    let scaled = place(&mut d);
    assert!(scaled.scale != from.scale);
    go(&mut d, at);
    assert_eq!(place(&mut d), scaled, "it is let go");
    assert_eq!(d.viewer().session.selected, 1, "the click selects nothing");
}
