//! Poses that change, for example after a loop closure.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, Vector2, Vector3};

use super::consistency::check_suspect;
use super::exchange::REACH;
use super::exchange::reassign_views;
use super::learning::learn;
use super::lifecycle::after_detection;
use super::memory::Memory;
use super::merging::NEAR;
use super::merging::try_as_one;
use super::objects::Objects;
use super::own_views::{refit, take_back};
use super::recent::{assign_again, recent_again};
use super::recent_frames::{RecentBox, RecentFrame, detections_of, set_owner};
use super::summary::{Motions, follow};
use super::tracked::Tracked;
use super::update::{DetectionRef, Event, FrameUpdate};
use super::views::KeptView;
use crate::association::input::observations::Camera;
use crate::association::score::fit::Start;
use crate::association::score::log_likelihood_ratio::LogLikelihoodRatios;
use crate::association::search::passes::fit_rays;
use crate::geometry::Projection;
use crate::geometry::point_tree::PointTree;
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

/// [`super::ObjectMap::update_poses`].
pub(super) fn update_poses(memory: &mut Memory, poses: &[PoseUpdate]) -> FrameUpdate {
    let mut update = FrameUpdate::default();
    let new: BTreeMap<&str, &Projection> = poses.iter().map(|p| (p.frame.as_str(), &p.projection)).collect();
    let moved: Vec<(u32, Projection)> = memory
        .keyframes
        .iter()
        .filter_map(|(key, keyframe)| Some((key, **new.get(keyframe.frame.id.as_str())?)))
        .filter(|(_, projection)| projection.center_in_world().is_some())
        .collect();
    let mut before: BTreeMap<u32, Camera> = BTreeMap::new();
    for (key, projection) in moved {
        let Some(keyframe) = memory.keyframes.get_mut(key) else { continue };
        before.insert(key, keyframe.camera.clone());
        keyframe.set_pose(projection, &memory.origin);
    }
    let of_frames = before.iter().filter_map(|(&key, old)| Some((key, motion(old, memory.keyframes.camera(key)?)?)));
    let motions = Motions { of_frames: of_frames.collect() };
    let slots: Vec<u32> = memory.objects.slots();
    let mut touched = BTreeSet::new();
    for slot in slots {
        let Some(tracked) = memory.objects.get(slot) else { continue };
        if !tracked.views.iter().any(|view| before.contains_key(&view.keyframe)) {
            continue;
        }
        touched.insert(slot);
        let Some(fitted) = refit_moved(memory, tracked.clone(), &before, &motions) else { continue };
        if let Some(tracked) = memory.objects.get_mut(slot) {
            *tracked = fitted;
        }
        memory.objects.index(slot);
    }
    for _ in 0..ROUNDS {
        learn(memory);
        for slot in touched.clone() {
            touched.extend(split(memory, slot, &mut update));
        }
        memory.tried_pairs.clear();
        for (first, second) in near_pairs(&memory.objects, &touched, NEAR) {
            try_as_one(memory, first, second, &mut update);
        }
        for (first, second) in near_pairs(&memory.objects, &touched, REACH) {
            reassign_views(memory, first, second, &mut update);
            reassign_views(memory, second, first, &mut update);
        }
        assign_kept(memory, &mut update);
    }
    check_suspect(memory);
    update
}

/// Assigns the kept views of all frames again, and all boxes of the recent ones.
fn assign_kept(memory: &mut Memory, update: &mut FrameUpdate) {
    let mut frames: BTreeMap<u32, RecentFrame> = BTreeMap::new();
    for tracked in memory.objects.tracked() {
        for view in &tracked.views {
            let Some(keyframe) = memory.keyframes.get(view.keyframe) else { continue };
            let nothing =
                || RecentFrame { key: view.keyframe, time: keyframe.frame.time, boxes: Vec::new(), repeats: 0 };
            let found = RecentBox { view: view.clone(), input_id: None, owner: Some(tracked.id), copies: Vec::new() };
            frames.entry(view.keyframe).or_insert_with(nothing).boxes.push(found);
        }
    }
    for mut frame in frames.into_values() {
        if memory.recent.iter().any(|recent| recent.key == frame.key) {
            continue;
        }
        // Other frames may have changed or removed objects.
        let is_kept = |b: &RecentBox| {
            let slot = b.owner.and_then(|id| memory.objects.slot_of(id));
            slot.and_then(|slot| memory.objects.get(slot)).is_some_and(|t| t.is_seen_in(b.view.keyframe))
        };
        frame.boxes.retain(is_kept);
        let place = |b: &RecentBox| (b.view.edges[0], b.view.detection);
        frame.boxes.stable_sort_by(|a, b| place(a).0.total_cmp(&place(b).0).then(place(a).1.cmp(&place(b).1)));
        // Its boxes may leave their objects before others take them.
        memory.keyframes.hold(frame.key);
        assign_again(memory, &mut frame, update);
        memory.keyframes.release(frame.key);
    }
    recent_again(memory, update);
}

/// An object refitted to its moved views, starting where they carry it; `before` has the cameras before.
fn refit_moved(
    memory: &Memory,
    mut tracked: Tracked,
    before: &BTreeMap<u32, Camera>,
    motions: &Motions,
) -> Option<Tracked> {
    for view in &mut tracked.views {
        if let Some(old) = before.get(&view.keyframe) {
            follow(view, &tracked.object, old, motions);
        }
    }
    let mut starts = vec![Start::body(&tracked.object)];
    for view in [tracked.views.first(), tracked.views.get(tracked.views.len() / 2), tracked.views.last()] {
        let Some((turn, shift)) = motions.of_frames.get(&view?.keyframe) else { continue };
        let center = turn * tracked.object.center + shift;
        starts.push(Start { center, root: turn * tracked.object.root });
    }
    let fitted = memory.fit_views(&tracked, &starts)?;
    tracked.replace_fit(fitted);
    Some(tracked)
}

/// Splits the views off an object that clutter explains better, and makes an object of them if they agree; returns its
/// slot. With wrong poses, views of different things were assigned to one object.
fn split(memory: &mut Memory, slot: u32, update: &mut FrameUpdate) -> Option<u32> {
    let tracked = memory.objects.get(slot)?;
    let (mut observations, statistics) = memory.gather(&tracked.views);
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
        memory.keyframes.hold(view.keyframe);
        let repeats = set_owner(&mut memory.recent, view, None);
        take_back(memory, slot, view, None, repeats);
    }
    let detections: Vec<DetectionRef> =
        views.iter().flat_map(|view| detections_of(&memory.recent, &memory.keyframes, view)).collect();
    refit(memory, slot, update);
    let Some(object) = object else {
        views.iter().for_each(|view| memory.keyframes.release(view.keyframe));
        update.events.push(Event::Reassigned { object: None, detections });
        return None;
    };
    let id = memory.objects.new_id();
    let mut split = Tracked::new(id, object, times);
    for view in views {
        let repeats = set_owner(&mut memory.recent, &view, Some(id));
        split.repeat(view.category, repeats);
        split.add_view(view, None);
    }
    split.object.visible = split.views.len();
    split.fitted_views = split.views.len();
    memory.running.assigned += split.views.len() as i64;
    let slot = memory.objects.put(split);
    update.events.push(Event::New { object: id, detections });
    after_detection(memory, slot, update);
    Some(slot)
}

/// Slots of objects whose centers are nearer than `reach` times the sum of their radii, nearest first; at least one of a pair
/// is in `touched`.
fn near_pairs(objects: &Objects, touched: &BTreeSet<u32>, reach: f64) -> Vec<(u32, u32)> {
    let slots: Vec<u32> = objects.slots();
    let objects: Vec<(Vector3<f64>, f64)> = slots
        .iter()
        .map(|&slot| objects.get(slot).map_or((Vector3::zeros(), 0.0), |t| (t.object.center, t.object.radius)))
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

/// The rigid motion of what a camera sees when its pose changes: `X_new = turn X + shift`.
fn motion(old: &Camera, new: &Camera) -> Option<(Matrix3<f64>, Vector3<f64>)> {
    // Both have the same intrinsics up to scale: M_new X_new + p_new = M_old X + p_old.
    let inverse = new.matrix.fixed_columns::<3>(0).try_inverse()?;
    let turn = inverse * old.matrix.fixed_columns::<3>(0);
    let shift = inverse * (old.matrix.column(3) - new.matrix.column(3));
    Some((turn, shift))
}
