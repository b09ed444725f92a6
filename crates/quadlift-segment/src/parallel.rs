//! Work spread over threads, results in order: the same bytes for any number of threads.

/// `f` of each entry, in this order, computed in parallel with the feature `parallel`.
#[cfg(feature = "parallel")]
pub(crate) fn map_slice<A: Sync, T: Send>(entries: &[A], f: impl Fn(&A) -> T + Sync + Send) -> Vec<T> {
    use rayon::prelude::*;
    entries.par_iter().map(f).collect()
}

/// `f` of each entry, in this order.
#[cfg(not(feature = "parallel"))]
pub(crate) fn map_slice<A: Sync, T: Send>(entries: &[A], f: impl Fn(&A) -> T + Sync + Send) -> Vec<T> {
    entries.iter().map(f).collect()
}
