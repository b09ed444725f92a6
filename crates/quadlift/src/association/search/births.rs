//! New objects from unassigned boxes: spheres from pairs of boxes, tested in other frames, best first.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashSet};

use crate::association::input::context::AssociationContext;
use crate::association::input::observations::Observations;
use crate::association::score::rays::{Sphere, center_covariance, pair_sphere, triangulate_sphere};
use crate::association::score::scene_statistics::SceneStatistics;
use crate::association::score::sphere_score::{Score, SphereScorer};
use crate::parallel::map_indices;
use crate::sorting::StableSort;

/// Maximum number of kept spheres per box.
const KEPT: usize = 3;

/// All boxes are paired with all while the square of their number is not larger.
const ALL_PAIRS: usize = 1_000_000;

/// Approximate number of free boxes of the partner frames (nearest first) that a box is paired with: in crowds not
/// those of all frames.
const MAX_PARTNERS: usize = 2000;

/// Range of the number of tested spheres per box, those with the best agreement first. With many free boxes fewer are
/// tested, to limit the time.
const TESTED: [usize; 2] = [10, 100];

/// Approximate total number of tested spheres.
const TESTED_IN_ALL: usize = 200_000;

/// Minimum score of a birth before any object is found; later, the evidence decides.
const FIRST_LEAST_SCORE: f64 = 4.0;

/// A birth that has lost most of its boxes to others is dropped.
const MAX_ASSIGNED_SHARE: f64 = 0.75;

/// A sphere and its boxes.
#[derive(Debug, Clone)]
pub(crate) struct Birth {
    pub sphere: Sphere,
    /// One box per frame, ascending.
    pub boxes: Vec<u32>,
    /// Logarithm of the ratio of the likelihoods.
    score: f64,
}

/// Finds births among the unused boxes. No two share a box; the best comes first.
pub(crate) fn births(
    context: &AssociationContext,
    observations: &Observations,
    statistics: &SceneStatistics,
    used: &[bool],
) -> Vec<Birth> {
    let least_score = if used.contains(&true) { 0.0 } else { FIRST_LEAST_SCORE };
    let mut scorer = SphereScorer::new(context, observations, statistics, used);
    let candidates = distinct(observations, pairs(&scorer));
    let grown = map_indices(candidates.len(), |k| {
        let (birth, category) = &candidates[k];
        (improve(&scorer, birth, *category, 3), *category)
    });
    let least_views = context.options.min_views;
    let mut queue: BinaryHeap<Queued> = BinaryHeap::new();
    for (place, (birth, category)) in grown.into_iter().enumerate() {
        if let Some(birth) = birth
            && birth.score > least_score
            && birth.boxes.len() >= least_views
        {
            queue.push(Queued { birth, category, place, rescored: 0 });
        }
    }
    let mut used = used.to_vec();
    let mut accepted = Vec::new();
    while let Some(Queued { birth, category, place, rescored }) = queue.pop() {
        let free: Vec<u32> = birth.boxes.iter().copied().filter(|&i| !used[i as usize]).collect();
        if free.len() == birth.boxes.len() {
            scorer.take(&free);
            for index in free {
                used[index as usize] = true;
            }
            accepted.push(birth);
            continue;
        }
        let taken = 1.0 - free.len() as f64 / birth.boxes.len() as f64;
        if taken > MAX_ASSIGNED_SHARE || free.len() < least_views || rescored >= 3 {
            continue;
        }
        // Better births have taken some of its boxes: it is rescored on the remaining ones.
        let Some(sphere) = triangulate_sphere(observations, &free, &birth.sphere.center) else { continue };
        let ends = vec![free[0], free[free.len() - 1]];
        let again = improve(&scorer, &Birth { sphere, boxes: ends, score: 0.0 }, category, 2);
        if let Some(birth) = again
            && birth.score > least_score
            && birth.boxes.len() >= least_views
        {
            queue.push(Queued { birth, category, place, rescored: rescored + 1 });
        }
    }
    accepted
}

/// A birth in the queue: the best score first, ties by index.
struct Queued {
    birth: Birth,
    category: usize,
    place: usize,
    rescored: usize,
}

impl Ord for Queued {
    fn cmp(&self, other: &Self) -> Ordering {
        self.birth.score.total_cmp(&other.birth.score).then(other.place.cmp(&self.place))
    }
}

impl PartialOrd for Queued {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Queued {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Queued {}

/// The best spheres of each box with a box of another frame, scored.
fn pairs(scorer: &SphereScorer) -> Vec<Birth> {
    let observations = scorer.observations;
    let free: Vec<usize> = scorer.all_free().collect();
    let mut frames: Vec<u32> = free.iter().map(|&i| observations.boxes[i].frame as u32).collect();
    frames.dedup();
    let all_pairs = free.len() * free.len() <= ALL_PAIRS;
    let most_tested = (TESTED_IN_ALL / free.len().max(1)).clamp(TESTED[0], TESTED[1]);
    let found = map_indices(free.len(), |k| {
        let index = free[k];
        let observation = &observations.boxes[index];
        let camera = &observations.cameras[observation.frame];
        let partners = if all_pairs { &frames } else { &scorer.context.order.partners[observation.frame] };
        let (mut spheres, mut looked_at) = (Vec::new(), 0);
        for &frame in partners.iter().filter(|&&f| f as usize != observation.frame) {
            if looked_at >= MAX_PARTNERS {
                break;
            }
            let partner_camera = &observations.cameras[frame as usize];
            for partner in scorer.free_in(frame as usize, observation.category) {
                looked_at += 1;
                let other = (partner_camera, &observations.boxes[partner as usize]);
                if let Some(pair) = pair_sphere((camera, observation), other) {
                    spheres.push((pair.disagreement, partner, pair.sphere));
                }
            }
        }
        if spheres.len() > most_tested {
            let best_first = |a: &(f64, u32, Sphere), b: &(f64, u32, Sphere)| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1));
            spheres.select_nth_unstable_by(most_tested, best_first);
            spheres.truncate(most_tested);
            spheres.sort_unstable_by(best_first);
        }
        best_spheres(scorer, index, &spheres)
    });
    found.into_iter().flatten().collect()
}

/// The best of the spheres of one box.
fn best_spheres(scorer: &SphereScorer, index: usize, spheres: &[(f64, u32, Sphere)]) -> Vec<Birth> {
    let observation = &scorer.observations.boxes[index];
    let witnesses = &scorer.context.order.witnesses[observation.frame];
    let mut best: Vec<Birth> = Vec::with_capacity(KEPT);
    for &(_, partner, sphere) in spheres {
        let Some(penalty) = scorer.size_penalty(sphere.log_radius, observation.category) else { continue };
        let boxes = [index as u32, partner];
        let covariance = center_covariance(scorer.observations, &boxes, &sphere);
        let found = scorer.score(&sphere, &covariance, 2, witnesses, observation.category);
        let score = found.value - penalty;
        if found.detected < 2 || score <= 0.0 {
            continue;
        }
        let birth = Birth { sphere, boxes: boxes.to_vec(), score };
        if best.len() < KEPT {
            best.push(birth);
        } else if let Some(worst) = (0..KEPT).min_by(|&a, &b| best[a].score.total_cmp(&best[b].score))
            && best[worst].score < score
        {
            best[worst] = birth;
        }
    }
    best
}

/// Keeps the best one of nearly identical spheres, with their categories; the best comes first.
fn distinct(observations: &Observations, mut births: Vec<Birth>) -> Vec<(Birth, usize)> {
    births.stable_sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut seen = HashSet::new();
    let mut kept = Vec::new();
    for birth in births {
        let category = observations.boxes[birth.boxes[0] as usize].category;
        let octave = (2.0 * birth.sphere.log_radius).round();
        let cell = birth.sphere.center / (0.35 * (0.5 * octave).exp());
        let key = [cell.x.round() as i64, cell.y.round() as i64, cell.z.round() as i64, octave as i64, category as i64];
        if seen.insert(key) {
            kept.push((birth, category));
        }
    }
    kept
}

/// Scores a sphere in all frames that may see it, then triangulates it from its boxes, a few times; returns the best.
fn improve(scorer: &SphereScorer, birth: &Birth, category: usize, rounds: usize) -> Option<Birth> {
    let (observations, context) = (scorer.observations, scorer.context);
    let (mut sphere, mut boxes) = (birth.sphere, birth.boxes.clone());
    let mut best: Option<Birth> = None;
    for round in 0..rounds {
        let covariance = center_covariance(observations, &boxes, &sphere);
        let frames = context.frames_near(&sphere.center, sphere.log_radius.exp(), observations.least_half_size);
        let Score { value, detected, boxes: claimed } =
            scorer.score(&sphere, &covariance, boxes.len(), &frames, category);
        let Some(penalty) = scorer.size_penalty(sphere.log_radius, category) else { break };
        let score = value - penalty;
        if best.as_ref().is_none_or(|b| score > b.score) {
            best = Some(Birth { sphere, boxes: claimed.clone(), score });
        }
        if detected < 2 || claimed.is_empty() || round + 1 == rounds {
            break;
        }
        match triangulate_sphere(observations, &claimed, &sphere.center) {
            Some(better) => (sphere, boxes) = (better, claimed),
            None => break,
        }
    }
    best
}
