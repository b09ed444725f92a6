//! Covariances know errors that the views of an object have in common, where the residuals show them.

use quadlift::geometry::{BodyKind, BoundingBox};
use quadlift::metrics::squared_errors;
use quadlift::solve::PosteriorOptions;
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift::{Localization, LocalizeOptions, localize};

/// Quantile of chi-square with 3 degrees of freedom at 95 %.
const LIMIT: f64 = 7.815;

fn boxes(sigma: f64) -> SyntheticScene {
    let trajectory = Trajectory::Arc { span: 60.0 };
    let (observations, noise) = (Observations::Boxes, vec![Noise::BoxEdges(sigma)]);
    generate(&SyntheticOptions { objects: 60, trajectory, observations, noise, ..Default::default() }).unwrap()
}

/// Moves every side of an object's boxes by a share of their half size that changes slowly from view to view: up to
/// `amount`.
fn with_habits(mut synthetic: SyntheticScene, amount: f64) -> SyntheticScene {
    synthetic
        .scene
        .edit(|parts| {
            for detection in &mut parts.detections {
                let object = detection.object_index.unwrap() as usize;
                let exact = detection.bounding_box.unwrap();
                let half_size = exact.mean_half_size();
                let edges = exact.edges();
                // A wave over the views, with a length and a phase of its own for each side of each object.
                let habit = |side: usize| {
                    let seed = (4 * object + side) as f64;
                    (0.1 * (1.0 + (12.9898 * seed).sin().abs()) * f64::from(detection.frame_index) + 7.0 * seed).sin()
                };
                let moved = std::array::from_fn(|side| edges[side] + amount * half_size * habit(side));
                detection.bounding_box = Some(BoundingBox::new(moved).unwrap());
            }
        })
        .unwrap();
    synthetic
}

fn run(synthetic: &SyntheticScene, common_errors: bool) -> Localization {
    let body = Some(BodyKind::Ellipsoid);
    let map = PosteriorOptions { body, common_errors, by_evidence: false, ..Default::default() };
    localize(&synthetic.scene, &LocalizeOptions::from(map)).unwrap()
}

/// Share of the true centers inside the region of 95 %.
fn inside(synthetic: &SyntheticScene, localization: &Localization) -> f64 {
    let pairs = localization.estimates.iter().zip(&synthetic.truth);
    let inside = pairs.filter(|(estimate, (_, truth))| {
        let body = estimate.body.unwrap();
        squared_errors(&body, &estimate.covariance.unwrap(), truth).unwrap().center <= LIMIT
    });
    inside.count() as f64 / synthetic.truth.len() as f64
}

fn level(localization: &Localization, name: &str) -> f64 {
    localization.noise.get(name).unwrap_or(0.0)
}

#[test]
fn habits_of_a_detector_widen_the_regions() {
    let synthetic = with_habits(boxes(0.01), 0.08);
    let (noise_only, default) = (run(&synthetic, false), run(&synthetic, true));
    let [before, after] = [&noise_only, &default].map(|localization| inside(&synthetic, localization));
    println!("inside: {before:.2} with noise only, {after:.2}; edge_common {:.2}", level(&default, "edge_common"));
    assert!(before < 0.6 && after > 0.8, "{before} {after}");
    assert!(level(&default, "edge_common") > 0.5 && level(&noise_only, "edge_common") == 0.0);
    // The fits are the same to the last bit.
    for (a, b) in noise_only.estimates.iter().zip(&default.estimates) {
        assert_eq!((a.body, a.center, &a.views), (b.body, b.center, &b.views));
    }
}

#[test]
fn independent_noise_is_not_taken_for_habits() {
    let synthetic = boxes(0.05);
    let default = run(&synthetic, true);
    let (share, common) = (inside(&synthetic, &default), level(&default, "edge_common"));
    println!("inside: {share:.2}, edge_common {common:.2}");
    assert!((0.85..=1.0).contains(&share) && common < 0.2, "{share} {common}");
}

#[test]
fn exact_boxes_leave_tiny_regions() {
    let synthetic = boxes(0.0);
    for (estimate, (_, truth)) in run(&synthetic, true).estimates.iter().zip(&synthetic.truth) {
        let size = truth.closest_ellipsoid().semi_axes.min();
        assert!(estimate.center_sd().unwrap() < 2e-3 * size, "{:?} of {size}", estimate.center_sd());
    }
}

/// The default estimator of boxes.
fn run_default(synthetic: &SyntheticScene) -> Localization {
    let options = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
    localize(&synthetic.scene, &options.into()).unwrap()
}

#[test]
fn regions_of_scenes_of_boxes_hold_with_and_without_habits() {
    for (synthetic, least) in [(boxes(0.05), 0.93), (with_habits(boxes(0.01), 0.08), 0.85)] {
        let found = run_default(&synthetic);
        let share = inside(&synthetic, &found);
        let deviations: Vec<f64> =
            found.estimates.iter().map(|e| e.center_sd().unwrap() / e.body.unwrap().half_extents.min()).collect();
        println!("inside: {share:.2}, largest deviation {:.3}", deviations.iter().fold(0.0f64, |a, x| a.max(*x)));
        assert!(share >= least, "{share}");
    }
}

#[test]
fn exact_boxes_leave_tiny_regions_by_evidence() {
    let synthetic = boxes(0.0);
    for (estimate, (_, truth)) in run_default(&synthetic).estimates.iter().zip(&synthetic.truth) {
        let size = truth.closest_ellipsoid().semi_axes.min();
        assert!(estimate.center_sd().unwrap() < 5e-3 * size, "{:?} of {size}", estimate.center_sd());
    }
}
