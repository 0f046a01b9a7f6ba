//! `transplat completions`.

use anyhow::Result;
use clap::CommandFactory as _;

use crate::cli::Cli;

pub fn run(shell: clap_complete::Shell) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(shell, &mut Cli::command(), "transplat", &mut text);
    // A reader that has left is no error.
    let _ = std::io::Write::write_all(&mut std::io::stdout(), &text);
    Ok(())
}
