//! The window in another language, in a process of its own: all of a process speaks one.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use eframe::egui::{Event, Key, Shape};
use egui_kittest::kittest::Queryable as _;
use proc_macro2::{TokenStream, TokenTree};
use transplat_core::present::View;
use transplat_core::scene::{LightKind, SKY};
use transplat_engine::language;
use transplat_tests::driver::Driver;
use transplat_tests::{Folder, root, small_lut};

fn template() -> PathBuf {
    root().join("assets/languages/transplat.pot")
}

/// The files below a folder.
fn files(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).expect("sources").flatten() {
        match entry.path() {
            path if path.is_dir() => files(&path, found),
            path => found.push(path),
        }
    }
}

/// The texts that code marks, with what marks them.
fn marked(code: TokenStream, found: &mut Vec<String>) {
    let tokens: Vec<TokenTree> = code.into_iter().collect();
    for (i, token) in tokens.iter().enumerate() {
        let TokenTree::Group(group) = token else {
            continue;
        };
        let is = |back: usize, words: &[&str]| {
            let at = i.checked_sub(back).map(|at| tokens[at].to_string());
            at.is_some_and(|at| words.contains(&at.as_str()))
        };
        let is_marked = is(1, &["tr", "tr_later"]) || is(1, &["!"]) && is(2, &["tr_format"]);
        let first = group.stream().into_iter().next();
        if let Some(TokenTree::Literal(literal)) = first.filter(|_| is_marked) {
            let text: syn::LitStr = syn::parse_str(&literal.to_string()).expect("a text");
            found.push(text.value());
        }
        marked(group.stream(), found);
    }
}

/// All texts of the window, and the files that say them.
fn texts() -> BTreeMap<String, BTreeSet<String>> {
    let sources = root().join("crates");
    let mut all = Vec::new();
    for folder in ["transplat-engine/src", "transplat/src/viewer"] {
        files(&sources.join(folder), &mut all);
    }
    let mut texts: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for path in all {
        let code = std::fs::read_to_string(&path).expect("sources are text");
        let mut found = Vec::new();
        marked(code.parse().expect("Rust"), &mut found);
        let name = path.strip_prefix(&sources).expect("in there").display();
        for text in found {
            texts.entry(text).or_default().insert(name.to_string());
        }
    }
    texts
}

/// A file of gettext with a translation of each text.
fn catalog(translated: impl Fn(&str) -> String) -> String {
    let quoted = |text: &str| {
        let escaped = text.replace('\\', "\\\\").replace('"', "\\\"");
        format!("\"{}\"", escaped.replace('\n', "\\n"))
    };
    let mut out = "msgid \"\"\nmsgstr \"Content-Type: text/plain; charset=UTF-8\\n\"\n".to_owned();
    for (text, files) in texts() {
        let files = files.into_iter().collect::<Vec<_>>().join(" ");
        let [text, translated] = [text.clone(), translated(&text)].map(|t| quoted(&t));
        out += &format!("\n#: {files}\nmsgid {text}\nmsgstr {translated}\n");
    }
    out
}

/// What translators start from is what the window says. `UPDATE_TEXTS=1` writes it anew.
#[test]
fn the_template_has_all_texts() {
    let said = catalog(|_| String::new());
    assert!(said.len() > 30_000, "{}", said.len());
    if std::env::var_os("UPDATE_TEXTS").is_some() {
        std::fs::write(template(), &said).expect("it is written");
    }
    let kept = std::fs::read_to_string(template()).expect("it is kept with the sources");
    let differs = said.lines().zip(kept.lines()).find(|(a, b)| a != b);
    assert!(said == kept, "UPDATE_TEXTS=1 writes it: {differs:?}");
}

/// What stands in braces, in any order; what has no name by its number.
fn values(text: &str) -> Vec<String> {
    let mut next = 0..;
    let mut value = |rest: &str| {
        let asked = rest.split_once('}')?.0;
        let (name, spec) = asked.split_once(':').unwrap_or((asked, ""));
        let name = match name {
            "" => next.next()?.to_string(),
            name => name.to_owned(),
        };
        Some(format!("{name}:{spec}"))
    };
    let mut found: Vec<_> = text.split('{').skip(1).filter_map(&mut value).collect();
    found.sort();
    found
}

/// Languages that come with the program say what the window says, with all that is told in it.
#[test]
fn languages_are_of_this_window() {
    let said = texts();
    let folders = [root().join("assets/languages")];
    let languages = language::languages(folders.into_iter());
    assert!(!languages.is_empty());
    for (name, file) in languages {
        let translated = language::read(&file).expect("it is one");
        for (text, as_said) in &translated {
            assert!(said.contains_key(text), "{name}: nobody says {text:?}");
            assert_eq!(values(text), values(as_said), "{name}: {text:?}");
        }
        // What is new is English until somebody translates it.
        let count = translated.len();
        assert!(count * 10 > said.len() * 9, "{name}: {count}");
    }
}

/// The texts that are painted.
fn painted(shape: &Shape, found: &mut BTreeSet<String>) {
    match shape {
        Shape::Vec(shapes) => shapes.iter().for_each(|shape| painted(shape, found)),
        Shape::Text(text) => drop(found.insert(text.galley.text().to_owned())),
        _ => {}
    }
}

/// Asserts that all that is painted now is said in the language, but what nobody translates.
fn check(d: &Driver, place: &str) {
    let mut found = BTreeSet::new();
    for shape in &d.harness.output().shapes {
        painted(&shape.shape, &mut found);
    }
    assert!(found.len() > 20, "{place}: {found:?}");
    let is_word = |word: &str| word.chars().filter(|c| c.is_ascii_alphabetic()).count() > 2;
    let left: Vec<_> = found
        .iter()
        .filter(|text| !text.contains('«'))
        .filter(|text| text.split_whitespace().any(is_word))
        .filter(|text| !NAMES.contains(&text.trim()))
        .filter(|text| !text.starts_with('/') && !text.starts_with("llvmpipe"))
        .filter(|text| !text.starts_with("ctrl") && !text.starts_with("shift"))
        // Units.
        .filter(|text| !text.contains(" W/"))
        .collect();
    assert!(left.is_empty(), "{place}: {left:?}");
}

/// Files, and what is called as its file is; keys.
const NAMES: [&str; 13] = [
    "sunset.hdr",
    "teapot",
    "teapot.ply",
    "city",
    "sunset",
    "interior",
    "interior.hdr",
    "city.hdr",
    "small.cube",
    "{splat}_{light}_{view}",
    "English",
    "Deutsch",
    "Delete",
];

#[test]
fn all_is_said_in_the_language() {
    let folder = Folder::empty();
    let brackets = folder.write("Brackets.po", catalog(|text| format!("«{text}»")));
    language::speak(Some(brackets.as_ref())).expect("a language");
    let mut d = Driver::bundled();
    let lut = d.folder.write("small.cube", small_lut());
    d.after(|v| v.open(lut.as_ref()));
    check(&d, "first");
    for tab in ["Light", "Look", "Camera", "Objects", "Export", "Report"] {
        d.click(&format!("«{tab}»"));
        check(&d, tab);
        if d.harness.query_by_label("«Advanced»").is_some() {
            d.click("«Advanced»");
            check(&d, &format!("{tab}, advanced"));
        }
    }
    d.after(|v| {
        v.session.project.keep_look();
        v.session.keep_view();
        v.session.project.scene.view = View::Difference;
    });
    for page in ["Looks 1", "Views 1", "Lights", "Light", "Swap lights"] {
        d.click(&format!("«{page}»"));
        check(&d, page);
    }
    d.click("«Placed lights»");
    for kind in LightKind::ALL {
        d.after(|v| v.session.add_light(kind));
        check(&d, &format!("lights, {kind:?}"));
    }
    d.after(|v| {
        v.session.set_light(1, SKY.into());
        v.session.project.scene.lights.clear();
    });
    d.harness.key_press(Key::J);
    d.settle();
    check(&d, "sun and sky, timeline");
    for view in [View::Split, View::Tau, View::Confidence] {
        d.after(|v| v.session.project.scene.view = view);
        check(&d, &format!("{view:?}"));
    }
    for (menu, entry) in [
        ("File", "Quit"),
        ("Edit", "History"),
        ("View", "Panels"),
        ("Help", "Shortcuts (?)"),
    ] {
        d.click(&format!("«{menu}»"));
        let entry = format!("«{entry}»");
        assert!(d.harness.query_by_label(&entry).is_some(), "{menu}");
        check(&d, menu);
        d.harness.key_press(Key::Escape);
        d.settle();
    }
    d.harness.event(Event::Text("?".into()));
    d.settle();
    assert!(d.harness.query_by_label("«orbit»").is_some());
    check(&d, "shortcuts");
}
