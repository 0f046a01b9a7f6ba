//! Checks that must pass before a change lands.

use std::io::{BufRead, BufReader};
use std::process::Stdio;

use crate::{Outcome, command, must, relight_bundled, setup};

/// Runs all checks and closes with the number of tests that passed and failed.
pub fn test() -> Outcome {
    setup::setup(false)?;
    must("cargo fetch --locked --quiet", &[])?;
    must("cargo fmt --all --check", &[])?;
    let clippy = "cargo clippy --workspace --all-targets --quiet -- --deny warnings";
    must(clippy, &[])?;
    let (passed, failed) = tests()?;
    docs()?;
    let program = "cargo run --quiet --package transplat --";
    for device in ["cpu", "gpu"] {
        let out = format!("target/checks/{device}");
        relight_bundled(program, &out, &format!("--device {device} --quiet"))?;
    }
    println!("\n{passed} passed, {failed} failed");
    Ok(())
}

fn docs() -> Outcome {
    println!("> cargo doc");
    let built = command("cargo", &["doc", "--workspace", "--no-deps", "--quiet"])
        .env("RUSTDOCFLAGS", "--deny warnings")
        .status();
    if built.is_ok_and(|s| s.success()) {
        Ok(())
    } else {
        Err("cargo doc failed".into())
    }
}

/// Runs the tests, showing what they print, and adds up their summary lines.
fn tests() -> Result<(u64, u64), String> {
    println!("> cargo test --workspace");
    let mut child = command("cargo", &["test", "--workspace", "--no-fail-fast"])
        .stdout(Stdio::piped())
        .spawn()
        .map_err(|e| format!("cargo could not be started: {e}"))?;
    let (mut passed, mut failed) = (0, 0);
    if let Some(stdout) = child.stdout.take() {
        for line in BufReader::new(stdout).lines().map_while(Result::ok) {
            println!("{line}");
            if let Some(counts) = summary(&line) {
                passed += counts.0;
                failed += counts.1;
            }
        }
    }
    let status = child.wait().map_err(|e| e.to_string())?;
    if status.success() && failed == 0 && passed > 0 {
        Ok((passed, failed))
    } else {
        Err(format!("tests failed\n\n{passed} passed, {failed} failed"))
    }
}

/// Counts of `test result: ok. 3 passed; 0 failed; ...`.
fn summary(line: &str) -> Option<(u64, u64)> {
    let counts = line.strip_prefix("test result: ")?.split_once(". ")?.1;
    let mut numbers = counts
        .split("; ")
        .map(|part| part.split(' ').next()?.parse().ok());
    Some((numbers.next()??, numbers.next()??))
}

#[cfg(test)]
mod tests {
    #[test]
    fn summary_lines_are_read() {
        let line =
            "test result: FAILED. 12 passed; 3 failed; 0 ignored; 0 measured; 0 filtered out";
        assert_eq!(super::summary(line), Some((12, 3)));
        assert_eq!(super::summary("test sh ... ok"), None);
    }
}
