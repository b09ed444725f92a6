//! The world: objects close together on the ground, clutter around them, a light, and the path of the camera.

use nalgebra::{Point3, Rotation3, Vector2, Vector3};
use quadlift::random::normal;
use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::camera::Path;
use super::objects::Object;
use super::options::RenderOptions;
use super::solid::{Shape, Solid};
use super::texture::{Color, Texture, any_color, near};

/// Clear width between the footprints of two objects.
const GAP: f64 = 0.05;

/// Clutter stands on a ring around the objects: width of the ring, and the gap between it and the objects.
const RING: f64 = 3.1;
const RING_GAP: f64 = 0.2;

/// Places that are tried for one piece of clutter before it is left out.
const CLUTTER_TRIES: usize = 20;

/// Everything that is seen.
#[derive(Debug, Clone)]
pub(super) struct World {
    pub(super) objects: Vec<Object>,
    pub(super) clutter: Vec<Solid>,
    /// The texture of the ground, the plane z = 0, by the points of the world.
    pub(super) ground: Texture,
    /// The texture of what is beyond, by directions.
    pub(super) sky: Texture,
    /// Unit direction towards the light.
    pub(super) light: Vector3<f64>,
    /// Brightness without the light.
    pub(super) ambient: f32,
    pub(super) path: Path,
}

impl World {
    /// Draws a world.
    pub(super) fn draw(options: &RenderOptions, rng: &mut ChaCha8Rng) -> Self {
        let ground_color = any_color(rng, 0.2..0.7);
        let mut kinds = options.kinds.clone();
        kinds.shuffle(rng);
        let mut colors = Vec::new();
        let drawn: Vec<Object> = (0..options.objects)
            .map(|index| {
                let hidden = rng.random_range(0.0..1.0f64) < options.camouflage;
                let color = if hidden { near(rng, &ground_color, 0.1, 0.05) } else { any_color(rng, 0.05..0.95) };
                colors.push(color);
                Object::draw(rng, kinds[index % kinds.len()], &color)
            })
            .collect();
        let (objects, radius) = placed(rng, drawn);
        let height = objects.iter().map(Object::height).sum::<f64>() / objects.len().max(1) as f64;
        let path = Path::draw(rng, &Point3::new(0.0, 0.0, 0.5 * height), radius, options.arc.to_radians());
        let clutter = clutter(rng, radius, &colors, &path);
        let ground = Texture::draw(rng, &ground_color, 0.2, 1.2);
        let sky_color = near(rng, &ground_color, 0.15, 0.0);
        let sky = Texture::draw(rng, &sky_color, 0.2, 6.0);
        let light = Vector3::new(normal(rng), normal(rng), rng.random_range(1.2..2.5)).normalize();
        Self { objects, clutter, ground, sky, light, ambient: rng.random_range(0.35..0.6), path }
    }

    /// All solids: those of the objects with the object's index, then the clutter.
    pub(super) fn solids(&self) -> impl Iterator<Item = (Option<usize>, &Solid)> {
        let of_objects =
            self.objects.iter().enumerate().flat_map(|(k, object)| object.solids.iter().map(move |s| (Some(k), s)));
        of_objects.chain(self.clutter.iter().map(|solid| (None, solid)))
    }
}

/// The objects, moved so that they stand close together around the origin without meeting; and the distance from the
/// origin within which all of them stand.
fn placed(rng: &mut ChaCha8Rng, drawn: Vec<Object>) -> (Vec<Object>, f64) {
    let mut taken: Vec<(Vector2<f64>, f64)> = Vec::new();
    let mut objects = Vec::new();
    // Where there is no room the circle grows, so that there will be.
    let mut circle = 0.0;
    for object in drawn {
        let footprint = object.footprint();
        let place = loop {
            let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
            let place = Vector2::new(angle.cos(), angle.sin()) * (circle * rng.random_range(0.0..1.0f64).sqrt());
            if taken.iter().all(|(other, size)| (place - other).norm() > size + footprint + GAP) {
                break place;
            }
            circle += 0.05;
        };
        taken.push((place, footprint));
        objects.push(object.shifted(&Vector3::new(place.x, place.y, 0.0)));
    }
    // The middle of the group moves to the origin.
    let count = objects.len().max(1) as f64;
    let middle = taken.iter().map(|(place, _)| place).sum::<Vector2<f64>>() / count;
    let radius = taken.iter().map(|(place, size)| (place - middle).norm() + size).fold(0.5, f64::max);
    let shift = Vector3::new(-middle.x, -middle.y, 0.0);
    (objects.into_iter().map(|object| object.shifted(&shift)).collect(), radius)
}

/// Solids around the objects; a quarter of them have the color of an object.
fn clutter(rng: &mut ChaCha8Rng, radius: f64, colors: &[Color], path: &Path) -> Vec<Solid> {
    let count = rng.random_range(8..16) + 2 * colors.len().min(20);
    let mut clutter = Vec::new();
    for _ in 0..count {
        let shape = [Shape::Ellipsoid, Shape::Cuboid, Shape::Cylinder][rng.random_range(0..3)];
        let half_sizes = Vector3::from_fn(|_, _| rng.random_range(0.15..0.7));
        let color = match colors.len() {
            0 => any_color(rng, 0.05..0.95),
            n if rng.random_range(0.0..1.0f64) < 0.25 => {
                let color = colors[rng.random_range(0..n)];
                near(rng, &color, 0.15, 0.05)
            }
            _ => any_color(rng, 0.05..0.95),
        };
        let texture = Texture::draw(rng, &color, 0.3, 2.5);
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), rng.random_range(0.0..std::f64::consts::TAU));
        let (sunk, shine) = (rng.random_range(0.6..1.0), rng.random_range(0.0..0.5f32));
        let reach = half_sizes.xy().norm();
        for _ in 0..CLUTTER_TRIES {
            let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
            let distance = radius + reach + RING_GAP + rng.random_range(0.0..RING);
            let center = Point3::new(distance * angle.cos(), distance * angle.sin(), half_sizes.z * sunk);
            if !path.comes_near(&center, reach) {
                clutter.push(Solid { shape, center, rotation, half_sizes, texture, shine });
                break;
            }
        }
    }
    clutter
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadlift::geometry::ConvexBody;
    use quadlift::random::stream;

    #[test]
    fn nothing_stands_in_an_object() {
        for seed in 0..10 {
            let options = RenderOptions { objects: 5, ..Default::default() };
            let world = World::draw(&options, &mut stream(seed, 0));
            assert_eq!(world.objects.len(), 5);
            for (owner, solid) in world.solids() {
                for (k, object) in world.objects.iter().enumerate().filter(|(k, _)| owner != Some(*k)) {
                    assert!(object.solids.iter().all(|s| !s.contains(&solid.center)), "{seed} {k}");
                    let gap = object.solids.iter().map(|s| (s.center.xy() - solid.center.xy()).norm());
                    assert!(gap.fold(f64::MAX, f64::min) > 0.1);
                }
            }
            assert!(world.clutter.len() >= 8, "{}", world.clutter.len());
        }
    }
}
