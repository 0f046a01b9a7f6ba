//! Counts of what makes the code hard to enter. Each may only fall: lower its limit in the commit that lowers the count.

use std::collections::{BTreeMap, BTreeSet};

use syn::visit::{self, Visit};
use transplat_tests::root;

use crate::sources::{Imports, Module, imports, is_for_tests, sources};

/// Crates that are counted.
pub const CRATES: [&str; 5] = [
    "transplat-core",
    "transplat-gpu",
    "transplat-engine",
    "transplat-eval",
    "transplat",
];

/// Inherent impls that lie neither in the type's module nor in a folder below it, by type and module.
const SPREAD_IMPLS: usize = 22;

/// Functions that take a tuple.
const TUPLE_PARAMETERS: usize = 54;

/// Names of types that several modules define. Twins on the GPU and in the oracle do not count.
const SHARED_NAMES: usize = 2;

/// Doc comments whose first line does not stand alone.
const DEPENDENT_DOCS: usize = 0;

/// Modules that reach themselves, where the call of a method counts as a use of the type's module.
const MODULES_IN_RINGS: usize = 25;

/// First words that make a doc comment's first line depend on the name below it.
const DEPENDENT_WORDS: [&str; 9] = [
    "What", "Whether", "How", "Which", "Of", "And", "That", "See", "Those",
];

/// Holds a count to its limit. One that has fallen is an error too, so that it can't rise again.
fn hold(what: &str, found: &BTreeSet<String>, limit: usize) {
    let count = found.len();
    let list = || found.iter().cloned().collect::<Vec<_>>().join("\n");
    assert!(
        count <= limit,
        "{count} {what}, {limit} before:\n{}",
        list()
    );
    assert!(
        count == limit,
        "{count} {what}: lower the limit from {limit}"
    );
}

/// A name of a type, and the module that defines it.
fn types(file: &syn::File) -> impl Iterator<Item = String> {
    file.items.iter().filter_map(|item| {
        let (name, attributes) = match item {
            syn::Item::Struct(i) => (&i.ident, &i.attrs),
            syn::Item::Enum(i) => (&i.ident, &i.attrs),
            syn::Item::Trait(i) => (&i.ident, &i.attrs),
            syn::Item::Type(i) => (&i.ident, &i.attrs),
            _ => return None,
        };
        (!is_for_tests(attributes)).then(|| name.to_string())
    })
}

/// The type that an inherent impl is of, by name.
fn inherent(item: &syn::Item) -> Option<(String, &syn::ItemImpl)> {
    let syn::Item::Impl(block) = item else {
        return None;
    };
    let syn::Type::Path(of) = &*block.self_ty else {
        return None;
    };
    let name = of.path.segments.last()?.ident.to_string();
    let is_inherent = block.trait_.is_none() && !is_for_tests(&block.attrs);
    is_inherent.then_some((name, block))
}

/// The modules of a crate without their tests.
fn production(name: &str) -> BTreeMap<Module, syn::File> {
    let mut files = sources(&root().join("crates").join(name).join("src"));
    for file in files.values_mut() {
        let is_test =
            |item: &syn::Item| matches!(item, syn::Item::Mod(m) if is_for_tests(&m.attrs));
        file.items.retain(|item| !is_test(item));
    }
    files
}

#[test]
fn the_methods_of_a_type_lie_in_its_module_or_below() {
    let mut found = BTreeSet::new();
    for name in CRATES {
        let files = production(name);
        for (module, file) in &files {
            for (of, _) in file.items.iter().filter_map(inherent) {
                let defines = |(_, file): &(&Module, &syn::File)| types(file).any(|t| t == of);
                let mut homes = files.iter().filter(defines).map(|(home, _)| home);
                let is_below = homes.any(|home| module.starts_with(home));
                if !is_below {
                    found.insert(format!("{name}: {of} in {}", module.join("::")));
                }
            }
        }
    }
    hold("types with methods elsewhere", &found, SPREAD_IMPLS);
}

/// Collects functions that take a tuple.
struct Tuples(Vec<String>);

impl<'a> Visit<'a> for Tuples {
    fn visit_signature(&mut self, signature: &'a syn::Signature) {
        let is_tuple = |input: &syn::FnArg| {
            let syn::FnArg::Typed(input) = input else {
                return false;
            };
            let of = match &*input.ty {
                syn::Type::Reference(reference) => &*reference.elem,
                other => other,
            };
            matches!(of, syn::Type::Tuple(tuple) if tuple.elems.len() > 1)
        };
        if signature.inputs.iter().any(is_tuple) {
            self.0.push(signature.ident.to_string());
        }
        visit::visit_signature(self, signature);
    }
}

#[test]
fn parameters_have_names() {
    let mut found = BTreeSet::new();
    for name in CRATES {
        for (module, file) in production(name) {
            let mut tuples = Tuples(Vec::new());
            tuples.visit_file(&file);
            let named = |f: String| format!("{name}: {}::{f}", module.join("::"));
            found.extend(tuples.0.into_iter().map(named));
        }
    }
    hold("functions that take a tuple", &found, TUPLE_PARAMETERS);
}

#[test]
fn one_name_is_one_type() {
    let mut homes = BTreeMap::<(&str, String), BTreeSet<String>>::new();
    for name in CRATES {
        for (module, file) in production(name) {
            let group = match (name, module.first().map(String::as_str)) {
                (_, Some("oracle")) => "oracle",
                ("transplat-gpu", _) => "gpu",
                _ => "",
            };
            for of in types(&file) {
                let home = format!("{name}::{}", module.join("::"));
                homes.entry((group, of)).or_default().insert(home);
            }
        }
    }
    homes.retain(|_, homes| homes.len() > 1);
    let told = homes
        .into_iter()
        .map(|((_, of), homes)| format!("{of}: {homes:?}"));
    hold("names of several types", &told.collect(), SHARED_NAMES);
}

#[test]
fn doc_comments_stand_alone() {
    let mut found = BTreeSet::new();
    for name in CRATES {
        let source = root().join("crates").join(name).join("src");
        for module in production(name).into_keys() {
            let mut path = source.join(module.join("/")).with_extension("rs");
            if module.is_empty() {
                path = source.join("lib.rs");
            }
            let text = std::fs::read_to_string(&path).expect("a source");
            let docs = text
                .split("#[cfg(test)]")
                .next()
                .unwrap_or_default()
                .lines();
            let docs = docs.map(|l| l.trim_start().strip_prefix("///").map(str::trim_start));
            let mut before = None;
            for (line, doc) in docs.enumerate() {
                let first = |d: &str| DEPENDENT_WORDS.contains(&d.split(' ').next().unwrap_or(d));
                let is_dependent = |d: &&str| first(d) || d.starts_with("The same");
                if before.is_none() {
                    let named = |d| format!("{name}: {}:{}: {d}", module.join("::"), line + 1);
                    found.extend(doc.filter(is_dependent).map(named));
                }
                before = doc;
            }
        }
    }
    hold(
        "doc comments that do not stand alone",
        &found,
        DEPENDENT_DOCS,
    );
}

/// The names of all methods that are called.
struct Calls(BTreeSet<String>);

impl<'a> Visit<'a> for Calls {
    fn visit_expr_method_call(&mut self, call: &'a syn::ExprMethodCall) {
        self.0.insert(call.method.to_string());
        visit::visit_expr_method_call(self, call);
    }
}

/// The modules that define each method, of all crates.
fn methods() -> BTreeMap<String, BTreeSet<(&'static str, Module)>> {
    let mut homes = BTreeMap::<String, BTreeSet<_>>::new();
    for name in CRATES {
        for (module, file) in production(name) {
            for (_, block) in file.items.iter().filter_map(inherent) {
                for item in &block.items {
                    if let syn::ImplItem::Fn(method) = item {
                        let of = homes.entry(method.sig.ident.to_string()).or_default();
                        of.insert((name, module.clone()));
                    }
                }
            }
        }
    }
    homes
}

/// Adds the modules whose methods each module of a crate calls. Only names of several words that one module defines are sure to be its own:
/// `get` is everybody's.
fn add_calls(name: &'static str, uses: &mut Imports) {
    let homes = methods();
    for (module, file) in production(name) {
        let mut calls = Calls(BTreeSet::new());
        calls.visit_file(&file);
        let own = calls.0.iter().filter(|name| name.contains('_'));
        for homes in own.filter_map(|name| homes.get(name)) {
            if let (1, Some((of, home))) = (homes.len(), homes.first())
                && *of == name
                && *home != module
            {
                uses.entry(module.clone()).or_default().insert(home.clone());
            }
        }
    }
}

/// Modules that reach themselves.
fn in_rings(imports: &Imports) -> BTreeSet<Module> {
    let reaches_itself = |start: &Module| {
        let mut seen = BTreeSet::new();
        let mut next: Vec<&Module> = imports[start].iter().collect();
        while let Some(module) = next.pop() {
            if seen.insert(module) {
                next.extend(imports.get(module).into_iter().flatten());
            }
        }
        seen.contains(start)
    };
    imports
        .keys()
        .filter(|m| reaches_itself(m))
        .cloned()
        .collect()
}

#[test]
fn modules_in_rings_by_methods_only_fall() {
    let mut found = BTreeSet::new();
    for name in CRATES {
        let source = root().join("crates").join(name).join("src");
        let mut uses = imports(&source);
        add_calls(name, &mut uses);
        let named = |m: Module| format!("{name}: {}", m.join("::"));
        found.extend(in_rings(&uses).into_iter().map(named));
    }
    hold("modules in rings", &found, MODULES_IN_RINGS);
}
