//! Rigid motions without checks, for searches that make many of them; [`CamFromWorld`] is the checked one.

use nalgebra::{Matrix3, Matrix3x4, Rotation3, Vector3};

use super::camera::CamFromWorld;

/// A rotation and a translation: `target = rotation * source + translation`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Pose {
    pub rotation: Matrix3<f64>,
    pub translation: Vector3<f64>,
}

impl From<&CamFromWorld> for Pose {
    fn from(pose: &CamFromWorld) -> Self {
        let matrix = pose.matrix();
        Self { rotation: matrix.fixed_columns::<3>(0).into_owned(), translation: matrix.column(3).into_owned() }
    }
}

impl Pose {
    /// The nearest pose with an exact rotation and the same center.
    pub(crate) fn orthonormal(&self) -> Self {
        let rotation = *Rotation3::from_matrix_eps(&self.rotation, 1e-12, 50, Rotation3::identity()).matrix();
        Self { rotation, translation: -(rotation * self.center()) }
    }

    pub(crate) fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation: Vector3::zeros() }
    }

    /// The same as a checked one.
    pub(crate) fn checked(&self) -> Option<CamFromWorld> {
        let mut matrix = Matrix3x4::zeros();
        matrix.fixed_columns_mut::<3>(0).copy_from(&self.rotation);
        matrix.set_column(3, &self.translation);
        CamFromWorld::new(matrix).ok()
    }

    pub(crate) fn apply(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }

    pub(crate) fn inverse(&self) -> Self {
        Self { rotation: self.rotation.transpose(), translation: -self.rotation.tr_mul(&self.translation) }
    }

    /// First the other one, then this one.
    pub(crate) fn after(&self, other: &Self) -> Self {
        Self { rotation: self.rotation * other.rotation, translation: self.apply(&other.translation) }
    }

    /// The origin of the target in the source: the center of a camera.
    pub(crate) fn center(&self) -> Vector3<f64> {
        -self.rotation.tr_mul(&self.translation)
    }

    /// Angle between the rotations of two poses, radians.
    pub(crate) fn angle_to(&self, other: &Self) -> f64 {
        2.0 * ((self.rotation - other.rotation).norm() / 8f64.sqrt()).min(1.0).asin()
    }

    /// The pose followed by a small motion in the target: rotation vector, shift.
    pub(crate) fn moved(&self, turn: &Vector3<f64>, shift: &Vector3<f64>) -> Self {
        let turn = Rotation3::new(*turn);
        Self { rotation: turn.matrix() * self.rotation, translation: turn * self.translation + shift }
    }
}
