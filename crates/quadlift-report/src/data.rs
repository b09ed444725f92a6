//! The data of a report, as the JSON document in its page. Mirrored by `viewer/src/data.ts`.
//!
//! Lengths are world units. Pixels are those of the frames' pinhole cameras: lens distortion has been taken out.

use nalgebra::Point3;
use quadlift::geometry::{Body, BodyKind, quaternion_from_rotation, rotation_from_quaternion};
use serde::Serialize;

/// A report.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct Report {
    /// Title of the page.
    pub title: String,
    /// Name and version of the program.
    pub program: String,
    /// World unit, if known.
    pub length_unit: Option<String>,
    /// World direction against gravity, if known.
    pub up: Option<[f64; 3]>,
    /// Categories; [`ReportObject::category`] points here.
    pub categories: Vec<String>,
    /// The posed images.
    pub frames: Vec<ReportFrame>,
    /// Points of the scene's surfaces in the world, x, y, z of each, rounded to be drawn.
    pub points: Vec<f64>,
    /// The objects: estimates, then what only the truth or the detections have.
    pub objects: Vec<ReportObject>,
    /// Scores against the truth.
    pub scores: Option<ReportScores>,
    /// Settings and counts of the run: name and value.
    pub settings: Vec<(String, String)>,
    /// Overview of the scene (consistency check, noise, association): name and value, as text.
    pub overview: Vec<(String, String)>,
    /// Notes about the report or the run, in sentences.
    pub notes: Vec<String>,
    /// A problem of the whole scene, shown at the top: it is inconsistent.
    pub banner: Option<String>,
    /// The meaning of the drawn regions of the centers, in a sentence; absent if no object has one.
    pub region: Option<String>,
}

/// A posed image.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ReportFrame {
    /// Id of the frame.
    pub id: String,
    /// World to pixels, 3x4 by rows, from the refined pose if it was refined.
    pub projection: Vec<f64>,
    /// The pose as given, if it was refined.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub given: Option<GivenPose>,
    /// Width and height in pixels.
    pub size: [f64; 2],
    /// The image as a data URL.
    pub image: Option<String>,
    /// The detections.
    pub detections: ReportDetections,
}

/// The pose of a frame before its refinement with the objects.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct GivenPose {
    /// World to pixels, 3x4 by rows.
    pub projection: Vec<f64>,
    /// Distance between the given and the refined center of the camera.
    pub shift: f64,
    /// Angle between the given and the refined axes of the camera in radians.
    pub angle: f64,
}

/// The detections of a frame by columns, because there may be hundreds of thousands in a report.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ReportDetections {
    /// Index into [`quadlift::scene::SceneParts::detections`]; `None` if only the estimate refers to the view. Not in
    /// the page.
    #[serde(skip)]
    pub detection_index: Vec<Option<usize>>,
    /// Index into [`Report::objects`], -1 if the object is unknown.
    pub object: Vec<i64>,
    /// 0: not used or not known, 1: used, 2: rejected as an outlier.
    pub state: Vec<u8>,
    /// Residuals in pixels.
    pub residual: Vec<Option<f64>>,
    /// Of those that are rejected and say why: row, and name of the reason (see [`quadlift::solve::Rejection::name`]).
    pub rejections: Vec<(usize, String)>,
    /// x0, y0, x1, y1 of each; four times nothing where there is no box.
    #[serde(rename = "box")]
    pub boxes: Vec<Option<f64>>,
    /// Of those that have an ellipse: row, center x and y, semi-axes, angle in radians.
    pub ellipses: Vec<(usize, f64, f64, f64, f64, f64)>,
    /// Of those that have a mask.
    pub masks: Vec<MaskRows>,
    /// Of those that have a depth: row, depth, and its ratio to that of the estimated body's visible surface.
    pub depths: Vec<(usize, f64, Option<f64>)>,
    /// Of those that have a whole 3D box: row, and the box.
    #[serde(rename = "boxes3d")]
    pub boxes3d: Vec<(usize, ReportBody)>,
}

/// A mask: row of its detection, height of its strips in pixels, and y (upper edge), x0, x1 of each run of pixels in them.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct MaskRows(pub usize, pub u32, pub Vec<u32>);

/// An object.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ReportObject {
    /// Id.
    pub id: String,
    /// Id of the true object that the estimate is paired with, if it differs.
    pub true_id: Option<String>,
    /// Index into [`Report::categories`], -1 without one.
    pub category: i64,
    /// Status of the estimate (see [`quadlift::solve::Status::name`]); absent without an estimate.
    pub status: Option<String>,
    /// Estimated center in the world.
    pub center: Option<[f64; 3]>,
    /// Standard deviation of the center per coordinate.
    pub center_sd: Option<f64>,
    /// Standard deviations of the half extents of the body, in their order.
    pub half_extents_sd: Option<[f64; 3]>,
    /// Standard deviations of its rotation in degrees: about the vertical, and away from it.
    pub rotation_sd_deg: Option<[f64; 2]>,
    /// The region of 95 % of the center, see [`Report::region`].
    pub center_shell: Option<ReportBody>,
    /// The estimated body.
    pub body: Option<ReportBody>,
    /// The box around the object.
    pub bounds: Option<ReportBody>,
    /// Standard deviations of its half extents, in their order.
    pub bounds_sd: Option<[f64; 3]>,
    /// The enclosing ellipsoid.
    pub enclosing: Option<ReportBody>,
    /// The true body.
    pub truth: Option<ReportBody>,
    /// Other bodies that fit the views about as well, the most probable first.
    pub alternatives: Vec<ReportAlternative>,
    /// Number of views that were used.
    pub views_used: usize,
    /// Number of views that were rejected.
    pub views_rejected: usize,
    /// Root mean square residual of the used views in pixels.
    pub residual: Option<f64>,
    /// The same per degree of freedom, relative to the half size of the boxes.
    pub relative_residual: Option<f64>,
    /// The same in standard deviations of the scene's noise.
    pub normalized_residual: Option<f64>,
    /// Mean IoU of the boxes that its other views predict for each of its views, and the measured ones.
    pub predicted_iou: Option<f64>,
    /// Id of the frame whose detection the other views contradict.
    pub suspect_view: Option<String>,
    /// Warnings, as text.
    pub warnings: Vec<String>,
}

/// Another body that fits an object's views about as well as the estimated one.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ReportAlternative {
    /// The body.
    pub body: ReportBody,
    /// Natural logarithm of its odds against the estimated body.
    pub log_odds: f64,
}

/// A body of any kind.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReportBody {
    /// `ellipsoid`, `cuboid`, `cylinder` or `superellipsoid`.
    pub kind: &'static str,
    /// Center in the world.
    pub center: [f64; 3],
    /// Semi-axes, half extents, or the two radii and half the height.
    pub half: [f64; 3],
    /// Unit quaternion, w first.
    pub rotation: [f64; 4],
    /// Exponent of the support function, in [1, 2]; 1 for a cylinder, where it has no meaning.
    pub exponent: f64,
}

/// Scores of the objects against the truth.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
#[serde(rename_all = "camelCase")]
pub struct ReportScores {
    /// What is scored.
    pub columns: Vec<ScoreColumn>,
    /// One row for each true object.
    pub rows: Vec<ScoreRow>,
    /// Means over the objects.
    pub mean: Vec<Option<f64>>,
    /// How many objects failed, in a sentence.
    pub failures: String,
}

/// A score.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScoreColumn {
    /// Heading.
    pub title: String,
    /// `share`, `percent` (a share too, shown as percent), `degrees` (given in radians) or `length`.
    pub unit: &'static str,
}

/// The scores of one object.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ScoreRow {
    /// Index into [`Report::objects`].
    pub object: usize,
    /// Status of the estimate; absent when there is none.
    pub status: Option<String>,
    /// One value for each column.
    pub values: Vec<Option<f64>>,
}

impl ReportBody {
    /// The body as a library type; `None` if the rotation is invalid.
    pub fn body(&self) -> Option<Body> {
        let (center, half_extents) = (Point3::from(self.center), self.half.into());
        let rotation = rotation_from_quaternion(self.rotation)?;
        let kind = BodyKind::named(self.kind, self.exponent)?;
        // Of a rounded body the page has the exponent that is about as round.
        let kind = if let BodyKind::Rounded(exponent) = kind { BodyKind::Rounded(exponent - 1.0) } else { kind };
        Some(Body { center, rotation, half_extents, kind })
    }
}

impl From<&Body> for ReportBody {
    fn from(body: &Body) -> Self {
        // The page draws the ends of the superellipsoids exactly, by their own shapes.
        let kind = body.kind.simplest();
        Self {
            kind: kind.name(),
            center: body.center.coords.into(),
            half: body.half_extents.into(),
            rotation: quaternion_from_rotation(&body.rotation),
            exponent: kind.exponent(),
        }
    }
}
