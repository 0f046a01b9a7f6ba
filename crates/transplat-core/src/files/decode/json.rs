//! JSON as programs write it, with errors in plain words.

use serde::de::DeserializeOwned;
use serde_json::error::Category;

/// Reads a value from a text in JSON, which may begin with a byte order mark. Numbers that are none, as Python writes them (`NaN`, `Infinity`),
/// count as `null`.
///
/// # Errors
/// It is no JSON, or another value is expected somewhere: what and where, in words.
pub fn from_slice<T: DeserializeOwned>(text: &[u8]) -> Result<T, String> {
    let text = text.strip_prefix("\u{feff}".as_bytes()).unwrap_or(text);
    match super::guard::guarded("the text", || Ok::<_, String>(serde_json::from_slice(text)))? {
        Ok(value) => Ok(value),
        Err(error) if error.classify() == Category::Syntax => match without_nan(text) {
            None => Err(in_words(&error)),
            Some(text) => serde_json::from_slice(&text).map_err(|e| in_words(&e)),
        },
        Err(error) => Err(in_words(&error)),
    }
}

/// The text with `null` in the place of each bare `NaN`, `Infinity` and `-Infinity`, if it has any.
fn without_nan(text: &[u8]) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(text.len());
    let (mut rest, mut in_string, mut found) = (text, false, false);
    while let [first, after @ ..] = rest {
        let mut words = [&b"-Infinity"[..], b"Infinity", b"NaN"].into_iter();
        let word = words.find(|word| !in_string && rest.starts_with(word));
        if let Some(word) = word {
            out.extend(b"null");
            rest = &rest[word.len()..];
            found = true;
            continue;
        }
        out.push(*first);
        rest = after;
        match (first, after) {
            // Whatever is escaped, it ends no string.
            (b'\\', [escaped, after @ ..]) if in_string => {
                out.push(*escaped);
                rest = after;
            }
            (b'"', _) => in_string = !in_string,
            _ => {}
        }
    }
    found.then_some(out)
}

/// Error of the parser, for somebody who wrote the file or has it from a program.
fn in_words(error: &serde_json::Error) -> String {
    let place = match error.line() {
        0 => String::new(),
        line => format!(" (line {line}, column {})", error.column()),
    };
    let what = match error.classify() {
        Category::Eof => "the JSON text ends too early".into(),
        Category::Io | Category::Syntax => "is no text in JSON".into(),
        Category::Data => {
            let text = error.to_string();
            let said = text
                .rfind(" at line ")
                .map_or(&text[..], |end| &text[..end]);
            of_data(said)
        }
    };
    format!("{what}{place}")
}

/// The parser's words for a value that is not as expected.
fn of_data(said: &str) -> String {
    let quoted = |text: &str| {
        let mut parts = text.splitn(3, '`');
        parts.nth(1).unwrap_or(text).to_owned()
    };
    let found_and_expected = |rest: &str| {
        let (found, expected) = rest.split_once(", expected ")?;
        Some((found.to_owned(), expected.to_owned()))
    };
    if said.starts_with("missing field") {
        return format!("{:?} is missing", quoted(said));
    }
    if said.starts_with("unknown field") {
        return format!("{:?} is an unknown field", quoted(said));
    }
    if said.starts_with("unknown variant") {
        let among = found_and_expected(said).map_or_else(String::new, |(_, expected)| expected);
        let among = among.trim_start_matches("one of ").replace('`', "\"");
        return format!("{:?} is none of {among}", quoted(said));
    }
    if let Some((found, expected)) = said
        .strip_prefix("invalid type: ")
        .or_else(|| said.strip_prefix("invalid value: "))
        .and_then(found_and_expected)
    {
        return format!(
            "{} stands where {} is expected",
            kind(&found),
            kind(&expected)
        );
    }
    if let Some((found, expected)) = said
        .strip_prefix("invalid length ")
        .and_then(found_and_expected)
    {
        return format!(
            "a list of {found} stands where {} is expected",
            kind(&expected)
        );
    }
    said.to_owned()
}

/// Name of a kind of value.
fn kind(parsers: &str) -> String {
    let quoted = || parsers.split('`').nth(1);
    match parsers {
        "sequence" | "a sequence" | "tuple variant" => "a list".into(),
        "map" | "a map" | "struct variant" => "an object".into(),
        "null" | "unit" | "unit value" => "null".into(),
        "a string" | "string" | "path string" | "a borrowed string" => "a text".into(),
        "a boolean" => "true or false".into(),
        "f32" | "f64" | "a number" => "a number".into(),
        "u8" | "u16" | "u32" | "u64" | "usize" | "i32" | "i64" => "a whole number".into(),
        _ if parsers.starts_with("struct ") => "an object".into(),
        _ if parsers.starts_with("tuple ") => "a list".into(),
        _ if parsers.starts_with("enum ") || parsers == "string or map" => {
            "a text or an object".into()
        }
        _ if parsers.starts_with("an array of length ") => {
            parsers.replace("an array of length", "a list of")
        }
        _ if parsers.starts_with("a sequence of ") && parsers.ends_with(" values") => {
            let count = parsers.split(' ').nth(3).unwrap_or_default();
            format!("a list of {count} numbers")
        }
        _ if parsers.starts_with("integer") || parsers.starts_with("floating") => {
            format!("the number {}", quoted().unwrap_or_default())
        }
        _ if parsers.starts_with("boolean") => quoted().unwrap_or_default().into(),
        _ if parsers.starts_with("string ") => format!("the text {}", &parsers[7..]),
        other => other.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Debug, Deserialize, PartialEq)]
    #[serde(deny_unknown_fields)]
    struct Thing {
        size: Option<f64>,
        name: String,
        #[serde(default)]
        place: [f32; 3],
    }

    #[test]
    fn text_as_programs_write_it_is_read() {
        let thing = |size| Thing {
            size,
            name: "NaN \"-Infinity".into(),
            place: [0.0; 3],
        };
        for (text, size) in [
            (r#"{"size": 1, "name": "NaN \"-Infinity"}"#, Some(1.0)),
            (r#"{"size": NaN, "name": "NaN \"-Infinity"}"#, None),
            (r#"{"size":-Infinity,"name":"NaN \"-Infinity"}"#, None),
            (
                "\u{feff}{\"size\": Infinity, \"name\": \"NaN \\\"-Infinity\"}",
                None,
            ),
        ] {
            assert_eq!(from_slice(text.as_bytes()), Ok(thing(size)), "{text}");
        }
    }

    #[test]
    fn errors_are_no_words_of_a_parser() {
        for (text, said) in [
            ("[1]", "a list of 1 stands where an object is expected"),
            (r#"{"size": 1}"#, "\"name\" is missing"),
            (
                r#"{"size": "x", "name": ""}"#,
                "the text \"x\" stands where a number is expected",
            ),
            (r#"{"nam": ""}"#, "\"nam\" is an unknown field"),
            (
                r#"{"name": "", "place": [1]}"#,
                "a list of 1 stands where a list of 3 is expected",
            ),
            (r#"{"name": "#, "ends too early"),
            (r#"{"name": #}"#, "is no text in JSON (line 1, column 10)"),
        ] {
            let why = from_slice::<Thing>(text.as_bytes()).expect_err(text);
            assert!(why.contains(said), "{text}: {why}");
        }
    }
}
