//! The box around an object.

use nalgebra::{Point3, Rotation3, Vector3};

use crate::geometry::{Body, BodyKind};

/// The box around an object, parts of which may lie outside of its body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// The center of the box in the world.
    pub center: Point3<f64>,
    /// Its axes, as columns. Where the vertical of the scene is known and its objects stand, the third one is vertical and the first one
    /// level, along the longer horizontal axis of the body; cuboids and cylinders, whose faces were seen, keep their own axes, as all bodies
    /// do otherwise.
    pub rotation: Rotation3<f64>,
    /// Half the extents along the axes, world units.
    pub half_extents: Vector3<f64>,
    /// Their standard deviations, world units; absent without a covariance of the body.
    pub half_extents_sd: Option<Vector3<f64>>,
}

impl Bounds {
    /// The box as a body.
    pub fn cuboid(&self) -> Body {
        let Self { center, rotation, half_extents, .. } = *self;
        Body { center, rotation, half_extents, kind: BodyKind::Cuboid }
    }
}
