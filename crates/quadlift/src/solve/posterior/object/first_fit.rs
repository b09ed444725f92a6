//! The first fit of each kind of body, from a fitted ellipsoid.

use super::cue_starts::oriented_from_cues;
use super::model::Model;
use super::objective::Objective;
use super::problem::{FROM_START, ObjectProblem};
use super::starts::{centers_from_size, oriented_starts};
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::body_model::oriented::OrientedModel;
use crate::geometry::BodyKind;
use crate::optimize::minimize::{Stop, minimize};
use crate::optimize::normal_equations::NormalEquations;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::sorting::StableSort;

/// Position and size for a start with a given rotation.
const IN_PLACE: Stop = Stop { evaluations: 4, min_predicted_decrease: 1.0 };

/// Number of placed starts that are also optimized in rotation. With all 17 of a cuboid a first fit takes a third
/// longer and finds no better minima (300 synthetic cuboids, exact and with 2 % noise).
pub(crate) const TURNED_STARTS: usize = 6;

/// The same under the noise levels that the first fits led to: with 4 of them 2 of 300 exact cuboids end in a wrong minimum,
/// with all none.
pub(crate) const ALL: usize = usize::MAX;

/// To decide between many starts: few steps.
const SCREENING: Stop = Stop { evaluations: 15, min_predicted_decrease: 1e-1 };

/// Oriented starts that are refined to the end. With 10 of them the results of the same 300 change by at most 0.001,
/// and it is slower.
const FOLLOWED_STARTS: usize = 3;

impl ObjectProblem {
    /// Whether the first fit selects among several starts, so that it should be repeated under other noise levels.
    pub(crate) fn has_several_starts(&self) -> bool {
        self.kind != BodyKind::Ellipsoid
    }

    /// The body that a fitted ellipsoid leads to, and the objective there; `None` if no start can be evaluated.
    pub(crate) fn started_at(
        &self,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        round: usize,
        turned: usize,
    ) -> Option<(Model, NormalEquations)> {
        let objective = self.objective(noise, outlier_scale);
        if !self.has_several_starts() {
            let body = Model::Ellipsoid(ellipsoid.clone());
            return objective.linearize(&body).map(|equations| (body, equations));
        }
        best_of(&objective, self.screened(ellipsoid, noise, outlier_scale, round, turned))
    }

    /// The starts of the first fit after a few steps, with the objective there, the best first; none where a body has only
    /// one start.
    pub(crate) fn screened(
        &self,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        round: usize,
        turned: usize,
    ) -> Vec<(Model, NormalEquations)> {
        let objective = self.objective(noise, outlier_scale);
        if !self.has_several_starts() {
            return Vec::new();
        }
        let centers = centers_from_size(&self.views, &self.measurements.frame, &self.prior);
        let mut starts = oriented_from_cues(&self.views.views, &self.measurements.frame, ellipsoid, self.kind);
        starts.extend(oriented_starts(ellipsoid, self.kind, &self.prior, &centers, round));
        // Where the size of the category is known few starts differ in more than their place.
        let turned = if self.prior.log_size.is_some() { ALL } else { turned };
        descended(&objective, starts, turned)
    }
}

/// Where oriented bodies end after a few steps from these starts, with the objective there, the best first. Place and size
/// of each start are found first, where it is; only so many of them are turned as well.
pub(crate) fn descended(
    objective: &Objective,
    starts: Vec<OrientedModel>,
    turned: usize,
) -> Vec<(Model, NormalEquations)> {
    if turned >= starts.len() {
        return turned_too(objective, starts.into_iter().map(Model::Oriented));
    }
    let held = |body: &Model| objective.linearize(body).map(NormalEquations::with_held_rotation);
    let in_place = |start| minimize(start, IN_PLACE, held, BodyModel::retract);
    let mut placed: Vec<_> = starts.into_iter().map(Model::Oriented).filter_map(in_place).collect();
    placed.stable_sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    placed.truncate(turned);
    turned_too(objective, placed.into_iter().map(|(start, _)| start))
}

fn turned_too(objective: &Objective, starts: impl Iterator<Item = Model>) -> Vec<(Model, NormalEquations)> {
    let descend = |start| minimize(start, SCREENING, |body| objective.linearize(body), BodyModel::retract);
    let mut descended: Vec<_> = starts.filter_map(descend).collect();
    descended.stable_sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
    descended
}

/// The best one of these after more steps.
pub(crate) fn best_of(
    objective: &Objective,
    descended: Vec<(Model, NormalEquations)>,
) -> Option<(Model, NormalEquations)> {
    let follow = |(start, _)| minimize(start, FROM_START, |body| objective.linearize(body), BodyModel::retract);
    let followed = descended.into_iter().take(FOLLOWED_STARTS).filter_map(follow);
    followed.min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
}
