//! Whether poses, cameras and boxes agree, while frames arrive: the consistency check of a run, on windows of frames with all their
//! boxes.
//!
//! The map forgets boxes that belong to nothing, so that what it keeps agrees with itself under almost any mistake. Frames enter the
//! window when their boxes have found their objects; objects of the map are the association that is checked.

use std::collections::HashMap;
use std::hash::Hash;

use super::map::ObjectMap;
use super::tracked::Tracked;
use super::update::{Event, FrameUpdate};
use super::views::{KeptView, RecentBox, RecentFrame, bounding_box};
use crate::association::statistics::median;
use crate::association::{AssociateOptions, AssociatedObject, Association, IdPolicy, Outcome};
use crate::diagnosis::misses::AGREES;
use crate::diagnosis::{Cause, CauseName, Diagnosis, diagnose_association, is_convincing};
use crate::run::diagnose_source;
use crate::scene::{Detection, Scene, SceneParts};
use crate::sorting::StableSort;

/// Number of frames after which a map is checked for the first time: a convention, about a second of a video.
const FIRST_CHECK: usize = 30;

/// Number of frames of a window beside the recent ones: the check takes every third one of 60.
const WINDOW: usize = 40;

/// Share of windows that are inconsistent for a known cause from which the map is: as of frames in a scene.
const MAX_EXPLAINED: f64 = 0.1;

/// Share of windows that are inconsistent for any cause above which the map is: in one nothing may stand still, poses may drift.
const MAX_WRONG: f64 = 0.5;

impl ObjectMap {
    /// Whether poses, cameras and boxes are consistent; `None` while there are too few frames and boxes to know.
    pub fn consistent(&self) -> Option<bool> {
        self.windows.consistent
    }

    /// The consistency check of the last frames that were inconsistent; that of nothing while [`Self::consistent`] is not `false`.
    pub fn diagnosis(&self) -> &Diagnosis {
        &self.diagnosis
    }

    /// Takes a frame that is not recent any more, or that the map has left out; holds it.
    pub(super) fn keep_for_check(&mut self, mut frame: RecentFrame) {
        forget_extras(&mut frame);
        let place = self.windows.frames.partition_point(|other| other.key < frame.key);
        self.windows.frames.insert(place, frame);
    }

    /// Checks the frames since the last check, if there are enough.
    pub(super) fn check_if_due(&mut self, update: &mut FrameUpdate) {
        let frames = self.windows.frames.len();
        let is_first = !self.windows.is_begun && frames + self.recent.len() >= FIRST_CHECK;
        if is_first || frames >= WINDOW {
            self.windows.is_begun = true;
            match frames >= WINDOW && self.passes() {
                true => self.begin_window(),
                false => self.check_window(frames < WINDOW, update),
            }
        }
    }

    /// Whether a full window is passed over: where a check takes long, the first, second, fourth, ... window is checked from then on.
    fn passes(&mut self) -> bool {
        let Some(since) = &mut self.windows.since_slow else { return false };
        *since = since.saturating_add(1);
        !since.is_power_of_two()
    }

    /// Forgets the frames of a window.
    fn begin_window(&mut self) {
        let passed = std::mem::take(&mut self.windows.frames);
        passed.iter().for_each(|frame| self.keyframes.release(frame.key));
    }

    /// Checks the frames since the last check at the end of a stream.
    pub(super) fn check_at_end(&mut self, update: &mut FrameUpdate) {
        // The recent frames alone were checked before.
        let is_new = !self.windows.frames.is_empty() || self.windows.checked == 0;
        if is_new {
            self.check_window(self.windows.checked > 0 && self.windows.frames.len() < WINDOW / 2, update);
        }
    }

    /// Checks the window with the recent frames. One that is not full is checked again, and counts only if it
    /// shows a cause.
    fn check_window(&mut self, is_part: bool, update: &mut FrameUpdate) {
        let mut frames: Vec<RecentFrame> = self.windows.frames.iter().chain(&self.recent).cloned().collect();
        frames.stable_sort_by_key(|frame| frame.key);
        self.learn_step(&frames);
        let (mut found, is_quick) = self.diagnose_frames(&frames);
        if !found.consistent {
            // A camera that waits shows nothing about its poses, and what moves before it something wrong: no verdict where it
            // waits for a third of the window.
            let all = frames.len();
            frames = self.of_different_places(frames);
            found = match frames.len() {
                views if views == all => found,
                views if views < FIRST_CHECK / 2 || 3 * views < 2 * all => Diagnosis::default(),
                _ => self.diagnose_frames(&frames).0,
            };
        }
        let is_unexplained = !found.consistent && !found.causes.iter().any(is_mistake);
        // The first explanation stays: that of the event.
        let is_first = self.windows.suspect.is_empty() || (self.diagnosis.causes.is_empty() && !is_unexplained);
        let counts = !is_part || !is_unexplained;
        if !found.consistent && counts && is_first {
            self.suspect(frames);
            self.diagnosis = found.clone();
        }
        if !is_part {
            self.begin_window();
            self.windows.since_slow = if is_quick { None } else { self.windows.since_slow.or(Some(0)) };
        }
        if (found.agreement.is_none() && found.consistent) || (is_part && is_unexplained) {
            return;
        }
        let windows = &mut self.windows;
        let checked = windows.checked.saturating_add(1);
        let explained = windows.explained.saturating_add(u32::from(!found.consistent && !is_unexplained));
        let unexplained = windows.unexplained.saturating_add(u32::from(is_unexplained));
        let share = |wrong: u32| f64::from(wrong) / f64::from(checked);
        let wrong = explained.saturating_add(unexplained);
        // Boxes that agree all the same: in a single window poses may drift.
        let drifts = wrong == 1 && is_unexplained && found.agreement.is_some_and(|agreement| agreement.miss < AGREES);
        let consistent = share(explained) < MAX_EXPLAINED && (share(wrong) <= MAX_WRONG || drifts);
        // The first frames alone count where they show a cause: objects that a mistake makes may agree with more frames.
        if !is_part || !(found.consistent || is_unexplained) {
            (windows.checked, windows.explained, windows.unexplained) = (checked, explained, unexplained);
        }
        let was = windows.consistent.replace(consistent);
        if consistent {
            self.suspect(Vec::new());
            self.diagnosis = Diagnosis::default();
        } else if was != Some(false) {
            update.events.push(Event::Inconsistent { diagnosis: Box::new(self.diagnosis.clone()) });
        }
    }

    /// Learns how far the camera moves between frames when it moves: the largest median of a window.
    fn learn_step(&mut self, frames: &[RecentFrame]) {
        let center = |frame: &RecentFrame| self.keyframes.camera(frame.key).map(|camera| camera.center);
        let step = |pair: &[RecentFrame]| Some((center(&pair[1])? - center(&pair[0])?).norm());
        let mut steps: Vec<f64> = frames.windows(2).filter_map(step).collect();
        self.windows.usual_step = median(&mut steps).unwrap_or(0.0).max(self.windows.usual_step);
    }

    /// Replaces the frames that were inconsistent.
    fn suspect(&mut self, mut frames: Vec<RecentFrame>) {
        for frame in &mut frames {
            self.keyframes.hold(frame.key);
            forget_extras(frame);
        }
        let before = std::mem::replace(&mut self.windows.suspect, frames);
        before.iter().for_each(|frame| self.keyframes.release(frame.key));
    }

    /// Checks the frames that were inconsistent once more after their poses have changed.
    pub(super) fn check_suspect(&mut self) {
        if self.windows.consistent != Some(false) {
            return;
        }
        let (found, _) = self.diagnose_frames(&self.windows.suspect);
        if found.consistent {
            self.suspect(Vec::new());
            (self.windows.explained, self.windows.unexplained) = (0, 0);
            self.windows.consistent = Some(true);
            self.diagnosis = Diagnosis::default();
        } else {
            self.diagnosis = found;
        }
    }

    /// The consistency check of some frames, and whether it was quick.
    fn diagnose_frames(&self, frames: &[RecentFrame]) -> (Diagnosis, bool) {
        let (scene, association) = self.scene_of_frames(frames);
        let has_ids = 2 * scene.detections.iter().filter(|d| d.object_index.is_some()).count() > scene.detections.len();
        if has_ids {
            let of_ids = diagnose_source(&scene, None);
            // Ids that are evidence may be wrong.
            let blames_ids = of_ids.causes.iter().all(|cause| cause.name == CauseName::ObjectIds);
            if !of_ids.consistent && (self.options.ids == IdPolicy::Trust || !blames_ids) {
                return (of_ids, true);
            }
        }
        let options = AssociateOptions {
            ids: self.options.ids,
            wrong_id_share: self.options.wrong_id_share,
            min_views: self.options.min_views,
            edge_noise_px: self.options.edge_noise_px,
            priors: self.options.priors.clone(),
            ..AssociateOptions::default()
        };
        let found = diagnose_association(&scene, &association, &options).unwrap_or_default();
        let is_quick = is_convincing(&association, found.agreement);
        (found, is_quick)
    }

    /// Frames with all their boxes as a scene, whose detections name their input ids, and the objects of the map in it.
    fn scene_of_frames(&self, frames: &[RecentFrame]) -> (Scene, Association) {
        let mut parts = SceneParts::default();
        let mut association = Association { outcome: Outcome::Found, ..Association::default() };
        let names = self.categories.names();
        // A detection without a category has the empty name: the scene is not shown.
        parts.categories = names.iter().map(|name| name.clone().unwrap_or_default()).collect();
        let (mut ids, mut objects) = (Numbers::new(), Numbers::new());
        for frame in frames {
            let Some(keyframe) = self.keyframes.get(frame.key) else { continue };
            let frame_index = parts.frames.len() as u32;
            parts.frames.push(keyframe.frame.to_scene());
            for RecentBox { view, input_id, owner, .. } in &frame.boxes {
                parts.detections.push(Detection {
                    frame_index,
                    object_index: input_id.map(|id| ids.of(id)),
                    category_index: names[usize::from(view.category)].as_ref().map(|_| u32::from(view.category)),
                    score: view.score.map(f64::from),
                    bounding_box: view.bounding_box(),
                    box_in_image: view.in_image.as_ref().and_then(|edges| bounding_box(edges)),
                    ..Default::default()
                });
                let owner = owner.map(|id| self.resolve(id)).filter(|id| self.slot_of_id.contains_key(id));
                association.object_of_detection.push(owner.map(|owner| objects.of(owner)));
            }
        }
        parts.object_ids = ids.known.iter().map(ToString::to_string).collect();
        let mut views = vec![0; objects.known.len()];
        association.object_of_detection.iter().flatten().for_each(|&index| views[index as usize] += 1);
        association.boxes = parts.detections.len();
        association.clutter = association.object_of_detection.iter().filter(|object| object.is_none()).count();
        let described = objects.known.iter().zip(views).map(|(id, views)| {
            let tracked = self.slot_of_id.get(id).and_then(|&slot| self.slot(slot));
            AssociatedObject {
                id: id.to_string(),
                category_index: None,
                views,
                expected_views: views,
                evidence: tracked.map(|tracked| self.evidence_for_views(tracked) * views as f64),
                ellipsoid: None,
                uncertain: None,
            }
        });
        association.objects = described.collect();
        (Scene(parts), association)
    }

    /// The mean evidence of a kept view of an object.
    fn evidence_for_views(&self, tracked: &Tracked) -> f64 {
        self.evidence_of(tracked) / tracked.views.len().max(1) as f64
    }
}

/// Drift, and frames that contradict others for no known reason, may be those of a short part.
fn is_mistake(cause: &Cause) -> bool {
    !matches!(cause.name, CauseName::ScaleJump | CauseName::ContradictingFrames)
}

/// Numbers of things in the order in which they come.
struct Numbers<T> {
    numbers: HashMap<T, u32>,
    known: Vec<T>,
}

impl<T: Copy + Eq + Hash> Numbers<T> {
    fn new() -> Self {
        Self { numbers: HashMap::new(), known: Vec::new() }
    }

    fn of(&mut self, thing: T) -> u32 {
        *self.numbers.entry(thing).or_insert_with(|| {
            self.known.push(thing);
            self.known.len() as u32 - 1
        })
    }
}

/// Forgets what the check does not use.
fn forget_extras(frame: &mut RecentFrame) {
    for RecentBox { view, copies, .. } in &mut frame.boxes {
        (view.shape, view.cues, view.absorbed) = (None, None, None);
        *copies = Vec::new();
    }
}

/// A frame that the map leaves out, with its boxes.
pub(super) fn left_out(key: u32, time: f64, views: Vec<KeptView>, input_ids: Vec<Option<u32>>) -> RecentFrame {
    let boxes = views.into_iter().zip(input_ids).map(|(view, input_id)| RecentBox {
        view,
        input_id,
        owner: None,
        copies: Vec::new(),
    });
    RecentFrame { key, time, boxes: boxes.collect(), repeats: 0 }
}

#[cfg(test)]
#[path = "consistency_tests.rs"]
mod tests;
