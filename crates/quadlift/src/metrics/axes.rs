//! Center, orientation and size of ellipsoids against the truth.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

use crate::geometry::Ellipsoid;
use crate::sorting::StableSort;

/// Maximum ratio of two semi-axes of a body that counts as round about the third: any direction
/// between the two is as good as theirs.
const MAX_ROUND_RATIO: f64 = 1.1;

/// Maximum ratio of two semi-axes that may be exchanged: small errors of their lengths decide which
/// one is the longer.
const MAX_EXCHANGEABLE_RATIO: f64 = 1.2;

/// Distance between two centers, in world units.
pub fn center_error(estimate: &Point3<f64>, truth: &Point3<f64>) -> f64 {
    (estimate - truth).norm()
}

/// Angle between the longest axes, in [0, pi/2] radians: theta_err of the paper.
///
/// Of equal longest axes the first one counts; the angle means little then.
pub(super) fn main_axis_angle(a: &Ellipsoid, b: &Ellipsoid) -> f64 {
    let axis = |e: &Ellipsoid| e.rotation.matrix().column(e.semi_axes.imax()).into_owned();
    let (u, v) = (axis(a), axis(b));
    u.cross(&v).norm().atan2(u.dot(&v).abs())
}

/// Angle of the estimate's longest axis to an axis of the truth that may be meant by it, in
/// [0, pi/2] radians: the axis error modulo the symmetry of the true body.
///
/// That is the longest axis, or one that is nearly as long (an axis of a screen of 0.38 by 0.35 may
/// be named otherwise). About as long axes span a plane in which any direction counts; of a ball no
/// direction is known, and the result is `None`.
pub fn axis_error(estimate: &Ellipsoid, truth: &Ellipsoid) -> Option<f64> {
    let longest = estimate.rotation.matrix().column(estimate.semi_axes.imax()).into_owned();
    let order = descending(truth);
    let [long, middle, short] = order.map(|axis| truth.semi_axes[axis]);
    let [first, second, third] = order.map(|axis| truth.rotation.matrix().column(axis).into_owned());
    let to_line = |axis: &Vector3<f64>| longest.cross(axis).norm().atan2(longest.dot(axis).abs());
    let to_plane = |normal: &Vector3<f64>| FRAC_PI_2 - to_line(normal);
    if long <= MAX_ROUND_RATIO * short {
        return None;
    }
    let mut error = if long <= MAX_ROUND_RATIO * middle { to_plane(&third) } else { to_line(&first) };
    if long <= MAX_EXCHANGEABLE_RATIO * middle {
        error = error.min(to_line(&second));
    }
    if long <= MAX_EXCHANGEABLE_RATIO * short {
        error = error.min(to_line(&third));
    }
    Some(error)
}

/// The smallest angle of a rotation from the axes of `a` to those of `b`, in [0, 2 pi / 3] radians.
///
/// Axes correspond by their length (longest to longest, and so on), whatever their order in the two bodies. The
/// remaining symmetry is that of a body with three different axes, the half turns about each of them. Where two
/// axes are nearly equal, the body does not determine their directions, and the angle overstates the error.
pub(super) fn rotation_error_modulo_symmetry(a: &Ellipsoid, b: &Ellipsoid) -> f64 {
    let q = UnitQuaternion::from_rotation_matrix(&(sorted_rotation(a).inverse() * sorted_rotation(b)));
    // Half turns permute the four components (up to sign): the best of them puts the largest one first.
    let components = q.coords;
    let largest = components.iamax();
    let rest: f64 = (0..4).filter(|&i| i != largest).map(|i| components[i] * components[i]).sum();
    2.0 * rest.sqrt().atan2(components[largest].abs())
}

/// Relative errors `(estimate - truth) / truth` of the semi-axes in descending order.
pub(super) fn sorted_axes_error(estimate: &Ellipsoid, truth: &Ellipsoid) -> Vector3<f64> {
    let (estimate_order, truth_order) = (descending(estimate), descending(truth));
    Vector3::from_fn(|i, _| estimate.semi_axes[estimate_order[i]] / truth.semi_axes[truth_order[i]] - 1.0)
}

/// Indices of the semi-axes from the longest to the shortest.
fn descending(e: &Ellipsoid) -> [usize; 3] {
    let mut order = [0, 1, 2];
    order.stable_sort_by(|&i, &j| e.semi_axes[j].total_cmp(&e.semi_axes[i]));
    order
}

/// The rotation whose columns are the axes from the longest to the shortest.
fn sorted_rotation(e: &Ellipsoid) -> Rotation3<f64> {
    let order = descending(e);
    let mut axes = Matrix3::from_fn(|i, j| e.rotation[(i, order[j])]);
    if axes.determinant() < 0.0 {
        axes.column_mut(2).neg_mut();
    }
    Rotation3::from_matrix_unchecked(axes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn ellipsoid(semi_axes: [f64; 3], rotation: Rotation3<f64>) -> Ellipsoid {
        Ellipsoid { center: Point3::origin(), semi_axes: Vector3::from(semi_axes), rotation }
    }

    #[test]
    fn the_main_axis_has_no_sign() {
        let a = ellipsoid([1.0, 3.0, 2.0], Rotation3::identity());
        let turned = |angle: f64| ellipsoid([1.0, 3.0, 2.0], Rotation3::from_axis_angle(&Vector3::x_axis(), angle));
        assert!(main_axis_angle(&a, &turned(PI)) < 1e-15);
        assert!((main_axis_angle(&a, &turned(0.3)) - 0.3).abs() < 1e-12);
        assert!((main_axis_angle(&a, &turned(PI - 1e-9)) - 1e-9).abs() < 1e-15);
        assert!((main_axis_angle(&a, &turned(FRAC_PI_2)) - FRAC_PI_2).abs() < 1e-12);
        // The same body with its axes in another order.
        let renamed = ellipsoid([3.0, 2.0, 1.0], sorted_rotation(&a));
        assert!(main_axis_angle(&a, &renamed) < 1e-15);
        assert!(rotation_error_modulo_symmetry(&a, &renamed) < 1e-9);
        assert_eq!(sorted_axes_error(&renamed, &a), Vector3::zeros());
    }

    #[test]
    fn the_order_of_the_axes_does_not_matter_whatever_its_hand() {
        // All orders of the axes; half of them make a left-handed frame of a right-handed one.
        let truth = ellipsoid([3.0, 2.0, 1.0], Rotation3::from_euler_angles(0.7, -0.4, 1.9));
        let turn = Rotation3::from_euler_angles(0.1, 0.05, -0.08);
        for order in [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]] {
            let mut axes = Matrix3::from_fn(|i, j| (truth.rotation * turn)[(i, order[j])]);
            if axes.determinant() < 0.0 {
                axes *= -1.0;
            }
            let rotation = Rotation3::from_matrix_unchecked(axes);
            let renamed = ellipsoid(order.map(|k| truth.semi_axes[k]), rotation);
            let error = rotation_error_modulo_symmetry(&renamed, &truth);
            assert!((error - turn.angle()).abs() < 1e-9, "{order:?}: {error} {}", turn.angle());
        }
    }

    #[test]
    fn axes_of_about_one_length_may_be_named_otherwise() {
        let truth = |semi_axes| ellipsoid(semi_axes, Rotation3::identity());
        let turned = |angle: f64| Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
        let error =
            |semi_axes: [f64; 3], angle: f64| axis_error(&ellipsoid([3.0, 2.0, 1.0], turned(angle)), &truth(semi_axes));
        let close = |found: Option<f64>, expected: f64| assert!((found.unwrap() - expected).abs() < 1e-9, "{found:?}");
        // Three different axes: the angle between the longest.
        close(error([3.0, 2.0, 1.0], FRAC_PI_2 - 0.01), FRAC_PI_2 - 0.01);
        // Nearly a square: the other axis is as good, but not the diagonal.
        close(error([1.15, 1.0, 0.2], FRAC_PI_2 - 0.01), 0.01);
        close(error([1.15, 1.0, 0.2], 0.7), 0.7);
        // A plate and a cylinder are round: only the axis of the plate counts.
        close(error([1.0, 1.0, 0.2], 0.7), 0.0);
        close(error([0.2, 1.0, 1.0], 0.3), FRAC_PI_2 - 0.3);
        close(error([0.5, 0.5, 3.0], 0.3), FRAC_PI_2);
        assert_eq!(error([1.0, 1.05, 0.97], 0.7), None);
    }

    #[test]
    fn size_errors_are_relative_and_signed() {
        let truth = ellipsoid([1.0, 4.0, 2.0], Rotation3::identity());
        let estimate = ellipsoid([3.0, 1.0, 2.0], Rotation3::identity());
        assert!((sorted_axes_error(&estimate, &truth) - Vector3::new(-0.25, 0.0, 0.0)).norm() < 1e-15);
    }

    proptest! {
        #[test]
        fn the_rotation_error_is_the_smallest_over_the_half_turns(
            p in prop::array::uniform3(-3.0..3.0f64), q in prop::array::uniform3(-3.0..3.0f64),
        ) {
            let rotation = |v: [f64; 3]| Rotation3::from_euler_angles(v[0], v[1], v[2]);
            let (a, b) = (ellipsoid([3.0, 2.0, 1.0], rotation(p)), ellipsoid([3.0, 2.0, 1.0], rotation(q)));
            let turns = [
                Rotation3::identity(),
                Rotation3::from_axis_angle(&Vector3::x_axis(), PI),
                Rotation3::from_axis_angle(&Vector3::y_axis(), PI),
                Rotation3::from_axis_angle(&Vector3::z_axis(), PI),
            ];
            let expected =
                turns.iter().map(|turn| (a.rotation * turn).angle_to(&b.rotation)).fold(f64::INFINITY, f64::min);
            prop_assert!((rotation_error_modulo_symmetry(&a, &b) - expected).abs() < 1e-7);
            prop_assert!(expected <= 2.0 * PI / 3.0 + 1e-9);
        }
    }
}
