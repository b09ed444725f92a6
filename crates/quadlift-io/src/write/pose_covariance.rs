//! Covariances of poses as in ROS's `geometry_msgs`: 6x6, position and then turns about the fixed axes of the world.

use std::f64::consts::PI;

use nalgebra::{Matrix3, SMatrix};
use quadlift::geometry::Body;
use quadlift::solve::{Covariance, CovarianceCoordinates};

type Matrix6 = SMatrix<f64, 6, 6>;

/// Variance of an unknown angle: uniform between -pi and pi.
const UNKNOWN_ANGLE: f64 = PI * PI / 3.0;

/// A turn with a greater variance (squared radians) than this is not known: the linear law of errors ends there.
const MAX_VARIANCE: f64 = 1.0;

/// Covariance of position (meters) and turns about the world's axes (radians).
pub(super) fn pose_covariance(covariance: &Covariance, body: &Body, meters: f64) -> Matrix6 {
    let r = body.rotation.matrix();
    // The turn in the object's frame as a linear function of the six coordinates after the center.
    let turn = match covariance.coordinates {
        CovarianceCoordinates::CenterRotationLogAxes => {
            let mut turn = SMatrix::<f64, 3, 6>::zeros();
            turn.fixed_columns_mut::<3>(0).copy_from(&Matrix3::identity());
            turn
        }
        CovarianceCoordinates::CenterVechShape => turn_from_shape(body),
    };
    let mut map = SMatrix::<f64, 6, 9>::zeros();
    map.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(meters);
    map.fixed_view_mut::<3, 6>(3, 3).copy_from(&(r * turn));
    let mut result = map * covariance.matrix * map.transpose();
    let turns = result.fixed_view::<3, 3>(3, 3);
    if !result.iter().all(|x| x.is_finite()) || turns.diagonal().max() > MAX_VARIANCE {
        let center = covariance.matrix.fixed_view::<3, 3>(0, 0) * (meters * meters);
        result = Matrix6::from_diagonal_element(UNKNOWN_ANGLE);
        result.fixed_view_mut::<3, 3>(0, 0).copy_from(&center);
    }
    result
}

/// How an ellipsoid turns in its own frame when `vech A` changes, to first order: `A = R D R^T` gives
/// `(R^T dA R)_ij = w_ij (D_j - D_i)`, with `w` the antisymmetric matrix of the turn. Infinite for equal axes.
fn turn_from_shape(body: &Body) -> SMatrix<f64, 3, 6> {
    let (r, a) = (body.rotation.matrix(), body.half_extents);
    let mut turn = SMatrix::zeros();
    for (column, (k, l)) in [(0, 0), (1, 0), (2, 0), (1, 1), (2, 1), (2, 2)].into_iter().enumerate() {
        let mut change = Matrix3::zeros();
        change[(k, l)] = 1.0;
        change[(l, k)] = 1.0;
        let local = r.transpose() * change * r;
        for (axis, (i, j)) in [(2, 1), (0, 2), (1, 0)].into_iter().enumerate() {
            turn[(axis, column)] = local[(i, j)] / (a[j] * a[j] - a[i] * a[i]);
        }
    }
    turn
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Rotation3, Vector3};
    use quadlift::geometry::{Ellipsoid, vech3};
    use quadlift::solve::Matrix9;

    #[test]
    fn turns_follow_the_shape_matrix() {
        let rotation = Rotation3::from_euler_angles(0.3, -0.8, 1.1);
        let body = Ellipsoid { center: Point3::origin(), semi_axes: Vector3::new(3.0, 1.0, 2.0), rotation };
        let body = &Body::from(body);
        let jacobian = turn_from_shape(body);
        // A small turn about the object's axes, there and back, and what the shape matrix makes of it.
        let turn = Vector3::new(1e-6, -2e-6, 3e-6);
        let turned = |turn| Body { rotation: rotation * Rotation3::new(turn), ..*body }.inscribed();
        let change = (vech3(&turned(turn).shape()) - vech3(&turned(-turn).shape())) * 0.5;
        assert!((jacobian * change - turn).norm() < 1e-13, "{}", jacobian * change);
    }

    #[test]
    fn covariances_are_in_meters_about_the_axes_of_the_world() {
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
        let body = Ellipsoid { center: Point3::origin(), semi_axes: Vector3::new(3.0, 1.0, 2.0), rotation };
        let body = &Body::from(body);
        let mut matrix = Matrix9::identity() * 4.0;
        for k in 3..6 {
            matrix[(k, k)] = 0.01 * k as f64;
        }
        let coordinates = CovarianceCoordinates::CenterRotationLogAxes;
        let found = pose_covariance(&Covariance { coordinates, matrix }, body, 0.001);
        // The object's x axis is the world's y axis.
        let expected = [4e-6, 4e-6, 4e-6, 0.04, 0.03, 0.05];
        assert!((found.diagonal() - SMatrix::<f64, 6, 1>::from(expected)).amax() < 1e-12, "{found}");
        // A turn that is hardly known, and a ball.
        matrix[(3, 3)] = 2.0;
        let vague = pose_covariance(&Covariance { coordinates, matrix }, body, 1.0);
        assert_eq!(vague.diagonal().as_slice()[3..], [UNKNOWN_ANGLE; 3]);
        let ball = Body { half_extents: Vector3::repeat(1.0), ..*body };
        let coordinates = CovarianceCoordinates::CenterVechShape;
        let found = pose_covariance(&Covariance { coordinates, matrix: Matrix9::identity() }, &ball, 1.0);
        assert_eq!(found.diagonal().as_slice(), [1.0, 1.0, 1.0, UNKNOWN_ANGLE, UNKNOWN_ANGLE, UNKNOWN_ANGLE]);
    }
}
