//! Names of objects and files.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use transplat_core::scene::Object;

/// Characters of a file's name that is made of an object's: systems have room for 255 bytes, and a character may have four.
const LONGEST_FILE_NAME: usize = 60;

/// Name of an object: the user's, or that of its splat's file without the ending.
pub fn name_of(object: &Object, asset: &Path) -> String {
    let of_file = Object {
        asset: Some(asset.to_owned()),
        ..object.clone()
    };
    of_file.called().unwrap_or_default()
}

/// File name without the ending that is valid on any system.
pub fn as_file_name(name: &str) -> String {
    let as_file = |c: char| {
        if c.is_alphanumeric() || "-_ .".contains(c) {
            c
        } else {
            '_'
        }
    };
    let file: String = name.chars().take(LONGEST_FILE_NAME).map(as_file).collect();
    // Hidden, it would not be found.
    match file.strip_prefix('.') {
        Some(rest) => format!("_{rest}"),
        None => file,
    }
}

/// Makes names distinct: one that is taken gets a number.
pub fn distinct_names(names: impl Iterator<Item = String>) -> Vec<String> {
    let mut taken = HashSet::new();
    let free = |name: String| {
        let numbered = (2..).map(|n| format!("{name}-{n}"));
        let mut free = std::iter::once(name.clone()).chain(numbered);
        free.find(|n| taken.insert(n.clone())).unwrap_or_default()
    };
    names.map(free).collect()
}

/// Where a file is that is named without its folder: beside one of some others, the first of them unless it is beside another.
pub fn beside(file: &Path, others: [Option<&Path>; 2]) -> PathBuf {
    let folders = || others.iter().flatten().filter_map(|other| other.parent());
    let mut places = folders().map(|folder| folder.join(file));
    let found = places.find(|place| place.is_file());
    let first = || folders().next().map(|folder| folder.join(file));
    found.or_else(first).unwrap_or_else(|| file.to_owned())
}
