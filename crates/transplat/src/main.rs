//! `transplat`: relight a captured object from the command line.

mod cli;
mod commands;
mod device;
mod report;
mod scene;

use std::process::ExitCode;

use clap::Parser;

use cli::{Cli, Command};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let result = match &cli.command {
        Command::Relight(args) => commands::relight::run(args),
        Command::Render(args) => commands::render::run(args),
        Command::Bake(args) => commands::bake::run(args),
        Command::Info(args) => commands::info::run(args),
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("transplat: {error:#}");
            ExitCode::FAILURE
        }
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn there_is_one_command_a_module() {
        use clap::CommandFactory;
        let names: Vec<String> = crate::cli::Cli::command()
            .get_subcommands()
            .map(|c| c.get_name().to_owned())
            .collect();
        assert_eq!(names, ["relight", "render", "bake", "info"]);
    }
}
