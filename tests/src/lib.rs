//! What the tests share: the adapter, the bundled scene, the program, and a metric for pictures. All of it panics where it fails, which
//! fails the test.

pub mod driver;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::{Arc, OnceLock};

use transplat_gpu::Context;

/// The adapter, software drivers included. No adapter is a failure, never a skip.
pub fn gpu() -> Arc<Context> {
    let context = Context::new(true);
    Arc::new(context.expect("the tests need a Vulkan driver; `cargo xtask test` installs one"))
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

/// A command line's words, each `{}` one of the names: those may hold spaces.
pub fn args<'a>(line: &'a str, names: &[&'a str]) -> Vec<&'a str> {
    let mut names = names.iter();
    let word = |word| match word {
        "{}" => names.next().copied().expect("a name for each"),
        word => word,
    };
    line.split_whitespace().map(word).collect()
}

/// Runs the program.
pub fn run(arguments: &[&str]) -> Output {
    Command::new(program())
        .args(arguments)
        .output()
        .expect("the program starts")
}

/// Runs the program, which must end with a code and say some words on stderr.
pub fn run_told(arguments: &[&str], code: i32, words: &[&str]) -> Output {
    let output = run(arguments);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{arguments:?}: {message}");
    for word in words {
        assert!(
            message.contains(word),
            "{arguments:?} does not say {word:?}: {message}"
        );
    }
    output
}

/// Runs the program, which must succeed, and yields the JSON object that it prints.
pub fn run_json(arguments: &[&str]) -> serde_json::Value {
    let output = run_told(&[arguments, &["--json"]].concat(), 0, &[]);
    serde_json::from_slice(&output.stdout).expect("one JSON object on stdout")
}

/// A camera file of some cameras around the origin, held level with +y up.
pub fn level_cameras() -> String {
    let frame = |i: usize| {
        let (sin, cos) = (1.3 * i as f64).sin_cos();
        let (x, z) = (4.0 * sin, 4.0 * cos);
        let rows = format!(
            "[[{cos},0,{sin},{x}],[0,1,0,1],[{},0,{cos},{z}],[0,0,0,1]]",
            -sin
        );
        format!(r#"{{"file_path": "{i}.png", "transform_matrix": {rows}}}"#)
    };
    let frames: Vec<String> = (0..5).map(frame).collect();
    format!(
        r#"{{"camera_angle_x": 0.6, "w": 40, "h": 30, "frames": [{}]}}"#,
        frames.join(",")
    )
}

/// A folder of a test's own, removed at its end.
pub struct Folder(tempfile::TempDir);

impl Folder {
    /// A new one, with nothing in it.
    pub fn empty() -> Self {
        Self(tempfile::tempdir().expect("a folder"))
    }

    /// A path in it.
    pub fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    /// A path in it, as an argument.
    pub fn name(&self, name: &str) -> String {
        self.path(name).display().to_string()
    }

    /// Writes a file and yields its name.
    pub fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        fs::write(self.path(name), bytes).expect("room for it");
        self.name(name)
    }

    /// Names of all files and folders below, sorted.
    pub fn files(&self) -> Vec<String> {
        fn walk(folder: &Path, out: &mut Vec<String>) {
            for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
                walk(&entry.path(), out);
                out.push(entry.file_name().to_string_lossy().into_owned());
            }
        }
        let mut out = Vec::new();
        walk(self.0.path(), &mut out);
        out.sort();
        out
    }
}

/// A table of colours (.cube), curves and a cube, that takes most of the blue away and lifts the dark.
pub fn small_lut() -> String {
    let mut text = String::from(
        "TITLE \"small\"\nLUT_1D_SIZE 3\nLUT_1D_INPUT_RANGE 0 1.25\nLUT_3D_SIZE 3\nLUT_3D_INPUT_RANGE 0.0 0.9\n",
    );
    text += "0 0 0\n0.6 0.5 0.55\n1 0.95 0.9\n";
    for i in 0..27 {
        let [r, g, b] = [i % 3, i / 3 % 3, i / 9].map(|v| v as f32 / 2.0);
        text += &format!("{} {} {}\n", 0.1 + 0.9 * r * r, 0.1 + 0.8 * g, 0.4 * b);
    }
    text
}

/// A small ascii splat: a square of surfels that face up.
pub fn small_splat(rows: usize) -> String {
    let names = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 rot_0 rot_1 rot_2 rot_3";
    let mut text =
        format!("ply\nformat ascii 1.0\ncomment SplatRenderMode: 2dgs\nelement vertex {rows}\n");
    for name in names.split(' ') {
        text += &format!("property float {name}\n");
    }
    text += "end_header\n";
    for i in 0..rows {
        text += &format!("{} {} 0 0.5 0.2 -0.3 3 -2 -2 1 0 0 0\n", i % 10, i / 10);
    }
    text
}

/// Red, green, blue and alpha of an EXR, `[height * width]`, in whatever order it holds its lines.
pub fn exr_pixels(path: &str) -> Vec<[f32; 4]> {
    let exr = exr::prelude::read_first_rgba_layer_from_file(
        path,
        |size, _| (size.width(), vec![[0.0; 4]; size.area()]),
        |(width, pixels): &mut (usize, Vec<[f32; 4]>), at, (r, g, b, a): (f32, f32, f32, f32)| {
            pixels[at.y() * *width + at.x()] = [r, g, b, a]
        },
    );
    exr.expect("an EXR").layer_data.channel_data.pixels.1
}

/// A picture's colour over black, 0 to 1, `[height * width]`.
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
pub fn psnr<const N: usize>(a: &[[f32; N]], b: &[[f32; N]]) -> f64 {
    assert_eq!(a.len(), b.len());
    let sum: f64 = a
        .iter()
        .flatten()
        .zip(b.iter().flatten())
        .map(|(a, b)| f64::from(a - b).powi(2))
        .sum();
    -10.0 * (sum / (N * a.len()) as f64).max(1e-12).log10()
}
