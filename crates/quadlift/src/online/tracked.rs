//! An object of the map.

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
    /// It was there, but is no longer detected in clear views.
    Gone,
}

impl Presence {
    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tentative => "tentative",
            Self::Confirmed => "confirmed",
            Self::Gone => "gone",
        }
    }
}

/// Log odds that an object that was just detected is still there in the next frame.
pub(super) const DETECTED_LOG_ODDS: f64 = 6.9;

/// An object of the map.
#[derive(Debug, Clone)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub(super) struct Tracked {
    pub id: ObjectId,
    /// The fit; its boxes are indices into `views`.
    pub object: Object,
    /// Kept views in the order of their frames.
    pub views: Vec<KeptView>,
    /// Number of views at the last fit, including forgotten ones.
    pub fitted_views: usize,
    /// Number of detections that repeat a view from the same place.
    pub repeated: u32,
    /// Number of its detections in each category, by index.
    pub categories: Vec<(u16, u32)>,
    /// Input ids of its detections, with counts.
    pub input_ids: Vec<(u32, u32)>,
    pub presence: Presence,
    /// Log odds that it is there.
    pub log_odds: f64,
    /// Clear views since it was confirmed, and those with a detection.
    pub clear: u32,
    pub clear_detected: u32,
    pub first_time: f64,
    pub last_time: f64,
    /// Key of the frame of the last detection.
    pub last_keyframe: u32,
}

/// Number of views for which places are reserved at a time.
const GROWTH: usize = 8;

/// Upper bound of counts in a state, so that counting on does not overflow.
#[cfg(any(feature = "serde", test))]
const MAX_STORED_COUNT: u32 = u32::MAX / 2;

/// Maximum number of input ids that are remembered per object.
const MAX_INPUT_IDS: usize = 32;

impl Tracked {
    /// An object without views, seen between two times.
    pub(super) fn new(id: ObjectId, object: Object, [first_time, last_time]: [f64; 2]) -> Self {
        Self {
            id,
            object,
            views: Vec::new(),
            fitted_views: 0,
            repeated: 0,
            categories: Vec::new(),
            input_ids: Vec::new(),
            presence: Presence::Tentative,
            log_odds: 0.0,
            clear: 0,
            clear_detected: 0,
            first_time,
            last_time,
            last_keyframe: 0,
        }
    }

    /// Adds to the count of a category.
    pub(super) fn count_category(&mut self, category: u16, times: u32) {
        match self.categories.iter_mut().find(|(known, _)| *known == category) {
            Some((_, count)) => *count = count.saturating_add(times),
            None => self.categories.push((category, times)),
        }
    }

    /// Counts detections that add no view.
    pub(super) fn repeat(&mut self, category: u16, times: u32) {
        self.repeated = self.repeated.saturating_add(times);
        self.count_category(category, times);
    }

    /// Adds to the count of an id.
    pub(super) fn count_id(&mut self, input_id: Option<u32>, times: u32) {
        let Some(id) = input_id else { return };
        if let Some((_, count)) = self.input_ids.iter_mut().find(|(known, _)| *known == id) {
            *count = count.saturating_add(times);
        } else if self.input_ids.len() < MAX_INPUT_IDS {
            self.input_ids.push((id, times));
        }
    }

    /// Removes a detection that was repeated so often from the counts.
    pub(super) fn uncount(&mut self, view: &KeptView, input_id: Option<u32>, repeats: u32) {
        self.repeated = self.repeated.saturating_sub(repeats);
        if let Some((_, count)) = self.input_ids.iter_mut().find(|(known, _)| Some(*known) == input_id) {
            *count = count.saturating_sub(1);
        }
        if let Some((_, count)) = self.categories.iter_mut().find(|(known, _)| *known == view.category) {
            *count = count.saturating_sub(1 + repeats);
        }
    }

    /// Adds a view in the order of frames, without a fit.
    pub(super) fn add_view(&mut self, view: KeptView, input_id: Option<u32>) {
        self.count_category(view.category, 1);
        self.count_id(input_id, 1);
        self.last_keyframe = self.last_keyframe.max(view.keyframe);
        let place = self.views.partition_point(|v| v.keyframe < view.keyframe);
        if self.views.len() == self.views.capacity() {
            // Doubling would leave up to half of the places empty for good.
            self.views.reserve_exact(GROWTH);
        }
        self.views.insert(place, view);
        self.renumber();
    }

    /// Removes a view.
    pub(super) fn take_view(&mut self, place: usize) -> KeptView {
        let view = self.views.remove(place);
        self.renumber();
        view
    }

    /// Replaces the fit.
    pub(super) fn replace_fit(&mut self, fitted: Object) {
        let Object { forgotten, visible, trusted_id, .. } = self.object;
        self.object = Object { forgotten, visible, trusted_id, ..fitted };
        self.fitted_views = self.object.views();
    }

    /// Whether it has a kept view of a frame.
    pub(super) fn is_seen_in(&self, keyframe: u32) -> bool {
        self.views.binary_search_by_key(&keyframe, |v| v.keyframe).is_ok()
    }

    /// Whether what was stored can be used in a map with so many categories and sources of cues.
    #[cfg(any(feature = "serde", test))]
    pub(super) fn is_valid(&self, categories: usize, cue_sources: usize) -> bool {
        let object = &self.object;
        let shape = object.center.iter().chain(&object.root).chain(&object.covariance);
        let counts = [object.visible, object.forgotten, self.fitted_views];
        shape.chain(&[self.first_time, self.last_time]).all(|x| x.is_finite())
            && object.radius > 0.0
            && object.radius.is_finite()
            && object.category < categories
            && self.categories.iter().all(|&(category, _)| usize::from(category) < categories)
            && self.views.len() >= 2
            && self.views.is_sorted_by(|a, b| a.keyframe < b.keyframe)
            && self.views.iter().all(|view| view.is_valid(categories, cue_sources))
            // Counting goes on.
            && counts.iter().all(|&n| n < MAX_STORED_COUNT as usize)
            && [self.clear, self.clear_detected].iter().all(|&n| n < MAX_STORED_COUNT)
    }

    /// Numbers the boxes of the fit by the views.
    pub(super) fn renumber(&mut self) {
        let count = self.views.len() as u32;
        self.object.boxes.clear();
        self.object.boxes.reserve_exact(self.views.capacity());
        self.object.boxes.extend(0..count);
    }
}
