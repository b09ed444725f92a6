//! Bodies as nine numbers that can be moved a little: position, and what the support function needs.
//!
//! Everything is in the object's frame (see [`crate::solve::conditioning`]): lengths are about one.

pub(crate) mod ellipsoid;
pub(crate) mod oriented;

use nalgebra::{Matrix3, SVector, Vector3};

use crate::optimize::normal_equations::{NormalEquations, Row};

/// Largest ratio of the longest to the shortest semi-axis that a step may reach.
pub(crate) const LARGEST_ASPECT: f64 = 1e6;

/// A body that the solver can fit.
pub(crate) trait BodyModel: Clone + Send + Sync {
    /// Centre.
    fn center(&self) -> &Vector3<f64>;
    /// Semi-axes, in the model's own order.
    fn semi_axes(&self) -> Vector3<f64>;
    /// The axes as columns.
    fn axes(&self) -> &Matrix3<f64>;
    /// Support function and its derivatives by the six shape parameters (3 to 8).
    fn support_gradient(&self, n: &Vector3<f64>) -> (f64, [f64; 6]);
    /// How far the body stays on the positive side of the plane `n.x + d = 0`, in lengths of `n` (negative where it reaches
    /// through), and the derivatives.
    #[inline]
    fn distance_to_plane(&self, n: &Vector3<f64>, d: f64) -> (f64, Row) {
        let (h, slope) = self.support_gradient(n);
        let row = std::array::from_fn(|k| if k < 3 { n[k] } else { -slope[k - 3] });
        (n.dot(self.center()) + d - h, row)
    }
    /// `B^T` with the shape matrix `A = B B^T`, for bodies whose outline is an ellipse.
    fn root_transposed(&self) -> Option<&Matrix3<f64>>;
    /// The body after a step: three of position, six of shape; `None` when it is not a sensible body any more.
    fn retract(&self, step: &SVector<f64, 9>) -> Option<Self>;
    /// Adds the prior on the deviation of the log semi-axes from their mean, weight 1/sd.
    fn add_shape_prior(&self, weight: f64, equations: &mut NormalEquations);
    /// Derivatives of the logarithms of the three semi-axes by the parameters.
    fn log_axes_gradient(&self) -> [Row; 3];
    /// Adds the prior that an axis of the body stands along `up` (unit vector), weight 1/sd (radians).
    fn add_upright_prior(&self, up: &Vector3<f64>, weight: f64, equations: &mut NormalEquations);
}
