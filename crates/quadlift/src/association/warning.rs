//! Reasons why an object is uncertain: a closed list that files and programs may rely on.

/// Why an object may be moving or be several objects.
///
/// A moving object rarely looks like clutter: some static ellipsoid explains its boxes approximately, but it is
/// unusually long, large or small, or fits worse than the scene's other objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum AssociationWarning {
    /// Its body is implausibly long.
    Elongated,
    /// Its size differs from the other objects of its category.
    UnusualSize,
    /// Its detections fit a static body much worse than those of the scene's other objects.
    WeakEvidence,
    /// The detector itself gives its boxes low scores.
    LowScores,
}

impl AssociationWarning {
    /// The reason as text.
    pub fn text(self) -> &'static str {
        match self {
            Self::Elongated => "implausibly long body: the object may be moving",
            Self::UnusualSize => "size unusual for its category: the object may be moving",
            Self::WeakEvidence => {
                "detections fit a single static body poorly: the object may be moving, or be several objects"
            }
            Self::LowScores => "low detection scores: it may be a false positive",
        }
    }
}
