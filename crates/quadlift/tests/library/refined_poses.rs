//! Poses that are refined with the objects.

use quadlift::diagnosis::{BoxFormat, Correction, Mistake};
use quadlift::geometry::{BodyKind, Projection, rotation_vector};
use quadlift::metrics::{iou3d_bodies, nees};
use quadlift::nalgebra::{Rotation3, Vector3, Vector6};
use quadlift::random::{normal, stream};
use quadlift::scene::RigCamera;
use quadlift::solve::{PoseMotion, PosteriorOptions, RefinedPose, Status};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift::{Localization, localize};

/// Cars along a street, with noisy boxes.
fn street(noise: f64) -> SyntheticScene {
    generate(&street_options(noise)).unwrap()
}

fn street_options(noise: f64) -> SyntheticOptions {
    SyntheticOptions {
        seed: 4,
        objects: 24,
        views: 60,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: if noise > 0.0 { vec![Noise::BoxEdges(noise)] } else { Vec::new() },
        ..Default::default()
    }
}

/// The scene with errors of its poses (rotation in radians, shift), and the errors.
fn with_errors(made: &SyntheticScene, sd: [f64; 2], correlation_length: f64) -> (SyntheticScene, Vec<Vector6<f64>>) {
    let mut rng = stream(9, 77);
    let rho = if correlation_length > 0.0 { (-1.0 / correlation_length).exp() } else { 0.0 };
    let mut error = Vector6::from_fn(|_, _| normal(&mut rng));
    let mut errors = Vec::new();
    for _ in &made.scene.frames {
        error = error * rho + Vector6::from_fn(|_, _| normal(&mut rng)) * (1.0 - rho * rho).sqrt();
        errors.push(Vector6::from_fn(|k, _| error[k] * sd[k / 3]));
    }
    let mut made = made.clone();
    made.scene
        .edit(|parts| {
            for (frame, error) in parts.frames.iter_mut().zip(&errors) {
                let turn = Rotation3::new(error.fixed_rows::<3>(0).into_owned());
                let shift = error.fixed_rows::<3>(3).into_owned();
                frame.projection = frame.projection.with_moved_camera(&turn, &shift).unwrap();
            }
        })
        .unwrap();
    (made, errors)
}

fn found(made: &SyntheticScene, refine_poses: Option<PoseMotion>) -> Localization {
    // By the same estimator with and without.
    let body = Some(BodyKind::Ellipsoid);
    let options = PosteriorOptions { body, refine_poses, by_evidence: false, ..Default::default() };
    localize(&made.scene, &options.into()).unwrap()
}

/// Mean IoU and median NEES.
fn scores(made: &SyntheticScene, found: &Localization) -> (f64, f64) {
    let (mut sum, mut errors) = (0.0, Vec::new());
    for estimate in &found.estimates {
        let id = &made.scene.object_ids[estimate.object_index];
        let truth = &made.truth.iter().find(|(name, _)| name == id).unwrap().1;
        sum += estimate.body.map_or(0.0, |body| iou3d_bodies(&body, truth));
        let ellipsoid = estimate.closest_ellipsoid().zip(estimate.covariance);
        errors.extend(ellipsoid.and_then(|(e, c)| nees(&e, &truth.closest_ellipsoid(), &c.matrix)));
    }
    errors.sort_by(f64::total_cmp);
    (sum / found.estimates.len() as f64, errors[errors.len() / 2])
}

/// Root mean square rotation error of poses, less the mean (which no measurement shows).
fn rotation_error(made: &SyntheticScene, given: &SyntheticScene, found: &Localization) -> f64 {
    let turn_of = |p: &Projection| p.world_from_cam_rotation().unwrap();
    let errors: Vec<Vector3<f64>> = (0..made.scene.frames.len())
        .map(|k| {
            let projection = &given.scene.frames[k].projection;
            let refined = found.refined_poses.iter().find(|refined| refined.frame_index == k);
            let moved = refined.and_then(|r| projection.with_moved_camera(&r.turn, &r.shift));
            let difference =
                turn_of(&moved.unwrap_or(*projection)) * turn_of(&made.scene.frames[k].projection).transpose();
            rotation_vector(&Rotation3::from_matrix(&difference))
        })
        .collect();
    let mean = errors.iter().sum::<Vector3<f64>>() / errors.len() as f64;
    (errors.iter().map(|e| (e - mean).norm_squared()).sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn independent_errors_of_poses_are_halved_and_objects_gain() {
    let exact = street(0.02);
    let (given, _) = with_errors(&exact, [0.01, 0.05], 0.0);
    let (before, after) = (found(&given, None), found(&given, Some(PoseMotion::Auto)));
    assert_eq!((before.pose_correlation_length, after.pose_correlation_length), (None, Some(0.0)));
    let (a, b) = (rotation_error(&exact, &given, &before), rotation_error(&exact, &given, &after));
    let (without, with) = (scores(&given, &before), scores(&given, &after));
    println!("independent: rotation {a:.4} -> {b:.4}, IoU and NEES {without:?} -> {with:?}");
    assert!(b < 0.5 * a, "{a} {b}");
    assert!(with.0 > without.0, "{without:?} {with:?}");
}

#[test]
fn slow_errors_of_poses_are_followed() {
    let exact = street(0.02);
    let (given, _) = with_errors(&exact, [0.02, 0.3], 100.0);
    let of = |motion| {
        let found = found(&given, motion);
        (rotation_error(&exact, &given, &found), scores(&given, &found), found.pose_correlation_length)
    };
    let (none, slow) = (of(None), of(Some(PoseMotion::Auto)));
    println!("slow: {none:?} -> {slow:?}");
    assert!(slow.2 >= Some(30.0), "{slow:?}");
    assert!(slow.0 < 0.5 * none.0, "{none:?} {slow:?}");
    assert!(slow.1.0 > none.1.0 + 0.2 && (4.0..14.0).contains(&slow.1.1), "{none:?} {slow:?}");
}

/// Slow errors that are said to be independent would make covariances far too small: the evidence must tell them apart.
#[test]
fn errors_of_a_few_frames_are_told_from_independent_ones() {
    let exact = street(0.03);
    for (correlation_length, expected) in [(0.0, 0.0..1.0), (20.0, 10.0..40.0)] {
        let (given, _) = with_errors(&exact, [0.01, 0.2], correlation_length);
        let found = found(&given, Some(PoseMotion::Auto));
        let chosen = found.pose_correlation_length.unwrap();
        assert!(expected.contains(&chosen), "{correlation_length}: {chosen}");
        let honest = scores(&given, &found).1;
        assert!((4.0..16.0).contains(&honest), "{correlation_length}: {honest}");
    }
}

#[test]
fn exact_poses_are_not_touched() {
    for noise in [0.0, 0.03] {
        let exact = street(noise);
        let (without, with) = (found(&exact, None), found(&exact, Some(PoseMotion::Auto)));
        assert!(with.refined_poses.is_empty() && with.pose_noise.is_none(), "{noise}: {:?}", with.pose_noise);
        let bodies = |found: &Localization| found.estimates.iter().map(|e| e.body).collect::<Vec<_>>();
        assert_eq!(bodies(&without), bodies(&with));
        // Who knows that there are errors has corrections, however small.
        let told = found(&exact, Some(PoseMotion::Independent));
        let moved = told.refined_poses.iter().map(|refined| rotation_vector(&refined.turn).norm()).fold(0.0, f64::max);
        assert!(!told.refined_poses.is_empty() && moved < if noise > 0.0 { 2e-3 } else { 1e-6 }, "{noise}: {moved}");
    }
}

/// The scene with errors of a rig of two cameras, which took two frames that follow each other, and one degree of wrong extrinsics: the same
/// as frames apart, and as a rig.
fn with_errors_of_a_rig(exact: &SyntheticScene) -> [SyntheticScene; 2] {
    let mut rng = stream(9, 78);
    let mut errors = Vec::new();
    let mut given = exact.clone();
    given
        .scene
        .edit(|parts| {
            for (k, frame) in parts.frames.iter_mut().enumerate() {
                if k % 2 == 0 {
                    errors.push(Vector6::from_fn(|i, _| [0.003, 0.05][i / 3] * normal(&mut rng)));
                }
                let error = errors[k / 2];
                let axes = Rotation3::from_matrix(&frame.projection.world_from_cam_rotation().unwrap());
                let own = Rotation3::new(Vector3::new(0.0, 0.017, 0.0) * (k % 2) as f64);
                let turn = Rotation3::new(error.fixed_rows::<3>(0).into_owned()) * axes * own * axes.inverse();
                frame.projection = frame.projection.with_moved_camera(&turn, &error.fixed_rows::<3>(3).into()).unwrap();
            }
        })
        .unwrap();
    let apart = given.clone();
    given
        .scene
        .edit(|parts| {
            for (k, frame) in parts.frames.iter_mut().enumerate() {
                frame.rig = Some(RigCamera { time_step: k as u64 / 2, camera: Some(k as u32 % 2) });
            }
        })
        .unwrap();
    [apart, given]
}

#[test]
fn a_rig_has_one_error_and_wrong_extrinsics_are_found() {
    let exact = street(0.03);
    let of = |given: &SyntheticScene| {
        let found = found(given, Some(PoseMotion::Auto));
        assert!(found.refined_poses.iter().all(|refined| refined.covariance.is_some()));
        (rotation_error(&exact, given, &found), scores(&exact, &found))
    };
    let [apart, rig] = with_errors_of_a_rig(&exact).map(|given| of(&given));
    println!("frames {apart:?}, rig {rig:?}");
    assert!(rig.0 < 0.8 * apart.0 && rig.0 < 0.003, "{apart:?} {rig:?}");
    assert!(rig.1.0 > apart.1.0 && rig.1.1 < apart.1.1.max(14.0), "{apart:?} {rig:?}");
}

#[test]
fn points_tell_the_errors_of_a_rig() {
    let exact = street_with_points(0.03, 1000, 0.5, 0.0);
    let [_, rig] = with_errors_of_a_rig(&exact);
    let boxes = without_points(&rig);
    let [of_boxes, of_points] = [&boxes, &rig].map(|given| {
        let found = found(given, Some(PoseMotion::Auto));
        assert!(found.refined_poses.len() == 60 && found.refined_poses.iter().all(|r| r.covariance.is_some()));
        (rotation_error(&exact, given, &found), scores(&exact, &found), found.pose_points)
    });
    println!("{of_boxes:?} {of_points:?}");
    let report = of_points.2.unwrap();
    assert!(report.problem.is_none() && report.error < Some(0.7), "{report:?}");
    assert!(of_points.0 < 0.7 * of_boxes.0, "{of_boxes:?} {of_points:?}");
}

/// Objects in the middle of cameras on an arc, with noisy boxes.
fn around(seed: u64, objects: usize) -> SyntheticScene {
    generate(&SyntheticOptions {
        seed,
        objects,
        views: 20,
        trajectory: Trajectory::Arc { span: 100.0 },
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        ..Default::default()
    })
    .unwrap()
}

/// Poses that are so wrong that the consistency check refuses the scene are what the refinement is for.
#[test]
fn the_self_check_is_that_of_refined_poses() {
    let exact = around(3, 12);
    let (given, _) = with_errors(&exact, [0.012, 0.2], 0.0);
    let (before, after) = (found(&given, None), found(&given, Some(PoseMotion::Auto)));
    let (a, b) = (before.diagnosis.agreement.unwrap(), after.diagnosis.agreement.unwrap());
    println!("{a:?} {b:?} {:?}", scores(&given, &after));
    assert!(!before.diagnosis.consistent && after.diagnosis.consistent, "{:?} {:?}", before.diagnosis, after.diagnosis);
    assert!(b.miss < 0.3 * a.miss, "{a:?} {b:?}");
    assert!(after.estimates.iter().all(|estimate| estimate.status == Status::Ok));
}

/// A mistake remains one if poses are refined, which explains a part of it.
#[test]
fn common_mistakes_are_not_refined_away() {
    let exact = around(3, 12);
    let formats = [BoxFormat::CenterReadAsCorner, BoxFormat::CornerReadAsCenter, BoxFormat::SwappedAxes];
    let mistakes = (Correction::OF_POSES[..9].iter().copied())
        .chain([0.8, 0.9, 1.1, 1.25].map(Correction::ImageScale))
        .chain([0.8, 1.25].map(Correction::FocalFactor))
        .chain([1, -2].map(Correction::FrameOffset))
        .chain(formats.map(Correction::Boxes))
        .chain([Correction::Letterbox(640.0)]);
    let mut refused = 0;
    for correction in mistakes {
        let mut wrong = exact.clone();
        wrong.scene = Mistake(correction).apply(&exact.scene);
        let before = found(&wrong, None).diagnosis;
        for motion in [PoseMotion::Auto, PoseMotion::Independent, PoseMotion::Slow] {
            let after = found(&wrong, Some(motion)).diagnosis;
            println!("{correction:?} {motion:?}: {:?} {:?}", before.agreement, after.agreement);
            assert_eq!(before.consistent, after.consistent, "{correction:?} {motion:?}: {before:?} {after:?}");
        }
        refused += usize::from(!before.consistent);
    }
    assert!(refused > 15, "{refused}");
}

/// Around a few objects turns and shifts of a camera look alike: neither may be taken for exact.
#[test]
fn poses_around_few_objects_are_not_more_certain_than_they_are() {
    let mut medians = Vec::new();
    for seed in 0..6 {
        let exact = around(seed, 5);
        let (given, _) = with_errors(&exact, [0.008, 3.0], 0.0);
        let found = found(&given, Some(PoseMotion::Auto));
        let of_frame = |refined: &RefinedPose| {
            let [from, to] = [&given, &exact].map(|made| made.scene.frames[refined.frame_index].projection);
            let from = from.with_moved_camera(&refined.turn, &refined.shift).unwrap();
            let [a, b] = [&from, &to].map(|projection| projection.world_from_cam_rotation().unwrap());
            let turn = rotation_vector(&Rotation3::from_matrix(&(b * a.transpose())));
            let shift = to.center_in_world().unwrap() - from.center_in_world().unwrap();
            let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            error.dot(&(refined.covariance.unwrap().try_inverse().unwrap() * error))
        };
        let mut all: Vec<f64> = found.refined_poses.iter().map(of_frame).collect();
        all.sort_by(f64::total_cmp);
        medians.extend(all.get(all.len() / 2));
    }
    println!("NEES of poses {medians:?}");
    // 5.35 is honest; without a prior on the ratio of the levels most are above 1000.
    assert!(medians.len() == 6 && medians.iter().all(|nees| (1.0..30.0).contains(nees)), "{medians:?}");
}

/// The street with points that are tracked through it.
fn street_with_points(noise: f64, points: usize, point_noise: f64, point_mismatches: f64) -> SyntheticScene {
    let options = SyntheticOptions { points, point_noise, point_mismatches, ..street_options(noise) };
    generate(&options).unwrap()
}

fn without_points(made: &SyntheticScene) -> SyntheticScene {
    let mut made = made.clone();
    made.scene.edit(|parts| parts.points.clear()).unwrap();
    made
}

#[test]
fn points_tell_poses_better_than_boxes_do() {
    for (sd, correlation_length, at_most) in [([0.01, 0.05], 0.0, 0.6), ([0.02, 0.3], 100.0, 0.5)] {
        let options = SyntheticOptions { points: 1500, point_mismatches: 0.05, ..street_options(0.02) };
        let exact = generate(&options).unwrap();
        let (given, _) = with_errors(&exact, sd, correlation_length);
        let without = without_points(&given);
        let [of_boxes, of_points] = [&without, &given].map(|given| found(given, Some(PoseMotion::Auto)));
        let report = of_points.pose_points.unwrap();
        assert!(of_boxes.pose_points.is_none() && report.problem.is_none());
        assert!(report.given_error > Some(1.0) && report.error < Some(0.8), "{report:?}");
        assert!((report.noise.unwrap() / 0.5 - 1.0).abs() < 0.15, "{report:?}");
        let (a, b) = (rotation_error(&exact, &without, &of_boxes), rotation_error(&exact, &given, &of_points));
        let (c, d) = (scores(&exact, &of_boxes), scores(&exact, &of_points));
        println!("{correlation_length}: rotation {a:.5} {b:.5}, IoU and NEES {c:.3?} {d:.3?}, {report:?}");
        assert!(b < at_most * a, "{correlation_length}: {b} {a}");
    }
}

#[test]
fn exact_poses_with_points_are_not_touched() {
    for (noise, point_noise, mismatches) in [(0.0, 0.0, 0.0), (0.03, 0.5, 0.0), (0.03, 1.0, 0.05)] {
        let exact = street_with_points(noise, 800, point_noise, mismatches);
        let (without, with) = (found(&exact, None), found(&exact, Some(PoseMotion::Auto)));
        assert!(with.refined_poses.is_empty() && with.pose_noise.is_none(), "{noise}: {:?}", with.pose_noise);
        let bodies = |found: &Localization| found.estimates.iter().map(|e| e.body).collect::<Vec<_>>();
        assert_eq!(bodies(&without), bodies(&with));
        assert!(with.pose_points.unwrap().problem.is_none() && without.pose_points.is_none());
    }
}

/// Points of something else must not move the poses.
#[test]
fn points_that_contradict_the_poses_are_left_out() {
    let exact = street_with_points(0.02, 800, 0.5, 0.0);
    let (given, _) = with_errors(&exact, [0.003, 0.02], 0.0);
    type Change = fn(&mut quadlift::scene::SceneParts);
    let wrong: [(&str, Change); 5] = [
        ("elsewhere", |parts| parts.points.iter_mut().for_each(|point| point.position *= 3.0)),
        ("elsewhere", |parts| {
            let pixels = parts.points.iter_mut().flat_map(|point| &mut point.observations);
            pixels.for_each(|seen| seen.pixel *= 0.5);
        }),
        // Another model: the frames are others.
        ("contradict_poses", |parts| {
            let count = parts.frames.len() as u32;
            for point in &mut parts.points {
                let seen = &mut point.observations;
                seen.iter_mut().for_each(|seen| seen.frame_index = count - 1 - seen.frame_index);
                seen.reverse();
            }
        }),
        // The pixels of other points.
        ("contradict_poses", |parts| {
            let mut rng = stream(3, 3);
            for seen in parts.points.iter_mut().flat_map(|point| &mut point.observations) {
                seen.pixel += quadlift::nalgebra::Vector2::new(normal(&mut rng), normal(&mut rng)) * 80.0;
            }
        }),
        ("no_parallax", |parts| parts.points.iter_mut().for_each(|point| point.observations.truncate(1))),
    ];
    let expected = found(&without_points(&given), Some(PoseMotion::Auto));
    for (name, change) in wrong {
        let mut given = given.clone();
        given.scene.edit(change).unwrap();
        let found = found(&given, Some(PoseMotion::Auto));
        let report = found.pose_points.unwrap();
        println!("{name}: {report}");
        assert_eq!(report.problem.map(|problem| problem.name()), Some(name), "{report:?}");
        assert_eq!(found.refined_poses, expected.refined_poses);
    }
}
