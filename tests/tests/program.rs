//! The program's commands: what they write, what they tell, and what they do with bad input.

use std::fs;
use std::path::{Path, PathBuf};

use transplat_core::load::load_asset;
use transplat_tests::{asset, run, run_json};

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn name(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        fs::write(self.path(name), bytes).expect("room for it");
        self.name(name)
    }

    /// Names of all files below.
    fn files(&self) -> Vec<String> {
        fn walk(folder: &Path, out: &mut Vec<String>) {
            for entry in fs::read_dir(folder).expect("a folder").flatten() {
                if entry.path().is_dir() {
                    walk(&entry.path(), out);
                } else {
                    out.push(entry.file_name().to_string_lossy().into_owned());
                }
            }
        }
        let mut out = Vec::new();
        walk(self.0.path(), &mut out);
        out.sort();
        out
    }
}

/// A small ascii splat: a square of surfels that face up.
fn small_splat(rows: usize) -> String {
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3";
    let mut text =
        format!("ply\nformat ascii 1.0\ncomment SplatRenderMode: 2dgs\nelement vertex {rows}\n");
    for name in names.split(' ') {
        text += &format!("property float {name}\n");
    }
    text += "end_header\n";
    for i in 0..rows {
        text += &format!("{} {} 0 0.5 0.2 -0.3 3 -2 -2 1 0 0 0\n", i % 10, i / 10);
    }
    text
}

#[test]
fn relight_writes_the_layout_that_came_in() {
    let folder = Folder::new();
    let (teapot, city, sunset) = (asset("teapot.ply"), asset("city.hdr"), asset("sunset.hdr"));
    let out = folder.name("out.ply");
    let told = run_json(&[
        "relight",
        &teapot,
        "--source",
        &city,
        "--target",
        &sunset,
        "--directions",
        "64",
        "--device",
        "cpu",
        "-o",
        &out,
    ]);
    assert_eq!(told["command"], "relight");
    assert_eq!(told["surfels"], 30000);
    assert_eq!(told["adapter"], "cpu");
    for stage in ["load", "project", "bake", "transfer", "export"] {
        assert!(
            told["stages_ms"][stage].as_f64().is_some_and(|ms| ms > 0.0),
            "{stage}"
        );
    }
    let (before, after) = (
        fs::read(&teapot).expect("the asset"),
        fs::read(&out).expect("the result"),
    );
    assert_eq!(before.len(), after.len());
    let header = before
        .windows(11)
        .position(|w| w == b"end_header\n")
        .expect("a header")
        + 11;
    assert_eq!(before[..header], after[..header]);
    let (a, _) = load_asset(teapot.as_ref()).expect("the asset");
    let (b, _) = load_asset(out.as_ref()).expect("the result");
    assert_eq!(
        (&a.positions, &a.scales, &a.opacities),
        (&b.positions, &b.scales, &b.opacities)
    );
    assert_ne!(a.sh, b.sh);
    assert!(b.sh.iter().flatten().all(|v| v.is_finite()));
}

#[test]
fn several_targets_give_one_output_each_and_a_saved_bake_gives_the_same() {
    let folder = Folder::new();
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
        let (a, b) = (
            fs::read(folder.path("one").join(name)),
            fs::read(folder.path("two").join(name)),
        );
        assert_eq!(a.expect("an output"), b.expect("an output"));
    }
    let other = folder.write("b.ply", small_splat(90));
    let output = run(&[
        "relight",
        &other,
        "--source",
        "even",
        "--target",
        "even",
        "--bake",
        &bake,
        "-o",
        &folder.name("b2.ply"),
        "--device",
        "cpu",
    ]);
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("another geometry"));
}

#[test]
fn no_input_is_written_over() {
    let folder = Folder::new();
    let splat = folder.write("city.ply", small_splat(20));
    let look = folder.write("look.json", "{}");
    let (city, here) = (asset("city.hdr"), folder.name(""));
    let relight = [
        "relight", &splat, "--source", "even", "--target", &city, "--look", &look, "-o",
    ];
    for arguments in [
        [&relight[..], &[&splat]].concat(),
        [&relight[..], &[&look]].concat(),
        [&relight[..], &[&here, "--target", "even"]].concat(),
        vec!["bake", &splat, "-o", &splat],
    ] {
        let output = run(&arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
        assert!(message.contains("is an input too"), "{message}");
    }
    assert_eq!(
        fs::read_to_string(&splat).expect("it is there"),
        small_splat(20)
    );
    assert_eq!(folder.files(), ["city.ply", "look.json"]);
}

#[test]
fn targets_of_one_name_do_not_write_over_each_other() {
    let folder = Folder::new();
    let splat = folder.write("a.ply", small_splat(20));
    let city = fs::read(asset("city.hdr")).expect("an environment");
    let mut arguments = vec![
        "relight".to_owned(),
        splat,
        "--source".into(),
        "even".into(),
    ];
    for name in ["x", "y", "z"] {
        fs::create_dir(folder.path(name)).expect("room for it");
        arguments.extend([
            "--target".into(),
            folder.write(&format!("{name}/sky.1k.hdr"), &city),
        ]);
    }
    arguments.extend(["--target".into(), folder.write("x/sky.2k.hdr", &city)]);
    arguments.extend([
        "-o".into(),
        folder.name("out"),
        "--device".into(),
        "cpu".into(),
    ]);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let told = run_json(&arguments);
    assert_eq!(told["outputs"].as_array().map(Vec::len), Some(4));
    for name in ["sky.1k.ply", "sky.1k-2.ply", "sky.1k-3.ply", "sky.2k.ply"] {
        assert!(folder.path("out").join(name).exists(), "{name}");
    }
}

#[test]
#[cfg(unix)]
fn a_full_disk_and_a_full_output_are_told() {
    let folder = Folder::new();
    let splat = folder.write("a.ply", small_splat(3000));
    let before = folder.files();
    let shell = |script: String| {
        std::process::Command::new("sh")
            .args(["-c", &script])
            .output()
            .expect("a shell")
    };
    let program = transplat_tests::program().display().to_string();
    // A limit of 8 KiB a file stands for the disk's end; the signal that comes with it is ignored.
    for (command, out) in [
        (
            format!("relight {splat} --source even --target even"),
            "out.ply",
        ),
        (format!("bake {splat}"), "out.bake"),
        (
            format!("render {splat} --eye 50,150,300 --size 300x300 --format exr"),
            "out.exr",
        ),
    ] {
        let out = folder.name(out);
        let output = shell(format!(
            "trap '' XFSZ; ulimit -f 8; exec {program} {command} --device cpu -o {out}"
        ));
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{command}: {message}");
        assert!(
            message.contains(&out) && !message.contains("panicked"),
            "{message}"
        );
        assert_eq!(folder.files(), before, "{command} left something");
    }
    #[cfg(target_os = "linux")]
    {
        let output = shell(format!("{program} info {splat} > /dev/full"));
        assert_eq!(
            output.status.code(),
            Some(1),
            "{}",
            String::from_utf8_lossy(&output.stderr)
        );
        let output = shell(format!("{program} info {splat} | true"));
        assert!(output.status.success() && output.stderr.is_empty());
    }
}

#[test]
fn even_light_to_even_light_changes_little() {
    let folder = Folder::new();
    let splat = folder.write("a.ply", small_splat(100));
    let out = folder.name("out.ply");
    run_json(&[
        "relight",
        &splat,
        "--source",
        "even",
        "--target",
        "even",
        "-o",
        &out,
        "--epsilon",
        "0.000001",
        "--device",
        "cpu",
    ]);
    let (a, _) = load_asset(splat.as_ref()).expect("the splat");
    let (b, _) = load_asset(out.as_ref()).expect("the result");
    for (a, b) in a.sh.iter().flatten().zip(b.sh.iter().flatten()) {
        assert!((a - b).abs() < 1e-4, "{a} {b}");
    }
}

#[test]
fn frames_keep_their_numbers_and_their_pixels() {
    let folder = Folder::new();
    let splat = folder.write("a.ply", small_splat(100));
    let (all, some) = (folder.name("all"), folder.name("some"));
    let common = [
        "render",
        &splat,
        "--turntable",
        "4",
        "--size",
        "64x48",
        "--device",
        "cpu",
    ];
    let told = run_json(&[&common[..], &["-o", &all]].concat());
    assert_eq!(told["pictures"], 4);
    run_json(&[&common[..], &["-o", &some, "--frames", "1-2"]].concat());
    for name in ["001.png", "002.png"] {
        let (a, b) = (
            fs::read(folder.path("all").join(name)),
            fs::read(folder.path("some").join(name)),
        );
        assert_eq!(a.expect("a picture"), b.expect("a picture"));
    }
    assert!(!folder.path("some").join("000.png").exists());
}

#[test]
fn every_view_and_format_is_written_by_both_devices() {
    let folder = Folder::new();
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
                run_json(&[
                    "render",
                    &splat,
                    "--source",
                    "even",
                    "--target",
                    &sunset,
                    "--view",
                    view,
                    "--eye",
                    "5,-8,9",
                    "--look-at",
                    "5,5,0",
                    "--size",
                    "40x30",
                    "--supersample",
                    "2",
                    "--directions",
                    "16",
                    "--background",
                    "#2a4b8c",
                    "--tone-map",
                    "agx",
                    "--device",
                    device,
                    "-o",
                    &out,
                ]);
                if format == "png" {
                    let picture = image::open(&out).expect("a picture").into_rgba8();
                    assert_eq!(picture.dimensions(), (40, 30));
                    assert!(
                        picture.pixels().all(|p| p.0[3] == 255),
                        "the background is filled"
                    );
                    assert!(
                        picture
                            .pixels()
                            .filter(|p| p.0 != [0x2a, 0x4b, 0x8c, 255])
                            .count()
                            > 50,
                        "{view} shows nothing"
                    );
                } else {
                    let exr = exr::prelude::read_first_rgba_layer_from_file(
                        &out,
                        |_, _| Vec::new(),
                        |pixels: &mut Vec<f32>, _, (r, g, b, a): (f32, f32, f32, f32)| {
                            pixels.extend([r, g, b, a])
                        },
                    )
                    .expect("an EXR");
                    let pixels = exr.layer_data.channel_data.pixels;
                    assert_eq!(pixels.len(), 40 * 30 * 4);
                    assert!(pixels.iter().all(|v| v.is_finite()));
                }
            }
        }
    }
}

#[test]
fn a_transparent_png_is_straight_and_an_exr_premultiplied() {
    let folder = Folder::new();
    // One faint white surfel.
    let splat = small_splat(1).replace("0.5 0.2 -0.3 3", "1.7724539 1.7724539 1.7724539 0");
    let splat = folder.write("a.ply", splat);
    let common = [
        "render",
        &splat,
        "--eye",
        "0,0,2",
        "--look-at",
        "0,0,0",
        "--size",
        "21x21",
        "--device",
        "cpu",
        "-o",
    ];
    run_json(&[&common[..], &[&folder.name("a.png")]].concat());
    let middle = image::open(folder.path("a.png"))
        .expect("a picture")
        .into_rgba8()
        .get_pixel(10, 10)
        .0;
    assert_eq!(middle, [255, 255, 255, 128]);
    run_json(&[&common[..], &[&folder.name("a.exr")]].concat());
    let exr = exr::prelude::read_first_rgba_layer_from_file(
        folder.path("a.exr"),
        |_, _| Vec::new(),
        |pixels: &mut Vec<[f32; 4]>, _, (r, g, b, a): (f32, f32, f32, f32)| {
            pixels.push([r, g, b, a])
        },
    )
    .expect("an EXR");
    let [r, _, _, a] = exr.layer_data.channel_data.pixels[10 * 21 + 10];
    assert!((a - 0.5).abs() < 1e-3 && (r - a).abs() < 1e-3, "{r} {a}");
}

#[test]
fn info_knows_every_kind() {
    let folder = Folder::new();
    let splat = folder.write("a.ply", small_splat(50));
    let bake = folder.name("a.bake");
    run_json(&[
        "bake",
        &splat,
        "-o",
        &bake,
        "--device",
        "cpu",
        "--directions",
        "32",
    ]);
    let look = folder.write("look.json", r#"{"rotate_target": 90}"#);
    for (file, kind) in [
        (&splat, "2DGS"),
        (&bake, "bake"),
        (&look, "look"),
        (&asset("sunset.hdr"), "environment"),
    ] {
        assert_eq!(run_json(&["info", file])["kind"], kind);
        let text = run(&["info", file]);
        assert!(text.status.success() && !text.stdout.is_empty());
    }
}

#[test]
fn a_look_sets_what_the_command_line_leaves_open() {
    let folder = Folder::new();
    let splat = folder.write("a.ply", small_splat(100));
    let look = folder.write(
        "look.json",
        r#"{"rotate_target": 120, "transfer": {"epsilon": 0.3}}"#,
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

#[test]
fn wrong_usage_exits_with_2() {
    let teapot = asset("teapot.ply");
    for arguments in [
        &[][..],
        &["relight"],
        &["relight", &teapot, "-o", "x.ply"],
        &["relight", &teapot, "--source", "even", "-o", "x.ply"],
        &["render", &teapot, "-o", "x"],
        &["render", &teapot, "--turntable", "0", "-o", "x"],
        &[
            "render",
            &teapot,
            "--turntable",
            "2",
            "--eye",
            "0,0,1",
            "-o",
            "x",
        ],
        &[
            "render",
            &teapot,
            "--turntable",
            "2",
            "--target",
            "even",
            "-o",
            "x",
        ],
        &[
            "render",
            &teapot,
            "--turntable",
            "2",
            "--view",
            "tau",
            "-o",
            "x",
        ],
        &["bake", &teapot, "--directions", "3", "-o", "x"],
        &[
            "relight",
            &teapot,
            "--source",
            "even",
            "--target",
            "even",
            "--sh-degree",
            "9",
            "-o",
            "x.ply",
        ],
        &[
            "relight",
            &teapot,
            "--source",
            "even",
            "--target",
            "even",
            "--epsilon",
            "-1",
            "-o",
            "x.ply",
        ],
        &["paint"],
    ] {
        let output = run(arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        assert!(
            !output.stderr.is_empty() && output.stdout.is_empty(),
            "{arguments:?}"
        );
    }
}

#[test]
fn bad_input_gets_one_clear_message_and_leaves_nothing() {
    let folder = Folder::new();
    let good = small_splat(100);
    let teapot = fs::read(asset("teapot.ply")).expect("the asset");
    let hdr = fs::read(asset("sunset.hdr")).expect("an environment");
    let good_ply = folder.write("good.ply", &good);
    let nan = good.replace("0.5 0.2", "nan nan");
    let exr_magic = [&[0x76, 0x2f, 0x31, 0x01, 2, 0, 0, 0][..], &[0; 100]].concat();
    let huge = "ply\nformat binary_little_endian 1.0\nelement vertex 1099511627776\nproperty float x\nend_header\n";
    let huge_all = good
        .replace("ascii", "binary_little_endian")
        .replace("vertex 100", "vertex 1099511627776");
    let assets = [
        (
            folder.write("truncated.ply", &teapot[..teapot.len() / 2]),
            "truncated",
        ),
        (folder.write("header.ply", &teapot[..300]), "end_header"),
        (folder.write("empty.ply", ""), "empty"),
        (
            folder.write("picture.ply", [0x89, b'P', b'N', b'G', 13, 10, 26, 10]),
            "not a PLY",
        ),
        (
            folder.write("type.ply", good.replace("float opacity", "uchar opacity")),
            "integer",
        ),
        (folder.write("nan.ply", nan), "no numbers"),
        (folder.write("huge.ply", huge), "no property"),
        (folder.write("huge2.ply", huge_all), "1099511627776"),
        (
            folder.write("short.ply", good.replace("vertex 100", "vertex 101")),
            "ends after 100",
        ),
        (folder.name("missing.ply"), "No such file"),
        (folder.name(""), "directory"),
    ];
    let mut environments = vec![
        (folder.write("cut.hdr", &hdr[..hdr.len() / 3]), "end"),
        (
            folder.write("big.hdr", "#?RADIANCE\n\n-Y 99999999 +X 99999999\n"),
            "claims",
        ),
        (folder.write("broken.exr", exr_magic), "OpenEXR"),
        (
            folder.write("broken.png", [0x89, b'P', b'N', b'G', 13, 10, 26, 10, 0, 0]),
            "broken.png",
        ),
        (folder.write("text.hdr", "hello"), "not a file"),
        (folder.name("missing.hdr"), "No such file"),
        (good_ply.clone(), "is a splat"),
    ];
    environments.push((folder.name("nothing-here/"), "No such file"));
    let before = folder.files();
    let out = folder.name("out.ply");
    let check = |arguments: &[&str], expected: &str| {
        let output = run(arguments);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{arguments:?}: {message}");
        assert!(
            message.contains(expected),
            "{arguments:?} does not say {expected:?}: {message}"
        );
        let lines = message
            .lines()
            .filter(|l| l.starts_with("transplat: "))
            .count();
        assert!(lines == 1 && !message.contains("panicked"), "{message}");
        assert_eq!(folder.files(), before, "{arguments:?} left something");
    };
    for (path, expected) in &assets {
        check(
            &[
                "relight", path, "--source", "even", "--target", "even", "--device", "cpu", "-o",
                &out,
            ],
            expected,
        );
        if expected != &"not a PLY" {
            check(&["info", path], "");
        }
    }
    for (path, expected) in &environments {
        check(
            &[
                "relight", &good_ply, "--source", path, "--target", "even", "--device", "cpu",
                "-o", &out,
            ],
            expected,
        );
    }
    let relight = [
        "relight", &good_ply, "--source", "even", "--target", "even", "--device", "cpu", "-o",
    ];
    check(
        &[&relight[..], &[&folder.name("no/such/folder/out.ply")]].concat(),
        "does not exist",
    );
    check(
        &[&relight[..], &[&folder.0.path().display().to_string()]].concat(),
        "directory",
    );
    check(
        &[&relight[..], &[&out, "--preset", "best"]].concat(),
        "best is not in this version",
    );
    check(
        &[&relight[..], &[&out, "--without", "suns"]].concat(),
        "preset best",
    );
    check(
        &[
            "render",
            &good_ply,
            "--turntable",
            "3",
            "--device",
            "cpu",
            "-o",
            &folder.name("a.png"),
        ],
        "do not fit",
    );
    check(
        &[
            "render",
            &good_ply,
            "--cameras",
            &good_ply,
            "--device",
            "cpu",
            "-o",
            &folder.name("pictures"),
        ],
        "camera file",
    );
    // A disk that is full.
    #[cfg(target_os = "linux")]
    check(&[&relight[..], &["/dev/full"]].concat(), "No space left");
}
