//! One module a command.

pub mod bake;
pub mod info;
pub mod relight;
pub mod render;

/// Ends the program over a wrong command line, as the parser itself does: message on stderr, exit code 2.
pub fn usage(message: &str) -> ! {
    clap::Error::raw(
        clap::error::ErrorKind::MissingRequiredArgument,
        format!("{message}\n"),
    )
    .exit()
}
