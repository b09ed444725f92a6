//! Work spread over threads, results in order: the same bytes for any number of threads.

/// `f(0), f(1), ... f(count - 1)`, in this order, computed in parallel with the feature `parallel`.
pub(crate) fn map_indices<T: Send>(count: usize, f: impl Fn(usize) -> T + Sync) -> Vec<T> {
    map_each(count, &f)
}

/// Built once for every type of results, not for every function.
#[cfg(feature = "parallel")]
fn map_each<T: Send>(count: usize, f: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    use rayon::prelude::*;
    (0..count).into_par_iter().map(f).collect()
}

#[cfg(not(feature = "parallel"))]
fn map_each<T: Send>(count: usize, f: &(dyn Fn(usize) -> T + Sync)) -> Vec<T> {
    (0..count).map(f).collect()
}

/// `f` of each item, which it may change, in parallel with the feature `parallel`; results in order.
pub(crate) fn map_mut<I: Send, T: Send>(items: &mut [I], f: impl Fn(&mut I) -> T + Sync + Send) -> Vec<T> {
    #[cfg(feature = "parallel")]
    {
        use rayon::prelude::*;
        items.par_iter_mut().map(f).collect()
    }
    #[cfg(not(feature = "parallel"))]
    {
        items.iter_mut().map(f).collect()
    }
}
