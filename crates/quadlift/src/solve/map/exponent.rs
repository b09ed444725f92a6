//! Objects of unknown kind: one support exponent for the whole scene, from what its boxes fit best (E9, ours).

use super::body_model::{BodyModel, EllipsoidModel, Form, OrientedModel};
use super::fit::Fit;
use super::levenberg_marquardt::{Stop, minimise};
use super::noise::NoiseLevels;
use super::normal_equations::{NormalEquations, PARAMETERS};
use super::object::Prepared;
use super::objective::Objective;
use super::scene_fit::SceneFit;
use super::starts::turned_axes;
use super::{BodyKind, MapContext};
use crate::geometry::linalg::cholesky;
use crate::parallel::map_indices;

/// The exponents are 2 (ellipsoid) less so many steps, to 1 (cuboid).
const STEPS: usize = 10;

/// Objects that are tried, at most, evenly spread.
const TRIED_OBJECTS: usize = 48;

/// Precision of a Gaussian with the volume of the rotations that differ for a body with the symmetry of a cuboid with
/// equal edges: `(2 pi)^(3/2) s^3 = 8 pi^2 / 24`, `1 / s^2`.
const ROTATION_PRECISION: f64 = 2.84;

/// From one exponent to the next.
const NEXT: Stop = Stop { evaluations: 12, promised_decrease: 1e-2 };

/// Times `ln n` that the score must fall: one would do for its expected value, but it varies from scene to scene (of six
/// scenes of 120 ellipsoids it fell by 13 in one, where `ln n` is 8).
const CLEARLY: f64 = 2.0;

/// The search ends after so many exponents in a row that fit worse than the best one.
const WORSE_IN_A_ROW: usize = 3;

/// The support exponent below 2 that the scene's boxes fit clearly better than that of an ellipsoid, where there is one.
///
/// Clearly: `n ln(cost) + sum ln det H` falls by more than `2 ln n`, with n the number of edges less that of the parameters
/// and H the normal equations of each object. The determinants (Laplace's approximation of the evidence) keep a body
/// with edges from winning because its rotation, which hardly matters to a round ellipsoid, can follow the noise.
pub(super) fn clearly_better(scene: &SceneFit<EllipsoidModel>, context: &MapContext) -> Option<f64> {
    // Ellipses are outlines of ellipsoids only.
    if scene.fits().any(|fit| fit.prepared.views.views.iter().any(|view| view.ellipse.is_some())) {
        return None;
    }
    let fits: Vec<&Fit<EllipsoidModel>> = scene.fits().collect();
    let stride = fits.len().div_ceil(TRIED_OBJECTS).max(1);
    // A body of the wrong kind errs alike in neighbouring views: what looks like correlation is what is looked for.
    let noise = scene.noise_of_independent_views(context);
    let mut tried: Vec<Chains> =
        fits.into_iter().step_by(stride).filter_map(|fit| Chains::new(fit, &noise, context)).collect();
    let data: f64 = tried.iter().map(|chains| chains.edges - PARAMETERS as f64).sum();
    if data <= PARAMETERS as f64 {
        return None;
    }
    let mut scores: Vec<(f64, f64)> = Vec::with_capacity(STEPS + 1);
    let mut best = f64::INFINITY;
    let mut worse = 0;
    for step in 0..=STEPS {
        let exponent = (2 * STEPS - step) as f64 / STEPS as f64;
        tried = map_indices(tried.len(), |k| tried[k].with_exponent(exponent));
        let cost: f64 = tried.iter().map(|chains| chains.cost).sum();
        let score = data * cost.ln() + tried.iter().map(|chains| chains.log_determinant).sum::<f64>();
        scores.push((exponent, score));
        worse = if score < best { 0 } else { worse + 1 };
        best = best.min(score);
        if worse == WORSE_IN_A_ROW {
            break;
        }
    }
    let ellipsoids = scores[0].1;
    if best > ellipsoids - CLEARLY * data.ln() {
        return None;
    }
    // Of those that are about as good the roundest.
    scores.into_iter().find(|(_, score)| *score < best + data.ln()).map(|(exponent, _)| exponent)
}

/// One object followed from exponent to exponent, from several rotations.
struct Chains<'a> {
    fit: &'a Fit<EllipsoidModel>,
    /// The object as oriented bodies see it.
    object: std::sync::Arc<Prepared>,
    noise: &'a NoiseLevels,
    bodies: Vec<OrientedModel>,
    /// Those from which it began.
    first: Vec<OrientedModel>,
    /// Number of edges.
    edges: f64,
    /// Smallest cost over the bodies, and the logarithm of the determinant of the normal equations there.
    cost: f64,
    log_determinant: f64,
}

impl<'a> Chains<'a> {
    fn new(fit: &'a Fit<EllipsoidModel>, noise: &'a NoiseLevels, context: &MapContext) -> Option<Self> {
        let oriented = MapContext { body: BodyKind::Superellipsoid(2.0), ..context.clone() };
        let object = Prepared::new(fit.prepared.views.clone(), &oriented).ok()?;
        let edges = object.measurements.edges.len() as f64;
        let first: Vec<OrientedModel> = turned_axes(&fit.body, &fit.prepared.prior)
            .into_iter()
            .map(|(axes, semi_axes)| OrientedModel::new(*fit.body.center(), axes, semi_axes, Form::Exponent(2.0)))
            .collect();
        Some(Self {
            fit,
            object: object.into(),
            noise,
            bodies: Vec::new(),
            first,
            edges,
            cost: f64::INFINITY,
            log_determinant: 0.0,
        })
    }

    /// The fits with another exponent, from those with the last one and from the beginning: where edges lie is not found
    /// from a rounder body alone.
    fn with_exponent(&self, exponent: f64) -> Self {
        let objective =
            Objective { ground: self.fit.ground, ..self.object.objective(self.noise, self.fit.outlier_scale) };
        let (mut cost, mut log_determinant) = (f64::INFINITY, 0.0);
        let bodies = self.bodies.iter().chain(&self.first).map(|body| {
            let form = Form::Exponent(exponent);
            let semi_axes = body.semi_axes() * (form.relative_size() / body.form().relative_size());
            let start = OrientedModel::new(*body.center(), *body.axes(), semi_axes, form);
            match minimise(start.clone(), NEXT, |body| objective.linearise(body), BodyModel::retract) {
                Some((body, equations)) => {
                    if equations.cost < cost
                        && let Some(determinant) = log_determinant_of(&equations)
                    {
                        (cost, log_determinant) = (equations.cost, determinant);
                    }
                    (equations.cost, body)
                }
                None => (f64::INFINITY, start),
            }
        });
        let mut bodies: Vec<(f64, OrientedModel)> = bodies.collect();
        bodies.sort_by(|a, b| a.0.total_cmp(&b.0));
        let bodies = bodies.into_iter().take(self.first.len()).map(|(_, body)| body).collect();
        Self {
            fit: self.fit,
            object: self.object.clone(),
            noise: self.noise,
            bodies,
            first: self.first.clone(),
            edges: self.edges,
            cost,
            log_determinant,
        }
    }
}

/// `ln det H` with a prior on the rotation, of which three parameters know nothing where axes are equal; `None` where H is
/// singular.
pub(super) fn log_determinant_of(equations: &NormalEquations) -> Option<f64> {
    let mut hessian = equations.hessian();
    for k in 3..6 {
        hessian[(k, k)] += ROTATION_PRECISION;
    }
    // Twice the sum of the logarithms of Cholesky's diagonal.
    cholesky(&hessian).map(|l| (0..PARAMETERS).map(|k| 2.0 * l[(k, k)].ln()).sum())
}
