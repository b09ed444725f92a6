//! Scores of estimates against the truth: from scene files to the table and the JSON document.

use std::collections::HashSet;
use std::fmt::Write;
use std::path::Path;

use anyhow::{anyhow, bail};
use quadlift::geometry::{Ellipsoid, Projection};
use quadlift::metrics::{
    EstimatedObject, Evaluation, FoundScore, Mean, MeanScore, ObjectScore, PairedBy, TruthObject, evaluate,
    evaluate_by_overlap, score_found,
};
use quadlift::solve::Status;
use quadlift_io::SceneFile;
use quadlift_io::scene_file::ObjectBodies;
use serde_json::{Map, Value, json};

use crate::output::{BAD, GOOD, HEADING, WARNING, one_line};
use crate::table::{Cell, Table, decimals, number};
use crate::words::{count, some_of, with_unit};

/// A true object is found when the volume IoU with an estimate is at least this.
const LEAST_IOU: f64 = 0.25;

/// How estimates and true objects are paired, as on the command line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Match {
    /// By their ids where any is common, else by overlap.
    #[default]
    Auto,
    /// By their ids.
    Ids,
    /// By the overlap of their bodies.
    Overlap,
}

/// Scores the objects of a result against those of a scene that holds the truth, paired as their ids suggest.
pub fn evaluate_files(estimate: (&Path, &SceneFile), truth: (&Path, &SceneFile)) -> anyhow::Result<Evaluation> {
    Ok(evaluate_objects(estimate, truth, Match::Auto)?.0)
}

/// Scores the objects of a result against those of a scene that holds the truth, and tells how many were found.
///
/// The cameras for the agreement in the images are those of the truth, or of the estimate where the truth has none.
pub fn evaluate_objects(
    estimate: (&Path, &SceneFile),
    truth: (&Path, &SceneFile),
    matching: Match,
) -> anyhow::Result<(Evaluation, FoundScore)> {
    let objects = |(path, file): (&Path, &SceneFile)| file.to_objects().map_err(|error| error.in_file(path));
    let estimated: Vec<EstimatedObject> = objects(estimate)?.into_iter().map(estimated_object).collect();
    let true_objects: Vec<TruthObject> = objects(truth)?.into_iter().map(true_object).collect();
    let (estimate_path, truth_path) = (estimate.0.display(), truth.0.display());
    if true_objects.is_empty() {
        bail!("{truth_path}: the file holds no \"objects\": there is no truth to compare with");
    }
    if estimated.is_empty() {
        bail!("{estimate_path}: the file holds no \"objects\": there is nothing to score");
    }
    if let (Some(a), Some(b)) = (&estimate.1.length_unit, &truth.1.length_unit)
        && a != b
    {
        bail!("the length unit of {estimate_path} is \"{a}\", that of {truth_path} is \"{b}\"");
    }
    let ids: HashSet<&str> = true_objects.iter().map(|object| object.id.as_str()).collect();
    let any_common = estimated.iter().any(|object| ids.contains(object.id.as_str()));
    if matching == Match::Ids && !any_common {
        bail!(
            "no object of {estimate_path} has the id of an object of {truth_path}; there: {} (--match overlap pairs them \
             by their bodies)",
            true_objects.iter().take(5).map(|object| object.id.as_str()).collect::<Vec<_>>().join(", ")
        );
    }
    let (path, cameras) = if truth.1.frames.is_empty() { estimate } else { truth };
    let scene = cameras.to_scene().map_err(|error| anyhow!(error.in_file(path)))?;
    let projections: Vec<Projection> = scene.frames.iter().map(|frame| frame.projection).collect();
    let evaluation = match matching {
        Match::Overlap => evaluate_by_overlap(&estimated, &true_objects, &projections),
        Match::Auto if !any_common => evaluate_by_overlap(&estimated, &true_objects, &projections),
        Match::Auto | Match::Ids => evaluate(&estimated, &true_objects, &projections),
    };
    let found: Vec<Option<Ellipsoid>> = estimated.iter().map(|object| object.ellipsoid).collect();
    let bodies: Vec<Ellipsoid> = true_objects.iter().filter_map(TruthObject::ellipsoid).collect();
    Ok((evaluation, score_found(&found, &bodies, LEAST_IOU)))
}

fn estimated_object(object: ObjectBodies) -> EstimatedObject {
    EstimatedObject {
        id: object.id,
        status: object.status.map(Status::name).unwrap_or_default().to_owned(),
        center: object.center,
        ellipsoid: object.ellipsoid,
        enclosing_ellipsoid: object.enclosing_ellipsoid,
        cuboid: object.cuboid,
        enclosing_cuboid: object.enclosing_cuboid,
    }
}

fn true_object(object: ObjectBodies) -> TruthObject {
    TruthObject { id: object.id, ellipsoid: object.ellipsoid, cuboid: object.cuboid }
}

/// A score: its name in JSON, its title in the table, and where it stands.
struct Column {
    name: &'static str,
    title: &'static str,
    unit: Unit,
    of: fn(&ObjectScore) -> Option<f64>,
    mean: fn(&MeanScore) -> Option<Mean>,
}

/// How a score is shown.
#[derive(PartialEq)]
enum Unit {
    Share,
    Percent,
    Degrees,
    Length,
}

const COLUMNS: [Column; 9] = [
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
        name: "cuboid_iou3d_enclosing",
        title: "encl. cuboid IoU",
        unit: Unit::Share,
        of: |o| o.cuboid_iou3d_enclosing,
        mean: |m| m.cuboid_iou3d_enclosing,
    },
    Column { name: "theta_err", title: "axis [deg]", unit: Unit::Degrees, of: |o| o.theta_err, mean: |m| m.theta_err },
    Column {
        name: "center_error",
        title: "centre",
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

/// The scores for people; columns that no object has are left out.
pub fn render(evaluation: &Evaluation, length_unit: Option<&str>) -> String {
    let columns: Vec<&Column> =
        COLUMNS.iter().filter(|c| evaluation.objects.iter().any(|o| (c.of)(o).is_some())).collect();
    let by_overlap = evaluation.paired_by == PairedBy::Overlap;
    let mut titles = ["<object", "<estimate", "<status"].map(str::to_owned).to_vec();
    titles.extend(columns.iter().map(|column| match column.unit {
        Unit::Length => with_unit(column.title, length_unit),
        _ => column.title.to_owned(),
    }));
    let mut table = Table::new(titles);
    let error = evaluation.mean.center_error.map_or(1.0, |mean| mean.value);
    let show = |column: &Column, value: Option<f64>| match column.unit {
        Unit::Share => number(value, 3),
        Unit::Percent => number(value.map(|x| 100.0 * x), 1),
        Unit::Degrees => number(value.map(f64::to_degrees), 1),
        Unit::Length => number(value, decimals(error, 3)),
    };
    for object in &evaluation.objects {
        let status = match object.status.as_deref() {
            None => Cell::styled("missing", BAD),
            Some(status) if object.has_body => Cell::styled(status, GOOD),
            Some(status) => Cell::styled(status, BAD),
        };
        let scores = columns.iter().map(|column| show(column, (column.of)(object)).into());
        // Where ids pair them it is the same one.
        let estimate = object.estimate.as_deref().filter(|_| by_overlap).unwrap_or_default();
        table.push([object.id.as_str().into(), estimate.into(), status].into_iter().chain(scores).collect());
    }
    let means = columns
        .iter()
        .map(|column| Cell::styled(show(column, (column.mean)(&evaluation.mean).map(|mean| mean.value)), HEADING));
    let mean = [Cell::styled("mean", HEADING), Cell::default(), Cell::default()];
    table.push(mean.into_iter().chain(means).collect());
    let mut text = table.render();
    let _ = writeln!(text, "{}", failures(evaluation));
    if !evaluation.unmatched.is_empty() {
        let _ = writeln!(
            text,
            "{WARNING}note:{WARNING:#} estimates that {}: {}",
            if by_overlap { "are paired with no true object" } else { "no true object has the id of" },
            one_line(&some_of(&evaluation.unmatched))
        );
    }
    text
}

/// How many objects have no body, in words.
fn failures(evaluation: &Evaluation) -> String {
    format!(
        "failures: {} of {} without a body ({:.0} %)",
        evaluation.failures,
        count(evaluation.objects.len(), "object"),
        100.0 * evaluation.failure_share().unwrap_or(0.0)
    )
}

/// The scores for programs: angles in radians, lengths in world units, shares from 0 to 1.
pub fn to_json(evaluation: &Evaluation) -> Value {
    let object = |o: &ObjectScore| {
        let mut scores = Map::new();
        scores.insert("id".to_owned(), json!(o.id));
        scores.insert("estimate".to_owned(), json!(o.estimate));
        scores.insert("status".to_owned(), json!(o.status));
        scores.insert("has_body".to_owned(), json!(o.has_body));
        for column in &COLUMNS {
            scores.insert(column.name.to_owned(), json!((column.of)(o)));
        }
        scores.insert("rotation_error".to_owned(), json!(o.rotation_error));
        Value::Object(scores)
    };
    let mean = |mean: Option<Mean>| mean.map(|mean| json!({ "value": mean.value, "objects": mean.count }));
    let mut means: Map<String, Value> =
        COLUMNS.iter().map(|column| (column.name.to_owned(), json!(mean((column.mean)(&evaluation.mean))))).collect();
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

/// How many objects were found, for people.
pub fn render_found(found: &FoundScore) -> String {
    format!(
        "{HEADING}found{HEADING:#}: {} of {} (IoU of {LEAST_IOU} or more, whatever their ids); of {} {} are true\n",
        found.matched,
        count(found.true_objects, "true object"),
        count(found.found, "estimate"),
        found.matched,
    )
}

/// How many objects were found, as JSON.
pub fn found_to_json(found: &FoundScore) -> Value {
    json!({
        "least_iou3d": LEAST_IOU,
        "true_objects": found.true_objects,
        "estimates": found.found,
        "matched": found.matched,
        "precision": found.precision(),
        "recall": found.recall(),
        "mean_iou3d": found.mean_iou3d,
    })
}

/// The scores for a report.
pub fn report_scores(evaluation: &Evaluation) -> quadlift_report::Scores {
    let unit = |unit: &Unit| match unit {
        Unit::Share => "share",
        Unit::Percent => "percent",
        Unit::Degrees => "degrees",
        Unit::Length => "length",
    };
    let values = |o: &ObjectScore| COLUMNS.iter().map(|column| (column.of)(o)).collect();
    quadlift_report::Scores {
        columns: COLUMNS
            .iter()
            .map(|column| quadlift_report::ScoreColumn { title: column.title.to_owned(), unit: unit(&column.unit) })
            .collect(),
        rows: evaluation.objects.iter().map(|o| (o.id.clone(), o.status.clone(), values(o))).collect(),
        mean: COLUMNS.iter().map(|column| (column.mean)(&evaluation.mean).map(|mean| mean.value)).collect(),
        failures: failures(evaluation),
    }
}
