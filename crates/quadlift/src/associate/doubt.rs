//! Objects that may not be one standing thing.

use super::evidence::evidence;
use super::object::Object;
use super::problem::Problem;
use super::rounds::State;
use super::statistics::median;

/// Why an object may not be one standing thing.
///
/// A thing that moves seldom looks like clutter: some standing ellipsoid explains its boxes more or less, but that is
/// oddly long, oddly large or small, or explains them less well than the scene's other objects explain theirs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Doubt {
    /// Its body is implausibly long.
    Elongated,
    /// Its size is not that of the other objects of its category.
    UnusualSize,
    /// Its detections agree with one standing body much less than those of the scene's other objects.
    WeakEvidence,
}

impl Doubt {
    /// The reason in words.
    pub fn text(self) -> &'static str {
        match self {
            Self::Elongated => "its body is implausibly long: it may move",
            Self::UnusualSize => "its size is not that of its category: it may move",
            Self::WeakEvidence => "its detections agree poorly with one standing body: it may move, or be several",
        }
    }
}

/// Ratio of the longest to the shortest semi-axis beyond which an object is doubtful.
const LARGEST_ASPECT: f64 = 8.0;

/// Standard deviations of a category's log radius beyond which it is.
const LARGEST_DEVIATION: f64 = 3.0;

/// The standard deviation of log radii is not taken for smaller than this.
const LEAST_SIZE_SD: f64 = 0.12;

/// Objects of a category that must be there for their sizes to tell what is usual.
const TELLING_OBJECTS: usize = 6;

/// Evidence per view, relative to the median of the scene's objects, below which an object is doubtful.
const LEAST_RELATIVE_EVIDENCE: f64 = 0.4;

/// For each object, why it is doubtful, if it is.
pub(super) fn doubts(problem: &Problem, state: &State) -> Vec<Option<Doubt>> {
    let objects = &state.objects;
    let per_view: Vec<f64> = objects
        .iter()
        .map(|o| evidence(problem, &state.observations, &state.model, o) / o.boxes.len().max(1) as f64)
        .collect();
    let usual_evidence = median(&mut per_view.clone()).unwrap_or(0.0);
    let usual_size: Vec<Option<(f64, f64)>> = (0..state.observations.categories.len())
        .map(|category| usual_log_radius(objects.iter().filter(|o| o.category == category)))
        .collect();
    let doubt = |(object, own): (&Object, &f64)| {
        let axes: [f64; 3] = std::array::from_fn(|i| object.root.column(i).norm());
        let longest = axes.iter().copied().fold(0.0, f64::max);
        if longest > LARGEST_ASPECT * axes.iter().copied().fold(f64::MAX, f64::min) {
            return Some(Doubt::Elongated);
        }
        if let Some((middle, sd)) = usual_size[object.category]
            && (object.radius.ln() - middle).abs() > LARGEST_DEVIATION * sd
        {
            return Some(Doubt::UnusualSize);
        }
        (*own < LEAST_RELATIVE_EVIDENCE * usual_evidence).then_some(Doubt::WeakEvidence)
    };
    objects.iter().zip(&per_view).map(doubt).collect()
}

/// Median and robust standard deviation of the log radii, where there are enough.
fn usual_log_radius<'a>(objects: impl Iterator<Item = &'a Object>) -> Option<(f64, f64)> {
    let mut logs: Vec<f64> = objects.map(|o| o.radius.ln()).collect();
    if logs.len() < TELLING_OBJECTS {
        return None;
    }
    let middle = median(&mut logs)?;
    let mut deviations: Vec<f64> = logs.iter().map(|x| (x - middle).abs()).collect();
    Some((middle, (1.4826 * median(&mut deviations)?).max(LEAST_SIZE_SD)))
}
