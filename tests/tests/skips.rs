//! What a scene does not need is left out, and told; forced all the same, it makes the same picture.

use std::sync::Arc;

use glam::{DVec3, Vec3};
use transplat_core::bake::Bake;
use transplat_core::bake::harmonic::DEFAULT_DIRECTIONS;
use transplat_core::camera::{Camera, CameraPose};
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::present::PLAIN;
use transplat_core::progress::no_progress;
use transplat_core::rasterize::{rasterize, shade};
use transplat_core::settings::optimizations::{Optimization, Optimizations, SkippedWork};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::sh::with_degree;
use transplat_core::surfels::{SurfelCloud, SurfelFilter, UpAxis};
use transplat_core::synthetic;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};
use transplat_gpu::Context;
use transplat_gpu::rasterize::{GpuRasterizer, Paint};
use transplat_gpu::transfer::GpuTransfer;
use transplat_tests::{gpu, psnr};

/// A sky that is brighter on one side, in one colour; with a sun or without.
fn sky(toward: DVec3, tint: [f32; 3], sun: f32) -> Illumination {
    let map = EnvironmentMap::of_directions(128, 64, |d| {
        let disc = if d.dot(toward) > 0.999 { sun } else { 0.0 };
        tint.map(|t| t * ((1.2 + d.dot(toward)) as f32 + disc))
    });
    Illumination::of(&map, 8)
}

/// Something that does not need something.
struct Case {
    skip: Optimization,
    method: Method,
    cloud: SurfelCloud,
    lights: [Illumination; 2],
    hide: SurfelFilter,
    /// PSNR in dB that forcing it leaves at least.
    least_psnr: f64,
}

/// Rounding alone keeps a picture beyond this.
const SAME: f64 = 100.0;

fn cases() -> Vec<Case> {
    let lights = || {
        [
            sky(DVec3::new(0.6, 0.0, 0.8), [1.0, 0.9, 0.8], 0.0),
            sky(DVec3::new(-0.6, 0.48, 0.64), [0.4, 0.7, 1.0], 300.0),
        ]
    };
    let case = |skip, method, cloud, least_psnr| Case {
        skip,
        method,
        cloud,
        lights: lights(),
        hide: SurfelFilter::default(),
        least_psnr,
    };
    let ball = || synthetic::sphere(1500);
    // A ball stored with three bands of nothing.
    let mut plain = ball();
    plain.sh = with_degree(plain.sh, 0, 3);
    plain.sh_degree = 3;
    let mut faint = synthetic::sphere_over_plate(700);
    for opacity in faint.opacities.iter_mut().step_by(5) {
        *opacity = 0.003;
    }
    let specular = synthetic::glossy_sphere_over_plate(700, 3);
    let gray = |sun| sky(DVec3::new(-0.6, 0.48, 0.64), [0.7; 3], sun);
    vec![
        // What a closed side's rays could add is how two-sided a surfel is.
        case(
            Optimization::ClosedSides,
            Method::Directional,
            synthetic::sphere_over_plate(1500),
            60.0,
        ),
        case(Optimization::OpenObject, Method::Directional, ball(), 45.0),
        case(Optimization::OpenObject, Method::Harmonic, ball(), 40.0),
        // Who follows sees nearly what its leader does: shadows are off by the distance between two of those.
        case(
            Optimization::SharedVisibility,
            Method::Directional,
            synthetic::sphere_over_plate(40_000),
            60.0,
        ),
        // A third of the rays, of which less than one in a hundred is told wrongly.
        case(
            Optimization::InferredRays,
            Method::Directional,
            synthetic::sphere_over_plate(66_000),
            50.0,
        ),
        // One in two tells what the other is made of as well.
        case(
            Optimization::SharedLobes,
            Method::Directional,
            synthetic::glossy_sphere_over_plate(66_000, 2),
            45.0,
        ),
        case(
            Optimization::EmptyBands,
            Method::Directional,
            plain.clone(),
            SAME,
        ),
        case(Optimization::EmptyBands, Method::Harmonic, plain, SAME),
        Case {
            lights: [lights()[0].clone(), gray(300.0)],
            ..case(
                Optimization::GrayLight,
                Method::Harmonic,
                specular.clone(),
                SAME,
            )
        },
        Case {
            lights: [lights()[0].clone(), gray(0.0)],
            ..case(
                Optimization::Suns,
                Method::Directional,
                specular.clone(),
                SAME,
            )
        },
        case(Optimization::Bounces, Method::Directional, ball(), SAME),
        case(
            Optimization::DiffuseSurfels,
            Method::Directional,
            specular.clone(),
            SAME,
        ),
        case(Optimization::Unseen, Method::Directional, faint, SAME),
        Case {
            hide: SurfelFilter {
                crop: true,
                crop_max: Vec3::new(0.2, 1.0, 1.0),
                ..SurfelFilter::default()
            },
            ..case(Optimization::Unseen, Method::Directional, specular, SAME)
        },
    ]
}

/// Relights on the CPU or on a GPU.
fn relit(
    prepared: &PreparedTransfer,
    target: &Illumination,
    unseen: &[bool],
    gpu: Option<&Arc<Context>>,
) -> Relit {
    let Some(gpu) = gpu else {
        let relit = prepared.relight_seen(target, Part::Whole, unseen);
        return relit.expect("a light for both");
    };
    let mut on_gpu = GpuTransfer::new(gpu, prepared).expect("room for it");
    let submitted = on_gpu.submit(target, Part::Whole, unseen);
    submitted.expect("a light for both");
    on_gpu.read().expect("the driver works")
}

/// A picture of the case, and what was left out on the way.
fn picture(
    case: &Case,
    gpu: Option<&Arc<Context>>,
    optimizations: Optimizations,
) -> (Vec<[f32; 3]>, Vec<SkippedWork>) {
    let settings = TransferSettings {
        optimizations,
        ..TransferSettings::of(case.method)
    };
    let cloud = Arc::new(case.cloud.clone());
    let bake = Bake::with_optimizations(&cloud, case.method, 128, &optimizations, &no_progress);
    let bake = bake.expect("not cancelled");
    let [source, target] = &case.lights;
    let prepared = PreparedTransfer::new(&cloud, &bake, source, &settings).expect("good settings");
    let bounds = cloud.bounds();
    let unseen = case.hide.unseen(&cloud, &bounds, &optimizations);
    let left_alone = if optimizations.has(Optimization::Unseen) {
        &unseen[..]
    } else {
        &[]
    };
    let relit = relit(&prepared, target, left_alone, gpu);
    let pose = CameraPose {
        pivot: bounds.center,
        azimuth: -60.0,
        elevation: 30.0,
        distance: 4.0 * bounds.radius,
        fov: 35.0,
        orthographic: false,
        roll: 0.0,
        aperture: 0.0,
    };
    let camera = Camera::from_pose(&pose, UpAxis::PlusZ, [160, 160], bounds.radius);
    let (sh, degree, encoding) = (&relit.sh, relit.degree, relit.encoding);
    let raster = if let Some(gpu) = gpu {
        let painter = GpuRasterizer::new(gpu, &cloud).expect("room for it");
        let drawn = painter.draw(&camera, Paint::relit(&relit), PLAIN, &unseen);
        drawn.expect("the driver works")
    } else {
        let colors = shade(&cloud.positions, sh, degree, encoding, camera.eye, PLAIN);
        rasterize(&cloud, &camera, &colors, &unseen)
    };
    let mut skipped_work = bake.skipped_work();
    skipped_work.extend(prepared.skipped_work(&cloud));
    skipped_work.extend(prepared.skipped_work_for(target, gpu.is_some()));
    skipped_work.extend(SkippedWork::of_unseen(left_alone));
    let pixels = raster.pixels.iter().map(|[r, g, b, _]| [*r, *g, *b]);
    (pixels.collect(), skipped_work)
}

fn same_when_forced(gpu: Option<&Arc<Context>>) {
    for case in cases() {
        let forced = Optimizations::default().without(case.skip);
        let (with, told) = picture(&case, gpu, Optimizations::default());
        let (without, told_forced) = picture(&case, gpu, forced);
        let psnr = psnr(&with, &without);
        println!(
            "{} ({}): {psnr:.1} dB",
            case.skip.name(),
            case.method.preset()
        );
        assert!(psnr >= case.least_psnr, "{:?}: {psnr} dB", case.skip);
        // The picture shows something.
        assert!(with.iter().flatten().any(|v| *v > 0.2), "{:?}", case.skip);
        let has = |told: &[SkippedWork]| told.iter().any(|s| s.skip == Some(case.skip));
        // The GPU works on all channels at once.
        let is_left_out = gpu.is_none() || case.skip != Optimization::GrayLight;
        assert_eq!(has(&told), is_left_out, "{:?}: {told:?}", case.skip);
        assert!(!has(&told_forced), "{:?}: {told_forced:?}", case.skip);
    }
}

#[test]
fn forced_on_the_cpu_the_picture_is_the_same() {
    same_when_forced(None);
}

#[test]
fn forced_on_the_gpu_the_picture_is_the_same() {
    same_when_forced(Some(&gpu()));
}

#[test]
fn a_scene_that_needs_everything_leaves_out_nothing_but_closed_sides() {
    let toward_sun = Vec3::new(0.4, 0.2, 0.9).normalize();
    let case = Case {
        // Of no account here.
        skip: Optimization::ClosedSides,
        method: Method::Directional,
        cloud: synthetic::mirroring_ball_plate_and_sheet(toward_sun, 3),
        lights: [
            sky(toward_sun.as_dvec3(), [1.0, 0.9, 0.8], 300.0),
            sky(DVec3::new(-0.6, 0.48, 0.64), [0.4, 0.7, 1.0], 300.0),
        ],
        hide: SurfelFilter::default(),
        least_psnr: SAME,
    };
    let told = picture(&case, None, Optimizations::default()).1;
    let others: Vec<&str> = told.iter().map(|s| s.what.as_str()).collect();
    assert!(
        others
            .iter()
            .all(|w| *w == "rays into closed sides" || w.starts_with("the lobe of")),
        "{others:?}"
    );
}

#[test]
fn bands_that_gloss_may_fill_are_kept() {
    // Captured with one band, stored with three: what the surfels mirror of another light needs all of them.
    let mut cloud = synthetic::glossy_sphere_over_plate(200, 1);
    cloud.sh = with_degree(cloud.sh, 1, 3);
    cloud.sh_degree = 3;
    let light = sky(DVec3::Z, [1.0; 3], 300.0);
    let settings = TransferSettings::default();
    let bake = Bake::new(
        &cloud,
        Method::Directional,
        DEFAULT_DIRECTIONS,
        &no_progress,
    );
    let bake = bake.expect("not cancelled");
    let prepared = PreparedTransfer::new(&cloud, &bake, &light, &settings).expect("good settings");
    let relit = prepared.relight(&light, Part::Whole).expect("with beams");
    assert_eq!(relit.degree, 3);
}
