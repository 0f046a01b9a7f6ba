//! Tells the program which commit it is built from, where that is known.

use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=TRANSPLAT_COMMIT");
    let named = std::env::var("TRANSPLAT_COMMIT").ok();
    if let Some(commit) = named.filter(|c| !c.is_empty()).or_else(commit) {
        println!("cargo::rustc-env=TRANSPLAT_COMMIT={commit}");
    }
}

/// That of the repository, where it is these sources'.
fn commit() -> Option<String> {
    let here = git(&["rev-parse", "--short=9", "HEAD"])?;
    // Sources that lie in another repository are of none of its commits.
    git(&["ls-files", "--error-unmatch", "build.rs"])?;
    // What moves when another commit is checked out or made.
    for moved in ["HEAD", "logs/HEAD"] {
        let path = git(&["rev-parse", "--git-path", moved])?;
        println!("cargo::rerun-if-changed={path}");
    }
    Some(here)
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
