//! Graph cuts with palettes that all frames of an object share.

use rand_chacha::ChaCha8Rng;

use crate::frames::Frames;
use crate::palette::{Colors, LogDensity, fit_palette, mixture_row, part};
use crate::sca::EXCLUDED;
use crate::smoothing::smooth_labels;

/// Rounds of palettes and cuts.
const ROUNDS: usize = 5;
/// Gaussians in each of the two palettes.
const GAUSSIANS: usize = 6;
/// Exponent of the likelihood: neighboring pixels are not independent.
const TEMPERING: f32 = 0.5;
/// Colors that a palette is made from.
const COLORS: usize = 6000;
/// Probability of the object by its box above which a pixel is one at first.
const FIRST_OBJECT: f32 = 0.4;

/// The pixels of a frame, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Labeled {
    /// Log-odds of the object.
    pub log_odds: Vec<f32>,
    /// Whether the pixel is taken for the object's.
    pub inside: Vec<bool>,
}

/// Rounds of GrabCut (Rother, Kolmogorov, Blake, 2004) on all frames together, from the box on: one palette of the object
/// and one of the background are fitted to the labels of all frames, then each frame is cut again by place, colors and
/// edges.
///
/// There must be at least one frame with a visible pixel.
pub(crate) fn pooled_cuts(frames: &Frames, strength: f32, rng: &mut ChaCha8Rng) -> Vec<Labeled> {
    let object = &frames.prior.object;
    let prior: Vec<f32> = object.iter().map(|p| (p / (1.0 - p)).ln()).collect();
    let inside = object.iter().map(|&p| p > FIRST_OBJECT).collect();
    let mut labeled = vec![Labeled { log_odds: Vec::new(), inside }; frames.frames.len()];
    for _ in 0..ROUNDS {
        let mut palette_of = |object: bool| {
            // The trace: a palette for a label that no pixel has.
            let weight = |t: usize, i: usize| if labeled[t].inside[i] == object { 1.0 } else { 1e-6 };
            let colors = frames.draw_colors(COLORS, rng, weight);
            fit_palette(&colors, GAUSSIANS, rng).iter().map(LogDensity::new).collect::<Vec<_>>()
        };
        let palettes = [palette_of(true), palette_of(false)];
        for (frame, labeled) in frames.frames.iter().zip(&mut labeled) {
            let [object, background] = palettes.each_ref().map(|palette| log_likelihood(palette, &frame.colors));
            let evidence = object.iter().zip(&background).zip(&frame.seen);
            labeled.log_odds = evidence
                .zip(prior.iter().zip(&frames.prior.excluded))
                .map(
                    |(((object, background), seen), (prior, &excluded))| {
                        if excluded { EXCLUDED } else { prior + seen * TEMPERING * (object - background) }
                    },
                )
                .collect();
            labeled.inside = smooth_labels(&labeled.log_odds, &frame.colors, frames.grid, strength);
        }
    }
    labeled
}

fn log_likelihood(palette: &[LogDensity], colors: &Colors) -> Vec<f32> {
    const ROW: usize = 64;
    let mut out = vec![0.0; colors[0].len()];
    let mut responsibilities = vec![0.0; ROW * palette.len()];
    for (row, out) in out.chunks_mut(ROW).enumerate() {
        let n = out.len();
        let range = row * ROW..row * ROW + n;
        mixture_row(palette, part(colors, range), &mut responsibilities[..n * palette.len()], out);
    }
    out
}
