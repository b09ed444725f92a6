//! The noise level from few residuals and the typical level of detectors (docs/method.md, section 7.2).

use crate::tuning::ANY_LEVEL;
use crate::tuning::USUAL_SPREAD;

/// No detector errs by so little of the half size of a box (a tenth of a pixel in a box of 100 pixels): such boxes are
/// computed, and the typical level of detectors does not apply.
const EXACT_BOX_LEVEL: f64 = 2e-3;

/// Minimum degrees of freedom to recognize computed boxes: with 3, detected ones fit as well once in 100,000 scenes.
const MIN_EXACT_DOF: f64 = 3.0;

/// Steps of the grid search for the most probable level.
const GRID: usize = 48;

/// Halvings of a step of the grid: to the last digit.
const HALVINGS: usize = 52;

/// The standard deviation that residuals and what is usual for detectors ask for together: the most probable one given
/// `told`, the level that the residuals show, their degrees of freedom, how many of these count, and the usual levels, of which the first
/// one holds without residuals.
pub(crate) fn posterior_level(told: f64, dof: f64, counted: f64, usual: [f64; 2]) -> f64 {
    if counted <= 0.0 {
        return usual[0];
    }
    if told < EXACT_BOX_LEVEL && dof >= MIN_EXACT_DOF {
        return told;
    }
    // The negative logarithm of the posterior; `x` is the logarithm of the level.
    let off = |x: f64| {
        let [a, b] = usual.map(|usual| (x - usual.ln()) / USUAL_SPREAD.get());
        if b.abs() < a.abs() { b } else { a }
    };
    let cost = |x: f64| {
        let off = off(x);
        counted * (x + 0.5 * (2.0 * (told.ln() - x)).exp()) - (ANY_LEVEL.get() + (-0.5 * off * off).exp()).ln()
    };
    // All parts grow outside of the levels. There may be a minimum near each of them.
    let [a, b] = usual;
    let (low, high) = (told.min(a).min(b).ln(), told.max(a).max(b).ln());
    let step = (high - low) / GRID as f64;
    let at = |k: usize| low + step * k as f64;
    let nearest = (0..=GRID).min_by(|&a, &b| cost(at(a)).total_cmp(&cost(at(b)))).unwrap_or(0);
    // The root of the derivative: comparisons of costs would tell the minimum to half of the digits only.
    let slope = |x: f64| {
        let off = off(x);
        let bell = (-0.5 * off * off).exp();
        counted * (1.0 - (2.0 * (told.ln() - x)).exp()) + off / USUAL_SPREAD.get() * bell / (ANY_LEVEL.get() + bell)
    };
    let (mut left, mut right) = ((at(nearest) - step).max(low), (at(nearest) + step).min(high));
    for _ in 0..HALVINGS {
        let middle = 0.5 * (left + right);
        if slope(middle) < 0.0 { left = middle } else { right = middle }
    }
    (0.5 * (left + right)).exp()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Of two usual levels the one counts that the residuals are near.
    #[test]
    fn the_usual_level_that_the_residuals_show_counts() {
        let level = |told, other| posterior_level(told, 60.0, 0.9, [0.1, other]);
        assert!((0.009..0.013).contains(&level(0.01, 0.01)), "{}", level(0.01, 0.01));
        assert!((level(0.05, 1e-9) / level(0.05, 0.1) - 1.0).abs() < 1e-9);
    }

    #[test]
    fn the_most_probable_level_is_the_lowest_of_a_fine_grid() {
        for (told, counted) in [(0.02, 0.5), (0.02, 3.0), (0.004, 0.3), (0.004, 1.0), (0.5, 2.0), (3.0, 0.4)] {
            let cost = |s: f64| {
                let off: f64 = (s / 0.1f64).ln() / USUAL_SPREAD.get();
                counted * (s.ln() + told * told / (2.0 * s * s)) - (ANY_LEVEL.get() + (-0.5 * off * off).exp()).ln()
            };
            let fine = (0..100_000).map(|k| 1e-4 * 1e5f64.powf(f64::from(k) / 1e5));
            let best = fine.min_by(|a, b| cost(*a).total_cmp(&cost(*b))).unwrap();
            let found = posterior_level(told, 10.0, counted, [0.1; 2]);
            assert!((found / best - 1.0).abs() < 2e-4, "{told} {counted}: {found} {best}");
        }
    }
}
