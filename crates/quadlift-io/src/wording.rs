//! Messages of the JSON and TOML readers in words for people.

/// Replaces the words of programmers in a message about a value of the wrong type or length.
pub fn plain_words(message: &str) -> String {
    let mut text = message.replace('\n', ", ");
    for (from, to) in [
        ("invalid type: ", "found "),
        ("invalid value: ", "found "),
        ("found sequence", "found a list"),
        ("found map", "found an object {...}"),
        ("found string", "found the text"),
        ("found boolean", "found"),
        ("found integer", "found the number"),
        ("found floating point", "found the number"),
        ("expected f64", "expected a number"),
        ("expected usize", "expected a whole number"),
        ("expected u32", "expected a whole number"),
        ("expected a string", "expected text in quotes"),
        ("expected a sequence", "expected a list"),
        ("trailing characters", "there is more text after the end"),
    ] {
        text = text.replace(from, to);
    }
    match text.strip_prefix("invalid length ").and_then(|rest| rest.split_once(',')) {
        Some(("1", rest)) => format!("found 1 entry,{rest}"),
        Some((count, rest)) => format!("found {count} entries,{rest}"),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn types_and_lengths_are_in_plain_words() {
        assert_eq!(plain_words("invalid type: sequence, expected f64"), "found a list, expected a number");
        assert_eq!(
            plain_words("invalid length 3, expected a list of 4 numbers"),
            "found 3 entries, expected a list of 4 numbers"
        );
        assert_eq!(plain_words("missing field `frame`"), "missing field `frame`");
    }
}
