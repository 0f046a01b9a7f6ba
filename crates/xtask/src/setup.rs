//! What the program needs of the system, and how it is installed.

use std::path::Path;
use std::process::Command;

use crate::Outcome;

/// Debian's packages for a Vulkan loader and drivers, a software one among them.
const PACKAGES: [&str; 2] = ["libvulkan1", "mesa-vulkan-drivers"];

/// Installs a Vulkan driver where there is none. Says what it does; without the rights, prints the command.
pub fn setup() -> Outcome {
    if !cfg!(target_os = "linux") || has_vulkan() {
        return Ok(());
    }
    let install = format!(
        "apt-get update && apt-get install --yes --no-install-recommends {}",
        PACKAGES.join(" ")
    );
    if !succeeds("apt-get", &["--version"]) {
        return Err(format!(
            "No Vulkan driver was found. Install your system's packages for it (Debian calls them {}).",
            PACKAGES.join(" and ")
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
            "No Vulkan driver was found. Install one with:\n  sudo sh -c '{install}'"
        ));
    };
    println!(
        "No Vulkan driver was found. Installing {}:\n  {install}",
        PACKAGES.join(" and ")
    );
    let status = Command::new(shell[0])
        .args(&shell[1..])
        .arg(&install)
        .env("DEBIAN_FRONTEND", "noninteractive")
        .status();
    if status.is_ok_and(|s| s.success()) && has_vulkan() {
        Ok(())
    } else {
        Err(format!(
            "The installation failed. Try it by hand:\n  {install}"
        ))
    }
}

fn succeeds(program: &str, arguments: &[&str]) -> bool {
    Command::new(program)
        .args(arguments)
        .output()
        .is_ok_and(|o| o.status.success())
}

/// A loader, and at least one driver's manifest where the loader looks for it.
fn has_vulkan() -> bool {
    let loader = [
        "/usr/lib/x86_64-linux-gnu",
        "/usr/lib/aarch64-linux-gnu",
        "/usr/lib64",
        "/usr/lib",
    ]
    .iter()
    .any(|folder| Path::new(folder).join("libvulkan.so.1").exists());
    let named = ["VK_DRIVER_FILES", "VK_ICD_FILENAMES"]
        .iter()
        .any(|name| std::env::var_os(name).is_some());
    let driver = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"]
        .iter()
        .any(|folder| std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some()));
    loader && (driver || named)
}
