//! An object as the map keeps it.

use super::update::ObjectId;
use super::views::KeptView;
use crate::association::score::object::Object;

/// How certain the map is of an object.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Presence {
    /// Its detections may still be clutter.
    Tentative,
    /// It is there.
    Confirmed,
    /// It was there, and is not detected any more where it should be.
    Gone,
}

/// Logarithm of the odds that an object that has just been detected is still there in the next frame.
pub(super) const DETECTED_LOG_ODDS: f64 = 6.9;

/// An object of the map.
#[derive(Debug, Clone)]
pub(super) struct Tracked {
    pub id: ObjectId,
    /// The fit; its boxes are the places of `views`.
    pub object: Object,
    /// Kept views in the order of their frames.
    pub views: Vec<KeptView>,
    /// Number of views, with the forgotten ones, at the last fit.
    pub fitted_views: usize,
    /// Number of its detections in each category, by index.
    pub categories: Vec<(u16, u32)>,
    /// Ids that its detections came with, and how many of each.
    pub input_ids: Vec<(u32, u32)>,
    pub presence: Presence,
    /// Logarithm of the odds that it is there.
    pub log_odds: f64,
    /// Views in which it could be seen clearly since it was confirmed, and in how many of them it was detected.
    pub clear: u32,
    pub clear_detected: u32,
    /// Clear views without a detection since the last one.
    pub missed: u32,
    pub first_time: f64,
    pub last_time: f64,
    /// Key of the frame of the last detection.
    pub last_keyframe: u32,
}

/// Distinct input ids that are remembered of an object.
const MAX_INPUT_IDS: usize = 32;

impl Tracked {
    /// An object of no views yet, seen between two instants.
    pub fn new(id: ObjectId, object: Object, [first_time, last_time]: [f64; 2]) -> Self {
        Self {
            id,
            object,
            views: Vec::new(),
            fitted_views: 0,
            categories: Vec::new(),
            input_ids: Vec::new(),
            presence: Presence::Tentative,
            log_odds: 0.0,
            clear: 0,
            clear_detected: 0,
            missed: 0,
            first_time,
            last_time,
            last_keyframe: 0,
        }
    }

    /// Counts the category and the id of a detection.
    fn count(&mut self, view: &KeptView, input_id: Option<u32>) {
        match self.categories.iter_mut().find(|(category, _)| *category == view.category) {
            Some((_, count)) => *count += 1,
            None => self.categories.push((view.category, 1)),
        }
        self.count_id(input_id, 1);
    }

    /// Counts an id, so many times.
    pub fn count_id(&mut self, input_id: Option<u32>, times: u32) {
        let Some(id) = input_id else { return };
        if let Some((_, count)) = self.input_ids.iter_mut().find(|(known, _)| *known == id) {
            *count += times;
        } else if self.input_ids.len() < MAX_INPUT_IDS {
            self.input_ids.push((id, times));
        }
    }

    /// Takes a detection off the counts of categories and ids.
    pub fn uncount(&mut self, view: &KeptView, input_id: Option<u32>) {
        if let Some((_, count)) = self.input_ids.iter_mut().find(|(known, _)| Some(*known) == input_id) {
            *count = count.saturating_sub(1);
        }
        if let Some((_, count)) = self.categories.iter_mut().find(|(category, _)| *category == view.category) {
            *count = count.saturating_sub(1);
        }
    }

    /// Puts a view where its frame belongs. The fit does not know of it yet.
    pub fn add_view(&mut self, view: KeptView, input_id: Option<u32>) {
        self.count(&view, input_id);
        self.last_keyframe = self.last_keyframe.max(view.keyframe);
        let place = self.views.partition_point(|v| v.keyframe < view.keyframe);
        self.views.insert(place, view);
        self.renumber();
    }

    /// Takes a view out.
    pub fn take_view(&mut self, place: usize) -> KeptView {
        let view = self.views.remove(place);
        self.renumber();
        view
    }

    /// A fit in place of the old one.
    pub fn replace_fit(&mut self, fitted: Object) {
        let Object { forgotten, visible, trusted_id, .. } = self.object;
        self.object = Object { forgotten, visible, trusted_id, ..fitted };
        self.fitted_views = self.object.views();
    }

    /// Whether it has a view of a frame; only of those that are kept.
    pub fn is_seen_in(&self, keyframe: u32) -> bool {
        self.views.binary_search_by_key(&keyframe, |v| v.keyframe).is_ok()
    }

    fn renumber(&mut self) {
        let count = self.views.len() as u32;
        self.object.boxes.clear();
        self.object.boxes.extend(0..count);
    }
}
