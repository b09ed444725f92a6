//! Settings of the model.

/// Settings of the model; the defaults are for a grid of 64 pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScaOptions {
    /// Number of stels, 2 to 8: one for the object, the others for the background.
    pub stels: usize,
    /// Number of components (poses), 1 to 16; never more than frames.
    pub components: usize,
    /// Gaussians in the palette of a stel, 1 to 8.
    pub gaussians: usize,
    /// Rounds with one component, which come first.
    pub warm_rounds: usize,
    /// Maximum number of rounds of the full model.
    pub rounds: usize,
    /// Relative change of F at which the rounds end.
    pub tolerance: f64,
    /// Exponent of the likelihood (eta), in (0, 1]: neighboring pixels are not independent.
    pub tempering: f64,
    /// Weight of the mean palette of all frames in each palette, in frames (kappa); 0 for independent frames.
    pub tying: f64,
    /// Weight of the box prior in each component, in frames (nu).
    pub prior_frames: f64,
    /// Standard deviation of the blur of the components, in grid pixels.
    pub blur: f64,
}

impl Default for ScaOptions {
    fn default() -> Self {
        Self {
            stels: 3,
            components: 5,
            gaussians: 4,
            warm_rounds: 6,
            rounds: 8,
            tolerance: 1e-4,
            tempering: 0.6,
            tying: 4.0,
            prior_frames: 1.0,
            blur: 1.5,
        }
    }
}

impl ScaOptions {
    /// The problem of the options, if any.
    pub(crate) fn problem(&self) -> Option<String> {
        let whole = |name: &str, value: usize, range: std::ops::RangeInclusive<usize>| {
            let text = format!("{name} is {value}; expected {} to {}", range.start(), range.end());
            (!range.contains(&value)).then_some(text)
        };
        let number = |name: &str, value: f64, low: f64, high: f64| {
            (!(low..=high).contains(&value)).then(|| format!("{name} is {value}; expected {low} to {high}"))
        };
        whole("the number of stels", self.stels, 2..=8)
            .or_else(|| whole("the number of components", self.components, 1..=16))
            .or_else(|| whole("the number of Gaussians", self.gaussians, 1..=8))
            .or_else(|| number("the tolerance", self.tolerance, 0.0, 1.0))
            .or_else(|| number("the tempering", self.tempering, 1e-3, 1.0))
            .or_else(|| number("the tying of palettes", self.tying, 0.0, 1e6))
            .or_else(|| number("the weight of the prior", self.prior_frames, 0.0, 1e6))
            .or_else(|| number("the blur", self.blur, 0.0, 32.0))
    }
}
