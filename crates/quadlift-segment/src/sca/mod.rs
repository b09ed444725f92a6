//! Stel Component Analysis (Jojic, Perina, Cristani, Murino, Frey, CVPR 2009), our variation.
//!
//! The crops of an object (frames t, pixels i) are explained by *stels*, regions s that have a palette of colours
//! each; stel 0 begins as the object, the others as background. Where the stels are is shared by the frames:
//! *components* k, poses of the object, hold a probability `r[k][s][i]` for each pixel, and a frame mixes them with
//! its weights `y[t][k]`. The colours are each frame's own, but tied to those of all frames:
//! ```text
//! p(s_i^t = s) = sum_k y_k^t r_{k,s,i}                        p(z_i^t | s) = sum_g w_{s,g}^t N(z; mu, Sigma)
//! F = sum_{t,i} -log sum_s p_s b_s^eta - nu sum p0 log r      (lower is better; eta tempers correlated pixels)
//! ```
//! Variational EM: exact posteriors of the stels, point estimates of everything else.

mod components;
mod expectation;
mod maximization;
mod model;
mod stels;

pub(crate) use model::{EXCLUDED, fit, fit_plain_mixture};

/// What SCA says about the pixels of a frame (row by row).
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct PixelOdds {
    /// Log-odds of the object by its place alone: the components, mixed for this frame.
    pub prior: Vec<f32>,
    /// Log-odds by place and colours: the posterior.
    pub posterior: Vec<f32>,
}

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
    /// Rounds of the full model at most.
    pub rounds: usize,
    /// Relative change of F at which the rounds end.
    pub tolerance: f64,
    /// Exponent of the likelihood (eta), in (0, 1]: neighbouring pixels are not independent.
    pub tempering: f64,
    /// How many frames' worth of pixels a palette takes from the mean of all frames (kappa); 0 for frames of their own.
    pub tying: f64,
    /// How many frames' worth the prior of the box counts in each component (nu).
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
    /// What is wrong with the options, if anything.
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

#[cfg(test)]
mod tests;
