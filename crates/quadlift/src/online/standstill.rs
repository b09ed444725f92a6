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
use super::current::Current;
use super::input::Frame;
use super::keyframes::Keyframe;
use super::map::ObjectMap;
use super::matching::Matched;
use super::tracked::Presence;
use super::update::{DetectionRef, FrameUpdate};
use super::views::{KeptView, RecentBox, RecentFrame, from_bits, to_bits};
use crate::association::input::observations::Camera;
use crate::association::places::{MAX_MOTION_PX, MAX_ROUNDING, MIN_OVERLAP, MIN_SEEN, turn_px};
use crate::association::statistics::median;
use crate::geometry::BoundingBox;
use crate::scene::NewDetection;
use crate::sorting::StableSort;

/// Detections that are remembered for a box, at most.
const MAX_COPIES: usize = 5000;

/// Errors alone leave the larger mean square of both axes below this in three of five boxes, and the median of many boxes at 1.23.
const MAX_AXIS_CHI2: f64 = 1.47;

/// Boxes of a place, at most: false ones come with every frame.
const MAX_BOXES: usize = 2000;

impl RecentFrame {
    /// Whether a box may be one of a new object: it has none, and it is there in enough frames from the place.
    pub(super) fn is_free(&self, index: usize) -> bool {
        let found = &self.boxes[index];
        found.owner.is_none()
            && (found.copies.len() + 1) as f64 >= MIN_SEEN * f64::from(self.repeats.min(MAX_COPIES as u32))
    }
}

impl RecentBox {
    /// Remembers a detection of the same thing from the same place.
    fn remember(&mut self, detection: DetectionRef) {
        if self.copies.len() < MAX_COPIES {
            self.copies.push(detection);
        }
    }
}

impl ObjectMap {
    /// The key of a recent frame from the place of a new one.
    pub(super) fn same_place(&self, frame: &Frame, detections: &[NewDetection]) -> Option<u32> {
        let new = Keyframe::camera_of(frame, &self.origin, self.running.extent.into());
        let distance = |slot: u32| self.slot(slot).map(|tracked| (tracked.object.center - new.center).norm());
        let near = self.visibility.near(&new.center);
        let is_confirmed = |&slot: &u32| self.slot(slot).is_some_and(|tracked| tracked.presence == Presence::Confirmed);
        let is_mapped = near.iter().any(is_confirmed);
        let nearest = near.into_iter().filter_map(distance).reduce(f64::min);
        let tolerance = match nearest {
            Some(distance) => MAX_MOTION_PX * distance / new.focal.max(1e-9),
            None => MAX_ROUNDING * (1.0 + new.center.norm()),
        };
        let is_there = |recent: &&RecentFrame| {
            self.keyframes.camera(recent.key).is_some_and(|known| {
                (known.center - new.center).norm() <= tolerance && turn_px(known, &new) <= MAX_MOTION_PX
            })
        };
        let known = self.recent.iter().rev().find(is_there);
        let still = || {
            let boxes = detections.iter().filter_map(|d| Some((self.categories.find(d.category)?, d.box_or_around()?)));
            let last = self.recent.back().filter(|_| !is_mapped)?;
            // Of a camera that drives, a car that drives before it may be all there is to see.
            let small = self.windows.small_step();
            let stays = small == 0.0 || (self.keyframes.camera(last.key)?.center - new.center).norm() < small;
            stays.then_some(())?;
            self.is_still(last, &new, &boxes.collect::<Vec<_>>()).then_some(last)
        };
        known.or_else(still).map(|recent| recent.key)
    }

    /// Whether most boxes of an image, with their categories, are where they were in a frame before, within their errors.
    fn is_still(&self, before: &RecentFrame, camera: &Camera, boxes: &[(u16, BoundingBox)]) -> bool {
        // A camera that looks at the same thing from elsewhere has turned.
        let max_turn = 2.0 * self.running.statistics.edge_noise_px;
        if self.keyframes.camera(before.key).is_none_or(|known| turn_px(known, camera) > max_turn) {
            return false;
        }
        let mut pairs = Vec::new();
        for (place, RecentBox { view, .. }) in before.boxes.iter().enumerate() {
            let Some(known) = view.box_in_image() else { continue };
            for (index, (_, new)) in boxes.iter().enumerate().filter(|(_, (category, _))| *category == view.category) {
                pairs.push((known.iou(new), place, index));
            }
        }
        pairs.retain(|(overlap, ..)| *overlap >= MIN_OVERLAP);
        pairs.stable_sort_by(|a, b| b.0.total_cmp(&a.0));
        let (mut is_used, mut is_found) = (vec![false; before.boxes.len()], vec![false; boxes.len()]);
        let mut motions = Vec::new();
        for (_, place, index) in pairs {
            if is_used[place] || is_found[index] {
                continue;
            }
            (is_used[place], is_found[index]) = (true, true);
            motions.extend(self.axis_chi2(&before.boxes[place].view, &boxes[index].1));
        }
        // Most move by no more than is expected of errors alone.
        2 * motions.len() >= before.boxes.len().min(boxes.len())
            && median(&mut motions).is_some_and(|chi2| chi2 <= MAX_AXIS_CHI2)
    }

    /// The mean square of the differences of edges in units of their variance, along the image axis with the larger one;
    /// `None` if the border cuts all of them.
    fn axis_chi2(&self, view: &KeptView, new: &BoundingBox) -> Option<f64> {
        let variance = 2.0 * self.running.statistics.sd(&view.observation(0, &Vector2::zeros())).powi(2);
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
    pub(super) fn of_different_places(&self, frames: Vec<RecentFrame>) -> Vec<RecentFrame> {
        let least = self.windows.small_step();
        let mut kept: Vec<RecentFrame> = Vec::with_capacity(frames.len());
        for frame in frames {
            let boxes = frame.boxes.iter().filter_map(|b| Some((b.view.category, b.view.box_in_image()?)));
            let boxes: Vec<_> = boxes.collect();
            let is_there = |last: &RecentFrame| {
                let cameras = self.keyframes.camera(last.key).zip(self.keyframes.camera(frame.key));
                cameras.is_some_and(|(a, b)| (b.center - a.center).norm() < least || self.is_still(last, b, &boxes))
            };
            if !kept.last().is_some_and(is_there) {
                kept.push(frame);
            }
        }
        kept
    }

    /// Takes the boxes of a frame from the place of a recent one.
    pub(super) fn repeat(&mut self, place: u32, current: &Current, matched: &Matched, update: &mut FrameUpdate) {
        let Some(index) = self.recent.iter().position(|recent| recent.key == place) else { return };
        self.recent[index].repeats = self.recent[index].repeats.saturating_add(1);
        // What was seen there before tells more than a body, which may still be uncertain.
        let mut pairs = self.seen_before(index, current);
        for &(slot, box_index, ratio) in &matched.pairs {
            let is_taken = pairs.iter().any(|&(known, other, _)| known == slot || other == box_index);
            // An object that was seen there is not somewhere else.
            if !is_taken && !self.slot(slot).is_some_and(|tracked| tracked.is_seen_in(place)) {
                pairs.push((slot, box_index, to_bits(ratio.hidden)));
            }
        }
        let mut taken = Vec::with_capacity(pairs.len());
        for (slot, box_index, hidden) in pairs {
            let view = KeptView { hidden, ..current.views[box_index as usize].clone() };
            if let Some(id) = self.slot(slot).map(|tracked| tracked.id) {
                update.objects[usize::from(view.detection)] = Some(id);
                taken.push((slot, box_index));
                self.repeat_view(slot, index, current, box_index, view);
            }
        }
        for box_index in 0..current.views.len() as u32 {
            if taken.iter().any(|(_, other)| *other == box_index) {
                continue;
            }
            self.repeat_loose(index, current, box_index);
        }
        self.after_matching(current, matched, &taken, update);
    }

    /// A box of an object: averaged into the view from there, or the view from there.
    fn repeat_view(&mut self, slot: u32, recent: usize, current: &Current, index: u32, view: KeptView) {
        let place = self.recent[recent].key;
        let input_id = current.input_ids[index as usize];
        let Some(tracked) = self.slot(slot) else { return };
        let known = tracked.views.iter().position(|known| known.keyframe == place);
        if let Some(known) = known {
            let mut standing = tracked.views[known].clone();
            if let (Some(own), Some(others)) = (self.keyframes.camera(place), self.keyframes.get(current.key)) {
                standing.absorb(own, &view, others, &tracked.object, &self.running.statistics);
            }
            // Another object may take them, if this one turns out to be none.
            let (detection, copy) = (standing.detection, self.detection_of(&view));
            let of_view = self.recent[recent].boxes.iter_mut().find(|found| found.view.detection == detection);
            if let Some((found, copy)) = of_view.zip(copy) {
                found.remember(copy);
            }
            if let Some(tracked) = self.slot_mut(slot) {
                tracked.views[known] = standing;
                tracked.repeat(view.category, 1);
                tracked.count_id(input_id, 1);
                tracked.last_time = current.time;
            }
            if let Some(id) = input_id {
                self.tally.count(id, slot, 1);
            }
        } else if let (copy, Some(view)) = (self.detection_of(&view), self.view_from(recent, view)) {
            let owner = self.add_late(slot, view.clone(), input_id, 0);
            self.recent[recent].boxes.push(RecentBox { view, input_id, owner, copies: copy.into_iter().collect() });
            if let Some(tracked) = self.slot_mut(slot) {
                tracked.last_time = current.time;
            }
            self.forget_views(slot);
        }
    }

    /// The objects of boxes that overlap one from there, the best overlaps first: slots, boxes, and which edges were hidden.
    fn seen_before(&self, recent: usize, current: &Current) -> Vec<(u32, u32, u8)> {
        let mut pairs = Vec::new();
        for (place, known) in self.recent[recent].boxes.iter().enumerate() {
            let slot = known.owner.and_then(|id| self.slot_of_id.get(&self.resolve(id)).copied());
            let Some(slot) = slot else { continue };
            for (index, view) in current.views.iter().enumerate().filter(|(_, v)| v.category == known.view.category) {
                let shared = overlap(&known.view, view);
                if shared >= MIN_OVERLAP {
                    pairs.push((shared, place, index as u32, slot, known.view.hidden));
                }
            }
        }
        pairs.stable_sort_by(|a, b| b.0.total_cmp(&a.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut found: Vec<(u32, u32, u8)> = Vec::new();
        for (_, _, index, slot, hidden) in pairs {
            if !found.iter().any(|&(known, other, _)| known == slot || other == index) {
                found.push((slot, index, hidden));
            }
        }
        found
    }

    /// A box without an object: a copy of one from there, or another one.
    fn repeat_loose(&mut self, recent: usize, current: &Current, index: u32) {
        let view = &current.views[index as usize];
        let Some(detection) = self.detection_of(view) else { return };
        let overlap = |known: &RecentBox| {
            let is_same = known.view.category == view.category;
            if is_same { overlap(&known.view, view) } else { 0.0 }
        };
        let boxes = &self.recent[recent].boxes;
        let best = (0..boxes.len()).max_by(|&a, &b| overlap(&boxes[a]).total_cmp(&overlap(&boxes[b])).then(b.cmp(&a)));
        if let Some(best) = best.filter(|&best| overlap(&boxes[best]) >= MIN_OVERLAP) {
            let known = &mut self.recent[recent].boxes[best];
            known.remember(detection);
        } else if let Some(view) = self.view_from(recent, view.clone()) {
            let input_id = current.input_ids[index as usize];
            self.recent[recent].boxes.push(RecentBox { view, input_id, owner: None, copies: vec![detection] });
        }
    }

    /// A box as one of the frame that was first at its place, with a number that no detection has.
    fn view_from(&self, recent: usize, view: KeptView) -> Option<KeptView> {
        let frame = &self.recent[recent];
        let last = frame.boxes.iter().map(|known| usize::from(known.view.detection)).max().unwrap_or_default();
        let detection = u16::try_from((last + 1).max(MAX_DETECTIONS)).ok().filter(|_| frame.boxes.len() < MAX_BOXES)?;
        Some(KeptView { keyframe: frame.key, detection, ..view })
    }

    /// The detections of a view: its own, and those from the same place.
    pub(super) fn detections_of(&self, view: &KeptView) -> Vec<DetectionRef> {
        let own = self.detection_of(view);
        let place = self.recent.partition_point(|frame| frame.key < view.keyframe);
        let frame = self.recent.get(place).filter(|frame| frame.key == view.keyframe);
        let known = frame.and_then(|frame| frame.boxes.iter().find(|b| b.view.detection == view.detection));
        own.into_iter().chain(known.map_or_else(Vec::new, |known| known.copies.clone())).collect()
    }
}

/// Intersection over union of the boxes of two views.
fn overlap(a: &KeptView, b: &KeptView) -> f64 {
    a.bounding_box().zip(b.bounding_box()).map_or(0.0, |(a, b)| a.iou(&b))
}

#[cfg(test)]
#[path = "standstill_tests.rs"]
mod tests;
