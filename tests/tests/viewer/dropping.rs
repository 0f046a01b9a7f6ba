//! What is dropped on the window, or opened while something loads.

use std::fs;
use std::path::{Path, PathBuf};

use eframe::egui;
use egui_kittest::kittest::Queryable;
use transplat_core::surfels::UpAxis;
use transplat_tests::driver::Driver;
use transplat_tests::{asset, level_cameras, psnr, small_splat};

#[test]
fn what_is_dropped_is_opened_and_what_is_broken_changes_nothing() {
    let mut d = Driver::bundled();
    let picture = d.picture();
    let scene = d.viewer().session.scene.clone();
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
        assert_eq!(d.viewer().session.scene, scene, "{file}");
        assert!(
            !d.viewer().shelf().iter().any(|p| p.ends_with(&name)),
            "{file} is on the shelf"
        );
    }
    d.viewer().session.messages.clear();
    assert!(psnr(&picture, &d.picture()) > 80.0);

    // A splat whose light nobody knows: relit from even light, which is said; upright after one click.
    let splat = d.folder.write("unknown.ply", small_splat(50));
    d.after(|v| v.open(Path::new(&splat)));
    let session = &d.viewer().session;
    assert!(session.source_is_assumed() && session.live().has_relit(0));
    assert_eq!(session.light(1).name(), "sunset", "the target stays");
    d.harness.get_by_label("captured under: not known");
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
    assert!(told.any(|text| text.contains("held with +y up")));
    d.viewer().session.object_mut().up = Some(UpAxis::PlusX);
    d.after(|v| v.open(&cameras));
    assert_eq!(d.viewer().session.up(), UpAxis::PlusX);

    // A folder of environments fills the shelf.
    let lights = d.folder.path("lights");
    fs::create_dir_all(&lights).expect("room for it");
    for name in ["a.hdr", "b.hdr"] {
        fs::copy(asset("city.hdr"), lights.join(name)).expect("room for it");
    }
    let count = d.viewer().shelf().len();
    d.after(|v| v.open(&lights));
    assert_eq!(d.viewer().shelf().len(), count + 2);
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
    for (side, slot) in [(0, "captured under: city"), (1, "relit by: sunset")] {
        let at = d.harness.get_by_label(slot).rect().center();
        let light = drop_light(&mut d, if side == 0 { "a.hdr" } else { "b.hdr" }, at);
        assert_eq!(d.viewer().session.light(side).path, light);
        assert!(d.viewer().shelf().contains(&light));
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
        let slot = d.harness.get_by_label("captured under: city");
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
    d.viewer().session.object_mut().linear = true;
    let linear = d.picture();
    assert!(psnr(&encoded, &linear) < 35.0);
    d.viewer().session.object_mut().linear = false;
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
