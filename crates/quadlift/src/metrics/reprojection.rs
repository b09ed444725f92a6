//! How well an estimate covers the truth in an image.

use super::iou_ellipses::ellipse_iou;
use crate::geometry::{ConvexBody, Ellipsoid, Projection, project_bounding_box, project_ellipsoid};

/// Area IoU of the outlines of two ellipsoids; `None` when one of them is not wholly in front of the camera.
pub fn ellipse_reprojection_iou(projection: &Projection, a: &Ellipsoid, b: &Ellipsoid) -> Option<f64> {
    let outline = |e: &Ellipsoid| project_ellipsoid(projection, e).ok();
    Some(ellipse_iou(&outline(a)?, &outline(b)?))
}

/// Area IoU of the tight boxes of two bodies' outlines (not cut at the image border); `None` when one of them is not
/// wholly in front of the camera.
pub fn box_reprojection_iou(projection: &Projection, a: &impl ConvexBody, b: &impl ConvexBody) -> Option<f64> {
    let a = project_bounding_box(projection, a).ok()?;
    let b = project_bounding_box(projection, b).ok()?;
    Some(a.iou(&b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3x4, Point3, Rotation3, Vector3};

    #[test]
    fn spheres_on_the_optical_axis() {
        let projection = Projection::from_matrix(Matrix3x4::identity()).unwrap();
        let sphere = |z: f64, radius: f64| Ellipsoid {
            center: Point3::new(0.0, 0.0, z),
            semi_axes: Vector3::repeat(radius),
            rotation: Rotation3::identity(),
        };
        // The outlines are concentric circles with squared radius r^2 / (z^2 - r^2): 1/24 and 1/99.
        let (near, far) = (sphere(5.0, 1.0), sphere(10.0, 1.0));
        assert!((ellipse_reprojection_iou(&projection, &near, &far).unwrap() - 24.0 / 99.0).abs() < 1e-9);
        assert!((box_reprojection_iou(&projection, &near, &far).unwrap() - 24.0 / 99.0).abs() < 1e-9);
        assert_eq!(ellipse_reprojection_iou(&projection, &near, &sphere(-5.0, 1.0)), None);
        assert_eq!(box_reprojection_iou(&projection, &near, &sphere(0.5, 1.0)), None);
    }
}
