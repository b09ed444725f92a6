//! A fitted object: refits under new noise levels, outliers, covariance, estimate.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Unit, Vector3, Vector6};

use super::agreement::{Reference, is_inconsistent};
use super::covariance;
use super::first_fit::{ALL, TURNED_STARTS};
use super::model::Model;
use super::objective::{MIN_VIEWS, OUTLIER_SCALE, Objective, outlier_scale};
use super::outliers::fit_without_outliers;
use super::problem::{FROM_START, ObjectProblem};
use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::geometry::linalg::invert_spd;
use crate::optimize::levenberg_marquardt::{End, Minimum};
use crate::optimize::minimize::{BodyStep, Stop, minimize, minimum};
use crate::optimize::normal_equations::NormalEquations;
use crate::scene::View;
use crate::solve::estimate::{Covariance, Estimate, GoodnessOfFit, Matrix9, Status, Warning};
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::common_errors::{CommonRow, CommonStatistics, added_covariance};
use crate::solve::posterior::noise::levels::{CovarianceLevels, NoiseLevels};
use crate::solve::posterior::noise::object_spread::{ObjectAgreement, scaled_covariance};
use crate::solve::posterior::noise::statistics::NoiseStatistics;
use crate::solve::posterior::residuals::measurements::Plane;
use crate::solve::posterior::residuals::row::ResidualRow;
use crate::solve::posterior::residuals::view_rows::choose_harmonics;
use crate::solve::posterior::shared::SharedErrors;
use crate::solve::posterior::shared::ground::{GroundPlane, LowestPoint};
use crate::solve::posterior::shared::pose_terms::{FrameTerm, ObjectPoseTerms};
use crate::solve::report::{describe, is_a_body};

/// Between two estimates of the noise levels.
const INNER_TERMINATION: Stop = Stop { evaluations: 6, min_predicted_decrease: 0.1 };

/// The end.
pub(crate) const FINAL_TERMINATION: Stop = Stop { evaluations: 40, min_predicted_decrease: 1e-4 };

/// A fit whose cost could still decrease by more than this has not converged: the decrease is about the squared
/// distance to the minimum in standard deviations of the estimate, of which a tenth is negligible.
const MAX_REMAINING_DECREASE: f64 = 0.01;

/// Mean squared whitened residual of a view (four edges: 4 is what the noise gives) above which a plain fit is suspect.
const SUSPECT_COST: f64 = 12.0;

/// Norm of a view's whitened residuals with which it does not count as used though no outliers were looked for: five
/// standard deviations of each of four edges. Of
/// Student's t distribution, the likelihood of an edge, one edge in 280,000 reaches it by itself.
const FAR_BEYOND_NOISE: f64 = 10.0;

/// Rounds in which a body with several starts is fitted from other starts.
const MAX_RESTART_ROUNDS: usize = 4;

/// A fitted object.
#[derive(Clone)]
pub(crate) struct Fit {
    pub problem: Arc<ObjectProblem>,
    /// The ellipsoid from whose starts the body came.
    pub ellipsoid: EllipsoidModel,
    pub body: Model,
    pub equations: NormalEquations,
    /// Set if the views contain outliers.
    pub outlier_scale: Option<f64>,
    /// The ground on which the object stands, in the object frame, and 1/sd of the distance from it.
    pub ground: Option<(Plane, f64)>,
    /// Whether the last iteration ended at a minimum.
    pub converged: bool,
}

impl Fit {
    /// The first fit: from the starts, and again without outliers if its residuals show some.
    pub(crate) fn first(
        object: ObjectProblem,
        noise: &NoiseLevels,
        context: &PosteriorContext,
    ) -> Result<Self, Box<Estimate>> {
        let failed =
            Box::new(Estimate::failed(object.views.object_index, object.views.category_index, Status::Diverged));
        let ellipsoid = object.fit_ellipsoid(noise).ok_or_else(|| failed.clone())?;
        let (body, equations) = object.started_at(&ellipsoid, noise, None, 0, TURNED_STARTS).ok_or(failed)?;
        let fit = Self {
            problem: Arc::new(object),
            ellipsoid,
            body,
            equations,
            outlier_scale: None,
            ground: None,
            converged: false,
        };
        Ok(if context.options.robust { fit.without_outliers(noise, context).unwrap_or(fit) } else { fit })
    }

    pub(crate) fn objective<'a>(&'a self, noise: &'a NoiseLevels, outlier_scale: Option<f64>) -> Objective<'a> {
        Objective { ground: self.ground, ..self.problem.objective(noise, outlier_scale) }
    }

    /// The lowest point of the body along `up`, as the object's own measurements have it.
    pub(crate) fn lowest_point(&self, up: &Unit<Vector3<f64>>) -> Option<LowestPoint> {
        let ObjectProblem { views, measurements, .. } = &*self.problem;
        let frame = &measurements.frame;
        let level = Plane { n: frame.direction_from_world(up), d: 0.0 };
        let (reach, _) = self.body.support_gradient(&level.n);
        // The estimate without the plane: its row is removed from the inverse again (Sherman-Morrison).
        let covariance = invert_spd(&self.equations.hessian())?;
        let variance_along = |plane: &Plane| {
            let row = nalgebra::SVector::from(self.body.distance_to_plane(&plane.n, plane.d).1);
            (row.transpose() * covariance * row)[0]
        };
        let with = variance_along(&level);
        let told = self.ground.map_or(0.0, |(_, weight)| weight * weight * with);
        let free = (1.0 - told).max(0.05);
        let variance = with / free;
        // The point is also moved back to its position without the plane.
        let pulled = self.ground.map_or(0.0, |(plane, _)| self.body.distance_to_plane(&plane.n, plane.d).0);
        let lowest = self.body.center() - level.n * reach + level.n * (pulled * (1.0 / free - 1.0));
        let point = frame.point_in_world(&lowest);
        let nearest = views.views.iter().filter_map(|view| Some((view.projection.center_in_world()? - point).norm()));
        Some(LowestPoint {
            point,
            variance: variance * frame.unit * frame.unit,
            height: 2.0 * reach * frame.unit,
            distance: nearest.fold(f64::INFINITY, f64::min),
        })
    }

    /// Whether the object stands on the ground plane.
    pub(crate) fn is_on_ground(&self) -> bool {
        self.problem.prior.on_ground
    }

    /// Puts the body on the ground plane, if it stands there. `object` is its index, if the plane knows it.
    pub(crate) fn stand_on_ground(&mut self, object: Option<usize>, ground: &GroundPlane, up: &Unit<Vector3<f64>>) {
        let lowest = self.is_on_ground().then(|| self.lowest_point(up)).flatten();
        self.ground = lowest.and_then(|lowest| ground.below(object, &lowest)).map(|below| {
            let frame = &self.problem.measurements.frame;
            let height = below.normal.dot(&(frame.origin - below.through));
            let plane = Plane { n: frame.direction_from_world(&below.normal), d: height / frame.unit };
            (plane, frame.unit / below.sd)
        });
    }

    /// Distance of the center from the nearest camera, world units.
    pub(crate) fn distance(&self) -> Option<f64> {
        let ObjectProblem { views, measurements, .. } = &*self.problem;
        let center = measurements.frame.point_in_world(self.body.center());
        let of = |view: &View| Some((view.projection.center_in_world()? - center).norm());
        views.views.iter().filter_map(of).min_by(f64::total_cmp)
    }

    /// Whether the prior has it that the object stands.
    pub(crate) fn is_upright(&self) -> bool {
        self.problem.prior.upright_weight > 0.0
    }

    /// What the measurements tell about the cameras (rotation vector about its center, shift; world axes and units); `None` where the normal
    /// equations are singular. That the body is seen from another side when the camera turns is left out: it is small against where
    /// the body appears.
    pub(crate) fn pose_terms(&self, noise: &NoiseLevels) -> Option<ObjectPoseTerms> {
        let ObjectProblem { views, measurements, .. } = &*self.problem;
        let objective = self.objective(noise, self.outlier_scale);
        // Under these noise levels: what cameras and object share must be less than what each has.
        let equations = objective.linearize(&self.body)?;
        let covariance = invert_spd(&equations.hessian())?;
        let center = measurements.frame.point_in_world(self.body.center());
        let cameras: Vec<_> = views.views.iter().map(|view| view.projection.center_in_world()).collect();
        let weights = noise.weights(measurements.views.len());
        let mut frames: BTreeMap<usize, FrameTerm> = BTreeMap::new();
        let mut of_row = |view: usize, row: &ResidualRow, weight: f64| {
            let Some(camera) = cameras[view] else { return };
            // Moving the camera is moving the body the other way.
            let frame = &measurements.frame;
            let by_point = frame.axes * Vector3::new(row.row[0], row.row[1], row.row[2]) / frame.unit;
            let by_turn = -(center - camera).cross(&by_point);
            let by_motion = Vector6::new(by_turn.x, by_turn.y, by_turn.z, -by_point.x, -by_point.y, -by_point.z);
            let frame = views.views[view].frame_index;
            frames.entry(frame).or_insert_with(|| FrameTerm::new(frame)).add(
                row.residual,
                &by_motion,
                &row.row,
                weight * weights.of(row.group),
            );
        };
        objective.each_row(&self.body, &mut of_row);
        objective.each_cue_row(&self.body, of_row);
        let step = -(covariance * equations.gradient());
        Some(ObjectPoseTerms { frames: frames.into_values().collect(), cross: Vec::new(), covariance, step })
    }

    /// Residual statistics under the noise levels of the last fit.
    pub(crate) fn statistics(&self, noise: &NoiseLevels, context: &PosteriorContext) -> NoiseStatistics {
        let objective = self.objective(noise, self.outlier_scale);
        objective.statistics(&self.body, &self.equations, context.options.correlated_views)
    }

    /// Log evidence for the noise levels of the last fit, up to terms that do not depend on them; `None` if the normal
    /// equations are singular.
    pub(crate) fn evidence(&self, noise: &NoiseLevels) -> Option<f64> {
        self.objective(noise, self.outlier_scale).evidence(&self.body, &self.equations)
    }

    /// A fit without outliers, if this plain one shows some.
    pub(crate) fn without_outliers(&self, noise: &NoiseLevels, context: &PosteriorContext) -> Option<Self> {
        let problem = &self.problem;
        let objective = Objective { smooth: true, ..problem.objective(noise, None) };
        let ellipsoid = fit_without_outliers(&objective, &self.body, &problem.views.views, context.seed)?;
        let (body, equations) = problem.started_at(&ellipsoid, noise, Some(OUTLIER_SCALE), 0, TURNED_STARTS)?;
        Some(Self {
            problem: problem.clone(),
            ellipsoid,
            body,
            equations,
            outlier_scale: Some(OUTLIER_SCALE),
            ground: self.ground,
            converged: false,
        })
    }

    /// The better one of the fit and another from the first starts, for noise levels that are far from those of the
    /// first fit: where the measurements determine little, its valley need not be the right one.
    pub(crate) fn restarted(self, noise: &NoiseLevels) -> Self {
        if self.outlier_scale.is_some() {
            return self;
        }
        let again = || {
            let ellipsoid = self.problem.fit_ellipsoid(noise)?;
            let (body, _) = self.problem.started_at(&ellipsoid, noise, None, 0, TURNED_STARTS)?;
            let objective = self.objective(noise, None);
            let (body, equations) = minimize(body, FROM_START, |body| objective.linearize(body), BodyModel::retract)?;
            (equations.cost < self.equations.cost).then(|| Self { ellipsoid, body, equations, ..self.clone() })
        };
        again().unwrap_or(self)
    }

    /// The fit repeated with the noise of the scene: from all starts if a body has several, and with a search for
    /// outliers if the residuals are much larger than the noise.
    pub(crate) fn retry_starts_and_outliers(
        &self,
        noise: &NoiseLevels,
        round: usize,
        context: &PosteriorContext,
    ) -> Self {
        let mut fit = self.refined(noise, false);
        if self.problem.has_several_starts() {
            let before = fit.clone();
            let again = |scale| {
                let (body, _) = before.problem.started_at(&self.ellipsoid, noise, scale, 1 + round, ALL)?;
                let objective = before.objective(noise, scale);
                minimize(body, INNER_TERMINATION, |body| objective.linearize(body), BodyModel::retract)
            };
            let restart = round < MAX_RESTART_ROUNDS || self.problem.prior.log_size.is_some();
            if restart
                && let Some((body, equations)) = again(fit.outlier_scale).filter(|(_, n)| n.cost < fit.equations.cost)
            {
                (fit.body, fit.equations) = (body, equations);
            }
            // A wrong start can look like outliers: where all views agree with another one there are none.
            if let Some((body, equations)) = fit.outlier_scale.and_then(|_| again(None)) {
                let costs = fit.problem.objective(noise, None).view_costs(&body);
                if costs.iter().all(|cost| *cost <= OUTLIER_SCALE * OUTLIER_SCALE) {
                    (fit.body, fit.equations, fit.outlier_scale) = (body, equations, None);
                }
            }
        }
        if fit.outlier_scale.is_some() || !context.options.robust {
            return fit;
        }
        let costs = fit.problem.objective(noise, None).view_costs(&fit.body);
        let mean = costs.iter().sum::<f64>() / costs.len().max(1) as f64;
        (mean > SUSPECT_COST).then(|| fit.without_outliers(noise, context)).flatten().unwrap_or(fit)
    }

    /// The same, with depths compared with what perspective shows of its body, and with outlines near it by harmonics.
    fn with_updated_measurements(&self, noise: &NoiseLevels) -> Self {
        let mut problem = self.problem.clone();
        if problem.measurements.has_outlines() {
            choose_harmonics(&mut Arc::make_mut(&mut problem).measurements, &self.body, noise);
        }
        if problem.measurements.has_depths() {
            let world = self.body.body_in_world(&problem.measurements.frame);
            let ObjectProblem { measurements, views, .. } = Arc::make_mut(&mut problem);
            measurements.look_at(&self.body, &world, &views.views);
        }
        Self { problem, ..self.clone() }
    }

    /// The fit under new noise levels. If it cannot be evaluated, its cost is infinite and its status is diverged.
    pub(crate) fn refined(&self, noise: &NoiseLevels, last: bool) -> Self {
        let stop = if last { FINAL_TERMINATION } else { INNER_TERMINATION };
        let fit = self.with_updated_measurements(noise);
        let plain = fit.objective(noise, None);
        let scale = self.outlier_scale.map(|_| outlier_scale(plain.view_costs(&self.body), noise));
        let objective = Objective { outlier_scale: scale, ..plain };
        match minimum(self.body.clone(), stop, |body| objective.linearize(body), BodyModel::retract) {
            Some(Minimum { state: body, equations, end }) => {
                let converged =
                    !matches!(end, End::UsedUp(BodyStep { promised, .. }) if promised > MAX_REMAINING_DECREASE);
                Self { body, equations, outlier_scale: scale, converged, ..fit }
            }
            None => Self { equations: NormalEquations::nowhere(), ..fit },
        }
    }

    /// Root mean square of the used whitened residuals of each view.
    fn view_deviations(&self, noise: &NoiseLevels) -> Vec<Option<f64>> {
        let mut sums = vec![(0.0, 0usize); self.problem.views.views.len()];
        self.objective(noise, None).each_row(&self.body, |view, row, _| {
            sums[view].0 += row.residual * row.residual;
            sums[view].1 += usize::from(row.counts);
        });
        sums.into_iter().map(|(sum, count)| (count > 0).then(|| (sum / count as f64).sqrt())).collect()
    }

    /// The normalized residual under the noise levels of the last fit.
    pub(crate) fn goodness_of_fit(&self, noise: &NoiseLevels) -> Option<GoodnessOfFit> {
        self.objective(noise, self.outlier_scale).goodness_of_fit(&self.body, &self.equations)
    }

    /// The fit without views that are far beyond the noise, where it is a plain one to enough views: it has followed them
    /// a little, and they do not count as used.
    pub(crate) fn reject_gross_outliers(
        self,
        noise: &NoiseLevels,
        reference: Reference,
        context: &PosteriorContext,
    ) -> Self {
        let enough = self.problem.views.views.len() >= MIN_VIEWS;
        let limit = self.largest_cost(reference);
        if self.outlier_scale.is_some() || !context.options.robust || !enough {
            return self;
        }
        let far = self.view_costs(noise).into_iter().any(|cost| cost > limit);
        if far { Self { outlier_scale: Some(OUTLIER_SCALE), ..self }.refined(noise, true) } else { self }
    }

    /// Squared norm of each view's whitened residuals, as if there were four of them.
    fn view_costs(&self, noise: &NoiseLevels) -> Vec<f64> {
        self.problem.objective(noise, None).view_costs(&self.body)
    }

    /// The squared norm of a view's whitened residuals beyond which it is rejected.
    fn largest_cost(&self, reference: Reference) -> f64 {
        let far = (FAR_BEYOND_NOISE * reference.factor()).max(OUTLIER_SCALE);
        self.outlier_scale.map_or(far, |scale| scale.min(far)).powi(2)
    }

    /// The used measurements, for the estimate of common errors.
    fn common_rows(&self, noise: &NoiseLevels) -> Vec<CommonRow> {
        let measured = &self.problem.measurements.views;
        let objective = self.objective(noise, self.outlier_scale);
        let weights = noise.weights(measured.len());
        let mut rows = Vec::with_capacity(4 * measured.len());
        let (mut last, mut component) = (None, 0);
        let mut of_row = |view: usize, row: &ResidualRow, weight: f64| {
            component = if last == Some((view, row.group)) { component + 1 } else { 1 };
            last = Some((view, row.group));
            if !row.counts || weight <= 0.0 {
                return;
            }
            let normal = Vector3::new(row.row[0], row.row[1], row.row[2]);
            let (component, direction, reach) = if row.group.is_edge() && !measured[view].harmonics {
                let noise = noise.of(row.group) * noise.size_factor(measured[view].half_size);
                (0, normal.normalize(), self.body.support_gradient(&normal).0 * noise)
            } else {
                (component, measured[view].axis, 1.0)
            };
            if reach > 0.0 && reach.is_finite() && direction.iter().all(|x| x.is_finite()) {
                let total_weight = weight * weights.of(row.group);
                let (group, residual, row) = (row.group, row.residual, row.row);
                let class = group.common_class();
                let slope = weight * objective.relative_slope(group, residual);
                rows.push(CommonRow {
                    view,
                    class,
                    component,
                    direction,
                    reach,
                    residual,
                    row,
                    weight,
                    slope,
                    total_weight,
                });
            }
        };
        objective.each_row(&self.body, &mut of_row);
        objective.each_cue_row(&self.body, of_row);
        rows
    }

    /// Statistics of the residuals about common errors and about this object.
    pub(crate) fn common_statistics(&self, noise: &NoiseLevels) -> (CommonStatistics, ObjectAgreement) {
        let Some(covariance) = invert_spd(&self.equations.hessian()) else { return Default::default() };
        let rows = self.common_rows(noise);
        (CommonStatistics::of_object(&rows, &covariance), ObjectAgreement::new(&rows, &covariance))
    }

    /// The covariance of noise, of common errors, of the scales of cues and of corrected poses.
    fn covariance(&self, noise: &NoiseLevels, shared: SharedErrors, context: &PosteriorContext) -> Option<Covariance> {
        let local = self.local_covariance(noise, shared, context)?;
        covariance::in_world(&local, &self.body.world_map(&self.problem.measurements.frame), self.body.coordinates())
    }

    /// The same in the parameters of the fit.
    pub(crate) fn local_covariance(
        &self,
        noise: &NoiseLevels,
        shared: SharedErrors,
        context: &PosteriorContext,
    ) -> Option<Matrix9> {
        // A rotation of which the measurements know nothing is one of all.
        let with_any_rotation = || invert_spd(&covariance::regularized(&self.equations));
        let of_noise = invert_spd(&self.equations.hessian()).or_else(with_any_rotation)?;
        let mut local =
            if context.options.common_errors { self.with_common_errors(&of_noise, noise) } else { of_noise };
        if let Some(terms) = self.scale_terms(shared.scales, noise) {
            local += shared.scales.added_covariance(&terms);
        }
        if context.corrects_poses()
            && let Some(terms) = self.pose_terms(noise)
        {
            local += shared.poses.added_covariance(terms);
        }
        Some(local)
    }

    /// A covariance of noise with what its inverse normal equations do not know.
    fn with_common_errors(&self, of_noise: &Matrix9, noise: &NoiseLevels) -> Matrix9 {
        let CovarianceLevels { common, spread } = noise.covariance_levels();
        let rows = self.common_rows(noise);
        let relative =
            if spread.variance > 0.0 { ObjectAgreement::new(&rows, of_noise).relative_variance(*spread) } else { 1.0 };
        let local = scaled_covariance(&rows, relative, of_noise);
        if common.iter().all(|level| *level == 0.0) {
            return local;
        }
        // Small residuals do not show that the body suits the object better: it may have followed the measurements.
        local + added_covariance(&rows, common, of_noise) * relative.max(1.0)
    }

    /// The estimate in the world.
    pub(crate) fn estimate(
        &self,
        noise: &NoiseLevels,
        reference: Reference,
        shared: SharedErrors,
        context: &PosteriorContext,
    ) -> Estimate {
        self.estimate_after(noise, reference, shared, 0, context)
    }

    /// The same after so many fits that an alternative has replaced.
    pub(crate) fn estimate_after(
        &self,
        noise: &NoiseLevels,
        reference: Reference,
        shared: SharedErrors,
        swaps: usize,
        context: &PosteriorContext,
    ) -> Estimate {
        let ObjectProblem { views, measurements, .. } = &*self.problem;
        let blank = Estimate::failed(views.object_index, views.category_index, Status::Ok);
        let body = self.body.body_in_world(&measurements.frame);
        let behind = |view: &View| view.projection.depth(&measurements.frame.point_in_world(self.body.center())) <= 0.0;
        if !self.equations.cost.is_finite() || views.views.iter().all(behind) || !is_a_body(&body, &views.views) {
            return Estimate { status: Status::Diverged, ..blank };
        }
        let Some(covariance) = self.covariance(noise, shared, context) else {
            return Estimate { status: Status::Degenerate, ..blank };
        };
        let costs = self.view_costs(noise);
        let limit = self.largest_cost(reference);
        let inlier = |view: usize| costs[view] <= limit;
        let mut estimate = describe(blank, body, &views.views, inlier, context.with_enclosing);
        for (view, deviations) in estimate.views.iter_mut().zip(self.view_deviations(noise)) {
            view.normalized_residual = deviations.map(|x| x / reference.factor());
        }
        estimate.covariance = Some(covariance);
        if !self.converged {
            estimate.warnings.push(Warning::NotConverged);
        }
        estimate.goodness_of_fit =
            self.goodness_of_fit(noise).map(|goodness_of_fit| reference.against(goodness_of_fit));
        // A body that most of its views contradict is not that of the object that they show.
        let rests_on_few = 2 * estimate.views_used() < estimate.views.len();
        if rests_on_few || estimate.goodness_of_fit.as_ref().is_some_and(is_inconsistent) {
            estimate.status = Status::Inconsistent;
        }
        self.with_alternatives(estimate, noise, reference, shared, swaps, context)
    }
}
