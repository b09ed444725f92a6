//! The logarithm of an ellipsoid's shape: six numbers in which sizes and directions of axes are compared.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use crate::geometry::linalg::symmetric_eigen3;
use crate::geometry::{Ellipsoid, VECH3};
use crate::solve::Covariance;

/// Entries of a symmetric matrix in the order of [`coordinates`], and their factors: with them the squared norm is that of the matrix.
const ENTRIES: [(usize, usize, f64); 6] = [
    (0, 0, 1.0),
    (1, 1, 1.0),
    (2, 2, 1.0),
    (1, 0, std::f64::consts::SQRT_2),
    (2, 0, std::f64::consts::SQRT_2),
    (2, 1, std::f64::consts::SQRT_2),
];

/// Eigenvalues whose relative difference is less count as equal.
const EQUAL: f64 = 1e-6;

/// The six coordinates of a symmetric matrix; their distances do not change when the matrix is rotated.
pub(super) fn coordinates(m: &Matrix3<f64>) -> Vector6<f64> {
    Vector6::from_fn(|k, _| {
        let (i, j, factor) = ENTRIES[k];
        m[(i, j)] * factor
    })
}

/// The symmetric matrix whose coordinates are those of one axis.
fn basis(k: usize) -> Matrix3<f64> {
    let (i, j, factor) = ENTRIES[k];
    let mut m = Matrix3::zeros();
    m[(i, j)] = 1.0 / factor;
    m[(j, i)] = 1.0 / factor;
    m
}

/// The matrix that rotates coordinates: those of `R m R^T` from those of `m`.
pub(super) fn rotation_of_coordinates(rotation: &Matrix3<f64>) -> Matrix6<f64> {
    let columns: [Vector6<f64>; 6] =
        std::array::from_fn(|k| coordinates(&(rotation * basis(k) * rotation.transpose())));
    Matrix6::from_columns(&columns)
}

/// `log A` of the shape matrix A.
pub(super) fn log_shape(body: &Ellipsoid) -> Matrix3<f64> {
    let r = body.rotation.matrix();
    r * Matrix3::from_diagonal(&body.semi_axes.map(|x| 2.0 * x.ln())) * r.transpose()
}

/// The covariance of the coordinates of `log A` from that of a body; `None` where A has no eigenvalues.
pub(super) fn covariance_of_log_shape(body: &Ellipsoid, covariance: &Covariance) -> Option<Matrix6<f64>> {
    let of_shape = covariance.in_center_vech_shape(body).fixed_view::<6, 6>(3, 3).into_owned();
    let (values, vectors) = symmetric_eigen3(&body.shape())?;
    let columns: [Vector6<f64>; 6] = std::array::from_fn(|k| {
        let (i, j) = VECH3[k];
        let mut by = Matrix3::zeros();
        by[(i, j)] = 1.0;
        by[(j, i)] = 1.0;
        coordinates(&slope_of_log(&values, &vectors, &by))
    });
    let slopes = Matrix6::from_columns(&columns);
    let result = slopes * of_shape * slopes.transpose();
    result.iter().all(|x| x.is_finite()).then_some(result)
}

/// The derivative of `log A` in a direction, from the eigenvalues and eigenvectors of A (Daleckii and Krein).
fn slope_of_log(values: &Vector3<f64>, vectors: &Matrix3<f64>, by: &Matrix3<f64>) -> Matrix3<f64> {
    let in_axes = vectors.transpose() * by * vectors;
    let scaled = Matrix3::from_fn(|i, j| {
        let (x, y) = (values[i], values[j]);
        let factor = if (x - y).abs() < EQUAL * x { 1.0 / x } else { (x / y).ln() / (x - y) };
        in_axes[(i, j)] * factor
    });
    vectors * scaled * vectors.transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::{CovarianceCoordinates, Matrix9};
    use nalgebra::{Point3, Rotation3};

    fn body(semi_axes: [f64; 3]) -> Ellipsoid {
        Ellipsoid {
            center: Point3::origin(),
            semi_axes: semi_axes.into(),
            rotation: Rotation3::from_euler_angles(0.5, -0.2, 1.0),
        }
    }

    #[test]
    fn coordinates_rotate_and_keep_the_norm() {
        let m = log_shape(&body([0.7, 0.4, 0.2]));
        assert!((coordinates(&m).norm() - m.norm()).abs() < 1e-12);
        let turn = *Rotation3::from_euler_angles(1.0, 0.3, -0.7).matrix();
        let rotated = rotation_of_coordinates(&turn) * coordinates(&m);
        assert!((rotated - coordinates(&(turn * m * turn.transpose()))).norm() < 1e-12);
    }

    #[test]
    fn covariances_are_those_of_differences() {
        // Steps of one coordinate of the body, in both ways of writing its covariance.
        for semi_axes in [[0.7, 0.4, 0.2], [0.5, 0.5, 0.5]] {
            let body = body(semi_axes);
            for k in 0..6 {
                let step = |size: f64| {
                    let mut shape = body.shape();
                    let (i, j) = VECH3[k];
                    shape[(i, j)] += size;
                    shape[(j, i)] = shape[(i, j)];
                    coordinates(&log_shape(&Ellipsoid::from_shape(body.center, &shape).unwrap()))
                };
                compare(&body, CovarianceCoordinates::CenterVechShape, k, (step(1e-6) - step(-1e-6)) / 2e-6);
                let step = |size: f64| {
                    let mut moved = body;
                    let mut axis = Vector3::zeros();
                    axis[k % 3] = size;
                    match k {
                        0..3 => moved.rotation = body.rotation * Rotation3::new(axis),
                        _ => moved.semi_axes = body.semi_axes.component_mul(&axis.map(f64::exp)),
                    }
                    coordinates(&log_shape(&moved))
                };
                compare(&body, CovarianceCoordinates::CenterRotationLogAxes, k, (step(1e-6) - step(-1e-6)) / 2e-6);
            }
        }
    }

    fn compare(body: &Ellipsoid, coordinates: CovarianceCoordinates, k: usize, slope: Vector6<f64>) {
        let mut matrix = Matrix9::zeros();
        matrix[(3 + k, 3 + k)] = 1.0;
        let found = covariance_of_log_shape(body, &Covariance { coordinates, matrix }).unwrap();
        let expected = slope * slope.transpose();
        assert!((found - expected).norm() < 1e-5 * (1.0 + expected.norm()), "{k}: {found} {expected}");
    }
}
