//! Association as a whole: what it promises on synthetic scenes, and what it does with bad input.

#[path = "crowd_tests.rs"]
mod crowd_tests;

use std::ops::ControlFlow;

use nalgebra::Vector3;

use super::*;
use crate::association::test_scenes::{once, repeated};
use crate::geometry::{BoundingBox, Ellipsoid, Projection};
use crate::metrics::{ClusteringScore, pairwise_clustering_scores, score_found};
use crate::scene::{NewDetection, SceneBuilder};
use crate::synthetic::{
    Detector, Noise, Observations, SyntheticIds, SyntheticOptions, SyntheticScene, Trajectory, generate,
};
use crowd_tests::{anywhere, scene_of};

const DETECTOR: Detector = Detector { misses: 0.2, false_boxes: 0.15, duplicates: 0.0, occlusion: false };

/// 50 objects of one category in a cube of 40, 20 views, edges 5 % off, 20 % missed, 15 % false boxes.
fn base(seed: u64) -> SyntheticOptions {
    SyntheticOptions {
        seed,
        cube_side: 40.0,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.05)],
        detector: DETECTOR,
        ids: SyntheticIds::Absent,
        ..Default::default()
    }
}

fn run(scene: &Scene, options: &AssociateOptions) -> Association {
    associate(scene, options).unwrap()
}

fn true_objects(synthetic: &SyntheticScene) -> Vec<Option<u32>> {
    synthetic.true_objects.iter().map(|t| t.map(|t| t as u32)).collect()
}

/// The score of the division of a synthetic scene.
fn score(make: &SyntheticOptions, options: &AssociateOptions) -> (ClusteringScore, SyntheticScene, Association) {
    let synthetic = generate(make).unwrap();
    let association = run(&synthetic.scene, options);
    (pairwise_clustering_scores(&true_objects(&synthetic), &association.object_of_detection), synthetic, association)
}

#[track_caller]
fn assert_f1(at_least: f64, make: &SyntheticOptions) {
    let found = score(make, &AssociateOptions::default()).0;
    assert!(found.f1 >= at_least, "{found:?}, expected F1 of at least {at_least}");
}

#[test]
fn objects_are_found_without_ids() {
    let (division, synthetic, association) = score(&base(0), &AssociateOptions::default());
    assert!(division.f1 >= 0.995 && division.adjusted_rand_index > 0.98, "{division:?}");
    assert_eq!((association.outcome, division.duplicates), (Outcome::Found, 0));
    let truth: Vec<Ellipsoid> = synthetic.truth.iter().map(|(_, body)| body.closest_ellipsoid()).collect();
    let found: Vec<_> = association.objects.iter().map(|o| o.ellipsoid).collect();
    let found = score_found(&found, &truth, 0.25);
    assert!(found.recall().unwrap() > 0.97 && found.precision().unwrap() > 0.97, "{found:?}");
    assert!((association.edge_noise - 0.05).abs() < 0.01, "{}", association.edge_noise);
    // What is reported fits together.
    for (index, object) in association.objects.iter().enumerate() {
        let members = association.object_of_detection.iter().filter(|&&o| o == Some(index as u32)).count();
        assert!(members == object.views && object.views <= object.expected_views && object.views >= 3);
        assert!(object.evidence.unwrap() > 5.0);
    }
    let assigned = association.object_of_detection.iter().flatten().count();
    assert_eq!(assigned + association.clutter, synthetic.scene.detections.len());
    let uncertain = association.objects.iter().filter(|o| o.uncertain.is_some()).count();
    assert!(uncertain <= 2, "{uncertain}");
}

#[test]
fn crowds_noise_photos_and_streets() {
    assert_f1(0.995, &SyntheticOptions { cube_side: 20.0, ..base(1) });
    let detector = Detector { misses: 0.3, false_boxes: 0.3, ..DETECTOR };
    assert_f1(0.985, &SyntheticOptions { cube_side: 30.0, noise: vec![Noise::BoxEdges(0.1)], detector, ..base(1) });
    let photos = SyntheticOptions { cube_side: 60.0, views: 60, trajectory: Trajectory::Random, ..base(1) };
    assert_f1(0.995, &photos);
    assert_f1(0.99, &SyntheticOptions { views: 80, objects: 44, trajectory: Trajectory::Street, ..base(1) });
    assert_f1(0.97, &SyntheticOptions { detector: Detector { duplicates: 0.2, ..DETECTOR }, ..base(1) });
}

#[test]
fn wrong_poses_are_absorbed_by_shifts_of_the_frames() {
    let (division, _, association) =
        score(&SyntheticOptions { pose_noise: 0.3, ..base(1) }, &AssociateOptions::default());
    assert!(division.f1 >= 0.99, "{division:?}");
    // 0.3 degrees at a focal length of 1500 pixels are 7.9 pixels.
    assert!((association.frame_shift_sd - 7.9).abs() < 2.0, "{}", association.frame_shift_sd);
}

#[test]
fn a_thorough_search_is_no_worse() {
    let make = SyntheticOptions { views: 6, objects: 25, ..base(2) };
    let plain = score(&make, &AssociateOptions::default()).0;
    let thorough = score(&make, &AssociateOptions { thorough: true, ..Default::default() }).0;
    assert!(thorough.f1 >= plain.f1 - 0.005 && thorough.f1 > 0.97, "{plain:?} {thorough:?}");
}

/// The F1 of a synthetic scene whose detections are of three categories, one in ten of them a wrong one; or of none.
fn f1_of_categories(make: &SyntheticOptions, known: bool) -> f64 {
    let mut synthetic = generate(make).unwrap();
    if known {
        synthetic.scene.0.categories = ["cup", "plate", "fork"].map(str::to_owned).to_vec();
        for (index, detection) in synthetic.scene.0.detections.iter_mut().enumerate() {
            let object = synthetic.true_objects[index].unwrap_or(index);
            detection.category_index = Some((object + usize::from(index.is_multiple_of(10))) as u32 % 3);
        }
    }
    let association = run(&synthetic.scene, &AssociateOptions::default());
    assert!(association.objects.iter().all(|object| object.category_index.is_some() == known));
    pairwise_clustering_scores(&true_objects(&synthetic), &association.object_of_detection).f1
}

#[test]
fn categories_help_and_may_be_wrong() {
    assert!(f1_of_categories(&base(3), true) > 0.99);
    // Few views of a crowd, where boxes alone do not tell: .922 without categories, .960 with them.
    let crowd = |seed| SyntheticOptions { cube_side: 20.0, views: 6, noise: vec![Noise::BoxEdges(0.1)], ..base(seed) };
    let mean = |known| (0..4).map(|seed| 0.25 * f1_of_categories(&crowd(seed), known)).sum::<f64>();
    let (without, with) = (mean(false), mean(true));
    assert!(with > 0.94 && with > without + 0.02, "{with} with categories, {without} without");
}

#[test]
fn the_answer_moves_with_the_world_and_does_not_depend_on_the_order_of_the_input() {
    let make = SyntheticOptions { objects: 20, ..base(4) };
    let plain = score(&make, &AssociateOptions::default()).2;
    for (scale, offset) in [(1.0, Vector3::new(1e6, -1e6, 1e6)), (1e-3, Vector3::zeros()), (1e3, Vector3::zeros())] {
        let moved = score(&SyntheticOptions { scale, offset, ..make.clone() }, &AssociateOptions::default()).2;
        assert_eq!(moved.object_of_detection, plain.object_of_detection, "scale {scale}, offset {offset:?}");
    }
    let mut reversed = generate(&make).unwrap().scene;
    reversed.0.detections.reverse();
    let mut found = run(&reversed, &AssociateOptions::default()).object_of_detection;
    found.reverse();
    let division = pairwise_clustering_scores(&plain.object_of_detection, &found);
    assert_eq!((division.f1, division.adjusted_rand_index), (1.0, 1.0));
}

#[cfg(feature = "parallel")]
#[test]
fn any_number_of_threads_gives_the_same_bytes() {
    let scene = generate(&base(5)).unwrap().scene;
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| format!("{:?}", run(&scene, &AssociateOptions::default())))
    };
    let one = on(1);
    assert_eq!(one, on(4));
    assert_eq!(one, on(3));
}

#[test]
fn wrong_ids_are_evidence_and_right_ones_can_be_trusted() {
    let broken = SyntheticIds::Tracks { fragments: 0.1, switches: 0.1 };
    let make = SyntheticOptions { views: 40, objects: 25, ids: broken, ..base(6) };
    let with = |ids| AssociateOptions { ids, ..Default::default() };
    let evidence = score(&make, &with(IdPolicy::Evidence)).0;
    let trusted = score(&make, &with(IdPolicy::Trust)).0;
    assert!(evidence.f1 >= 0.995 && trusted.f1 < 0.6, "{evidence:?} {trusted:?}");
    // True ids come back from both, and nothing is changed by trust.
    let perfect = SyntheticOptions { ids: SyntheticIds::True, ..make };
    for ids in [IdPolicy::Trust, IdPolicy::Evidence] {
        let (division, synthetic, association) = score(&perfect, &with(ids));
        assert!(division.f1 >= 0.995, "{division:?}");
        let applied = association.applied_to(&synthetic.scene, None);
        let id = |scene: &Scene, index: usize| {
            scene.detections[index].object_index.map(|o| scene.object_ids[o as usize].clone())
        };
        for index in 0..applied.detections.len() {
            let (before, after) = (id(&synthetic.scene, index), id(&applied, index));
            if ids == IdPolicy::Trust && before.is_some() {
                assert_eq!(before, after);
            }
            // No object gets the id of another.
            assert!(after.is_none_or(|after| before.is_none_or(|before| before == after)));
        }
    }
    // New names never collide with those of the input.
    let ignored = score(&perfect, &with(IdPolicy::Ignore)).2;
    assert!(ignored.objects.iter().all(|o| !synthetic_id(&o.id)), "{:?}", ignored.objects[0].id);
}

/// Whether an id is one of those that synthetic scenes give their objects.
fn synthetic_id(id: &str) -> bool {
    id.strip_prefix("object_").is_some_and(|number| number.len() == 3)
}

#[test]
fn trusted_ids_keep_theirs_and_draw_what_has_none() {
    let make = SyntheticOptions { objects: 20, ids: SyntheticIds::True, ..base(7) };
    let mut synthetic = generate(&make).unwrap();
    // A third has no id; one object none at all, one a single view with an id only.
    let mut kept_one = false;
    for (index, detection) in synthetic.scene.0.detections.iter_mut().enumerate() {
        let object = synthetic.true_objects[index];
        let keep = match object {
            Some(3) => false,
            Some(4) => !std::mem::replace(&mut kept_one, true),
            _ => !index.is_multiple_of(3),
        };
        if !keep {
            detection.object_index = None;
        }
    }
    let association = run(&synthetic.scene, &AssociateOptions { ids: IdPolicy::Trust, ..Default::default() });
    for (detection, found) in synthetic.scene.detections.iter().zip(&association.object_of_detection) {
        if let Some(id) = detection.object_index {
            let found = &association.objects[found.unwrap() as usize].id;
            assert_eq!(found, &synthetic.scene.object_ids[id as usize]);
        }
    }
    let division = pairwise_clustering_scores(&true_objects(&synthetic), &association.object_of_detection);
    assert!(division.precision > 0.99 && division.recall > 0.95, "{division:?}");
}

#[test]
fn duplicates_and_low_scores_are_left_out_and_counted() {
    let detector = Detector { duplicates: 0.3, false_boxes: 0.0, ..DETECTOR };
    let mut synthetic = generate(&SyntheticOptions { objects: 10, detector, ..base(8) }).unwrap();
    for (index, detection) in synthetic.scene.0.detections.iter_mut().enumerate() {
        // True boxes are better than their duplicates.
        let is_true = synthetic.true_objects[index].is_some();
        detection.score = (!index.is_multiple_of(7)).then_some(if is_true { 0.9 } else { 0.3 });
    }
    let all = synthetic.scene.detections.len();
    let duplicates = synthetic.true_objects.iter().filter(|t| t.is_none()).count();
    let suppressed = run(&synthetic.scene, &AssociateOptions { max_overlap: Some(0.5), ..Default::default() });
    let left_out = suppressed.skipped.duplicate;
    assert!(left_out.abs_diff(duplicates) <= duplicates / 5 + 5, "{left_out} of {duplicates}");
    assert!(suppressed.objects.iter().map(|o| o.views).sum::<usize>() + suppressed.clutter + left_out == all);
    let scored = run(&synthetic.scene, &AssociateOptions { min_score: Some(0.5), ..Default::default() });
    // Detections without a score stay.
    let low = synthetic.scene.detections.iter().filter(|d| d.score == Some(0.3)).count();
    assert_eq!(scored.skipped.low_score, low);
    assert!(
        low > 10
            && scored
                .object_of_detection
                .iter()
                .zip(&synthetic.scene.detections)
                .all(|(o, d)| { d.score != Some(0.3) || o.is_none() })
    );
}

#[test]
fn progress_reaches_its_total() {
    let scene = generate(&SyntheticOptions { objects: 5, ..base(9) }).unwrap().scene;
    let seen = std::sync::Mutex::new(Vec::new());
    let watch = |done: usize, total: usize| {
        seen.lock().unwrap().push((done, total));
        ControlFlow::Continue(())
    };
    associate_observed(&scene, &AssociateOptions::default(), &watch).unwrap();
    let seen = seen.into_inner().unwrap();
    assert!(seen.len() > 20 && seen.iter().all(|&(done, total)| done <= total && total == seen[0].1));
    assert!(seen.last().is_some_and(|&(done, total)| done == total));
}

#[test]
fn an_observer_cancels() {
    let scene = generate(&SyntheticOptions { objects: 5, ..base(9) }).unwrap().scene;
    for last in [1, 7, 30] {
        let cancel =
            |done: usize, _: usize| if done < last { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        let canceled = associate_observed(&scene, &AssociateOptions::default(), &cancel);
        assert_eq!(canceled.unwrap_err(), AssociateError::Canceled);
    }
}

#[test]
fn senseless_options_are_refused() {
    let scene = Scene::default();
    let refused = |change: fn(&mut AssociateOptions)| {
        let mut options = AssociateOptions::default();
        change(&mut options);
        associate(&scene, &options).unwrap_err().to_string()
    };
    assert!(refused(|o| o.wrong_id_share = 0.0).starts_with("the share of wrong ids is 0;"));
    assert!(refused(|o| o.min_views = 1).contains("at least 2"));
    assert!(refused(|o| o.min_score = Some(f64::NAN)).contains("minimum score"));
    assert!(refused(|o| o.max_overlap = Some(1.5)).contains("from 0 to 1"));
    assert!(refused(|o| o.edge_noise_px = Some(-1.0)).contains("positive"));
    assert!(refused(|o| o.source = Some("yolo".into())).contains("no detections of the source"));
}

/// Where boxes are large more slack costs little; in few views of small ones it would cost the objects.
#[test]
fn as_much_slack_is_taken_as_costs_little() {
    let slack = |make: &SyntheticOptions| {
        let (division, _, association) = score(make, &AssociateOptions::default());
        assert!(division.f1 > 0.9, "{division:?}");
        association.edge_noise_px
    };
    assert_eq!(slack(&SyntheticOptions { views: 4, ..base(0) }), 2.0);
    assert_eq!(slack(&base(0)), 2.0);
    assert!(slack(&SyntheticOptions { distance: 80.0, ..base(0) }) >= 4.0);
    let given = AssociateOptions { edge_noise_px: Some(3.0), ..Default::default() };
    assert_eq!(run(&generate(&base(0)).unwrap().scene, &given).edge_noise_px, 3.0);
}

/// What a detector sees again and again in one place and hardly believes in.
#[test]
fn objects_with_low_scores_are_uncertain() {
    let scored = |score: f64| {
        let make = SyntheticOptions { objects: 8, detector: Detector::default(), ..base(4) };
        let mut synthetic = generate(&make).unwrap();
        for (detection, object) in synthetic.scene.0.detections.iter_mut().zip(&synthetic.true_objects) {
            detection.score = Some(if *object == Some(0) { score } else { 0.9 });
        }
        let association = run(&synthetic.scene, &AssociateOptions::default());
        let first = synthetic.true_objects.iter().position(|object| *object == Some(0)).unwrap();
        let found = association.object_of_detection[first].map(|object| association.objects[object as usize].uncertain);
        (association.objects.len(), found)
    };
    assert_eq!(scored(0.9), (8, Some(None)));
    assert_eq!(scored(0.04), (8, Some(Some(AssociationWarning::LowScores))));
}

#[test]
fn bad_input_ends_in_an_outcome() {
    let outcome = |scene: &Scene| {
        let association = run(scene, &AssociateOptions::default());
        assert_eq!(association.object_of_detection.len(), scene.detections.len());
        association.outcome
    };
    assert_eq!(outcome(&Scene::default()), Outcome::NoDetections);
    assert_eq!(outcome(&scene_of(20, |_| Vec::new())), Outcome::NoDetections);
    // All in one frame; in two.
    let in_one = |frame| if frame == 3 { anywhere(300, 0) } else { Vec::new() };
    assert_eq!(outcome(&scene_of(20, in_one)), Outcome::TooFewFrames);
    assert_eq!(outcome(&scene_of(2, |_| anywhere(40, 1))), Outcome::TooFewFrames);
    let pairs = AssociateOptions { min_views: 2, ..Default::default() };
    let two = SyntheticOptions { views: 2, objects: 6, detector: Detector::default(), ..base(0) };
    let (division, _, association) = score(&two, &pairs);
    let views: Vec<usize> = association.objects.iter().map(|o| o.views).collect();
    assert_eq!((division.f1, views), (1.0, vec![2; 6]));
    // Every detection is false: chance makes few objects of them.
    let association = run(&scene_of(10, |frame| anywhere(20, frame)), &AssociateOptions::default());
    assert!(association.clutter > 150, "{}", association.clutter);
    assert!(run(&scene_of(10, |frame| anywhere(10, frame)), &AssociateOptions::default()).objects.is_empty());
    // Always the same box, in the middle of what the cameras look at: one thing that stands there.
    let same = run(&scene_of(12, |_| vec![[600.0, 400.0, 700.0, 500.0]]), &AssociateOptions::default());
    assert_eq!((same.objects.len(), same.objects[0].views, same.clutter), (1, 12, 0));
    let same_many = run(&scene_of(6, |_| vec![[600.0, 400.0, 700.0, 500.0]; 30]), &AssociateOptions::default());
    // Each object has one of the boxes of a frame at most, and no box is counted twice.
    let frames = scene_of(6, |_| vec![[600.0, 400.0, 700.0, 500.0]; 30]).0.detections;
    for object in 0..same_many.objects.len() as u32 {
        let of_object = same_many.object_of_detection.iter().zip(&frames).filter(|(o, _)| **o == Some(object));
        let mut seen: Vec<u32> = of_object.map(|(_, detection)| detection.frame_index).collect();
        let views = seen.len();
        seen.dedup();
        assert_eq!((seen.len(), views), (views, same_many.objects[object as usize].views));
    }
    let assigned = same_many.object_of_detection.iter().flatten().count();
    assert_eq!((assigned + same_many.clutter, same_many.object_of_detection.len()), (180, 180));
}

#[test]
fn scores_may_be_missing_or_of_any_size() {
    let plain = generate(&SyntheticOptions { objects: 15, ..base(8) }).unwrap().scene;
    let mut scored = plain.clone();
    for (index, detection) in scored.0.detections.iter_mut().enumerate() {
        detection.score = [None, Some(-3.0), Some(1e300), Some(f64::NAN), Some(0.5)][index % 5];
    }
    // Without a minimum score and without duplicates to choose from they change nothing.
    let found = run(&scored, &AssociateOptions::default());
    assert_eq!(found, run(&plain, &AssociateOptions::default()));
    let strict = AssociateOptions { min_score: Some(0.5), max_overlap: Some(0.9), ..Default::default() };
    let found = run(&scored, &strict);
    let low = scored.detections.iter().filter(|d| d.score == Some(-3.0)).count();
    assert_eq!(found.skipped.low_score, low);
    let associated = found.object_of_detection.iter().zip(&scored.detections);
    assert!(associated.filter(|(object, _)| object.is_some()).all(|(_, d)| d.score != Some(-3.0)));
    // All too low: nothing takes part.
    let none = run(&scored, &AssociateOptions { min_score: Some(f64::MAX), ..Default::default() });
    let without_score = scored.detections.iter().filter(|d| d.score.is_none_or(f64::is_nan)).count();
    assert_eq!(none.skipped.low_score, scored.detections.len() - without_score);
}

#[test]
fn cameras_that_share_nothing_give_nothing() {
    // Back to back, each with boxes of its own.
    let mut scene = scene_of(6, |frame| anywhere(15, frame));
    for (index, frame) in scene.0.frames.iter_mut().enumerate() {
        let angle = std::f64::consts::TAU * index as f64 / 6.0;
        let turn = nalgebra::Rotation3::from_euler_angles(0.0, angle, 0.0);
        let intrinsics = nalgebra::Matrix3::new(1500.0, 0.0, 640.0, 0.0, 1500.0, 480.0, 0.0, 0.0, 1.0);
        let matrix = intrinsics * nalgebra::Matrix3x4::identity();
        let mut turned = matrix;
        turned.fixed_columns_mut::<3>(0).copy_from(&(matrix.fixed_columns::<3>(0) * turn.matrix()));
        frame.projection = Projection::from_matrix(turned).unwrap();
    }
    let association = run(&scene, &AssociateOptions::default());
    assert_eq!((association.outcome, association.clutter), (Outcome::NothingAgrees, 90));
}

/// Without bounds this takes hours; how long it takes is measured by the bench `crowds`.
#[test]
fn a_mass_of_boxes_is_answered() {
    let crowded = scene_of(10, |frame| anywhere(if frame == 4 { 5000 } else { 20 }, frame));
    let found = run(&crowded, &AssociateOptions::default());
    assert_eq!(found.object_of_detection.len(), 5180);
    // Boxes in one place of every image, and poses that differ.
    let stacked = scene_of(8, |_| vec![[600.0, 400.0, 660.0, 460.0]; 100]);
    let found = run(&stacked, &AssociateOptions::default());
    assert_eq!(found.object_of_detection.len(), 800);
}

#[test]
fn what_moves_is_uncertain_or_no_object() {
    let make = SyntheticOptions { views: 60, objects: 38, trajectory: Trajectory::Street, ..base(3) };
    let mut synthetic = generate(&make).unwrap();
    let standing = true_objects(&synthetic);
    // A car that drives ahead, faster and on the other lane, and one that comes towards the camera.
    let mut moving = Vec::new();
    for (frame, camera) in synthetic.scene.frames.clone().iter().enumerate() {
        let along = frame as f64;
        for (x, y) in [(10.0 + 1.4 * along, -2.0), (70.0 - 0.6 * along, 2.5)] {
            let body = Ellipsoid {
                center: nalgebra::Point3::new(x, y, 0.75),
                semi_axes: Vector3::new(2.1, 0.85, 0.75),
                rotation: nalgebra::Rotation3::identity(),
            };
            let Ok(outline) = crate::geometry::project_ellipsoid(&camera.projection, &body) else { continue };
            let seen = outline.bounding_box();
            if seen.x0 > 0.0 && seen.x1 < 1242.0 && seen.mean_half_size() > 8.0 {
                let mut detection = synthetic.scene.detections[0].clone();
                (detection.frame_index, detection.bounding_box) = (frame as u32, Some(seen));
                moving.push(synthetic.scene.detections.len());
                synthetic.scene.0.detections.push(detection);
            }
        }
    }
    assert!(moving.len() > 60, "{}", moving.len());
    let association = run(&synthetic.scene, &AssociateOptions::default());
    let division = pairwise_clustering_scores(&standing, &association.object_of_detection[..standing.len()]);
    assert!(division.f1 > 0.98, "{division:?}");
    let mut trusted = 0;
    for &index in &moving {
        let object = association.object_of_detection[index].map(|o| &association.objects[o as usize]);
        trusted += usize::from(object.is_some_and(|o| o.uncertain.is_none()));
    }
    assert!(trusted * 2 < moving.len(), "{trusted} of {} boxes of what moves", moving.len());
}

/// The same scene in another unit of length: what was `1` is `unit` long.
fn in_unit(scene: &Scene, unit: f64) -> Scene {
    let mut scene = scene.clone();
    for frame in &mut scene.0.frames {
        let mut matrix = *frame.projection.matrix();
        matrix.column_mut(3).scale_mut(unit);
        frame.projection = Projection::from_matrix(matrix).unwrap();
    }
    scene
}

#[test]
fn evidence_does_not_depend_on_the_unit_of_length() {
    // A lone object tells nothing of the volume in which objects may be.
    for objects in [1, 2] {
        let noise = vec![Noise::BoxEdges(0.1)];
        let make =
            SyntheticOptions { objects, views: 4, noise, detector: Detector::default(), cube_side: 20.0, ..base(6) };
        let scene = generate(&make).unwrap().scene;
        let evidence = |unit: f64| -> Vec<f64> {
            run(&in_unit(&scene, unit), &AssociateOptions::default())
                .objects
                .iter()
                .map(|o| o.evidence.unwrap())
                .collect()
        };
        let in_meters = evidence(1.0);
        assert_eq!(in_meters.len(), objects);
        for unit in [1e-3, 1e3] {
            let other = evidence(unit);
            assert_eq!(other.len(), objects, "{unit}");
            for (a, b) in in_meters.iter().zip(other) {
                assert!((a - b).abs() < 1e-3, "{a} with the unit 1, {b} with the unit {unit}");
            }
        }
    }
}

/// Without a part less is found; see `quadlift-bench association` for what each is worth elsewhere.
#[test]
fn parts_are_worth_their_time() {
    let duplicates = |seed| SyntheticOptions { detector: Detector { duplicates: 0.2, ..DETECTOR }, ..base(seed) };
    let four_views = |seed| SyntheticOptions { views: 4, ..base(seed) };
    for (part, scenes, least) in [
        (Part::Nested, vec![duplicates(0), duplicates(1)], 0.012),
        (Part::SecondPass, vec![four_views(1), four_views(4)], 0.01),
    ] {
        let f1 = |without| {
            let options = AssociateOptions { without, ..Default::default() };
            scenes.iter().map(|make| score(make, &options).0.f1).sum::<f64>() / scenes.len() as f64
        };
        let (with, without) = (f1(None), f1(Some(part)));
        assert!(with > without + least, "{part:?}: {with} with it, {without} without");
    }
}

#[test]
fn copies_of_frames_change_nothing_but_the_counts() {
    for ids in [SyntheticIds::Absent, SyntheticIds::True] {
        let synthetic = once(ids);
        let options = AssociateOptions::default();
        let found = associate(&synthetic.scene, &options).unwrap();
        let again = associate(&repeated(&synthetic.scene, 10), &options).unwrap();
        assert_eq!(found.objects.len(), again.objects.len());
        let copied: Vec<_> = found.object_of_detection.iter().flat_map(|&object| [object; 10]).collect();
        assert_eq!(pairwise_clustering_scores(&copied, &again.object_of_detection).f1, 1.0);
        assert_eq!(again.clutter, 10 * found.clutter);
        for (one, ten) in found.objects.iter().zip(&again.objects) {
            assert_eq!((10 * one.views, &one.id), (ten.views, &ten.id));
            assert!((one.evidence.unwrap() - ten.evidence.unwrap()).abs() < 1e-6, "{one:?} {ten:?}");
        }
    }
}
