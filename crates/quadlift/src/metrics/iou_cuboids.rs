//! Volume IoU of cuboids by exact clipping. Of other bodies it is that of the cuboids around them.

use nalgebra::{Matrix3, Vector3};

use super::ratio_of_union;
use crate::geometry::{Body, BodyKind};

/// Volume of the intersection over volume of the union, in [0, 1], exact to rounding.
///
/// Zero if a body has no volume or contains a non-finite number.
pub(super) fn iou3d_cuboids(a: &Body, b: &Body) -> f64 {
    ratio_of_union(cuboid_intersection_volume(a, b), volume(a), volume(b))
}

/// Volume common to two cuboids, in cubic world units.
///
/// Every face of the common body is a face of one cuboid clipped by the six planes of the other; the volume is the
/// sum of the cones over these faces. A face plane that both share counts once, with the first cuboid.
fn cuboid_intersection_volume(a: &Body, b: &Body) -> f64 {
    let offset = b.center - a.center;
    let size = a.half_extents.amax().max(b.half_extents.amax());
    let usable = |c: &Body| c.half_extents.iter().all(|h| h.is_finite() && *h > 0.0);
    if !usable(a) || !usable(b) || !offset.iter().all(|x| x.is_finite()) {
        return 0.0;
    }
    // Points within this distance of a plane lie on it.
    let slack = 1e-12 * size;
    let first = Placed { center: Vector3::zeros(), axes: *a.rotation.matrix(), half: a.half_extents };
    let second = Placed { center: offset, axes: *b.rotation.matrix(), half: b.half_extents };
    let mut faces = Vec::with_capacity(12);
    first.clipped_faces(&second, slack, &mut faces);
    second.clipped_faces(&first, -slack, &mut faces);
    let Some(apex) = faces.first().map(|face| face.corners[0]) else { return 0.0 };
    let common: f64 = faces.iter().map(|face| face.area() * face.normal.dot(&(face.corners[0] - apex)) / 3.0).sum();
    common.max(0.0).min(volume(a)).min(volume(b))
}

fn volume(cuboid: &Body) -> f64 {
    BodyKind::Cuboid.volume(&cuboid.half_extents)
}

/// A cuboid relative to the first one's center.
struct Placed {
    center: Vector3<f64>,
    axes: Matrix3<f64>,
    half: Vector3<f64>,
}

/// A convex polygon with its unit normal.
struct Face {
    normal: Vector3<f64>,
    corners: Vec<Vector3<f64>>,
}

impl Placed {
    /// The parts of the six faces that lie in `other`, whose planes are moved outwards by `slack`.
    fn clipped_faces(&self, other: &Placed, slack: f64, faces: &mut Vec<Face>) {
        for axis in 0..3 {
            let arm = |k: usize| self.axes.column((axis + k) % 3) * self.half[(axis + k) % 3];
            let (u, v) = (arm(1), arm(2));
            for sign in [1.0, -1.0] {
                let middle = self.center + arm(0) * sign;
                let corners = vec![middle + u + v, middle - u + v, middle - u - v, middle + u - v];
                let mut face = Face { normal: self.axes.column(axis) * sign, corners };
                for other_axis in 0..3 {
                    for other_sign in [1.0, -1.0] {
                        let n = other.axes.column(other_axis) * other_sign;
                        face.clip(&n, n.dot(&other.center) + other.half[other_axis] + slack);
                    }
                }
                if face.corners.len() >= 3 {
                    faces.push(face);
                }
            }
        }
    }
}

impl Face {
    /// Keeps the part with `n.x <= d` (Sutherland and Hodgman).
    fn clip(&mut self, n: &Vector3<f64>, d: f64) {
        let mut kept = Vec::with_capacity(self.corners.len() + 1);
        for (i, p) in self.corners.iter().enumerate() {
            let q = &self.corners[(i + 1) % self.corners.len()];
            let (at_p, at_q) = (n.dot(p) - d, n.dot(q) - d);
            if at_p <= 0.0 {
                kept.push(*p);
            }
            if (at_p <= 0.0) != (at_q <= 0.0) {
                kept.push(p + (q - p) * (at_p / (at_p - at_q)));
            }
        }
        self.corners = kept;
    }

    fn area(&self) -> f64 {
        let apex = self.corners[0];
        let twice: Vector3<f64> = self.corners.windows(2).map(|pair| (pair[0] - apex).cross(&(pair[1] - apex))).sum();
        0.5 * twice.norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::ConvexBody;
    use nalgebra::{Point3, Rotation3};
    use proptest::prelude::*;
    use rand::{RngExt, SeedableRng};

    fn cuboid(center: [f64; 3], half: [f64; 3], angles: [f64; 3]) -> Body {
        Body {
            kind: BodyKind::Cuboid,
            center: Point3::from(center),
            half_extents: Vector3::from(half),
            rotation: Rotation3::from_euler_angles(angles[0], angles[1], angles[2]),
        }
    }

    #[test]
    fn axis_aligned_cuboids() {
        let a = cuboid([0.0; 3], [1.0, 2.0, 3.0], [0.0; 3]);
        let b = cuboid([1.0, 1.0, 1.0], [1.0, 2.0, 3.0], [0.0; 3]);
        assert!((cuboid_intersection_volume(&a, &b) - 1.0 * 3.0 * 5.0).abs() < 1e-10);
        assert!((iou3d_cuboids(&a, &b) - 15.0 / 81.0).abs() < 1e-12);
        assert!((iou3d_cuboids(&a, &a) - 1.0).abs() < 1e-10);
        assert!((iou3d_cuboids(&a, &a.scaled(0.5)) - 0.125).abs() < 1e-12);
    }

    #[test]
    fn shared_planes_count_once_and_touching_bodies_share_nothing() {
        let a = cuboid([0.0; 3], [1.0, 1.0, 1.0], [0.3, 0.1, -0.7]);
        let beside = |distance: f64| Body { center: a.center + a.rotation * Vector3::new(distance, 0.0, 0.0), ..a };
        assert!((cuboid_intersection_volume(&a, &beside(0.5)) - 6.0).abs() < 1e-9);
        assert!(cuboid_intersection_volume(&a, &beside(2.0)) < 1e-10);
        assert!((cuboid_intersection_volume(&a, &beside(2.0 - 1e-6)) - 4e-6).abs() < 1e-10);
        assert_eq!(cuboid_intersection_volume(&a, &beside(2.1)), 0.0);
        // The same box with its axes named differently.
        let turned =
            Body { rotation: a.rotation * Rotation3::from_euler_angles(0.0, 0.0, std::f64::consts::FRAC_PI_2), ..a };
        assert!((iou3d_cuboids(&a, &turned) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_box_turned_by_45_degrees_leaves_an_octagonal_prism() {
        let a = cuboid([0.0; 3], [1.0, 1.0, 2.0], [0.0; 3]);
        let b = cuboid([0.0; 3], [1.0, 1.0, 2.0], [0.0, 0.0, std::f64::consts::FRAC_PI_4]);
        let octagon = 8.0 * (2.0f64.sqrt() - 1.0);
        assert!((cuboid_intersection_volume(&a, &b) - 4.0 * octagon).abs() < 1e-10);
    }

    #[test]
    fn far_from_the_origin_and_very_flat() {
        let a = cuboid([1e6, -2e6, 3e6], [1.0, 1e3, 1e3], [0.2, 0.5, 1.0]);
        let b = Body { center: a.center + a.rotation * Vector3::new(0.5, 0.0, 0.0), ..a };
        assert!((iou3d_cuboids(&a, &b) - 0.6).abs() < 1e-8);
        let broken = Body { half_extents: Vector3::new(f64::NAN, 1.0, 1.0), ..a };
        assert_eq!(iou3d_cuboids(&a, &broken), 0.0);
        assert_eq!(iou3d_cuboids(&a, &Body { half_extents: Vector3::zeros(), ..a }), 0.0);
    }

    #[test]
    fn agrees_with_sampling() {
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(11);
        for _ in 0..12 {
            let mut random = |low: f64, high: f64| -> [f64; 3] { std::array::from_fn(|_| rng.random_range(low..high)) };
            let a = cuboid(random(-1.0, 1.0), random(0.3, 2.0), random(-3.0, 3.0));
            let b = cuboid(random(-1.0, 1.0), random(0.3, 2.0), random(-3.0, 3.0));
            let n = 200_000;
            let inside = (0..n)
                .filter(|_| {
                    let local = Vector3::from_fn(|i, _| a.half_extents[i] * rng.random_range(-1.0..1.0));
                    b.contains(&(a.center + a.rotation * local))
                })
                .count();
            let share = inside as f64 / f64::from(n);
            // Five standard deviations of the sampled share.
            let bound = 5.0 * (0.25 / f64::from(n)).sqrt();
            assert!((cuboid_intersection_volume(&a, &b) / a.volume() - share).abs() < bound);
        }
    }

    proptest! {
        #[test]
        fn symmetric_and_in_range(
            center in prop::array::uniform3(-2.0..2.0f64), half in prop::array::uniform3(0.05..2.0f64),
            angles in prop::array::uniform3(-3.0..3.0f64),
        ) {
            let (a, b) = (cuboid([0.0; 3], [1.0, 0.7, 0.4], [0.1, 0.2, 0.3]), cuboid(center, half, angles));
            let iou = iou3d_cuboids(&a, &b);
            prop_assert!((0.0..=1.0).contains(&iou));
            prop_assert!((iou - iou3d_cuboids(&b, &a)).abs() < 1e-9);
        }

        #[test]
        fn aligned_cuboids_overlap_like_intervals(
            center in prop::array::uniform3(-2.0..2.0f64), half in prop::array::uniform3(0.05..2.0f64),
        ) {
            let (a, b) = (cuboid([0.0; 3], [1.0, 0.7, 0.4], [0.0; 3]), cuboid(center, half, [0.0; 3]));
            let expected: f64 = (0..3)
                .map(|i| {
                    let low = (-a.half_extents[i]).max(center[i] - half[i]);
                    (a.half_extents[i].min(center[i] + half[i]) - low).max(0.0)
                })
                .product();
            prop_assert!((cuboid_intersection_volume(&a, &b) - expected).abs() < 1e-9);
        }
    }
}
