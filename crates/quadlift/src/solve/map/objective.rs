//! What is minimised: whitened residuals of all views, with a robust loss where there are outliers, plus priors.

use nalgebra::Vector3;

use super::body_model::BodyModel;
use super::measurements::{Measurements, Plane};
use super::noise::{NoiseGroup, NoiseLevels, NoiseStatistics};
use super::normal_equations::{NormalEquations, PARAMETERS, Row};
use super::rows::{ResidualRow, view_rows};
use crate::geometry::linalg::invert_spd;

/// Scale of the redescending loss (Geman-McClure) on the norm of a view's whitened residuals.
pub(super) const OUTLIER_SCALE: f64 = 4.0;

/// Priors of one object, in its frame.
#[derive(Debug, Clone, Default)]
pub(super) struct ObjectPrior {
    /// 1/sd of the deviation of the log semi-axes from their mean.
    pub shape_weight: f64,
    /// Mean and 1/sd of the log semi-axes: length, width, height.
    pub log_size: Option<[(f64, f64); 3]>,
    /// Direction against gravity.
    pub up: Option<Vector3<f64>>,
    /// 1/sd of the angle between an axis and `up`.
    pub upright_weight: f64,
    /// The plane on which the object stands (positive above) and 1/sd of the distance, lengths in object units.
    pub ground: Option<(Plane, f64)>,
    /// The axes of the body model are length, width and height, in this order (set for oriented bodies).
    pub axes_are_named: bool,
}

/// The objective of one object.
#[derive(Debug)]
pub(super) struct Objective<'a> {
    pub measurements: &'a Measurements,
    pub prior: &'a ObjectPrior,
    pub noise: &'a NoiseLevels,
    /// Whether views may be outliers.
    pub robust: bool,
    /// Whether shapes of ellipses are compared in the smooth form, for the way from a start.
    pub smooth: bool,
}

impl Objective<'_> {
    /// Cost and normal equations at a body; `None` when it is not finite.
    pub(super) fn linearise(&self, body: &impl BodyModel) -> Option<NormalEquations> {
        let mut equations = NormalEquations::zero();
        let mut rows = Vec::with_capacity(16);
        for view in 0..self.measurements.views.len() {
            view_rows(self.measurements, view, body, self.noise, self.smooth, &mut rows);
            let weight = if self.robust {
                let (cost, weight) = geman_mcclure(squared_norm(&rows));
                equations.cost += cost;
                weight
            } else {
                equations.cost += squared_norm(&rows);
                1.0
            };
            for row in &rows {
                equations.add_row(row.residual, &row.row, weight);
            }
        }
        self.add_priors(body, &mut equations);
        equations.cost.is_finite().then_some(equations)
    }

    /// Squared norm of each view's whitened residuals.
    pub(super) fn view_costs(&self, body: &impl BodyModel) -> Vec<f64> {
        let mut rows = Vec::with_capacity(16);
        (0..self.measurements.views.len())
            .map(|view| {
                view_rows(self.measurements, view, body, self.noise, self.smooth, &mut rows);
                squared_norm(&rows)
            })
            .collect()
    }

    /// Residual statistics for the noise levels; nothing when the normal equations are singular.
    pub(super) fn statistics(&self, body: &impl BodyModel, equations: &NormalEquations) -> NoiseStatistics {
        let mut statistics = NoiseStatistics::default();
        let Some(covariance) = invert_spd(&equations.hessian()) else { return statistics };
        let mut rows = Vec::with_capacity(16);
        let mut counts = [0; NoiseGroup::ALL.len()];
        let views = self.measurements.views.len();
        for view in 0..views {
            view_rows(self.measurements, view, body, self.noise, self.smooth, &mut rows);
            let weight = if self.robust { geman_mcclure(squared_norm(&rows)).1 } else { 1.0 };
            for row in &rows {
                let gradient = nalgebra::SVector::<f64, PARAMETERS>::from(row.row);
                let leverage = weight * gradient.dot(&(covariance * gradient));
                statistics.add(row.group, row.residual, weight, leverage);
                counts[row.group as usize] += 1;
            }
        }
        for group in NoiseGroup::ALL {
            statistics.add_views(group, counts[group as usize], views);
        }
        statistics
    }

    fn add_priors(&self, body: &impl BodyModel, equations: &mut NormalEquations) {
        if self.prior.shape_weight > 0.0 {
            body.add_shape_prior(self.prior.shape_weight, equations);
        }
        if let Some(up) = &self.prior.up
            && self.prior.upright_weight > 0.0
        {
            body.add_upright_prior(up, self.prior.upright_weight, equations);
        }
        if let Some(log_size) = &self.prior.log_size {
            let gradients = body.log_axes_gradient();
            let semi_axes = body.semi_axes();
            for (axis, named) in self.named_axes(body).into_iter().enumerate() {
                let (mean, weight) = log_size[named];
                let row: Row = gradients[axis].map(|x| x * weight);
                equations.add_quadratic(weight * (semi_axes[axis].ln() - mean), &row);
            }
        }
        if let Some((plane, weight)) = &self.prior.ground {
            let (h, slope) = body.support_gradient(&plane.n);
            let mut row = [0.0; PARAMETERS];
            for k in 0..3 {
                row[k] = weight * plane.n[k];
            }
            for k in 0..6 {
                row[3 + k] = -weight * slope[k];
            }
            equations.add_quadratic(weight * (plane.n.dot(body.center()) + plane.d - h), &row);
        }
    }

    /// For each axis of the body, which of length (0), width (1) and height (2) it is.
    fn named_axes(&self, body: &impl BodyModel) -> [usize; 3] {
        if self.prior.axes_are_named {
            return [0, 1, 2];
        }
        let semi_axes = body.semi_axes();
        let mut names = [0; 3];
        match &self.prior.up {
            Some(up) => {
                let vertical = (body.axes().transpose() * up).iamax();
                let (a, b) = ((vertical + 1) % 3, (vertical + 2) % 3);
                let length = if semi_axes[a] >= semi_axes[b] { a } else { b };
                names[vertical] = 2;
                names[length] = 0;
                names[3 - vertical - length] = 1;
            }
            None => {
                // Longest to longest: the only sensible match when no direction is known.
                let order = |values: [f64; 3]| {
                    let mut order = [0, 1, 2];
                    order.sort_by(|&a, &b| values[b].total_cmp(&values[a]));
                    order
                };
                let by_prior = order(self.prior.log_size.unwrap_or_default().map(|(mean, _)| mean));
                for (axis, name) in order(semi_axes.into()).into_iter().zip(by_prior) {
                    names[axis] = name;
                }
            }
        }
        names
    }
}

fn squared_norm(rows: &[ResidualRow]) -> f64 {
    rows.iter().map(|row| row.residual * row.residual).sum()
}

/// Cost and weight of a view under the Geman-McClure loss.
fn geman_mcclure(squared: f64) -> (f64, f64) {
    let ratio = 1.0 + squared / (OUTLIER_SCALE * OUTLIER_SCALE);
    (squared / ratio, 1.0 / (ratio * ratio))
}
