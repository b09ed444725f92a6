//! A line of the output: what a frame has changed in the map.

use quadlift::diagnosis::{CauseName, Diagnosis};
use quadlift::online::{DetectionRef, Event, FrameUpdate, ObjectId, Removal};
use quadlift::run::Check;
use serde::Serialize;

use super::line::LineError;
use crate::diagnosis::{Context, DiagnosisRecord};

/// A line of the output. Members that are `None` are left out.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct OutputLine {
    /// Number of the input line, from 1, where it was not taken.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<u64>,
    /// Id of the frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<String>,
    /// For each detection of the frame, the id of its object; `null` where it belongs to none so far.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub objects: Option<Vec<Option<String>>>,
    /// Number of new poses of frames that the map keeps.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub poses: Option<usize>,
    /// Number of frames that were observed, at the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<u64>,
    /// What happened, in this order.
    pub events: Vec<EventRecord>,
}

/// What happened to an object, or what is wrong with the input.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub enum EventRecord {
    /// An object came up from two detections or more.
    New {
        /// The object.
        object: String,
        /// Its detections of earlier frames.
        detections: Vec<DetectionRecord>,
    },
    /// There is enough evidence for an object.
    Confirmed {
        /// The object.
        object: String,
    },
    /// Detections of earlier frames turned out to be of an object, or of none.
    Reassigned {
        /// The object; `null` where they are clutter.
        object: Option<String>,
        /// The detections.
        detections: Vec<DetectionRecord>,
    },
    /// Two objects turned out to be one.
    Merged {
        /// The object that stays.
        object: String,
        /// The id that means the same object from now on.
        alias: String,
    },
    /// An object left the map, or is gone.
    Removed {
        /// The object.
        object: String,
        /// Why.
        reason: &'static str,
    },
    /// An object that was gone is detected again.
    Returned {
        /// The object.
        object: String,
    },
    /// The frame contradicts the map and changes nothing: of the objects that should be seen, none is detected.
    Disagrees {
        /// Number of objects that should be seen.
        expected: usize,
    },
    /// Poses, cameras and boxes contradict each other.
    Inconsistent {
        /// What explains it, in words.
        message: String,
        /// The causes, the best first.
        causes: Vec<CauseName>,
    },
    /// An event that this version does not know.
    Other,
    /// The line or the frame was not taken.
    Error {
        /// What is wrong.
        message: String,
        /// Column of the line in bytes, from 1, where it is known.
        #[serde(skip_serializing_if = "Option::is_none")]
        column: Option<usize>,
    },
}

/// A detection of an earlier frame.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DetectionRecord {
    /// Id of the frame.
    pub frame: String,
    /// Index of the detection in the frame.
    pub detection: usize,
}

impl From<&DetectionRef> for DetectionRecord {
    fn from(detection: &DetectionRef) -> Self {
        Self { frame: detection.frame.clone(), detection: detection.detection }
    }
}

impl From<&Event> for EventRecord {
    fn from(event: &Event) -> Self {
        let id = |object: &ObjectId| object.to_string();
        let records = |detections: &[DetectionRef]| detections.iter().map(DetectionRecord::from).collect();
        match event {
            Event::New { object, detections } => Self::New { object: id(object), detections: records(detections) },
            Event::Confirmed { object } => Self::Confirmed { object: id(object) },
            Event::Reassigned { object, detections } => {
                Self::Reassigned { object: object.as_ref().map(id), detections: records(detections) }
            }
            Event::Merged { object, alias } => Self::Merged { object: id(object), alias: id(alias) },
            Event::Removed { object, reason } => Self::Removed { object: id(object), reason: reason_name(*reason) },
            Event::Returned { object } => Self::Returned { object: id(object) },
            Event::Disagrees { expected } => Self::Disagrees { expected: *expected },
            Event::Inconsistent { diagnosis } => {
                let causes = diagnosis.causes.iter().map(|cause| cause.name).collect();
                Self::Inconsistent { message: inconsistency_in_words(diagnosis), causes }
            }
            _ => Self::Other,
        }
    }
}

/// Why frames of a stream are inconsistent. Options that correct it are those of other commands.
pub fn inconsistency_in_words(diagnosis: &Diagnosis) -> String {
    let check = Check { diagnosis: diagnosis.clone(), ..Check::default() };
    DiagnosisRecord::of(&check, &Context::default()).of_map_in_words().unwrap_or_default()
}

/// The name of a reason in the output.
fn reason_name(reason: Removal) -> &'static str {
    match reason {
        Removal::Gone => "gone",
        Removal::Weak => "weak",
        Removal::Nested => "nested",
        Removal::Forgotten => "forgotten",
        Removal::User => "user",
        _ => "other",
    }
}

impl OutputLine {
    /// The line of a frame that was observed.
    pub fn of_frame(frame: &str, update: &FrameUpdate) -> Self {
        let objects = update.objects.iter().map(|object| object.as_ref().map(ToString::to_string)).collect();
        Self { frame: Some(frame.to_owned()), objects: Some(objects), ..Self::of_events(update) }
    }

    /// The line of new poses of so many frames.
    pub fn of_poses(poses: usize, update: &FrameUpdate) -> Self {
        Self { poses: Some(poses), ..Self::of_events(update) }
    }

    /// The line of the end, after so many frames.
    pub fn of_end(frames: u64, update: &FrameUpdate) -> Self {
        Self { end: Some(frames), ..Self::of_events(update) }
    }

    /// The line of an error in an input line, or in a frame of a scene.
    pub fn of_error(line: Option<u64>, error: LineError) -> Self {
        let LineError { frame, column, message } = error;
        Self { line, frame, events: vec![EventRecord::Error { message, column }], ..Self::default() }
    }

    fn of_events(update: &FrameUpdate) -> Self {
        Self { events: update.events.iter().map(EventRecord::from).collect(), ..Self::default() }
    }

    /// The line as it is written, with its end.
    pub fn to_text(&self) -> String {
        // Texts and numbers alone: nothing that could fail.
        let mut text = serde_json::to_string(self).unwrap_or_default();
        text.push('\n');
        text
    }
}
