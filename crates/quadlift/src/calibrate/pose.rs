//! Poses without checks.

use nalgebra::{Matrix3, Matrix3x4, Rotation3, Vector3};

use crate::geometry::CamFromWorld;

/// A rotation and a translation: `target = rotation * source + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    pub rotation: Matrix3<f64>,
    pub translation: Vector3<f64>,
}

impl From<&CamFromWorld> for Pose {
    /// The nearest pose with an exact rotation and the same centre.
    fn from(pose: &CamFromWorld) -> Self {
        let matrix = pose.matrix();
        let given = matrix.fixed_columns::<3>(0).into_owned();
        let rotation = *Rotation3::from_matrix_eps(&given, 1e-12, 50, Rotation3::identity()).matrix();
        let center = -given.tr_mul(&matrix.column(3).into_owned());
        Self { rotation, translation: -(rotation * center) }
    }
}

impl Pose {
    pub(super) fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// The same as a checked one.
    pub(super) fn checked(&self) -> Option<CamFromWorld> {
        let mut matrix = Matrix3x4::zeros();
        matrix.fixed_columns_mut::<3>(0).copy_from(&self.rotation);
        matrix.set_column(3, &self.translation);
        CamFromWorld::new(matrix).ok()
    }

    pub(super) fn apply(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    pub(super) fn inverse(&self) -> Self {
        Self { rotation: self.rotation.transpose(), translation: -self.rotation.tr_mul(&self.translation) }
    }

    /// First the other one, then this one.
    pub(super) fn after(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.apply(&other.translation) }
    }

    /// The origin of the target in the source: the centre of a camera.
    pub(super) fn center(&self) -> Vector3<f64> {
        -self.rotation.tr_mul(&self.translation)
    }

    /// Angle between the rotations of two poses, radians.
    pub(super) fn angle_to(&self, other: &Self) -> f64 {
        2.0 * ((self.rotation - other.rotation).norm() / 8f64.sqrt()).min(1.0).asin()
    }

    /// The pose followed by a small motion in the target: rotation vector, shift.
    pub(super) fn moved(&self, turn: &Vector3<f64>, shift: &Vector3<f64>) -> Self {
        let turn = Rotation3::new(*turn);
        Self { rotation: turn.matrix() * self.rotation, translation: turn * self.translation + shift }
    }
}

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
    if !cross.iter().all(|x| x.is_finite()) {
        return None;
    }
    let svd = cross.try_svd(true, true, 1e-15, 200)?;
    let (u, v_t) = (svd.u?, svd.v_t?);
    // On a line the turn about it is open.
    if svd.singular_values[1] < 1e-9 * svd.singular_values[0] || svd.singular_values[0] <= 0.0 {
        return None;
    }
    let sign = Vector3::new(1.0, 1.0, (u * v_t).determinant().signum());
    let rotation = u * Matrix3::from_diagonal(&sign) * v_t;
    Some(Pose { rotation, translation: to - rotation * from })
}

#[cfg(test)]
mod tests {
    use super::*;

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
