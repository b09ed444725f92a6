//! Variance components: how large each kind of measurement error is, from the residuals themselves (E5, ours).
//!
//! This is what lets one estimator serve every noise: with orientations that are useless and sizes that are exact it
//! finds both out and weighs them so.

/// A kind of measurement error with a standard deviation of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NoiseGroup {
    /// Position of a box along an axis, relative to its mean half size.
    BoxCenter,
    /// Half extent of a box along an axis, relative to its mean half size.
    BoxSize,
    /// A single edge of a box whose other edge lies at the image border.
    Edge,
    /// Centre of an ellipse, relative to its mean semi-axis.
    EllipseCenter,
    /// Logarithm of the mean semi-axis of an ellipse.
    EllipseSize,
    /// Half the logarithm of the ratio of the semi-axes of an ellipse.
    EllipseAspect,
    /// Angle of an ellipse, times half the logarithm of its axis ratio.
    EllipseAngle,
}

impl NoiseGroup {
    /// All groups, in the order of their indices.
    pub(super) const ALL: [Self; GROUPS] = [
        Self::BoxCenter,
        Self::BoxSize,
        Self::Edge,
        Self::EllipseCenter,
        Self::EllipseSize,
        Self::EllipseAspect,
        Self::EllipseAngle,
    ];
}

/// Number of noise groups.
const GROUPS: usize = 7;

/// Names for reports, in the order of the groups.
pub(super) const GROUP_NAMES: [&str; GROUPS] =
    ["box_center", "box_size", "edge", "ellipse_center", "ellipse_size", "ellipse_aspect", "ellipse_angle"];

/// Where the estimation starts, and what few data are drawn towards.
const DEFAULT_EDGE: f64 = 0.1;

/// Smallest standard deviation: larger ones cost accuracy on exact data, smaller ones stability.
const FLOOR: f64 = 5e-4;

/// Degrees of freedom up to which the default fills in for missing data.
const ENOUGH_DATA: f64 = 16.0;

/// Views of an object up to which the default fills in for missing ones: in a few views a body that is not quite of the
/// right kind follows the measurements, and they look better than they are.
const ENOUGH_VIEWS: f64 = 10.0;

/// A standard deviation for each group.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NoiseLevels([f64; GROUPS]);

impl Default for NoiseLevels {
    fn default() -> Self {
        // Centre and half extent are means of two independent edges.
        let half = DEFAULT_EDGE * std::f64::consts::FRAC_1_SQRT_2;
        Self([half, half, DEFAULT_EDGE, DEFAULT_EDGE, DEFAULT_EDGE, DEFAULT_EDGE, DEFAULT_EDGE])
    }
}

impl NoiseLevels {
    /// The standard deviation of a group.
    #[inline]
    pub(super) fn of(&self, group: NoiseGroup) -> f64 {
        self.0[group as usize]
    }

    /// All groups multiplied by a factor.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self(self.0.map(|s| s * factor))
    }

    /// The levels that the statistics ask for.
    pub(super) fn updated(&self, statistics: &NoiseStatistics) -> Self {
        let defaults = Self::default();
        Self(std::array::from_fn(|g| {
            let (squares, freedom) = (statistics.squares[g], statistics.freedom[g].max(0.0));
            let variance = self.0[g] * self.0[g];
            let missing = (ENOUGH_DATA - freedom).max(statistics.missing[g]);
            let updated = (squares * variance + missing * defaults.0[g] * defaults.0[g]) / (freedom + missing);
            updated.sqrt().max(FLOOR)
        }))
    }

    /// Largest relative change against other levels, over the groups that have data.
    pub(super) fn change(&self, other: &Self, statistics: &NoiseStatistics) -> f64 {
        (0..GROUPS)
            .filter(|&g| statistics.freedom[g] > 0.0)
            .map(|g| (self.0[g] / other.0[g]).ln().abs())
            .fold(0.0, f64::max)
    }

    /// Names and levels of the groups that have data.
    pub(super) fn report(&self, statistics: &NoiseStatistics) -> Vec<(&'static str, f64)> {
        (0..GROUPS).filter(|&g| statistics.freedom[g] > 0.0).map(|g| (GROUP_NAMES[g], self.0[g])).collect()
    }
}

/// Weighted sums of squared whitened residuals and their degrees of freedom, by group.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct NoiseStatistics {
    squares: [f64; GROUPS],
    freedom: [f64; GROUPS],
    missing: [f64; GROUPS],
}

impl NoiseStatistics {
    /// Adds a whitened residual with its robust weight and its leverage (what the fit itself took of it).
    pub(super) fn add(&mut self, group: NoiseGroup, residual: f64, weight: f64, leverage: f64) {
        self.squares[group as usize] += weight * residual * residual;
        self.freedom[group as usize] += weight - leverage;
    }

    /// Notes that an object was seen in so many views only, each with `count` residuals of a group in all.
    pub(super) fn add_views(&mut self, group: NoiseGroup, count: usize, views: usize) {
        if views > 0 {
            self.missing[group as usize] += count as f64 * (ENOUGH_VIEWS / views as f64 - 1.0).max(0.0);
        }
    }

    /// Adds another object's statistics.
    pub(super) fn merge(&mut self, other: &Self) {
        for g in 0..GROUPS {
            self.squares[g] += other.squares[g];
            self.freedom[g] += other.freedom[g];
            self.missing[g] += other.missing[g];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn plenty_of_data_sets_the_level_and_none_leaves_the_default() {
        let mut statistics = NoiseStatistics::default();
        for _ in 0..1000 {
            statistics.add(NoiseGroup::EllipseSize, 0.5, 1.0, 0.1);
        }
        let updated = NoiseLevels::default().updated(&statistics);
        let expected = (0.1f64 * 0.1 * 250.0 / 900.0).sqrt();
        assert!((updated.of(NoiseGroup::EllipseSize) - expected).abs() < 1e-12);
        assert!((updated.of(NoiseGroup::Edge) - DEFAULT_EDGE).abs() < 1e-12);
        assert_eq!(updated.report(&statistics).len(), 1);
    }

    #[test]
    fn exact_data_reach_the_floor() {
        let mut statistics = NoiseStatistics::default();
        for _ in 0..100 {
            statistics.add(NoiseGroup::BoxSize, 0.0, 1.0, 0.0);
        }
        assert_eq!(NoiseLevels::default().updated(&statistics).of(NoiseGroup::BoxSize), FLOOR);
    }
}
