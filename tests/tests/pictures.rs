//! The bundled scene against pictures that were made otherwise: by an independent renderer of surfels, by a path tracer, by the same light in
//! another layout.

use std::f64::consts::PI;

use glam::Vec3;
use transplat_core::environment::EnvironmentMap;
use transplat_core::files::{load_backplate, load_environment, load_lut, write_environment};
use transplat_tests::{
    Folder, args, asset, exr_pixels, picture, psnr, root, run_json, run_told, small_lut,
};

fn render(device: &str, frame: &str, more: &[&str]) -> Vec<[f32; 3]> {
    let folder = Folder::empty();
    let (teapot, cameras) = (asset("teapot.ply"), asset("teapot_cameras.json"));
    let out = folder.name("");
    let common = args(
        "render {} --cameras {} --frames {} --size 200x200 --device {} -o {}",
        &[&teapot, &cameras, frame, device, &out],
    );
    run_json(&[&common[..], more].concat());
    picture(&folder.path(&format!("00{frame}.png")))
}

fn reference(name: &str) -> Vec<[f32; 3]> {
    picture(&root().join("tests/pictures").join(name))
}

#[test]
fn the_asset_is_drawn_as_an_independent_renderer_draws_it() {
    for device in ["cpu", "gpu"] {
        for frame in ["0", "3"] {
            let got = render(device, frame, &["--background", "black"]);
            let psnr = psnr(
                &got,
                &reference(&format!("teapot_city_00{frame}_surfels.png")),
            );
            // Both are rounded to 8 bits (58.9 dB between two roundings); an error of geometry or order falls far below 50.
            assert!(psnr > 52.0, "{device} {frame}: {psnr}");
        }
    }
}

#[test]
fn relighting_comes_nearer_to_the_path_traced_truth_than_doing_nothing() {
    let (city, sunset) = (asset("city.hdr"), asset("sunset.hdr"));
    for (frame, measured) in [("0", 38.25), ("3", 33.95)] {
        let truth = reference(&format!("teapot_sunset_00{frame}_truth.png"));
        let black = ["--background", "black", "--supersample", "2"];
        let light = ["--source", &city, "--target", &sunset];
        let before = render("cpu", frame, &black);
        let relit = render("cpu", frame, &[black, light].concat());
        let (before, after) = (psnr(&before, &truth), psnr(&relit, &truth));
        println!("frame {frame}: nothing {before:.1} dB, relit {after:.1} dB");
        // What was measured; a light turned or mirrored by mistake loses more than 3 dB.
        assert!(
            after > measured - 0.1 && after > before + 4.0,
            "{before} {after}"
        );
    }
}

#[test]
fn cpu_and_gpu_relight_alike() {
    let (city, sunset) = (asset("city.hdr"), asset("sunset.hdr"));
    let light = args(
        "--source {} --target {} --directions 64 --background environment",
        &[&city, &sunset],
    );
    let cpu = render("cpu", "3", &light);
    let gpu = render("gpu", "3", &light);
    let psnr = psnr(&cpu, &gpu);
    assert!(psnr > 52.0, "{psnr}");
}

/// Every pixel is what the table says of it; light that is linear has no table.
#[test]
fn a_table_of_colours_grades_what_is_for_display() {
    let folder = Folder::empty();
    let lut = folder.write("small.cube", small_lut());
    let table = load_lut(&folder.path("small.cube")).expect("a table");
    let teapot = asset("teapot.ply");
    for background in ["checker", "transparent"] {
        let draw = |name: &str, more: &[&str]| {
            let line = "render {} --turntable 1 --size 160x160 --device cpu --background {} -o {}";
            let out = folder.name(name);
            run_json(&[&args(line, &[&teapot, background, &out])[..], more].concat());
            image::open(folder.path(name))
                .expect("a picture")
                .into_rgba8()
        };
        let plain = draw("plain.png", &[]);
        let graded = draw("graded.png", &["--lut", &lut]);
        let (mut worst, mut seen) = (0f32, 0);
        for (plain, graded) in plain
            .pixels()
            .zip(graded.pixels())
            .filter(|(p, _)| p[3] > 200)
        {
            let color = [0, 1, 2].map(|c| f32::from(plain[c]) / 255.0);
            for (c, expected) in table.apply(color).into_iter().enumerate() {
                worst = worst.max((expected * 255.0 - f32::from(graded[c])).abs());
            }
            assert_eq!(plain[3], graded[3]);
            seen += 1;
        }
        // Half a step before the table, where it is steepest twice that, and half a step after it.
        assert!(seen > 2000 && worst < 1.6, "{seen} {worst}");
    }
    let linear = |name: &str, more: &[&str]| {
        let line = "render {} --turntable 1 --size 40x40 --device cpu -o {}";
        let out = folder.name(name);
        let json = run_json(&[&args(line, &[&teapot, &out])[..], more].concat());
        (exr_pixels(&out), json["warnings"].to_string())
    };
    let (plain, _) = linear("plain.exr", &[]);
    let (graded, warned) = linear("graded.exr", &["--lut", &lut]);
    assert!(plain == graded && warned.contains("LUT"), "{warned}");
}

/// A lens spreads light and makes none, and nothing is spread that is in focus.
#[test]
fn a_lens_blurs_what_is_not_in_focus() {
    let folder = Folder::empty();
    let teapot = asset("teapot.ply");
    let draw = |name: &str, more: &[&str]| {
        // All of it is within the picture.
        let line = "render {} --eye 0,-4,1.5 --fov 40 --size 160x160 --device cpu -o {}";
        let out = folder.name(name);
        run_json(&[&args(line, &[&teapot, &out])[..], more].concat());
        exr_pixels(&out)
    };
    let sharp = draw("sharp.exr", &[]);
    assert!(sharp == draw("closed.exr", &["--aperture", "0"]));
    let near = draw("near.exr", &["--aperture", "0.03"]);
    // Far before the object: all of it is blurred.
    let far = draw("far.exr", &["--aperture", "0.1", "--look-at", "0,-2.5,1"]);
    let straight = draw("straight.exr", &["--look-at", "0,-2.5,1"]);
    let light = |p: &[[f32; 4]]| p.iter().map(|p| p[1]).sum::<f32>();
    let edges = |p: &[[f32; 4]]| {
        let steps = p.windows(2).map(|p| (p[0][1] - p[1][1]).powi(2));
        steps.sum::<f32>()
    };
    // A step that is spread over n pixels has an nth of its squares: of a few here, of twenty there. Light is kept but for what sampling errs.
    for (sharp, blurred, most) in [(&sharp, &near, 0.8), (&straight, &far, 0.15)] {
        let kept = light(blurred) / light(sharp);
        assert!((kept - 1.0).abs() < 0.02, "{kept}");
        let left = edges(blurred) / edges(sharp);
        assert!(left < most, "{left}");
    }
    // What is in focus keeps its edges.
    assert!(edges(&near) > 0.2 * edges(&sharp));
}

/// However long the lens, all of the object is in the picture; how it is seen through differs.
#[test]
fn the_object_is_framed_for_the_lens_that_is_asked_for() {
    let folder = Folder::empty();
    let teapot = asset("teapot.ply");
    let draw = |name: &str, more: &[&str]| {
        let line = "render {} --size 200x120 --device cpu -o {}";
        let out = folder.name(name);
        run_json(&[&args(line, &[&teapot, &out])[..], more].concat());
        exr_pixels(&out)
    };
    // How near it comes to any edge, as a share of the picture.
    let margin = |p: &[[f32; 4]]| {
        let seen = (0..p.len()).filter(|i| p[*i][3] > 0.05);
        let margins = seen.map(|i| {
            let (x, y) = (i % 200, i / 200);
            (x.min(199 - x) as f32 / 200.0).min(y.min(119 - y) as f32 / 120.0)
        });
        margins.fold(f32::INFINITY, f32::min)
    };
    let long = draw("long.exr", &["--fov", "10"]);
    let wide = draw("wide.exr", &["--fov", "90"]);
    for picture in [&long, &wide] {
        assert!(
            (0.02..0.2).contains(&margin(picture)),
            "{}",
            margin(picture)
        );
    }
    assert!(psnr(&long, &wide) < 25.0);
}

/// A light is the same whichever way its picture lays it out: as a cross, which is known by its shape, as a disc, which is taken for an angular map
/// unless somebody says that it is a mirror ball.
#[test]
fn crosses_and_discs_light_as_the_panorama_that_they_show() {
    let folder = Folder::empty();
    let (splat, city) = (asset("teapot.ply"), asset("city.hdr"));
    let map = load_environment(city.as_ref()).expect("a light");
    // By the direction at a place of the picture, from -1 to 1 right and up; black where there is none.
    let write = |name: &str, [w, h]: [usize; 2], direction: &dyn Fn(f64, f64) -> Option<Vec3>| {
        let color = |i: usize| {
            let [x, y] = [i % w, i / w].map(|v| v as f64 + 0.5);
            let d = direction(2.0 * x / w as f64 - 1.0, 1.0 - 2.0 * y / h as f64);
            d.map_or([0.0; 3], |d| map.sample(d.normalize()))
        };
        let pixels = (0..w * h).map(color).collect();
        let map = EnvironmentMap::new(w, h, pixels);
        write_environment(&folder.path(name), &map).expect("room");
        folder.name(name)
    };
    let cross = write("cross.exr", [512, 384], &|x, y| {
        let (u, v) = (2.0 * (x + 1.0), 1.5 * (1.0 - y));
        let (right, up) = (2.0 * u.fract() - 1.0, 1.0 - 2.0 * v.fract());
        let d = match [u as usize, v as usize] {
            [0, 1] => [right, 1.0, up],
            [1, 1] => [1.0, -right, up],
            [2, 1] => [-right, -1.0, up],
            [3, 1] => [-1.0, right, up],
            [1, 0] => [-up, -right, 1.0],
            [1, 2] => [up, -right, -1.0],
            _ => return None,
        };
        Some(Vec3::from(d.map(|v| v as f32)))
    });
    let disc = |x: f64, y: f64| (x.hypot(y) <= 1.0).then_some(x.hypot(y).max(1e-9));
    let probe = write("probe.exr", [512; 2], &|x, y| {
        let r = disc(x, y)?;
        let (sin, cos) = (PI * r).sin_cos();
        Some(Vec3::from(
            [cos, -x * sin / r, y * sin / r].map(|v| v as f32),
        ))
    });
    let ball = write("ball.exr", [512; 2], &|x, y| {
        let r = disc(x, y)?;
        let n = Vec3::from([(1.0 - r * r).sqrt(), x, y].map(|v| v as f32));
        Some(2.0 * n.x * n - Vec3::X)
    });
    let bake = folder.name("teapot.bake");
    run_json(&args("bake {} --device cpu -o {}", &[&splat, &bake]));
    let drawn = |light: &str, told: &str| {
        let out = folder.name("drawn.png");
        let line = format!(
            "render {{}} --source even --target {{}} --bake {{}} --size 120x100 --background black --device cpu -o {{}} {told}"
        );
        let told = run_json(&args(&line, &[&splat, light, &bake, &out]));
        (picture(out.as_ref()), told["warnings"].to_string())
    };
    let (panorama, _) = drawn(&city, "");
    for (light, option, layout, warning) in [
        (&cross, "", "cube-cross", "cross"),
        (&probe, "", "angular-map", "angular map"),
        (&ball, "--target-layout mirror-ball", "angular-map", ""),
    ] {
        let (relit, warnings) = drawn(light, option);
        let psnr = psnr(&panorama, &relit);
        // What is left is the picture's own resolution, 512 pixels for all around at the least: 44 to 57 dB.
        assert!(psnr > 40.0, "{layout}: {psnr}");
        assert!(
            warnings.contains(warning) && (!warning.is_empty() || warnings == "[]"),
            "{warnings}"
        );
        // What nobody says something of is told by its shape, and a photograph is what it is.
        let told = run_json(&["info", light]);
        assert_eq!(told["layout"], layout);
        let plate = load_backplate(light.as_ref()).expect("a picture");
        assert_eq!(
            [&told["width"], &told["height"]],
            [plate.width, plate.height]
        );
        assert_eq!(plate.width, 512);
    }
    let (wrong, _) = drawn(&ball, "");
    // Read wrongly, its light comes from elsewhere: 24 dB.
    assert!(psnr(&panorama, &wrong) < 30.0);
    let line = "render {} --source even --target {} --target-layout mirror-ball -o {}";
    let out = folder.name("none.png");
    run_told(
        &args(line, &[&splat, &city, &out]),
        1,
        &["city.hdr", "fill a square"],
    );
}
