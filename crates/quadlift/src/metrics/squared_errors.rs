//! Squared Mahalanobis distances of an estimate from the truth: of the center, the extents, the whole body.

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, Vector3};

use crate::geometry::linalg::solve_spd;
use crate::geometry::{Body, Ellipsoid, rotation_vector, vech3};
use crate::solve::{Covariance, CovarianceCoordinates, Matrix9};

/// Squared Mahalanobis distances of the truth from an estimate (ours). If the covariance is calibrated they follow
/// chi-square distributions: with 3 degrees of freedom for center and extents, with 9 for the whole body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SquaredErrors {
    /// Of the center, in the world.
    pub center: f64,
    /// Of the extents: the squared half extents along the world's axes (ellipsoids, `CenterVechShape`), or the
    /// logarithms of the semi-axes (`CenterRotationLogAxes`).
    pub extents: f64,
    /// Of all nine parameters of the body; [`super::nees`] for ellipsoids.
    pub whole: f64,
}

/// Indices of the diagonal of A among the nine parameters of `CenterVechShape`.
const SQUARED_EXTENTS: [usize; 3] = [3, 6, 8];

/// Squared Mahalanobis distances between an estimated and a true body, whose center is that of the same kind of body:
/// compare a tangent body with a tangent one.
///
/// Two bodies of one kind are compared in their half extents, others through their closest ellipsoids (see
/// [`Body::closest_ellipsoid`]). The axes of a body other than an ellipsoid can be named in 24 ways; the one closest to the
/// truth is used. `None` if the covariance is not positive definite.
pub fn squared_errors(estimate: &Body, covariance: &Covariance, truth: &Body) -> Option<SquaredErrors> {
    let (estimate, truth) = if estimate.kind == truth.kind {
        (estimate.inscribed(), truth.inscribed())
    } else {
        (estimate.closest_ellipsoid(), truth.closest_ellipsoid())
    };
    let matrix = &covariance.matrix;
    let of = |error: &SVector<f64, 9>, extents: [usize; 3]| {
        Some(SquaredErrors {
            center: distance(error, matrix, [0, 1, 2])?,
            extents: distance(error, matrix, extents)?,
            whole: distance(error, matrix, [0, 1, 2, 3, 4, 5, 6, 7, 8])?,
        })
    };
    match covariance.coordinates {
        CovarianceCoordinates::CenterVechShape => {
            let mut error = SVector::<f64, 9>::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&(estimate.center - truth.center));
            error.fixed_rows_mut::<6>(3).copy_from(&vech3(&(estimate.shape() - truth.shape())));
            of(&error, SQUARED_EXTENTS)
        }
        CovarianceCoordinates::CenterRotationLogAxes => named_axes()
            .iter()
            .filter_map(|naming| of(&oriented_error(&estimate, &truth, naming), [6, 7, 8]))
            .min_by(|a, b| a.whole.total_cmp(&b.whole)),
    }
}

/// The error in center, rotation vector (in the estimate's axes) and log semi-axes, when the columns of `naming` are the
/// estimate's axes among those of the truth.
fn oriented_error(estimate: &Ellipsoid, truth: &Ellipsoid, naming: &Matrix3<f64>) -> SVector<f64, 9> {
    let axes = Rotation3::from_matrix_unchecked(truth.rotation.matrix() * naming);
    let semi_axes = naming.abs().tr_mul(&truth.semi_axes);
    let mut error = SVector::<f64, 9>::zeros();
    error.fixed_rows_mut::<3>(0).copy_from(&(truth.center - estimate.center));
    error.fixed_rows_mut::<3>(3).copy_from(&rotation_vector(&(estimate.rotation.inverse() * axes)));
    error.fixed_rows_mut::<3>(6).copy_from(&Vector3::from_fn(|i, _| (semi_axes[i] / estimate.semi_axes[i]).ln()));
    error
}

/// The 24 rotations that exchange axes.
fn named_axes() -> Vec<Matrix3<f64>> {
    let mut all = Vec::with_capacity(24);
    for (x, y, z) in [(0, 1, 2), (1, 2, 0), (2, 0, 1), (1, 0, 2), (0, 2, 1), (2, 1, 0)] {
        for signs in 0..8u8 {
            let sign = |bit: u8| if signs >> bit & 1 == 0 { 1.0 } else { -1.0 };
            let mut matrix = Matrix3::zeros();
            (matrix[(x, 0)], matrix[(y, 1)], matrix[(z, 2)]) = (sign(0), sign(1), sign(2));
            if matrix.determinant() > 0.0 {
                all.push(matrix);
            }
        }
    }
    all
}

/// `e^T Sigma^-1 e` over some of the nine parameters.
fn distance<const N: usize>(error: &SVector<f64, 9>, covariance: &Matrix9, parameters: [usize; N]) -> Option<f64> {
    // The diagonal is scaled to one: parameters have different units.
    let scale = SVector::<f64, N>::from_fn(|i, _| covariance[(parameters[i], parameters[i])].sqrt().recip());
    let scaled = SMatrix::<f64, N, N>::from_fn(|i, j| covariance[(parameters[i], parameters[j])] * scale[i] * scale[j]);
    let error = SVector::<f64, N>::from_fn(|i, _| error[parameters[i]] * scale[i]);
    Some(error.dot(&solve_spd(&scaled, &error)?))
}

#[cfg(test)]
mod tests {
    use super::super::nees;
    use super::*;
    use crate::geometry::{Body, BodyKind};
    use nalgebra::Point3;

    fn covariance(coordinates: CovarianceCoordinates) -> Covariance {
        // Positive definite, with correlations.
        let root = Matrix9::from_fn(|i, j| if i == j { 1.0 + i as f64 } else { 0.3 * ((i * 7 + j * 3) as f64).sin() });
        Covariance { coordinates, matrix: root * root.transpose() * 0.01 }
    }

    #[test]
    fn of_ellipsoids_the_whole_is_nees_and_the_parts_are_marginals() {
        let truth = Ellipsoid {
            center: Point3::new(1.0, 2.0, 3.0),
            semi_axes: Vector3::new(3.0, 2.0, 1.0),
            rotation: Rotation3::from_euler_angles(0.2, -0.4, 0.9),
        };
        let estimate =
            Ellipsoid { center: Point3::new(1.3, 1.8, 3.1), semi_axes: Vector3::new(3.2, 1.9, 1.1), ..truth };
        let covariance = covariance(CovarianceCoordinates::CenterVechShape);
        let errors = squared_errors(&Body::from(estimate), &covariance, &Body::from(truth)).unwrap();
        let expected = nees(&estimate, &truth, &covariance.matrix).unwrap();
        assert!((errors.whole - expected).abs() < 1e-9 * expected);
        let marginal = |error: Vector3<f64>, places: [usize; 3]| {
            let block = Matrix3::from_fn(|i, j| covariance.matrix[(places[i], places[j])]);
            error.dot(&(block.try_inverse().unwrap() * error))
        };
        let center = marginal(estimate.center - truth.center, [0, 1, 2]);
        assert!((errors.center - center).abs() < 1e-9 * center);
        let extents = marginal((estimate.shape() - truth.shape()).diagonal(), [3, 6, 8]);
        assert!((errors.extents - extents).abs() < 1e-9 * extents);
        assert!(errors.whole >= errors.center.max(errors.extents));
    }

    #[test]
    fn how_the_axes_of_a_cuboid_are_named_does_not_matter() {
        let rotation = Rotation3::from_euler_angles(0.3, 0.5, -1.2);
        let center = Point3::new(0.5, 0.0, -2.0);
        let estimate = Body { kind: BodyKind::Cuboid, center, half_extents: Vector3::new(2.0, 1.0, 0.5), rotation };
        // A small turn, and sizes that differ by 5, 0 and -10 %.
        let turned = rotation * Rotation3::new(Vector3::new(0.02, -0.01, 0.03));
        let half_extents = Vector3::new(2.1, 1.0, 0.45);
        let covariance = covariance(CovarianceCoordinates::CenterRotationLogAxes);
        let plain = Body { kind: BodyKind::Cuboid, center, half_extents, rotation: turned };
        let expected = squared_errors(&estimate, &covariance, &plain).unwrap();
        let named = named_axes();
        assert_eq!(named.len(), 24);
        for naming in named {
            let renamed = Body {
                kind: BodyKind::Cuboid,
                center,
                half_extents: naming.abs().tr_mul(&half_extents),
                rotation: Rotation3::from_matrix_unchecked(turned.matrix() * naming),
            };
            let errors = squared_errors(&estimate, &covariance, &renamed).unwrap();
            assert!((errors.whole - expected.whole).abs() < 1e-9 * expected.whole, "{naming}");
            assert!((errors.extents - expected.extents).abs() < 1e-9 * expected.extents);
        }
        // The errors by hand.
        let error = SVector::<f64, 9>::from_column_slice(&[
            0.0,
            0.0,
            0.0,
            0.02,
            -0.01,
            0.03,
            (2.1f64 / 2.0).ln(),
            0.0,
            (0.45f64 / 0.5).ln(),
        ]);
        let by_hand = (error.transpose() * covariance.matrix.try_inverse().unwrap() * error)[0];
        assert!((expected.whole - by_hand).abs() < 1e-9 * by_hand);
        let singular = Covariance { matrix: Matrix9::zeros(), ..covariance };
        assert_eq!(squared_errors(&estimate, &singular, &plain), None);
    }
}
