//! Evenly spread rotations and axes.

use std::f64::consts::{PI, TAU};
use std::sync::OnceLock;

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};

/// Number of rotations in the table.
const COUNT: usize = 250;

/// Number of candidates among which they are chosen.
const CANDIDATES: usize = 3000;

/// The first `count` (at most 250) of a list of rotations of which each is as far from the ones before as possible, where the 24 turns
/// of a cube count as none: about evenly spread over what a cuboid may be.
pub(super) fn spread_rotations(count: usize) -> &'static [Matrix3<f64>] {
    static TABLE: OnceLock<Vec<Matrix3<f64>>> = OnceLock::new();
    &TABLE.get_or_init(table)[..count.min(COUNT)]
}

fn table() -> Vec<Matrix3<f64>> {
    let candidates: Vec<Quaternion<f64>> = (0..CANDIDATES).map(on_spiral).collect();
    let turns = turns_of_cube();
    // Cosine of half the angle to the nearest chosen rotation.
    let mut nearest = vec![-1.0f64; CANDIDATES];
    let mut chosen = vec![Quaternion::identity()];
    while chosen.len() < COUNT {
        let last = chosen[chosen.len() - 1];
        let turned: Vec<Quaternion<f64>> = turns.iter().map(|turn| last * turn).collect();
        for (near, candidate) in nearest.iter_mut().zip(&candidates) {
            *near = turned.iter().map(|one| one.dot(candidate).abs()).fold(*near, f64::max);
        }
        let farthest = (0..CANDIDATES).min_by(|&a, &b| nearest[a].total_cmp(&nearest[b]));
        chosen.extend(farthest.map(|k| candidates[k]));
    }
    chosen.into_iter().map(|q| *UnitQuaternion::new_normalize(q).to_rotation_matrix().matrix()).collect()
}

/// The super-Fibonacci spiral over the unit quaternions (Alexa, CVPR 2022).
fn on_spiral(index: usize) -> Quaternion<f64> {
    const PSI: f64 = 1.533_751_168_755_204_3;
    let s = (index as f64 + 0.5) / CANDIDATES as f64;
    let (alpha, beta) = (TAU * index as f64 / 2f64.sqrt(), TAU * index as f64 / PSI);
    let (r, rest) = (s.sqrt(), (1.0 - s).sqrt());
    Quaternion::new(r * alpha.sin(), r * alpha.cos(), rest * beta.sin(), rest * beta.cos())
}

/// The 24 rotations of a cube.
fn turns_of_cube() -> Vec<Quaternion<f64>> {
    let half = 0.5f64.sqrt();
    let mut turns = Vec::with_capacity(24);
    for i in 0..4 {
        let unit = |k: usize, x: f64| nalgebra::Vector4::from_fn(|row, _| if row == k { x } else { 0.0 });
        turns.push(Quaternion::from(unit(i, 1.0)));
        for j in i + 1..4 {
            turns.extend([half, -half].map(|other| Quaternion::from(unit(i, half) + unit(j, other))));
        }
    }
    let sign = |bits: usize, k: usize| if bits >> k & 1 == 0 { 0.5 } else { -0.5 };
    turns.extend((0..8).map(|bits| Quaternion::new(0.5, sign(bits, 0), sign(bits, 1), sign(bits, 2))));
    turns
}

/// Evenly spread axes over half a sphere, about the third one.
pub(super) fn spread_axes(count: usize) -> impl Iterator<Item = Vector3<f64>> {
    let golden_angle = PI * (3.0 - 5f64.sqrt());
    (0..count).map(move |k| {
        let z = (k as f64 + 0.5) / count as f64;
        let across = (1.0 - z * z).sqrt();
        let (sin, cos) = (golden_angle * k as f64).sin_cos();
        Vector3::new(across * cos, across * sin, z)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotations_cover_those_of_a_cuboid() {
        let turns = turns_of_cube();
        assert_eq!(turns.len(), 24);
        let rotations: Vec<Quaternion<f64>> =
            spread_rotations(80).iter().map(|m| *UnitQuaternion::from_matrix(m).quaternion()).collect();
        // Any rotation is within 30 degrees of one of 80; the cuboid's half turn is 63.
        let farthest = (0..CANDIDATES).map(|k| {
            let one = on_spiral(k);
            let cosine = |q: &Quaternion<f64>| turns.iter().map(|turn| (q * turn).dot(&one).abs()).fold(0.0, f64::max);
            2.0 * rotations.iter().map(cosine).fold(0.0, f64::max).min(1.0).acos()
        });
        let farthest = farthest.fold(0.0, f64::max).to_degrees();
        assert!(farthest < 30.0, "{farthest}");
    }
}
