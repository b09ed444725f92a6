//! Variance components: how large each kind of measurement error is, from the residuals themselves (docs/method.md, section 7.1).
//!
//! One estimator can therefore handle every kind of noise: with useless orientations and exact sizes it detects both
//! and weights them accordingly.

use super::common_errors::COMMON_CLASSES;
use super::groups::{CORRELATIONS, GROUPS, NoiseGroup};
use super::noise_prior::posterior_level;
use super::object_spread::Spread;
use super::statistics::NoiseStatistics;
use crate::optimize::median::median;
use crate::solve::noise_model::{COMMON_NAMES, CORRELATION_NAMES, NoiseModel, SPREAD_NAMES};
use crate::tuning::CORRELATED_FROM;
use crate::tuning::MANY_VIEWS;
use crate::tuning::NOISE_FLOOR;
use crate::tuning::OCCLUDED_RATIO;
use crate::tuning::TEMPERING;

/// Start of the estimation, and the typical level of detectors. Of depths: the mean relative error of networks that estimate metric
/// depth is 5 to 10 % (their own tables); of 3D boxes:
/// guesses of their distances, directions, sizes and rotations.
const DEFAULTS: [f64; GROUPS] = [0.1, 0.2, 0.1, 0.1, 0.1, 0.1, 0.1, 0.2, 0.1, 0.1, 0.02, 0.1, 0.15];

/// The usual level of a group.
pub(crate) fn noise_prior(group: NoiseGroup) -> f64 {
    DEFAULTS[group as usize]
}

/// Upper bound of the correlation between views.
const MAX_CORRELATION: f64 = 0.9;

/// Minimum degrees of freedom to estimate the correlation of views.
const ENOUGH_PAIRS: f64 = 16.0;

const RATIO_FREEDOM: f64 = 4.0;

/// How much residuals count because of the correlation of views: of edges, of ellipses, of cues.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Weights([f64; CORRELATIONS]);

impl Weights {
    /// Every view counts wholly.
    pub(crate) const INDEPENDENT: Self = Self([1.0; CORRELATIONS]);

    #[inline]
    pub(crate) fn of(&self, group: NoiseGroup) -> f64 {
        self.0[group.correlated_with()]
    }

    #[inline]
    pub(crate) fn edges(&self) -> f64 {
        self.0[0]
    }

    #[inline]
    pub(crate) fn ellipses(&self) -> f64 {
        self.0[1]
    }

    #[inline]
    pub(crate) fn cues(&self) -> f64 {
        self.0[2]
    }
}

/// Statistics of the residuals that affect covariances, but not the fits.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct CovarianceLevels {
    /// Standard deviation of the errors common to the views of an object, in units of the noise, for each kind of
    /// measurement ([`NoiseGroup::common_class`]).
    pub common: [f64; COMMON_CLASSES],
    /// How much objects differ.
    pub spread: Spread,
}

/// Noise statistics from the residuals of a scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct NoiseLevels {
    /// A standard deviation for each group.
    sd: [f64; GROUPS],
    /// Median [weight](crate::solve::posterior::residuals::cues::weights) of the measurements of each group: 1 where no standard
    /// deviations are given. A measurement of that weight has, a priori, the usual level or the given standard deviation: those that
    /// residuals contradict count by their ratios only.
    typical_weights: [f64; GROUPS],
    /// Correlation of an error with that in the object's next view, in [0, 1): of edges, of ellipses, of
    /// cues.
    correlation: [f64; CORRELATIONS],
    /// Terms that affect only the covariance.
    covariance: CovarianceLevels,
    /// Half size of a box, in pixels, at which the part of the edge noise that is constant in pixels equals the part
    /// that is proportional to the size.
    pixel_size: f64,
}

impl NoiseLevels {
    /// The levels before anything is known.
    pub(crate) fn new(pixel_size: f64) -> Self {
        Self {
            sd: DEFAULTS,
            typical_weights: [1.0; GROUPS],
            correlation: [0.0; CORRELATIONS],
            covariance: CovarianceLevels::default(),
            pixel_size,
        }
    }

    /// The levels before anything is known, for measurements with these weights: the typical one is their median.
    pub(crate) fn of_weights(pixel_size: f64, weights: impl Iterator<Item = (NoiseGroup, f64)>) -> Self {
        let mut of_group: [Vec<f64>; GROUPS] = Default::default();
        weights.for_each(|(group, weight)| of_group[group as usize].push(weight));
        let typical_weights = of_group.map(|mut weights| median(&mut weights).unwrap_or(1.0));
        let sd = std::array::from_fn(|g| DEFAULTS[g] * typical_weights[g]);
        Self { sd, typical_weights, ..Self::new(pixel_size) }
    }

    /// Given levels. Occluded edges default to twice the noise of other edges; other groups have their default.
    pub(crate) fn given(noise_model: &NoiseModel, pixel_size: f64) -> Self {
        let of_group = |group: NoiseGroup| noise_model.get(group.name()).map(|x| x / reported_part(group));
        let sd = NoiseGroup::ALL.map(|group| {
            let hidden = (group == NoiseGroup::OccludedEdge).then(|| of_group(NoiseGroup::Edge).map(|edge| 2.0 * edge));
            of_group(group).or(hidden.flatten()).unwrap_or(DEFAULTS[group as usize]).max(NOISE_FLOOR.get())
        });
        let edge = [noise_model.get("edge_noise_px"), noise_model.get("edge_noise")];
        let pixel_size = if let [Some(pixels), Some(relative)] = edge { pixels / relative } else { pixel_size };
        let correlation = CORRELATION_NAMES.map(|name| noise_model.get(name).unwrap_or(0.0));
        let covariance = CovarianceLevels {
            common: COMMON_NAMES.map(|name| noise_model.get(name).unwrap_or(0.0)),
            spread: Spread {
                level: noise_model.get(SPREAD_NAMES[0]).unwrap_or(0.0),
                variance: noise_model.get(SPREAD_NAMES[1]).unwrap_or(0.0),
            },
        };
        Self { sd, correlation, covariance, ..Self::new(pixel_size) }
    }

    /// Terms that affect only covariances.
    pub(crate) fn covariance_levels(&self) -> &CovarianceLevels {
        &self.covariance
    }

    /// The same levels with these for covariances.
    pub(crate) fn with_covariance_levels(&self, covariance: CovarianceLevels) -> Self {
        Self { covariance, ..*self }
    }

    /// How the noise of an edge, relative to the half size of its box, depends on that size: detector errors are
    /// constant in pixels for small boxes and proportional to the size for large ones (section 5.2). One where both parts are
    /// equal.
    #[inline]
    pub(crate) fn size_factor(&self, half_size: f64) -> f64 {
        let pixels = self.pixel_size / half_size;
        (0.5 * (1.0 + pixels * pixels)).sqrt()
    }

    /// The standard deviation of a group.
    #[inline]
    pub(crate) fn of(&self, group: NoiseGroup) -> f64 {
        self.sd[group as usize]
    }

    /// The same levels with independent views.
    pub(crate) fn uncorrelated(&self) -> Self {
        Self { correlation: [0.0; CORRELATIONS], ..*self }
    }

    /// All standard deviations multiplied by a factor.
    pub(crate) fn scaled(&self, factor: f64) -> Self {
        Self { sd: self.sd.map(|s| s * factor), ..*self }
    }

    /// Weight of a residual among those of `views` views: errors that persist from view to view are not better
    /// determined by many views (section 5.4). `(1 - c) / (1 + c)` is the fraction of independent views in a long sequence with
    /// the correlation c between neighbors.
    pub(crate) fn weights(&self, views: usize) -> Weights {
        Weights(self.correlation.map(|c| ((1.0 - c) / (1.0 + c)).max(1.0 / views.max(1) as f64)))
    }

    /// The levels from the statistics.
    pub(crate) fn updated(&self, statistics: &NoiseStatistics) -> Self {
        let told = |group: NoiseGroup| {
            let g = group as usize;
            let dof = statistics.dof[g].max(0.0);
            let level = self.sd[g] / self.typical_weights[g];
            let level = if dof > 0.0 { level * (statistics.squares[g] / dof).sqrt() } else { DEFAULTS[g] };
            (level.max(NOISE_FLOOR.get()), dof)
        };
        // Correlated neighboring views carry less information.
        let counted = |groups: &[NoiseGroup]| {
            let c = self.correlation[groups[0].correlated_with()];
            let independent = (1.0 - c) / (1.0 + c);
            let dof: f64 = groups.iter().map(|group| statistics.dof[*group as usize].max(0.0)).sum();
            let many_views =
                (1.0 - c / CORRELATED_FROM.get()).max(0.0) * (statistics.usual_views() / MANY_VIEWS.get()).powi(4);
            TEMPERING.get() * independent * dof * (1.0 + many_views)
        };
        let mut sd = NoiseGroup::ALL.map(|group| {
            let (level, dof) = told(group);
            let (usual, weight) = (DEFAULTS[group as usize], self.typical_weights[group as usize]);
            weight * posterior_level(level, dof, counted(&[group]), [usual, usual / weight])
        });
        // What hidden and other edges tell of the level goes together, once it is known how much noisier hidden ones are.
        let ((level, dof), (of_hidden, of_hidden_freedom)) = (told(NoiseGroup::Edge), told(NoiseGroup::OccludedEdge));
        let mut ratio = OCCLUDED_RATIO.get();
        if dof > 0.0 && of_hidden_freedom > 0.0 {
            // The variance of the logarithm of a level is half of 1 / freedom.
            let share = 1.0 / (1.0 + RATIO_FREEDOM * (1.0 / dof + 1.0 / of_hidden_freedom));
            ratio = (share * (of_hidden / level).ln() + (1.0 - share) * OCCLUDED_RATIO.get().ln()).exp();
        }
        let all = dof + of_hidden_freedom;
        if all > 0.0 {
            let squares = dof * level * level + of_hidden_freedom * (of_hidden / ratio).powi(2);
            let counted = counted(&[NoiseGroup::Edge, NoiseGroup::OccludedEdge]);
            let edge = posterior_level((squares / all).sqrt(), all, counted, [DEFAULTS[NoiseGroup::Edge as usize]; 2]);
            sd[NoiseGroup::Edge as usize] = edge.max(NOISE_FLOOR.get());
            sd[NoiseGroup::OccludedEdge as usize] = (ratio * edge).max(NOISE_FLOOR.get());
        }
        // What remains of exact data is the pull of the priors, which says nothing about measurements.
        let exact = sd[NoiseGroup::Edge as usize] < 2.0 * NOISE_FLOOR.get();
        let correlation = statistics.neighbors.map(|[sum, pairs]| {
            let told = pairs > ENOUGH_PAIRS && !exact;
            if told { (sum / pairs).clamp(0.0, MAX_CORRELATION) } else { 0.0 }
        });
        Self { sd, correlation, ..*self }
    }

    /// Largest relative change against other levels, over the groups that have data.
    pub(crate) fn change(&self, other: &Self, statistics: &NoiseStatistics) -> f64 {
        (0..GROUPS)
            .filter(|&g| statistics.dof[g] > 0.0)
            .map(|g| (self.sd[g] / other.sd[g]).ln().abs())
            .chain((0..CORRELATIONS).map(|k| (self.correlation[k] - other.correlation[k]).abs()))
            .fold(0.0, f64::max)
    }

    /// Names and levels of the groups with data. The noise of an edge has two equal parts at the half size
    /// `pixel_size`: it is reported as both, relative to the half size and in pixels.
    pub(crate) fn report(&self, statistics: &NoiseStatistics) -> Vec<(&'static str, f64)> {
        let mut report = Vec::new();
        let with_data = |group: &&NoiseGroup| statistics.dof[**group as usize] > 0.0;
        for &group in NoiseGroup::ALL.iter().filter(with_data) {
            let part = reported_part(group);
            report.push((group.name(), self.of(group) * part));
            if group == NoiseGroup::Edge {
                report.push(("edge_noise_px", self.of(group) * part * self.pixel_size));
                report.push((CORRELATION_NAMES[0], self.correlation[0]));
            }
        }
        let CovarianceLevels { common, spread } = self.covariance;
        let level = if spread.variance > 0.0 { spread.level } else { 0.0 };
        let correlation = CORRELATION_NAMES.into_iter().zip(self.correlation).skip(1);
        let of_covariance =
            COMMON_NAMES.into_iter().zip(common).chain(SPREAD_NAMES.into_iter().zip([level, spread.variance]));
        report.extend(correlation.chain(of_covariance).filter(|(_, level)| *level > 0.0));
        report
    }
}

/// Reported fraction of a group's standard deviation: edges have two equal parts.
fn reported_part(group: NoiseGroup) -> f64 {
    if group.is_edge() { std::f64::consts::FRAC_1_SQRT_2 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Levels after `count` residuals of each of these groups that show the level `told`, of objects with `views` views.
    fn levels(groups: &[NoiseGroup], told: f64, count: usize, views: usize) -> (NoiseLevels, NoiseStatistics) {
        let start = NoiseLevels::new(67.0);
        let mut statistics = NoiseStatistics::default();
        for &group in groups {
            (0..count).for_each(|_| statistics.add(group, told / start.of(group), 1.0, 1.0));
        }
        statistics.add_object(0.0, 9, views);
        (start.updated(&statistics), statistics)
    }

    #[test]
    fn plenty_of_data_sets_the_level_and_none_leaves_the_default() {
        let mut statistics = NoiseStatistics::default();
        for _ in 0..100_000 {
            statistics.add(NoiseGroup::EllipseSize, 0.5, 1.0, 0.9);
        }
        let updated = NoiseLevels::new(67.0).updated(&statistics);
        let expected = (0.1f64 * 0.1 * 250.0 / 900.0).sqrt();
        assert!((updated.of(NoiseGroup::EllipseSize) / expected - 1.0).abs() < 1e-3);
        assert!((updated.of(NoiseGroup::Edge) - 0.1).abs() < 1e-12);
        assert_eq!(updated.report(&statistics).len(), 1);
    }

    #[test]
    fn few_residuals_are_drawn_to_the_usual_level_and_many_are_believed() {
        let edges = |told, count, views| levels(&[NoiseGroup::Edge], told, count, views).0.of(NoiseGroup::Edge);
        // Five cars in a few views each: three per cent become five. Fifty objects: they stay.
        assert!((0.045..0.07).contains(&edges(0.03, 65, 4)), "{}", edges(0.03, 65, 4));
        assert!((0.0300..0.0306).contains(&edges(0.03, 4000, 4)));
        // With more residuals, the level approaches their own; never beyond it.
        let all: Vec<f64> = [10, 100, 1000, 10_000].map(|count| edges(0.03, count, 4)).to_vec();
        assert!(all.windows(2).all(|pair| pair[0] > pair[1]) && all[0] < 0.1 && all[3] > 0.03, "{all:?}");
        assert!((0.1..0.2).contains(&edges(0.2, 100, 4)));
        // Many views of an object tell more than few.
        assert!(edges(0.03, 31, 20) < 0.5 * edges(0.03, 31, 4));
        // No detector is as exact as that: boxes were computed.
        assert_eq!(edges(1e-3, 4, 3), 1e-3);
        assert!(edges(1e-3, 2, 2) > 0.09, "two residuals may be small by chance");
    }

    #[test]
    fn occluded_edges_have_a_factor_of_their_own_once_they_are_many() {
        let both = [NoiseGroup::Edge, NoiseGroup::OccludedEdge];
        let ratio = |levels: &NoiseLevels| levels.of(NoiseGroup::OccludedEdge) / levels.of(NoiseGroup::Edge);
        assert!((1.0..1.01).contains(&ratio(&levels(&both, 0.03, 4000, 10).0)));
        assert!((1.3..1.9).contains(&ratio(&levels(&both, 0.03, 8, 10).0)));
        assert_eq!(ratio(&levels(&[NoiseGroup::Edge], 0.03, 100, 10).0), OCCLUDED_RATIO.get());
    }

    #[test]
    fn levels_that_are_reported_can_be_given() {
        let mut statistics = NoiseStatistics::default();
        for group in NoiseGroup::ALL {
            (0..100).for_each(|_| statistics.add(group, 0.3, 1.0, 1.0));
        }
        statistics.add_neighbors(0, 0.5, 100);
        statistics.add_neighbors(1, 0.25, 100);
        statistics.add_neighbors(2, 0.125, 100);
        let levels = NoiseLevels::new(50.0).updated(&statistics);
        let report = levels.report(&statistics);
        let given = NoiseLevels::given(&NoiseModel::new(report.iter().copied()).unwrap(), 67.0);
        for g in 0..GROUPS {
            assert!((given.sd[g] / levels.sd[g] - 1.0).abs() < 1e-12);
        }
        assert_eq!(given.correlation, [0.5, 0.25, 0.125]);
        assert!((given.pixel_size - 50.0).abs() < 1e-9);
        assert_eq!(NoiseLevels::given(&NoiseModel::default(), 67.0), NoiseLevels::new(67.0));
        let edges = NoiseLevels::given(&NoiseModel::new([("edge_noise", 0.03)]).unwrap(), 67.0);
        assert_eq!(edges.of(NoiseGroup::OccludedEdge), 2.0 * edges.of(NoiseGroup::Edge));
    }

    #[test]
    fn correlated_views_count_less_but_never_less_than_one() {
        let mut statistics = NoiseStatistics::default();
        statistics.add_neighbors(0, 0.7, 50);
        statistics.add_neighbors(0, 0.9, 50);
        let updated = NoiseLevels::new(67.0).updated(&statistics);
        assert!((updated.correlation[0] - 0.8).abs() < 1e-12 && updated.correlation[1] == 0.0);
        assert!((updated.weights(100).of(NoiseGroup::Edge) - 1.0 / 9.0).abs() < 1e-12);
        assert_eq!(updated.weights(2).of(NoiseGroup::Edge), 0.5);
        assert_eq!(NoiseLevels::new(67.0).weights(100).of(NoiseGroup::Edge), 1.0);
    }

    #[test]
    fn exact_data_reach_the_floor() {
        let mut statistics = NoiseStatistics::default();
        for _ in 0..100 {
            statistics.add(NoiseGroup::Edge, 0.0, 1.0, 1.0);
        }
        let level = NoiseLevels::new(67.0).updated(&statistics).of(NoiseGroup::Edge);
        assert!((level / NOISE_FLOOR.get() - 1.0).abs() < 1e-12, "{level}");
    }
}
