//! Uncertainty of a fit in coordinates that can be interpreted (docs/method.md, section 12.1).

use crate::body_model::ellipsoid::{EllipsoidModel, shape_jacobian};
use crate::geometry::linalg::cholesky;
use crate::geometry::{VECH3, vech3};
use crate::optimize::normal_equations::{NormalEquations, PARAMETERS};
use crate::solve::conditioning::ObjectFrame;
use crate::solve::estimate::{Covariance, CovarianceCoordinates, Matrix9};
use nalgebra::{Matrix3, SMatrix};

/// Derivatives of the ellipsoid's center and `vech A`, in world units, by the parameters of the fit. In these coordinates
/// the normalized estimation error is right even for narrow baselines; in logarithms of the shape it is ten times too
/// confident.
pub(crate) fn ellipsoid_in_world(model: &EllipsoidModel, frame: &ObjectFrame) -> Matrix9 {
    let mut map = Matrix9::zeros();
    map.fixed_view_mut::<3, 3>(0, 0).copy_from(&(frame.axes * frame.unit));
    let turn = turn_of_shape(&frame.axes);
    map.fixed_view_mut::<6, 6>(3, 3).copy_from(&(turn * shape_jacobian(&model.root()) * frame.unit * frame.unit));
    map
}

/// Derivatives of `vech (R A R^T)` by `vech A`.
fn turn_of_shape(rotation: &Matrix3<f64>) -> SMatrix<f64, 6, 6> {
    let columns = VECH3.map(|(i, j)| {
        let mut unit = Matrix3::zeros();
        (unit[(i, j)], unit[(j, i)]) = (1.0, 1.0);
        vech3(&(rotation * unit * rotation.transpose()))
    });
    SMatrix::from_columns(&columns)
}

/// The same of center, rotation vector and log semi-axes; only the center depends on the unit and the model's axes are
/// those of the body.
pub(crate) fn oriented_in_world(frame: &ObjectFrame) -> Matrix9 {
    let mut map = Matrix9::identity();
    map.fixed_view_mut::<3, 3>(0, 0).copy_from(&(frame.axes * frame.unit));
    map
}

/// A covariance in world units from one in the parameters of the fit; `None` when it is not finite.
pub(crate) fn in_world(local: &Matrix9, in_world: &Matrix9, coordinates: CovarianceCoordinates) -> Option<Covariance> {
    let matrix = in_world * local * in_world.transpose();
    let matrix = (matrix + matrix.transpose()) * 0.5;
    matrix.iter().all(|x| x.is_finite()).then_some(Covariance { coordinates, matrix })
}

/// Precision of a Gaussian with the volume of the rotations that differ for a body with the symmetry of a cuboid with
/// equal edges: `(2 pi)^(3/2) s^3 = 8 pi^2 / 24`, `1 / s^2`.
const ROTATION_PRECISION: f64 = 2.84;

/// `ln det H` with a prior on the rotation, of which three parameters know nothing where axes are equal; `None` where H is
/// singular.
pub(crate) fn log_determinant_of(equations: &NormalEquations) -> Option<f64> {
    // Twice the sum of the logarithms of Cholesky's diagonal.
    cholesky(&regularized(equations)).map(|l| (0..PARAMETERS).map(|k| 2.0 * l[(k, k)].ln()).sum())
}

/// The normal equations with a prior on the rotation.
pub(crate) fn regularized(equations: &NormalEquations) -> SMatrix<f64, PARAMETERS, PARAMETERS> {
    let mut hessian = equations.hessian();
    for k in 3..6 {
        hessian[(k, k)] += ROTATION_PRECISION;
    }
    hessian
}
