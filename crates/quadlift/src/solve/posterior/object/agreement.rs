//! Whether an object's measurements agree with its body, given the noise of the scene (docs/method.md, section 8.3).
//!
//! The normalized residual of an object is its mean squared whitened residual per degree of freedom: about one if its boxes have the
//! noise of the scene. A false box among few views cannot be rejected, because too few others contradict it; the body
//! is then a compromise whose normalized residual is hundreds of times that of the other objects.
//!
//! False boxes also raise the noise level of the scene if there are too few views to reject them. Normalized residuals are therefore
//! compared with that of the median object ([`Reference`]) instead of one; at most with the noise level itself, and at
//! least with a level that no detector reaches.

use crate::optimize::chi_square::per_dof;
use crate::solve::estimate::GoodnessOfFit;
use crate::solve::options::PosteriorOptions;
use crate::solve::posterior::noise::groups::NoiseGroup;
use crate::solve::posterior::noise::levels::NoiseLevels;
use crate::sorting::StableSort;

/// The reference for normalized residuals: the noise levels times this factor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Reference(f64);

/// Edge noise, relative to the half size of a box, below which residuals are not told apart: rounding of boxes to pixels
/// and bodies that are not quite of the right kind leave more than exact data do.
const MIN_EDGE_NOISE: f64 = 0.01;

impl Reference {
    /// For a scene whose objects have these normalized residuals under its noise levels. Levels that were given alone count, whatever
    /// other objects there are.
    pub(crate) fn among(
        noise: &NoiseLevels,
        goodness: impl Iterator<Item = GoodnessOfFit>,
        options: &PosteriorOptions,
    ) -> Self {
        if options.noise_model.is_some() { Self::of_noise(noise) } else { Self::of_scene(noise, goodness) }
    }

    /// The noise levels themselves.
    fn of_noise(noise: &NoiseLevels) -> Self {
        Self(1.0f64.max(MIN_EDGE_NOISE / noise.of(NoiseGroup::Edge)))
    }

    /// From the normalized residuals of the scene's objects under its noise levels.
    fn of_scene(noise: &NoiseLevels, goodness: impl Iterator<Item = GoodnessOfFit>) -> Self {
        Self(median_level(goodness).max(MIN_EDGE_NOISE / noise.of(NoiseGroup::Edge)))
    }

    /// Not more than the noise levels themselves: a scene of a single object, or one in which most objects hold a false
    /// box, does not excuse them.
    pub(crate) fn clamped_to_noise(self, noise: &NoiseLevels) -> Self {
        Self(self.0.min(Self::of_noise(noise).0))
    }

    /// A normalized residual under the noise levels, against the reference.
    pub(crate) fn against(self, goodness_of_fit: GoodnessOfFit) -> GoodnessOfFit {
        GoodnessOfFit { normalized_residual: goodness_of_fit.normalized_residual / self.0, ..goodness_of_fit }
    }

    /// The factor on the noise levels.
    pub(crate) fn factor(self) -> f64 {
        self.0
    }
}

/// The median normalized residual of objects, in standard deviations of the noise: over the degrees of freedom, since up to half of them
/// may belong to objects with false boxes. One where no object tells.
pub(crate) fn median_level(goodness: impl Iterator<Item = GoodnessOfFit>) -> f64 {
    // Of chi-square with few degrees of freedom the median lies below the mean (Wilson and Hilferty).
    let mut levels: Vec<(f64, f64)> = goodness
        .filter(|goodness_of_fit| goodness_of_fit.dof > 0.0)
        .map(|goodness_of_fit| {
            (goodness_of_fit.normalized_residual.powi(2) / per_dof(goodness_of_fit.dof, 0.0), goodness_of_fit.dof)
        })
        .collect();
    weighted_median(&mut levels).map_or(1.0, f64::sqrt)
}

/// The median of values with weights; `None` without any.
pub(crate) fn weighted_median(values: &mut [(f64, f64)]) -> Option<f64> {
    values.stable_sort_by(|a, b| a.0.total_cmp(&b.0));
    let half = 0.5 * values.iter().map(|(_, weight)| weight).sum::<f64>();
    let mut sum = 0.0;
    let median = values.iter().find(|(_, weight)| {
        sum += weight;
        sum >= half
    });
    median.map(|(value, _)| *value)
}

/// Whether a normalized residual (relative to the reference) is far beyond the noise.
pub(crate) fn is_inconsistent(goodness_of_fit: &GoodnessOfFit) -> bool {
    let expected = per_dof(goodness_of_fit.dof.max(1.0), ONE_IN_1000);
    goodness_of_fit.relative_residual > MIN_RELATIVE_RESIDUAL
        && goodness_of_fit.normalized_residual.powi(2) > HETEROGENEITY * expected
}

/// Whether a normalized residual (relative to the reference) is consistent with noise.
pub(crate) fn agrees(goodness_of_fit: &GoodnessOfFit) -> bool {
    goodness_of_fit.normalized_residual.powi(2) < per_dof(goodness_of_fit.dof.max(1.0), ONE_IN_100)
}

/// Standard deviations of a Gaussian that one of 1000 exceeds.
const ONE_IN_1000: f64 = 3.09;

/// Standard deviations of a Gaussian that one of 100 exceeds.
const ONE_IN_100: f64 = 2.33;

/// How much larger than the scene's the variance of an object's errors may be.
const HETEROGENEITY: f64 = 2.0;

/// Normalized residuals below this, relative to the half size of the boxes, are never contradictions.
const MIN_RELATIVE_RESIDUAL: f64 = 0.1;
