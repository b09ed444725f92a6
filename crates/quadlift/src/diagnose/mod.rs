//! The self-check: does a scene agree with itself, and if not, which of the usual mistakes explains it (ours)?
//!
//! 1. `sample`: some objects with their boxes, those that the border of the image cuts left out.
//! 2. `agreement`: how far the rays through the middles of an object's boxes miss each other, in half sizes of the boxes.
//! 3. `correction`, `hypotheses`, `search`: the usual mistakes are undone one by one; the one that makes the scene agree
//!    much better is its cause.
//! 4. `without_ids`: where no objects are known, they are sought under each hypothesis.

mod agreement;
mod apply;
mod camera;
mod cause;
mod correction;
mod frame_order;
mod hypotheses;
mod sample;
mod search;
#[cfg(test)]
mod tests;
mod without_ids;

use std::collections::BTreeSet;

pub use agreement::Agreement;
pub use camera::CameraParts;
pub use cause::{Cause, CauseName};
pub use correction::{BoxFormat, Correction, Mistake};
pub use without_ids::diagnose_association;

use crate::scene::{Detection, Scene};
use sample::Sample;
use search::Explanation;

/// Boxes from which on a sample says something.
const FEWEST_BOXES: usize = 8;

/// Scenes whose boxes typically miss by more than this many half sizes...
const INCONSISTENT_MISS: f64 = 0.5;

/// ...and of whose boxes fewer than this share agree do not agree with themselves, whatever the cause.
const INCONSISTENT_SHARE: f64 = 0.3;

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

/// Checks whether the boxes of each object agree with each other, and if not, which mistake explains it.
///
/// Looks at the detections that name an object and that `is_used` accepts (those of one source). It takes a few
/// milliseconds for a scene of any size, because a sample is enough.
pub fn diagnose(scene: &Scene, is_used: impl Fn(&Detection) -> bool) -> Diagnosis {
    let sample = Sample::new(scene, is_used);
    let Some(search) = search::search(&sample) else { return Diagnosis::default() };
    let (boxes, objects) = (sample.boxes(), sample.objects.len());
    let cause = |e: &Explanation| Cause {
        name: e.correction.cause(),
        value: e.correction.value(),
        correction: Some(e.correction),
        before: search.before,
        after: e.after,
    };
    let find = |explains: &dyn Fn(&Explanation) -> bool| -> Vec<Cause> {
        let mut causes: Vec<Cause> = search.explanations.iter().filter(|e| explains(e)).map(cause).collect();
        let mut named = BTreeSet::new();
        causes.retain(|cause| named.insert(cause.name));
        causes.truncate(MOST_CAUSES);
        causes
    };
    let causes = find(&|e| e.explains(boxes, objects));
    let disagrees =
        boxes >= FEWEST_BOXES && search.before.miss > INCONSISTENT_MISS && search.before.share < INCONSISTENT_SHARE;
    if !causes.is_empty() || disagrees {
        return Diagnosis { consistent: false, agreement: Some(search.before), causes };
    }
    let causes = find(&|e| e.is_likely(boxes, objects));
    Diagnosis { consistent: true, agreement: Some(search.before), causes }
}
