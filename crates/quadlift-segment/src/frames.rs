//! The pixels of an object's crops, as the methods read them.

use crate::box_prior::BoxPrior;
use crate::color::scaled_lab;
use crate::crop::Crop;
use crate::palette::{Colors, draw_indices};
use rand_chacha::ChaCha8Rng;

/// One crop's pixels.
#[derive(Debug, Clone)]
pub(crate) struct Frame {
    /// Colors of the grid's pixels, row by row.
    pub colors: Colors,
    /// 1 for pixels that lie in the image, 0 for the others.
    pub seen: Vec<f32>,
}

/// All crops of an object, cut with the same options.
#[derive(Debug, Clone)]
pub(crate) struct Frames {
    /// Pixels along each side of the grid.
    pub grid: usize,
    /// One entry for each crop.
    pub frames: Vec<Frame>,
    /// Where the object is likely to be, the same for all.
    pub prior: BoxPrior,
}

impl Frames {
    /// The pixels of crops that were cut with this grid and margin.
    pub(crate) fn new(crops: &[Crop], grid: usize, margin: f64) -> Self {
        let frames = crops
            .iter()
            .map(|crop| {
                let mut colors: Colors = Default::default();
                for axis in &mut colors {
                    axis.reserve(crop.colors().len());
                }
                for &rgb in crop.colors() {
                    for (axis, value) in colors.iter_mut().zip(scaled_lab(rgb)) {
                        axis.push(value);
                    }
                }
                let seen = crop.seen().iter().map(|&seen| if seen { 1.0 } else { 0.0 }).collect();
                Frame { colors, seen }
            })
            .collect();
        Self { grid, frames, prior: BoxPrior::new(grid, margin) }
    }

    /// Number of pixels of a crop.
    pub(crate) fn pixels(&self) -> usize {
        self.grid * self.grid
    }

    /// Colors drawn from the seen pixels of all crops, in proportion to `weight(frame, pixel)`.
    pub(crate) fn draw_colors(
        &self,
        count: usize,
        rng: &mut ChaCha8Rng,
        weight: impl Fn(usize, usize) -> f64,
    ) -> Colors {
        let pixels = self.pixels();
        let weights = self.frames.iter().enumerate().flat_map(|(t, frame)| {
            let weight = &weight;
            frame.seen.iter().enumerate().map(move |(i, &seen)| f64::from(seen) * weight(t, i))
        });
        let drawn = draw_indices(weights, count, rng);
        std::array::from_fn(|axis| drawn.iter().map(|&i| self.frames[i / pixels].colors[axis][i % pixels]).collect())
    }
}
