//! What must hold for every map, and all numbers of a map, for tests.

use std::collections::BTreeMap;

use super::map::ObjectMap;
use super::update::ObjectId;

impl ObjectMap {
    /// All that determines what the map does, as text.
    pub(super) fn numbers(&self) -> String {
        let sources = (&self.cue_sources, &self.scaled_by_frame);
        let names = (self.categories.names(), sources, &self.input_ids, &self.tally);
        let frames = (self.next_key, &self.last, &self.origin, &self.keyframes, &self.recent, &self.windows);
        let objects = (&self.slots, &self.aliases, self.indexed_range, self.next_id, &self.tried_pairs);
        format!("{:?}", (names, frames, objects, &self.running, self.disagreeing, &self.diagnosis))
    }

    /// Panics if references or counts are wrong.
    pub(super) fn assert_sound(&self) {
        let mut held: BTreeMap<u32, u32> = BTreeMap::new();
        for view in self.tracked().flat_map(|tracked| &tracked.views) {
            *held.entry(view.keyframe).or_default() += 1;
        }
        for frame in self.recent.iter().chain(self.windows.all()) {
            *held.entry(frame.key).or_default() += 1;
        }
        let references: BTreeMap<u32, u32> = self.keyframes.iter().map(|(key, k)| (key, k.references)).collect();
        assert_eq!(held, references);
        let views: usize = self.tracked().map(|tracked| tracked.views.len() + tracked.object.forgotten).sum();
        assert_eq!(self.running.assigned, views as i64);
        let mut repeats: BTreeMap<ObjectId, u32> = BTreeMap::new();
        for found in self.recent.iter().flat_map(|frame| &frame.boxes) {
            found.owner.into_iter().for_each(|id| *repeats.entry(id).or_default() += found.repeats());
        }
        let (categories, sources) = (self.categories.names().len(), self.cue_sources.len());
        for tracked in self.tracked() {
            let known = repeats.get(&tracked.id).copied().unwrap_or(0);
            assert!(tracked.repeated >= known, "{} {known}", tracked.repeated);
            assert!(tracked.is_valid(categories, sources));
        }
        assert_eq!(self.free_slots.len() + self.slot_of_id.len(), self.slots.len());
        assert!(self.free_slots.iter().all(|&slot| self.slot(slot).is_none()));
    }
}
