//! Co-segmentation without stels: one pair of palettes for all frames of an object, and graph cuts.

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use crate::frames::Frames;
use crate::palette::{Colors, LogDensity, fit_palette, mixture_row, part};
use crate::sca::EXCLUDED;
use crate::smoothing::smooth_labels;

/// Gaussians in each of the two palettes.
const GAUSSIANS: usize = 6;
/// Rounds of palettes and cuts.
const ROUNDS: usize = 5;
/// Exponent of the likelihood: neighbouring pixels are not independent.
const TEMPERING: f32 = 0.5;
/// Colours that a palette is made from.
const COLORS: usize = 6000;
/// Probability of the object above which a pixel is one at first.
const FIRST_OBJECT: f32 = 0.4;

/// Log-odds of the object and labels for each pixel of each frame, as GrabCut makes them for a single image, but with
/// the palettes of all frames together and the prior of the box.
///
/// There must be at least one frame with a seen pixel.
pub(crate) fn pooled_cut(frames: &Frames, strength: f32, seed: u64) -> Vec<(Vec<f32>, Vec<bool>)> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let prior = &frames.prior;
    let first: Vec<bool> = prior.object.iter().map(|&p| p > FIRST_OBJECT).collect();
    let mut labelled = vec![(Vec::new(), first); frames.frames.len()];
    for _ in 0..ROUNDS {
        let mut palette_of = |object: bool| {
            // The trace: a palette of pixels without a label, where all have the other one.
            let weight = |t: usize, i: usize| if labelled[t].1[i] == object { 1.0 } else { 1e-6 };
            let colors = frames.draw_colors(COLORS, &mut rng, weight);
            fit_palette(&colors, GAUSSIANS, &mut rng).iter().map(LogDensity::new).collect::<Vec<_>>()
        };
        let palettes = [palette_of(true), palette_of(false)];
        for (frame, labelled) in frames.frames.iter().zip(&mut labelled) {
            let [object, background] = palettes.each_ref().map(|palette| log_likelihood(palette, &frame.colors));
            let log_odds: Vec<f32> = (0..frames.pixels())
                .map(|i| {
                    let p = prior.object[i];
                    let evidence = frame.seen[i] * TEMPERING * (object[i] - background[i]);
                    if prior.excluded[i] { EXCLUDED } else { (p / (1.0 - p)).ln() + evidence }
                })
                .collect();
            let labels = smooth_labels(&log_odds, &frame.colors, frames.grid, strength);
            *labelled = (log_odds, labels);
        }
    }
    labelled
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
