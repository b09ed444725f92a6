//! Projection of bodies: the outline of an ellipsoid, the tight box of any convex body; and the planes behind edges and lines.

use nalgebra::{Matrix3, Matrix3x4, Point3, Vector3, Vector4};

use super::body::Body;
use super::bounding_box::BoundingBox;
use super::camera::Projection;
use super::convex_body::ConvexBody;
use super::ellipse::Ellipse;
use super::ellipsoid::Ellipsoid;
use super::kinds::BodyKind;
use super::tangent_lines::TangentLine;

/// Why a body has no outline in an image.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ProjectionError {
    /// The whole body lies behind the camera plane.
    #[error("the object lies behind the camera")]
    BehindCamera,
    /// The camera plane cuts the body, so that its outline is not bounded.
    #[error("the object straddles the camera plane")]
    StraddlesCameraPlane,
    /// A number is not finite.
    #[error("the projection of the object is not finite")]
    NotFinite,
}

/// The outline of an ellipsoid: `C* ~ P Q* P^T` (PfD equation 3), in pixels.
///
/// # Errors
/// [`ProjectionError`] when the ellipsoid is not wholly in front of the camera.
pub fn project_ellipsoid(projection: &Projection, ellipsoid: &Ellipsoid) -> Result<Ellipse, ProjectionError> {
    let (h, c) = dual_conic(projection.matrix(), &ellipsoid.center, &ellipsoid.shape());
    if !c.iter().all(|x| x.is_finite()) {
        return Err(ProjectionError::NotFinite);
    }
    if c[(2, 2)] >= 0.0 {
        return Err(ProjectionError::StraddlesCameraPlane);
    }
    if h.z <= 0.0 {
        return Err(ProjectionError::BehindCamera);
    }
    Ellipse::from_dual_conic(&c).map_err(|_| ProjectionError::NotFinite)
}

/// The projected center `h` (homogeneous) and the dual conic `M A M^T - h h^T`.
fn dual_conic(p: &Matrix3x4<f64>, center: &Point3<f64>, shape: &Matrix3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
    let m = p.fixed_columns::<3>(0);
    let h = m * center.coords + p.column(3);
    (h, m * shape * m.transpose() - h * h.transpose())
}

/// The tight axis-aligned box of a convex body's outline, in pixels.
///
/// An edge is the image line `x = e` whose plane `P^T l` touches the body; it is found by Newton's method on the
/// distance between plane and body, which is concave in `e`.
///
/// # Errors
/// [`ProjectionError`] when the body is not wholly in front of the camera.
pub fn project_bounding_box(projection: &Projection, body: &impl ConvexBody) -> Result<BoundingBox, ProjectionError> {
    let p = projection.matrix();
    let center = body.center();
    let row = |i: usize| (Vector3::new(p[(i, 0)], p[(i, 1)], p[(i, 2)]), p[(i, 3)]);
    let (m3, d3) = row(2);
    let depth = m3.dot(&center.coords) + d3;
    let reach = body.support(&m3);
    if !depth.is_finite() || !reach.is_finite() {
        return Err(ProjectionError::NotFinite);
    }
    if depth <= -reach {
        return Err(ProjectionError::BehindCamera);
    }
    if depth <= reach {
        return Err(ProjectionError::StraddlesCameraPlane);
    }
    let mut edges = [0.0; 4];
    for axis in 0..2 {
        let (m, d) = row(axis);
        let middle = (m.dot(&center.coords) + d) / depth;
        for (side, sign) in [(axis, 1.0), (axis + 2, -1.0)] {
            // Distance of the plane of x = e from the body, positive outside of it; its slope is -sign * (depth of
            // the touching point), between depth - reach and depth + reach.
            let gap = |e: f64| {
                let n = (m - m3 * e) * sign;
                sign * ((m.dot(&center.coords) + d) - e * depth) - body.support(&n)
            };
            edges[side] = outer_root(gap, middle, -sign, depth, reach);
        }
    }
    BoundingBox::new(edges).map_err(|_| ProjectionError::NotFinite)
}

/// The box of an outline with this dual conic, in coordinates (X / Z, Y / Z) of the frame of the camera: left, top, right, bottom. The conic is
/// that of a body whose center has this depth; `None` where the body is not wholly in front of the camera.
pub(crate) fn box_of_outline(dual_conic: &Matrix3<f64>, depth: f64) -> Option<[f64; 4]> {
    let last = dual_conic[(2, 2)];
    if last.is_nan() || last >= -1e-9 * depth * depth {
        return None;
    }
    let mut edges = [0.0; 4];
    for axis in 0..2 {
        let middle = dual_conic[(axis, 2)];
        let root = (middle * middle - dual_conic[(axis, axis)] * last).max(0.0).sqrt();
        edges[axis] = (middle + root) / last;
        edges[axis + 2] = (middle - root) / last;
    }
    Some(edges)
}

/// Where a body in the frame of a camera touches the planes of the edges of its box (left, top, right, bottom): points from the center of the
/// body. An edge is at X / Z (left, right) or Y / Z of its point. `None` where the body is not wholly in front of the camera.
///
/// Those of an ellipsoid have a closed form. Else Newton's method on the distance between plane and body, which is concave in the edge: each
/// step goes to where the point that lies farthest across the plane is seen, and none goes too far.
pub(crate) fn tangent_points(body: &Body) -> Option<[Vector3<f64>; 4]> {
    let center = body.center.coords;
    if center.z.is_nan() || center.z <= 0.0 {
        return None;
    }
    if body.kind == BodyKind::Ellipsoid {
        let root = body.rotation.matrix() * Matrix3::from_diagonal(&body.half_extents);
        let shape = root * root.transpose();
        let edges = box_of_outline(&(shape - center * center.transpose()), center.z)?;
        return Some(std::array::from_fn(|edge| {
            let mut normal = Vector3::zeros();
            normal[edge % 2] = 1.0;
            normal[2] = -edges[edge];
            shape * normal / -normal.dot(&center)
        }));
    }
    // Also not so near to the plane of the camera that the outline ends nowhere.
    if body.support(&Vector3::z()) >= center.z * (1.0 - 1e-9) {
        return None;
    }
    let mut points = [Vector3::zeros(); 4];
    for (edge, point) in points.iter_mut().enumerate() {
        let (axis, outwards) = (edge % 2, if edge < 2 { -1.0 } else { 1.0 });
        let mut normal = Vector3::zeros();
        normal[axis] = outwards;
        let mut position = center[axis] / center.z;
        for _ in 0..MOST_STEPS {
            normal[2] = -outwards * position;
            *point = body.support_point(&normal);
            let at = center + *point;
            let next = at[axis] / at.z;
            let is_last = (next - position) * outwards <= 1e-14 * (1.0 + position.abs());
            position = next;
            if is_last {
                break;
            }
        }
        if !position.is_finite() {
            return None;
        }
    }
    Some(points)
}

/// Steps of Newton's method to an edge, at most.
const MOST_STEPS: usize = 100;

/// The root of the concave function `gap` in the direction `towards` (+1 or -1) from `start`, where it is negative.
///
/// Its slope lies between `depth - reach` and `depth + reach`. The first step takes the steepest, which cannot jump over
/// the root; secant steps follow, until they are lost in rounding.
fn outer_root(gap: impl Fn(f64) -> f64, start: f64, towards: f64, depth: f64, reach: f64) -> f64 {
    let (mut x, mut value) = (start, gap(start));
    let mut slope = depth + reach;
    for _ in 0..100 {
        let next = x - value / slope * towards;
        if next == x || !next.is_finite() {
            break;
        }
        let next_value = gap(next);
        let secant = (next_value - value) / ((next - x) * towards);
        let converged = (next - x).abs() <= 1e-14 * (1.0 + x.abs());
        (x, value) = (next, next_value);
        if converged {
            break;
        }
        if secant.is_finite() && secant > 0.0 {
            slope = secant.clamp(depth - reach, depth + reach);
        }
    }
    x
}

/// The plane through the camera and the box edge `edge` (0 left, 1 top, 2 right, 3 bottom), positive on the side of
/// the box, for a projection `p` of any frame.
pub(crate) fn edge_plane(p: &Matrix3x4<f64>, bounding_box: &BoundingBox, edge: usize) -> Vector4<f64> {
    let position = bounding_box.edges()[edge];
    let plane = (p.row(edge % 2) - p.row(2) * position).transpose();
    if edge < 2 { plane } else { -plane }
}

/// The plane through the camera and a tangent line, positive on the side of the object, for a projection `p` of any
/// frame.
pub(crate) fn support_plane(p: &Matrix3x4<f64>, line: &TangentLine) -> Vector4<f64> {
    p.transpose() * Vector3::new(-line.normal.x, -line.normal.y, line.reach)
}

#[cfg(test)]
mod tests {
    use super::super::{CamFromWorld, Intrinsics};
    use super::*;
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    fn camera(distance: f64) -> Projection {
        let mut pose = Matrix3x4::identity();
        pose[(2, 3)] = distance;
        Projection::from_camera(
            &Intrinsics::new(700.0, 650.0, 320.0, 240.0).unwrap(),
            &CamFromWorld::new(pose).unwrap(),
        )
    }

    fn ellipsoid(angles: [f64; 3], center: [f64; 3]) -> Ellipsoid {
        Ellipsoid {
            center: Point3::from(center),
            semi_axes: Vector3::new(2.0, 1.2, 0.6),
            rotation: Rotation3::from_euler_angles(angles[0], angles[1], angles[2]),
        }
    }

    #[test]
    fn a_sphere_on_the_axis_projects_to_a_circle() {
        let sphere =
            Ellipsoid { center: Point3::origin(), semi_axes: Vector3::repeat(1.0), rotation: Rotation3::identity() };
        let outline = project_ellipsoid(&camera(5.0), &sphere).unwrap();
        // The cone that touches a unit sphere at distance 5 has the slope 1 / sqrt(24).
        assert!((outline.center - nalgebra::Vector2::new(320.0, 240.0)).norm() < 1e-9);
        assert!((outline.semi_axes.x - 700.0 / 24.0f64.sqrt()).abs() < 1e-9);
        assert!((outline.semi_axes.y - 650.0 / 24.0f64.sqrt()).abs() < 1e-9);
    }

    #[test]
    fn bodies_behind_and_across_the_camera_plane_are_told_apart() {
        let e = ellipsoid([0.1, 0.2, 0.3], [0.0, 0.0, 0.0]);
        assert_eq!(project_ellipsoid(&camera(-5.0), &e), Err(ProjectionError::BehindCamera));
        assert_eq!(project_ellipsoid(&camera(0.5), &e), Err(ProjectionError::StraddlesCameraPlane));
        assert_eq!(project_bounding_box(&camera(-5.0), &e), Err(ProjectionError::BehindCamera));
        assert_eq!(project_bounding_box(&camera(0.5), &e), Err(ProjectionError::StraddlesCameraPlane));
    }

    proptest! {
        #[test]
        fn the_box_by_support_is_the_box_of_the_outline(
            a in -3.0..3.0f64, b in -1.5..1.5f64, x in -3.0..3.0f64, y in -2.0..2.0f64, z in -2.0..10.0f64,
        ) {
            let e = ellipsoid([a, b, 0.4], [x, y, z]);
            let outline = project_ellipsoid(&camera(6.0), &e).unwrap().bounding_box();
            let boxed = project_bounding_box(&camera(6.0), &e).unwrap();
            for (p, q) in outline.edges().iter().zip(boxed.edges()) {
                prop_assert!((p - q).abs() < 1e-7, "{outline:?} {boxed:?}");
            }
        }

        #[test]
        fn the_box_of_a_cuboid_is_the_box_of_its_corners(
            a in -3.0..3.0f64, b in -1.5..1.5f64, x in -3.0..3.0f64, z in -2.0..10.0f64,
        ) {
            let cuboid = Body { kind: BodyKind::Cuboid,
                center: Point3::new(x, 0.5, z),
                half_extents: Vector3::new(1.5, 1.0, 0.7),
                rotation: Rotation3::from_euler_angles(a, b, 0.2),
            };
            let camera = camera(6.0);
            let boxed = project_bounding_box(&camera, &cuboid).unwrap().edges();
            let mut expected = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
            for corner in cuboid.corners() {
                let pixel = camera.project_point(&corner).unwrap();
                for axis in 0..2 {
                    expected[axis] = f64::min(expected[axis], pixel[axis]);
                    expected[axis + 2] = f64::max(expected[axis + 2], pixel[axis]);
                }
            }
            for (p, q) in expected.iter().zip(boxed) {
                prop_assert!((p - q).abs() < 1e-7, "{expected:?} {boxed:?}");
            }
        }
    }

    #[test]
    fn tangent_points_are_seen_at_the_edges_of_the_box() {
        let intrinsics = Intrinsics::new(1.0, 1.0, 0.0, 0.0).unwrap();
        let camera = Projection::from_camera(&intrinsics, &CamFromWorld::new(Matrix3x4::identity()).unwrap());
        let e = ellipsoid([0.5, 0.2, -0.3], [1.0, 0.2, 4.0]);
        for kind in BodyKind::ALL {
            let body = Body { kind, ..Body::from(e) };
            let expected = project_bounding_box(&camera, &body).unwrap().edges();
            for (edge, point) in tangent_points(&body).unwrap().into_iter().enumerate() {
                let at = body.center.coords + point;
                assert!((at[edge % 2] / at.z - expected[edge]).abs() < 1e-12, "{kind:?} {edge}");
            }
            let turned_away = Body { center: Point3::new(1.0, 0.2, -4.0), ..body };
            let across = Body { center: Point3::new(0.1, 0.2, 0.3), ..body };
            assert!(tangent_points(&turned_away).is_none() && tangent_points(&across).is_none(), "{kind:?}");
        }
    }

    #[test]
    fn a_superellipsoid_with_exponent_two_is_the_ellipsoid() {
        let e = ellipsoid([0.5, 0.2, -0.3], [1.0, 0.2, 3.0]);
        let s = Body { kind: BodyKind::Superellipsoid(2.0), ..Body::from(e) };
        let (p, q) = (project_bounding_box(&camera(6.0), &e), project_bounding_box(&camera(6.0), &s));
        assert_eq!(p, q);
    }
}
