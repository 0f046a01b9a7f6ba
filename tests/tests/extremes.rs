//! The stiff and extreme cases on the GPU: what is asked of the CPU holds there too.

use transplat_core::environment::Illumination;
use transplat_core::extremes::{all, run};
use transplat_core::settings::Method;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};
use transplat_gpu::transfer::GpuTransfer;
use transplat_tests::gpu;

#[test]
fn every_case_holds_on_the_gpu() {
    let gpu = gpu();
    let relight = |prepared: &PreparedTransfer, light: &Illumination| -> Result<Relit, String> {
        let mut on_gpu = GpuTransfer::new(&gpu, prepared).expect("the driver works");
        let submitted = on_gpu.submit(light, Part::Whole, &[]);
        submitted.map_err(|e| e.to_string())?;
        Ok(on_gpu.read().expect("the driver works"))
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
