//! What contradicts itself is told once, and what does not is never told.

use super::super::tests::assert_sound;
use super::super::{Event, Frame, FrameUpdate, ObjectMap, OnlineOptions, PoseUpdate};
use crate::association::IdPolicy;
use crate::diagnosis::{CauseName, Correction, Mistake};
use crate::scene::{NewDetection, Scene};
use crate::synthetic::{Detector, Noise, Observations, SyntheticIds, SyntheticOptions, Trajectory, generate};

fn scene(seed: u64, views: usize, ids: SyntheticIds, trajectory: Trajectory) -> Scene {
    let options = SyntheticOptions {
        objects: if trajectory == Trajectory::Street { 60 } else { 10 },
        views,
        seed,
        cube_side: 40.0,
        trajectory,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        detector: Detector { misses: 0.1, false_boxes: 0.1, ..Default::default() },
        ids,
        ..Default::default()
    };
    generate(&options).unwrap().scene
}

fn observe(map: &mut ObjectMap, scene: &Scene, frames: std::ops::Range<usize>) -> Vec<FrameUpdate> {
    let of_frame = |k: usize| {
        let found = scene.detections.iter().filter(move |d| d.frame_index as usize == k);
        let detection = |d: &crate::scene::Detection| NewDetection {
            object: d.object_index.map(|o| scene.object_ids[o as usize].as_str()),
            ..NewDetection::from_box(d.bounding_box.unwrap())
        };
        found.map(detection).collect::<Vec<_>>()
    };
    let mut updates: Vec<FrameUpdate> = frames
        .map(|k| map.observe(&Frame::of_scene(scene, &scene.frames[k], k as f64), &of_frame(k)).unwrap())
        .collect();
    updates.push(map.settle());
    assert_sound(map);
    updates
}

/// The causes that are told, and after which frame.
fn told(updates: &[FrameUpdate]) -> Vec<(usize, Vec<CauseName>)> {
    let causes = |event: &Event| match event {
        Event::Inconsistent { diagnosis } => Some(diagnosis.causes.iter().map(|cause| cause.name).collect()),
        _ => None,
    };
    let of = |(k, update): (usize, &FrameUpdate)| {
        update.events.iter().filter_map(causes).map(|found| (k, found)).collect::<Vec<_>>()
    };
    updates.iter().enumerate().flat_map(of).collect()
}

fn map() -> ObjectMap {
    ObjectMap::new(OnlineOptions::default()).unwrap()
}

#[test]
fn wrong_poses_are_told_once_and_right_ones_never() {
    for ids in [SyntheticIds::Absent, SyntheticIds::True] {
        let right = scene(1, 100, ids, Trajectory::Orbit);
        let mut good = map();
        assert_eq!(good.consistent(), None);
        assert_eq!(told(&observe(&mut good, &right, 0..100)), []);
        assert_eq!((good.consistent(), good.diagnosis().consistent), (Some(true), true));
        let mut bad = map();
        let found = told(&observe(&mut bad, &Mistake(Correction::OpenGlAxes).apply(&right), 0..100));
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!((found[0].0, found[0].1[0]), (29, CauseName::OpenGlAxes));
        assert_eq!((bad.consistent(), bad.diagnosis().causes[0].name), (Some(false), CauseName::OpenGlAxes));
    }
}

#[test]
fn too_few_frames_are_not_judged() {
    let wrong = Mistake(Correction::OpenGlAxes).apply(&scene(1, 60, SyntheticIds::True, Trajectory::Orbit));
    let mut map = map();
    assert_eq!(told(&observe(&mut map, &wrong, 0..1)), []);
    assert_eq!(map.consistent(), None);
}

#[test]
fn every_second_frame_in_another_convention_is_named() {
    let right = scene(2, 80, SyntheticIds::Absent, Trajectory::Orbit);
    let wrong = Mistake(Correction::BodyAxes).apply(&right);
    let mut parts = right.into_parts();
    for (k, frame) in parts.frames.iter_mut().enumerate().filter(|(k, _)| k % 2 == 1) {
        frame.projection = wrong.frames[k].projection;
    }
    let mut map = map();
    let found = told(&observe(&mut map, &Scene::from_parts(parts).unwrap(), 0..80));
    assert_eq!(found.iter().map(|(_, causes)| causes[0]).collect::<Vec<_>>(), [CauseName::BodyAxes]);
    let cause = &map.diagnosis().causes[0];
    assert!(cause.frames.len() > 10, "{:?}", cause.frames);
}

#[test]
fn a_mistake_that_begins_later_is_told_and_new_poses_mend_it() {
    let right = scene(3, 120, SyntheticIds::True, Trajectory::Orbit);
    let wrong = Mistake(Correction::OpenGlAxes).apply(&right);
    let mut parts = right.clone().into_parts();
    for (k, frame) in parts.frames.iter_mut().enumerate().skip(70) {
        frame.projection = wrong.frames[k].projection;
    }
    let options = OnlineOptions { ids: IdPolicy::Trust, ..Default::default() };
    let mut map = ObjectMap::new(options).unwrap();
    let found = told(&observe(&mut map, &Scene::from_parts(parts).unwrap(), 0..120));
    assert!(found.len() == 1 && found[0].0 >= 70, "{found:?}");
    let poses: Vec<PoseUpdate> =
        right.frames.iter().map(|frame| PoseUpdate { frame: frame.id.clone(), projection: frame.projection }).collect();
    map.update_poses(&poses);
    assert_sound(&map);
    assert_eq!((map.consistent(), map.diagnosis().consistent), (Some(true), true));
}

#[test]
fn right_streams_of_many_kinds_are_not_told() {
    let kinds = [Trajectory::Orbit, Trajectory::Random, Trajectory::Street, Trajectory::Arc { span: 60.0 }];
    for trajectory in kinds {
        for seed in 0..3 {
            let right = scene(seed, 130, SyntheticIds::Absent, trajectory);
            let mut map = map();
            let found = told(&observe(&mut map, &right, 0..130));
            assert_eq!((found, map.consistent()), (vec![], Some(true)), "{trajectory:?} {seed}");
        }
    }
}

#[test]
fn a_camera_that_stands_still_is_right() {
    let mut parts = scene(5, 60, SyntheticIds::Absent, Trajectory::Orbit).into_parts();
    let first = parts.frames[0].projection;
    for frame in &mut parts.frames {
        frame.projection = first;
    }
    let of_first: Vec<_> = parts.detections.iter().filter(|d| d.frame_index == 0).cloned().collect();
    parts.detections = (0..60).flat_map(|k| of_first.iter().map(move |d| with_frame(d, k))).collect();
    let still = Scene::from_parts(parts).unwrap();
    let mut map = map();
    assert_eq!(told(&observe(&mut map, &still, 0..60)), []);
}

fn with_frame(detection: &crate::scene::Detection, frame_index: u32) -> crate::scene::Detection {
    crate::scene::Detection { frame_index, ..detection.clone() }
}

#[test]
fn what_the_first_frames_show_alone_stays() {
    for (seed, noise, outlier_share) in [(200_002, 0.0, 0.05), (200_002, 0.01, 0.0), (0, 0.05, 0.3)] {
        let options = SyntheticOptions {
            objects: 10,
            views: 60,
            seed,
            trajectory: Trajectory::Random,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(noise)],
            outlier_share,
            ..Default::default()
        };
        let mut wrong = Mistake(Correction::OpenGlAxes).apply(&generate(&options).unwrap().scene);
        wrong.0.detections.iter_mut().for_each(|d| d.object_index = None);
        let mut map = map();
        let updates = observe(&mut map, &wrong, 0..wrong.frames.len());
        assert_eq!((told(&updates).len(), map.consistent()), (1, Some(false)), "{seed}");
    }
}
