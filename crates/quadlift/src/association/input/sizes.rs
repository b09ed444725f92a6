//! Sizes of the objects of a category.

/// Logarithm of the radius of a category's objects.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(crate) struct LogSize {
    /// Its mean.
    pub mean: f64,
    /// Its standard deviation.
    pub sd: f64,
}
