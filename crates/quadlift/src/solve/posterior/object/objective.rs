//! The objective: whitened residuals of all views, a robust loss in case of outliers, and priors (docs/method.md,
//! section 5).

use super::consensus::{Consensus, USUAL_RESIDUALS};
use super::prior::ObjectPrior;
use crate::body_model::BodyModel;
use crate::geometry::linalg::invert_spd;
use crate::optimize::chi_square;
use crate::optimize::normal_equations::{NormalEquations, PARAMETERS, Row};
use crate::optimize::student_t::StudentT;
use crate::solve::estimate::GoodnessOfFit;
use crate::solve::posterior::noise::groups::{CORRELATIONS, NoiseGroup};
use crate::solve::posterior::noise::levels::{NoiseLevels, Weights};
use crate::solve::posterior::noise::statistics::NoiseStatistics;
use crate::solve::posterior::residuals::cues::MeasuredCue;
use crate::solve::posterior::residuals::measurements::{Measurements, Plane};
use crate::solve::posterior::residuals::row::ResidualRow;
use crate::solve::posterior::residuals::view_rows::view_rows;
use crate::tuning::STUDENT_T_DOF;

/// Scale of the redescending loss (Geman-McClure) on the norm of a view's four whitened residuals.
pub(crate) const OUTLIER_SCALE: f64 = 4.0;

/// A view's sum of squared whitened residuals, as if there were four of them.
pub(crate) fn usual_cost(sum: f64, residuals: usize) -> f64 {
    chi_square::as_of(sum, residuals, USUAL_RESIDUALS)
}

/// The outlier scale of an object whose views have these sums of squares ([`Objective::view_costs`]): larger where the views
/// that agree do so less well than the noise of the scene lets expect, because then that noise is not the object's. Few views
/// do not tell.
pub(crate) fn outlier_scale(view_costs: Vec<f64>, noise: &NoiseLevels) -> f64 {
    if view_costs.len() < MIN_VIEWS {
        return OUTLIER_SCALE;
    }
    OUTLIER_SCALE * Consensus::of(view_costs, noise).variance.sqrt().clamp(1.0, 10.0)
}

/// Minimum number of views to detect an outlier.
pub(crate) const MIN_VIEWS: usize = 5;

/// Whitened residuals beyond this are excluded from the correlation between views.
const MAX_CORRELATION_RESIDUAL: f64 = 4.0;

/// The likelihood of a residual of a group with heavy tails.
#[inline]
pub(crate) fn student_t() -> StudentT {
    StudentT::new(STUDENT_T_DOF.get())
}

/// The objective of one object.
#[derive(Debug)]
pub(crate) struct Objective<'a> {
    pub measurements: &'a Measurements,
    pub prior: &'a ObjectPrior,
    /// The plane on which the object stands (positive above) and 1/sd of the distance, lengths in object units.
    pub ground: Option<(Plane, f64)>,
    pub noise: &'a NoiseLevels,
    /// Whether single edges may be wrong.
    pub heavy_tails: bool,
    /// The outlier scale if views may be outliers: views beyond it are down-weighted, in units of the noise, for a view
    /// of four residuals.
    pub outlier_scale: Option<f64>,
    /// Whether shapes of ellipses are compared in the smooth form, for the way from a start.
    pub smooth: bool,
}

impl Objective<'_> {
    /// Cost and normal equations at a body; `None` when it is not finite.
    pub(crate) fn linearize(&self, body: &impl BodyModel) -> Option<NormalEquations> {
        let mut equations = NormalEquations::zero();
        let mut rows = Vec::with_capacity(16);
        let weights = self.weights();
        for view in 0..self.measurements.views.len() {
            view_rows(self.measurements, view, body, self.noise, self.smooth, &mut rows);
            let (cost, view_weight) = self.view_loss(&rows, &weights);
            equations.cost += cost;
            for row in &rows {
                equations.add_row(row.residual, &row.row, view_weight * self.row_weight(row, &weights));
            }
        }
        self.each_cue(body, |_, rows, cost, loss_weight| {
            equations.cost += cost * weights.cues();
            for row in rows {
                equations.add_row(row.residual, &row.row, loss_weight * weights.of(row.group));
            }
        });
        self.add_priors(body, &mut equations);
        equations.cost.is_finite().then_some(equations)
    }

    /// Each cue with its whitened residuals, their cost and their weight. A cue is wrong as a whole:
    /// its residuals have one multivariate Student t distribution.
    #[inline]
    pub(crate) fn each_cue(&self, body: &impl BodyModel, mut take: impl FnMut(&MeasuredCue, &[ResidualRow], f64, f64)) {
        if self.measurements.cues.is_empty() {
            return;
        }
        let mut rows = Vec::with_capacity(9);
        for cue in &self.measurements.cues {
            cue.rows(body, self.noise, &mut rows);
            let squares = rows.iter().map(|row| row.residual * row.residual).sum();
            let (cost, weight) = if self.heavy_tails {
                (student_t().cost_of(squares, rows.len()), student_t().weight_of(squares, rows.len()))
            } else {
                (squares, 1.0)
            };
            take(cue, &rows, cost, weight);
        }
    }

    /// Cost of a view and the factor on the weights of its rows: Geman and McClure's loss of the view's weighted sum of
    /// squares, and its derivative.
    #[inline]
    fn view_loss(&self, rows: &[ResidualRow], weights: &Weights) -> (f64, f64) {
        let (edges, others) = self.view_cost(rows);
        let cost = edges * weights.edges() + others * weights.ellipses();
        let Some(squared_scale) = self.squared_scale(rows.len()) else { return (cost, 1.0) };
        // Whether a view is an outlier does not depend on how many others there are: the scale is weighted like the sum.
        let count = rows.len().max(1) as f64;
        let mean_weight = rows.iter().map(|row| weights.of(row.group)).sum::<f64>() / count;
        let ratio = 1.0 + cost / (mean_weight.max(f64::MIN_POSITIVE) * squared_scale);
        (cost / ratio, 1.0 / (ratio * ratio))
    }

    /// The square of the outlier scale for a view of so many residuals.
    #[inline]
    fn squared_scale(&self, residuals: usize) -> Option<f64> {
        self.outlier_scale.map(|scale| chi_square::as_of(scale * scale, USUAL_RESIDUALS, residuals.max(1)))
    }

    /// Twice the negative log likelihood of a view's edges and of its other residuals, up to constants.
    #[inline]
    fn view_cost(&self, rows: &[ResidualRow]) -> (f64, f64) {
        // One logarithm for a view.
        let (mut tails, mut edges, mut others) = (student_t().no_cost(), 0.0, 0.0);
        for row in rows {
            let squared = row.residual * row.residual;
            if !row.group.is_edge() {
                let heavy = self.heavy_tails && row.group.has_heavy_tails();
                others += if heavy { student_t().cost_of_one(squared) } else { squared };
            } else if self.heavy_tails {
                tails.add(squared);
            } else {
                edges += squared;
            }
        }
        (edges + tails.total(), others)
    }

    fn weights(&self) -> Weights {
        self.noise.weights(self.measurements.views.len())
    }

    #[inline]
    fn row_weight(&self, row: &ResidualRow, weights: &Weights) -> f64 {
        let heavy = self.heavy_tails && row.group.has_heavy_tails();
        weights.of(row.group) * if heavy { student_t().weight(row.residual * row.residual) } else { 1.0 }
    }

    /// Derivative of a weighted residual by the residual, relative to its weight: below one where the tails are heavy.
    pub(crate) fn relative_slope(&self, group: NoiseGroup, residual: f64) -> f64 {
        let heavy = self.heavy_tails && group.has_heavy_tails();
        if heavy { student_t().relative_slope(residual * residual) } else { 1.0 }
    }

    /// Squared norm of each view's whitened residuals, as if there were four of them in each.
    pub(crate) fn view_costs(&self, body: &impl BodyModel) -> Vec<f64> {
        self.of_views(body, |rows| usual_cost(rows.iter().map(|row| row.residual * row.residual).sum(), rows.len()))
    }

    /// The squares of each view's whitened residuals at a body.
    pub(crate) fn squares_of_views(&self, body: &impl BodyModel) -> Vec<Vec<f64>> {
        self.of_views(body, |rows| rows.iter().map(|row| row.residual * row.residual).collect())
    }

    /// Something of each view's whitened residuals.
    fn of_views<T>(&self, body: &impl BodyModel, of_view: impl Fn(&[ResidualRow]) -> T) -> Vec<T> {
        let mut rows = Vec::with_capacity(16);
        (0..self.measurements.views.len())
            .map(|view| {
                view_rows(self.measurements, view, body, self.noise, self.smooth, &mut rows);
                of_view(&rows)
            })
            .collect()
    }

    /// Every residual with the index of its view and its weight; views are taken as independent.
    pub(crate) fn each_row(&self, body: &impl BodyModel, mut take: impl FnMut(usize, &ResidualRow, f64)) {
        let mut rows = Vec::with_capacity(16);
        for view in 0..self.measurements.views.len() {
            view_rows(self.measurements, view, body, self.noise, self.smooth, &mut rows);
            let (_, view_weight) = self.view_loss(&rows, &Weights::INDEPENDENT);
            for row in &rows {
                take(view, row, view_weight * self.row_weight(row, &Weights::INDEPENDENT));
            }
        }
    }

    /// Every residual of the cues with the index of its view and its weight; views are taken as independent.
    pub(crate) fn each_cue_row(&self, body: &impl BodyModel, mut take: impl FnMut(usize, &ResidualRow, f64)) {
        self.each_cue(body, |cue, rows, _, weight| rows.iter().for_each(|row| take(cue.view, row, weight)));
    }

    /// Logarithm of the evidence for the noise levels at a fit (Laplace's approximation), up to what does not depend on
    /// them; `None` when the normal equations are singular.
    pub(crate) fn evidence(&self, body: &impl BodyModel, equations: &NormalEquations) -> Option<f64> {
        let covariance = invert_spd(&equations.hessian())?;
        let weights = self.weights();
        let mut rows = Vec::with_capacity(16);
        let mut normalizer = 0.0;
        for view in 0..self.measurements.views.len() {
            view_rows(self.measurements, view, body, self.noise, self.smooth, &mut rows);
            let (_, view_weight) = self.view_loss(&rows, &weights);
            for row in rows.iter().filter(|row| row.counts) {
                let weight = view_weight * weights.of(row.group);
                normalizer += weight * self.noise.of(row.group).ln();
            }
        }
        self.each_cue(body, |_, rows, _, _| {
            normalizer += rows.iter().map(|row| weights.of(row.group) * self.noise.of(row.group).ln()).sum::<f64>();
        });
        Some(0.5 * (covariance.determinant().ln() - equations.cost) - normalizer)
    }

    /// Residual statistics for the noise levels; nothing when the normal equations are singular.
    pub(crate) fn statistics(
        &self,
        body: &impl BodyModel,
        equations: &NormalEquations,
        correlated_views: bool,
    ) -> NoiseStatistics {
        let mut statistics = NoiseStatistics::default();
        let Some(covariance) = invert_spd(&equations.hessian()) else { return statistics };
        let weights = self.weights();
        // Of edges, of ellipses, of cues.
        let mut neighbors = [(0.0, 0.0, 0); CORRELATIONS];
        let mut determined = 0.0;
        let views = self.measurements.views.len();
        let (mut rows, mut before) = (Vec::with_capacity(16), Vec::<ResidualRow>::with_capacity(16));
        for view in 0..views {
            std::mem::swap(&mut rows, &mut before);
            view_rows(self.measurements, view, body, self.noise, self.smooth, &mut rows);
            let (_, view_weight) = self.view_loss(&rows, &weights);
            for row in rows.iter().filter(|row| row.counts) {
                let gradient = nalgebra::SVector::<f64, PARAMETERS>::from(row.row);
                let weight = view_weight * self.row_weight(row, &Weights::INDEPENDENT);
                let shared = weights.of(row.group);
                let leverage = weight * shared * gradient.dot(&(covariance * gradient));
                determined += leverage;
                // The scale of Student's t distribution by maximum likelihood: weighted squares over the number.
                statistics.add(row.group, row.residual, weight, view_weight - leverage);
            }
            if correlated_views && rows.len() == before.len() {
                for (a, b) in before.iter().zip(&rows) {
                    let (products, squares, pairs) = &mut neighbors[a.group.correlated_with()];
                    // Edges that do not count are zero; wild ones would drown the others.
                    if a.counts && b.counts && a.residual.abs().max(b.residual.abs()) < MAX_CORRELATION_RESIDUAL {
                        *products += a.residual * b.residual;
                        *squares += 0.5 * (a.residual * a.residual + b.residual * b.residual);
                        *pairs += 1;
                    }
                }
            }
        }
        // Of a depth and of a 3D box before.
        let mut cues_before: [Vec<ResidualRow>; 2] = Default::default();
        self.each_cue(body, |_, rows, _, loss_weight| {
            let before = &mut cues_before[usize::from(rows.len() > 1)];
            for row in rows {
                let gradient = nalgebra::SVector::<f64, PARAMETERS>::from(row.row);
                let leverage = loss_weight * weights.of(row.group) * gradient.dot(&(covariance * gradient));
                determined += leverage;
                statistics.add(row.group, row.residual, loss_weight, 1.0 - leverage);
            }
            if correlated_views {
                let (products, squares, pairs) = &mut neighbors[CORRELATIONS - 1];
                let alike = before.iter().zip(rows).filter(|(a, b)| a.group == b.group);
                for (a, b) in alike.filter(|(a, b)| a.residual.abs().max(b.residual.abs()) < MAX_CORRELATION_RESIDUAL) {
                    *products += a.residual * b.residual;
                    *squares += 0.5 * (a.residual * a.residual + b.residual * b.residual);
                    *pairs += 1;
                }
            }
            before.clear();
            before.extend_from_slice(rows);
        });
        for (k, (products, squares, pairs)) in neighbors.into_iter().enumerate() {
            if squares > 0.0 {
                statistics.add_neighbors(k, products / squares, pairs);
            }
        }
        statistics.add_object(determined, PARAMETERS, views);
        statistics
    }

    /// How far the measurements are from a fitted body, in standard deviations of the noise; `None` when the normal
    /// equations are singular. Rejected views do not count. In many views wild residuals
    /// count in the deviations as in the fit, little: one wrong edge is no contradiction. In few nothing tells which.
    pub(crate) fn goodness_of_fit(&self, body: &impl BodyModel, equations: &NormalEquations) -> Option<GoodnessOfFit> {
        let covariance = invert_spd(&equations.hessian())?;
        let weights = self.weights();
        let mut rows = Vec::with_capacity(16);
        let (mut squares, mut relative, mut dof) = (0.0, 0.0, 0.0);
        let few = self.measurements.views.len() < MIN_VIEWS;
        for (view, measured) in self.measurements.views.iter().enumerate() {
            view_rows(self.measurements, view, body, self.noise, self.smooth, &mut rows);
            let cost: f64 = rows.iter().map(|row| row.residual * row.residual).sum();
            if self.squared_scale(rows.len()).is_some_and(|limit| cost > limit) {
                continue;
            }
            let (_, view_weight) = self.view_loss(&rows, &weights);
            for row in rows.iter().filter(|row| row.counts) {
                let gradient = nalgebra::SVector::<f64, PARAMETERS>::from(row.row);
                let weight = view_weight * self.row_weight(row, &Weights::INDEPENDENT);
                let leverage = weight * weights.of(row.group) * gradient.dot(&(covariance * gradient));
                let size_factor = if row.group.is_edge() { self.noise.size_factor(measured.half_size) } else { 1.0 };
                squares += if few { 1.0 } else { weight } * row.residual * row.residual;
                relative += (row.residual * self.noise.of(row.group) * size_factor).powi(2);
                dof += view_weight - leverage;
            }
        }
        (dof > 0.0).then(|| GoodnessOfFit {
            normalized_residual: (squares / dof).sqrt(),
            relative_residual: (relative / dof).sqrt(),
            dof,
        })
    }

    /// The part of the cost that is that of the priors.
    pub(crate) fn cost_of_priors(&self, body: &impl BodyModel) -> f64 {
        let mut equations = NormalEquations::zero();
        self.add_priors(body, &mut equations);
        equations.cost
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
            for (axis, named) in self.prior.named_axes(body).into_iter().enumerate() {
                let (mean, weight) = log_size[named];
                let row: Row = gradients[axis].map(|x| x * weight);
                equations.add_quadratic(weight * (semi_axes[axis].ln() - mean), &row);
            }
        }
        if let Some(learned_size) = &self.prior.learned_size {
            learned_size.add_to(body, equations);
        }
        if let Some(site) = &self.prior.size_site {
            site.add_to(body, equations);
        }
        if let Some((plane, weight)) = &self.ground {
            // Of the lowest point.
            let (height, row) = body.distance_to_plane(&plane.n, plane.d);
            equations.add_quadratic(weight * height, &row.map(|x| x * weight));
        }
    }
}
