//! Normalized estimation error squared: whether a covariance is consistent with the error.

use nalgebra::SVector;

use crate::geometry::linalg::solve_spd;
use crate::geometry::{Ellipsoid, vech3};
use crate::solve::Matrix9;

/// The normalized estimation error squared `e^T Sigma^-1 e`, with `e` the error of the center (3) and of `vech` of the
/// shape matrix A (6), the coordinates of [`crate::solve::CovarianceCoordinates::CenterVechShape`].
///
/// If the covariance is correct it follows chi-square with 9 degrees of freedom (mean 9, median 8.34). `None` if the
/// covariance is not positive definite.
pub fn nees(estimate: &Ellipsoid, truth: &Ellipsoid, covariance: &Matrix9) -> Option<f64> {
    let mut error = SVector::<f64, 9>::zeros();
    error.fixed_rows_mut::<3>(0).copy_from(&(estimate.center - truth.center));
    error.fixed_rows_mut::<6>(3).copy_from(&vech3(&(estimate.shape() - truth.shape())));
    // The diagonal is scaled to one: the two parts have different units.
    let scale = covariance.diagonal().map(|variance| 1.0 / variance.sqrt());
    let scaled = Matrix9::from_fn(|i, j| covariance[(i, j)] * scale[i] * scale[j]);
    let error = error.component_mul(&scale);
    Some(error.dot(&solve_spd(&scaled, &error)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Rotation3, Vector3};

    #[test]
    fn known_errors_in_units_of_their_deviation() {
        let truth = Ellipsoid {
            center: Point3::new(1.0, 2.0, 3.0),
            semi_axes: Vector3::new(3.0, 2.0, 1.0),
            rotation: Rotation3::identity(),
        };
        // The center is off by two standard deviations, A_11 by one.
        let estimate = Ellipsoid {
            center: truth.center + Vector3::new(0.0, 0.2, 0.0),
            semi_axes: Vector3::new(10.0f64.sqrt(), 2.0, 1.0),
            ..truth
        };
        let mut covariance = Matrix9::identity();
        covariance[(1, 1)] = 0.01;
        assert!((nees(&estimate, &truth, &covariance).unwrap() - 5.0).abs() < 1e-9);
        // A correlation of 0.6 between the two: (x^2 - 2 rho x y + y^2) / (1 - rho^2).
        covariance[(1, 3)] = 0.06;
        covariance[(3, 1)] = 0.06;
        assert!((nees(&estimate, &truth, &covariance).unwrap() - (4.0 - 2.4 + 1.0) / 0.64).abs() < 1e-9);
        assert_eq!(nees(&estimate, &truth, &Matrix9::zeros()), None);
    }
}
