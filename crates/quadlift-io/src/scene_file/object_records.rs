//! Objects as they are written in a scene file: bodies, and what an estimator reports about them.

use nalgebra::{Point3, Vector3};
use quadlift::geometry::{Body, BodyKind, quaternion_from_rotation, rotation_from_quaternion};
use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};

use crate::error::EntryError;
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
    /// The body of an estimate.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<Box<BodyRecord>>,
    /// Standard deviations of its half extents, world units.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_list")]
    pub half_extents_sd: Option<[f64; 3]>,
    /// Standard deviations of its rotation, degrees: about the vertical, and away from it (see [`quadlift::solve::Estimate::rotation_sd`]).
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_list")]
    pub rotation_sd_deg: Option<[f64; 2]>,
    /// The box around the real object, with the extents that its measurements show.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub bounds: Option<Box<BoundsRecord>>,
    /// The ellipsoid that should contain the real object, where it was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub enclosing: Option<Box<BodyRecord>>,
    /// The ellipsoid of a true object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ellipsoid: Option<EllipsoidRecord>,
    /// The cuboid of a true object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cuboid: Option<Box<CuboidRecord>>,
    /// The cylinder of a true object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cylinder: Option<Box<CylinderRecord>>,
    /// The superellipsoid of a true object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub superellipsoid: Option<Box<SuperellipsoidRecord>>,
    /// The rounded body of a true object.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rounded: Option<Box<BodyRecord>>,
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
    pub goodness_of_fit: Option<GoodnessOfFitRecord>,
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

/// A body of any kind.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct BodyRecord {
    /// `ellipsoid`, `cuboid`, `cylinder`, `rounded` or `superellipsoid` ([`BodyKind::name`]).
    pub kind: String,
    /// Center in the world.
    #[serde(deserialize_with = "numbers::list")]
    pub center: [f64; 3],
    /// Unit quaternion `[w, x, y, z]`; the columns of the rotation are the axes, in the order of `half_extents`.
    #[serde(deserialize_with = "numbers::list")]
    pub rotation: [f64; 4],
    /// Half the extents along its axes, world units: the semi-axes of an ellipsoid; the radii and half the height of a cylinder, whose axis
    /// is the third.
    #[serde(deserialize_with = "numbers::list")]
    pub half_extents: [f64; 3],
    /// Exponent of the support function of a superellipsoid, in [1, 2] (1 cuboid, 2 ellipsoid).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub support_exponent: Option<f64>,
    /// Roundness of a rounded body, in [0, 1] (0 cuboid, 1 ellipsoid).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub roundness: Option<f64>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// The box around an object (see [`quadlift::solve::Bounds`]).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct BoundsRecord {
    /// Center in the world.
    #[serde(deserialize_with = "numbers::list")]
    pub center: [f64; 3],
    /// Unit quaternion `[w, x, y, z]`; the columns of the rotation are the axes, in the order of `half_extents`.
    #[serde(deserialize_with = "numbers::list")]
    pub rotation: [f64; 4],
    /// Half the extents along its axes, world units.
    #[serde(deserialize_with = "numbers::list")]
    pub half_extents: [f64; 3],
    /// Their standard deviations, world units.
    #[serde(default, skip_serializing_if = "Option::is_none", deserialize_with = "numbers::optional_list")]
    pub half_extents_sd: Option<[f64; 3]>,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// Another body that agrees with an object's measurements (see [`quadlift::solve::Alternative`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct AlternativeRecord {
    /// The body; in files of older versions it has another form, which is not read.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub body: Option<BodyRecord>,
    /// Natural logarithm of its odds against the reported body.
    pub log_odds: f64,
    /// Unknown fields.
    #[serde(flatten)]
    pub extra: Map<String, Value>,
}

/// Residual statistics of an object (see [`quadlift::solve::GoodnessOfFit`]).
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct GoodnessOfFitRecord {
    /// In standard deviations of the scene's noise: about 1 for objects with typical noise.
    pub normalized_residual: f64,
    /// Relative to the half size of the boxes.
    pub relative_residual: f64,
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
    /// [`quadlift::solve::ViewReport::normalized_residual`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normalized_residual: Option<f64>,
    /// Whether the view was used; otherwise it was rejected as an outlier.
    pub inlier: bool,
    /// Why it was rejected: a name of [`quadlift::solve::Rejection`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rejection_reason: Option<String>,
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
    pub suspect_view: Option<String>,
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

/// The record of a kind of body.
pub(crate) trait KindRecord {
    /// The body, checked; `place` is that of the record in its file.
    ///
    /// # Errors
    /// [`EntryError`] names the first number that makes no body.
    fn to_body(&self, place: &str) -> Result<Body, EntryError>;

    /// Center, rotation and lengths.
    fn parts_mut(&mut self) -> (&mut [f64; 3], &mut [f64; 4], Vec<&mut f64>);
}

impl KindRecord for BodyRecord {
    fn to_body(&self, place: &str) -> Result<Body, EntryError> {
        let parameter = self.support_exponent.or(self.roundness).unwrap_or(f64::NAN);
        let kind = BodyKind::named(&self.kind, parameter).ok_or_else(|| {
            let known = BodyKind::ALL.map(BodyKind::name).join(", ");
            let problem = format!("unknown kind of body \"{}\"; expected one of {known}", self.kind);
            EntryError::new(format!("{place}.kind"), problem)
        })?;
        checked_parameter(kind, place)?;
        let half_extents = positive(&self.half_extents, place, "half_extents");
        checked(kind, &self.center, half_extents, &self.rotation, place)
    }

    fn parts_mut(&mut self) -> (&mut [f64; 3], &mut [f64; 4], Vec<&mut f64>) {
        (&mut self.center, &mut self.rotation, self.half_extents.iter_mut().collect())
    }
}

impl KindRecord for BoundsRecord {
    fn to_body(&self, place: &str) -> Result<Body, EntryError> {
        let half_extents = positive(&self.half_extents, place, "half_extents");
        checked(BodyKind::Cuboid, &self.center, half_extents, &self.rotation, place)
    }

    fn parts_mut(&mut self) -> (&mut [f64; 3], &mut [f64; 4], Vec<&mut f64>) {
        let lengths = self.half_extents.iter_mut().chain(self.half_extents_sd.iter_mut().flatten()).collect();
        (&mut self.center, &mut self.rotation, lengths)
    }
}

impl KindRecord for EllipsoidRecord {
    fn to_body(&self, place: &str) -> Result<Body, EntryError> {
        let semi_axes = positive(&self.semi_axes, place, "semi_axes");
        checked(BodyKind::Ellipsoid, &self.center, semi_axes, &self.rotation, place)
    }

    fn parts_mut(&mut self) -> (&mut [f64; 3], &mut [f64; 4], Vec<&mut f64>) {
        (&mut self.center, &mut self.rotation, self.semi_axes.iter_mut().collect())
    }
}

impl KindRecord for CuboidRecord {
    fn to_body(&self, place: &str) -> Result<Body, EntryError> {
        let half_extents = positive(&self.half_extents, place, "half_extents");
        checked(BodyKind::Cuboid, &self.center, half_extents, &self.rotation, place)
    }

    fn parts_mut(&mut self) -> (&mut [f64; 3], &mut [f64; 4], Vec<&mut f64>) {
        (&mut self.center, &mut self.rotation, self.half_extents.iter_mut().collect())
    }
}

impl KindRecord for CylinderRecord {
    fn to_body(&self, place: &str) -> Result<Body, EntryError> {
        let ([x, y], z) = (self.radii, self.half_height);
        if !is_positive(x) || !is_positive(y) {
            let problem = format!("expected two positive numbers, found {:?}", self.radii);
            return Err(EntryError::new(format!("{place}.radii"), problem));
        }
        if !is_positive(z) {
            let problem = format!("expected a positive number, found {z:?}");
            return Err(EntryError::new(format!("{place}.half_height"), problem));
        }
        checked(BodyKind::Cylinder, &self.center, Ok(Vector3::new(x, y, z)), &self.rotation, place)
    }

    fn parts_mut(&mut self) -> (&mut [f64; 3], &mut [f64; 4], Vec<&mut f64>) {
        let lengths = self.radii.iter_mut().chain([&mut self.half_height]).collect();
        (&mut self.center, &mut self.rotation, lengths)
    }
}

impl KindRecord for SuperellipsoidRecord {
    fn to_body(&self, place: &str) -> Result<Body, EntryError> {
        let kind = BodyKind::Superellipsoid(self.support_exponent);
        checked_parameter(kind, place)?;
        let semi_axes = positive(&self.semi_axes, place, "semi_axes");
        checked(kind, &self.center, semi_axes, &self.rotation, place)
    }

    fn parts_mut(&mut self) -> (&mut [f64; 3], &mut [f64; 4], Vec<&mut f64>) {
        (&mut self.center, &mut self.rotation, self.semi_axes.iter_mut().collect())
    }
}

fn checked_parameter(kind: BodyKind, place: &str) -> Result<(), EntryError> {
    let (field, range, x) = match kind {
        BodyKind::Superellipsoid(exponent) => ("support_exponent", [1.0, 2.0], exponent),
        BodyKind::Rounded(roundness) => ("roundness", [0.0, 1.0], roundness),
        _ => return Ok(()),
    };
    if range[0] <= x && x <= range[1] {
        return Ok(());
    }
    let problem = format!("{x} is not a number from {} (cuboid) to {} (ellipsoid)", range[0], range[1]);
    Err(EntryError::new(format!("{place}.{field}"), problem))
}

fn checked(
    kind: BodyKind,
    center: &[f64; 3],
    half_extents: Result<Vector3<f64>, EntryError>,
    rotation: &[f64; 4],
    place: &str,
) -> Result<Body, EntryError> {
    let unit_rotation = || {
        let problem = format!("expected a unit quaternion [w, x, y, z], found {rotation:?}");
        rotation_from_quaternion(*rotation).ok_or_else(|| EntryError::new(format!("{place}.rotation"), problem))
    };
    let center = finite_point(center, format!("{place}.center"))?;
    Ok(Body { center, half_extents: half_extents?, rotation: unit_rotation()?, kind })
}

pub(super) fn finite_point(point: &[f64; 3], place: String) -> Result<Point3<f64>, EntryError> {
    if point.iter().all(|x| x.is_finite()) {
        return Ok(Point3::from(*point));
    }
    Err(EntryError::new(place, "the point holds a number that is not finite"))
}

fn is_positive(x: f64) -> bool {
    x > 0.0 && x.is_finite()
}

fn positive(lengths: &[f64; 3], place: &str, field: &str) -> Result<Vector3<f64>, EntryError> {
    if lengths.iter().all(|x| is_positive(*x)) {
        return Ok(Vector3::from(*lengths));
    }
    Err(EntryError::new(format!("{place}.{field}"), format!("expected three positive numbers, found {lengths:?}")))
}

impl From<&Body> for BodyRecord {
    fn from(body: &Body) -> Self {
        let is_rounded = matches!(body.kind, BodyKind::Rounded(_));
        Self {
            kind: body.kind.name().to_owned(),
            center: body.center.coords.into(),
            rotation: quaternion_from_rotation(&body.rotation),
            half_extents: body.half_extents.into(),
            support_exponent: body.kind.parameter().filter(|_| !is_rounded),
            roundness: body.kind.parameter().filter(|_| is_rounded),
            extra: Map::new(),
        }
    }
}

impl ObjectRecord {
    /// The bodies of a true object, the ellipsoid first, with their names.
    pub(crate) fn true_bodies(&self) -> [(&'static str, Option<&dyn KindRecord>); 5] {
        fn of<R: KindRecord>(record: Option<&R>) -> Option<&dyn KindRecord> {
            record.map(|record| record as _)
        }
        [
            ("ellipsoid", of(self.ellipsoid.as_ref())),
            ("cuboid", of(self.cuboid.as_deref())),
            ("cylinder", of(self.cylinder.as_deref())),
            ("superellipsoid", of(self.superellipsoid.as_deref())),
            ("rounded", of(self.rounded.as_deref())),
        ]
    }

    /// All bodies, and the box around the object.
    pub(crate) fn bodies_mut(&mut self) -> Vec<&mut dyn KindRecord> {
        let mut all: Vec<&mut dyn KindRecord> = Vec::new();
        all.extend(self.body.iter_mut().chain(&mut self.enclosing).map(|record| &mut **record as _));
        all.extend(self.bounds.iter_mut().map(|record| &mut **record as _));
        all.extend(self.ellipsoid.iter_mut().map(|record| record as _));
        all.extend(self.cuboid.iter_mut().map(|record| &mut **record as _));
        all.extend(self.cylinder.iter_mut().map(|record| &mut **record as _));
        all.extend(self.superellipsoid.iter_mut().map(|record| &mut **record as _));
        all.extend(self.rounded.iter_mut().map(|record| &mut **record as _));
        all.extend(self.alternatives.iter_mut().filter_map(|other| other.body.as_mut().map(|record| record as _)));
        all
    }

    /// Sets the body of a true object under the name of its kind, and its closest ellipsoid.
    pub(crate) fn set_true_body(&mut self, body: &Body) {
        let (center, half_extents) = (body.center.coords.into(), body.half_extents.into());
        let (rotation, extra) = (quaternion_from_rotation(&body.rotation), Map::new());
        let semi_axes = body.closest_ellipsoid().semi_axes.into();
        self.ellipsoid = Some(EllipsoidRecord { center, semi_axes, rotation, extra: extra.clone() });
        match body.kind {
            BodyKind::Ellipsoid => {}
            BodyKind::Cuboid => self.cuboid = Some(Box::new(CuboidRecord { center, half_extents, rotation, extra })),
            BodyKind::Cylinder => {
                let [x, y, half_height] = half_extents;
                let record = CylinderRecord { center, radii: [x, y], half_height, rotation, extra };
                self.cylinder = Some(Box::new(record));
            }
            BodyKind::Superellipsoid(support_exponent) => {
                let semi_axes = half_extents;
                let record = SuperellipsoidRecord { center, semi_axes, rotation, support_exponent, extra };
                self.superellipsoid = Some(Box::new(record));
            }
            BodyKind::Rounded(_) => self.rounded = Some(Box::new(BodyRecord::from(body))),
        }
    }
}
