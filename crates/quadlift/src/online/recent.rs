//! Assigns the boxes of the last frames again, when the objects are known better.

use super::current::Current;
use super::map::ObjectMap;
use super::update::{Event, FrameUpdate, ObjectId, Removal};
use super::views::{KeptView, RecentBox, RecentFrame, to_bits};
use crate::association::input::observations::{BoxObservation, Camera};
use crate::association::score::fit::Start;
use crate::association::score::log_likelihood_ratio::LogLikelihoodRatio;

/// Number of last frames whose boxes may still be reassigned.
pub(super) const WINDOW: usize = 24;

/// Ages, in frames, at which the boxes of a frame are assigned again.
const LOOKS: [usize; 3] = [3, 10, WINDOW];

/// A box to reassign: its index in the frame, the slots before and after.
struct Change {
    index: usize,
    from: Option<u32>,
    to: Option<(u32, LogLikelihoodRatio)>,
}

impl ObjectMap {
    /// Assigns the boxes of all recent frames again and checks them, for the end of a stream. It takes about as long as observing that
    /// many frames.
    pub fn settle(&mut self) -> FrameUpdate {
        let mut update = FrameUpdate::default();
        self.recent_again(&mut update);
        self.check_at_end(&mut update);
        update
    }

    /// Assigns the boxes of all recent frames again.
    pub(super) fn recent_again(&mut self, update: &mut FrameUpdate) {
        for recent in 0..self.recent.len() {
            self.look_again(recent, update);
        }
    }

    /// Assigns the frames of the ages [`LOOKS`] again, and drops the oldest one.
    pub(super) fn look_back_at_frames(&mut self, update: &mut FrameUpdate) {
        let newest = self.recent.len().saturating_sub(1);
        for lag in LOOKS {
            if let Some(recent) = newest.checked_sub(lag) {
                self.look_again(recent, update);
            }
        }
        while self.recent.len() > WINDOW {
            if let Some(old) = self.recent.pop_front() {
                self.keep_for_check(old);
            }
        }
    }

    /// Sets the object of a box in its frame, if the frame is recent; returns how often the box was repeated.
    pub(super) fn set_owner(&mut self, view: &KeptView, owner: Option<ObjectId>) -> u32 {
        let place = self.recent.partition_point(|frame| frame.key < view.keyframe);
        let Some(frame) = self.recent.get_mut(place).filter(|frame| frame.key == view.keyframe) else { return 0 };
        let Some(found) = frame.boxes.iter_mut().find(|b| b.view.detection == view.detection) else { return 0 };
        found.owner = owner;
        found.repeats()
    }

    /// Assigns the boxes of a recent frame again.
    fn look_again(&mut self, recent: usize, update: &mut FrameUpdate) {
        let nothing = RecentFrame { boxes: Vec::new(), ..self.recent[recent] };
        let mut frame = std::mem::replace(&mut self.recent[recent], nothing);
        self.assign_again(&mut frame, update);
        // Objects that were removed in between could not say so to a frame that was not there.
        for found in &mut frame.boxes {
            found.owner = found.owner.filter(|id| self.slot_of_id.contains_key(id));
        }
        self.recent[recent] = frame;
    }

    /// Assigns boxes of a frame again.
    pub(super) fn assign_again(&mut self, frame: &mut RecentFrame, update: &mut FrameUpdate) {
        let Some(changes) = self.changes(frame) else { return };
        let mut changed: Vec<u32> = Vec::new();
        for change in &changes {
            let Some(slot) = change.from else { continue };
            let found = &frame.boxes[change.index];
            self.take_back(slot, &found.view, found.input_id, found.repeats());
            changed.push(slot);
        }
        for change in &changes {
            let mut owner = None;
            if let Some((slot, ratio)) = change.to {
                let found = &frame.boxes[change.index];
                let view = KeptView { hidden: to_bits(ratio.hidden), ..found.view.clone() };
                owner = self.add_late(slot, view, found.input_id, found.repeats());
                changed.push(slot);
            }
            frame.boxes[change.index].owner = owner;
            // The frame is not among the recent ones now.
            let RecentBox { view, copies, .. } = &frame.boxes[change.index];
            let detections = self.detection_of(view).into_iter().chain(copies.iter().cloned()).collect();
            update.events.push(Event::Reassigned { object: owner, detections });
        }
        changed.sort_unstable();
        changed.dedup();
        for slot in changed {
            self.refit(slot, update);
            if let Some(tracked) = self.slot_mut(slot) {
                tracked.first_time = tracked.first_time.min(frame.time);
                tracked.last_keyframe = tracked.last_keyframe.max(frame.key);
                self.after_detection(slot, update);
            }
        }
    }

    /// Boxes of a frame whose best assignment differs from the current one.
    fn changes(&mut self, frame: &RecentFrame) -> Option<Vec<Change>> {
        let keyframe = self.keyframes.get(frame.key)?;
        let (camera, shift, noise) = (keyframe.camera.clone(), keyframe.shift, keyframe.frame.pose_noise);
        let mut observations = self.no_observations();
        let observation = |b: &RecentBox| BoxObservation { id: b.input_id, ..b.view.observation(0, &shift) };
        observations.boxes = frame.boxes.iter().map(observation).collect();
        observations.cameras.push(Camera { boxes: 0..frame.boxes.len(), ..camera.clone() });
        let slot_of = |id: &ObjectId| self.slot_of_id.get(&self.resolve(*id)).copied();
        let owners: Vec<Option<u32>> = frame.boxes.iter().map(|b| b.owner.as_ref().and_then(slot_of)).collect();
        // A box whose view has been forgotten stays where it is, and its object takes no other of the frame.
        let is_fixed =
            |index: usize| owners[index].and_then(|slot| self.slot(slot)).is_some_and(|t| !t.is_seen_in(frame.key));
        let fixed: Vec<u32> = (0..owners.len()).filter(|&k| is_fixed(k)).filter_map(|k| owners[k]).collect();
        let free = (0..owners.len() as u32).filter(|&k| !is_fixed(k as usize)).collect();
        let mut current =
            Current { key: frame.key, time: frame.time, observations, views: Vec::new(), input_ids: Vec::new(), free };
        let slots: Vec<u32> =
            self.visibility.near(&camera.center).into_iter().filter(|slot| !fixed.contains(slot)).collect();
        // Objects that were uncertain then say now where the frame's boxes should be.
        let (matched, _) = self.match_boxes(&mut current, &slots, noise, &|index| owners[index as usize]);
        let mut new: Vec<Option<(u32, LogLikelihoodRatio)>> = vec![None; owners.len()];
        for &(slot, index, ratio) in &matched.pairs {
            new[index as usize] = Some((slot, ratio));
        }
        let differs = |&index: &u32| new[index as usize].map(|(slot, _)| slot) != owners[index as usize];
        let change =
            |index: u32| Change { index: index as usize, from: owners[index as usize], to: new[index as usize] };
        Some(current.free.iter().copied().filter(differs).map(change).collect())
    }

    /// Removes a view that was repeated so often from its object.
    pub(super) fn take_back(&mut self, slot: u32, view: &KeptView, input_id: Option<u32>, repeats: u32) {
        let Some(tracked) = self.slot_mut(slot) else { return };
        let Some(place) = tracked.views.iter().position(|v| v.keyframe == view.keyframe) else { return };
        let taken = tracked.take_view(place);
        tracked.uncount(&taken, input_id);
        tracked.unrepeat(taken.category, repeats);
        self.running.assigned -= 1;
        self.keyframes.release(taken.keyframe);
        if let Some(id) = input_id {
            self.tally.uncount(id, slot);
        }
    }

    /// Adds a view of an earlier frame, which was repeated so often, to an object.
    pub(super) fn add_late(
        &mut self,
        slot: u32,
        view: KeptView,
        input_id: Option<u32>,
        repeats: u32,
    ) -> Option<ObjectId> {
        let key = view.keyframe;
        let tracked = self.slot_mut(slot)?;
        let id = tracked.id;
        tracked.repeat(view.category, repeats);
        tracked.add_view(view, input_id);
        tracked.object.visible = tracked.object.visible.max(tracked.object.views());
        self.running.assigned += 1;
        self.keyframes.hold(key);
        if let Some(input_id) = input_id {
            self.tally.count(input_id, slot, 1);
        }
        Some(id)
    }

    /// Refits an object; one with too few views is removed.
    pub(super) fn refit(&mut self, slot: u32, update: &mut FrameUpdate) {
        self.forget_views(slot);
        let Some(tracked) = self.slot(slot) else { return };
        if tracked.views.len() < 2 {
            self.remove_slot(slot, Removal::Weak, update);
            return;
        }
        let fitted = self.fit_views(tracked, &[Start::body(&tracked.object)]);
        if let (Some(fitted), Some(tracked)) = (fitted, self.slot_mut(slot)) {
            tracked.replace_fit(fitted);
            self.index(slot);
        }
    }
}
