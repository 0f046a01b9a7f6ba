//! README and manual: short, linked, and as the program has it.

use std::fs;
use std::path::{Path, PathBuf};

use transplat_tests::{root, run};

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
            // The manual is packed without what is around it.
            let manual = root().join("docs");
            let target = target.canonicalize().expect("it is there");
            let stays = !page.starts_with(&manual) || target.starts_with(&manual);
            assert!(stays, "{}: {link} leaves the manual", page.display());
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

/// Commands of the program, as its help lists them.
fn commands() -> Vec<String> {
    let help = String::from_utf8(run(&["--help"]).stdout).expect("text");
    let listed = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    let listed = listed.take_while(|line| !line.is_empty());
    let names = listed.filter_map(|line| line.split_whitespace().next());
    let names = names.filter(|name| *name != "help").map(str::to_owned);
    names.collect()
}

/// Words that an artist would not search for.
const BANNED: &str = "surfel surfels told tell tells doubt doubts beam beams veil veils shelf picture pictures film films gloss shine shines \
    faint awaited asset";

/// Most words of a sentence.
const LONGEST: usize = 25;

/// Texts for users: of the window, the README and the guide, without code.
fn texts() -> Vec<(String, String)> {
    let window = root().join("assets/languages/transplat.pot");
    let quoted = |line: &str| {
        let line = line.strip_prefix("msgid ").unwrap_or(line);
        line.strip_prefix('"')?.strip_suffix('"').map(str::to_owned)
    };
    let pot = read(&window);
    let mut out: Vec<(String, String)> = pot
        .split("\n\n")
        .map(|entry| entry.lines().filter_map(quoted).collect::<String>())
        .map(|text| ("window".into(), text.replace("\\n", "\n")))
        .collect();
    for page in pages() {
        let name = page.strip_prefix(root()).expect("of the project");
        let is_guide = name.starts_with("docs/guide") || name.ends_with("README.md");
        let mut is_code = false;
        for line in read(&page).lines().filter(|_| is_guide) {
            is_code ^= line.starts_with("```");
            if is_code || line.starts_with("    ") || line.starts_with("```") {
                continue;
            }
            let spoken = line.split('`').step_by(2).collect::<Vec<_>>().join("code");
            out.push((name.display().to_string(), spoken));
        }
    }
    out
}

#[test]
fn texts_for_users_are_in_the_words_of_the_field() {
    let mut found = Vec::new();
    for (place, text) in texts() {
        // Names of values and files are not read.
        let text = text.split(['{', '}']).step_by(2).collect::<String>();
        let text = text.replace("](", "] (").replace("assets/", "");
        let words = text.split(|c: char| !c.is_alphabetic());
        let banned = words.map(str::to_lowercase);
        let banned = banned.filter(|word| BANNED.split_whitespace().any(|b| b == word));
        found.extend(banned.map(|word| format!("{place}: {word}: {text}")));
        let sentences = text.split(['.', '!', '?', ';', ':', '\n', '|']);
        for sentence in sentences.filter(|s| s.split_whitespace().count() > LONGEST) {
            found.push(format!("{place}: long: {sentence}"));
        }
    }
    assert!(found.is_empty(), "{}", found.join("\n"));
}

/// `UPDATE_DOCS=1` writes it.
#[test]
fn the_reference_has_the_options() {
    let mut text = String::from(
        "# Options\n\nThe program's own `--help`. Without a command it opens the window.\n",
    );
    let all = [("transplat", vec!["--help"])];
    let commands = commands();
    let each = commands.iter();
    let each = each.map(|command| (command.as_str(), vec![command.as_str(), "--help"]));
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
