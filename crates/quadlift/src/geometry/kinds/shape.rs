//! What distinguishes the kinds of bodies, in the frame of their axes.

use nalgebra::Vector3;

use super::mesh::Mesh;

/// The simple body that is drawn for a body where there are no others.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Primitive {
    /// An ellipsoid.
    Ball,
    /// A cuboid.
    Cube,
    /// A cylinder about the third axis.
    Cylinder,
}

/// A kind of body. `half` are half extents `a_i`, points and vectors are along the axes of the body.
pub(super) trait Shape {
    /// Its name on the command line and in files.
    fn name(&self) -> &'static str;

    /// Whether the third axis is unlike the other two, across which the section is a circle or an ellipse.
    fn has_axis(&self) -> bool {
        false
    }

    /// The number that the name is followed by.
    fn parameter(&self) -> Option<f64> {
        None
    }

    /// Exponent q of the support function, in [1, 2]; 1 where it has none.
    fn exponent(&self) -> f64 {
        1.0
    }

    /// Support function of the components `a_i u_i`.
    fn support(&self, v: &Vector3<f64>) -> f64;

    /// Whether a point lies in the body, its boundary included.
    fn contains(&self, point: &Vector3<f64>, half: &Vector3<f64>) -> bool;

    /// Volume.
    fn volume(&self, half: &Vector3<f64>) -> f64;

    /// Where the line `from + t along` enters and leaves the body, the other way round if it does not meet it; `None` without a closed
    /// form.
    fn crossing(&self, _from: &Vector3<f64>, _along: &Vector3<f64>, _half: &Vector3<f64>) -> Option<[f64; 2]> {
        None
    }

    /// The body of half extents one.
    fn mesh(&self) -> Mesh;

    /// The nearest simple body.
    fn primitive(&self) -> Primitive;

    /// Half extents relative to the semi-axes of the ellipsoid that touches about the same planes.
    fn relative_size(&self) -> f64;

    /// In which components of its argument the support function has a kink at zero.
    fn kinks(&self) -> [bool; 3];

    /// The support function and its derivatives by the reaches `a_i |u_i|`.
    fn support_gradient(&self, reach: &Vector3<f64>) -> (f64, Vector3<f64>);

    /// One over the distance between center and visible surface, of the components `|v_i| / a_i` of a ray, and its derivatives. Of cuboids
    /// and cylinders the distance is the mean over the outline, half of volume over projected area (docs/method.md, section 19.1).
    fn inverse_depth(&self, x: &Vector3<f64>) -> (f64, Vector3<f64>);
}
