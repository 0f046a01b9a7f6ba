//! The directional method on the GPU against its CPU twin; that is held against the f64 oracle next to it.

use std::ops::ControlFlow;
use std::sync::Arc;

use glam::{DVec3, Vec3};
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::strata::{DIRECTIONS, SurfelHits};
use transplat_core::color::Encoding;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::progress::no_progress;
use transplat_core::settings::optimizations::Optimizations;
use transplat_core::settings::{Method, Terms, TransferSettings};
use transplat_core::sh::coefficient_count;
use transplat_core::surfels::SurfelCloud;
use transplat_core::synthetic;
use transplat_core::transfer::directional::{
    DirectionalCache, DirectionalLight, DirectionalTransfer,
};
use transplat_core::transfer::{Part, Relit};
use transplat_gpu::bake::directional::GpuTracer;
use transplat_gpu::transfer::directional::GpuDirectional;
use transplat_gpu::{Context, GpuError};
use transplat_tests::gpu;

/// A gradient with a sun, and its colours.
fn sky(toward_sun: DVec3, tint: [f32; 3]) -> Illumination {
    let map = EnvironmentMap::of_directions(256, 128, |d| {
        let is_sun = d.dot(toward_sun) > 0.9994;
        let sun = if is_sun { 300.0 } else { 0.0 };
        tint.map(|t| t * ((1.2 + d.z) as f32 + sun))
    });
    Illumination::of(&map, 8)
}

fn sun() -> DVec3 {
    DVec3::new(0.4, 0.2, 0.9).normalize()
}

fn prepare(cloud: &SurfelCloud, settings: &TransferSettings) -> Arc<DirectionalTransfer> {
    let bake = DirectionalBake::bake(cloud, &no_progress).expect("not cancelled");
    let asset = Arc::new(DirectionalCache::new(
        cloud,
        Arc::new(bake),
        &Optimizations::default(),
    ));
    let source = sky(sun(), [1.0, 0.9, 0.8]);
    Arc::new(DirectionalTransfer::new(&asset, &source, settings).expect("with beams"))
}

fn relit_on_both(
    gpu: &Arc<Context>,
    prepared: &Arc<DirectionalTransfer>,
    target: &DirectionalLight,
) -> (Relit, Relit) {
    let on_gpu = GpuDirectional::new(gpu, prepared).expect("the driver works");
    on_gpu.submit(target, Part::Whole);
    let got = on_gpu.read().expect("the driver works");
    (prepared.relight(target.clone(), Part::Whole, &[]), got)
}

/// Holds the largest difference of each surfel, relative to the brightest colour, by its median and by what 99 % of the surfels stay below.
fn assert_alike(cpu: &Relit, gpu: &Relit, what: &str) {
    assert_eq!(cpu.sh.len(), gpu.sh.len());
    let k = coefficient_count(cpu.degree);
    let size = cpu.sh.iter().flatten().fold(0f32, |a, v| a.max(v.abs()));
    let mut all: Vec<f32> = cpu
        .sh
        .chunks_exact(k)
        .zip(gpu.sh.chunks_exact(k))
        .map(|(c, g)| {
            let pairs = c.iter().flatten().zip(g.iter().flatten());
            pairs.fold(0f32, |a, (c, g)| a.max((c - g).abs())) / size.max(1e-9)
        })
        .collect();
    all.sort_by(f32::total_cmp);
    let (median, most) = (all[all.len() / 2], all[all.len() * 99 / 100]);
    println!("best {what}: median {median:.1e}, 99 % {most:.1e}");
    // f32 sums of a few hundred terms in another order; a sun's ray that grazes a rim may fall on either side.
    assert!(median < 1e-5 && most < 1e-4, "{what}: {median} {most}");
}

#[test]
fn transfer() {
    let gpu = gpu();
    let light = sky(DVec3::new(-0.7, 0.1, 0.5).normalize(), [0.3, 0.5, 0.9]);
    for (degree, encoding) in [
        (3, Encoding::Stored),
        (0, Encoding::Stored),
        (2, Encoding::Linear),
        (4, Encoding::StoredLinear),
        (5, Encoding::Stored),
    ] {
        let mut cloud = synthetic::mirroring_ball_plate_and_sheet(sun().as_vec3(), degree);
        cloud.encoding = encoding;
        let whole = TransferSettings::default();
        let prepared = prepare(&cloud, &whole);
        assert!(prepared.specular_surfels > 100 || degree == 0);
        let on_gpu = GpuDirectional::new(&gpu, &prepared).expect("the driver works");
        let target = prepared.light(&light).expect("with beams");
        // Parts before the whole, to see that nothing is left of the light before.
        for part in [Part::Diffuse, Part::Specular, Part::Whole] {
            let cpu = prepared.relight(target.clone(), part, &[]);
            on_gpu.submit(&target, part);
            let got = on_gpu.read().expect("the driver works");
            assert_eq!(got.encoding, cpu.encoding);
            assert_alike(&cpu, &got, &format!("{degree} {encoding:?} {part:?}"));
            let tau = got.tau.iter().flatten().zip(cpu.tau.iter().flatten());
            let off = tau.filter(|(g, c)| (*g - *c).abs() > 1e-4 * (1.0 + c.abs()));
            assert!(off.count() * 100 < got.tau.len());
        }
    }
}

#[test]
fn transfer_without_each_term() {
    let gpu = gpu();
    let cloud = synthetic::mirroring_ball_plate_and_sheet(sun().as_vec3(), 1);
    let light = sky(DVec3::new(-0.7, 0.1, 0.5).normalize(), [0.3, 0.5, 0.9]);
    let mut seen = Vec::new();
    let terms = Terms::of_method(Method::Directional).map(|t| t.name);
    for off in terms.chain([""]) {
        let mut settings = TransferSettings::default();
        if !off.is_empty() {
            settings = settings.without(off).expect("a term of the preset");
        }
        let prepared = prepare(&cloud, &settings);
        let target = prepared.light(&light).expect("with beams");
        let (cpu, got) = relit_on_both(&gpu, &prepared, &target);
        assert_alike(&cpu, &got, &format!("without {off:?}"));
        // Each term changes the colour, but for what shines by itself, which nothing does here, and for what is cast at the pixel.
        let changes = !["glow", "pixel-shadows"].contains(&off);
        assert!(!changes || seen.iter().all(|other| other != &got.sh));
        if changes {
            seen.push(got.sh);
        }
    }
}

#[test]
fn chunks_see_each_other() {
    let gpu = gpu();
    let cloud = synthetic::mirroring_ball_plate_and_sheet(sun().as_vec3(), 2);
    let prepared = prepare(&cloud, &TransferSettings::default());
    let light = sky(DVec3::new(-0.7, 0.1, 0.5).normalize(), [0.3, 0.5, 0.9]);
    let target = prepared.light(&light).expect("with beams");
    let cpu = prepared.relight(target.clone(), Part::Whole, &[]);
    // The last chunk is a short one.
    let on_gpu = GpuDirectional::in_chunks(&gpu, &prepared, 192).expect("the driver works");
    on_gpu.submit(&target, Part::Whole);
    let got = on_gpu.read().expect("the driver works");
    assert_alike(&cpu, &got, "in chunks");
}

#[test]
fn no_surfel_at_all_and_a_single_one() {
    let gpu = gpu();
    let light = sky(sun(), [1.0; 3]);
    for n in [0, 1] {
        let mut cloud = synthetic::from_points(&[Vec3::ZERO], &[Vec3::Z], 0.1);
        if n == 0 {
            cloud = synthetic::from_points(&[], &[], 0.1);
        }
        let prepared = prepare(&cloud, &TransferSettings::default());
        let on_gpu = GpuDirectional::new(&gpu, &prepared).expect("the driver works");
        let target = prepared.light(&light).expect("with beams");
        on_gpu.submit(&target, Part::Whole);
        let got = on_gpu.read().expect("the driver works");
        assert_eq!(got.tau.len(), n);
        let cpu = prepared.relight(target, Part::Whole, &[]);
        for (g, c) in got.sh.iter().flatten().zip(cpu.sh.iter().flatten()) {
            assert!((g - c).abs() < 1e-5 * (1.0 + c.abs()), "{g} {c}");
        }
    }
}

#[test]
fn bake() {
    let gpu = gpu();
    let mut cloud = synthetic::mirroring_ball_plate_and_sheet(Vec3::Z, 0);
    // One that casts no shadow, and one that covers all.
    cloud.opacities[3] = 0.1;
    cloud.scales[5] = glam::Vec2::splat(0.8);
    let cpu = DirectionalBake::bake(&cloud, &no_progress).expect("not cancelled");
    let tracer = DirectionalBake::tracer(&cloud, &no_progress).expect("not cancelled");
    let on_gpu = GpuTracer::new(&gpu, &tracer).expect("the driver works");
    let by = |strata: &[usize],
              found: &mut [SurfelHits],
              progress: transplat_core::progress::Progress<'_>| {
        on_gpu
            .trace(strata, found, progress)
            .expect("the driver works");
        Ok::<(), transplat_core::Error>(())
    };
    let previews = std::cell::Cell::new(0);
    let got = DirectionalBake::bake_by(
        &cloud,
        &tracer,
        (&[8, 2, 1], &Optimizations::default()),
        by,
        &no_progress,
        |_, _| previews.set(previews.get() + 1),
    )
    .expect("not cancelled");
    assert_eq!(previews.get(), 2);
    let (mut rays, mut hits) = (0, 0);
    for i in 0..cloud.len() {
        rays += (0..DIRECTIONS)
            .filter(|j| {
                cpu.directional_visibility.is_open(i, *j)
                    != got.directional_visibility.is_open(i, *j)
            })
            .count();
        for (c, g) in cpu
            .directional_visibility
            .hits_of(i)
            .iter()
            .zip(got.directional_visibility.hits_of(i))
        {
            // Of discs in one plane either may be met first.
            let [a, b] = [c, g].map(|h| h.surfel());
            let apart = cloud.positions[a] - cloud.positions[b];
            let plane = apart.dot(cloud.stored_normal(a)).abs() < 1e-4
                && cloud.stored_normal(a).dot(cloud.stored_normal(b)).abs() > 0.9999;
            hits += usize::from(c.stratum() != g.stratum() || !plane);
        }
        hits += cpu
            .directional_visibility
            .hits_of(i)
            .len()
            .abs_diff(got.directional_visibility.hits_of(i).len());
    }
    println!(
        "bake for best: {rays} of {} rays and {hits} of {} hits differ from the CPU",
        cloud.len() * DIRECTIONS,
        cpu.directional_visibility.hits.len()
    );
    // A ray that grazes a rim may round to either side of it.
    assert!(rays * 2000 < cloud.len() * DIRECTIONS);
    assert!(hits * 1000 < cpu.directional_visibility.hits.len());
    let stop = |_| ControlFlow::Break(());
    let mut found: Vec<SurfelHits> = (0..cloud.len() as u32).map(SurfelHits::of).collect();
    let stopped = on_gpu.trace(&[0, 1], &mut found, &stop);
    assert!(matches!(stopped, Err(GpuError::Cancelled)));
}

#[test]
fn transfer_of_which_half_is_believed() {
    let gpu = gpu();
    let cloud = synthetic::mirroring_ball_plate_and_sheet(sun().as_vec3(), 2);
    let whole = prepare(&cloud, &TransferSettings::default());
    let source = Illumination {
        trust: 0.5,
        ..sky(sun(), [1.0, 0.9, 0.8])
    };
    let half =
        DirectionalTransfer::new(&whole.asset, &source, &whole.settings).expect("with beams");
    let half = Arc::new(half);
    let target = sky(DVec3::new(-0.7, 0.1, 0.5).normalize(), [0.3, 0.5, 0.9]);
    let told = target.told([0.125, 0.5, 2.0]);
    let target = half.light(&told).expect("with beams");
    let (cpu, got) = relit_on_both(&gpu, &half, &target);
    // Powers are exact to a few units in the last place.
    assert_alike(&cpu, &got, "believed by half");
}

#[test]
fn a_lamp_keeps_shining_on_both() {
    let gpu = gpu();
    let mut cloud = synthetic::sphere(1500);
    let is_lamp = |p: &Vec3| p.z > 0.94;
    let (settings, even) = (TransferSettings::default(), Illumination::even(3));
    let bake = DirectionalBake::bake(&cloud, &no_progress).expect("not cancelled");
    let bake = Arc::new(bake);
    // Brighter than white paint; where half of the source is believed, of a colour purer than any.
    // What of that does not glow goes with the light, in which a sun is many times as strong.
    for (color, trust, least, within) in [
        ([7.0, 5.5, 4.0], 1.0, 0.99, 0.05),
        ([0.007, 1.77, 2.66], 0.5, 0.9, 0.5),
    ] {
        for (f, p) in cloud.sh.iter_mut().zip(&cloud.positions) {
            *f = if is_lamp(p) { color } else { [1.0; 3] };
        }
        let asset = DirectionalCache::new(&cloud, bake.clone(), &Optimizations::default());
        let source = Illumination {
            trust,
            ..even.clone()
        };
        let prepared = DirectionalTransfer::new(&Arc::new(asset), &source, &settings);
        let prepared = Arc::new(prepared.expect("with beams"));
        let light = sky(DVec3::X, [0.4, 0.2, 1.5]).told([0.3, 1.0, 2.0]);
        let target = prepared.light(&light).expect("with beams");
        let (cpu, got) = relit_on_both(&gpu, &prepared, &target);
        assert_alike(&cpu, &got, "with a lamp");
        let emits = |i: &usize| prepared.emission_share_of(*i) > least;
        let lamp: Vec<usize> = (0..cloud.len()).filter(emits).collect();
        assert!(!lamp.is_empty() && lamp.iter().all(|i| is_lamp(&cloud.positions[*i])));
        for i in lamp {
            let tau = got.tau[i];
            assert!(tau.iter().all(|t| (t - 1.0).abs() < within), "{tau:?}");
        }
    }
}
