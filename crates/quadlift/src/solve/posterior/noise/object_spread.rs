//! Differences between objects: objects differ in how well a body of their kind fits them. The covariance of each is scaled by
//! the variance of its own residuals, depending on how much the objects of the scene differ ([`Spread`]), and by the cost of a
//! robust fit.

use nalgebra::SVector;

use super::common_errors::{CommonRow, SIGNIFICANT};
use super::groups::NoiseGroup;
use crate::optimize::normal_equations::NormalEquations;
use crate::solve::estimate::Matrix9;

/// Upper bound of the cost of robustness.
const MAX_COST: f64 = 1.5;

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
fn cost_of_robustness<'a>(rows: impl Iterator<Item = &'a CommonRow> + Clone) -> f64 {
    let sum = |of: fn(&CommonRow) -> f64| rows.clone().map(of).sum::<f64>();
    let squares = sum(|row| row.weight * row.residual * row.residual);
    let scores = sum(|row| (row.weight * row.residual).powi(2));
    let slope = sum(|row| row.slope);
    let ratio = rows.clone().count() as f64 * scores * sum(|row| row.weight) / (slope * slope * squares);
    // Not reliable for few residuals.
    if slope > 0.0 && ratio.is_finite() { ratio.clamp(1.0, MAX_COST) } else { 1.0 }
}

/// The covariance of a robust fit whose errors have `variance` times the variance that its weights take them to have; that of the
/// priors stays. Boxes and ellipses pay for their robust weights, and cues for theirs: wrong depths say nothing about edges.
pub(crate) fn scaled_covariance(rows: &[CommonRow], variance: f64, covariance: &Matrix9) -> Matrix9 {
    let is_cue = |row: &CommonRow| row.class >= NoiseGroup::Depth.common_class();
    let costs = [false, true].map(|cues| cost_of_robustness(rows.iter().filter(move |row| is_cue(row) == cues)));
    let added = rows.iter().fold(NormalEquations::zero(), |mut sum, row| {
        sum.add_row(0.0, &row.row, row.total_weight * (variance * costs[usize::from(is_cue(row))] - 1.0));
        sum
    });
    covariance + covariance * added.hessian() * covariance
}

#[cfg(test)]
mod tests {
    use super::super::test_rows::{dense, rows};
    use super::*;
    use crate::optimize::normal_equations::PARAMETERS;
    use nalgebra::DMatrix;

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
        let cost = cost_of_robustness(rows.iter());
        assert!((variance - 1.0).abs() < 0.15 && (1.1..1.35).contains(&cost), "{variance} {cost}");
    }
}
