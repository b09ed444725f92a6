//! The objects: ellipsoids, and things that are not convex.

use nalgebra::{Point3, Rotation3, Vector3};
use quadlift::geometry::Ellipsoid;
use quadlift::random;
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::envelope::envelope;
use super::solid::{Shape, Solid};
use super::texture::{Color, Texture, near};

/// What an object is. Most are not convex; sizes are about 1 from the middle to the far end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum ObjectKind {
    /// An ellipsoid in any orientation.
    Ellipsoid,
    /// A handle with a head across.
    Hammer,
    /// A cup with a handle.
    Mug,
    /// A body with head, beak and tail.
    Duck,
    /// A seat with a back and four legs.
    Chair,
    /// Two cuboids at a right angle.
    Angle,
    /// A body with a roof and four wheels.
    Car,
    /// A barrel with a grip and a foot.
    Drill,
    /// A bent, tapering row of ellipsoids.
    Banana,
}

impl ObjectKind {
    /// All kinds.
    pub const ALL: [Self; 9] = [
        Self::Ellipsoid,
        Self::Hammer,
        Self::Mug,
        Self::Duck,
        Self::Chair,
        Self::Angle,
        Self::Car,
        Self::Drill,
        Self::Banana,
    ];

    /// The name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Ellipsoid => "ellipsoid",
            Self::Hammer => "hammer",
            Self::Mug => "mug",
            Self::Duck => "duck",
            Self::Chair => "chair",
            Self::Angle => "angle",
            Self::Car => "car",
            Self::Drill => "drill",
            Self::Banana => "banana",
        }
    }
}

/// An object that stands on the ground (z = 0).
#[derive(Debug, Clone)]
pub(super) struct Object {
    pub(super) kind: ObjectKind,
    pub(super) solids: Vec<Solid>,
}

impl Object {
    /// Draws an object with colors around `base`, above the origin.
    pub(super) fn draw(rng: &mut ChaCha8Rng, kind: ObjectKind, base: &Color) -> Self {
        let solids = parts(rng, kind, base);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..std::f64::consts::TAU));
        // Some kinds have no side on which they would always stand.
        let tilts = matches!(kind, ObjectKind::Hammer | ObjectKind::Angle | ObjectKind::Drill | ObjectKind::Banana);
        let tilt = if tilts && rng.random_range(0.0..1.0f64) < 0.6 {
            let axis = random::rotation(rng) * Vector3::x_axis();
            Rotation3::from_axis_angle(&axis, rng.random_range(0.3..1.5))
        } else {
            Rotation3::identity()
        };
        let rotation = tilt * turn;
        let solids: Vec<Solid> = solids.into_iter().map(|s| s.moved(&rotation, 1.0, &Vector3::zeros())).collect();
        let object = Self { kind, solids };
        let lowest = -object.reach(&-Vector3::z());
        object.shifted(&Vector3::new(0.0, 0.0, -lowest))
    }

    /// The object moved.
    pub(super) fn shifted(mut self, shift: &Vector3<f64>) -> Self {
        self.solids.iter_mut().for_each(|solid| solid.center += shift);
        self
    }

    /// How far the object reaches in a direction, from the world's origin.
    fn reach(&self, direction: &Vector3<f64>) -> f64 {
        self.solids.iter().map(|s| direction.dot(&s.center.coords) + s.support(direction)).fold(f64::MIN, f64::max)
    }

    /// Distance from the z axis within which the object stands.
    pub(super) fn footprint(&self) -> f64 {
        let reach = |k: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 32.0).sin_cos();
            self.reach(&Vector3::new(cos, sin, 0.0))
        };
        (0..32).map(reach).fold(0.0, f64::max)
    }

    /// Height of the top above the ground.
    pub(super) fn height(&self) -> f64 {
        self.reach(&Vector3::z())
    }

    /// The minimum-volume enclosing ellipsoid of the object.
    pub(super) fn envelope(&self) -> Ellipsoid {
        envelope(&self.solids)
    }
}

/// The solids of an object about the origin.
fn parts(rng: &mut ChaCha8Rng, kind: ObjectKind, base: &Color) -> Vec<Solid> {
    use Shape::{Cuboid, Cylinder, Ellipsoid as Ball};
    let upright = Rotation3::identity();
    let about = |axis, angle: f64| Rotation3::from_axis_angle(&axis, angle);
    let (x_axis, y_axis) = (Vector3::x_axis(), Vector3::y_axis());
    let quarter = std::f64::consts::FRAC_PI_2;
    let mut texture = |deviation: f32| {
        let color = near(rng, base, deviation, 0.05);
        Texture::draw(rng, &color, 0.25, 2.5)
    };
    let (main, second, third) = (texture(0.05), texture(0.2), texture(0.3));
    let shine = rng.random_range(0.0..0.6f32);
    let part = |shape, center: [f64; 3], rotation, half_sizes: [f64; 3], texture: &Texture| Solid {
        shape,
        center: Point3::from(center),
        rotation,
        half_sizes: Vector3::from(half_sizes),
        texture: texture.clone(),
        shine,
    };
    match kind {
        ObjectKind::Ellipsoid => {
            let half_sizes = [1.0, rng.random_range(0.35..0.8), rng.random_range(0.25..0.6)];
            vec![part(Ball, [0.0; 3], random::rotation(rng), half_sizes, &main)]
        }
        ObjectKind::Hammer => vec![
            part(Cylinder, [0.0; 3], upright, [0.13, 0.13, 0.9], &main),
            part(Cuboid, [0.05, 0.0, 0.9], upright, [0.5, 0.2, 0.2], &second),
        ],
        ObjectKind::Mug => {
            let mut parts = vec![part(Cylinder, [0.0; 3], upright, [0.55, 0.55, 0.7], &main)];
            parts.extend((0..9).map(|k| {
                let (sin, cos) = (-1.4 + 2.8 * f64::from(k) / 8.0).sin_cos();
                part(Ball, [0.55 + 0.38 * cos, 0.0, 0.42 * sin], upright, [0.1, 0.1, 0.12], &main)
            }));
            parts
        }
        ObjectKind::Duck => vec![
            part(Ball, [0.0; 3], upright, [0.8, 0.5, 0.45], &main),
            part(Ball, [0.55, 0.0, 0.5], upright, [0.32, 0.3, 0.3], &main),
            part(Ball, [0.9, 0.0, 0.45], upright, [0.2, 0.12, 0.06], &third),
            part(Ball, [-0.75, 0.0, 0.25], about(y_axis, 0.6), [0.3, 0.2, 0.1], &main),
        ],
        ObjectKind::Chair => {
            let mut parts = vec![
                part(Cuboid, [0.0; 3], upright, [0.5, 0.5, 0.06], &second),
                part(Cuboid, [-0.45, 0.0, 0.5], upright, [0.05, 0.5, 0.5], &main),
            ];
            for (x, y) in [(-0.44, -0.44), (-0.44, 0.44), (0.44, -0.44), (0.44, 0.44)] {
                parts.push(part(Cuboid, [x, y, -0.4], upright, [0.06, 0.06, 0.4], &main));
            }
            parts
        }
        ObjectKind::Angle => vec![
            part(Cuboid, [0.0, 0.0, -0.5], upright, [0.8, 0.25, 0.22], &main),
            part(Cuboid, [-0.6, 0.0, 0.2], upright, [0.22, 0.25, 0.6], &second),
        ],
        ObjectKind::Car => {
            let dark = Texture::draw(rng, &Color::new(0.08, 0.08, 0.1), 0.05, 3.0);
            let mut parts = vec![
                part(Cuboid, [0.0; 3], upright, [1.0, 0.42, 0.2], &main),
                part(Ball, [-0.05, 0.0, 0.22], upright, [0.6, 0.38, 0.34], &dark),
            ];
            for (x, y) in [(-0.6, -0.4), (-0.6, 0.4), (0.6, -0.4), (0.6, 0.4)] {
                parts.push(part(Cylinder, [x, y, -0.2], about(x_axis, quarter), [0.2, 0.2, 0.08], &dark));
            }
            parts
        }
        ObjectKind::Drill => vec![
            part(Cylinder, [0.1, 0.0, 0.45], about(y_axis, quarter), [0.2, 0.2, 0.6], &main),
            part(Cuboid, [-0.3, 0.0, -0.15], about(y_axis, 0.15), [0.16, 0.14, 0.55], &second),
            part(Cuboid, [-0.35, 0.0, -0.75], upright, [0.35, 0.2, 0.14], &main),
            part(Cylinder, [0.85, 0.0, 0.45], about(y_axis, quarter), [0.07, 0.07, 0.3], &third),
        ],
        ObjectKind::Banana => (0..9)
            .map(|k| {
                let s = (f64::from(k) - 4.0) / 4.0;
                let (angle, thick) = (1.2 * s, 0.26 * (1.0 - 0.75 * s * s));
                let center = [0.9 * angle.sin(), 0.0, 0.9 - 0.9 * angle.cos()];
                part(Ball, center, about(y_axis, -angle), [0.26, thick, thick], &main)
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::geometry::ConvexBody;

    #[test]
    fn every_kind_stands_on_the_ground_and_fits_its_bounds() {
        for seed in 0..5 {
            let mut rng = random::stream(seed, 0);
            for kind in ObjectKind::ALL {
                let object = Object::draw(&mut rng, kind, &Color::repeat(0.5));
                assert!(object.reach(&-Vector3::z()).abs() < 1e-12, "{kind:?}");
                assert!(object.height() > 0.3 && object.height() < 2.6, "{kind:?} {}", object.height());
                assert!(object.footprint() > 0.2 && object.footprint() < 1.8, "{kind:?} {}", object.footprint());
                // No part lies apart from the others.
                let envelope = object.envelope();
                for solid in &object.solids {
                    assert!(envelope.contains(&solid.center), "{kind:?}");
                }
            }
        }
    }
}
