//! What fits say of cameras that move, and of bodies that are none.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Matrix3, Point3, Unit, Vector3, Vector6};

use super::agreement::Reference;
use super::fit::Fit;
use super::model::Model;
use super::problem::ObjectProblem;
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::geometry::BodyKind;
use crate::geometry::rotation::horizontal_basis;
use crate::observer::{Unobserved, Watch};
use crate::optimize::normal_equations::NormalEquations;
use crate::scene::ObjectViews;
use crate::solve::estimate::{Estimate, Status};
use crate::solve::options::{PoseNoise, PosteriorOptions};
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::shared::SharedErrors;
use crate::solve::posterior::shared::cue_scales::CueScales;
use crate::solve::posterior::shared::ground::{GroundPlane, LowestPoint};
use crate::solve::posterior::shared::pose_prior::PosePrior;
use crate::solve::posterior::shared::pose_terms::SceneTerms;
use crate::solve::posterior::shared::poses::PoseCorrections;
use crate::synthetic::{Observations, SyntheticOptions, generate};

/// An object of five views, with a ball for its body, and the options.
fn ball(test: impl Fn(&Fit, &NoiseLevels, &PosteriorContext)) {
    ball_on_ground(None, test);
}

/// The same where objects stand on a ground plane if the direction against gravity is known.
fn ball_on_ground(up: Option<Unit<Vector3<f64>>>, test: impl Fn(&Fit, &NoiseLevels, &PosteriorContext)) {
    let make = SyntheticOptions { objects: 1, views: 5, observations: Observations::Boxes, ..Default::default() };
    let scene = generate(&make).unwrap().scene;
    let detections: Vec<u32> = (0..5).collect();
    let views: ObjectViews = scene.object_views(0, &detections);
    let options = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ground_plane: true, ..Default::default() };
    let watch = Watch::new(&Unobserved, 1);
    let context = PosteriorContext { up, ..PosteriorContext::of_test(&scene, &options, &watch) };
    let problem = ObjectProblem::new(views, BodyKind::Ellipsoid, &context).unwrap();
    let body = EllipsoidModel::from_axes(Vector3::new(0.1, 0.05, -0.1), Matrix3::identity(), Vector3::repeat(0.9));
    let noise = NoiseLevels::new(67.0);
    let equations = problem.objective(&noise, None).linearize(&body).unwrap();
    let ellipsoid = body.clone();
    let (problem, body) = (Arc::new(problem), Model::Ellipsoid(body));
    let fit = Fit { problem, ellipsoid, body, equations, outlier_scale: None, ground: None, converged: true };
    test(&fit, &noise, &context);
}

#[test]
fn residuals_follow_a_camera_that_turns_or_moves() {
    ball(|fit, noise, _| {
        let terms = fit.pose_terms(noise).unwrap();
        assert_eq!(terms.frames.iter().map(|term| term.frame).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
        // Half of the weighted sum of squares has the gradient of the terms; a ball looks the same from all sides, so that turns have no
        // other effect than to move it.
        let weights = noise.weights(5);
        let residuals = |frame: usize, moved: Vector6<f64>| {
            let corrections = PoseCorrections::of_frames(&BTreeMap::from([(frame, moved)]));
            let problem = fit.problem.with_corrected_cameras(&corrections);
            let mut all = Vec::new();
            problem.objective(noise, None).each_row(&fit.body, |_, row, _| all.push(row.residual));
            all
        };
        let mut rows = Vec::new();
        fit.objective(noise, None).each_row(&fit.body, |view, row, weight| {
            rows.push((view, row.residual, weight * weights.of(row.group), row.row));
        });
        for term in &terms.frames {
            let mut gradient = Vector6::zeros();
            let mut coupling = nalgebra::SMatrix::<f64, 6, 9>::zeros();
            let mut information = Vector6::zeros();
            for k in 0..6 {
                let step = if k < 3 { 1e-6 } else { 1e-4 };
                let mut by = Vector6::zeros();
                by[k] = step;
                let (plus, minus) = (residuals(term.frame, by), residuals(term.frame, -by));
                for (row, (_, residual, weight, by_object)) in rows.iter().enumerate() {
                    let derivative = (plus[row] - minus[row]) / (2.0 * step);
                    gradient[k] += weight * residual * derivative;
                    information[k] += weight * derivative * derivative;
                    for (column, of_object) in by_object.iter().enumerate() {
                        coupling[(k, column)] += weight * derivative * of_object;
                    }
                }
            }
            assert!((gradient - term.gradient).norm() < 2e-3 * term.gradient.norm(), "{gradient} {}", term.gradient);
            assert!((coupling - term.coupling).norm() < 2e-3 * coupling.norm());
            assert!((information - term.information.diagonal()).norm() < 2e-3 * information.norm());
        }
    });
}

#[test]
fn the_prior_pulls_cameras_back_where_the_objects_tell_nothing() {
    ball(|fit, noise, _| {
        let moved = Vector6::new(0.01, -0.02, 0.03, 0.4, 0.5, -0.6);
        let mut poses = PoseCorrections::of_frames(&BTreeMap::from([(2, moved)]));
        let pose_noise = Some(PoseNoise { rotation_sd: 0.01, translation_sd: 0.1 });
        let prior =
            PosePrior::new(&PosteriorOptions { pose_noise, ..Default::default() }, &Arc::default(), || 1.0).unwrap();
        // With this noise measurements are worth nothing.
        let objects = vec![fit.pose_terms(&noise.scaled(1e5)).unwrap()];
        let step = poses.update(SceneTerms { objects, points: Vec::new() }, &prior);
        assert!((step.motion_of(2).unwrap() + moved).norm() < 1e-6);
        assert!(poses.motion_of(2).unwrap().norm() < 1e-6);
        assert!(poses.determined() < 1e-4);
    });
}

/// The estimate of a fit alone in its scene.
fn estimate(fit: &Fit, noise: &NoiseLevels, context: &PosteriorContext) -> Estimate {
    let reference = Reference::among(noise, std::iter::empty(), context.options);
    let shared = SharedErrors { scales: &CueScales::default(), poses: &PoseCorrections::default() };
    fit.estimate(noise, reference, shared, context)
}

#[test]
fn an_object_that_less_than_half_of_its_views_show_is_inconsistent() {
    ball(|fit, noise, context| {
        let mut costs = fit.objective(noise, None).view_costs(&fit.body);
        costs.sort_by(f64::total_cmp);
        for (used, status) in [(2, Status::Inconsistent), (3, Status::Ok)] {
            // A scale between the views that are used and the next one.
            let scale = (0.5 * (costs[used - 1] + costs[used])).sqrt();
            let found = estimate(&Fit { outlier_scale: Some(scale), ..fit.clone() }, noise, context);
            assert_eq!((found.views_used(), found.status), (used, status));
        }
    });
}

#[test]
fn bodies_that_have_run_away_have_diverged() {
    ball(|fit, noise, context| {
        let ends =
            |body: Model, equations: NormalEquations| estimate(&Fit { body, equations, ..fit.clone() }, noise, context);
        assert_eq!(ends(fit.body.clone(), fit.equations).status, Status::Ok);
        // Behind the cameras, a point, nowhere.
        let away = *fit.body.center() - fit.problem.measurements.views[0].axis * 1e4;
        for (center, radius) in [(away, 0.9), (*fit.body.center(), 1e-4), (*fit.body.center(), 1e4)] {
            let body = EllipsoidModel::from_axes(center, Matrix3::identity(), Vector3::repeat(radius));
            let estimate = ends(Model::Ellipsoid(body), fit.equations);
            assert_eq!((estimate.status, estimate.center), (Status::Diverged, None), "{center} {radius}");
        }
        assert_eq!(ends(fit.body.clone(), NormalEquations::nowhere()).status, Status::Diverged);
    });
}

/// A plane through a point of the world, as certain as what lies on it: told by many objects about the point.
fn ground(through: Point3<f64>, up: &Unit<Vector3<f64>>, slope: f64) -> GroundPlane {
    let [e1, e2] = horizontal_basis(up);
    let told = (0..400i32).map(|k| {
        let (x, y) = (f64::from(k % 20 - 10) * 10.0, (f64::from(k / 20) - 9.5) * 10.0);
        let point = through + e1 * x + e2 * y + up.into_inner() * (slope * x);
        (1000 + k as usize, LowestPoint { point, variance: 1e-9, height: 1e-3, distance: 1e-3 })
    });
    GroundPlane::fit(up, &told.collect::<Vec<_>>(), &[], None).unwrap()
}

#[test]
fn an_object_on_the_ground_is_held_at_its_height_in_the_world() {
    let up = Unit::new_normalize(Vector3::new(0.1, -0.2, 1.0));
    ball_on_ground(Some(up), |fit, _, _| {
        let through = Point3::new(1.0, -2.0, -3.0);
        let plane = ground(through, &up, 0.05);
        let frame = &fit.problem.measurements.frame;
        let center = frame.point_in_world(fit.body.center());
        let radius = 0.9 * frame.unit;
        let lowest = fit.lowest_point(&up).unwrap();
        assert!((lowest.point - (center - up.into_inner() * radius)).norm() < 1e-9 * radius, "{lowest:?}");
        assert!((lowest.height - 2.0 * radius).abs() < 1e-9 * radius);
        let mut standing = fit.clone();
        standing.stand_on_ground(None, &plane, &up);
        let (local, weight) = standing.ground.unwrap();
        let found = fit.body.distance_to_plane(&local.n, local.d).0 * weight;
        // Of a ball the point nearest to the plane lies along its normal.
        let normal = (up.into_inner() - horizontal_basis(&up)[0] * 0.05).normalize();
        let expected = (normal.dot(&(center - through)) - radius) / lowest.unevenness();
        assert!((found - expected).abs() < 1e-3 * (1.0 + expected.abs()), "{found} {expected}");
    });
    // Without a known direction nothing stands.
    ball(|fit, _, _| assert!(!fit.is_on_ground()));
}

#[test]
fn the_grounds_own_pull_is_taken_out_of_what_an_object_tells_of_it() {
    let up = Vector3::z_axis();
    ball_on_ground(Some(up), |fit, noise, _| {
        // Little is known of the object, so that the ground has a say.
        let noise = noise.scaled(10.0);
        let free = fit.refined(&noise, true);
        let alone = free.lowest_point(&up).unwrap();
        let deviation = alone.variance.sqrt();
        // A plane that lies lower by half a deviation of the object's lowest point.
        let plane = ground(alone.point - up.into_inner() * 0.5 * deviation, &up, 0.0);
        let mut standing = free.clone();
        standing.stand_on_ground(None, &plane, &up);
        let standing = standing.refined(&noise, true);
        let bottom = |fit: &Fit| {
            let frame = &fit.problem.measurements.frame;
            up.dot(&frame.point_in_world(fit.body.center()).coords)
                - fit.body.support_gradient(&frame.direction_from_world(&up)).0 * frame.unit
        };
        let pulled = bottom(&free) - bottom(&standing);
        assert!(pulled > 0.1 * deviation, "pulled by {pulled} of {deviation}");
        let told = standing.lowest_point(&up).unwrap();
        let moved = up.dot(&(told.point - alone.point)).abs();
        assert!(moved < 0.1 * pulled, "{moved} of {pulled}");
        assert!((told.variance / alone.variance - 1.0).abs() < 0.1, "{} {}", told.variance, alone.variance);
    });
}
