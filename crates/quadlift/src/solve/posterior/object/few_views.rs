//! A false box among three or four views: too few for hypotheses and a redescending loss (see [`super::outliers`]), but
//! the other views are consistent, and no other subset is (docs/method.md, section 8.2).

use crate::tuning::CLEAR;
use std::sync::Arc;

use super::agreement::{Reference, agrees, is_inconsistent};
use super::fit::Fit;
use super::objective::{MIN_VIEWS, OUTLIER_SCALE};
use super::problem::ObjectProblem;
use crate::scene::ObjectViews;
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;

/// Minimum number of views for the rejection of one.
const MIN_TO_LEAVE_OUT: usize = 3;

impl Fit {
    /// If this fit to three or four views contradicts them: the fit without one of them, if the others are consistent
    /// and no other subset is. Two views agree by chance more often than three do; the choice must therefore be clear.
    pub(crate) fn reject_one_of_few_views(
        &self,
        noise: &NoiseLevels,
        reference: Reference,
        context: &PosteriorContext,
    ) -> Option<Self> {
        let all = &self.problem.views;
        let count = all.views.len();
        if !(MIN_TO_LEAVE_OUT..MIN_VIEWS).contains(&count) || !self.contradicts(noise, reference) {
            return None;
        }
        let level = noise.scaled(reference.factor());
        let mut best: Option<(f64, Self)> = None;
        let mut second = f64::INFINITY;
        for left_out in 0..count {
            let mut views = ObjectViews { views: Vec::with_capacity(count - 1), ..*all };
            views.views.extend(all.views.iter().enumerate().filter(|(k, _)| *k != left_out).map(|(_, view)| *view));
            let fitted = ObjectProblem::new(views, self.problem.kind, context)
                .and_then(|object| Self::first(self.as_upright(object, context), &level, context));
            let Ok(fit) = fitted else { continue };
            let fit = Self { ground: None, ..fit.refined(&level, true) };
            let Some(goodness_of_fit) = fit.goodness_of_fit(&level) else { continue };
            let squares = goodness_of_fit.normalized_residual.powi(2) * goodness_of_fit.dof;
            match &best {
                Some((least, _)) if squares >= *least => second = second.min(squares),
                _ => {
                    if let Some((least, _)) = best.replace((squares, fit)) {
                        second = second.min(least);
                    }
                }
            }
        }
        let (squares, fit) = best?;
        if fit.goodness_of_fit(&level).is_none_or(|goodness_of_fit| !agrees(&goodness_of_fit))
            || second - squares < 2.0 * CLEAR
        {
            return None;
        }
        // All views again, in the frame of those that agree: the loss keeps the other one out.
        let problem = ObjectProblem::in_frame(all.clone(), fit.problem.measurements.frame, self.problem.kind, context);
        let problem = Arc::new(self.as_upright(problem, context));
        let all_views = Self { problem, outlier_scale: Some(OUTLIER_SCALE), ground: None, ..fit };
        Some(all_views.refined(&level, false))
    }

    /// Other views of the object, standing where this fit has it that it stands.
    pub(crate) fn as_upright(&self, problem: ObjectProblem, context: &PosteriorContext) -> ObjectProblem {
        match &context.up {
            Some(up) if self.is_upright() => problem.standing(up),
            _ => problem,
        }
    }

    /// Whether the measurements contradict the body.
    pub(crate) fn contradicts(&self, noise: &NoiseLevels, reference: Reference) -> bool {
        self.goodness_of_fit(noise).is_some_and(|goodness_of_fit| is_inconsistent(&reference.against(goodness_of_fit)))
    }
}
