//! Manual: the pages of `docs/` as a site.

use std::path::PathBuf;

use crate::{Outcome, must, root};

/// Builds the manual in `target/manual`, by mdBook.
pub fn manual() -> Outcome {
    let mdbook = tool("mdbook", "0.5.4", "")?;
    must(&format!("{} build docs", mdbook.display()), &[])?;
    println!("\ntarget/manual/index.html");
    Ok(())
}

/// A program of crates.io, installed in `target/tools` where it is not there yet.
pub fn tool(name: &str, version: &str, features: &str) -> Result<PathBuf, String> {
    let program = root().join("target/tools/bin").join(name);
    if !program.is_file() {
        must(
            &format!("cargo install --locked --root target/tools {name}@{version} {features}"),
            &[],
        )?;
    }
    Ok(program)
}
