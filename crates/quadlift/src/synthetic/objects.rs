//! The objects: random places, sizes and orientations.

use nalgebra::{Point3, Rotation3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::random;
use crate::geometry::{Body, Cuboid, Ellipsoid, Superellipsoid};
use crate::solve::BodyKind;

/// Side of the cube that holds the centres.
const CUBE_SIDE: f64 = 20.0;

/// What is drawn of an object, in a world that is neither scaled nor moved.
pub(super) struct Object {
    center: Point3<f64>,
    semi_axes: Vector3<f64>,
    rotation: Rotation3<f64>,
}

impl Object {
    /// Draws an object as in PfD section 5.1: centre in a cube of side 20 about the origin, full length of the longest
    /// axis (the first one) from [3, 12], the others that times a factor from [0.3, 1], any orientation.
    pub(super) fn draw(rng: &mut ChaCha8Rng) -> Self {
        let half = 0.5 * CUBE_SIDE;
        let center = Point3::from(Vector3::from_fn(|_, _| rng.random_range(-half..half)));
        let longest = 0.5 * rng.random_range(3.0..12.0);
        let semi_axes =
            Vector3::new(longest, longest * rng.random_range(0.3..1.0), longest * rng.random_range(0.3..1.0));
        Self { center, semi_axes, rotation: random::rotation(rng) }
    }

    /// The body, in a world multiplied by `scale` and then moved by `offset`.
    pub(super) fn body(&self, kind: BodyKind, scale: f64, offset: &Vector3<f64>) -> Body {
        let (center, semi_axes, rotation) = (self.center * scale + offset, self.semi_axes * scale, self.rotation);
        match kind {
            BodyKind::Ellipsoid => Body::Ellipsoid(Ellipsoid { center, semi_axes, rotation }),
            BodyKind::Cuboid => Body::Cuboid(Cuboid { center, half_extents: semi_axes, rotation }),
            BodyKind::Superellipsoid(support_exponent) => {
                Body::Superellipsoid(Superellipsoid { center, semi_axes, rotation, support_exponent })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_sizes_fill_their_ranges() {
        let mut rng = random::stream(7, 0);
        let objects: Vec<Object> = (0..2000).map(|_| Object::draw(&mut rng)).collect();
        let assert_fills = |f: fn(&Object) -> f64, low: f64, high: f64| {
            let least = objects.iter().map(f).fold(f64::MAX, f64::min);
            let most = objects.iter().map(f).fold(f64::MIN, f64::max);
            let (rounding, gap) = (1e-12, 0.01 * (high - low));
            assert!(least > low - rounding && least < low + gap, "{least} {low}");
            assert!(most < high + rounding && most > high - gap, "{most} {high}");
        };
        assert_fills(|o| o.center.x, -10.0, 10.0);
        assert_fills(|o| o.center.y, -10.0, 10.0);
        assert_fills(|o| o.center.z, -10.0, 10.0);
        assert_fills(|o| 2.0 * o.semi_axes.x, 3.0, 12.0);
        assert_fills(|o| o.semi_axes.y / o.semi_axes.x, 0.3, 1.0);
        assert_fills(|o| o.semi_axes.z / o.semi_axes.x, 0.3, 1.0);
    }
}
