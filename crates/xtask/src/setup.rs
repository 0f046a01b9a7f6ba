//! System libraries that the program needs, and their installation.

use std::path::Path;
use std::process::Command;

use crate::Outcome;

/// Debian's packages for a Vulkan loader and drivers, a software one among them.
pub const DRIVER: [&str; 2] = ["libvulkan1", "mesa-vulkan-drivers"];

/// Debian's packages that a window needs besides, with a library that each brings. A desktop has them already.
pub const WINDOW: [(&str, &str); 7] = [
    ("libx11-6", "libX11.so.6"),
    ("libx11-xcb1", "libX11-xcb.so.1"),
    ("libxcb1", "libxcb.so.1"),
    ("libxcursor1", "libXcursor.so.1"),
    ("libxi6", "libXi.so.6"),
    ("libxkbcommon0", "libxkbcommon.so.0"),
    ("libxkbcommon-x11-0", "libxkbcommon-x11.so.0"),
];

/// Installs what is missing: a Vulkan driver, and for a window X11's libraries. Says what it does; without the rights, prints the command.
pub fn setup(window: bool) -> Outcome {
    if !cfg!(target_os = "linux") {
        return Ok(());
    }
    let missing = missing(window);
    if missing.is_empty() {
        return Ok(());
    }
    let names = missing.join(" ");
    let install =
        format!("apt-get update && apt-get install --yes --no-install-recommends {names}");
    if !succeeds("apt-get", &["--version"]) {
        return Err(format!(
            "Libraries are missing. Install your system's packages for them (Debian calls them {names})."
        ));
    }
    let is_root = Command::new("id")
        .arg("-u")
        .output()
        .is_ok_and(|o| o.stdout.trim_ascii() == b"0");
    let shell: &[&str] = if is_root {
        &["sh", "-c"]
    } else if succeeds("sudo", &["-n", "true"]) {
        &["sudo", "-n", "sh", "-c"]
    } else {
        return Err(format!(
            "Libraries are missing. Install them with:\n  sudo sh -c '{install}'"
        ));
    };
    println!("Installing {names}:\n  {install}");
    let status = Command::new(shell[0])
        .args(&shell[1..])
        .arg(&install)
        .env("DEBIAN_FRONTEND", "noninteractive")
        .status();
    if status.is_ok_and(|s| s.success()) && self::missing(window).is_empty() {
        Ok(())
    } else {
        Err(format!(
            "The installation failed. Try it by hand:\n  {install}"
        ))
    }
}

/// Packages that are not there.
fn missing(window: bool) -> Vec<&'static str> {
    let mut packages = Vec::new();
    if !has_vulkan() {
        packages.extend(DRIVER);
    }
    if window {
        let absent = WINDOW.iter().filter(|(_, library)| !has_library(library));
        packages.extend(absent.map(|(package, _)| package));
    }
    packages
}

fn has_library(name: &str) -> bool {
    LIBRARY_FOLDERS
        .iter()
        .any(|folder| Path::new(folder).join(name).exists())
}

/// Where the loader finds libraries.
const LIBRARY_FOLDERS: [&str; 6] = [
    "/usr/lib/x86_64-linux-gnu",
    "/usr/lib/aarch64-linux-gnu",
    "/lib/x86_64-linux-gnu",
    "/lib/aarch64-linux-gnu",
    "/usr/lib64",
    "/usr/lib",
];

fn succeeds(program: &str, arguments: &[&str]) -> bool {
    Command::new(program)
        .args(arguments)
        .output()
        .is_ok_and(|o| o.status.success())
}

/// A loader, and at least one driver's manifest where the loader looks for it.
fn has_vulkan() -> bool {
    let loader = has_library("libvulkan.so.1");
    let named = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"]
        .iter()
        .any(|name| std::env::var_os(name).is_some());
    let driver = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"]
        .iter()
        .any(|folder| std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()));
    loader && (driver || named)
}
