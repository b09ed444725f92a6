//! What the objects of a scene share: noise levels, the share of wrong boxes, the roundness of rounded bodies.

/// Degrees of freedom of Student's t distribution of the errors of edges. Recipe: 9 of 5, 7, 9, 15, flat within .003 of 3D IoU.
pub(super) const DOF: f64 = 9.0;

/// A wrong box lies anywhere within this many half sizes.
pub(super) const CLUTTER_RANGE: f64 = 10.0;

/// Share of wrong boxes before the scene has been looked at.
pub(super) const FIRST_WRONG_SHARE: f64 = 0.05;

/// Views of the prior on that share.
pub(super) const WRONG_SHARE_VIEWS: f64 = 20.0;

/// Noise level, in half sizes, of the first fits, and the median of the prior on levels.
pub(super) const FIRST_NOISE: f64 = 0.1;

/// Standard deviation of the logarithm of the noise level of detectors.
const LOG_NOISE_SD: f64 = 1.5;

/// Noise of occluded edges over that of the others before the scene has been looked at.
pub(super) const OCCLUDED_RATIO: f64 = 2.0;

/// Lowest noise level: boxes of files have so many digits.
pub(super) const MIN_NOISE: f64 = 2e-5;

/// The cuboid's share in rounded bodies: mean and precision of its prior. The precision is that of an even distribution.
pub(super) const FIRST_CUBOID_SHARE: [f64; 2] = [0.35, 12.0];

/// What the fit of an object takes from its scene.
#[derive(Debug, Clone, Copy)]
pub(super) struct Conditions {
    /// Standard deviations of edges in half sizes times `f(s)`: free ones, occluded ones.
    pub noise: [f64; 2],
    /// Correlation of the errors of opposite edges, in the image: that of boxes that are shifted is positive.
    pub opposite_correlation: f64,
    /// Share of wrong boxes.
    pub wrong_share: f64,
    /// Weight of a view beside its neighbors, whose errors are alike; in [0, 1].
    pub view_weight: f64,
    /// Standard deviation of the logarithms of half extents about their mean.
    pub shape_sd: f64,
    /// The cuboid's share in rounded bodies: mean and precision.
    pub cuboid_share: [f64; 2],
}

impl Conditions {
    /// Those of the first fits, at this noise level.
    pub(super) fn first(noise: f64, shape_sd: f64) -> Self {
        Self {
            noise: [noise, OCCLUDED_RATIO * noise],
            opposite_correlation: 0.0,
            wrong_share: FIRST_WRONG_SHARE,
            view_weight: 1.0,
            shape_sd,
            cuboid_share: FIRST_CUBOID_SHARE,
        }
    }

    /// The same at another noise level of free edges.
    pub(super) fn at(&self, noise: f64) -> Self {
        Self { noise: [noise, noise * self.noise[1] / self.noise[0]], ..*self }
    }

    /// The same with noise levels times a factor.
    pub(super) fn times(&self, factor: f64) -> Self {
        Self { noise: self.noise.map(|x| x * factor), ..*self }
    }

    /// The same with noise levels of at least this.
    pub(super) fn at_least(&self, noise: f64) -> Self {
        Self { noise: self.noise.map(|x| x.max(noise)), ..*self }
    }

    /// Logarithm of the prior density of the noise level; counted once for a scene.
    pub(super) fn log_prior(&self) -> f64 {
        -0.5 * ((self.noise[0] / FIRST_NOISE).ln() / LOG_NOISE_SD).powi(2)
    }
}
