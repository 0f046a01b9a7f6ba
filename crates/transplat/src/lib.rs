//! The program `transplat`: its commands and its viewer. The mathematics is in `transplat_core`, its GPU passes in `transplat_gpu`.

mod bundled;
mod cli;
mod commands;
mod device;
mod ground_truth;
mod layers;
mod metrics;
mod picture;
mod pipeline;
mod savings;
mod summary;
mod sweep;
pub mod viewer;
mod words;

use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Command};

/// Runs what the command line asks for.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match &cli.command {
        Some(Command::Relight(args)) => commands::relight::run(args),
        Some(Command::Render(args)) => commands::render::run(args),
        Some(Command::Bake(args)) => commands::bake::run(args),
        Some(Command::Estimate(args)) => commands::estimate::run(args),
        Some(Command::Probe(args)) => commands::probe::run(args),
        Some(Command::Info(args)) => commands::info::run(args),
        Some(Command::Report(args)) => commands::report::run(args),
        None => commands::view::run(&cli.view),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("transplat: {error:#}");
            ExitCode::FAILURE
        }
    }
}
