//! Outlines of bodies in images, as polygons in pixels.

use std::f64::consts::{FRAC_PI_2, TAU};

use nalgebra::{Matrix2, Matrix3x4, Vector2};
use quadlift::geometry::{Body, BodyKind, Ellipse, Projection, TangentLines, project_bounding_box, project_ellipsoid};

/// Points on the outline of a round body.
const POINTS: usize = 96;

/// The outline of a body.
#[derive(Debug, Clone, Default)]
pub(crate) struct Outline {
    /// Polygons that cover the body in the image: one, or the faces of a cuboid that the camera sees.
    pub faces: Vec<Vec<Vector2<f64>>>,
    /// Lines: the border, or the edges of a cuboid.
    pub lines: Vec<Vec<Vector2<f64>>>,
}

/// The outline of a body; `None` if it is not entirely in front of the camera.
pub(crate) fn outline(projection: &Projection, body: &Body) -> Option<Outline> {
    match body.kind {
        BodyKind::Ellipsoid => Some(closed(ellipse_points(&project_ellipsoid(projection, &body.inscribed()).ok()?))),
        BodyKind::Cuboid => cuboid(projection, body),
        _ => Some(closed(tangent_polygon(projection, body)?)),
    }
}

/// Points on an ellipse, round about.
pub(crate) fn ellipse_points(ellipse: &Ellipse) -> Vec<Vector2<f64>> {
    let turn = rotation(ellipse.angle());
    let point = |k: usize| {
        let (sin, cos) = (TAU * k as f64 / POINTS as f64).sin_cos();
        ellipse.center() + turn * Vector2::new(ellipse.semi_axes().x * cos, ellipse.semi_axes().y * sin)
    };
    (0..POINTS).map(point).collect()
}

/// The closed polygon of the tangent lines of an outline or an oriented box.
pub(crate) fn support_polygon(lines: &TangentLines) -> Vec<Vector2<f64>> {
    let lines: Vec<_> = lines.lines().collect();
    let corner = |k: usize| {
        let (a, b) = (&lines[k], &lines[(k + 1) % lines.len()]);
        let normals = Matrix2::from_rows(&[a.normal.transpose(), b.normal.transpose()]);
        normals.try_inverse().map(|inverse| inverse * Vector2::new(a.reach, b.reach))
    };
    (0..=lines.len()).filter_map(|k| corner(k % lines.len())).collect()
}

fn closed(border: Vec<Vector2<f64>>) -> Outline {
    let mut line = border.clone();
    line.extend(border.first());
    Outline { faces: vec![border], lines: vec![line] }
}

fn rotation(angle: f64) -> Matrix2<f64> {
    let (sin, cos) = angle.sin_cos();
    Matrix2::new(cos, -sin, sin, cos)
}

/// The polygon of tangent lines of the outline of a convex body: the sides of its box in the image and in rotated
/// images.
fn tangent_polygon(projection: &Projection, body: &Body) -> Option<Vec<Vector2<f64>>> {
    let turns = POINTS / 4;
    // Lines n . x = d by the direction of n.
    let mut lines = vec![(Vector2::zeros(), 0.0); POINTS];
    for k in 0..turns {
        let turn = rotation(-FRAC_PI_2 * k as f64 / turns as f64);
        let mut turned: Matrix3x4<f64> = *projection.matrix();
        let rows = turn * turned.fixed_rows::<2>(0);
        turned.fixed_rows_mut::<2>(0).copy_from(&rows);
        let [x0, y0, x1, y1] = project_bounding_box(&Projection::from_matrix(turned).ok()?, body).ok()?.edges();
        let normals = [(Vector2::x(), x1), (Vector2::y(), y1), (-Vector2::x(), -x0), (-Vector2::y(), -y0)];
        for (quarter, (normal, distance)) in normals.into_iter().enumerate() {
            lines[quarter * turns + k] = (turn.transpose() * normal, distance);
        }
    }
    let corner = |k: usize| {
        let ((n, d), (m, e)) = (lines[k], lines[(k + 1) % POINTS]);
        Matrix2::from_rows(&[n.transpose(), m.transpose()]).try_inverse().map(|inverse| inverse * Vector2::new(d, e))
    };
    (0..POINTS).map(corner).collect()
}

fn cuboid(projection: &Projection, cuboid: &Body) -> Option<Outline> {
    let corners = cuboid.corners();
    let pixels: Option<Vec<Vector2<f64>>> = corners.iter().map(|corner| projection.project_point(corner)).collect();
    let pixels = pixels?;
    let center = projection.center_in_world()?;
    let towards = cuboid.rotation.inverse() * (center - cuboid.center);
    let mut outline = Outline::default();
    for axis in 0..3 {
        let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
        for side in [0, 1 << axis] {
            let sign = if side == 0 { -1.0 } else { 1.0 };
            if sign * towards[axis] > cuboid.half_extents[axis] {
                outline.faces.push([0, u, u + v, v].map(|k| pixels[k + side]).to_vec());
            }
        }
        for k in (0..8).filter(|k| k & (1 << axis) == 0) {
            outline.lines.push(vec![pixels[k], pixels[k + (1 << axis)]]);
        }
    }
    Some(outline)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Point3, Rotation3, Vector3};
    use quadlift::geometry::{Body, BodyKind, CamFromWorld, Intrinsics};

    fn camera() -> Projection {
        let mut pose = Matrix3x4::identity();
        pose[(2, 3)] = 6.0;
        Projection::from_camera(
            &Intrinsics::new(700.0, 650.0, 320.0, 240.0).unwrap(),
            &CamFromWorld::new(pose).unwrap(),
        )
    }

    fn superellipsoid(support_exponent: f64) -> Body {
        Body {
            center: Point3::new(0.5, -0.3, 1.0),
            half_extents: Vector3::new(1.2, 0.8, 0.4),
            rotation: Rotation3::from_euler_angles(0.3, 0.7, -0.4),
            kind: BodyKind::Superellipsoid(support_exponent),
        }
    }

    #[test]
    fn tangents_give_the_outline_of_the_ellipsoid_that_a_superellipsoid_becomes() {
        let body = superellipsoid(2.0);
        let polygon = tangent_polygon(&camera(), &body).unwrap();
        let ellipsoid = body.inscribed();
        let ellipse = project_ellipsoid(&camera(), &ellipsoid).unwrap();
        let turn = rotation(-ellipse.angle());
        for corner in &polygon {
            let radius = (turn * (corner - ellipse.center())).component_div(&ellipse.semi_axes()).norm();
            // Corners of a polygon about a curve lie a little outside.
            assert!((1.0 - 1e-9..1.01).contains(&radius), "{radius}");
        }
    }

    #[test]
    fn a_cuboid_shows_one_to_three_faces_that_cover_its_box() {
        let body = superellipsoid(1.0);
        let cuboid = Body { kind: BodyKind::Cuboid, ..body };
        let outline = outline(&camera(), &cuboid).unwrap();
        assert_eq!((outline.faces.len(), outline.lines.len()), (3, 12));
        let straight = Body { center: Point3::origin(), rotation: Rotation3::identity(), ..cuboid };
        assert_eq!(super::outline(&camera(), &straight).unwrap().faces.len(), 1);
        let edges = project_bounding_box(&camera(), &cuboid).unwrap().edges();
        let points = || outline.faces.iter().flatten();
        let reach = |f: fn(f64, f64) -> f64, axis: usize, start| points().map(|p| p[axis]).fold(start, f);
        for axis in 0..2 {
            assert!((reach(f64::min, axis, f64::MAX) - edges[axis]).abs() < 1e-6);
            assert!((reach(f64::max, axis, f64::MIN) - edges[axis + 2]).abs() < 1e-6);
        }
    }

    #[test]
    fn the_faces_of_a_cuboid_are_those_that_look_at_the_camera() {
        let body = superellipsoid(1.0);
        let cuboid = Body { kind: BodyKind::Cuboid, ..body };
        let outline = outline(&camera(), &cuboid).unwrap();
        let corners = cuboid.corners();
        let depth = |corner: &Point3<f64>| camera().depth(corner);
        let by_depth = |a: &&Point3<f64>, b: &&Point3<f64>| depth(a).total_cmp(&depth(b));
        let pixel = |corner: &Point3<f64>| camera().project_point(corner).unwrap();
        let (nearest, farthest) = (corners.iter().min_by(by_depth).unwrap(), corners.iter().max_by(by_depth).unwrap());
        for face in &outline.faces {
            assert!(face.iter().any(|p| (p - pixel(nearest)).norm() < 1e-9), "{face:?}");
            assert!(face.iter().all(|p| (p - pixel(farthest)).norm() > 1e-9), "{face:?}");
        }
    }

    #[test]
    fn what_is_not_in_front_of_the_camera_has_no_outline() {
        let mut body = superellipsoid(1.5);
        for depth in [-6.2, -30.0] {
            body.center.z = depth;
            assert!(outline(&camera(), &body).is_none());
        }
    }
}
