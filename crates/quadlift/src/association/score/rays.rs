//! Spheres from the rays of boxes: candidates for new objects.

use nalgebra::{Matrix3, Vector3};

use crate::association::input::observations::{BoxObservation, Camera, Observations};
use crate::geometry::linalg::{invert_spd, solve_spd};
use crate::geometry::ray_sum::RaySum;

/// Standard deviation of a ray across its direction, in radii of the sphere that fills the box.
pub(crate) const RAY_SD: f64 = 0.2;

/// Standard deviation of the log radius estimated from a box.
pub(crate) const LOG_RADIUS_SD: f64 = 0.28;

/// Gaps between rays, and log ratios of radii, are rejected above this many standard deviations.
const MAX_GAP: f64 = 3.0;
const MAX_RATIO: f64 = 2.5;

/// Squared sine of the angle between rays below which they do not determine depth (0.06 degrees).
const MIN_SQUARED_SINE: f64 = 1e-6;

/// A sphere.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sphere {
    pub center: Vector3<f64>,
    pub log_radius: f64,
}

/// A sphere that is consistent with two boxes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PairSphere {
    pub sphere: Sphere,
    /// How badly the two agree: half of a sum of squares.
    pub disagreement: f64,
}

/// The sphere of two boxes of different cameras; `None` if their rays pass too far from each other, meet behind a
/// camera, or do not determine depth, or if the sizes are inconsistent.
pub(crate) fn pair_sphere(a: (&Camera, &BoxObservation), b: (&Camera, &BoxObservation)) -> Option<PairSphere> {
    let ((camera_a, box_a), (camera_b, box_b)) = (a, b);
    let (da, db) = (&box_a.ray, &box_b.ray);
    let between = camera_b.center - camera_a.center;
    let (aa, bb, ab) = (da.norm_squared(), db.norm_squared(), da.dot(db));
    let determinant = aa * bb - ab * ab;
    let (p, q) = (da.dot(&between), db.dot(&between));
    // Depths of the points where the rays are nearest, times the determinant.
    let (za, zb) = (bb * p - ab * q, ab * p - aa * q);
    if determinant.is_nan() || determinant < MIN_SQUARED_SINE * aa * bb || za <= 0.0 || zb <= 0.0 {
        return None;
    }
    let (za, zb) = (za / determinant, zb / determinant);
    let (ra, rb) = (box_a.radius_per_depth * za, box_b.radius_per_depth * zb);
    let (xa, xb) = (camera_a.center + da * za, camera_b.center + db * zb);
    let gap = (xa - xb).norm_squared();
    if gap > (MAX_GAP * RAY_SD).powi(2) * (ra * ra + rb * rb) {
        return None;
    }
    // The depths are uncertain, and the radii with them.
    let squared_sine = determinant / (aa * bb);
    let depth_variance = (ra * ra / (za * za * aa) + rb * rb / (zb * zb * bb)) / squared_sine;
    let variance = 2.0 * 0.3 * 0.3 + 2.0 * RAY_SD * RAY_SD * depth_variance;
    let ratio = (ra / rb).ln();
    if ratio * ratio > MAX_RATIO * MAX_RATIO * variance {
        return None;
    }
    let (wa, wb) = (1.0 / (ra * ra), 1.0 / (rb * rb));
    let center = (xa * wa + xb * wb) / (wa + wb);
    let disagreement = gap / (2.0 * RAY_SD * RAY_SD * ra * rb) + ratio * ratio / (2.0 * LOG_RADIUS_SD * LOG_RADIUS_SD);
    Some(PairSphere { sphere: Sphere { center, log_radius: 0.5 * (ra * rb).ln() }, disagreement })
}

/// The information about the center from the rays through boxes.
fn information(observations: &Observations, boxes: &[u32], center: &Vector3<f64>) -> RaySum {
    let mut rays = RaySum::zero();
    for &index in boxes {
        let observation = &observations.boxes[index as usize];
        let camera = &observations.cameras[observation.frame];
        let squared = observation.ray.norm_squared();
        let depth = ((center - camera.center).dot(&observation.ray) / squared).abs().max(1e-9);
        let weight = (RAY_SD * observation.radius_per_depth * depth).powi(-2);
        rays.add(&camera.center, &observation.ray, squared, weight);
    }
    rays
}

/// Covariance of the center of a sphere seen along the rays through boxes; isotropic with its radius if they do not
/// determine it.
pub(crate) fn center_covariance(observations: &Observations, boxes: &[u32], sphere: &Sphere) -> Matrix3<f64> {
    let mut sum = information(observations, boxes, &sphere.center).information;
    sum += Matrix3::identity() * (1e-7 * sum.trace());
    invert_spd(&sum).unwrap_or_else(|| Matrix3::identity() * (2.0 * sphere.log_radius).exp())
}

/// The sphere of many boxes, from a first guess of its center; `None` if it is not in front of all cameras.
pub(crate) fn triangulate_sphere(observations: &Observations, boxes: &[u32], guess: &Vector3<f64>) -> Option<Sphere> {
    let mut center = *guess;
    for _ in 0..2 {
        let RaySum { mut information, mut toward } = information(observations, boxes, &center);
        let little = 1e-7 * information.trace();
        information += Matrix3::identity() * little;
        toward += center * little;
        center = solve_spd(&information, &toward)?;
    }
    let mut log_radius = 0.0;
    for &index in boxes {
        let observation = &observations.boxes[index as usize];
        let camera = &observations.cameras[observation.frame];
        let depth = (center - camera.center).dot(&observation.ray) / observation.ray.norm_squared();
        if depth.is_nan() || depth <= 0.0 {
            return None;
        }
        log_radius += (observation.radius_per_depth * depth).ln() / boxes.len() as f64;
    }
    (log_radius.is_finite() && center.iter().all(|x| x.is_finite())).then_some(Sphere { center, log_radius })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::association::test_scenes::{ellipsoid, seen_by};
    use crate::geometry::Ellipsoid;

    fn ball() -> Ellipsoid {
        Ellipsoid { semi_axes: Vector3::repeat(2.0), ..ellipsoid() }
    }

    #[test]
    fn two_boxes_of_a_ball_show_it() {
        let (observations, _) = seen_by(9, &ball());
        let center = ball().center.coords - observations.origin;
        let side = |k: usize| (&observations.cameras[k], &observations.boxes[k]);
        let pair = pair_sphere(side(0), side(1)).unwrap();
        assert!((pair.sphere.center - center).norm() < 0.05, "{}", pair.sphere.center - center);
        assert!((pair.sphere.log_radius - 2.0f64.ln()).abs() < 0.01 && pair.disagreement < 0.01);
        // A box of itself has no other ray; one far away passes by.
        assert!(pair_sphere(side(0), side(0)).is_none());
        let mut moved = observations.clone();
        moved.move_boxes(1, &nalgebra::Vector2::new(0.0, 200.0));
        assert!(pair_sphere(side(0), (&moved.cameras[1], &moved.boxes[1])).is_none());
    }

    #[test]
    fn many_boxes_are_triangulated_from_a_poor_guess() {
        let (observations, _) = seen_by(9, &ball());
        let center = ball().center.coords - observations.origin;
        let boxes: Vec<u32> = (0..9).collect();
        let sphere = triangulate_sphere(&observations, &boxes, &(center + Vector3::new(20.0, 5.0, -9.0))).unwrap();
        assert!((sphere.center - center).norm() < 0.05 && (sphere.log_radius - 2.0f64.ln()).abs() < 0.01);
        let covariance = center_covariance(&observations, &boxes, &sphere);
        // Nine rays from all around, each 0.2 radii off across: about 0.4 / sqrt(9 * 2 / 3) along every axis.
        for axis in 0..3 {
            let sd = covariance[(axis, axis)].sqrt();
            assert!((0.12..0.25).contains(&sd), "{sd}");
        }
    }
}
