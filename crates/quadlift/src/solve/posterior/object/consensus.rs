//! How many views agree with a body, whatever their noise (docs/method.md, section 8.1).

use crate::optimize::normal_equations::PARAMETERS;
use crate::solve::posterior::noise::groups::NoiseGroup;
use crate::solve::posterior::noise::levels::NoiseLevels;

/// Share of the boxes that are not of the object that they are given for, before anything is known.
pub(crate) const WRONG_SHARE: f64 = 0.05;

/// Where the edges of a wrong box may be: over so many half sizes of the object's.
const WRONG_RANGE: f64 = 10.0;

/// Residuals of a view for which the scale of the loss and limits on its sum of squares are meant: four edges. Sums of
/// other numbers are compared by their probability ([`crate::optimize::chi_square::as_of`]).
pub(crate) const USUAL_RESIDUALS: usize = 4;

/// The fewest views that say more than a body can follow.
const MIN_VIEWS: usize = 3;

/// A variance below this is that of exact data: a hundredth of the noise says no more than less.
const MIN_VARIANCE: f64 = 1e-4;

/// Logarithm of the density of an edge of a wrong box, over that of an edge of the object at its most probable place.
pub(crate) fn log_wrong_edge(noise: &NoiseLevels) -> f64 {
    (noise.of(NoiseGroup::Edge) * std::f64::consts::TAU.sqrt() / WRONG_RANGE).ln()
}

/// What the views that agree best say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Consensus {
    /// Logarithm of the likelihood that these views show the body and the others are wrong boxes, up to a constant.
    pub score: f64,
    /// Mean squared residual of these views, by degrees of freedom, in units of the noise levels.
    pub variance: f64,
}

impl Consensus {
    /// The more probable one first; of exact ones the more exact.
    pub(crate) fn order(&self, other: &Self) -> std::cmp::Ordering {
        other.score.total_cmp(&self.score).then(self.variance.total_cmp(&other.variance))
    }

    /// Of the squared residuals of views, as if there were four in each, under these noise levels. The number of views that
    /// agree is the most probable one, with their own variance.
    pub(crate) fn of(mut view_costs: Vec<f64>, noise: &NoiseLevels) -> Self {
        view_costs.sort_by(f64::total_cmp);
        let count = view_costs.len();
        let log_wrong = (WRONG_SHARE / (1.0 - WRONG_SHARE)).ln() + USUAL_RESIDUALS as f64 * log_wrong_edge(noise);
        let mut sum = 0.0;
        let mut best = Self { score: f64::NEG_INFINITY, variance: 1.0 };
        for (k, cost) in view_costs.into_iter().enumerate() {
            sum += cost;
            let agree = k + 1;
            if agree < MIN_VIEWS {
                continue;
            }
            let dof = (USUAL_RESIDUALS * agree - PARAMETERS) as f64;
            let variance = sum / dof;
            let score = -0.5 * dof * (variance.max(MIN_VARIANCE).ln() + 1.0) + (count - agree) as f64 * log_wrong;
            if score > best.score {
                best = Self { score, variance };
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(costs: &[f64]) -> Consensus {
        Consensus::of(costs.to_vec(), &NoiseLevels::new(67.0))
    }

    #[test]
    fn the_noise_is_that_of_the_views_that_agree() {
        let right = vec![4.0; 12];
        assert!((of(&right).variance - 48.0 / 39.0).abs() < 1e-12);
        // A minority of twelve among twenty-six that are far off in ways of their own.
        let mut with_wrong = right.clone();
        with_wrong.extend((1..15).map(|k| 1000.0 * f64::from(k)));
        let found = of(&with_wrong);
        assert!((found.variance - 48.0 / 39.0).abs() < 1e-12, "{found:?}");
        assert!(found.score < of(&right).score);
    }

    #[test]
    fn one_wrong_box_of_four_is_not_noise() {
        assert!((of(&[1.0, 1.0, 1.0, 4000.0]).variance - 1.0).abs() < 1e-12);
    }

    #[test]
    fn views_that_agree_less_well_than_the_noise_agree_all_the_same() {
        let noisy: Vec<f64> = (0..20).map(|k| 100.0 + f64::from(k)).collect();
        assert!((of(&noisy).variance - noisy.iter().sum::<f64>() / 71.0).abs() < 1e-9);
        // Nor are a few views that happen to agree better all that show the object.
        let mut lucky = vec![1.0; 4];
        lucky.extend(vec![6.0; 8]);
        assert!((of(&lucky).variance - 52.0 / 39.0).abs() < 1e-9);
    }

    #[test]
    fn a_body_that_more_views_show_is_more_probable() {
        let costs = |right: usize| {
            let mut costs = vec![4.0; right];
            costs.resize(20, 5000.0);
            costs
        };
        assert!(of(&costs(10)).score > of(&costs(8)).score);
        // Twice as many views outweigh half the noise.
        let exact: Vec<f64> = costs(6).iter().map(|cost| 0.25 * cost).collect();
        assert!(of(&costs(12)).score > of(&exact).score);
    }

    /// The logarithm of the likelihood that the variance of the views that agree maximizes, and that of the edges of wrong boxes: a
    /// twentieth of the boxes, over ten half sizes where an edge of the object has the noise of a tenth, relative to its peak.
    #[test]
    fn the_score_is_the_likelihood_of_right_and_wrong_boxes() {
        let wrong_edge = 0.1 * 0.1 * (2.0 * std::f64::consts::PI).sqrt();
        let wrong = f64::ln(0.05 / 0.95 * wrong_edge.powi(4));
        let score = |squares: f64, views: f64, wrong_views: f64| {
            let dof = 4.0 * views - 9.0;
            -0.5 * dof * ((squares / dof).ln() + 1.0) + wrong_views * wrong
        };
        for (costs, expected) in [
            (vec![1.0, 4000.0, 1.0, 1.0], score(3.0, 3.0, 1.0)),
            (vec![2.0; 6], score(12.0, 6.0, 0.0)),
            (vec![2.0, 2.0, 2.0, 2.0, 1e5, 1e5], score(8.0, 4.0, 2.0)),
        ] {
            assert!((of(&costs).score - expected).abs() < 1e-9, "{costs:?}: {} {expected}", of(&costs).score);
        }
        // Exact views have a hundredth of the noise, and of two such bodies the more exact one is the better.
        let [exact, more_exact] = [1e-4, 1e-8].map(|cost| of(&[cost; 5]));
        assert!((exact.score + 5.5 * (f64::ln(1e-4) + 1.0)).abs() < 1e-9 && exact.score == more_exact.score);
        assert_eq!(more_exact.order(&exact), std::cmp::Ordering::Less);
    }
}
