//! Sizes of the objects of a category.

/// Logarithm of the radius of a category's objects.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LogSize {
    /// Its mean.
    pub mean: f64,
    /// Its standard deviation.
    pub sd: f64,
}
