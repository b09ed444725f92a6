//! Cuboids (oriented boxes in space).

use nalgebra::{Point3, Rotation3, Vector3};

use super::convex_body::ConvexBody;
use super::ellipsoid::Ellipsoid;

/// An oriented cuboid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cuboid {
    /// Center in the world.
    pub center: Point3<f64>,
    /// Half extents in world units, in the order of the columns of `rotation`.
    pub half_extents: Vector3<f64>,
    /// Rotation `world_from_object`: its columns are the axes.
    pub rotation: Rotation3<f64>,
}

impl Cuboid {
    /// The eight corners in the world; bit k of the index chooses the sign along axis k.
    pub fn corners(&self) -> [Point3<f64>; 8] {
        std::array::from_fn(|k| {
            let sign = |axis: usize| if k >> axis & 1 == 1 { 1.0 } else { -1.0 };
            let offset = Vector3::from_fn(|axis, _| sign(axis) * self.half_extents[axis]);
            self.center + self.rotation * offset
        })
    }

    /// The inscribed ellipsoid: the same center and axes, the half extents as semi-axes.
    pub fn inscribed_ellipsoid(&self) -> Ellipsoid {
        Ellipsoid { center: self.center, semi_axes: self.half_extents, rotation: self.rotation }
    }

    /// The same cuboid, `factor` times as large about its center.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { half_extents: self.half_extents * factor, ..*self }
    }
}

impl ConvexBody for Cuboid {
    fn center(&self) -> Point3<f64> {
        self.center
    }

    fn support(&self, n: &Vector3<f64>) -> f64 {
        (self.rotation.inverse() * n).component_mul(&self.half_extents).abs().sum()
    }

    fn volume(&self) -> f64 {
        8.0 * self.half_extents.product()
    }

    fn contains(&self, point: &Point3<f64>) -> bool {
        let local = self.rotation.inverse() * (point - self.center);
        (0..3).all(|i| local[i].abs() <= self.half_extents[i])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_support_is_reached_at_a_corner() {
        let cuboid = Cuboid {
            center: Point3::new(1.0, 2.0, 3.0),
            half_extents: Vector3::new(2.0, 1.0, 0.5),
            rotation: Rotation3::from_euler_angles(0.4, -0.3, 1.2),
        };
        let n = Vector3::new(0.3, -0.8, 0.2);
        let reach = cuboid.corners().iter().map(|c| n.dot(&(c - cuboid.center))).fold(f64::MIN, f64::max);
        assert!((cuboid.support(&n) - reach).abs() < 1e-12);
        assert!(cuboid.contains(&cuboid.center));
        assert!(!cuboid.contains(&(cuboid.center + Vector3::new(5.0, 0.0, 0.0))));
        assert!((cuboid.volume() - 8.0).abs() < 1e-12);
    }
}
