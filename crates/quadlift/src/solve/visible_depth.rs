//! The depth of a body's visible surface, against which measured depths are compared.

use nalgebra::Point3;

use super::conditioning::ObjectFrame;
use super::map::object::model::Model;
use crate::body_model::BodyModel;
use crate::geometry::{Body, ConvexBody};
use crate::scene::View;

/// Depth along the optical axis of the visible surface of a body (docs/method.md, section 19.1): the depth that an exact source
/// would measure in this view. `None` without a box or ellipse in the image, and for a body that is not in front of the camera.
///
/// ```
/// use nalgebra::{Matrix3x4, Point3, Rotation3, Vector3};
/// use quadlift::geometry::{Body, BoundingBox, Ellipsoid, Projection};
/// use quadlift::scene::View;
///
/// let p = Matrix3x4::new(500.0, 0.0, 320.0, 0.0, 0.0, 500.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0);
/// let view = View::from_box(Projection::from_matrix(p)?, BoundingBox::new([310.0, 230.0, 330.0, 250.0])?);
/// let ball = Ellipsoid { center: Point3::new(0.0, 0.0, 50.0), semi_axes: Vector3::repeat(1.0), rotation: Rotation3::identity() };
/// let depth = quadlift::solve::visible_depth(&view, &Body::Ellipsoid(ball)).expect("it is in front of the camera");
/// // The near side of a ball is between half of its radius and its radius before its centre.
/// assert!((49.0..49.5).contains(&depth));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn visible_depth(view: &View, body: &Body) -> Option<f64> {
    let ray = view.projection.ray_in_world(&view.measured_box()?.center())?;
    let center = body.center();
    let near = Model::of_body(body, &ObjectFrame { origin: center, unit: 1.0 }).near_side(&ray).0;
    let depth = view.projection.depth(&Point3::from(center.coords - ray * near));
    (depth > 0.0).then_some(depth)
}
