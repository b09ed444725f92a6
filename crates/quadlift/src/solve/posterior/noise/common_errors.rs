//! Errors common to the views of an object (docs/method.md, section 12.4).
//!
//! The normal equations of a fit model the noise of single measurements, which averages out over many views. Other
//! errors do not: bodies are not exactly of their kind, detectors misplace the same edge of an object in the same way,
//! and poses drift. All of these correlate the errors of measurements from similar directions. The error of an edge is
//! therefore modeled as noise plus a random field on the sphere of directions (the normal of the edge's tangent plane,
//! in the world),
//!
//! `e_i = noise_i + reach_i f(u_i)`,  `cov(f(u), f(v)) = s^2 / (1 + |u - v| / L)`,
//!
//! in units of the noise; `reach` is how far the body reaches in the direction, in half sizes of the box. The kernel is a
//! mixture of exponentials, so it is positive definite and has no one scale. Ellipses have a field for each component,
//! over the directions of the cameras' axes.
//!
//! The variance `s^2` is estimated from products of residuals of different views, over all objects of the scene, with
//! the degrees of freedom used by the fits ([`CommonStatistics`]); if the products are not significant it is zero, and
//! the covariance is that of the noise. The field then adds `H^-1 J^T W K W J H^-1` to the covariance of a fit; the fit
//! itself does not change.

use crate::tuning::CORRELATION_SCALE;
use nalgebra::{SMatrix, SVector, Vector3};

use crate::optimize::normal_equations::{PARAMETERS, Row};
use crate::solve::estimate::Matrix9;

/// Kinds of measurements with errors common to the views of an object: those of [`super::groups::NoiseGroup`], hidden
/// edges with the others.
pub(crate) const COMMON_CLASSES: usize = 12;

/// Rows of an object that are compared with each other, about: of more, evenly spread views are taken.
const MAX_ROWS: usize = 320;

/// Number of standard errors below which the variance of the field is set to zero.
pub(super) const SIGNIFICANT: f64 = 2.0;

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

/// All rows of evenly spread views, about [`MAX_ROWS`] of them, and how many rows each stands for. Sums over pairs of
/// different rows grow with the square of that number, those over single rows with the number.
fn thinned(rows: &[CommonRow]) -> (Vec<&CommonRow>, f64) {
    let share = MAX_ROWS as f64 / rows.len().max(1) as f64;
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

#[cfg(test)]
mod tests {
    use super::super::test_rows::{dense, rows};
    use super::*;
    use nalgebra::{DMatrix, DVector};

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
        // Variance of a quadratic form of normal errors, `2 tr (A cov)^2`, where the residuals have the covariance `I - J H^-1 J^T`.
        let product = &pairs * &left;
        close(sums.scatter, 2.0 * (&product * &product).trace());
    }

    #[test]
    fn a_field_counts_by_as_much_as_it_exceeds_two_standard_errors() {
        // Sums of noise with the variance 4 and of a field, of which each sum has its own share.
        let deviation = |field: f64| {
            let (of_noise, of_field) = ([100.0, -10.0], [80.0, 42.0]);
            let sums = [0, 1].map(|k| 4.0 * of_noise[k] + field * of_field[k]);
            let class = ClassStatistics { sums, of_noise, of_field, scatter: 25.0 };
            CommonStatistics([class; COMMON_CLASSES]).deviations()[3]
        };
        // Were there noise only, it would have the variance of the first sum, and the second a scatter of 5 times that. An error of the
        // second sum by one is one of the field by 100 / (100 * 42 + 10 * 80).
        let error = |field: f64| 5.0 * (400.0 + 80.0 * field) / 5000.0;
        for field in [2.0, 6.0, 20.0] {
            let threshold = 2.0 * error(field) / field;
            let expected = if threshold < 1.0 { (field * (1.0 - threshold * threshold)).sqrt() } else { 0.0 };
            assert!((deviation(field) - expected).abs() < 1e-9, "{field}: {} {expected}", deviation(field));
        }
        // `field = 2 error(field)` is where it vanishes: 0.8 / 0.84.
        assert!(deviation(0.94) == 0.0 && deviation(0.97) > 0.0);
        assert_eq!(deviation(-1.0), 0.0);
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
}
