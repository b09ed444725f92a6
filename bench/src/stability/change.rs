//! How far two answers for an object lie apart.

use std::collections::BTreeMap;
use std::mem::discriminant;

use quadlift::Localization;
use quadlift::geometry::{Body, ConvexBody};
use quadlift::nalgebra::Vector3;
use quadlift::scene::Scene;

use super::perturbation::WorldChange;

/// Directions in which bodies are compared, spread evenly over the sphere.
const DIRECTIONS: usize = 64;

/// The body of each object, by id; `None` where there is none.
pub(super) type Answers = BTreeMap<String, Option<Body>>;

/// How an answer changed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Change {
    /// Largest distance between the tangent planes of both bodies, relative to the size of the first. Infinite where only one answer
    /// has a body.
    pub distance: f64,
    /// Whether the answers are bodies of different kinds, or only one is a body.
    pub of_kind: bool,
}

/// The answers for a scene.
pub(super) fn answers(scene: &Scene, found: &Localization) -> Answers {
    found.estimates.iter().map(|one| (scene.object_ids[one.object_index].clone(), one.body)).collect()
}

/// The changes of the answers, in the order of the ids. `after` is in the changed world.
pub(super) fn changes(before: &Answers, after: &Answers, world: &WorldChange) -> Vec<Change> {
    let change = |(id, one): (&String, &Option<Body>)| match (one, after.get(id).copied().flatten()) {
        (Some(one), Some(other)) => {
            let of_kind = discriminant(&one.kind) != discriminant(&other.kind);
            Change { distance: distance(one, &other, world), of_kind }
        }
        (None, None) => Change { distance: 0.0, of_kind: false },
        _ => Change { distance: f64::INFINITY, of_kind: true },
    };
    before.iter().map(change).collect()
}

/// By support functions: bodies whose axes have other names are the same body.
fn distance(one: &Body, other: &Body, world: &WorldChange) -> f64 {
    let size = one.half_extents.product().cbrt();
    let center = world.rotation.inverse() * (other.center().coords - world.shift) / world.scale;
    let moved = center - one.center().coords;
    let apart = |n: Vector3<f64>| {
        let reach = other.support(&(world.rotation * n)) / world.scale;
        (n.dot(&moved) + reach - one.support(&n)).abs() / size
    };
    directions().map(apart).fold(0.0, f64::max)
}

/// Unit vectors on a spiral.
fn directions() -> impl Iterator<Item = Vector3<f64>> {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    (0..DIRECTIONS).map(move |k| {
        let z = 1.0 - (2.0 * k as f64 + 1.0) / DIRECTIONS as f64;
        let (sin, cos) = (k as f64 * golden).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        Vector3::new(radius * cos, radius * sin, z)
    })
}

#[cfg(test)]
mod tests {
    use quadlift::geometry::{Body, BodyKind};
    use quadlift::nalgebra::{Point3, Rotation3};

    use super::*;

    fn cuboid(turn: f64, half_extents: [f64; 3]) -> Body {
        let rotation = Rotation3::from_axis_angle(&Vector3::z_axis(), turn);
        Body { kind: BodyKind::Cuboid, center: Point3::new(1.0, 2.0, 3.0), half_extents: half_extents.into(), rotation }
    }

    #[test]
    fn twins_are_one_answer_and_other_bodies_are_not() {
        let none = WorldChange::default();
        let one = cuboid(0.3, [2.0, 1.0, 0.5]);
        let twin = cuboid(0.3 + std::f64::consts::FRAC_PI_2, [1.0, 2.0, 0.5]);
        assert!(distance(&one, &twin, &none) < 1e-12);
        let longer = distance(&one, &cuboid(0.3, [2.1, 1.0, 0.5]), &none);
        assert!((0.08..0.11).contains(&longer), "{longer}");
    }

    #[test]
    fn a_moved_body_in_a_moved_world_is_the_same() {
        let world = WorldChange::moved();
        let one = cuboid(0.3, [2.0, 1.0, 0.5]);
        let moved = Body {
            center: Point3::from(world.rotation * one.center.coords * world.scale + world.shift),
            half_extents: one.half_extents * world.scale,
            rotation: world.rotation * one.rotation,
            ..one
        };
        assert!(distance(&one, &moved, &world) < 1e-12);
    }
}
