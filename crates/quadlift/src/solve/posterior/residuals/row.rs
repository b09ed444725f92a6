//! One whitened residual with its derivatives.

use crate::optimize::normal_equations::Row;
use crate::solve::posterior::noise::groups::NoiseGroup;

/// Depths below this (in object sizes) are taken as this: the object is at or behind the camera, and its residuals
/// are very large.
pub(crate) const MIN_DEPTH: f64 = 1e-3;

/// One whitened residual: divided by the noise of its group.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ResidualRow {
    pub residual: f64,
    pub row: Row,
    pub group: NoiseGroup,
    /// Whether it is a measurement here: not where an edge is cut off and the body reaches beyond it.
    pub counts: bool,
}
