//! The command `relight`: splats under another light, as splats.

use std::fs;

use glam::Vec3;
use transplat_core::files::load_splat;
use transplat_core::surfels::SurfelCloud;
use transplat_tests::{Folder, args, asset, run, run_json, run_told, small_splat};

#[test]
fn relight_writes_the_layout_that_came_in() {
    let folder = Folder::empty();
    let (teapot, city, sunset) = (asset("teapot.ply"), asset("city.hdr"), asset("sunset.hdr"));
    let out = folder.name("out.ply");
    let told = run_json(&args(
        "relight {} --source {} --target {} --directions 64 --device cpu -o {}",
        &[&teapot, &city, &sunset, &out],
    ));
    assert_eq!(told["command"], "relight");
    assert_eq!(told["surfels"], 30000);
    assert_eq!(told["adapter"], "cpu");
    for stage in ["load", "project", "bake", "transfer", "export"] {
        assert!(
            told["stages_ms"][stage].as_f64().is_some_and(|ms| ms > 0.0),
            "{stage}"
        );
    }
    let [before, after] = [&teapot, &out].map(|path| fs::read(path).expect("it is there"));
    assert_eq!(before.len(), after.len());
    let header = before
        .windows(11)
        .position(|w| w == b"end_header\n")
        .expect("a header")
        + 11;
    assert_eq!(before[..header], after[..header]);
    let (a, _) = load_splat(teapot.as_ref()).expect("the asset");
    let (b, _) = load_splat(out.as_ref()).expect("the result");
    assert_eq!(
        (&a.positions, &a.scales, &a.opacities),
        (&b.positions, &b.scales, &b.opacities)
    );
    assert_ne!(a.sh, b.sh);
    assert!(b.sh.iter().flatten().all(|v| v.is_finite()));
}

/// Lights of one's own from a file: on either device alike, where they stand, and nothing else shines that the file does not name.
#[test]
fn relight_takes_a_rig_of_lights() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(400));
    let rig = |name: &str, lights: &str, around: &str| {
        let text = format!(r#"{{"lights": [{lights}], "environment": {around}}}"#);
        folder.write(name, text)
    };
    let point = |x: f32, y: f32| {
        format!(r#"{{"type": "point", "position": [{x}, {y}, 2], "intensity": [40, 30, 20]}}"#)
    };
    let near_first = rig("near_first.json", &point(0.0, 0.0), "null");
    let near_last = rig("near_last.json", &point(9.0, 39.0), "null");
    let relit = |rig: &str, device: &str| {
        let out = folder.name("out.ply");
        let line = "relight {} --source even --rig {} --device {} -o {}";
        run_json(&args(line, &[&splat, rig, device, &out]));
        let (cloud, _) = load_splat(out.as_ref()).expect("the result");
        cloud
    };
    let brightness = |cloud: &SurfelCloud, x: f32, y: f32| {
        let is_there = |p: &Vec3| (p.x, p.y) == (x, y);
        let i = cloud.positions.iter().position(is_there).expect("a surfel");
        cloud.sh[i * cloud.sh.len() / cloud.len()][1]
    };
    let ends = |cloud: &SurfelCloud| [brightness(cloud, 0.0, 0.0), brightness(cloud, 9.0, 39.0)];
    let first = relit(&near_first, "cpu");
    let ([a, b], [c, d]) = (ends(&first), ends(&relit(&near_last, "cpu")));
    assert!(a > b + 0.5 && d > c + 0.5, "{a} {b} {c} {d}");
    let on_gpu = relit(&near_first, "gpu");
    let off = (first.sh.iter().flatten()).zip(on_gpu.sh.iter().flatten());
    assert!(off.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) < 1e-5);
    // A rig beside a map that lies with it; and wrong ones.
    let out = folder.name("out.ply");
    let line = "relight {} --source even --rig {} --device cpu -o {}";
    let city = fs::read(asset("city.hdr")).expect("it is bundled");
    folder.write("city.hdr", city);
    let mixed = rig(
        "mixed.json",
        &point(0.0, 0.0),
        r#"{"file": "city.hdr", "scale": 2}"#,
    );
    run_json(&args(line, &[&splat, &mixed, &out]));
    let wrong = rig(
        "wrong.json",
        r#"{"type": "point", "position": [0, 0, 1]}"#,
        "null",
    );
    run_told(
        &args(line, &[&splat, &wrong, &out]),
        1,
        &["wrong.json", "intensity"],
    );
    let lost = rig("lost.json", &point(0.0, 0.0), r#"{"file": "nowhere.hdr"}"#);
    run_told(&args(line, &[&splat, &lost, &out]), 1, &["nowhere.hdr"]);
}

/// One light more on the command line is one more in the file; a rig that is written as an environment is the same light where it is far away;
/// and sun and sky are a light like any other.
#[test]
fn a_rig_is_told_on_the_command_line_and_written_as_an_environment() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(200));
    let key = r#"{"type": "directional", "to_light": [0.3, -0.4, 0.8], "irradiance": [3, 2, 1], "angle_deg": 6}"#;
    let fill = r#"{"type": "directional", "to_light": [-0.7, 0.2, 0.6], "irradiance": [0.5, 0.6, 0.9], "angle_deg": 6}"#;
    let around = r#""environment": {"uniform": [0.2, 0.2, 0.3]}"#;
    let both = format!(r#"{{"lights": [{key}, {fill}], {around}}}"#);
    let both = folder.write("both.json", both);
    let one = folder.write("one.json", format!(r#"{{"lights": [{key}], {around}}}"#));
    let out = folder.name("out.ply");
    let relit = |told: &[&str]| {
        let line = "relight {} --source even --device cpu -o {}";
        run_json(&[&args(line, &[&splat, &out])[..], told].concat());
        let (cloud, _) = load_splat(out.as_ref()).expect("the result");
        cloud.sh
    };
    let expected = relit(&["--rig", &both]);
    assert_eq!(relit(&["--rig", &one, "--light", fill]), expected);
    for name in ["rig.hdr", "rig.exr"] {
        let map = folder.name(name);
        let told = run_json(&args("light {} -o {}", &[&both, &map]));
        assert_eq!(told["output"], map);
        let found = relit(&["--target", &map]);
        // RGBE has eight bits a channel.
        let most = if name == "rig.hdr" { 6e-3 } else { 1e-3 };
        let off = expected.iter().flatten().zip(found.iter().flatten());
        let off = off.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(off < most, "{name}: {off}");
    }
    let sky = r#"{"lights": [], "environment": {"sky": {"sun": {"azimuth": 30, "elevation": 4}}}}"#;
    let sky = folder.write("sky.json", sky);
    let (evening, day) = (relit(&["--rig", &sky]), relit(&["--target", "sky"]));
    let mean = |sh: &[[f32; 3]], c: usize| sh.iter().map(|v| v[c]).sum::<f32>();
    assert!(mean(&day, 1) > mean(&evening, 1), "a low sun is dimmer");
    let map = folder.name("sky.exr");
    run_json(&args("light {} --columns 512 -o {}", &[&sky, &map]));
    // What is wrong is said.
    let line = "relight {} --source even --target even --device cpu -o {} --light {}";
    let lamp = r#"{"type": "lamp"}"#;
    run_told(&args(line, &[&splat, &out, lamp]), 2, &["--light", "lamp"]);
    let late = folder.write(
        "late.json",
        r#"{"lights": [], "environment": {"sky": {"turbidity": 30}}}"#,
    );
    run_told(
        &args("light {} -o {}", &[&late, &map]),
        1,
        &["late.json", "turbidity"],
    );
    run_told(&args("light {} -o a.png", &[&both]), 1, &[".hdr or .exr"]);
    let line = "relight {} --source sky --target even --device cpu -o {}";
    run_told(&args(line, &[&splat, &out]), 1, &["sun and sky"]);
}

#[test]
fn several_targets_give_one_output_each_and_a_saved_bake_gives_the_same() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(100));
    let bake = folder.name("a.bake");
    run_json(&["bake", &splat, "-o", &bake, "--device", "cpu"]);
    let (city, sunset) = (asset("city.hdr"), asset("sunset.hdr"));
    let (one, two) = (folder.name("one"), folder.name("two"));
    let common = [
        "relight", &splat, "--source", "even", "--target", &city, "--target", &sunset, "--device",
        "cpu",
    ];
    run_json(&[&common[..], &["-o", &one]].concat());
    let told = run_json(&[&common[..], &["-o", &two, "--bake", &bake]].concat());
    assert!(told["stages_ms"].get("bake").is_none());
    assert!(
        told["skipped"]
            .as_array()
            .is_some_and(|s| s.iter().any(|s| s["what"] == "bake"))
    );
    for name in ["city.ply", "sunset.ply"] {
        let [a, b] = ["one", "two"].map(|out| fs::read(folder.path(out).join(name)));
        assert_eq!(a.expect("an output"), b.expect("an output"));
    }
    let other = folder.write("b.ply", small_splat(90));
    let output = run(&args(
        "relight {} --source even --target even --bake {} -o {} --device cpu",
        &[&other, &bake, &folder.name("b2.ply")],
    ));
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("another geometry"));
}

#[test]
fn targets_of_one_name_do_not_write_over_each_other() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(20));
    let city = fs::read(asset("city.hdr")).expect("an environment");
    let [x, y, z] = ["x", "y", "z"].map(|name| {
        fs::create_dir(folder.path(name)).expect("room for it");
        folder.write(&format!("{name}/sky.1k.hdr"), &city)
    });
    let (other, out) = (folder.write("x/sky.2k.hdr", &city), folder.name("out"));
    let told = run_json(&args(
        "relight {} --source even --target {} --target {} --target {} --target {} -o {} --device cpu",
        &[&splat, &x, &y, &z, &other, &out],
    ));
    assert_eq!(told["outputs"].as_array().map(Vec::len), Some(4));
    for name in ["sky.1k.ply", "sky.1k-2.ply", "sky.1k-3.ply", "sky.2k.ply"] {
        assert!(folder.path("out").join(name).exists(), "{name}");
    }
}

#[test]
fn even_light_to_even_light_changes_little() {
    let folder = Folder::empty();
    let splat = folder.write("a.ply", small_splat(100));
    let out = folder.name("out.ply");
    run_json(&args(
        "relight {} --source even --target even -o {} --epsilon 0.000001 --device cpu",
        &[&splat, &out],
    ));
    let (a, _) = load_splat(splat.as_ref()).expect("the splat");
    let (b, _) = load_splat(out.as_ref()).expect("the result");
    for (a, b) in a.sh.iter().flatten().zip(b.sh.iter().flatten()) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
}

#[test]
fn a_capture_of_unknown_light_is_relit_from_an_estimate() {
    let folder = Folder::empty();
    let (teapot, sunset) = (asset("teapot.ply"), asset("sunset.hdr"));
    let (light, bake) = (folder.name("light.exr"), folder.name("teapot.bake"));
    run_json(&["bake", &teapot, "--device", "cpu", "-o", &bake]);
    let estimate = [
        "estimate", &teapot, "--bake", &bake, "--device", "cpu", "-o", &light,
    ];
    let told = &run_json(&estimate)["source_estimate"];
    assert_eq!(told["is_good"], true);
    assert!(told["confidence"].as_f64().expect("a number") > 0.9);
    // Where the sun of the street stands in which it was captured.
    let sun = told["sun_direction"].as_array().expect("a sun");
    let city = [0.54, -0.39, 0.74];
    let cosine: f64 = (0..3)
        .map(|i| sun[i].as_f64().expect("a number") * city[i])
        .sum();
    assert!(cosine > 0.995, "{sun:?}");
    // The file is what the program goes on with.
    let relit = ["estimate", &light].map(|source| {
        let out = folder.name("relit.ply");
        let relight = [
            "relight", &teapot, "--bake", &bake, "--device", "cpu", "--target", &sunset,
        ];
        run_json(&[&relight[..], &["--source", source, "-o", &out]].concat());
        fs::read(out).expect("a splat")
    });
    assert!(relit[0] == relit[1]);
    let relit_name = folder.name("relit.ply");
    // A bake that does not fit is told before anything is baked for the estimate.
    let relight = args(
        "relight {} --preset paper --bake {} --source estimate --target {} --device cpu -o {}",
        &[&teapot, &bake, &sunset, &relit_name],
    );
    run_told(&relight, 1, &[&bake, "for preset best"]);
    // What cannot be told is said, and no light is invented.
    let few = folder.write("few.ply", small_splat(20));
    let none = folder.name("none.exr");
    let estimate = ["estimate", &few, "--device", "cpu", "-o", &none];
    run_told(&estimate, 1, &["cannot be estimated"]);
    assert!(!folder.path("none.exr").exists());
    let out = folder.name("few_relit.ply");
    let relight = [
        "relight", &few, "--source", "estimate", "--target", &sunset, "--device", "cpu", "-o", &out,
    ];
    run_told(&relight, 0, &["half of the change for a capture"]);
}

#[test]
fn a_splat_of_another_format_is_relit_in_its_own() {
    let folder = Folder::empty();
    let (splat, sunset) = (asset("teapot.ply"), asset("sunset.hdr"));
    let (packed, glb) = (folder.name("teapot.spz"), folder.name("teapot.glb"));
    let told = run_json(&args("convert {} -o {}", &[&splat, &packed]));
    let warned = told["warnings"].to_string();
    assert!(
        warned.contains("no 2D Gaussians") && warned.contains("24 bits"),
        "{warned}"
    );
    // It had +z up, and has +y there.
    let (before, _) = load_splat(splat.as_ref()).expect("the teapot");
    let (after, _) = load_splat(packed.as_ref()).expect("what was written");
    let (before, after) = (before.bounds(), after.bounds());
    assert!((before.radius / after.radius - 1.0).abs() < 0.01);
    assert!((before.center.z - after.center.y).abs() < 1e-3 * before.radius);
    let out = folder.name("relit/");
    let line = "relight {} --source even --target {} --preset paper --device cpu -o {}";
    run_json(&args(line, &[&packed, &sunset, &out]));
    run_json(&args(line, &[&packed, &sunset, &glb]));
    for name in ["relit/sunset.spz", "teapot.glb"] {
        let (relit, _) = load_splat(folder.path(name).as_ref()).expect("a relit splat");
        assert!(relit.bounds().center.distance(after.center) < 1e-3 * after.radius);
    }
    run_told(
        &["convert", &packed, "-o", &folder.name("a.obj")],
        1,
        &[".compressed.ply"],
    );
}
