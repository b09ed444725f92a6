//! The model: all learned parameters of an object's crops, and their initial values.

use rand_chacha::ChaCha8Rng;

use super::options::ScaOptions;
use super::stels::Stels;

use crate::blur::Blur;
use crate::frames::Frames;
use crate::palette::{Palette, fit_palette};

/// Everything that is learned about an object's crops.
pub(super) struct Model<'a> {
    pub options: &'a ScaOptions,
    pub frames: &'a Frames,
    /// A palette for each frame and stel.
    pub palettes: Vec<Vec<Palette>>,
    /// Mixing weights of the components for each frame; they sum to 1.
    pub mixing: Vec<Vec<f32>>,
    /// The maps of the stels.
    pub stels: Stels,
    /// 0 for pixels that cannot be the object, 1 for the others.
    pub allowed: Vec<f32>,
    /// Exponent of the likelihood.
    pub tempering: f32,
    pub blur: Blur,
}

/// Colors that the first palettes are made from.
const FIRST_COLORS: usize = 6000;
impl<'a> Model<'a> {
    /// The start: palettes of the middle of the box and of what surrounds it, one component at the prior.
    pub(super) fn new(frames: &'a Frames, options: &'a ScaOptions, rng: &mut ChaCha8Rng) -> Self {
        let (object, background) = frames.prior.color_weights();
        let count = frames.frames.len();
        let object_colors = frames.draw_colors(FIRST_COLORS, rng, |_, i| object[i]);
        let mut palettes = vec![fit_palette(&object_colors, options.gaussians, rng)];
        let colors = frames.draw_colors(FIRST_COLORS, rng, |_, i| background[i]);
        // The surroundings' Gaussians, split by their lightness into the background's stels.
        let mut surroundings = fit_palette(&colors, options.gaussians * (options.stels - 1), rng);
        surroundings.sort_by(|a, b| a.mean.x.total_cmp(&b.mean.x));
        for part in surroundings.chunks_exact(options.gaussians) {
            let total: f64 = part.iter().map(|g| g.weight).sum();
            palettes.push(part.iter().map(|g| crate::palette::Gaussian { weight: g.weight / total, ..*g }).collect());
        }
        Self {
            options,
            frames,
            palettes: vec![palettes; count],
            mixing: vec![vec![1.0]; count],
            stels: Stels::from_prior(&frames.prior, options.stels),
            allowed: frames.prior.excluded.iter().map(|&excluded| if excluded { 0.0 } else { 1.0 }).collect(),
            tempering: options.tempering as f32,
            blur: Blur::new(options.blur as f32),
        }
    }

    pub(super) fn prior_frames(&self) -> f32 {
        self.options.prior_frames as f32
    }
}

/// The numbers divided by their sum.
pub(super) fn normalized(values: Vec<f64>) -> Vec<f32> {
    let total: f64 = values.iter().sum();
    values.iter().map(|x| (x / total) as f32).collect()
}
