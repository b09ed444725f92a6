//! Which objects a transform brings together, and how well.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector3;

use super::MapTransform;
use super::prepared::{Candidate, PreparedMaps, SIZE_SLACK};
use super::refine::{DOF, LOG_SCALE_SD, Moved, Refined, refine, whitened};
use crate::geometry::Similarity;
use crate::geometry::linalg::{cholesky, invert_spd};
use crate::optimize::matching::{Pair, best_pairs};
use crate::optimize::student_t::StudentT;

/// Logarithm of the odds that an object of one map is in the other one: 0.3.
const LOG_ODDS_COMMON: f64 = -0.847_3;

/// Logarithm of the density at zero of Student's t distribution with five degrees of freedom in three dimensions.
const LOG_PEAK: f64 = -2.624_1;

/// Squared distance of two centers, over the trace of its covariance, beyond which they are not compared.
const FAR: f64 = 400.0;

/// Factor on standard deviations while a transform rests on few objects.
const WIDEN: f64 = 3.0;

/// Rounds of matching and refining at most, and steps of each.
const ROUNDS: usize = 30;
const STEPS: usize = 12;

/// Rounds in which matches may change.
const MATCHING_ROUNDS: usize = 8;

/// Change of a transform, relative to it, from which on it stands: errors of objects are turned by it, so that each round has others.
const SETTLED: f64 = 1e-9;

/// Logarithm of the odds that two objects are the same, against objects of their categories that are anywhere in their maps: `None` where
/// they are far apart. `widen` multiplies standard deviations.
fn gain(maps: &PreparedMaps, moved: &Moved, candidate: &Candidate, log_scale: f64, widen: f64) -> Option<f64> {
    let pair = (candidate.a, candidate.b);
    if (candidate.log_ratio - log_scale).abs() > 2.0 * SIZE_SLACK {
        return None;
    }
    let off: Vector3<f64> = maps.a.objects[pair.0].center - moved.centers[pair.1].0;
    let spread = maps.a.objects[pair.0].center_covariance.trace() + moved.centers[pair.1].1.trace();
    if off.norm_squared() > FAR * widen * widen * spread {
        return None;
    }
    let student_t = StudentT::new(DOF);
    let factor = moved.center_factor(maps, pair)? * widen;
    let log_density = LOG_PEAK
        - factor.diagonal().iter().map(|x| x.ln()).sum::<f64>()
        - 0.5 * student_t.cost_of(whitened(&factor, &off).norm_squared(), 3);
    let log_volume = maps.a.log_volume().min(maps.b.log_volume() + 3.0 * log_scale);
    let of_place = LOG_ODDS_COMMON - (candidate.alike as f64).ln() + log_volume + log_density;
    if of_place <= 0.0 {
        return None;
    }
    // Objects of a category are alike: shapes that agree say nothing, those that do not speak against the pair.
    let factor = moved.shape_factor(maps, pair)? * widen;
    let off = whitened(&factor, &moved.shape_difference(maps, pair));
    let of_shape = 0.5 * (student_t.cost_of(6.0, 6) - student_t.cost_of(off.norm_squared(), 6));
    Some(of_place + of_shape.min(0.0))
}

/// The pairs of objects that a transform brings together, with the sum of their gains.
pub(super) fn matches(maps: &PreparedMaps, a_from_b: &Similarity, widen: f64) -> (Vec<(usize, usize)>, f64) {
    let moved = Moved::new(maps, a_from_b);
    let log_scale = a_from_b.scale.ln();
    let pair = |candidate: &Candidate| {
        let gain = gain(maps, &moved, candidate, log_scale, widen).filter(|gain| *gain > 0.0)?;
        Some(Pair { row: candidate.a as u32, column: candidate.b as u32, gain })
    };
    let pairs: Vec<Pair> = maps.candidates.iter().filter_map(pair).collect();
    let chosen = best_pairs(&pairs);
    let sum = chosen.iter().map(|&k| pairs[k].gain).sum();
    let mut found: Vec<_> = chosen.iter().map(|&k| (pairs[k].row as usize, pairs[k].column as usize)).collect();
    found.sort_unstable();
    (found, sum)
}

/// The sum of the best gain of each object of A, with widened errors: a quick score of a start.
pub(super) fn quick_score(maps: &PreparedMaps, a_from_b: &Similarity) -> f64 {
    let moved = Moved::new(maps, a_from_b);
    let log_scale = a_from_b.scale.ln();
    let mut best = vec![0.0f64; maps.a.objects.len()];
    for candidate in &maps.candidates {
        if let Some(gain) = gain(maps, &moved, candidate, log_scale, WIDEN) {
            best[candidate.a] = best[candidate.a].max(gain);
        }
    }
    best.iter().sum()
}

/// The transform near a start that explains most, with its evidence; `None` where it explains too little. Everything is relative to
/// the middles of the maps.
pub(super) fn aligned(maps: &PreparedMaps, start: Similarity) -> Option<MapTransform> {
    let mut a_from_b = start;
    let mut before = Vec::new();
    let mut refined: Option<Refined> = None;
    for round in 0..ROUNDS {
        let widen = if round == 0 { WIDEN } else { 1.0 };
        let found = if round < MATCHING_ROUNDS { matches(maps, &a_from_b, widen).0 } else { before.clone() };
        if found.len() < maps.needed() {
            return None;
        }
        let better = refine(maps, &a_from_b, &found, STEPS)?;
        let change = (better.a_from_b.matrix() - a_from_b.matrix()).norm();
        a_from_b = better.a_from_b;
        let stands = found == before && change < SETTLED * a_from_b.matrix().norm();
        before = found;
        refined = Some(better);
        if round > 1 && stands {
            break;
        }
    }
    let Refined { pivot, information, .. } = refined?;
    let (found, gains) = matches(maps, &a_from_b, 1.0);
    if found.len() < maps.needed() {
        return None;
    }
    let free = if maps.options.scale.is_some() { 6.0 } else { 7.0 };
    let log_determinant = 2.0 * cholesky(&information)?.diagonal().iter().map(|x| x.ln()).sum::<f64>();
    // Laplace's approximation: the share of all transforms that this one takes.
    let mut evidence = gains + 0.5 * (free * TAU.ln() - log_determinant) - log_volume(maps, a_from_b.scale);
    if let Some(known) = &maps.options.up {
        let up = a_from_b.rotation * known.up_in_b.into_inner();
        let off = up.cross(&known.up_in_a.into_inner()).norm() / known.sd;
        // Against a direction that is anywhere on the sphere.
        evidence += (4.0 * PI / (TAU * known.sd * known.sd)).ln() - 0.5 * off * off;
    }
    let mut covariance = invert_spd(&information)? * misfit(maps, &a_from_b, &found, free);
    if maps.options.scale.is_some() {
        covariance.fill_row(6, 0.0);
        covariance.fill_column(6, 0.0);
    }
    let finite = evidence.is_finite() && a_from_b.is_valid();
    finite.then(|| MapTransform { a_from_b, covariance, pivot: pivot.into(), matches: found, evidence })
}

/// The mean squared residual of the centers in standard deviations, where that is more than 1: covariances of estimates may be too small.
fn misfit(maps: &PreparedMaps, a_from_b: &Similarity, pairs: &[(usize, usize)], free: f64) -> f64 {
    let moved = Moved::new(maps, a_from_b);
    let student_t = StudentT::new(DOF);
    let squares = pairs.iter().filter_map(|&pair| {
        let off = maps.a.objects[pair.0].center - moved.centers[pair.1].0;
        let squares = whitened(&moved.center_factor(maps, pair)?, &off).norm_squared();
        Some(squares * student_t.weight_of(squares, 3))
    });
    let left = 3.0 * pairs.len() as f64 - free;
    if left > 0.0 { (squares.sum::<f64>() / left).max(1.0) } else { 1.0 }
}

/// Logarithm of the volume of all transforms: rotations, translations with which the maps overlap, scales.
fn log_volume(maps: &PreparedMaps, scale: f64) -> f64 {
    let of_translations: f64 = (maps.a.extents + maps.b.extents * scale).iter().map(|x| x.ln()).sum();
    let of_scales = if maps.options.scale.is_some() { 0.0 } else { (TAU.sqrt() * LOG_SCALE_SD).ln() };
    (8.0 * PI * PI).ln() + of_translations + of_scales
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::gamma::ln_gamma;

    #[test]
    fn constants_are_those_of_the_distribution() {
        let peak = ln_gamma((DOF + 3.0) / 2.0) - ln_gamma(DOF / 2.0) - 1.5 * (DOF * PI).ln();
        assert!((peak - LOG_PEAK).abs() < 1e-4, "{peak}");
        assert!(((0.3f64 / 0.7).ln() - LOG_ODDS_COMMON).abs() < 1e-4);
    }
}
