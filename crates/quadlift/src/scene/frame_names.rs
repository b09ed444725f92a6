//! Orders of frame names: alphabetical, and by the numbers in them.

use crate::sorting::StableSort;

/// The place of each name in alphabetical order ("frame_10" before "frame_9").
pub(crate) fn lexicographic_places(ids: &[&str]) -> Vec<usize> {
    places(ids, |a, b| a.cmp(b))
}

/// The place of each name when runs of digits are compared as numbers ("frame_9" before "frame_10").
pub(crate) fn natural_places(ids: &[&str]) -> Vec<usize> {
    places(ids, natural)
}

fn places(ids: &[&str], order: impl Fn(&str, &str) -> std::cmp::Ordering) -> Vec<usize> {
    let mut frames: Vec<usize> = (0..ids.len()).collect();
    frames.stable_sort_by(|&a, &b| order(ids[a], ids[b]).then(a.cmp(&b)));
    let mut places = vec![0; ids.len()];
    for (place, frame) in frames.into_iter().enumerate() {
        places[frame] = place;
    }
    places
}

fn natural(a: &str, b: &str) -> std::cmp::Ordering {
    let (mut a, mut b) = (a, b);
    loop {
        let ((text_a, number_a, rest_a), (text_b, number_b, rest_b)) = (split(a), split(b));
        // Numbers without leading zeros: the longer one is larger.
        let by_number = number_a.len().cmp(&number_b.len()).then(number_a.cmp(number_b));
        let order = text_a.cmp(text_b).then(by_number);
        if order.is_ne() || (rest_a.is_empty() && rest_b.is_empty()) {
            return order.then(rest_a.cmp(rest_b));
        }
        (a, b) = (rest_a, rest_b);
    }
}

/// What comes before the first number, the number without leading zeros, and the rest.
fn split(name: &str) -> (&str, &str, &str) {
    let start = name.find(|c: char| c.is_ascii_digit()).unwrap_or(name.len());
    let (text, rest) = name.split_at(start);
    let end = rest.find(|c: char| !c.is_ascii_digit()).unwrap_or(rest.len());
    let (number, rest) = rest.split_at(end);
    (text, number.trim_start_matches('0'), rest)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_compared_as_numbers() {
        let ids = ["img9.jpg", "img10.jpg", "img1.jpg", "img010b.jpg"];
        assert_eq!(natural_places(&ids), [1, 2, 0, 3]);
        assert_eq!(lexicographic_places(&ids), [3, 2, 1, 0]);
        assert_eq!(natural_places(&["b2", "a10", "a9"]), [2, 1, 0]);
        assert_eq!(natural_places(&["", "7"]), [0, 1]);
    }
}
