//! `transplat` without a command: the viewer.

use anyhow::{Context, Result};
use transplat_core::look::Look;

use crate::cli::ViewArgs;
use crate::scene::look_of;
use crate::viewer::{self, Opening};

pub fn run(args: &ViewArgs) -> Result<()> {
    for file in &args.files {
        // A misspelt name is told before a window opens.
        std::fs::metadata(file).with_context(|| file.display().to_string())?;
    }
    let look = look_of(&args.options, Some(&args.light))?;
    let asked = look != Look::default();
    viewer::open(Opening {
        files: args.files.clone(),
        look: asked.then_some(look),
    })
}
