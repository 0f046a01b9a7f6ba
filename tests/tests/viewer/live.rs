//! What a window shows where the GPU relights, which the adapter of the tests leaves to the CPU.

use std::sync::Arc;

use eframe::wgpu::TextureFormat;
use transplat_core::present::{Background, View};
use transplat_gpu::live::{Live, LiveAsset};
use transplat_gpu::transfer::GpuTransfer;

use transplat_tests::driver::Driver;
use transplat_tests::psnr;

#[test]
fn the_gpu_shows_what_the_cpu_relit() {
    let mut d = Driver::new();
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
        let (values, _) = live.read_screen().expect("the driver works");
        let gpu: Vec<[f32; 3]> = values.chunks_exact(4).map(|p| [p[0], p[1], p[2]]).collect();
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
