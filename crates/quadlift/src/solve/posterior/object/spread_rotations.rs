//! Rotations from which an oriented body starts, spread evenly over those that differ for a cuboid.

use std::sync::LazyLock;

use nalgebra::{Matrix3, UnitQuaternion};

use crate::geometry::rotation::rotation_of_cube;
use crate::sorting::StableSort;

/// Rotations of a round, and rounds that have their own.
const OF_EACH_ROUND: usize = 16;
const ROUNDS: usize = 5;

/// Rotations among which each is the farthest from those before it.
const CANDIDATES: usize = 32;

/// The root of `x^4 = x + 1`: multiples of its powers fill the unit cube more evenly than random points
/// (Roberts 2018, the sequence R3).
const EVEN_STEP: f64 = 1.220_744_084_605_759_5;

static ALL: LazyLock<Vec<UnitQuaternion<f64>>> = LazyLock::new(|| {
    let mut chosen: Vec<UnitQuaternion<f64>> = Vec::with_capacity(ROUNDS * OF_EACH_ROUND);
    for k in 0..ROUNDS * OF_EACH_ROUND {
        let nearness = |to: &UnitQuaternion<f64>| chosen.iter().map(|from| nearness(from, to)).fold(0.0, f64::max);
        let candidates = (0..CANDIDATES).map(|candidate| evenly(k * CANDIDATES + candidate));
        let farthest = candidates.map(|candidate| (nearness(&candidate), candidate)).min_by(|a, b| a.0.total_cmp(&b.0));
        chosen.extend(farthest.map(|(_, rotation)| rotation));
    }
    chosen
});

/// The rotations of a round, by no accident of a seed.
pub(crate) fn spread_rotations(round: usize) -> impl Iterator<Item = Matrix3<f64>> {
    let first = round % ROUNDS * OF_EACH_ROUND;
    ALL[first..first + OF_EACH_ROUND].iter().map(|rotation| rotation.to_rotation_matrix().into_inner())
}

/// One of a sequence of rotations that fills their space evenly.
fn evenly(k: usize) -> UnitQuaternion<f64> {
    let point = [1, 2, 3].map(|power| (0.5 + (k + 1) as f64 / EVEN_STEP.powi(power)).fract());
    UnitQuaternion::from_rotation_matrix(&rotation_of_cube(point))
}

/// Cosine of half the smallest angle between two cuboids of these rotations, which are the same after the 24 rotations of a
/// cube: those have the quaternions `(1, 0, 0, 0)`, `(1, 1, 0, 0) / sqrt 2` and `(1, 1, 1, 1) / 2` with any order and signs.
fn nearness(from: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>) -> f64 {
    let mut turn: [f64; 4] = (from.inverse() * to).coords.abs().into();
    turn.stable_sort_by(|a, b| b.total_cmp(a));
    let [a, b, c, d] = turn;
    a.max((a + b) * std::f64::consts::FRAC_1_SQRT_2).max(0.5 * (a + b + c + d))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::solve::posterior::object::alternatives::symmetries;

    fn angle(from: &UnitQuaternion<f64>, to: &UnitQuaternion<f64>) -> f64 {
        2.0 * nearness(from, to).min(1.0).acos().to_degrees()
    }

    #[test]
    fn cuboids_are_compared_by_all_names_of_their_axes() {
        for k in 0..20 {
            let (from, to) = (evenly(k), evenly(k + 50));
            let turn = from.to_rotation_matrix().matrix().transpose() * to.to_rotation_matrix().matrix();
            let cosine = |symmetry: &Matrix3<f64>| (((turn * symmetry).trace() - 1.0) / 2.0).clamp(-1.0, 1.0);
            let expected = symmetries().iter().map(cosine).fold(-1.0, f64::max).acos().to_degrees();
            assert!((angle(&from, &to) - expected).abs() < 1e-6, "{} {expected}", angle(&from, &to));
        }
    }

    /// One rotation of each round is near any cuboid, and one of all rounds nearer. No two are alike.
    #[test]
    fn rotations_are_spread_evenly() {
        let spread = |starts: &[UnitQuaternion<f64>]| {
            let nearest = |to| starts.iter().map(|from| angle(from, &to)).fold(180.0, f64::min);
            let angles: Vec<f64> = (10_000..11_000).map(|k| nearest(evenly(k))).collect();
            (angles.iter().sum::<f64>() / angles.len() as f64, angles.iter().copied().fold(0.0, f64::max))
        };
        for round in ALL.chunks(OF_EACH_ROUND) {
            let (mean, farthest) = spread(round);
            assert!(mean < 19.0 && farthest < 38.0, "{mean} {farthest}");
        }
        let (mean, farthest) = spread(&ALL);
        assert!(mean < 10.5 && farthest < 18.0, "{mean} {farthest}");
        for (k, one) in ALL.iter().enumerate() {
            assert!(ALL[..k].iter().all(|other| angle(one, other) > 10.0));
        }
    }

    #[test]
    fn rounds_have_rotations_of_their_own_and_come_again_after_the_last() {
        let all: Vec<Vec<Matrix3<f64>>> = (0..ROUNDS).map(|round| spread_rotations(round).collect()).collect();
        assert!(all.iter().all(|of_round| of_round.len() == 16));
        for (a, b) in (0..ROUNDS).flat_map(|a| (0..a).map(move |b| (a, b))) {
            assert!(all[a].iter().all(|one| all[b].iter().all(|other| (one - other).amax() > 1e-3)), "{a} {b}");
        }
        assert_eq!(spread_rotations(ROUNDS + 1).collect::<Vec<_>>(), all[1]);
    }
}
