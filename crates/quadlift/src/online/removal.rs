//! Objects that leave the map.

use super::memory::Memory;
use super::recent_frames::set_owner;
use super::tracked::{Presence, Tracked};
use super::update::{Event, FrameUpdate, ObjectId, Removal};

/// If there are too many objects, one in so many is forgotten at once.
const FORGOTTEN_PART: usize = 100;

/// Removes an object; its detections have none then.
pub(super) fn remove_slot(memory: &mut Memory, slot: u32, reason: Removal, update: &mut FrameUpdate) {
    let Some(tracked) = memory.objects.take(slot) else { return };
    memory.running.assigned -= tracked.object.views() as i64;
    for view in &tracked.views {
        set_owner(&mut memory.recent, view, None);
        memory.keyframes.release(view.keyframe);
    }
    for object in &mut update.objects {
        if *object == Some(tracked.id) {
            *object = None;
        }
    }
    update.events.push(Event::Removed { object: tracked.id, reason });
}

/// Removes objects if there are more than [`super::OnlineOptions::max_objects`]; never the newest one.
pub(super) fn forget_beyond_limit(memory: &mut Memory, newest: ObjectId, update: &mut FrameUpdate) {
    let most = memory.options.max_objects;
    if memory.objects.len() <= most {
        return;
    }
    let rank = |t: &Tracked| {
        let kind = match t.presence {
            Presence::Tentative => 0,
            Presence::Gone => 1,
            Presence::Confirmed => 2,
        };
        (kind, t.last_keyframe, t.id)
    };
    let mut ranks: Vec<_> = memory.objects.tracked().filter(|t| t.id != newest).map(rank).collect();
    ranks.sort_unstable();
    // Some at once, so that the list need not be made for every new object.
    let count = (memory.objects.len() - most).max(most / FORGOTTEN_PART);
    for (.., id) in ranks.into_iter().take(count) {
        if let Some(slot) = memory.objects.slot_of(id) {
            remove_slot(memory, slot, Removal::Forgotten, update);
        }
    }
}
