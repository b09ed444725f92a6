//! A pinhole camera taken apart into intrinsics and pose, so that each part can be corrected by itself.

use nalgebra::{Matrix3, Matrix3x4, Vector3};

use crate::geometry::{Intrinsics, Projection};

/// A pinhole camera in parts: `P = K [R | t]`.
///
/// Unlike [`crate::geometry::CamFromWorld`] the pose is not checked: wrong conventions may give any matrix.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraParts {
    /// Focal lengths and principal point, pixels.
    pub intrinsics: Intrinsics,
    /// `R` of `cam_from_world`.
    pub rotation: Matrix3<f64>,
    /// `t` of `cam_from_world`, world units.
    pub translation: Vector3<f64>,
}

impl CameraParts {
    /// Takes a projection apart; a skew is dropped. `None` if the camera has no finite center.
    pub fn from_projection(projection: &Projection) -> Option<Self> {
        let pose = projection.camera_pose()?;
        let rotation = pose.matrix().fixed_columns::<3>(0).into_owned();
        let m = projection.m();
        let k = m * rotation.transpose() / m.row(2).norm();
        Some(Self {
            intrinsics: Intrinsics::new(k[(0, 0)].abs(), k[(1, 1)].abs(), k[(0, 2)], k[(1, 2)]).ok()?,
            rotation,
            translation: pose.matrix().column(3).into_owned(),
        })
    }

    /// The projection `K [R | t]`; `None` if it is singular.
    pub fn projection(&self) -> Option<Projection> {
        let mut pose = Matrix3x4::zeros();
        pose.fixed_columns_mut::<3>(0).copy_from(&self.rotation);
        pose.set_column(3, &self.translation);
        Projection::from_matrix(self.intrinsics.matrix() * pose).ok()
    }

    /// The camera center in the world, for a rotation.
    pub fn center(&self) -> Vector3<f64> {
        -(self.rotation.transpose() * self.translation)
    }

    /// The same camera with another center.
    pub fn with_center(&self, center: &Vector3<f64>) -> Self {
        Self { translation: -(self.rotation * center), ..*self }
    }
}
