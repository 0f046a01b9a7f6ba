//! The order of the workspace: which crate and module may use which, and counts that may only fall.

mod page;
mod ratchets;
mod sources;

use std::collections::BTreeSet;
use std::fs;
use std::process::Command;

use syn::visit::Visit;
use transplat_tests::root;

use ratchets::CRATES;
use sources::{Imports, Module, Paths, imports, sources};

/// What is left when modules that take nothing from what is left are taken away: the rings, and what stands on them.
fn left_in_rings(mut imports: Imports) -> Imports {
    loop {
        let standing: BTreeSet<Module> = imports.keys().cloned().collect();
        let before = imports.len();
        imports.retain(|_, taken| taken.iter().any(|t| standing.contains(t)));
        if imports.len() == before {
            return imports;
        }
    }
}

#[test]
fn no_module_is_explained_by_itself() {
    for name in CRATES {
        let found = imports(&root().join("crates").join(name).join("src"));
        assert!(found.len() > 10, "{name}: {found:?}");
        let edges: usize = found.values().map(BTreeSet::len).sum();
        assert!(edges > found.len(), "{name}: the imports were not read");
        let rings = left_in_rings(found);
        assert!(rings.is_empty(), "{name} has modules in rings: {rings:#?}");
    }
}

/// Third-party decoders panic on some files and allocate what others claim: `files::decode` is where they are called, and nowhere else.
#[test]
fn decoders_are_called_through_their_guard_alone() {
    const DECODERS: [&str; 9] = [
        "ImageReader",
        "ImageDecoder",
        "ZipArchive",
        "GzDecoder",
        "ZlibDecoder",
        "StreamingDecoder",
        "MetaData",
        "UncompressedBlock",
        "STANDARD",
    ];
    let calls = |path: &[String]| {
        let has = |name: &str| path.iter().any(|p| p == name);
        let is_json = has("serde_json") && path.last().is_some_and(|f| f.starts_with("from_"));
        is_json || DECODERS.into_iter().any(has) || path.first().is_some_and(|p| p == "ruzstd")
    };
    let mut callers = BTreeSet::new();
    for name in CRATES {
        for (module, file) in &sources(&root().join("crates").join(name).join("src")) {
            let is_test = module.iter().any(|m| m == "tests" || m == "fuzz");
            let mut paths = Paths::default();
            paths.visit_file(file);
            if !is_test && paths.0.iter().any(|path| calls(path)) {
                callers.insert(format!("{name}::{}", module.join("::")));
            }
        }
    }
    // Those besides read what the program itself wrote or is built with.
    let known = [
        "transplat::cli::values",
        "transplat-core::files::decode",
        "transplat-core::files::decode::json",
        "transplat::commands::batch",
        "transplat::commands::info",
        "transplat::viewer::app",
        "transplat::viewer::history",
    ];
    let known: BTreeSet<String> = known.map(String::from).into();
    assert_eq!(callers, known);
}

#[test]
fn a_ring_is_found() {
    let of = |name: &str, taken: &[&str]| {
        let module = |name: &str| vec![name.to_owned()];
        (module(name), taken.iter().map(|t| module(t)).collect())
    };
    let ring = [of("a", &["b"]), of("b", &["a", "c"]), of("c", &[])];
    assert_eq!(left_in_rings(ring.into_iter().collect()).len(), 2);
    let line = [of("a", &["b"]), of("b", &["c"]), of("c", &[])];
    assert!(left_in_rings(line.into_iter().collect()).is_empty());
}

/// The workspace and all that it is built with, as `cargo metadata` gives it.
fn metadata() -> serde_json::Value {
    let mut metadata = Command::new(env!("CARGO"));
    let arguments = "metadata --format-version 1 --locked --offline";
    metadata.current_dir(root()).args(arguments.split(' '));
    let told = metadata.output().expect("cargo");
    let why = String::from_utf8_lossy(&told.stderr);
    assert!(told.status.success(), "`cargo fetch --locked` first: {why}");
    serde_json::from_slice(&told.stdout).expect("JSON")
}

/// Mathematics and files need no GPU, the GPU no window, the engine neither a window nor a command line.
#[test]
fn crates_use_what_is_listed() {
    let told = metadata();
    let packages = told["packages"].as_array().expect("packages");
    let uses = |name: &str| -> BTreeSet<&str> {
        let is_it = |p: &&serde_json::Value| p["name"] == name;
        let package = packages.iter().find(is_it).expect("a crate of ours");
        let each = package["dependencies"].as_array().expect("dependencies");
        let each = each.iter().filter(|d| d["kind"].is_null());
        each.filter_map(|d| d["name"].as_str()).collect()
    };
    let own = |name: &str| -> Vec<&str> {
        let own = uses(name).into_iter();
        own.filter(|d| d.starts_with("transplat")).collect()
    };
    assert_eq!(own("transplat-core"), [""; 0]);
    assert_eq!(own("transplat-gpu"), ["transplat-core"]);
    assert_eq!(own("transplat-engine"), ["transplat-core", "transplat-gpu"]);
    assert_eq!(
        own("transplat-eval"),
        ["transplat-core", "transplat-engine"]
    );
    let all = [
        "transplat-core",
        "transplat-engine",
        "transplat-eval",
        "transplat-gpu",
    ];
    assert_eq!(own("transplat"), all);
    for windowed in ["wgpu", "eframe", "egui", "winit", "rfd", "clap"] {
        for name in all {
            let is_adapter = windowed == "wgpu" && name == "transplat-gpu";
            let is_used = uses(name).contains(windowed) && !is_adapter;
            assert!(!is_used, "{name} uses {windowed}");
        }
    }
}

/// What `cargo deny check licenses sources` asks, which is not there everywhere.
#[test]
fn all_that_the_program_is_built_with_is_free_and_from_the_registry() {
    let rules = fs::read_to_string(root().join("deny.toml")).expect("the rules");
    let allowed: BTreeSet<&str> = (rules.lines())
        .filter_map(|line| line.trim().strip_prefix('"')?.strip_suffix("\","))
        .collect();
    assert!(allowed.contains("MIT"), "{allowed:?}");
    let told = metadata();
    let packages = told["packages"].as_array().expect("packages");
    assert!(packages.len() > 100);
    for package in packages {
        let name = package["name"].as_str().expect("a name");
        let license = package["license"].as_str().unwrap_or_default();
        // One of each group.
        let is_free = license.split(" AND ").all(|group| {
            let group = group.trim_matches(['(', ')']);
            let mut either = group.split(" OR ").flat_map(|l| l.split('/'));
            either.any(|l| allowed.contains(l.trim()))
        });
        assert!(is_free, "{name}: {license}");
        let source = package["source"].as_str();
        assert!(
            source.is_none_or(|s| s == "registry+https://github.com/rust-lang/crates.io-index"),
            "{name}: {source:?}"
        );
    }
}
