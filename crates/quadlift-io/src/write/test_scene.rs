//! A scene for the tests of the writers: an ellipsoid, a cuboid and a superellipsoid before two cameras.

use nalgebra::{Point3, Rotation3, Vector3};
use quadlift::geometry::{Body, BodyKind, Ellipsoid};

use crate::scene_file::{CameraRecord, DetectionRecord, FrameRecord, ObjectRecord, SceneFile, ViewRecord};

/// Three objects near the origin, "up" is z. Camera 0 stands at (0, -10, 0) and looks along y; camera 1 at (10, 0, 0) and
/// looks along -x; both see 640 x 480 pixels with a focal length of 500.
pub(crate) fn three_bodies() -> SceneFile {
    let object = |id: &str, category: Option<&str>, body: Body, enclosing: Option<f64>| {
        let mut record =
            ObjectRecord { id: id.into(), category: category.map(str::to_owned), ..ObjectRecord::default() };
        record.set_true_body(&body);
        record.enclosing = enclosing.map(|factor| Box::new((&body.scaled(factor)).into()));
        record
    };
    let turn = |angle: f64| Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
    let ellipsoid =
        Ellipsoid { center: Point3::new(1.0, 0.5, 0.0), semi_axes: Vector3::new(0.5, 0.25, 0.75), rotation: turn(0.0) };
    let cuboid = Body {
        kind: BodyKind::Cuboid,
        center: Point3::new(-1.0, 0.0, 0.5),
        half_extents: Vector3::new(1.0, 0.5, 0.25),
        rotation: turn(0.5),
    };
    let superellipsoid = Body {
        center: Point3::new(0.0, 1.0, -1.0),
        half_extents: Vector3::new(0.5, 0.5, 0.25),
        rotation: turn(0.0),
        kind: BodyKind::Superellipsoid(1.5),
    };
    let mut objects = vec![
        object("1", Some("cup"), Body::from(ellipsoid), Some(1.25)),
        object("2", Some("box"), cuboid, Some(1.25)),
        object("tin", Some("cup"), superellipsoid, None),
    ];
    objects[0].status = Some("ok".into());
    let view = |frame: &str, residual_px, inlier| ViewRecord {
        frame: frame.into(),
        residual_px,
        inlier,
        ..ViewRecord::default()
    };
    objects[0].view_residuals_px = vec![view("000090", Some(0.5), true), view("000091", None, false)];
    let frame = |id: &str, rows| FrameRecord {
        id: id.into(),
        camera: Some("cam".into()),
        cam_from_world: Some(rows),
        image: Some(format!("images/{id}.png")),
        ..FrameRecord::default()
    };
    SceneFile {
        name: Some("three bodies".into()),
        length_unit: Some("m".into()),
        up: Some([0.0, 0.0, 2.0]),
        cameras: vec![CameraRecord {
            id: "cam".into(),
            model: "PINHOLE".into(),
            width: Some(640.0),
            height: Some(480.0),
            params: vec![500.0, 500.0, 320.0, 240.0],
            ..CameraRecord::default()
        }],
        frames: vec![
            frame("000090", [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 10.0]]),
            frame("000091", [[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [-1.0, 0.0, 0.0, 10.0]]),
        ],
        detections: vec![DetectionRecord {
            frame: "000091".into(),
            object: Some("2".into()),
            category: Some("box".into()),
            bounding_box: Some([1.0, 2.0, 3.0, 4.0]),
            ..DetectionRecord::default()
        }],
        objects,
        ..SceneFile::default()
    }
}
