//! What the tests share: the adapter, the bundled scene, the program, and a metric for pictures.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::OnceLock;

use transplat_gpu::Context;

/// The adapter, software drivers included. No adapter is a failure, never a skip.
///
/// # Panics
/// If there is none.
#[allow(clippy::expect_used)]
pub fn gpu() -> Context {
    Context::new(true).expect("the tests need a Vulkan driver; `cargo xtask test` installs one")
}

/// The repository's root.
pub fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap_or(Path::new("."))
}

/// A file of the bundled scene.
pub fn asset(name: &str) -> String {
    root().join("assets").join(name).display().to_string()
}

/// The program, built with this profile.
///
/// # Panics
/// If it does not build.
pub fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(|| {
        let mut folder = std::env::current_exe().unwrap_or_default();
        folder.pop();
        folder.pop();
        let mut build = Command::new(env!("CARGO"));
        build
            .current_dir(root())
            .args(["build", "--quiet", "--workspace", "--bins"]);
        if folder.ends_with("release") {
            build.arg("--release");
        }
        let built = build.status().is_ok_and(|status| status.success());
        assert!(built, "the program does not build");
        folder
            .join("transplat")
            .with_extension(std::env::consts::EXE_EXTENSION)
    })
}

/// Runs the program.
///
/// # Panics
/// If it cannot be started.
#[allow(clippy::expect_used)]
pub fn run(arguments: &[&str]) -> Output {
    Command::new(program())
        .args(arguments)
        .output()
        .expect("the program starts")
}

/// Runs the program, which must succeed, and yields the JSON object that it prints.
///
/// # Panics
/// If it fails, or prints no JSON.
#[allow(clippy::expect_used)]
pub fn run_json(arguments: &[&str]) -> serde_json::Value {
    let output = run(&[arguments, &["--json"]].concat());
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    serde_json::from_slice(&output.stdout).expect("one JSON object on stdout")
}

/// A picture's colour over black, 0 to 1, `[height * width]`.
///
/// # Panics
/// If it cannot be read.
#[allow(clippy::expect_used)]
pub fn picture(path: &Path) -> Vec<[f32; 3]> {
    let picture = image::open(path).expect("a picture").into_rgba32f();
    picture
        .pixels()
        .map(|p| {
            let [r, g, b, a] = p.0;
            [r * a, g * a, b * a]
        })
        .collect()
}

/// Peak signal to noise ratio in dB, for values of 0 to 1.
///
/// # Panics
/// If the pictures differ in size.
pub fn psnr(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: f64 = a
        .iter()
        .flatten()
        .zip(b.iter().flatten())
        .map(|(a, b)| f64::from(a - b).powi(2))
        .sum();
    -10.0 * (sum / (3 * a.len()) as f64).max(1e-12).log10()
}
