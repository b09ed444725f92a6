//! What stands on the desk, and what is around it. Metres; z points upwards, the top of the desk is z = 0.

use nalgebra::{Matrix3, Point3, Rotation3, Vector3};
use quadlift::geometry::{Body, Cuboid, Cylinder, Ellipsoid};

use super::paint::{Paint, srgb};
use crate::render::solid::Shape;

/// The form of a part, in a frame in which its half sizes are 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Form {
    /// A full ellipsoid, cuboid or cylinder.
    Full(Shape),
    /// The lower half of a hollow ball, open above.
    Bowl,
    /// A hollow cylinder with a bottom, open above.
    Cup,
}

/// A part of a thing.
#[derive(Debug, Clone)]
pub(super) struct Part {
    pub(super) form: Form,
    pub(super) center: Point3<f64>,
    /// World from part.
    pub(super) rotation: Rotation3<f64>,
    pub(super) half: Vector3<f64>,
    pub(super) paint: Paint,
    /// Index of the thing it belongs to; none for what is not looked for (the desk, its surroundings).
    pub(super) thing: Option<usize>,
}

impl Part {
    /// From directions of the world to the frame in which the half sizes are 1.
    pub(super) fn to_unit(&self) -> Matrix3<f64> {
        Matrix3::from_diagonal(&self.half.map(|s| 1.0 / s)) * self.rotation.matrix().transpose()
    }

    /// The radius of a ball about the centre that holds the part.
    pub(super) fn radius(&self) -> f64 {
        match self.form {
            Form::Full(Shape::Cuboid) => self.half.norm(),
            Form::Full(Shape::Cylinder) | Form::Cup => self.half.xy().max().hypot(self.half.z),
            Form::Full(Shape::Ellipsoid) | Form::Bowl => self.half.max(),
        }
    }

    /// The part as a body of its kind; none for those that are hollow.
    pub(super) fn body(&self) -> Option<Body> {
        let Self { center, rotation, half, .. } = *self;
        match self.form {
            Form::Full(Shape::Ellipsoid) => Some(Body::Ellipsoid(Ellipsoid { center, semi_axes: half, rotation })),
            Form::Full(Shape::Cuboid) => Some(Body::Cuboid(Cuboid { center, half_extents: half, rotation })),
            Form::Full(Shape::Cylinder) => {
                Some(Body::Cylinder(Cylinder { center, radii: half.xy(), half_height: half.z, rotation }))
            }
            Form::Bowl | Form::Cup => None,
        }
    }

    /// Points whose convex hull is nearly the part.
    pub(super) fn points(&self) -> Vec<Point3<f64>> {
        let ring = |k: u32, z: f64, r: f64| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / 24.0).sin_cos();
            Vector3::new(r * cos, r * sin, z)
        };
        let unit: Vec<Vector3<f64>> = match self.form {
            Form::Full(Shape::Cuboid) => {
                (0..8).map(|k| Vector3::from_fn(|axis, _| if k >> axis & 1 == 0 { -1.0 } else { 1.0 })).collect()
            }
            Form::Full(Shape::Cylinder) | Form::Cup => {
                (0..24).flat_map(|k| [ring(k, -1.0, 1.0), ring(k, 1.0, 1.0)]).collect()
            }
            Form::Full(Shape::Ellipsoid) | Form::Bowl => {
                let top = if self.form == Form::Bowl { 0 } else { 6 };
                (-6..=top)
                    .flat_map(|j| {
                        let (sin, cos) = (f64::from(j) * std::f64::consts::PI / 12.0).sin_cos();
                        (0..24).map(move |k| ring(k, sin, cos))
                    })
                    .collect()
            }
        };
        unit.iter().map(|p| self.center + self.rotation * p.component_mul(&self.half)).collect()
    }
}

/// A thing on the desk.
#[derive(Debug, Clone, Copy)]
pub(super) struct Thing {
    pub(super) category: &'static str,
    pub(super) name: &'static str,
}

/// The things, all parts (those of things, then the surroundings), in a fixed arrangement.
pub(super) fn desk() -> (Vec<Thing>, Vec<Part>) {
    let mut desk = Desk { things: Vec::new(), parts: Vec::new(), place: [0.0; 2], turn: 0.0 };
    use Form::{Bowl, Cup, Full};
    use Shape::{Cuboid, Cylinder, Ellipsoid};
    let dark = Paint::Plain(srgb(40, 41, 45));

    desk.thing("monitor", "monitor", [0.0, 0.24], 0.06);
    desk.part(Full(Cuboid), [0.0, 0.0, 0.28], 0.0, [0.27, 0.014, 0.165], Paint::Screen);
    desk.part(Full(Cuboid), [0.0, 0.02, 0.08], 0.0, [0.03, 0.01, 0.08], dark);
    desk.part(Full(Cuboid), [0.0, 0.02, 0.006], 0.0, [0.11, 0.075, 0.006], dark);

    desk.thing("keyboard", "keyboard", [-0.02, -0.11], -0.05);
    desk.part(Full(Cuboid), [0.0, 0.0, 0.009], 0.0, [0.2, 0.065, 0.009], Paint::Keys);

    for (name, at, turn, height, half, cover, title) in [
        ("blue book", [-0.42, -0.02], 0.5, 0.018, [0.085, 0.12, 0.018], srgb(30, 70, 140), srgb(245, 225, 150)),
        ("red book", [-0.41, -0.01], 0.2, 0.05, [0.075, 0.105, 0.014], srgb(170, 40, 45), srgb(250, 240, 225)),
        ("green book", [0.46, -0.2], -0.6, 0.013, [0.08, 0.11, 0.013], srgb(40, 110, 70), srgb(235, 235, 200)),
    ] {
        desk.thing("book", name, at, turn);
        desk.part(Full(Cuboid), [0.0, 0.0, height], 0.0, half, Paint::Cover(cover, title));
    }

    for (name, at, turn, paint) in [
        ("red can", [0.33, 0.06], 0.8, Paint::Can(srgb(190, 30, 35), srgb(250, 248, 240))),
        ("green can", [0.43, 0.12], 2.3, Paint::Can(srgb(40, 130, 70), srgb(250, 225, 90))),
    ] {
        desk.thing("can", name, at, turn);
        desk.part(Full(Cylinder), [0.0, 0.0, 0.061], 0.0, [0.033, 0.033, 0.061], paint);
    }

    desk.thing("mug", "mug", [-0.26, -0.22], 2.6);
    let mug = Paint::Plain(srgb(225, 150, 50));
    desk.part(Cup, [0.0, 0.0, 0.048], 0.0, [0.041, 0.041, 0.048], mug);
    for k in 0..9 {
        let (sin, cos) = (-1.45 + 2.9 * f64::from(k) / 8.0).sin_cos();
        let at = [0.039 + 0.027 * cos, 0.0, 0.048 + 0.03 * sin];
        desk.part(Full(Ellipsoid), at, 0.0, [0.0075, 0.0065, 0.0085], mug);
    }

    desk.thing("bowl", "bowl", [0.24, -0.24], 0.0);
    desk.part(Bowl, [0.0, 0.0, 0.066], 0.0, [0.083, 0.083, 0.064], Paint::Plain(srgb(90, 140, 190)));
    desk.part(Full(Cylinder), [0.0, 0.0, 0.005], 0.0, [0.036, 0.036, 0.005], Paint::Plain(srgb(80, 128, 175)));

    let orange = Paint::Plain(srgb(238, 130, 25));
    desk.thing("orange", "orange", [0.09, -0.29], 0.0);
    desk.part(Full(Ellipsoid), [0.0, 0.0, 0.036], 0.0, [0.038, 0.038, 0.036], orange);

    for (name, at, turn, half, colors) in [
        ("cereal box", [-0.46, 0.25], 0.35, [0.09, 0.032, 0.13], [srgb(225, 170, 40), srgb(190, 45, 40)]),
        ("tea box", [0.52, -0.02], -0.35, [0.06, 0.04, 0.035], [srgb(120, 70, 140), srgb(240, 220, 160)]),
    ] {
        desk.thing("box", name, at, turn);
        desk.part(Full(Cuboid), [0.0, 0.0, half[2]], 0.0, half, Paint::Carton(colors[0], colors[1]));
    }

    desk.thing("ball", "tennis ball", [-0.14, -0.29], 0.7);
    desk.part(Full(Ellipsoid), [0.0, 0.0, 0.034], 0.0, [0.034; 3], Paint::Tennis(srgb(190, 210, 50)));

    desk.surroundings();
    (desk.things, desk.parts)
}

/// The desk in the making.
struct Desk {
    things: Vec<Thing>,
    parts: Vec<Part>,
    /// Where the thing that is being put together stands, and its turn about the vertical axis.
    place: [f64; 2],
    turn: f64,
}

impl Desk {
    /// Begins a thing.
    fn thing(&mut self, category: &'static str, name: &'static str, place: [f64; 2], turn: f64) {
        self.things.push(Thing { category, name });
        (self.place, self.turn) = (place, turn);
    }

    /// A part of the thing, in the thing's own frame.
    fn part(&mut self, form: Form, center: [f64; 3], turn: f64, half: [f64; 3], paint: Paint) {
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), self.turn);
        let center = rotation * Point3::from(center) + Vector3::new(self.place[0], self.place[1], 0.0);
        let rotation = rotation * Rotation3::from_axis_angle(&Vector3::z_axis(), turn);
        let thing = self.things.len().checked_sub(1);
        self.parts.push(Part { form, center, rotation, half: half.into(), paint, thing });
    }

    /// The desk itself, the wall behind it with a picture, and the floor.
    fn surroundings(&mut self) {
        let mut fixed = |center: [f64; 3], half: [f64; 3], paint: Paint| {
            let rotation = Rotation3::identity();
            let form = Form::Full(Shape::Cuboid);
            self.parts.push(Part { form, center: center.into(), rotation, half: half.into(), paint, thing: None });
        };
        fixed([0.0, 0.02, -0.02], [0.78, 0.44, 0.02], Paint::Wood(srgb(186, 138, 92)));
        for (x, y) in [(-0.72, -0.36), (0.72, -0.36), (-0.72, 0.4), (0.72, 0.4)] {
            fixed([x, y, -0.4], [0.03, 0.03, 0.36], Paint::Plain(srgb(60, 60, 64)));
        }
        fixed([-0.55, 0.745, 0.52], [0.26, 0.012, 0.19], Paint::Poster);
        fixed([0.0, 0.85, 1.0], [6.0, 0.09, 2.2], Paint::Plain(srgb(206, 202, 190)));
        fixed([0.0, 0.0, -0.85], [6.0, 6.0, 0.09], Paint::Plain(srgb(112, 104, 96)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_stand_on_the_desk_or_on_each_other_and_apart() {
        let (things, parts) = desk();
        let lowest = |k: usize| {
            let points = parts.iter().filter(|part| part.thing == Some(k)).flat_map(Part::points);
            points.map(|p| p.z).fold(f64::MAX, f64::min)
        };
        for (k, thing) in things.iter().enumerate() {
            // The red book lies on the blue one.
            let expected = if thing.name == "red book" { 0.036 } else { 0.0 };
            assert!((lowest(k) - expected).abs() < 2.5e-3, "{} {}", thing.name, lowest(k));
        }
        assert!(things.len() >= 12);
        for (k, a) in parts.iter().enumerate() {
            for b in parts[..k].iter().filter(|b| b.thing != a.thing && b.thing.is_some() && a.thing.is_some()) {
                let inside = (a.to_unit() * (b.center - a.center)).amax() < 1.0;
                assert!(!inside, "{:?} {:?}", a.thing.map(|k| things[k].name), b.thing.map(|k| things[k].name));
            }
        }
    }
}
