//! The order of the house: each module can be explained by those below it, and what is built with is free.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;
use std::process::Command;

use syn::visit::{self, Visit};
use transplat_tests::root;

/// A module by its names from the crate's root on.
type Module = Vec<String>;

/// Which modules each one takes something from.
type Imports = BTreeMap<Module, BTreeSet<Module>>;

/// The modules of a crate: one a file.
fn modules(folder: &Path, of: &Module, out: &mut BTreeMap<Module, syn::File>) {
    for entry in fs::read_dir(folder).expect("a folder").flatten() {
        let path = entry.path();
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut module = of.clone();
        if path.is_dir() {
            module.push(name.into_owned());
            modules(&path, &module, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            if !["lib", "main"].contains(&&*name) {
                module.push(name.into_owned());
            }
            let text = fs::read_to_string(&path).expect("a source");
            out.insert(module, syn::parse_file(&text).expect("it compiles"));
        }
    }
}

/// Whether an item is there for tests alone: they may look at anything.
fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
    let is_cfg_test = |a: &syn::Attribute| {
        a.path().is_ident("cfg") && a.parse_args::<syn::Ident>().is_ok_and(|i| i == "test")
    };
    attributes.iter().any(is_cfg_test)
}

/// Modules within a file's, and whether one is for tests.
fn children(file: &syn::File) -> impl Iterator<Item = (String, bool)> {
    file.items.iter().filter_map(|item| match item {
        syn::Item::Mod(m) => Some((m.ident.to_string(), is_for_tests(&m.attrs))),
        _ => None,
    })
}

/// Collects all paths of a file that is no test.
#[derive(Default)]
struct Paths(Vec<Vec<String>>);

impl Paths {
    fn add_tree(&mut self, tree: &syn::UseTree, mut before: Vec<String>) {
        match tree {
            syn::UseTree::Path(path) => {
                before.push(path.ident.to_string());
                self.add_tree(&path.tree, before);
            }
            syn::UseTree::Group(group) => {
                for tree in &group.items {
                    self.add_tree(tree, before.clone());
                }
            }
            syn::UseTree::Name(syn::UseName { ident })
            | syn::UseTree::Rename(syn::UseRename { ident, .. }) => {
                before.push(ident.to_string());
                self.0.push(before);
            }
            syn::UseTree::Glob(_) => self.0.push(before),
        }
    }
}

impl<'a> Visit<'a> for Paths {
    fn visit_item(&mut self, item: &'a syn::Item) {
        let attributes: &[syn::Attribute] = match item {
            syn::Item::Mod(m) => &m.attrs,
            syn::Item::Fn(f) => &f.attrs,
            syn::Item::Impl(i) => &i.attrs,
            syn::Item::Use(u) => &u.attrs,
            _ => &[],
        };
        if !is_for_tests(attributes) {
            visit::visit_item(self, item);
        }
    }

    // Who may see an item is nothing that it takes.
    fn visit_visibility(&mut self, _: &'a syn::Visibility) {}

    fn visit_item_use(&mut self, item: &'a syn::ItemUse) {
        self.add_tree(&item.tree, Vec::new());
    }

    fn visit_path(&mut self, path: &'a syn::Path) {
        let names = path.segments.iter().map(|s| s.ident.to_string());
        self.0.push(names.collect());
        visit::visit_path(self, path);
    }
}

/// What each module of a crate takes from which others. What macros are given is not seen, nor what is reached through the name of an
/// imported module.
fn imports(source: &Path) -> Imports {
    let mut files = BTreeMap::new();
    modules(source, &Vec::new(), &mut files);
    let mut tests = BTreeSet::new();
    for (module, file) in &files {
        for (child, _) in children(file).filter(|(_, is_test)| *is_test) {
            tests.insert([module.clone(), vec![child]].concat());
        }
    }
    files.retain(|module, _| !tests.iter().any(|t| module.starts_with(t)));
    let of = |(module, file): (&Module, &syn::File)| {
        let mut paths = Paths::default();
        paths.visit_file(file);
        let within: BTreeSet<String> = children(file).map(|(name, _)| name).collect();
        let taken = paths.0.into_iter().filter_map(|path| {
            let (first, rest) = path.split_first()?;
            let mut full = match first.as_str() {
                "crate" => Vec::new(),
                "self" => module.clone(),
                "super" => module[..module.len().saturating_sub(1)].to_vec(),
                name if within.contains(name) => [module.clone(), vec![first.clone()]].concat(),
                _ => return None,
            };
            for name in rest {
                match name.as_str() {
                    "super" => drop(full.pop()),
                    _ => full.push(name.clone()),
                }
            }
            // The module whose item it is; the crate's root only lists them.
            while !full.is_empty() && !files.contains_key(&full) {
                full.pop();
            }
            (!full.is_empty() && full != *module).then_some(full)
        });
        (module.clone(), taken.collect())
    };
    files.iter().map(of).collect()
}

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
    for name in ["transplat-core", "transplat-gpu", "transplat"] {
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
    for folder in ["transplat-core/src/files", "transplat/src"] {
        let mut files = BTreeMap::new();
        modules(&root().join("crates").join(folder), &Vec::new(), &mut files);
        for (module, file) in &files {
            let is_test = module.iter().any(|m| m == "tests" || m == "fuzz");
            let mut paths = Paths::default();
            paths.visit_file(file);
            if !is_test && paths.0.iter().any(|path| calls(path)) {
                callers.insert(module.join("::"));
            }
        }
    }
    // Those besides read what the program itself wrote or is built with.
    let known = [
        "cli::values",
        "decode",
        "decode::json",
        "commands::batch",
        "commands::info",
        "viewer::app",
        "viewer::history",
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

/// What `cargo deny check licenses sources` asks, which is not there everywhere.
#[test]
fn all_that_the_program_is_built_with_is_free_and_from_the_registry() {
    let rules = fs::read_to_string(root().join("deny.toml")).expect("the rules");
    let allowed: BTreeSet<&str> = (rules.lines())
        .filter_map(|line| line.trim().strip_prefix('"')?.strip_suffix("\","))
        .collect();
    assert!(allowed.contains("MIT"), "{allowed:?}");
    let mut metadata = Command::new(env!("CARGO"));
    let arguments = "metadata --format-version 1 --locked --offline";
    metadata.current_dir(root()).args(arguments.split(' '));
    let told = metadata.output().expect("cargo");
    let why = String::from_utf8_lossy(&told.stderr);
    assert!(told.status.success(), "`cargo fetch --locked` first: {why}");
    let told: serde_json::Value = serde_json::from_slice(&told.stdout).expect("JSON");
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
