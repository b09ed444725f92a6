//! Whether poses, cameras and boxes agree, while frames arrive: the consistency check of a run, on windows of frames with all their
//! boxes.
//!
//! The map forgets boxes that belong to nothing, so that what it keeps agrees with itself under almost any mistake. Frames enter the
//! window when their boxes have found their objects; objects of the map are the association that is checked.

use std::collections::HashMap;
use std::hash::Hash;

use super::keyframes::Keyframes;
use super::memory::Memory;
use super::recent_frames::{RecentBox, RecentFrame};
use super::standstill::of_different_places;
use super::update::{Event, FrameUpdate};
use super::views::{KeptView, bounding_box};
use super::windows::Windows;
use crate::association::{AssociateOptions, AssociatedObject, Association, IdPolicy, Outcome};
use crate::diagnosis::misses::AGREES;
use crate::diagnosis::{Cause, CauseName, Diagnosis, diagnose_association, is_convincing};
use crate::optimize::median::quantile;
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

/// Checks the frames since the last check, if there are enough.
pub(super) fn check_if_due(memory: &mut Memory, update: &mut FrameUpdate) {
    let frames = memory.windows.frames.len();
    let is_first = !memory.windows.is_begun && frames + memory.recent.len() >= FIRST_CHECK;
    if is_first || frames >= WINDOW {
        memory.windows.is_begun = true;
        match frames >= WINDOW && passes(&mut memory.windows) {
            true => begin_window(&mut memory.windows, &mut memory.keyframes),
            false => check_window(memory, frames < WINDOW, update),
        }
    }
}

/// Whether a full window is passed over: where a check takes long, the first, second, fourth, ... window is checked from then on.
fn passes(windows: &mut Windows) -> bool {
    let Some(since) = &mut windows.since_slow else { return false };
    *since = since.saturating_add(1);
    !since.is_power_of_two()
}

/// Forgets the frames of a window.
fn begin_window(windows: &mut Windows, keyframes: &mut Keyframes) {
    let passed = std::mem::take(&mut windows.frames);
    passed.iter().for_each(|frame| keyframes.release(frame.key));
}

/// Checks the frames since the last check at the end of a stream.
pub(super) fn check_at_end(memory: &mut Memory, update: &mut FrameUpdate) {
    // The recent frames alone were checked before.
    let is_new = !memory.windows.frames.is_empty() || memory.windows.checked == 0;
    if is_new {
        check_window(memory, memory.windows.checked > 0 && memory.windows.frames.len() < WINDOW / 2, update);
    }
}

/// Checks the window with the recent frames. One that is not full is checked again, and counts only if it
/// shows a cause.
fn check_window(memory: &mut Memory, is_part: bool, update: &mut FrameUpdate) {
    let mut frames: Vec<RecentFrame> = memory.windows.frames.iter().chain(&memory.recent).cloned().collect();
    frames.stable_sort_by_key(|frame| frame.key);
    learn_step(&mut memory.windows, &memory.keyframes, &frames);
    let (mut found, is_quick) = diagnose_frames(memory, &frames);
    if !found.consistent {
        // A camera that waits shows nothing about its poses, and what moves before it something wrong: no verdict where it
        // waits for a third of the window.
        let all = frames.len();
        frames = of_different_places(&memory.keyframes, &memory.running.statistics, &memory.windows, frames);
        found = match frames.len() {
            views if views == all => found,
            views if views < FIRST_CHECK / 2 || 3 * views < 2 * all => Diagnosis::default(),
            _ => diagnose_frames(memory, &frames).0,
        };
    }
    let is_unexplained = !found.consistent && !found.causes.iter().any(is_mistake);
    // The first explanation stays: that of the event.
    let is_first = memory.windows.suspect.is_empty() || (memory.diagnosis.causes.is_empty() && !is_unexplained);
    let counts = !is_part || !is_unexplained;
    if !found.consistent && counts && is_first {
        suspect(&mut memory.windows, &mut memory.keyframes, frames);
        memory.diagnosis = found.clone();
    }
    if !is_part {
        begin_window(&mut memory.windows, &mut memory.keyframes);
        memory.windows.since_slow = if is_quick { None } else { memory.windows.since_slow.or(Some(0)) };
    }
    if (found.agreement.is_none() && found.consistent) || (is_part && is_unexplained) {
        return;
    }
    let windows = &mut memory.windows;
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
        suspect(&mut memory.windows, &mut memory.keyframes, Vec::new());
        memory.diagnosis = Diagnosis::default();
    } else if was != Some(false) {
        update.events.push(Event::Inconsistent { diagnosis: Box::new(memory.diagnosis.clone()) });
    }
}

/// Learns how far the camera moves between frames when it moves: the largest median of a window.
fn learn_step(windows: &mut Windows, keyframes: &Keyframes, frames: &[RecentFrame]) {
    let center = |frame: &RecentFrame| keyframes.camera(frame.key).map(|camera| camera.center);
    let step = |pair: &[RecentFrame]| Some((center(&pair[1])? - center(&pair[0])?).norm());
    let mut steps: Vec<f64> = frames.windows(2).filter_map(step).collect();
    windows.usual_step = quantile(&mut steps, 0.5).unwrap_or(0.0).max(windows.usual_step);
}

/// Replaces the frames that were inconsistent.
fn suspect(windows: &mut Windows, keyframes: &mut Keyframes, mut frames: Vec<RecentFrame>) {
    for frame in &mut frames {
        keyframes.hold(frame.key);
        frame.forget_extras();
    }
    let before = std::mem::replace(&mut windows.suspect, frames);
    before.iter().for_each(|frame| keyframes.release(frame.key));
}

/// Checks the frames that were inconsistent once more after their poses have changed.
pub(super) fn check_suspect(memory: &mut Memory) {
    if memory.windows.consistent != Some(false) {
        return;
    }
    let (found, _) = diagnose_frames(memory, &memory.windows.suspect);
    if found.consistent {
        suspect(&mut memory.windows, &mut memory.keyframes, Vec::new());
        (memory.windows.explained, memory.windows.unexplained) = (0, 0);
        memory.windows.consistent = Some(true);
        memory.diagnosis = Diagnosis::default();
    } else {
        memory.diagnosis = found;
    }
}

/// The consistency check of some frames, and whether it was quick.
fn diagnose_frames(memory: &Memory, frames: &[RecentFrame]) -> (Diagnosis, bool) {
    let (scene, association) = scene_of_frames(memory, frames);
    let has_ids = 2 * scene.detections.iter().filter(|d| d.object_index.is_some()).count() > scene.detections.len();
    if has_ids {
        let of_ids = diagnose_source(&scene, None);
        // Ids that are evidence may be wrong.
        let blames_ids = of_ids.causes.iter().all(|cause| cause.name == CauseName::ObjectIds);
        if !of_ids.consistent && (memory.options.ids == IdPolicy::Trust || !blames_ids) {
            return (of_ids, true);
        }
    }
    let options = AssociateOptions {
        ids: memory.options.ids,
        wrong_id_share: memory.options.wrong_id_share,
        min_views: memory.options.min_views,
        edge_noise_px: memory.options.edge_noise_px,
        priors: memory.options.priors.clone(),
        ..AssociateOptions::default()
    };
    let found = diagnose_association(&scene, &association, &options).unwrap_or_default();
    let is_quick = is_convincing(&association, found.agreement);
    (found, is_quick)
}

/// Frames with all their boxes as a scene, whose detections name their input ids, and the objects of the map in it.
fn scene_of_frames(memory: &Memory, frames: &[RecentFrame]) -> (Scene, Association) {
    let mut parts = SceneParts::default();
    let mut association = Association { outcome: Outcome::Found, ..Association::default() };
    let names = memory.categories.names();
    // A detection without a category has the empty name: the scene is not shown.
    parts.categories = names.iter().map(|name| name.clone().unwrap_or_default()).collect();
    let (mut id_numbers, mut ids) = (HashMap::new(), Vec::new());
    let (mut object_numbers, mut objects) = (HashMap::new(), Vec::new());
    for frame in frames {
        let Some(keyframe) = memory.keyframes.get(frame.key) else { continue };
        let frame_index = parts.frames.len() as u32;
        parts.frames.push(keyframe.frame.to_scene());
        for RecentBox { view, input_id, owner, .. } in &frame.boxes {
            parts.detections.push(Detection {
                frame_index,
                object_index: input_id.map(|id| number_of(&mut id_numbers, &mut ids, id)),
                category_index: names[usize::from(view.category)].as_ref().map(|_| u32::from(view.category)),
                score: view.score.map(f64::from),
                bounding_box: view.bounding_box(),
                box_in_image: view.in_image.as_ref().and_then(|edges| bounding_box(edges)),
                ..Default::default()
            });
            let owner = owner.map(|id| memory.objects.resolve(id)).filter(|id| memory.objects.has(*id));
            association
                .object_of_detection
                .push(owner.map(|owner| number_of(&mut object_numbers, &mut objects, owner)));
        }
    }
    parts.object_ids = ids.iter().map(ToString::to_string).collect();
    let mut views = vec![0; objects.len()];
    association.object_of_detection.iter().flatten().for_each(|&index| views[index as usize] += 1);
    association.boxes = parts.detections.len();
    association.clutter = association.object_of_detection.iter().filter(|object| object.is_none()).count();
    let described = objects.iter().zip(views).map(|(id, views)| {
        let tracked = memory.objects.by_id(*id);
        AssociatedObject {
            id: id.to_string(),
            category_index: None,
            views,
            expected_views: views,
            evidence: tracked.map(|t| memory.evidence_of(t) / t.views.len().max(1) as f64 * views as f64),
            ellipsoid: None,
            uncertain: None,
        }
    });
    association.objects = described.collect();
    (Scene(parts), association)
}

/// Drift, and frames that contradict others for no known reason, may be those of a short part.
fn is_mistake(cause: &Cause) -> bool {
    !matches!(cause.name, CauseName::ScaleJump | CauseName::ContradictingFrames)
}

/// The number of a thing: the next one if it is new.
fn number_of<T: Copy + Eq + Hash>(numbers: &mut HashMap<T, u32>, known: &mut Vec<T>, thing: T) -> u32 {
    *numbers.entry(thing).or_insert_with(|| {
        known.push(thing);
        known.len() as u32 - 1
    })
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
