//! New objects from pairs of unassigned boxes of this frame and the last ones.

use super::MAX_DETECTIONS;
use super::current::Current;
use super::map::ObjectMap;
use super::tracked::Tracked;
use super::update::{DetectionRef, Event, FrameUpdate, ObjectId};
use super::views::{KeptView, RecentBox, to_bits};
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

impl ObjectMap {
    /// Starts new objects from the unassigned boxes of the frame.
    pub(super) fn begin_objects(&mut self, current: &mut Current, update: &mut FrameUpdate) {
        let mut pairs = self.box_pairs(current);
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
            let old = &self.recent[pair.old.0].boxes[pair.old.1];
            if old.owner.is_some() {
                continue;
            }
            let views = [old.view.clone(), current.views[pair.new as usize].clone()];
            let (category, repeats) = (old.view.category, old.repeats());
            let ids = [old.input_id, current.input_ids[pair.new as usize]];
            let (observations, statistics) = self.gather(&views);
            let start = Start::sphere(pair.sphere.center, pair.sphere.log_radius.exp());
            let Some(object) = fit(&observations, &statistics, vec![0, 1], &[start]) else { continue };
            let first_time = self.recent[pair.old.0].time;
            let id = self.new_id();
            let mut tracked = Tracked::new(id, object, [first_time, current.time]);
            for (view, input_id) in views.into_iter().zip(ids) {
                self.keyframes.hold(view.keyframe);
                tracked.add_view(view, input_id);
            }
            tracked.repeat(category, repeats);
            tracked.fitted_views = tracked.views.len();
            self.recent[pair.old.0].boxes[pair.old.1].owner = Some(id);
            taken_new.push(pair.new);
            update.objects[current.views[pair.new as usize].detection as usize] = Some(id);
            self.add_object(tracked, update);
        }
        current.free.retain(|index| !taken_new.contains(index));
    }

    /// Pairs of unassigned boxes that may show the same object.
    fn box_pairs(&self, current: &Current) -> Vec<BoxPair> {
        let camera = &current.observations.cameras[0];
        // The rays of the free boxes of the last frames, the latest first.
        let mut others: Vec<(&Camera, BoxObservation, (usize, usize))> = Vec::new();
        let most = (MAX_PAIRS / current.free.len().max(1)).max(MIN_PAIRS);
        for (recent, frame) in self.recent.iter().enumerate().rev() {
            let Some(keyframe) = self.keyframes.get(frame.key) else { continue };
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
        let tally = self.weighs_ids().then_some(&self.tally);
        let mut pairs = Vec::new();
        for &new in &current.free {
            let observation = &current.observations.boxes[new as usize];
            for (other_camera, other, old) in &others {
                let pair = new_pair(&self.running.statistics, tally, (camera, observation), (other_camera, other));
                let box_pair =
                    |pair: PairSphere| BoxPair { disagreement: pair.disagreement, new, old: *old, sphere: pair.sphere };
                pairs.extend(pair.map(box_pair));
            }
        }
        pairs
    }

    /// Puts a new object into the map, with the boxes of the last frames that fit it.
    fn add_object(&mut self, mut tracked: Tracked, update: &mut FrameUpdate) {
        let id = tracked.id;
        self.running.assigned += tracked.views.len() as i64;
        self.look_back(&mut tracked);
        let detections: Vec<DetectionRef> =
            tracked.views[..tracked.views.len() - 1].iter().flat_map(|view| self.detections_of(view)).collect();
        self.put(tracked);
        update.events.push(Event::New { object: id, detections });
        self.forget_beyond_limit(id, update);
    }

    /// A new id.
    pub(super) fn new_id(&mut self) -> ObjectId {
        let id = ObjectId(self.next_id);
        self.next_id += 1;
        id
    }

    /// Puts an object into a slot and returns the slot.
    pub(super) fn put(&mut self, tracked: Tracked) -> u32 {
        let slot = match self.free_slots.pop() {
            Some(slot) => slot,
            None => {
                self.slots.push(None);
                (self.slots.len() - 1) as u32
            }
        };
        for &(input_id, count) in &tracked.input_ids {
            self.tally.count(input_id, slot, count);
        }
        self.slot_of_id.insert(tracked.id, slot);
        self.slots[slot as usize] = Some(Box::new(tracked));
        self.index(slot);
        slot
    }

    /// Assigns unassigned boxes of the last frames to an object of two views, latest first, and counts the frames in which it
    /// should be seen.
    fn look_back(&mut self, tracked: &mut Tracked) {
        for recent in (0..self.recent.len()).rev() {
            let key = self.recent[recent].key;
            let first = tracked.views[0].keyframe;
            let Some(camera) = self.keyframes.camera(key) else { continue };
            let Some(prediction) = tracked.object.predict(camera) else { continue };
            if tracked.is_seen_in(key) {
                continue;
            }
            let boxes = &self.recent[recent].boxes;
            let places: Vec<usize> = (0..boxes.len()).filter(|&k| self.recent[recent].is_free(k)).collect();
            let (observations, statistics) = self.gather(places.iter().map(|&k| &boxes[k].view));
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
                if let Some(fitted) = self.fit_views(&longer, &[Start::body(&tracked.object)]) {
                    longer.replace_fit(fitted);
                    longer.object.visible += 1;
                    *tracked = longer;
                    self.keyframes.hold(key);
                    self.recent[recent].boxes[places[index]].owner = Some(tracked.id);
                    tracked.first_time = tracked.first_time.min(self.recent[recent].time);
                    self.running.assigned += 1;
                    continue;
                }
            }
            // Before it came up it was perhaps not in view yet.
            if visible && key > first {
                tracked.object.visible += 1;
            }
        }
    }

    /// The detection of a view; `None` of one that stands for others from its place alone.
    pub(super) fn detection_of(&self, view: &KeptView) -> Option<DetectionRef> {
        if usize::from(view.detection) >= MAX_DETECTIONS {
            return None;
        }
        let frame = self.keyframes.get(view.keyframe)?.frame.id.clone();
        Some(DetectionRef { frame, detection: view.detection as usize })
    }
}
