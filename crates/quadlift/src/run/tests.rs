//! The order of a run: what is corrected, associated, measured and concluded.

use std::ops::ControlFlow;
use std::sync::Mutex;

use super::*;
use crate::diagnosis::{BoxFormat, Correction, Diagnosis, Mistake};
use crate::solve::{Estimate, PosteriorOptions, SceneSolution, Status};
use crate::synthetic::{Noise, Observations, SyntheticOptions, Trajectory, generate};

fn scene(noise: f64) -> Scene {
    let options = SyntheticOptions {
        objects: 8,
        views: 12,
        trajectory: Trajectory::Orbit,
        cube_side: 40.0,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(noise)],
        ..SyntheticOptions::default()
    };
    generate(&options).unwrap().scene
}

fn without_ids(scene: Scene) -> Scene {
    let mut parts = scene.into_parts();
    parts.detections.iter_mut().for_each(|detection| detection.object_index = None);
    parts.object_ids.clear();
    Scene::from_parts(parts).unwrap()
}

fn count_ok(run: &Run) -> usize {
    run.localization.estimates.iter().filter(|estimate| estimate.status == Status::Ok).count()
}

/// Notes the phases of a run.
#[derive(Default)]
struct Phases(Mutex<Vec<Phase>>);

impl Observer for Phases {
    fn progress(&self, _: usize, _: usize) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn begins(&self, phase: Phase) {
        self.0.lock().unwrap().push(phase);
    }
}

#[test]
fn detections_without_ids_are_associated_first() {
    let mut input = without_ids(scene(0.02));
    let phases = Phases::default();
    let found = run(&mut input, &RunOptions::default(), &phases).unwrap();
    assert_eq!(*phases.0.lock().unwrap(), [Phase::Association, Phase::Objects]);
    assert_eq!(found.association.as_ref().unwrap().objects.len(), 8);
    assert_eq!((found.localization.estimates.len(), count_ok(&found)), (8, 8));
    // The input names them now.
    assert!(input.detections.iter().filter(|d| d.object_index.is_some()).count() >= 90);
    assert_eq!(found.localization.skipped.without_object, 0);
}

#[test]
fn named_detections_give_what_localize_gives() {
    let given = scene(0.02);
    let mut input = given.clone();
    let found = run(&mut input, &RunOptions::default(), &Unobserved).unwrap();
    let localized = localize(&given, &LocalizeOptions::default()).unwrap();
    assert!(found.association.is_none() && found.check.diagnosis.consistent);
    for (a, b) in found.localization.estimates.iter().zip(&localized.estimates) {
        assert_eq!((a.body, a.status), (b.body, b.status));
    }
    assert_eq!(found.check.diagnosis, localized.diagnosis);
}

#[test]
fn a_mistake_is_named_and_corrected_only_where_that_is_asked_for() {
    let wrong = Mistake(Correction::OpenGlAxes).apply(&scene(0.02));
    let named = run(&mut wrong.clone(), &RunOptions::default(), &Unobserved).unwrap();
    assert!(!named.check.diagnosis.consistent && named.check.corrected.is_empty());
    assert_eq!(named.check.diagnosis.causes[0].correction, Some(Correction::OpenGlAxes));
    assert_eq!(count_ok(&named), 0);
    let fixed = run(&mut wrong.clone(), &RunOptions { fix: true, ..Default::default() }, &Unobserved).unwrap();
    assert_eq!(fixed.check.corrected, [Correction::OpenGlAxes]);
    assert_eq!(count_ok(&fixed), 8);
}

#[test]
fn an_inconsistent_scene_has_no_object_that_is_ok_unless_it_is_accepted() {
    let estimates = vec![Estimate::failed(0, None, Status::Ok), Estimate::failed(1, None, Status::Degenerate)];
    let localization =
        Localization { solution: SceneSolution { estimates, ..Default::default() }, ..Default::default() };
    for (consistent, accepted, status) in
        [(false, false, Status::Inconsistent), (false, true, Status::Ok), (true, false, Status::Ok)]
    {
        let mut check = Check { diagnosis: Diagnosis { consistent, ..Default::default() }, ..Check::default() };
        let mut localization = localization.clone();
        check.conclude(&mut localization, true, accepted);
        let statuses: Vec<Status> = localization.estimates.iter().map(|estimate| estimate.status).collect();
        assert_eq!(statuses, [status, Status::Degenerate]);
        assert_eq!(localization.diagnosis.consistent, consistent);
    }
}

#[test]
fn two_mistakes_are_named_together() {
    let wrong =
        Mistake(Correction::Boxes(BoxFormat::SwappedAxes)).apply(&Mistake(Correction::OpenGlAxes).apply(&scene(0.01)));
    let found = run(&mut wrong.clone(), &RunOptions::default(), &Unobserved).unwrap();
    assert!(found.check.diagnosis.causes.is_empty() == found.check.together.is_some());
    let fixed = run(&mut wrong.clone(), &RunOptions { fix: true, ..Default::default() }, &Unobserved).unwrap();
    assert_eq!((fixed.check.corrected.len(), count_ok(&fixed)), (2, 8), "{:?}", fixed.check);
}

#[test]
fn refined_poses_may_settle_an_inconsistency() {
    // Of detections that name their objects: association would have used the poses as given.
    let mut check = Check { diagnosis: Diagnosis { consistent: false, ..Default::default() }, ..Check::default() };
    let pose = crate::solve::RefinedPose {
        frame_index: 0,
        turn: nalgebra::Rotation3::identity(),
        shift: nalgebra::Vector3::zeros(),
        covariance: None,
    };
    let localization = Localization {
        solution: SceneSolution { refined_poses: vec![pose], ..Default::default() },
        ..Default::default()
    };
    let mut concluded = check.clone();
    concluded.conclude(&mut localization.clone(), false, false);
    assert!(!concluded.diagnosis.consistent);
    check.conclude(&mut localization.clone(), true, false);
    assert!(check.diagnosis.consistent);
}

#[test]
fn a_run_without_objects_says_why() {
    let options = RunOptions { associate: AssociateWhen::Never, ..Default::default() };
    let unnamed = without_ids(scene(0.02));
    let count = unnamed.detections.len();
    let error = run(&mut unnamed.clone(), &options, &Unobserved).unwrap_err();
    assert_eq!(error, RunError::NothingToLocalize { detections: count, without_object: count });
    let options = RunOptions {
        localize: PosteriorOptions { ground_plane: true, ..Default::default() }.into(),
        ..Default::default()
    };
    let mut flat = scene(0.02).into_parts();
    flat.up = None;
    let error = run(&mut Scene::from_parts(flat).unwrap(), &options, &Unobserved).unwrap_err();
    assert!(matches!(error, RunError::Localize(LocalizeError::Option(_))), "{error:?}");
}
