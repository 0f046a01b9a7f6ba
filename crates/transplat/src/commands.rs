//! The commands, one module each.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use transplat_core::files::SplatFormat;

pub mod bake;
pub mod batch;
pub mod completions;
pub mod convert;
pub mod delight;
pub mod estimate;
pub mod headless;
pub mod info;
pub mod light;
pub mod man;
pub mod probe;
pub mod relight;
pub mod render;
pub mod report;
pub mod settings;
pub mod view;

/// Refuses outputs that are also inputs: a capture is not to be lost to a slip of the hand.
pub fn refuse_overwriting<'a>(
    inputs: impl IntoIterator<Item = &'a Path>,
    outputs: &[impl AsRef<Path>],
) -> Result<()> {
    let inputs = inputs.into_iter().filter_map(|p| p.canonicalize().ok());
    let inputs: Vec<PathBuf> = inputs.collect();
    for output in outputs {
        let output = output.as_ref();
        let known = output.canonicalize();
        if known.is_ok_and(|o| o.is_file() && inputs.contains(&o)) {
            bail!(
                "{}: is an input too and would be lost; choose another output",
                output.display()
            );
        }
    }
    Ok(())
}

/// The format that a splat's name says; refuses one that says none.
pub fn called_as_a_splat(path: &Path) -> Result<SplatFormat> {
    let endings = || SplatFormat::WRITTEN.map(|(ending, _)| ending).join(", ");
    SplatFormat::of_name(path).with_context(|| {
        format!(
            "{}: the name says the format, and ends with {}",
            path.display(),
            endings()
        )
    })
}
