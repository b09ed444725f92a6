//! The consistency check of a scene whose detections name their objects.

use super::agreement::Agreement;
use super::cause::{Cause, CauseName};
use super::sample::Sample;
use super::some_frames::{are_many, some_frames};
use super::verdict::{Diagnosis, of_search};
use super::{object_ids, rig_time, search, some_frames, trajectory};
use crate::scene::{Detection, Scene};
use crate::solve::RefinedPose;

/// If boxes miss by more than this, or a smaller fraction of them agrees, the trajectory and the ids are checked.
const SUSPICIOUS_MISS: f64 = 0.1;
const SUSPICIOUS_SHARE: f64 = 0.85;

/// A jump of the scale has more numbers to fit than a correction: it must explain the boxes better by this (a logarithm).
const CLEARLY_BETTER: f64 = 0.2;

/// Refined poses must explain the boxes better than a correction by this factor. A convention; 22 mistakes with three kinds of refinement are
/// refused as without it (a test).
const CLEARLY_LESS: f64 = 0.5;

/// Fraction of frames that repeat a pose although something moved above which the scene is inconsistent.
const MANY_REPEATED: f64 = 0.2;

/// Fraction of these frames above which other explanations are discarded.
const MAX_REPEATED: f64 = 0.5;

/// With fewer agreeing boxes than this the frames are compared with each other.
const SOME_WRONG: f64 = 0.95;

/// Checks whether the boxes of each object are consistent, and if not, which mistake explains it; also checks the
/// scene's `up` against the cameras.
///
/// Uses the detections with an object id that `is_used` accepts (those of one source). Takes a few milliseconds for a
/// scene of any size, because a sample is enough; longer if the scene is inconsistent.
pub fn diagnose(scene: &Scene, is_used: impl Fn(&Detection) -> bool) -> Diagnosis {
    of_boxes(scene, is_used).and_up(scene)
}

/// The same for a scene whose poses were refined, because they are known to be wrong: the refined ones are checked.
///
/// Refined poses explain a part of most mistakes, with many more numbers than a correction has. The scene counts as consistent only if its
/// boxes then miss by clearly less than after any correction, once the numbers that poses and objects took are counted.
pub(crate) fn diagnose_refined(
    scene: &Scene,
    refined: &[RefinedPose],
    is_used: impl Fn(&Detection) -> bool,
) -> Diagnosis {
    let given = diagnose(scene, &is_used);
    if given.consistent || refined.is_empty() {
        return given;
    }
    let mut moved = scene.clone();
    for RefinedPose { frame_index, turn, shift, .. } in refined {
        if let Some(frame) = moved.0.frames.get_mut(*frame_index) {
            frame.projection = frame.projection.with_moved_camera(turn, shift).unwrap_or(frame.projection);
        }
    }
    let after = diagnose(&moved, &is_used);
    let miss = |agreement: Option<Agreement>| agreement.map_or(f64::INFINITY, |agreement| agreement.miss);
    let corrected = given.causes.iter().map(|cause| cause.after.miss).fold(miss(given.agreement), f64::min);
    // Two numbers of each box's middle, three of each object's and six of each camera.
    let groups = scene.detections_by_object(|d| is_used(d) && (d.bounding_box.is_some() || d.ellipse.is_some()));
    let without_poses: f64 = groups.iter().map(|group| (2.0 * group.len() as f64 - 3.0).max(0.0)).sum();
    let left = without_poses - 6.0 * refined.len() as f64;
    let honest = miss(after.agreement) * (without_poses / left).sqrt();
    if after.consistent && left > 0.0 && honest < CLEARLY_LESS * corrected { after } else { given }
}

/// The diagnosis from the boxes of each object.
pub(crate) fn of_boxes(scene: &Scene, is_used: impl Fn(&Detection) -> bool) -> Diagnosis {
    let sample = Sample::new(scene, &is_used);
    let Some(search) = search::search(&sample) else { return Diagnosis::default() };
    let found = of_search(&search, &sample);
    let before = search.given.agreement();
    let without_correction = |consistent, name, value, after| {
        let cause = Cause { value, after, ..Cause::unexplained(name, before) };
        Diagnosis { consistent, agreement: Some(before), causes: vec![cause] }
    };
    if let Some(share) = trajectory::repeated_poses(&sample)
        && (found.causes.is_empty() || share > MAX_REPEATED)
    {
        let consistent = found.consistent && share < MANY_REPEATED;
        return without_correction(consistent, CauseName::DuplicatePoses, Some(share), before);
    }
    if let Some(cause) = rig_time::of_scene(scene, &is_used, true, before) {
        return Diagnosis { consistent: false, agreement: Some(before), causes: vec![cause] };
    }
    let of_some = || {
        if !found.causes.is_empty() || before.share >= SOME_WRONG {
            return None;
        }
        let cause = some_frames(&Sample::with_at_most(scene, &is_used, some_frames::MAX_BOXES), before)?;
        let consistent = found.consistent && !are_many(&cause);
        Some(Diagnosis { consistent, agreement: Some(before), causes: vec![cause] })
    };
    if before.miss <= SUSPICIOUS_MISS && before.share >= SUSPICIOUS_SHARE {
        return of_some().unwrap_or(found);
    }
    // A correction may explain a part of a jump.
    let best = search.explanations.first().filter(|_| !found.consistent).map_or(0.0, |best| best.gain.gain);
    let jump = trajectory::scale_jump(&sample, &search.given);
    if let Some(jump) = jump.filter(|jump| jump.gain.explains(sample.boxes(), sample.objects.len()))
        && jump.gain.gain > best + CLEARLY_BETTER
    {
        return without_correction(false, CauseName::ScaleJump, Some(jump.factor), jump.gain.after);
    }
    if let Some(diagnosis) = of_some() {
        return diagnosis;
    }
    if found.causes.is_empty()
        && let Some(cause) = object_ids::mixed_ids(scene, &is_used, before)
    {
        return Diagnosis { consistent: false, agreement: Some(before), causes: vec![cause] };
    }
    found
}
