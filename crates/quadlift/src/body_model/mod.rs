//! Bodies as nine numbers that can be moved a little: position, and what the support function needs.
//!
//! Everything is in the object's frame (see [`crate::solve::conditioning`]): lengths are about one.

pub(crate) mod ellipsoid;
pub(crate) mod oriented;

use nalgebra::{Matrix3, SVector, Vector3};

use crate::optimize::normal_equations::{NormalEquations, Row};
use crate::sorting::StableSort;

/// Largest ratio of the longest to the shortest semi-axis that a step may reach.
pub(crate) const MAX_ASPECT: f64 = 1e6;

/// Size and rotation of a measured box, in the object's frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct MeasuredShape {
    /// Its axes as columns, if known.
    pub axes: Option<Matrix3<f64>>,
    /// Logarithms of its half extents along them, if known.
    pub log_half_extents: Option<Vector3<f64>>,
    /// Whether its axes are length, width and height as those of the body are.
    pub named: bool,
}

/// Residuals with their derivatives: measured less predicted.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ShapeDifference {
    /// Logarithms of the half extents.
    pub size: Option<[(f64, Row); 3]>,
    /// Rotation about each axis of the measured box, radians.
    pub rotation: Option<[(f64, Row); 3]>,
}

/// The indices of three numbers, the largest first.
pub(crate) fn descending(values: &Vector3<f64>) -> [usize; 3] {
    let mut order = [0, 1, 2];
    order.stable_sort_by(|&a, &b| values[b].total_cmp(&values[a]));
    order
}

/// Which axis of a body is which of a measured box without rotation: the longest is the longest.
fn by_length(semi_axes: &Vector3<f64>, log_half_extents: &Vector3<f64>) -> [usize; 3] {
    let mut axes = [0; 3];
    for (axis, measured) in descending(semi_axes).into_iter().zip(descending(log_half_extents)) {
        axes[measured] = axis;
    }
    axes
}

/// Logarithms of a measured box's half extents less those of these axes of a body.
fn size_differences(body: &impl BodyModel, log_half_extents: &Vector3<f64>, axes: [usize; 3]) -> [(f64, Row); 3] {
    let (semi_axes, gradients) = (body.semi_axes(), body.log_axes_gradient());
    std::array::from_fn(|k| (log_half_extents[k] - semi_axes[axes[k]].ln(), gradients[axes[k]].map(|x| -x)))
}

/// A body that the solver can fit.
pub(crate) trait BodyModel: Clone + Send + Sync {
    /// Center.
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
    /// The entries of `1/2 log A` of an ellipsoid between these directions (orthonormal columns): the diagonal, then those of rows and
    /// columns (1, 0), (2, 0), (2, 1) times the root of two, with their derivatives; `None` for other bodies.
    fn log_shape_along(&self, axes: &Matrix3<f64>) -> Option<[(f64, Row); 6]>;
    /// Adds what is known about the spin of a cylinder about its axis.
    fn add_spin_prior(&self, equations: &mut NormalEquations);
    /// Derivatives of the logarithms of the three semi-axes by the parameters.
    fn log_axes_gradient(&self) -> [Row; 3];
    /// How far the visible surface lies before the center, the median over the outline, seen from far along the unit vector
    /// `ray`; with the derivatives by the six shape parameters (docs/method.md, section 19.1).
    fn near_side(&self, ray: &Vector3<f64>) -> (f64, [f64; 6]);
    /// How a measured box differs in size and rotation (docs/method.md, section 19.2).
    fn compare(&self, measured: &MeasuredShape) -> ShapeDifference;
    /// Adds the prior that an axis of the body stands along `up` (unit vector), weight 1/sd (radians).
    fn add_upright_prior(&self, up: &Vector3<f64>, weight: f64, equations: &mut NormalEquations);
}
