//! Cylinders (upright or lying, with an elliptic base).

use nalgebra::{Point3, Rotation3, Vector2, Vector3};

use super::convex_body::ConvexBody;

/// A cylinder whose base is an ellipse.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cylinder {
    /// Center in the world.
    pub center: Point3<f64>,
    /// Semi-axes of the base along the first two columns of `rotation`, world units.
    pub radii: Vector2<f64>,
    /// Half the height, along the third column of `rotation`, world units.
    pub half_height: f64,
    /// Rotation `world_from_object`: its columns are the axes, the third one that of the cylinder.
    pub rotation: Rotation3<f64>,
}

impl Cylinder {
    /// Half extents of the cuboid around the cylinder, in the order of the columns of `rotation`.
    pub fn half_extents(&self) -> Vector3<f64> {
        Vector3::new(self.radii.x, self.radii.y, self.half_height)
    }

    /// The cylinder in a cuboid with these half extents, its axis along the third one.
    pub fn from_half_extents(center: Point3<f64>, half_extents: Vector3<f64>, rotation: Rotation3<f64>) -> Self {
        Self { center, radii: half_extents.xy(), half_height: half_extents.z, rotation }
    }

    /// The same cylinder, `factor` times as large about its center.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { radii: self.radii * factor, half_height: self.half_height * factor, ..*self }
    }
}

impl ConvexBody for Cylinder {
    fn center(&self) -> Point3<f64> {
        self.center
    }

    fn support(&self, n: &Vector3<f64>) -> f64 {
        let u = self.rotation.inverse() * n;
        (self.radii.x * u.x).hypot(self.radii.y * u.y) + self.half_height * u.z.abs()
    }

    fn volume(&self) -> f64 {
        2.0 * std::f64::consts::PI * self.radii.x * self.radii.y * self.half_height
    }

    fn contains(&self, point: &Point3<f64>) -> bool {
        let local = self.rotation.inverse() * (point - self.center);
        local.z.abs() <= self.half_height && (local.x / self.radii.x).hypot(local.y / self.radii.y) <= 1.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn cylinder() -> Cylinder {
        Cylinder {
            center: Point3::new(1.0, 2.0, 3.0),
            radii: Vector2::new(2.0, 1.0),
            half_height: 0.5,
            rotation: Rotation3::from_euler_angles(0.4, -0.3, 1.2),
        }
    }

    #[test]
    fn the_support_is_reached_on_the_rims() {
        let body = cylinder();
        for n in [Vector3::new(0.3, -0.8, 0.2), Vector3::z(), -Vector3::x() * 2.0] {
            let rim = (0..100_000).map(|k| {
                let (sin, cos) = (f64::from(k) * 1e-5 * std::f64::consts::TAU).sin_cos();
                let top = if k % 2 == 0 { 0.5 } else { -0.5 };
                n.dot(&(body.rotation * Vector3::new(2.0 * cos, sin, top)))
            });
            assert!((body.support(&n) - rim.fold(f64::MIN, f64::max)).abs() < 1e-6);
        }
        assert_eq!(Cylinder::from_half_extents(body.center, body.half_extents(), body.rotation), body);
    }

    #[test]
    fn volume_and_second_moments_agree_with_sampling() {
        let body = cylinder();
        let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let (mut inside, n) = (0.0, 400_000);
        for _ in 0..n {
            let local = body.half_extents().map(|half| rng.random_range(-half..half));
            if body.contains(&(body.center + body.rotation * local)) {
                inside += 1.0;
            }
        }
        let box_volume = 8.0 * body.half_extents().product();
        assert!((box_volume * inside / f64::from(n) / body.volume() - 1.0).abs() < 0.01);
    }
}
