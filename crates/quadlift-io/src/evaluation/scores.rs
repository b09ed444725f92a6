//! The scores: names, titles, and as JSON.

use quadlift::metrics::{Evaluation, Mean, MeanScore, ObjectDetectionScore, ObjectScore, PairedBy};
use serde_json::{Map, Value, json};

use super::MIN_IOU;
use crate::wording::count;

/// A score: its name in JSON, its title in the table, and its accessors.
#[derive(Debug)]
pub struct Column {
    /// Its name in JSON.
    pub name: &'static str,
    /// Its title in tables.
    pub title: &'static str,
    /// How it is shown.
    pub unit: Unit,
    /// That of an object.
    pub of: fn(&ObjectScore) -> Option<f64>,
    /// Its mean over the objects.
    pub mean: fn(&MeanScore) -> Option<Mean>,
}

/// How a score is shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// From 0 to 1.
    Share,
    /// A share, as percents.
    Percent,
    /// Radians, as degrees.
    Degrees,
    /// World units.
    Length,
}

/// The scores, in the order in which they are shown.
pub const COLUMNS: [Column; 8] = [
    Column { name: "iou3d", title: "IoU", unit: Unit::Share, of: |o| o.iou3d, mean: |m| m.iou3d },
    Column {
        name: "iou3d_enclosing",
        title: "enclosing IoU",
        unit: Unit::Share,
        of: |o| o.iou3d_enclosing,
        mean: |m| m.iou3d_enclosing,
    },
    Column {
        name: "cuboid_iou3d",
        title: "cuboid IoU",
        unit: Unit::Share,
        of: |o| o.cuboid_iou3d,
        mean: |m| m.cuboid_iou3d,
    },
    Column {
        name: "axis_error",
        title: "axis [deg]",
        unit: Unit::Degrees,
        of: |o| o.axis_error,
        mean: |m| m.axis_error,
    },
    Column {
        name: "center_error",
        title: "center",
        unit: Unit::Length,
        of: |o| o.center_error,
        mean: |m| m.center_error,
    },
    Column { name: "size_error", title: "size [%]", unit: Unit::Percent, of: |o| o.size_error, mean: |m| m.size_error },
    Column {
        name: "ellipse_reprojection_iou",
        title: "outline IoU",
        unit: Unit::Share,
        of: |o| o.reprojection.map(|r| r.ellipse_iou),
        mean: |m| m.ellipse_reprojection_iou,
    },
    Column {
        name: "box_reprojection_iou",
        title: "box IoU",
        unit: Unit::Share,
        of: |o| o.reprojection.map(|r| r.box_iou),
        mean: |m| m.box_reprojection_iou,
    },
];

/// The scores for programs: angles in radians, lengths in world units, shares from 0 to 1.
pub fn scores_record(evaluation: &Evaluation) -> Value {
    let object = |o: &ObjectScore| {
        let mut scores = Map::new();
        scores.insert("id".to_owned(), json!(o.id));
        scores.insert("estimate".to_owned(), json!(o.estimate));
        scores.insert("status".to_owned(), json!(o.status));
        scores.insert("has_body".to_owned(), json!(o.has_body));
        for column in &COLUMNS {
            scores.insert(column.name.to_owned(), json!((column.of)(o)));
        }
        scores.insert("theta_err".to_owned(), json!(o.theta_err));
        scores.insert("rotation_error".to_owned(), json!(o.rotation_error));
        Value::Object(scores)
    };
    let mean = |mean: Option<Mean>| mean.map(|mean| json!({ "value": mean.value, "objects": mean.count }));
    let mut means: Map<String, Value> =
        COLUMNS.iter().map(|column| (column.name.to_owned(), json!(mean((column.mean)(&evaluation.mean))))).collect();
    means.insert("theta_err".to_owned(), json!(mean(evaluation.mean.theta_err)));
    means.insert("rotation_error".to_owned(), json!(mean(evaluation.mean.rotation_error)));
    json!({
        "objects": evaluation.objects.iter().map(object).collect::<Vec<_>>(),
        "mean": means,
        "failures": evaluation.failures,
        "failure_share": evaluation.failure_share(),
        "unmatched": evaluation.unmatched,
        "matched_by": match evaluation.paired_by {
            PairedBy::Ids => "ids",
            PairedBy::Overlap => "overlap",
        },
    })
}

/// The number of objects without a body, as text.
pub fn failures_in_words(evaluation: &Evaluation) -> String {
    format!(
        "failures: {} of {} without a body ({:.0} %)",
        evaluation.failures,
        count(evaluation.objects.len(), "object"),
        100.0 * evaluation.failure_share().unwrap_or(0.0)
    )
}

/// How many objects were found, as JSON.
pub fn found_record(found: &ObjectDetectionScore) -> Value {
    json!({
        "least_iou3d": MIN_IOU,
        "true_objects": found.true_objects,
        "estimates": found.found,
        "matched": found.matched,
        "precision": found.precision(),
        "recall": found.recall(),
        "mean_iou3d": found.mean_iou3d,
    })
}
