//! Observes a frame: checks it and runs the steps in their order.

use std::collections::BTreeSet;

use nalgebra::Vector2;

use super::births::begin_objects;
use super::consistency::check_if_due;
use super::consistency::left_out;
use super::current::Current;
use super::input::{Frame, ObserveError};
use super::kept_shape::{MapShape, line_bits};
use super::keyframes::Keyframe;
use super::learning::learn_if_due;
use super::lifecycle::disagreement;
use super::matching::{assign, match_boxes};
use super::memory::Memory;
use super::merging::merge_overlapping;
use super::names::Categories;
use super::recent::look_back_at_frames;
use super::recent_frames::{RecentBox, RecentFrame};
use super::standstill::{repeat, same_place};
use super::update::{Event, FrameUpdate};
use super::views::{KeptView, to_bits};
use super::{MAX_CATEGORIES, MAX_CUE_SOURCES, MAX_DETECTIONS};
use crate::association::IdPolicy;
use crate::association::input::clutter::set_clutter;
use crate::association::input::context::given_size;
use crate::geometry::{BoundingBox, quaternion_from_rotation, rotation_from_quaternion};
use crate::scene::{self, BORDER_TOLERANCE_PX, NewDetection, Outlines, check_outline, edges_at_border};
use crate::sorting::StableSort;

/// Number of consecutive contradicting frames after which they are used: the world has changed.
const MAX_CONTRADICTING_FRAMES: u32 = 10;

/// [`super::ObjectMap::observe`].
pub(super) fn observe(
    memory: &mut Memory,
    frame: &Frame,
    detections: &[NewDetection],
) -> Result<FrameUpdate, ObserveError> {
    check(memory, frame, detections)?;
    let mut update = FrameUpdate { objects: vec![None; detections.len()], events: Vec::new() };
    let place = same_place(memory, frame, detections);
    let mut current = take_in(memory, frame, detections, place.is_some());
    let slots = memory.objects.near(&current.observations.cameras[0].center);
    let (matched, shift) = match_boxes(memory, &mut current, &slots, frame.pose_noise, &|_| None);
    shift.iter().for_each(|shift| memory.running.learn_shift(shift));
    let disagrees = disagreement(&memory.objects, &memory.running, &matched, current.views.len());
    if let Some(expected) = disagrees {
        memory.disagreeing += 1;
        update.events.push(Event::Disagrees { expected });
    } else {
        memory.disagreeing = 0;
    }
    let is_believed = disagrees.is_none() || memory.disagreeing > MAX_CONTRADICTING_FRAMES;
    if let (Some(place), true) = (place, is_believed) {
        repeat(memory, place, &current, &matched, &mut update);
        memory.keyframes.release(current.key);
    } else if is_believed {
        let seen = assign(memory, &mut current, matched, &mut update);
        begin_objects(memory, &mut current, &mut update);
        merge_overlapping(memory, &seen, &mut update);
        learn_if_due(memory);
        let object_of = |view: &KeptView| update.objects[usize::from(view.detection)];
        let boxes = current
            .views
            .into_iter()
            .zip(current.input_ids)
            .map(|(view, input_id)| RecentBox { owner: object_of(&view), view, input_id, copies: Vec::new() })
            .collect();
        memory.recent.push_back(RecentFrame { key: current.key, time: frame.time, boxes, repeats: 0 });
        look_back_at_frames(memory, &mut update);
    } else {
        memory.windows.keep(left_out(current.key, frame.time, current.views, current.input_ids));
    }
    check_if_due(memory, &mut update);
    memory.last = Some((frame.time, frame.id.clone()));
    Ok(update)
}

fn check(memory: &Memory, frame: &Frame, detections: &[NewDetection]) -> Result<(), ObserveError> {
    let id = || frame.id.clone();
    if !frame.time.is_finite() {
        return Err(ObserveError::Time(id()));
    }
    if let Some((last, _)) = &memory.last
        && frame.time < *last
    {
        return Err(ObserveError::TimeWentBack { id: id(), time: frame.time, last: *last });
    }
    let is_known = |key: u32| memory.keyframes.get(key).is_some_and(|k| k.frame.id == frame.id);
    let is_last = memory.last.as_ref().is_some_and(|(_, last)| *last == frame.id);
    if is_last || memory.recent.iter().any(|recent| is_known(recent.key)) {
        return Err(ObserveError::DuplicateFrame(id()));
    }
    if let Some(size) = frame.image_size
        && !(size.min() > 0.0 && size.iter().all(|x| x.is_finite()))
    {
        return Err(ObserveError::ImageSize { id: id(), width: size.x, height: size.y });
    }
    if frame.projection.center_in_world().is_none_or(|c| c.iter().any(|x| !x.is_finite())) {
        return Err(ObserveError::NoCenter(id()));
    }
    if detections.len() > MAX_DETECTIONS {
        return Err(ObserveError::TooManyDetections { id: id(), count: detections.len() });
    }
    check_categories(&memory.categories, frame, detections)?;
    detections.iter().enumerate().try_for_each(|(index, detection)| check_detection(frame, index, detection))?;
    check_cue_sources(&memory.cue_sources, frame, detections)?;
    match detections.iter().position(|d| d.score.is_some_and(|score| !score.is_finite())) {
        Some(detection) => Err(ObserveError::Score { id: id(), detection }),
        None => Ok(()),
    }
}

fn check_categories(categories: &Categories, frame: &Frame, detections: &[NewDetection]) -> Result<(), ObserveError> {
    let is_new = |name: &&str| categories.find(Some(name)).is_none();
    let new: BTreeSet<&str> = detections.iter().filter_map(|d| d.category).filter(is_new).collect();
    // One more for detections without a category.
    let count = categories.names().len() + new.len() + 1;
    if count > MAX_CATEGORIES {
        return Err(ObserveError::TooManyCategories { id: frame.id.clone(), count });
    }
    Ok(())
}

fn check_cue_sources(cue_sources: &[String], frame: &Frame, detections: &[NewDetection]) -> Result<(), ObserveError> {
    let used = detections.iter().flat_map(|detection| detection.cues.sources());
    let names = used.filter_map(|index| frame.cue_sources.get(index as usize));
    let new: BTreeSet<&String> = names.filter(|name| !cue_sources.contains(name)).collect();
    let count = cue_sources.len() + new.len();
    if count > MAX_CUE_SOURCES {
        return Err(ObserveError::TooManyCueSources { id: frame.id.clone(), count });
    }
    Ok(())
}

/// The index of a source of depths and 3D boxes.
fn cue_source(cue_sources: &mut Vec<String>, name: &str) -> u32 {
    let known = cue_sources.iter().position(|known| known == name);
    let index = known.unwrap_or_else(|| {
        cue_sources.push(name.to_owned());
        cue_sources.len() - 1
    });
    // Checked to be at most MAX_CUE_SOURCES.
    index as u32
}

/// Counts the frame and prepares its boxes; those of a frame `is_repeated` from a place do not count.
fn take_in(memory: &mut Memory, frame: &Frame, detections: &[NewDetection], is_repeated: bool) -> Current {
    let key = memory.next_key;
    memory.next_key = memory.next_key.saturating_add(1);
    if memory.running.frames == 0 {
        memory.origin = frame.projection.center_in_world().map_or(memory.origin, |c| c.coords);
    }
    memory.running.frames += 1;
    memory.running.repeated += u64::from(is_repeated);
    memory.running.longest_focal = memory.running.longest_focal.max(frame.projection.focal_length());
    let mut views = Vec::with_capacity(detections.len());
    let mut shapes = kept_shapes(frame, detections);
    for (index, detection) in detections.iter().enumerate() {
        if memory.options.min_score.zip(detection.score).is_some_and(|(least, score)| score < least) {
            continue;
        }
        // Checked to have one.
        let Some(in_image) = detection.box_or_around() else { continue };
        let measured = match &frame.lens {
            Some(lens) => lens.undistort_box(&in_image),
            None => Some(in_image),
        };
        // Views are kept in single precision; a box must be valid then.
        let rounded = |measured: BoundingBox| BoundingBox::new(measured.edges().map(|e| f64::from(e as f32))).ok();
        let Some(measured) = measured.and_then(rounded) else { continue };
        if frame.image_size.is_none() {
            let [width, height] = memory.running.extent;
            memory.running.extent = [width.max(measured.x1()), height.max(measured.y1())];
        }
        let shape = shapes.get_mut(index).and_then(Option::take);
        let view = view_of(memory, key, index, detection, [&measured, &in_image], frame);
        if !is_repeated {
            let observation = view.observation(0, &Vector2::zeros());
            memory.running.count_box(observation.log_half, observation.half_size, usize::from(view.category));
        }
        views.push(KeptView { shape: shape.map(Box::new), ..view });
    }
    views.stable_sort_by(|a, b| a.edges[0].total_cmp(&b.edges[0]).then(a.detection.cmp(&b.detection)));
    let kept = Frame { cue_sources: Vec::new(), scaled_by_frame: BTreeSet::new(), ..frame.clone() };
    let keyframe = Keyframe::new(kept, &memory.origin, memory.running.extent.into());
    let mut camera = keyframe.camera.clone();
    camera.boxes = 0..views.len();
    memory.keyframes.insert(key, keyframe);
    memory.keyframes.hold(key);
    let range = memory.running.longest_focal / memory.running.least_half_size().max(1e-9);
    memory.objects.set_range(range);
    let mut observations = memory.no_observations();
    observations.boxes = views.iter().map(|view| view.observation(0, &Vector2::zeros())).collect();
    let input_ids: Vec<Option<u32>> = views
        .iter()
        .map(|view| detections[usize::from(view.detection)].object.and_then(|id| input_id_number(memory, id, key)))
        .collect();
    for (observation, id) in observations.boxes.iter_mut().zip(&input_ids) {
        observation.id = *id;
    }
    observations.cameras.push(camera);
    observations.move_boxes(0, &Vector2::zeros());
    set_clutter(&mut observations.boxes, &observations.cameras[0], &memory.running.box_sizes());
    for (view, observation) in views.iter_mut().zip(&observations.boxes) {
        view.log_clutter = observation.log_clutter as f32;
    }
    let free = (0..views.len() as u32).collect();
    Current { key, time: frame.time, observations, views, input_ids, free }
}

fn view_of(
    memory: &mut Memory,
    key: u32,
    index: usize,
    detection: &NewDetection,
    [measured, in_image]: [&BoundingBox; 2],
    frame: &Frame,
) -> KeptView {
    let category = category_index(memory, detection.category);
    let mut cues = detection.cues;
    for source in cues.sources_mut() {
        let is_scaled = frame.scaled_by_frame.contains(source);
        // Checked to have a name.
        *source = cue_source(&mut memory.cue_sources, &frame.cue_sources[*source as usize]);
        if is_scaled {
            memory.scaled_by_frame.insert(*source);
        }
    }
    if let Some(box3d) = &mut cues.box3d {
        // As files of the map have it.
        let wxyz = box3d.rotation.as_ref().map(quaternion_from_rotation);
        box3d.rotation = wxyz.and_then(rotation_from_quaternion);
    }
    KeptView {
        keyframe: key,
        // Checked to be less than MAX_DETECTIONS.
        detection: index as u16,
        edges: measured.edges().map(|edge| edge as f32),
        in_image: frame.lens.map(|_| Box::new(in_image.edges().map(|edge| edge as f32))),
        absorbed: None,
        cues: (!cues.is_empty()).then(|| Box::new(cues)),
        shape: None,
        cut: to_bits(edges_at_border(in_image, frame.image_size, BORDER_TOLERANCE_PX)),
        hidden: 0,
        category,
        score: detection.score.map(|score| score as f32),
        log_clutter: 0.0,
    }
}

/// The number of a category.
fn category_index(memory: &mut Memory, name: Option<&str>) -> u16 {
    if let Some(known) = memory.categories.find(name) {
        return known;
    }
    memory.running.add_category(name.and_then(|name| given_size(&memory.options.priors, name)));
    memory.categories.add(name)
}

/// The number of an input id, where ids are used.
fn input_id_number(memory: &mut Memory, name: &str, key: u32) -> Option<u32> {
    if memory.options.ids == IdPolicy::Ignore {
        return None;
    }
    let number = memory.input_ids.number(name, key);
    for forgotten in memory.input_ids.forget_old() {
        memory.objects.tally.forget_id(forgotten);
    }
    Some(number)
}

/// What is kept of the outlines and oriented boxes of a frame; empty if there are none.
fn kept_shapes(frame: &Frame, detections: &[NewDetection]) -> Vec<Option<MapShape>> {
    if detections.iter().all(|d| d.outline.is_none() && d.oriented_box.is_none()) {
        return Vec::new();
    }
    let frame = frame.to_scene();
    let mut outlines = Outlines::default();
    let mut seen = vec![scene::Detection::default(); detections.len()];
    for (index, (detection, seen)) in detections.iter().zip(&mut seen).enumerate() {
        // Checked already.
        let _ = outlines.add(index, seen, has_box(detection), &frame, &detection.shape());
    }
    outlines.hide(&mut seen);
    let kept = |(detection, seen): (&NewDetection, &scene::Detection)| {
        let hidden = line_bits(seen.tangent_lines.as_deref()?.lines().map(|line| line.end.hidden));
        MapShape::of(&detection.shape(), &frame, hidden, has_box(detection))
    };
    detections.iter().zip(&seen).map(kept).collect()
}

/// Whether a box was measured, not only an outline or an oriented box.
fn has_box(detection: &NewDetection) -> bool {
    detection.bounding_box.is_some() || detection.ellipse.is_some()
}

/// Checks that there is a box, an outline, depths and 3D boxes, and that their sources have names.
fn check_detection(frame: &Frame, detection: usize, found: &NewDetection) -> Result<(), ObserveError> {
    let id = || frame.id.clone();
    found.cues.check().map_err(|error| ObserveError::Cue { id: id(), detection, error })?;
    let count = frame.cue_sources.len();
    if let Some(source_index) = found.cues.sources().find(|&source| source as usize >= count) {
        return Err(ObserveError::CueSource { id: id(), detection, source_index, count });
    }
    let checked = found.outline.map_or(Ok(()), check_outline);
    checked.map_err(|error| ObserveError::Outline { id: id(), detection, error })?;
    found.box_or_around().map(|_| ()).ok_or_else(|| ObserveError::NoBox { id: id(), detection })
}
