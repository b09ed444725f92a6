//! Rounded bodies: the Minkowski sum of a cuboid and an ellipsoid with weights w and 1 - w. For a given w they are fitted like cuboids;
//! w follows by Newton's method with the body optimized.

use super::conditions::Conditions;
use super::fit::{Fit, Termination, Workspace, linearize, minimize};
use super::rows::Rows;
use super::solid::{Solid, Step};
use crate::geometry::linalg::solve_spd;
use crate::optimize::normal_equations::PARAMETERS;

/// Bounds of the cuboid's share: beyond them are cuboids and ellipsoids.
const MIN_SHARE: f64 = 0.03;
const MAX_SHARE: f64 = 0.97;

/// Longest step of the share.
const MAX_SHARE_STEP: f64 = 0.3;

/// A step that decreases the cost by less is none.
const MIN_DECREASE: f64 = 3e-2;

/// Newton's step of the cuboid's share at a fit, with the body optimized for it, and the curvature, prior included.
fn share_step(rows: &Rows, fit: &Fit, conditions: &Conditions, work: &mut Workspace) -> Option<(f64, f64)> {
    let equations = linearize(rows, &fit.body, conditions, work);
    let center: [f64; 3] = fit.body.center.into();
    let (mut gradient, mut curvature, mut cross) = (0.0, 0.0, Step::zeros());
    for (index, view) in rows.views.iter().enumerate() {
        let at = &work.views[index];
        let mut scale = view.sd(conditions).inverse();
        for edge in 0..4 {
            if view.is_reached(edge, at.residual.0[edge]) {
                scale.0[edge] = 0.0;
            }
        }
        let root = at.weight.sqrt();
        let slope = view.pairing.residuals(fit.body.share_slope4(&view.normal, view.length));
        let slope = slope * scale * root * -view.inverse_depth(&center);
        gradient += (slope * at.residual * root).sum();
        curvature += (slope * slope).sum();
        for k in 0..PARAMETERS {
            cross[k] += (slope * work.slopes[index][k]).sum();
        }
    }
    let weight = conditions.view_weight;
    cross *= weight;
    let eliminated = cross.dot(&solve_spd(&equations.hessian, &cross)?);
    let [mean, of_prior] = conditions.cuboid_share;
    let curvature = (curvature * weight - eliminated).max(0.0) + of_prior;
    Some((-(gradient * weight + of_prior * (fit.body.cuboid_share - mean)) / curvature, curvature))
}

/// The rounded body with its best share, from a start, in at most so many rounds.
pub(super) fn fit_rounded(
    rows: &Rows,
    start: &Solid,
    conditions: &Conditions,
    rounds: usize,
    work: &mut Workspace,
) -> Fit {
    let [mean, precision] = conditions.cuboid_share;
    let prior = |share: f64| precision * (share - mean).powi(2);
    let mut fit = minimize(rows, start, conditions, Termination::new(3e-2, 8), work);
    let mut curvature = precision;
    for _ in 0..rounds {
        let Some((step, found)) = share_step(rows, &fit, conditions, work) else { break };
        curvature = found;
        let share = fit.body.cuboid_share;
        let next = (share + step.clamp(-MAX_SHARE_STEP, MAX_SHARE_STEP)).clamp(MIN_SHARE, MAX_SHARE);
        if (next - share).powi(2) * curvature < MIN_DECREASE {
            break;
        }
        let body = Solid { cuboid_share: next, ..fit.body };
        let moved = minimize(rows, &body, conditions, Termination::new(3e-2, 6), work);
        if moved.equations.cost + prior(next) > fit.equations.cost + prior(share) {
            break;
        }
        fit = moved;
    }
    fit.log_share_evidence = 0.5 * (precision / curvature).ln() - 0.5 * prior(fit.body.cuboid_share);
    fit
}
