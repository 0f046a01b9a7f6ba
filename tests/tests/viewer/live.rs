//! What a window shows where the GPU relights and draws, which the adapter of the tests leaves to the CPU.

use std::sync::Arc;
use std::time::Instant;

use eframe::wgpu::TextureFormat;
use glam::{Affine3A, Quat, Vec3};
use transplat::viewer::Viewer;
use transplat_core::present::{Background, View};
use transplat_core::surfels::SurfelCloud;
use transplat_gpu::live::{Drawing, Live, LiveSplat, Placement};
use transplat_gpu::transfer::GpuTransfer;

use transplat_tests::driver::{Driver, PATIENCE};
use transplat_tests::psnr;

#[test]
fn the_gpu_shows_what_the_cpu_relit() {
    let mut d = Driver::bundled();
    d.viewer().session.project.scene.background = Background::Color([0.2; 3]);
    d.picture();
    let session = &d.viewer().session;
    let context = session.canvas.context.clone();
    let cloud: Arc<_> = session.asset().expect("a splat").cloud.clone();
    let prepared = session.prepared().cloned().expect("it is prepared");
    let mut live = Live::new(&context, TextureFormat::Rgba8Unorm, Drawing::Gpu);
    let asset = LiveSplat::new(&context, &cloud, Drawing::Gpu).expect("the driver works");
    live.set_asset(0, asset).expect("room for it");
    live.set_transfer(
        0,
        GpuTransfer::new(&context, &prepared).expect("the driver works"),
    );
    let mut pictures = Vec::new();
    for view in [View::After, View::Diffuse, View::Specular, View::Tau] {
        d.viewer().session.project.scene.view = view;
        let cpu = d.picture();
        let session = &d.viewer().session;
        let [_, target] = session.oriented_lights();
        let size = session
            .canvas
            .live()
            .read_screen()
            .expect("the driver works")
            .1;
        let frame = session.frame(size, view).expect("a splat");
        live.relight(0, &target.light, view.part(), &[])
            .expect("read for best");
        assert!(live.frame(&frame));
        let (gpu, _) = live.read_screen().expect("the driver works");
        // Both round to eight bits, which blending in half floats (a tenth of a step off) brings to the other side of one pixel in ten: 58 dB.
        assert!(psnr(&cpu, &gpu) > 58.0, "{view:?}: {}", psnr(&cpu, &gpu));
        pictures.push(gpu);
    }
    for (i, a) in pictures.iter().enumerate() {
        assert!(pictures[..i].iter().all(|b| psnr(a, b) < 40.0));
    }
    // The whole is more than either part.
    let sum = |i: usize| pictures[i].iter().flatten().sum::<f32>();
    assert!(sum(0) > sum(1) && sum(0) > sum(2));
}

/// What takes long to relight follows another light at once, and is exact when the light rests; nothing else makes it coarse.
#[test]
fn a_light_that_moves_is_shown_coarsely_until_it_rests() {
    let mut d = Driver::bundled();
    let turn =
        |degrees: f64| move |v: &mut Viewer| v.session.project.scene.environment.rotation = degrees;
    let before = d.picture();
    d.after(turn(120.0));
    let exact = d.picture();
    d.after(turn(0.0));
    d.viewer().session.project.coarse_from_ms = 0.0;

    turn(120.0)(d.viewer());
    let start = Instant::now();
    while d.viewer().session.project.not_final(View::After) != Some("Coarse: the light is changing")
    {
        d.harness.step();
        assert!(start.elapsed() < PATIENCE, "it is never coarse");
    }
    let live = d.viewer().session.canvas.live();
    let coarse = live.read_screen().expect("the driver works").0;
    drop(live);
    assert!(psnr(&coarse, &exact) > psnr(&before, &exact) + 3.0);
    assert!(psnr(&coarse, &exact) < 50.0);
    assert!(psnr(&d.picture(), &exact) > 80.0);

    // Epsilon is no light: the picture stays exact, then is exact again.
    d.viewer().session.project.scene.transfer.epsilon = Some(0.05);
    d.harness.step();
    while !d.viewer().session.is_settled() {
        assert_eq!(d.viewer().session.project.not_final(View::After), None);
        d.harness.step();
    }
}

/// Two objects, one in front of the other or each in the midst of the other, are what one of all their surfels is, whichever was opened first
/// and however they are placed.
#[test]
fn two_objects_are_drawn_like_one_of_both() {
    let mut d = Driver::bundled();
    d.viewer().session.project.scene.background = Background::Color([0.2; 3]);
    d.viewer().session.project.scene.view = View::Before;
    let one = d.picture();
    let session = &d.viewer().session;
    let context = session.canvas.context.clone();
    let near = session.asset().expect("a splat").cloud.clone();
    let size = session
        .canvas
        .live()
        .read_screen()
        .expect("the driver works")
        .1;
    let mut frame = session.frame(size, View::Before).expect("a splat");
    let mut seen = |objects: &[(&SurfelCloud, Affine3A)], drawing: Drawing| -> Vec<[f32; 3]> {
        let mut live = Live::new(&context, TextureFormat::Rgba8Unorm, drawing);
        frame.objects.clear();
        for (object, (cloud, place)) in objects.iter().enumerate() {
            let cloud = Arc::new((*cloud).clone());
            let asset = LiveSplat::new(&context, &cloud, drawing).expect("the driver works");
            live.set_asset(object, asset).expect("room for both");
            frame.objects.push(Placement {
                scene_from_object: *place,
                shown: true,
                ..Placement::default()
            });
        }
        assert!(live.frame(&frame));
        live.read_screen().expect("the driver works").0
    };
    let camera = session.frame(size, View::Before).expect("a splat");
    let axes = camera.presentation.camera.view_from_world.transpose();
    let radius = session.asset().expect("a splat").bounds.radius;
    let here = Affine3A::IDENTITY;
    // Behind it and half hidden, or turned and in its midst.
    let behind = Affine3A::from_translation(radius * (3.0 * axes.z_axis + axes.x_axis));
    let amidst = Affine3A::from_scale_rotation_translation(
        Vec3::splat(0.7),
        Quat::from_rotation_z(1.0),
        0.4 * radius * axes.x_axis,
    );
    for there in [behind, amidst] {
        let both = SurfelCloud::composed(&[(&near, here), (&near, there)]);
        let merged = seen(&[(&both, here)], Drawing::Gpu);
        assert!(psnr(&one, &merged) < 30.0, "the other one is seen");
        // A surfel is left out where what is before it leaves less than 1e-4 of it: less than a step of eight bits.
        for drawing in [Drawing::Gpu, Drawing::Cpu] {
            for objects in [
                [(&*near, here), (&*near, there)],
                [(&*near, there), (&*near, here)],
            ] {
                let apart = seen(&objects, drawing);
                let psnr = psnr(&merged, &apart);
                assert!(psnr > 50.0, "{drawing:?}: {psnr}");
            }
        }
    }
}
