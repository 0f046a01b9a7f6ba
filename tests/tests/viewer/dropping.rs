//! What is dropped on the window, or opened while something loads.

use std::fs;
use std::path::{Path, PathBuf};

use eframe::egui;
use egui_kittest::kittest::Queryable;
use transplat_core::environment::{ImageReading, Layout};
use transplat_core::response::CameraResponse;
use transplat_core::surfels::UpAxis;
use transplat_tests::driver::Driver;
use transplat_tests::{asset, level_cameras, psnr, small_splat};

#[test]
fn what_is_dropped_is_opened_and_what_is_broken_changes_nothing() {
    let mut d = Driver::bundled();
    let picture = d.picture();
    let scene = d.viewer().session.project.scene.clone();
    let ply = fs::read(d.folder.path("teapot.ply")).expect("it is there");
    let broken: Vec<String> = vec![
        d.folder.write("half.ply", &ply[..ply.len() / 2]),
        d.folder.write("words.ply", "these are words"),
        d.folder.write("empty.hdr", ""),
        d.folder.write(
            "half.hdr",
            &fs::read(asset("city.hdr")).expect("it is there")[..9000],
        ),
        d.folder.write(
            "liar.hdr",
            "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 60000 +X 120000\n",
        ),
        d.folder.write("wrong.json", r#"{"epsilom": 1}"#),
        d.folder.write("gone.json", r#"{"asset": "nowhere.ply"}"#),
        d.folder.write("film.mp4", [0u8, 1, 2, 3]),
        d.folder.name("vanished.exr"),
    ];
    for file in &broken {
        d.viewer().session.messages.clear();
        d.after(|v| v.open(Path::new(file)));
        if d.harness.query_by_label("Discard").is_some() {
            d.click("Discard");
        }
        let messages = d.viewer().session.messages.clone();
        let errors: Vec<_> = messages.iter().filter(|m| m.is_error).collect();
        assert_eq!(errors.len(), 1, "{file}: {messages:?}");
        let name = Path::new(file)
            .file_name()
            .expect("a name")
            .to_string_lossy()
            .into_owned();
        let named = if name == "gone.json" {
            "nowhere.ply"
        } else {
            &name
        };
        assert!(errors[0].text.contains(named), "{}", errors[0].text);
        assert_eq!(d.viewer().session.project.scene, scene, "{file}");
        assert!(
            !d.viewer()
                .light_library()
                .iter()
                .any(|p| p.ends_with(&name)),
            "{file} is on the shelf"
        );
    }
    d.viewer().session.messages.clear();
    assert!(psnr(&picture, &d.picture()) > 80.0);

    // A splat whose light nobody knows: relit from even light, which is said; upright after one click.
    let splat = d.folder.write("unknown.ply", small_splat(50));
    d.after(|v| v.open(Path::new(&splat)));
    let session = &d.viewer().session;
    assert!(session.source_is_assumed() && session.canvas.live().has_relit(0));
    assert_eq!(session.light(1).name(), "sunset", "the target stays");
    d.harness.get_by_label("Capture light: unknown");
    d.viewer().session.object_mut().up = Some(UpAxis::MinusY);
    d.picture();
    assert_eq!(d.viewer().session.up(), UpAxis::MinusY);

    // Cameras tell which way is up, and nobody who said so is overruled.
    let splat = d.folder.write("lying.ply", small_splat(50));
    d.after(|v| v.open(Path::new(&splat)));
    let cameras = d.folder.path("transforms.json");
    fs::write(&cameras, level_cameras()).expect("room for it");
    d.after(|v| v.open(&cameras));
    let session = &d.viewer().session;
    assert_eq!(session.up(), UpAxis::PlusY);
    let mut told = session.messages.iter().map(|m| &m.text);
    assert!(told.any(|text| text.contains("Up axis set to +y, by its cameras")));
    d.viewer().session.object_mut().up = Some(UpAxis::PlusX);
    d.after(|v| v.open(&cameras));
    assert_eq!(d.viewer().session.up(), UpAxis::PlusX);

    // A folder of environments fills the shelf.
    let lights = d.folder.path("lights");
    fs::create_dir_all(&lights).expect("room for it");
    for name in ["a.hdr", "b.hdr"] {
        fs::copy(asset("city.hdr"), lights.join(name)).expect("room for it");
    }
    let count = d.viewer().light_library().len();
    d.after(|v| v.open(&lights));
    assert_eq!(d.viewer().light_library().len(), count + 2);
}

/// Drops a light at a place of the window.
fn drop_light(d: &mut Driver, name: &str, at: egui::Pos2) -> PathBuf {
    let light = d.folder.path(name);
    fs::copy(asset("interior.hdr"), &light).expect("room for it");
    drop_files(d, &[&light], at);
    light
}

fn drop_files(d: &mut Driver, files: &[&PathBuf], at: egui::Pos2) {
    d.harness.hover_at(at);
    d.harness.step();
    for file in files {
        let file = std::sync::Arc::new(Dropped((*file).clone()));
        d.harness.input_mut().dropped_files.push(file);
    }
    d.harness.step();
    d.harness.input_mut().dropped_files.clear();
    d.harness.hover_at(at + egui::vec2(1.0, 0.0));
    d.settle();
}

#[test]
fn a_light_dropped_on_a_slot_is_that_slots_light() {
    let mut d = Driver::bundled();
    for (side, slot) in [(0, "Capture light: city"), (1, "New light: sunset")] {
        let at = d.harness.get_by_label(slot).rect().center();
        let light = drop_light(&mut d, if side == 0 { "a.hdr" } else { "b.hdr" }, at);
        assert_eq!(d.viewer().session.light(side).path, light);
        assert!(d.viewer().light_library().contains(&light));
    }
    // Anywhere else it is the target's.
    let light = drop_light(&mut d, "c.hdr", egui::pos2(300.0, 300.0));
    assert_eq!(d.viewer().session.light(1).path, light);
}

/// A splat that is dropped with the light of its capture is lit by it, whichever comes first.
#[test]
fn a_light_dropped_with_its_splat_is_that_splats() {
    for light_first in [true, false] {
        let mut d = Driver::bundled();
        let (splat, light) = (d.folder.path("own.ply"), d.folder.path("own.hdr"));
        fs::copy(asset("teapot.ply"), &splat).expect("room for it");
        fs::copy(asset("interior.hdr"), &light).expect("room for it");
        let slot = d.harness.get_by_label("Capture light: city");
        let at = slot.rect().center();
        let files = match light_first {
            true => [&light, &splat],
            false => [&splat, &light],
        };
        drop_files(&mut d, &files, at);
        let session = &d.viewer().session;
        assert_eq!(session.asset().map(|a| a.name()), Some("own".into()));
        assert_eq!(session.light(0).path, light);
    }
}

#[test]
fn what_is_changed_while_a_splat_loads_is_kept() {
    let mut d = Driver::bundled();
    let (again, city) = (d.folder.path("again.ply"), d.folder.path("city.hdr"));
    fs::copy(asset("teapot.ply"), &again).expect("room for it");
    d.viewer().open(&again);
    d.viewer().session.set_light(0, city);
    d.viewer().session.object_mut().source.rotation = 12.0;
    d.after(|v| v.session.object_mut().up = Some(UpAxis::PlusX));
    let session = &d.viewer().session;
    assert_eq!(session.asset().map(|a| a.name()), Some("again".into()));
    assert_eq!(session.light(0).name(), "city");
    assert_eq!(session.object().source.rotation, 12.0);
    assert_eq!(session.up(), UpAxis::PlusX);

    // A file that changed is read anew when it is opened again.
    let light = d.folder.path("edited.hdr");
    fs::copy(asset("city.hdr"), &light).expect("room for it");
    d.after(|v| v.open(&light));
    let first = d.viewer().session.light(1).illumination.clone();
    fs::copy(asset("sunset.hdr"), &light).expect("room for it");
    d.after(|v| v.open(&light));
    assert_ne!(d.viewer().session.light(1).illumination, first);

    // The colour's encoding is the settings': undone and redone it is loaded again.
    let encoded = d.picture();
    d.viewer().session.object_mut().response = CameraResponse::LINEAR;
    let linear = d.picture();
    assert!(psnr(&encoded, &linear) < 35.0);
    d.viewer().session.object_mut().response = CameraResponse::default();
    assert!(psnr(&encoded, &d.picture()) > 60.0);
}

#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        fs::read(&self.0).map_err(|e| e.to_string())
    }
}

fn as_layout(layout: Layout) -> ImageReading {
    ImageReading {
        layout: Some(layout),
        layer: None,
    }
}

/// A layout that the picture has not is told once, and the light stays as it was read; one that it has holds wherever the light goes.
#[test]
fn a_light_is_read_as_its_layout_is_told() {
    let mut d = Driver::bundled();
    let disc = image::RgbImage::from_fn(64, 64, |x, y| {
        let [right, down] = [x, y].map(|v| f64::from(v) - 31.5);
        let is_inside = right.hypot(down) < 32.0;
        image::Rgb(if is_inside {
            [4 * x as u8, 4 * y as u8, 90]
        } else {
            [0; 3]
        })
    });
    let probe = d.folder.path("probe.png");
    disc.save(&probe).expect("room for it");
    d.after(|v| v.open(&probe));
    let read_as = |d: &mut Driver| {
        let session = &d.viewer().session;
        let layout = session.project.scene.environment.layout;
        assert_eq!(
            session.light(1).reading.layout,
            layout,
            "what is set is what is read"
        );
        (layout, session.light(1).id)
    };
    let (layout, by_shape) = read_as(&mut d);
    assert_eq!(layout, None);
    let told = |d: &mut Driver, what: &str| {
        let messages = &d.viewer().session.messages;
        messages.iter().filter(|m| m.text.contains(what)).count()
    };
    assert_eq!(told(&mut d, "angular map"), 1);
    d.after(|v| v.session.set_reading(1, &as_layout(Layout::CubeCross)));
    assert_eq!(told(&mut d, "a cube cross has"), 1);
    assert_eq!(read_as(&mut d), (None, by_shape));
    assert!(
        d.viewer()
            .light_library()
            .iter()
            .any(|p| p.ends_with("probe.png"))
    );
    d.after(|v| v.session.set_reading(1, &as_layout(Layout::MirrorBall)));
    d.harness.run_steps(12);
    let (layout, as_ball) = read_as(&mut d);
    assert_eq!(layout, Some(Layout::MirrorBall));
    assert_ne!(as_ball, by_shape);
    let saved = d.viewer().session.project.scene_to_save();
    assert_eq!(saved.environment.layout, layout);
    // Another light, and back; each is a step by itself once it is left alone.
    d.after(|v| v.session.set_light(1, "even".into()));
    assert_eq!(d.viewer().session.project.scene.environment.layout, None);
    d.harness.run_steps(12);
    d.after(|v| v.session.set_light(1, probe.clone()));
    d.harness.run_steps(12);
    assert_eq!(read_as(&mut d), (Some(Layout::MirrorBall), as_ball));
    let mut undo = || {
        d.harness
            .key_press_modifiers(egui::Modifiers::CTRL, egui::Key::Z);
        d.settle();
        read_as(&mut d).0
    };
    // The light, the other one, the layout.
    let seen = [undo(), undo(), undo()];
    assert_eq!(seen, [None, Some(Layout::MirrorBall), None]);
}
