//! Names of files made from ids: ids may be any text.

use std::collections::HashSet;

/// Longest name in characters, of four bytes each at most; systems take 255 bytes with the ending.
const LONGEST: usize = 55;

/// One name for each id, in their order, all different also where capital letters do not count, of letters, digits, `-`, `_` and `.`.
/// An id that is a plain name already keeps it.
pub fn file_names<'a>(ids: impl IntoIterator<Item = &'a str>) -> Vec<String> {
    let mut taken = HashSet::new();
    let name = |id: &'a str| {
        let plain = plain(id);
        let numbered = (2u64..).map(|number| format!("{plain}_{number}"));
        let mut candidates = std::iter::once(plain.clone()).chain(numbered);
        // There are more numbers than ids.
        candidates.find(|name| taken.insert(name.to_lowercase())).unwrap_or(plain.clone())
    };
    ids.into_iter().map(name).collect()
}

/// The id with `_` in place of all signs that may mean something to a system.
fn plain(id: &str) -> String {
    let sign = |c: char| if c.is_alphanumeric() || matches!(c, '-' | '_' | '.') { c } else { '_' };
    let name: String = id.chars().take(LONGEST).map(sign).collect();
    // Hidden files, and the folder itself.
    match name.strip_prefix('.') {
        Some(rest) => format!("_{rest}"),
        None if name.is_empty() => "_".to_owned(),
        None => name,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_plain_and_different() {
        let ids = ["000001", "a/b", "a_b", "A_B", "../x", "", "..", "cup 1", "杯"];
        assert_eq!(file_names(ids), ["000001", "a_b", "a_b_2", "A_B_3", "_._x", "_", "_.", "cup_1", "杯"]);
        let long = "x".repeat(300);
        let names = file_names([long.as_str(), &long]);
        assert_eq!(names.iter().map(String::len).collect::<Vec<_>>(), [55, 57]);
    }
}
