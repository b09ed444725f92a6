//! The ellipsoid that encloses the real object, which fills only part of the body that fits its boxes (docs/method.md, section 13): the
//! smallest one around its corrected support.
//!
//! Planes in evenly spread directions, as far away as the support reaches there, make a polytope. Its boundary is a point in each of
//! these directions, and the smallest ellipsoid around points is found by Khachiyan's algorithm (Todd and Yildirim, *On Khachiyan's
//! algorithm for the computation of minimum-volume enclosing ellipsoids*, Discrete Applied Mathematics 155, 2007). All of it in the frame
//! in which the ellipsoid closest to the body is the unit ball, so that an exact ellipsoid encloses itself.

use nalgebra::{Matrix3, Matrix4, Vector3, Vector4};

use super::corrected_support::CorrectedSupport;
use crate::geometry::linalg::invert_spd;
use crate::geometry::rotation::on_spiral;
use crate::geometry::{Body, Ellipsoid};
use crate::scene::View;

/// Directions of the planes, in opposite pairs.
const DIRECTIONS: usize = 200;

/// The support is taken this many standard deviations of its correction farther away: where nothing was seen an object may reach farther
/// than its body, and an ellipsoid around what is expected in each direction is smaller than is expected of the one around all.
const DEVIATIONS: f64 = 0.3;

/// A plane is at least this far from the center, in radii of the ball: one that cuts the body near its center is false.
const MIN_DISTANCE: f64 = 0.02;

/// The ellipsoid has converged when no point lies farther outside of it than this share...
const TOLERANCE: f64 = 1e-3;

/// ...or ends after as many steps, and is enlarged until it holds all points.
const MAX_STEPS: usize = 1000;

/// The ellipsoid that encloses the object of these views; `None` if its numbers are not finite.
pub(super) fn enclosing(views: &[View], body: &Body) -> Option<Ellipsoid> {
    let closest = body.closest_ellipsoid();
    let support = CorrectedSupport::new(body, views);
    let directions = directions();
    let distances = directions.iter().map(|direction| {
        let normal = direction.component_div(&closest.semi_axes).normalize();
        let reach = support.along(&(closest.rotation * normal));
        let radius = normal.component_mul(&closest.semi_axes).norm();
        ((reach.distance + DEVIATIONS * reach.sd) / radius).max(MIN_DISTANCE)
    });
    let planes: Vec<(Vector3<f64>, f64)> = directions.iter().copied().zip(distances).collect();
    let points: Vec<Vector3<f64>> =
        directions.iter().map(|direction| direction * boundary(&planes, direction)).collect();
    let (center, shape) = smallest_ellipsoid(&points)?;
    let root = closest.rotation.matrix() * Matrix3::from_diagonal(&closest.semi_axes);
    Ellipsoid::from_shape(body.center + root * center, &(root * shape * root.transpose())).ok()
}

/// Unit vectors that are spread evenly, each followed by its opposite.
fn directions() -> Vec<Vector3<f64>> {
    let half = DIRECTIONS / 2;
    let direction = |k: usize| on_spiral(k, (k as f64 + 0.5) / half as f64);
    (0..half).flat_map(|k| [direction(k), -direction(k)]).collect()
}

/// How far the polytope of these planes (normal, distance) about the origin reaches in a direction.
fn boundary(planes: &[(Vector3<f64>, f64)], direction: &Vector3<f64>) -> f64 {
    let crossing = |(normal, distance): &(Vector3<f64>, f64)| {
        let along = normal.dot(direction);
        if along > 0.0 { distance / along } else { f64::INFINITY }
    };
    planes.iter().map(crossing).fold(f64::INFINITY, f64::min)
}

/// Center and shape matrix of the smallest ellipsoid around points that span space.
fn smallest_ellipsoid(points: &[Vector3<f64>]) -> Option<(Vector3<f64>, Matrix3<f64>)> {
    // With a fourth coordinate of one the center is the origin. The dual problem: weights of the points with the largest determinant of
    // their moments.
    let lifted: Vec<Vector4<f64>> = points.iter().map(|point| point.push(1.0)).collect();
    // From the points that lie farthest along the axes: few points touch the ellipsoid, and all others would be left one by one.
    let mut weights = vec![0.0; points.len()];
    for k in 0..6 {
        let along = |point: &Vector3<f64>| if k < 3 { point[k] } else { -point[k - 3] };
        let farthest = (0..points.len()).max_by(|a, b| along(&points[*a]).total_cmp(&along(&points[*b])))?;
        weights[farthest] += 1.0 / 6.0;
    }
    let mut squares = vec![0.0; points.len()];
    for _ in 0..MAX_STEPS {
        let mut moments = Matrix4::zeros();
        lifted.iter().zip(&weights).for_each(|(point, &weight)| moments.ger(weight, point, point, 1.0));
        let inverse = invert_spd(&moments)?;
        lifted.iter().zip(&mut squares).for_each(|(point, square)| *square = point.dot(&(inverse * point)));
        let farthest = (0..points.len()).max_by(|a, b| squares[*a].total_cmp(&squares[*b]))?;
        let held = (0..points.len()).filter(|k| weights[*k] > 0.0);
        let innermost = held.min_by(|a, b| squares[*a].total_cmp(&squares[*b]))?;
        let (outside, inside) = (squares[farthest] / 4.0 - 1.0, 1.0 - squares[innermost] / 4.0);
        if outside.max(inside) < TOLERANCE {
            break;
        }
        // The weight of the point farthest outside grows, or that of one inside shrinks, until the determinant is largest.
        let chosen = if outside >= inside { farthest } else { innermost };
        let square = squares[chosen];
        let step = (square - 4.0) / (4.0 * (square - 1.0));
        let none = -weights[chosen] / (1.0 - weights[chosen]);
        let step = if square > 1.0 { step.max(none) } else { none };
        weights.iter_mut().for_each(|weight| *weight *= 1.0 - step);
        weights[chosen] = if step == none { 0.0 } else { weights[chosen] + step };
    }
    let weighted = || points.iter().zip(&weights);
    let center: Vector3<f64> = weighted().map(|(point, &weight)| point * weight).sum();
    let mut shape = Matrix3::zeros();
    weighted().for_each(|(point, &weight)| shape.ger(3.0 * weight, &(point - center), &(point - center), 1.0));
    let inverse = invert_spd(&shape)?;
    let farthest = points.iter().map(|point| (point - center).dot(&(inverse * (point - center)))).fold(0.0, f64::max);
    Some((center, shape * farthest))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Rotation3};

    use super::*;
    use crate::geometry::BodyKind;

    fn body(kind: BodyKind) -> Body {
        Body {
            center: Point3::new(1.0, -2.0, 30.0),
            rotation: Rotation3::from_euler_angles(0.3, -0.7, 1.1),
            half_extents: Vector3::new(1.5, 1.0, 0.4),
            kind,
        }
    }

    #[test]
    fn without_edges_an_ellipsoid_encloses_itself() {
        let body = body(BodyKind::Ellipsoid);
        let found = enclosing(&[], &body).unwrap();
        assert!((found.center - body.center).norm() < 1e-3);
        // The correction of nothing is zero, give or take its least deviation: .3 of 1 % of the size.
        let growth = found.semi_axes.product() / body.half_extents.product();
        assert!((1.0..1.02).contains(&growth), "{growth}");
    }

    #[test]
    fn the_smallest_ellipsoid_around_a_box_goes_through_its_corners() {
        let half = Vector3::new(3.0, 1.0, 0.2);
        let points: Vec<Vector3<f64>> = (0..8)
            .map(|k| Vector3::from_fn(|axis, _| half[axis] * if k >> axis & 1 == 1 { 1.0 } else { -1.0 }))
            .chain([Vector3::new(0.5, 0.2, 0.1), Vector3::zeros()])
            .map(|point| point + Vector3::new(10.0, 0.0, -4.0))
            .collect();
        let (center, shape) = smallest_ellipsoid(&points).unwrap();
        assert!((center - Vector3::new(10.0, 0.0, -4.0)).norm() < 1e-3);
        let expected = Matrix3::from_diagonal(&half.map(|x| 3.0 * x * x));
        assert!((shape - expected).amax() < 1e-3 * expected.amax(), "{shape}");
    }

    #[test]
    fn points_in_a_plane_have_no_ellipsoid() {
        assert!(smallest_ellipsoid(&[Vector3::x(), Vector3::y(), -Vector3::x(), -Vector3::y()]).is_none());
    }

    /// Corners lie between the directions, and are cut by as much: by a fifth of their distance at most.
    #[test]
    fn a_cuboid_is_enclosed_with_its_corners() {
        let body = body(BodyKind::Cuboid);
        let found = enclosing(&[], &body).unwrap();
        let inverse = found.shape().try_inverse().unwrap();
        for corner in body.corners() {
            let offset = corner - found.center;
            assert!(offset.dot(&(inverse * offset)).sqrt() < 1.2, "{corner}");
        }
        assert!((found.center - body.center).norm() < 1e-3);
    }
}
