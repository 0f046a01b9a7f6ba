//! Every GPU pass against its CPU twin and against the plain f64 oracle.

use std::sync::Arc;

use glam::{Vec2, Vec3};
use transplat_core::bake::harmonic::{BakeInput, HarmonicBake, bake_harmonic};
use transplat_core::camera::Camera;
use transplat_core::color::{Display, Encoding, ToneMap};
use transplat_core::environment::{EnvironmentMap, IncidentRadiance, project_environment};
use transplat_core::oracle::{self, OracleHarmonic, relight_surfel};
use transplat_core::progress::no_progress;
use transplat_core::rasterize::{ColorSpace, Raster, depth_order, rasterize, shade};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::sh::coefficient_count;
use transplat_core::surfels::Thickness;
use transplat_core::synthetic;
use transplat_core::transfer::harmonic::HarmonicTransfer;
use transplat_gpu::Context;
use transplat_gpu::rasterize::{GpuRasterizer, Paint};
use transplat_gpu::transfer::harmonic::GpuHarmonic;
use transplat_tests::{gpu, psnr};

fn sky(width: usize, height: usize) -> EnvironmentMap {
    let pixels = (0..width * height)
        .map(|i| {
            let v = ((i * 7919) % 1013) as f32 / 1013.0;
            let sun = if i == width * height / 3 { 2000.0 } else { 0.0 };
            [v + sun, v * v + 0.8 * sun, 0.3 + 0.5 * sun]
        })
        .collect();
    EnvironmentMap::new(width, height, pixels)
}

#[test]
fn projection() {
    let gpu = gpu();
    for (width, height, degree) in [(64, 32, 8), (1000, 7, 3), (3, 5, 0), (512, 256, 4)] {
        let map = sky(width, height);
        let exact = oracle::project_environment(&map, degree);
        let got = transplat_gpu::environment::project_environment(&gpu, &map, degree)
            .expect("the driver works");
        // A lane adds width / 32 values in f32, and m-fold angles come of m products: (width / 32 + degree) 2^-24 of the
        // light's total, |Y| <= 2; rows are added in f64.
        let total = exact[0].iter().fold(0f64, |a, b| a.max(*b));
        let bound = (width as f64 / 32.0 + 8.0) * 2.4e-7 * total;
        let mut worst = 0f64;
        for (e, g) in exact
            .iter()
            .flatten()
            .zip(got.coefficients.iter().flatten())
        {
            worst = worst.max((e - f64::from(*g)).abs());
        }
        println!(
            "projection {width} x {height}, degree {degree}: largest error {:.2e} of the light",
            worst / total
        );
        assert!(worst <= bound, "{worst} > {bound}");
    }
}

/// Openness by the CPU and by the GPU, and how many bytes differ by more than their rounding.
fn baked(gpu: &Context, input: &BakeInput) -> ([Vec<u8>; 2], usize) {
    let cpu = bake_harmonic(input, &no_progress).expect("not cancelled");
    let got = transplat_gpu::bake::harmonic::bake_harmonic(gpu, input, &no_progress)
        .expect("the driver works");
    assert_eq!(cpu.len(), got.len());
    let pairs = cpu.iter().zip(&got);
    let differ = pairs.filter(|(c, g)| c.abs_diff(**g) > 1).count();
    ([cpu, got], differ)
}

#[test]
fn bake() {
    let gpu = gpu();
    let mut cloud = synthetic::sphere_over_plate(300);
    // One surfel that covers the whole map takes the path for large ones.
    cloud.positions[0] = Vec3::new(0.0, 0.0, -0.3);
    cloud.scales[0] = Vec2::splat(0.8);
    cloud.tangents[0] = [Vec3::X, Vec3::Y];
    // Not a multiple of the batch.
    for directions in [16, 21] {
        let input = BakeInput::new(&cloud, directions);
        let ([cpu, got], differ) = baked(&gpu, &input);
        let (mut sum, mut exact_sum) = (0.0, 0.0);
        for (i, (c, g)) in cpu.iter().zip(&got).enumerate() {
            sum += f64::from(c.abs_diff(*g)) / 255.0;
            let exact = oracle::openness(&input, i / directions, i % directions);
            exact_sum += (exact - f64::from(*g) / 255.0).abs();
        }
        let count = cpu.len() as f64;
        println!(
            "bake, {directions} directions: {differ} of {count} differ from the CPU, mean {:.1e}; mean error to f64 {:.1e}",
            sum / count,
            exact_sum / count
        );
        // A texel's centre on the rim of a disc, or a tap on the rim of a texel, may round to either side: rare.
        assert!((differ as f64) < 0.005 * count, "{differ} of {count}");
        assert!(sum / count < 5e-4);
        // Bytes round by 1/510 at most, 1/1020 in the mean.
        assert!(exact_sum / count < 2e-3);
    }
}

#[test]
fn bake_with_more_directions_than_one_read_back() {
    let gpu = gpu();
    let cloud = synthetic::sphere(40);
    let ([cpu, _], differ) = baked(&gpu, &BakeInput::new(&cloud, 1037));
    assert!(differ * 200 < cpu.len(), "{differ} of {}", cpu.len());
}

#[test]
fn transfer() {
    let gpu = gpu();
    for (light_degree, asset_degree) in [(3, 3), (0, 1), (2, 4), (5, 3), (6, 0), (8, 2)] {
        let cloud = synthetic::glossy_sphere_over_plate(150, asset_degree);
        let input = BakeInput::new(&cloud, 64);
        let open = bake_harmonic(&input, &no_progress).expect("not cancelled");
        let visibility = HarmonicBake::from_open(&cloud, 64, open);
        let source = project_environment(&sky(64, 32), light_degree);
        let target = project_environment(&sky(30, 20), light_degree);
        let v = visibility.coefficients(light_degree);
        for off in ["", "shadow", "specular", "reflection", "attenuation"] {
            let mut settings = TransferSettings {
                sh_degree: light_degree,
                ..TransferSettings::of(Method::Harmonic)
            };
            if !off.is_empty() {
                settings = settings.without(off).expect("a term of the preset");
            }
            let prepared = HarmonicTransfer::new(&cloud, &visibility, &source, &settings);
            let prepared = Arc::new(prepared.expect("good input"));
            let on_gpu = GpuHarmonic::new(&gpu, &prepared).expect("the driver works");
            // Twice, to see that nothing is left of the light before.
            on_gpu.submit(&prepared.light(&source));
            on_gpu.submit(&prepared.light(&target));
            let got = on_gpu.read().expect("the driver works");
            let cpu = prepared.relight(&target);
            let oracle = OracleHarmonic::new(&source, &target, &settings);
            let (ka, kl) = (prepared.coefficients(), coefficient_count(light_degree));
            let (mut to_cpu, mut to_exact) = (0f64, 0f64);
            for i in 0..cloud.len() {
                let color: Vec<[f64; 3]> =
                    cloud.sh_of(i).iter().map(|c| c.map(f64::from)).collect();
                let v: Vec<f64> = v[i * kl..][..kl].iter().map(|v| f64::from(*v)).collect();
                let exact = relight_surfel(
                    &oracle,
                    &color,
                    prepared.normals[i].to_array().map(f64::from),
                    &v,
                );
                // What is left out is nothing.
                assert!(exact[ka..].iter().flatten().all(|v| *v == 0.0));
                for (j, exact) in exact[..ka].iter().enumerate() {
                    for c in 0..3 {
                        let (g, p) = (f64::from(got[i * ka + j][c]), f64::from(cpu[i * ka + j][c]));
                        let size = 1.0 + exact[c].abs();
                        to_cpu = to_cpu.max((g - p).abs() / size);
                        to_exact = to_exact.max((g - exact[c]).abs() / size);
                    }
                }
            }
            println!(
                "transfer {light_degree}/{asset_degree} without {off:?}: {to_cpu:.1e} to the CPU, {to_exact:.1e} to f64"
            );
            // K roundings of the light (2^-24 each), over a source irradiance that the clamp leaves as small as epsilon (5 %): 20 K 2^-24.
            assert!(to_cpu < 1e-4 && to_exact < 1e-4);
        }
    }
}

#[test]
fn transfer_over_more_than_one_chunk() {
    let gpu = gpu();
    let n = transplat_gpu::CHUNK + 77;
    let normals: Vec<Vec3> = synthetic::sphere(n).positions;
    let cloud = synthetic::from_points(&normals, &normals, 0.01);
    let mut settings = TransferSettings {
        sh_degree: 1,
        ..TransferSettings::of(Method::Harmonic)
    };
    settings.terms.shadow = false;
    let prepared = HarmonicTransfer::new(
        &cloud,
        &HarmonicBake::all_open(&cloud, 16),
        &IncidentRadiance::even(1),
        &settings,
    )
    .map(Arc::new)
    .expect("good input");
    let target = project_environment(&sky(16, 8), 1);
    let on_gpu = GpuHarmonic::new(&gpu, &prepared).expect("the driver works");
    on_gpu.submit(&prepared.light(&target));
    let (got, cpu) = (
        on_gpu.read().expect("the driver works"),
        prepared.relight(&target),
    );
    assert_eq!(got.len(), n);
    for (g, c) in got.iter().flatten().zip(cpu.iter().flatten()) {
        assert!((g - c).abs() <= 1e-4 * (1.0 + c.abs()), "{g} {c}");
    }
}

#[test]
fn bake_and_rasterize_over_more_than_one_chunk() {
    let gpu = gpu();
    let n = transplat_gpu::CHUNK + 77;
    let mut cloud = synthetic::sphere(n);
    // The last surfels are in the second chunk: they hover over the rest, and must be seen and cast shadows.
    for i in n - 40..n {
        cloud.positions[i] = Vec3::new(1.3, 0.01 * (i + 40 - n) as f32 - 0.2, 0.1);
        cloud.scales[i] = Vec2::splat(0.05);
    }
    let ([cpu, _], differ) = baked(&gpu, &BakeInput::new(&cloud, 16));
    assert!(differ * 200 < cpu.len(), "{differ} of {}", cpu.len());
    let colors: Vec<[f32; 3]> = (0..n)
        .map(|i| {
            if i + 40 < n {
                [1.0, 0.0, 0.0]
            } else {
                [0.0, 1.0, 0.0]
            }
        })
        .collect();
    let camera = camera([48, 48]);
    let cpu = rasterize(&cloud, &camera, &colors, &[]);
    let got = GpuRasterizer::new(&gpu, &Arc::new(cloud.clone()))
        .and_then(|r| r.draw(&camera, Paint::Colors(&colors), ColorSpace::Linear, &[]))
        .expect("the driver works");
    assert!(
        cpu.pixels.iter().any(|p| p[1] > 0.5),
        "the second chunk is in sight"
    );
    let psnr = raster_psnr(&cpu, &got);
    assert!(psnr > 55.0, "{psnr}");
}

fn camera(size: [usize; 2]) -> Camera {
    Camera::look_at(
        Vec3::new(3.0, 1.0, 1.5),
        Vec3::new(0.0, 0.0, 0.3),
        Vec3::Z,
        0.7,
        size,
        0.02,
    )
}

/// Over all four channels; the peak is 1.
fn raster_psnr(a: &Raster, b: &Raster) -> f64 {
    let held = [a, b].map(|r| r.pixels.iter().map(|p| p.map(|v| v.min(1.0))).collect());
    let [a, b]: [Vec<[f32; 4]>; 2] = held;
    psnr(&a, &b)
}

#[test]
fn rasterize_every_encoding_degree_and_curve() {
    let gpu = gpu();
    for degree in [0, 3, 8] {
        let cloud = synthetic::glossy_sphere_over_plate(300, degree);
        let on_gpu = GpuRasterizer::new(&gpu, &Arc::new(cloud.clone())).expect("it fits");
        let camera = camera([96, 64]);
        for encoding in [Encoding::Stored, Encoding::StoredLinear, Encoding::Linear] {
            let mut spaces = vec![ColorSpace::Linear];
            for tone_map in [
                ToneMap::Srgb,
                ToneMap::Neutral,
                ToneMap::Agx,
                ToneMap::Aces,
                ToneMap::None,
            ] {
                spaces.push(ColorSpace::Display(Display {
                    exposure: 0.7,
                    tone_map,
                }));
            }
            spaces.push(ColorSpace::Display(Display::default()));
            for space in spaces {
                let colors = shade(
                    &cloud.positions,
                    &cloud.sh,
                    degree,
                    encoding,
                    camera.eye,
                    space,
                );
                let cpu = rasterize(&cloud, &camera, &colors, &[]);
                let paint = Paint::Sh {
                    sh: &cloud.sh,
                    degree: cloud.sh_degree,
                    encoding,
                    shadows: &[],
                };
                let got = on_gpu
                    .draw(&camera, paint, space, &[])
                    .expect("the driver works");
                let psnr = raster_psnr(&cpu, &got);
                // 55 dB is half a step of 8 bits; where a target has half floats, blending alone costs that much.
                assert!(
                    psnr > 55.0,
                    "degree {degree} {encoding:?} {space:?}: {psnr}"
                );
            }
        }
    }
}

#[test]
fn rasterize_depth_and_pictures_larger_than_a_tile() {
    let gpu = gpu();
    let cloud = synthetic::sphere_over_plate(300);
    let on_gpu = GpuRasterizer::new(&gpu, &Arc::new(cloud.clone())).expect("it fits");
    let colors = vec![[1.0, 0.5, 0.25]; cloud.len()];
    // Wider than one draw: the seam must not show.
    let mut wide = camera([4200, 24]);
    wide.focal = 60.0;
    for camera in [camera([64, 64]), wide] {
        let cpu = rasterize(&cloud, &camera, &colors, &[]);
        let got = on_gpu
            .draw(&camera, Paint::Colors(&colors), ColorSpace::Linear, &[])
            .expect("the driver works");
        let psnr = raster_psnr(&cpu, &got);
        assert!(psnr > 55.0, "{} wide: {psnr}", camera.width);
        for (i, (c, g)) in cpu.depth.iter().zip(&got.depth).enumerate() {
            if cpu.pixels[i][3] > 0.5 {
                assert!((c - g).abs() < 0.01, "depth {c} {g}");
            }
        }
    }
}

#[test]
fn rasterize_extreme_surfels() {
    let gpu = gpu();
    let mut cloud = synthetic::sphere(200);
    for (i, scale) in cloud.scales.iter_mut().enumerate() {
        *scale = match i % 4 {
            0 => Vec2::splat(1e6),
            1 => Vec2::new(1e-9, 0.1),
            2 => Vec2::splat(0.0),
            _ => *scale,
        };
    }
    cloud.positions[1] = Vec3::splat(1e12);
    let colors = vec![[1.0; 3]; cloud.len()];
    for eye in [Vec3::new(3.0, 1.0, 0.5), Vec3::ZERO] {
        let camera = Camera::look_at(eye, Vec3::X * 0.1, Vec3::Z, 1.2, [48, 48], 0.02);
        let got = GpuRasterizer::new(&gpu, &Arc::new(cloud.clone()))
            .and_then(|r| r.draw(&camera, Paint::Colors(&colors), ColorSpace::Linear, &[]))
            .expect("the driver works");
        assert!(got.pixels.iter().flatten().all(|v| v.is_finite()));
        let cpu = rasterize(&cloud, &camera, &colors, &[]);
        assert!(cpu.pixels.iter().flatten().all(|v| v.is_finite()));
        let psnr = raster_psnr(&cpu, &got);
        println!("extreme surfels from {eye}: {psnr:.1} dB");
        // Discs of a million radii leave f32 few digits of where their rim is: most pixels agree, not all.
        assert!(psnr > 30.0, "{psnr}");
    }
}

#[test]
fn rasterize_3d_gaussians_among_surfels() {
    let gpu = gpu();
    let mut cloud = synthetic::sphere_over_plate(400);
    for i in 0..cloud.len() {
        // Round ones, needles, and such as are smaller than a pixel, at more than one place of the sphere each.
        let (scale, sigma) = match i % 5 {
            0 => continue,
            1 => (cloud.scales[i], 0.5 * cloud.scales[i].x),
            2 => (Vec2::new(3.0, 0.02) * cloud.scales[i], 1e-7),
            3 => (Vec2::splat(1e-3), 1e-3),
            // As wide as the scene, and seen from its middle.
            _ if i < 10 => (Vec2::splat(40.0), 20.0),
            _ => (cloud.scales[i], 1e-20),
        };
        cloud.scales[i] = scale;
        cloud.thicknesses[i] = Thickness::of_gaussian(sigma, i % 2 == 0);
    }
    let colors: Vec<[f32; 3]> = (0..cloud.len())
        .map(|i| [0.3 + 0.1 * (i % 7) as f32, 0.5, 0.1 * (i % 4) as f32])
        .collect();
    let rasterizer = GpuRasterizer::new(&gpu, &Arc::new(cloud.clone())).expect("it fits");
    for eye in [Vec3::new(3.0, 1.0, 0.5), Vec3::new(0.4, 0.1, 0.9)] {
        let camera = Camera::look_at(eye, Vec3::Z * 0.3, Vec3::Z, 0.9, [120, 90], 0.02);
        let got = rasterizer.draw(&camera, Paint::Colors(&colors), ColorSpace::Linear, &[]);
        let got = got.expect("the driver works");
        let psnr = raster_psnr(&rasterize(&cloud, &camera, &colors, &[]), &got);
        println!("3D Gaussians from {eye}: {psnr:.1} dB");
        // f32 on either side: what differs is where alpha ends at 1/255.
        assert!(psnr > 55.0, "{psnr}");
    }
}

/// A million depths, of which many are equal, in one picture after the other; some surfels are hidden, some behind the camera, some aside.
#[test]
fn the_adapter_orders_surfels_as_the_cpu_does() {
    let gpu = gpu();
    let mut seed = 1u32;
    let mut random = || {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) as f32 / (1 << 24) as f32
    };
    for (n, pictures) in [(1, 1), (255, 2), (4097, 3), (1_000_000, 100)] {
        let mut points: Vec<Vec3> = (0..n)
            .map(|_| Vec3::new(random(), random(), random()) * 4.0 - 2.0)
            .collect();
        // Equal ones keep their order.
        for i in (3..n).step_by(3) {
            points[i] = points[i - 3];
        }
        let cloud = synthetic::from_points(&points, &vec![Vec3::Z; n], 1e-3);
        let hidden: Vec<bool> = (0..n).map(|i| i % 17 == 3).collect();
        let on_gpu = GpuRasterizer::new(&gpu, &Arc::new(cloud.clone())).expect("it fits");
        for picture in 0..pictures {
            let around = Vec3::new((picture as f32).cos(), (picture as f32).sin(), 0.3);
            let (eye, to) = (2.5 * around, Vec3::ZERO);
            let camera = Camera::look_at(eye, to, Vec3::Z, 0.9, [64, 48], 0.02);
            let got = on_gpu
                .order_on_adapter(&camera, &hidden)
                .expect("the driver works");
            // Depths are rounded in other places there.
            let depth = |i: &u32| camera.project(points[*i as usize]).1;
            let (mut sorted, mut there) = (vec![false; n], 0);
            for i in &got {
                assert!(
                    !std::mem::replace(&mut sorted[*i as usize], true),
                    "{i} twice"
                );
                assert!(!hidden[*i as usize] && depth(i) > 0.0);
            }
            for pair in got.windows(2) {
                let [far, near] = [0, 1].map(|k| depth(&pair[k]));
                assert!(far >= near - 1e-5, "{n}: {far} before {near}");
                let is_twin = points[pair[0] as usize] == points[pair[1] as usize];
                assert!(!is_twin || pair[0] > pair[1], "{n}: {pair:?}");
            }
            for i in depth_order(&points, &camera, &hidden) {
                let ([x, y], _) = camera.project(points[i as usize]);
                // A pixel inside of the edge there is no doubt.
                let is_inside = (1.0..62.0).contains(&x) && (1.0..46.0).contains(&y);
                assert!(
                    !is_inside || depth(&i) < 0.03 || sorted[i as usize],
                    "{n}: {i}"
                );
                there += usize::from(is_inside);
            }
            assert!(
                got.len() >= there && (n < 1000 || there > n / 10),
                "{n}: {there}"
            );
        }
    }
}
