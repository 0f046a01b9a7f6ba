//! Packages: a `.deb` for Debian, an archive and an AppImage for any other Linux.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use crate::manual::{manual, tool};
use crate::setup::{DRIVER, WINDOW};
use crate::{Outcome, command, must, root};

/// Where they are made, in the root.
const OUT: &str = "target/dist";

/// What of the assets the program opens; the rest is the README's.
const ASSETS: [&str; 8] = [
    "README.md",
    "breakfast.ply",
    "breakfast_cameras.json",
    "city.hdr",
    "interior.hdr",
    "sunset.hdr",
    "teapot.ply",
    "teapot_cameras.json",
];

/// Builds the program and packs it: `transplat_VERSION_ARCHITECTURE.deb`, and `transplat-VERSION-MACHINE-linux.tar.gz` with the same
/// tree, which runs from wherever it is unpacked.
pub fn dist() -> Outcome {
    if !cfg!(target_os = "linux") {
        return Err("packages are made on Linux; elsewhere build the program: cargo build --release --package transplat (see the README)".into());
    }
    // Where it is looked for below, whatever the user's own folder is.
    let build = "cargo build --release --locked --package transplat --target-dir target";
    must(build, &[])?;
    let version = env!("CARGO_PKG_VERSION");
    let machine = std::env::consts::ARCH;
    let name = format!("transplat-{version}-{machine}-linux");
    remove(&root().join(OUT))?;
    let tree = root().join(OUT).join(&name);
    lay(&tree, &format!("{OUT}/{name}"))?;
    // Whatever the builder's own files are.
    must(&format!("chmod -R u=rwX,go=rX {OUT}/{name}"), &[])?;
    let archive = format!("{OUT}/{name}.tar.gz");
    // No owner's name, no times but the commit's.
    let time = output("git", &["log", "-1", "--format=%ct"]).unwrap_or_else(|_| "0".into());
    let time = time.trim();
    must(
        &format!(
            "tar --create --gzip --file {archive} --sort=name --owner=0 --group=0 --numeric-owner --mtime=@{time} --directory {OUT} {name}"
        ),
        &[],
    )?;
    let package = deb(&tree, version, time)?;
    let mut made = vec![package.clone(), archive.clone()];
    made.extend(app_image(&tree, &name)?);
    checksums(&made)?;
    let size = |path: &str| fs::metadata(root().join(path)).map_or(0, |m| m.len() / 1_000_000);
    println!(
        "\n{package}  {} MB: sudo apt install ./{package}\n{archive}  {} MB: unpack, then start bin/transplat in it\n{OUT}/SHA256SUMS",
        size(&package),
        size(&archive)
    );
    Ok(())
}

/// An AppImage of a tree, where the program appimagetool is installed.
fn app_image(tree: &Path, name: &str) -> Result<Option<String>, String> {
    if output("appimagetool", &["--version"]).is_err() {
        println!("appimagetool is not installed: no AppImage is made");
        return Ok(None);
    }
    let folder = format!("{OUT}/AppDir");
    let packed = root().join(&folder);
    copy_folder(tree, &packed.join("usr"))?;
    let package = root().join("crates/xtask/package");
    copy(
        &package.join("transplat.desktop"),
        &packed.join("transplat.desktop"),
    )?;
    copy(
        &root().join("assets/icon.svg"),
        &packed.join("transplat.svg"),
    )?;
    write(
        &packed.join("AppRun"),
        "#!/bin/sh\nexec \"$(dirname \"$(readlink -f \"$0\")\")/usr/bin/transplat\" \"$@\"\n",
    )?;
    must(&format!("chmod 755 {folder}/AppRun"), &[])?;
    let image = format!("{OUT}/{name}.AppImage");
    must(
        &format!("appimagetool --no-appstream {folder} {image}"),
        &[],
    )?;
    remove(&packed)?;
    Ok(Some(image))
}

/// Writes the SHA-256 sums of files beside them.
fn checksums(files: &[String]) -> Outcome {
    let names = files.iter().filter_map(|file| file.strip_prefix(OUT));
    let names: Vec<&str> = names.map(|name| name.trim_start_matches('/')).collect();
    println!("> sha256sum");
    let sums = command("sha256sum", &names)
        .current_dir(root().join(OUT))
        .output()
        .map_err(|e| format!("sha256sum could not be started: {e}"))?;
    if !sums.status.success() {
        return Err(format!("sha256sum failed: {}", sums.status));
    }
    let text = String::from_utf8(sums.stdout).map_err(|e| e.to_string())?;
    write(&root().join(OUT).join("SHA256SUMS"), &text)
}

/// Lays the files as they lie in `/usr`; `from_root` is where that is as commands say it.
fn lay(tree: &Path, from_root: &str) -> Outcome {
    copy(
        &root().join("target/release/transplat"),
        &tree.join("bin/transplat"),
    )?;
    must(&format!("strip {from_root}/bin/transplat"), &[])?;
    let share = tree.join("share");
    let assets = share.join("transplat/assets");
    for name in ASSETS {
        copy(&root().join("assets").join(name), &assets.join(name))?;
    }
    copy_folder(&root().join("assets/languages"), &assets.join("languages"))?;
    copy_folder(&root().join("assets/truth"), &assets.join("truth"))?;
    // The first picture waits for no bake.
    for splat in ["teapot.ply", "breakfast.ply"] {
        let splat = format!("{from_root}/share/transplat/assets/{splat}");
        let program = format!("{from_root}/bin/transplat");
        let line = format!("{program} bake {splat} -o {splat}.best.bake --device cpu --quiet");
        must(&line, &[])?;
    }
    manual()?;
    copy_folder(&root().join("target/manual"), &assets.join("manual"))?;
    let program = format!("{from_root}/bin/transplat");
    must(&format!("{program} man {from_root}/share/man/man1"), &[])?;
    for (shell, file) in [
        ("bash", "bash-completion/completions/transplat"),
        ("zsh", "zsh/site-functions/_transplat"),
        ("fish", "fish/vendor_completions.d/transplat.fish"),
    ] {
        write(
            &share.join(file),
            &output(&program, &["completions", shell])?,
        )?;
    }
    let package = root().join("crates/xtask/package");
    for (from, to) in [
        (
            package.join("transplat.desktop"),
            "applications/transplat.desktop",
        ),
        (package.join("transplat.xml"), "mime/packages/transplat.xml"),
        (
            root().join("assets/icon.svg"),
            "icons/hicolor/scalable/apps/transplat.svg",
        ),
        (
            root().join("assets/icon.png"),
            "icons/hicolor/128x128/apps/transplat.png",
        ),
        (root().join("README.md"), "doc/transplat/README.md"),
        (root().join("CHANGELOG.md"), "doc/transplat/CHANGELOG.md"),
        (root().join("LICENSE"), "doc/transplat/copyright"),
    ] {
        copy(&from, &share.join(to))?;
    }
    write(&share.join("doc/transplat/third_party.txt"), &licences()?)
}

/// The Debian package of a tree, and its name.
fn deb(tree: &Path, version: &str, time: &str) -> Result<String, String> {
    let architecture = match std::env::consts::ARCH {
        "x86_64" => "amd64",
        "aarch64" => "arm64",
        other => other,
    };
    let packed = root().join(OUT).join("deb");
    fs::create_dir_all(packed.join("DEBIAN")).map_err(|e| e.to_string())?;
    copy_folder(tree, &packed.join("usr"))?;
    // Debian's zsh looks there.
    let zsh = packed.join("usr/share/zsh");
    fs::rename(zsh.join("site-functions"), zsh.join("vendor-completions"))
        .map_err(|e| format!("{}: {e}", zsh.display()))?;
    let libraries = WINDOW.iter().map(|(package, _)| (*package).to_owned());
    let depends: Vec<String> = [
        format!("libc6 (>= {})", needed_glibc(&tree.join("bin/transplat"))?),
        "libgcc-s1".into(),
    ]
    .into_iter()
    .chain(libraries)
    .collect();
    let kilobytes = size_of_folder(tree)? / 1024;
    write(
        &packed.join("DEBIAN/control"),
        &format!(
            "Package: transplat
Version: {version}
Architecture: {architecture}
Maintainer: The transplat developers <transplat@localhost>
Installed-Size: {kilobytes}
Depends: {}
Recommends: {}, xdg-desktop-portal
Suggests: ffmpeg
Section: graphics
Priority: optional
Description: see a captured object under another light
 An interactive viewer with live relighting of Gaussian splats, and a command
 line that relights and draws them. From a trained splat and the light that it
 was captured in, it shows the object under any other light, at once.
",
            depends.join(", "),
            DRIVER.join(", "),
        ),
    )?;
    let package = format!("{OUT}/transplat_{version}_{architecture}.deb");
    println!("> dpkg-deb --build {package}");
    let built = command(
        "dpkg-deb",
        &[
            "--build",
            "--root-owner-group",
            &format!("{OUT}/deb"),
            &package,
        ],
    )
    .env("SOURCE_DATE_EPOCH", time)
    .status();
    remove(&packed)?;
    match built {
        Ok(status) if status.success() => Ok(package),
        Ok(status) => Err(format!("dpkg-deb failed: {status}")),
        Err(error) => Err(format!("dpkg-deb could not be started: {error}")),
    }
}

/// The newest version of the C library that a program names: `GLIBC_2.34` is 2.34.
fn needed_glibc(program: &Path) -> Result<String, String> {
    let bytes = fs::read(program).map_err(|e| format!("{}: {e}", program.display()))?;
    let newest = glibc_versions(&bytes).max().unwrap_or((2, 17));
    Ok(format!("{}.{}", newest.0, newest.1))
}

fn glibc_versions(bytes: &[u8]) -> impl Iterator<Item = (u32, u32)> {
    const NAME: &[u8] = b"GLIBC_";
    let found = bytes.windows(NAME.len()).enumerate();
    let starts = found
        .filter(|(_, w)| *w == NAME)
        .map(|(i, _)| i + NAME.len());
    starts.filter_map(|start| {
        let rest = &bytes[start..];
        let end = rest.iter().position(|b| *b == 0)?;
        let (major, minor) = std::str::from_utf8(&rest[..end]).ok()?.split_once('.')?;
        let minor = minor.split('.').next()?;
        Some((major.parse().ok()?, minor.parse().ok()?))
    })
}

/// Licences of all crates that are linked in, each text once, by cargo-about.
fn licences() -> Result<String, String> {
    let about = tool("cargo-about", "0.9.3", "--features cli")?;
    let about = about.display().to_string();
    let template = "crates/xtask/package/about.hbs";
    let line = [
        "generate",
        "--locked",
        "--fail",
        "--config",
        "about.toml",
        "--manifest-path",
        "crates/transplat/Cargo.toml",
        template,
    ];
    output(&about, &line)
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, String> {
    let read = fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))?;
    let mut paths: Vec<PathBuf> = read.flatten().map(|e| e.path()).collect();
    paths.sort();
    Ok(paths)
}

fn copy(from: &Path, to: &Path) -> Outcome {
    let folder = to.parent().unwrap_or(to);
    let copied = fs::create_dir_all(folder).and_then(|()| fs::copy(from, to));
    let told = |e| format!("{}: {e}", from.display());
    copied.map(|_| ()).map_err(told)
}

fn copy_folder(from: &Path, to: &Path) -> Outcome {
    for path in entries(from)? {
        let to = to.join(path.file_name().unwrap_or_default());
        if path.is_dir() {
            copy_folder(&path, &to)?;
        } else {
            copy(&path, &to)?;
        }
    }
    Ok(())
}

fn size_of_folder(folder: &Path) -> Result<u64, String> {
    let mut bytes = 0;
    for path in entries(folder)? {
        bytes += if path.is_dir() {
            size_of_folder(&path)?
        } else {
            fs::metadata(&path).map_err(|e| e.to_string())?.len()
        };
    }
    Ok(bytes)
}

fn write(path: &Path, text: &str) -> Outcome {
    let folder = path.parent().unwrap_or(path);
    let written = fs::create_dir_all(folder).and_then(|()| fs::write(path, text));
    written.map_err(|e| format!("{}: {e}", path.display()))
}

fn remove(folder: &Path) -> Outcome {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(format!("{}: {error}", folder.display()))
        }
        _ => Ok(()),
    }
}

/// What a command prints.
fn output(program: &str, arguments: &[&str]) -> Result<String, String> {
    let output = command(program, arguments)
        .output()
        .map_err(|e| format!("{program} could not be started: {e}"))?;
    if !output.status.success() {
        let why = String::from_utf8_lossy(&output.stderr);
        return Err(format!("{program} failed: {}\n{why}", output.status));
    }
    String::from_utf8(output.stdout).map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_newest_version_of_the_c_library_is_asked_for() {
        let names = b"\0GLIBC_2.2.5\0GLIBC_2.34\0GLIBC_2.9\0GLIBC_PRIVATE\0";
        assert_eq!(super::glibc_versions(names).max(), Some((2, 34)));
    }
}
