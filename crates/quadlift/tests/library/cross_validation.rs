//! Cross-validation on synthetic scenes: exact views predict each other, noise lowers the agreement, and a false box is
//! named.

use quadlift::cross_validation::{CrossValidation, Extent};
use quadlift::geometry::{BodyKind, BoundingBox};
use quadlift::scene::Scene;
use quadlift::solve::{Method, NoiseModel, Prediction};
use quadlift::synthetic::{Noise, Observations, SyntheticOptions, Trajectory, generate};
use quadlift::{Localization, LocalizeOptions, localize};

fn scene(objects: usize, views: usize, sigma: f64) -> Scene {
    let noise = if sigma > 0.0 { vec![Noise::BoxEdges(sigma)] } else { Vec::new() };
    let observations = Observations::Boxes;
    let trajectory = Trajectory::Orbit;
    let options = SyntheticOptions { objects, views, observations, noise, trajectory, seed: 3, ..Default::default() };
    generate(&options).unwrap().scene
}

fn run(scene: &Scene, options: LocalizeOptions, extent: Extent) -> Localization {
    let mut options = options;
    options.cross_validation.extent = extent;
    localize(scene, &options).unwrap()
}

fn all(scene: &Scene) -> CrossValidation {
    run(scene, LocalizeOptions::default(), Extent::All).cross_validation
}

#[test]
fn exact_views_predict_each_other() {
    let scene = scene(8, 12, 0.0);
    let checked = all(&scene);
    assert!(checked.iou().unwrap() > 0.999, "{:?}", checked.iou());
    assert!(checked.edge_error().unwrap() < 1e-3, "{:?}", checked.edge_error());
    assert_eq!(checked.objects.len(), 8);
    assert!(checked.objects.iter().all(|object| object.predictions.len() == 12 && object.suspect_view().is_none()));
    let planes = LocalizeOptions { method: Method::Planes, ..Default::default() };
    let iou = run(&scene, planes, Extent::All).cross_validation.iou().unwrap();
    assert!(iou > 0.9999, "{iou}");
}

#[test]
fn noise_lowers_the_agreement() {
    let iou = |sigma| all(&scene(12, 12, sigma)).iou().unwrap();
    let falling = [0.0, 0.02, 0.05, 0.1].map(iou);
    assert!(falling.windows(2).all(|pair| pair[1] < pair[0] - 0.01), "{falling:?}");
    // An edge of the prediction errs less than one of the measurement: with many views their difference has the noise of
    // the measurement. Median of |x| for a Gaussian: .674 sd.
    let error = all(&scene(30, 20, 0.05)).edge_error().unwrap();
    assert!((1.0..1.35).contains(&(error / (0.674 * 0.05))), "{error}");
}

#[test]
fn a_false_box_is_the_odd_view() {
    for (views, false_view) in [(20, 7), (8, 0), (6, 5), (4, 2)] {
        let mut scene = scene(6, views, 0.01);
        let wrong =
            scene.detections.iter().position(|d| d.object_index == Some(2) && d.frame_index == false_view).unwrap();
        let b = scene.detections[wrong].bounding_box.unwrap();
        let size = b.size();
        let edges = [b.x0() + 0.8 * size.x, b.y0() - 0.5 * size.y, b.x1() + 1.2 * size.x, b.y1() - 0.1 * size.y];
        let wrong_box = BoundingBox::new(edges).ok();
        scene.edit(|parts| parts.detections[wrong].bounding_box = wrong_box).unwrap();
        let checked = all(&scene);
        let odd: Vec<_> =
            checked.objects.iter().filter_map(|o| Some((o.estimate_index, o.suspect_view()?.frame_index))).collect();
        assert_eq!(odd, [(2, false_view as usize)], "{views} views");
        let of = |index| checked.of_estimate(index).unwrap().iou().unwrap();
        assert!(of(2) < of(1) - 0.5 / views as f64, "{views} views: {} {}", of(2), of(1));
    }
}

#[test]
fn two_views_predict_nothing() {
    let result = run(&scene(3, 2, 0.01), LocalizeOptions::default(), Extent::All);
    assert_eq!((result.cross_validation.objects.len(), result.cross_validation.iou()), (0, None));
}

/// The fit to the other views is the one that a scene without the left-out view gives: nothing of it remains in the start.
#[test]
fn a_left_out_view_has_no_influence() {
    for body in [BodyKind::Ellipsoid, BodyKind::Cuboid] {
        for views in [3, 5, 12] {
            let scene = scene(4, views, 0.03);
            let mut options = LocalizeOptions::default();
            options.method.posterior_options_mut().unwrap().body = Some(body);
            options.method.posterior_options_mut().unwrap().noise_model =
                Some(NoiseModel::new([("edge_noise", 0.03), ("edge_noise_px", 0.5)]).unwrap());
            // One fit for each view, so that the detections of one frame can be left out of the scene.
            options.cross_validation.fits_per_object = views;
            let checked = run(&scene, options.clone(), Extent::All).cross_validation;
            for left_out in 0..views {
                let mut others = scene.clone();
                let hidden = scene.occluded_edges(|_| true);
                others
                    .edit(|parts| {
                        for (detection, hidden) in parts.detections.iter_mut().zip(hidden) {
                            detection.occluded_edges = Some(hidden);
                        }
                        parts.detections.retain(|d| d.frame_index as usize != left_out);
                    })
                    .unwrap();
                let from_scratch = run(&others, options.clone(), Extent::Nothing);
                for (object, estimate) in checked.objects.iter().zip(&from_scratch.estimates) {
                    let prediction = object.predictions[left_out];
                    assert_eq!(prediction.frame_index, left_out);
                    let projection = &scene.frames[left_out].projection;
                    let expected =
                        quadlift::geometry::project_bounding_box(projection, &estimate.body.unwrap()).unwrap();
                    assert_eq!(prediction.predicted, Some(expected));
                }
            }
        }
    }
}

#[test]
fn the_sample_is_a_part_of_the_whole() {
    let scene = scene(30, 12, 0.03);
    let whole = all(&scene);
    let sample = run(&scene, LocalizeOptions::default(), Extent::Sample).cross_validation;
    assert_eq!(sample.objects.len(), 8);
    for prediction in sample.predictions() {
        // From a warm start, see below.
        let same = |other: &&Prediction| {
            (other.object_index, other.frame_index) == (prediction.object_index, prediction.frame_index)
        };
        assert!((whole.predictions().find(same).unwrap().iou - prediction.iou).abs() < 5e-3);
    }
    assert!((sample.iou().unwrap() - whole.iou().unwrap()).abs() < 0.03);
    let estimates = |extent| run(&scene, LocalizeOptions::default(), extent).solution.estimates;
    assert_eq!(estimates(Extent::Nothing), estimates(Extent::All));
}

/// The sample's fits start from the fit to all views where there are enough of them: that changes nearly nothing.
#[test]
fn a_warm_start_predicts_the_same() {
    for (views, bound) in [(20, 1e-3), (8, 5e-3)] {
        let scene = scene(20, views, 0.05);
        let mut options = LocalizeOptions::default();
        options.method.posterior_options_mut().unwrap().body = Some(BodyKind::Ellipsoid);
        // Whether an object stands is decided anew from the starts, and kept with a warm one.
        options.method.posterior_options_mut().unwrap().upright = false;
        let cold = run(&scene, options.clone(), Extent::All).cross_validation;
        options.cross_validation.sampled_fits = usize::MAX;
        let warm = run(&scene, options, Extent::Sample).cross_validation;
        let mut changes: Vec<f64> =
            cold.predictions().zip(warm.predictions()).map(|(a, b)| (a.iou - b.iou).abs()).collect();
        assert_eq!(changes.len(), 20 * views);
        changes.sort_by(f64::total_cmp);
        // Of single objects one fit takes a view for an outlier and the other does not.
        assert!(changes[changes.len() * 95 / 100] < bound && changes[changes.len() - 1] < 0.05, "{changes:?}");
        assert!((cold.iou().unwrap() - warm.iou().unwrap()).abs() < 5e-4);
    }
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let scene = scene(9, 7, 0.05);
    let with_threads = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| format!("{:?}", all(&scene)))
    };
    assert_eq!(with_threads(1), with_threads(4));
}
