//! Camera poses that were corrected with the objects.

use nalgebra::{Matrix3x4, Matrix6, Rotation3, Vector3};

use crate::geometry::{CamFromWorld, CameraError};

/// The correction of a frame's camera ([`super::PosteriorOptions::refine_poses`], [`super::PosteriorOptions::pose_noise`]).
#[derive(Debug, Clone, PartialEq)]
pub struct RefinedPose {
    /// Index into [`crate::scene::SceneParts::frames`].
    pub frame_index: usize,
    /// Rotation of the camera about its center, world axes.
    pub turn: Rotation3<f64>,
    /// Shift of its center, world units.
    pub shift: Vector3<f64>,
    /// Covariance of the errors that are left: rotation vector (radians) and shift (world units), world axes. It is that of the prior and the
    /// measurements; what moves all cameras and objects together is in it.
    pub covariance: Option<Matrix6<f64>>,
}

impl RefinedPose {
    /// The corrected pose of a camera whose pose was given.
    ///
    /// # Errors
    /// [`CameraError`] for numbers that are not finite.
    pub fn cam_from_world(&self, given: &CamFromWorld) -> Result<CamFromWorld, CameraError> {
        let given = given.matrix();
        let rotation = given.fixed_columns::<3>(0).into_owned();
        let center = -(rotation.tr_mul(&given.column(3)));
        let rotation = rotation * self.turn.matrix().transpose();
        let mut corrected = Matrix3x4::zeros();
        corrected.fixed_columns_mut::<3>(0).copy_from(&rotation);
        corrected.set_column(3, &-(rotation * (center + self.shift)));
        CamFromWorld::new(corrected)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Intrinsics, Projection};

    #[test]
    fn a_corrected_pose_projects_as_the_moved_camera() {
        let turn = Rotation3::new(Vector3::new(0.02, -0.01, 0.03));
        let (rotation, t) = (Rotation3::new(Vector3::new(0.4, 0.2, -0.7)), Vector3::new(1.0, -2.0, 5.0));
        let mut matrix = Matrix3x4::zeros();
        matrix.fixed_columns_mut::<3>(0).copy_from(rotation.matrix());
        matrix.set_column(3, &t);
        let given = CamFromWorld::new(matrix).unwrap();
        let shift = Vector3::new(0.3, 0.1, -0.2);
        let intrinsics = Intrinsics::new(500.0, 510.0, 320.0, 240.0).unwrap();
        let refined = RefinedPose { frame_index: 0, turn, shift, covariance: None }.cam_from_world(&given).unwrap();
        let moved = Projection::from_camera(&intrinsics, &given).with_moved_camera(&turn, &shift).unwrap();
        let expected = Projection::from_camera(&intrinsics, &refined);
        assert!((moved.matrix() - expected.matrix()).norm() < 1e-9 * moved.matrix().norm());
    }
}
