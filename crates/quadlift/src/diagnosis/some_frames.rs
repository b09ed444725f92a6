//! Frames whose boxes contradict those of the other frames: another convention in a part of the data (ours).
//!
//! Boxes that are wrong by themselves are spread over all frames; in a frame with a wrong pose nearly all are wrong. The counts of
//! wrong boxes are those of one kind of frame (binomial) or of two, and the likelihoods of both say which.

use super::agreement::Agreement;
use super::cause::{Cause, CauseName};
use super::correction::Correction;
use super::hypotheses::discrete;
use super::misses::{AGREES, corrected_ray, point_of};
use super::rays::{MAX_MISS, Ray, meeting_point};
use super::sample::{Sample, Seen};
use crate::tuning::CLEAR;

/// Share of frames that contradict the others from which the scene is inconsistent: robust fits are not hurt by fewer.
const MANY_WRONG: f64 = 0.1;

/// Boxes that are looked at, at most.
pub(crate) const MAX_BOXES: usize = 20_000;

/// The least share of wrong boxes in wrong frames, and the largest one in the others.
const MIN_WRONG: f64 = 0.8;
const MAX_WRONG_OF_RIGHT: f64 = 0.25;

/// Rounds of expectation and maximization.
const ROUNDS: usize = 30;

/// Boxes of wrong frames that a correction must explain.
const MIN_EXPLAINED: f64 = 0.8;

/// Boxes of wrong frames that agree with some object as they are, at most.
const MAX_BY_CHANCE: f64 = 0.5;

/// A correction that changes nothing.
pub(crate) const NOTHING: Correction = Correction::FrameOffset(0);

/// The boxes of a frame: all, and those that contradict their objects.
#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    boxes: f64,
    wrong: f64,
}

/// Whether a cause of some frames makes the scene inconsistent.
pub(crate) fn are_many(cause: &Cause) -> bool {
    cause.value.is_some_and(|share| share >= MANY_WRONG)
}

/// Looks for frames that contradict the others, and names them, their share of those with boxes, and the mistake if one explains
/// them; `None` if there are none.
pub(crate) fn some_frames(sample: &Sample, before: Agreement) -> Option<Cause> {
    let ray = |seen: &Seen| corrected_ray(sample, seen, None, None);
    let mut counts = vec![Counts::default(); sample.frames.len()];
    for object in &sample.objects {
        let rays: Vec<Option<Ray>> = object.iter().map(ray).collect();
        let point = meeting_point(&rays.iter().flatten().copied().collect::<Vec<_>>());
        for (seen, ray) in object.iter().zip(&rays) {
            let miss = ray.zip(point).map_or(MAX_MISS, |(ray, point)| ray.miss(&point));
            let count = &mut counts[seen.frame as usize];
            count.boxes += 1.0;
            count.wrong += f64::from(miss > AGREES);
        }
    }
    let is_wrong = two_kinds(&counts)?;
    let found = mistake(sample, &is_wrong);
    Some(named(sample, &counts, &is_wrong, found, before))
}

/// The same where objects were found by association: the boxes that no object took are the wrong ones, and a mistake must explain
/// them. `None` if none does.
pub(crate) fn some_frames_of_loose(sample: &Sample, loose: &[Seen], before: Agreement) -> Option<Cause> {
    let mut counts = vec![Counts::default(); sample.frames.len()];
    sample.objects.iter().flatten().for_each(|seen| counts[seen.frame as usize].boxes += 1.0);
    for seen in loose {
        let count = &mut counts[seen.frame as usize];
        (count.boxes, count.wrong) = (count.boxes + 1.0, count.wrong + 1.0);
    }
    let is_wrong = two_kinds(&counts)?;
    let points: Vec<_> = sample.objects.iter().filter_map(|object| point_of(sample, object)).collect();
    let these: Vec<&Seen> = loose.iter().filter(|seen| is_wrong[seen.frame as usize]).collect();
    let agrees = |correction: Correction, seen: &Seen| {
        let ray = corrected_ray(sample, seen, Some(correction), None);
        ray.is_some_and(|ray| points.iter().any(|point| ray.miss(point) <= AGREES))
    };
    let share_of =
        |correction| these.iter().filter(|seen| agrees(correction, seen)).count() as f64 / these.len() as f64;
    let found = best(sample, share_of).filter(|_| share_of(NOTHING) < MAX_BY_CHANCE)?;
    Some(named(sample, &counts, &is_wrong, Some(found), before))
}

/// The frames and their mistake.
fn named(
    sample: &Sample,
    counts: &[Counts],
    is_wrong: &[bool],
    mistake: Option<(Correction, f64)>,
    before: Agreement,
) -> Cause {
    let with_boxes = counts.iter().filter(|count| count.boxes > 0.0).count();
    let wrong = is_wrong.iter().filter(|wrong| **wrong).count();
    let share = wrong as f64 / with_boxes as f64;
    let (name, after) = mistake.map_or((CauseName::ContradictingFrames, before), |(correction, share)| {
        (correction.cause(), Agreement { share, ..before })
    });
    let frames = (0..is_wrong.len()).filter(|k| is_wrong[*k]).map(|k| sample.frame_ids[k].to_owned()).collect();
    Cause { value: Some(share), frames, after, ..Cause::unexplained(name, before) }
}

/// Whether each frame is of the kind with more wrong boxes; `None` unless there clearly are two kinds.
fn two_kinds(counts: &[Counts]) -> Option<Vec<bool>> {
    let used: Vec<Counts> = counts.iter().copied().filter(|count| count.boxes > 0.0).collect();
    let (boxes, wrong) = used.iter().fold((0.0, 0.0), |(b, w), count| (b + count.boxes, w + count.wrong));
    let one = wrong / boxes;
    let log = |count: &Counts, share: f64| count.wrong * share.ln() + (count.boxes - count.wrong) * (1.0 - share).ln();
    let (mut of_wrong, mut of_right, mut mixture) = (0.95, 0.05, 0.5);
    let posterior = |count: &Counts, of_wrong: f64, of_right: f64, mixture: f64| {
        let odds = log(count, of_wrong) - log(count, of_right) + (mixture / (1.0 - mixture)).ln();
        1.0 / (1.0 + (-odds).exp())
    };
    for _ in 0..ROUNDS {
        // Each kind has half a box of each sort to begin with, so that shares are never 0 or 1.
        let mut sums = [[0.5, 1.0]; 2];
        let mut weights = 0.5;
        for count in &used {
            let p = posterior(count, of_wrong, of_right, mixture);
            for (sum, p) in sums.iter_mut().zip([p, 1.0 - p]) {
                sum[0] += p * count.wrong;
                sum[1] += p * count.boxes;
            }
            weights += p;
        }
        [of_wrong, of_right] = sums.map(|[wrong, boxes]| wrong / boxes);
        mixture = weights / (used.len() as f64 + 1.0);
    }
    if of_wrong < MIN_WRONG || of_right > MAX_WRONG_OF_RIGHT || !(0.0..1.0).contains(&one) {
        return None;
    }
    let of_two = |count: &Counts| {
        let (a, b) = (mixture.ln() + log(count, of_wrong), (1.0 - mixture).ln() + log(count, of_right));
        a.max(b) + (-(a - b).abs()).exp().ln_1p()
    };
    let gain: f64 = used.iter().map(|count| of_two(count) - log(count, one.max(1e-9))).sum();
    // Two more numbers (Schwarz 1978).
    let wrong: Vec<bool> =
        counts.iter().map(|count| count.boxes > 0.0 && posterior(count, of_wrong, of_right, mixture) > 0.5).collect();
    let found = gain > CLEAR + (used.len() as f64).ln() && wrong.contains(&true);
    found.then_some(wrong)
}

/// The mistake whose correction makes the boxes of these frames agree with the objects of the others, and the share that does.
fn mistake(sample: &Sample, is_wrong: &[bool]) -> Option<(Correction, f64)> {
    // The objects in the other frames, with their boxes in these ones.
    let mut objects = Vec::new();
    for object in &sample.objects {
        let (these, others): (Vec<Seen>, Vec<Seen>) = object.iter().partition(|seen| is_wrong[seen.frame as usize]);
        if let Some(point) = point_of(sample, &others) {
            objects.push((point, these));
        }
    }
    let boxes: usize = objects.iter().map(|(_, these)| these.len()).sum();
    let agreeing = |correction: Correction| {
        let agrees = |point: &_, seen: &Seen| {
            corrected_ray(sample, seen, Some(correction), None).is_some_and(|ray| ray.miss(point) <= AGREES)
        };
        let count = objects.iter().flat_map(|(point, these)| these.iter().filter(move |seen| agrees(point, seen)));
        count.count() as f64 / boxes as f64
    };
    best(sample, agreeing)
}

/// The correction after which the largest share of boxes agrees, if that explains them.
fn best(sample: &Sample, share_of: impl Fn(Correction) -> f64) -> Option<(Correction, f64)> {
    let mut best = None;
    for correction in discrete(&sample.frame_ids) {
        // Detections that other frames took are not explained by what those frames show.
        if correction.frames(&sample.frame_ids).is_some() {
            continue;
        }
        let share = share_of(correction);
        if share >= MIN_EXPLAINED && best.is_none_or(|(_, known)| share > known) {
            best = Some((correction, share));
        }
    }
    best
}
