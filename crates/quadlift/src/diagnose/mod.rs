//! The self-check: does a scene agree with itself, and if not, which of the usual mistakes explains it (ours)?
//!
//! 1. `sample`: some objects with their boxes, those that the border of the image cuts left out.
//! 2. `rays`, `agreement`: how far the rays through the middles of an object's boxes miss each other, in half sizes of the
//!    boxes.
//! 3. `correction`, `hypotheses`, `search`: the usual mistakes are undone one by one; the one that makes the scene agree
//!    much better is its cause.
//! 4. `trajectory`, `object_ids`: where no correction explains it, whether poses repeat, the scale jumps, or ids do not
//!    stay with their objects.
//! 5. `without_ids`: where no objects are known, they are sought under each hypothesis.
//! 6. `upright`, `lengths`: what boxes and poses alone do not tell, against the cameras and against priors on sizes.

mod agreement;
mod apply;
mod camera;
mod cause;
mod correction;
mod frame_order;
mod hypotheses;
mod lengths;
mod object_ids;
mod rays;
mod sample;
mod search;
#[cfg(test)]
mod tests;
mod trajectory;
mod upright;
mod without_ids;

use std::collections::BTreeSet;

pub use agreement::Agreement;
pub use camera::CameraParts;
pub use cause::{Cause, CauseName};
pub use correction::{BoxFormat, Correction, Mistake};
pub use without_ids::diagnose_association;

use crate::scene::{Detection, Scene};
use sample::Sample;
use search::{Explanation, Search};

/// Boxes from which on a sample says something.
const FEWEST_BOXES: usize = 8;

/// Scenes whose boxes typically miss by more than this many half sizes...
const INCONSISTENT_MISS: f64 = 0.5;

/// ...and of whose boxes fewer than this share agree do not agree with themselves, whatever the cause.
const INCONSISTENT_SHARE: f64 = 0.3;

/// Scenes whose boxes typically miss by less than this many half sizes agree, whatever would make them agree better.
const NEGLIGIBLE_MISS: f64 = 0.005;

/// Where boxes miss by more than this, or fewer than this share of them agree, the trajectory and the ids are looked at.
const SUSPICIOUS_MISS: f64 = 0.1;
const SUSPICIOUS_SHARE: f64 = 0.85;

/// A jump of the scale has more numbers to fit than a correction: it must explain the boxes better by this (a logarithm).
const CLEARLY_BETTER: f64 = 0.2;

/// Share of the frames that repeat a pose although something moved, from which on the scene is wrong.
const MANY_REPEATED: f64 = 0.2;

/// Share of these frames from which on whatever else seems to explain the scene does not.
const MOST_REPEATED: f64 = 0.5;

/// Explanations that are reported, at most.
const MOST_CAUSES: usize = 3;

/// What the self-check found.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// Whether the scene agrees with itself, as far as can be seen.
    pub consistent: bool,
    /// How well it agrees; `None` where there was nothing to look at (no object with two boxes).
    pub agreement: Option<Agreement>,
    /// What explains the disagreement, the best explanation first. Of a consistent scene: what makes it agree a little
    /// better, and may be wrong.
    pub causes: Vec<Cause>,
}

impl Default for Diagnosis {
    /// Nothing to look at, nothing wrong.
    fn default() -> Self {
        Self { consistent: true, agreement: None, causes: Vec::new() }
    }
}

/// Checks whether the boxes of each object agree with each other, and if not, which mistake explains it; and whether the
/// scene's `up` agrees with the cameras.
///
/// Looks at the detections that name an object and that `is_used` accepts (those of one source). It takes a few
/// milliseconds for a scene of any size, because a sample is enough; more where the scene does not agree with itself.
pub fn diagnose(scene: &Scene, is_used: impl Fn(&Detection) -> bool) -> Diagnosis {
    of_boxes(scene, is_used).and_up(scene)
}

impl Diagnosis {
    /// The same, where `up` contradicts the cameras and nothing else is wrong: wrong poses contradict it as well.
    fn and_up(mut self, scene: &Scene) -> Self {
        if let (true, Some(agreement)) = (self.consistent, self.agreement)
            && let Some((correction, is_certain)) = upright::corrected_up(scene)
        {
            self.consistent = !is_certain;
            self.causes.insert(0, Cause::new(correction, agreement, agreement));
        }
        self
    }
}

/// The diagnosis from the boxes of each object.
fn of_boxes(scene: &Scene, is_used: impl Fn(&Detection) -> bool) -> Diagnosis {
    let sample = Sample::new(scene, &is_used);
    let Some(search) = search::search(&sample) else { return Diagnosis::default() };
    let found = of_search(&search, &sample);
    let before = search.given.agreement();
    let without_correction = |consistent, name, value, after| {
        let cause = Cause { name, value, correction: None, before, after };
        Diagnosis { consistent, agreement: Some(before), causes: vec![cause] }
    };
    if let Some(share) = trajectory::repeated_poses(&sample)
        && (found.causes.is_empty() || share > MOST_REPEATED)
    {
        let consistent = found.consistent && share < MANY_REPEATED;
        return without_correction(consistent, CauseName::DuplicatePoses, Some(share), before);
    }
    if before.miss <= SUSPICIOUS_MISS && before.share >= SUSPICIOUS_SHARE {
        return found;
    }
    // A correction may explain a part of a jump.
    let best = search.explanations.first().filter(|_| !found.consistent).map_or(0.0, |best| best.gain.gain);
    let jump = trajectory::scale_jump(&sample, &search.given);
    if let Some(jump) = jump.filter(|jump| jump.gain.explains(sample.boxes(), sample.objects.len()))
        && jump.gain.gain > best + CLEARLY_BETTER
    {
        return without_correction(false, CauseName::ScaleJump, Some(jump.factor), jump.gain.after);
    }
    if found.causes.is_empty()
        && let Some(cause) = object_ids::mixed_ids(scene, &is_used, before)
    {
        return Diagnosis { consistent: false, agreement: Some(before), causes: vec![cause] };
    }
    found
}

/// The agreement of the boxes of each object, and the corrections that explain it.
fn of_search(search: &Search, sample: &Sample) -> Diagnosis {
    let (boxes, objects) = (sample.boxes(), sample.objects.len());
    let before = search.given.agreement();
    let find = |explains: &dyn Fn(&Explanation) -> bool| -> Vec<Cause> {
        let found = search.explanations.iter().filter(|e| explains(e));
        let mut causes: Vec<Cause> = found.map(|e| Cause::new(e.correction, before, e.gain.after)).collect();
        let mut named = BTreeSet::new();
        causes.retain(|cause| named.insert(cause.name));
        causes.truncate(MOST_CAUSES);
        causes
    };
    let explained = if before.miss > NEGLIGIBLE_MISS { find(&|e| e.gain.explains(boxes, objects)) } else { Vec::new() };
    let disagrees = boxes >= FEWEST_BOXES && before.miss > INCONSISTENT_MISS && before.share < INCONSISTENT_SHARE;
    if !explained.is_empty() || disagrees {
        return Diagnosis { consistent: false, agreement: Some(before), causes: explained };
    }
    let causes = find(&|e| e.gain.is_likely(boxes, objects));
    Diagnosis { consistent: true, agreement: Some(before), causes }
}
