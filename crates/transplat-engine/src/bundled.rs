//! The scene that comes with the program.

use std::path::{Path, PathBuf};

/// A file or folder of the bundled scene: beside the program, where a package puts it, or in the sources that it was built from.
pub fn bundled(name: &str) -> Option<PathBuf> {
    let program = std::env::current_exe().ok();
    let folder = program.as_deref().and_then(Path::parent);
    let sources = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets");
    let places = [
        folder.map(|f| f.join("assets")),
        folder.map(|f| f.join("../share/transplat/assets")),
        Some(sources),
    ];
    places
        .into_iter()
        .flatten()
        .map(|place| place.join(name))
        .find(|path| path.exists())
        .map(|path| path.canonicalize().unwrap_or(path))
}

/// First page of the manual: of a package, or in the sources as built by `cargo xtask docs`.
pub fn manual() -> Option<PathBuf> {
    let built = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/manual/index.html");
    bundled("manual/index.html").or_else(|| built.canonicalize().ok())
}

/// True for a folder of what comes with the program.
pub fn is_bundled(folder: &Path) -> bool {
    bundled(BUNDLED_SPLAT).is_some_and(|splat| splat.parent() == Some(folder))
}

/// The environments of the bundled scene; the first is the one that its splat was captured under.
pub const BUNDLED_LIGHTS: [&str; 3] = ["city.hdr", "sunset.hdr", "interior.hdr"];

/// The light that the splat is first relit by: its lamp throws a shadow that is seen.
pub const BUNDLED_FIRST_LIGHT: &str = "interior.hdr";

/// The splat of the bundled scene.
pub const BUNDLED_SPLAT: &str = "teapot.ply";

/// The other one: not laid on a surface that was known, but trained from pictures.
pub const BUNDLED_TRAINED_SPLAT: &str = "breakfast.ply";
