//! Observers: progress is reported, and work that is canceled ends early with an error that says so.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicUsize, Ordering};

use quadlift::solve::Method;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, generate};
use quadlift::{LocalizeError, LocalizeOptions, localize, localize_observed};

const OBJECTS: usize = 40;

fn scene() -> quadlift::scene::Scene {
    let make = SyntheticOptions {
        objects: OBJECTS,
        views: 8,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(0.02)],
        ..Default::default()
    };
    generate(&make).unwrap().scene
}

#[test]
fn all_objects_are_counted_and_watching_changes_nothing() {
    let scene = scene();
    for method in [Method::default(), Method::Planes] {
        let options = LocalizeOptions::from(method);
        let largest = AtomicUsize::new(0);
        let watch = |done: usize, total: usize| {
            assert!(done <= total && total == OBJECTS);
            largest.fetch_max(done, Ordering::Relaxed);
            ControlFlow::Continue(())
        };
        let watched = localize_observed(&scene, &options, &watch).unwrap();
        assert_eq!(largest.into_inner(), OBJECTS);
        let plain = localize(&scene, &options).unwrap();
        assert_eq!(format!("{watched:?}"), format!("{plain:?}"));
    }
}

#[test]
fn work_can_be_canceled_at_any_time() {
    let scene = scene();
    let count = |options: &LocalizeOptions, last: usize| {
        let calls = AtomicUsize::new(0);
        let watch = |_: usize, _: usize| match calls.fetch_add(1, Ordering::Relaxed) {
            call if call + 1 < last => ControlFlow::Continue(()),
            _ => ControlFlow::Break(()),
        };
        let ended = localize_observed(&scene, options, &watch);
        (ended.err(), calls.into_inner())
    };
    for method in [Method::default(), Method::Planes] {
        let options = LocalizeOptions::from(method);
        let (ended, all) = count(&options, usize::MAX);
        assert_eq!(ended, None);
        for last in [1, 2, all / 2, all] {
            assert_eq!(count(&options, last).0, Some(LocalizeError::Canceled), "{last} of {all}");
        }
    }
    // The default method asks before the first object is done: while the noise of the scene is estimated.
    let before_any = |done: usize, _: usize| if done > 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
    let canceled = localize_observed(&scene, &LocalizeOptions::default(), &before_any);
    assert_eq!(canceled.unwrap_err(), LocalizeError::Canceled);
    // What is left after that is not done: each thread finishes its object at most.
    for method in [Method::default(), Method::Planes] {
        let largest = AtomicUsize::new(0);
        let after_one = |done: usize, _: usize| {
            largest.fetch_max(done, Ordering::Relaxed);
            if done == 0 { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
        };
        let canceled = localize_observed(&scene, &LocalizeOptions::from(method), &after_one);
        assert_eq!(canceled.unwrap_err(), LocalizeError::Canceled);
        assert!(largest.into_inner() <= 1 + rayon::current_num_threads());
    }
}
