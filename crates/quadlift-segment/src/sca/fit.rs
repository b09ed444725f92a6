//! The order in which the parts of the model are learned, and the log-odds of the object that follow.

use rand_chacha::ChaCha8Rng;

use super::expectation::Row;
use super::maximization::Learn;
use super::model::Model;
use super::options::ScaOptions;
use crate::frames::Frames;
use crate::vector_math::{dot, exp, ln};

/// Rounds of the warm start in which the components stay at the prior.
const PRIOR_ROUNDS: usize = 2;
/// Rounds after which the change of F may end the fit.
const MIN_ROUNDS: usize = 4;

/// Log-odds of the object in the pixels of each frame (row by row), by SCA.
///
/// There must be at least one frame with a visible pixel, and the options in their ranges.
pub(crate) fn fit(frames: &Frames, options: &ScaOptions, rng: &mut ChaCha8Rng) -> Vec<Vec<f32>> {
    let mut model = Model::new(frames, options, rng);
    for round in 0..options.warm_rounds {
        model.round(if round < PRIOR_ROUNDS { Learn::Palettes } else { Learn::Stels });
    }
    if options.components > 1 && frames.frames.len() > 1 {
        model.split_into_components(options.components, rng);
    }
    model.run();
    model.log_odds()
}

impl Model<'_> {
    /// Rounds until F converges.
    fn run(&mut self) {
        let mut earlier = f64::INFINITY;
        for round in 0..self.options.rounds {
            let free_energy = self.round(Learn::Stels);
            if round >= MIN_ROUNDS && (earlier - free_energy).abs() < self.options.tolerance * free_energy.abs() {
                break;
            }
            earlier = free_energy;
        }
    }

    /// The stels of the object: those that fill the center of the box more than its surroundings; at least one, and
    /// never all.
    pub(super) fn object_stels(&self) -> Vec<bool> {
        let count = self.options.stels;
        let mut inside = vec![[0.0f64; 2]; count];
        let mut row = self.row();
        let prior = &self.frames.prior;
        for t in 0..self.frames.frames.len() {
            self.expect(t, &mut row, |row| {
                let range = row.start..row.start + row.length;
                for (s, inside) in inside.iter_mut().enumerate() {
                    inside[0] += f64::from(dot(&row.posterior[row.of(s)], &prior.core[range.clone()]));
                    inside[1] += f64::from(dot(&row.posterior[row.of(s)], &prior.ring[range.clone()]));
                }
            });
        }
        let frames = self.frames.frames.len() as f64;
        let size = |region: &[f32]| frames * f64::from(region.iter().sum::<f32>());
        let (core, ring) = (size(&prior.core), size(&prior.ring));
        let score: Vec<f64> = inside.iter().map(|[a, b]| ((a / core + 1e-4) / (b / ring + 1e-4)).ln()).collect();
        let chosen: Vec<bool> = score.iter().map(|&score| score > 0.0).collect();
        if chosen.contains(&true) && chosen.contains(&false) {
            return chosen;
        }
        let best = (0..count).max_by(|&a, &b| score[a].total_cmp(&score[b]));
        (0..count).map(|s| Some(s) == best).collect()
    }

    /// Log-odds of the object: those of the blended prior with the tempered ratio of the likelihoods, in each of which the
    /// stels have the proportions of the prior.
    fn log_odds(&self) -> Vec<Vec<f32>> {
        let object_stels = self.object_stels();
        let mut row = self.row();
        (0..self.frames.frames.len())
            .map(|t| {
                let mut odds = vec![EXCLUDED; self.frames.pixels()];
                self.expect(t, &mut row, |row| {
                    for i in (0..row.length).filter(|i| self.allowed[row.start + i] > 0.0) {
                        let (prior, ratio) = pixel_odds(row, i, &object_stels);
                        odds[row.start + i] = prior + self.tempering * ratio;
                    }
                });
                odds
            })
            .collect()
    }
}

/// Log-odds of a pixel that cannot be the object.
pub(crate) const EXCLUDED: f32 = -50.0;

/// The prior's log-odds of a pixel and the logarithm of the ratio of its likelihoods.
fn pixel_odds(row: &Row, i: usize, object_stels: &[bool]) -> (f32, f32) {
    // Prior and `log sum p b - log sum p` of the stels that are the object or are not.
    let side = |object: bool| {
        let stels =
            || object_stels.iter().enumerate().filter(|(_, of)| **of == object).map(|(s, _)| s * row.length + i);
        let top = stels().map(|at| row.log_likelihood[at]).fold(f32::MIN, f32::max);
        let prior: f32 = stels().map(|at| row.prior[at]).sum();
        let mass: f32 = stels().map(|at| row.prior[at] * exp(row.log_likelihood[at] - top)).sum();
        (prior, top + ln(mass.max(1e-30)) - ln(prior.max(1e-30)))
    };
    let ((prior, object), (_, background)) = (side(true), side(false));
    let prior = prior.clamp(1e-6, 1.0 - 1e-6);
    (ln(prior) - ln(1.0 - prior), object - background)
}
