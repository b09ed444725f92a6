//! Stable sorts that the compiler builds once. The standard library's are built anew for every type and comparison, which
//! was a tenth of all code of the library.

use std::cmp::Ordering;

/// Stable sorts of slices whose elements are compared a few thousand times at most; inner loops use those of the standard
/// library.
pub(crate) trait StableSort<T> {
    /// Sorts by a comparison; equal elements keep their order.
    fn stable_sort_by(&mut self, compare: impl Fn(&T, &T) -> Ordering);

    /// Sorts by a key; elements with equal keys keep their order.
    fn stable_sort_by_key<K: Ord>(&mut self, key: impl Fn(&T) -> K) {
        self.stable_sort_by(|a, b| key(a).cmp(&key(b)));
    }
}

impl<T> StableSort<T> for [T] {
    fn stable_sort_by(&mut self, compare: impl Fn(&T, &T) -> Ordering) {
        let mut order = sorted_indices(self.len(), &|a, b| compare(&self[a], &self[b]));
        // Cycle by cycle: `order[i]` is the index of the element that belongs to i, or i itself once it is there.
        for start in 0..order.len() {
            let mut at = start;
            while order[at] != start {
                let next = order[at];
                self.swap(at, next);
                order[at] = at;
                at = next;
            }
            order[at] = at;
        }
    }
}

/// The indices below `count` in the order of their elements.
fn sorted_indices(count: usize, compare: &dyn Fn(usize, usize) -> Ordering) -> Vec<usize> {
    let mut order: Vec<usize> = (0..count).collect();
    order.sort_by(|&a, &b| compare(a, b));
    order
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn it_sorts_as_the_standard_library_does(keys in proptest::collection::vec(0_u8..20, 0..60)) {
            let mut ours: Vec<(u8, usize)> = keys.iter().copied().zip(0..).collect();
            let mut theirs = ours.clone();
            ours.stable_sort_by_key(|&(key, _)| key);
            theirs.sort_by_key(|&(key, _)| key);
            prop_assert_eq!(&ours, &theirs);
            ours.stable_sort_by(|a, b| b.1.cmp(&a.1));
            theirs.sort_by_key(|&(_, place)| std::cmp::Reverse(place));
            prop_assert_eq!(ours, theirs);
        }
    }
}
