//! The program's commands: what they write and what they tell.

use std::fs;
use std::path::Path;
use std::process::Command;

use transplat_core::color::srgb_encode;
use transplat_core::files::{load_environment, load_splat};
use transplat_tests::{
    Folder, args, asset, exr_pixels, level_cameras, picture, program, run, run_json, run_told,
    small_lut, small_splat,
};

#[test]
fn a_front_that_is_a_guess_is_warned_of_until_a_place_outside_is_told() {
    // The middle one of three translucent sheets is hidden alike from above and from below.
    let sheets = (0..3).flat_map(|z| (0..400).map(move |i| (i % 20, i / 20, 3 * z)));
    let rows: String = sheets
        .map(|(x, y, z)| format!("{x} {y} {z} 0.5 0.2 -0.3 0 -0.2 -0.2 1 0 0 0\n"))
        .collect();
    let splat = small_splat(0).replace("vertex 0", "vertex 1200") + &rows;
    let folder = Folder::empty();
    let splat = folder.write("sheets.ply", splat);
    let bake = folder.name("sheets.bake");
    let arguments = ["bake", &splat, "-o", &bake, "--device", "cpu"];
    let share = |told: &serde_json::Value| told["normals_ambiguous_share"].as_f64();

    let told = run_json(&arguments);
    assert!(share(&told) > Some(0.05), "{told}");
    assert!(told["warnings"].to_string().contains("--outside-from"));

    let told = run_json(&[&arguments[..], &["--outside-from", "10,10,40"]].concat());
    assert_eq!(share(&told), Some(0.0));
    assert_eq!(told["warnings"].to_string(), "[]");
}

#[test]
fn frames_keep_their_numbers_and_their_pixels() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(100));
    let (all, some) = (folder.name("all"), folder.name("some"));
    let common = args(
        "render {} --turntable 4 --size 64x48 --device cpu",
        &[&splat],
    );
    let told = run_json(&[&common[..], &["-o", &all]].concat());
    assert_eq!(told["pictures"], 4);
    run_json(&[&common[..], &["-o", &some, "--frames", "1-2"]].concat());
    for name in ["001.png", "002.png"] {
        let [a, b] = ["all", "some"].map(|out| fs::read(folder.path(out).join(name)));
        assert_eq!(a.expect("a picture"), b.expect("a picture"));
    }
    assert!(!folder.path("some").join("000.png").exists());
}

#[test]
fn a_batch_is_drawn_in_parts_goes_on_and_is_the_same_as_in_one_go() {
    let folder = Folder::empty();
    folder.write("a.ply", small_splat(80));
    folder.write("b.ply", small_splat(120));
    fs::copy(asset("sunset.hdr"), folder.name("sunset.hdr")).expect("room");
    let batch = folder.write(
        "batch.json",
        br#"{"splats": ["a.ply", {"asset": "b.ply", "source": "even"}], "source": "sunset.hdr",
            "lights": ["sunset.hdr", "even"], "turntable": 3}"#,
    );
    let draw = |out: &str, part: &str| {
        run_json(&args(
            "render --batch {} --part {} --size 24x16 --device cpu -o {}",
            &[&batch, part, &folder.name(out)],
        ))
    };
    let read = |out: &str| -> Vec<(String, Vec<u8>)> {
        let pictures = ["a", "b"].iter().flat_map(|splat| {
            let of_light = |light: &str| {
                let name = move |frame| format!("{splat}/{light}/00{frame}.png");
                (0..3).map(name).collect::<Vec<_>>()
            };
            [of_light("sunset"), of_light("even")].concat()
        });
        pictures
            .map(|name| {
                let path = folder.name(&format!("{out}/{name}"));
                let bytes = fs::read(&path).unwrap_or_else(|why| panic!("{name}: {why}"));
                (name, bytes)
            })
            .collect()
    };
    let whole = draw("whole", "1/1");
    assert_eq!(whole["pictures"], 12);
    let parts: Vec<u64> = (1..=5)
        .map(|part| draw("parts", &format!("{part}/5"))["pictures"].as_u64())
        .map(|pictures| pictures.expect("a number"))
        .collect();
    assert_eq!(parts.iter().sum::<u64>(), 12, "{parts:?}");
    assert!(read("whole") == read("parts"));

    // What is there is left, whatever it is; what is missing is drawn.
    let (gone, other) = ("parts/b/even/001.png", "parts/a/even/002.png");
    fs::remove_file(folder.name(gone)).expect("it was drawn");
    fs::write(folder.name(other), b"of mine").expect("room");
    let again = draw("parts", "1/1");
    assert_eq!(
        (&again["pictures"], &again["pictures_there"]),
        (&1.into(), &11.into())
    );
    assert_eq!(
        fs::read(folder.name(other)).expect("it is there"),
        b"of mine"
    );
    // Pictures of other settings are not mixed with those.
    let line = "render --batch {} --size 16x16 --device cpu -o {}";
    run_told(
        &args(line, &[&batch, &folder.name("parts")]),
        1,
        &["other settings"],
    );
    let of_gone = fs::read(folder.name(gone)).expect("it is drawn again");
    assert!(of_gone == fs::read(folder.name("whole/b/even/001.png")).expect("it is there"));

    // A look has a light of its own.
    folder.write(
        "look.json",
        r#"{"asset": "a.ply", "source": {"file": "even"}, "target": {"file": "sunset.hdr"}}"#,
    );
    let alone = folder.write("alone.json", r#"{"splats": ["look.json"], "turntable": 2}"#);
    let line = "render --batch {} --size 8x8 --device cpu -o {}";
    let told = run_json(&args(line, &[&alone, &folder.name("alone")]));
    assert_eq!(told["pictures"], 2);
    assert!(fs::exists(folder.name("alone/look/001.png")).expect("the folder is there"));
}

/// An encoder that keeps what it is given: a film is then its frames, one after the other.
#[cfg(unix)]
#[test]
fn a_film_holds_the_frames_or_says_what_it_needs() {
    use std::os::unix::fs::PermissionsExt;
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(80));
    let encoder = folder.write(
        "ffmpeg",
        "#!/bin/sh\nfor last; do :; done\nexec /bin/cat > \"$last\"\n",
    );
    fs::set_permissions(&encoder, fs::Permissions::from_mode(0o755)).expect("it is ours");
    let draw = |path: &str, out: &str| {
        let line = "render {} --turntable 3 --size 20x12 --device cpu -o {}";
        Command::new(program())
            .args(args(line, &[&splat, out]))
            .env("PATH", path)
            .output()
            .expect("the program starts")
    };
    let (here, pictures, video) = (
        folder.name(""),
        folder.name("pictures/"),
        folder.name("a.webm"),
    );
    for out in [&pictures, &video] {
        let told = draw(&here, out);
        assert!(
            told.status.success(),
            "{}",
            String::from_utf8_lossy(&told.stderr)
        );
    }
    let frames = (0..3).flat_map(|i| {
        let picture = image::open(folder.name(&format!("pictures/00{i}.png")));
        picture.expect("a picture").into_rgba8().into_raw()
    });
    assert!(fs::read(&video).expect("a film") == frames.collect::<Vec<u8>>());

    // Without an encoder, and with one that fails, nothing is left.
    let none = draw("", &folder.name("b.mp4"));
    let message = String::from_utf8_lossy(&none.stderr).into_owned();
    assert!(
        none.status.code() == Some(1) && message.contains("a video needs ffmpeg"),
        "{message}"
    );
    folder.write("ffmpeg", "#!/bin/sh\necho out of ink >&2\nexit 3\n");
    let failed = draw(&here, &folder.name("b.mp4"));
    let message = String::from_utf8_lossy(&failed.stderr).into_owned();
    assert!(
        failed.status.code() == Some(1) && message.contains("out of ink"),
        "{message}"
    );
    assert!(!fs::exists(folder.name("b.mp4")).expect("the folder is there"));
}

#[test]
fn every_view_and_format_is_written_by_both_devices() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(100));
    let sunset = asset("sunset.hdr");
    for device in ["cpu", "gpu"] {
        for view in [
            "after",
            "before",
            "split",
            "difference",
            "diffuse",
            "specular",
            "normals",
            "depth",
            "visibility",
            "tau",
        ] {
            for format in ["png", "exr"] {
                let out = folder.name(&format!("{device}-{view}.{format}"));
                run_json(&args(
                    "render {} --source even --target {} --view {} --eye 5,-8,9 --look-at 5,5,0 --size 40x30 --supersample 2 --directions 16 --background #2a4b8c --tone-map agx --device {} -o {}",
                    &[&splat, &sunset, view, device, &out],
                ));
                if format == "png" {
                    let picture = image::open(&out).expect("a picture").into_rgba8();
                    assert_eq!(picture.dimensions(), (40, 30));
                    let is_filled = picture.pixels().all(|p| p.0[3] == 255);
                    assert!(is_filled, "the background is filled");
                    let others = picture.pixels().filter(|p| p.0 != [0x2a, 0x4b, 0x8c, 255]);
                    assert!(others.count() > 50, "{view} shows nothing");
                } else {
                    let pixels = exr_pixels(&out);
                    assert_eq!(pixels.len(), 40 * 30);
                    assert!(pixels.iter().flatten().all(|v| v.is_finite()));
                }
            }
        }
    }
}

#[test]
fn a_transparent_png_is_straight_and_an_exr_premultiplied() {
    let folder = Folder::empty();
    // One faint white surfel.
    let splat = small_splat(1).replace("0.5 0.2 -0.3 3", "1.7724539 1.7724539 1.7724539 0");
    let splat = folder.write("a.ply", splat);
    let common = args(
        "render {} --eye 0,0,2 --look-at 0,0,0 --size 21x21 --device cpu -o",
        &[&splat],
    );
    run_json(&[&common[..], &[&folder.name("a.png")]].concat());
    let middle = image::open(folder.path("a.png"))
        .expect("a picture")
        .into_rgba8()
        .get_pixel(10, 10)
        .0;
    assert_eq!(middle, [255, 255, 255, 128]);
    run_json(&[&common[..], &[&folder.name("a.exr")]].concat());
    let [r, _, _, a] = exr_pixels(&folder.name("a.exr"))[10 * 21 + 10];
    assert!((a - 0.5).abs() < 1e-3 && (r - a).abs() < 1e-3, "{r} {a}");
}

#[test]
fn the_version_tells_what_was_built_and_what_draws() {
    for flag in ["--version", "-V"] {
        let told = run(&[flag]);
        let text = String::from_utf8_lossy(&told.stdout);
        assert!(told.status.success());
        let (first, second) = text.trim().split_once('\n').expect("two lines");
        let version = concat!("transplat ", env!("CARGO_PKG_VERSION"));
        assert!(first.starts_with(version), "{first}");
        let adapter = second.strip_prefix("adapter: ").expect("the adapter");
        assert!(!adapter.is_empty() && !adapter.starts_with("none"));
    }
}

#[test]
fn cameras_tell_that_a_splat_lies_on_its_side() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(50));
    let cameras = folder.write("transforms.json", level_cameras());
    let line = "render {} --cameras {} --device cpu -o {}";
    for (at, (up, is_explicit)) in [("", false), (" --up=+x", true), (" --up=+y", true)]
        .into_iter()
        .enumerate()
    {
        let out = folder.name(&at.to_string());
        let told = run_json(&args(&format!("{line}{up}"), &[&splat, &cameras, &out]));
        let warnings = told["warnings"].to_string();
        assert_eq!(!warnings.contains("(--up=+y)"), is_explicit, "{warnings}");
    }
}

#[test]
fn info_knows_every_kind() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(50));
    let bake = folder.name("a.bake");
    run_json(&args(
        "bake {} -o {} --device cpu --directions 32",
        &[&splat, &bake],
    ));
    let look = folder.write("look.json", r#"{"target": {"rotation": 90}}"#);
    for (file, kind) in [
        (&splat, "2DGS"),
        (&bake, "bake"),
        (&look, "look"),
        (&asset("sunset.hdr"), "environment"),
        (&folder.write("a.cube", small_lut()), "lut"),
    ] {
        let json = run_json(&["info", file]);
        assert_eq!(json["kind"], kind);
        if kind == "look" {
            assert_eq!(json["look"]["version"], 2);
            assert_eq!(json["look"]["target"]["rotation"], 90.0);
        }
        let text = run(&["info", file]);
        assert!(text.status.success() && !text.stdout.is_empty());
    }
}

#[test]
fn a_look_sets_what_the_command_line_leaves_open() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(100));
    let look = folder.write(
        "look.json",
        r#"{"target": {"rotation": 120}, "transfer": {"epsilon": 0.3}}"#,
    );
    let city = asset("city.hdr");
    let relight = |more: &[&str], name: &str| {
        let out = folder.name(name);
        let common = [
            "relight", &splat, "--source", "even", "--target", &city, "--device", "cpu", "-o", &out,
        ];
        run_json(&[&common[..], more].concat());
        fs::read(&out).expect("an output")
    };
    let by_look = relight(&["--look", &look], "a");
    let by_hand = relight(&["--rotate-target", "120", "--epsilon", "0.3"], "b");
    assert_eq!(by_look, by_hand);
    assert_ne!(
        relight(&["--look", &look, "--rotate-target", "0"], "c"),
        by_look
    );
}

/// Plumbing alone: the "truth" is what the directional method itself has drawn, so it scores high, nothing scores low, and the table
/// says so. How good the methods are is asked of [`the_bundled_splats_are_as_near_to_the_truth_as_they_were`].
#[test]
fn a_folder_of_truth_is_read_and_scored() {
    let folder = Folder::empty();
    let (teapot, city, sunset) = (asset("teapot.ply"), asset("city.hdr"), asset("sunset.hdr"));
    for inside in ["truth/envs", "truth/dev/teapot/gt/sunset"] {
        fs::create_dir_all(folder.path(inside)).expect("room");
    }
    fs::copy(&city, folder.path("truth/envs/city.hdr")).expect("room");
    fs::copy(&sunset, folder.path("truth/envs/sunset.hdr")).expect("room");
    fs::copy(&teapot, folder.path("truth/dev/teapot/source.ply")).expect("room");
    let cameras = fs::read_to_string(asset("teapot_cameras.json")).expect("the cameras");
    let mut cameras: serde_json::Value = serde_json::from_str(&cameras).expect("JSON");
    let frames = cameras["frames"].as_array_mut().expect("frames");
    frames.truncate(2);
    (cameras["w"], cameras["h"]) = (96.into(), 96.into());
    let transforms = folder.write("truth/dev/teapot/transforms_test.json", cameras.to_string());
    let manifest = r#"{"sets": {"dev": {"objects": {"teapot": {"source_env": "city", "targets": ["sunset", "interior"]}}}}}"#;
    folder.write("truth/MANIFEST.json", manifest);
    let (truth, out) = (folder.name("truth"), folder.name("report"));
    let drawn = folder.name("truth/dev/teapot/gt/sunset");
    let render = ["render", &teapot, "--source", &city, "--target", &sunset];
    let options = args(
        "--cameras {} --format exr --device cpu -o {}",
        &[&transforms, &drawn],
    );
    run_json(&[&render[..], &options].concat());
    let report = args(
        "report --only truth --ground-truth {} --device cpu -o {}",
        &[&truth, &out],
    );
    let told = run_json(&report);
    assert_eq!(told["pairs"], 1);
    let table = fs::read_to_string(folder.path("report/truth.csv")).expect("the table");
    let mut lines = table.lines();
    assert_eq!(
        lines.next(),
        Some(
            "object,source,target,preset,terms_off,psnr,psnr_mask,ssim,perceptual,transfer_ms,source_light"
        )
    );
    let rows: Vec<Vec<&str>> = lines.map(|l| l.split(',').collect()).collect();
    let psnr = |method: &str| -> f64 {
        let row = rows.iter().find(|r| r[3] == method);
        row.expect("a row")[5].parse().expect("a number")
    };
    // What was drawn in linear light is blended otherwise than the display blends.
    assert!(psnr("best") > 38.0, "{table}");
    for method in ["paper", "nothing"] {
        assert!(psnr(method) < psnr("best") - 3.0, "{method}: {table}");
    }
    assert!(folder.path("report/pictures/teapot_sunset.png").is_file());
    assert!(folder.path("report/truth.md").is_file());

    // What is not there is told.
    let other = [&report[..], &["--objects", "kettle"]].concat();
    run_told(&other, 1, &["kettle", "teapot"]);
    folder.write("truth/MANIFEST.json", manifest.replace("city", "moon"));
    run_told(&report, 1, &["moon.hdr"]);
}

/// The bundled teapot was captured under its city as that lies in its file.
#[test]
fn a_panorama_is_rotated_to_fit_the_splat() {
    let folder = Folder::empty();
    let [splat, city, sunset] = ["teapot.ply", "city.hdr", "sunset.hdr"].map(asset);
    let out = folder.name("relit.ply");
    let relight = |source, rotation| {
        args(
            "relight {} --source {} --rotate-source {} --target {} --device cpu -o {}",
            &[&splat, source, rotation, &sunset, &out],
        )
    };
    let told = run_json(&relight(&city, "fit"));
    let rotation = told["source_rotation"].as_f64().expect("a number");
    assert!(rotation.abs() < 3.0, "{rotation}");
    assert_eq!(told["source_mirrored"], false);
    let contradicts = "warning: The capture light contradicts the shading of teapot";
    run_told(
        &relight(&city, "140"),
        0,
        &[contradicts, "--rotate-source fit"],
    );
    let right = run_told(&relight(&city, "0"), 0, &[]);
    assert!(!String::from_utf8_lossy(&right.stderr).contains(contradicts));
    run_told(
        &relight("estimate", "fit"),
        1,
        &["--rotate-source fit", "panorama"],
    );
}

/// Under the light of its capture a splat looks as captured. A photograph of that light is clipped, and darker.
#[test]
fn a_photographed_panorama_serves_as_the_light_of_the_capture() {
    let folder = Folder::empty();
    let [splat, city] = ["teapot.ply", "city.hdr"].map(asset);
    let map = load_environment(Path::new(&city)).expect("the light is there");
    let mut photograph = image::RgbImage::new(map.width() as u32, map.height() as u32);
    for (pixel, radiance) in photograph.pixels_mut().zip(map.pixels()) {
        // A thirtieth of the sphere is clipped, which has a quarter of the light.
        let encoded = radiance.map(|v| srgb_encode((v / 1.87).min(1.0)));
        pixel.0 = encoded.map(|v| (255.0 * v).round() as u8);
    }
    let source = folder.name("photograph.png");
    photograph.save(&source).expect("room");
    let out = folder.name("relit.ply");
    let error = |clipped: &[&str]| {
        let line = "relight {} --source {} --target {} --device cpu -o {}";
        let arguments = args(line, &[&splat, &source, &city, &out]);
        let told = run_json(&[&arguments[..], clipped].concat());
        let colors = |file: &str| load_splat(Path::new(file)).expect("it was written").0.sh;
        let (before, after) = (colors(&splat), colors(&out));
        let each = before.iter().flatten().zip(after.iter().flatten());
        let squares: f64 = each.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        (squares.sqrt(), told["source_completed_gain"].as_f64())
    };
    let ((completed, gain), (as_it_is, none)) = (error(&[]), error(&["--source-clipped", "false"]));
    assert!(completed < 0.3 * as_it_is, "{completed} for {as_it_is}");
    // Of the light 0.75 was left.
    assert!(gain.is_some_and(|g| (g - 1.33).abs() < 0.2), "{gain:?}");
    assert_eq!(none, None);
}

/// Path-traced. The one splat was laid on a surface that was known, the other trained from pictures.
#[test]
fn the_bundled_splats_are_as_near_to_the_truth_as_they_were() {
    let folder = Folder::empty();
    let out = folder.name("report");
    let report = ["report", "--only", "truth", "--quick", "--unknown-light"];
    let told = run_json(&[&report[..], &["--device", "cpu", "-o", &out]].concat());
    assert_eq!(told["pairs"], 4);
    let table = fs::read_to_string(folder.path("report/truth.csv")).expect("the table");
    let rows: Vec<Vec<&str>> = table
        .lines()
        .skip(1)
        .map(|l| l.split(',').collect())
        .collect();
    let psnr = |object: &str, target: &str, preset: &str, light: &str| -> f64 {
        let key = [object, "city", target, preset, ""];
        let mut of = rows.iter().filter(|r| r[..5] == key && r[10] == light);
        let score = of.next().expect("a row")[5].parse().expect("a number");
        assert!(of.next().is_none(), "{key:?} twice: {table}");
        score
    };
    // What was measured (told and estimated by `best`, `paper`, not relit); a tenth of a decibel less is a worse picture than there was.
    for (object, target, measured) in [
        ("teapot", "sunset", [34.70, 34.08, 29.43, 21.46]),
        ("teapot", "interior", [34.01, 33.36, 27.42, 23.85]),
        ("breakfast", "sunset", [38.00, 37.05, 33.75, 23.03]),
        ("breakfast", "interior", [34.50, 33.56, 31.81, 25.02]),
    ] {
        let kinds = [
            ("best", "told"),
            ("best", "estimated"),
            ("paper", "told"),
            ("nothing", "told"),
        ];
        for ((preset, light), measured) in kinds.into_iter().zip(measured) {
            let psnr = psnr(object, target, preset, light);
            assert!(
                psnr > measured - 0.1,
                "{object} under {target} by {preset}, light {light}: {psnr} for {measured}"
            );
            // What is as captured is drawn against pictures that do not change.
            if preset == "nothing" {
                assert!((psnr - measured).abs() < 0.1, "{psnr} for {measured}");
            }
        }
    }
}

#[test]
fn a_report_measures_settings_and_extreme_cases() {
    let folder = Folder::empty();
    let out = folder.name("report");
    // Of another splat than the bundled one there is no truth.
    let splat = folder.write("small.ply", small_splat(300));
    let told = run_json(&args(
        "report {} --source even --target {} --quick --device cpu -o {}",
        &[&splat, &asset("sunset.hdr"), &out],
    ));
    assert_eq!(told["extreme_cases_failed"], 0);
    let table = |name: &str| {
        let text = fs::read_to_string(folder.path("report").join(name)).expect("a table");
        let mut lines = text.lines().map(str::to_owned);
        (lines.next().expect("a head"), lines.collect::<Vec<_>>())
    };
    let (head, rows) = table("error_vs_time.csv");
    assert_eq!(
        head,
        "setting,device,stage,time_ms,time_spread_ms,memory_bytes,rel_l2,max_abs,psnr_numeric,psnr_truth,on_front,is_default"
    );
    let fields = |row: &String| -> Vec<String> { row.split(',').map(str::to_owned).collect() };
    let default = rows
        .iter()
        .find(|r| r.starts_with("preset best,cpu,transfer"));
    let default = fields(default.expect("a row"));
    assert!(default[6].parse::<f64>().expect("a number") < 1e-4 && default[9].is_empty());
    let (head, rows) = table("extremes.csv");
    assert_eq!(
        head,
        "case,property,ok,f32_error,gpu_error,condition_number,note"
    );
    assert!(rows.len() > 60);
    let (head, rows) = table("skipped.csv");
    assert_eq!(head, "what,why,time_saved_ms,memory_saved_bytes,max_error");
    assert!(!rows.is_empty());
    for row in &rows {
        let error = fields(row).pop().expect("a field");
        // Where preset paper needs no maps, their softness goes as well.
        let most = if row.starts_with("the bake (paper)") {
            0.5
        } else {
            0.05
        };
        assert!(error.parse::<f64>().expect("a number") < most, "{row}");
    }
    let (_, rows) = table("epsilon.csv");
    assert!(rows.iter().filter(|r| r.contains(",true,")).count() == 2);
    let page = fs::read_to_string(folder.path("report/report.html")).expect("the page");
    assert!(page.contains("<svg") && page.ends_with("</html>\n"));
    // A splat of unknown light is asked for one.
    run_told(&["report", &splat, "-o", &out], 2, &["--source"]);
}

/// Compiled pipelines lie among the user's caches; a file there that is not whole is not taken, and is written anew.
#[test]
fn compiled_pipelines_are_kept_from_start_to_start() {
    let folder = Folder::empty();
    let draw = |name: &str| {
        let (splat, out) = (asset("teapot.ply"), folder.name(name));
        let line = "render {} --view before --size 64x48 --device gpu -o {}";
        let mut drawing = Command::new(program());
        drawing.args(args(line, &[&splat, &out]));
        drawing.env("XDG_CACHE_HOME", folder.path("caches"));
        assert!(drawing.status().expect("the program starts").success());
        picture(out.as_ref())
    };
    let first = draw("first.png");
    let kept = fs::read_dir(folder.path("caches/transplat/pipelines")).expect("it was made");
    let kept: Vec<_> = kept.map(|entry| entry.expect("readable").path()).collect();
    let [kept] = &kept[..] else {
        panic!("one file for the adapter: {kept:?}");
    };
    let whole = fs::read(kept).expect("readable").len();
    let written = || {
        fs::metadata(kept)
            .and_then(|m| m.modified())
            .expect("it is there")
    };
    let when = written();
    assert_eq!(draw("again.png"), first);
    // Nothing came to what was taken.
    assert_eq!(written(), when);
    fs::write(kept, [1; 100]).expect("room");
    assert_eq!(draw("broken.png"), first);
    assert_eq!(fs::read(kept).expect("readable").len(), whole);
}

#[test]
fn completions_and_manual_pages_know_the_commands() {
    let folder = Folder::empty();
    for shell in ["bash", "zsh", "fish"] {
        let text = String::from_utf8(run(&["completions", shell]).stdout).expect("text");
        assert!(
            text.contains("relight") && text.contains("turntable"),
            "{shell}"
        );
    }
    let pages = folder.name("man");
    assert!(run(&["man", &pages]).status.success());
    for (page, says) in [
        ("transplat.1", "transplat\\-relight"),
        ("transplat-relight.1", "target"),
    ] {
        let text = fs::read_to_string(folder.path("man").join(page)).expect("a page");
        assert!(text.contains(says), "{page}");
    }
}
