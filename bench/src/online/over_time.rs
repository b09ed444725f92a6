//! Scores of a map while frames arrive.

use quadlift::geometry::{Body, Ellipsoid};
use quadlift::metrics::{pair_by_overlap, pairwise_clustering_scores, squared_errors};
use quadlift::online::ObjectMap;
use quadlift::scene::Scene;

use super::replay::Labels;
use crate::association::case::{Case, MIN_VIEWS, localize_ellipsoids};
use crate::error::Error;

/// Minimum volume IoU of an object whose NEES counts: others are of something else.
const MIN_IOU: f64 = 0.1;

/// Scores over the frames so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Scores {
    /// F1 of the boxes so far.
    pub f1: f64,
    /// Mean O3D of the objects that were detected often enough so far.
    pub o3d: f64,
    /// NEES of the objects with a covariance (chi-square with 9 degrees of freedom: median 8.34).
    pub nees: Vec<f64>,
}

/// The scores of a map after the first `frames` frames of a case.
///
/// # Errors
/// [`Error::Localize`].
pub(super) fn scores(case: &Case, map: &ObjectMap, labels: &Labels, frames: usize) -> Result<Scores, Error> {
    let is_seen = |index: &usize| (case.scene.detections[*index].frame_index as usize) < frames;
    let seen: Vec<usize> = (0..case.scene.detections.len()).filter(is_seen).collect();
    let division = labels.division(map);
    let of = |all: &[Option<u32>]| seen.iter().map(|&k| all[k]).collect::<Vec<_>>();
    let truth = of(&case.true_objects);
    let f1 = pairwise_clustering_scores(&truth, &of(&division)).f1;
    let mut views = vec![0; case.bodies.len()];
    truth.iter().flatten().for_each(|&object| views[object as usize] += 1);
    let bodies: Vec<Option<Ellipsoid>> =
        case.bodies.iter().zip(&views).map(|(body, &views)| (views >= MIN_VIEWS).then_some(*body)).collect();
    let (o3d, nees) = judge(&map.to_averaged_scene(), &bodies)?;
    Ok(Scores { f1, o3d, nees })
}

/// Mean O3D and NEES of the bodies of a scene whose detections name their objects.
///
/// # Errors
/// [`Error::Localize`].
pub(super) fn judge(scene: &Scene, bodies: &[Option<Ellipsoid>]) -> Result<(f64, Vec<f64>), Error> {
    let localization = localize_ellipsoids(scene)?;
    let found: Vec<Option<Ellipsoid>> = localization.estimates.iter().map(|e| e.closest_ellipsoid()).collect();
    let pairs = pair_by_overlap(&found, bodies, 0.0);
    let total = pairs.iter().map(|pair| pair.iou3d).fold(0.0, |sum, iou| sum + iou);
    let nees = pairs.iter().filter(|pair| pair.iou3d >= MIN_IOU).filter_map(|pair| {
        let estimate = &localization.estimates[pair.found];
        let truth = Body::from(bodies[pair.truth]?);
        Some(squared_errors(estimate.body.as_ref()?, estimate.covariance.as_ref()?, &truth)?.whole)
    });
    Ok((total / bodies.iter().flatten().count().max(1) as f64, nees.collect()))
}
