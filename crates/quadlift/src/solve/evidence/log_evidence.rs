//! The log evidence of a fit: its likelihood integrated over the object's own noise, times the volume of its posterior over that of
//! its prior (Laplace's approximation), with normalized priors, so that kinds, upright bodies and noise levels compare.

use std::f64::consts::{LN_2, PI, TAU};

use nalgebra::Vector3;

use super::conditions::{Conditions, DOF};
use super::fit::{Fit, Workspace, clutter, log_determinant, residuals};
use super::lanes::Lanes;
use super::prior::{TILT_SD, prior};
use super::rows::Rows;
use super::solid::{Family, Solid};
use crate::solve::estimate::Matrix9;

/// Precision of a Gaussian with the volume of the rotations that differ for a cuboid: `(2 pi)^(3/2) s^3 = 8 pi^2 / 24`.
pub(super) const ROTATION_PRECISION: f64 = 2.84;

/// Volume of those rotations.
const ROTATION_VOLUME: f64 = PI * PI / 3.0;

/// The same for the quarter turn about the vertical that differs for an upright cuboid.
const YAW_PRECISION: f64 = 2.54;

/// The same for half a turn of the axis of a level cylinder, and for each of the two angles of the axis of any.
const LEVEL_AXIS_PRECISION: f64 = 0.64;
const AXIS_PRECISION: f64 = 1.0;

/// Shape of the inverse gamma distribution of an object's noise variance about the scene's: eight degrees of freedom.
const VARIANCE_SHAPE: f64 = 4.0;

/// Bounds of the logarithm of an object's variance over the scene's.
const MAX_LOG_VARIANCE: f64 = 1.6;

/// Secant steps towards the peak of the integrand.
const MAX_STEPS: usize = 4;

/// Log evidence of a fit that converged under the noise levels of `conditions`, for residuals in half sizes, so that levels compare.
/// Neighboring views count as independent.
pub(super) fn log_evidence(rows: &Rows, fit: &Fit, conditions: &Conditions, work: &mut Workspace) -> f64 {
    let body = &fit.body;
    let prior = prior(body, conditions.shape_sd);
    let data = (fit.equations.hessian - prior.hessian) / conditions.view_weight;
    residuals(rows, body, conditions, work);
    let mut hessian = data + prior.hessian;
    if body.family == Family::Ellipsoid {
        hessian = with_angles(body, hessian, &prior.hessian, conditions.shape_sd);
    }
    let log_density = add_flat_priors(body, &mut hessian, conditions.shape_sd);
    let log_scale: f64 = (rows.views.iter())
        .flat_map(|view| {
            let sd = view.sd(conditions);
            (0..4).filter(|&edge| !view.truncated[edge]).map(move |edge| sd.0[edge].ln())
        })
        .sum();
    let evidence = log_likelihood_over_variance(rows, conditions, work)
        - 0.5 * (log_determinant(&hessian) + prior.cost)
        + log_density
        + fit.log_share_evidence
        - log_scale;
    if evidence.is_nan() { f64::NEG_INFINITY } else { evidence }
}

/// Half the logarithm of `2 pi` for each of so many parameters.
fn half_log_tau(parameters: f64) -> f64 {
    0.5 * parameters * TAU.ln()
}

/// The normal matrix of an ellipsoid in rotations and logarithms of semi-axes, with the prior of an angle for the tilt.
fn with_angles(body: &Solid, mut hessian: Matrix9, of_prior: &Matrix9, shape_sd: f64) -> Matrix9 {
    if body.up.is_some() {
        hessian += prior(&Solid { up: None, ..*body }, shape_sd).hessian - of_prior;
    }
    let a = &body.half_extents;
    let scale = nalgebra::SVector::<f64, 9>::from_fn(|k, _| match k {
        0..3 => 1.0,
        3..6 => {
            let (i, j) = ((k + 1) % 3, (k + 2) % 3);
            (a[i] * a[i] - a[j] * a[j]).abs() / (a[i] * a[j])
        }
        _ => 2.0,
    });
    hessian.zip_map(&(scale * scale.transpose()), |h, s| h * s)
}

/// Adds flat priors of rotations to the normal matrix as Gaussians of the same volume; the logarithm of the density of the priors of
/// rotation and proportions, with the volume that belongs to the determinant.
fn add_flat_priors(body: &Solid, hessian: &mut Matrix9, shape_sd: f64) -> f64 {
    let variance = shape_sd * shape_sd;
    let tilt = TILT_SD * TILT_SD;
    let mut add = |index: usize, precision: f64| hessian[(index, index)] += precision;
    // Densities: of two log ratios of three axes, of one ratio of a cylinder, of two angles of tilt.
    let three_axes = -(0.5 * 3f64.ln() + TAU.ln() + variance.ln());
    let two_axes = -0.5 * (TAU * 1.5 * variance).ln();
    let two_tilts = -(TAU * tilt).ln();
    let vertical_or_level = -LN_2;
    match (body.family, body.up) {
        (Family::Cylinder, None) => {
            (3..5).for_each(|k| add(k, AXIS_PRECISION));
            half_log_tau(7.0) - TAU.ln() + two_axes
        }
        (Family::Cylinder, Some(_)) if body.is_level_cylinder() => {
            (3..5).for_each(|k| add(k, LEVEL_AXIS_PRECISION));
            half_log_tau(7.0) + vertical_or_level - PI.ln() - 0.5 * (TAU * tilt).ln() + two_axes
        }
        (Family::Cylinder, Some(_)) => half_log_tau(7.0) + vertical_or_level + two_tilts + two_axes,
        (_, None) => {
            (3..6).for_each(|k| add(k, ROTATION_PRECISION));
            half_log_tau(9.0) - ROTATION_VOLUME.ln() + three_axes
        }
        (family, Some(up)) => {
            if family == Family::Ellipsoid {
                let vertical = vertical_axis(body, &up);
                (0..3).for_each(|k| add(3 + k, if k == vertical { YAW_PRECISION } else { 1.0 / tilt }));
            } else {
                add(5, YAW_PRECISION);
            }
            half_log_tau(9.0) - (PI / 2.0).ln() + two_tilts + three_axes
        }
    }
}

/// Index of the axis nearest to `up`.
pub(super) fn vertical_axis(body: &Solid, up: &Vector3<f64>) -> usize {
    body.axes.tr_mul(up).iamax()
}

/// `ln int InvGamma(v) prod_f L_f(r / sqrt v) dv` over the object's variance v in units of the scene's, from the residuals in `work`: the
/// peak in `ln v` by secant steps, and its width (Laplace).
pub(super) fn log_likelihood_over_variance(rows: &Rows, conditions: &Conditions, work: &Workspace) -> f64 {
    let at = |log_variance: f64| -> (f64, f64) {
        let inverse = (-log_variance).exp();
        let (mut logs, mut product) = (0.0, 1.0f64);
        let mut slope = VARIANCE_SHAPE * (inverse - 1.0);
        for (view, at) in rows.views.iter().zip(&work.views) {
            let x = at.residual * at.residual * (inverse / DOF);
            let tail = x + Lanes::splat(1.0);
            let count = view.two_sided[0] + view.two_sided[1];
            let scale = match count {
                4 => inverse * inverse,
                2 => inverse,
                _ => inverse.powf(0.5 * f64::from(count)),
            };
            let tails = tail.product();
            let squared = tails * tails;
            let right = (1.0 - conditions.wrong_share) * scale / (squared * squared * tails);
            let likelihood = right + conditions.wrong_share * clutter(view, conditions);
            slope += right / likelihood * (0.5 * (DOF + 1.0) * (x / tail).sum() - 0.5 * f64::from(count));
            product *= likelihood;
            if product < 1e-200 {
                logs += product.ln();
                product = 1.0;
            }
        }
        (logs + product.ln() - VARIANCE_SHAPE * (log_variance + inverse), slope)
    };
    let mut x = 0.0;
    let (mut value, mut slope) = at(x);
    let mut curvature = VARIANCE_SHAPE + 1.4 * rows.views.len() as f64;
    for _ in 0..MAX_STEPS {
        let next = (x + (slope / curvature).clamp(-0.8, 0.8)).clamp(-MAX_LOG_VARIANCE, MAX_LOG_VARIANCE);
        if (next - x).abs() < 0.3 / curvature.sqrt() {
            break;
        }
        let (next_value, next_slope) = at(next);
        curvature = ((slope - next_slope) / (next - x)).clamp(0.3 * curvature, 3.0 * curvature).max(1.0);
        (x, value, slope) = (next, next_value, next_slope);
    }
    // ln(b^a / Gamma(a)) of the inverse gamma distribution, a = b = 4.
    let normalization = VARIANCE_SHAPE * VARIANCE_SHAPE.ln() - 6f64.ln();
    value + 0.5 * (slope * slope / curvature).min(0.2) + 0.5 * (TAU / curvature).ln() + normalization
}
