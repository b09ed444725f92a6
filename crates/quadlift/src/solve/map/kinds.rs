//! Objects of unknown kind: which kind of body each is, from what its boxes fit best and what the other objects are (E9,
//! ours).
//!
//! For each object every kind has an evidence (Laplace's approximation): how well its boxes fit, less what the freedom of
//! the body is worth. One object seldom tells. How often each kind occurs is therefore estimated from all objects, in each
//! category from those of the category as well, and an object takes the kind that is most probable given both. Where all objects are of
//! one kind they agree on it, and where they are not each goes its own way as far as its views tell.

use std::collections::BTreeMap;

use nalgebra::Vector3;

use super::super::options::BodyKind;
use super::MapContext;
use super::body_model::{BodyModel, Form, OrientedModel};
use super::first_fit::{TURNED_STARTS, best_of, descended};
use super::fit::Fit;
use super::model::Model;
use super::noise::{LARGEST_CORRELATION, NoiseLevels};
use super::normal_equations::{NormalEquations, PARAMETERS};
use super::object::Prepared;
use super::objective::Objective;
use super::scene_fit::SceneFit;
use super::starts::{along_each_axis, oriented_starts, turned_axes};
use crate::geometry::linalg::cholesky;
use crate::parallel::map_indices;

/// The exponents of superellipsoids that are tried.
const EXPONENTS: [f64; 3] = [1.75, 1.5, 1.25];

/// The kinds: ellipsoid, superellipsoids, cuboid, cylinder.
const KINDS: usize = EXPONENTS.len() + 3;
const CUBOID: usize = KINDS - 2;
const CYLINDER: usize = KINDS - 1;

/// The kind with which it is tried whether an object may be no ellipsoid: the boxes of any body with edges are fitted
/// better by this one as well.
const TRIED: usize = 1;

/// Starts of a superellipsoid that are turned.
const TURNED: usize = 2;

/// A cylinder has eight ways to name its axes where a cuboid has 24: twice the logarithm of the ratio.
const LOG_AXES_OF_CYLINDER: f64 = 2.197_224_577_336_219_6;

/// Precision of a Gaussian with the volume of the rotations that differ for a body with the symmetry of a cuboid with
/// equal edges: `(2 pi)^(3/2) s^3 = 8 pi^2 / 24`, `1 / s^2`.
const ROTATION_PRECISION: f64 = 2.84;

/// How often objects are none of the kinds but ellipsoids, before anything is known: the share of the others together.
const OTHERS: f64 = 0.01;

/// Weight of what is known beforehand, and of what is known of the scene against the category, in objects.
const WEIGHT_OF_PRIOR: f64 = 1.0;

/// Degrees of freedom with which the noise of the scene is believed to be that of an object.
const FREEDOM_OF_SCENE: f64 = 8.0;

/// By how much the score of the kind that is tried first may lie above that of the ellipsoid for the others to be tried:
/// where some objects may be no ellipsoids, and where those that were looked at are.
const LENIENT: f64 = 2.0;
const STRICT: f64 = -2.0;

/// Objects that are looked at first, evenly spread, and the share of other bodies below which they are ellipsoids.
const LOOKED_AT: usize = 8;
const FEW_OTHERS: f64 = 0.25;

/// Rounds in which shares and probabilities are adjusted to each other.
const ROUNDS: usize = 50;

fn kind_of(index: usize) -> BodyKind {
    match index {
        0 => BodyKind::Ellipsoid,
        CUBOID => BodyKind::Cuboid,
        CYLINDER => BodyKind::Cylinder,
        k => BodyKind::Superellipsoid(EXPONENTS[k - 1]),
    }
}

fn form_of(index: usize) -> Form {
    match index {
        0 => Form::Exponent(2.0),
        CUBOID => Form::Cuboid,
        CYLINDER => Form::Cylinder,
        k => Form::Exponent(EXPONENTS[k - 1]),
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
    /// For each kind the correlation of an edge's residuals in views that follow each other, times the number of pairs, and
    /// that number.
    neighbours: [[f64; 2]; KINDS],
}

impl Evidence {
    /// Logarithms of the evidences over that of an ellipsoid. The noise of an object is about that of the scene: its variance has an
    /// inverse gamma distribution around `variance`.
    fn log_odds(&self, variance: f64, independent: f64) -> [f64; KINDS] {
        let known = FREEDOM_OF_SCENE * variance;
        let log = |(cost, determinant): (f64, f64)| {
            -0.5 * (independent * (self.freedom + FREEDOM_OF_SCENE) * (cost + known).ln() + determinant)
        };
        let ellipsoid = self.fits[0].map_or(0.0, log);
        self.fits.map(|fit| fit.map_or(f64::NEG_INFINITY, |fit| log(fit) - ellipsoid))
    }

    /// The kind whose fit has the best score.
    fn best(&self) -> usize {
        let score = |k: usize| self.fits[k].map_or(f64::INFINITY, |(cost, det)| self.freedom * cost.ln() + det);
        (0..KINDS).min_by(|&a, &b| score(a).total_cmp(&score(b))).unwrap_or(0)
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
    /// Share of the residuals that count, see [`independent_share`].
    independent: f64,
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
            CUBOID | CYLINDER => OTHERS / 3.0,
            _ => OTHERS / 3.0 / EXPONENTS.len() as f64,
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
        let of = |k: usize, screen| fits[k].and_then(|fit: &Fit| evidence(fit, &noise, screen, context));
        let stride = fits.len().div_ceil(LOOKED_AT).max(1);
        let some = map_indices(fits.len().div_ceil(stride), |k| of(k * stride, LENIENT));
        let screen = if may_hold_others(&some) { LENIENT } else { STRICT };
        let all: Vec<Option<Evidence>> = map_indices(fits.len(), |k| match k % stride {
            0 => some[k / stride].clone(),
            _ => of(k, screen),
        });
        let told: Vec<&Evidence> = all.iter().flatten().collect();
        let freedom: f64 = told.iter().map(|evidence| evidence.freedom).sum();
        let variance = told.iter().map(|evidence| evidence.best_cost()).sum::<f64>() / freedom;
        if freedom <= 0.0 || !variance.is_finite() {
            return ellipsoids;
        }
        let independent = independent_share(&told);
        let log_odds: Vec<_> = told.iter().map(|evidence| evidence.log_odds(variance, independent)).collect();
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
        let mut found = probabilities
            .iter()
            .zip(&told)
            .map(|(probabilities, evidence)| most_probable(probabilities, evidence.freedom));
        let mut kind = |evidence: &Option<Evidence>| kind_of(evidence.as_ref().and_then(|_| found.next()).unwrap_or(0));
        let of_each = all.iter().map(&mut kind).collect();
        Self { of_each, others: Some(Others { shares, variance, independent, noise }) }
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
        let Some(Others { shares, variance, independent, noise }) = &self.others else { return BodyKind::Ellipsoid };
        let Some(evidence) = evidence(fit, noise, LENIENT, context) else { return BodyKind::Ellipsoid };
        let probabilities = posterior(&evidence.log_odds(*variance, *independent), &shares.of(evidence.category));
        kind_of(most_probable(&probabilities, evidence.freedom))
    }
}

/// Share of the residuals that count: those that remain with the best kind of each object are alike in neighbouring views
/// where no kind is quite right, and then they say less about which one is.
fn independent_share(told: &[&Evidence]) -> f64 {
    let mut sums = [0.0; 2];
    for evidence in told {
        let [sum, pairs] = evidence.neighbours[evidence.best()];
        sums[0] += sum;
        sums[1] += pairs;
    }
    let correlation = if sums[1] > 0.0 { (sums[0] / sums[1]).clamp(0.0, LARGEST_CORRELATION) } else { 0.0 };
    (1.0 - correlation) / (1.0 + correlation)
}

/// Whether some of these objects may be no ellipsoids, each judged by itself.
fn may_hold_others(some: &[Option<Evidence>]) -> bool {
    let odds = |evidence: &Evidence| {
        let variance = evidence.best_cost() / evidence.freedom;
        evidence.log_odds(variance, 1.0)[1..].iter().map(|log_odds| log_odds.exp()).sum::<f64>() / (KINDS - 1) as f64
    };
    let probable: f64 =
        some.iter().flatten().map(odds).map(|odds| if odds.is_finite() { odds / (1.0 + odds) } else { 1.0 }).sum();
    probable > FEW_OTHERS * some.iter().flatten().count() as f64
}

/// Probabilities from logarithms of odds and what is probable beforehand.
fn posterior(log_odds: &[f64; KINDS], prior: &[f64; KINDS]) -> [f64; KINDS] {
    let logs: [f64; KINDS] = std::array::from_fn(|k| log_odds[k] + prior[k].ln());
    let largest = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let odds = logs.map(|log| (log - largest).exp());
    let sum: f64 = odds.iter().sum();
    odds.map(|odds| odds / sum)
}

/// The most probable kind; of those that are about as probable the roundest.
fn most_probable(probabilities: &[f64; KINDS], freedom: f64) -> usize {
    let best = (0..KINDS).rev().max_by(|&a, &b| probabilities[a].total_cmp(&probabilities[b])).unwrap_or(0);
    let enough = probabilities[best] / freedom.sqrt();
    if best == CYLINDER { best } else { (0..best).find(|&k| probabilities[k] > enough).unwrap_or(best) }
}

/// What the boxes of a fitted object tell about its kind; `None` where nothing can be told.
fn evidence(fit: &Fit, noise: &NoiseLevels, screen: f64, context: &MapContext) -> Option<Evidence> {
    let views = &fit.prepared.views;
    let Model::Ellipsoid(ellipsoid) = &fit.body else { return None };
    // Ellipses are outlines of ellipsoids only.
    if views.views.iter().any(|view| view.ellipse.is_some()) {
        return None;
    }
    let frame = fit.prepared.measurements.frame;
    let object = Prepared::in_frame(views.clone(), frame, BodyKind::Superellipsoid(2.0), context);
    let freedom = object.measurements.edges.len() as f64 - PARAMETERS as f64;
    if freedom <= 0.0 {
        return None;
    }
    let objective = Objective { ground: fit.ground, ..object.objective(noise, fit.outlier_scale) };
    let mut evidence =
        Evidence { category: views.category_index, freedom, fits: [None; KINDS], neighbours: [[0.0; 2]; KINDS] };
    let mut take = |kind: usize, (body, equations): (Model, NormalEquations)| {
        let mut determinant = log_determinant_of(&equations)?;
        if kind == CYLINDER {
            determinant += LOG_AXES_OF_CYLINDER;
        }
        evidence.neighbours[kind] = objective.statistics(&body, &equations, true).neighbours_of_edges();
        evidence.fits[kind] = Some((equations.cost, determinant));
        Some(freedom * equations.cost.ln() + determinant)
    };
    // From the axes of the ellipsoid and from those turned by 45 degrees.
    let starts = |form: Form| -> Vec<OrientedModel> {
        let size = form.relative_size();
        let start = |(axes, sizes): (_, Vector3<f64>)| OrientedModel::new(*fit.body.center(), axes, sizes * size, form);
        turned_axes(ellipsoid, &object.prior).into_iter().map(start).collect()
    };
    let search = |starts, turned| best_of(&objective, descended(&objective, starts, turned));
    let round = starts(Form::Exponent(2.0)).into_iter().take(1).collect();
    let ellipsoid_score = take(0, search(round, 1)?)?;
    let tried = form_of(TRIED);
    let score = take(TRIED, search(starts(tried), 1)?)?;
    if score > ellipsoid_score + screen {
        return Some(evidence);
    }
    for kind in (1..CUBOID).filter(|kind| *kind != TRIED) {
        take(kind, search(starts(form_of(kind)), TURNED)?);
    }
    let any_way = oriented_starts(ellipsoid, Form::Cuboid, &object.prior, &[], object.seed(context));
    take(CUBOID, search(any_way, TURNED_STARTS)?);
    let lying = starts(Form::Cylinder).iter().flat_map(along_each_axis).collect();
    take(CYLINDER, search(lying, TURNED_STARTS)?);
    Some(evidence)
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
