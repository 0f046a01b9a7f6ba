//! Reader of gettext's `.po` files.

use std::collections::HashMap;

/// Text that the strings of a line belong to.
#[derive(Clone, Copy, PartialEq)]
enum CatalogPart {
    Text,
    Translation,
    /// Strings that the window never requests.
    Context,
    Plural,
}

/// The texts that are translated; what does not follow the format is told with its line, the first is 1.
pub fn parse(file: &str) -> Result<HashMap<String, String>, String> {
    let file = file.trim_start_matches('\u{feff}');
    let mut texts = HashMap::new();
    let mut entry = Entry::default();
    // Said of the entry that follows: somebody has to look at it again.
    let mut is_fuzzy = false;
    for (i, line) in file.lines().enumerate() {
        let line = line.trim();
        let wrong = || format!("line {} is none of gettext's", i + 1);
        if line.is_empty() || line.starts_with('#') {
            is_fuzzy |= line.starts_with("#,") && line.contains("fuzzy");
            continue;
        }
        let (word, quoted) = line.split_at(line.find('"').ok_or_else(wrong)?);
        let string = unquoted(quoted).ok_or_else(wrong)?;
        match word.trim_end() {
            "" => {}
            "msgctxt" => {
                std::mem::take(&mut entry).end(&mut texts);
                entry.part = Some(CatalogPart::Context);
            }
            "msgid" if entry.part != Some(CatalogPart::Text) => {
                let is_plain = entry.part != Some(CatalogPart::Context) && !is_fuzzy;
                is_fuzzy = false;
                std::mem::take(&mut entry).end(&mut texts);
                (entry.part, entry.is_plain) = (Some(CatalogPart::Text), is_plain);
            }
            "msgstr" => entry.part = Some(CatalogPart::Translation),
            other if other == "msgid_plural" || other.starts_with("msgstr[") => {
                entry.part = Some(CatalogPart::Plural);
                entry.is_plain = false;
            }
            _ => return Err(wrong()),
        }
        match entry.part.ok_or_else(wrong)? {
            CatalogPart::Text => entry.text += &string,
            CatalogPart::Translation => entry.translation += &string,
            CatalogPart::Context | CatalogPart::Plural => {}
        }
    }
    entry.end(&mut texts);
    Ok(texts)
}

#[derive(Default)]
struct Entry {
    text: String,
    translation: String,
    part: Option<CatalogPart>,
    /// True for a text with its translation, and nothing else.
    is_plain: bool,
}

impl Entry {
    /// Takes it over, if it translates something; the head of the file is that of no text.
    fn end(self, texts: &mut HashMap<String, String>) {
        if self.is_plain && !self.text.is_empty() && !self.translation.is_empty() {
            texts.insert(self.text, self.translation);
        }
    }
}

/// Text between quotes; none where they are not closed, or something follows.
fn unquoted(quoted: &str) -> Option<String> {
    let inside = quoted.strip_prefix('"')?.strip_suffix('"')?;
    let mut out = String::new();
    let mut characters = inside.chars();
    while let Some(character) = characters.next() {
        out.push(match character {
            '"' => return None,
            '\\' => match characters.next()? {
                'n' => '\n',
                't' => '\t',
                other => other,
            },
            other => other,
        });
    }
    Some(out)
}

#[cfg(test)]
mod tests {
    use super::parse;

    #[test]
    fn texts_are_read_as_gettext_writes_them() {
        let file = r#"
            # by nobody
            #
            msgid ""
            msgstr "Language: de\n"

            #: viewer/menus.rs
            #, no-wrap
            msgid "Open"
            msgstr "Öffnen"

            msgid "a \"long\" "
            "one\n"
            msgstr ""
            "ein \"langer\"\n"

            msgctxt "somewhere"
            msgid "Close"
            msgstr "Schließen"

            msgid "one" 
            msgid_plural "many"
            msgstr[99999999999] "viele"

            #, fuzzy
            msgid "unsure"
            msgstr "unsicher"

            msgid "not yet"
            msgstr ""
        "#;
        let texts = parse(file).expect("it is one");
        let text = |of: &str| texts.get(of).map(String::as_str);
        assert_eq!(text("Open"), Some("Öffnen"));
        assert_eq!(text("a \"long\" one\n"), Some("ein \"langer\"\n"));
        assert_eq!(texts.len(), 2, "{texts:?}");
    }

    #[test]
    fn what_is_none_is_told_with_its_line() {
        for (line, file) in [
            (1, "Open = Öffnen"),
            (1, "\"alone\""),
            (2, "msgid \"a\"\nmsgstr \"b"),
            (2, "msgid \"a\"\nmsgid \"b\""),
            (1, "msgid \"a\"b\""),
            (1, "\\\""),
        ] {
            let told = parse(file).expect_err(file);
            assert!(told.contains(&format!("line {line} ")), "{file}: {told}");
        }
    }
}
