//! Covariance: the posterior's curvature, corrected for heavy tails and for the object's own noise, and systematic errors as random
//! effects, whose levels are estimated from the scene by marginal likelihood.
//!
//! Errors that the views of an object share: a smooth field over the directions of the normals, relative to the support (detectors see
//! an object from one side alike); one error for each side of the box, in half sizes; a drift of the poses over the views.

use nalgebra::{SMatrix, SVector, Vector3};

use super::conditions::{Conditions, DOF};
use super::fit::{Workspace, linearize};
use super::log_evidence::ROTATION_PRECISION;
use super::object::Object;
use super::prior::prior;
use super::solid::{Family, Step};
use crate::geometry::linalg::{cholesky, invert_spd};
use crate::optimize::normal_equations::PARAMETERS;
use crate::parallel::map_indices;
use crate::solve::estimate::Matrix9;

/// Features of the field; sides of the box; orders of the drift along both image axes.
const FIELD: usize = 18;
const SIDES: usize = 4;
const DRIFT: usize = 6;
const EFFECTS: usize = FIELD + SIDES + DRIFT;

/// Distance of unit normals at which the correlation of the field is one half.
const REACH: f64 = 1.0;

/// Directions whose correlation with a chosen one is above this add no feature.
const SAME_DIRECTION: f64 = 0.98;

/// Order k of the drift falls as `k^-FALL`. A depth on an arc absorbs the first order, so that residuals show the others only: its level
/// follows from theirs. 2 and 3 are alike, 0 made deviations along the ray 1.5 to 2 times too small.
const FALL: f64 = 2.0;

/// Objects of the sample that sets the levels.
const MAX_SAMPLE: usize = 80;

/// Rounds over the levels.
const LEVEL_ROUNDS: usize = 2;

/// Medians of the levels' log-normal priors; their standard deviation in logarithm is 1, that of the noise factor .5.
const FIELD_SD: f64 = 0.04;
const SIDE_SD: f64 = 0.04;
const DRIFT_SD: f64 = 0.02;

/// Levels that are tried.
const FIELD_SDS: [f64; 14] = [2e-5, 1e-4, 0.0005, 0.002, 0.005, 0.01, 0.02, 0.035, 0.06, 0.1, 0.15, 0.22, 0.32, 0.45];
const SIDE_SDS: [f64; 10] = [2e-5, 1e-4, 0.0005, 0.002, 0.005, 0.01, 0.02, 0.035, 0.06, 0.1];
const DRIFT_SDS: [f64; 18] = [
    1e-5, 5e-5, 0.0002, 0.0003, 0.0005, 0.0008, 0.0013, 0.002, 0.003, 0.0045, 0.007, 0.01, 0.015, 0.02, 0.03, 0.04,
    0.06, 0.08,
];
const NOISE_FACTORS: [f64; 7] = [0.3, 0.45, 0.6, 0.75, 0.9, 1.1, 1.4];

/// Limits of the factors on the covariance.
const MAX_ROBUST: f64 = 1.5;
const MAX_CORRELATED: f64 = 6.0;
const MAX_SPREAD: f64 = 4.0;
const MIN_FACTOR: f64 = 0.3;

/// Rows that an object's nine parameters and its variance leave for the spread between objects.
const MIN_ROWS: f64 = 14.0;
const USED_ROWS: f64 = 8.0;

type Effects = SMatrix<f64, EFFECTS, EFFECTS>;
type EffectVector = SVector<f64, EFFECTS>;

/// Information of one object about systematic errors, with the body projected out.
struct Information {
    /// Normal matrix and gradient of the effects.
    normal: Effects,
    gradient: EffectVector,
    /// Change of the body by each effect.
    change: SMatrix<f64, PARAMETERS, EFFECTS>,
    /// Normal matrix of the measurements, and inverse of that with the priors.
    data: Matrix9,
    inverse: Matrix9,
    /// Weighted squared residuals of the rows, the cost that is left of them and the priors, and the rows' number.
    squares: f64,
    cost: f64,
    rows: f64,
    /// Parameters that the measurements determine.
    determined: f64,
    /// Sums of psi^2, psi' and w of Student's t.
    robust: [f64; 3],
}

impl Information {
    /// At the chosen body of an object; `None` where the normal equations are singular.
    fn new(object: &Object, conditions: &Conditions, work: &mut Workspace) -> Option<Self> {
        let (rows, body) = (&object.rows, &object.fit().body);
        let equations = linearize(rows, body, conditions, work);
        let prior = prior(body, conditions.shape_sd);
        // Where a body looks alike from all sides its rotation is open, as in the evidence.
        let mut hessian = equations.hessian;
        if body.family != Family::Ellipsoid {
            (3..6).for_each(|k| hessian[(k, k)] += ROTATION_PRECISION);
        }
        let inverse = invert_spd(&hessian)?;
        let mut normal = Effects::zeros();
        let mut gradient = EffectVector::zeros();
        let mut cross = SMatrix::<f64, PARAMETERS, EFFECTS>::zeros();
        let (mut squares, mut count, mut robust) = (0.0, 0.0, [0.0; 3]);
        let field = field_features(object);
        let frames = [0, rows.views.len() - 1].map(|index| rows.views[index].frame as f64);
        let center: [f64; 3] = body.center.into();
        for (index, view) in rows.views.iter().enumerate() {
            let at = &work.views[index];
            let inverse_depth = view.inverse_depth(&center);
            let support = body.support4(&view.normal, view.length).0;
            let sd = view.sd(conditions);
            let drift = drift_orders(view.frame as f64, frames);
            let of_edges: [EffectVector; 4] = std::array::from_fn(|edge| {
                let mut effect = EffectVector::zeros();
                for k in 0..FIELD {
                    effect[k] = field[4 * index + edge][k] * support.0[edge] * inverse_depth;
                }
                effect[FIELD + edge] = 1.0 / view.size_factor;
                // Both edges of an axis move together.
                let side = if edge < 2 { -1.0 } else { 1.0 };
                for (order, x) in drift.iter().enumerate() {
                    effect[FIELD + SIDES + 3 * (edge % 2) + order] = side * x;
                }
                effect
            });
            for edge in 0..4 {
                let residual = at.residual.0[edge];
                if view.is_reached(edge, residual) {
                    continue;
                }
                let root = at.weight.0[edge].sqrt();
                let scale = root / sd.0[edge];
                let [own, opposite] = view.pairing.of(edge);
                let effect = (of_edges[edge] * own + of_edges[(edge + 2) % 4] * opposite) * scale;
                let row = Step::from_fn(|k, _| work.slopes[index][k].0[edge]);
                let weighted = residual * root;
                gradient += effect * weighted;
                normal.ger(1.0, &effect, &effect, 1.0);
                cross.ger(1.0, &row, &effect, 1.0);
                squares += weighted * weighted;
                count += at.probability;
                let t = DOF + residual * residual;
                robust[0] += at.probability * ((DOF + 1.0) * residual / t).powi(2);
                robust[1] += at.probability * (DOF + 1.0) * (DOF - residual * residual) / (t * t);
                robust[2] += at.probability * (DOF + 1.0) / t;
            }
        }
        // Neighboring views count less. The body is projected out.
        let weight = conditions.view_weight;
        cross *= weight;
        let change = inverse * cross;
        let normal = normal * weight - cross.transpose() * change;
        let gradient = gradient * weight - change.transpose() * equations.gradient;
        let cost = squares * weight + prior.cost - equations.gradient.dot(&(inverse * equations.gradient));
        Some(Self {
            normal,
            gradient,
            change,
            data: equations.hessian - prior.hessian,
            inverse,
            squares: squares * weight,
            cost,
            rows: count * weight,
            determined: PARAMETERS as f64 - inverse.component_mul(&prior.hessian).sum(),
            robust: robust.map(|x| x * weight),
        })
    }

    /// Log marginal likelihood of levels, up to terms without them; 0 where it cannot be evaluated.
    fn log_likelihood(&self, levels: &Systematic) -> f64 {
        let sd = EffectVector::from_fn(|k, _| levels.sd_of(k) / levels.noise.sqrt());
        let scaled = self.normal.component_mul(&(sd * sd.transpose())) + Effects::identity();
        let Some(lower) = cholesky(&scaled) else { return 0.0 };
        let Some(y) = lower.solve_lower_triangular(&self.gradient.component_mul(&sd)) else { return 0.0 };
        let log_root = lower.diagonal().iter().map(|x| x.ln()).sum::<f64>();
        let explained = y.norm_squared() / levels.noise;
        let dof = (self.rows - self.determined).max(0.0);
        -log_root - 0.5 * (self.cost / levels.noise - explained) - 0.5 * dof * levels.noise.ln()
    }
}

/// Features of the field at the normals of all edges: `K_nm L^-T` with `L L^T = K_mm`, the farthest normals as inducing directions.
fn field_features(object: &Object) -> Vec<[f64; FIELD]> {
    let views = &object.rows.views;
    let normals: Vec<Vector3<f64>> =
        views.iter().flat_map(|view| (0..4).map(|edge| view.normal_of(edge).normalize())).collect();
    let kernel = |a: &Vector3<f64>, b: &Vector3<f64>| 1.0 / (1.0 + (a - b).norm() / REACH);
    let mut nearest = vec![f64::NEG_INFINITY; normals.len()];
    let mut features = vec![[0.0; FIELD]; normals.len()];
    let mut chosen: Vec<usize> = Vec::with_capacity(FIELD);
    let mut next = 0;
    while chosen.len() < FIELD.min(normals.len()) {
        for (k, normal) in normals.iter().enumerate() {
            let correlation = kernel(normal, &normals[next]);
            features[k][chosen.len()] = correlation;
            nearest[k] = nearest[k].max(correlation);
        }
        chosen.push(next);
        next = (0..normals.len()).min_by(|&a, &b| nearest[a].total_cmp(&nearest[b])).unwrap_or(0);
        if nearest[next] > SAME_DIRECTION {
            break;
        }
    }
    let count = chosen.len();
    let among = SMatrix::<f64, FIELD, FIELD>::from_fn(|i, j| match (i < count && j < count, i == j) {
        (true, same) => kernel(&normals[chosen[i]], &normals[chosen[j]]) + if same { 1e-6 } else { 0.0 },
        (false, same) => f64::from(same),
    });
    let Some(lower) = cholesky(&among) else { return vec![[0.0; FIELD]; normals.len()] };
    let solved = |feature: [f64; FIELD]| {
        lower.solve_lower_triangular(&SVector::from(feature)).map_or([0.0; FIELD], |solved| solved.into())
    };
    features.into_iter().map(solved).collect()
}

/// Legendre polynomials 1 to 3 over the frames of an object, falling with their order.
fn drift_orders(frame: f64, [first, last]: [f64; 2]) -> [f64; 3] {
    let z = if last > first { 2.0 * (frame - first) / (last - first) - 1.0 } else { 0.0 };
    [
        2f64.powf(FALL) * 3f64.sqrt() * z,
        5f64.sqrt() * (1.5 * z * z - 0.5),
        (2.0 / 3f64).powf(FALL) * 7f64.sqrt() * (2.5 * z * z * z - 1.5 * z),
    ]
}

/// Levels of systematic errors, and factors on the covariance, of a scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Systematic {
    pub field: f64,
    pub side: f64,
    pub drift: f64,
    /// Factor on the noise variance that is left for independent errors.
    pub noise: f64,
    /// Of Student's t: the variance of its estimate over the inverse curvature.
    pub robust: f64,
    /// Residual variance per degree of freedom, with the weight of neighboring views.
    pub correlated: f64,
    /// Relative variance of the residual variance between objects.
    pub spread: f64,
}

impl Systematic {
    fn sd_of(&self, effect: usize) -> f64 {
        match effect {
            0..FIELD => self.field,
            _ if effect < FIELD + SIDES => self.side,
            _ => self.drift,
        }
    }

    /// Without anything systematic.
    pub(super) const NONE: Self =
        Self { field: 0.0, side: 0.0, drift: 0.0, noise: 1.0, robust: 1.0, correlated: 1.0, spread: 0.0 };

    /// From an evenly spread sample of objects.
    pub(super) fn new(objects: &[Object], conditions: &Conditions) -> Self {
        let stride = objects.len().div_ceil(MAX_SAMPLE).max(1);
        let sample = map_indices(objects.len().div_ceil(stride), |k| {
            Information::new(&objects[k * stride], conditions, &mut Workspace::default())
        });
        let sample: Vec<Information> = sample.into_iter().flatten().collect();
        let mut levels = Self {
            field: FIELD_SD,
            side: SIDE_SD,
            drift: DRIFT_SD,
            noise: 1.0,
            robust: robust_factor(&sample),
            correlated: correlated_factor(&sample),
            spread: spread(&sample),
        };
        let of = |levels: &Self| {
            let each = map_indices(sample.len(), |k| sample[k].log_likelihood(levels));
            levels.log_prior() + each.iter().sum::<f64>()
        };
        let mut best = of(&levels);
        let mut try_all = |values: &[f64], set: fn(&mut Self, f64), levels: &mut Self| {
            for value in values {
                let mut tried = *levels;
                set(&mut tried, *value);
                let likelihood = of(&tried);
                if likelihood > best {
                    (best, *levels) = (likelihood, tried);
                }
            }
        };
        for _ in 0..LEVEL_ROUNDS {
            try_all(&FIELD_SDS, |levels, x| levels.field = x, &mut levels);
            try_all(&SIDE_SDS, |levels, x| levels.side = x, &mut levels);
            try_all(&NOISE_FACTORS, |levels, x| levels.noise = x, &mut levels);
            try_all(&DRIFT_SDS, |levels, x| levels.drift = x, &mut levels);
        }
        levels
    }

    fn log_prior(&self) -> f64 {
        let of = |level: f64, median: f64| (level / median).ln().powi(2);
        -0.5 * (of(self.field, FIELD_SD) + of(self.side, SIDE_SD) + of(self.drift, DRIFT_SD))
            - 2.0 * self.noise.ln().powi(2)
    }

    /// Covariance of the parameters of the chosen body of an object in its frame; `None` where it is singular.
    pub(super) fn covariance(&self, object: &Object, conditions: &Conditions, work: &mut Workspace) -> Option<Matrix9> {
        let information = Information::new(object, conditions, work)?;
        let rows = (information.rows - USED_ROWS).max(0.0);
        let own = (1.0 + 0.5 * self.spread * information.squares) / (1.0 + 0.5 * self.spread * rows);
        let factor = (self.robust * own * self.correlated).max(MIN_FACTOR);
        let sandwich = information.inverse * information.data * information.inverse;
        let variances = EffectVector::from_fn(|k, _| self.sd_of(k).powi(2));
        let systematic = information.change * SMatrix::from_diagonal(&variances) * information.change.transpose();
        Some(information.inverse + sandwich * (factor - 1.0) + systematic)
    }
}

/// Variance of the estimate of Student's t over the inverse of its curvature: `E psi^2 E w / (E psi')^2`.
fn robust_factor(sample: &[Information]) -> f64 {
    let sum = |k: usize| sample.iter().map(|information| information.robust[k]).sum::<f64>();
    let count = sample.iter().map(|information| information.rows).sum::<f64>().max(1e-12);
    let [squared, slope, weight] = [0, 1, 2].map(|k| sum(k) / count);
    (squared * weight / slope.max(0.1).powi(2)).clamp(1.0, MAX_ROBUST)
}

fn correlated_factor(sample: &[Information]) -> f64 {
    let squares: f64 = sample.iter().map(|information| information.squares).sum();
    let dof: f64 = sample.iter().map(|information| information.rows - information.determined).sum();
    let rows: f64 = sample.iter().map(|information| information.rows).sum();
    (squares / dof.max(0.12 * rows).max(1e-9)).clamp(1.0, MAX_CORRELATED)
}

/// Relative variance of the residual variances of objects, without that of their estimates.
fn spread(sample: &[Information]) -> f64 {
    let known: Vec<(f64, f64)> = sample
        .iter()
        .filter(|information| information.rows > MIN_ROWS)
        .map(|information| (information.squares / (information.rows - USED_ROWS), 2.0 / (information.rows - USED_ROWS)))
        .collect();
    let count = known.len() as f64;
    if known.len() < 4 {
        return 0.0;
    }
    let mean = known.iter().map(|(variance, _)| variance).sum::<f64>() / count;
    let squares = known.iter().map(|(variance, _)| variance * variance).sum::<f64>() / count;
    let of_estimates = known.iter().map(|(_, variance)| variance).sum::<f64>() / count;
    (squares / (mean * mean) - 1.0 - of_estimates).clamp(0.0, MAX_SPREAD)
}
