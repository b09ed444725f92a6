//! Scores a scene file against one with ground truth: its objects, and how its detections were associated
//! ([`identities`]).

pub mod identities;
mod scores;

use std::collections::HashSet;
use std::path::Path;

use quadlift::geometry::{Body, Ellipsoid, Projection};
use quadlift::metrics::{
    EstimatedObject, Evaluation, ObjectDetectionScore, PairedBy, TruthObject, evaluate, score_found,
};
use quadlift::solve::Status;

use crate::error::ReadError;
use crate::scene_file::{ObjectBodies, SceneFile};

pub use scores::{COLUMNS, Column, Unit, failures_in_words, found_record, scores_record};

/// Minimum volume IoU of a true object with an estimate that is `ok` to count as found.
pub const MIN_IOU: f64 = 0.25;

/// How estimates and true objects are paired.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Matching {
    /// By ids if any are shared, otherwise by overlap.
    #[default]
    Auto,
    /// By their ids.
    Ids,
    /// By the overlap of their bodies.
    Overlap,
}

/// Why two files cannot be compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum EvaluateError {
    /// One of them is wrong.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// Either file lacks the data to compare, or they do not match.
    #[error("{0}")]
    Unfit(String),
    /// They should be paired by ids and have none in common.
    #[error("{0}")]
    NoCommonId(String),
}

/// Scores the objects of a result against those of a scene with ground truth, and counts how many were found.
///
/// Reprojection scores use the cameras of the truth, or of the estimate if the truth has none. Messages name the paths.
///
/// # Errors
/// [`EvaluateError`] if there is nothing to compare.
pub fn evaluate_objects(
    estimate: (&Path, &SceneFile),
    truth: (&Path, &SceneFile),
    matching: Matching,
) -> Result<(Evaluation, ObjectDetectionScore), EvaluateError> {
    let unfit = |why| Err(EvaluateError::Unfit(why));
    let objects = |(path, file): (&Path, &SceneFile)| file.to_objects().map_err(|error| error.in_file(path));
    let estimated: Vec<EstimatedObject> = objects(estimate)?.into_iter().map(estimated_object).collect();
    let true_objects: Vec<TruthObject> = objects(truth)?.into_iter().map(true_object).collect();
    let (estimate_path, truth_path) = (estimate.0.display(), truth.0.display());
    if true_objects.is_empty() {
        return unfit(format!("{truth_path}: the file holds no \"objects\": there is no truth to compare with"));
    }
    if estimated.is_empty() {
        return unfit(format!("{estimate_path}: the file holds no \"objects\": there is nothing to score"));
    }
    if let (Some(a), Some(b)) = (&estimate.1.length_unit, &truth.1.length_unit)
        && a != b
    {
        return unfit(format!("the length unit of {estimate_path} is \"{a}\", that of {truth_path} is \"{b}\""));
    }
    let ids: HashSet<&str> = true_objects.iter().map(|object| object.id.as_str()).collect();
    let any_common = estimated.iter().any(|object| ids.contains(object.id.as_str()));
    if matching == Matching::Ids && !any_common {
        return Err(EvaluateError::NoCommonId(format!(
            "no object of {estimate_path} has the id of an object of {truth_path}; there: {}",
            true_objects.iter().take(5).map(|object| object.id.as_str()).collect::<Vec<_>>().join(", ")
        )));
    }
    let (path, cameras) = if truth.1.frames.is_empty() { estimate } else { truth };
    let scene = cameras.to_scene().map_err(|error| error.in_file(path))?;
    let projections: Vec<Projection> = scene.frames.iter().map(|frame| frame.projection).collect();
    let paired_by = match matching {
        Matching::Overlap => PairedBy::Overlap,
        Matching::Auto if !any_common => PairedBy::Overlap,
        Matching::Auto | Matching::Ids => PairedBy::Ids,
    };
    let evaluation = evaluate(&estimated, &true_objects, &projections, paired_by);
    // An unreliable estimate finds nothing: `localize` does not count it either.
    let is_ok = |object: &EstimatedObject| object.status.is_empty() || object.status == Status::Ok.name();
    let found: Vec<Option<Ellipsoid>> =
        estimated.iter().filter(|object| is_ok(object)).map(|object| Some(object.body?.closest_ellipsoid())).collect();
    let bodies: Vec<Ellipsoid> = true_objects.iter().filter_map(TruthObject::ellipsoid).collect();
    Ok((evaluation, score_found(&found, &bodies, MIN_IOU)))
}

fn estimated_object(object: ObjectBodies) -> EstimatedObject {
    EstimatedObject {
        body: object.body(),
        enclosing: object.enclosing.as_ref().map(Body::closest_ellipsoid),
        id: object.id,
        status: object.status.map(Status::name).unwrap_or_default().to_owned(),
        center: object.center,
    }
}

fn true_object(object: ObjectBodies) -> TruthObject {
    TruthObject { ellipsoid: object.ellipsoid(), cuboid: object.cuboid(), id: object.id }
}
