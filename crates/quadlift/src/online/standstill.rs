//! Frames from one place: a camera that waits sees the same view again, which is one view however often it is seen.
//!
//! Copies have no parallax: an object of two boxes from one place could be anywhere on its ray, and its evidence would grow with every
//! copy. A frame from the place of a recent one therefore adds nothing but means: its boxes are averaged into the views from there. Boxes
//! of no object are collected, and get the object that is found once the camera moves.
//!
//! Distances of objects tell which motion is none. Before there are objects the image does: poses of a camera that waits differ by the
//! errors of its GPS, and any two boxes that these errors set apart agree on an object somewhere on their rays.

use nalgebra::Vector2;

use super::MAX_DETECTIONS;
use super::current::{Current, Matched};
use super::input::Frame;
use super::keyframes::{Keyframe, Keyframes};
use super::lifecycle::after_matching;
use super::memory::Memory;
use super::objects::Objects;
use super::own_views::{add_late, forget_views};
use super::recent_frames::{RecentBox, RecentFrame, detection_of};
use super::summary::absorb;
use super::tracked::Presence;
use super::update::FrameUpdate;
use super::views::{KeptView, from_bits, to_bits};
use super::windows::Windows;
use crate::association::input::observations::Camera;
use crate::association::score::scene_statistics::SceneStatistics;
use crate::geometry::BoundingBox;
use crate::optimize::matching::{Pair, greedy_pairs};
use crate::optimize::median::quantile;
use crate::scene::NewDetection;
use crate::scene::places::{MAX_MOTION_PX, MAX_ROUNDING, MIN_OVERLAP, turn_px};

/// Errors alone leave the larger mean square of both axes below this in three of five boxes, and the median of many boxes at 1.23.
const MAX_AXIS_CHI2: f64 = 1.47;

/// Boxes of a place, at most: false ones come with every frame.
const MAX_BOXES: usize = 2000;

/// The key of a recent frame from the place of a new one.
pub(super) fn same_place(memory: &Memory, frame: &Frame, detections: &[NewDetection]) -> Option<u32> {
    let new = Keyframe::camera_of(frame, &memory.origin, memory.running.extent.into());
    let distance = |slot: u32| memory.objects.get(slot).map(|tracked| (tracked.object.center - new.center).norm());
    let near = memory.objects.near(&new.center);
    let is_confirmed =
        |&slot: &u32| memory.objects.get(slot).is_some_and(|tracked| tracked.presence == Presence::Confirmed);
    let is_mapped = near.iter().any(is_confirmed);
    let nearest = near.into_iter().filter_map(distance).reduce(f64::min);
    let tolerance = match nearest {
        Some(distance) => MAX_MOTION_PX * distance / new.focal.max(1e-9),
        None => MAX_ROUNDING * (1.0 + new.center.norm()),
    };
    let is_there = |recent: &&RecentFrame| {
        memory.keyframes.camera(recent.key).is_some_and(|known| {
            (known.center - new.center).norm() <= tolerance
                && turn_px(&known.matrix, &new.matrix, &known.size) <= MAX_MOTION_PX
        })
    };
    let known = memory.recent.iter().rev().find(is_there);
    let still = || {
        let boxes = detections.iter().filter_map(|d| Some((memory.categories.find(d.category)?, d.box_or_around()?)));
        let last = memory.recent.back().filter(|_| !is_mapped)?;
        // Of a camera that drives, a car that drives before it may be all there is to see.
        let small = memory.windows.small_step();
        let stays = small == 0.0 || (memory.keyframes.camera(last.key)?.center - new.center).norm() < small;
        stays.then_some(())?;
        is_still(&memory.keyframes, &memory.running.statistics, last, &new, &boxes.collect::<Vec<_>>()).then_some(last)
    };
    known.or_else(still).map(|recent| recent.key)
}

/// Whether most boxes of an image, with their categories, are where they were in a frame before, within their errors.
fn is_still(
    keyframes: &Keyframes,
    statistics: &SceneStatistics,
    before: &RecentFrame,
    camera: &Camera,
    boxes: &[(u16, BoundingBox)],
) -> bool {
    // A camera that looks at the same thing from elsewhere has turned.
    let max_turn = 2.0 * statistics.edge_noise_px;
    if keyframes.camera(before.key).is_none_or(|known| turn_px(&known.matrix, &camera.matrix, &known.size) > max_turn) {
        return false;
    }
    let mut pairs = Vec::new();
    for (row, RecentBox { view, .. }) in before.boxes.iter().enumerate() {
        let Some(known) = view.box_in_image() else { continue };
        for (column, (_, new)) in boxes.iter().enumerate().filter(|(_, (category, _))| *category == view.category) {
            pairs.push(Pair { row: row as u32, column: column as u32, gain: known.iou(new) });
        }
    }
    pairs.retain(|pair| pair.gain >= MIN_OVERLAP);
    let motion =
        |pair: Pair| axis_chi2(statistics, &before.boxes[pair.row as usize].view, &boxes[pair.column as usize].1);
    let mut motions: Vec<f64> = greedy_pairs(&pairs).into_iter().filter_map(|k| motion(pairs[k])).collect();
    // Most move by no more than is expected of errors alone.
    2 * motions.len() >= before.boxes.len().min(boxes.len())
        && quantile(&mut motions, 0.5).is_some_and(|chi2| chi2 <= MAX_AXIS_CHI2)
}

/// The mean square of the differences of edges in units of their variance, along the image axis with the larger one;
/// `None` if the border cuts all of them.
fn axis_chi2(statistics: &SceneStatistics, view: &KeptView, new: &BoundingBox) -> Option<f64> {
    let variance = 2.0 * statistics.sd(&view.observation(0, &Vector2::zeros())).powi(2);
    let (known, new, cut) = (view.box_in_image()?.edges(), new.edges(), from_bits(view.cut));
    let along = |edges: [usize; 2]| {
        let whole: Vec<usize> = edges.into_iter().filter(|&edge| !cut[edge]).collect();
        let sum: f64 = whole.iter().map(|&edge| (known[edge] - new[edge]).powi(2) / variance).sum();
        (!whole.is_empty()).then(|| sum / whole.len() as f64)
    };
    // Most cameras move sideways: the mean of both axes would halve that.
    along([0, 2]).into_iter().chain(along([1, 3])).reduce(f64::max)
}

/// The frames, without those from the place of the one before: with the same image, or moved by much less than is usual.
pub(super) fn of_different_places(
    keyframes: &Keyframes,
    statistics: &SceneStatistics,
    windows: &Windows,
    frames: Vec<RecentFrame>,
) -> Vec<RecentFrame> {
    let least = windows.small_step();
    let mut kept: Vec<RecentFrame> = Vec::with_capacity(frames.len());
    for frame in frames {
        let boxes = frame.boxes.iter().filter_map(|b| Some((b.view.category, b.view.box_in_image()?)));
        let boxes: Vec<_> = boxes.collect();
        let is_there = |last: &RecentFrame| {
            let cameras = keyframes.camera(last.key).zip(keyframes.camera(frame.key));
            cameras.is_some_and(|(a, b)| {
                (b.center - a.center).norm() < least || is_still(keyframes, statistics, last, b, &boxes)
            })
        };
        if !kept.last().is_some_and(is_there) {
            kept.push(frame);
        }
    }
    kept
}

/// Takes the boxes of a frame from the place of a recent one.
pub(super) fn repeat(memory: &mut Memory, place: u32, current: &Current, matched: &Matched, update: &mut FrameUpdate) {
    let Some(index) = memory.recent.iter().position(|recent| recent.key == place) else { return };
    memory.recent[index].repeats = memory.recent[index].repeats.saturating_add(1);
    // What was seen there before tells more than a body, which may still be uncertain.
    let mut pairs = seen_before(&memory.objects, &memory.recent[index], current);
    for &(slot, box_index, ratio) in &matched.pairs {
        let is_taken = pairs.iter().any(|&(known, other, _)| known == slot || other == box_index);
        // An object that was seen there is not somewhere else.
        if !is_taken && !memory.objects.get(slot).is_some_and(|tracked| tracked.is_seen_in(place)) {
            pairs.push((slot, box_index, to_bits(ratio.hidden)));
        }
    }
    let mut taken = Vec::with_capacity(pairs.len());
    for (slot, box_index, hidden) in pairs {
        let view = KeptView { hidden, ..current.views[box_index as usize].clone() };
        if let Some(id) = memory.objects.get(slot).map(|tracked| tracked.id) {
            update.objects[usize::from(view.detection)] = Some(id);
            taken.push((slot, box_index));
            repeat_view(memory, slot, index, current, box_index, view);
        }
    }
    for box_index in 0..current.views.len() as u32 {
        if taken.iter().any(|(_, other)| *other == box_index) {
            continue;
        }
        repeat_loose(&memory.keyframes, &mut memory.recent[index], current, box_index);
    }
    after_matching(memory, current, matched, &taken, update);
}

/// A box of an object: averaged into the view from there, or the view from there.
fn repeat_view(memory: &mut Memory, slot: u32, recent: usize, current: &Current, index: u32, view: KeptView) {
    let place = memory.recent[recent].key;
    let input_id = current.input_ids[index as usize];
    let Some(tracked) = memory.objects.get(slot) else { return };
    let known = tracked.views.iter().position(|known| known.keyframe == place);
    if let Some(known) = known {
        let mut standing = tracked.views[known].clone();
        if let (Some(own), Some(others)) = (memory.keyframes.camera(place), memory.keyframes.get(current.key)) {
            absorb(&mut standing, own, &view, others, &tracked.object, &memory.running.statistics);
        }
        // Another object may take them, if this one turns out to be none.
        let (detection, copy) = (standing.detection, detection_of(&memory.keyframes, &view));
        let of_view = memory.recent[recent].boxes.iter_mut().find(|found| found.view.detection == detection);
        if let Some((found, copy)) = of_view.zip(copy) {
            found.remember(copy);
        }
        if let Some(tracked) = memory.objects.get_mut(slot) {
            tracked.views[known] = standing;
            tracked.repeat(view.category, 1);
            tracked.count_id(input_id, 1);
            tracked.last_time = current.time;
        }
        if let Some(id) = input_id {
            memory.objects.tally.count(id, slot, 1);
        }
    } else if let (copy, Some(view)) = (detection_of(&memory.keyframes, &view), view_from(&memory.recent[recent], view))
    {
        let owner = add_late(memory, slot, view.clone(), input_id, 0);
        memory.recent[recent].boxes.push(RecentBox { view, input_id, owner, copies: copy.into_iter().collect() });
        if let Some(tracked) = memory.objects.get_mut(slot) {
            tracked.last_time = current.time;
        }
        forget_views(memory, slot);
    }
}

/// The objects of boxes that overlap one from there, the best overlaps first: slots, boxes, and which edges were hidden.
fn seen_before(objects: &Objects, frame: &RecentFrame, current: &Current) -> Vec<(u32, u32, u8)> {
    let (mut pairs, mut hidden) = (Vec::new(), Vec::new());
    for known in &frame.boxes {
        let slot = known.owner.and_then(|id| objects.slot_of(objects.resolve(id)));
        let Some(slot) = slot else { continue };
        for (index, view) in current.views.iter().enumerate().filter(|(_, v)| v.category == known.view.category) {
            let shared = overlap(&known.view, view);
            if shared >= MIN_OVERLAP {
                pairs.push(Pair { row: slot, column: index as u32, gain: shared });
                hidden.push(known.view.hidden);
            }
        }
    }
    greedy_pairs(&pairs).into_iter().map(|k| (pairs[k].row, pairs[k].column, hidden[k])).collect()
}

/// A box without an object: a copy of one from there, or another one.
fn repeat_loose(keyframes: &Keyframes, frame: &mut RecentFrame, current: &Current, index: u32) {
    let view = &current.views[index as usize];
    let Some(detection) = detection_of(keyframes, view) else { return };
    let overlap = |known: &RecentBox| {
        let is_same = known.view.category == view.category;
        if is_same { overlap(&known.view, view) } else { 0.0 }
    };
    let boxes = &frame.boxes;
    let best = (0..boxes.len()).max_by(|&a, &b| overlap(&boxes[a]).total_cmp(&overlap(&boxes[b])).then(b.cmp(&a)));
    if let Some(best) = best.filter(|&best| overlap(&boxes[best]) >= MIN_OVERLAP) {
        let known = &mut frame.boxes[best];
        known.remember(detection);
    } else if let Some(view) = view_from(frame, view.clone()) {
        let input_id = current.input_ids[index as usize];
        frame.boxes.push(RecentBox { view, input_id, owner: None, copies: vec![detection] });
    }
}

/// A box as one of the frame that was first at its place, with a number that no detection has.
fn view_from(frame: &RecentFrame, view: KeptView) -> Option<KeptView> {
    let last = frame.boxes.iter().map(|known| usize::from(known.view.detection)).max().unwrap_or_default();
    let detection = u16::try_from((last + 1).max(MAX_DETECTIONS)).ok().filter(|_| frame.boxes.len() < MAX_BOXES)?;
    Some(KeptView { keyframe: frame.key, detection, ..view })
}

/// Intersection over union of the boxes of two views.
fn overlap(a: &KeptView, b: &KeptView) -> f64 {
    a.bounding_box().zip(b.bounding_box()).map_or(0.0, |(a, b)| a.iou(&b))
}

#[cfg(test)]
#[path = "standstill_tests.rs"]
mod tests;
