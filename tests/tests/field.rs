//! What people bring, out of public reports on splat viewers, converters and image libraries: each opens as it is meant, or says what it is and
//! what to do. What a reader alone decides is tested beside it; this is what the program makes of it.

use std::fs;

use glam::DVec3;
use transplat_core::files::load_splat;
use transplat_tests::{Folder, args, asset, picture, psnr, run_json, run_told, small_splat};

/// A ball of `n` surfels as a PLY in ascii, its positions as `double` moved by an offset, each row changed.
fn ball(n: usize, offset: DVec3, change: impl Fn(usize, &mut Vec<f64>)) -> String {
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3";
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {n}\n");
    for name in names.split(' ') {
        let scalar = if "xyz".contains(name) {
            "double"
        } else {
            "float"
        };
        text += &format!("property {scalar} {name}\n");
    }
    text += "end_header\n";
    for i in 0..n {
        let z = 1.0 - (2.0 * i as f64 + 1.0) / n as f64;
        let (sin, cos) = (2.399_963 * i as f64).sin_cos();
        let place = DVec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
        let turn = glam::DQuat::from_rotation_arc(DVec3::Z, place.normalize());
        let mut row = (place + offset).to_array().to_vec();
        row.extend([
            z,
            0.3 * cos,
            -0.4,
            4.0,
            -3.0,
            -3.0,
            turn.w,
            turn.x,
            turn.y,
            turn.z,
        ]);
        change(i, &mut row);
        let words: Vec<String> = row.iter().map(f64::to_string).collect();
        text += &format!("{}\n", words.join(" "));
    }
    text
}

fn as_captured(folder: &Folder, splat: &str, name: &str) -> Vec<[f32; 3]> {
    let out = folder.name(name);
    let line = "render {} --view before --device cpu --size 96x96 --background black -o {}";
    run_told(&args(line, &[splat, &out]), 0, &[]);
    picture(out.as_ref())
}

/// Wherever its coordinates have their origin, and whatever floats far away, the same object fills the picture.
#[test]
fn an_object_is_framed_and_drawn_wherever_it_lies() {
    let folder = Folder::empty();
    let near = folder.write("near.ply", ball(1500, DVec3::ZERO, |_, _| {}));
    let near = as_captured(&folder, &near, "near.png");
    assert!(near.iter().filter(|p| p[0] + p[1] + p[2] > 0.1).count() > 3000);
    let utm = DVec3::new(500_123.25, 5_600_456.5, 312.125);
    let far = folder.write("far.ply", ball(1500, utm, |_, _| {}));
    assert!(psnr(&near, &as_captured(&folder, &far, "far.png")) > 45.0);
    // One in a hundred is faint and up to 600 radii away.
    let floats = ball(1500, DVec3::ZERO, |i, row| {
        if i % 100 == 50 {
            row[..3]
                .iter_mut()
                .for_each(|v| *v *= 20.0 + i as f64 / 2.5);
            row[6] = -3.0;
        }
    });
    let floats = folder.write("floats.ply", floats);
    assert!(psnr(&near, &as_captured(&folder, &floats, "floats.png")) > 25.0);
}

/// The coordinates of a command line, of a camera file and of a probe are those of the splat's file.
#[test]
fn places_are_given_in_the_coordinates_of_the_file() {
    let folder = Folder::empty();
    let utm = DVec3::new(500_123.25, 5_600_456.5, 312.125);
    let [near, far] = [("near.ply", DVec3::ZERO), ("far.ply", utm)]
        .map(|(name, offset)| folder.write(name, ball(800, offset, |_, _| {})));
    let cameras = |offset: DVec3| {
        let [x, y, z] = (offset + DVec3::new(0.5, -4.0, 0.0)).to_array();
        let rows = format!("[[1,0,0,{x}],[0,0,-1,{y}],[0,1,0,{z}],[0,0,0,1]]");
        format!(r#"{{"fl_y": 100, "w": 96, "h": 96, "frames": [{{"transform_matrix": {rows}}}]}}"#)
    };
    let point = |at: DVec3| at.to_array().map(|v| v.to_string()).join(",");
    let pictures = [(near, DVec3::ZERO), (far, utm)].map(|(splat, offset)| {
        let file = folder.write("cameras.json", cameras(offset));
        let (out, eye) = (
            folder.name("out/"),
            point(offset + DVec3::new(3.0, 2.0, 1.0)),
        );
        let line = "render {} --view before --device cpu --size 96x96 --background black";
        let by_file = format!("{line} --cameras {{}} -o {{}}");
        run_told(&args(&by_file, &[&splat, &file, &out]), 0, &[]);
        let eyed = folder.name("eye.png");
        let (from, to) = (
            format!("--eye={eye}"),
            format!("--look-at={}", point(offset)),
        );
        let by_eye = format!("{line} {{}} {{}} -o {{}}");
        run_told(&args(&by_eye, &[&splat, &from, &to, &eyed]), 0, &[]);
        [folder.path("out/000.png"), eyed.into()].map(|path| picture(&path))
    });
    let [near, far] = pictures;
    for (near, far) in near.iter().zip(&far) {
        assert!(near.iter().flatten().any(|v| *v > 0.2), "something is seen");
        assert!(psnr(near, far) > 45.0);
    }
}

/// Whatever the program writes, it opens, where it was.
#[test]
fn what_is_written_far_from_the_origin_opens_there() {
    let folder = Folder::empty();
    let utm = DVec3::new(-4_100_123.25, 5_600_456.5, 312.125);
    let far = folder.write("far.ply", ball(600, utm, |_, _| {}));
    for name in ["a.ply", "a.glb", "a.sog"] {
        let out = folder.name(name);
        run_told(&args("convert {} --up +z -o {}", &[&far, &out]), 0, &[]);
        let (cloud, file) = load_splat(out.as_ref()).expect(name);
        assert_eq!(
            (cloud.len(), file.report.warnings.len()),
            (600, 0),
            "{name}"
        );
        let found = run_json(&["info", &out]);
        let center: Vec<f64> = serde_json::from_value(found["center"].clone()).expect("numbers");
        let center = match name {
            "a.glb" => DVec3::new(center[0], -center[2], center[1]),
            _ => DVec3::from_slice(&center),
        };
        assert!(center.distance(utm) < 0.05, "{name}: {center}");
    }
    for name in ["b.spz", "b.splat", "b.compressed.ply"] {
        let out = folder.name(name);
        run_told(
            &args("convert {} --up +z -o {}", &[&far, &out]),
            1,
            &["in steps of", "large"],
        );
        assert!(!folder.path(name).exists());
    }
}

/// A folder of lights as a Mac and Windows leave it, one of which is broken.
#[test]
fn the_lights_of_a_folder_are_used_and_the_rest_is_named() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(40));
    let lights = folder.name("lights");
    fs::create_dir(&lights).expect("room for it");
    let sunset = fs::read(asset("sunset.hdr")).expect("a light");
    folder.write("lights/noon.hdr", &sunset);
    folder.write("lights/dusk.hdr", &sunset);
    folder.write("lights/._noon.hdr", [0, 5, 22, 7]);
    folder.write("lights/.DS_Store", "Bud1");
    folder.write("lights/notes.txt", "lights");
    let out = folder.name("out/");
    let line = "relight {} --source even --device cpu --target {} -o {}";
    let told = run_told(&args(line, &[&splat, &lights, &out]), 0, &[]);
    let said = String::from_utf8_lossy(&told.stdout).into_owned();
    for word in ["._noon.hdr (hidden)", "notes.txt (neither .hdr nor .exr)"] {
        assert!(said.contains(word), "{said}");
    }
    assert!(folder.path("out/noon.ply").is_file() && folder.path("out/dusk.ply").is_file());
    folder.write("lights/torn.hdr", &sunset[..sunset.len() / 2]);
    let torn = ["a light is skipped", "torn.hdr", "all but 1"];
    run_told(&args(line, &[&splat, &lights, &out]), 1, &torn);
    assert!(folder.path("out/noon.ply").is_file() && !folder.path("out/torn.ply").exists());
}

/// What a look says was written on another system.
#[test]
fn looks_are_read_with_back_slashes_and_a_byte_order_mark() {
    let folder = Folder::empty();
    fs::create_dir(folder.path("splats")).expect("room for it");
    folder.write("splats/a.ply", small_splat(40));
    let look = r#"{"version": 2, "asset": "splats\\a.ply", "source": {"file": "even"}}"#;
    let look = folder.write("look.json", format!("\u{feff}{look}"));
    let out = folder.name("out.png");
    let line = "render {} --target even --device cpu --size 32x32 --eye 5,2,30 -o {}";
    run_told(&args(line, &[&look, &out]), 0, &[]);
}

/// Images are of any layout: what makes a light of one is not asked of a mask or a photograph.
#[test]
fn a_photograph_with_dark_corners_is_no_light_probe() {
    let folder = Folder::empty();
    let disc = image::RgbImage::from_fn(64, 64, |x, y| {
        let [right, down] = [x, y].map(|v| f64::from(v) - 31.5);
        image::Rgb(if right.hypot(down) < 31.0 {
            [200, 3 * x as u8, 90]
        } else {
            [0; 3]
        })
    });
    let photo = folder.path("photo.png");
    disc.save(&photo).expect("room for it");
    let splat = folder.write("a.ply", small_splat(40));
    let (photo, out) = (folder.name("photo.png"), folder.name("out.png"));
    // Beside the object, which is far to the left.
    let line =
        "render {} --view before --device cpu --plate {} --eye 1000,0,5 --look-at 2000,0,5 -o {}";
    run_told(&args(line, &[&splat, &photo, &out]), 0, &[]);
    let shown = image::open(&out).expect("a picture").into_rgb8();
    assert_eq!(shown.dimensions(), (64, 64));
    let off = shown.pixels().zip(disc.pixels());
    let off = off.map(|(a, b)| (0..3).map(|c| a[c].abs_diff(b[c])).max().unwrap_or(0));
    assert!(off.max() <= Some(1));
}

/// Messages say what failed, why, and last of which file; none is a parser's, nor a number of the system's.
#[test]
fn messages_are_for_people() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(40));
    let cameras = folder.write("cameras.json", r#"{"frames": [{"transform_matrix": 1}]}"#);
    let list = folder.write("list.json", r#"[{"position": [1, 2], "rotation": 3}]"#);
    let look = folder.write("look.json", r#"{"version": 2, "strenght": 1}"#);
    let exr = folder.write(
        "deep.exr",
        [&[0x76, 0x2f, 0x31, 1, 2, 0, 0, 0][..], &[7; 300]].concat(),
    );
    let zip = folder.write("a.zip", [&b"PK\x03\x04"[..], &[1; 200]].concat());
    let gone = folder.name("gone.ply");
    let render = "render {} --view before --device cpu --cameras {} -o x";
    for (arguments, file) in [
        (args(render, &[&splat, &cameras]), &cameras),
        (args(render, &[&splat, &list]), &list),
        (args("info {}", &[&look]), &look),
        (args("info {}", &[&exr]), &exr),
        (args("info {}", &[&zip]), &zip),
        (args("info {}", &[&gone]), &gone),
        (args(render, &[&gone, &cameras]), &gone),
    ] {
        let told = run_told(&arguments, 1, &[]);
        let said = String::from_utf8_lossy(&told.stderr).into_owned();
        for word in [
            "struct ",
            "expected f64",
            "os error",
            "Error {",
            "Error(",
            "panicked",
            "kind:",
        ] {
            assert!(!said.contains(word), "{arguments:?}: {said}");
        }
        assert!(
            said.trim_end().ends_with(file.as_str()),
            "{arguments:?}: {said}"
        );
    }
}

/// Splats as large as the object, each of which every ray would cross: bounded, and said.
#[test]
fn blobs_as_large_as_the_object_are_relit_in_a_bounded_time() {
    let folder = Folder::empty();
    let blobs = ball(6000, DVec3::ZERO, |i, row| {
        row[6] = (i % 7) as f64 - 2.0;
        row[7..9].fill(-0.5);
    });
    let splat = folder.write("blobs.ply", blobs);
    let out = folder.name("out.ply");
    let line = "relight {} --source even --target even --device cpu -o {}";
    let told = run_told(&args(line, &[&splat, &out]), 0, &[]);
    let said = String::from_utf8_lossy(&told.stdout).into_owned();
    assert!(
        said.contains("each ray would cross hundreds of them"),
        "{said}"
    );
}
