//! The last frames, whose boxes may still be reassigned.

use std::collections::VecDeque;

use super::MAX_DETECTIONS;
use super::keyframes::Keyframes;
use super::update::{DetectionRef, ObjectId};
use super::views::KeptView;
use crate::scene::places::MIN_SEEN;

/// Detections that are remembered for a box, at most.
const MAX_COPIES: usize = 5000;

/// A frame whose boxes may still be reassigned.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct RecentFrame {
    pub key: u32,
    pub time: f64,
    pub boxes: Vec<RecentBox>,
    /// Number of frames from the same place after it.
    #[cfg_attr(feature = "serde", serde(default))]
    pub repeats: u32,
}

/// A box with its object.
#[derive(Debug, Clone, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct RecentBox {
    pub view: KeptView,
    /// Input id of the detection.
    pub input_id: Option<u32>,
    pub owner: Option<ObjectId>,
    /// The same box in frames from the same place.
    #[cfg_attr(feature = "serde", serde(default, skip_serializing_if = "Vec::is_empty"))]
    pub copies: Vec<DetectionRef>,
}

impl RecentFrame {
    /// Whether a box may be one of a new object: it has none, and it is there in enough frames from the place.
    pub(super) fn is_free(&self, index: usize) -> bool {
        let found = &self.boxes[index];
        found.owner.is_none()
            && (found.copies.len() + 1) as f64 >= MIN_SEEN * f64::from(self.repeats.min(MAX_COPIES as u32))
    }

    /// Forgets what the consistency check does not use.
    pub(super) fn forget_extras(&mut self) {
        for RecentBox { view, copies, .. } in &mut self.boxes {
            (view.shape, view.cues, view.absorbed) = (None, None, None);
            *copies = Vec::new();
        }
    }

    /// Whether what was stored can be used in a map with so many categories and sources of cues.
    #[cfg(feature = "serde")]
    pub(super) fn is_valid(&self, categories: usize, cue_sources: usize) -> bool {
        let is_valid = |view: &KeptView| view.keyframe == self.key && view.is_valid(categories, cue_sources);
        self.boxes.iter().all(|found| is_valid(&found.view))
    }
}

impl RecentBox {
    /// Remembers a detection of the same thing from the same place.
    pub(super) fn remember(&mut self, detection: DetectionRef) {
        if self.copies.len() < MAX_COPIES {
            self.copies.push(detection);
        }
    }

    /// Number of its detections beside the first.
    pub(super) fn repeats(&self) -> u32 {
        // A view that stands for detections from its place alone has a number that no detection has.
        let own = usize::from(usize::from(self.view.detection) < MAX_DETECTIONS);
        (own + self.copies.len()).saturating_sub(1) as u32
    }
}

/// Sets the object of a box in its frame, if the frame is recent; returns how often the box was repeated.
pub(super) fn set_owner(recent: &mut VecDeque<RecentFrame>, view: &KeptView, owner: Option<ObjectId>) -> u32 {
    let place = recent.partition_point(|frame| frame.key < view.keyframe);
    let Some(frame) = recent.get_mut(place).filter(|frame| frame.key == view.keyframe) else { return 0 };
    let Some(found) = frame.boxes.iter_mut().find(|b| b.view.detection == view.detection) else { return 0 };
    found.owner = owner;
    found.repeats()
}

/// The detection of a view; `None` of one that stands for others from its place alone.
pub(super) fn detection_of(keyframes: &Keyframes, view: &KeptView) -> Option<DetectionRef> {
    if usize::from(view.detection) >= MAX_DETECTIONS {
        return None;
    }
    let frame = keyframes.get(view.keyframe)?.frame.id.clone();
    Some(DetectionRef { frame, detection: view.detection as usize })
}

/// The detections of a view: its own, and those from the same place.
pub(super) fn detections_of(
    recent: &VecDeque<RecentFrame>,
    keyframes: &Keyframes,
    view: &KeptView,
) -> Vec<DetectionRef> {
    let own = detection_of(keyframes, view);
    let place = recent.partition_point(|frame| frame.key < view.keyframe);
    let frame = recent.get(place).filter(|frame| frame.key == view.keyframe);
    let known = frame.and_then(|frame| frame.boxes.iter().find(|b| b.view.detection == view.detection));
    own.into_iter().chain(known.map_or_else(Vec::new, |known| known.copies.clone())).collect()
}
