//! One object on its way from views to an estimate.

use std::sync::Arc;

use nalgebra::{Point3, Rotation3, Unit, Vector3};

use super::super::conditioning::ObjectFrame;
use super::super::estimate::{Covariance, Estimate, Status, Warning};
use super::super::options::BodyKind;
use super::super::planes::planes_in_frame;
use super::super::report::describe;
use super::MapContext;
use super::body_model::{BodyModel, EllipsoidModel, OrientedModel};
use super::covariance;
use super::ground::{GroundPlane, LowestPoint};
use super::levenberg_marquardt::{Stop, minimise};
use super::measurements::{Measurements, Plane};
use super::noise::{NoiseLevels, NoiseStatistics};
use super::normal_equations::NormalEquations;
use super::objective::{OUTLIER_SCALE, ObjectPrior, Objective, lowest_point, outlier_scale};
use super::robust::fit_without_outliers;
use super::starts::{ellipsoid_from_quadric, oriented_starts, unit_sphere};
use crate::geometry::linalg::invert_spd;
use crate::geometry::{Body, Cuboid, Ellipsoid, Superellipsoid};
use crate::scene::{ObjectViews, View};

/// From a start: many steps, no need to end exactly.
const FROM_START: Stop = Stop { evaluations: 40, promised_decrease: 1e-2 };

/// To decide between many starts: few steps.
const SCREENING: Stop = Stop { evaluations: 15, promised_decrease: 1e-1 };

/// Between two estimates of the noise levels.
const BETWEEN_ROUNDS: Stop = Stop { evaluations: 10, promised_decrease: 3e-2 };

/// The end.
const POLISH: Stop = Stop { evaluations: 40, promised_decrease: 1e-6 };

/// Mean squared whitened residual of a view (four edges: 4 is what the noise gives) above which a plain fit is suspect.
const SUSPECT_COST: f64 = 12.0;

/// Oriented starts that are followed to the end.
const FOLLOWED_STARTS: usize = 3;

/// An object's measurements and priors in its own frame.
pub(super) struct Prepared {
    pub views: ObjectViews,
    pub measurements: Measurements,
    pub prior: ObjectPrior,
    heavy_tails: bool,
}

/// A fitted object.
#[derive(Clone)]
pub(super) struct Fit<B> {
    prepared: Arc<Prepared>,
    /// The ellipsoid from whose starts the body came.
    ellipsoid: EllipsoidModel,
    body: B,
    equations: NormalEquations,
    /// Set where the views hold outliers.
    outlier_scale: Option<f64>,
    /// The ground plane in the object's frame, where the object stands on it.
    ground: Option<(Plane, f64)>,
}

impl Prepared {
    /// Builds the object's frame and priors; an estimate that says why when there is none.
    pub(super) fn new(views: ObjectViews, context: &MapContext) -> Result<Self, Box<Estimate>> {
        let failed = |status| Box::new(Estimate::failed(views.object_index, views.category_index, status));
        if views.views.len() < 2 {
            return Err(failed(Status::TooFewViews));
        }
        let frame = ObjectFrame::from_views(&views.views).ok_or_else(|| failed(Status::Degenerate))?;
        let ellipses_as_planes = context.options.body != BodyKind::Ellipsoid;
        let measurements = Measurements::new(frame, &views.views, ellipses_as_planes, context.options);
        let prior = object_prior(&views, &frame, context);
        Ok(Self { views, measurements, prior, heavy_tails: context.options.heavy_tails })
    }

    /// The first fit: from the starts, and again without the outliers where its residuals show some.
    pub(super) fn first_fit<B: FirstFit>(
        self,
        noise: &NoiseLevels,
        context: &MapContext,
    ) -> Result<Fit<B>, Box<Estimate>> {
        let failed = Box::new(Estimate::failed(self.views.object_index, self.views.category_index, Status::Diverged));
        let seed = self.seed(context);
        let ellipsoid = self.fit_ellipsoid(noise).ok_or_else(|| failed.clone())?;
        let (body, equations) = B::from_ellipsoid(&self, &ellipsoid, noise, None, context, seed).ok_or(failed)?;
        let fit = Fit { prepared: Arc::new(self), ellipsoid, body, equations, outlier_scale: None, ground: None };
        Ok(if context.options.robust { fit.without_outliers(noise, context).unwrap_or(fit) } else { fit })
    }

    fn seed(&self, context: &MapContext) -> u64 {
        context.seed ^ (self.views.object_index as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
    }

    fn objective<'a>(&'a self, noise: &'a NoiseLevels, outlier_scale: Option<f64>) -> Objective<'a> {
        Objective {
            measurements: &self.measurements,
            prior: &self.prior,
            ground: None,
            noise,
            heavy_tails: self.heavy_tails,
            outlier_scale,
            smooth: false,
        }
    }

    /// The best ellipsoid over its starts, all views believed.
    fn fit_ellipsoid(&self, noise: &NoiseLevels) -> Option<EllipsoidModel> {
        let objective = Objective { smooth: true, ..self.objective(noise, None) };
        let linear = planes_in_frame(&self.views.views, &self.measurements.frame)
            .ok()
            .and_then(|quadric| ellipsoid_from_quadric(&quadric));
        [Some(unit_sphere(Vector3::zeros())), linear]
            .into_iter()
            .flatten()
            .filter_map(|start| minimise(start, FROM_START, |body| objective.linearise(body), BodyModel::retract))
            .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
            .map(|(body, _)| body)
    }
}

/// How the first fit of each kind of body comes from the ellipsoid.
pub(super) trait FirstFit: BodyModel {
    /// Whether the first fit chooses between several starts, which is worth repeating under other noise levels.
    const SEVERAL_STARTS: bool;

    fn from_ellipsoid(
        prepared: &Prepared,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        context: &MapContext,
        seed: u64,
    ) -> Option<(Self, NormalEquations)>;

    /// The body in the world.
    fn body_in_world(&self, frame: &ObjectFrame) -> Body;

    /// Covariance in world units.
    fn covariance(&self, equations: &NormalEquations, frame: &ObjectFrame) -> Option<Covariance>;
}

impl FirstFit for EllipsoidModel {
    const SEVERAL_STARTS: bool = false;

    fn from_ellipsoid(
        prepared: &Prepared,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        _context: &MapContext,
        _seed: u64,
    ) -> Option<(Self, NormalEquations)> {
        let equations = prepared.objective(noise, outlier_scale).linearise(ellipsoid)?;
        Some((ellipsoid.clone(), equations))
    }

    fn body_in_world(&self, frame: &ObjectFrame) -> Body {
        Body::Ellipsoid(Ellipsoid {
            center: frame.point_in_world(self.center()),
            semi_axes: self.semi_axes() * frame.unit,
            rotation: Rotation3::from_matrix_unchecked(*self.axes()),
        })
    }

    fn covariance(&self, equations: &NormalEquations, frame: &ObjectFrame) -> Option<Covariance> {
        covariance::of_ellipsoid(self, equations, frame)
    }
}

impl FirstFit for OrientedModel {
    const SEVERAL_STARTS: bool = true;

    fn from_ellipsoid(
        prepared: &Prepared,
        ellipsoid: &EllipsoidModel,
        noise: &NoiseLevels,
        outlier_scale: Option<f64>,
        context: &MapContext,
        seed: u64,
    ) -> Option<(Self, NormalEquations)> {
        let objective = prepared.objective(noise, outlier_scale);
        let exponent = match context.options.body {
            BodyKind::Superellipsoid(exponent) => exponent,
            BodyKind::Cuboid | BodyKind::Ellipsoid => 1.0,
        };
        let centers = centers_from_size(prepared);
        let starts = oriented_starts(ellipsoid, exponent, &prepared.prior, &centers, seed);
        let descend = |start: OrientedModel, stop: Stop| {
            minimise(start, stop, |body| objective.linearise(body), BodyModel::retract)
        };
        let mut screened: Vec<_> = starts.into_iter().filter_map(|start| descend(start, SCREENING)).collect();
        screened.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        screened
            .into_iter()
            .take(FOLLOWED_STARTS)
            .filter_map(|(start, _)| descend(start, FROM_START))
            .min_by(|a, b| a.1.cost.total_cmp(&b.1.cost))
    }

    fn body_in_world(&self, frame: &ObjectFrame) -> Body {
        let center: Point3<f64> = frame.point_in_world(self.center());
        let semi_axes = self.semi_axes() * frame.unit;
        let rotation = Rotation3::from_matrix_unchecked(*self.axes());
        if self.exponent() == 1.0 {
            Body::Cuboid(Cuboid { center, half_extents: semi_axes, rotation })
        } else {
            Body::Superellipsoid(Superellipsoid { center, semi_axes, rotation, support_exponent: self.exponent() })
        }
    }

    fn covariance(&self, equations: &NormalEquations, frame: &ObjectFrame) -> Option<Covariance> {
        covariance::of_oriented(self, equations, frame)
    }
}

impl<B: FirstFit> Fit<B> {
    fn objective<'a>(&'a self, noise: &'a NoiseLevels, outlier_scale: Option<f64>) -> Objective<'a> {
        Objective { ground: self.ground, ..self.prepared.objective(noise, outlier_scale) }
    }

    /// The lowest point of the body against `up`, for the ground plane; `None` where it does not stand on it.
    pub(super) fn lowest_point(&self, up: &Unit<Vector3<f64>>) -> Option<LowestPoint> {
        let Prepared { views, measurements, prior, .. } = &*self.prepared;
        if !prior.on_ground {
            return None;
        }
        let frame = &measurements.frame;
        let level = Plane { n: up.into_inner(), d: 0.0 };
        let (reach, _) = self.body.support_gradient(&level.n);
        // What the object knows without the plane: its row is taken out of the inverse again (Sherman-Morrison).
        let covariance = invert_spd(&self.equations.hessian())?;
        let variance_along = |plane: &Plane| {
            let row = nalgebra::SVector::from(lowest_point(plane, &self.body).1);
            (row.transpose() * covariance * row)[0]
        };
        let with = variance_along(&level);
        let told = self.ground.map_or(0.0, |(_, weight)| weight * weight * with);
        let variance = with / (1.0 - told).max(1e-3);
        let point = frame.point_in_world(&(self.body.center() - level.n * reach));
        let nearest = views.views.iter().filter_map(|view| Some((view.projection.center_in_world()? - point).norm()));
        Some(LowestPoint {
            point,
            variance: variance * frame.unit * frame.unit,
            height: 2.0 * reach * frame.unit,
            distance: nearest.fold(f64::INFINITY, f64::min),
        })
    }

    /// Puts the body on the ground plane.
    pub(super) fn stand_on(&mut self, ground: &GroundPlane, up: &Unit<Vector3<f64>>) {
        self.ground = self.lowest_point(up).map(|lowest| {
            let frame = &self.prepared.measurements.frame;
            let height = ground.normal.dot(&(frame.origin - ground.reference)) + ground.offset;
            (Plane { n: ground.normal, d: height / frame.unit }, frame.unit / lowest.unevenness())
        });
    }

    /// Residual statistics under the noise levels of the last fit.
    pub(super) fn statistics(&self, noise: &NoiseLevels, context: &MapContext) -> NoiseStatistics {
        let objective = self.objective(noise, self.outlier_scale);
        objective.statistics(&self.body, &self.equations, context.options.correlated_views)
    }

    /// A fit that leaves outliers out, where this plain one shows some.
    fn without_outliers(&self, noise: &NoiseLevels, context: &MapContext) -> Option<Self> {
        let prepared = &self.prepared;
        let objective = Objective { smooth: true, ..prepared.objective(noise, None) };
        let tangents = prepared.measurements.with_ellipses_as_planes(&prepared.views.views, context.options);
        let seed = prepared.seed(context);
        let ellipsoid = fit_without_outliers(&objective, &self.body, &tangents, seed)?;
        let (body, equations) = B::from_ellipsoid(prepared, &ellipsoid, noise, Some(OUTLIER_SCALE), context, seed)?;
        Some(Self {
            prepared: prepared.clone(),
            ellipsoid,
            body,
            equations,
            outlier_scale: Some(OUTLIER_SCALE),
            ground: self.ground,
        })
    }

    /// The fit looked at again, now that the noise of the scene is known: from all starts where a body has several, and
    /// for outliers where the residuals are much larger than the noise.
    pub(super) fn reconsidered(&self, noise: &NoiseLevels, round: usize, context: &MapContext) -> Self {
        let mut fit = self.refined(noise, false);
        if B::SEVERAL_STARTS {
            // Other random rotations than before.
            let seed = self.prepared.seed(context).wrapping_add(1 + round as u64);
            let again = |scale| {
                let (body, _) = B::from_ellipsoid(&self.prepared, &self.ellipsoid, noise, scale, context, seed)?;
                let objective = self.objective(noise, scale);
                minimise(body, BETWEEN_ROUNDS, |body| objective.linearise(body), BodyModel::retract)
            };
            if let Some((body, equations)) = again(fit.outlier_scale).filter(|(_, n)| n.cost < fit.equations.cost) {
                (fit.body, fit.equations) = (body, equations);
            }
            // A wrong start can look like outliers: where all views agree with another one there are none.
            if let Some((body, equations)) = fit.outlier_scale.and_then(|_| again(None)) {
                let costs = fit.prepared.objective(noise, None).view_costs(&body);
                if costs.iter().all(|cost| *cost <= OUTLIER_SCALE * OUTLIER_SCALE) {
                    (fit.body, fit.equations, fit.outlier_scale) = (body, equations, None);
                }
            }
        }
        if fit.outlier_scale.is_some() || !context.options.robust {
            return fit;
        }
        let costs = fit.prepared.objective(noise, None).view_costs(&fit.body);
        let mean = costs.iter().sum::<f64>() / costs.len().max(1) as f64;
        (mean > SUSPECT_COST).then(|| fit.without_outliers(noise, context)).flatten().unwrap_or(fit)
    }

    /// The fit under new noise levels; the old one where that fails.
    pub(super) fn refined(&self, noise: &NoiseLevels, last: bool) -> Self {
        let stop = if last { POLISH } else { BETWEEN_ROUNDS };
        let plain = self.objective(noise, None);
        let scale = self.outlier_scale.map(|_| outlier_scale(plain.view_costs(&self.body)));
        let objective = Objective { outlier_scale: scale, ..plain };
        match minimise(self.body.clone(), stop, |body| objective.linearise(body), BodyModel::retract) {
            Some((body, equations)) => Self { body, equations, outlier_scale: scale, ..self.clone() },
            None => self.clone(),
        }
    }

    /// The estimate in the world.
    pub(super) fn estimate(&self, noise: &NoiseLevels, context: &MapContext) -> Estimate {
        let Prepared { views, measurements, .. } = &*self.prepared;
        let costs = self.outlier_scale.map(|_| self.prepared.objective(noise, None).view_costs(&self.body));
        let inlier = |view: usize| match (&costs, self.outlier_scale) {
            (Some(costs), Some(scale)) => costs[view] <= scale * scale,
            _ => true,
        };
        let mut estimate = describe(
            Estimate::failed(views.object_index, views.category_index, Status::Ok),
            self.body.body_in_world(&measurements.frame),
            &views.views,
            inlier,
            context.options.enclosing_quantile,
        );
        estimate.covariance = self.body.covariance(&self.equations, &measurements.frame);
        if estimate.covariance.is_none() {
            estimate.warnings.push(Warning::NoCovariance);
        }
        if views.views.iter().all(|view| estimate.center.is_some_and(|c| view.projection.depth(&c) <= 0.0)) {
            estimate.status = Status::Diverged;
        }
        estimate
    }
}

/// The priors of an object in its frame.
fn object_prior(views: &ObjectViews, frame: &ObjectFrame, context: &MapContext) -> ObjectPrior {
    let mut prior = ObjectPrior { shape_weight: 1.0 / context.options.shape_sd, ..Default::default() };
    prior.axes_are_named = context.options.body != BodyKind::Ellipsoid;
    let name = views.category_index.map_or("", |index| context.categories[index].as_str());
    prior.on_ground = context.options.ground_plane && context.up.is_some();
    let Some(category) = context.options.priors.of(name) else { return prior };
    prior.on_ground |= category.on_ground && context.up.is_some();
    if let (Some(up), Some(sd)) = (context.up, category.upright_sd) {
        prior.up = Some(up.into_inner());
        prior.upright_weight = 1.0 / sd;
    }
    if let Some(size) = category.size {
        prior.log_size =
            Some(std::array::from_fn(|k| ((0.5 * size.mean[k] / frame.unit).ln(), size.mean[k] / size.sd[k])));
        if prior.up.is_none() {
            prior.up = context.up.map(Unit::into_inner);
        }
        // The category's size takes the place of the general shape prior.
        prior.shape_weight = 0.0;
    }
    prior
}

/// Centres to start from where the category's size is known: on the ray of the tallest box that is not cut off, at the
/// depth that its height suggests, times .85, 1 and 1.2 (E9). In the object's frame.
fn centers_from_size(prepared: &Prepared) -> Vec<Vector3<f64>> {
    let frame = &prepared.measurements.frame;
    let Some([_, _, (log_half_height, _)]) = prepared.prior.log_size else { return Vec::new() };
    let whole = |view: &&View| {
        let b = view.bounding_box;
        b.is_some_and(|b| !super::super::planes::edges_at_border(&b, view.image_size, 2.0).contains(&true))
    };
    let height = |view: &View| view.bounding_box.map_or(0.0, |b| b.size().y);
    let tallest = prepared.views.views.iter().filter(whole).max_by(|a, b| height(a).total_cmp(&height(b)));
    let Some(view) = tallest else { return Vec::new() };
    let (Some(bounding_box), Some(camera)) = (view.bounding_box, view.projection.center_in_world()) else {
        return Vec::new();
    };
    let Some(ray) = view.projection.ray_in_world(&bounding_box.center()) else { return Vec::new() };
    let depth = view.projection.focal_length() * 2.0 * log_half_height.exp() * frame.unit / bounding_box.size().y;
    let along = view.projection.depth(&(camera + ray));
    [0.85, 1.0, 1.2]
        .into_iter()
        .map(|factor| (camera + ray * (depth * factor / along) - frame.origin) / frame.unit)
        .collect()
}
