//! Right scenes are called right, and mistakes by their names.

use super::{BoxFormat, CameraParts, CauseName, Correction, Diagnosis, Mistake, diagnose, diagnose_association};
use crate::association::{AssociateOptions, associate};
use crate::scene::{Frame, RigCamera, Scene};
use crate::synthetic::{Noise, Observations, SyntheticOptions, Trajectory, generate};

fn scene(trajectory: Trajectory, seed: u64) -> Scene {
    let options = SyntheticOptions {
        seed,
        objects: 10,
        views: 12,
        trajectory,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.02)],
        ..Default::default()
    };
    generate(&options).unwrap().scene
}

fn mistakes() -> Vec<Correction> {
    let mut all = Correction::OF_POSES.to_vec();
    all.extend([
        Correction::FocalFactor(1.7),
        Correction::NormalizedIntrinsics,
        Correction::CenteredPrincipalPoint,
        Correction::ImageScale(0.5),
        Correction::ImageScale(1.5),
        Correction::Letterbox(640.0),
        Correction::NormalizedLetterbox,
        Correction::NormalizedBoxes,
        Correction::Boxes(BoxFormat::CornersReadAsSize),
        Correction::Boxes(BoxFormat::CenterReadAsCorner),
        Correction::Boxes(BoxFormat::CornerReadAsCenter),
        Correction::Boxes(BoxFormat::CornersReadAsCenter),
        Correction::Boxes(BoxFormat::SwappedAxes),
        Correction::TurnedPictures { orientation: 2, fractions: false },
        Correction::TurnedPictures { orientation: 3, fractions: false },
        Correction::TurnedPictures { orientation: 6, fractions: false },
        Correction::TurnedPictures { orientation: 6, fractions: true },
        Correction::TurnedPictures { orientation: 8, fractions: true },
        Correction::FrameOffset(1),
        Correction::FrameOffset(-2),
        Correction::ReversedFrames,
    ]);
    all
}

#[test]
fn corrections_undo_their_mistakes() {
    let right = scene(Trajectory::Random, 4);
    for correction in mistakes() {
        let restored = correction.apply(&Mistake(correction).apply(&right));
        for (a, b) in right.frames.iter().zip(&restored.frames) {
            // The principal point of the synthetic cameras is in the middle.
            let expected = a.projection.matrix();
            let difference = (expected - b.projection.matrix()).norm() / expected.norm();
            assert!(difference < 1e-9, "{correction:?}: {difference}");
        }
        // Detections that an offset moves out of the trajectory are lost.
        for detection in &restored.detections {
            let same = right.detections.iter().any(|other| {
                let edges = |d: &crate::scene::Detection| d.bounding_box.unwrap().edges();
                other.frame_index == detection.frame_index
                    && other.object_index == detection.object_index
                    && edges(other).iter().zip(edges(detection)).all(|(a, b)| (a - b).abs() < 1e-6)
            });
            assert!(same, "{correction:?}: {detection:?}");
        }
    }
}

#[test]
fn right_scenes_agree() {
    for trajectory in [Trajectory::default(), Trajectory::Orbit, Trajectory::Random, Trajectory::Street] {
        let diagnosis = diagnose(&scene(trajectory, 1), |_| true);
        assert!(diagnosis.consistent && diagnosis.causes.is_empty(), "{trajectory:?}: {diagnosis:?}");
        assert!(diagnosis.agreement.unwrap().miss < 0.1, "{trajectory:?}: {diagnosis:?}");
    }
}

#[test]
fn mistakes_are_named() {
    let right = scene(Trajectory::Orbit, 2);
    for correction in mistakes() {
        let diagnosis = diagnose(&Mistake(correction).apply(&right), |_| true);
        assert!(!diagnosis.consistent, "{correction:?}: {diagnosis:?}");
        let cause = diagnosis.causes.first();
        assert_eq!(cause.map(|cause| cause.name), Some(correction.cause()), "{correction:?}: {diagnosis:?}");
        let (found, expected) = (cause.unwrap().value, correction.value());
        assert!(found.zip(expected).is_none_or(|(a, b)| (a / b - 1.0).abs() < 0.05), "{found:?} {expected:?}");
    }
}

#[test]
fn names_are_all_different() {
    let names: std::collections::BTreeSet<_> = CauseName::ALL.iter().map(|cause| cause.name()).collect();
    assert_eq!(names.len(), CauseName::ALL.len());
}

#[test]
fn a_scene_without_objects_has_nothing_to_disagree() {
    let diagnosis = diagnose(&Scene::default(), |_| true);
    assert!(diagnosis.consistent && diagnosis.agreement.is_none());
}

fn diagnose_without_ids(scene: &Scene) -> Diagnosis {
    let mut scene = scene.clone();
    scene.0.detections.iter_mut().for_each(|detection| detection.object_index = None);
    scene.0.object_ids.clear();
    let options = AssociateOptions::default();
    let association = associate(&scene, &options).unwrap();
    diagnose_association(&scene, &association, &options).unwrap()
}

#[test]
fn mistakes_are_named_without_ids() {
    let right = scene(Trajectory::Orbit, 2);
    assert!(diagnose_without_ids(&right).consistent);
    let mistakes = [
        Correction::InvertPoses,
        Correction::OpenGlAxes,
        Correction::InvertOpenGlPoses,
        Correction::NormalizedIntrinsics,
        Correction::ImageScale(1.6),
        Correction::Letterbox(640.0),
        Correction::NormalizedLetterbox,
        Correction::NormalizedBoxes,
        Correction::FrameOffset(1),
    ];
    for correction in mistakes {
        let diagnosis = diagnose_without_ids(&Mistake(correction).apply(&right));
        assert!(!diagnosis.consistent, "{correction:?}: {diagnosis:?}");
        let cause = diagnosis.causes.first();
        assert_eq!(cause.map(|cause| cause.name), Some(correction.cause()), "{correction:?}: {diagnosis:?}");
        let (found, expected) = (cause.unwrap().value, correction.value());
        assert!(found.zip(expected).is_none_or(|(a, b)| (a / b - 1.0).abs() < 0.1), "{found:?} {expected:?}");
    }
}

/// The scene with the steps of its trajectory multiplied by a factor from the middle on.
fn with_scale_jump(scene: &Scene, factor: f64) -> Scene {
    let camera = |frame: &Frame| CameraParts::from_projection(&frame.projection).unwrap();
    let middle = scene.frames.len() / 2;
    let anchor = camera(&scene.frames[middle - 1]).center();
    let mut jumped = scene.clone();
    for frame in &mut jumped.0.frames[middle..] {
        let camera = camera(frame);
        let center = anchor + (camera.center() - anchor) * factor;
        frame.projection = camera.with_center(&center).projection().unwrap();
    }
    jumped
}

#[test]
fn a_jump_of_the_scale_is_named_with_its_factor() {
    for (trajectory, factor) in [(Trajectory::Orbit, 0.5), (Trajectory::Random, 1.4), (Trajectory::default(), 1.25)] {
        let diagnosis = diagnose(&with_scale_jump(&scene(trajectory, 2), factor), |_| true);
        assert!(!diagnosis.consistent, "{trajectory:?}: {diagnosis:?}");
        assert_eq!(diagnosis.causes[0].name, CauseName::ScaleJump, "{trajectory:?}: {diagnosis:?}");
        let found = diagnosis.causes[0].value.unwrap() * factor;
        assert!((found - 1.0).abs() < 0.1, "{trajectory:?}: {found}");
    }
}

#[test]
fn repeated_poses_are_named_with_their_share() {
    for (repeated, consistent) in [(12, false), (5, false), (0, true)] {
        let mut scene = scene(Trajectory::Orbit, 2);
        for frame in 12 - repeated..12 {
            scene.0.frames[frame].projection = scene.frames[12 - repeated].projection;
        }
        let diagnosis = diagnose(&scene, |_| true);
        assert_eq!(diagnosis.consistent, consistent, "{repeated}: {diagnosis:?}");
        assert_eq!(diagnosis.causes.first().map(|c| c.name), (!consistent).then_some(CauseName::DuplicatePoses));
        let share = diagnosis.causes.first().and_then(|c| c.value);
        assert!(share.is_none_or(|share| (share * 12.0 - (f64::from(repeated as u32) - 1.0)).abs() < 1.5), "{share:?}");
    }
}

#[test]
fn a_camera_that_stands_still_repeats_its_pose_rightly() {
    let mut scene = scene(Trajectory::Orbit, 2);
    for frame in 6..12 {
        scene.0.frames[frame].projection = scene.frames[5].projection;
        let first: Vec<_> = scene.detections.iter().filter(|d| d.frame_index == 5).cloned().collect();
        for d in scene.0.detections.iter_mut().filter(|d| d.frame_index == frame as u32) {
            d.bounding_box = first.iter().find(|f| f.object_index == d.object_index).and_then(|f| f.bounding_box);
        }
    }
    let diagnosis = diagnose(&scene, |_| true);
    assert!(diagnosis.consistent && diagnosis.causes.is_empty(), "{diagnosis:?}");
}

#[test]
fn ids_that_start_anew_in_each_frame_are_no_ids() {
    let mut scene = scene(Trajectory::Orbit, 2);
    // Numbered from left to right.
    let mut order: Vec<usize> = (0..scene.detections.len()).collect();
    let x = |k: usize| scene.detections[k].bounding_box.unwrap().x0;
    order.sort_by(|&a, &b| x(a).total_cmp(&x(b)));
    let mut next = [0; 12];
    for k in order {
        let detection = &mut scene.0.detections[k];
        let number = &mut next[detection.frame_index as usize];
        detection.object_index = Some(*number);
        *number += 1;
    }
    let diagnosis = diagnose(&scene, |_| true);
    assert!(!diagnosis.consistent);
    assert_eq!(diagnosis.causes.first().map(|c| c.name), Some(CauseName::ObjectIds), "{diagnosis:?}");
    assert!(diagnosis.causes[0].after.miss < 0.1, "{diagnosis:?}");
}

#[test]
fn false_boxes_do_not_hide_a_mistake() {
    let options = SyntheticOptions {
        seed: 5,
        objects: 10,
        views: 8,
        trajectory: Trajectory::Arc { span: 60.0 },
        observations: Observations::Boxes,
        outlier_share: 0.3,
        ..Default::default()
    };
    let right = generate(&options).unwrap().scene;
    let diagnosis = diagnose(&right, |_| true);
    assert!(diagnosis.consistent && diagnosis.causes.is_empty(), "{diagnosis:?}");
    for correction in [Correction::InvertPoses, Correction::ImageScale(2.0), Correction::NormalizedIntrinsics] {
        let diagnosis = diagnose(&Mistake(correction).apply(&right), |_| true);
        assert!(!diagnosis.consistent, "{correction:?}: {diagnosis:?}");
        assert_eq!(diagnosis.causes.first().map(|c| c.name), Some(correction.cause()), "{correction:?}: {diagnosis:?}");
    }
}

/// A part of the frames as a mistake writes them.
fn with_some(right: &Scene, wrong: &Scene, is_wrong: impl Fn(usize) -> bool) -> Scene {
    let mut mixed = right.clone().into_parts();
    for (frame, (k, other)) in mixed.frames.iter_mut().zip(wrong.frames.iter().enumerate()) {
        frame.projection = if is_wrong(k) { other.projection } else { frame.projection };
    }
    for (detection, other) in mixed.detections.iter_mut().zip(&wrong.detections) {
        if is_wrong(detection.frame_index as usize) {
            detection.bounding_box = other.bounding_box;
        }
    }
    Scene(mixed)
}

#[test]
fn frames_in_another_convention_are_named() {
    let right = scene(Trajectory::Orbit, 2);
    let turned = Correction::TurnedPictures { orientation: 6, fractions: true };
    for correction in [Correction::BodyAxes, Correction::OpenGlAxes, Correction::InvertPoses, turned] {
        let wrong = Mistake(correction).apply(&right);
        // Every second frame, every third one, two of twelve.
        for is_wrong in [|k: usize| k % 2 == 1, |k| k % 3 == 0, |k| k == 4 || k == 9] {
            let diagnosis = diagnose(&with_some(&right, &wrong, is_wrong), |_| true);
            assert!(!diagnosis.consistent, "{correction:?}: {diagnosis:?}");
            let cause = diagnosis.causes.first().unwrap();
            let expected = (0..12).filter(|k| is_wrong(*k)).map(|k| right.frames[k].id.clone()).collect::<Vec<_>>();
            assert_eq!((cause.name, &cause.frames), (correction.cause(), &expected), "{correction:?}: {diagnosis:?}");
            assert!(cause.correction.is_none());
        }
    }
}

/// Boxes that are wrong by themselves are no frames that are.
#[test]
fn wrong_boxes_in_all_frames_are_no_wrong_frames() {
    for seed in 1..=6 {
        let options = SyntheticOptions {
            seed,
            objects: 10,
            views: 12,
            trajectory: Trajectory::Orbit,
            observations: Observations::Boxes,
            noise: vec![Noise::BoxEdges(0.02)],
            outlier_share: 0.3,
            ..Default::default()
        };
        let diagnosis = diagnose(&generate(&options).unwrap().scene, |_| true);
        assert!(diagnosis.causes.iter().all(|cause| cause.frames.is_empty()), "{seed}: {diagnosis:?}");
    }
}

/// A street whose images two cameras of a rig took in turn, with the detections of camera 1 moved by some time steps.
fn rig_on_a_street(steps: i64, seed: u64) -> Scene {
    let options = SyntheticOptions {
        seed,
        objects: 30,
        views: 60,
        trajectory: Trajectory::Street,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.03)],
        ..Default::default()
    };
    let mut parts = generate(&options).unwrap().scene.into_parts();
    for (k, frame) in parts.frames.iter_mut().enumerate() {
        frame.rig = Some(RigCamera { time_step: k as u64 / 2, camera: Some(k as u32 % 2) });
    }
    let frames = parts.frames.len() as i64;
    parts.detections.retain_mut(|detection| {
        let frame = i64::from(detection.frame_index);
        let moved = if frame % 2 == 1 { frame + 2 * steps } else { frame };
        detection.frame_index = moved.max(0) as u32;
        (0..frames).contains(&moved)
    });
    Scene(parts)
}

#[test]
fn a_camera_of_a_rig_that_is_late_is_named() {
    for seed in 0..4 {
        for steps in [0, 1, -1, 2] {
            let given = rig_on_a_street(steps, seed);
            let mut without = given.clone();
            without.0.detections.iter_mut().for_each(|d| d.object_index = None);
            let options = AssociateOptions::default();
            let association = associate(&without, &options).unwrap();
            let unnamed = diagnose_association(&without, &association, &options).unwrap();
            for found in [diagnose(&given, |_| true), unnamed] {
                if steps == 0 {
                    assert!(found.consistent && found.causes.is_empty(), "{seed}: {found:?}");
                    continue;
                }
                let [cause] = found.causes.as_slice() else { panic!("{seed} {steps}: {found:?}") };
                // Which of two cameras is late nobody knows.
                let expected = if cause.frames[0] == given.frames[0].id { steps } else { -steps };
                assert!(!found.consistent && cause.name == CauseName::CameraOffset, "{seed} {steps}: {found:?}");
                assert_eq!((cause.value, cause.frames.len()), (Some(expected as f64), 30), "{seed} {steps}");
            }
        }
    }
}
