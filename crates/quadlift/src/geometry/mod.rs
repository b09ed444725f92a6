//! The vocabulary: cameras, boxes, ellipses and ellipsoids, bodies of several kinds, and how they project.
//!
//! Camera axes are OpenCV's (x right, y down, z forward); pixels are measured from the top-left corner of the image
//! (the first pixel's center is at 0.5, 0.5); angles are radians; the world unit is the user's.

mod bounding_box;
mod camera_model;
mod convex_body;
mod ellipse;
pub(crate) mod gamma;
pub(crate) mod linalg;
pub(crate) mod point_tree;
mod oriented_box;
pub(crate) mod quadrature;
pub(crate) mod ray_sum;
pub(crate) mod rotation;
mod camera;
mod lens;
pub(crate) mod rigid;
mod kinds;
mod tangent_lines;
mod vech;
mod ellipsoid;
mod reach;
mod body;
mod projection;
mod similarity;
pub(crate) mod visible_surface;

pub use body::Body;
pub use bounding_box::{BoundingBox, BoundingBoxError};
pub use camera::{CamFromWorld, CameraError, Intrinsics, Projection};
pub use camera_model::CameraModel;
pub use convex_body::ConvexBody;
pub use ellipse::{Ellipse, EllipseError};
pub use ellipsoid::{DualQuadric, Ellipsoid, EllipsoidError};
pub use kinds::{BodyKind, Mesh, Primitive};
pub use lens::Camera;
pub use oriented_box::{OrientedBox, OrientedBoxError};
pub use projection::{ProjectionError, project_bounding_box, project_ellipsoid};
pub(crate) use projection::{box_of_outline, edge_plane, support_plane, tangent_points};
pub(crate) use rotation::skew;
pub use rotation::{quaternion_from_rotation, rotation_defect, rotation_from_quaternion, rotation_vector};
pub use similarity::Similarity;
pub use tangent_lines::{OutlineEnd, SUPPORT_DIRECTIONS, TangentLine, TangentLines};
pub use vech::vech3;
pub(crate) use vech::{VECH3, VECH4};
pub use visible_surface::visible_depth;
