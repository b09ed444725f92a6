//! Cameras: intrinsics, `cam_from_world` poses and 3x4 projections.
//!
//! OpenCV axes (x right, y down, z forward); the pixel origin is the top-left corner of the image, so that the
//! first pixel's center is (0.5, 0.5).

use nalgebra::{Matrix3, Matrix3x4, Point3, Rotation3, Vector2, Vector3, Vector4};

use super::camera_model::CameraModel;
use super::rotation::rotation_defect;

/// Why a camera, a pose or a projection is refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CameraError {
    /// A number is NaN or infinite.
    #[error("{what} holds a number that is not finite")]
    NotFinite {
        /// What holds the number.
        what: &'static str,
    },
    /// A focal length is zero or negative.
    #[error("focal lengths are ({fx}, {fy}); expected two positive numbers (the intrinsics are singular)")]
    SingularIntrinsics {
        /// Horizontal focal length in pixels.
        fx: f64,
        /// Vertical focal length in pixels.
        fy: f64,
    },
    /// A camera model has another number of parameters.
    #[error("a {} camera has {} params [{}]; found {found}",
        model.name(), model.parameter_names().len(), model.parameter_names().join(", "))]
    ParameterCount {
        /// The model.
        model: CameraModel,
        /// How many parameters were given.
        found: usize,
    },
    /// A coefficient of a camera model is out of its range.
    #[error("a {} camera has {range}", model.name())]
    Coefficients {
        /// The model.
        model: CameraModel,
        /// What is allowed, in words.
        range: &'static str,
    },
    /// The left 3x3 block of `cam_from_world` is not a rotation.
    #[error("the 3x3 part of cam_from_world is not a rotation (|R R^T - I| is {defect:.3e}, at most 1e-3 is accepted)")]
    NotARotation {
        /// Largest entry of `|R R^T - I|`, infinite for a reflection.
        defect: f64,
    },
    /// The left 3x3 block of a projection is singular: the camera has no finite center.
    #[error("the left 3x3 block of the projection is singular (its determinant is {determinant:.3e})")]
    SingularProjection {
        /// Determinant of the block.
        determinant: f64,
    },
}

/// A pinhole camera without distortion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intrinsics {
    /// Horizontal focal length in pixels.
    pub fx: f64,
    /// Vertical focal length in pixels.
    pub fy: f64,
    /// Horizontal position of the principal point in pixels.
    pub cx: f64,
    /// Vertical position of the principal point in pixels.
    pub cy: f64,
}

impl Intrinsics {
    /// Checked intrinsics.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] and [`CameraError::SingularIntrinsics`].
    pub fn new(fx: f64, fy: f64, cx: f64, cy: f64) -> Result<Self, CameraError> {
        if ![fx, fy, cx, cy].iter().all(|x| x.is_finite()) {
            return Err(CameraError::NotFinite { what: "the intrinsics" });
        }
        if fx <= 0.0 || fy <= 0.0 {
            return Err(CameraError::SingularIntrinsics { fx, fy });
        }
        Ok(Self { fx, fy, cx, cy })
    }

    /// The calibration matrix `K` (3x3).
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(self.fx, 0.0, self.cx, 0.0, self.fy, self.cy, 0.0, 0.0, 1.0)
    }
}

/// A camera pose: maps world points to camera points (COLMAP's convention).
///
/// The rotation is used as it is given, even where it is orthonormal only to 1e-3: to make it orthonormal would
/// move cameras that are far from the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CamFromWorld {
    matrix: Matrix3x4<f64>,
}

impl CamFromWorld {
    /// A checked pose from `[R | t]`.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] and [`CameraError::NotARotation`] (off by more than 1e-3).
    pub fn new(matrix: Matrix3x4<f64>) -> Result<Self, CameraError> {
        if !matrix.iter().all(|x| x.is_finite()) {
            return Err(CameraError::NotFinite { what: "cam_from_world" });
        }
        let defect = rotation_defect(&matrix.fixed_columns::<3>(0).into_owned());
        if defect > 1e-3 {
            return Err(CameraError::NotARotation { defect });
        }
        Ok(Self { matrix })
    }

    /// The 3x4 matrix `[R | t]`.
    pub fn matrix(&self) -> &Matrix3x4<f64> {
        &self.matrix
    }
}

/// A 3x4 projection from world points to pixels, with `det M > 0` for its left 3x3 block `M`.
///
/// Points in front of the camera have a positive third coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize), serde(try_from = "Matrix3x4<f64>"))]
#[cfg_attr(feature = "serde", serde(into = "Matrix3x4<f64>"))]
pub struct Projection {
    matrix: Matrix3x4<f64>,
}

impl TryFrom<Matrix3x4<f64>> for Projection {
    type Error = CameraError;

    fn try_from(matrix: Matrix3x4<f64>) -> Result<Self, CameraError> {
        Self::from_matrix(matrix)
    }
}

impl From<Projection> for Matrix3x4<f64> {
    fn from(projection: Projection) -> Self {
        projection.matrix
    }
}

impl Projection {
    /// `K [R | t]`, unscaled.
    pub fn from_camera(intrinsics: &Intrinsics, cam_from_world: &CamFromWorld) -> Self {
        Self { matrix: intrinsics.matrix() * cam_from_world.matrix }
    }

    /// A bare projection, multiplied by the sign that makes `det M > 0`.
    ///
    /// # Errors
    /// [`CameraError::NotFinite`] and [`CameraError::SingularProjection`].
    pub fn from_matrix(matrix: Matrix3x4<f64>) -> Result<Self, CameraError> {
        if !matrix.iter().all(|x| x.is_finite()) {
            return Err(CameraError::NotFinite { what: "the projection" });
        }
        let m = matrix.fixed_columns::<3>(0).into_owned();
        let determinant = m.determinant();
        // Relative to the row norms: scaling a row of a projection does not make it singular.
        let size: f64 = m.row_iter().map(|row| row.norm()).product();
        if determinant.is_nan() || determinant.abs() <= 1e-12 * size {
            return Err(CameraError::SingularProjection { determinant });
        }
        Ok(Self { matrix: matrix * determinant.signum() })
    }

    /// The 3x4 matrix.
    pub fn matrix(&self) -> &Matrix3x4<f64> {
        &self.matrix
    }

    /// The left 3x3 block `M`.
    pub fn m(&self) -> Matrix3<f64> {
        self.matrix.fixed_columns::<3>(0).into_owned()
    }

    /// The camera center in the world; `None` only when the block `M` cannot be inverted in floating point.
    pub fn center_in_world(&self) -> Option<Point3<f64>> {
        let center = self.m().lu().solve(&-self.matrix.column(3).into_owned())?;
        center.iter().all(|x| x.is_finite()).then(|| Point3::from(center))
    }

    /// The same camera turned about its center and then shifted, both in the world; `None` where it has no center (see
    /// [`Projection::center_in_world`]).
    pub fn with_moved_camera(&self, turn: &Rotation3<f64>, shift: &Vector3<f64>) -> Option<Self> {
        let center = self.center_in_world()?;
        let m = self.m() * turn.matrix().transpose();
        let mut matrix = Matrix3x4::zeros();
        matrix.fixed_columns_mut::<3>(0).copy_from(&m);
        matrix.set_column(3, &-(m * (center.coords + shift)));
        Some(Self { matrix })
    }

    /// The pose of the camera: axes that see pixels as `K [R | t]` does, with positive focal lengths in `K` and no skew
    /// of its second row. `None` where the camera has no center (see [`Projection::center_in_world`]).
    ///
    /// Of [`Projection::from_camera`] it is the pose, with a rotation that is exactly orthonormal.
    pub fn camera_pose(&self) -> Option<CamFromWorld> {
        let m = self.m();
        let row = |i: usize| m.row(i).transpose();
        let z = row(2).try_normalize(0.0)?;
        let y = (row(1) - z * row(1).dot(&z)).try_normalize(0.0)?;
        let rotation = Matrix3::from_rows(&[y.cross(&z).transpose(), y.transpose(), z.transpose()]);
        let mut matrix = Matrix3x4::zeros();
        matrix.fixed_columns_mut::<3>(0).copy_from(&rotation);
        matrix.set_column(3, &-(rotation * self.center_in_world()?.coords));
        CamFromWorld::new(matrix).ok()
    }

    /// Focal lengths and principal point of the camera whose pose is [`Projection::camera_pose`]; skew is dropped. `None` where
    /// that is, or where the numbers overflow.
    pub fn intrinsics(&self) -> Option<Intrinsics> {
        let k = self.m() * self.world_from_cam_rotation()?;
        let scale = k[(2, 2)];
        Intrinsics::new(k[(0, 0)] / scale, k[(1, 1)] / scale, k[(0, 2)] / scale, k[(1, 2)] / scale).ok()
    }

    /// The rotation from the axes of the camera (x to the right, y down, z forwards) to those of the world; `None` where
    /// [`Projection::camera_pose`] is.
    pub fn world_from_cam_rotation(&self) -> Option<Matrix3<f64>> {
        Some(self.camera_pose()?.matrix().fixed_columns::<3>(0).transpose())
    }

    /// Unit direction of the ray through a pixel, pointing away from the camera, in the world.
    pub fn ray_in_world(&self, pixel: &Vector2<f64>) -> Option<Vector3<f64>> {
        let ray = self.m().lu().solve(&Vector3::new(pixel.x, pixel.y, 1.0))?;
        ray.try_normalize(0.0).filter(|d| d.iter().all(|x| x.is_finite()))
    }

    /// Distance of a world point from the camera plane, positive in front, in world units.
    pub fn depth(&self, point: &Point3<f64>) -> f64 {
        let row = self.matrix.row(2);
        (row[0] * point.x + row[1] * point.y + row[2] * point.z + row[3])
            / (row[0] * row[0] + row[1] * row[1] + row[2] * row[2]).sqrt()
    }

    /// The pixel of a world point; `None` when the point is not in front of the camera.
    pub fn project_point(&self, point: &Point3<f64>) -> Option<Vector2<f64>> {
        let h = self.matrix * Vector4::new(point.x, point.y, point.z, 1.0);
        (h.z > 0.0).then(|| Vector2::new(h.x / h.z, h.y / h.z))
    }

    /// Mean focal length in pixels: the geometric mean of the parts of the first two rows that are orthogonal to
    /// the third, over the norm of the third.
    pub fn focal_length(&self) -> f64 {
        let m = self.m();
        let axis = m.row(2).normalize();
        let scale = m.row(2).norm();
        let part = |i: usize| (m.row(i) - axis * m.row(i).dot(&axis)).norm() / scale;
        (part(0) * part(1)).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose(z: f64) -> Matrix3x4<f64> {
        let mut m = Matrix3x4::identity();
        m[(2, 3)] = z;
        m
    }

    #[test]
    fn the_principal_point_is_where_the_optical_axis_hits() {
        let intrinsics = Intrinsics::new(500.0, 510.0, 320.0, 240.0).unwrap();
        let projection = Projection::from_camera(&intrinsics, &CamFromWorld::new(pose(4.0)).unwrap());
        let pixel = projection.project_point(&Point3::origin()).unwrap();
        assert!((pixel - Vector2::new(320.0, 240.0)).norm() < 1e-12);
        assert!((projection.depth(&Point3::origin()) - 4.0).abs() < 1e-12);
        assert!((projection.center_in_world().unwrap() - Point3::new(0.0, 0.0, -4.0)).norm() < 1e-12);
        assert!(projection.project_point(&Point3::new(0.0, 0.0, -5.0)).is_none());
        assert!((projection.focal_length() - (500.0f64 * 510.0).sqrt()).abs() < 1e-9);
        let ray = projection.ray_in_world(&Vector2::new(320.0, 240.0)).unwrap();
        assert!((ray - Vector3::z()).norm() < 1e-12);
    }

    #[test]
    fn a_moved_camera_sees_what_moved_with_it_where_it_was() {
        let intrinsics = Intrinsics::new(500.0, 510.0, 320.0, 240.0).unwrap();
        let projection = Projection::from_camera(&intrinsics, &CamFromWorld::new(pose(4.0)).unwrap());
        let (turn, shift) = (Rotation3::new(Vector3::new(0.1, -0.2, 0.3)), Vector3::new(1.0, 2.0, 3.0));
        let moved = projection.with_moved_camera(&turn, &shift).unwrap();
        let center = projection.center_in_world().unwrap();
        assert!((moved.center_in_world().unwrap() - center - shift).norm() < 1e-12);
        let point = Point3::new(0.3, -0.4, 1.0);
        let moved_point = center + turn * (point - center) + shift;
        let (before, after) = (projection.project_point(&point).unwrap(), moved.project_point(&moved_point).unwrap());
        assert!((before - after).norm() < 1e-9);
    }

    #[test]
    fn the_pose_is_found_in_the_projection() {
        let rotation = Rotation3::new(Vector3::new(0.5, -1.2, 2.0));
        let mut matrix = pose(4.0);
        matrix.fixed_columns_mut::<3>(0).copy_from(rotation.matrix());
        let intrinsics = Intrinsics::new(500.0, 510.0, 320.0, 240.0).unwrap();
        let projection = Projection::from_camera(&intrinsics, &CamFromWorld::new(matrix).unwrap());
        assert!((projection.camera_pose().unwrap().matrix() - matrix).norm() < 1e-12);
        let found = projection.intrinsics().unwrap().matrix();
        assert!((found - Intrinsics::new(500.0, 510.0, 320.0, 240.0).unwrap().matrix()).norm() < 1e-9, "{found}");
        let scaled = Projection::from_matrix(projection.matrix() * -0.01).unwrap();
        assert!((scaled.camera_pose().unwrap().matrix() - matrix).norm() < 1e-12);
    }

    #[test]
    fn the_sign_of_a_bare_projection_does_not_matter() {
        let matrix = Intrinsics::new(500.0, 500.0, 0.0, 0.0).unwrap().matrix() * pose(3.0);
        let a = Projection::from_matrix(matrix).unwrap();
        let b = Projection::from_matrix(-matrix).unwrap();
        assert_eq!(a, b);
    }

    #[test]
    fn depths_are_lengths_whatever_the_scale_of_the_projection() {
        let intrinsics = Intrinsics::new(500.0, 510.0, 320.0, 240.0).unwrap();
        let projection = Projection::from_camera(&intrinsics, &CamFromWorld::new(pose(4.0)).unwrap());
        for scale in [0.01, 100.0, -3.0] {
            let scaled = Projection::from_matrix(projection.matrix() * scale).unwrap();
            for z in [0.0, 2.5, -9.0] {
                let depth = scaled.depth(&Point3::new(0.3, -0.2, z));
                assert!((depth - (z + 4.0)).abs() < 1e-12, "scale {scale}: {depth} at {z}");
            }
        }
    }

    #[test]
    fn bad_cameras_are_refused() {
        assert!(matches!(Intrinsics::new(0.0, 1.0, 0.0, 0.0), Err(CameraError::SingularIntrinsics { .. })));
        assert!(matches!(Intrinsics::new(f64::NAN, 1.0, 0.0, 0.0), Err(CameraError::NotFinite { .. })));
        let mut stretched = pose(1.0);
        stretched[(0, 0)] = 1.01;
        assert!(matches!(CamFromWorld::new(stretched), Err(CameraError::NotARotation { .. })));
        let mut nearly = pose(1.0);
        nearly[(0, 0)] = 1.0 + 4e-4;
        assert!(CamFromWorld::new(nearly).is_ok());
        assert!(matches!(Projection::from_matrix(Matrix3x4::zeros()), Err(CameraError::SingularProjection { .. })));
    }
}
