//! Levels of pose errors from the equations of the corrections, and whether poses as given show any errors (docs/method.md, section 11.2).

use std::collections::BTreeMap;

use nalgebra::{Matrix6, Vector2};

use super::pose_prior::{PoseLevels, PosePrior};
use super::pose_system::{MAX_STEP, PoseEquations, PoseSystem};
use super::pose_terms::{Motion, SceneTerms};
use crate::parallel::map_indices;
use crate::sorting::StableSort;
use crate::tuning::CLEAR;

/// Steps of the levels under the same equations, at most; the relative change below which they stand, and the number of parameters of the
/// motions below which the measurements determine nothing.
const LEVEL_STEPS: usize = 10;
const LEVEL_TOLERANCE: f64 = 0.1;
const DETERMINED: f64 = 1.0;

/// Factor by which a level changes in one of these steps, at most.
const MAX_FREE_STEP: f64 = 16.0;

/// Standard deviations of the derivative of the evidence, and logarithm of the evidence, from which poses are suspected. Less than what
/// corrections need: 5 is about three standard deviations.
const SUSPECTED_SCORE: f64 = 2.0;
const SUSPECTED_EVIDENCE: f64 = 1.0;

/// Logarithm of the evidence below the largest one from which a correlation length is no longer considered.
const MAX_LOG_EVIDENCE_GAP: f64 = 30.0;

/// Factor by which levels may be larger than they seem before the first step: noise levels contain what is an error of poses.
const INITIAL_SD_FACTOR: f64 = 4.0;

/// Frames that get one motion where slow errors are looked for, relative to their correlation length; and fewest of them: errors that
/// last shorter show beside those of single frames and slower ones.
const COARSE: f64 = 0.2;
const MIN_TOGETHER: f64 = 5.0;

/// The levels of one correlation length that errors may have, and what speaks for it.
#[derive(Debug, Clone, Copy)]
struct PoseNoiseHypothesis {
    /// The levels that suit the equations.
    levels: PoseLevels,
    /// Logarithm of the evidence for them, against poses that are exact.
    evidence: f64,
}

impl PoseNoiseHypothesis {
    /// From these levels, which are estimated if they are not given; `None` where the equations are singular.
    fn new(
        equations: &PoseEquations,
        mut levels: PoseLevels,
        estimated: bool,
        before: impl Fn(usize) -> Motion,
    ) -> Option<Self> {
        let mut evidence = None;
        for _ in 0..LEVEL_STEPS {
            let Some(system) = PoseSystem::new(equations, levels, &before) else { break };
            evidence = Some(system.log_evidence());
            let (shown, determined) = system.levels(equations, levels, MAX_FREE_STEP);
            if !estimated || shown.change(&levels) < LEVEL_TOLERANCE || determined < DETERMINED {
                break;
            }
            levels = shown;
        }
        Some(Self { levels, evidence: evidence? })
    }
}

impl PosePrior {
    /// Whether poses stay as given before anything is known of their levels: they may be exact, and the cheap tests find no errors.
    pub(super) fn keeps_input_poses(&self, terms: &SceneTerms, levels: &[PoseLevels]) -> bool {
        levels.is_empty() && self.may_be_exact && !self.are_suspected(terms)
    }

    /// The levels from which the next step is taken, of each correlation length that errors may have, that of the largest evidence first.
    /// `levels` are those of the last step; none before the first one, and none then for poses that do not clearly show errors.
    pub(super) fn contenders(
        &self,
        equations: &PoseEquations,
        levels: &[PoseLevels],
        before: impl Fn(usize) -> Motion + Sync,
    ) -> Vec<PoseLevels> {
        let starts = levels.is_empty();
        let levels = if starts { self.first.as_slice() } else { levels };
        if levels.len() < 2 && !(starts && self.may_be_exact) {
            return levels.to_vec();
        }
        let contender =
            |k: usize| Some((levels[k], PoseNoiseHypothesis::new(equations, levels[k], self.estimated, &before)?));
        let found: Vec<(PoseLevels, PoseNoiseHypothesis)> =
            map_indices(levels.len(), contender).into_iter().flatten().collect();
        let most = found.iter().map(|(_, found)| found.evidence).fold(f64::NEG_INFINITY, f64::max);
        // Poses are corrected where it is clear that they are not exact.
        if starts && self.may_be_exact && most < CLEAR {
            return Vec::new();
        }
        let mut found: Vec<_> =
            found.into_iter().filter(|(_, found)| found.evidence > most - MAX_LOG_EVIDENCE_GAP).collect();
        // Stable: of equal ones the errors that last shortest.
        found.stable_sort_by(|(_, a), (_, b)| b.evidence.total_cmp(&a.evidence));
        let next = |(before, PoseNoiseHypothesis { levels, .. }): (PoseLevels, PoseNoiseHypothesis)| match (
            self.estimated,
            starts,
        ) {
            (false, _) => before,
            (true, true) => levels.scaled(INITIAL_SD_FACTOR).at_most(&before),
            (true, false) => levels.within(&before, MAX_STEP),
        };
        found.into_iter().map(next).collect()
    }

    /// Whether poses as given show errors: of single frames, or slow ones. It takes much less time than the equations of all frames.
    fn are_suspected(&self, terms: &SceneTerms) -> bool {
        score_test_independent(terms).max() > SUSPECTED_SCORE
            || self.first.iter().any(|first| drift_log_evidence(terms, *first) > SUSPECTED_EVIDENCE)
    }
}

/// The derivative of the evidence by the variances of independent errors (rotation, shift), at zero, relative to its standard deviation if
/// poses are exact: Rao's score. The standard deviation is a little too small, since it leaves out what couples frames.
fn score_test_independent(terms: &SceneTerms) -> Vector2<f64> {
    let mut frames: BTreeMap<usize, (Motion, Matrix6<f64>)> = BTreeMap::new();
    terms.objects.iter().for_each(|object| object.add_diagonal(&mut frames));
    terms.points.iter().for_each(|point| point.add_diagonal(&mut frames));
    Vector2::from_fn(|k, _| {
        let of = |(gradient, information): &(Motion, Matrix6<f64>)| {
            let block = information.fixed_view::<3, 3>(3 * k, 3 * k).into_owned();
            (gradient.fixed_rows::<3>(3 * k).norm_squared() - block.trace(), 2.0 * block.norm_squared())
        };
        let (score, variance) = frames.values().map(of).fold((0.0, 0.0), |(a, b), (c, d)| (a + c, b + d));
        if variance > 0.0 { score / f64::sqrt(variance) } else { 0.0 }
    })
}

/// Logarithm of the evidence for slow errors, with one motion for some frames that follow each other.
fn drift_log_evidence(terms: &SceneTerms, first: PoseLevels) -> f64 {
    let together = COARSE * first.correlation_length;
    if together < MIN_TOGETHER {
        return f64::NEG_INFINITY;
    }
    let coarse = SceneTerms {
        objects: terms.objects.iter().map(|object| object.coarse(together, first.first_camera)).collect(),
        points: terms.points.iter().map(|point| point.coarse(together, first.first_camera)).collect(),
    };
    let levels =
        PoseLevels { correlation_length: first.correlation_length / together, first_camera: usize::MAX, ..first };
    let equations = PoseEquations::new(&coarse, usize::MAX);
    PoseNoiseHypothesis::new(&equations, levels, true, |_| Motion::zeros())
        .map_or(f64::NEG_INFINITY, |found| found.evidence)
}
