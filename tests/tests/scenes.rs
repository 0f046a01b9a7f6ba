//! Scenes of several objects: drawn as one, relit together, written and probed.

use std::collections::HashMap;
use std::f32::consts::PI;
use std::fs;
use std::path::Path;

use glam::{DVec3, Vec3};
use transplat_core::color::{Encoding, encode_sh};
use transplat_core::environment::EnvironmentMap;
use transplat_core::files::{load_environment, load_splat, write_splat};
use transplat_core::surfels::SurfelCloud;
use transplat_core::synthetic;
use transplat_tests::{Folder, args, asset, picture, psnr, run_json, run_told};

const VIEW: &str = "--eye 2,-2,1.5 --look-at 0,0,0.2 --size 160x120 --background black";

fn write(folder: &Folder, name: &str, cloud: &SurfelCloud) -> String {
    let path = folder.name(name);
    let stored = encode_sh(cloud.sh.to_vec(), cloud.sh_degree, Encoding::Stored);
    write_splat(cloud, &stored, path.as_ref()).expect("room");
    path
}

/// A ball of half the size over a plate, both captured under even light.
fn ball_over_plate(folder: &Folder) -> String {
    write(folder, "plate.ply", &synthetic::sheet(40));
    write(folder, "ball.ply", &synthetic::sphere(1500));
    let scene = r#"{"version": 3, "objects": [
        {"asset": "plate.ply", "source": {"file": "even"}},
        {"name": "the ball", "asset": "ball.ply", "source": {"file": "even"},
         "transform": {"scale": 0.4, "rotation": [0, 0, 0.6, 0.8], "translation": [0, 0, 0.5]}}]}"#;
    folder.write("scene.json", scene)
}

/// What a command line draws.
fn drawn(folder: &Folder, line: &str, names: &[&str]) -> Vec<[f32; 3]> {
    let out = folder.name("picture.png");
    let line = format!("render {line} {VIEW} -o {{}}");
    run_json(&args(&line, &[names, &[&out]].concat()));
    picture(out.as_ref())
}

fn mean(pixels: impl Iterator<Item = f32> + Clone) -> f32 {
    pixels.clone().sum::<f32>() / pixels.count() as f32
}

/// Eight bits a channel leave 59 dB; what is drawn in another order leaves less than 40.
#[test]
fn a_capture_that_is_split_in_two_is_drawn_as_the_whole() {
    let folder = Folder::empty();
    let (whole, _) = load_splat(asset("teapot.ply").as_ref()).expect("the asset");
    for (name, half) in [("even.ply", 0), ("odd.ply", 1)] {
        let taken: Vec<usize> = (half..whole.len()).step_by(2).collect();
        let part = whole.selected(&taken);
        write_splat(&part, &part.sh, folder.path(name).as_ref()).expect("room");
    }
    let scene = r#"{"version": 3, "objects": [{"asset": "even.ply"}, {"asset": "odd.ply"}]}"#;
    let scene = folder.write("scene.json", scene);
    for device in ["--device cpu", "--device gpu"] {
        let line = format!("{{}} {device} --view before");
        let together = drawn(&folder, &line, &[&scene]);
        let apart = drawn(&folder, &line, &[&asset("teapot.ply")]);
        let alike = psnr(&together, &apart);
        assert!(alike > 60.0, "{device}: {alike}");
    }
}

/// A ball of radius r at height d over a plate takes `(r / d)^2` of an even sky from the point below it.
#[test]
fn an_object_darkens_the_scene_below_it_and_nothing_far_from_it() {
    let folder = Folder::empty();
    let scene = ball_over_plate(&folder);
    let told = run_json(&args(
        "relight {} -o {} --device cpu",
        &[&scene, &folder.name("out/")],
    ));
    assert_eq!(told["surfels"], 1600 + 1500);
    assert_eq!(told["targets"][0]["name"], "even");
    let (before, _) = load_splat(&folder.path("plate.ply")).expect("the plate");
    let (after, _) = load_splat(&folder.path("out/plate.ply")).expect("the plate, relit");
    let ratio = |near: f32, far: f32| {
        let there = |i: &usize| (near..far).contains(&before.positions[*i].length());
        let light = |cloud: &SurfelCloud, i: usize| {
            Encoding::Stored.decode(0.282_095 * cloud.sh_of(i)[0][1])
        };
        let each = (0..before.len())
            .filter(there)
            .map(|i| light(&after, i) / light(&before, i));
        mean(each.collect::<Vec<_>>().into_iter())
    };
    let below = ratio(0.0, 0.15);
    // It takes 0.64 from above and throws back some of that; a sheet whose colour knows no view shows the mean of that and its other side.
    assert!((0.68..0.85).contains(&below), "{below}");
    let far = ratio(1.2, 2.0);
    assert!((0.93..1.01).contains(&far), "{far}");
    assert!(folder.path("out/the ball.ply").is_file());
}

#[test]
fn all_objects_in_one_splat_look_as_the_scene_does_on_either_device_and_by_either_preset() {
    let folder = Folder::empty();
    let (scene, one, city) = (
        ball_over_plate(&folder),
        folder.name("one.ply"),
        asset("city.hdr"),
    );
    for preset in ["best", "paper"] {
        let by = format!("--preset {preset} --device cpu");
        let line = format!("relight {{}} --target {{}} {by} -o {{}}");
        run_json(&args(&line, &[&scene, &city, &one]));
        let line = format!("{{}} --target {{}} {by}");
        let together = drawn(&folder, &line, &[&scene, &city]);
        let merged = drawn(&folder, "{} --device cpu", &[&one]);
        let alike = psnr(&together, &merged);
        // The paper's colours are linear, and lose a little when they are encoded.
        assert!(
            alike > if preset == "best" { 50.0 } else { 35.0 },
            "{preset}: {alike}"
        );
        let line = format!("{{}} --target {{}} --preset {preset} --device gpu");
        let alike = psnr(&together, &drawn(&folder, &line, &[&scene, &city]));
        assert!(alike > 45.0, "{preset}: {alike}");
        let captured = drawn(&folder, "{} --view before --device cpu", &[&scene]);
        assert!(
            psnr(&together, &captured) < 35.0,
            "{preset}: something is relit"
        );
    }
    // What is not shown is not there.
    let text = fs::read_to_string(&scene).expect("the scene");
    let alone = folder.write(
        "alone.json",
        text.replace("\"name\"", "\"shown\": false, \"name\""),
    );
    let told = run_json(&args(
        "relight {} --target {} -o {} --device cpu",
        &[&alone, &city, &folder.name("alone.ply")],
    ));
    assert_eq!(told["surfels"], 1600);
}

/// Where a scene stands is nothing to its light: turned as a whole, with light and camera, it is the same picture.
#[test]
fn objects_light_and_camera_that_are_turned_together_show_the_same() {
    let folder = Folder::empty();
    let (scene, city) = (ball_over_plate(&folder), asset("city.hdr"));
    let text = fs::read_to_string(&scene).expect("the scene");
    // A quarter turn about the vertical: of the plate that alone, of the ball after its own, and both a step aside.
    let quarter =
        r#""transform": {"rotation": [0, 0, 0.70710678, 0.70710678], "translation": [5, 1, 2]}"#;
    let turned = text.replacen("\"source\"", &format!("{quarter}, \"source\""), 1);
    let (own, both) = ("[0, 0, 0.6, 0.8]", "[0, 0, 0.98994949, 0.14142136]");
    let turned = turned
        .replace(own, both)
        .replace("[0, 0, 0.5]", "[5, 1, 2.5]");
    let turned = folder.write("turned.json", turned);
    let line = "{} --target {} --device cpu";
    let straight = drawn(&folder, line, &[&scene, &city]);
    let out = folder.name("turned.png");
    let view = "--eye 7,3,3.5 --look-at 5,1,2.2 --size 160x120 --background black";
    let line = format!("render {line} --rotate-target 90 {view} -o {{}}");
    run_json(&args(&line, &[&turned, &city, &out]));
    let alike = psnr(&straight, &picture(out.as_ref()));
    assert!(alike > 50.0, "{alike}");
}

/// The first object's coordinates and light are the scene's, whether it is shown or not; what is written as one file is where it stands.
#[test]
fn an_object_of_a_scene_whose_first_is_not_shown_stays_where_it_stands() {
    let folder = Folder::empty();
    let (scene, city) = (ball_over_plate(&folder), asset("city.hdr"));
    let text = fs::read_to_string(&scene).expect("the scene");
    let hidden = text.replacen(
        "\"source\"",
        "\"shown\": false, \"up\": \"-y\", \"source\"",
        1,
    );
    let hidden = folder.write("hidden.json", hidden);
    let [one, own] = ["one.ply", "own/"].map(|name| folder.name(name));
    let line = "relight {} --target {} --device cpu -o {}";
    for out in [&one, &own] {
        let told = run_json(&args(line, &[&hidden, &city, out]));
        assert_eq!(told["surfels"], 1500);
    }
    let (placed, _) = load_splat(one.as_ref()).expect("the ball where it stands");
    let around = placed.bounds();
    assert!(around.center.distance(Vec3::new(0.0, 0.0, 0.5)) < 0.02);
    assert!((around.radius / 0.4 - 1.0).abs() < 0.1, "{}", around.radius);
    assert_eq!(placed.up, transplat_core::surfels::UpAxis::MinusY);
    let own = folder.path("own/city.ply");
    let (captured, _) = load_splat(&own).expect("the ball as it was captured");
    assert!(captured.bounds().center.length() < 0.02);
}

/// A picture's channels by name.
fn channels(path: &str) -> HashMap<String, Vec<f32>> {
    use exr::prelude::{ReadChannels as _, ReadLayers as _};
    let image = exr::prelude::read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .expect("an EXR");
    let list = image.layer_data.channel_data.list.into_iter();
    let each = list.map(|c| (c.name.to_string(), c.sample_data.values_as_f32().collect()));
    each.collect()
}

/// The plate times the shadow, with the object over it, is the picture; and its look makes it again.
#[test]
fn layers_put_together_are_the_picture() {
    let folder = Folder::empty();
    let (scene, city) = (ball_over_plate(&folder), asset("city.hdr"));
    let [first, again] = ["first.exr", "again.exr"].map(|name| folder.name(name));
    for preset in ["best", "paper"] {
        let line = format!(
            "render {{}} --target {{}} {VIEW} --preset {preset} --supersample 2 --device cpu --layers -o {{}}"
        );
        run_json(&args(&line, &[&scene, &city, &first]));
        let all = channels(&first);
        let of = |layer: &str, letters: &str| -> Vec<&[f32]> {
            let name = |c: char| format!("{layer}.{c}").trim_start_matches('.').to_owned();
            letters.chars().map(|c| &all[&name(c)][..]).collect()
        };
        let (beauty, plate, shadow) = (of("", "RGBA"), of("plate", "RGBA"), of("shadow", "RGB"));
        let ball = of("the_ball", "RGBA");
        let n = beauty[0].len();
        let (mut error, mut darkest) = (0.0, 1.0f32);
        for i in 0..n {
            for c in 0..3 {
                let under = plate[c][i] * shadow[c][i];
                let together = ball[c][i] + (1.0 - ball[3][i]) * under;
                error += f64::from(together - beauty[c][i]).powi(2);
                darkest = darkest.min(shadow[c][i]);
            }
        }
        let db = -10.0 * (error / (3 * n) as f64).log10();
        assert!(db > 50.0, "{preset}: {db}");
        assert!(darkest < 0.8, "{preset}: there is a shadow: {darkest}");
        let (id, depth, normal) = (&all["id.X"], &all["depth.Z"], of("normal", "XYZ"));
        for i in 0..n {
            match id[i] {
                0.0 => assert!(depth[i] > 1e9 && beauty[3][i] == 0.0),
                1.0 => {
                    assert!(ball[3][i] <= 0.5 * beauty[3][i] + 0.01);
                    assert!(ball[3][i] > 0.01 || normal[2][i] > 0.9);
                }
                2.0 => assert!(ball[3][i] >= 0.5 * beauty[3][i] - 0.01 && depth[i] < 3.5),
                other => panic!("id {other}"),
            }
        }
        assert!(id.contains(&2.0) && id.contains(&1.0) && id.contains(&0.0));
    }
    let look = folder.name("first.look.json");
    let line = "render --look {} --size 160x120 --supersample 2 --device cpu --layers -o {}";
    run_json(&args(line, &[&look, &again]));
    let [first, again] = [&first, &again].map(|path| channels(path));
    for (name, values) in &first {
        let off = values.iter().zip(&again[name]).map(|(a, b)| (a - b).abs());
        assert!(mean(off.collect::<Vec<_>>().into_iter()) < 1e-3, "{name}");
    }
    // One object alone on a ground that catches its shadow.
    let caught = folder.write(
        "caught.json",
        r#"{"asset": "ball.ply", "source": {"file": "even"}, "target": {"file": "even"}, "shadow_catcher": true}"#,
    );
    let out = folder.name("caught.exr");
    run_json(&args(
        &format!(
            "render {{}} {} --device cpu --layers -o {{}}",
            VIEW.replace("--background black", "")
        ),
        &[&caught, &out],
    ));
    let caught = channels(&out);
    assert!(!caught.contains_key("plate.R") && caught.contains_key("ball.A"));
    assert!(caught["shadow.R"].iter().any(|s| *s < 0.8));
    let line = "render {} --target {} --eye 2,2,2 --layers -o {}";
    run_told(
        &args(line, &[&scene, &city, &folder.name("a.png")]),
        2,
        &[".exr"],
    );
}

/// Objects that meet in a pixel each have their share of it: together they go over the plate.
#[test]
fn layers_of_objects_that_touch_in_the_picture_are_added() {
    let folder = Folder::empty();
    write(&folder, "plate.ply", &synthetic::sheet(8));
    write(&folder, "ball.ply", &synthetic::sphere(300));
    let ball = |name: &str, at: &str| {
        format!(
            r#"{{"name": "{name}", "asset": "ball.ply", "source": {{"file": "even"}}, "transform": {{"scale": 0.4, "translation": {at}}}}}"#
        )
    };
    let scene = folder.write(
        "scene.json",
        format!(
            r#"{{"version": 3, "objects": [{{"asset": "plate.ply", "source": {{"file": "even"}}}}, {}, {}]}}"#,
            ball("near", "[0.3, 0, 0.5]"),
            ball("far", "[-0.3, 0.3, 0.5]")
        ),
    );
    let out = folder.name("layers.exr");
    let line = format!("render {{}} --target even {VIEW} --device cpu --layers -o {{}}");
    run_json(&args(&line, &[&scene, &out]));
    let all = channels(&out);
    let value = |layer: &str, c: char, i: usize| all[&format!("{layer}.{c}")][i];
    let n = all["A"].len();
    let (mut error, mut shared) = (0.0, 0);
    for i in 0..n {
        let alphas = ["near", "far"].map(|layer| value(layer, 'A', i));
        shared += usize::from(alphas.iter().all(|a| *a > 0.2));
        for c in ['R', 'G', 'B'] {
            let objects = value("near", c, i) + value("far", c, i);
            let under = value("plate", c, i) * value("shadow", c, i);
            let together = objects + (1.0 - alphas[0] - alphas[1]) * under;
            error += f64::from(together - all[&c.to_string()][i]).powi(2);
        }
    }
    let db = -10.0 * (error / (3 * n) as f64).log10();
    assert!(shared > 10, "they touch in {shared} pixels");
    assert!(db > 50.0, "{db}");
}

/// Names that no format has room for, or no alphabet: none is lost, none taken twice. Objects on the ground of a photograph have a layer each.
#[test]
fn layers_are_called_so_that_a_compositor_reads_them() {
    let folder = Folder::empty();
    write(&folder, "plate.ply", &synthetic::sheet(8));
    write(&folder, "ball.ply", &synthetic::sphere(100));
    let long = "long".repeat(100);
    let names = ["Düse λ", "花瓶", "", "a.b", "a b", &long];
    let named = names.map(|name| {
        format!(
            r#"{{"name": "{name}", "asset": "ball.ply", "source": {{"file": "even"}}, "transform": {{"scale": 0.2}}}}"#
        )
    });
    let scene = |more: &str| {
        format!(
            r#"{{"version": 3, {more} "objects": [{{"asset": "plate.ply", "source": {{"file": "even"}}}}, {}]}}"#,
            named.join(",")
        )
    };
    let out = folder.name("a.exr");
    let line = "render {} --eye 2,-2,1.5 --size 32x24 --device cpu --layers -o {}";
    let layers = |scene: &str| {
        let scene = folder.write("scene.json", scene);
        run_json(&args(line, &[&scene, &out]));
        let all = channels(&out);
        let with_alpha = all.keys().filter_map(|name| name.strip_suffix(".A"));
        let mut layers: Vec<String> = with_alpha.map(str::to_owned).collect();
        layers.sort();
        layers
    };
    let cut = &long[..200];
    let expected = |plate: &str| {
        let mut expected =
            ["D_se__", "object", "ball", "a_b", "a_b-2", cut, plate].map(str::to_owned);
        expected.sort();
        expected
    };
    assert_eq!(layers(&scene("")), expected("plate"));
    let bytes = fs::read(&out).expect("the picture");
    let look = String::from_utf8_lossy(&bytes);
    assert!(
        look.contains("D\\u00fcse \\u03bb"),
        "the look is kept with it"
    );
    // Where the ground is a photograph's, the first one is no place.
    assert_eq!(
        layers(&scene(r#""shadow_catcher": true,"#)),
        expected("plate-2")
    );
}

#[test]
fn a_probe_sees_the_scene_from_where_an_object_stands_without_it() {
    let folder = Folder::empty();
    let (scene, light) = (ball_over_plate(&folder), folder.name("light.exr"));
    let told = run_json(&args(
        "probe {} --at {} -o {} --device cpu",
        &[&scene, "the ball", &light],
    ));
    let place = &told["places"][0];
    assert_eq!(
        place["at"][2].as_f64().map(|z| (100.0 * z).round()),
        Some(50.0)
    );
    // The plate is half of radiance 1/2 below; above there is the even light of the capture.
    let map = load_environment(light.as_ref()).expect("a light");
    let toward = |z: f32| map.sample(Vec3::new(0.0, 0.0, z))[1];
    assert!((toward(1.0) - 1.0).abs() < 0.01, "{}", toward(1.0));
    assert!((toward(-1.0) - 0.5).abs() < 0.05, "{}", toward(-1.0));
    let many = folder.name("many");
    let told = run_json(&args(
        "probe {} --at 0,0,0.3 --at -1,0,0.4 --environment {} -o {} --device cpu",
        &[&folder.name("plate.ply"), &asset("city.hdr"), &many],
    ));
    assert_eq!(told["outputs"].as_array().map(Vec::len), Some(2));
    assert!(Path::new(&many).join("001.exr").is_file());
    let told = run_json(&args(
        "probe {} --at 0,0,0.3 -o {} --device cpu",
        &[&folder.name("plate.ply"), &light],
    ));
    assert!(
        told["warnings"].to_string().contains("--environment"),
        "{told}"
    );
}

#[test]
fn scenes_that_say_too_little_are_refused_with_what_is_missing() {
    let folder = Folder::empty();
    let scene = ball_over_plate(&folder);
    let text = fs::read_to_string(&scene).expect("the scene");
    let no_light = text.replacen("\"source\": {\"file\": \"even\"}", "\"locked\": false", 1);
    let no_light = folder.write("no_light.json", no_light);
    let gone = folder.write("gone.json", text.replace("ball.ply", "bull.ply"));
    let out = folder.name("out.ply");
    run_told(
        &["relight", &no_light, "-o", &out],
        2,
        &["plate", "--source"],
    );
    let askew = folder.write("askew.json", text.replace("0.6, 0.8", "0.6, 0.9"));
    let told = [
        "askew.json",
        "object 2 (the ball)",
        "rotation [0, 0, 0.6, 0.9]",
    ];
    run_told(&["relight", &askew, "-o", &out], 1, &told);
    let nested = folder.write("nested.json", text.replace("ball.ply", "scene.json"));
    let told = ["scene.json", "a look, where one splat is expected"];
    run_told(&["relight", &nested, "-o", &out], 1, &told);
    let told = run_json(&["info", &gone]);
    assert!(
        told["warnings"]
            .to_string()
            .contains("bull.ply: is not there")
    );
    run_told(&["relight", &gone, "-o", &out], 1, &["bull.ply"]);
    run_told(
        &[
            "probe",
            &scene,
            "--at",
            "a ball",
            "-o",
            &folder.name("a.exr"),
        ],
        1,
        &["a ball", "the ball", "plate"],
    );
    run_told(
        &[
            "probe",
            &scene,
            "--at",
            "0,0,1",
            "-o",
            &folder.name("a.hdr"),
        ],
        1,
        &[".exr"],
    );
    let bake = folder.name("plate.bake");
    run_json(&[
        "bake",
        &folder.name("plate.ply"),
        "-o",
        &bake,
        "--device",
        "cpu",
    ]);
    let line = "relight {} --bake {} -o {} --device cpu";
    run_told(&args(line, &[&scene, &bake, &out]), 1, &["one object"]);
    assert!(!Path::new(&out).exists());
}

/// One file in two parts along a box: under any light they are where they were captured what the whole is there, and each is written with
/// its own rows.
#[test]
fn what_is_cut_out_of_a_capture_was_lit_by_the_rest() {
    let folder = Folder::empty();
    let mut cloud = synthetic::sphere_over_slab(900);
    // Dark: it throws back little.
    cloud.sh.iter_mut().flatten().for_each(|v| *v *= 0.2);
    let capture = write(&folder, "capture.ply", &cloud);
    let (cloud, _) = load_splat(capture.as_ref()).expect("the capture");
    let cut = |keep: &str| {
        format!(
            r#""asset": "capture.ply", "source": {{"file": "even"}}, "cut": [{{"keep": "{keep}", "min": [-9, -9, 0.1], "max": [9, 9, 9]}}]"#
        )
    };
    let city = asset("city.hdr");
    let scene = |name: &str, moved: &str| {
        let [ball, slab] = ["inside", "outside"].map(cut);
        let scene = format!(
            r#"{{"version": 3, "objects": [{{{slab}, "name": "slab"}}, {{{ball}, "name": "ball"{moved}}}]}}"#
        );
        folder.write(name, scene)
    };
    let apart = scene("apart.json", "");
    let whole = r#"{"asset": "capture.ply", "source": {"file": "even"}}"#;
    let whole = folder.write("whole.json", whole);
    let line = "{} --target {} --device cpu";
    let [a, b] = [&apart, &whole].map(|scene| drawn(&folder, line, &[scene, &city]));
    assert!(psnr(&a, &b) > 50.0, "{}", psnr(&a, &b));
    // Without the ball the slab is brighter below it than it was captured, under the same light.
    let away = scene("away.json", r#", "shown": false"#);
    run_json(&args(
        "relight {} --target even --device cpu -o {}",
        &[&away, &folder.name("out/")],
    ));
    let (slab, _) = load_splat(&folder.path("out/even.ply")).expect("the slab");
    assert_eq!(slab.len(), cloud.len() - 900);
    let below = |cloud: &SurfelCloud, from: usize| {
        let each = (0..slab.len()).filter(|i| {
            let place = slab.positions[*i];
            place.z > -0.05 && place.truncate().length() < 0.2
        });
        let light = |i| Encoding::Stored.decode(0.282_095 * cloud.sh_of(from + i)[0][1]);
        mean(each.map(light).collect::<Vec<_>>().into_iter())
    };
    // It took half of the sky, and threw back a little of that.
    let ratio = below(&slab, 0) / below(&cloud, 900);
    assert!((1.1..2.0).contains(&ratio), "{ratio}");
    // Nothing is left on the kept side.
    let none = cut("inside").replace("0.1]", "8]");
    let none = folder.write(
        "none.json",
        format!(r#"{{"version": 3, "objects": [{{{none}}}]}}"#),
    );
    let out = folder.name("none.png");
    let line = "render {} --target even --eye 1,1,1 -o {}";
    run_told(
        &args(line, &[&none, &out]),
        1,
        &["capture.ply", "kept side", "lie between"],
    );
}

/// A matte ball in a room that shows its lamp clipped at white: taken out, the ball tells how bright that was, and the room what else shone.
#[test]
fn what_is_taken_out_of_a_room_is_relit_from_the_light_that_arrived_there() {
    let folder = Folder::empty();
    let to_lamp = Vec3::new(0.6, 0.0, 0.8);
    let is_lamp = |d: Vec3| d.dot(to_lamp) > 0.93;
    let mut capture = synthetic::sphere(1500);
    let ball = capture.len();
    // Radiance 9 over a solid angle of 0.44, and 0.3 all around.
    let irradiance = |n: Vec3| 0.3 * PI + 9.0 * 0.44 * n.dot(to_lamp).max(0.0);
    let mut colors: Vec<f32> = (capture.positions.iter())
        .map(|n| 0.5 * irradiance(*n) / PI)
        .collect();
    let walls = synthetic::sphere(8000);
    colors.extend(
        walls
            .positions
            .iter()
            .map(|d| if is_lamp(*d) { 1.0 } else { 0.3 }),
    );
    capture.add(&walls, 8.0, Vec3::ZERO);
    capture.scales[ball..].iter_mut().for_each(|s| *s *= 2.0);
    capture.opacities.fill(0.999);
    capture.encoding = Encoding::Linear;
    capture.sh_degree = 0;
    capture.sh = colors.iter().map(|v| [v / 0.282_095; 3]).collect();
    write(&folder, "capture.ply", &capture);
    let object = |keep: &str| {
        format!(
            r#"{{"name": "{keep}", "asset": "capture.ply", "up": "+z", "source": {{"file": "estimate"}}, "cut": [{{"keep": "{keep}", "min": [-2, -2, -2], "max": [2, 2, 2]}}]}}"#
        )
    };
    let [ball, room] = ["inside", "outside"].map(object);
    let scene = |name: &str, objects: &str| {
        folder.write(name, format!(r#"{{"version": 3, "objects": [{objects}]}}"#))
    };
    let within = scene("within.json", &format!("{ball}, {room}"));
    let alone = scene("alone.json", &ball);
    let out = folder.name("out.png");
    let line = "render {} --target even --device cpu --eye 5,0,0 -o {}";
    for (scene, is_shown) in [(&within, false), (&alone, true)] {
        let said = run_json(&args(line, &[scene, &out]));
        let estimate = &said["source_estimate"];
        assert_eq!(estimate["uses_capture_environment"], is_shown, "{estimate}");
    }
    let probe = |more: &str| {
        let line = format!("probe {{}} --at inside {more} --device cpu -o {{}}");
        let out = folder.name("light.exr");
        run_json(&args(&line, &[&within, &out]));
        load_environment(out.as_ref()).expect("a light")
    };
    let truth = |d: DVec3| [if is_lamp(d.as_vec3()) { 9.0 } else { 0.3 }; 3];
    let truth = EnvironmentMap::of_directions(128, 64, truth);
    // The ball sees no finer detail than a cosine.
    let toward = |map: &EnvironmentMap, d: Vec3| map.reduced(128).blurred(20.0).sample(d)[1];
    let [plain, completed] = ["", "--clipped-like estimate"].map(probe);
    let ratio = |map: &EnvironmentMap, d: Vec3| toward(map, d) / toward(&truth, d);
    assert!(ratio(&plain, to_lamp) < 0.3);
    for d in [to_lamp, -to_lamp] {
        let completed = ratio(&completed, d);
        assert!((0.6..1.6).contains(&completed), "{d}: {completed}");
    }
}
