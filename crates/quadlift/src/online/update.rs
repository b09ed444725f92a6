//! What a frame has changed in an object map.

/// Id of an object of a map: 1, 2, ... in the order in which objects came up. Ids are never used again.
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
    /// It was not detected in clear views: it is gone. The map keeps it and finds it again where it returns.
    Gone,
    /// Its detections are better explained by clutter; they belong to no object any more.
    Weak,
    /// It is inside of a like object that has more detections.
    Nested,
    /// The map keeps [`super::OnlineOptions::max_objects`] objects only.
    Forgotten,
    /// The user removed it.
    User,
}

/// What happened to an object.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// An object came up from two detections or more. It is not certain yet.
    New {
        /// The object.
        object: ObjectId,
        /// Its detections of earlier frames; that of this frame is in [`FrameUpdate::objects`].
        detections: Vec<DetectionRef>,
    },
    /// There is enough evidence for an object.
    Confirmed {
        /// The object.
        object: ObjectId,
    },
    /// Detections of earlier frames turned out to be of an object, or of none.
    Reassigned {
        /// The object; `None` where they are clutter.
        object: Option<ObjectId>,
        /// The detections.
        detections: Vec<DetectionRef>,
    },
    /// Two objects turned out to be one. The older id stays.
    Merged {
        /// The object that stays.
        object: ObjectId,
        /// The id that is an alias of it from now on.
        alias: ObjectId,
    },
    /// An object left the map, or is gone.
    Removed {
        /// The object.
        object: ObjectId,
        /// Why.
        reason: Removal,
    },
    /// An object that was gone is detected again.
    Returned {
        /// The object.
        object: ObjectId,
    },
    /// The frame contradicts the map: of the objects that should be seen, none is detected. It changes nothing but what it says
    /// itself.
    Disagrees {
        /// Number of objects that should be seen.
        expected: usize,
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
