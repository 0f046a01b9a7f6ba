//! What the program does with bad input: one clear message, the right exit code, and nothing left behind or lost.

use std::fs;

use transplat_tests::{Folder, args, asset, run_told, small_lut, small_splat};

#[test]
fn no_input_is_written_over() {
    let folder = Folder::empty();
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
        run_told(&arguments, 1, &["is an input too"]);
    }
    assert_eq!(
        fs::read_to_string(&splat).expect("it is there"),
        small_splat(20)
    );
    assert_eq!(folder.files(), ["city.ply", "look.json"]);
}

#[test]
#[cfg(unix)]
fn a_full_disk_and_a_full_output_are_told() {
    let folder = Folder::empty();
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
fn wrong_usage_exits_with_2() {
    let teapot = asset("teapot.ply");
    for arguments in [
        &["relight"][..],
        &["relight", &teapot, "-o", "x.ply"],
        &["relight", &teapot, "--source", "even", "-o", "x.ply"],
        &["render", &teapot, "--turntable", "0", "-o", "x"],
        &args("render {} --turntable 2 --eye 0,0,1 -o x", &[&teapot]),
        &args("render {} --turntable 2 --target even -o x", &[&teapot]),
        &args("render {} --turntable 2 --view tau -o x", &[&teapot]),
        &["bake", &teapot, "--directions", "3", "-o", "x"],
        &args(
            "relight {} --source even --target even --sh-degree 9 -o x.ply",
            &[&teapot],
        ),
        &args(
            "relight {} --source even --target even --epsilon -1 -o x.ply",
            &[&teapot],
        ),
        &["paint"],
    ] {
        let output = run_told(arguments, 2, &[]);
        assert!(
            !output.stderr.is_empty() && output.stdout.is_empty(),
            "{arguments:?}"
        );
    }
}

#[test]
fn bad_input_gets_one_clear_message_and_leaves_nothing() {
    let folder = Folder::empty();
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
            "an image, where a splat",
        ),
        (
            folder.write("type.ply", good.replace("float opacity", "uchar opacity")),
            "integer",
        ),
        (folder.write("nan.ply", nan), "no numbers"),
        (folder.write("huge.ply", huge), "not a splat"),
        (folder.write("huge2.ply", huge_all), "1099511627776"),
        (
            folder.write("short.ply", good.replace("vertex 100", "vertex 101")),
            "ends after 100",
        ),
        (folder.name("missing.ply"), "no such file"),
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
        (
            folder.write("text.hdr", "hello"),
            "not an image that is read here",
        ),
        (folder.name("missing.hdr"), "no such file"),
        (good_ply.clone(), "a splat, where an image"),
    ];
    environments.push((folder.name("nothing-here/"), "no such file"));
    let of_harmonic = folder.name("paper.bake");
    let bake = ["bake", &good_ply, "--preset", "paper", "--device", "cpu"];
    run_told(&[&bake[..], &["-o", &of_harmonic]].concat(), 0, &[]);
    let cut_lut = folder.write(
        "cut.cube",
        small_lut().lines().take(12).collect::<Vec<_>>().join("\n"),
    );
    let missing_lut = folder.name("missing.cube");
    let before = folder.files();
    let out = folder.name("out.ply");
    let check = |arguments: &[&str], expected: &str| {
        let output = run_told(arguments, 1, &[expected]);
        let message = String::from_utf8_lossy(&output.stderr);
        let lines = message
            .lines()
            .filter(|l| l.starts_with("transplat: "))
            .count();
        assert!(lines == 1 && !message.contains("panicked"), "{message}");
        assert_eq!(folder.files(), before, "{arguments:?} left something");
    };
    for (path, expected) in &assets {
        let relight = "relight {} --source even --target even --device cpu -o {}";
        check(&args(relight, &[path, &out]), expected);
        if expected != &"an image, where a splat" {
            check(&["info", path], "");
        }
    }
    for (path, expected) in &environments {
        let relight = "relight {} --source {} --target even --device cpu -o {}";
        check(&args(relight, &[&good_ply, path, &out]), expected);
    }
    let relight = |line: &str, names: &[&str], expected: &str| {
        let line = format!("relight {{}} --source even --target even --device cpu {line}");
        check(&args(&line, &[&[&*good_ply][..], names].concat()), expected);
    };
    let nowhere = folder.name("no/such/folder/out.ply");
    relight("-o {}", &[&nowhere], "does not exist");
    let here = folder.name("");
    relight("-o {}", &[here.trim_end_matches('/')], "directory");
    let of_paper = "-o {} --preset paper --without suns";
    relight(of_paper, &[&out], "preset paper has no term");
    let of_best = "-o {} --without specular";
    relight(of_best, &[&out], "preset best has no term");
    let bake = "-o {} --bake {}";
    relight(bake, &[&out, &of_harmonic], "the bake is for preset paper");
    check(
        &args(
            "render {} --turntable 3 --device cpu -o {}",
            &[&good_ply, &folder.name("a.png")],
        ),
        "do not fit",
    );
    check(
        &args(
            "render {} --turntable 1 -o {}",
            &[&good_ply, &folder.name("a.jpg")],
        ),
        "an image is .png or .exr",
    );
    check(&["report", "-o", &good_ply], "is a file");
    for (lut, expected) in [
        (&asset("teapot_cameras.json"), "is expected here"),
        (&missing_lut, "no such file"),
        (&cut_lut, "colours where its sizes ask for 30"),
    ] {
        let line = "render {} --turntable 1 --lut {} --device cpu -o {}";
        check(
            &args(line, &[&good_ply, lut, &folder.name("a.png")]),
            expected,
        );
    }
    let relight_lut = "relight {} --source even --target even --device cpu -o {}";
    check(
        &args(relight_lut, &[&cut_lut, &out]),
        "a LUT (for --lut), where a splat",
    );
    let city = asset("city.hdr");
    relight("--target {} -o {}", &[&city, &out], "give a folder");
    check(
        &args(
            "render {} --cameras {} --device cpu -o {}",
            &[&good_ply, &good_ply, &folder.name("pictures")],
        ),
        "no file of cameras",
    );
    // A disk that is full.
    #[cfg(target_os = "linux")]
    relight("-o /dev/full", &[], "no room is left");
}

/// Not the one that another frame is drawn over, nor one that a look names and this picture does without.
#[test]
fn photographs_are_never_written_over() {
    let folder = Folder::empty();
    let splat = folder.write("good.ply", small_splat(100));
    fs::create_dir(folder.path("photos")).expect("room");
    let photograph = image::RgbImage::from_pixel(8, 8, image::Rgb([1, 2, 3]));
    for name in ["000.png", "001.png"] {
        photograph
            .save(folder.path("photos").join(name))
            .expect("room");
    }
    // The second camera's photograph is the first one's number.
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,5],[0,0,0,1]]";
    let frame = |name: &str| format!(r#"{{"file_path": "{name}", "transform_matrix": {pose}}}"#);
    let [first, second] = ["001.png", "000.png"].map(frame);
    let cameras = format!(r#"{{"camera_angle_x": 0.6, "frames": [{first}, {second}]}}"#);
    let cameras = folder.write("transforms.json", cameras);
    let photos = folder.name("photos");
    let lost = "would be lost";
    let line = "render {} --cameras {} --plate {} --frames 0 --device cpu -o {}";
    run_told(
        &args(line, &[&splat, &cameras, &photos, &photos]),
        1,
        &[lost],
    );
    let photo = folder.path("photos/000.png").display().to_string();
    let look =
        r#"{"version": 3, "asset": "good.ply", "background": "plate", "plate": "photos/000.png"}"#;
    let look = folder.write("look.json", look);
    let line = "render {} --turntable 1 --background white --device cpu -o {}";
    run_told(&args(line, &[&look, &photo]), 1, &[lost]);
    for name in ["000.png", "001.png"] {
        let kept = image::open(folder.path("photos").join(name)).expect("it is kept");
        assert_eq!(kept.to_rgb8(), photograph);
    }
}

#[test]
fn without_an_adapter_it_is_said_in_plain_words() {
    let error = transplat_gpu::choose_adapter(&[]).expect_err("there is none");
    let text = error.to_string();
    assert!(
        text.contains("no graphics driver was found") && text.contains("install"),
        "{text}"
    );
}

#[test]
fn a_wrong_batch_is_told_and_a_wrong_splat_keeps_no_other_from_being_drawn() {
    let folder = Folder::empty();
    folder.write("a.ply", small_splat(50));
    folder.write("cut.ply", &small_splat(50)[..2000]);
    folder.write("bare.json", "{}");
    let tries: [(&str, &str); 10] = [
        (r#"{"splats": []}"#, "names no splats"),
        (
            r#"{"splats": ["a.ply"], "turntible": 2}"#,
            "\"turntible\" is an unknown field",
        ),
        (r#"{"splats": ["a.ply"]}"#, "a camera is needed"),
        (
            r#"{"splats": ["a.ply", "./a.ply"], "turntable": 1}"#,
            "called a already",
        ),
        (
            r#"{"splats": ["a.ply"], "lights": ["even"], "turntable": 1}"#,
            "what it was captured under is missing",
        ),
        (
            r#"{"splats": ["a.ply"], "turntable": 99999999}"#,
            "1 to 100000 views",
        ),
        (
            r#"{"splats": ["a.ply"], "turntable": 0}"#,
            "1 to 100000 views",
        ),
        (
            r#"{"splats": ["cut.ply", "a.ply"], "source": "even", "lights": ["even"], "turntable": 1}"#,
            "not drawn: cut:",
        ),
        (
            r#"{"splats": ["a.ply"], "source": "even", "lights": ["gone.hdr", "even"], "turntable": 1}"#,
            "not drawn: gone:",
        ),
        // A look that does not say enough is one splat's matter too.
        (
            r#"{"splats": ["bare.json", "a.ply"], "source": "even", "lights": ["even"], "turntable": 1}"#,
            "not drawn: bare: the splat to work on is needed",
        ),
    ];
    for (i, (batch, expected)) in tries.iter().enumerate() {
        let batch = folder.write(&format!("{i}.json"), batch.as_bytes());
        let line = "render --batch {} --size 8x8 --device cpu -o {}";
        let out = folder.name(&format!("out{i}"));
        let told = run_told(
            &[&args(line, &[&batch, &out])[..], &["--json"]].concat(),
            1,
            &[expected],
        );
        if expected.starts_with("not drawn") {
            let told: serde_json::Value = serde_json::from_slice(&told.stdout).expect("one object");
            assert_eq!(
                (&told["pictures"], &told["failed"][1]),
                (&1.into(), &().into())
            );
        }
    }
    for out in ["out7", "out8", "out9"] {
        let picture = folder.name(&format!("{out}/a/even/000.png"));
        assert!(fs::exists(picture).is_ok_and(|there| there), "{out}");
    }
    let splat = folder.name("a.ply");
    run_told(
        &args(
            "render {} --turntable 1 --part 1/2 -o {}",
            &[&splat, &splat],
        ),
        2,
        &["--batch"],
    );
}

/// More than any machine holds, in a file that takes no room on the disk.
#[test]
fn a_splat_larger_than_the_memory_is_refused_before_it_is_taken_in() {
    let folder = Folder::empty();
    let (rows, row_bytes) = (100_000_000_000u64, 4 * 13);
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3";
    let mut header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {rows}\n");
    for name in names.split(' ') {
        header += &format!("property float {name}\n");
    }
    header += "end_header\n";
    let length = header.len() as u64 + rows * row_bytes;
    let splat = folder.write("vast.ply", header);
    let file = fs::OpenOptions::new().write(true).open(&splat);
    (file.expect("it is there").set_len(length)).expect("a file with holes");
    let out = folder.name("out.ply");
    let relight = [
        "relight", "--source", "even", "--target", "even", "-o", &out,
    ];
    for command in [&["info"][..], &relight] {
        let arguments = [command, &[&splat]].concat();
        run_told(
            &arguments,
            1,
            &["vast.ply", "GB of memory or more", "are free"],
        );
    }
}
