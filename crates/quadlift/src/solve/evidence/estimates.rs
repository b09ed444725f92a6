//! From a fitted object to its estimate: the body in the world, its covariance, the views that it explains.

use nalgebra::{Matrix3, Rotation3, Vector3};

use super::conditions::Conditions;
use super::fit::{Workspace, residuals};
use super::noise_names::Shared;
use super::object::Object;
use super::solid::{Family, Solid};
use crate::body_model::ellipsoid::shape_jacobian;
use crate::geometry::{Body, rotation_vector};
use crate::optimize::normal_equations::PARAMETERS;
use crate::scene::ObjectViews;
use crate::solve::estimate::{
    Alternative, Covariance, CovarianceCoordinates, Estimate, GoodnessOfFit, MAX_RELATIVE_CENTER_SD, Matrix9, Status,
    Warning,
};
use crate::solve::posterior::object::agreement::{is_inconsistent, median_level};
use crate::solve::posterior::object::alternatives::{MAX_ALTERNATIVES, are_different, symmetries};
use crate::solve::posterior::object::covariance;
use crate::solve::report::{describe, is_a_body};

/// A view with at least this probability to show the object counts as used.
const MIN_PROBABILITY: f64 = 0.5;

/// A fit whose cost could still decrease by more than this has not converged: a tenth of a squared standard deviation of the estimate.
const MAX_REMAINING_DECREASE: f64 = 0.01;

/// Log odds from which another body fits about as well (38 %). With even less, one half against one, 5.6 % of the right objects among
/// three views, some with a wrong box, came with a warning or were undetermined, where 5 % may.
const AMBIGUOUS: f64 = -0.5;

/// Standard deviation of the logarithm of one radius of a cylinder about the other: bases are round, but covariances must be regular.
const ROUND_BASE_SD: f64 = 0.01;

/// Noise in half sizes below which residuals are not compared: bodies that are not quite of the right kind leave more than exact boxes.
const MIN_EDGE_NOISE: f64 = 0.01;

/// What all estimates of a scene need.
pub(super) struct Reporter<'a> {
    pub shared: &'a Shared,
    /// Normalized residual of a consistent object, in units of the noise.
    pub reference: f64,
    pub with_enclosing: bool,
}

/// The normalized residual that consistent objects of the scene have: that of the median object, at most the noise itself, so that a
/// scene of objects with wrong boxes does not excuse them.
pub(super) fn reference(objects: &[Object], conditions: &Conditions) -> f64 {
    let mut work = Workspace::default();
    let goodness: Vec<GoodnessOfFit> =
        objects.iter().filter_map(|object| goodness_of_fit(object, conditions, &mut work)).collect();
    let least = MIN_EDGE_NOISE / conditions.noise[0];
    // Without objects the levels were given, and count alone.
    let level = if objects.is_empty() { 1.0 } else { median_level(goodness.into_iter()).min(1.0) };
    level.max(least)
}

/// Residual statistics of an object; `None` where nothing is left after its parameters.
fn goodness_of_fit(object: &Object, conditions: &Conditions, work: &mut Workspace) -> Option<GoodnessOfFit> {
    let fit = object.fit();
    residuals(&object.rows, &fit.body, conditions, work);
    let (mut squares, mut relative, mut rows) = (0.0, 0.0, 0.0);
    for (view, at) in object.rows.views.iter().zip(&work.views) {
        let sd = view.sd(conditions) * view.size_factor;
        for edge in (0..4).filter(|&edge| at.residual.0[edge] != 0.0) {
            let squared = at.residual.0[edge].powi(2);
            squares += at.weight.0[edge] * squared;
            relative += at.probability * squared * sd.0[edge].powi(2);
            rows += at.probability;
        }
    }
    let dof = rows - fit.determined(conditions)?;
    (dof > 0.0).then(|| GoodnessOfFit {
        normalized_residual: (squares / dof).sqrt(),
        relative_residual: (relative / dof).sqrt(),
        dof,
    })
}

impl Reporter<'_> {
    /// The estimate of an object with its views.
    pub(super) fn estimate(&self, object: &Object, views: &ObjectViews, work: &mut Workspace) -> Estimate {
        let blank = Estimate::failed(views.object_index, views.category_index, Status::Ok);
        let (rows, fit, conditions) = (&object.rows, object.fit(), &self.shared.conditions);
        let body = fit.body.in_world(&rows.origin, rows.unit);
        if !fit.equations.cost.is_finite() || !is_a_body(&body, &views.views) {
            return Estimate { status: Status::Diverged, ..blank };
        }
        let Some(local) = self.shared.systematic.covariance(object, conditions, work) else {
            return Estimate { status: Status::Degenerate, ..blank };
        };
        let local = with_alternatives(&local, object);
        let goodness = goodness_of_fit(object, conditions, work);
        // Views that look away from the object have no rows.
        let mut probability = vec![0.0; views.views.len()];
        let mut deviation = vec![None; views.views.len()];
        for (view, at) in rows.views.iter().zip(&work.views) {
            probability[view.view] = at.probability;
            let used = at.residual.0.iter().filter(|x| **x != 0.0).count();
            let squares = (at.residual * at.residual).sum();
            deviation[view.view] = (used > 0).then(|| (squares / used as f64).sqrt() / self.reference);
        }
        let inlier = |view: usize| probability[view] >= MIN_PROBABILITY;
        let mut estimate = describe(blank, body, &views.views, inlier, self.with_enclosing);
        for (view, deviation) in estimate.views.iter_mut().zip(deviation) {
            view.normalized_residual = deviation;
        }
        estimate.covariance = in_world(&fit.body, &local, rows.unit);
        let converged = fit.converged || fit.remaining <= MAX_REMAINING_DECREASE;
        if !converged {
            estimate.warnings.push(Warning::NotConverged);
        }
        if !converged || estimate.relative_center_sd().is_some_and(|sd| sd > MAX_RELATIVE_CENTER_SD) {
            estimate.status = Status::Undetermined;
        }
        estimate.goodness_of_fit = goodness.map(|goodness| GoodnessOfFit {
            normalized_residual: goodness.normalized_residual / self.reference,
            ..goodness
        });
        let rests_on_few = 2 * estimate.views_used() < estimate.views.len();
        if rests_on_few || estimate.goodness_of_fit.as_ref().is_some_and(is_inconsistent) {
            estimate.status = Status::Inconsistent;
        }
        let alternatives = object.alternatives.iter().map(|(solid, log_odds)| Alternative {
            body: solid.in_world(&rows.origin, rows.unit),
            log_odds: *log_odds,
        });
        // Seen from the axes of the body, so that nothing depends on those of the world. Another kind of about the same extent is no other
        // answer.
        let is_other = |other: &Body| match std::mem::discriminant(&other.kind) == std::mem::discriminant(&body.kind) {
            true => are_different(&body, other, &fit.body.axes),
            false => are_different(&body.closest_ellipsoid().into(), &other.closest_ellipsoid().into(), &fit.body.axes),
        };
        let alternatives = alternatives.filter(|other| is_other(&other.body));
        estimate.alternatives = alternatives.take(MAX_ALTERNATIVES).collect();
        if let Some(first) = estimate.alternatives.first().filter(|first| first.log_odds > AMBIGUOUS) {
            estimate.warnings.push(Warning::Ambiguous { log_odds: first.log_odds });
        }
        estimate
    }
}

/// The covariance of the mixture about the reported body, in the parameters of the fit: with the squared distances of the alternatives, by
/// their probabilities.
fn with_alternatives(covariance: &Matrix9, object: &Object) -> Matrix9 {
    let body = &object.fit().body;
    let odds = object.alternatives.iter().map(|(_, log_odds)| log_odds.min(0.0).exp());
    let total = 1.0 + odds.clone().sum::<f64>();
    let mut covariance = *covariance;
    for ((other, _), odds) in object.alternatives.iter().zip(odds) {
        let difference = difference(body, other);
        covariance += difference * difference.transpose() * (odds / total);
    }
    covariance
}

/// From one body to another, as a step of the fit: center, rotation of bodies with edges, logarithms of the support along the axes.
fn difference(body: &Solid, other: &Solid) -> super::solid::Step {
    let mut step = super::solid::Step::zeros();
    step.fixed_rows_mut::<3>(0).copy_from(&(other.center - body.center));
    let scale = if body.family == Family::Ellipsoid { 2.0 } else { 1.0 };
    for k in 0..3 {
        let axis: Vector3<f64> = body.axes.column(k).into();
        step[6 + k] = scale * (other.support(&axis) / body.half_extents[k]).ln();
    }
    let has_edges = |solid: &Solid| matches!(solid.family, Family::Cuboid | Family::Rounded);
    if has_edges(body) && has_edges(other) {
        // Of the 24 ways to name the axes of the other body the nearest.
        let turn = body.axes.transpose() * other.axes;
        let nearest = symmetries().into_iter().max_by(|a, b| (turn * a).trace().total_cmp(&(turn * b).trace()));
        let turn = turn * nearest.unwrap_or_else(Matrix3::identity);
        step.fixed_rows_mut::<3>(3).copy_from(&rotation_vector(&Rotation3::from_matrix_unchecked(turn)));
    }
    step
}

/// A covariance of the parameters of the fit in world units: of ellipsoids that of `vech A`, of others that of rotation vector and
/// logarithms; `None` when it is not finite.
fn in_world(body: &Solid, local: &Matrix9, unit: f64) -> Option<Covariance> {
    let mut map = Matrix9::identity();
    map.fixed_view_mut::<3, 3>(0, 0).copy_from(&(Matrix3::identity() * unit));
    let coordinates = match body.family {
        Family::Ellipsoid => {
            let root = body.axes * Matrix3::from_diagonal(&(body.half_extents * unit));
            let slopes = shape_jacobian(&root);
            // The entries 23, 13, 12, 11, 22, 33 of D, as a step has them, in the order of vech.
            for (k, entry) in [4, 2, 1, 0, 3, 5].into_iter().enumerate() {
                map.fixed_view_mut::<6, 1>(3, 3 + k).copy_from(&slopes.column(entry));
            }
            CovarianceCoordinates::CenterVechShape
        }
        Family::Rounded | Family::Cuboid | Family::Cylinder => CovarianceCoordinates::CenterRotationLogAxes,
    };
    let mut local = *local;
    if body.family == Family::Cylinder {
        // One radius, and any rotation about the axis.
        for k in 0..PARAMETERS {
            local[(k, 7)] = local[(k, 6)];
        }
        for k in 0..PARAMETERS {
            local[(7, k)] = local[(6, k)];
        }
        local[(7, 7)] += ROUND_BASE_SD * ROUND_BASE_SD;
    }
    covariance::in_world(&local, &map, coordinates)
}
