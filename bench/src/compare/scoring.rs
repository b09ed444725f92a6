//! The values of one run: of each true object, and of the scene.

use std::collections::BTreeMap;
use std::path::Path;

use quadlift::geometry::{Body, BodyKind};
use quadlift::metrics::{ObjectScore, iou3d_bodies, squared_errors};
use quadlift::solve::{Covariance, Status};
use quadlift_io::SceneFile;
use quadlift_io::evaluation::identities::{self, DivisionOutcome};
use quadlift_io::evaluation::{Matching, evaluate_objects};
use quadlift_io::scene_file::ObjectBodies;

use super::program::Finished;
use super::sets::{Overlap, SceneCase, Set};

/// Quantile of chi-square with 9 degrees of freedom at 95 %: the limit of the squared distance of a body.
const CHI2_9_95: f64 = 16.919;

/// What is compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Measured {
    /// Volume IoU of an object, 0 if it is missing.
    Iou,
    /// 1 if the true body lies in the region of 95 %, 0 if not.
    Coverage,
    /// Pairwise F1 of the association of a scene.
    F1,
    /// Processor time of a run, seconds.
    Time,
}

impl Measured {
    /// All of them, in the order of the rows.
    pub(super) const ALL: [Self; 4] = [Self::Iou, Self::Coverage, Self::F1, Self::Time];

    /// The name in tables and documents.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Iou => "IoU",
            Self::Coverage => "coverage",
            Self::F1 => "F1",
            Self::Time => "time [s]",
        }
    }
}

/// The values of one run, by measure and object; that of a scene has no object.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Scored {
    /// The values.
    pub values: BTreeMap<(Measured, String), f64>,
    /// Whether there was no result.
    pub failed: bool,
}

/// Scores a run.
///
/// # Errors
/// The result is not a valid scene file, or does not fit the truth.
pub(super) fn score(set: &Set, scene: &SceneCase, finished: &Finished) -> anyhow::Result<Scored> {
    let mut scored = Scored { failed: finished.result.is_none(), ..Default::default() };
    let empty = SceneFile::default();
    let result = finished.result.as_ref().unwrap_or(&empty);
    for (id, iou, coverage) in objects(set, scene, result)? {
        scored.values.insert((Measured::Iou, id.clone()), iou);
        if let Some(is_inside) = coverage {
            scored.values.insert((Measured::Coverage, id), f64::from(u8::from(is_inside)));
        }
    }
    if !set.has_ids {
        let path = Path::new("result");
        let f1 = match identities::score((path, result), (path, &scene.truth), None)? {
            DivisionOutcome::Scored(division) => division.score.f1,
            _ => 0.0,
        };
        scored.values.insert((Measured::F1, String::new()), f1);
    }
    if let Some(time) = finished.time {
        scored.values.insert((Measured::Time, String::new()), time.as_secs_f64());
    }
    Ok(scored)
}

/// For each true object that counts: its id, its IoU, and whether the region of its estimate holds it.
fn objects(set: &Set, scene: &SceneCase, result: &SceneFile) -> anyhow::Result<Vec<(String, f64, Option<bool>)>> {
    let path = Path::new("result");
    let estimates = result.to_objects().map_err(|error| error.in_file(path))?;
    let truth = scene.truth.to_objects().map_err(|error| error.in_file(path))?;
    let matching = if set.has_ids { Matching::Ids } else { Matching::Overlap };
    let any_common = estimates.iter().any(|estimate| truth.iter().any(|object| object.id == estimate.id));
    let can_be_scored = if set.has_ids { any_common } else { !estimates.is_empty() };
    let scores: Vec<ObjectScore> = if can_be_scored {
        evaluate_objects((path, result), (path, &scene.truth), matching)?.0.objects
    } else {
        Vec::new()
    };
    let of_object = |object: &ObjectBodies| {
        let score = scores.iter().find(|score| score.id == object.id);
        let paired = score.and_then(|score| score.estimate.as_ref());
        let estimate = paired.and_then(|id| estimates.iter().find(|estimate| estimate.id == *id));
        let iou = match set.overlap {
            Overlap::Ellipsoids => score.and_then(|score| score.iou3d),
            Overlap::Enclosing => score.and_then(|score| score.iou3d_enclosing),
            Overlap::Bodies => {
                estimate.and_then(ObjectBodies::body).zip(object.body()).map(|(a, b)| iou3d_bodies(&a, &b))
            }
        };
        let region = estimate.filter(|estimate| estimate.status == Some(Status::Ok));
        let region = region.and_then(|estimate| Some((estimate.body()?, estimate.covariance?)));
        let inside = region.and_then(|(body, covariance)| is_inside(set.overlap, &body, &covariance, object));
        (object.id.clone(), iou.unwrap_or(0.0), inside)
    };
    Ok(truth.iter().filter(|object| scene.counted.contains(&object.id)).map(of_object).collect())
}

/// Whether the true body lies in the region of 95 % of an estimate.
pub(crate) fn is_inside(overlap: Overlap, body: &Body, covariance: &Covariance, truth: &ObjectBodies) -> Option<bool> {
    let true_body = match (body.kind, overlap, truth.cuboid()) {
        (_, Overlap::Bodies, _) => truth.body()?,
        (BodyKind::Cuboid, _, Some(cuboid)) => cuboid,
        _ => truth.ellipsoid().map(Body::from).or(truth.body())?,
    };
    Some(squared_errors(body, covariance, &true_body)?.whole <= CHI2_9_95)
}
