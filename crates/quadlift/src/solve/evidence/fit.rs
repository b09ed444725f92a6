//! The likelihood of an object's boxes under a body, and its maximum.
//!
//! A view shows the object, with Student's t of each edge, or it is a wrong box, which lies anywhere:
//! `L = (1 - w) prod (1 + r^2 / nu)^(-(nu + 1) / 2) + w prod (sqrt(2 pi) sigma f / C)`, up to a constant. The probability that it shows
//! the object weights its rows; there is no other treatment of outliers, whatever the number of views.

use std::f64::consts::TAU;

use super::conditions::{CLUTTER_RANGE, Conditions, DOF};
use super::lanes::{Lanes, dot};
use super::prior::prior;
use super::rows::{Rows, ViewRows};
use super::solid::{Solid, Step};
use crate::geometry::linalg::{cholesky, invert_spd, solve_spd};
use crate::optimize::normal_equations::PARAMETERS;
use crate::solve::estimate::Matrix9;

/// Maximum density of a wrong box along one edge, over that of a right one.
const MAX_CLUTTER: f64 = 0.5;

/// Products of likelihoods are taken to their logarithm before they underflow.
const SMALL_PRODUCT: f64 = 1e-200;

/// A step longer than this (radians, logarithms, radii) is cut.
const MAX_STEP: f64 = 1.5;

/// One view at a body: its whitened residuals, the weights of its rows, the probability that it shows the object.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ViewResiduals {
    pub residual: Lanes,
    /// Weights of the edges, the probability included.
    pub weight: Lanes,
    pub probability: f64,
}

/// Buffers of one thread, and what was last written into them.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    /// Slopes of the whitened residuals times the root of their weight.
    pub slopes: Vec<[Lanes; PARAMETERS]>,
    pub views: Vec<ViewResiduals>,
}

/// Density of a wrong box over the peak of a right one's, for the edges of a view that count.
pub(super) fn clutter(view: &ViewRows, conditions: &Conditions) -> f64 {
    let mut density = (1.0 - conditions.opposite_correlation.powi(2)).sqrt().powi(view.pairs());
    for group in 0..2 {
        let of_edge = (TAU.sqrt() / CLUTTER_RANGE * conditions.noise[group] * view.size_factor).min(MAX_CLUTTER);
        for _ in 0..view.two_sided[group] {
            density *= of_edge;
        }
    }
    density
}

/// Residuals, weights and log likelihood at a body; with slopes where they are asked for.
#[inline(always)]
fn evaluate<const SLOPES: bool>(rows: &Rows, body: &Solid, conditions: &Conditions, work: &mut Workspace) -> f64 {
    let count = rows.views.len();
    work.views.resize(count, ViewResiduals::default());
    if SLOPES {
        work.slopes.resize(count, [Lanes::ZERO; PARAMETERS]);
    }
    let center: [f64; 3] = body.center.into();
    let (mut product, mut logs) = (1.0f64, 0.0);
    for (index, view) in rows.views.iter().enumerate() {
        let (support, support_slopes) = body.support4(&view.normal, view.length);
        let inverse_depth = view.inverse_depth(&center);
        let n = &view.residual_normal;
        let support = view.pairing.residuals(support);
        let distance = dot(n, &center) + view.residual_offset - support;
        let error = distance * inverse_depth;
        let mut scale = view.sd(conditions).inverse();
        for edge in 0..4 {
            // A body that reaches beyond the image border agrees with it.
            if view.truncated[edge] && error.0[edge] < 0.0 {
                scale.0[edge] = 0.0;
            }
        }
        let residual = error * scale;
        let tail = Lanes::splat(1.0) + residual * residual * (1.0 / DOF);
        let tails = tail.product();
        let squared = tails * tails;
        let right = (1.0 - conditions.wrong_share) / (squared * squared * tails);
        let likelihood = right + conditions.wrong_share * clutter(view, conditions);
        let probability = right / likelihood;
        let weight = Lanes::splat(probability * (DOF + 1.0) / DOF) / tail;
        work.views[index] = ViewResiduals { residual, weight, probability };
        if SLOPES {
            let slopes = &mut work.slopes[index];
            let factor = scale * weight.sqrt() * inverse_depth;
            for k in 0..3 {
                slopes[k] = (n[k] - error * view.depth_slope[k]) * factor;
            }
            let factor = factor * -1.0;
            for k in 0..6 {
                slopes[3 + k] = view.pairing.residuals(support_slopes[k]) * factor;
            }
        }
        product *= likelihood;
        if product < SMALL_PRODUCT {
            logs += product.ln();
            product = 1.0;
        }
    }
    logs + product.ln()
}

/// Residuals and weights at a body; the log likelihood.
pub(super) fn residuals(rows: &Rows, body: &Solid, conditions: &Conditions, work: &mut Workspace) -> f64 {
    evaluate::<false>(rows, body, conditions, work)
}

/// Normal equations of likelihood and priors at a body.
#[derive(Debug, Clone, Copy)]
pub(super) struct Equations {
    pub hessian: Matrix9,
    pub gradient: Step,
    /// -2 log of likelihood and priors.
    pub cost: f64,
}

/// Linearizes at a body.
pub(super) fn linearize(rows: &Rows, body: &Solid, conditions: &Conditions, work: &mut Workspace) -> Equations {
    let log_likelihood = evaluate::<true>(rows, body, conditions, work);
    let weight = conditions.view_weight;
    let prior = prior(body, conditions.shape_sd);
    let mut equations = Equations {
        hessian: prior.hessian,
        gradient: prior.gradient,
        cost: prior.cost - 2.0 * log_likelihood * weight,
    };
    // Blocks of three by three, so that sums stay in registers.
    for (i, j) in [(0, 0), (3, 0), (3, 3), (6, 0), (6, 3), (6, 6)] {
        let mut sums = [[Lanes::ZERO; 3]; 3];
        for slopes in &work.slopes {
            for x in 0..3 {
                for y in 0..3 {
                    sums[x][y] = sums[x][y] + slopes[i + x] * slopes[j + y];
                }
            }
        }
        for x in 0..3 {
            for y in 0..3 {
                let sum = sums[x][y].sum() * weight;
                equations.hessian[(i + x, j + y)] += sum;
                if i != j {
                    equations.hessian[(j + y, i + x)] += sum;
                }
            }
        }
    }
    let mut sums = [Lanes::ZERO; PARAMETERS];
    for (slopes, view) in work.slopes.iter().zip(&work.views) {
        let residual = view.residual * view.weight.sqrt();
        for k in 0..PARAMETERS {
            sums[k] = sums[k] + slopes[k] * residual;
        }
    }
    for k in 0..PARAMETERS {
        equations.gradient[k] += sums[k].sum() * weight;
    }
    equations
}

/// A body at, or near, a minimum of the cost.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fit {
    pub body: Solid,
    pub equations: Equations,
    /// Decrease of the cost that the last linearization predicted.
    pub remaining: f64,
    /// Whether no step decreases the cost by as much as was asked for.
    pub converged: bool,
    /// Logarithm of what the cuboid's share of a rounded body adds to the evidence.
    pub log_share_evidence: f64,
}

impl Fit {
    /// Number of parameters that the measurements determine, `tr(H^-1 H_data)`; `None` where H is singular.
    pub(super) fn determined(&self, conditions: &Conditions) -> Option<f64> {
        let of_prior = prior(&self.body, conditions.shape_sd).hessian;
        Some(PARAMETERS as f64 - invert_spd(&self.equations.hessian)?.component_mul(&of_prior).sum())
    }
}

/// Where a minimization ends.
#[derive(Debug, Clone, Copy)]
pub(super) struct Termination {
    pub min_predicted_decrease: f64,
    pub steps: usize,
}

impl Termination {
    pub(super) const fn new(min_predicted_decrease: f64, steps: usize) -> Self {
        Self { min_predicted_decrease, steps }
    }
}

/// Levenberg-Marquardt from a body. The center is damped by the mean of its three directions, so that steps turn with the world.
pub(super) fn minimize(
    rows: &Rows,
    start: &Solid,
    conditions: &Conditions,
    termination: Termination,
    work: &mut Workspace,
) -> Fit {
    let mut body = *start;
    let mut equations = linearize(rows, &body, conditions, work);
    let mut damping = 1e-3f64;
    let mut remaining = f64::INFINITY;
    let mut converged = false;
    let mut steps = 0;
    while steps < termination.steps {
        let hessian = &equations.hessian;
        let of_center = (hessian[(0, 0)] + hessian[(1, 1)] + hessian[(2, 2)]) / 3.0;
        let mut damped = *hessian;
        for k in 0..PARAMETERS {
            damped[(k, k)] += damping * if k < 3 { of_center } else { hessian[(k, k)] } + 1e-12;
        }
        let Some(mut step) = solve_spd(&damped, &-equations.gradient) else {
            damping = (damping * 8.0).max(1e-6);
            steps += 1;
            if damping > 1e6 {
                break;
            }
            continue;
        };
        let length = step.norm();
        if !length.is_finite() {
            break;
        }
        if length > MAX_STEP {
            step *= MAX_STEP / length;
        }
        let predicted = -2.0 * equations.gradient.dot(&step) - step.dot(&(hessian * step));
        if damping <= 1.0 {
            remaining = predicted;
        }
        if predicted < termination.min_predicted_decrease {
            converged = true;
            break;
        }
        let moved = body.moved(&step);
        let at_moved = linearize(rows, &moved, conditions, work);
        steps += 1;
        if at_moved.cost < equations.cost {
            (body, equations) = (moved, at_moved);
            damping = (damping * 0.1).max(1e-9);
        } else {
            damping *= 8.0;
            if damping > 1e4 {
                converged = true;
                break;
            }
        }
    }
    Fit { body, equations, remaining, converged, log_share_evidence: 0.0 }
}

/// `ln det` of a positive definite matrix; infinite where it is none.
pub(super) fn log_determinant(matrix: &Matrix9) -> f64 {
    cholesky(matrix).map_or(f64::INFINITY, |lower| 2.0 * lower.diagonal().iter().map(|x| x.ln()).sum::<f64>())
}

/// Mean squared sum of four residuals of a view at its median, over that of Student's t: the median of the sum of four squares of
/// Gaussian variables.
const MEDIAN_OF_FOUR_SQUARES: f64 = 3.36;

/// Typical residual in units of the noise, from the median view.
pub(super) fn residual_level(work: &Workspace) -> f64 {
    let mut sums: Vec<f64> = work.views.iter().map(|view| (view.residual * view.residual).sum()).collect();
    sums.sort_by(f64::total_cmp);
    (sums[sums.len() / 2] / MEDIAN_OF_FOUR_SQUARES).sqrt()
}
