//! The result of the consistency check.

use std::collections::BTreeSet;

use super::agreement::{Agreement, MIN_BOXES};
use super::cause::Cause;
use super::sample::Sample;
use super::search::{Explanation, Search};
use super::upright;
use crate::scene::Scene;

/// Scenes whose boxes typically miss by more than this many half sizes...
const INCONSISTENT_MISS: f64 = 0.5;

/// ...and of whose boxes fewer than this share agree do not agree with themselves, whatever the cause.
const INCONSISTENT_SHARE: f64 = 0.3;

/// Scenes whose boxes typically miss by less than this many half sizes agree, whatever would make them agree better.
const NEGLIGIBLE_MISS: f64 = 0.005;

/// Maximum number of reported explanations.
const MAX_CAUSES: usize = 3;

/// The result of the consistency check.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Diagnosis {
    /// Whether the scene is consistent.
    pub consistent: bool,
    /// Its agreement; `None` if nothing could be checked (no object with two boxes).
    pub agreement: Option<Agreement>,
    /// Causes of the inconsistency, the best explanation first. For a consistent scene: possible mistakes, whose
    /// correction improves the agreement slightly.
    pub causes: Vec<Cause>,
}

impl Default for Diagnosis {
    /// Nothing to check: consistent.
    fn default() -> Self {
        Self { consistent: true, agreement: None, causes: Vec::new() }
    }
}

impl Diagnosis {
    /// The same, where `up` contradicts the cameras and nothing else is wrong: wrong poses contradict it as well.
    pub(crate) fn and_up(mut self, scene: &Scene) -> Self {
        if let (true, Some(agreement)) = (self.consistent, self.agreement)
            && let Some((correction, is_certain)) = upright::corrected_up(scene)
        {
            self.consistent = !is_certain;
            self.causes.insert(0, Cause::new(correction, agreement, agreement));
        }
        self
    }
}

/// The agreement of the boxes of each object, and corrections that improve it.
pub(crate) fn of_search(search: &Search, sample: &Sample) -> Diagnosis {
    let (boxes, objects) = (sample.boxes(), sample.objects.len());
    let before = search.given.agreement();
    let find = |explains: &dyn Fn(&Explanation) -> bool| -> Vec<Cause> {
        let found = search.explanations.iter().filter(|e| explains(e));
        let mut causes: Vec<Cause> = found.map(|e| Cause::new(e.correction, before, e.gain.after)).collect();
        let mut named = BTreeSet::new();
        causes.retain(|cause| named.insert(cause.name));
        causes.truncate(MAX_CAUSES);
        causes
    };
    let explained = if before.miss > NEGLIGIBLE_MISS { find(&|e| e.gain.explains(boxes, objects)) } else { Vec::new() };
    let disagrees = boxes >= MIN_BOXES && before.miss > INCONSISTENT_MISS && before.share < INCONSISTENT_SHARE;
    if !explained.is_empty() || disagrees {
        return Diagnosis { consistent: false, agreement: Some(before), causes: explained };
    }
    let causes = find(&|e| e.gain.is_likely(boxes, objects));
    Diagnosis { consistent: true, agreement: Some(before), causes }
}
