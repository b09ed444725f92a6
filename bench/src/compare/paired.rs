//! Paired differences and their standard error.

/// Means of A and B over pairs, and of the differences B - A.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Paired {
    /// Number of pairs.
    pub count: usize,
    /// Mean of A.
    pub a: f64,
    /// Mean of B.
    pub b: f64,
    /// Mean of B - A.
    pub difference: f64,
    /// Standard error of that mean; absent for a single pair.
    pub standard_error: Option<f64>,
}

impl Paired {
    /// Of pairs `[a, b]`; `None` if there are none.
    pub(super) fn of(pairs: &[[f64; 2]]) -> Option<Self> {
        let count = pairs.len();
        let mean = |of: &dyn Fn(&[f64; 2]) -> f64| pairs.iter().map(of).sum::<f64>() / count as f64;
        let difference = mean(&|[a, b]| b - a);
        let squares = mean(&|[a, b]| (b - a - difference).powi(2));
        // The unbiased variance, n / (n - 1) times the mean square, over n.
        let standard_error = (count > 1).then(|| (squares / (count - 1) as f64).sqrt());
        let all = Self { count, a: mean(&|pair| pair[0]), b: mean(&|pair| pair[1]), difference, standard_error };
        (count > 0).then_some(all)
    }

    /// Whether the difference exceeds two standard errors.
    pub(super) fn is_marked(&self) -> bool {
        self.standard_error.is_some_and(|error| self.difference.abs() > 2.0 * error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_standard_error_are_those_of_a_hand_calculation() {
        // Differences 1, 3, 5: mean 3, variance (4 + 0 + 4) / 2 = 4, standard error 2 / sqrt(3).
        let paired = Paired::of(&[[0.0, 1.0], [10.0, 13.0], [2.0, 7.0]]).unwrap();
        assert_eq!((paired.count, paired.a, paired.b, paired.difference), (3, 4.0, 7.0, 3.0));
        assert!((paired.standard_error.unwrap() - 2.0 / 3.0_f64.sqrt()).abs() < 1e-12);
        assert!(paired.is_marked(), "3 exceeds 2.31");
    }

    #[test]
    fn what_both_share_cancels() {
        // Objects from 0 to 1000, all of them better by 0.1: no error but rounding.
        let pairs: Vec<[f64; 2]> = (0..11).map(|k| 100.0 * f64::from(k)).map(|x| [x, x + 0.1]).collect();
        let paired = Paired::of(&pairs).unwrap();
        assert!((paired.difference - 0.1).abs() < 1e-12 && paired.standard_error.unwrap() < 1e-12);
        assert!(paired.is_marked());
    }

    #[test]
    fn differences_within_two_standard_errors_are_not_marked() {
        // Differences 3, -1, 1, 1: mean 1, variance (4 + 4) / 3, standard error sqrt(2 / 3) = 0.816; two are 1.63.
        let paired = Paired::of(&[[0.0, 3.0], [0.0, -1.0], [0.0, 1.0], [0.0, 1.0]]).unwrap();
        assert!((paired.standard_error.unwrap() - (2.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert!(!paired.is_marked());
        assert!(Paired::of(&[]).is_none());
        let single = Paired::of(&[[1.0, 2.0]]).unwrap();
        assert!(single.standard_error.is_none() && !single.is_marked());
        assert!(!Paired::of(&[[1.0, 1.0], [2.0, 2.0]]).unwrap().is_marked(), "no difference at all");
    }
}
