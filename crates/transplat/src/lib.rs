//! The program `transplat`: its commands and its window, both clients of `transplat_engine`.

mod cli;
mod commands;
mod summary;
pub mod viewer;

use std::io::Write as _;
use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Command, Usage};
use transplat_engine::device::{Device, DeviceChoice};
use transplat_engine::words;

/// The version, the commit that it was built from where that is known, and the adapter that `--device gpu` would take.
fn version() -> String {
    let commit = option_env!("TRANSPLAT_COMMIT").map(|c| format!(" ({c})"));
    let adapter = match Device::open(DeviceChoice::Gpu) {
        Ok(device) => device.name(),
        Err(why) => format!("none ({why:#})"),
    };
    format!(
        "transplat {}{}\nadapter: {adapter}",
        env!("CARGO_PKG_VERSION"),
        commit.unwrap_or_default()
    )
}

/// Runs what the command line asks for.
pub fn main() -> ExitCode {
    let cli = Cli::parse();
    if cli.version {
        // A reader that has left is no error.
        let _ = writeln!(std::io::stdout(), "{}", version());
        return ExitCode::SUCCESS;
    }
    let result = match &cli.command {
        Some(Command::Relight(args)) => commands::relight::run(args),
        Some(Command::Render(args)) => match &args.batch {
            Some(file) => commands::batch::run(file, args),
            None => commands::render::run(args),
        },
        Some(Command::Convert(args)) => commands::convert::run(args),
        Some(Command::Delight(args)) => commands::delight::run(args),
        Some(Command::Bake(args)) => commands::bake::run(args),
        Some(Command::Estimate(args)) => commands::estimate::run(args),
        Some(Command::Probe(args)) => commands::probe::run(args),
        Some(Command::Light(args)) => commands::light::run(args),
        Some(Command::Info(args)) => commands::info::run(args),
        Some(Command::Report(args)) => commands::report::run(args),
        Some(Command::Completions { shell }) => commands::completions::run(*shell),
        Some(Command::Man { folder }) => commands::man::run(folder),
        None => commands::view::run(&cli.view),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            if let Some(usage) = error.downcast_ref::<Usage>() {
                usage.exit();
            }
            eprintln!("transplat: {}", words::of_error(&error));
            ExitCode::FAILURE
        }
    }
}
