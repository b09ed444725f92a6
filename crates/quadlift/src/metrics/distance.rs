//! Distances between bodies, in world units.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Vector3};

use crate::geometry::linalg::symmetric_eigen3;
use crate::geometry::{ConvexBody, Ellipsoid};

/// Directions on the half sphere to start with.
const DIRECTIONS: u32 = 1000;
/// Starts that are refined.
const REFINED: usize = 6;

/// Hausdorff distance between two convex bodies, `max_u |h_A(u) - h_B(u)|` over the unit directions, where h is the
/// support function about a common point (so that the distance of the centres counts). World units.
///
/// A fixed set of directions and a local search from the best of them: a lower bound of the distance, for ellipsoids
/// precise to about 1e-9 of it, for bodies with edges to about 1e-4. NaN if a body contains a non-finite number.
pub fn hausdorff_distance(a: &impl ConvexBody, b: &impl ConvexBody) -> f64 {
    let offset = b.center() - a.center();
    // The bodies are symmetric: u and -u together give the sum of both moduli.
    let difference = |u: &Vector3<f64>| u.dot(&offset).abs() + (b.support(u) - a.support(u)).abs();
    let mut starts: Vec<(f64, Vector3<f64>)> = (0..DIRECTIONS)
        .map(|k| {
            // A Fibonacci spiral over the upper half sphere.
            let z = (f64::from(k) + 0.5) / f64::from(DIRECTIONS);
            let (sin, cos) = (f64::from(k) * GOLDEN_ANGLE).sin_cos();
            let radius = (1.0 - z * z).sqrt();
            Vector3::new(radius * cos, radius * sin, z)
        })
        .chain(offset.try_normalize(0.0))
        .map(|u| (difference(&u), u))
        .collect();
    if starts.iter().any(|start| start.0.is_nan()) {
        return f64::NAN;
    }
    starts.sort_by(|p, q| q.0.total_cmp(&p.0));
    starts.truncate(REFINED);
    starts.into_iter().map(|(value, u)| refine(&difference, value, u)).fold(0.0, f64::max)
}

/// The angle that spreads points evenly, 2 pi (1 - 1 / golden ratio).
const GOLDEN_ANGLE: f64 = 2.399963229728653;

/// Turns of the search pattern that must all fail before its step is halved. At a ridge (bodies with edges) only a
/// narrow sector of directions ascends.
const TURNS: u32 = 8;

/// Largest value near `u`: steps on the sphere in eight directions, turned and then halved when none of them ascends.
fn refine(f: &impl Fn(&Vector3<f64>) -> f64, mut value: f64, mut u: Vector3<f64>) -> f64 {
    let (mut step, mut turn, mut failed) = (0.05, 0.0, 0);
    while step > 1e-8 {
        let x = u.cross(&Vector3::ith(u.iamin(), 1.0)).normalize();
        let y = u.cross(&x);
        let (mut best, mut best_u) = (value, u);
        for k in 0..8 {
            let (sin, cos) = (turn + TAU / 8.0 * f64::from(k)).sin_cos();
            let v = (u + (x * cos + y * sin) * step).normalize();
            let next = f(&v);
            if next > best {
                (best, best_u) = (next, v);
            }
        }
        if best > value {
            (value, u, failed) = (best, best_u, 0);
        } else {
            failed += 1;
        }
        if failed == TURNS {
            (step, failed) = (0.5 * step, 0);
        }
        turn += GOLDEN_ANGLE;
    }
    value
}

/// Squared Wasserstein-2 distance between the uniform distributions on two ellipsoids, in squared world units:
/// `|dt|^2 + tr(S1 + S2 - 2 (S1^1/2 S2 S1^1/2)^1/2)` with the second moments `S = A / 5`.
///
/// NaN if a body contains a non-finite number.
pub fn squared_wasserstein(a: &Ellipsoid, b: &Ellipsoid) -> f64 {
    let r = a.rotation.matrix();
    let root = r * Matrix3::from_diagonal(&a.semi_axes) * r.transpose();
    let shape = b.shape();
    let Some((values, _)) = symmetric_eigen3(&(root * shape * root)) else { return f64::NAN };
    let cross: f64 = values.iter().map(|v| v.max(0.0).sqrt()).sum();
    let moments = (a.semi_axes.norm_squared() + b.semi_axes.norm_squared() - 2.0 * cross).max(0.0) / 5.0;
    (a.center - b.center).norm_squared() + moments
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Cuboid;
    use nalgebra::{Point3, Rotation3};
    use proptest::prelude::*;

    fn ellipsoid(center: [f64; 3], semi_axes: [f64; 3], angles: [f64; 3]) -> Ellipsoid {
        Ellipsoid {
            center: Point3::from(center),
            semi_axes: Vector3::from(semi_axes),
            rotation: Rotation3::from_euler_angles(angles[0], angles[1], angles[2]),
        }
    }

    #[test]
    fn hausdorff_distance_of_spheres_and_concentric_ellipsoids() {
        let (a, b) = (ellipsoid([0.0; 3], [1.0; 3], [0.0; 3]), ellipsoid([3.0, 0.0, 4.0], [2.5; 3], [0.0; 3]));
        assert!((hausdorff_distance(&a, &b) - 6.5).abs() < 1e-12);
        assert_eq!(hausdorff_distance(&a, &a), 0.0);
        let (p, q) = (ellipsoid([1e6; 3], [3.0, 2.0, 1.0], [0.4; 3]), ellipsoid([1e6; 3], [3.2, 2.7, 1.1], [0.4; 3]));
        assert!((hausdorff_distance(&p, &q) - 0.7).abs() < 1e-9);
        assert!(hausdorff_distance(&p, &ellipsoid([0.0; 3], [f64::NAN; 3], [0.0; 3])).is_nan());
    }

    #[test]
    fn the_hausdorff_distance_of_cuboids_is_reached_at_a_corner() {
        // Farthest corner of one from the other, both ways.
        let outside = |from: &Cuboid, to: &Cuboid| {
            from.corners()
                .iter()
                .map(|corner| {
                    let local = to.rotation.inverse() * (corner - to.center);
                    (local.abs() - to.half_extents).sup(&Vector3::zeros()).norm()
                })
                .fold(0.0, f64::max)
        };
        for k in 0..20 {
            let k = f64::from(k);
            let cuboid = |e: Ellipsoid| Cuboid { center: e.center, half_extents: e.semi_axes, rotation: e.rotation };
            let a = cuboid(ellipsoid([0.0; 3], [1.0, 2.0, 0.5], [0.3 * k, 0.2, 0.1 * k]));
            let b = cuboid(ellipsoid([0.1 * k, 0.3, -0.05 * k], [1.5, 0.7, 0.9], [0.1, 0.5 * k, 0.4]));
            let expected = outside(&a, &b).max(outside(&b, &a));
            let distance = hausdorff_distance(&a, &b);
            assert!((distance - expected).abs() < 1e-4 * expected, "{distance} {expected}");
        }
    }

    #[test]
    fn wasserstein_of_known_pairs() {
        let a = ellipsoid([0.0; 3], [3.0, 2.0, 1.0], [0.3, 0.1, 0.2]);
        assert!(squared_wasserstein(&a, &a) < 1e-12);
        // The same axes: the mean of the squared differences of corresponding points.
        let b = ellipsoid([1.0, 0.0, 0.0], [3.5, 2.0, 0.8], [0.3, 0.1, 0.2]);
        assert!((squared_wasserstein(&a, &b) - 1.0 - (0.25 + 0.04) / 5.0).abs() < 1e-12);
        assert!(squared_wasserstein(&a, &ellipsoid([f64::NAN; 3], [1.0; 3], [0.0; 3])).is_nan());
    }

    proptest! {
        #[test]
        fn both_distances_are_symmetric(
            center in prop::array::uniform3(-2.0..2.0f64), semi_axes in prop::array::uniform3(0.1..3.0f64),
            angles in prop::array::uniform3(-3.0..3.0f64),
        ) {
            let (a, b) = (ellipsoid([0.0; 3], [2.0, 1.0, 0.5], [0.1; 3]), ellipsoid(center, semi_axes, angles));
            prop_assert!((hausdorff_distance(&a, &b) - hausdorff_distance(&b, &a)).abs() < 1e-9);
            prop_assert!((squared_wasserstein(&a, &b) - squared_wasserstein(&b, &a)).abs() < 1e-9);
            prop_assert!(squared_wasserstein(&a, &b) >= (a.center - b.center).norm_squared());
        }
    }
}
