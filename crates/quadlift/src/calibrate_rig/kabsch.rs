//! Rigid motions from pairs of points.

use nalgebra::{Matrix3, Vector3};

use crate::geometry::rigid::Pose;
use crate::geometry::rotation::nearest_rotation;

/// A point, where it is taken to, and its weight.
pub(super) type WeightedPair = (Vector3<f64>, Vector3<f64>, f64);

/// The rigid motion that takes one set of points to another one with the least weighted sum of squares (Kabsch 1976); `None` for
/// fewer than three points or points on a line.
pub(super) fn kabsch(pairs: &[WeightedPair]) -> Option<Pose> {
    let total: f64 = pairs.iter().map(|pair| pair.2).sum();
    if pairs.len() < 3 || !(total.is_finite() && total > 0.0) {
        return None;
    }
    let mean = |of: fn(&WeightedPair) -> Vector3<f64>| {
        pairs.iter().map(|pair| of(pair) * pair.2).sum::<Vector3<f64>>() / total
    };
    let (from, to) = (mean(|p| p.0), mean(|p| p.1));
    let cross: Matrix3<f64> = pairs.iter().map(|(a, b, weight)| (b - to) * (a - from).transpose() * *weight).sum();
    let (rotation, spread) = nearest_rotation(&cross)?;
    // On a line the turn about it is open.
    if spread[1] < 1e-9 * spread[0] || spread[0] <= 0.0 {
        return None;
    }
    Some(Pose { rotation, translation: to - rotation * from })
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    #[test]
    fn the_motion_of_points_is_found_also_in_a_plane_and_not_on_a_line() {
        let truth = Pose {
            rotation: *Rotation3::new(Vector3::new(0.4, -1.1, 2.0)).matrix(),
            translation: Vector3::new(1.0, -2.0, 0.5),
        };
        let points = [[0.0, 0.0], [1.0, 0.2], [-0.4, 2.0], [0.7, -1.0]].map(|[x, y]| Vector3::new(x, y, 3.0));
        let pairs = points.map(|p| (p, truth.apply(&p), 1.0));
        let found = kabsch(&pairs).unwrap();
        assert!((found.rotation - truth.rotation).norm() + (found.translation - truth.translation).norm() < 1e-12);
        assert!(found.inverse().after(&truth).angle_to(&Pose::identity()) < 1e-7);
        let line = [0.0, 1.0, 2.0, 5.0].map(|x| Vector3::new(x, 2.0 * x, 1.0)).map(|p| (p, truth.apply(&p), 1.0));
        assert!(kabsch(&line).is_none() && kabsch(&pairs[..2]).is_none());
        assert!(kabsch(&pairs.map(|(a, _, w)| (a, Vector3::repeat(f64::NAN), w))).is_none());
    }
}
