//! Words for people: messages of the JSON and TOML readers, small pieces that several reports share.

/// How many names a line shows.
const SHOWN: usize = 8;

/// Replaces the words of programmers in a message about a value of the wrong type or length.
pub(crate) fn plain_words(message: &str) -> String {
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

/// "1 view", "2 views".
pub fn count(n: usize, singular: &str) -> String {
    format!("{n} {singular}{}", if n == 1 { "" } else { "s" })
}

/// The first names of a list, and how many more there are.
pub fn some_of<T: AsRef<str>>(names: &[T]) -> String {
    let shown: Vec<&str> = names.iter().take(SHOWN).map(AsRef::as_ref).collect();
    let text = shown.join(", ");
    if names.len() > SHOWN { format!("{text} and {} more", names.len() - SHOWN) } else { text }
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

    #[test]
    fn long_lists_are_cut() {
        assert_eq!((count(1, "view"), count(0, "view")), ("1 view".to_owned(), "0 views".to_owned()));
        assert_eq!(some_of(&["a", "b"]), "a, b");
        assert_eq!(some_of(&["x"; 10]), "x, x, x, x, x, x, x, x and 2 more");
    }
}
