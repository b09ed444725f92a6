//! Random numbers beyond the rand crate: normal numbers, uniform rotations, separate streams of one seed.

use nalgebra::{Quaternion, Rotation3, UnitQuaternion};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// The generator number `stream` of a seed; those of different numbers are independent.
pub fn stream(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}

/// A number from the standard normal distribution (Box-Muller: always two draws, the second value is not kept).
pub fn normal(rng: &mut ChaCha8Rng) -> f64 {
    // 1 - u lies in (0, 1]: its logarithm is finite.
    let radius = (-2.0 * (1.0 - rng.random_range(0.0..1.0f64)).ln()).sqrt();
    radius * rng.random_range(0.0..std::f64::consts::TAU).cos()
}

/// A uniformly distributed rotation: four normal numbers, normalized, are a uniform unit quaternion.
pub fn rotation(rng: &mut ChaCha8Rng) -> Rotation3<f64> {
    let [w, x, y, z] = std::array::from_fn(|_| normal(rng));
    UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).to_rotation_matrix()
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Matrix3;

    #[test]
    fn normal_numbers_have_the_moments_of_the_normal_distribution() {
        let mut rng = stream(1, 0);
        let n = 200_000;
        let x: Vec<f64> = (0..n).map(|_| normal(&mut rng)).collect();
        let moment = |k: i32| x.iter().map(|x| x.powi(k)).sum::<f64>() / n as f64;
        // Standard errors: 0.0022, 0.0032, 0.0087, 0.022; bounds at four of them.
        assert!(moment(1).abs() < 0.009);
        assert!((moment(2) - 1.0).abs() < 0.013);
        assert!(moment(3).abs() < 0.035);
        assert!((moment(4) - 3.0).abs() < 0.088);
        let beyond = x.iter().filter(|x| x.abs() > 1.959964).count() as f64 / n as f64;
        assert!((beyond - 0.05).abs() < 0.002);
    }

    #[test]
    fn rotations_are_uniform() {
        let mut rng = stream(2, 0);
        let n = 20_000;
        let (mut mean, mut square, mut fourth) = (Matrix3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        for _ in 0..n {
            let r = rotation(&mut rng).into_inner();
            assert!((r * r.transpose() - Matrix3::identity()).amax() < 1e-14 && r.determinant() > 0.0);
            mean += r / n as f64;
            square += r.map(|x| x * x) / n as f64;
            fourth += r.map(|x| x.powi(4)) / n as f64;
        }
        // Each entry of a uniform rotation is uniform on [-1, 1]: moments 0, 1/3, 1/5.
        assert!(mean.amax() < 0.02);
        assert!((square - Matrix3::repeat(1.0 / 3.0)).amax() < 0.01);
        assert!((fourth - Matrix3::repeat(0.2)).amax() < 0.01);
    }

    #[test]
    fn streams_differ_and_repeat() {
        let first = |seed, number| normal(&mut stream(seed, number));
        assert_eq!(first(3, 1), first(3, 1));
        assert_ne!(first(3, 1), first(3, 2));
        assert_ne!(first(3, 1), first(4, 1));
    }
}
