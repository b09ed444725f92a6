//! "Did you mean ...": the known name that is nearest to an unknown one.

/// Names to list when none is near; more would hide the message.
const FEW: usize = 6;

/// The rest of a message about an unknown name: the nearest known name, or the known names. `what` is the plural.
pub(crate) fn known_names<'a>(
    wanted: &str,
    known: impl ExactSizeIterator<Item = &'a str> + Clone,
    what: &str,
) -> String {
    if let Some(nearest) = nearest(wanted, known.clone()) {
        return format!("did you mean \"{nearest}\"?");
    }
    let count = known.len();
    let quoted: Vec<String> = known.take(FEW).map(|name| format!("\"{name}\"")).collect();
    match count {
        0 => format!("the file has no {what}"),
        1..=FEW => format!("the {what} are: {}", quoted.join(", ")),
        _ => format!("there are {count} {what}: {}, ...", quoted.join(", ")),
    }
}

/// The known name that differs only in case, surrounding space or leading zeros, or in one letter.
fn nearest<'a>(wanted: &str, known: impl Iterator<Item = &'a str> + Clone) -> Option<&'a str> {
    let key = plain(wanted);
    known.clone().find(|name| plain(name) == key).or_else(|| {
        // In short names, and in numbers, one letter makes another name.
        let distinctive = wanted.chars().count() >= 3 && !wanted.bytes().all(|b| b.is_ascii_digit());
        known.into_iter().find(|name| distinctive && differs_in_one(wanted, name))
    })
}

/// A name in lower case without surrounding space and leading zeros.
fn plain(name: &str) -> String {
    name.trim().trim_start_matches('0').to_lowercase()
}

/// Whether one inserted, removed or changed letter makes the names equal.
fn differs_in_one(a: &str, b: &str) -> bool {
    let (a, b): (Vec<char>, Vec<char>) = (a.chars().collect(), b.chars().collect());
    if a.len().abs_diff(b.len()) > 1 {
        return false;
    }
    let head = a.iter().zip(&b).take_while(|(p, q)| p == q).count();
    let tail = a[head..].iter().rev().zip(b[head..].iter().rev()).take_while(|(p, q)| p == q).count();
    a.len().max(b.len()) - head - tail <= 1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn near_names_are_suggested() {
        let known = ["000012", "000013", "left", "Right"];
        let message = |wanted| known_names(wanted, known.iter().copied(), "frames");
        assert_eq!(message("12"), "did you mean \"000012\"?");
        assert_eq!(message("right"), "did you mean \"Right\"?");
        assert_eq!(message("lft"), "did you mean \"left\"?");
        assert_eq!(message("leaft"), "did you mean \"left\"?");
        assert_eq!(message("lest"), "did you mean \"left\"?");
        assert_eq!(message("000014"), "the frames are: \"000012\", \"000013\", \"left\", \"Right\"");
    }

    #[test]
    fn lists_are_short() {
        assert_eq!(known_names("x", [].into_iter(), "cameras"), "the file has no cameras");
        let many = ["aa", "bb", "cc", "dd", "ee", "ff", "gg"];
        assert_eq!(
            known_names("x", many.into_iter(), "frames"),
            "there are 7 frames: \"aa\", \"bb\", \"cc\", \"dd\", \"ee\", \"ff\", ..."
        );
    }
}
