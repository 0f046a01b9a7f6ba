//! Errors and numbers in words.

/// A share, 0 to 1, for people.
pub fn percent(share: f64) -> String {
    let percent = 100.0 * share;
    if percent < 1.0 {
        format!("{percent:.2} %")
    } else {
        format!("{percent:.0} %")
    }
}

/// A time for people.
pub fn milliseconds(ms: f64) -> String {
    if ms >= 1000.0 {
        format!("{:.1} s", ms / 1000.0)
    } else if ms >= 10.0 {
        format!("{ms:.0} ms")
    } else {
        format!("{ms:.1} ms")
    }
}

/// Message of an error, outermost cause first, with refusals of the system in plain words.
pub fn of_error(error: &anyhow::Error) -> String {
    let mut said: Vec<String> = error.chain().map(ToString::to_string).collect();
    if let Some(reason) = error.root_cause().downcast_ref::<std::io::Error>() {
        said.pop();
        // What a reader found follows the file's name, what the system refuses comes before it.
        let is_of_system = reason.get_ref().is_none();
        let reason = transplat_core::refusal(reason);
        match &said[..] {
            [path] if is_of_system && !path.contains(": ") => said.insert(0, reason),
            _ => said.push(reason),
        }
    }
    said.dedup();
    said.join(": ")
}
