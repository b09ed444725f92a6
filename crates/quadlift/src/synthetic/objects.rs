//! The objects: random places, sizes and orientations.

use nalgebra::{Point3, Rotation3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::options::Trajectory;
use crate::geometry::{Body, BodyKind};
use crate::random;

/// Height of the objects' centers on a floor relative to those in a cube.
const FLOOR_HEIGHT: f64 = 0.15;

/// Distance of parked cars along a street, and half extents of a car.
const CAR_GAP: f64 = 6.0;
const CAR: Vector3<f64> = Vector3::new(2.1, 0.85, 0.75);

/// An object in the world before scaling and translation.
pub(super) struct Object {
    pub(super) center: Point3<f64>,
    pub(super) semi_axes: Vector3<f64>,
    rotation: Rotation3<f64>,
}

impl Object {
    /// Draws the object with this number: parked along a street, or anywhere in a cube (flattened to a floor).
    pub(super) fn draw(index: usize, trajectory: Trajectory, cube_side: f64, rng: &mut ChaCha8Rng) -> Self {
        if trajectory == Trajectory::Street {
            return Self::draw_parked(index, rng);
        }
        let mut object = Self::draw_in_cube(cube_side, rng);
        if trajectory == Trajectory::Random {
            object.center.z *= FLOOR_HEIGHT;
        }
        object
    }

    /// The same object upright on the plane z = 0: rotated about the vertical only, by the angle of its rotation about
    /// the world's z axis.
    pub(super) fn standing(self) -> Self {
        let (_, _, yaw) = self.rotation.euler_angles();
        let center = Point3::new(self.center.x, self.center.y, self.semi_axes.z);
        Self { center, rotation: Rotation3::from_euler_angles(0.0, 0.0, yaw), ..self }
    }

    /// Draws a car beside the street, which runs along x: alternately left and right of it.
    fn draw_parked(index: usize, rng: &mut ChaCha8Rng) -> Self {
        let side = if index.is_multiple_of(2) { 1.0 } else { -1.0 };
        let along = CAR_GAP * (index / 2) as f64 + rng.random_range(0.0..1.5);
        let center = Point3::new(along, side * (4.5 + rng.random_range(0.0..3.0)), CAR.z);
        let semi_axes = CAR.map(|x| x * (0.08 * random::normal(rng)).exp());
        Self { center, semi_axes, rotation: Rotation3::from_euler_angles(0.0, 0.0, 0.1 * random::normal(rng)) }
    }

    /// Draws an object as in PfD section 5.1: center in a cube about the origin (of side 20 there), full length of the
    /// longest axis (the first one) from [3, 12], the others that times a factor from [0.3, 1], any orientation.
    fn draw_in_cube(cube_side: f64, rng: &mut ChaCha8Rng) -> Self {
        let half = 0.5 * cube_side;
        let center = Point3::from(Vector3::from_fn(|_, _| rng.random_range(-half..half)));
        let longest = 0.5 * rng.random_range(3.0..12.0);
        let semi_axes =
            Vector3::new(longest, longest * rng.random_range(0.3..1.0), longest * rng.random_range(0.3..1.0));
        Self { center, semi_axes, rotation: random::rotation(rng) }
    }

    /// The body (cylinders are round), in a world multiplied by `scale` and then moved by `offset`.
    pub(super) fn body(&self, kind: BodyKind, scale: f64, offset: &Vector3<f64>) -> Body {
        let (center, rotation) = (self.center * scale + offset, self.rotation);
        let mut half_extents = self.semi_axes * scale;
        if kind.has_axis() {
            let radius = (half_extents.x * half_extents.y).sqrt();
            (half_extents.x, half_extents.y) = (radius, radius);
        }
        Body { center, rotation, half_extents, kind }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_sizes_fill_their_ranges() {
        let mut rng = random::stream(7, 0);
        let objects: Vec<Object> = (0..2000).map(|_| Object::draw_in_cube(20.0, &mut rng)).collect();
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

    #[test]
    fn a_street_has_cars_on_both_sides_and_a_floor_is_flat() {
        let mut rng = random::stream(8, 0);
        let cars: Vec<Object> = (0..100).map(|i| Object::draw(i, Trajectory::Street, 20.0, &mut rng)).collect();
        for (pair, place) in cars.chunks(2).zip(0..) {
            assert!(pair[0].center.y >= 4.5 && pair[1].center.y <= -4.5);
            assert!((pair[0].center.x - 6.0 * f64::from(place)).abs() <= 1.5);
        }
        let on_floor = |i| Object::draw(i, Trajectory::Random, 40.0, &mut rng);
        let floor: Vec<Object> = (0..100).map(on_floor).collect();
        assert!(floor.iter().all(|o| o.center.z.abs() <= 3.0) && floor.iter().any(|o| o.center.x.abs() > 15.0));
    }
}
