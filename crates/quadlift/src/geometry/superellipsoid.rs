//! Superellipsoids, described by the exponent of their support function.

use nalgebra::{Point3, Rotation3, Vector3};

use super::convex_body::ConvexBody;
use super::gamma::ln_gamma;

/// A body between cuboid and ellipsoid: its support function is `(sum |a_i u_i|^q)^(1/q)`.
///
/// `q` = 1 is the cuboid, `q` = 2 the ellipsoid. The body itself is `sum |x_i / a_i|^p <= 1` with `p = q / (q - 1)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Superellipsoid {
    /// Center in the world.
    pub center: Point3<f64>,
    /// Semi-axes in world units, in the order of the columns of `rotation`.
    pub semi_axes: Vector3<f64>,
    /// Rotation `world_from_object`: its columns are the axes.
    pub rotation: Rotation3<f64>,
    /// Exponent q of the support function, in [1, 2].
    pub support_exponent: f64,
}

/// `(sum |v_i|^q)^(1/q)`, exact for q = 1 and q = 2.
pub(super) fn q_norm(v: &Vector3<f64>, q: f64) -> f64 {
    if q == 1.0 {
        return v.abs().sum();
    }
    if q == 2.0 {
        return v.norm();
    }
    let largest = v.amax();
    if largest == 0.0 {
        return 0.0;
    }
    largest * v.map(|x| (x.abs() / largest).powf(q)).sum().powf(1.0 / q)
}

impl Superellipsoid {
    /// The same body, `factor` times as large about its center.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { semi_axes: self.semi_axes * factor, ..*self }
    }
}

impl ConvexBody for Superellipsoid {
    fn center(&self) -> Point3<f64> {
        self.center
    }

    fn support(&self, n: &Vector3<f64>) -> f64 {
        q_norm(&(self.rotation.inverse() * n).component_mul(&self.semi_axes), self.support_exponent)
    }

    fn volume(&self) -> f64 {
        if self.support_exponent <= 1.0 {
            return 8.0 * self.semi_axes.product();
        }
        let p = self.support_exponent / (self.support_exponent - 1.0);
        8.0 * self.semi_axes.product() * (3.0 * ln_gamma(1.0 + 1.0 / p) - ln_gamma(1.0 + 3.0 / p)).exp()
    }

    fn contains(&self, point: &Point3<f64>) -> bool {
        let local = (self.rotation.inverse() * (point - self.center)).component_div(&self.semi_axes);
        if self.support_exponent <= 1.0 {
            return local.amax() <= 1.0;
        }
        q_norm(&local, self.support_exponent / (self.support_exponent - 1.0)) <= 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    #[test]
    fn limits_are_cuboid_and_ellipsoid() {
        let v = Vector3::new(1.0, -2.0, 0.5);
        assert_eq!(q_norm(&v, 1.0), 3.5);
        assert!((q_norm(&v, 1.5) - (1.0 + 2.0f64.powf(1.5) + 0.5f64.powf(1.5)).powf(2.0 / 3.0)).abs() < 1e-12);
        assert_eq!(q_norm(&Vector3::zeros(), 1.5), 0.0);
    }

    #[test]
    fn the_volume_agrees_with_sampling() {
        let body = Superellipsoid {
            center: Point3::origin(),
            semi_axes: Vector3::new(1.0, 1.0, 1.0),
            rotation: Rotation3::identity(),
            support_exponent: 1.3,
        };
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let (mut inside, n) = (0.0, 400_000);
        for _ in 0..n {
            let p = Point3::from(Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0)));
            if body.contains(&p) {
                inside += 1.0;
            }
        }
        assert!((8.0 * inside / n as f64 - body.volume()).abs() < 0.02 * body.volume());
    }
}
