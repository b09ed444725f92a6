//! Solids: ellipsoids, cuboids and cylinders, intersected with rays.

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use quadlift::geometry::{BoundingBox, ConvexBody, Ellipsoid, Projection, ProjectionError};

use super::texture::{Color, Texture};

/// A ray that has just left a surface does not meet it again within this length.
const NEAREST: f64 = 1e-4;

/// What a solid is in its own frame, in which its half sizes are all 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shape {
    /// The unit ball.
    Ellipsoid,
    /// The cube from -1 to 1.
    Cuboid,
    /// The unit disc in x and y, from -1 to 1 along z.
    Cylinder,
}

/// A solid in the world.
#[derive(Debug, Clone)]
pub(super) struct Solid {
    pub(super) shape: Shape,
    pub(super) center: Point3<f64>,
    /// World from solid.
    pub(super) rotation: Rotation3<f64>,
    /// Half sizes along the solid's own axes.
    pub(super) half_sizes: Vector3<f64>,
    pub(super) texture: Texture,
    /// Strength of the highlight, from 0.
    pub(super) shine: f32,
}

impl Solid {
    /// From directions of the world to the frame in which the half sizes are 1.
    pub(super) fn to_unit(&self) -> Matrix3<f64> {
        Matrix3::from_diagonal(&self.half_sizes.map(|s| 1.0 / s)) * self.rotation.matrix().transpose()
    }

    /// The radius of a ball about the center that holds the solid.
    pub(super) fn radius(&self) -> f64 {
        match self.shape {
            Shape::Ellipsoid => self.half_sizes.max(),
            Shape::Cuboid => self.half_sizes.norm(),
            Shape::Cylinder => self.half_sizes.xy().max().hypot(self.half_sizes.z),
        }
    }

    /// How far the solid reaches from its center in a direction of the world, times the length of the direction.
    pub(super) fn support(&self, direction: &Vector3<f64>) -> f64 {
        let d = (self.rotation.inverse() * direction).component_mul(&self.half_sizes);
        match self.shape {
            Shape::Ellipsoid => d.norm(),
            Shape::Cuboid => d.abs().sum(),
            Shape::Cylinder => d.xy().norm() + d.z.abs(),
        }
    }

    /// A box in the image that holds the solid.
    pub(super) fn bounds(&self, projection: &Projection) -> Result<BoundingBox, ProjectionError> {
        quadlift::geometry::project_bounding_box(projection, self)
    }

    /// The solid moved by a rotation about the origin, then enlarged, then shifted.
    pub(super) fn moved(mut self, rotation: &Rotation3<f64>, scale: f64, shift: &Vector3<f64>) -> Self {
        self.center = rotation * self.center * scale + shift;
        self.rotation = rotation * self.rotation;
        self.half_sizes *= scale;
        self
    }

    /// The color at a point of the surface.
    pub(super) fn color(&self, point: &Point3<f64>) -> Color {
        let local = self.rotation.inverse() * (point - self.center);
        self.texture.color(&local.map(|x| x as f32))
    }
}

impl ConvexBody for Solid {
    fn center(&self) -> Point3<f64> {
        self.center
    }

    fn support(&self, n: &Vector3<f64>) -> f64 {
        Solid::support(self, n)
    }

    fn volume(&self) -> f64 {
        let (center, rotation) = (self.center, self.rotation);
        match self.shape {
            Shape::Ellipsoid => Ellipsoid { center, semi_axes: self.half_sizes, rotation }.volume(),
            Shape::Cuboid => 8.0 * self.half_sizes.product(),
            Shape::Cylinder => 2.0 * std::f64::consts::PI * self.half_sizes.product(),
        }
    }

    fn contains(&self, point: &Point3<f64>) -> bool {
        let p = self.to_unit() * (point - self.center);
        match self.shape {
            Shape::Ellipsoid => p.norm() <= 1.0,
            Shape::Cuboid => p.amax() <= 1.0,
            Shape::Cylinder => p.xy().norm() <= 1.0 && p.z.abs() <= 1.0,
        }
    }
}

impl Shape {
    /// Where a ray meets the shape from outside: the least `t > NEAREST` with `origin + t direction` on the surface,
    /// infinite when it does not. Both in the frame of the shape; the direction has any length.
    pub(super) fn distance(self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> f64 {
        let entry = match self {
            Self::Ellipsoid => round_interval(origin.norm_squared(), origin.dot(direction), direction.norm_squared()),
            Self::Cuboid => {
                let [x, y, z] = [0, 1, 2].map(|axis| slab_interval(origin[axis], direction[axis]));
                intersection(intersection(x, y), z)
            }
            Self::Cylinder => {
                let (o, d) = (origin.xy(), direction.xy());
                let side = round_interval(o.norm_squared(), o.dot(&d), d.norm_squared());
                intersection(side, slab_interval(origin.z, direction.z))
            }
        };
        // A ray that starts inside sees nothing of the solid.
        if entry[0] <= entry[1] && entry[0] > NEAREST { entry[0] } else { f64::INFINITY }
    }

    /// The outward normal at a point of the surface, in the frame of the shape and of any length.
    pub(super) fn normal(self, point: &Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Ellipsoid => *point,
            Self::Cuboid => {
                let axis = point.iamax();
                Vector3::ith(axis, point[axis].signum())
            }
            Self::Cylinder if point.z.abs() > point.xy().norm() => Vector3::z() * point.z.signum(),
            Self::Cylinder => Vector3::new(point.x, point.y, 0.0),
        }
    }
}

/// Where `|o + t d|^2 <= 1`, from the products `o.o`, `o.d` and `d.d`.
fn round_interval(oo: f64, od: f64, dd: f64) -> [f64; 2] {
    let discriminant = od * od - dd * (oo - 1.0);
    if discriminant <= 0.0 || dd == 0.0 {
        // The whole line is inside, or nothing of it.
        return if oo < 1.0 && dd == 0.0 { [f64::NEG_INFINITY, f64::INFINITY] } else { [f64::INFINITY, 0.0] };
    }
    let root = discriminant.sqrt();
    [(-od - root) / dd, (-od + root) / dd]
}

/// Where `|o + t d| <= 1`.
fn slab_interval(o: f64, d: f64) -> [f64; 2] {
    if d == 0.0 {
        return if o.abs() <= 1.0 { [f64::NEG_INFINITY, f64::INFINITY] } else { [f64::INFINITY, 0.0] };
    }
    let (a, b) = ((-1.0 - o) / d, (1.0 - o) / d);
    [a.min(b), a.max(b)]
}

fn intersection(a: [f64; 2], b: [f64; 2]) -> [f64; 2] {
    [a[0].max(b[0]), a[1].min(b[1])]
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::random::{rotation, stream};
    use rand::RngExt;

    const SHAPES: [Shape; 3] = [Shape::Ellipsoid, Shape::Cuboid, Shape::Cylinder];

    #[test]
    fn rays_meet_the_surface_where_a_march_along_them_does() {
        let mut rng = stream(2, 0);
        for shape in SHAPES {
            let texture = Texture::draw(&mut rng, &Color::repeat(0.5), 0.2, 2.0);
            let (mut hits, mut misses) = (0, 0);
            for _ in 0..300 {
                let half_sizes = Vector3::from_fn(|_, _| rng.random_range(0.2..1.5));
                let solid = Solid {
                    shape,
                    center: Point3::new(0.3, -0.2, 4.0),
                    rotation: rotation(&mut rng),
                    half_sizes,
                    texture: texture.clone(),
                    shine: 0.0,
                };
                let direction =
                    Vector3::new(rng.random_range(-0.4..0.4), rng.random_range(-0.4..0.4), 1.0f64).normalize();
                let to_unit = solid.to_unit();
                let t = shape.distance(&(to_unit * (-solid.center.coords)), &(to_unit * direction));
                let step = 1e-3;
                let marched = (0..8000).map(|k| k as f64 * step).find(|s| solid.contains(&(direction * *s).into()));
                match marched {
                    Some(expected) => {
                        assert!((t - expected).abs() < 1.5 * step, "{shape:?} {t} {expected}");
                        hits += 1;
                        let point = Point3::from(direction * t);
                        let unit = shape.normal(&(to_unit * (point - solid.center)));
                        let normal = (to_unit.transpose() * unit).normalize();
                        assert!(normal.dot(&direction) < 1e-9);
                        assert!(!solid.contains(&(point + normal * 1e-3)));
                        // The farthest points in the direction of the normal are no farther than the support.
                        assert!(normal.dot(&(point - solid.center)) <= ConvexBody::support(&solid, &normal) + 1e-9);
                    }
                    // Grazing rays may slip between the steps.
                    None => {
                        misses += 1;
                        assert!(t.is_infinite() || !solid.contains(&(direction * (t + 2.0 * step)).into()));
                    }
                }
            }
            assert!(hits > 50 && misses > 20, "{shape:?} {hits} {misses}");
        }
    }

    #[test]
    fn rays_from_inside_and_along_the_axes_are_no_special_cases() {
        for shape in SHAPES {
            assert!(shape.distance(&Vector3::zeros(), &Vector3::x()).is_infinite());
            assert_eq!(shape.distance(&Vector3::new(-3.0, 0.0, 0.0), &Vector3::x()), 2.0);
            assert_eq!(shape.distance(&Vector3::new(0.0, 0.0, 3.0), &-Vector3::z()), 2.0);
            assert!(shape.distance(&Vector3::new(0.0, 2.0, 3.0), &-Vector3::z()).is_infinite());
        }
    }
}
