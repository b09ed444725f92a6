//! Work spread over threads, results in order: the same bytes for any number of threads.

/// `f(0), f(1), ... f(count - 1)`, in this order, computed in parallel with the feature `parallel`.
#[cfg(feature = "parallel")]
pub(crate) fn map_indices<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    use rayon::prelude::*;
    (0..count).into_par_iter().map(f).collect()
}

/// `f(0), f(1), ... f(count - 1)`, in this order.
#[cfg(not(feature = "parallel"))]
pub(crate) fn map_indices<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    (0..count).map(f).collect()
}
