//! A false box among few views: no wrong body counts as localized, and right ones stay.

use std::collections::BTreeMap;

use quadlift::geometry::ConvexBody;
use quadlift::solve::{Estimate, NoiseModel, Rejection, Status, Warning};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, SyntheticScene, Trajectory, generate};
use quadlift::{Localization, LocalizeOptions, localize};

/// `quadlift synth --objects 40 --views VIEWS --outliers 0.1 --noise box:NOISE --trajectory orbit --seed SEED`.
fn scene(views: usize, noise: f64, seed: u64) -> SyntheticScene {
    let options = SyntheticOptions {
        seed,
        objects: 40,
        views,
        trajectory: Trajectory::Orbit,
        outlier_share: 0.1,
        observations: Observations::Boxes,
        noise: vec![Noise::BoxEdges(noise)],
        ..Default::default()
    };
    generate(&options).unwrap()
}

fn localized(scene: &SyntheticScene) -> Localization {
    localize(&scene.scene, &LocalizeOptions::default()).unwrap()
}

/// Error of the center: in semi-axes of the true body, and in the estimate's own standard deviations.
fn center_error(scene: &SyntheticScene, estimate: &Estimate) -> Option<(f64, f64)> {
    let truth = &scene.truth[estimate.object_index].1;
    let error = estimate.center? - truth.center();
    let covariance = estimate.covariance?.matrix.fixed_view::<3, 3>(0, 0).into_owned();
    let deviations = (error.transpose() * covariance.try_inverse()? * error)[0].sqrt();
    Some((error.norm() / truth.closest_ellipsoid().semi_axes.product().cbrt(), deviations))
}

/// Whether nothing is said against an estimate but what is said of every scene with so few views.
fn counts(estimate: &Estimate) -> bool {
    let usual = |warning: &Warning| matches!(warning, Warning::TwoViews | Warning::NarrowBaseline { .. });
    estimate.status == Status::Ok && estimate.warnings.iter().all(usual)
}

/// Shares over eight scenes of 40 objects: wrong ones that count (by more than five deviations, and by more than their
/// mean semi-axis), and of the right ones (off by at most their mean semi-axis) those that do not count. `false_boxes.rs` of
/// the experiments makes a table with the same definitions.
fn shares(views: usize, first_seed: u64) -> (f64, f64) {
    let (mut all, mut wrong, mut right, mut lost) = (0, 0, 0, 0);
    for seed in first_seed..first_seed + 8 {
        let scene = scene(views, 0.02, seed);
        for estimate in &localized(&scene).estimates {
            let error = center_error(&scene, estimate);
            let is_wrong = error.is_none_or(|(sizes, sds)| sizes > 1.0 && sds > 5.0);
            // Whether an object is right does not depend on how sure its estimate is.
            let is_right = error.is_some_and(|(sizes, _)| sizes <= 1.0);
            all += 1;
            wrong += usize::from(is_wrong && counts(estimate));
            right += usize::from(is_right);
            lost += usize::from(is_right && !counts(estimate));
        }
    }
    (f64::from(wrong as u32) / f64::from(all), f64::from(lost as u32) / f64::from(right as u32))
}

#[test]
fn a_false_box_among_few_views_does_not_pass_and_right_objects_stay() {
    for views in 2..=5 {
        let (wrong, lost) = shares(views, 9000);
        // Before: 0.12, 0.08, 0.04 and 0.01.
        assert!(wrong <= 0.01, "{views} views: {wrong:.4} of the objects are wrong and count");
        if views > 2 {
            assert!(lost <= 0.05, "{views} views: {lost:.4} of the right objects do not count");
        }
    }
}

#[test]
fn the_object_of_the_issue_is_not_ok_with_all_its_views() {
    let scene = scene(3, 0.02, 0);
    let localization = localized(&scene);
    let estimate = &localization.estimates[32];
    let outliers: Vec<bool> = scene
        .scene
        .detections
        .iter()
        .zip(&scene.outliers)
        .filter(|(detection, _)| detection.object_index == Some(32))
        .map(|(_, outlier)| *outlier)
        .collect();
    assert!(outliers.contains(&true));
    // Either the false box is found, or the object does not count.
    let used: Vec<bool> = estimate.views.iter().map(|view| view.inlier).collect();
    assert!(
        estimate.status == Status::Inconsistent || used.iter().zip(&outliers).all(|(used, outlier)| *used != *outlier),
        "{estimate:?}"
    );
}

#[test]
fn residuals_far_beyond_the_noise_are_never_used() {
    for (views, seed) in [(3, 0), (4, 1), (5, 2), (20, 3)] {
        let scene = scene(views, 0.02, seed);
        for estimate in &localized(&scene).estimates {
            for view in &estimate.views {
                assert_eq!(view.inlier, view.rejection_reason.is_none());
                // Five for each of four edges, or as improbable for a single one that counts (chi-square, 100 with 4
                // degrees of freedom and 106 with one).
                assert!(!view.inlier || view.normalized_residual.is_none_or(|x| x <= 10.4), "{views} {estimate:?}");
                let in_front = view.residual_px.is_some();
                assert!(view.rejection_reason != Some(Rejection::BehindCamera) || !in_front, "{view:?}");
            }
        }
    }
}

#[test]
fn with_given_levels_an_object_is_judged_by_them_alone() {
    let scene = scene(2, 0.02, 4);
    let noise_model = NoiseModel::new([("edge_noise", 0.02), ("edge_noise_px", 0.2)]).unwrap();
    let mut options = LocalizeOptions::default();
    options.method.posterior_options_mut().unwrap().noise_model = Some(noise_model);
    // What hides an edge is in the other boxes of its frame.
    options.method.posterior_options_mut().unwrap().occluded_edges = false;
    // The consistency check looks at all objects of a scene.
    options.allow_inconsistent = true;
    options.method.posterior_options_mut().unwrap().body = Some(quadlift::geometry::BodyKind::Ellipsoid);
    let together = localize(&scene.scene, &options).unwrap();
    let mut statuses: BTreeMap<&str, usize> = BTreeMap::new();
    for estimate in &together.estimates {
        *statuses.entry(estimate.status.name()).or_default() += 1;
        let mut alone = scene.scene.clone();
        let own = Some(estimate.object_index as u32);
        alone.edit(|parts| parts.detections.retain(|detection| detection.object_index == own)).unwrap();
        let alone = localize(&alone, &options).unwrap();
        assert_eq!(alone.estimates[0].body, estimate.body);
        assert_eq!(alone.estimates[0].status, estimate.status);
        assert_eq!(alone.estimates[0].goodness_of_fit, estimate.goodness_of_fit);
        assert_eq!(alone.estimates[0].views, estimate.views);
    }
    // Of two views that do not agree either may be wrong.
    assert!(statuses["ok"] > 25 && statuses["undetermined"] > 0, "{statuses:?}");
}
