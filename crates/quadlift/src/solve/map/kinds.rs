//! Objects of unknown kind: which kind of body each is, from what its boxes fit best and what the other objects are (E9,
//! ours).
//!
//! For each object every kind has an evidence (Laplace's approximation): how well its boxes fit, less what the freedom of
//! the body is worth. One object seldom tells. How often each kind occurs is therefore estimated from all objects, in each
//! category from those of the category as well, and an object takes the kind that is most probable given both. Where all objects are of
//! one kind they agree on it, and where they are not each goes its own way as far as its views tell.

use std::collections::BTreeMap;

use super::super::options::BodyKind;
use super::MapContext;
use super::body_model::{BodyModel, Form, OrientedModel};
use super::fit::Fit;
use super::levenberg_marquardt::{Stop, minimise};
use super::model::Model;
use super::noise::NoiseLevels;
use super::normal_equations::{NormalEquations, PARAMETERS};
use super::object::Prepared;
use super::objective::Objective;
use super::scene_fit::SceneFit;
use super::starts::{along_each_axis, turned_axes};
use crate::geometry::linalg::cholesky;
use crate::parallel::map_indices;

/// The exponents of superellipsoids are 2 less so many tenths.
const STEPS: usize = 10;

/// Number of kinds: ellipsoid, superellipsoids, cuboid (the last of the exponents), cylinder.
const KINDS: usize = STEPS + 2;
const CYLINDER: usize = KINDS - 1;

/// The exponent with which it is tried whether an object may be none: where the boxes of a body with edges are fitted
/// better than those of an ellipsoid, so are those of this one, half of the way between an ellipsoid and a sphere's cube.
const TRIED_STEP: usize = 4;

/// Precision of a Gaussian with the volume of the rotations that differ for a body with the symmetry of a cuboid with
/// equal edges: `(2 pi)^(3/2) s^3 = 8 pi^2 / 24`, `1 / s^2`.
const ROTATION_PRECISION: f64 = 2.84;

/// From one exponent to the next.
const NEXT: Stop = Stop { evaluations: 12, promised_decrease: 1e-2 };

/// How often objects are none of the kinds but ellipsoids, before anything is known: the share of the others together.
const OTHERS: f64 = 0.01;

/// Weight of what is known beforehand, and of what is known of the scene against the category, in objects.
const WEIGHT_OF_PRIOR: f64 = 1.0;

/// Degrees of freedom with which the noise of the scene is believed to be that of an object.
const FREEDOM_OF_SCENE: f64 = 8.0;

/// Above the score of the ellipsoid by so much the tried exponent shows that the object is one.
const HOPELESS: f64 = 2.0;

/// The exponents are followed until so many in a row fit worse than the best one.
const WORSE_IN_A_ROW: usize = 3;

/// Rounds in which shares and probabilities are adjusted to each other.
const ROUNDS: usize = 50;

fn kind_of(index: usize) -> BodyKind {
    match index {
        0 => BodyKind::Ellipsoid,
        CYLINDER => BodyKind::Cylinder,
        STEPS => BodyKind::Cuboid,
        step => BodyKind::Superellipsoid((2 * STEPS - step) as f64 / STEPS as f64),
    }
}

/// What the boxes of an object tell about its kind.
#[derive(Debug, Clone)]
struct Evidence {
    category: Option<usize>,
    /// Number of edges less that of the parameters.
    freedom: f64,
    /// For each kind the cost of the best fit and the logarithm of the determinant of its normal equations; `None` where it was not
    /// tried.
    fits: [Option<(f64, f64)>; KINDS],
}

impl Evidence {
    /// Logarithms of the evidences over that of an ellipsoid. The noise of an object is about that of the scene: its variance has an
    /// inverse gamma distribution around `variance`.
    fn log_odds(&self, variance: f64) -> [f64; KINDS] {
        let known = FREEDOM_OF_SCENE * variance;
        let log = |(cost, determinant): (f64, f64)| {
            -0.5 * ((self.freedom + FREEDOM_OF_SCENE) * (cost + known).ln() + determinant)
        };
        let ellipsoid = self.fits[0].map_or(0.0, log);
        self.fits.map(|fit| fit.map_or(f64::NEG_INFINITY, |fit| log(fit) - ellipsoid))
    }

    fn best_cost(&self) -> f64 {
        self.fits.iter().flatten().map(|(cost, _)| *cost).fold(f64::INFINITY, f64::min)
    }
}

/// The kinds of bodies of a scene's objects.
#[derive(Debug, Clone)]
pub(super) struct Kinds {
    of_each: Vec<BodyKind>,
    /// What the kind of another object is found from; `None` where it is given, or all are of one kind.
    others: Option<Others>,
}

#[derive(Debug, Clone)]
struct Others {
    shares: Shares,
    /// Weighted squared residual per degree of freedom.
    variance: f64,
    noise: NoiseLevels,
}

/// How often each kind occurs: expected numbers of objects.
#[derive(Debug, Clone, Default)]
struct Shares {
    all: [f64; KINDS],
    by_category: BTreeMap<Option<usize>, [f64; KINDS]>,
}

impl Shares {
    fn add(&mut self, category: Option<usize>, probabilities: &[f64; KINDS], sign: f64) {
        let of_category = self.by_category.entry(category).or_insert([0.0; KINDS]);
        for k in 0..KINDS {
            self.all[k] += sign * probabilities[k];
            of_category[k] += sign * probabilities[k];
        }
    }

    /// Probabilities of the kinds of another object.
    fn of(&self, category: Option<usize>) -> [f64; KINDS] {
        let before = |k: usize| match k {
            0 => 1.0 - OTHERS,
            STEPS | CYLINDER => OTHERS / 3.0,
            _ => OTHERS / 3.0 / (STEPS - 1) as f64,
        };
        let pooled = |counts: &[f64; KINDS], prior: [f64; KINDS]| {
            let total = counts.iter().sum::<f64>().max(0.0) + WEIGHT_OF_PRIOR;
            std::array::from_fn(|k| (counts[k].max(0.0) + WEIGHT_OF_PRIOR * prior[k]) / total)
        };
        let scene = pooled(&self.all, std::array::from_fn(before));
        self.by_category.get(&category).map_or(scene, |counts| pooled(counts, scene))
    }
}

impl Kinds {
    /// So many objects of one kind.
    pub(super) fn given(kind: BodyKind, count: usize) -> Self {
        Self { of_each: vec![kind; count.max(1)], others: None }
    }

    /// How often each kind occurs among objects that were fitted as ellipsoids, and the kind of each.
    pub(super) fn among(scene: &SceneFit, context: &MapContext) -> Self {
        // A body of the wrong kind errs alike in neighbouring views: what looks like correlation is what is looked for.
        let noise = scene.noise_of_independent_views(context);
        let fits = scene.fit_of_each();
        let ellipsoids = Self::given(BodyKind::Ellipsoid, fits.len());
        let all: Vec<Option<Evidence>> =
            map_indices(fits.len(), |k| fits[k].and_then(|fit| evidence(fit, &noise, context)));
        let told: Vec<&Evidence> = all.iter().flatten().collect();
        let freedom: f64 = told.iter().map(|evidence| evidence.freedom).sum();
        let variance = told.iter().map(|evidence| evidence.best_cost()).sum::<f64>() / freedom;
        if freedom <= 0.0 || !variance.is_finite() {
            return ellipsoids;
        }
        let log_odds: Vec<_> = told.iter().map(|evidence| evidence.log_odds(variance)).collect();
        let mut probabilities: Vec<[f64; KINDS]> = log_odds.iter().map(|odds| posterior(odds, &[1.0; KINDS])).collect();
        let mut shares = Shares::default();
        for (evidence, probabilities) in told.iter().zip(&probabilities) {
            shares.add(evidence.category, probabilities, 1.0);
        }
        for _ in 0..ROUNDS {
            for (k, evidence) in told.iter().enumerate() {
                // By what the others are.
                shares.add(evidence.category, &probabilities[k], -1.0);
                probabilities[k] = posterior(&log_odds[k], &shares.of(evidence.category));
                shares.add(evidence.category, &probabilities[k], 1.0);
            }
        }
        let mut found = probabilities.iter().map(most_probable);
        let mut kind = |evidence: &Option<Evidence>| kind_of(evidence.as_ref().and_then(|_| found.next()).unwrap_or(0));
        let of_each = all.iter().map(&mut kind).collect();
        Self { of_each, others: Some(Others { shares, variance, noise }) }
    }

    /// The kind of each object.
    pub(super) fn of_each(&self) -> &[BodyKind] {
        &self.of_each
    }

    /// The kind that all objects are of, where they are of one.
    pub(super) fn of_all(&self) -> Option<BodyKind> {
        let first = *self.of_each.first()?;
        self.of_each.iter().all(|kind| *kind == first).then_some(first)
    }

    /// The kind of another object of the scene, fitted as an ellipsoid.
    pub(super) fn of_other(&self, fit: &Fit, context: &MapContext) -> BodyKind {
        let Some(Others { shares, variance, noise }) = &self.others else { return BodyKind::Ellipsoid };
        let Some(evidence) = evidence(fit, noise, context) else { return BodyKind::Ellipsoid };
        kind_of(most_probable(&posterior(&evidence.log_odds(*variance), &shares.of(evidence.category))))
    }
}

/// Probabilities from logarithms of odds and what is probable beforehand.
fn posterior(log_odds: &[f64; KINDS], prior: &[f64; KINDS]) -> [f64; KINDS] {
    let logs: [f64; KINDS] = std::array::from_fn(|k| log_odds[k] + prior[k].ln());
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let odds = logs.map(|log| (log - largest).exp());
    let sum: f64 = odds.iter().sum();
    odds.map(|odds| odds / sum)
}

/// The first of the most probable ones: the roundest.
fn most_probable(probabilities: &[f64; KINDS]) -> usize {
    (0..KINDS).rev().max_by(|&a, &b| probabilities[a].total_cmp(&probabilities[b])).unwrap_or(0)
}

/// An object as oriented bodies see it, followed from exponent to exponent.
struct Search<'a> {
    objective: Objective<'a>,
    /// Ellipsoids with the axes of the fit, and with those turned by 45 degrees.
    first: Vec<OrientedModel>,
}

/// The end of a search with one form.
struct Found {
    cost: f64,
    log_determinant: f64,
    bodies: Vec<OrientedModel>,
}

impl Search<'_> {
    /// The fits of a form, from those with the last exponent and from the beginning: where edges lie is not found from a rounder
    /// body alone.
    fn with_form(&self, form: Form, last: &[OrientedModel]) -> Found {
        let mut found = Found { cost: f64::INFINITY, log_determinant: 0.0, bodies: Vec::new() };
        let starts = last.iter().chain(&self.first).flat_map(|body| {
            let semi_axes = body.semi_axes() * (form.relative_size() / body.form().relative_size());
            let start = OrientedModel::new(*body.center(), *body.axes(), semi_axes, form);
            if form == Form::Cylinder { along_each_axis(&start).to_vec() } else { vec![start] }
        });
        let mut ends: Vec<(f64, OrientedModel)> = Vec::new();
        for start in starts {
            let end = minimise(start, NEXT, |body| self.objective.linearise(body), BodyModel::retract);
            let Some((body, equations)) = end else { continue };
            if equations.cost < found.cost
                && let Some(determinant) = log_determinant_of(&equations)
            {
                (found.cost, found.log_determinant) = (equations.cost, determinant);
            }
            ends.push((equations.cost, body));
        }
        ends.sort_by(|a, b| a.0.total_cmp(&b.0));
        found.bodies = ends.into_iter().take(self.first.len()).map(|(_, body)| body).collect();
        found
    }
}

/// What the boxes of a fitted object tell about its kind; `None` where nothing can be told.
fn evidence(fit: &Fit, noise: &NoiseLevels, context: &MapContext) -> Option<Evidence> {
    let views = &fit.prepared.views;
    // Ellipses are outlines of ellipsoids only.
    if views.views.iter().any(|view| view.ellipse.is_some()) {
        return None;
    }
    let object = Prepared::in_frame(views.clone(), fit.prepared.measurements.frame, BodyKind::Superellipsoid(2.0), context);
    let freedom = object.measurements.edges.len() as f64 - PARAMETERS as f64;
    if freedom <= 0.0 {
        return None;
    }
    let round = Form::Exponent(2.0);
    let Model::Ellipsoid(ellipsoid) = &fit.body else { return None };
    let first = turned_axes(ellipsoid, &object.prior)
        .into_iter()
        .map(|(axes, semi_axes)| OrientedModel::new(*fit.body.center(), axes, semi_axes, round))
        .collect();
    let objective = Objective { ground: fit.ground, ..object.objective(noise, fit.outlier_scale) };
    let search = Search { objective, first };
    let mut evidence = Evidence { category: views.category_index, freedom, fits: [None; KINDS] };
    let mut take = |kind: usize, found: &Found| {
        evidence.fits[kind] = found.cost.is_finite().then_some((found.cost, found.log_determinant));
        let score = freedom * found.cost.ln() + found.log_determinant;
        if score.is_nan() { f64::INFINITY } else { score }
    };
    let mut found = search.with_form(round, &[]);
    let ellipsoid = take(0, &found);
    let tried = search.with_form(exponent_of(TRIED_STEP), &[]);
    if take(TRIED_STEP, &tried) > ellipsoid + HOPELESS {
        return Some(evidence);
    }
    let (mut best, mut worse) = (ellipsoid, 0);
    for step in 1..=STEPS {
        found = search.with_form(exponent_of(step), &found.bodies);
        let score = take(step, &found);
        worse = if score < best { 0 } else { worse + 1 };
        best = best.min(score);
        if worse == WORSE_IN_A_ROW {
            break;
        }
    }
    take(CYLINDER, &search.with_form(Form::Cylinder, &[]));
    Some(evidence)
}

fn exponent_of(step: usize) -> Form {
    Form::Exponent((2 * STEPS - step) as f64 / STEPS as f64)
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
