//! Depths and 3D boxes of detections, beside the estimates.

use nalgebra::{Point3, Rotation3};
use quadlift::geometry::{Body, BodyKind, Projection, visible_depth};
use quadlift::scene::{Box3dCue, Detection, Scene};

use crate::data::{ReportBody, ReportDetections};

/// Significant digits of lengths: finer than a pixel of the page.
const DIGITS: i32 = 6;

/// Rays along each side of a box in the search for the visible surface.
const RAYS: usize = 9;

impl ReportDetections {
    /// Adds the depth and the 3D box of a row, beside the estimated body of its object.
    pub(crate) fn push_cues(&mut self, row: usize, scene: &Scene, detection: &Detection, body: Option<&ReportBody>) {
        let Some(cues) = detection.cues.as_deref() else { return };
        if let Some(depth) = cues.depth {
            let estimated = body.and_then(ReportBody::body);
            let ratio = estimated.and_then(|body| Some(depth.median / seen(scene, detection, &body)?));
            self.depths.push((row, rounded(depth.median), ratio.map(|ratio| (1e4 * ratio).round() / 1e4)));
        }
        let projection = scene.frames.get(detection.frame_index as usize).map(|frame| &frame.projection);
        if let Some(cuboid) = cues.box3d.zip(projection).and_then(|(measured, p)| box_in_world(&measured, p)) {
            let body = ReportBody::from(&cuboid);
            self.boxes3d.push((
                row,
                ReportBody {
                    center: body.center.map(rounded),
                    half: body.half.map(rounded),
                    rotation: body.rotation.map(rounded),
                    ..body
                },
            ));
        }
    }
}

/// The depth of a body that an exact source would measure in a detection.
fn seen(scene: &Scene, detection: &Detection, body: &Body) -> Option<f64> {
    let view = scene.view(detection);
    visible_depth(&view.projection, &view.measured_box()?, body, RAYS)
}

/// A 3D box with center, size and rotation as a cuboid in the world; `None` if it lacks one of them.
pub(crate) fn box_in_world(measured: &Box3dCue, projection: &Projection) -> Option<Body> {
    let (turn, eye) = (projection.world_from_cam_rotation()?, projection.center_in_world()?);
    Some(Body {
        kind: BodyKind::Cuboid,
        center: Point3::from(eye.coords + turn * measured.center?.coords),
        half_extents: measured.half_extents?,
        rotation: Rotation3::from_matrix_unchecked(turn * measured.rotation?.matrix()),
    })
}

/// The number with so many significant digits.
fn rounded(x: f64) -> f64 {
    if x == 0.0 || !x.is_finite() {
        return x;
    }
    let power = 10f64.powi(DIGITS - 1 - x.abs().log10().floor() as i32);
    let found = (x * power).round() / power;
    if found.is_finite() { found } else { x }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3x4, Vector3};
    use quadlift::geometry::{BoundingBox, CamFromWorld, Ellipsoid, Intrinsics, project_bounding_box};
    use quadlift::scene::{Cues, DepthCue, NewDetection, SceneBuilder};

    use super::*;

    #[test]
    fn cues_are_shown_beside_the_estimate_in_the_world() {
        let pose = Matrix3x4::new(0.0, 1.0, 0.0, 0.5, 0.0, 0.0, -1.0, 0.25, -1.0, 0.0, 0.0, 20.0);
        let pose = CamFromWorld::new(pose).unwrap();
        let projection = Projection::from_camera(&Intrinsics::new(700.0, 700.0, 320.0, 240.0).unwrap(), &pose);
        let ball = Ellipsoid {
            center: Point3::new(3.0, -1.0, 0.5),
            semi_axes: Vector3::repeat(1.0),
            rotation: Rotation3::identity(),
        };
        let center = pose.matrix() * ball.center.to_homogeneous();
        // 10 % farther than its near side, which is 1 / sqrt(2) before the center.
        let near = center.z - center.normalize().z * std::f64::consts::FRAC_1_SQRT_2;
        let rotation = Rotation3::from_euler_angles(0.3, 0.2, 0.1);
        let box3d = Box3dCue {
            center: Some(Point3::from(center)),
            half_extents: Some(Vector3::new(2.0, 1.0, 0.5)),
            rotation: Some(rotation),
            ..Default::default()
        };
        let mut builder = SceneBuilder::new("test");
        builder.add_frame("a", projection, None).unwrap();
        let edges: BoundingBox = project_bounding_box(&projection, &ball).unwrap();
        let depth = DepthCue { median: 1.1 * near, sd: None, source: None };
        for box3d in [box3d, Box3dCue { half_extents: None, ..box3d }] {
            let cues = Cues { depth: Some(depth), box3d: Some(box3d) };
            let input = NewDetection { frame: "a", bounding_box: Some(edges), cues, ..Default::default() };
            builder.add_detection(&input).unwrap();
        }
        let scene = builder.build();
        let mut rows = ReportDetections::default();
        let body = ReportBody::from(&Body::from(ball));
        rows.push_cues(0, &scene, &scene.detections[0], Some(&body));
        rows.push_cues(1, &scene, &scene.detections[1], None);
        let (row, measured, ratio) = rows.depths[0];
        assert!(row == 0 && (measured - 1.1 * near).abs() < 1e-4 && (ratio.unwrap() - 1.1).abs() < 5e-3, "{ratio:?}");
        assert_eq!(rows.depths[1].2, None);
        // A box without a size is not drawn.
        let [(0, drawn)] = rows.boxes3d.as_slice() else { panic!("{:?}", rows.boxes3d) };
        assert_eq!((drawn.kind, drawn.half), ("cuboid", [2.0, 1.0, 0.5]));
        let cuboid = drawn.body().unwrap();
        assert_eq!(cuboid.kind, BodyKind::Cuboid);
        assert!((cuboid.center - ball.center).norm() < 1e-4);
        let expected = pose.matrix().fixed_columns::<3>(0).transpose() * rotation.matrix();
        assert!((cuboid.rotation.matrix() - expected).amax() < 1e-4);
    }

    #[test]
    fn numbers_are_rounded_to_their_digits() {
        assert_eq!(
            [123.456_789, -0.001_234_567_8, 0.0, 9.999_999_9e9].map(rounded),
            [123.457, -0.001_234_57, 0.0, 1e10]
        );
    }
}
