//! The noise level of a scene: variance components propose, the evidence of all objects decides.

use super::conditions::{Conditions, FIRST_WRONG_SHARE, MIN_NOISE, OCCLUDED_RATIO, WRONG_SHARE_VIEWS};
use super::fit::{Fit, Workspace, linearize, residuals};
use super::object::Object;
use crate::geometry::linalg::cholesky;
use crate::optimize::normal_equations::PARAMETERS;
use crate::parallel::map_indices;

/// Candidates among the levels of the objects differ by more than this in logarithm.
const MIN_LEVEL_GAP: f64 = 0.45;

/// Quantiles of the objects' levels that are candidates.
const QUANTILES: usize = 8;

/// The level of all objects with the most evidence, among their own levels from `lowest` on; nothing is fitted.
pub(super) fn best_level(objects: &[Object], conditions: &Conditions, lowest: f64) -> f64 {
    let mut own: Vec<f64> = objects.iter().map(|object| object.own_level).collect();
    own.sort_by(f64::total_cmp);
    let mut candidates = vec![conditions.noise[0]];
    for quantile in 0..=QUANTILES {
        let level = own[(own.len() - 1) * quantile / QUANTILES].max(lowest);
        if candidates.iter().all(|other| (level / other).ln().abs() > MIN_LEVEL_GAP) {
            candidates.push(level);
        }
    }
    if candidates.len() == 1 {
        return candidates[0];
    }
    let evidences = map_indices(objects.len(), |k| {
        let (object, mut work) = (&objects[k], Workspace::default());
        let at = |level: &f64| {
            let conditions = conditions.at(*level);
            let equations = linearize(&object.rows, &object.fit().body, &conditions, &mut work);
            let fit = Fit { equations, ..*object.fit() };
            object.log_evidence_of(&fit, &conditions, &mut work)
        };
        candidates.iter().map(at).collect::<Vec<f64>>()
    });
    let total = |index: usize| {
        evidences.iter().map(|of_object| of_object[index]).sum::<f64>() + conditions.at(candidates[index]).log_prior()
    };
    let mut best = (candidates[0], f64::NEG_INFINITY);
    for (index, level) in candidates.iter().enumerate() {
        let evidence = total(index);
        if evidence > best.1 {
            best = (*level, evidence);
        }
    }
    best.0
}

/// Sums over objects from which levels follow; index 1 is of occluded edges.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Weighted squared residuals, edges, and parameters that the edges determine.
    squares: [f64; 2],
    edges: [f64; 2],
    parameters: [f64; 2],
    /// Probabilities of views that they show their object; views; sum of the inverse number of views of the objects.
    right: f64,
    views: f64,
    inverse_views: f64,
    /// Products and squares of residuals of neighboring views, and their number.
    products: f64,
    neighbor_squares: f64,
    neighbors: f64,
}

impl Sums {
    fn add(&mut self, other: &Self) {
        for group in 0..2 {
            self.squares[group] += other.squares[group];
            self.edges[group] += other.edges[group];
            self.parameters[group] += other.parameters[group];
        }
        self.right += other.right;
        self.views += other.views;
        self.inverse_views += other.inverse_views;
        self.products += other.products;
        self.neighbor_squares += other.neighbor_squares;
        self.neighbors += other.neighbors;
    }

    fn of(object: &Object, conditions: &Conditions, work: &mut Workspace) -> Self {
        let (rows, fit) = (&object.rows, object.fit());
        let mut sums = Self { inverse_views: 1.0 / rows.views.len() as f64, ..Self::default() };
        let all = PARAMETERS as f64;
        let determined = fit.determined(conditions).unwrap_or(all).clamp(0.0, all);
        let occluded = occluded_leverage(object, fit, conditions, work).min(determined);
        sums.parameters = [determined - occluded, occluded];
        residuals(rows, &fit.body, conditions, work);
        for (index, view) in rows.views.iter().enumerate() {
            let at = work.views[index];
            for edge in (0..4).filter(|&edge| at.residual.0[edge] != 0.0) {
                let group = view.group(edge);
                sums.squares[group] += at.weight.0[edge] * at.residual.0[edge].powi(2);
                sums.edges[group] += at.probability;
            }
            sums.right += at.probability;
            sums.views += 1.0;
            if index > 0 && rows.views[index - 1].frame + 1 == view.frame {
                sums.add_neighbors(&at.residual.0, &work.views[index - 1].residual.0);
            }
        }
        sums
    }

    /// The errors of the same edges in neighboring frames; large ones are not noise.
    fn add_neighbors(&mut self, a: &[f64; 4], b: &[f64; 4]) {
        const LARGE: f64 = 4.0;
        for (a, b) in a.iter().zip(b) {
            if *a != 0.0 && *b != 0.0 && a.abs() < LARGE && b.abs() < LARGE {
                self.products += a * b;
                self.neighbor_squares += 0.5 * (a * a + b * b);
                self.neighbors += 1.0;
            }
        }
    }
}

/// Parameters that occluded edges determine: the sum of their leverages.
fn occluded_leverage(object: &Object, fit: &Fit, conditions: &Conditions, work: &mut Workspace) -> f64 {
    let rows = &object.rows;
    if rows.views.iter().all(|view| view.occluded == [false; 4]) {
        return 0.0;
    }
    linearize(rows, &fit.body, conditions, work);
    let Some(lower) = cholesky(&fit.equations.hessian) else { return 0.0 };
    let mut sum = 0.0;
    for (index, view) in rows.views.iter().enumerate() {
        for edge in (0..4).filter(|&edge| view.occluded[edge]) {
            let row = nalgebra::SVector::<f64, PARAMETERS>::from_fn(|k, _| work.slopes[index][k].0[edge]);
            sum += lower.solve_lower_triangular(&row).map_or(0.0, |x| x.norm_squared()) * conditions.view_weight;
        }
    }
    sum
}

/// Conditions from the residuals of the chosen bodies: variance components of both groups of edges, the share of wrong boxes, the weight
/// of neighboring views.
pub(super) fn proposed(objects: &[Object], conditions: &Conditions) -> Conditions {
    let each = map_indices(objects.len(), |k| Sums::of(&objects[k], conditions, &mut Workspace::default()));
    let mut sums = Sums::default();
    each.iter().for_each(|of_object| sums.add(of_object));
    let dof = [0, 1].map(|group| (sums.edges[group] - sums.parameters[group]).max(0.02 * sums.edges[group]).max(1e-9));
    let of = |group: usize| conditions.noise[group] * (sums.squares[group] / dof[group]).sqrt();
    let free = of(0);
    let correlation = if sums.neighbors > MIN_NEIGHBORS {
        (sums.products / sums.neighbor_squares.max(1e-12)).clamp(0.0, MAX_CORRELATION)
    } else {
        0.0
    };
    // An object is worth at least one view.
    let views = objects.len() as f64 / sums.inverse_views.max(1e-9);
    let view_weight = ((1.0 - correlation) / (1.0 + correlation)).max(1.0 / views);
    // The ratio of occluded edges is drawn to its prior by the uncertainty of both levels.
    let ratio = if sums.edges[1] > MIN_OCCLUDED {
        let known = 1.0 / (1.0 + 4.0 * (1.0 / dof[0].max(1.0) + 1.0 / dof[1]));
        let measured = (of(1) / free.max(1e-9)).max(0.2);
        (known * measured.ln() + (1.0 - known) * OCCLUDED_RATIO.ln()).exp().clamp(0.5, 8.0)
    } else {
        OCCLUDED_RATIO
    };
    let noise = free.clamp(MIN_NOISE, 1.0);
    let wrong = sums.views - sums.right + FIRST_WRONG_SHARE * WRONG_SHARE_VIEWS;
    Conditions {
        noise: [noise, noise * ratio],
        wrong_share: (wrong / (sums.views + WRONG_SHARE_VIEWS)).clamp(0.005, 0.5),
        view_weight,
        ..*conditions
    }
}

/// Pairs of edges in neighboring views from which on their correlation is estimated.
const MIN_NEIGHBORS: f64 = 16.0;
const MAX_CORRELATION: f64 = 0.9;

/// Occluded edges from which on their level is estimated.
const MIN_OCCLUDED: f64 = 4.0;
