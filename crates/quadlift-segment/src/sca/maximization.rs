//! The M step: palettes, components and mixing weights, given which stel each pixel belongs to.

use super::expectation::Row;
use super::model::{Model, normalized};
use super::stels::Stels;
use crate::palette::{ColorSums, color_products, palette_of, part};
use crate::vector_math::dot;

/// What an M step learns besides the palettes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Learn {
    /// Nothing.
    Palettes,
    /// Components and mixing weights.
    Stels,
}

/// Sums over the pixels of all frames.
struct Sums {
    /// For each frame, stel and Gaussian.
    colors: Vec<Vec<ColorSums>>,
    /// For each frame: votes for the components.
    mixing: Vec<Vec<f64>>,
    /// Votes `sum_t y q / p` for the components' maps.
    votes: Stels,
}

impl Model<'_> {
    /// One E step with the M step that follows from it; returns F before the step.
    pub(super) fn round(&mut self, learn: Learn) -> f64 {
        let (stels, components) = (self.options.stels, self.stels.components);
        let frames = self.frames.frames.len();
        let per_frame = stels * self.options.gaussians;
        let mut sums = Sums {
            colors: vec![vec![ColorSums::default(); per_frame]; frames],
            mixing: vec![vec![0.0; components]; frames],
            votes: match learn {
                Learn::Stels => Stels::zeros(components, stels, self.frames.pixels()),
                Learn::Palettes => Stels::zeros(0, stels, 0),
            },
        };
        let mut row = Row::new(self.frames.grid, stels, self.options.gaussians);
        let mut products = Default::default();
        let mut free_energy = 0.0;
        for t in 0..frames {
            free_energy += self.expect(t, &mut row, |row| {
                self.add_colors(t, row, &mut products, &mut sums.colors[t]);
                if learn != Learn::Palettes {
                    self.add_votes(t, row, &mut sums);
                }
            });
        }
        free_energy -= self.options.prior_frames * self.stels.log_prior(&self.frames.prior);
        self.set_palettes(&sums.colors);
        match learn {
            Learn::Palettes => {}
            Learn::Stels => {
                for (mixing, votes) in self.mixing.iter_mut().zip(&sums.mixing) {
                    *mixing = normalized(mixing.iter().zip(votes).map(|(&y, v)| f64::from(y) * v).collect());
                }
                let mut counts = sums.votes;
                counts.multiply(&self.stels);
                counts.normalize_counts(&self.frames.prior, self.prior_frames(), &self.blur, self.frames.grid);
                self.stels = counts;
            }
        }
        free_energy
    }

    fn add_colors(&self, t: usize, row: &mut Row, products: &mut [Vec<f32>; 6], sums: &mut [ColorSums]) {
        let n = row.length;
        let frame = &self.frames.frames[t];
        let range = row.start..row.start + n;
        let colors = part(&frame.colors, range.clone());
        color_products(colors, products);
        let seen = &frame.seen[range];
        let gaussians = self.options.gaussians;
        for (index, (weights, sums)) in row.responsibilities.chunks_exact_mut(n).zip(sums).enumerate() {
            let s = index / gaussians;
            for ((weight, q), seen) in weights.iter_mut().zip(&row.posterior[s * n..(s + 1) * n]).zip(seen) {
                *weight *= q * seen;
            }
            sums.add_row(weights, colors, products.each_ref().map(Vec::as_slice));
        }
    }

    fn add_votes(&self, t: usize, row: &mut Row, sums: &mut Sums) {
        let range = row.start..row.start + row.length;
        let seen = &self.frames.frames[t].seen[range.clone()];
        // Outside of the image a pixel votes with its prior: q / p = 1.
        for (ratio, prior) in row.posterior.chunks_exact_mut(row.length).zip(row.prior.chunks_exact(row.length)) {
            for ((ratio, prior), seen) in ratio.iter_mut().zip(prior).zip(seen) {
                *ratio = seen * (*ratio / prior - 1.0) + 1.0;
            }
        }
        for (k, &y) in self.mixing[t].iter().enumerate() {
            for s in 0..self.options.stels {
                let ratio = &row.posterior[row.of(s)];
                if self.stels.components > 1 {
                    sums.mixing[t][k] += f64::from(dot(ratio, &self.stels.map(k, s)[range.clone()]));
                }
                for (vote, ratio) in sums.votes.map_mut(k, s)[range.clone()].iter_mut().zip(ratio) {
                    *vote += y * ratio;
                }
            }
        }
        if self.stels.components == 1 {
            sums.mixing[t][0] = 1.0;
        }
    }

    /// A palette of each frame and stel: its own pixels and `tying` times those of the mean frame.
    fn set_palettes(&mut self, sums: &[Vec<ColorSums>]) {
        let mut pooled = vec![ColorSums::default(); sums.first().map_or(0, Vec::len)];
        for frame in sums {
            for (pooled, own) in pooled.iter_mut().zip(frame) {
                pooled.add_scaled(own, 1.0 / sums.len() as f64);
            }
        }
        let gaussians = self.options.gaussians;
        for (palettes, own) in self.palettes.iter_mut().zip(sums) {
            let mut tied = own.clone();
            for (tied, pooled) in tied.iter_mut().zip(&pooled) {
                tied.add_scaled(pooled, self.options.tying);
            }
            for (palette, sums) in palettes.iter_mut().zip(tied.chunks_exact(gaussians)) {
                *palette = palette_of(sums, palette);
            }
        }
    }
}
