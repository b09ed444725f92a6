//! Grows objects along a chain of neighboring frames: each box goes to the object that predicts it; the remaining
//! boxes form new objects in pairs.

use std::collections::{HashSet, VecDeque};
use std::ops::ControlFlow;

use nalgebra::Vector3;

use super::assignment::{count_visible, overlaps_image};
use super::candidates::Candidates;
use crate::association::input::context::AssociationContext;
use crate::association::input::observations::{BoxObservation, Camera, Observations};
use crate::association::score::fit::{Start, fit};
use crate::association::score::input_ids::IdTally;
use crate::association::score::log_likelihood_ratio::{LogLikelihoodRatio, LogLikelihoodRatios};
use crate::association::score::object::{Object, is_visible};
use crate::association::score::rays::{PairSphere, Sphere, pair_sphere};
use crate::association::score::scene_statistics::SceneStatistics;
use crate::optimize::matching::{Pair, best_pairs};
use crate::sorting::StableSort;

/// Number of previous frames in which an unassigned box searches for a partner.
const WINDOW: usize = 12;

/// Disagreement of the boxes of a new object, at most.
const MAX_DISAGREEMENT: f64 = 6.0;

/// Below this number of views an object is refitted at every box, later when its views have grown by this factor.
pub(crate) const ALWAYS_FITTED: usize = 12;
pub(crate) const REFIT_GROWTH: f64 = 1.15;

/// Objects of two views die when they have been missed more often than this.
pub(crate) const MAX_MISSES: usize = 4;

/// In videos of more frames than `LONG_VIDEO`, objects that have not been seen for this many frames are skipped: the
/// poses may have drifted.
const PARKED_AFTER: usize = 60;
const LONG_VIDEO: usize = 400;

/// Maximum number of tested pairs per box.
const MAX_PAIRS: usize = 20_000;

/// An object while it grows.
struct Growing {
    object: Object,
    /// Step at which it was seen last.
    last_seen: usize,
    /// Views at the last fit.
    fitted_views: usize,
    /// Its position and size when the frames that may see it were stored.
    noted: (Vector3<f64>, f64),
    alive: bool,
}

/// The state of the growth.
struct Growth<'a> {
    context: &'a AssociationContext<'a>,
    observations: &'a Observations,
    statistics: &'a mut SceneStatistics,
    slots: Vec<Growing>,
    /// For each frame, objects that may be visible in it; with repetitions.
    near: Vec<Vec<u32>>,
    /// For each frame, when it comes.
    step_of: Vec<usize>,
    tally: Option<IdTally>,
    alive: usize,
}

/// Grows objects over the frames of `order` from the boxes without a trusted id, starting with some objects. Returns those with
/// enough views. `report` is called after each frame.
pub(crate) fn grow(
    context: &AssociationContext,
    observations: &Observations,
    statistics: &mut SceneStatistics,
    order: &[u32],
    initial: Vec<Object>,
    report: &impl Fn() -> ControlFlow<()>,
) -> Vec<Object> {
    let mut step_of = vec![usize::MAX; observations.cameras.len()];
    for (step, &frame) in order.iter().enumerate() {
        step_of[frame as usize] = step;
    }
    let mut growth = Growth {
        context,
        observations,
        statistics,
        slots: Vec::new(),
        near: vec![Vec::new(); observations.cameras.len()],
        step_of,
        tally: context.weighs_ids.then(|| IdTally::new(context.options.wrong_id_share)),
        alive: 0,
    };
    for object in initial {
        growth.add(object, 0, 0);
    }
    let mut pool: VecDeque<(usize, u32)> = VecDeque::new();
    for (step, &frame) in order.iter().enumerate() {
        let free = |&index: &usize| !context.is_trusted(&observations.boxes[index]);
        let mut left: Vec<u32> =
            observations.cameras[frame as usize].boxes.clone().filter(free).map(|i| i as u32).collect();
        left = growth.extend(frame as usize, step, left);
        while pool.front().is_some_and(|&(since, _)| since + WINDOW <= step) {
            pool.pop_front();
        }
        let used = growth.begin(step, &left, &pool);
        pool.retain(|(_, index)| !used.contains(index));
        pool.extend(left.iter().filter(|index| !used.contains(index)).map(|&index| (step, index)));
        if report().is_break() {
            break;
        }
    }
    growth.finish()
}

/// The sphere of two boxes as a new object, with the sizes of its category and the ids in its disagreement; `None` where they
/// disagree too much.
pub(crate) fn new_pair(
    statistics: &SceneStatistics,
    tally: Option<&IdTally>,
    new: (&Camera, &BoxObservation),
    old: (&Camera, &BoxObservation),
) -> Option<PairSphere> {
    let (a, b) = (new.1, old.1);
    if a.category != b.category {
        return None;
    }
    let mut pair = pair_sphere(new, old)?;
    if let Some(size) = statistics.log_sizes[a.category] {
        pair.disagreement += 0.5 * ((pair.sphere.log_radius - size.mean) / size.sd).powi(2);
    }
    if pair.disagreement.is_nan() || pair.disagreement >= MAX_DISAGREEMENT {
        return None;
    }
    pair.disagreement -= tally.map_or(0.0, |t| t.pair_bonus(a.id, b.id));
    Some(pair)
}

impl Growth<'_> {
    /// Adds an object that was seen at a step and may be visible in the frames from another step on.
    fn add(&mut self, object: Object, seen: usize, from: usize) {
        let slot = self.slots.len() as u32;
        if let Some(tally) = &mut self.tally {
            tally.add(self.observations, slot, &object.boxes);
        }
        let fitted_views = object.boxes.len();
        self.slots.push(Growing { object, last_seen: seen, fitted_views, noted: (Vector3::zeros(), 0.0), alive: true });
        self.alive += 1;
        self.note(slot, from);
    }

    /// Stores the frames from a step on that may see an object, unless its position and size are nearly unchanged.
    fn note(&mut self, slot: u32, from: usize) {
        let growing = &mut self.slots[slot as usize];
        // With a margin, so that small changes need no update.
        let size = 1.3 * growing.object.longest_semi_axis();
        let center = growing.object.center;
        let (old_center, old_size) = growing.noted;
        if size <= 1.3 * old_size && (center - old_center).norm() <= old_size {
            return;
        }
        growing.noted = (center, size);
        for frame in self.context.frames_near(&center, size, self.observations.least_half_size) {
            let comes = self.step_of[frame as usize];
            if comes != usize::MAX && comes >= from {
                self.near[frame as usize].push(slot);
            }
        }
    }

    /// Assigns the boxes of a frame to the objects that predict them; returns the remaining ones.
    fn extend(&mut self, frame: usize, step: usize, left: Vec<u32>) -> Vec<u32> {
        let observations = self.observations;
        let mut slots = std::mem::take(&mut self.near[frame]);
        slots.sort_unstable();
        slots.dedup();
        let parks = self.context.order.is_video && observations.cameras.len() > LONG_VIDEO;
        slots.retain(|&slot| {
            let growing = &self.slots[slot as usize];
            growing.alive && !(parks && step > growing.last_seen + PARKED_AFTER)
        });
        let (pairs, gains, seen) = self.gains(frame, &slots, &left);
        for &slot in &seen {
            self.slots[slot as usize].object.visible += 1;
        }
        let mut taken = Vec::new();
        for k in best_pairs(&pairs) {
            let Pair { row: slot, column: index, .. } = pairs[k];
            if self.take(slot, index, gains[k].hidden, step) {
                taken.push(index);
            }
        }
        for slot in seen {
            let growing = &mut self.slots[slot as usize];
            let object = &growing.object;
            if object.boxes.len() < 3
                && object.trusted_id.is_none()
                && object.visible.saturating_sub(object.boxes.len()) > MAX_MISSES
            {
                growing.alive = false;
                self.alive -= 1;
                if let Some(tally) = &mut self.tally {
                    tally.remove(observations, slot, &growing.object.boxes);
                }
            }
        }
        taken.sort_unstable();
        left.into_iter().filter(|index| taken.binary_search(index).is_err()).collect()
    }

    /// The possible pairs of objects and free boxes of a frame, their gains, and the objects that should be visible.
    fn gains(&self, frame: usize, slots: &[u32], left: &[u32]) -> (Vec<Pair>, Vec<LogLikelihoodRatio>, Vec<u32>) {
        let observations = self.observations;
        let camera = &observations.cameras[frame];
        let calculator = LogLikelihoodRatios::new(observations, self.statistics);
        let candidates = Candidates::new(observations, self.statistics, left);
        let largest_bonus = self.tally.as_ref().map_or(0.0, IdTally::largest_bonus);
        let (mut pairs, mut gains, mut seen) = (Vec::new(), Vec::new(), Vec::new());
        for &slot in slots {
            let object = &self.slots[slot as usize].object;
            let Some(prediction) = object.predict(camera) else { continue };
            if is_visible(&prediction, camera, observations.least_half_size) {
                seen.push(slot);
            }
            // A trusted object with a box of its id in this frame takes no other box.
            let is_named = object.trusted_id.is_some() && object.frames(observations).any(|f| f == frame);
            if is_named || !overlaps_image(&prediction.edges, &camera.size) {
                continue;
            }
            let bonus = |index: u32| {
                let id = observations.boxes[index as usize].id;
                self.tally.as_ref().map_or(0.0, |tally| tally.bonus(id, slot, None, self.alive))
            };
            for candidate in candidates.best(&calculator, object, (camera, &prediction), bonus, largest_bonus) {
                pairs.push(Pair { row: slot, column: candidate.index, gain: candidate.gain.value });
                gains.push(candidate.gain);
            }
        }
        (pairs, gains, seen)
    }

    /// Assigns a box to an object, which is refitted if it has few views; `false` if that fails.
    fn take(&mut self, slot: u32, index: u32, hidden: [bool; 4], step: usize) -> bool {
        let growing = &mut self.slots[slot as usize];
        let before = self.statistics.hidden[index as usize];
        self.statistics.hidden[index as usize] = hidden;
        let place = growing.object.boxes.partition_point(|&b| b < index);
        let views = growing.object.boxes.len() + 1;
        if views < ALWAYS_FITTED || views as f64 >= REFIT_GROWTH * growing.fitted_views as f64 {
            let mut boxes = growing.object.boxes.clone();
            boxes.insert(place, index);
            let Some(fitted) = fit(self.observations, self.statistics, boxes, &[Start::body(&growing.object)]) else {
                self.statistics.hidden[index as usize] = before;
                return false;
            };
            let (visible, trusted_id) = (growing.object.visible, growing.object.trusted_id);
            growing.object = Object { visible, trusted_id, ..fitted };
            growing.fitted_views = views;
        } else {
            growing.object.boxes.insert(place, index);
        }
        growing.last_seen = step;
        if let Some(tally) = &mut self.tally {
            tally.add(self.observations, slot, &[index]);
        }
        self.note(slot, step + 1);
        true
    }

    /// Creates new objects from pairs of a frame's free boxes with those of the last frames; returns the used boxes.
    fn begin(&mut self, step: usize, left: &[u32], pool: &VecDeque<(usize, u32)>) -> HashSet<u32> {
        let observations = self.observations;
        let sides = |index: u32| {
            let observation = &observations.boxes[index as usize];
            (&observations.cameras[observation.frame], observation)
        };
        let mut pairs: Vec<(f64, u32, u32, Sphere)> = Vec::new();
        for &new in left {
            let (camera, observation) = sides(new);
            for &(_, old) in pool.iter().rev().take(MAX_PAIRS) {
                let pair = new_pair(self.statistics, self.tally.as_ref(), (camera, observation), sides(old));
                pairs.extend(pair.map(|pair| (pair.disagreement, new, old, pair.sphere)));
            }
        }
        pairs.stable_sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let mut used = HashSet::new();
        for (_, new, old, sphere) in pairs {
            if used.contains(&new) || used.contains(&old) {
                continue;
            }
            let start = Start::sphere(sphere.center, sphere.log_radius.exp());
            let boxes = vec![new.min(old), new.max(old)];
            if let Some(object) = fit(observations, self.statistics, boxes, &[start]) {
                self.add(object, step, step + 1);
                used.extend([new, old]);
            }
        }
        used
    }

    /// The objects with enough views, fitted to all of them.
    fn finish(self) -> Vec<Object> {
        let least = self.context.options.min_views;
        let grown: Vec<Growing> = self
            .slots
            .into_iter()
            .filter(|g| g.alive && (g.object.boxes.len() >= least || g.object.trusted_id.is_some()))
            .collect();
        let (context, observations, statistics) = (self.context, self.observations, &*self.statistics);
        crate::parallel::map_indices(grown.len(), |k| {
            let growing = &grown[k];
            let mut object = growing.object.clone();
            if object.boxes.len() > growing.fitted_views {
                let boxes = object.boxes.clone();
                if let Some(fitted) = fit(observations, statistics, boxes, &[Start::body(&object)]) {
                    object = Object { trusted_id: object.trusted_id, ..fitted };
                }
            }
            object.visible = count_visible(context, observations, &object);
            object
        })
    }
}
