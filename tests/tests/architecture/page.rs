//! `ARCHITECTURE.md` lists crates and folders as their `//!` lines describe them.

use std::fs;
use std::path::{Path, PathBuf};

use transplat_tests::root;

use crate::ratchets::CRATES;

const BEGIN: &str = "<!-- written by UPDATE_ARCHITECTURE=1 cargo test --package transplat-tests --test architecture -->\n";
const END: &str = "<!-- end -->\n";

/// The first sentence of a module's `//!` lines.
fn description(file: &Path) -> String {
    let text = fs::read_to_string(file).expect("a source");
    let lines = text.lines().skip_while(|line| !line.starts_with("//!"));
    let paragraph = lines.map_while(|line| line.strip_prefix("//! "));
    let text = paragraph.collect::<Vec<_>>().join(" ");
    let sentence = text.split_once(". ").map_or(&*text, |(first, _)| first);
    format!("{}.", sentence.trim_end_matches('.')).replace(['[', ']'], "")
}

/// The folders of a crate's sources that have a module of their name, sorted.
fn folders(folder: &Path, out: &mut Vec<PathBuf>) {
    let entries = fs::read_dir(folder).expect("a folder").flatten();
    let mut paths: Vec<_> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths.into_iter().filter(|path| path.is_dir()) {
        if path.with_extension("rs").is_file() {
            out.push(path.clone());
        }
        folders(&path, out);
    }
}

fn listed() -> String {
    let mut out = String::from(BEGIN);
    for name in CRATES {
        let source = root().join("crates").join(name).join("src");
        out += &format!(
            "\n**`{name}`**: {}\n\n",
            description(&source.join("lib.rs"))
        );
        let mut all = Vec::new();
        folders(&source, &mut all);
        for folder in all {
            let what = description(&folder.with_extension("rs"));
            let path = folder.strip_prefix(&source).expect("below").display();
            out += &format!("- `{path}/` {what}\n");
        }
    }
    out + "\n" + END
}

#[test]
fn the_page_lists_crates_and_folders_as_they_describe_themselves() {
    let page = root().join("ARCHITECTURE.md");
    let text = fs::read_to_string(&page).expect("the page");
    let (before, rest) = text.split_once(BEGIN).expect("the list begins");
    let (_, after) = rest.split_once(END).expect("the list ends");
    let expected = [before, &listed(), after].concat();
    if std::env::var_os("UPDATE_ARCHITECTURE").is_some() {
        fs::write(&page, &expected).expect("it is written");
    }
    let text = fs::read_to_string(&page).expect("the page");
    assert!(text == expected, "UPDATE_ARCHITECTURE=1 writes the list");
}

/// A file that the page names is there.
#[test]
fn the_page_names_files_that_exist() {
    let text = fs::read_to_string(root().join("ARCHITECTURE.md")).expect("the page");
    let places: Vec<_> = (CRATES.iter().map(|name| format!("crates/{name}/src")))
        .chain(["crates", "", "tests", "shaders"].map(String::from))
        .map(|place| root().join(place))
        .collect();
    let mut count = 0;
    for name in text.split('`').skip(1).step_by(2) {
        let is_file = [".rs", ".wgsl", "/"].iter().any(|end| name.ends_with(end));
        if is_file && !name.contains(['{', '*', ' ']) {
            count += 1;
            let is_there = places.iter().any(|place| place.join(name).exists());
            assert!(is_there, "{name} is nowhere");
        }
    }
    assert!(count > 60, "{count} names were found");
}
