//! Evidence of the boxes of an object about its kind of body (docs/method.md, section 9).
//!
//! The evidence of each kind by Laplace's approximation: the fit to the boxes, minus a penalty for the degrees of
//! freedom of the body.

#[cfg(test)]
use nalgebra::Matrix3;
use nalgebra::{SVector, Vector3};

use crate::body_model::BodyModel;
use crate::body_model::ellipsoid::EllipsoidModel;
use crate::body_model::oriented::OrientedModel;
use crate::geometry::BodyKind;
use crate::geometry::linalg::solve_spd;
use crate::optimize::normal_equations::{NormalEquations, PARAMETERS};
use crate::scene::Cues;
use crate::solve::posterior::context::PosteriorContext;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::solve::posterior::object::consensus::{WRONG_SHARE, log_wrong_edge};
use crate::solve::posterior::object::covariance::{log_determinant_of, regularized};
use crate::solve::posterior::object::first_fit::{ALL, best_of, descended};
use crate::solve::posterior::object::fit::Fit;
use crate::solve::posterior::object::model::Model;
use crate::solve::posterior::object::objective::{Objective, student_t};
use crate::solve::posterior::object::problem::ObjectProblem;
use crate::solve::posterior::object::starts::{along_each_axis, oriented_starts, turned_axes};

/// The tested exponents of superellipsoids.
pub(crate) const EXPONENTS: [f64; 3] = [1.75, 1.5, 1.25];

/// The kinds, the roundest first: ellipsoid, superellipsoids, cuboid; and the cylinder.
pub(crate) const KINDS: usize = EXPONENTS.len() + 3;
pub(crate) const ELLIPSOID: usize = 0;
pub(crate) const CUBOID: usize = KINDS - 2;
pub(crate) const CYLINDER: usize = KINDS - 1;

/// The kind with an index.
pub(crate) fn kind_of(index: usize) -> BodyKind {
    match index {
        ELLIPSOID => BodyKind::Ellipsoid,
        CUBOID => BodyKind::Cuboid,
        CYLINDER => BodyKind::Cylinder,
        k => BodyKind::Superellipsoid(EXPONENTS[k - 1]),
    }
}

/// A cylinder has eight ways to name its axes where a cuboid has 24: twice the logarithm of the ratio.
const LOG_AXES_OF_CYLINDER: f64 = 2.197_224_577_336_219_6;

/// Standard deviation of the logarithm of the ratio of a cylinder's radii, and that of two semi-axes of any body (the
/// shape prior's 0.4, twice).
const ROUND_SD: f64 = 0.1;
const ANY_SD: f64 = 0.566;

/// Degrees of freedom of the prior on an object's noise, which is centered on the noise of the scene.
const DOF_OF_SCENE: f64 = 8.0;

/// Logarithms of the variances over which the noise of an object is integrated, relative to that of the scene.
const LOG_VARIANCES: [f64; 2] = [-4.0, 12.0];
const LOG_VARIANCE_STEP: f64 = 0.25;

/// Rounds in which the variance of a kind and the views that are wrong are adjusted to each other.
const VARIANCE_ROUNDS: usize = 20;

/// Smallest variance, in that of the noise: exact data.
const MIN_VARIANCE: f64 = 1e-8;

/// How the views of an object agree with the best body of a kind.
#[derive(Debug, Clone)]
pub(crate) struct KindFit {
    /// For each view the squares of its whitened residuals.
    pub(crate) views: Vec<Vec<f64>>,
    /// What the freedom of the body and the priors do: the logarithm of the determinant of the normal equations and the
    /// cost of the priors.
    pub(crate) freedom: f64,
    cost: f64,
    body: Model,
}

#[cfg(test)]
impl KindFit {
    /// Views of these squared residuals of a body of unit size.
    pub(crate) fn of_views(views: Vec<Vec<f64>>, freedom: f64) -> Self {
        let body =
            Model::Ellipsoid(EllipsoidModel::from_axes(Vector3::zeros(), Matrix3::identity(), Vector3::repeat(1.0)));
        Self { views, freedom, cost: 0.0, body }
    }
}

/// Evidence of the boxes of an object about its kind. All kinds are judged by all views: each view is one of the object or,
/// with a small probability, a wrong box that may be anywhere.
#[derive(Debug, Clone)]
pub(crate) struct BodyEvidence {
    /// The category of the object.
    pub(crate) category: Option<usize>,
    /// Whether the size of its category is known, which is that of a box.
    pub(crate) sized: bool,
    /// Logarithm of the density of an edge of a wrong box, over that of an edge of the object at its most probable place.
    pub(crate) log_wrong: f64,
    /// Whether single edges may be wrong.
    pub(crate) heavy_tails: bool,
    /// The fit of each kind; `None` where it failed.
    pub(crate) fits: [Option<KindFit>; KINDS],
}

impl BodyEvidence {
    /// The evidence about a fitted object; `None` if it cannot be computed.
    pub(crate) fn of(fit: &Fit, noise: &NoiseLevels, context: &PosteriorContext) -> Option<Self> {
        let views = &fit.problem.views;
        // Ellipses are outlines of ellipsoids only.
        if views.views.iter().any(|view| view.ellipse.is_some()) {
            return None;
        }
        let search = BodySearch::new(fit, noise, context);
        if search.object.measurements.edges.len() <= PARAMETERS {
            return None;
        }
        let log_wrong = log_wrong_edge(noise);
        let sized = fit.problem.prior.log_size.is_some();
        let fits = std::array::from_fn(|_| None);
        let heavy_tails = context.options.heavy_tails;
        let mut evidence = Self { category: views.category_index, sized, log_wrong, heavy_tails, fits };
        let round = search.starts(BodyKind::Ellipsoid).into_iter().take(1).collect();
        evidence.take(ELLIPSOID, &search, round, 1);
        evidence.fits[ELLIPSOID].as_ref()?;
        let any_way = oriented_starts(&search.ellipsoid, BodyKind::Cuboid, &search.object.prior, &[], 0);
        evidence.take(CUBOID, &search, any_way, ALL);
        // Bodies that are about as angular have about the same place, size and directions.
        for kind in (1..CUBOID).rev() {
            let mut starts = search.starts(kind_of(kind));
            starts.extend(evidence.like(kind + 1, kind_of(kind)));
            evidence.take(kind, &search, starts, ALL);
        }
        for kind in 2..=CUBOID {
            let like = evidence.like(kind - 1, kind_of(kind)).into_iter().collect();
            evidence.take(kind, &search, like, 1);
        }
        let lying = search.starts(BodyKind::Cylinder).into_iter().chain(evidence.like(CUBOID, BodyKind::Cylinder));
        evidence.take(CYLINDER, &search, lying.flat_map(|start| along_each_axis(&start)).collect(), ALL);
        Some(evidence)
    }

    /// The fitted body of another kind as a start of this one.
    fn like(&self, other: usize, kind: BodyKind) -> Option<OrientedModel> {
        let body = &self.fits[other].as_ref()?.body;
        let sizes = body.semi_axes() * (kind.relative_size() / kind_of(other).relative_size());
        Some(OrientedModel::new(*body.center(), *body.axes(), sizes, kind))
    }

    /// The evidence of a kind, from these starts, of which so many are turned, if they lead to a better fit than there was.
    fn take(&mut self, kind: usize, search: &BodySearch, starts: Vec<OrientedModel>, turned: usize) {
        let objective = search.objective();
        let found = best_of(&objective, descended(&objective, starts, turned));
        let Some((body, equations)) = found else { return };
        if self.fits[kind].as_ref().is_some_and(|fit| fit.cost <= equations.cost) {
            return;
        }
        let Some(mut freedom) = log_determinant_of(&equations) else { return };
        freedom += objective.cost_of_priors(&body);
        if kind == CYLINDER {
            freedom += LOG_AXES_OF_CYLINDER + elongation(&body, &equations);
        }
        let views = objective.squares_of_views(&body);
        self.fits[kind] = Some(KindFit { views, freedom, cost: equations.cost, body });
    }

    /// Logarithms of the evidences over that of an ellipsoid, minus infinity for kinds that could not be fitted. The noise of an object is
    /// about that of the scene: its variance has an inverse gamma distribution around `variance`.
    pub(crate) fn log_odds(&self, variance: f64) -> [f64; KINDS] {
        let log = |fit: &KindFit| self.log_evidence(fit, variance);
        let ellipsoid = self.fits[ELLIPSOID].as_ref().map_or(0.0, log);
        std::array::from_fn(|k| self.fits[k].as_ref().map_or(f64::NEG_INFINITY, |fit| log(fit) - ellipsoid))
    }

    /// The evidence with the noise of the object integrated out, up to a constant.
    fn log_evidence(&self, fit: &KindFit, variance: f64) -> f64 {
        let [first, last] = LOG_VARIANCES;
        let count = ((last - first) / LOG_VARIANCE_STEP) as usize;
        let logs: Vec<f64> = (0..=count)
            .map(|k| {
                let log = first + LOG_VARIANCE_STEP * k as f64;
                let prior = -0.5 * DOF_OF_SCENE * (log + (-log).exp());
                prior + self.log_likelihood(fit, variance * log.exp())
            })
            .collect();
        let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        largest + logs.iter().map(|log| (log - largest).exp()).sum::<f64>().ln() - 0.5 * fit.freedom
    }

    /// Of the views, where residuals have this variance, with the parameters of the body integrated out.
    fn log_likelihood(&self, fit: &KindFit, variance: f64) -> f64 {
        let of_views = fit.views.iter().map(|view| {
            let [right, wrong] = self.log_densities(view, variance);
            right.max(wrong) + (-(right - wrong).abs()).exp().ln_1p()
        });
        of_views.sum::<f64>() + 0.5 * PARAMETERS as f64 * variance.ln()
    }

    /// Logarithms of the densities of a view that shows the object and of one that does not, each with its probability.
    fn log_densities(&self, squares: &[f64], variance: f64) -> [f64; 2] {
        let count = squares.len() as f64;
        let cost = if self.heavy_tails {
            let mut cost = student_t().no_cost();
            squares.iter().for_each(|square| cost.add(square / variance));
            cost.total()
        } else {
            squares.iter().sum::<f64>() / variance
        };
        let right = (1.0 - WRONG_SHARE).ln() - 0.5 * (count * variance.ln() + cost);
        [right, WRONG_SHARE.ln() + count * self.log_wrong]
    }

    /// The variance of the residuals of the views that show the object, for a kind, and their degrees of freedom.
    fn variance_of(&self, fit: &KindFit) -> (f64, f64) {
        let (mut variance, mut dof) = (1.0, 0.0);
        for _ in 0..VARIANCE_ROUNDS {
            let (mut sum, mut residuals) = (0.0, 0.0);
            for squares in &fit.views {
                let [right, wrong] = self.log_densities(squares, variance);
                let shows = 1.0 / (1.0 + (wrong - right).exp());
                sum += shows * squares.iter().map(|square| self.weight(square / variance) * square).sum::<f64>();
                residuals += shows * squares.len() as f64;
            }
            dof = (residuals - PARAMETERS as f64).max(0.0);
            if dof < 1.0 {
                break;
            }
            variance = (sum / dof).max(MIN_VARIANCE);
        }
        (variance, dof)
    }

    /// The weight of a residual, squared, over the variance.
    fn weight(&self, squared: f64) -> f64 {
        if self.heavy_tails { student_t().weight(squared) } else { 1.0 }
    }

    /// The kind with the largest evidence by itself, with the variance of its residuals and their degrees of freedom.
    pub(crate) fn best(&self) -> (usize, f64, f64) {
        let mut best = (f64::NEG_INFINITY, (ELLIPSOID, 1.0, 0.0));
        for (kind, fit) in self.fits.iter().enumerate() {
            let Some(fit) = fit else { continue };
            let (variance, dof) = self.variance_of(fit);
            let score = self.log_likelihood(fit, variance) - 0.5 * fit.freedom;
            if score > best.0 {
                best = (score, (kind, variance, dof));
            }
        }
        best.1
    }
}

/// Minus twice the logarithm of the evidence that a cylinder's section is about round over that of any ellipse: the boxes
/// of cuboids are fitted well by elliptic cylinders, which hardly occur.
fn elongation(body: &Model, equations: &NormalEquations) -> f64 {
    let sizes = body.semi_axes();
    let ratio = (sizes.x / sizes.y).ln();
    let mut gradient = SVector::<f64, PARAMETERS>::zeros();
    (gradient[6], gradient[7]) = (1.0, -1.0);
    // Where the measurements leave it open both are as probable.
    let Some(direction) = solve_spd(&regularized(equations), &gradient) else { return 0.0 };
    let variance = gradient.dot(&direction);
    let log = |prior_sd: f64| {
        let total = variance + prior_sd * prior_sd;
        ratio * ratio / total + total.ln()
    };
    log(ROUND_SD) - log(ANY_SD)
}

/// An object whose kind is looked for.
struct BodySearch<'a> {
    fit: &'a Fit,
    ellipsoid: EllipsoidModel,
    noise: &'a NoiseLevels,
    object: ObjectProblem,
}

impl<'a> BodySearch<'a> {
    fn new(fit: &'a Fit, noise: &'a NoiseLevels, context: &PosteriorContext) -> Self {
        let ellipsoid = match &fit.body {
            Model::Ellipsoid(ellipsoid) => ellipsoid.clone(),
            body => EllipsoidModel::from_axes(*body.center(), *body.axes(), body.semi_axes()),
        };
        let (mut views, frame) = (fit.problem.views.clone(), fit.problem.measurements.frame);
        // The sizes of a source of 3D boxes mean the kind of body that it was made for.
        views.views.iter_mut().for_each(|view| view.cues = Cues::default());
        let object = ObjectProblem::in_frame(views, frame, BodyKind::Superellipsoid(2.0), context);
        Self { fit, ellipsoid, noise, object }
    }

    fn objective(&self) -> Objective<'_> {
        Objective { ground: self.fit.ground, ..self.object.objective(self.noise, self.fit.outlier_scale) }
    }

    /// From the axes of the ellipsoid and from those turned by 45 degrees.
    fn starts(&self, kind: BodyKind) -> Vec<OrientedModel> {
        let (center, size) = (*self.fit.body.center(), kind.relative_size());
        let start = |(axes, sizes): (_, Vector3<f64>)| OrientedModel::new(center, axes, sizes * size, kind);
        turned_axes(&self.ellipsoid, &self.object.prior).into_iter().map(start).collect()
    }
}

#[cfg(test)]
#[path = "body_evidence_tests.rs"]
mod tests;
