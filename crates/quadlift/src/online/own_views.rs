//! The views of an object: how they come, go and are forgotten.

use super::memory::Memory;
use super::removal::remove_slot;
use super::summary::absorb;
use super::update::{FrameUpdate, ObjectId, Removal};
use super::views::{KeptView, most_redundant_pair};
use crate::association::score::fit::Start;

/// Removes a view that was repeated so often from its object.
pub(super) fn take_back(memory: &mut Memory, slot: u32, view: &KeptView, input_id: Option<u32>, repeats: u32) {
    let Some(tracked) = memory.objects.get_mut(slot) else { return };
    let Some(place) = tracked.views.iter().position(|v| v.keyframe == view.keyframe) else { return };
    let taken = tracked.take_view(place);
    tracked.uncount(&taken, input_id, repeats);
    memory.running.assigned -= 1;
    memory.keyframes.release(taken.keyframe);
    if let Some(id) = input_id {
        memory.objects.tally.uncount(id, slot);
    }
}

/// Adds a view of an earlier frame, which was repeated so often, to an object.
pub(super) fn add_late(
    memory: &mut Memory,
    slot: u32,
    view: KeptView,
    input_id: Option<u32>,
    repeats: u32,
) -> Option<ObjectId> {
    let key = view.keyframe;
    let tracked = memory.objects.get_mut(slot)?;
    let id = tracked.id;
    tracked.repeat(view.category, repeats);
    tracked.add_view(view, input_id);
    tracked.object.visible = tracked.object.visible.max(tracked.object.views());
    memory.running.assigned += 1;
    memory.keyframes.hold(key);
    if let Some(input_id) = input_id {
        memory.objects.tally.count(input_id, slot, 1);
    }
    Some(id)
}

/// Forgets views of an object until it has at most [`super::OnlineOptions::max_views`].
pub(super) fn forget_views(memory: &mut Memory, slot: u32) {
    let (most, keyframes, statistics) = (memory.options.max_views, &mut memory.keyframes, &memory.running.statistics);
    let Some(tracked) = memory.objects.get_mut(slot) else { return };
    while tracked.views.len() > most {
        let (place, like_it) = most_redundant_pair(&tracked.views, keyframes, &tracked.object.center);
        let of = |place: usize| keyframes.get(tracked.views[place].keyframe);
        if let (Some(others), Some(own)) = (of(place), of(like_it)) {
            let mut standing = tracked.views[like_it].clone();
            absorb(&mut standing, &own.camera, &tracked.views[place], others, &tracked.object, statistics);
            tracked.views[like_it] = standing;
        }
        let forgotten = tracked.take_view(place);
        tracked.object.forgotten += 1;
        keyframes.release(forgotten.keyframe);
    }
}

/// Refits an object; one with too few views is removed.
pub(super) fn refit(memory: &mut Memory, slot: u32, update: &mut FrameUpdate) {
    forget_views(memory, slot);
    let Some(tracked) = memory.objects.get(slot) else { return };
    if tracked.views.len() < 2 {
        remove_slot(memory, slot, Removal::Weak, update);
        return;
    }
    let fitted = memory.fit_views(tracked, &[Start::body(&tracked.object)]);
    if let (Some(fitted), Some(tracked)) = (fitted, memory.objects.get_mut(slot)) {
        tracked.replace_fit(fitted);
        memory.objects.index(slot);
    }
}
