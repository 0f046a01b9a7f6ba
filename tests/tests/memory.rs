//! Memory over a long session, in a process of its own: other tests would be counted too.
#![cfg(target_os = "linux")]

use transplat_tests::driver::Driver;

fn held_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").expect("Linux tells it");
    let line = status.lines().find(|l| l.starts_with("VmRSS:"));
    let kib = line.and_then(|l| l.split_whitespace().nth(1)?.parse::<f64>().ok());
    kib.expect("a number") / 1024.0
}

#[test]
fn looking_around_takes_no_memory() {
    let mut driver = Driver::bundled();
    let mut look_around = |steps: usize| {
        for _ in 0..steps {
            driver.after(|v| v.session.project.pose.azimuth += 3.0);
        }
        held_mib()
    };
    // Buffers and pipelines of the first frames stay.
    let before = look_around(10);
    let after = look_around(100);
    // Compiling a pass for each frame took 1.5 MiB a frame; one large buffer comes and goes.
    assert!(after - before < 60.0, "{before} to {after} MiB");
}
