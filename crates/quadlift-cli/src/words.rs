//! Small pieces of text that several reports share.

/// How many names a line shows.
const SHOWN: usize = 8;

/// What is said where Parquet is asked for and the program was built without it.
#[cfg(not(feature = "parquet"))]
pub const NO_PARQUET: &str = "this program was built without Parquet; build it with it: cargo install --path crates/quadlift-cli \
                              --features parquet";

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

/// A title of a column with lengths; the unit is named where it is known.
pub fn with_unit(title: &str, length_unit: Option<&str>) -> String {
    match length_unit {
        Some(unit) => format!("{title} [{unit}]"),
        None => title.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lists_are_cut() {
        assert_eq!((count(1, "view"), count(0, "view")), ("1 view".to_owned(), "0 views".to_owned()));
        assert_eq!(some_of(&["a", "b"]), "a, b");
        assert_eq!(some_of(&["x"; 10]), "x, x, x, x, x, x, x, x and 2 more");
    }
}
