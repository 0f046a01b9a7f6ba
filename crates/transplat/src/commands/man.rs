//! `transplat man`: manual pages of the program and of each command, for packages.

use std::path::Path;

use anyhow::{Context as _, Result};
use clap::CommandFactory as _;

use crate::cli::Cli;

pub fn run(folder: &Path) -> Result<()> {
    let command = Cli::command().name("transplat");
    let command = command.version(env!("CARGO_PKG_VERSION"));
    std::fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(command, folder))
        .with_context(|| folder.display().to_string())
}
