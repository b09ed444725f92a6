//! Uncertainty of a fit in coordinates that can be interpreted (E6).

use crate::body_model::ellipsoid::EllipsoidModel;
use crate::geometry::linalg::cholesky;
use crate::optimize::normal_equations::{NormalEquations, PARAMETERS};
use crate::solve::conditioning::ObjectFrame;
use crate::solve::estimate::{Covariance, CovarianceCoordinates, Matrix9};
use nalgebra::SMatrix;

/// Derivatives of the ellipsoid's centre and `vech A`, in world units, by the parameters of the fit. In these coordinates
/// the normalised estimation error is right even for narrow baselines; in logarithms of the shape it is ten times too
/// confident.
pub(crate) fn ellipsoid_in_world(model: &EllipsoidModel, frame: &ObjectFrame) -> Matrix9 {
    let mut map = Matrix9::zeros();
    map.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(frame.unit);
    map.fixed_view_mut::<6, 6>(3, 3).copy_from(&(model.shape_jacobian() * frame.unit * frame.unit));
    map
}

/// The same of centre, rotation vector and log semi-axes; only the centre depends on the unit and the model's axes are
/// those of the body.
pub(crate) fn oriented_in_world(frame: &ObjectFrame) -> Matrix9 {
    let mut map = Matrix9::identity();
    map.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(frame.unit);
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
    cholesky(&regularised(equations)).map(|l| (0..PARAMETERS).map(|k| 2.0 * l[(k, k)].ln()).sum())
}

/// The normal equations with a prior on the rotation.
pub(crate) fn regularised(equations: &NormalEquations) -> SMatrix<f64, PARAMETERS, PARAMETERS> {
    let mut hessian = equations.hessian();
    for k in 3..6 {
        hessian[(k, k)] += ROTATION_PRECISION;
    }
    hessian
}
