//! Errors common to the views of an object (docs/method.md, section 12.4).
//!
//! The normal equations of a fit model the noise of single measurements, which averages out over many views. Other
//! errors do not: bodies are not exactly of their kind, detectors misplace the same edge of an object in the same way,
//! and poses drift. All of these correlate the errors of measurements from similar directions. The error of an edge is
//! therefore modelled as noise plus a random field on the sphere of directions (the normal of the edge's tangent plane,
//! in the world),
//!
//! `e_i = noise_i + reach_i f(u_i)`,  `cov(f(u), f(v)) = s^2 / (1 + |u - v| / L)`,
//!
//! in units of the noise; `reach` is how far the body reaches in the direction, in half sizes of the box. The kernel is a
//! mixture of exponentials, so it is positive definite and has no one scale. Ellipses have a field for each component,
//! over the directions of the cameras' axes.
//!
//! Objects also differ in how well a body of their kind fits them: the covariance of each is scaled by the variance of
//! its own residuals, depending on how much the objects of the scene differ ([`Spread`]).
//!
//! The variance `s^2` is estimated from products of residuals of different views, over all objects of the scene, with
//! the degrees of freedom used by the fits ([`CommonStatistics`]); if the products are not significant it is zero, and
//! the covariance is that of the noise. The field then adds `H^-1 J^T W K W J H^-1` to the covariance of a fit; the fit
//! itself does not change.

use crate::tuning::CORRELATION_SCALE;
use nalgebra::{SMatrix, SVector, Vector3};

use crate::optimize::normal_equations::{NormalEquations, PARAMETERS, Row};
use crate::solve::estimate::Matrix9;

/// Kinds of measurements with errors common to the views of an object: those of [`super::levels::NoiseGroup`], hidden
/// edges with the others.
pub(crate) const COMMON_CLASSES: usize = 7;

/// Rows of an object that are compared with each other, about: of more, evenly spread views are taken.
const MOST_ROWS: usize = 320;

/// Number of standard errors below which the variance of the field is set to zero.
const SIGNIFICANT: f64 = 2.0;

/// Upper bound of the cost of robustness.
const LARGEST_COST: f64 = 1.5;

/// One measurement of an object, at its fit.
#[derive(Debug, Clone)]
pub(crate) struct CommonRow {
    /// Index of its view.
    pub view: usize,
    /// Which kind of measurement it is.
    pub class: usize,
    /// Its component in the view: 0 for all edges, which are distinguished by their direction.
    pub component: usize,
    /// Unit vector on which the field is defined.
    pub direction: Vector3<f64>,
    /// Reach of the body in this direction, in half sizes of the detection.
    pub reach: f64,
    /// Whitened residual and its derivatives.
    pub residual: f64,
    pub row: Row,
    /// Robust weight.
    pub weight: f64,
    /// Derivative of the weighted residual by the residual (of the robust loss).
    pub slope: f64,
    /// Weight in the normal equations.
    pub total_weight: f64,
}

impl CommonRow {
    fn correlation(&self, other: &Self) -> f64 {
        if (self.class, self.component) != (other.class, other.component) {
            return 0.0;
        }
        CORRELATION_SCALE.get() / (CORRELATION_SCALE.get() + (self.direction - other.direction).norm())
    }
}

/// All rows of evenly spread views, about [`MOST_ROWS`] of them, and how many rows each stands for. Sums over pairs of
/// different rows grow with the square of that number, those over single rows with the number.
fn thinned(rows: &[CommonRow]) -> (Vec<&CommonRow>, f64) {
    let share = MOST_ROWS as f64 / rows.len().max(1) as f64;
    let keeps = |row: &&CommonRow| (row.view as f64 * share).floor() < ((row.view + 1) as f64 * share).floor();
    let kept: Vec<&CommonRow> = rows.iter().filter(|row| share >= 1.0 || keeps(row)).collect();
    let each = rows.len() as f64 / kept.len().max(1) as f64;
    (kept, each)
}

/// Statistics of the residuals of a scene about the field of each kind of measurement.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct CommonStatistics([ClassStatistics; COMMON_CLASSES]);

/// Two sums over residuals, their expectations, and the variance of the second.
#[derive(Debug, Clone, Copy, Default)]
struct ClassStatistics {
    /// Weighted squares; products of different views, weighted with the correlation of the field.
    sums: [f64; 2],
    /// Expected sums for unit variance of the noise, and of the field.
    of_noise: [f64; 2],
    of_field: [f64; 2],
    /// Variance of the second sum under independent noise of unit variance.
    scatter: f64,
}

impl CommonStatistics {
    /// The sums of one object; `covariance` is the inverse of its normal equations.
    ///
    /// Residuals are `R e` with the errors `e` and `R = I - J H^-1 J^T W`, so that `E[r^T A r] = tr(A R cov(e) R^T)`.
    pub(crate) fn of_object(rows: &[CommonRow], covariance: &Matrix9) -> Self {
        let (rows, each) = thinned(rows);
        // J, and G^T = W J H^-1 with the weights of all rows.
        let jacobian: Vec<SVector<f64, PARAMETERS>> = rows.iter().map(|row| SVector::from(row.row)).collect();
        let gain: Vec<SVector<f64, PARAMETERS>> =
            rows.iter().zip(&jacobian).map(|(row, j)| covariance * j * (row.total_weight * each)).collect();
        let noise_gain = gain.iter().fold(Matrix9::zeros(), |sum, g| sum + g * g.transpose() / each);
        let mut statistics = Self::default();
        for (class, sums) in statistics.0.iter_mut().enumerate() {
            let members: Vec<usize> = (0..rows.len()).filter(|&i| rows[i].class == class).collect();
            if members.is_empty() {
                continue;
            }
            // A J and K G^T, row by row; A holds products of different views, relative to the reach.
            let mut pair_jacobian = vec![SVector::<f64, PARAMETERS>::zeros(); members.len()];
            let mut field_gain = vec![SVector::<f64, PARAMETERS>::zeros(); members.len()];
            let mut pair_field = 0.0;
            for (a, &i) in members.iter().enumerate() {
                field_gain[a] += gain[i] * (rows[i].reach * rows[i].reach / each);
                let scale_i = rows[i].weight.sqrt() / rows[i].reach;
                for (b, &j) in members.iter().enumerate().take(a) {
                    let correlation = rows[i].correlation(rows[j]);
                    let field = correlation * rows[i].reach * rows[j].reach;
                    field_gain[a] += gain[j] * field;
                    field_gain[b] += gain[i] * field;
                    if rows[i].view == rows[j].view {
                        continue;
                    }
                    let pair = correlation * scale_i * rows[j].weight.sqrt() / rows[j].reach;
                    pair_jacobian[a] += jacobian[j] * pair;
                    pair_jacobian[b] += jacobian[i] * pair;
                    pair_field += 2.0 * pair * field;
                    sums.sums[1] += 2.0 * pair * rows[i].residual * rows[j].residual;
                    sums.scatter += 4.0 * pair * pair;
                }
            }
            let mut quadratic = Matrix9::zeros();
            let mut field = Matrix9::zeros();
            let (mut absorbed, mut total_weight) = (0.0, 0.0);
            for (a, &i) in members.iter().enumerate() {
                quadratic += jacobian[i] * pair_jacobian[a].transpose();
                field += gain[i] * field_gain[a].transpose();
            }
            for (a, &i) in members.iter().enumerate() {
                let (row, j, g) = (rows[i], &jacobian[i], &gain[i]);
                sums.sums[0] += row.weight * row.residual * row.residual;
                sums.of_noise[0] += row.weight * (1.0 - 2.0 * j.dot(g) / each + j.dot(&(noise_gain * j)));
                sums.of_field[0] +=
                    row.weight * (row.reach * row.reach - 2.0 * j.dot(&field_gain[a]) + j.dot(&(field * j)));
                sums.of_noise[1] -= 2.0 * pair_jacobian[a].dot(g) / each;
                sums.of_field[1] -= 2.0 * pair_jacobian[a].dot(&field_gain[a]);
                absorbed += pair_jacobian[a].dot(&(covariance * pair_jacobian[a]));
                total_weight += row.total_weight;
            }
            // tr (A R R^T)^2 with R R^T = I - w J H^-1 J^T, which holds for equal weights w.
            let weight = total_weight / members.len() as f64;
            let seen = covariance * quadratic * weight;
            sums.scatter += 2.0 * ((seen * seen).trace() - 2.0 * weight * absorbed);
            sums.of_noise[1] += (quadratic * noise_gain).trace();
            sums.of_field[1] += pair_field + (quadratic * field).trace();
        }
        statistics
    }

    /// Adds another object's sums.
    pub(crate) fn merge(&mut self, other: &Self) {
        for (sums, more) in self.0.iter_mut().zip(&other.0) {
            for k in 0..2 {
                sums.sums[k] += more.sums[k];
                sums.of_noise[k] += more.of_noise[k];
                sums.of_field[k] += more.of_field[k];
            }
            sums.scatter += more.scatter;
        }
    }

    /// Standard deviation of the field in units of the noise, for each kind of measurement. Zero if not significant.
    pub(crate) fn deviations(&self) -> [f64; COMMON_CLASSES] {
        self.0.map(|sums| sums.variance().map_or(0.0, f64::sqrt))
    }
}

impl ClassStatistics {
    fn variance(&self) -> Option<f64> {
        // Two equations: sums = of_noise * noise + of_field * field.
        let [[a, b], [c, d]] = [[self.of_noise[0], self.of_field[0]], [self.of_noise[1], self.of_field[1]]];
        let determinant = a * d - b * c;
        if a <= 0.0 || determinant <= 1e-9 * (a * d).abs() {
            return None;
        }
        let field = (a * self.sums[1] - c * self.sums[0]) / determinant;
        // Were there noise only, it would have this variance.
        let deviation = self.scatter.max(0.0).sqrt() * self.sums[0] / determinant;
        // Fades in, so that the result depends continuously on the evidence.
        let threshold = SIGNIFICANT * deviation / field;
        (field > 0.0 && threshold < 1.0).then_some(field * (1.0 - threshold * threshold))
    }
}

/// The contribution of the field to the covariance of a fit, whose inverse normal equations are `covariance`.
pub(crate) fn added_covariance(
    rows: &[CommonRow],
    deviations: &[f64; COMMON_CLASSES],
    covariance: &Matrix9,
) -> Matrix9 {
    let (rows, each) = thinned(rows);
    let scaled: Vec<SVector<f64, PARAMETERS>> = rows
        .iter()
        .map(|row| SVector::from(row.row) * (row.total_weight * row.reach * deviations[row.class] * each))
        .collect();
    let mut middle = SMatrix::<f64, PARAMETERS, PARAMETERS>::zeros();
    for (i, row) in rows.iter().enumerate() {
        // Half of the diagonal: the sum is made symmetric in the end.
        let mut sum = scaled[i] * (0.5 / each);
        for (other, scaled) in rows[..i].iter().zip(&scaled) {
            sum += scaled * row.correlation(other);
        }
        middle += scaled[i] * sum.transpose();
    }
    covariance * (middle + middle.transpose()) * covariance
}

/// How well one object agrees with the noise levels of the scene: its sum of weighted squared residuals, and the degrees
/// of freedom that are left in them.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct ObjectAgreement {
    squares: f64,
    dof: f64,
}

impl ObjectAgreement {
    /// Of an object at its fit; `covariance` is the inverse of its normal equations.
    pub(crate) fn new(rows: &[CommonRow], covariance: &Matrix9) -> Self {
        let squared_weights = rows.iter().fold(NormalEquations::zero(), |mut sum, row| {
            sum.add_row(0.0, &row.row, row.total_weight * row.total_weight);
            sum
        });
        let noise_gain = covariance * squared_weights.hessian() * covariance;
        rows.iter().fold(Self::default(), |sum, row| {
            let j = SVector::from(row.row);
            let left = 1.0 - 2.0 * row.total_weight * j.dot(&(covariance * j)) + j.dot(&(noise_gain * j));
            Self { squares: sum.squares + row.weight * row.residual * row.residual, dof: sum.dof + row.weight * left }
        })
    }

    /// The variance of the object's errors in units of the scene's: its own variance, shrunk towards 1 if objects are
    /// similar or its residuals are few.
    pub(crate) fn relative_variance(&self, spread: Spread) -> f64 {
        if spread.variance <= 0.0 || self.dof <= 0.0 || spread.level <= 0.0 {
            return 1.0;
        }
        let own = self.squares / (self.dof * spread.level);
        let evidence = 0.5 * spread.variance * self.dof;
        (1.0 + evidence * own) / (1.0 + evidence)
    }
}

/// How much the variance of errors differs between the objects of a scene.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Spread {
    /// Mean squared whitened residual.
    pub level: f64,
    /// Relative variance of that of an object.
    pub variance: f64,
}

impl Spread {
    /// By the method of moments; zero if the objects do not differ significantly.
    pub(crate) fn of(objects: &[ObjectAgreement]) -> Self {
        let counted = || objects.iter().filter(|object| object.dof > 1.0);
        let (squares, dof) = counted().fold((0.0, 0.0), |(a, b), object| (a + object.squares, b + object.dof));
        if dof <= 0.0 || squares <= 0.0 {
            return Self::default();
        }
        let level = squares / dof;
        // Each with the inverse variance that it has when all objects are alike: 2 / freedom.
        let excess = counted().map(|object| {
            let off = object.squares / (object.dof * level) - 1.0;
            object.dof * off * off - 2.0
        });
        let variance = excess.sum::<f64>() / dof;
        let deviation = (8.0 * counted().count() as f64).sqrt() / dof;
        let threshold = SIGNIFICANT * deviation / variance;
        let clear = variance > 0.0 && threshold < 1.0;
        Self { level, variance: if clear { variance * (1.0 - threshold * threshold) } else { 0.0 } }
    }
}

/// Variance of a robust fit relative to what its weights `w` promise (Huber's sandwich, `E[psi^2] / E[psi']^2` against
/// `E[w r^2] / E[w]`, with `psi = w r`): one without robust weights.
pub(crate) fn cost_of_robustness(rows: &[CommonRow]) -> f64 {
    let sum = |of: fn(&CommonRow) -> f64| rows.iter().map(of).sum::<f64>();
    let squares = sum(|row| row.weight * row.residual * row.residual);
    let scores = sum(|row| (row.weight * row.residual).powi(2));
    let slope = sum(|row| row.slope);
    let ratio = rows.len() as f64 * scores * sum(|row| row.weight) / (slope * slope * squares);
    // Not reliable for few residuals.
    if slope > 0.0 && ratio.is_finite() { ratio.clamp(1.0, LARGEST_COST) } else { 1.0 }
}

/// The covariance of a fit whose errors have `factor` times the variance that its weights take them to have; that of the
/// priors stays.
pub(crate) fn scaled_covariance(rows: &[CommonRow], factor: f64, covariance: &Matrix9) -> Matrix9 {
    let of_data = rows.iter().fold(NormalEquations::zero(), |mut sum, row| {
        sum.add_row(0.0, &row.row, row.total_weight);
        sum
    });
    covariance + covariance * of_data.hessian() * covariance * (factor - 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};

    /// Rows without a pattern, of edges in several views.
    fn rows(views: usize) -> Vec<CommonRow> {
        let number = |seed: f64| (seed * 12.9898).sin() * 43758.5453 % 1.0;
        let mut rows = Vec::new();
        for view in 0..views {
            for side in 0..4 {
                let seed = (4 * view + side) as f64;
                let direction = Vector3::from_fn(|k, _| number(seed + 0.31 * k as f64)).normalize();
                rows.push(CommonRow {
                    view,
                    class: 0,
                    component: 0,
                    direction,
                    reach: 1.0 + 0.3 * number(seed + 5.0),
                    residual: 2.0 * number(seed + 7.0),
                    row: std::array::from_fn(|k| number(seed + 9.0 + 1.7 * k as f64)),
                    weight: 1.0,
                    slope: 1.0,
                    total_weight: 1.0,
                });
            }
        }
        rows
    }

    fn dense(rows: &[CommonRow]) -> (DMatrix<f64>, DMatrix<f64>, DMatrix<f64>, Matrix9) {
        let n = rows.len();
        let jacobian = DMatrix::from_fn(n, PARAMETERS, |i, k| rows[i].row[k]);
        let correlation = DMatrix::from_fn(n, n, |i, j| {
            CORRELATION_SCALE.get() / (CORRELATION_SCALE.get() + (rows[i].direction - rows[j].direction).norm())
        });
        let field = DMatrix::from_fn(n, n, |i, j| correlation[(i, j)] * rows[i].reach * rows[j].reach);
        let pairs = DMatrix::from_fn(n, n, |i, j| {
            let other = rows[i].view != rows[j].view;
            if other { correlation[(i, j)] / (rows[i].reach * rows[j].reach) } else { 0.0 }
        });
        let hessian = jacobian.transpose() * &jacobian + DMatrix::identity(PARAMETERS, PARAMETERS) * 0.1;
        let covariance = Matrix9::from_iterator(hessian.try_inverse().unwrap().iter().copied());
        (jacobian, field, pairs, covariance)
    }

    #[test]
    fn sums_are_those_of_dense_matrices() {
        let rows = rows(8);
        let (jacobian, field, pairs, covariance) = dense(&rows);
        let n = rows.len();
        let covariance_dense = DMatrix::from_iterator(PARAMETERS, PARAMETERS, covariance.iter().copied());
        let left = DMatrix::identity(n, n) - &jacobian * &covariance_dense * jacobian.transpose();
        let residuals = DVector::from_fn(n, |i, _| rows[i].residual);
        let sums = CommonStatistics::of_object(&rows, &covariance).0[0];
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9 * (1.0 + b.abs()), "{a} {b}");
        close(sums.sums[0], residuals.norm_squared());
        close(sums.sums[1], (residuals.transpose() * &pairs * &residuals)[0]);
        let of = |errors: &DMatrix<f64>| &left * errors * left.transpose();
        close(sums.of_noise[0], of(&DMatrix::identity(n, n)).trace());
        close(sums.of_field[0], of(&field).trace());
        close(sums.of_noise[1], (&pairs * of(&DMatrix::identity(n, n))).trace());
        close(sums.of_field[1], (&pairs * of(&field)).trace());
    }

    #[test]
    fn the_field_adds_what_dense_matrices_say() {
        let rows = rows(6);
        let (jacobian, field, _, covariance) = dense(&rows);
        let covariance_dense = DMatrix::from_iterator(PARAMETERS, PARAMETERS, covariance.iter().copied());
        let gain = &covariance_dense * jacobian.transpose();
        let expected = &gain * field * gain.transpose() * 4.0;
        let mut deviations = [0.0; COMMON_CLASSES];
        deviations[0] = 2.0;
        let added = added_covariance(&rows, &deviations, &covariance);
        for i in 0..PARAMETERS {
            for j in 0..PARAMETERS {
                assert!((added[(i, j)] - expected[(i, j)]).abs() < 1e-10 * (1.0 + expected[(i, j)].abs()));
            }
        }
    }

    #[test]
    fn agreement_counts_what_the_fit_has_left() {
        let rows = rows(8);
        let (jacobian, _, _, covariance) = dense(&rows);
        let covariance_dense = DMatrix::from_iterator(PARAMETERS, PARAMETERS, covariance.iter().copied());
        let n = rows.len();
        let left = DMatrix::identity(n, n) - &jacobian * &covariance_dense * jacobian.transpose();
        let agreement = ObjectAgreement::new(&rows, &covariance);
        assert!((agreement.dof - (&left * left.transpose()).trace()).abs() < 1e-9);
        let scaled = scaled_covariance(&rows, 3.0, &covariance);
        let expected =
            covariance_dense.clone() + &covariance_dense * jacobian.transpose() * &jacobian * &covariance_dense * 2.0;
        assert!((0..81).all(|k| (scaled[k] - expected[k]).abs() < 1e-9 * (1.0 + expected[k].abs())));
    }

    #[test]
    fn objects_that_are_alike_are_left_alone() {
        let object = |squares: f64| ObjectAgreement { squares, dof: 60.0 };
        let alike: Vec<_> = (0..40).map(|k| object(60.0 + 10.0 * f64::sin(f64::from(k)))).collect();
        assert_eq!(Spread::of(&alike).variance, 0.0);
        assert_eq!(alike[0].relative_variance(Spread::of(&alike)), 1.0);
        let different: Vec<_> = (0..40).map(|k| object(if k % 2 == 0 { 20.0 } else { 100.0 })).collect();
        let spread = Spread::of(&different);
        // Relative squares 1/3 and 5/3: variance 4/9, less 2/60 for the noise of 60 degrees of freedom.
        assert!((spread.level - 1.0).abs() < 1e-12 && (0.38..0.42).contains(&spread.variance), "{spread:?}");
        assert!((0.33..0.5).contains(&different[0].relative_variance(spread)));
        assert!((1.5..1.67).contains(&different[1].relative_variance(spread)));
        assert_eq!(Spread::of(&[]), Spread::default());
    }

    #[test]
    fn robust_weights_cost_what_the_normal_distribution_says() {
        // Normal residuals of unit variance under Student's t with 9 degrees of freedom: 1.21 (numerically).
        let count = 20_000;
        let quantile = |k: usize| {
            // By the sum of many uniform numbers without a pattern: nearly normal.
            (0..12)
                .map(|i| ((k * 12 + i) as f64 * 0.618_033_988_75 + (i as f64).sqrt() * k as f64).fract())
                .sum::<f64>()
                - 6.0
        };
        let template = rows(1).remove(0);
        let rows: Vec<CommonRow> = (0..count)
            .map(|k| {
                let residual = quantile(k);
                let squared = residual * residual;
                let weight = 10.0 / (9.0 + squared);
                CommonRow { residual, weight, slope: weight * (9.0 - squared) / (9.0 + squared), ..template.clone() }
            })
            .collect();
        let variance = rows.iter().map(|row| row.residual * row.residual).sum::<f64>() / count as f64;
        let cost = cost_of_robustness(&rows);
        assert!((variance - 1.0).abs() < 0.15 && (1.1..1.35).contains(&cost), "{variance} {cost}");
    }
}
