//! The trait of convex bodies: their support function.

use nalgebra::{Point3, Vector3};

/// A convex body that is symmetric about its center.
pub trait ConvexBody {
    /// The center in the world.
    fn center(&self) -> Point3<f64>;

    /// The support function about the center: `max n.(x - center)` over the body, for any vector `n` (it need not
    /// be a unit vector). World units times the length of `n`.
    fn support(&self, n: &Vector3<f64>) -> f64;

    /// Volume in cubic world units.
    fn volume(&self) -> f64;

    /// Whether a point of the world lies in the body (its boundary included).
    fn contains(&self, point: &Point3<f64>) -> bool;
}
