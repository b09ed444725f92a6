//! The map as a whole: what it finds, forgets, refuses and stores.

use std::collections::BTreeMap;

use nalgebra::{Matrix3x4, Matrix4, Rotation3, Vector3};

use super::own_views::{add_late, refit, take_back};
use super::*;
use crate::association::IdPolicy;
use crate::geometry::{BoundingBox, Projection};
use crate::scene::{NewDetection, Scene};
use crate::solve::Status;
use crate::synthetic::{
    Detector, Noise, Observations, SyntheticIds, SyntheticOptions, SyntheticScene, Trajectory, generate,
};

/// Objects seen once around, 20 % missed, 15 % false boxes.
fn around(objects: usize, views: usize, ids: SyntheticIds) -> SyntheticScene {
    generate(&SyntheticOptions {
        objects,
        views,
        cube_side: 60.0,
        trajectory: Trajectory::Orbit,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        detector: Detector { misses: 0.2, false_boxes: 0.15, ..Default::default() },
        ids,
        ..Default::default()
    })
    .unwrap()
}

fn detections(scene: &Scene, frame: usize) -> Vec<NewDetection<'_>> {
    let of_frame = scene.detections.iter().filter(|d| d.frame_index as usize == frame);
    of_frame
        .map(|d| NewDetection {
            category: d.category_index.map(|c| scene.categories[c as usize].as_str()),
            score: d.score,
            object: d.object_index.map(|o| scene.object_ids[o as usize].as_str()),
            ..NewDetection::from_box(d.bounding_box.unwrap())
        })
        .collect()
}

fn observe(map: &mut ObjectMap, scene: &Scene, frames: std::ops::Range<usize>) -> Vec<FrameUpdate> {
    frames
        .map(|k| map.observe(&Frame::of_scene(scene, &scene.frames[k], k as f64), &detections(scene, k)).unwrap())
        .collect()
}

fn map() -> ObjectMap {
    ObjectMap::new(OnlineOptions::default()).unwrap()
}

/// All that determines what the map does, as text.
pub(super) fn numbers(map: &ObjectMap) -> String {
    let memory = &map.memory;
    let sources = (&memory.cue_sources, &memory.scaled_by_frame);
    let names = (memory.categories.names(), sources, &memory.input_ids, &memory.objects.tally);
    let frames = (memory.next_key, &memory.last, &memory.origin, &memory.keyframes, &memory.recent, &memory.windows);
    let objects: Vec<_> = memory.objects.tracked().collect();
    let found = (&memory.tried_pairs, memory.disagreeing, &memory.diagnosis);
    format!("{:?}", (names, frames, objects, &memory.running, found))
}

/// Panics if references or counts are wrong.
pub(super) fn assert_sound(map: &ObjectMap) {
    let memory = &map.memory;
    let mut held: BTreeMap<u32, u32> = BTreeMap::new();
    for view in memory.objects.tracked().flat_map(|tracked| &tracked.views) {
        *held.entry(view.keyframe).or_default() += 1;
    }
    for frame in memory.recent.iter().chain(memory.windows.all()) {
        *held.entry(frame.key).or_default() += 1;
    }
    let references: BTreeMap<u32, u32> = memory.keyframes.iter().map(|(key, k)| (key, k.references)).collect();
    assert_eq!(held, references);
    let views: usize = memory.objects.tracked().map(|tracked| tracked.views.len() + tracked.object.forgotten).sum();
    assert_eq!(memory.running.assigned, views as i64);
    let mut repeats: BTreeMap<ObjectId, u32> = BTreeMap::new();
    for found in memory.recent.iter().flat_map(|frame| &frame.boxes) {
        found.owner.into_iter().for_each(|id| *repeats.entry(id).or_default() += found.repeats());
    }
    let (categories, sources) = (memory.categories.names().len(), memory.cue_sources.len());
    for tracked in memory.objects.tracked() {
        let known = repeats.get(&tracked.id).copied().unwrap_or(0);
        assert!(tracked.repeated >= known, "{} {known}", tracked.repeated);
        assert!(tracked.is_valid(categories, sources));
    }
    memory.objects.assert_sound();
}

/// For each true object the objects of the map whose centers lie within its shortest semi-axis.
fn found(map: &ObjectMap, synthetic: &SyntheticScene) -> Vec<Vec<ObjectId>> {
    let is_at = |object: &MapObject, body: &crate::geometry::Ellipsoid| {
        (object.ellipsoid.center - body.center).norm() < body.semi_axes.min()
    };
    let of = |body: &crate::geometry::Ellipsoid| map.objects().filter(|o| is_at(o, body)).map(|o| o.id).collect();
    synthetic.truth.iter().map(|(_, body)| of(&body.closest_ellipsoid())).collect()
}

#[test]
fn every_object_is_found_once_and_localized() {
    let synthetic = around(12, 60, SyntheticIds::Absent);
    let mut map = map();
    let updates = observe(&mut map, &synthetic.scene, 0..60);
    assert!(found(&map, &synthetic).iter().all(|ids| ids.len() == 1), "{:?}", found(&map, &synthetic));
    assert_eq!((map.objects().count(), map.frames()), (12, 60));
    let count = |is: fn(&Event) -> bool| updates.iter().flat_map(|u| &u.events).filter(|e| is(e)).count();
    assert!(count(|e| matches!(e, Event::Confirmed { .. })) >= 12);
    // A detection is of the object whose id the update has.
    let objects = updates[59].objects.iter().flatten().count();
    assert!(objects >= 6, "{objects}");
    let object = map.objects().next().unwrap();
    assert!(object.existence > 0.99 && object.detections > 30 && object.kept_views == 32, "{object:?}");
    assert!(object.expected_views >= object.detections && object.last_seen > 50.0, "{object:?}");
    let localization = crate::localize(&map.to_averaged_scene(), &crate::LocalizeOptions::default()).unwrap();
    assert!(localization.estimates.iter().all(|e| e.status == Status::Ok && e.covariance.is_some()));
}

#[test]
fn estimates_use_the_views_that_were_forgotten() {
    let synthetic = around(8, 200, SyntheticIds::Absent);
    let mut map = ObjectMap::new(OnlineOptions { max_views: 10, ..Default::default() }).unwrap();
    observe(&mut map, &synthetic.scene, 0..200);
    let bodies: Vec<_> = synthetic.truth.iter().map(|(_, body)| body.closest_ellipsoid()).collect();
    let iou = |scene: &Scene| {
        let localization = crate::localize(scene, &crate::LocalizeOptions::default()).unwrap();
        let estimates: Vec<_> = localization.estimates.iter().map(|e| e.closest_ellipsoid()).collect();
        crate::metrics::score_found(&estimates, &bodies, 0.25).mean_iou3d.unwrap()
    };
    let (kept, averaged) = (map.to_scene(), map.to_averaged_scene());
    let views: u32 = map.memory.objects.tracked().flat_map(|t| &t.views).map(super::views::KeptView::stands_for).sum();
    let detections: usize = map.memory.objects.tracked().map(|t| t.object.views()).sum();
    // Few forgotten boxes are outliers, or have other cut edges than the view that is most like them.
    assert!(views as usize > detections * 9 / 10, "{views} of {detections}");
    assert_eq!(kept.detections.len(), averaged.detections.len());
    // The volume error of the mean of 16 boxes is a quarter; half leaves room for what the Jacobians differ.
    let (of_kept, of_all) = (iou(&kept), iou(&averaged));
    assert!(1.0 - of_all < 0.5 * (1.0 - of_kept), "{of_kept} {of_all}");
}

#[test]
fn views_that_were_fitted_with_another_object_go_back_when_poses_are_updated() {
    let synthetic = generate(&SyntheticOptions {
        objects: 8,
        views: 60,
        cube_side: 20.0,
        trajectory: Trajectory::Orbit,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        detector: Detector { misses: 0.4, ..Default::default() },
        ids: SyntheticIds::Absent,
        ..Default::default()
    })
    .unwrap();
    let scene = &synthetic.scene;
    let mut map = map();
    observe(&mut map, scene, 0..60);
    let true_object = |view: &super::views::KeptView| {
        let mut of_frame = (0..scene.detections.len()).filter(|&d| scene.detections[d].frame_index == view.keyframe);
        synthetic.true_objects[of_frame.nth(usize::from(view.detection)).unwrap()]
    };
    let strays = |map: &ObjectMap| -> usize {
        let of = |tracked: &super::tracked::Tracked| {
            let truths: Vec<_> = tracked.views.iter().map(true_object).collect();
            let most = truths.iter().map(|t| truths.iter().filter(|other| *other == t).count()).max();
            truths.len() - most.unwrap_or(0)
        };
        map.memory.objects.tracked().map(of).sum()
    };
    let before = strays(&map);
    // The nearest pair: the first gives the second its views in frames in which the second has none.
    let objects: Vec<(u32, Vector3<f64>)> = map
        .memory
        .objects
        .slots()
        .into_iter()
        .map(|slot| (slot, map.memory.objects.get(slot).unwrap().object.center))
        .collect();
    let pairs = objects.iter().flat_map(|a| objects.iter().filter(|b| b.0 != a.0).map(move |b| (a, b)));
    let (a, b) = pairs.min_by(|x, y| (x.0.1 - x.1.1).norm().total_cmp(&(y.0.1 - y.1.1).norm())).unwrap();
    let taker = map.memory.objects.get(b.0).unwrap();
    let given: Vec<_> =
        map.memory.objects.get(a.0).unwrap().views.iter().filter(|v| !taker.is_seen_in(v.keyframe)).cloned().collect();
    for view in given {
        map.memory.keyframes.hold(view.keyframe);
        take_back(&mut map.memory, a.0, &view, None, 0);
        add_late(&mut map.memory, b.0, view, None, 0);
    }
    let mut update = FrameUpdate::default();
    refit(&mut map.memory, b.0, &mut update);
    assert!(strays(&map) >= before + 4, "{} {before}", strays(&map));
    let same = scene.frames.iter().map(|f| PoseUpdate { frame: f.id.clone(), projection: f.projection });
    map.update_poses(&same.collect::<Vec<_>>());
    assert!(strays(&map) <= before, "{} {before}", strays(&map));
}

#[test]
fn the_same_frames_give_the_same_map() {
    let synthetic = around(8, 40, SyntheticIds::Tracks { fragments: 0.05, switches: 0.05 });
    let [first, second] = [0; 2].map(|_| {
        let mut map = map();
        observe(&mut map, &synthetic.scene, 0..40);
        numbers(&map)
    });
    assert_eq!(first, second);
}

#[test]
fn an_object_that_is_taken_away_is_gone_and_comes_back() {
    let synthetic = around(6, 120, SyntheticIds::Absent);
    let truth = &synthetic.true_objects;
    // The first object is not there from frame 50 to 99.
    let mut scene = synthetic.scene.clone().into_parts();
    let mut index = 0;
    scene.detections.retain(|d| {
        index += 1;
        !(truth[index - 1] == Some(0) && (50..100).contains(&d.frame_index))
    });
    let scene = Scene::from_parts(scene).unwrap();
    let mut map = map();
    observe(&mut map, &scene, 0..50);
    let id = found(&map, &synthetic)[0][0];
    assert_eq!(map.object(id).unwrap().presence, Presence::Confirmed);
    let gone: Vec<ObjectId> = observe(&mut map, &scene, 50..100)
        .iter()
        .flat_map(|u| &u.events)
        .filter_map(|e| match e {
            Event::Removed { object, reason: Removal::Gone } => Some(*object),
            _ => None,
        })
        .collect();
    assert_eq!(gone, [id], "gone once, whatever false boxes say");
    let object = map.object(id).unwrap();
    // A false box may have counted as a detection since, but one is not enough to bring it back.
    assert!(object.presence == Presence::Gone && object.existence < 0.1, "{object:?}");
    let returned = observe(&mut map, &scene, 100..120);
    assert!(returned.iter().flat_map(|u| &u.events).any(|e| *e == Event::Returned { object: id }));
    assert_eq!(map.object(id).unwrap().presence, Presence::Confirmed);
}

/// A projection in a world that is turned about the origin (about z, radians) and shifted.
fn moved_world(projection: &Projection, turn: f64, shift: Vector3<f64>) -> Projection {
    let mut world = Matrix4::identity();
    world.fixed_view_mut::<3, 3>(0, 0).copy_from(Rotation3::from_axis_angle(&Vector3::z_axis(), turn).matrix());
    world.fixed_view_mut::<3, 1>(0, 3).copy_from(&shift);
    let matrix: Matrix3x4<f64> = projection.matrix() * world.try_inverse().unwrap();
    Projection::from_matrix(matrix).unwrap()
}

#[test]
fn objects_follow_their_frames_after_a_loop_closure_and_duplicates_are_merged() {
    let synthetic = around(12, 80, SyntheticIds::Absent);
    let scene = &synthetic.scene;
    let mut map = map();
    for k in 0..80 {
        let mut frame = Frame::of_scene(scene, &scene.frames[k], k as f64);
        // The world of the second half is turned by 8 degrees and shifted: everything comes up twice.
        if k >= 40 {
            frame.projection = moved_world(&frame.projection, 8f64.to_radians(), Vector3::new(30.0, 0.0, 0.0));
        }
        map.observe(&frame, &detections(scene, k)).unwrap();
    }
    assert!(map.objects().count() >= 20, "{}", map.objects().count());
    let poses: Vec<PoseUpdate> =
        scene.frames.iter().map(|f| PoseUpdate { frame: f.id.clone(), projection: f.projection }).collect();
    let update = map.update_poses(&poses);
    let merged: Vec<(ObjectId, ObjectId)> = update
        .events
        .iter()
        .filter_map(|e| match e {
            Event::Merged { object, alias } => Some((*object, *alias)),
            _ => None,
        })
        .collect();
    assert!(merged.len() >= 8, "{merged:?}");
    assert!(found(&map, &synthetic).iter().all(|ids| ids.len() == 1), "{:?}", found(&map, &synthetic));
    // The older id stays, and the younger one leads to it.
    let (older, younger) = merged[0];
    assert!(older < younger && map.resolve(younger) == map.resolve(older));
    assert_eq!(map.object(younger), map.object(older));
    assert_sound(&map);
}

#[test]
fn frames_that_make_no_sense_are_refused_and_change_nothing() {
    let synthetic = around(6, 30, SyntheticIds::Absent);
    let mut map = map();
    observe(&mut map, &synthetic.scene, 0..20);
    let before = numbers(&map);
    let frame = |id: &str, time: f64| Frame {
        id: id.to_owned(),
        ..Frame::of_scene(&synthetic.scene, &synthetic.scene.frames[20], time)
    };
    let known = synthetic.scene.frames[19].id.clone();
    let good = detections(&synthetic.scene, 20);
    assert_eq!(map.observe(&frame(&known, 20.0), &good), Err(ObserveError::DuplicateFrame(known)));
    assert!(matches!(map.observe(&frame("a", 3.0), &good), Err(ObserveError::TimeWentBack { .. })));
    assert_eq!(map.observe(&frame("a", f64::NAN), &good), Err(ObserveError::Time("a".to_owned())));
    let flat = Frame { image_size: Some([640.0, 0.0].into()), ..frame("a", 20.0) };
    assert!(matches!(map.observe(&flat, &good), Err(ObserveError::ImageSize { .. })));
    let many = vec![good[0]; MAX_DETECTIONS + 1];
    assert!(matches!(map.observe(&frame("a", 20.0), &many), Err(ObserveError::TooManyDetections { .. })));
    let scored = [NewDetection { score: Some(f64::INFINITY), ..good[0] }];
    assert!(matches!(map.observe(&frame("a", 20.0), &scored), Err(ObserveError::Score { detection: 0, .. })));
    let names: Vec<String> = (0..MAX_CATEGORIES).map(|k| k.to_string()).collect();
    let categories: Vec<NewDetection> = names.iter().map(|n| NewDetection { category: Some(n), ..good[0] }).collect();
    assert!(matches!(map.observe(&frame("a", 20.0), &categories), Err(ObserveError::TooManyCategories { .. })));
    assert_eq!(numbers(&map), before);
    assert!(map.observe(&frame("a", 20.0), &good).is_ok());
}

#[test]
fn a_pose_that_jumps_contradicts_the_map_and_does_not_spoil_it() {
    let synthetic = around(10, 40, SyntheticIds::Absent);
    let mut map = map();
    observe(&mut map, &synthetic.scene, 0..30);
    let objects: Vec<MapObject> = map.objects().collect();
    for k in 30..35 {
        let mut frame = Frame::of_scene(&synthetic.scene, &synthetic.scene.frames[k], k as f64);
        frame.projection = moved_world(&frame.projection, 0.35, Vector3::new(30.0, 0.0, 0.0));
        let update = map.observe(&frame, &detections(&synthetic.scene, k)).unwrap();
        assert!(matches!(update.events[..], [Event::Disagrees { expected }] if expected >= 3), "{:?}", update.events);
        assert!(update.objects.iter().all(Option::is_none));
    }
    assert_eq!(map.objects().collect::<Vec<_>>(), objects);
    let after = observe(&mut map, &synthetic.scene, 35..40);
    assert!(after[4].objects.iter().flatten().count() >= 5);
}

#[test]
fn memory_is_bounded() {
    let street = |objects: usize, views: usize| {
        generate(&SyntheticOptions {
            objects,
            views,
            trajectory: Trajectory::Street,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(0.03)],
            detector: Detector { false_boxes: 0.5, ..Default::default() },
            ids: SyntheticIds::Absent,
            ..Default::default()
        })
        .unwrap()
        .scene
    };
    let scene = street(70, 150);
    let options = OnlineOptions { max_objects: 12, max_views: 8, ..Default::default() };
    let mut map = ObjectMap::new(options).unwrap();
    let updates = observe(&mut map, &scene, 0..150);
    assert!(map.objects().count() + map.tentative_objects().count() <= 12);
    assert!(map.objects().all(|o| o.kept_views <= 8));
    assert!(map.keyframes() <= 12 * 8 + 25, "{}", map.keyframes());
    let forgotten = |e: &Event| matches!(e, Event::Removed { reason: Removal::Forgotten, .. });
    assert!(updates.iter().flat_map(|u| &u.events).any(forgotten));
    assert_sound(&map);
}

#[test]
fn users_merge_and_remove_objects() {
    let synthetic = around(6, 40, SyntheticIds::Absent);
    let mut map = map();
    observe(&mut map, &synthetic.scene, 0..40);
    let ids: Vec<ObjectId> = map.objects().map(|o| o.id).collect();
    assert!(map.remove(ids[0]) && !map.remove(ids[0]) && map.object(ids[0]).is_none());
    assert_eq!(map.merge(ids[1], ids[1]), None);
    assert_eq!(map.merge(ids[2], ids[1]), Some(ids[1]));
    assert_eq!(map.object(ids[2]).unwrap().id, ids[1]);
    assert_eq!(map.objects().count(), ids.len() - 2);
    assert_sound(&map);
}

#[test]
fn ids_of_a_tracker_hold_a_crowd_together() {
    let crowd = generate(&SyntheticOptions {
        objects: 40,
        views: 24,
        cube_side: 16.0,
        trajectory: Trajectory::Orbit,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        ids: SyntheticIds::Tracks { fragments: 0.05, switches: 0.05 },
        ..Default::default()
    })
    .unwrap();
    let right = |ids: IdPolicy| {
        let mut map = ObjectMap::new(OnlineOptions { ids, ..Default::default() }).unwrap();
        observe(&mut map, &crowd.scene, 0..24);
        map.settle();
        found(&map, &crowd).iter().filter(|ids| ids.len() == 1).count()
    };
    let (with, without) = (right(IdPolicy::Evidence), right(IdPolicy::Ignore));
    assert!(with >= without && with >= 30, "{with} {without}");
}

#[test]
fn five_thousand_boxes_in_a_frame_take_a_bounded_time() {
    let synthetic = around(10, 20, SyntheticIds::Absent);
    let mut map = map();
    observe(&mut map, &synthetic.scene, 0..10);
    for k in 10..12 {
        let boxes: Vec<NewDetection> = (0..5000)
            .map(|n| {
                let (x, y) = (f64::from(n % 100) * 12.0, f64::from(n / 100) * 18.0);
                NewDetection::from_box(BoundingBox::new([x, y, x + 20.0 + f64::from(n % 7), y + 25.0]).unwrap())
            })
            .collect();
        let update =
            map.observe(&Frame::of_scene(&synthetic.scene, &synthetic.scene.frames[k], k as f64), &boxes).unwrap();
        assert!(update.events.iter().filter(|e| matches!(e, Event::New { .. })).count() <= 500);
    }
    observe(&mut map, &synthetic.scene, 12..20);
    assert_sound(&map);
}

#[test]
fn a_map_takes_other_options_of_their_ranges_only() {
    let other = map().with_options(OnlineOptions { max_views: 5, ..Default::default() }).unwrap();
    assert_eq!(other.options().max_views, 5);
    let error = map().with_options(OnlineOptions { max_views: 3, ..Default::default() }).unwrap_err();
    assert!(error.to_string().contains("maximum number of views"), "{error}");
}
