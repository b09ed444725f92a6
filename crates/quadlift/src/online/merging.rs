//! Merges objects that are one.

use super::current::Seen;
use super::memory::Memory;
use super::objects::Objects;
use super::own_views::forget_views;
use super::recent_frames::{detections_of, set_owner};
use super::removal::remove_slot;
use super::tracked::{Presence, Tracked};
use super::update::{DetectionRef, Event, FrameUpdate, ObjectId, Removal};
use super::views::KeptView;
use crate::association::score::evidence::evidence;
use crate::association::score::fit::{Start, fit};
use crate::association::search::nested::{FEWER_VIEWS, SAME_PLACE, SAME_SIZE, within};
use crate::sorting::StableSort;

/// Objects are tried as one when their centers are nearer than this many times the sum of their radii.
pub(super) const NEAR: f64 = 1.2;

/// Maximum fraction of the smaller object's frames in which both have a box.
const SHARED_FRAMES: f64 = 0.5;

/// A refused pair is tried again when the number of views of either has grown by this factor.
const TRIED_AGAIN: f64 = 1.3;

/// Pairs that are remembered; more are tried again.
const MAX_TRIED: usize = 100_000;

/// Tries objects as one whose predictions overlap in the frame.
pub(super) fn merge_overlapping(memory: &mut Memory, seen: &[Seen], update: &mut FrameUpdate) {
    let mut order: Vec<&Seen> = seen.iter().collect();
    order.stable_sort_by(|a, b| a.prediction.edges[0].total_cmp(&b.prediction.edges[0]).then(a.slot.cmp(&b.slot)));
    for (place, first) in order.iter().enumerate() {
        for second in &order[place + 1..] {
            let (a, b) = (&first.prediction.edges, &second.prediction.edges);
            if b[0] > a[2] {
                break;
            }
            if b[1] <= a[3] && a[1] <= b[3] {
                try_as_one(memory, first.slot, second.slot, update);
            }
        }
    }
}

/// Two objects with their slots, the older one first.
fn by_age(objects: &Objects, first: u32, second: u32) -> Option<[(u32, &Tracked); 2]> {
    let (a, b) = (objects.get(first)?, objects.get(second)?);
    Some(if a.id < b.id { [(first, a), (second, b)] } else { [(second, b), (first, a)] })
}

/// Tries two objects as one.
pub(super) fn try_as_one(memory: &mut Memory, first: u32, second: u32, update: &mut FrameUpdate) {
    let Some([(older_slot, a), (younger_slot, b)]) = by_age(&memory.objects, first, second) else { return };
    if a.object.category != b.object.category {
        return;
    }
    let distance = (a.object.center - b.object.center).norm();
    if distance >= NEAR * (a.object.radius + b.object.radius) {
        return;
    }
    let key = (a.id.0, b.id.0);
    let views = (a.object.views(), b.object.views());
    if let Some(tried) = memory.tried_pairs.get(&key)
        && (views.0 as f64) < TRIED_AGAIN * tried.0 as f64
        && (views.1 as f64) < TRIED_AGAIN * tried.1 as f64
    {
        return;
    }
    if let Some(union) = union(memory, a, b, false) {
        merge_into(memory, older_slot, younger_slot, union, update);
    } else if let Some(weaker) = nested(a, b) {
        let slot = if weaker == a.id { older_slot } else { younger_slot };
        remove_slot(memory, slot, Removal::Nested, update);
    } else {
        if memory.tried_pairs.len() >= MAX_TRIED {
            memory.tried_pairs.clear();
        }
        memory.tried_pairs.insert(key, views);
    }
}

/// Merges two objects, whatever the evidence says; `false` where no body fits both.
pub(super) fn merge_by_force(memory: &mut Memory, first: u32, second: u32) -> bool {
    let Some([(older_slot, older), (younger_slot, younger)]) = by_age(&memory.objects, first, second) else {
        return false;
    };
    let Some(union) = union(memory, older, younger, true) else { return false };
    merge_into(memory, older_slot, younger_slot, union, &mut FrameUpdate::default());
    true
}

/// Both as one, where that has more evidence than they have apart, or where it is certain.
fn union(memory: &Memory, older: &Tracked, younger: &Tracked, certain: bool) -> Option<Tracked> {
    let (major, minor) =
        if older.object.views() >= younger.object.views() { (older, younger) } else { (younger, older) };
    let is_new = |keyframe: u32| !major.is_seen_in(keyframe);
    let new = minor.views.iter().filter(|v| is_new(v.keyframe)).count();
    let shared = minor.views.len() - new;
    if !certain && shared as f64 > SHARED_FRAMES * minor.views.len().min(major.views.len()) as f64 {
        return None;
    }
    let mut union = major.clone();
    for view in minor.views.iter().filter(|v| is_new(v.keyframe)) {
        union.add_view(view.clone(), None);
    }
    let (observations, statistics) = memory.gather(&union.views);
    let starts = [Start::body(&major.object), Start::body(&minor.object)];
    let fitted = fit(&observations, &statistics, union.object.boxes.clone(), &starts)?;
    // Where both were in the map both should have been seen in the same frames.
    let misses = |t: &Tracked| t.object.visible.saturating_sub(t.object.views());
    union.object.forgotten += minor.object.forgotten;
    union.object.visible = (union.object.views() + misses(older).saturating_sub(minor.object.views()))
        .max(older.object.visible)
        .max(younger.object.visible);
    union.replace_fit(fitted);
    let together = evidence(&memory.rate, &observations, &statistics, &union.object);
    (certain || together > memory.evidence_of(major) + memory.evidence_of(minor)).then_some(union)
}

/// Puts the union in the place of the older object; the younger one becomes an alias.
fn merge_into(memory: &mut Memory, older: u32, younger: u32, mut union: Tracked, update: &mut FrameUpdate) {
    let (Some(old), Some(young)) = (memory.objects.get(older).cloned(), memory.objects.get(younger).cloned()) else {
        return;
    };
    // Of two boxes in one frame one is clutter.
    let lost: Vec<&KeptView> =
        old.views.iter().chain(&young.views).filter(|view| !union.views.iter().any(|v| v.is_same(view))).collect();
    memory.running.assigned -= lost.len() as i64;
    let detections: Vec<DetectionRef> =
        lost.iter().flat_map(|view| detections_of(&memory.recent, &memory.keyframes, view)).collect();
    let of_lost = lost.into_iter().map(|view| set_owner(&mut memory.recent, view, None)).fold(0, u32::saturating_add);
    union.repeated = old.repeated.saturating_add(young.repeated).saturating_sub(of_lost);
    for view in &union.views {
        memory.keyframes.hold(view.keyframe);
    }
    for view in old.views.iter().chain(&young.views) {
        memory.keyframes.release(view.keyframe);
    }
    for &(id, _) in &young.input_ids {
        let count = memory.objects.tally.forget(id, younger);
        memory.objects.tally.count(id, older, count);
    }
    memory.objects.take(younger);
    for view in &union.views {
        set_owner(&mut memory.recent, view, Some(old.id));
    }
    union.id = old.id;
    union.presence = match (old.presence, young.presence) {
        (Presence::Confirmed, _) | (_, Presence::Confirmed) => Presence::Confirmed,
        (Presence::Gone, _) | (_, Presence::Gone) => Presence::Gone,
        _ => Presence::Tentative,
    };
    union.log_odds = old.log_odds.max(young.log_odds);
    union.first_time = old.first_time.min(young.first_time);
    union.last_time = old.last_time.max(young.last_time);
    union.last_keyframe = old.last_keyframe.max(young.last_keyframe);
    union.categories = old.categories.clone();
    for &(category, count) in &young.categories {
        union.count_category(category, count);
    }
    union.input_ids = old.input_ids.clone();
    for &(id, count) in &young.input_ids {
        union.count_id(Some(id), count);
    }
    memory.objects.add_alias(young.id, old.id);
    for object in &mut update.objects {
        if *object == Some(young.id) {
            *object = Some(old.id);
        }
    }
    memory.objects.give_back(older, Box::new(union));
    forget_views(memory, older);
    memory.objects.index(older);
    update.events.push(Event::Merged { object: old.id, alias: young.id });
    if !detections.is_empty() {
        update.events.push(Event::Reassigned { object: None, detections });
    }
}

/// The weaker of two alike objects in one place, where it has much fewer views: detectors report one object twice.
fn nested(a: &Tracked, b: &Tracked) -> Option<ObjectId> {
    let apart = within(&a.object, &b.object.center).max(within(&b.object, &a.object.center));
    if apart >= SAME_PLACE || (a.object.radius / b.object.radius).ln().abs() >= SAME_SIZE {
        return None;
    }
    let (few, many) = if a.object.views() <= b.object.views() { (a, b) } else { (b, a) };
    let is_weak = (few.object.views() as f64) < FEWER_VIEWS * many.object.views() as f64;
    (is_weak && many.presence == Presence::Confirmed).then_some(few.id)
}
