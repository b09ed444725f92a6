//! Evidence of views about kinds of bodies.

use super::super::scenes_of_tests::{box_scene, with_scene};
use super::*;
use crate::solve::posterior::residuals::measurements::Plane;
use crate::synthetic::SyntheticOptions;

/// An object seen in views of these costs as an ellipsoid and as a cuboid.
fn seen(ellipsoid: &[f64], cuboid: &[f64]) -> BodyEvidence {
    let fit = |costs: &[f64]| Some(KindFit::of_views(costs.iter().map(|cost| vec![cost / 4.0; 4]).collect(), 10.0));
    let mut fits = std::array::from_fn(|_| None);
    (fits[ELLIPSOID], fits[CUBOID]) = (fit(ellipsoid), fit(cuboid));
    BodyEvidence { category: None, sized: false, log_wrong: -4.0, heavy_tails: false, fits }
}

/// A kind that gives up views that another one explains is the less probable one, however well it fits the rest.
#[test]
fn views_that_a_kind_rejects_count_against_it() {
    let mut ellipsoid = [0.01; 20];
    let mut cuboid = [1e-4; 20];
    ellipsoid[18..].fill(900.0);
    cuboid[14..].fill(400.0);
    let evidence = seen(&ellipsoid, &cuboid);
    let odds = |variance| evidence.log_odds(variance)[CUBOID];
    assert!(odds(0.01 / 4.0) < -20.0, "{}", odds(0.01 / 4.0));
    // With the same views rejected the better fit wins.
    cuboid[14..18].fill(1e-4);
    let evidence = seen(&ellipsoid, &cuboid);
    assert!(evidence.log_odds(1e-4)[CUBOID] > 20.0);
    assert_eq!(evidence.best().0, CUBOID);
}

#[test]
fn the_noise_of_an_object_is_that_of_the_views_that_show_it() {
    let mut costs = [2.0; 12];
    costs[9..].fill(5000.0);
    let evidence = seen(&costs, &costs);
    let (_, variance, dof) = evidence.best();
    assert!((dof - (36.0 - 9.0)).abs() < 1e-6 && (variance - 18.0 / 27.0).abs() < 1e-6, "{variance} {dof}");
}

/// Wrong boxes are none of an object with twenty times the noise: with Student's t distribution of single edges, whose scale is that of
/// the noise, the kind that fits the others better is as much more probable as without them.
#[test]
fn wrong_boxes_beside_right_ones_take_nothing_from_the_evidence() {
    let views = |variance: f64, wrong: usize| {
        // Squares of a normal distribution at its quantiles, of four edges in turn; and edges that are 25 noises off.
        let right = (0..14).map(|k| (0..4).map(|e| variance * [0.1, 0.45, 1.0, 2.5][(k + e) % 4]).collect());
        right.chain((0..wrong).map(|_| vec![625.0; 4])).collect::<Vec<Vec<f64>>>()
    };
    let odds = |wrong: usize| {
        let mut evidence = seen(&[], &[]);
        (evidence.heavy_tails, evidence.log_wrong) = (true, -5.0);
        evidence.fits[ELLIPSOID] = Some(KindFit::of_views(views(1.5, wrong), 10.0));
        evidence.fits[CUBOID] = Some(KindFit::of_views(views(1.0, wrong), 10.0));
        evidence.log_odds(1.0)[CUBOID]
    };
    let (without, with) = (odds(0), odds(6));
    assert!(without > 5.0 && (with / without - 1.0).abs() < 0.02, "{without} {with}");
}

/// Without wrong boxes the integral has a closed form: `-(N - 9 + 8) / 2 ln(C + 8 v)` of `N` residuals.
#[test]
fn the_sum_over_variances_is_the_integral() {
    for (ellipsoid, cuboid, variance) in [(1.0, 0.5, 0.3), (3.0, 3.5, 1.0), (0.5, 0.01, 0.1)] {
        let mut evidence = seen(&[ellipsoid; 10], &[cuboid; 10]);
        evidence.log_wrong = -100.0;
        let expected = -19.5 * f64::ln((10.0 * cuboid + 8.0 * variance) / (10.0 * ellipsoid + 8.0 * variance));
        let found = evidence.log_odds(variance)[CUBOID];
        assert!((found - expected).abs() < 0.02, "{found} {expected}");
    }
}

/// A cylinder whose radii differ by a factor, and measurements that tell every parameter with this deviation.
fn of_radii(factor: f64, sd: f64) -> f64 {
    let sizes = Vector3::new(factor, 1.0, 2.0);
    let body = OrientedModel::new(Vector3::zeros(), Matrix3::identity(), sizes, BodyKind::Cylinder);
    let mut equations = NormalEquations::zero();
    for k in 0..PARAMETERS {
        let row = std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 });
        equations.add_row(0.0, &row, 1.0 / (sd * sd));
    }
    elongation(&Model::Oriented(body), &equations)
}

/// Against the densities of the two priors at what was measured.
#[test]
fn cylinders_are_round() {
    for (factor, sd) in [(1.0, 0.01), (1.3, 0.05), (2.0, 0.2)] {
        // The difference of two parameters has twice the variance.
        let density = |prior_sd: f64| {
            let variance = prior_sd * prior_sd + 2.0 * sd * sd;
            (-0.5 * f64::ln(factor).powi(2) / variance).exp() / variance.sqrt()
        };
        let expected = -2.0 * (density(ROUND_SD) / density(ANY_SD)).ln();
        assert!((of_radii(factor, sd) - expected).abs() < 1e-9, "{factor} {sd}");
    }
    assert!(of_radii(1.0, 0.01) < -3.0, "round ones are more probable than any");
    assert!(of_radii(1.5, 0.01) > 10.0, "elliptic ones less");
    assert!(of_radii(1.5, 10.0).abs() < 0.1, "measurements that tell nothing decide nothing");
}

/// The freedom counts by half its logarithm, where the views agree with both kinds alike.
#[test]
fn of_bodies_that_fit_alike_the_one_of_less_freedom_is_the_more_probable() {
    let mut evidence = seen(&[2.0; 10], &[2.0; 10]);
    for (freedom, best) in [(16.0, ELLIPSOID), (4.0, CUBOID)] {
        evidence.fits[CUBOID].as_mut().unwrap().freedom = freedom;
        let found = evidence.log_odds(0.7)[CUBOID];
        assert!((found - 0.5 * (10.0 - freedom)).abs() < 1e-9, "{found}");
        assert_eq!(evidence.best().0, best);
    }
}

/// The costs of views and the freedom of each kind that was fitted to one object, which stands on a plane: logarithm of the determinant
/// with a prior on rotations, and minus twice that of the priors: shape, ground, and how round a cylinder is.
#[test]
fn the_freedom_is_that_of_the_normal_equations_and_the_priors() {
    let options = SyntheticOptions { objects: 1, views: 6, body: BodyKind::Cylinder, ..Default::default() };
    with_scene(&box_scene(0.02, &options), &Default::default(), |views_of, context| {
        let noise = NoiseLevels::new(67.0).scaled(0.3);
        let problem = ObjectProblem::new(views_of(0), BodyKind::Ellipsoid, context).unwrap();
        let mut fit = Fit::first(problem, &noise, context).unwrap();
        fit.ground = Some((Plane { n: Vector3::z(), d: 0.9 }, 5.0));
        let evidence = BodyEvidence::of(&fit, &noise, context).unwrap();
        let search = BodySearch::new(&fit, &noise, context);
        for kind in 0..KINDS {
            let found = evidence.fits[kind].as_ref().unwrap();
            let Model::Oriented(body) = &found.body else { panic!("an oriented body") };
            let logs = body.semi_axes().map(f64::ln);
            let shape = (logs - Vector3::repeat(logs.mean())).norm_squared() / (0.4 * 0.4);
            let height = 5.0 * (body.center().z + 0.9 - body.support_gradient(&Vector3::z()).0);
            let equations = search.objective().linearize(body).unwrap();
            let mut hessian = equations.hessian();
            // The volume of the rotations that differ for a cuboid is that of a Gaussian of this precision.
            let precision = std::f64::consts::TAU * (3.0 / std::f64::consts::PI.powi(2)).powf(2.0 / 3.0);
            (3..6).for_each(|k| hessian[(k, k)] += precision);
            let mut expected = hessian.determinant().ln() + shape + height * height;
            if kind == CYLINDER {
                let inverse = hessian.try_inverse().unwrap();
                let variance = inverse[(6, 6)] + inverse[(7, 7)] - 2.0 * inverse[(6, 7)];
                let density = |sd: f64| {
                    let variance = variance + sd * sd;
                    (-0.5 * (logs.x - logs.y).powi(2) / variance).exp() / variance.sqrt()
                };
                // A third of the names of a cuboid's axes; radii that differ by 10 %, against those of any body.
                expected += 2.0 * f64::ln(3.0) - 2.0 * (density(0.1) / density(2.0_f64.sqrt() * 0.4)).ln();
            }
            assert!((found.freedom - expected).abs() < 0.01, "{kind}: {} {expected}", found.freedom);
            let costs: f64 = found.views.iter().flatten().map(|square| 10.0 * (square / 9.0).ln_1p()).sum();
            assert!((costs + shape + height * height - equations.cost).abs() < 1e-6 * equations.cost, "{kind}");
        }
        // Of the boxes of a cylinder it is the best.
        let best = evidence.fits.iter().flatten().map(|fit| fit.cost).fold(f64::INFINITY, f64::min);
        assert!(evidence.fits[CYLINDER].as_ref().unwrap().cost < best + 1.0);
        // Starts that lead nowhere leave what was found.
        let mut again = evidence.clone();
        let bad = OrientedModel::new(Vector3::repeat(0.5), Matrix3::identity(), Vector3::repeat(3.0), BodyKind::Cuboid);
        again.take(CUBOID, &search, vec![bad], 0);
        assert_eq!(again.fits[CUBOID].as_ref().unwrap().cost, evidence.fits[CUBOID].as_ref().unwrap().cost);
    });
}
