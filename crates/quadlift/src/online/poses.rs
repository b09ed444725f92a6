//! Poses that change, for example after a loop closure.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Vector2, Vector3};

use super::exchange::REACH;
use super::map::ObjectMap;
use super::merging::NEAR;
use super::summary::Motions;
use super::tracked::Tracked;
use super::update::{DetectionRef, Event, FrameUpdate, ObjectId};
use super::views::{KeptView, RecentBox, RecentFrame};
use crate::association::input::observations::Camera;
use crate::association::input::point_tree::PointTree;
use crate::association::score::fit::Start;
use crate::association::score::log_likelihood_ratio::LogLikelihoodRatios;
use crate::association::search::passes::fit_rays;
use crate::geometry::Projection;
use crate::sorting::StableSort;

/// Rounds of estimation, splitting, merging and assignment after frames have moved.
const ROUNDS: usize = 4;

/// The new pose of a frame.
#[derive(Debug, Clone)]
pub struct PoseUpdate {
    /// Id of the frame.
    pub frame: String,
    /// World to pixels, of the pinhole camera where there is a lens.
    pub projection: Projection,
}

impl ObjectMap {
    /// Moves frames and the objects that they show. Objects that then coincide are merged.
    ///
    /// Objects are refitted to their kept views; no old detection is needed. Frames that the map does not keep are skipped. The
    /// update names merged objects.
    pub fn update_poses(&mut self, poses: &[PoseUpdate]) -> FrameUpdate {
        let mut update = FrameUpdate::default();
        let new: BTreeMap<&str, &Projection> = poses.iter().map(|p| (p.frame.as_str(), &p.projection)).collect();
        let moved: Vec<(u32, Projection)> = self
            .keyframes
            .iter()
            .filter_map(|(key, keyframe)| Some((key, **new.get(keyframe.frame.id.as_str())?)))
            .filter(|(_, projection)| projection.center_in_world().is_some())
            .collect();
        let mut before: BTreeMap<u32, Camera> = BTreeMap::new();
        for (key, projection) in moved {
            let Some(keyframe) = self.keyframes.get_mut(key) else { continue };
            before.insert(key, keyframe.camera.clone());
            keyframe.set_pose(projection, &self.origin);
        }
        let of_frames = before.iter().filter_map(|(&key, old)| Some((key, motion(old, self.keyframes.camera(key)?)?)));
        let motions = Motions { of_frames: of_frames.collect() };
        let slots: Vec<u32> = self.slot_of_id.values().copied().collect();
        let mut touched = BTreeSet::new();
        for slot in slots {
            let Some(tracked) = self.slot(slot) else { continue };
            if !tracked.views.iter().any(|view| before.contains_key(&view.keyframe)) {
                continue;
            }
            touched.insert(slot);
            let Some(fitted) = self.moved(tracked.clone(), &before, &motions) else { continue };
            if let Some(tracked) = self.slot_mut(slot) {
                *tracked = fitted;
            }
            self.index(slot);
        }
        for _ in 0..ROUNDS {
            self.learn();
            for slot in touched.clone() {
                touched.extend(self.split(slot, &mut update));
            }
            self.tried_pairs.clear();
            self.merge_near(&touched, &mut update);
            self.exchange(&touched, &mut update);
            self.assign_kept(&mut update);
        }
        self.check_suspect();
        update
    }

    /// Assigns the kept views of all frames again, and all boxes of the recent ones.
    fn assign_kept(&mut self, update: &mut FrameUpdate) {
        let mut frames: BTreeMap<u32, RecentFrame> = BTreeMap::new();
        for tracked in self.tracked() {
            for view in &tracked.views {
                let Some(keyframe) = self.keyframes.get(view.keyframe) else { continue };
                let nothing =
                    || RecentFrame { key: view.keyframe, time: keyframe.frame.time, boxes: Vec::new(), repeats: 0 };
                let found =
                    RecentBox { view: view.clone(), input_id: None, owner: Some(tracked.id), copies: Vec::new() };
                frames.entry(view.keyframe).or_insert_with(nothing).boxes.push(found);
            }
        }
        for mut frame in frames.into_values() {
            if self.recent.iter().any(|recent| recent.key == frame.key) {
                continue;
            }
            // Other frames may have changed or removed objects.
            let is_kept = |b: &RecentBox| {
                let slot = b.owner.and_then(|id| self.slot_of_id.get(&id));
                slot.and_then(|&slot| self.slot(slot)).is_some_and(|t| t.is_seen_in(b.view.keyframe))
            };
            frame.boxes.retain(is_kept);
            let place = |b: &RecentBox| (b.view.edges[0], b.view.detection);
            frame.boxes.stable_sort_by(|a, b| place(a).0.total_cmp(&place(b).0).then(place(a).1.cmp(&place(b).1)));
            // Its boxes may leave their objects before others take them.
            self.keyframes.hold(frame.key);
            self.assign_again(&mut frame, update);
            self.keyframes.release(frame.key);
        }
        self.recent_again(update);
    }

    /// An object refitted to its moved views, starting where they carry it; `before` has the cameras before.
    fn moved(&self, mut tracked: Tracked, before: &BTreeMap<u32, Camera>, motions: &Motions) -> Option<Tracked> {
        for view in &mut tracked.views {
            if let Some(old) = before.get(&view.keyframe) {
                view.follow(&tracked.object, old, motions);
            }
        }
        let mut starts = vec![Start::body(&tracked.object)];
        for view in [tracked.views.first(), tracked.views.get(tracked.views.len() / 2), tracked.views.last()] {
            let Some((turn, shift)) = motions.of_frames.get(&view?.keyframe) else { continue };
            let center = turn * tracked.object.center + shift;
            starts.push(Start { center, root: turn * tracked.object.root });
        }
        let fitted = self.fit_views(&tracked, &starts)?;
        tracked.replace_fit(fitted);
        Some(tracked)
    }

    /// Splits the views off an object that clutter explains better, and makes an object of them if they agree; returns its
    /// slot. With wrong poses, views of different things were assigned to one object.
    fn split(&mut self, slot: u32, update: &mut FrameUpdate) -> Option<u32> {
        let tracked = self.slot(slot)?;
        let (mut observations, statistics) = self.gather(&tracked.views);
        let ratios = LogLikelihoodRatios::new(&observations, &statistics);
        let fits = |index| ratios.predicted_gain(&tracked.object, index).is_some_and(|ratio| ratio.value > 0.0);
        let others: Vec<usize> = (0..tracked.views.len()).filter(|&index| !fits(index)).collect();
        if others.is_empty() || others.len() == tracked.views.len() {
            return None;
        }
        for index in 0..others.len() {
            observations.move_boxes(others[index], &Vector2::zeros());
        }
        let boxes: Vec<u32> = others.iter().map(|&index| index as u32).collect();
        let object = if boxes.len() < 2 { None } else { fit_rays(&observations, &statistics, boxes) };
        let times = [tracked.first_time, tracked.last_time];
        let views: Vec<KeptView> = others.iter().map(|&index| tracked.views[index].clone()).collect();
        for view in &views {
            // For the new object.
            self.keyframes.hold(view.keyframe);
            let repeats = self.set_owner(view, None);
            self.take_back(slot, view, None, repeats);
        }
        let detections: Vec<DetectionRef> = views.iter().flat_map(|view| self.detections_of(view)).collect();
        self.refit(slot, update);
        let Some(object) = object else {
            views.iter().for_each(|view| self.keyframes.release(view.keyframe));
            update.events.push(Event::Reassigned { object: None, detections });
            return None;
        };
        let id = self.new_id();
        let mut split = Tracked::new(id, object, times);
        for view in views {
            let repeats = self.set_owner(&view, Some(id));
            split.repeat(view.category, repeats);
            split.add_view(view, None);
        }
        split.object.visible = split.views.len();
        split.fitted_views = split.views.len();
        self.running.assigned += split.views.len() as i64;
        let slot = self.put(split);
        update.events.push(Event::New { object: id, detections });
        self.after_detection(slot, update);
        Some(slot)
    }

    /// Merges near objects that are one, nearest first; at least one of a pair has moved.
    fn merge_near(&mut self, touched: &BTreeSet<u32>, update: &mut FrameUpdate) {
        for (first, second) in self.near_pairs(touched, NEAR) {
            self.try_as_one(first, second, update);
        }
    }

    /// Exchanges views between near objects, nearest first; at least one of a pair has moved.
    fn exchange(&mut self, touched: &BTreeSet<u32>, update: &mut FrameUpdate) {
        for (first, second) in self.near_pairs(touched, REACH) {
            self.reassign_views(first, second, update);
            self.reassign_views(second, first, update);
        }
    }

    /// Slots of objects whose centers are nearer than `reach` times the sum of their radii, nearest first; at least one of a pair
    /// is in `touched`.
    fn near_pairs(&self, touched: &BTreeSet<u32>, reach: f64) -> Vec<(u32, u32)> {
        let slots: Vec<u32> = self.slot_of_id.values().copied().collect();
        let objects: Vec<(Vector3<f64>, f64)> = slots
            .iter()
            .map(|&slot| self.slot(slot).map_or((Vector3::zeros(), 0.0), |t| (t.object.center, t.object.radius)))
            .collect();
        let largest = objects.iter().map(|(_, radius)| *radius).fold(0.0, f64::max);
        let tree = PointTree::new(objects.iter().map(|(center, _)| *center).collect());
        let mut pairs = Vec::new();
        for (place, slot) in slots.iter().enumerate().filter(|(_, slot)| touched.contains(slot)) {
            let (center, radius) = objects[place];
            for other in tree.within(&center, reach * (radius + largest)) {
                let (other_center, other_radius) = objects[other as usize];
                let apart = (other_center - center).norm() / (radius + other_radius);
                let is_twice = touched.contains(&slots[other as usize]) && (other as usize) < place;
                if other as usize != place && !is_twice && apart < reach {
                    pairs.push((apart, *slot, slots[other as usize]));
                }
            }
        }
        pairs.stable_sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        pairs.into_iter().map(|(_, first, second)| (first, second)).collect()
    }

    /// Merges two objects that are known to be one. Returns the id that stays, the older one, or `None` if that is impossible.
    pub fn merge(&mut self, first: ObjectId, second: ObjectId) -> Option<ObjectId> {
        let (first, second) = (self.resolve(first), self.resolve(second));
        let (a, b) = (*self.slot_of_id.get(&first)?, *self.slot_of_id.get(&second)?);
        (a != b && self.merge_by_force(a, b)).then_some(first.min(second))
    }
}

/// The rigid motion of what a camera sees when its pose changes: `X_new = turn X + shift`.
fn motion(old: &Camera, new: &Camera) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    // Both have the same intrinsics up to scale: M_new X_new + p_new = M_old X + p_old.
    let inverse = new.matrix.fixed_columns::<3>(0).try_inverse()?;
    let turn = inverse * old.matrix.fixed_columns::<3>(0);
    let shift = inverse * (old.matrix.column(3) - new.matrix.column(3));
    Some((turn, shift))
}
