//! The bundled scene against pictures that were made otherwise: by an independent renderer of surfels, and by a path tracer.

use transplat_tests::{Folder, args, asset, picture, psnr, root, run_json};

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
