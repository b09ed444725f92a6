//! The vocabulary: cameras, boxes, ellipses and ellipsoids, cuboids, cylinders, superellipsoids, and how they project.
//!
//! Camera axes are OpenCV's (x right, y down, z forward); pixels are measured from the top-left corner of the image
//! (the first pixel's center is at 0.5, 0.5); angles are radians; the world unit is the user's.

mod bounding_box;
mod camera_model;
mod convex_body;
mod cylinder;
mod ellipse;
pub(crate) mod gamma;
pub(crate) mod linalg;
mod oriented_box;
pub(crate) mod quadrature;
pub(crate) mod rotation;
mod camera;
mod lens;
pub(crate) mod rigid;
mod superellipsoid;
mod support_lines;
mod vech;
mod ellipsoid;
mod cuboid;
mod projection;
mod reach;
mod similarity;
pub(crate) mod visible_surface;

pub use bounding_box::{BoundingBox, BoundingBoxError};
pub use camera::{CamFromWorld, CameraError, Intrinsics, Projection};
pub use camera_model::CameraModel;
pub use convex_body::ConvexBody;
pub use cuboid::Cuboid;
pub use cylinder::Cylinder;
pub use ellipse::{Ellipse, EllipseError};
pub use ellipsoid::{DualQuadric, Ellipsoid, EllipsoidError};
pub use lens::{Camera, WIDEST_ANGLE_DEG};
pub use oriented_box::{OrientedBox, OrientedBoxError};
pub use projection::{ProjectionError, project_bounding_box, project_ellipsoid};
pub(crate) use projection::{box_of_outline, edge_plane, support_plane};
pub use reach::ellipsoid_of_same_reach;
pub(crate) use rotation::skew;
pub use rotation::{quaternion_from_rotation, rotation_defect, rotation_from_quaternion, rotation_vector};
pub use similarity::Similarity;
pub use superellipsoid::Superellipsoid;
pub use support_lines::{MOST_SUPPORT_DIRECTIONS, OutlineEnd, SUPPORT_DIRECTIONS, SupportLine, SupportLines};
pub use vech::vech3;
pub(crate) use vech::{VECH3, VECH4};
pub use visible_surface::visible_depth;

/// A body of any kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Body {
    /// An ellipsoid.
    Ellipsoid(Ellipsoid),
    /// A cuboid.
    Cuboid(Cuboid),
    /// A cylinder.
    Cylinder(Cylinder),
    /// A superellipsoid.
    Superellipsoid(Superellipsoid),
}

impl Body {
    /// The same body, `factor` times as large about its center.
    pub fn scaled(&self, factor: f64) -> Self {
        match self {
            Self::Ellipsoid(body) => Self::Ellipsoid(body.scaled(factor)),
            Self::Cuboid(body) => Self::Cuboid(body.scaled(factor)),
            Self::Cylinder(body) => Self::Cylinder(body.scaled(factor)),
            Self::Superellipsoid(body) => Self::Superellipsoid(body.scaled(factor)),
        }
    }

    /// The ellipsoid that stands for the body: itself, or the one that reaches about as far in all directions, see
    /// [`ellipsoid_of_same_reach`].
    pub fn ellipsoid(&self) -> Ellipsoid {
        match self {
            Self::Ellipsoid(body) => *body,
            Self::Cuboid(body) => ellipsoid_of_same_reach(body, &body.rotation),
            Self::Cylinder(body) => ellipsoid_of_same_reach(body, &body.rotation),
            Self::Superellipsoid(body) => ellipsoid_of_same_reach(body, &body.rotation),
        }
    }

    /// Half extents of the cuboid around the body along the columns of its rotation: the semi-axes of an ellipsoid or
    /// superellipsoid, the radii and half the height of a cylinder. World units.
    pub fn half_extents(&self) -> nalgebra::Vector3<f64> {
        match self {
            Self::Ellipsoid(body) => body.semi_axes,
            Self::Cuboid(body) => body.half_extents,
            Self::Cylinder(body) => body.half_extents(),
            Self::Superellipsoid(body) => body.semi_axes,
        }
    }

    /// Rotation `world_from_object`: its columns are the axes of the body.
    pub fn rotation(&self) -> nalgebra::Rotation3<f64> {
        match self {
            Self::Ellipsoid(body) => body.rotation,
            Self::Cuboid(body) => body.rotation,
            Self::Cylinder(body) => body.rotation,
            Self::Superellipsoid(body) => body.rotation,
        }
    }
}

impl ConvexBody for Body {
    fn center(&self) -> nalgebra::Point3<f64> {
        match self {
            Self::Ellipsoid(body) => body.center,
            Self::Cuboid(body) => body.center,
            Self::Cylinder(body) => body.center,
            Self::Superellipsoid(body) => body.center,
        }
    }

    fn support(&self, n: &nalgebra::Vector3<f64>) -> f64 {
        match self {
            Self::Ellipsoid(body) => body.support(n),
            Self::Cuboid(body) => body.support(n),
            Self::Cylinder(body) => body.support(n),
            Self::Superellipsoid(body) => body.support(n),
        }
    }

    fn volume(&self) -> f64 {
        match self {
            Self::Ellipsoid(body) => body.volume(),
            Self::Cuboid(body) => body.volume(),
            Self::Cylinder(body) => body.volume(),
            Self::Superellipsoid(body) => body.volume(),
        }
    }

    fn contains(&self, point: &nalgebra::Point3<f64>) -> bool {
        match self {
            Self::Ellipsoid(body) => body.contains(point),
            Self::Cuboid(body) => body.contains(point),
            Self::Cylinder(body) => body.contains(point),
            Self::Superellipsoid(body) => body.contains(point),
        }
    }
}
