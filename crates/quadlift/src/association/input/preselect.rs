//! Selects the detections to associate.

use crate::association::options::{AssociateError, AssociateOptions};
use crate::geometry::BoundingBox;
use crate::scene::{Scene, SkippedDetections};
use crate::sorting::StableSort;

/// The selected detections (indices into the scene, ascending) and the numbers of skipped ones, by reason.
pub(crate) fn select(
    scene: &Scene,
    options: &AssociateOptions,
) -> Result<(Vec<usize>, SkippedDetections), AssociateError> {
    let source = scene.source_index(options.source.as_deref())?;
    let mut skipped = SkippedDetections::default();
    let mut kept = Vec::new();
    for (index, detection) in scene.detections.iter().enumerate() {
        if source.is_some() && detection.source_index != source {
            skipped.other_source += 1;
        } else if is_below(detection.score, options.min_score) {
            skipped.low_score += 1;
        } else {
            kept.push(index);
        }
    }
    if let Some(limit) = options.max_overlap {
        let before = kept.len();
        kept = without_duplicates(scene, kept, limit);
        skipped.duplicate = before - kept.len();
    }
    Ok((kept, skipped))
}

fn is_below(score: Option<f64>, least: Option<f64>) -> bool {
    least.zip(score).is_some_and(|(least, score)| score < least)
}

/// Non-maximum suppression in every frame and category: processes the best detections first and drops those that
/// overlap one of them by more than `limit`.
fn without_duplicates(scene: &Scene, mut indices: Vec<usize>, limit: f64) -> Vec<usize> {
    let rank = |index: usize| {
        let detection = &scene.detections[index];
        // Detections without a score come after those with one.
        let area = detection.measured_box().map_or(0.0, |b| b.size().product());
        (detection.score.unwrap_or(f64::NEG_INFINITY), area)
    };
    let group = |index: usize| {
        let detection = &scene.detections[index];
        (detection.frame_index, detection.category_index)
    };
    indices.stable_sort_by(|&a, &b| {
        let ((score_a, area_a), (score_b, area_b)) = (rank(a), rank(b));
        let best_first = score_b.total_cmp(&score_a).then(area_b.total_cmp(&area_a)).then(a.cmp(&b));
        group(a).cmp(&group(b)).then(best_first)
    });
    let mut kept = Vec::with_capacity(indices.len());
    for members in indices.chunk_by(|&a, &b| group(a) == group(b)) {
        let mut boxes: Vec<BoundingBox> = Vec::new();
        for &index in members {
            let Some(own) = scene.detections[index].measured_box() else { continue };
            if boxes.iter().all(|better| better.iou(&own) <= limit) {
                boxes.push(own);
                kept.push(index);
            }
        }
    }
    kept.sort_unstable();
    kept
}
