//! What an object with cues says about the scales of their sources, against differences.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::fit::Fit;
use super::model::Model;
use super::problem::ObjectProblem;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::geometry::BodyKind;
use crate::observer::{Unobserved, Watch};
use crate::solve::options::PosteriorOptions;
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::shared::cue_scales::{CueScales, Ratios};
use crate::synthetic::{CueOptions, Observations, SyntheticOptions, generate, simulate_cues};
use nalgebra::{Matrix3, Vector3};

/// An object of four views with depths and 3D boxes, at a body that is not its best one, under these noise levels.
fn fit_at(noise: &NoiseLevels) -> Fit {
    let make = SyntheticOptions { objects: 1, views: 4, observations: Observations::Boxes, ..Default::default() };
    let made = generate(&make).unwrap();
    let cues = CueOptions { depth: Some(Default::default()), box3d: Some(Default::default()) };
    let scene = simulate_cues(&made.scene, |_, _| Some(made.truth[0].1), &cues, 3).unwrap();
    let options = PosteriorOptions { body: Some(BodyKind::Ellipsoid), ..Default::default() };
    let watch = Watch::new(&Unobserved, 1);
    let context = PosteriorContext { has_cues: true, ..PosteriorContext::of_test(&scene, &options, &watch) };
    let views = scene.object_views(0, &[0, 1, 2, 3]);
    let problem = ObjectProblem::new(views, BodyKind::Ellipsoid, &context).unwrap();
    let axes = Vector3::new(1.1, 0.9, 0.8);
    let body = EllipsoidModel::from_axes(Vector3::new(0.1, 0.05, -0.1), Matrix3::identity(), axes);
    let equations = problem.objective(noise, None).linearize(&body).unwrap();
    let (ellipsoid, body) = (body.clone(), Model::Ellipsoid(body));
    Fit { problem: Arc::new(problem), ellipsoid, body, equations, outlier_scale: None, ground: None, converged: true }
}

#[test]
fn the_cost_falls_with_a_step_as_its_derivatives_say() {
    let noise = NoiseLevels::new(67.0);
    let without_shift = CueScales::default();
    // The object is 200 away.
    let far = Ratios { depths: BTreeMap::from([(Some(0), vec![120.0; 5])]), ..Default::default() };
    // Depth, distance, all sizes, and three extents; the shift.
    for (mut scales, constants) in [(without_shift, 6), (CueScales::of_medians(far), 7)] {
        let mut fit = fit_at(&noise);
        // At no scales, and at some.
        for place in 0..2 {
            let terms = fit.scale_terms(&scales, &noise).unwrap();
            assert_eq!(terms.terms.len(), constants);
            let change = scales.step(std::iter::once(&terms)).unwrap();
            let there = |share: f64| {
                let change = change.part(share);
                (fit.moved_with(&change, share, &terms, &noise).unwrap(), scales.changed(&change))
            };
            let cost = |share: f64| {
                let (fit, scales) = there(share);
                fit.equations.cost + scales.cost()
            };
            let slope = |h: f64| (cost(h) - cost(-h)) / (2.0 * h);
            let by_body = fit.equations.gradient().dot(&change.step_of(&terms, 1.0));
            let of_prior = |constant| scales.prior_gradient(constant);
            let by_scales: f64 = terms
                .terms
                .iter()
                .map(|(constant, term)| (term.gradient + of_prior(*constant)) * change.value(*constant))
                .sum();
            let expected = 2.0 * (by_body + by_scales);
            let slope = slope(1e-4);
            assert!((slope - expected).abs() < 1e-4 * expected.abs(), "{constants} {place}: {slope} {expected}");
            assert!(expected < 0.0 && cost(1.0) < cost(0.0));
            (fit, scales) = there(0.5);
        }
    }
}

/// With the covariance of other levels an object would know more than its measurements tell, and the scales had no solution.
#[test]
fn terms_are_those_of_the_noise_levels() {
    let fit = fit_at(&NoiseLevels::new(67.0));
    for noise in [NoiseLevels::new(67.0).scaled(0.1), NoiseLevels::new(67.0).scaled(10.0)] {
        let terms = fit.scale_terms(&CueScales::default(), &noise).unwrap();
        for term in terms.terms.values() {
            assert!(term.information - term.coupling.dot(&(terms.covariance * term.coupling)) > 0.0);
        }
        assert!(CueScales::default().step(std::iter::once(&terms)).is_some());
    }
}
