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
            Self::Elongated => "its body is implausibly long: it may move",
            Self::UnusualSize => "its size is not that of its category: it may move",
            Self::WeakEvidence => "its detections agree poorly with one standing body: it may move, or be several",
            Self::LowScores => "its boxes have low scores: the detector hardly believes in it",
        }
    }
}
