//! States of an object: evidence confirms it, clear views without a detection count against it.

use std::collections::{HashMap, HashSet};

use super::current::{Current, Matched, Seen};
use super::memory::Memory;
use super::objects::Objects;
use super::removal::remove_slot;
use super::running::Running;
use super::tracked::{DETECTED_LOG_ODDS, Presence, Tracked};
use super::update::{Event, FrameUpdate, Removal};
use super::views::KeptView;
use crate::association::input::observations::BoxObservation;
use crate::association::search::growth::MAX_MISSES;
use crate::optimize::median::quantile;
use crate::tuning::CLEAR;

/// Log odds below which an object is gone. With [`DETECTED_LOG_ODDS`] a detector that misses one object in five
/// must miss it eight times in a row: by chance once in 400,000 views.
const GONE_LOG_ODDS: f64 = -5.5;

/// What a detection adds to the log odds of a gone object. Two detections bring it back, because one may be clutter.
const RETURN_LOG_ODDS: f64 = 4.0;

/// An object is clearly in view if at least this share of its predicted box is inside the image,
const CLEAR_SHARE: f64 = 0.7;
/// and the box is this many times larger than the smallest that a detector is expected to find,
const CLEAR_SIZE: f64 = 1.5;
/// or than the boxes in which it was detected before.
const USUAL_SIZE: f64 = 0.8;

/// Maximum covered share of the views from which the detection rate is estimated.
const MAX_COVERED: f64 = 0.2;

/// Weight of the map's detection rate beside the object's own, in views.
const SHARE_WEIGHT: f64 = 4.0;

/// Range of the detection rate in clear views.
const SHARE_RANGE: [f64; 2] = [0.05, 0.97];

/// Minimum number of expected detections for a contradiction, and the log probability that none occurs.
const MIN_EXPECTED: usize = 3;
const DISAGREES_BELOW: f64 = -12.0;

/// The number of expected objects, if the frame contradicts the map because none of them is detected.
pub(super) fn disagreement(objects: &Objects, running: &Running, matched: &Matched, boxes: usize) -> Option<usize> {
    if boxes == 0 {
        return None;
    }
    let is_matched = |seen: &Seen| matched.pairs.iter().any(|(slot, ..)| *slot == seen.slot);
    let confirmed = |seen: &&Seen| objects.get(seen.slot).is_some_and(|t| t.presence == Presence::Confirmed);
    let (mut expected, mut log_probability) = (0, 0.0);
    for seen in matched.seen.iter().filter(confirmed) {
        if is_matched(seen) {
            return None;
        }
        if let Some(tracked) = objects.get(seen.slot) {
            expected += 1;
            log_probability += (1.0 - share_of(running, tracked)).ln();
        }
    }
    (expected >= MIN_EXPECTED && log_probability < DISAGREES_BELOW).then_some(expected)
}

/// Probability that an object is detected in a clear view.
fn share_of(running: &Running, tracked: &Tracked) -> f64 {
    let usual = running.detection_share();
    let own = f64::from(tracked.clear_detected) + SHARE_WEIGHT * usual;
    (own / (f64::from(tracked.clear) + SHARE_WEIGHT)).clamp(SHARE_RANGE[0], SHARE_RANGE[1])
}

/// Updates the objects of a frame with their detections and misses.
pub(super) fn after_matching(
    memory: &mut Memory,
    current: &Current,
    matched: &Matched,
    taken: &[(u32, u32)],
    update: &mut FrameUpdate,
) {
    for &(slot, _) in taken {
        after_detection(memory, slot, update);
    }
    let detected: HashSet<u32> = taken.iter().map(|(slot, _)| *slot).collect();
    let depth_of_slot: HashMap<u32, f64> = matched.seen.iter().map(|s| (s.slot, s.prediction.depth)).collect();
    let mut depths = vec![None; current.observations.boxes.len()];
    for (slot, index, _) in &matched.pairs {
        depths[*index as usize] = depth_of_slot.get(slot).copied();
    }
    for seen in &matched.seen {
        let is_detected = detected.contains(&seen.slot);
        // Its own box covers it where it is detected; what else does was no hindrance then.
        let visible_share = match covered_share(current, &depths, seen, || usual_half_size(&memory.objects, seen.slot))
        {
            None => 0.0,
            Some(_) if is_detected => 1.0,
            Some(covered) => 1.0 - covered,
        };
        if visible_share >= 1.0 - MAX_COVERED {
            count_clear_view(&mut memory.objects, &mut memory.running, seen.slot, is_detected);
        }
        if !is_detected {
            after_miss(memory, seen.slot, visible_share, update);
        }
    }
}

/// Median half size of an object's kept boxes, pixels; infinite without any.
fn usual_half_size(objects: &Objects, slot: u32) -> f64 {
    let half_size = |view: &KeptView| {
        let [x0, y0, x1, y1] = view.edges.map(f64::from);
        0.25 * (x1 - x0 + y1 - y0)
    };
    let mut sizes: Vec<f64> = objects.get(slot).map_or(Vec::new(), |t| t.views.iter().map(half_size).collect());
    quantile(&mut sizes, 0.5).unwrap_or(f64::INFINITY)
}

fn count_clear_view(objects: &mut Objects, running: &mut Running, slot: u32, detected: bool) {
    let Some(tracked) = objects.get_mut(slot).filter(|t| t.presence == Presence::Confirmed) else { return };
    tracked.clear += 1;
    tracked.clear_detected += u32::from(detected);
    running.clear += 1.0;
    running.clear_detected += f64::from(u8::from(detected));
}

pub(super) fn after_detection(memory: &mut Memory, slot: u32, update: &mut FrameUpdate) {
    let Some(tracked) = memory.objects.get(slot) else { return };
    let id = tracked.id;
    let confirms = tracked.presence == Presence::Tentative
        && tracked.object.views() >= memory.options.min_views
        && memory.evidence_of(tracked) > CLEAR;
    let Some(tracked) = memory.objects.get_mut(slot) else { return };
    match tracked.presence {
        Presence::Tentative if confirms => {
            tracked.presence = Presence::Confirmed;
            tracked.log_odds = DETECTED_LOG_ODDS;
            update.events.push(Event::Confirmed { object: id });
        }
        Presence::Tentative => (),
        Presence::Confirmed => tracked.log_odds = DETECTED_LOG_ODDS,
        Presence::Gone => {
            tracked.log_odds += RETURN_LOG_ODDS;
            if tracked.log_odds > 0.0 {
                tracked.presence = Presence::Confirmed;
                tracked.log_odds = DETECTED_LOG_ODDS;
                update.events.push(Event::Returned { object: id });
            }
        }
    }
}

fn after_miss(memory: &mut Memory, slot: u32, visible_share: f64, update: &mut FrameUpdate) {
    let Some(tracked) = memory.objects.get(slot) else { return };
    let id = tracked.id;
    let views = tracked.object.views();
    let misses = tracked.object.visible.saturating_sub(views);
    let weak = match tracked.presence {
        // More often than detected, too.
        Presence::Tentative => misses > MAX_MISSES.max(views),
        // Many misses speak against a weak object, wherever they come from.
        Presence::Confirmed => misses.is_multiple_of(MAX_MISSES) && memory.evidence_of(tracked) <= CLEAR,
        Presence::Gone => false,
    };
    if weak {
        remove_slot(memory, slot, Removal::Weak, update);
        return;
    }
    if visible_share == 0.0 || tracked.presence == Presence::Tentative {
        return;
    }
    // Things that are half hidden are detected much less often (ours).
    let share = share_of(&memory.running, tracked) * visible_share * visible_share;
    let Some(tracked) = memory.objects.get_mut(slot) else { return };
    tracked.log_odds += (1.0 - share).ln();
    if tracked.presence == Presence::Gone {
        tracked.log_odds = tracked.log_odds.max(GONE_LOG_ODDS);
    } else if tracked.log_odds < GONE_LOG_ODDS {
        tracked.log_odds = GONE_LOG_ODDS;
        tracked.presence = Presence::Gone;
        update.events.push(Event::Removed { object: id, reason: Removal::Gone });
    }
}

/// The share of an object's predicted box that the box of a nearer object or an unassigned box covers; `None` where a detection is not
/// expected. `depths` are the depths of the objects of the boxes, if assigned.
fn covered_share(current: &Current, depths: &[Option<f64>], seen: &Seen, usual_size: impl Fn() -> f64) -> Option<f64> {
    let prediction = &seen.prediction;
    let camera = &current.observations.cameras[0];
    let [x0, y0, x1, y1] = prediction.edges;
    let [w, h] = prediction.size();
    let inside = (x1.min(camera.size.x) - x0.max(0.0)).max(0.0) * (y1.min(camera.size.y) - y0.max(0.0)).max(0.0);
    let half_size = 0.25 * (w + h);
    let is_large =
        || half_size >= CLEAR_SIZE * current.observations.least_half_size || half_size >= USUAL_SIZE * usual_size();
    if inside < CLEAR_SHARE * w * h || !is_large() {
        return None;
    }
    let covers = |(depth, b): (&Option<f64>, &BoxObservation)| {
        let [bx0, by0, bx1, by1] = b.edges;
        let covered = (x1.min(bx1) - x0.max(bx0)).max(0.0) * (y1.min(by1) - y0.max(by0)).max(0.0) / (w * h);
        if depth.is_some_and(|depth| depth >= prediction.depth) { 0.0 } else { covered }
    };
    let covered = depths.iter().zip(&current.observations.boxes).map(covers).fold(0.0, f64::max);
    Some(covered.min(1.0))
}

#[cfg(test)]
#[path = "lifecycle_tests.rs"]
mod tests;
