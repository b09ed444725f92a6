//! Assigns the boxes of a frame to objects.

use nalgebra::Vector2;

use super::current::{Current, Matched, Seen};
use super::lifecycle::after_matching;
use super::memory::Memory;
use super::objects::Objects;
use super::own_views::forget_views;
use super::tracked::Tracked;
use super::update::{FrameUpdate, ObjectId};
use super::views::{from_bits, to_bits};
use crate::association::score::fit::Start;
use crate::association::score::log_likelihood_ratio::LogLikelihoodRatios;
use crate::association::score::object::is_visible;
use crate::association::score::scene_statistics::SceneStatistics;
use crate::association::search::assignment::overlaps_image;
use crate::association::search::candidates::Candidates;
use crate::association::search::frame_shift::{FrameShift, MIN_INFORMATIVE_VIEWS};
use crate::association::search::growth::{ALWAYS_FITTED, REFIT_GROWTH};
use crate::optimize::matching::{Pair, best_pairs};
use crate::solve::PoseNoise;

/// Minimum shift for a second matching, pixels.
const MIN_SHIFT: f64 = 0.25;

/// Sum of the squared normalized residuals of a box's edges beyond which its object is refitted: 5 % of
/// the boxes if errors are normal.
const REFIT_CHI2: f64 = 9.5;

/// Matches boxes with objects, and updates the shift of the frame, which is subtracted from its boxes; `owner` is the slot of
/// the object that a box is assigned to so far.
pub(super) fn match_boxes(
    memory: &mut Memory,
    current: &mut Current,
    slots: &[u32],
    pose_noise: Option<PoseNoise>,
    owner: &dyn Fn(u32) -> Option<u32>,
) -> (Matched, Option<FrameShift>) {
    let matched = pair_up(memory, current, slots, owner);
    let Some(subtracted) = memory.keyframes.get(current.key).map(|k| k.shift) else { return (matched, None) };
    let estimate = shift_of(&memory.objects, &memory.running.statistics, current, &matched, pose_noise, &subtracted);
    if !estimate.is_informative() {
        return (matched, None);
    }
    let shift = estimate.shift();
    if (shift - subtracted).norm() < MIN_SHIFT {
        return (matched, Some(estimate));
    }
    current.observations.move_boxes(0, &(subtracted - shift));
    if let Some(keyframe) = memory.keyframes.get_mut(current.key) {
        keyframe.shift = shift;
    }
    (pair_up(memory, current, slots, owner), Some(estimate))
}

/// The best pairs; `owner` is the slot of the object that a box is assigned to so far.
fn pair_up(memory: &Memory, current: &Current, slots: &[u32], owner: &dyn Fn(u32) -> Option<u32>) -> Matched {
    let (observations, statistics) = (&current.observations, &memory.running.statistics);
    let camera = &observations.cameras[0];
    let ratios = LogLikelihoodRatios::new(observations, statistics);
    let candidates = Candidates::new(observations, statistics, &current.free);
    let weighs_ids = memory.weighs_ids();
    let largest_bonus = if weighs_ids { memory.objects.tally.largest_bonus() } else { 0.0 };
    let alive = memory.objects.len();
    let (mut pairs, mut gains, mut seen) = (Vec::new(), Vec::new(), Vec::new());
    for &slot in slots {
        let Some(tracked) = memory.objects.get(slot) else { continue };
        let Some(prediction) = tracked.object.predict(camera) else { continue };
        if is_visible(&prediction, camera, observations.least_half_size) {
            seen.push(Seen { slot, prediction });
        }
        if current.free.is_empty() || !overlaps_image(&prediction.edges, &camera.size) {
            continue;
        }
        let bonus = |index: u32| {
            let id = observations.boxes[index as usize].id;
            if weighs_ids { memory.objects.tally.bonus(id, slot, owner(index), alive) } else { 0.0 }
        };
        for candidate in candidates.best(&ratios, &tracked.object, (camera, &prediction), bonus, largest_bonus) {
            pairs.push(Pair { row: slot, column: candidate.index, gain: candidate.gain.value });
            gains.push(candidate.gain);
        }
    }
    let pairs = best_pairs(&pairs).into_iter().map(|k| (pairs[k].row, pairs[k].column, gains[k])).collect();
    Matched { pairs, seen }
}

/// The shift of the frame's boxes relative to the map; `subtracted` is what was subtracted from them before.
fn shift_of(
    objects: &Objects,
    statistics: &SceneStatistics,
    current: &Current,
    matched: &Matched,
    pose_noise: Option<PoseNoise>,
    subtracted: &Vector2<f64>,
) -> FrameShift {
    let camera = &current.observations.cameras[0];
    let given = pose_noise.map_or(0.0, |noise| camera.focal * noise.rotation_sd);
    let mut estimate = FrameShift::new(statistics.shift_sd.hypot(given));
    for &(slot, index, ratio) in &matched.pairs {
        let Some(tracked) = objects.get(slot).filter(|t| t.object.views() >= MIN_INFORMATIVE_VIEWS) else {
            continue;
        };
        let observation = &current.observations.boxes[index as usize];
        let residuals = tracked.object.residuals_px(camera, observation);
        let one_sided = std::array::from_fn(|e| observation.cut[e] || ratio.hidden[e]);
        estimate.add(&residuals, one_sided, statistics.sd(observation), subtracted);
    }
    estimate
}

/// Assigns the matched boxes; returns the objects that should be visible.
pub(super) fn assign(
    memory: &mut Memory,
    current: &mut Current,
    matched: Matched,
    update: &mut FrameUpdate,
) -> Vec<Seen> {
    for seen in &matched.seen {
        if let Some(tracked) = memory.objects.get_mut(seen.slot) {
            tracked.object.visible += 1;
        }
    }
    let mut taken = Vec::with_capacity(matched.pairs.len());
    for &(slot, index, ratio) in &matched.pairs {
        current.views[index as usize].hidden = to_bits(ratio.hidden);
        if let Some(id) = give(memory, slot, current, index) {
            update.objects[current.views[index as usize].detection as usize] = Some(id);
            taken.push((slot, index));
        } else {
            current.views[index as usize].hidden = 0;
        }
    }
    current.free.retain(|index| !taken.iter().any(|(_, other)| other == index));
    after_matching(memory, current, &matched, &taken, update);
    matched.seen
}

/// Assigns a box of the frame to an object and refits it if due; `None` if the fit fails.
fn give(memory: &mut Memory, slot: u32, current: &Current, index: u32) -> Option<ObjectId> {
    let view = &current.views[index as usize];
    let mut tracked = memory.objects.borrow(slot)?;
    memory.keyframes.hold(view.keyframe);
    let input_id = current.input_ids[index as usize];
    tracked.add_view(view.clone(), input_id);
    let views = tracked.object.views();
    let grown = views < ALWAYS_FITTED || views as f64 >= REFIT_GROWTH * tracked.fitted_views as f64;
    if grown || surprise(&memory.running.statistics, &tracked, current, index) > REFIT_CHI2 {
        match memory.fit_views(&tracked, &[Start::body(&tracked.object)]) {
            Some(fitted) => tracked.replace_fit(fitted),
            None => {
                let place = tracked.views.partition_point(|v| v.keyframe < view.keyframe);
                tracked.take_view(place);
                tracked.uncount(view, input_id, 0);
                memory.keyframes.release(view.keyframe);
                memory.objects.give_back(slot, tracked);
                return None;
            }
        }
    }
    tracked.last_time = current.time;
    if let Some(id) = input_id {
        memory.objects.tally.count(id, slot, 1);
    }
    memory.running.assigned += 1;
    let id = tracked.id;
    memory.objects.give_back(slot, tracked);
    forget_views(memory, slot);
    memory.objects.index(slot);
    Some(id)
}

/// Sum of the squared normalized residuals of a box's edges.
fn surprise(statistics: &SceneStatistics, tracked: &Tracked, current: &Current, index: u32) -> f64 {
    let observation = &current.observations.boxes[index as usize];
    let hidden = from_bits(current.views[index as usize].hidden);
    let residuals = tracked.object.residuals_px(&current.observations.cameras[0], observation);
    let information = statistics.sd(observation).powi(-2);
    let two_sided = (0..4).filter(|&e| !observation.cut[e] && !hidden[e]);
    two_sided.map(|e| residuals[e] * residuals[e] * information).sum()
}
