//! What changed in an object map.

use crate::diagnosis::Diagnosis;

/// Id of an object of a map: 1, 2, ... in order of appearance. Ids are never reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct ObjectId(pub u64);

impl std::fmt::Display for ObjectId {
    /// The id in scene files.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "object_{:04}", self.0)
    }
}

/// A detection of an earlier frame.
#[derive(Debug, Clone, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct DetectionRef {
    /// Id of the frame.
    pub frame: String,
    /// Index of the detection in the frame.
    pub detection: usize,
}

/// Why an object was removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Removal {
    /// It was not detected in clear views. The map keeps it, and detects when it returns.
    Gone,
    /// Clutter explains its detections better; they are unassigned.
    Weak,
    /// It coincides with a similar object that has many more detections.
    Nested,
    /// The map exceeded [`super::OnlineOptions::max_objects`].
    Forgotten,
    /// The user removed it.
    User,
}

/// What happened to an object.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// A tentative object was created from two or more detections.
    New {
        /// The object.
        object: ObjectId,
        /// Its detections in earlier frames; the one in this frame is in [`FrameUpdate::objects`].
        detections: Vec<DetectionRef>,
    },
    /// There is enough evidence for an object.
    Confirmed {
        /// The object.
        object: ObjectId,
    },
    /// Detections of earlier frames were reassigned.
    Reassigned {
        /// The object; `None` if they are clutter now.
        object: Option<ObjectId>,
        /// The detections.
        detections: Vec<DetectionRef>,
    },
    /// Two objects were merged. The older id stays.
    Merged {
        /// The object that stays.
        object: ObjectId,
        /// The id that is now an alias of it.
        alias: ObjectId,
    },
    /// An object was removed or is gone.
    Removed {
        /// The object.
        object: ObjectId,
        /// Why.
        reason: Removal,
    },
    /// A gone object is detected again.
    Returned {
        /// The object.
        object: ObjectId,
    },
    /// The frame contradicts the map, because none of the expected objects is detected. It does not change the map.
    Disagrees {
        /// Number of expected objects.
        expected: usize,
    },
    /// Poses, cameras and boxes of the last frames contradict each other, and so does a tenth of all frames.
    Inconsistent {
        /// What explains it.
        diagnosis: Box<Diagnosis>,
    },
}

/// What [`super::ObjectMap::observe`] found.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct FrameUpdate {
    /// For each detection of the frame, its object; `None` where it belongs to none so far.
    pub objects: Vec<Option<ObjectId>>,
    /// What happened, in the order in which it happened.
    pub events: Vec<Event>,
}
