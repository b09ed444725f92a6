//! What the objects of a scene agree on, and what they do not change of each other.

use nalgebra::SVector;

use super::super::scenes_of_tests::{box_scene, with_scene};
use super::*;
use crate::geometry::linalg::invert_spd;
use crate::scene::Scene;
use crate::solve::estimate::Status;
use crate::solve::options::PosteriorOptions;
use crate::solve::posterior::noise::groups::NoiseGroup;
use crate::synthetic::SyntheticOptions;
use crate::tuning::{ANY_LEVEL, MANY_VIEWS, TEMPERING, USUAL_SPREAD};

type ViewsOf<'a> = &'a (dyn Fn(usize) -> ObjectViews + Sync);

fn objects(objects: usize, views: usize) -> SyntheticOptions {
    SyntheticOptions { objects, views, ..Default::default() }
}

/// Views are taken as independent, and covariances are those of the noise.
fn plain() -> PosteriorOptions {
    PosteriorOptions { correlated_views: false, common_errors: false, ..Default::default() }
}

fn fitted(count: usize, views_of: ViewsOf, context: &PosteriorContext) -> SceneFit {
    SceneFit::fit(&vec![BodyKind::Ellipsoid; count], views_of, context)
}

fn edge_level(scene: &SceneFit) -> f64 {
    scene.noise.of(NoiseGroup::Edge)
}

/// Sum of the weighted squared residuals of edges, in units of the level, and their degrees of freedom.
fn squares_and_freedom(scene: &SceneFit) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for fit in scene.fits() {
        let covariance = invert_spd(&fit.equations.hessian()).unwrap();
        fit.objective(&scene.noise, None).each_row(&fit.body, |_, row, weight| {
            assert!(row.group == NoiseGroup::Edge && row.counts);
            let gradient = SVector::from(row.row);
            sums[0] += weight * row.residual * row.residual;
            sums[1] += 1.0 - weight * gradient.dot(&(covariance * gradient));
        });
    }
    sums
}

/// Against the root of the derivative of the posterior of the level, a grid of whose logarithm is searched for the sign.
#[test]
fn the_level_is_the_most_probable_one_of_all_objects() {
    for (noise, views) in [(0.03, 6), (0.15, 4)] {
        with_scene(&box_scene(noise, &objects(5, views)), &plain(), |views_of, context| {
            let scene = fitted(5, views_of, context);
            let level = edge_level(&scene);
            let [squares, freedom] = squares_and_freedom(&scene);
            let told = level * level * squares / freedom;
            let counted = TEMPERING.get() * freedom * (1.0 + (views as f64 / MANY_VIEWS.get()).powi(4));
            let slope = |x: f64| {
                let off = (x - f64::ln(0.1)) / USUAL_SPREAD.get();
                let bell = (-0.5 * off * off).exp();
                counted * (1.0 - told * (-2.0 * x).exp()) + off / USUAL_SPREAD.get() * bell / (ANY_LEVEL.get() + bell)
            };
            let mut roots = Vec::new();
            for k in 0..30_000 {
                let x = f64::ln(1e-3) + 2e-4 * f64::from(k);
                if slope(x) < 0.0 && slope(x + 2e-4) >= 0.0 {
                    roots.push(x.exp());
                }
            }
            assert!(roots.iter().any(|root| (level / root).ln().abs() < 0.02), "{noise}: {level} {roots:?}");
            // Between what the residuals show and the usual level.
            assert!((level - told.sqrt()) * (level - 0.1) < 0.0, "{level} {told}");
        });
    }
}

/// Rounds that go on from where they ended change nothing that matters.
#[test]
fn rounds_end_because_fits_and_levels_agree() {
    with_scene(&box_scene(0.03, &objects(4, 6)), &plain(), |views_of, context| {
        let scene = fitted(4, views_of, context);
        let (level, before): (f64, Vec<Fit>) = (edge_level(&scene), scene.fits().cloned().collect());
        assert_eq!(before.len(), 4);
        let again = scene.alternate_until_converged(context);
        assert!((edge_level(&again) / level).ln().abs() < 0.02, "{level} {}", edge_level(&again));
        for (before, after) in before.iter().zip(again.fits()) {
            // In standard deviations of the center.
            let covariance = invert_spd(&before.equations.hessian()).unwrap();
            let moved = after.body.center() - before.body.center();
            for axis in 0..3 {
                assert!(moved[axis].abs() < 0.1 * covariance[(axis, axis)].sqrt(), "{moved}");
            }
            assert!(after.refined(&again.noise, true).converged);
        }
    });
}

/// A scene one of whose detections is a box elsewhere.
fn with_false_box(scene: &Scene, object: u32) -> Scene {
    let mut parts = scene.clone().into_parts();
    let found = parts.detections.iter_mut().find(|d| d.object_index == Some(object)).unwrap();
    let edges = found.bounding_box.unwrap().edges();
    let shift = 1.5 * (edges[2] - edges[0]);
    found.bounding_box = crate::geometry::BoundingBox::new(edges.map(|edge| edge + shift)).ok();
    Scene::from_parts(parts).unwrap()
}

#[test]
fn the_order_of_the_objects_does_not_matter() {
    with_scene(&box_scene(0.05, &objects(4, 5)), &PosteriorOptions::default(), |views_of, context| {
        let scene = fitted(4, views_of, context);
        let reversed = fitted(4, &|k| views_of(3 - k), context);
        assert!((edge_level(&scene) / edge_level(&reversed) - 1.0).abs() < 1e-9);
        for k in 0..4 {
            let [one, other] = [scene.estimate(k, context), reversed.estimate(3 - k, context)];
            assert_eq!((one.object_index, one.status), (other.object_index, Status::Ok));
            let moved = (one.center.unwrap() - other.center.unwrap()).norm();
            assert!(moved < 1e-6, "{k}: {moved}");
        }
    });
}

#[test]
fn under_given_levels_an_object_is_fitted_as_if_it_were_alone() {
    let noise_model = Some(NoiseModel::new([("edge_noise", 0.04)]).unwrap());
    let options = PosteriorOptions { noise_model, upright: false, ..Default::default() };
    let scene = with_false_box(&box_scene(0.04, &objects(3, 5)), 2);
    with_scene(&scene, &options, |views_of, context| {
        let all = fitted(3, views_of, context);
        for k in 0..3 {
            let alone = fitted(1, &|_| views_of(k), context);
            let [found, expected] = [all.estimate(k, context), alone.estimate(0, context)];
            assert_eq!((found.center, found.status), (expected.center, expected.status));
            assert_eq!(found.covariance.unwrap().matrix, expected.covariance.unwrap().matrix);
            // As an object that was not among those of the scene.
            let other = all.estimate_other(views_of(k), BodyKind::Ellipsoid, context);
            let sd = expected.covariance.unwrap().matrix[(0, 0)].sqrt();
            assert!((other.center.unwrap() - expected.center.unwrap()).norm() < 0.1 * sd, "{k}");
            assert_eq!(other.status, expected.status);
        }
        // A fit of the object, without a scene.
        let noise = NoiseLevels::given(options.noise_model.as_ref().unwrap(), options.pixel_noise_size);
        let problem = ObjectProblem::new(views_of(0), BodyKind::Ellipsoid, context).unwrap();
        let fit = Fit::first(problem, &noise, context).unwrap().refined(&noise, true);
        let center = fit.problem.measurements.frame.point_in_world(fit.body.center());
        let found = all.estimate(0, context);
        let sd = found.covariance.unwrap().matrix[(0, 0)].sqrt();
        assert!((found.center.unwrap() - center).norm() < 0.05 * sd);
    });
}

#[test]
fn an_object_that_cannot_be_fitted_says_so_and_changes_no_other() {
    with_scene(&box_scene(0.03, &objects(4, 5)), &plain(), |views_of, context| {
        let of_few_views = |k: usize| {
            let mut views = views_of(k);
            if k == 3 {
                views.views.truncate(1);
            }
            views
        };
        let (with, without) = (fitted(4, &of_few_views, context), fitted(3, views_of, context));
        assert_eq!(with.estimate(3, context).status, Status::TooFewViews);
        assert_eq!((with.len(), with.fits().count(), edge_level(&with)), (4, 3, edge_level(&without)));
        assert!((0..3).all(|k| with.estimate(k, context).center == without.estimate(k, context).center));
    });
}
