//! Similarities: a scale, a rotation and a translation from one frame to another.

use nalgebra::{Matrix3x4, Matrix4, Point3, Rotation3, Unit, Vector3};

use super::camera::{CamFromWorld, CameraError};
use super::ellipsoid::Ellipsoid;

/// Maps points of one frame to another: `scale * rotation * x + translation`. With the scale 1 it is rigid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Similarity {
    /// How long a unit of the source is in units of the target.
    pub scale: f64,
    /// `target_from_source`.
    pub rotation: Rotation3<f64>,
    /// Where the origin of the source is, target frame and units.
    pub translation: Vector3<f64>,
}

impl Similarity {
    /// The one that moves nothing.
    pub fn identity() -> Self {
        Self { scale: 1.0, rotation: Rotation3::identity(), translation: Vector3::zeros() }
    }

    /// A point in the target frame.
    pub fn point(&self, point: &Point3<f64>) -> Point3<f64> {
        Point3::from(self.rotation * point.coords * self.scale + self.translation)
    }

    /// An ellipsoid in the target frame.
    pub fn ellipsoid(&self, body: &Ellipsoid) -> Ellipsoid {
        Ellipsoid {
            center: self.point(&body.center),
            semi_axes: body.semi_axes * self.scale,
            rotation: self.rotation * body.rotation,
        }
    }

    /// The pose in the target frame of a camera whose pose in the source is known. Lengths in the camera's frame are scaled, too.
    ///
    /// # Errors
    /// [`CameraError`] where numbers overflow.
    pub fn camera(&self, cam_from_source: &CamFromWorld) -> Result<CamFromWorld, CameraError> {
        // x_source = R^T (x - t) / s: the camera sees K (R' x_source + t'), of which a factor s changes nothing.
        let matrix = cam_from_source.matrix();
        let rotation = matrix.fixed_columns::<3>(0) * self.rotation.matrix().transpose();
        let translation = matrix.column(3) * self.scale - rotation * self.translation;
        let mut moved = Matrix3x4::zeros();
        moved.fixed_columns_mut::<3>(0).copy_from(&rotation);
        moved.set_column(3, &translation);
        CamFromWorld::new(moved)
    }

    /// A direction in the target frame.
    pub fn direction(&self, direction: &Unit<Vector3<f64>>) -> Unit<Vector3<f64>> {
        self.rotation * direction
    }

    /// From the target to the source.
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.inverse();
        Self { scale: 1.0 / self.scale, rotation, translation: -(rotation * self.translation) / self.scale }
    }

    /// First `other`, then this one.
    #[must_use]
    pub(crate) fn after(&self, other: &Self) -> Self {
        Self {
            scale: self.scale * other.scale,
            rotation: self.rotation * other.rotation,
            translation: self.point(&other.translation.into()).coords,
        }
    }

    /// Angle of the rotation in [0, pi], radians; accurate for small ones, too.
    pub fn angle(&self) -> f64 {
        self.angle_to(&Self::identity())
    }

    /// Angle between the rotations of two similarities in [0, pi], radians.
    pub fn angle_to(&self, other: &Self) -> f64 {
        2.0 * ((self.rotation.matrix() - other.rotation.matrix()).norm() / 8f64.sqrt()).min(1.0).asin()
    }

    /// The 4x4 matrix `[[s R, t], [0, 1]]`.
    pub fn matrix(&self) -> Matrix4<f64> {
        let mut matrix = Matrix4::identity();
        matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(&(self.rotation.matrix() * self.scale));
        matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&self.translation);
        matrix
    }

    /// Whether all its numbers are finite and its scale is positive.
    pub fn is_valid(&self) -> bool {
        let finite = |x: &f64| x.is_finite();
        let of_rotation = self.rotation.matrix().iter().all(finite);
        self.scale.is_finite() && self.scale > 0.0 && of_rotation && self.translation.iter().all(finite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Intrinsics, Projection, project_bounding_box};

    fn similarity() -> Similarity {
        Similarity {
            scale: 2.5,
            rotation: Rotation3::from_euler_angles(0.3, -0.8, 2.0),
            translation: Vector3::new(4.0, -1.0, 7.0),
        }
    }

    #[test]
    fn the_inverse_undoes_and_the_product_composes() {
        let point = Point3::new(0.4, 3.0, -2.0);
        let there = similarity().point(&point);
        assert!((similarity().inverse().point(&there) - point).norm() < 1e-12);
        let twice = similarity().after(&similarity());
        assert!((twice.point(&point) - similarity().point(&there)).norm() < 1e-12);
        let homogeneous = similarity().matrix() * point.to_homogeneous();
        assert!((homogeneous.xyz() - there.coords).norm() < 1e-12);
        assert!(similarity().is_valid());
        let turned = |angle: f64| Similarity { rotation: Rotation3::new(Vector3::y() * angle), ..similarity() };
        for angle in [0.0, 1e-9, 0.5, 3.0, std::f64::consts::PI] {
            assert!((turned(angle).angle() - angle).abs() <= 1e-7 * angle, "{angle}");
            assert!((turned(angle + 0.1).angle_to(&turned(0.1)) - angle).abs() < 1e-7);
        }
        assert!(!Similarity { scale: 0.0, ..similarity() }.is_valid());
    }

    #[test]
    fn a_moved_camera_sees_moved_bodies_in_the_same_place() {
        let body = Ellipsoid {
            center: Point3::new(0.2, -0.1, 5.0),
            semi_axes: Vector3::new(0.5, 0.3, 0.2),
            rotation: Rotation3::from_euler_angles(0.1, 0.7, -0.4),
        };
        let mut matrix = Matrix3x4::identity();
        matrix.set_column(3, &Vector3::new(0.3, 0.1, 1.0));
        let camera = CamFromWorld::new(matrix).unwrap();
        let intrinsics = Intrinsics::new(500.0, 520.0, 320.0, 240.0).unwrap();
        let seen = |camera: &CamFromWorld, body: &Ellipsoid| {
            project_bounding_box(&Projection::from_camera(&intrinsics, camera), body).unwrap()
        };
        let (a, b) =
            (seen(&camera, &body), seen(&similarity().camera(&camera).unwrap(), &similarity().ellipsoid(&body)));
        assert!((a.center() - b.center()).norm() < 1e-9 && (a.mean_half_size() - b.mean_half_size()).abs() < 1e-9);
    }
}
