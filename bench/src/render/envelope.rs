//! The minimum-volume enclosing ellipsoid of a set of solids.

use nalgebra::{Matrix3, Matrix4, Point3, Rotation3, Vector3, Vector4};
use quadlift::geometry::Ellipsoid;

use super::solid::{Shape, Solid};

/// Points that approximate an ellipsoid, and points on each rim of a cylinder.
const BALL_POINTS: usize = 150;
const RIM_POINTS: usize = 24;

/// The iteration ends when no point lies farther out than this share of the bound.
const TOLERANCE: f64 = 1e-3;
const MAX_ITERATIONS: usize = 10_000;

/// The envelope: exact for a single ellipsoid, otherwise that of points on the surfaces (larger than the least one by
/// less than 0.3 % in volume, and parts of the surfaces between the points may stand out by as much).
pub(super) fn envelope(solids: &[Solid]) -> Ellipsoid {
    if let [Solid { shape: Shape::Ellipsoid, center, rotation, half_sizes, .. }] = solids {
        return Ellipsoid { center: *center, semi_axes: *half_sizes, rotation: *rotation };
    }
    let points: Vec<Point3<f64>> = solids.iter().flat_map(surface_points).collect();
    enclosing_ellipsoid(&points)
}

/// Points of the surface whose convex hull is nearly the solid.
fn surface_points(solid: &Solid) -> Vec<Point3<f64>> {
    let unit: Vec<Vector3<f64>> = match solid.shape {
        Shape::Ellipsoid => (0..BALL_POINTS).map(spiral_point).collect(),
        Shape::Cuboid => {
            (0..8).map(|k| Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -1.0 } else { 1.0 })).collect()
        }
        Shape::Cylinder => (0..2 * RIM_POINTS)
            .map(|k| {
                let (sin, cos) = (std::f64::consts::TAU * (k / 2) as f64 / RIM_POINTS as f64).sin_cos();
                Vector3::new(cos, sin, if k % 2 == 0 { -1.0 } else { 1.0 })
            })
            .collect(),
    };
    unit.iter().map(|p| solid.center + solid.rotation * p.component_mul(&solid.half_sizes)).collect()
}

/// Point k of a spiral that covers the unit sphere evenly (Fibonacci).
fn spiral_point(k: usize) -> Vector3<f64> {
    let z = 1.0 - (2 * k + 1) as f64 / BALL_POINTS as f64;
    let (sin, cos) = (k as f64 * std::f64::consts::PI * (3.0 - 5.0f64.sqrt())).sin_cos();
    let r = (1.0 - z * z).sqrt();
    Vector3::new(r * cos, r * sin, z)
}

/// Khachiyan's algorithm: weights of the points move towards the one that lies farthest out; at the end the ellipsoid
/// grows until it holds all points.
pub(super) fn enclosing_ellipsoid(points: &[Point3<f64>]) -> Ellipsoid {
    let n = points.len();
    let lifted: Vec<Vector4<f64>> = points.iter().map(|p| p.to_homogeneous()).collect();
    let mut weights = vec![1.0 / n as f64; n];
    for _ in 0..MAX_ITERATIONS {
        let scatter: Matrix4<f64> = lifted.iter().zip(&weights).map(|(p, w)| p * p.transpose() * *w).sum();
        let Some(inverse) = scatter.try_inverse() else { break };
        let (farthest, value) = lifted
            .iter()
            .map(|p| p.dot(&(inverse * p)))
            .enumerate()
            .fold((0, f64::MIN), |best, (k, value)| if value > best.1 { (k, value) } else { best });
        if value <= 4.0 * (1.0 + TOLERANCE) {
            break;
        }
        let step = (value - 4.0) / (4.0 * (value - 1.0));
        weights.iter_mut().for_each(|w| *w *= 1.0 - step);
        weights[farthest] += step;
    }
    let center: Vector3<f64> = points.iter().zip(&weights).map(|(p, w)| p.coords * *w).sum();
    let scatter = |p: &Point3<f64>, w: &f64| (p.coords - center) * (p.coords - center).transpose() * *w;
    let shape: Matrix3<f64> = points.iter().zip(&weights).map(|(p, w)| scatter(p, w)).sum::<Matrix3<f64>>() * 3.0;
    let reach = |inverse: Matrix3<f64>| {
        points.iter().map(|p| (p.coords - center).dot(&(inverse * (p.coords - center)))).fold(0.0, f64::max)
    };
    let growth = shape.try_inverse().map_or(1.0, reach);
    // Solids have a volume, so their points have one: the fall-back is for the compiler.
    Ellipsoid::from_shape(center.into(), &(shape * growth)).unwrap_or(Ellipsoid {
        center: center.into(),
        semi_axes: Vector3::repeat(growth.sqrt()),
        rotation: Rotation3::identity(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::objects::{Object, ObjectKind};
    use super::super::texture::Color;
    use super::*;
    use quadlift::geometry::ConvexBody;
    use quadlift::random::{rotation, stream};

    #[test]
    fn the_envelope_of_a_cuboid_is_known() {
        let half = Vector3::new(3.0, 2.0, 0.5);
        let turn = rotation(&mut stream(1, 0));
        let corners: Vec<Point3<f64>> = (0..8)
            .map(|k| {
                let corner = Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -half[axis] } else { half[axis] });
                Point3::from(turn * corner + Vector3::new(5.0, -3.0, 1.0))
            })
            .collect();
        let found = enclosing_ellipsoid(&corners);
        // Semi-axes sqrt(3) times the half sizes.
        assert!((found.semi_axes - half * 3.0f64.sqrt()).amax() < 1e-6, "{:?}", found.semi_axes);
        assert!((found.center - Point3::new(5.0, -3.0, 1.0)).norm() < 1e-9);
    }

    #[test]
    fn the_envelope_of_points_of_an_ellipsoid_is_the_ellipsoid() {
        let mut rng = stream(3, 0);
        let object = Object::draw(&mut rng, ObjectKind::Ellipsoid, &Color::repeat(0.5));
        let exact = object.envelope();
        let found = enclosing_ellipsoid(&surface_points(&object.solids[0]));
        assert!((found.volume() / exact.volume() - 1.0).abs() < 0.01);
        assert!((found.shape() - exact.shape()).amax() < 0.02);
    }

    #[test]
    fn envelopes_hold_their_objects_and_none_that_is_smaller_does() {
        let mut rng = stream(4, 0);
        for kind in ObjectKind::ALL {
            let object = Object::draw(&mut rng, kind, &Color::repeat(0.5));
            let envelope = object.envelope();
            let grown = Ellipsoid { semi_axes: envelope.semi_axes * 1.005, ..envelope };
            let points: Vec<_> = object.solids.iter().flat_map(surface_points).collect();
            assert!(points.iter().all(|p| grown.contains(p)), "{kind:?}");
            // The least ellipsoid touches on all sides: pushed in any direction, it loses a point.
            for k in 0..BALL_POINTS {
                let mut pushed = envelope;
                pushed.center += spiral_point(k) * 0.05;
                assert!(!points.iter().all(|p| pushed.contains(p)), "{kind:?}");
            }
        }
    }
}
