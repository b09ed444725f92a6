//! Reasons why an object is doubtful: a closed list that files and programs may rely on.

/// Why an object may not be one standing thing.
///
/// A thing that moves seldom looks like clutter: some standing ellipsoid explains its boxes more or less, but that is
/// oddly long, oddly large or small, or explains them less well than the scene's other objects explain theirs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum AssociationWarning {
    /// Its body is implausibly long.
    Elongated,
    /// Its size is not that of the other objects of its category.
    UnusualSize,
    /// Its detections agree with one standing body much less than those of the scene's other objects.
    WeakEvidence,
    /// The detector itself gives its boxes low scores.
    LowScores,
}

impl AssociationWarning {
    /// The reason in words.
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
