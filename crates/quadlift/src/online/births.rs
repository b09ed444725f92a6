//! New objects from pairs of unassigned boxes of this frame and the last ones.

use super::current::Current;
use super::memory::Memory;
use super::recent_frames::RecentBox;
use super::recent_frames::detections_of;
use super::removal::forget_beyond_limit;
use super::tracked::Tracked;
use super::update::{DetectionRef, Event, FrameUpdate};
use super::views::to_bits;
use crate::association::input::observations::{BoxObservation, Camera};
use crate::association::score::fit::{Start, fit};
use crate::association::score::log_likelihood_ratio::LogLikelihoodRatios;
use crate::association::score::object::is_visible;
use crate::association::score::rays::{PairSphere, Sphere};
use crate::association::search::growth::new_pair;
use crate::sorting::StableSort;

/// Maximum number of pairs tested per frame, and the minimum per box.
const MAX_PAIRS: usize = 100_000;
const MIN_PAIRS: usize = 20;

/// Maximum number of new objects per frame; each costs fits.
const MAX_BIRTHS: usize = 500;

/// Two boxes that may show the same object: a box of the frame, and a recent frame with a box in it.
struct BoxPair {
    disagreement: f64,
    new: u32,
    old: (usize, usize),
    sphere: Sphere,
}

/// Starts new objects from the unassigned boxes of the frame.
pub(super) fn begin_objects(memory: &mut Memory, current: &mut Current, update: &mut FrameUpdate) {
    let mut pairs = box_pairs(memory, current);
    let place = |pair: &BoxPair| (pair.new, pair.old);
    pairs.stable_sort_by(|a, b| a.disagreement.total_cmp(&b.disagreement).then(place(a).cmp(&place(b))));
    let mut taken_new: Vec<u32> = Vec::new();
    for pair in pairs {
        if taken_new.len() >= MAX_BIRTHS {
            break;
        }
        if taken_new.contains(&pair.new) {
            continue;
        }
        let old = &memory.recent[pair.old.0].boxes[pair.old.1];
        if old.owner.is_some() {
            continue;
        }
        let views = [old.view.clone(), current.views[pair.new as usize].clone()];
        let (category, repeats) = (old.view.category, old.repeats());
        let ids = [old.input_id, current.input_ids[pair.new as usize]];
        let (observations, statistics) = memory.gather(&views);
        let start = Start::sphere(pair.sphere.center, pair.sphere.log_radius.exp());
        let Some(object) = fit(&observations, &statistics, vec![0, 1], &[start]) else { continue };
        let first_time = memory.recent[pair.old.0].time;
        let id = memory.objects.new_id();
        let mut tracked = Tracked::new(id, object, [first_time, current.time]);
        for (view, input_id) in views.into_iter().zip(ids) {
            memory.keyframes.hold(view.keyframe);
            tracked.add_view(view, input_id);
        }
        tracked.repeat(category, repeats);
        tracked.fitted_views = tracked.views.len();
        memory.recent[pair.old.0].boxes[pair.old.1].owner = Some(id);
        taken_new.push(pair.new);
        update.objects[current.views[pair.new as usize].detection as usize] = Some(id);
        add_object(memory, tracked, update);
    }
    current.free.retain(|index| !taken_new.contains(index));
}

/// Pairs of unassigned boxes that may show the same object.
fn box_pairs(memory: &Memory, current: &Current) -> Vec<BoxPair> {
    let camera = &current.observations.cameras[0];
    // The rays of the free boxes of the last frames, the latest first.
    let mut others: Vec<(&Camera, BoxObservation, (usize, usize))> = Vec::new();
    let most = (MAX_PAIRS / current.free.len().max(1)).max(MIN_PAIRS);
    for (recent, frame) in memory.recent.iter().enumerate().rev() {
        let Some(keyframe) = memory.keyframes.get(frame.key) else { continue };
        let Some(inverse) = keyframe.camera.matrix.fixed_columns::<3>(0).try_inverse() else { continue };
        for (place, RecentBox { view, input_id, .. }) in
            frame.boxes.iter().enumerate().filter(|(place, _)| frame.is_free(*place))
        {
            if others.len() >= most {
                break;
            }
            let mut observation = view.observation(0, &keyframe.shift);
            observation.id = *input_id;
            observation.relocalize(&inverse, keyframe.camera.focal);
            others.push((&keyframe.camera, observation, (recent, place)));
        }
    }
    let tally = memory.weighs_ids().then_some(&memory.objects.tally);
    let mut pairs = Vec::new();
    for &new in &current.free {
        let observation = &current.observations.boxes[new as usize];
        for (other_camera, other, old) in &others {
            let pair = new_pair(&memory.running.statistics, tally, (camera, observation), (other_camera, other));
            let box_pair =
                |pair: PairSphere| BoxPair { disagreement: pair.disagreement, new, old: *old, sphere: pair.sphere };
            pairs.extend(pair.map(box_pair));
        }
    }
    pairs
}

/// Puts a new object into the map, with the boxes of the last frames that fit it.
fn add_object(memory: &mut Memory, mut tracked: Tracked, update: &mut FrameUpdate) {
    let id = tracked.id;
    memory.running.assigned += tracked.views.len() as i64;
    look_back(memory, &mut tracked);
    let detections: Vec<DetectionRef> = tracked.views[..tracked.views.len() - 1]
        .iter()
        .flat_map(|view| detections_of(&memory.recent, &memory.keyframes, view))
        .collect();
    memory.objects.put(tracked);
    update.events.push(Event::New { object: id, detections });
    forget_beyond_limit(memory, id, update);
}

/// Assigns unassigned boxes of the last frames to an object of two views, latest first, and counts the frames in which it
/// should be seen.
fn look_back(memory: &mut Memory, tracked: &mut Tracked) {
    for recent in (0..memory.recent.len()).rev() {
        let key = memory.recent[recent].key;
        let first = tracked.views[0].keyframe;
        let Some(camera) = memory.keyframes.camera(key) else { continue };
        let Some(prediction) = tracked.object.predict(camera) else { continue };
        if tracked.is_seen_in(key) {
            continue;
        }
        let boxes = &memory.recent[recent].boxes;
        let places: Vec<usize> = (0..boxes.len()).filter(|&k| memory.recent[recent].is_free(k)).collect();
        let (observations, statistics) = memory.gather(places.iter().map(|&k| &boxes[k].view));
        let visible = is_visible(&prediction, camera, observations.least_half_size);
        let ratios = LogLikelihoodRatios::new(&observations, &statistics);
        let best = (0..observations.boxes.len())
            .filter_map(|index| ratios.gain(&tracked.object, &prediction, index).map(|ratio| (index, ratio)))
            .filter(|(_, ratio)| ratio.value > 0.0)
            .max_by(|a, b| a.1.value.total_cmp(&b.1.value).then(b.0.cmp(&a.0)));
        if let Some((index, ratio)) = best {
            let found = &boxes[places[index]];
            let mut view = found.view.clone();
            view.hidden = to_bits(ratio.hidden);
            let mut longer = tracked.clone();
            longer.repeat(view.category, found.repeats());
            longer.add_view(view, found.input_id);
            if let Some(fitted) = memory.fit_views(&longer, &[Start::body(&tracked.object)]) {
                longer.replace_fit(fitted);
                longer.object.visible += 1;
                *tracked = longer;
                memory.keyframes.hold(key);
                memory.recent[recent].boxes[places[index]].owner = Some(tracked.id);
                tracked.first_time = tracked.first_time.min(memory.recent[recent].time);
                memory.running.assigned += 1;
                continue;
            }
        }
        // Before it came up it was perhaps not in view yet.
        if visible && key > first {
            tracked.object.visible += 1;
        }
    }
}
