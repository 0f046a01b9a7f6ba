//! The stiff and extreme cases on the GPU: what is asked of the CPU holds there too.

use transplat_core::environment::Illumination;
use transplat_core::extremes::{all, run};
use transplat_core::settings::Method;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};
use transplat_gpu::transfer::directional::GpuDirectional;
use transplat_gpu::transfer::harmonic::GpuHarmonic;
use transplat_tests::gpu;

#[test]
fn every_case_holds_on_the_gpu() {
    let gpu = gpu();
    let relight = |prepared: &PreparedTransfer, light: &Illumination| -> Result<Relit, String> {
        Ok(match prepared {
            PreparedTransfer::Harmonic(paper) => {
                let on_gpu = GpuHarmonic::new(&gpu, paper).expect("the driver works");
                on_gpu
                    .relight(&paper.light(&light.radiance))
                    .expect("the driver works");
                paper.relit(on_gpu.read().expect("the driver works"), Part::Whole)
            }
            PreparedTransfer::Directional(best) => {
                let on_gpu = GpuDirectional::new(&gpu, best).expect("the driver works");
                let light = best.light(light.for_directional().map_err(|e| e.to_string())?);
                on_gpu
                    .relight(&light, Part::Whole)
                    .expect("the driver works");
                on_gpu.read().expect("the driver works")
            }
        })
    };
    let mut failures = Vec::new();
    for case in all() {
        for method in Method::ALL {
            let outcome = run(&case, method, Some(&relight));
            let told = format!(
                "{} ({}): {:?}, CPU {:?}, GPU {:?}",
                case.name,
                method.preset(),
                outcome.failure,
                outcome.f32_error,
                outcome.other_error
            );
            println!("{told}");
            // Some hundred roundings of 2^-24 each, and the drivers' own exp and log, good to 2^-21.
            let is_off = outcome.other_error.is_some_and(|e| e > 1e-5);
            if outcome.failure.is_some() || is_off {
                failures.push(told);
            }
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
}
