//! Translations of the window's texts.
//!
//! What is written in the code is English, and the key of its translation; where there is none, the English stands. The file of a language is
//! one of gettext (`.po`), so that its tools serve; `assets/languages/transplat.pot` has all texts, collected from the code by a test. What
//! goes wrong with a file is told in English, as the commands tell it.

mod gettext;

use std::collections::{BTreeMap, HashMap};
use std::fmt::{Display, Write as _};
use std::path::{Path, PathBuf};
use std::sync::RwLock;

use anyhow::{Context as _, Result, anyhow, bail};

/// Texts of the language that is spoken; none is English. They stay for good, since a text once shown may be held anywhere.
static SPOKEN: RwLock<Option<&'static HashMap<String, String>>> = RwLock::new(None);

/// Bytes of the largest file that is read as a language.
const LARGEST: u64 = 4 << 20;

/// A text of the window as it is read.
pub fn tr(text: &'static str) -> &'static str {
    translated(text).unwrap_or(text)
}

/// A text that is translated where it is shown, by [`tr`].
pub const fn tr_later(text: &'static str) -> &'static str {
    text
}

/// As `format!`, translated. A translation may take the values in any order: by name, where all are named (`"{name}", name = name`), or else
/// by number.
#[macro_export]
macro_rules! tr_format {
    ($text:literal $(, $name:ident = $value:expr)+ $(,)?) => {
        match $crate::language::translated($text) {
            None => format!($text $(, $name = $value)+),
            Some(text) => $crate::language::fill(
                text,
                &[$((stringify!($name), &$value as &dyn std::fmt::Display)),+],
            ),
        }
    };
    ($text:literal $(, $value:expr)+ $(,)?) => {
        match $crate::language::translated($text) {
            None => format!($text $(, $value)+),
            Some(text) => $crate::language::fill(
                text,
                &[$(("", &$value as &dyn std::fmt::Display)),+],
            ),
        }
    };
}
pub use crate::tr_format;

/// The translation of a text, where there is one.
pub fn translated(text: &str) -> Option<&'static str> {
    let spoken = SPOKEN.read().ok()?;
    (*spoken)?.get(text).map(String::as_str)
}

/// Fills a translation's braces as `format!` does those of the text. What it asks for and is not there stays as it is written.
pub fn fill(text: &str, values: &[(&str, &dyn Display)]) -> String {
    let mut out = String::new();
    let mut next = 0..;
    let mut rest = text;
    while let Some((before, inside)) = rest.split_once('{') {
        out += &before.replace("}}", "}");
        if let Some(after) = inside.strip_prefix('{') {
            out.push('{');
            rest = after;
            continue;
        }
        let Some((asked, after)) = inside.split_once('}') else {
            return out + "{" + inside;
        };
        let (name, spec) = asked.split_once(':').unwrap_or((asked, ""));
        let numbered = match name {
            "" => next.next(),
            _ => name.parse().ok(),
        };
        let value = match numbered {
            Some(number) => values.get::<usize>(number),
            None => values.iter().find(|(of, _)| *of == name),
        };
        match value {
            Some((_, value)) => push(&mut out, spec, *value),
            None => {
                let _ = write!(out, "{{{asked}}}");
            }
        }
        rest = after;
    }
    out + &rest.replace("}}", "}")
}

/// A value as its spec has it: a sign, decimals.
fn push(out: &mut String, spec: &str, value: &dyn Display) {
    let decimals = spec.split_once('.').and_then(|(_, d)| d.parse().ok());
    let written = match (spec.starts_with('+'), decimals) {
        (true, Some(decimals)) => write!(out, "{value:+.decimals$}"),
        (true, None) => write!(out, "{value:+}"),
        (false, Some(decimals)) => write!(out, "{value:.decimals$}"),
        (false, None) => write!(out, "{value}"),
    };
    // A string takes what is written to it.
    let _ = written;
}

/// Speaks the language of a file from here on, or English.
///
/// # Errors
/// The file cannot be read, is none of gettext, or translates nothing.
pub fn speak(file: Option<&Path>) -> Result<()> {
    let texts = file.map(read).transpose()?;
    let texts = texts.map(|texts| &*Box::leak(Box::new(texts)));
    if let Ok(mut spoken) = SPOKEN.write() {
        *spoken = texts;
    }
    Ok(())
}

/// The texts of a language's file, by their English.
///
/// # Errors
/// As [`speak`].
pub fn read(file: &Path) -> Result<HashMap<String, String>> {
    let named = || file.display().to_string();
    let size = std::fs::metadata(file).with_context(named)?.len();
    if size > LARGEST {
        bail!("{}: {size} bytes are too many for a language", named());
    }
    let text = std::fs::read_to_string(file).with_context(named)?;
    let texts = gettext::parse(&text).map_err(|why| anyhow!("{}: {why}", named()))?;
    if texts.is_empty() {
        bail!("{}: translates nothing", named());
    }
    Ok(texts)
}

/// Where users put languages of their own.
pub fn own_folder() -> Option<PathBuf> {
    let of_program = directories::ProjectDirs::from("", "", "transplat")?;
    Some(of_program.config_dir().join("languages"))
}

/// The files of the languages in some folders, by what each is called; a later folder's come before an earlier one's.
pub fn languages(folders: impl Iterator<Item = PathBuf>) -> BTreeMap<String, PathBuf> {
    let entries = folders.filter_map(|f| std::fs::read_dir(f).ok()).flatten();
    let files = entries.flatten().map(|entry| entry.path());
    files
        .filter(|path| path.extension().is_some_and(|e| e == "po"))
        .filter_map(|path| Some((path.file_stem()?.to_str()?.to_owned(), path)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_translation_takes_the_values_in_its_own_order() {
        let share = 12.34;
        let values: [(&str, &dyn Display); 3] = [("", &"a"), ("", &7), ("share", &share)];
        let fill = |text: &str| fill(text, &values);
        assert_eq!(fill("{} {} {share:.1}"), "a 7 12.3");
        assert_eq!(fill("{share:+.0} % von {1} in {0}"), "+12 % von 7 in a");
        assert_eq!(fill("{{{}}} }}"), "{a} }");
        // What it got wrong is seen, and nothing is lost.
        assert_eq!(fill("{} {whatever} {9} {"), "a {whatever} {9} {");
    }

    #[test]
    fn what_is_no_language_is_told() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("Deutsch.po");
        assert!(speak(Some(&file)).is_err());
        for text in ["", "\0\x01", "no gettext", "msgid \"Open\"\nmsgstr \"\"\n"] {
            std::fs::write(&file, text).expect("it is written");
            let told = speak(Some(&file)).expect_err("translates nothing");
            assert!(format!("{told:#}").contains("Deutsch.po"), "{told:#}");
        }
        let folders = [folder.path().to_owned(), folder.path().join("none")];
        assert_eq!(
            languages(folders.into_iter()),
            BTreeMap::from([("Deutsch".to_owned(), file)])
        );
    }
}
