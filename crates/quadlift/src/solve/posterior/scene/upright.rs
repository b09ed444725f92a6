//! Which objects stand upright, with some axis along `up`, and which have arbitrary orientation (docs/method.md,
//! section 10).
//!
//! Most objects stand or lie on a level surface, so one of their three axes is vertical; it is unknown which one.
//! Others lean, and with a wrong `up` all do. Each object is fitted both ways under the noise levels of the scene, and
//! the evidences of the two fits are compared (Laplace's approximation): a prior that says much gains little where the
//! measurements leave the rotation open anyway. The share of the objects that stand is estimated from all of them, so
//! that a scene in which none does is not harmed.

use crate::tuning::UPRIGHT_SHARE;
use std::sync::Arc;

use nalgebra::Vector3;

use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::geometry::linalg::cholesky;
use crate::optimize::minimize::minimize;
use crate::optimize::normal_equations::{NormalEquations, PARAMETERS};
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::object::covariance::log_determinant_of;
use crate::solve::posterior::object::first_fit::TURNED_STARTS;
use crate::solve::posterior::object::fit::Fit;
use crate::solve::posterior::object::model::Model;
use crate::solve::posterior::object::prior::TILT_SD;
use crate::solve::posterior::object::problem::{FROM_START, ObjectProblem};
use crate::solve::posterior::object::starts::set_upright;

/// Rounds in which the share of the objects that stand and the odds of each are adjusted to each other.
const SHARE_ROUNDS: usize = 100;

/// With fewer views the direction about the vertical has several minima: an upright fit is sought from all starts.
const FEW_VIEWS: usize = 8;

/// Objects that lie anyhow, added to those of the scene: where the odds say nothing, nothing is set upright.
const ADDED: f64 = 2.0;

/// How often an object of a scene stands, from the logarithms of the odds of each under equal shares: by expectation and
/// maximization from one half. `UPRIGHT_SHARE` without objects.
pub(crate) fn share_of_upright(log_odds: &[f64]) -> f64 {
    if log_odds.is_empty() {
        return UPRIGHT_SHARE.get();
    }
    let mut share = 0.5;
    for _ in 0..SHARE_ROUNDS {
        let sum: f64 = log_odds.iter().map(|odds| 1.0 / (1.0 + (-odds - logit(share)).exp())).sum();
        share = sum / (log_odds.len() as f64 + ADDED);
    }
    share
}

/// Whether an object stands, by the logarithm of its odds under equal shares and the share of those that do.
pub(crate) fn stands(log_odds: f64, share: f64) -> bool {
    log_odds + logit(share) > 0.0
}

fn logit(share: f64) -> f64 {
    (share / (1.0 - share)).ln()
}

/// Whether an earlier fit had it that this body stands (`up` is in its frame): an axis of it is vertical, as it is by chance for few.
pub(crate) fn was_upright(body: &impl BodyModel, up: &Vector3<f64>) -> bool {
    body.axes().tr_mul(up).amax() > (2.0 * TILT_SD).cos()
}

impl Fit {
    /// The fit of the same object standing, and the logarithm of its odds against this one under equal shares; `None`
    /// where nothing is asked: it stands already, `up` is not known, or a prior on the size of its category has taken the
    /// place of the shape prior, without which the odds mean nothing (cars in two and three views of KITTI: O3D .60 and .68
    /// instead of .67 and .80).
    pub(crate) fn standing(&self, noise: &NoiseLevels, context: &PosteriorContext) -> Option<(Self, f64)> {
        let asked = context.options.upright && !self.is_upright() && self.problem.prior.log_size.is_none();
        let up = context.up.filter(|_| asked)?;
        let problem = Arc::new(self.problem.standing(&up));
        let near = self.put_upright(&problem, noise);
        let few = problem.views.views.len() < FEW_VIEWS;
        let again = || {
            let fit = Self::first(ObjectProblem::clone(&problem), noise, context).ok()?;
            Some(Self { problem: problem.clone(), ground: self.ground, ..fit }.refined(noise, false))
        };
        let again = if few || self.outlier_scale.is_some() || near.is_none() { again() } else { None };
        let (standing, fit) = [near, again]
            .into_iter()
            .flatten()
            .filter_map(|fit| Some((fit.trustful(noise)?, fit)))
            .min_by(|a, b| a.0.cost.total_cmp(&b.0.cost))?;
        let lying = self.refined(noise, false).trustful(noise)?;
        let (a, b) = (log_determinant(&self.body, &standing)?, log_determinant(&self.body, &lying)?);
        let log_odds = -0.5 * (standing.cost + a - lying.cost - b)
            + self.body.log_upright_density(TILT_SD, context.options.shape_sd);
        log_odds.is_finite().then_some((fit, log_odds))
    }

    /// The body of this fit set upright, and fitted from there; `None` for a body with several starts, which is looked for from
    /// all of them.
    fn put_upright(&self, problem: &Arc<ObjectProblem>, noise: &NoiseLevels) -> Option<Self> {
        if self.problem.has_several_starts() {
            return None;
        }
        let body = EllipsoidModel::from_axes(*self.body.center(), *self.body.axes(), self.body.semi_axes());
        let (axes, semi_axes) = set_upright(&body, &problem.prior.up?)?;
        let start = EllipsoidModel::from_axes(*body.center(), axes, semi_axes);
        let objective = problem.objective(noise, self.outlier_scale);
        let (ellipsoid, _) = minimize(start, FROM_START, |body| objective.linearize(body), BodyModel::retract)?;
        let (body, equations) = problem.started_at(&ellipsoid, noise, self.outlier_scale, 0, TURNED_STARTS)?;
        let fit = Self { problem: problem.clone(), ellipsoid, body, equations, ..self.clone() };
        Some(fit.refined(noise, false))
    }

    /// The objective at the body of this fit where no view is an outlier: one that rejects many would seem to agree.
    fn trustful(&self, noise: &NoiseLevels) -> Option<NormalEquations> {
        self.objective(noise, None).linearize(&self.body)
    }
}

/// `ln det H`, with the precision that a body has whose rotation is open.
fn log_determinant(body: &Model, equations: &NormalEquations) -> Option<f64> {
    if matches!(body, Model::Oriented(_)) {
        return log_determinant_of(equations);
    }
    cholesky(&equations.hessian()).map(|l| (0..PARAMETERS).map(|k| 2.0 * l[(k, k)].ln()).sum())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_in_which_most_objects_stand_carries_those_that_tell_little() {
        let share = share_of_upright(&[4.9, 4.5, 4.9, 0.4, 4.8, -0.2, 4.9, 4.7]);
        assert!((0.6..0.8).contains(&share), "{share}");
        assert!(stands(0.4, share) && stands(-0.2, share) && !stands(-2.0, share));
    }

    #[test]
    fn nothing_stands_where_the_odds_say_nothing_or_no() {
        for odds in [vec![0.0; 20], vec![-5.0, -80.0, 0.5, -3.0], vec![0.3; 2], vec![f64::NEG_INFINITY; 3]] {
            let share = share_of_upright(&odds);
            assert!(odds.iter().all(|odds| !stands(*odds, share)), "{odds:?} {share}");
        }
        assert_eq!(share_of_upright(&[]), UPRIGHT_SHARE.get());
        let one = share_of_upright(&[4.9]);
        assert!(stands(4.9, one), "one object, of which it is clear: {one}");
    }
}
