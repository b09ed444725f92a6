//! Assigns the boxes of a frame to objects.

use nalgebra::Vector2;

use super::current::Current;
use super::map::ObjectMap;
use super::tracked::Tracked;
use super::update::{FrameUpdate, ObjectId};
use super::views::{from_bits, most_redundant_pair, to_bits};
use crate::association::score::fit::Start;
use crate::association::score::log_likelihood_ratio::{LogLikelihoodRatio, LogLikelihoodRatios};
use crate::association::score::object::{Prediction, is_visible};
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

/// An object that should be visible in the frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub slot: u32,
    pub prediction: Prediction,
}

/// The pairs of objects and boxes of a frame.
#[derive(Debug, Default)]
pub(super) struct Matched {
    /// Slot, index of the box, log likelihood ratio.
    pub pairs: Vec<(u32, u32, LogLikelihoodRatio)>,
    /// Objects that should be visible.
    pub seen: Vec<Seen>,
}

impl ObjectMap {
    /// Matches boxes with objects, and updates the shift of the frame, which is subtracted from its boxes; `owner` is the slot of
    /// the object that a box is assigned to so far.
    pub(super) fn match_boxes(
        &mut self,
        current: &mut Current,
        slots: &[u32],
        pose_noise: Option<PoseNoise>,
        owner: &dyn Fn(u32) -> Option<u32>,
    ) -> (Matched, Option<FrameShift>) {
        let matched = self.pair_up(current, slots, owner);
        let Some(subtracted) = self.keyframes.get(current.key).map(|k| k.shift) else { return (matched, None) };
        let estimate = self.shift_of(current, &matched, pose_noise, &subtracted);
        if !estimate.is_informative() {
            return (matched, None);
        }
        let shift = estimate.shift();
        if (shift - subtracted).norm() < MIN_SHIFT {
            return (matched, Some(estimate));
        }
        current.observations.move_boxes(0, &(subtracted - shift));
        if let Some(keyframe) = self.keyframes.get_mut(current.key) {
            keyframe.shift = shift;
        }
        (self.pair_up(current, slots, owner), Some(estimate))
    }

    /// The best pairs; `owner` is the slot of the object that a box is assigned to so far.
    fn pair_up(&self, current: &Current, slots: &[u32], owner: &dyn Fn(u32) -> Option<u32>) -> Matched {
        let (observations, statistics) = (&current.observations, &self.running.statistics);
        let camera = &observations.cameras[0];
        let ratios = LogLikelihoodRatios::new(observations, statistics);
        let candidates = Candidates::new(observations, statistics, &current.free);
        let weighs_ids = self.weighs_ids();
        let largest_bonus = if weighs_ids { self.tally.largest_bonus() } else { 0.0 };
        let alive = self.slot_of_id.len();
        let (mut pairs, mut gains, mut seen) = (Vec::new(), Vec::new(), Vec::new());
        for &slot in slots {
            let Some(tracked) = self.slot(slot) else { continue };
            let Some(prediction) = tracked.object.predict(camera) else { continue };
            if is_visible(&prediction, camera, observations.least_half_size) {
                seen.push(Seen { slot, prediction });
            }
            if current.free.is_empty() || !overlaps_image(&prediction.edges, &camera.size) {
                continue;
            }
            let bonus = |index: u32| {
                let id = observations.boxes[index as usize].id;
                if weighs_ids { self.tally.bonus(id, slot, owner(index), alive) } else { 0.0 }
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
        &self,
        current: &Current,
        matched: &Matched,
        pose_noise: Option<PoseNoise>,
        subtracted: &Vector2<f64>,
    ) -> FrameShift {
        let camera = &current.observations.cameras[0];
        let given = pose_noise.map_or(0.0, |noise| camera.focal * noise.rotation_sd);
        let mut estimate = FrameShift::new(self.running.statistics.shift_sd.hypot(given));
        for &(slot, index, ratio) in &matched.pairs {
            let Some(tracked) = self.slot(slot).filter(|t| t.object.views() >= MIN_INFORMATIVE_VIEWS) else { continue };
            let observation = &current.observations.boxes[index as usize];
            let residuals = tracked.object.residuals_px(camera, observation);
            let one_sided = std::array::from_fn(|e| observation.cut[e] || ratio.hidden[e]);
            estimate.add(&residuals, one_sided, self.running.statistics.sd(observation), subtracted);
        }
        estimate
    }

    /// Assigns the matched boxes; returns the objects that should be visible.
    pub(super) fn assign(&mut self, current: &mut Current, matched: Matched, update: &mut FrameUpdate) -> Vec<Seen> {
        for seen in &matched.seen {
            if let Some(tracked) = self.slot_mut(seen.slot) {
                tracked.object.visible += 1;
            }
        }
        let mut taken = Vec::with_capacity(matched.pairs.len());
        for &(slot, index, ratio) in &matched.pairs {
            current.views[index as usize].hidden = to_bits(ratio.hidden);
            if let Some(id) = self.give(slot, current, index) {
                update.objects[current.views[index as usize].detection as usize] = Some(id);
                taken.push((slot, index));
            } else {
                current.views[index as usize].hidden = 0;
            }
        }
        current.free.retain(|index| !taken.iter().any(|(_, other)| other == index));
        self.after_matching(current, &matched, &taken, update);
        matched.seen
    }

    /// Assigns a box of the frame to an object and refits it if due; `None` if the fit fails.
    fn give(&mut self, slot: u32, current: &Current, index: u32) -> Option<ObjectId> {
        let view = &current.views[index as usize];
        let mut tracked = self.slots.get_mut(slot as usize)?.take()?;
        self.keyframes.hold(view.keyframe);
        let input_id = current.input_ids[index as usize];
        tracked.add_view(view.clone(), input_id);
        let views = tracked.object.views();
        let grown = views < ALWAYS_FITTED || views as f64 >= REFIT_GROWTH * tracked.fitted_views as f64;
        if grown || self.surprise(&tracked, current, index) > REFIT_CHI2 {
            match self.fit_views(&tracked, &[Start::body(&tracked.object)]) {
                Some(fitted) => tracked.replace_fit(fitted),
                None => {
                    let place = tracked.views.partition_point(|v| v.keyframe < view.keyframe);
                    tracked.take_view(place);
                    tracked.uncount(view, input_id);
                    self.keyframes.release(view.keyframe);
                    self.slots[slot as usize] = Some(tracked);
                    return None;
                }
            }
        }
        tracked.last_time = current.time;
        if let Some(id) = input_id {
            self.tally.count(id, slot, 1);
        }
        self.running.assigned += 1;
        let id = tracked.id;
        self.slots[slot as usize] = Some(tracked);
        self.forget_views(slot);
        self.index(slot);
        Some(id)
    }

    /// Sum of the squared normalized residuals of a box's edges.
    fn surprise(&self, tracked: &Tracked, current: &Current, index: u32) -> f64 {
        let observation = &current.observations.boxes[index as usize];
        let hidden = from_bits(current.views[index as usize].hidden);
        let residuals = tracked.object.residuals_px(&current.observations.cameras[0], observation);
        let information = self.running.statistics.sd(observation).powi(-2);
        let two_sided = (0..4).filter(|&e| !observation.cut[e] && !hidden[e]);
        two_sided.map(|e| residuals[e] * residuals[e] * information).sum()
    }

    /// Forgets views of an object until it has at most [`super::OnlineOptions::max_views`].
    pub(super) fn forget_views(&mut self, slot: u32) {
        let (most, keyframes, statistics) = (self.options.max_views, &mut self.keyframes, &self.running.statistics);
        let Some(tracked) = self.slots.get_mut(slot as usize).and_then(Option::as_deref_mut) else { return };
        while tracked.views.len() > most {
            let (place, like_it) = most_redundant_pair(&tracked.views, keyframes, &tracked.object.center);
            let of = |place: usize| keyframes.get(tracked.views[place].keyframe);
            if let (Some(others), Some(own)) = (of(place), of(like_it)) {
                let mut standing = tracked.views[like_it].clone();
                standing.absorb(&own.camera, &tracked.views[place], others, &tracked.object, statistics);
                tracked.views[like_it] = standing;
            }
            let forgotten = tracked.take_view(place);
            tracked.object.forgotten += 1;
            keyframes.release(forgotten.keyframe);
        }
    }
}
