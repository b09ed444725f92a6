//! Sets of indices as bits, 64 in a word.

use std::cmp::Ordering;

/// Indices of the bits that are set.
pub(crate) fn ones(words: impl Iterator<Item = u64>) -> impl Iterator<Item = usize> {
    words.enumerate().flat_map(|(word, bits)| {
        let mut left = bits;
        std::iter::from_fn(move || {
            let bit = left.trailing_zeros();
            (left != 0).then(|| {
                left &= left - 1;
                word * 64 + bit as usize
            })
        })
    })
}

/// The bits with a larger index.
pub(crate) fn after(index: usize, words: impl Iterator<Item = u64>) -> impl Iterator<Item = u64> {
    let (last, bit) = (index / 64, index % 64);
    words.enumerate().map(move |(word, bits)| match word.cmp(&last) {
        Ordering::Less => 0,
        Ordering::Equal => bits & (u64::MAX << bit) << 1,
        Ordering::Greater => bits,
    })
}

/// Number of bits that are set.
pub(crate) fn count(words: impl Iterator<Item = u64>) -> usize {
    words.map(|bits| bits.count_ones() as usize).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_after_an_index_are_found_and_counted() {
        let words = [1 << 3 | 1 << 63, 1 | 1 << 5];
        let of = |index: usize| ones(after(index, words.into_iter())).collect::<Vec<_>>();
        assert_eq!(ones(words.into_iter()).collect::<Vec<_>>(), [3, 63, 64, 69]);
        assert_eq!((of(2), of(3), of(62)), (vec![3, 63, 64, 69], vec![63, 64, 69], vec![63, 64, 69]));
        assert_eq!((of(63), of(64), of(127)), (vec![64, 69], vec![69], vec![]));
        assert_eq!(count(after(3, words.into_iter())), 3);
    }
}
