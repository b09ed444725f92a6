//! The first fit of a body of each kind, from an ellipsoid.

use super::super::options::BodyKind;
use super::body_model::{BodyModel, EllipsoidModel, Form};
use super::levenberg_marquardt::{Stop, minimise};
use super::model::Model;
use super::noise::NoiseLevels;
use super::normal_equations::NormalEquations;
use super::object::{FROM_START, Prepared};
use super::starts::{centers_from_size, oriented_starts};

/// To decide between many starts: few steps.
const SCREENING: Stop = Stop { evaluations: 15, promised_decrease: 1e-1 };

/// Oriented starts that are followed to the end.
const FOLLOWED_STARTS: usize = 3;

impl Prepared {
    /// Whether the first fit chooses between several starts, which is worth repeating under other noise levels.
    pub(super) fn has_several_starts(&self) -> bool {
        self.kind != BodyKind::Ellipsoid
    }

    /// The body that a fitted ellipsoid leads to, and the objective there; `None` when no start can be evaluated.
    pub(super) fn from_ellipsoid(
        &self,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        seed: u64,
    ) -> Option<(Model, NormalEquations)> {
        let objective = self.objective(noise, outlier_scale);
        if !self.has_several_starts() {
            let body = Model::Ellipsoid(ellipsoid.clone());
            return objective.linearise(&body).map(|equations| (body, equations));
        }
        self.screened(ellipsoid, noise, outlier_scale, seed)
            .into_iter()
            .take(FOLLOWED_STARTS)
            .filter_map(|(start, _)| minimise(start, FROM_START, |body| objective.linearise(body), BodyModel::retract))
            .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
    }

    /// The starts of the first fit after a few steps, with the objective there, the best first; none where a body has only
    /// one start.
    pub(super) fn screened(
        &self,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        seed: u64,
    ) -> Vec<(Model, NormalEquations)> {
        let objective = self.objective(noise, outlier_scale);
        let form = match self.kind {
            BodyKind::Ellipsoid => return Vec::new(),
            BodyKind::Superellipsoid(exponent) => Form::Exponent(exponent),
            BodyKind::Cylinder => Form::Cylinder,
            BodyKind::Cuboid => Form::Cuboid,
        };
        let centers = centers_from_size(self);
        let starts = oriented_starts(ellipsoid, form, &self.prior, &centers, seed);
        let descend = |start| minimise(start, SCREENING, |body| objective.linearise(body), BodyModel::retract);
        let mut screened: Vec<_> = starts.into_iter().map(Model::Oriented).filter_map(descend).collect();
        screened.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        screened
    }
}
