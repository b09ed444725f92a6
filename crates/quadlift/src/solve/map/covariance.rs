//! Uncertainty of a fit: the inverse of the normal equations, in coordinates that can be interpreted (E6).

use super::super::conditioning::ObjectFrame;
use super::super::estimate::{Covariance, CovarianceCoordinates, Matrix9};
use super::body_model::EllipsoidModel;
use super::normal_equations::NormalEquations;
use crate::geometry::linalg::invert_spd;

/// Covariance of the ellipsoid's centre and `vech A`, in world units. There the normalised estimation error is right
/// even for narrow baselines; in logarithms of the shape it is ten times too confident.
pub(super) fn of_ellipsoid(
    model: &EllipsoidModel,
    equations: &NormalEquations,
    frame: &ObjectFrame,
) -> Option<Covariance> {
    let local = invert_spd(&equations.hessian())?;
    let mut map = Matrix9::zeros();
    map.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(frame.unit);
    map.fixed_view_mut::<6, 6>(3, 3).copy_from(&(model.shape_jacobian() * frame.unit * frame.unit));
    finished(map * local * map.transpose(), CovarianceCoordinates::CenterVechShape)
}

/// Covariance of centre, rotation vector and log semi-axes; only the centre depends on the unit and the model's axes
/// are those of the body.
pub(super) fn of_oriented(equations: &NormalEquations, frame: &ObjectFrame) -> Option<Covariance> {
    let local = invert_spd(&equations.hessian())?;
    let mut map = Matrix9::identity();
    map.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(frame.unit);
    finished(map * local * map.transpose(), CovarianceCoordinates::CenterRotationLogAxes)
}

fn finished(matrix: Matrix9, coordinates: CovarianceCoordinates) -> Option<Covariance> {
    let matrix = (matrix + matrix.transpose()) * 0.5;
    matrix.iter().all(|x| x.is_finite()).then_some(Covariance { coordinates, matrix })
}
