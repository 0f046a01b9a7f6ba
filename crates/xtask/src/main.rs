//! `cargo xtask run` and `cargo xtask test`: each does all set-up on a fresh Debian machine that has only Rust.

mod checks;
mod dist;
mod manual;
mod setup;

use std::path::Path;
use std::process::{Command, ExitCode};

const HELP: &str = "cargo xtask run [ARGUMENTS]   run the program; without arguments the viewer on the bundled scene, or where there is no display, images of it
cargo xtask test              format, lints, docs, unit, parity and image tests, the program on the bundled scene
cargo xtask bench [ARGUMENTS] how long each stage takes by surfels and pixels; --help tells more
cargo xtask docs              the manual as a site, in target/manual
cargo xtask dist              a package for Debian and an archive for other Linux systems, with checksums, in target/dist
cargo xtask setup             only install what is missing";

/// What a task yields: success, or a message.
type Outcome = Result<(), String>;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let outcome = match arguments.first().map(String::as_str) {
        Some("run") => run(&arguments[1..]),
        Some("test") => checks::test(),
        Some("bench") => bench(&arguments[1..]),
        Some("docs") => manual::manual(),
        Some("dist") => dist::dist(),
        Some("setup") => setup::setup(has_display()),
        Some(other) => Err(format!("unknown command {other}\n{HELP}")),
        None => Err(HELP.into()),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(message) => {
            eprintln!("{message}");
            ExitCode::FAILURE
        }
    }
}

/// The repository's root.
fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .ancestors()
        .nth(2)
        .unwrap_or(Path::new("."))
}

/// A command in the root. Graphics libraries complain where there is no session's folder for sockets; any folder quiets them.
fn command(program: &str, arguments: &[&str]) -> Command {
    let mut command = Command::new(program);
    command.args(arguments).current_dir(root());
    if std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        command.env("XDG_RUNTIME_DIR", std::env::temp_dir());
    }
    command
}

/// Runs a command line that must succeed, with words that may hold spaces at its end.
fn must(line: &str, given: &[String]) -> Outcome {
    let mut words = line.split_whitespace();
    let program = words.next().unwrap_or_default();
    println!("> {line} {}", given.join(" "));
    let mut command = command(program, &words.collect::<Vec<_>>());
    match command.args(given).status() {
        Ok(status) if status.success() => Ok(()),
        Ok(status) => Err(format!("{line} failed: {status}")),
        Err(error) => Err(format!("{program} could not be started: {error}")),
    }
}

/// Whether a window can be opened.
fn has_display() -> bool {
    ["DISPLAY", "WAYLAND_DISPLAY"]
        .iter()
        .any(|name| std::env::var_os(name).is_some_and(|v| !v.is_empty()))
}

fn run(arguments: &[String]) -> Outcome {
    // The commands work without a driver too, on the CPU.
    if let Err(message) = setup::setup(has_display()) {
        eprintln!("{message}\nGoing on without.");
    }
    let program = "cargo run --release --quiet --package transplat --";
    println!("building the program (a few minutes the first time)");
    if !arguments.is_empty() || has_display() {
        return must(program, arguments);
    }
    let out = "target/bundled";
    relight_bundled(program, out, "")?;
    let full = root().join(out);
    println!(
        "\nThere is no display for the viewer. The teapot was captured under city.hdr. Relit by sunset.hdr and interior.hdr:\n  {0}/sunset.ply  {0}/interior.ply   open in any splat viewer\n  {0}/before/*.png  {0}/after/*/*.png   images, before and after\nMore: cargo xtask run --help",
        full.display()
    );
    Ok(())
}

fn bench(arguments: &[String]) -> Outcome {
    // The CPU is measured without a driver.
    if let Err(message) = setup::setup(false) {
        eprintln!("{message}\nGoing on without.");
    }
    let line = "cargo bench --quiet --package transplat-tests --bench stages --";
    must(line, arguments)
}

/// The program's own commands on the bundled scene; `program` is how it is started, `more` goes to each command.
fn relight_bundled(program: &str, out: &str, more: &str) -> Outcome {
    let (asset, bake) = ("assets/teapot.ply", format!("{out}/teapot.bake"));
    let targets = "--target assets/sunset.hdr --target assets/interior.hdr";
    let lights = format!("--source assets/city.hdr {targets} --bake {bake}");
    let view = "--turntable 4 --supersample 2";
    std::fs::create_dir_all(root().join(out)).map_err(|e| format!("{out}: {e}"))?;
    must(&format!("{program} info {asset}"), &[])?;
    for line in [
        format!("bake {asset} -o {bake}"),
        format!("relight {asset} -o {out} {lights}"),
        format!("render {asset} -o {out}/before {view}"),
        format!("render {asset} -o {out}/after --background environment {lights} {view}"),
    ] {
        must(&format!("{program} {line} {more}"), &[])?;
    }
    Ok(())
}
