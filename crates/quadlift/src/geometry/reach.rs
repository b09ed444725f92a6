//! The ellipsoid closest to another body (docs/method.md, section 3).

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::convex_body::ConvexBody;
use super::ellipsoid::Ellipsoid;
use super::quadrature::gauss_kronrod15;

/// The ellipsoid that reaches about as far as a body in all directions: about the same planes touch both, so that it is what
/// an ellipsoid fitted to boxes of the body from all sides would be.
///
/// The body is symmetric to the planes through its center that are spanned by the columns of `rotation`, which are the axes
/// of the ellipsoid too. World units.
///
/// The square of an ellipsoid's reach is the quadratic form `n^T A n`; here A is that whose form is closest to the square of
/// the body's reach `h(n)`, in the mean of squares over all directions: `A = (15 M - 3 tr(M) I) / 2` with
/// `M = mean of h(n)^2 n n^T` (for `h(n)^2 = n^T A n` it is `(2 A + tr(A) I) / 15`). Of a cuboid with half extents `a_i`
/// the squared semi-axes are `a_i (a_i + 2/pi (a_j + a_k))`: of a cube 1.51 times half its edge.
pub(crate) fn ellipsoid_of_same_reach(body: &impl ConvexBody, rotation: &Rotation3<f64>) -> Ellipsoid {
    // One octant stands for all.
    let mean = |axis: usize| {
        let over_polar = |polar: f64| {
            let (sin, cos) = polar.sin_cos();
            let over_azimuth = |azimuth: f64| {
                let n = Vector3::new(sin * azimuth.cos(), sin * azimuth.sin(), cos);
                (body.support(&(rotation * n)) * n[axis]).powi(2)
            };
            sin * gauss_kronrod15(&over_azimuth, 0.0, FRAC_PI_2).0
        };
        gauss_kronrod15(&over_polar, 0.0, FRAC_PI_2).0 / FRAC_PI_2
    };
    let moments = Vector3::from_fn(|axis, _| mean(axis));
    let squared = (moments * 15.0).add_scalar(-3.0 * moments.sum()) / 2.0;
    // Bodies that are much flatter than long: no shorter than the body itself reaches.
    let half_extents =
        Matrix3::from(*rotation.matrix()).column_iter().map(|axis| body.support(&axis.into())).collect::<Vec<f64>>();
    let semi_axes = Vector3::from_fn(|axis, _| squared[axis].max(half_extents[axis].powi(2)).sqrt());
    Ellipsoid { center: body.center(), semi_axes, rotation: *rotation }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_2_PI;

    use nalgebra::Point3;

    use super::super::{Body, BodyKind};
    use super::*;

    fn place() -> (Point3<f64>, Rotation3<f64>) {
        (Point3::new(1.0, -2.0, 3.0), Rotation3::from_euler_angles(0.3, -0.7, 1.1))
    }

    #[test]
    fn an_ellipsoid_stands_for_itself() {
        let (center, rotation) = place();
        let body = Ellipsoid { center, semi_axes: Vector3::new(2.0, 1.0, 0.3), rotation };
        let found = ellipsoid_of_same_reach(&body, &rotation);
        assert!((found.semi_axes - body.semi_axes).amax() < 1e-9, "{found:?}");
        assert_eq!((found.center, found.rotation), (center, rotation));
    }

    /// Against the closed forms of the integrals.
    #[test]
    fn cuboids_and_round_cylinders_have_closed_forms() {
        let (center, rotation) = place();
        let half_extents = Vector3::new(2.0, 1.0, 0.3);
        let found = Body { center, half_extents, rotation, kind: BodyKind::Cuboid }.closest_ellipsoid();
        let others = half_extents.map(|a| half_extents.sum() - a);
        let expected = (half_extents + others * FRAC_2_PI).component_mul(&half_extents).map(f64::sqrt);
        assert!((found.semi_axes - expected).amax() < 1e-9, "{found:?} {expected}");

        let (radius, half_height): (f64, f64) = (0.5, 2.0);
        let half_extents = Vector3::new(radius, radius, half_height);
        let found = Body { center, half_extents, rotation, kind: BodyKind::Cylinder }.closest_ellipsoid().semi_axes;
        let across = (radius * radius + 0.5 * radius * half_height).sqrt();
        let along = (half_height * half_height + radius * half_height).sqrt();
        assert!((found - Vector3::new(across, across, along)).amax() < 1e-9, "{found}");
    }

    #[test]
    fn superellipsoids_lie_between_the_ellipsoid_and_the_cuboid() {
        let (center, rotation) = place();
        let semi_axes = Vector3::new(2.0, 1.0, 0.7);
        let of = |support_exponent: f64| {
            let kind = BodyKind::Superellipsoid(support_exponent);
            Body { center, half_extents: semi_axes, rotation, kind }.closest_ellipsoid().semi_axes
        };
        assert!((of(2.0) - semi_axes).amax() < 1e-9);
        let cuboid =
            Body { center, half_extents: semi_axes, rotation, kind: BodyKind::Cuboid }.closest_ellipsoid().semi_axes;
        assert!((of(1.0) - cuboid).amax() < 1e-9);
        let mut before = semi_axes;
        for exponent in [1.75, 1.5, 1.25, 1.0] {
            let found = of(exponent);
            assert!((0..3).all(|axis| found[axis] > before[axis]), "{exponent}: {found}");
            before = found;
        }
    }
}
