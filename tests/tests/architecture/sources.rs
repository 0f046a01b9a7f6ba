//! The modules of a crate as syntax trees, and what they take from each other.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use syn::visit::{self, Visit};

/// A module by its names from the crate's root on.
pub type Module = Vec<String>;

/// Which modules each one takes something from.
pub type Imports = BTreeMap<Module, BTreeSet<Module>>;

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
pub fn is_for_tests(attributes: &[syn::Attribute]) -> bool {
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
pub struct Paths(pub Vec<Vec<String>>);

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

/// The modules of a crate but those for tests alone.
pub fn sources(source: &Path) -> BTreeMap<Module, syn::File> {
    let mut files = BTreeMap::new();
    modules(source, &Vec::new(), &mut files);
    let mut tests = BTreeSet::new();
    for (module, file) in &files {
        for (child, _) in children(file).filter(|(_, is_test)| *is_test) {
            tests.insert([module.clone(), vec![child]].concat());
        }
    }
    files.retain(|module, _| !tests.iter().any(|t| module.starts_with(t)));
    files
}

/// The modules that each module of a crate uses. What macros are given is not seen, nor what is reached through the name of an imported
/// module.
pub fn imports(source: &Path) -> Imports {
    let files = sources(source);
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
