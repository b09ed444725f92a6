//! Surfaces on which objects stand.

use nalgebra::{Point3, Unit, Vector3};

/// A level surface on which objects stand (a table, a shelf, the floor), found from them ([`super::MapOptions::supporting_surfaces`]).
#[derive(Debug, Clone, PartialEq)]
pub struct SupportingSurface {
    /// The objects that stand on it: indices into [`crate::scene::SceneParts::object_ids`].
    pub objects: Vec<usize>,
    /// A point of it, in the middle of what stands on it, world units.
    pub point: Point3<f64>,
    /// Its normal, upwards.
    pub normal: Unit<Vector3<f64>>,
    /// Standard deviation of its height at the point, world units.
    pub height_sd: f64,
}
