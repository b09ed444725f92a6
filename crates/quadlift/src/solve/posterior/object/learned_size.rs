//! The size of an object and its category: what the object itself tells, and its fit with the prior learned from the others
//! (docs/method.md, section 21).

use std::sync::Arc;

use nalgebra::{Matrix3, SMatrix, SVector, Unit, Vector3};

use super::fit::Fit;
use super::model::Model;
use super::prior::{LearnedSize, ObjectPrior};
use super::problem::{FROM_START, ObjectProblem};
use super::size_site::{ShapeInformation, SizeSite, Vector6, shape_precision};
use crate::body_model::BodyModel;
use crate::geometry::linalg::invert_spd;
use crate::optimize::minimize::minimize;
use crate::solve::estimate::Matrix9;
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::shared::SharedErrors;
use crate::solve::posterior::shared::size_model::{SizeDistribution, SizeInformation, across, first_order, orders};

/// Added to the covariance of what an object tells, relative to it, so that it has an inverse.
const REGULAR: f64 = 1e-9;

impl Fit {
    /// What the measurements tell about the size, in the order of the body's own axes; `None` where the normal equations are
    /// singular. `covariance` is that of the parameters of the fit, which may be larger than the inverse of the normal equations.
    pub(crate) fn size_information(&self, covariance: &Matrix9, context: &PosteriorContext) -> Option<SizeInformation> {
        let (information, vector) = match self.shape_information(covariance) {
            // Where it is open which way the axes point, as the shape prior has it.
            Some(told) => {
                let beside = invert_spd(&(told.information.fixed_view::<3, 3>(3, 3) + any_shape(context)))?;
                let coupling = told.information.fixed_view::<3, 3>(0, 3) * beside;
                (
                    told.information.fixed_view::<3, 3>(0, 0) - coupling * told.information.fixed_view::<3, 3>(3, 0),
                    told.vector.fixed_rows::<3>(0) - coupling * told.vector.fixed_rows::<3>(3),
                )
            }
            None => {
                let prior = &self.problem.prior;
                let prior = match &prior.learned_size {
                    Some(learned) => learned.precision(&self.body),
                    None => (across() * (prior.shape_weight * prior.shape_weight), Vector3::zeros()),
                };
                let gradients = SMatrix::<f64, 3, 9>::from_rows(&self.body.log_axes_gradient().map(|row| row.into()));
                self.told(covariance, &gradients, &self.body.semi_axes().map(f64::ln), &prior)?
            }
        };
        let unit = self.problem.measurements.frame.unit.ln();
        let information = (information + information.transpose()) * 0.5;
        Some(SizeInformation { information, vector: vector + information * Vector3::repeat(unit) })
    }

    /// What the measurements of an ellipsoid tell about `W = 1/2 log A`; `None` for other bodies.
    fn shape_information(&self, covariance: &Matrix9) -> Option<ShapeInformation> {
        let axes = *self.body.axes();
        let entries = self.body.log_shape_along(&axes)?;
        let gradients = SMatrix::<f64, 6, 9>::from_rows(&entries.map(|(_, row)| row.into()));
        let prior = &self.problem.prior;
        let prior = match &prior.size_site {
            Some(site) => site.along(&axes),
            None => (shape_precision(prior.shape_weight), Vector6::zeros()),
        };
        let at = Vector6::from(entries.map(|(value, _)| value));
        let (information, vector) = self.told(covariance, &gradients, &at, &prior)?;
        Some(ShapeInformation { axes, information, vector })
    }

    /// Information about quantities with these values and gradients, and that times the estimate, without a prior on them (its
    /// precision, and that times its mean).
    fn told<const N: usize>(
        &self,
        covariance: &Matrix9,
        gradients: &SMatrix<f64, N, 9>,
        at: &SVector<f64, N>,
        (precision, told): &(SMatrix<f64, N, N>, SVector<f64, N>),
    ) -> Option<(SMatrix<f64, N, N>, SVector<f64, N>)> {
        let inverse = invert_spd(&self.equations.hessian())?;
        let seen = |covariance: &Matrix9| gradients * covariance * gradients.transpose();
        let of_fit = seen(&inverse);
        let posterior = invert_spd(&of_fit)?;
        let minimum = at - gradients * inverse * self.equations.gradient();
        // The prior is a factor of the posterior: what is left without it.
        let information = posterior - precision;
        let vector = posterior * minimum - told;
        // The variance of the vector: of noise, and of errors that the normal equations do not know.
        let added = posterior * (seen(covariance) - of_fit) * posterior;
        let least = posterior.trace() * REGULAR;
        let variance = information + added + SMatrix::<f64, N, N>::identity() * (2.0 * least);
        let weight = information * invert_spd(&variance)?;
        let (information, vector) = (weight * information, weight * vector);
        let finite = information.iter().chain(vector.iter()).all(|x| x.is_finite());
        finite.then_some(((information + information.transpose()) * 0.5, vector))
    }

    /// The order of this body's axes by which objects of a category are compared.
    pub(crate) fn order_of_axes(&self, up: Option<&Unit<Vector3<f64>>>) -> [usize; 3] {
        let up = up.map(|up| self.problem.measurements.frame.direction_from_world(up));
        first_order(&self.body.semi_axes().map(f64::ln), self.body.axes(), up.as_ref())
    }

    /// The fit with the shape prior in the place of a size that was learned before, if there was one.
    pub(crate) fn without_learned_size(&self, context: &PosteriorContext) -> Self {
        let ObjectPrior { learned_size, size_site, .. } = &self.problem.prior;
        if learned_size.is_none() && size_site.is_none() {
            return self.clone();
        }
        let mut problem = ObjectProblem::clone(&self.problem);
        problem.prior.shape_weight = 1.0 / context.options.shape_sd;
        (problem.prior.learned_size, problem.prior.size_site) = (None, None);
        Self { problem: Arc::new(problem), ..self.clone() }
    }

    /// The fit with a learned size in the place of the shape prior; as it was where the size says nothing that can be used.
    pub(crate) fn with_learned_size(
        &self,
        size: &SizeDistribution,
        level: f64,
        noise: &NoiseLevels,
        shared: SharedErrors,
        context: &PosteriorContext,
    ) -> Self {
        let unit = self.problem.measurements.frame.unit;
        let size = SizeDistribution { mean: size.mean.map(|x| x - unit.ln()), ..*size };
        let up = self.problem.prior.up.filter(|_| size.named);
        let mut problem = ObjectProblem::clone(&self.problem);
        let mut starts = vec![self.body.clone()];
        if matches!(self.body, Model::Ellipsoid(_)) {
            let told = self.local_covariance(noise, shared, context).and_then(|c| self.shape_information(&c));
            let weight = 1.0 / context.options.shape_sd;
            problem.prior.size_site =
                told.and_then(|told| SizeSite::new(&told, &size, up.as_ref(), weight, level * level, context.seed));
            problem.prior.shape_weight =
                if problem.prior.size_site.is_some() { 0.0 } else { 1.0 / context.options.shape_sd };
        } else {
            // No category differs more than any objects do.
            let of_any = 0.5 * (across() * size.covariance).trace() / context.options.shape_sd.powi(2);
            let Some(learned) = LearnedSize::new(&size, up, (level * level).max(of_any)) else { return self.clone() };
            let first = first_order(&self.body.semi_axes().map(f64::ln), self.body.axes(), up.as_ref());
            starts.extend(orders(size.named).iter().map(|order| {
                let mut semi_axes = Vector3::zeros();
                (0..3).for_each(|k| semi_axes[first[order[k]]] = size.mean[k].exp());
                self.body.of_size(semi_axes)
            }));
            problem.prior.learned_size = Some(learned);
            problem.prior.shape_weight = 0.0;
        }
        let fit = Self { problem: Arc::new(problem), ..self.clone() };
        let objective = fit.objective(noise, self.outlier_scale);
        let descend = |start: Model| minimize(start, FROM_START, |body| objective.linearize(body), BodyModel::retract);
        let ends = starts.into_iter().filter_map(descend);
        let Some((body, equations)) = ends.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost)) else { return self.clone() };
        Self { body, equations, ..fit }
    }
}

/// The precision of the shape prior beside the diagonal.
fn any_shape(context: &PosteriorContext) -> Matrix3<f64> {
    Matrix3::from_diagonal_element(context.options.shape_sd.powi(-2))
}
