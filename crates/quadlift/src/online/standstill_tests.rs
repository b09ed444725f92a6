//! A camera that waits: on a street, at the start and on the way.

use std::collections::HashMap;

use nalgebra::{Matrix3x4, Matrix4, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::super::tests::assert_sound;
use super::super::{DetectionRef, Event, Frame, FrameUpdate, ObjectId, ObjectMap, OnlineOptions};
use super::RecentFrame;
use crate::geometry::{BoundingBox, Projection};
use crate::metrics::pairwise_clustering_scores;
use crate::scene::{NewDetection, Scene};
use crate::synthetic::{Detector, Noise, Observations, SyntheticOptions, Trajectory, generate};

const VIEWS: usize = 60;

/// A detection: its box and its true object, if it is not a false one.
type Seen = (BoundingBox, Option<String>);

/// The frames of a drive along parked cars with their detections.
fn street(seed: u64) -> Vec<(Frame, Vec<Seen>)> {
    let options = SyntheticOptions {
        objects: 37,
        views: VIEWS,
        seed,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        detector: Detector { misses: 0.1, ..Default::default() },
        ..Default::default()
    };
    let scene: Scene = generate(&options).unwrap().scene;
    let of_frame = |(k, frame): (usize, &crate::scene::Frame)| {
        let found = scene.detections.iter().filter(|d| d.frame_index as usize == k);
        let seen = found
            .map(|d| (d.bounding_box.unwrap(), d.object_index.map(|object| scene.object_ids[object as usize].clone())));
        (Frame::of_scene(&scene, frame, k as f64), seen.collect())
    };
    scene.frames.iter().enumerate().map(of_frame).collect()
}

/// The same where the camera waits in a frame, with new errors of its boxes and boxes that are missed.
fn waiting(mut frames: Vec<(Frame, Vec<Seen>)>, at: usize, copies: usize) -> Vec<(Frame, Vec<Seen>)> {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let (frame, seen) = frames[at].clone();
    let copy = |k: usize| {
        let frame = Frame { id: format!("{}-{k}", frame.id), ..frame.clone() };
        let mut again = Vec::new();
        for (bounds, object) in &seen {
            let half = bounds.mean_half_size();
            let edges = bounds
                .edges()
                .map(|edge| edge + 0.05 * half * (random.random::<f64>() * 12.0_f64.sqrt() - 3.0_f64.sqrt()));
            if random.random::<f64>() > 0.1 {
                again.push((BoundingBox::new(edges).unwrap(), object.clone()));
            }
        }
        (frame, again)
    };
    let again: Vec<_> = (0..copies).map(copy).collect();
    frames.splice(at + 1..at + 1, again);
    frames
}

/// The frames with poses of a GPS: each is off by about a centimeter, and the errors drift by as much from frame to frame if they walk.
fn with_gps(mut frames: Vec<(Frame, Vec<Seen>)>, walks: bool) -> Vec<(Frame, Vec<Seen>)> {
    let mut random = ChaCha8Rng::seed_from_u64(8);
    let mut drift = Vector3::zeros();
    for (frame, _) in &mut frames {
        let mut error = || Vector3::from_fn(|_, _| 0.035 * (random.random::<f64>() - 0.5));
        if walks {
            drift += error();
        }
        let moved = Matrix4::new_translation(&(drift + error()));
        frame.projection = Projection::from_matrix(frame.projection.matrix() * moved).unwrap();
    }
    frames
}

/// What a map has found: the object of each detection at the end, F1 of pairs of detections of one object.
struct Found {
    map: ObjectMap,
    f1: f64,
    objects: HashMap<(String, usize), ObjectId>,
}

fn observe(frames: &[(Frame, Vec<Seen>)], with_ids: bool) -> Found {
    let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
    let mut objects: HashMap<(String, usize), ObjectId> = HashMap::new();
    let mut take = |update: &FrameUpdate, frame: &str| {
        for (k, object) in update.objects.iter().enumerate() {
            if let Some(object) = object {
                objects.insert((frame.to_owned(), k), *object);
            }
        }
        for event in &update.events {
            let (object, detections) = match event {
                Event::New { object, detections } => (Some(*object), detections),
                Event::Reassigned { object, detections } => (*object, detections),
                Event::Removed { object, .. } => {
                    objects.retain(|_, owner| owner != object);
                    continue;
                }
                _ => continue,
            };
            for detection in detections {
                let place = (detection.frame.clone(), detection.detection);
                match object {
                    Some(object) => objects.insert(place, object),
                    None => objects.remove(&place),
                };
            }
        }
    };
    for (k, (frame, seen)) in frames.iter().enumerate() {
        let detections: Vec<NewDetection> = seen
            .iter()
            .map(|(bounds, id)| NewDetection {
                object: id.as_deref().filter(|_| with_ids),
                ..NewDetection::from_box(*bounds)
            })
            .collect();
        let update = map.observe(&Frame { time: k as f64, ..frame.clone() }, &detections).unwrap();
        take(&update, &frame.id);
    }
    take(&map.settle(), "");
    assert_sound(&map);
    let mut names: HashMap<&str, u32> = HashMap::new();
    let (mut truth, mut found) = (Vec::new(), Vec::new());
    for (frame, seen) in frames {
        for (k, (_, object)) in seen.iter().enumerate() {
            let next = names.len() as u32;
            truth.push(object.as_deref().map(|name| *names.entry(name).or_insert(next)));
            let owner = objects.get(&(frame.id.clone(), k)).map(|id| map.resolve(*id));
            found.push(owner.filter(|id| map.object(*id).is_some()).map(|id| id.0 as u32));
        }
    }
    let f1 = pairwise_clustering_scores(&truth, &found).f1;
    Found { map, f1, objects }
}

#[test]
fn objects_are_those_of_a_camera_that_does_not_wait() {
    for seed in 0..3 {
        for with_ids in [false, true] {
            let moving = observe(&street(seed), with_ids);
            for at in [0, 1, VIEWS / 3] {
                let found = observe(&waiting(street(seed), at, 200), with_ids);
                let counts = [&moving, &found].map(|found| found.map.objects().count());
                assert!(
                    found.f1 > moving.f1 - 0.03 && counts[0].abs_diff(counts[1]) <= 2,
                    "seed {seed}, ids {with_ids}, at {at}: {} and {}, {counts:?}",
                    found.f1,
                    moving.f1
                );
            }
        }
    }
}

#[test]
fn errors_of_poses_are_no_motion() {
    for seed in 0..3 {
        let moving = observe(&street(seed), false);
        for (at, walks) in [(0, false), (0, true), (VIEWS / 3, true), (VIEWS - 1, true)] {
            let found = observe(&with_gps(waiting(street(seed), at, 84), walks), false);
            let is_right = found.f1 > moving.f1 - 0.03 && found.map.consistent() != Some(false);
            assert!(is_right, "seed {seed}, at {at}, {walks}: {} {}", found.f1, moving.f1);
        }
    }
}

#[test]
fn detections_before_the_first_motion_get_their_objects_afterwards() {
    let frames = waiting(street(1), 0, 100);
    let found = observe(&frames, false);
    let waited = &frames[..101];
    let all: usize = waited.iter().map(|(_, seen)| seen.len()).sum();
    let with_object = waited.iter().flat_map(|(frame, seen)| (0..seen.len()).map(|k| (frame.id.clone(), k)));
    let with_object = with_object.filter(|place| found.objects.contains_key(place)).count();
    assert!(with_object * 10 >= all * 8, "{with_object} of {all}");
}

#[test]
fn copies_are_no_evidence() {
    // Nothing else is ever seen.
    let frames = waiting(street(2), 0, 300);
    let map = observe(&frames[..301], false).map;
    assert_eq!((map.objects().count(), map.tentative_objects().count(), map.frames()), (0, 0, 301));
    assert!(map.keyframes() <= 1, "{}", map.keyframes());
    let [moving, waited] = [street(2), waiting(street(2), VIEWS / 3, 300)].map(|frames| observe(&frames, false).map);
    let evidence = |map: &ObjectMap| map.objects().map(|object| object.evidence).sum::<f64>();
    let detections = |map: &ObjectMap| map.objects().map(|object| object.detections).sum::<usize>();
    assert!(evidence(&waited) < 1.1 * evidence(&moving), "{} {}", evidence(&waited), evidence(&moving));
    assert!(detections(&waited) > detections(&moving) + 600);
}

#[test]
fn false_boxes_of_a_place_are_no_boxes_of_objects() {
    let view = |detection| super::KeptView {
        keyframe: 0,
        detection,
        edges: [0.0, 0.0, 10.0, 10.0],
        in_image: None,
        absorbed: None,
        cues: None,
        shape: None,
        score: None,
        log_clutter: 0.0,
        category: 0,
        cut: 0,
        hidden: 0,
    };
    let copy = DetectionRef { frame: "a".to_owned(), detection: 0 };
    let boxes = [5, 0].map(|copies| super::RecentBox {
        view: view(copies as u16),
        input_id: None,
        owner: None,
        copies: vec![copy.clone(); copies],
    });
    let frame = |repeats| RecentFrame { key: 0, time: 0.0, boxes: boxes.to_vec(), repeats };
    let free = |repeats| [0, 1].map(|index| frame(repeats).is_free(index));
    assert_eq!([free(0), free(3), free(12), free(30)], [[true, true], [true, true], [true, false], [false, false]]);
}

#[test]
fn every_detection_of_a_camera_that_moves_slowly_counts() {
    // 10 px an image before two cups of 100 px.
    let mut map = ObjectMap::new(OnlineOptions::default()).unwrap();
    for k in (0..30).filter(|&k| k != 7) {
        let x = -1.5 + 3.0 / 29.0 * f64::from(k);
        let p = Matrix3x4::new(500.0, 0.0, 320.0, -500.0 * x, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0);
        let mut frame = Frame::new(k.to_string(), f64::from(k), Projection::from_matrix(p).unwrap());
        frame.image_size = Some([640.0, 480.0].into());
        let cups = [-0.75, 0.75].map(|center| {
            let u = 320.0 + 100.0 * (center - x);
            NewDetection::from_box(BoundingBox::new([u - 50.0, 190.0, u + 50.0, 290.0]).unwrap())
        });
        map.observe(&frame, &cups).unwrap();
    }
    let detections: Vec<usize> = map.objects().map(|object| object.detections).collect();
    assert_eq!(detections, [29, 29]);
}
