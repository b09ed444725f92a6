//! Assigns the boxes of the last frames again, when the objects are known better.

use super::current::Current;
use super::lifecycle::after_detection;
use super::matching::match_boxes;
use super::memory::Memory;
use super::own_views::{add_late, refit, take_back};
use super::recent_frames::{RecentBox, RecentFrame, detection_of};
use super::update::{Event, FrameUpdate, ObjectId};
use super::views::{KeptView, to_bits};
use crate::association::input::observations::{BoxObservation, Camera};
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

/// Assigns the boxes of all recent frames again.
pub(super) fn recent_again(memory: &mut Memory, update: &mut FrameUpdate) {
    for recent in 0..memory.recent.len() {
        look_again(memory, recent, update);
    }
}

/// Assigns the frames of the ages [`LOOKS`] again, and drops the oldest one.
pub(super) fn look_back_at_frames(memory: &mut Memory, update: &mut FrameUpdate) {
    let newest = memory.recent.len().saturating_sub(1);
    for lag in LOOKS {
        if let Some(recent) = newest.checked_sub(lag) {
            look_again(memory, recent, update);
        }
    }
    while memory.recent.len() > WINDOW {
        if let Some(old) = memory.recent.pop_front() {
            memory.windows.keep(old);
        }
    }
}

/// Assigns the boxes of a recent frame again.
fn look_again(memory: &mut Memory, recent: usize, update: &mut FrameUpdate) {
    let nothing = RecentFrame { boxes: Vec::new(), ..memory.recent[recent] };
    let mut frame = std::mem::replace(&mut memory.recent[recent], nothing);
    assign_again(memory, &mut frame, update);
    // Objects that were removed in between could not say so to a frame that was not there.
    for found in &mut frame.boxes {
        found.owner = found.owner.filter(|id| memory.objects.has(*id));
    }
    memory.recent[recent] = frame;
}

/// Assigns boxes of a frame again.
pub(super) fn assign_again(memory: &mut Memory, frame: &mut RecentFrame, update: &mut FrameUpdate) {
    let Some(changes) = changes(memory, frame) else { return };
    let mut changed: Vec<u32> = Vec::new();
    for change in &changes {
        let Some(slot) = change.from else { continue };
        let found = &frame.boxes[change.index];
        take_back(memory, slot, &found.view, found.input_id, found.repeats());
        changed.push(slot);
    }
    for change in &changes {
        let mut owner = None;
        if let Some((slot, ratio)) = change.to {
            let found = &frame.boxes[change.index];
            let view = KeptView { hidden: to_bits(ratio.hidden), ..found.view.clone() };
            owner = add_late(memory, slot, view, found.input_id, found.repeats());
            changed.push(slot);
        }
        frame.boxes[change.index].owner = owner;
        // The frame is not among the recent ones now.
        let RecentBox { view, copies, .. } = &frame.boxes[change.index];
        let detections = detection_of(&memory.keyframes, view).into_iter().chain(copies.iter().cloned()).collect();
        update.events.push(Event::Reassigned { object: owner, detections });
    }
    changed.sort_unstable();
    changed.dedup();
    for slot in changed {
        refit(memory, slot, update);
        if let Some(tracked) = memory.objects.get_mut(slot) {
            tracked.first_time = tracked.first_time.min(frame.time);
            tracked.last_keyframe = tracked.last_keyframe.max(frame.key);
            after_detection(memory, slot, update);
        }
    }
}

/// Boxes of a frame whose best assignment differs from the current one.
fn changes(memory: &mut Memory, frame: &RecentFrame) -> Option<Vec<Change>> {
    let keyframe = memory.keyframes.get(frame.key)?;
    let (camera, shift, noise) = (keyframe.camera.clone(), keyframe.shift, keyframe.frame.pose_noise);
    let mut observations = memory.no_observations();
    let observation = |b: &RecentBox| BoxObservation { id: b.input_id, ..b.view.observation(0, &shift) };
    observations.boxes = frame.boxes.iter().map(observation).collect();
    observations.cameras.push(Camera { boxes: 0..frame.boxes.len(), ..camera.clone() });
    let slot_of = |id: &ObjectId| memory.objects.slot_of(memory.objects.resolve(*id));
    let owners: Vec<Option<u32>> = frame.boxes.iter().map(|b| b.owner.as_ref().and_then(slot_of)).collect();
    // A box whose view has been forgotten stays where it is, and its object takes no other of the frame.
    let is_fixed = |index: usize| {
        owners[index].and_then(|slot| memory.objects.get(slot)).is_some_and(|t| !t.is_seen_in(frame.key))
    };
    let fixed: Vec<u32> = (0..owners.len()).filter(|&k| is_fixed(k)).filter_map(|k| owners[k]).collect();
    let free = (0..owners.len() as u32).filter(|&k| !is_fixed(k as usize)).collect();
    let mut current =
        Current { key: frame.key, time: frame.time, observations, views: Vec::new(), input_ids: Vec::new(), free };
    let slots: Vec<u32> =
        memory.objects.near(&camera.center).into_iter().filter(|slot| !fixed.contains(slot)).collect();
    // Objects that were uncertain then say now where the frame's boxes should be.
    let (matched, _) = match_boxes(memory, &mut current, &slots, noise, &|index| owners[index as usize]);
    let mut new: Vec<Option<(u32, LogLikelihoodRatio)>> = vec![None; owners.len()];
    for &(slot, index, ratio) in &matched.pairs {
        new[index as usize] = Some((slot, ratio));
    }
    let differs = |&index: &u32| new[index as usize].map(|(slot, _)| slot) != owners[index as usize];
    let change = |index: u32| Change { index: index as usize, from: owners[index as usize], to: new[index as usize] };
    Some(current.free.iter().copied().filter(differs).map(change).collect())
}
