//! How well detections were divided into objects, and how many of the true objects were found.

use std::collections::HashMap;

use super::overlap::pair_by_overlap;
use crate::geometry::Ellipsoid;

/// Agreement of two divisions of the same detections.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ClusteringScore {
    /// Fraction of the assigned pairs of detections of true objects that are correct; 1 if there are none.
    pub precision: f64,
    /// Fraction of the true pairs of detections that were assigned to the same object; 1 if there are none.
    pub recall: f64,
    /// Harmonic mean of precision and recall.
    pub f1: f64,
    /// Adjusted Rand index over all detections, those without an object each on their own: 1 for equal divisions, 0 on
    /// average for random ones.
    pub adjusted_rand_index: f64,
    /// Number of found objects whose main true object is covered better by another found object.
    pub duplicates: usize,
}

/// Scores a division of detections into objects against the true one; `None` marks detections without an object. Both
/// lists have the same detections in the same order; any numbers serve as names of objects.
///
/// Detections without a true object only affect the adjusted Rand index.
pub fn pairwise_clustering_scores(truth: &[Option<u32>], found: &[Option<u32>]) -> ClusteringScore {
    let both = || truth.iter().copied().zip(found.iter().copied());
    let of_true_objects = || both().filter_map(|(t, f)| Some((t?, f)));
    let together = pairs_in_groups(of_true_objects().filter_map(|(t, f)| Some((t, f?))));
    let ratio = |part: f64, whole: f64| if whole > 0.0 { part / whole } else { 1.0 };
    let precision = ratio(together, pairs_in_groups(of_true_objects().filter_map(|(_, f)| f)));
    let recall = ratio(together, pairs_in_groups(of_true_objects().map(|(t, _)| t)));
    let f1 = if precision + recall > 0.0 { 2.0 * precision * recall / (precision + recall) } else { 0.0 };
    // Singletons form no pairs.
    let (pairs_true, pairs_found) = (pairs_in_groups(truth.iter().flatten()), pairs_in_groups(found.iter().flatten()));
    let count = truth.len().min(found.len()) as f64;
    let expected = if count > 1.0 { pairs_true * pairs_found / (0.5 * count * (count - 1.0)) } else { 0.0 };
    let most = 0.5 * (pairs_true + pairs_found);
    let adjusted_rand_index = if most > expected { (together - expected) / (most - expected) } else { 1.0 };
    ClusteringScore { precision, recall, f1, adjusted_rand_index, duplicates: duplicates(truth, found) }
}

/// Number of pairs of equal items.
fn pairs_in_groups<T: std::hash::Hash + Eq>(items: impl Iterator<Item = T>) -> f64 {
    let mut counts: HashMap<T, u64> = HashMap::new();
    for item in items {
        *counts.entry(item).or_default() += 1;
    }
    counts.values().map(|&n| n * (n - 1) / 2).sum::<u64>() as f64
}

fn duplicates(truth: &[Option<u32>], found: &[Option<u32>]) -> usize {
    let mut counts: HashMap<u32, HashMap<Option<u32>, usize>> = HashMap::new();
    for (&true_object, &object) in truth.iter().zip(found) {
        if let Some(object) = object {
            *counts.entry(object).or_default().entry(true_object).or_default() += 1;
        }
    }
    let majority = |members: &HashMap<Option<u32>, usize>| {
        members
            .iter()
            .max_by_key(|&(&object, &count)| (count, std::cmp::Reverse(object)))
            .and_then(|(&object, _)| object)
    };
    let owned: Vec<u32> = counts.values().filter_map(majority).collect();
    let mut distinct = owned.clone();
    distinct.sort_unstable();
    distinct.dedup();
    owned.len() - distinct.len()
}

/// How many true objects were found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ObjectDetectionScore {
    /// Number of true objects.
    pub true_objects: usize,
    /// Number of found objects.
    pub found: usize,
    /// Number of found objects paired with a true one.
    pub matched: usize,
    /// Mean volume IoU of these pairs; absent without pairs.
    pub mean_iou3d: Option<f64>,
}

impl ObjectDetectionScore {
    /// Fraction of the found objects that are correct; absent if nothing was found.
    pub fn precision(&self) -> Option<f64> {
        (self.found > 0).then(|| self.matched as f64 / self.found as f64)
    }

    /// Fraction of the true objects that were found; absent if there are none.
    pub fn recall(&self) -> Option<f64> {
        (self.true_objects > 0).then(|| self.matched as f64 / self.true_objects as f64)
    }
}

/// How many true objects were found: found and true bodies are paired one to one (see [`pair_by_overlap`]), and a pair
/// counts with a volume IoU (O3D) of at least `least_iou`. A found object without a body counts as found and is never
/// paired.
pub fn score_found(found: &[Option<Ellipsoid>], truth: &[Ellipsoid], least_iou: f64) -> ObjectDetectionScore {
    let bodies: Vec<Option<Ellipsoid>> = truth.iter().copied().map(Some).collect();
    let pairs = pair_by_overlap(found, &bodies, least_iou);
    let total: f64 = pairs.iter().map(|pair| pair.iou3d).sum();
    ObjectDetectionScore {
        true_objects: truth.len(),
        found: found.len(),
        matched: pairs.len(),
        mean_iou3d: (!pairs.is_empty()).then(|| total / pairs.len() as f64),
    }
}

#[cfg(test)]
mod tests {
    use super::super::iou3d_ellipsoids;
    use super::*;
    use crate::geometry::ConvexBody;
    use nalgebra::{Point3, Rotation3, Vector3};
    use proptest::prelude::*;

    #[test]
    fn a_division_by_hand() {
        // Objects 1 (four detections) and 2 (two); the last detection is false.
        let truth = [Some(1), Some(1), Some(1), Some(1), Some(2), Some(2), None];
        let found = [Some(7), Some(7), Some(7), Some(8), Some(8), None, Some(8)];
        let score = pairwise_clustering_scores(&truth, &found);
        // Found together: 3 pairs of 1 and the wrong one (1, 2); true pairs: 6 and 1.
        assert_eq!((score.precision, score.recall), (0.75, 3.0 / 7.0));
        assert!((score.f1 - 2.0 * 0.75 * (3.0 / 7.0) / (0.75 + 3.0 / 7.0)).abs() < 1e-15);
        // Over all 21 pairs: 3 in both, 7 true, 6 found.
        let expected = 7.0 * 6.0 / 21.0;
        assert!((score.adjusted_rand_index - (3.0 - expected) / (6.5 - expected)).abs() < 1e-15);
        // 8 has one detection of each of three; the tie goes to no object.
        assert_eq!(score.duplicates, 0);
        let split = [Some(1), Some(1), Some(3), Some(3), Some(2), Some(2), None];
        assert_eq!(pairwise_clustering_scores(&truth, &split).duplicates, 1);
    }

    #[test]
    fn nothing_to_divide_is_divided_well() {
        let score = pairwise_clustering_scores(&[], &[]);
        assert_eq!((score.precision, score.recall, score.adjusted_rand_index), (1.0, 1.0, 1.0));
        let score = pairwise_clustering_scores(&[Some(0), Some(0)], &[None, None]);
        assert_eq!((score.recall, score.f1), (0.0, 0.0));
    }

    proptest! {
        #[test]
        fn names_do_not_matter(truth in prop::collection::vec(prop::option::of(0..4u32), 2..30), shift in 1..9u32) {
            let renamed: Vec<_> = truth.iter().map(|t| t.map(|t| (t * 7 + shift) % 11)).collect();
            let score = pairwise_clustering_scores(&truth, &renamed);
            prop_assert_eq!((score.precision, score.recall, score.duplicates), (1.0, 1.0, 0));
            prop_assert!((score.adjusted_rand_index - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn found_objects_are_paired_once() {
        let ball = |x: f64| Ellipsoid {
            center: Point3::new(x, 0.0, 0.0),
            semi_axes: Vector3::repeat(1.0),
            rotation: Rotation3::identity(),
        };
        let truth = [ball(0.0), ball(10.0), ball(20.0)];
        assert!(truth[0].volume() > 4.0);
        let found = [Some(ball(0.1)), Some(ball(0.2)), Some(ball(10.0)), None];
        let score = score_found(&found, &truth, 0.25);
        assert_eq!((score.true_objects, score.found, score.matched), (3, 4, 2));
        assert_eq!((score.precision(), score.recall()), (Some(0.5), Some(2.0 / 3.0)));
        let expected = 0.5 * (1.0 + iou3d_ellipsoids(&ball(0.1), &truth[0]));
        assert!((score.mean_iou3d.unwrap() - expected).abs() < 1e-9);
        assert_eq!(score_found(&[], &[], 0.25).precision(), None);
    }
}
