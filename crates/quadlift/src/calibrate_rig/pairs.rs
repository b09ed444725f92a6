//! How two cameras stand to each other: bodies in both, each with a depth from the size of its box, are two clouds of points that
//! a rigid motion takes to each other. Unlike rays alone this works where people walk on a plane, as they do.

use nalgebra::{Matrix3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;

use super::kabsch::kabsch;
use crate::geometry::rigid::Pose;
use crate::optimize::median::median;
use crate::sorting::StableSort;

/// Standard deviations of a point: of its depth, relative (the tilt of the camera changes sizes by as much), and across, relative to the
/// size of the body.
pub(super) const DEPTH_SD: f64 = 0.12;
const ACROSS_SD: f64 = 0.15;

/// Squared distance, in standard deviations, of points that belong together: 99 % of three Gaussians.
pub(super) const SAME_POINT: f64 = 11.34;

/// Hypotheses, time steps on which they are compared, and how many are kept.
const HYPOTHESES: usize = 300;
const MAX_TIME_STEPS: usize = 60;
const KEPT: usize = 3;

/// A hypothesis is kept with at least this share of the score of the best one.
const KEPT_SHARE: f64 = 0.6;

/// Motions differ by more than this: radians, and shares of the distance of the points.
const OTHER_ANGLE: f64 = 0.25;
const OTHER_SHARE: f64 = 0.25;

/// A body in the frame of a camera, with its depth from the size of its box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SizedPoint {
    pub place: Vector3<f64>,
    /// Size of the body: half the diagonal of its box at depth one.
    pub extent: f64,
    /// Standard deviation of the depth, relative.
    pub depth_sd: f64,
}

impl SizedPoint {
    /// Covariance of the place.
    pub(super) fn covariance(&self) -> Matrix3<f64> {
        let across = (ACROSS_SD * self.extent).powi(2);
        self.place * self.place.transpose() * (self.depth_sd * self.depth_sd) + Matrix3::identity() * across
    }
}

/// Boxes of two cameras at one time step that may show the same body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Candidate {
    pub time_step: usize,
    pub boxes: [usize; 2],
    pub points: [SizedPoint; 2],
}

/// A motion that explains how two cameras see the same bodies.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RelativePose {
    /// From the frame of the first camera to that of the second one.
    pub second_from_first: Pose,
    /// Number of bodies that agree, less what they are off.
    pub score: f64,
    /// Candidates that agree, at most one for each box.
    pub inliers: Vec<usize>,
}

/// Squared distance of the two points of a candidate after a motion, in standard deviations.
pub(super) fn distance(pose: &Pose, [a, b]: &[SizedPoint; 2]) -> f64 {
    let moved = pose.apply(&a.place);
    let covariance = pose.rotation * a.covariance() * pose.rotation.transpose() + b.covariance();
    let off = moved - b.place;
    covariance.cholesky().map_or(f64::INFINITY, |cholesky| off.dot(&cholesky.solve(&off)))
}

/// The candidates of a motion that agree, each box once, those that agree best first at each time step.
fn agreeing(pose: &Pose, candidates: &[Candidate]) -> (f64, Vec<usize>) {
    let mut score = 0.0;
    let mut inliers = Vec::new();
    let mut near: Vec<(f64, usize)> = Vec::new();
    let mut start = 0;
    while start < candidates.len() {
        let time_step = candidates[start].time_step;
        let end = start + candidates[start..].iter().take_while(|c| c.time_step == time_step).count();
        near.clear();
        near.extend((start..end).map(|k| (distance(pose, &candidates[k].points), k)).filter(|n| n.0 < SAME_POINT));
        near.stable_sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let first = inliers.len();
        for &(squared, k) in &near {
            let [a, b] = candidates[k].boxes;
            let taken = |&other: &usize| candidates[other].boxes[0] == a || candidates[other].boxes[1] == b;
            if !inliers[first..].iter().any(taken) {
                inliers.push(k);
                score += 1.0 - squared / SAME_POINT;
            }
        }
        start = end;
    }
    (score, inliers)
}

/// The motion again from the candidates that agree.
fn refitted(pose: Pose, candidates: &[Candidate], inliers: &[usize]) -> Option<Pose> {
    let pairs: Vec<_> = inliers
        .iter()
        .map(|&k| {
            let [a, b] = candidates[k].points;
            let spread = pose.rotation * a.covariance() * pose.rotation.transpose() + b.covariance();
            (a.place, b.place, 1.0 / spread.trace())
        })
        .collect();
    kabsch(&pairs)
}

/// Motions that explain the candidates (ordered by time steps), the best one first; those that follow differ from it and explain nearly as
/// much.
pub(super) fn relative_poses(candidates: &[Candidate], seed: u64) -> Vec<RelativePose> {
    let mut time_steps: Vec<usize> = candidates.iter().map(|candidate| candidate.time_step).collect();
    time_steps.dedup();
    if time_steps.is_empty() {
        return Vec::new();
    }
    let step = time_steps.len().div_ceil(MAX_TIME_STEPS);
    let chosen: Vec<usize> = time_steps.iter().copied().step_by(step).collect();
    let sample: Vec<Candidate> =
        candidates.iter().filter(|c| chosen.binary_search(&c.time_step).is_ok()).copied().collect();
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut found: Vec<(f64, Pose)> = Vec::new();
    for _ in 0..HYPOTHESES {
        let mut three = [0; 3];
        three.fill_with(|| rng.random_range(0..sample.len()));
        let of_boxes = |k: usize, l: usize, side: usize| sample[k].boxes[side] == sample[l].boxes[side];
        let clash = |k: usize, l: usize| of_boxes(k, l, 0) || of_boxes(k, l, 1);
        if clash(three[0], three[1]) || clash(three[0], three[2]) || clash(three[1], three[2]) {
            continue;
        }
        let pairs = three.map(|k| (sample[k].points[0].place, sample[k].points[1].place, 1.0));
        let Some(mut pose) =
            kabsch(&pairs).filter(|pose| three.iter().all(|&k| distance(pose, &sample[k].points) < SAME_POINT))
        else {
            continue;
        };
        let (mut score, mut inliers) = agreeing(&pose, &sample);
        let best = found.iter().map(|other| other.0).fold(0.0, f64::max);
        for _ in 0..3 {
            if score < KEPT_SHARE * best {
                break;
            }
            let Some(again) = refitted(pose, &sample, &inliers) else { break };
            let (better, of_again) = agreeing(&again, &sample);
            if better <= score {
                break;
            }
            (pose, score, inliers) = (again, better, of_again);
        }
        found.push((score, pose));
    }
    found.stable_sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut kept: Vec<RelativePose> = Vec::new();
    for (_, pose) in found {
        if kept.iter().any(|other| are_same(&other.second_from_first, &pose, candidates)) {
            continue;
        }
        let (_, inliers) = agreeing(&pose, candidates);
        let pose = refitted(pose, candidates, &inliers).unwrap_or(pose);
        let (score, inliers) = agreeing(&pose, candidates);
        if kept.first().is_some_and(|best| score < KEPT_SHARE * best.score) {
            break;
        }
        if !kept.iter().any(|other| are_same(&other.second_from_first, &pose, candidates)) {
            kept.push(RelativePose { second_from_first: pose, score, inliers });
        }
        if kept.len() == KEPT {
            break;
        }
    }
    kept.stable_sort_by(|a, b| b.score.total_cmp(&a.score));
    kept
}

fn are_same(a: &Pose, b: &Pose, candidates: &[Candidate]) -> bool {
    let mut depths: Vec<f64> = candidates.iter().map(|candidate| candidate.points[0].place.norm()).collect();
    let depth = median(&mut depths).unwrap_or_default();
    a.angle_to(b) < OTHER_ANGLE && (a.center() - b.center()).norm() < OTHER_SHARE * depth
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Rotation3;

    fn candidates(truth: &Pose, count: usize, line: bool) -> Vec<Candidate> {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut all = Vec::new();
        for time_step in 0..count {
            // Two bodies that are not told apart.
            let mut place = || {
                let x = rng.random_range(-2.0..2.0);
                let z = if line { 6.0 + 0.3 * x } else { rng.random_range(4.0..8.0) };
                SizedPoint { place: Vector3::new(x, 0.3, z), extent: 0.9, depth_sd: DEPTH_SD }
            };
            let places = [place(), place()];
            for (k, first) in places.into_iter().enumerate() {
                for (l, second) in places.into_iter().enumerate() {
                    let second = SizedPoint { place: truth.apply(&second.place), ..second };
                    let boxes = [4 * time_step + k, 4 * time_step + 2 + l];
                    all.push(Candidate { time_step, boxes, points: [first, second] });
                }
            }
        }
        all
    }

    #[test]
    fn a_motion_is_found_without_knowing_which_point_is_which() {
        let truth = Pose {
            rotation: *Rotation3::new(Vector3::new(0.1, -1.3, 0.05)).matrix(),
            translation: Vector3::new(5.0, 0.3, 4.0),
        };
        let found = relative_poses(&candidates(&truth, 30, false), 1);
        assert!((found[0].second_from_first.rotation - truth.rotation).norm() < 0.1, "{found:?}");
        assert!(found[0].inliers.len() >= 55);
        assert!(relative_poses(&[], 1).is_empty());
    }
}
