//! Rotations: quaternions (w first in files), exponential map, checks.

use nalgebra::{Matrix3, Quaternion, Rotation3, Unit, UnitQuaternion, Vector3};

/// The golden angle, radians: points of a spiral that turns by it are spread evenly over a disc or a sphere.
pub(crate) const GOLDEN_ANGLE: f64 = 2.399_963_229_728_653;

/// A unit vector of the spiral on a sphere, with this height: heights at even distances give directions that are spread evenly.
pub(crate) fn on_spiral(index: usize, z: f64) -> Vector3<f64> {
    let (sin, cos) = (index as f64 * GOLDEN_ANGLE).sin_cos();
    let radius = (1.0 - z * z).sqrt();
    Vector3::new(radius * cos, radius * sin, z)
}

/// Iterations after which a singular value decomposition is given up.
const MAX_SVD_STEPS: usize = 200;

/// The rotation of a unit quaternion `[w, x, y, z]`.
///
/// `None` when the quaternion is not finite or its norm is off from one by more than 1e-3.
pub fn rotation_from_quaternion(wxyz: [f64; 4]) -> Option<Rotation3<f64>> {
    let [w, x, y, z] = wxyz;
    let norm = (w * w + x * x + y * y + z * z).sqrt();
    if !norm.is_finite() || (norm - 1.0).abs() > 1e-3 {
        return None;
    }
    Some(UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix())
}

/// The unit quaternion `[w, x, y, z]` of a rotation, with `w >= 0`.
pub fn quaternion_from_rotation(rotation: &Rotation3<f64>) -> [f64; 4] {
    let q = UnitQuaternion::from_rotation_matrix(rotation);
    let sign = if q.w < 0.0 { -1.0 } else { 1.0 };
    [sign * q.w, sign * q.i, sign * q.j, sign * q.k]
}

/// The rotation vector: the axis times the angle in radians, up to pi.
///
/// Unlike `Rotation3::scaled_axis`, whose angle is an arc cosine, it is exact for small angles, and never NaN.
pub fn rotation_vector(rotation: &Rotation3<f64>) -> Vector3<f64> {
    UnitQuaternion::from_rotation_matrix(rotation).scaled_axis()
}

/// The matrix `[w]x` with `[w]x v = w x v`.
pub(crate) fn skew(w: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -w.z, w.y, w.z, 0.0, -w.x, -w.y, w.x, 0.0)
}

/// How far a 3x3 matrix is from being a rotation: the largest entry of `|R R^T - I|`, or infinity when its
/// determinant is not positive or an entry is not finite.
pub fn rotation_defect(m: &Matrix3<f64>) -> f64 {
    let defect = (m * m.transpose() - Matrix3::identity()).amax();
    if m.determinant() > 0.0 && defect.is_finite() { defect } else { f64::INFINITY }
}

/// The rotation that belongs to a point of the unit cube: points spread evenly there give rotations spread evenly (Shoemake's method).
pub(crate) fn rotation_of_cube([u, a, b]: [f64; 3]) -> Rotation3<f64> {
    let (a, b) = (a * std::f64::consts::TAU, b * std::f64::consts::TAU);
    let (p, q) = ((1.0 - u).sqrt(), u.sqrt());
    let quaternion = Quaternion::new(q * b.cos(), p * a.sin(), p * a.cos(), q * b.sin());
    UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix()
}

/// Two unit vectors that span the plane orthogonal to `up`.
pub(crate) fn horizontal_basis(up: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let away = if up.z.abs() < 0.9 { Vector3::z() } else { Vector3::x() };
    let first = up.cross(&away).normalize();
    [first, up.cross(&first)]
}

/// The rotation with the largest `tr(R^T m)` (Kabsch), and the singular values of `m`; `None` where it is not finite.
pub(crate) fn nearest_rotation(m: &Matrix3<f64>) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    if !m.iter().all(|x| x.is_finite()) {
        return None;
    }
    let svd = m.try_svd(true, true, f64::EPSILON, MAX_SVD_STEPS)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    let sign = (u * v_t).determinant().signum();
    Some((u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t, svd.singular_values))
}

/// The turn about an axis with the largest `tr(R^T m)`.
pub(crate) fn nearest_turn(m: &Matrix3<f64>, axis: &Unit<Vector3<f64>>) -> Rotation3<f64> {
    let cosine = m.trace() - axis.dot(&(m * axis.into_inner()));
    let axial = Vector3::new(m[(2, 1)] - m[(1, 2)], m[(0, 2)] - m[(2, 0)], m[(1, 0)] - m[(0, 1)]);
    Rotation3::from_axis_angle(axis, axial.dot(axis).atan2(cosine))
}

/// The smallest turn that brings one direction onto another; about any axis across them where they are opposite.
pub(crate) fn between(from: &Unit<Vector3<f64>>, to: &Unit<Vector3<f64>>) -> Rotation3<f64> {
    Rotation3::rotation_between(from, to).unwrap_or_else(|| {
        let [across, _] = horizontal_basis(from);
        Rotation3::from_axis_angle(&Unit::new_unchecked(across), std::f64::consts::PI)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quaternions_round_trip() {
        let rotation = Rotation3::from_euler_angles(0.3, -1.1, 2.5);
        let back = rotation_from_quaternion(quaternion_from_rotation(&rotation)).unwrap();
        assert!((rotation.matrix() - back.matrix()).norm() < 1e-12);
        assert!(rotation_from_quaternion([1.0, 1.0, 0.0, 0.0]).is_none());
        assert!(rotation_from_quaternion([f64::NAN, 0.0, 0.0, 0.0]).is_none());
    }

    #[test]
    fn rotation_vectors_are_exact_however_small_or_large() {
        let axis = Vector3::new(0.48, -0.6, 0.64);
        for exponent in -160..=4 {
            let turn = axis * f64::powf(10.0, 0.1 * f64::from(exponent));
            let found = rotation_vector(&Rotation3::new(turn));
            assert!((found - turn).norm() < 1e-9 * turn.norm() + 1e-16, "{turn:?} {found:?}");
        }
        assert_eq!(rotation_vector(&Rotation3::identity()), Vector3::zeros());
        assert!((rotation_vector(&Rotation3::new(axis * 3.0)) - axis * 3.0).norm() < 1e-12);
    }

    #[test]
    fn skew_is_the_cross_product() {
        let (a, b) = (Vector3::new(1.0, 2.0, -0.5), Vector3::new(0.2, -0.7, 3.0));
        assert!((skew(&a) * b - a.cross(&b)).norm() < 1e-14);
    }

    #[test]
    fn the_nearest_rotation_and_turn_are_those_that_were_applied() {
        let rotation = *Rotation3::from_euler_angles(0.4, -1.2, 2.0).matrix();
        let spread = Matrix3::from_diagonal(&Vector3::new(3.0, 2.0, 0.1));
        assert!((nearest_rotation(&(rotation * spread)).unwrap().0 - rotation).norm() < 1e-12);
        assert_eq!(nearest_rotation(&Matrix3::repeat(f64::NAN)), None);
        let axis = Unit::new_normalize(Vector3::new(0.3, -0.2, 0.9));
        let turn = Rotation3::from_axis_angle(&axis, -2.1);
        assert!((nearest_turn(&(turn.matrix() * spread * 2.0), &axis).matrix() - turn.matrix()).norm() < 1e-12);
    }

    #[test]
    fn the_turn_between_directions_brings_one_onto_the_other() {
        let up = Vector3::z_axis();
        for direction in [Vector3::new(0.3, 0.1, 0.2), -Vector3::z(), Vector3::z()] {
            let to = Unit::new_normalize(direction);
            assert!((between(&up, &to) * up.into_inner() - to.into_inner()).norm() < 1e-12);
        }
    }

    #[test]
    fn a_reflection_is_not_a_rotation() {
        assert!(rotation_defect(&Matrix3::identity()) < 1e-15);
        assert!(rotation_defect(&(-Matrix3::identity())).is_infinite());
    }
}
