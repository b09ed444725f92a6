//! The self-check: does a scene agree with itself, and if not, which of the usual mistakes explains it (ours)?
//!
//! 1. `sample`: some objects with their boxes, those that the border of the image cuts left out.
//! 2. `agreement`: how far the rays through the middles of an object's boxes miss each other, in half sizes of the boxes.
//! 3. `correction`, `hypotheses`, `search`: the usual mistakes are undone one by one; the one that makes the scene agree
//!    much better is its cause.

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

pub use agreement::Agreement;
pub use camera::CameraParts;
pub use cause::{Cause, CauseName};
pub use correction::{BoxFormat, Correction, Mistake};

use crate::scene::{Detection, Scene};
use sample::Sample;
use search::Explanation;

/// Scenes whose boxes typically miss by more than this do not agree with themselves, whatever the cause.
const INCONSISTENT_MISS: f64 = 0.5;

/// A correction explains a disagreement when it makes the misses smaller by this factor (a logarithm)...
const EXPLAINS: f64 = 0.35;

/// ...and by so many standard deviations of that.
const SIGNIFICANT: f64 = 3.0;

/// Explanations that are reported, at most.
const MOST_CAUSES: usize = 3;

/// What the self-check found.
#[derive(Debug, Clone, PartialEq)]
pub struct Diagnosis {
    /// Whether the scene agrees with itself, as far as can be seen.
    pub consistent: bool,
    /// How well it agrees; `None` where there was nothing to look at (no object with two boxes).
    pub agreement: Option<Agreement>,
    /// What explains the disagreement, the best explanation first.
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
    let explains = |e: &&Explanation| e.gain > EXPLAINS && e.gain > SIGNIFICANT * e.gain_sd;
    let cause = |e: &Explanation| Cause {
        name: e.correction.cause(),
        value: e.correction.value(),
        correction: Some(e.correction),
        before: search.before,
        after: e.after,
    };
    let causes: Vec<Cause> = search.explanations.iter().filter(explains).take(MOST_CAUSES).map(cause).collect();
    Diagnosis {
        consistent: causes.is_empty() && search.before.miss < INCONSISTENT_MISS,
        agreement: Some(search.before),
        causes,
    }
}
