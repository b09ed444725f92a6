//! Right scenes are called right, and mistakes by their names.

use super::{BoxFormat, CauseName, Correction, Diagnosis, Mistake, diagnose, diagnose_association};
use crate::associate::{AssociateOptions, associate};
use crate::scene::Scene;
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
    let mut all = vec![
        Correction::InvertPoses,
        Correction::OpenGlAxes,
        Correction::InvertOpenGlPoses,
        Correction::BodyAxes,
        Correction::InvertBodyPoses,
        Correction::LeftHandedAxes,
        Correction::InvertLeftHandedPoses,
        Correction::CenterAsTranslation,
        Correction::TransposedRotation,
        Correction::FocalFactor(1.7),
        Correction::NormalizedIntrinsics,
        Correction::CenteredPrincipalPoint,
        Correction::ImageScale(0.5),
        Correction::ImageScale(1.5),
        Correction::Letterbox(640.0),
        Correction::NormalizedBoxes,
        Correction::Boxes(BoxFormat::CornersReadAsSize),
        Correction::Boxes(BoxFormat::CenterReadAsCorner),
        Correction::Boxes(BoxFormat::CornerReadAsCenter),
        Correction::Boxes(BoxFormat::SwappedAxes),
        Correction::FrameOffset(1),
        Correction::FrameOffset(-2),
        Correction::ReversedFrames,
    ];
    for was_wxyz in [true, false] {
        for world_from_cam in [true, false] {
            all.push(Correction::QuaternionOrder { was_wxyz, world_from_cam });
        }
    }
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
    scene.detections.iter_mut().for_each(|detection| detection.object_index = None);
    scene.object_ids.clear();
    let options = AssociateOptions::default();
    let association = associate(&scene, &options, &|_, _| {}).unwrap();
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
