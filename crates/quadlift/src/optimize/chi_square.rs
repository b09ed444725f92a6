//! Sums of squared residuals with different degrees of freedom, compared (Wilson and Hilferty 1931).

/// Quantile of the chi-square distribution over its degrees of freedom, `z` standard deviations of a Gaussian above the
/// median.
pub(crate) fn per_dof(dof: f64, z: f64) -> f64 {
    let spread = 2.0 / (9.0 * dof);
    (1.0 - spread + z * spread.sqrt()).max(0.1).powi(3)
}

/// The sum of `to` squared residuals that is as improbable as this sum of `from` of them; below the median in
/// proportion. Zero where there are no residuals.
pub(crate) fn as_of(sum: f64, from: usize, to: usize) -> f64 {
    if from == to {
        return sum;
    }
    if from == 0 || to == 0 {
        return 0.0;
    }
    let (from, to) = (from as f64, to as f64);
    let median = from * per_dof(from, 0.0);
    if sum <= median {
        return sum * to * per_dof(to, 0.0) / median;
    }
    let spread = 2.0 / (9.0 * from);
    let z = ((sum / from).cbrt() - (1.0 - spread)) / spread.sqrt();
    to * per_dof(to, z)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Probability that the sum of an even number of squared residuals is larger (a finite sum, exact).
    fn tail(sum: f64, dof: usize) -> f64 {
        let half = 0.5 * sum;
        let mut term = 1.0;
        let mut total = 0.0;
        for k in 0..dof / 2 {
            if k > 0 {
                term *= half / k as f64;
            }
            total += term;
        }
        total * (-half).exp()
    }

    #[test]
    fn sums_of_different_numbers_of_residuals_are_compared_by_their_tails() {
        for (from, to) in [(4, 16), (16, 4), (4, 6), (2, 4)] {
            for sum in [1.5, 2.5, 4.0].map(|over| over * from as f64) {
                let other = as_of(sum, from, to);
                let (expected, found) = (tail(sum, from), tail(other, to));
                assert!((found / expected).ln().abs() < 0.15 * expected.ln().abs().max(1.0), "{from} {to} {sum}");
            }
        }
    }

    #[test]
    fn it_is_monotonous_and_continuous_at_the_median_and_zero_for_nothing() {
        let sums: Vec<f64> = (0..400).map(|k| as_of(0.1 * f64::from(k), 16, 4)).collect();
        assert!(sums.windows(2).all(|w| w[1] > w[0] && w[1] - w[0] < 0.1), "{sums:?}");
        assert_eq!((as_of(0.0, 16, 4), as_of(7.0, 4, 4), as_of(0.0, 0, 4)), (0.0, 7.0, 0.0));
    }
}
