//! A camera with a lens: points between the image as it is and the pixels of its pinhole camera.

use nalgebra::{Point3, Vector2};

use super::distortion::{distort, fold_radius, undistort};
use crate::geometry::camera::{CameraError, Intrinsics};
use crate::geometry::camera_model::{CameraModel, MAX_PARAMETERS};

/// Rays farther than this from the optical axis are not undistorted, in degrees: in the plane of a pinhole camera they
/// lie almost six focal lengths out and a pixel of the lens covers more than thirty.
const WIDEST_ANGLE_DEG: f64 = 80.0;

/// A camera of one of COLMAP's models.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "serde", serde(try_from = "(CameraModel, Vec<f64>)", into = "(CameraModel, Vec<f64>)"))]
pub struct Camera {
    model: CameraModel,
    params: [f64; MAX_PARAMETERS],
    pinhole: Intrinsics,
    /// How far from the axis the model can be inverted, in the plane that its polynomial bends.
    pub(super) reach: f64,
}

impl TryFrom<(CameraModel, Vec<f64>)> for Camera {
    type Error = CameraError;

    fn try_from((model, params): (CameraModel, Vec<f64>)) -> Result<Self, CameraError> {
        Self::new(model, &params)
    }
}

impl From<Camera> for (CameraModel, Vec<f64>) {
    fn from(camera: Camera) -> Self {
        (camera.model, camera.params().to_vec())
    }
}

impl Camera {
    /// A checked camera; `params` are in COLMAP's order, see [`CameraModel::parameter_names`].
    ///
    /// # Errors
    /// [`CameraError`]: a wrong number of parameters, numbers that are not finite, focal lengths that are not positive,
    /// coefficients out of their range.
    pub fn new(model: CameraModel, params: &[f64]) -> Result<Self, CameraError> {
        let names = model.parameter_names();
        if params.len() != names.len() {
            return Err(CameraError::ParameterCount { model, found: params.len() });
        }
        if !params.iter().all(|x| x.is_finite()) {
            return Err(CameraError::NotFinite { what: "the intrinsics" });
        }
        let pinhole = match (model, params) {
            // The pinhole camera of the same resolution in the middle of the panorama.
            (CameraModel::Equirectangular, &[w, h]) => {
                Intrinsics::new(w / std::f64::consts::TAU, h / std::f64::consts::PI, 0.5 * w, 0.5 * h)?
            }
            (_, &[f, cx, cy, ..]) if model.has_one_focal_length() => Intrinsics::new(f, f, cx, cy)?,
            (_, &[fx, fy, cx, cy, ..]) => Intrinsics::new(fx, fy, cx, cy)?,
            _ => return Err(CameraError::ParameterCount { model, found: params.len() }),
        };
        let mut all = [0.0; MAX_PARAMETERS];
        all[..params.len()].copy_from_slice(params);
        let mut camera = Self { model, params: all, pinhole, reach: f64::INFINITY };
        camera.check_coefficients()?;
        let widest = WIDEST_ANGLE_DEG.to_radians();
        let farthest = if model.is_fisheye() { widest } else { widest.tan() };
        camera.reach = fold_radius(model, camera.coefficients(), farthest);
        Ok(camera)
    }

    fn check_coefficients(&self) -> Result<(), CameraError> {
        let (fine, range) = match (self.model, self.coefficients()) {
            (CameraModel::Eucm, &[alpha, beta]) => {
                ((0.0..=1.0).contains(&alpha) && beta > 0.0, "alpha from 0 to 1 and beta above 0")
            }
            (CameraModel::Fov, &[omega]) => (omega.abs() < std::f64::consts::PI, "omega between -pi and pi"),
            _ => (true, ""),
        };
        if fine { Ok(()) } else { Err(CameraError::Coefficients { model: self.model, range }) }
    }

    /// The model.
    pub fn model(&self) -> CameraModel {
        self.model
    }

    /// The parameters in COLMAP's order.
    pub(crate) fn params(&self) -> &[f64] {
        &self.params[..self.model.parameter_names().len()]
    }

    /// The parameters after focal lengths and principal point.
    pub(super) fn coefficients(&self) -> &[f64] {
        let first = match self.model {
            CameraModel::Equirectangular => 2,
            model if model.has_one_focal_length() => 3,
            _ => 4,
        };
        &self.params()[first..]
    }

    /// The pinhole camera in whose pixels the undistorted measurements are: the same focal lengths and principal point.
    /// For a panorama, a camera that looks at its middle with the same resolution there.
    pub fn pinhole(&self) -> Intrinsics {
        self.pinhole
    }

    /// Whether the camera is a pinhole camera already, so that nothing is to be undistorted.
    pub(crate) fn is_pinhole(&self) -> bool {
        matches!(self.model, CameraModel::SimplePinhole | CameraModel::Pinhole)
    }

    /// The pixel of a point in camera coordinates; `None` when it is not in front of the camera, or when the lens does
    /// not show it.
    pub fn project_point(&self, point_in_camera: &Point3<f64>) -> Option<Vector2<f64>> {
        let p = point_in_camera;
        if p.z.is_nan() || p.z <= 0.0 {
            return None;
        }
        self.distort_ideal(&Vector2::new(p.x / p.z, p.y / p.z))
    }

    /// The pixel in the image of a pixel of the pinhole camera; the inverse of [`Camera::undistort_point`].
    pub fn distort_point(&self, pinhole_pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        self.distort_ideal(&self.to_plane(pinhole_pixel))
    }

    /// The pixel of the pinhole camera (see [`Camera::pinhole`]) that sees what this pixel of the image sees.
    ///
    /// `None` when the ray is more than `WIDEST_ANGLE_DEG` from the axis, or when the model maps no ray there: beyond
    /// the radius at which a polynomial turns back, an inverse would be a wrong one.
    pub fn undistort_point(&self, pixel: &Vector2<f64>) -> Option<Vector2<f64>> {
        if self.is_pinhole() {
            return Some(*pixel);
        }
        let q = undistort(self.model, self.coefficients(), self.reach, &self.to_plane(pixel))?;
        (q.norm() <= WIDEST_ANGLE_DEG.to_radians().tan()).then(|| self.to_pixel(&q))
    }

    fn distort_ideal(&self, q: &Vector2<f64>) -> Option<Vector2<f64>> {
        distort(self.model, self.coefficients(), q).map(|p| self.to_pixel(&p))
    }

    fn to_plane(self, pixel: &Vector2<f64>) -> Vector2<f64> {
        let k = &self.pinhole;
        Vector2::new((pixel.x - k.cx) / k.fx, (pixel.y - k.cy) / k.fy)
    }

    pub(super) fn to_pixel(self, p: &Vector2<f64>) -> Vector2<f64> {
        let k = &self.pinhole;
        Vector2::new(k.fx * p.x + k.cx, k.fy * p.y + k.cy)
    }
}
