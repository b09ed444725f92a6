//! Uncertainty of a fit in coordinates that can be interpreted (E6).

use super::super::conditioning::ObjectFrame;
use super::super::estimate::{Covariance, CovarianceCoordinates, Matrix9};
use super::body_model::EllipsoidModel;

/// Derivatives of the ellipsoid's centre and `vech A`, in world units, by the parameters of the fit. In these coordinates
/// the normalised estimation error is right even for narrow baselines; in logarithms of the shape it is ten times too
/// confident.
pub(super) fn ellipsoid_in_world(model: &EllipsoidModel, frame: &ObjectFrame) -> Matrix9 {
    let mut map = Matrix9::zeros();
    map.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(frame.unit);
    map.fixed_view_mut::<6, 6>(3, 3).copy_from(&(model.shape_jacobian() * frame.unit * frame.unit));
    map
}

/// The same of centre, rotation vector and log semi-axes; only the centre depends on the unit and the model's axes are
/// those of the body.
pub(super) fn oriented_in_world(frame: &ObjectFrame) -> Matrix9 {
    let mut map = Matrix9::identity();
    map.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(frame.unit);
    map
}

/// A covariance in world units from one in the parameters of the fit; `None` when it is not finite.
pub(super) fn in_world(local: &Matrix9, in_world: &Matrix9, coordinates: CovarianceCoordinates) -> Option<Covariance> {
    let matrix = in_world * local * in_world.transpose();
    let matrix = (matrix + matrix.transpose()) * 0.5;
    matrix.iter().all(|x| x.is_finite()).then_some(Covariance { coordinates, matrix })
}
