//! Objects that may not be one standing thing.

use super::evidence::evidence;
use super::model::Model;
use super::object::Object;
use super::observations::Observations;
use super::problem::Problem;

/// Why an object may not be one standing thing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Doubt {
    /// Its detections agree so little with one standing body that it may be moving, or a mixture of several.
    WeakEvidence,
    /// No real thing is so long: the fit follows something that moves.
    Elongated,
}

impl Doubt {
    /// The reason in words.
    pub fn text(self) -> &'static str {
        match self {
            Self::WeakEvidence => "its detections agree poorly with one standing body: it may move, or be several",
            Self::Elongated => "its body is implausibly long: it may move",
        }
    }
}

/// Evidence per view below which an object is doubtful.
const LEAST_EVIDENCE_PER_VIEW: f64 = 5.0;

/// Ratio of the longest to the shortest semi-axis beyond which it is.
const LARGEST_ASPECT: f64 = 8.0;

/// Why an object is doubtful, if it is.
pub(super) fn doubt(problem: &Problem, observations: &Observations, model: &Model, object: &Object) -> Option<Doubt> {
    let axes: [f64; 3] = std::array::from_fn(|i| object.root.column(i).norm());
    let aspect = axes.iter().copied().fold(0.0, f64::max) / axes.iter().copied().fold(f64::MAX, f64::min);
    if aspect > LARGEST_ASPECT {
        return Some(Doubt::Elongated);
    }
    let per_view = evidence(problem, observations, model, object) / object.boxes.len().max(1) as f64;
    (per_view < LEAST_EVIDENCE_PER_VIEW).then_some(Doubt::WeakEvidence)
}
