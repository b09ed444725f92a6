//! Objects as they are written in a scene file: bodies, and what an estimator reports about them.

use nalgebra::Point3;
use quadlift::geometry::{Body, Cuboid, Cylinder, Ellipsoid, Superellipsoid, quaternion_from_rotation};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::numbers;

/// An object: a true one, or an estimate with its figures.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ObjectRecord {
    /// Id, which detections name in `object`.
    pub id: String,
    /// Category.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub category: Option<String>,
    /// Status of the estimate (see [`quadlift::solve::Status::name`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub status: Option<String>,
    /// Estimated center in the world, whenever there is one, even without a body.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_list")]
    pub center: Option<[f64; 3]>,
    /// Standard deviation of the center per coordinate, world units.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub center_sd: Option<f64>,
    /// The ellipsoid; of an estimate, the one that is tangent to the measurements.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ellipsoid: Option<EllipsoidRecord>,
    /// The enclosing ellipsoid, which should contain the real object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub enclosing_ellipsoid: Option<EllipsoidRecord>,
    /// The cuboid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cuboid: Option<Box<CuboidRecord>>,
    /// The enclosing cuboid, which should contain the real object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub enclosing_cuboid: Option<Box<CuboidRecord>>,
    /// The cylinder.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<Box<CylinderRecord>>,
    /// The enclosing cylinder, which should contain the real object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub enclosing_cylinder: Option<Box<CylinderRecord>>,
    /// The superellipsoid.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub superellipsoid: Option<Box<SuperellipsoidRecord>>,
    /// The enclosing superellipsoid, which should contain the real object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub enclosing_superellipsoid: Option<Box<SuperellipsoidRecord>>,
    /// Number of views that the estimate rests on.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub views_used: Option<usize>,
    /// Ids of the frames that were rejected as outliers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub views_rejected: Vec<String>,
    /// Root mean square residual of the used views in pixels.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residual_px: Option<f64>,
    /// Other bodies that agree with the measurements about as well, the most probable first.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub alternatives: Vec<AlternativeRecord>,
    /// Residual statistics.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub misfit: Option<MisfitRecord>,
    /// The contribution of each view.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub view_residuals_px: Vec<ViewRecord>,
    /// Cross-validation: how well left-out views are predicted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cross_validation: Option<Box<CrossValidationRecord>>,
    /// Warnings, as text.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
    /// Uncertainty.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub covariance: Option<Box<CovarianceRecord>>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// An ellipsoid.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct EllipsoidRecord {
    /// Center in the world.
    #[serde(deserialize_with = "numbers::list")]
    pub center: [f64; 3],
    /// Semi-axes in world units.
    #[serde(deserialize_with = "numbers::list")]
    pub semi_axes: [f64; 3],
    /// Unit quaternion `[w, x, y, z]`; the columns of the rotation are the axes, in the order of `semi_axes`.
    #[serde(deserialize_with = "numbers::list")]
    pub rotation: [f64; 4],
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A cuboid.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CuboidRecord {
    /// Center in the world.
    #[serde(deserialize_with = "numbers::list")]
    pub center: [f64; 3],
    /// Half the extents along its axes, world units.
    #[serde(deserialize_with = "numbers::list")]
    pub half_extents: [f64; 3],
    /// Unit quaternion `[w, x, y, z]`; the columns of the rotation are the axes, in the order of `half_extents`.
    #[serde(deserialize_with = "numbers::list")]
    pub rotation: [f64; 4],
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A cylinder.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CylinderRecord {
    /// Center in the world.
    #[serde(deserialize_with = "numbers::list")]
    pub center: [f64; 3],
    /// Semi-axes of the base in world units.
    #[serde(deserialize_with = "numbers::list")]
    pub radii: [f64; 2],
    /// Half the height in world units.
    pub half_height: f64,
    /// Unit quaternion `[w, x, y, z]`; the first two columns of the rotation are the axes of the base, in the order of
    /// `radii`, the third one is the axis of the cylinder.
    #[serde(deserialize_with = "numbers::list")]
    pub rotation: [f64; 4],
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A superellipsoid.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SuperellipsoidRecord {
    /// Center in the world.
    #[serde(deserialize_with = "numbers::list")]
    pub center: [f64; 3],
    /// Semi-axes in world units.
    #[serde(deserialize_with = "numbers::list")]
    pub semi_axes: [f64; 3],
    /// Unit quaternion `[w, x, y, z]`; the columns of the rotation are the axes, in the order of `semi_axes`.
    #[serde(deserialize_with = "numbers::list")]
    pub rotation: [f64; 4],
    /// Exponent of the support function, in [1, 2] (1 cuboid, 2 ellipsoid).
    pub support_exponent: f64,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// A body of any kind, under the name of its kind.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum BodyRecord {
    /// An ellipsoid.
    Ellipsoid(EllipsoidRecord),
    /// A cuboid.
    Cuboid(CuboidRecord),
    /// A cylinder.
    Cylinder(CylinderRecord),
    /// A superellipsoid.
    Superellipsoid(SuperellipsoidRecord),
}

/// Another body that agrees with an object's measurements (see [`quadlift::solve::Alternative`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AlternativeRecord {
    /// The body that touches the measurements.
    #[serde(flatten)]
    pub body: BodyRecord,
    /// Natural logarithm of its odds against the reported body.
    pub log_odds: f64,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// Residual statistics of an object (see [`quadlift::solve::Misfit`]).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct MisfitRecord {
    /// In standard deviations of the scene's noise: about 1 for objects with typical noise.
    pub deviations: f64,
    /// Relative to the half size of the boxes.
    pub relative: f64,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// What one view contributed to an estimate.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ViewRecord {
    /// Id of the frame.
    pub frame: String,
    /// Root mean square distance between measured and predicted box edges in pixels, if defined.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub residual_px: Option<f64>,
    /// Root mean square residual in standard deviations of the scene's noise (see
    /// [`quadlift::solve::ViewReport::deviations`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub deviations: Option<f64>,
    /// Whether the view was used; otherwise it was rejected as an outlier.
    pub inlier: bool,
    /// Why it was rejected: a name of [`quadlift::solve::Rejection`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rejected_because: Option<String>,
    /// IoU of the measured box and the one predicted from the other views, if the whole scene was cross-validated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub predicted_iou: Option<f64>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// Cross-validation of an object: how well its other views predict each of its views.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CrossValidationRecord {
    /// Mean IoU of predicted and measured boxes.
    pub iou: f64,
    /// Number of views that were predicted.
    pub views: usize,
    /// Median error of the predicted edges relative to the mean half size of the measured box.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub edge_error: Option<f64>,
    /// Id of the frame whose detection the others contradict.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub odd_view: Option<String>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// Covariance of an estimate.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CovarianceRecord {
    /// What the rows and columns mean: `center_vech_shape` or `center_rotation_log_axes` (see
    /// [`quadlift::solve::CovarianceCoordinates`]).
    pub coordinates: String,
    /// The 9x9 matrix by rows.
    #[serde(deserialize_with = "numbers::matrix")]
    pub matrix: [[f64; 9]; 9],
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

fn list(point: &Point3<f64>) -> [f64; 3] {
    point.coords.into()
}

impl From<&Ellipsoid> for EllipsoidRecord {
    fn from(body: &Ellipsoid) -> Self {
        let (semi_axes, rotation) = (body.semi_axes.into(), quaternion_from_rotation(&body.rotation));
        Self { center: list(&body.center), semi_axes, rotation, extra: Map::new() }
    }
}

impl From<&Cuboid> for CuboidRecord {
    fn from(body: &Cuboid) -> Self {
        let (half_extents, rotation) = (body.half_extents.into(), quaternion_from_rotation(&body.rotation));
        Self { center: list(&body.center), half_extents, rotation, extra: Map::new() }
    }
}

impl From<&Cylinder> for CylinderRecord {
    fn from(body: &Cylinder) -> Self {
        let (radii, rotation) = (body.radii.into(), quaternion_from_rotation(&body.rotation));
        Self { center: list(&body.center), radii, half_height: body.half_height, rotation, extra: Map::new() }
    }
}

impl From<&Superellipsoid> for SuperellipsoidRecord {
    fn from(body: &Superellipsoid) -> Self {
        let (semi_axes, rotation) = (body.semi_axes.into(), quaternion_from_rotation(&body.rotation));
        let support_exponent = body.support_exponent;
        Self { center: list(&body.center), semi_axes, rotation, support_exponent, extra: Map::new() }
    }
}

impl From<&Body> for BodyRecord {
    fn from(body: &Body) -> Self {
        match body {
            Body::Ellipsoid(ellipsoid) => Self::Ellipsoid(ellipsoid.into()),
            Body::Cuboid(cuboid) => Self::Cuboid(cuboid.into()),
            Body::Cylinder(cylinder) => Self::Cylinder(cylinder.into()),
            Body::Superellipsoid(superellipsoid) => Self::Superellipsoid(superellipsoid.into()),
        }
    }
}

impl ObjectRecord {
    /// Sets the body of its kind and its equivalent ellipsoid.
    pub fn set_body(&mut self, body: &Body) {
        self.ellipsoid = Some((&body.ellipsoid()).into());
        match body {
            Body::Ellipsoid(_) => {}
            Body::Cuboid(cuboid) => self.cuboid = Some(Box::new(cuboid.into())),
            Body::Cylinder(cylinder) => self.cylinder = Some(Box::new(cylinder.into())),
            Body::Superellipsoid(superellipsoid) => self.superellipsoid = Some(Box::new(superellipsoid.into())),
        }
    }

    /// The same for the enclosing body.
    pub fn set_enclosing_body(&mut self, body: &Body) {
        self.enclosing_ellipsoid = Some((&body.ellipsoid()).into());
        match body {
            Body::Ellipsoid(_) => {}
            Body::Cuboid(cuboid) => self.enclosing_cuboid = Some(Box::new(cuboid.into())),
            Body::Cylinder(cylinder) => self.enclosing_cylinder = Some(Box::new(cylinder.into())),
            Body::Superellipsoid(superellipsoid) => {
                self.enclosing_superellipsoid = Some(Box::new(superellipsoid.into()))
            }
        }
    }
}
