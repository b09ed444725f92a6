//! Scores of estimates against the truth, for Python.

use std::collections::HashSet;

use quadlift::geometry::Projection;
use quadlift::metrics::{EstimatedObject, Mean, ObjectScore, PairedBy, TruthObject, evaluate, evaluate_by_overlap};
use quadlift::scene::Scene;
use quadlift::solve::Status;
use quadlift_io::SceneFile;
use serde_json::{Value, json};

/// Scores the objects of `estimate` against those of `truth`: paired by their ids where any is common, else by overlap.
/// `frames` holds the cameras for the agreement in the images.
pub fn scores(estimate: &SceneFile, truth: &SceneFile, frames: &Scene) -> Result<Value, String> {
    let objects = |file: &SceneFile| file.to_objects().map_err(|error| format!("{}: {}", error.entry, error.problem));
    let estimated: Vec<EstimatedObject> = (objects(estimate)?.into_iter())
        .map(|object| EstimatedObject {
            id: object.id,
            status: object.status.map(Status::name).unwrap_or_default().to_owned(),
            center: object.center,
            ellipsoid: object.ellipsoid,
            enclosing_ellipsoid: object.enclosing_ellipsoid,
            cuboid: object.cuboid,
            enclosing_cuboid: object.enclosing_cuboid,
        })
        .collect();
    let truth: Vec<TruthObject> = (objects(truth)?.into_iter())
        .map(|object| TruthObject { id: object.id, ellipsoid: object.ellipsoid, cuboid: object.cuboid })
        .collect();
    if truth.is_empty() {
        return Err("the truth holds no objects: there is nothing to compare with".to_owned());
    }
    if estimated.is_empty() {
        return Err("there are no estimated objects: there is nothing to score".to_owned());
    }
    let ids: HashSet<&str> = truth.iter().map(|object| object.id.as_str()).collect();
    let any_common = estimated.iter().any(|object| ids.contains(object.id.as_str()));
    let projections: Vec<Projection> = frames.frames.iter().map(|frame| frame.projection).collect();
    let compare = if any_common { evaluate } else { evaluate_by_overlap };
    let evaluation = compare(&estimated, &truth, &projections);
    let value = |mean: Option<Mean>| mean.map(|mean| mean.value);
    let mean = &evaluation.mean;
    Ok(json!({
        "objects": evaluation.objects.iter().map(object_scores).collect::<Vec<_>>(),
        "mean": {
            "iou3d": value(mean.iou3d),
            "iou3d_enclosing": value(mean.iou3d_enclosing),
            "cuboid_iou3d": value(mean.cuboid_iou3d),
            "cuboid_iou3d_enclosing": value(mean.cuboid_iou3d_enclosing),
            "theta_err": value(mean.theta_err),
            "rotation_error": value(mean.rotation_error),
            "center_error": value(mean.center_error),
            "size_error": value(mean.size_error),
            "ellipse_reprojection_iou": value(mean.ellipse_reprojection_iou),
            "box_reprojection_iou": value(mean.box_reprojection_iou),
        },
        "failures": evaluation.failures,
        "unmatched": evaluation.unmatched,
        "matched_by": match evaluation.paired_by {
            PairedBy::Ids => "ids",
            PairedBy::Overlap => "overlap",
        },
    }))
}

fn object_scores(score: &ObjectScore) -> Value {
    json!({
        "id": score.id,
        "estimate": score.estimate,
        "status": score.status,
        "has_body": score.has_body,
        "iou3d": score.iou3d,
        "iou3d_enclosing": score.iou3d_enclosing,
        "cuboid_iou3d": score.cuboid_iou3d,
        "cuboid_iou3d_enclosing": score.cuboid_iou3d_enclosing,
        "theta_err": score.theta_err,
        "rotation_error": score.rotation_error,
        "center_error": score.center_error,
        "size_error": score.size_error,
        "ellipse_reprojection_iou": score.reprojection.map(|r| r.ellipse_iou),
        "box_reprojection_iou": score.reprojection.map(|r| r.box_iou),
    })
}
