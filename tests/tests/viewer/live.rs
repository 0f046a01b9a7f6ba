//! What a window shows where the GPU relights, which the adapter of the tests leaves to the CPU.

use std::sync::Arc;

use eframe::wgpu::TextureFormat;
use glam::Vec3;
use transplat_core::present::{Background, View};
use transplat_core::surfels::SurfelCloud;
use transplat_gpu::live::{Live, LiveAsset};
use transplat_gpu::transfer::GpuTransfer;

use transplat_tests::driver::Driver;
use transplat_tests::psnr;

#[test]
fn the_gpu_shows_what_the_cpu_relit() {
    let mut d = Driver::bundled();
    d.viewer().session.scene.background = Background::Color([0.2; 3]);
    d.picture();
    let session = &d.viewer().session;
    let context = session.context.clone();
    let cloud: Arc<_> = session.asset().expect("a splat").cloud.clone();
    let prepared = session.prepared().cloned().expect("it is prepared");
    let mut live = Live::new(&context, TextureFormat::Rgba8Unorm);
    live.set_asset(
        0,
        LiveAsset::new(&context, &cloud).expect("the driver works"),
    );
    live.set_transfer(
        0,
        GpuTransfer::new(&context, &prepared).expect("the driver works"),
    );
    let mut pictures = Vec::new();
    for view in [View::After, View::Diffuse, View::Specular, View::Tau] {
        d.viewer().session.scene.view = view;
        let cpu = d.picture();
        let session = &d.viewer().session;
        let [_, target] = session.oriented_lights();
        let size = session.live().read_screen().expect("the driver works").1;
        let frame = session.frame(size, view).expect("a splat");
        live.relight(0, &target.light, view.part(), &[])
            .expect("read for best");
        assert!(live.frame(&frame));
        let (gpu, _) = live.read_screen().expect("the driver works");
        // Both round to eight bits.
        assert!(psnr(&cpu, &gpu) > 60.0, "{view:?}: {}", psnr(&cpu, &gpu));
        pictures.push(gpu);
    }
    for (i, a) in pictures.iter().enumerate() {
        assert!(pictures[..i].iter().all(|b| psnr(a, b) < 40.0));
    }
    // The whole is more than either part.
    let sum = |i: usize| pictures[i].iter().flatten().sum::<f32>();
    assert!(sum(0) > sum(1) && sum(0) > sum(2));
}

/// Two objects one behind the other are what one of all their surfels is, whichever was opened first.
#[test]
fn two_objects_are_drawn_like_one_of_both() {
    let mut d = Driver::bundled();
    d.viewer().session.scene.background = Background::Color([0.2; 3]);
    d.viewer().session.scene.view = View::Before;
    let one = d.picture();
    let session = &d.viewer().session;
    let context = session.context.clone();
    let near = session.asset().expect("a splat").cloud.clone();
    let size = session.live().read_screen().expect("the driver works").1;
    let mut frame = session.frame(size, View::Before).expect("a splat");
    // None hidden of either.
    frame.hidden = vec![Default::default(); 2];
    let camera = &frame.presentation.camera;
    let axes = camera.view_from_world.transpose();
    let radius = session.asset().expect("a splat").bounds.radius;
    // So far that no depth is in both, and half hidden.
    let mut far = near.thinned(0);
    far.add(&near, 1.0, radius * (3.0 * axes.z_axis + axes.x_axis));
    let mut both = SurfelCloud::clone(&near);
    both.add(&far, 1.0, Vec3::ZERO);
    let [far, both] = [far, both].map(Arc::new);
    let seen = |clouds: &[&Arc<SurfelCloud>]| -> Vec<[f32; 3]> {
        let mut live = Live::new(&context, TextureFormat::Rgba8Unorm);
        for (object, cloud) in clouds.iter().enumerate() {
            let asset = LiveAsset::new(&context, cloud).expect("the driver works");
            live.set_asset(object, asset);
        }
        assert!(live.frame(&frame));
        live.read_screen().expect("the driver works").0
    };
    let merged = seen(&[&both]);
    assert!(psnr(&one, &merged) < 30.0, "the far one is not seen");
    // A surfel is left out where what is before it leaves less than 1e-4 of it: less than a step of eight bits.
    for clouds in [[&near, &far], [&far, &near]] {
        let apart = seen(&clouds);
        assert!(psnr(&merged, &apart) > 60.0, "{}", psnr(&merged, &apart));
    }
}
