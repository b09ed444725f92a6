//! Bodies of any kind.

use nalgebra::{Point3, Rotation3, Vector3};

use super::convex_body::ConvexBody;
use super::ellipsoid::Ellipsoid;
use super::kinds::BodyKind;
use super::reach::ellipsoid_of_same_reach;

/// A body of any kind, in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body {
    /// Center in the world.
    pub center: Point3<f64>,
    /// Rotation `world_from_object`: its columns are the axes of the body.
    pub rotation: Rotation3<f64>,
    /// Half extents of the cuboid around the body, in the order of the columns of `rotation`: the semi-axes of an ellipsoid or
    /// superellipsoid, the radii and half the height of a cylinder. World units.
    pub half_extents: Vector3<f64>,
    /// Kind.
    pub kind: BodyKind,
}

impl Body {
    /// The same body, `factor` times as large about its center.
    pub fn scaled(&self, factor: f64) -> Self {
        Self { half_extents: self.half_extents * factor, ..*self }
    }

    /// The ellipsoid closest to the body: itself, or the one that reaches about as far in all directions, see
    /// `ellipsoid_of_same_reach`.
    pub fn closest_ellipsoid(&self) -> Ellipsoid {
        if self.kind == BodyKind::Ellipsoid { self.inscribed() } else { ellipsoid_of_same_reach(self, &self.rotation) }
    }

    /// The point of the body, from its center, that lies farthest along `n`: its support function is `n` times it. Of an edge or a face that
    /// is perpendicular to `n`, a point of it.
    pub(crate) fn support_point(&self, n: &Vector3<f64>) -> Vector3<f64> {
        let along = self.rotation.inverse() * n;
        let (_, share) = self.kind.support_gradient(&along.abs().component_mul(&self.half_extents));
        let sign = along.map(|x| if x < 0.0 { -1.0 } else { 1.0 });
        self.rotation * share.component_mul(&self.half_extents).component_mul(&sign)
    }

    /// The ellipsoid with the same center and axes and the half extents as semi-axes.
    pub fn inscribed(&self) -> Ellipsoid {
        Ellipsoid { center: self.center, semi_axes: self.half_extents, rotation: self.rotation }
    }

    /// The eight corners of the cuboid around the body, in the world; bit k of the index chooses the sign along axis k.
    pub fn corners(&self) -> [Point3<f64>; 8] {
        std::array::from_fn(|k| {
            let sign = |axis: usize| if k >> axis & 1 == 1 { 1.0 } else { -1.0 };
            let offset = Vector3::from_fn(|axis, _| sign(axis) * self.half_extents[axis]);
            self.center + self.rotation * offset
        })
    }
}

impl From<Ellipsoid> for Body {
    fn from(Ellipsoid { center, semi_axes, rotation }: Ellipsoid) -> Self {
        Self { center, rotation, half_extents: semi_axes, kind: BodyKind::Ellipsoid }
    }
}

impl ConvexBody for Body {
    fn center(&self) -> Point3<f64> {
        self.center
    }

    fn support(&self, n: &Vector3<f64>) -> f64 {
        self.kind.support(&(self.rotation.inverse() * n).component_mul(&self.half_extents))
    }

    fn volume(&self) -> f64 {
        self.kind.volume(&self.half_extents)
    }

    fn contains(&self, point: &Point3<f64>) -> bool {
        self.kind.contains(&(self.rotation.inverse() * (point - self.center)), &self.half_extents)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    fn body(kind: BodyKind) -> Body {
        Body {
            center: Point3::new(1.0, 2.0, 3.0),
            half_extents: Vector3::new(2.0, 1.0, 0.5),
            rotation: Rotation3::from_euler_angles(0.4, -0.3, 1.2),
            kind,
        }
    }

    /// Points of the body reach as far as the support function says, and the body fills as much of the cuboid around it as
    /// its volume says.
    #[test]
    fn support_and_volume_agree_with_sampling() {
        let n = Vector3::new(0.3, -0.8, 0.2);
        for kind in BodyKind::ALL.into_iter().chain([BodyKind::Superellipsoid(1.3)]) {
            let body = body(kind);
            let mut rng = rand_chacha::ChaCha8Rng::seed_from_u64(1);
            let (mut inside, mut reach) = (0, 0.0f64);
            for _ in 0..200_000 {
                let local = body.half_extents.map(|half| rng.random_range(-half..half));
                let offset = body.rotation * local;
                if body.contains(&(body.center + offset)) {
                    inside += 1;
                    reach = reach.max(n.dot(&offset));
                }
            }
            let volume = 8.0 * body.half_extents.product() * f64::from(inside) / 200_000.0;
            assert!((volume / body.volume() - 1.0).abs() < 0.01, "{kind:?}: {volume}");
            assert!((0.0..0.05).contains(&(1.0 - reach / body.support(&n))), "{kind:?}: {reach}");
            assert!(!body.contains(&(body.center + Vector3::new(5.0, 0.0, 0.0))));
        }
    }

    #[test]
    fn support_points_reach_as_far_as_the_body() {
        for kind in BodyKind::ALL {
            let body = body(kind);
            for n in [Vector3::new(0.3, -0.8, 0.2), Vector3::z(), -Vector3::x() * 2.0] {
                let point = body.support_point(&n);
                assert!((n.dot(&point) - body.support(&n)).abs() < 1e-12, "{kind:?}");
                assert!(body.contains(&(body.center + point * (1.0 - 1e-12))), "{kind:?}");
            }
        }
    }

    #[test]
    fn the_support_is_reached_at_a_corner_and_on_the_rims() {
        let cuboid = body(BodyKind::Cuboid);
        let cylinder = body(BodyKind::Cylinder);
        for n in [Vector3::new(0.3, -0.8, 0.2), Vector3::z(), -Vector3::x() * 2.0] {
            let reach = cuboid.corners().iter().map(|c| n.dot(&(c - cuboid.center))).fold(f64::MIN, f64::max);
            assert!((cuboid.support(&n) - reach).abs() < 1e-12);
            let rim = (0..100_000).map(|k| {
                let (sin, cos) = (f64::from(k) * 1e-5 * std::f64::consts::TAU).sin_cos();
                let top = if k % 2 == 0 { 0.5 } else { -0.5 };
                n.dot(&(cylinder.rotation * Vector3::new(2.0 * cos, sin, top)))
            });
            assert!((cylinder.support(&n) - rim.fold(f64::MIN, f64::max)).abs() < 1e-6);
        }
        assert!((cuboid.volume() - 8.0).abs() < 1e-12);
    }
}
