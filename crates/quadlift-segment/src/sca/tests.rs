//! The model on crops whose truth is known.

use proptest::prelude::*;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::maximization::Learn;
use super::model::Model;
use super::{ScaOptions, fit};
use crate::box_prior::BoxPrior;
use crate::frames::{Frame, Frames};

const GRID: usize = 32;

/// Frames in which an ellipse at a slant stands out from its surroundings; the sign of the slant alternates.
fn planted(frames: usize, noise: f32, seed: u64) -> (Frames, Vec<Vec<bool>>) {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let (mut pixels, mut truth) = (Vec::new(), Vec::new());
    for t in 0..frames {
        let slant = if t % 2 == 0 { 1.0f32 } else { -1.0 };
        let inside: Vec<bool> = (0..GRID * GRID)
            .map(|i| ((i % GRID) as f32 - 15.5, (i / GRID) as f32 - 15.5))
            .map(|(x, y)| ((x + slant * y) / 11.0).powi(2) + ((x - slant * y) / 19.0).powi(2) < 1.0)
            .collect();
        let mut axis = |object: f32, background: f32| -> Vec<f32> {
            inside.iter().map(|&i| if i { object } else { background } + rng.random_range(-noise..noise)).collect()
        };
        let colors = [axis(0.4, 0.6), axis(0.2, 0.0), axis(0.1, 0.1)];
        pixels.push(Frame { colors, seen: vec![1.0; GRID * GRID] });
        truth.push(inside);
    }
    (Frames { grid: GRID, frames: pixels, prior: BoxPrior::new(GRID, 0.2) }, truth)
}

/// IoU of the pixels with positive log-odds with the truth.
fn overlap(odds: &[f32], truth: &[bool]) -> f64 {
    let count =
        |f: &dyn Fn(bool, bool) -> bool| odds.iter().zip(truth).filter(|(o, t)| f(**o > 0.0, **t)).count() as f64;
    count(&|a, b| a && b) / count(&|a, b| a || b)
}

#[test]
fn the_planted_object_is_found_in_its_poses() {
    // So many that a component has several, against the one of the box's prior.
    let (frames, truth) = planted(16, 0.15, 1);
    let odds = fit(&frames, &ScaOptions::default(), &mut ChaCha8Rng::seed_from_u64(0));
    for (odds, truth) in odds.iter().zip(&truth) {
        assert!(overlap(odds, truth) > 0.9, "{}", overlap(odds, truth));
    }
}

#[test]
fn without_blur_and_tying_f_falls() {
    // Only then it is the quantity that the steps minimize (the palettes' noise, which is added, is small here).
    let (frames, _) = planted(8, 0.2, 2);
    let options = ScaOptions { blur: 0.0, tying: 0.0, ..Default::default() };
    let mut model = Model::new(&frames, &options, &mut ChaCha8Rng::seed_from_u64(4));
    let mut earlier = f64::INFINITY;
    for round in 0..12 {
        let free_energy = model.round(Learn::Stels);
        assert!(free_energy <= earlier + 1e-4 * earlier.abs(), "round {round}: {free_energy} after {earlier}");
        earlier = free_energy;
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]
    #[test]
    fn posteriors_priors_and_mixing_weights_sum_to_one(
        count in 1..5usize, stels in 2..5usize, components in 1..6usize, noise in 0.001..0.5f32, seed in 0..1000u64,
        unseen in 0..GRID,
    ) {
        let (mut frames, _) = planted(count, noise, seed);
        frames.frames[0].seen[..unseen * GRID].fill(0.0);
        let options = ScaOptions { stels, components, ..Default::default() };
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut model = Model::new(&frames, &options, &mut rng);
        model.round(Learn::Stels);
        if count > 1 && components > 1 {
            model.split_into_components(components, &mut rng);
        }
        prop_assert!(model.round(Learn::Stels).is_finite());
        let mut row = model.row();
        for t in 0..count {
            prop_assert!((model.mixing[t].iter().sum::<f32>() - 1.0).abs() < 1e-5);
            let mut worst = 0.0f32;
            model.expect(t, &mut row, |row| {
                for i in 0..row.length {
                    for list in [&row.posterior, &row.prior] {
                        let total: f32 = (0..stels).map(|s| list[s * row.length + i]).sum();
                        // Written so that NaN counts as wrong.
                        let error = (total - 1.0).abs();
                        worst = if error < worst { worst } else { error };
                    }
                }
            });
            prop_assert!(worst < 1e-4, "{worst}");
            for palette in &model.palettes[t] {
                prop_assert!((palette.iter().map(|g| g.weight).sum::<f64>() - 1.0).abs() < 1e-9);
            }
        }
        for k in 0..model.stels.components {
            for i in 0..GRID * GRID {
                let total: f32 = (0..stels).map(|s| model.stels.map(k, s)[i]).sum();
                prop_assert!((total - 1.0).abs() < 1e-4);
            }
        }
    }
}

#[test]
fn options_outside_of_their_ranges_are_named() {
    let options = ScaOptions { stels: 1, ..Default::default() };
    assert_eq!(options.problem().unwrap(), "the number of stels is 1; expected 2 to 8");
    let options = ScaOptions { tempering: f64::NAN, ..Default::default() };
    assert_eq!(options.problem().unwrap(), "the tempering is NaN; expected 0.001 to 1");
    assert_eq!(ScaOptions::default().problem(), None);
}
