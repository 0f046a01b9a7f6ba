//! README and manual: short, linked, and as the program has it.

use std::fs;
use std::path::{Path, PathBuf};

use transplat_tests::{root, run};

/// Commands of the program, whose `--help` is the reference.
const COMMANDS: [&str; 10] = [
    "relight", "render", "delight", "convert", "bake", "estimate", "light", "probe", "info",
    "report",
];

const OPTIONS: &str = "docs/reference/options.md";

/// Pages that people read, from the root.
fn pages() -> Vec<PathBuf> {
    fn walk(folder: &Path, out: &mut Vec<PathBuf>) {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                walk(&path, out);
            } else if path.extension().is_some_and(|e| e == "md") {
                out.push(path);
            }
        }
    }
    let mut out = Vec::new();
    walk(&root().join("docs"), &mut out);
    let beside = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"];
    out.extend(beside.map(|name| root().join(name)));
    out.sort();
    out
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).expect("a page")
}

/// Targets of the links of a page, without what is on the web.
fn links(text: &str) -> impl Iterator<Item = &str> {
    let after = text.split("](").skip(1);
    let targets = after.filter_map(|rest| rest.split_once(')').map(|(target, _)| target));
    // Formulas of the method have brackets, too.
    targets.filter(|target| target.contains('.') && !target.starts_with("http"))
}

#[test]
fn the_readme_is_for_a_newcomer() {
    let lines = read(&root().join("README.md")).lines().count();
    assert!(lines <= 150, "the README has {lines} lines");
}

#[test]
fn links_lead_somewhere() {
    for page in pages() {
        for link in links(&read(&page)) {
            let (file, _) = link.split_once('#').unwrap_or((link, ""));
            let target = page.parent().expect("a folder").join(file);
            assert!(target.exists(), "{}: {link} is not there", page.display());
        }
    }
}

#[test]
fn the_manual_lists_its_pages() {
    let summary = root().join("docs/SUMMARY.md");
    let text = read(&summary);
    let listed: Vec<PathBuf> = links(&text)
        .map(|link| root().join("docs").join(link))
        .collect();
    for page in pages() {
        let is_of_manual = page.starts_with(root().join("docs")) && page != summary;
        assert!(
            !is_of_manual || listed.contains(&page),
            "{} is not listed",
            page.display()
        );
    }
}

/// `UPDATE_DOCS=1` writes it.
#[test]
fn the_reference_has_the_options() {
    let mut text = String::from(
        "# Options\n\nThe program's own `--help`. Without a command it opens the window.\n",
    );
    let all = [("transplat", vec!["--help"])];
    let each = COMMANDS.map(|command| (command, vec![command, "--help"]));
    for (name, line) in all.into_iter().chain(each) {
        let help = run(&line).stdout;
        let help = String::from_utf8(help).expect("text");
        let lines = help.lines().map(str::trim_end).collect::<Vec<_>>();
        text += &format!(
            "\n## {name}\n\n```text\n{}\n```\n",
            lines.join("\n").trim_end()
        );
    }
    let page = root().join(OPTIONS);
    if std::env::var_os("UPDATE_DOCS").is_some() {
        fs::write(&page, &text).expect("room for it");
    }
    let there = fs::read_to_string(&page).unwrap_or_default();
    assert!(
        there == text,
        "{OPTIONS} is not what --help says; UPDATE_DOCS=1 writes it"
    );
}
