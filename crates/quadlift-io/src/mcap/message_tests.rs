//! What messages mean, from the same content as JSON.

use serde_json::{Value as Json, json};

use super::super::decode::Decoder;
use super::*;

fn value(json: &Json) -> Value {
    Decoder::Json.decode(json.to_string().as_bytes()).unwrap()
}

fn stamp_of(seconds: i64) -> Json {
    json!({ "stamp": { "sec": seconds, "nanosec": 5 }, "frame_id": "/camera" })
}

fn info(model: &str, d: &[f64]) -> Json {
    json!({
        "header": stamp_of(7),
        "width": 640,
        "height": 480,
        "distortion_model": model,
        "d": d,
        "k": [500.0, 0, 320.0, 0, 510.0, 240.0, 0, 0, 1],
        "r": [0, 1, 0, -1, 0, 0, 0, 0, 1],
        "p": [400.0, 0, 300.0, -40.0, 0, 400.0, 200.0, 0, 0, 0, 1, 0],
        "binning_x": 0,
        "binning_y": 0,
        "roi": { "x_offset": 0, "y_offset": 0, "width": 0, "height": 0, "do_rectify": false },
    })
}

fn camera(json: &Json) -> Result<CameraRecord, String> {
    calibration(&value(json), CameraOptions::default()).map(|found| found.camera)
}

#[test]
fn lens_models_have_their_names_and_orders() {
    let found = calibration(&value(&info("plumb_bob", &[])), CameraOptions::default()).unwrap();
    assert_eq!((found.stamp, found.frame.as_str()), (7_000_000_005, "camera"));
    assert_eq!(found.cam_from_frame, Isometry3::identity());
    for (model, d, name, rest) in [
        ("plumb_bob", vec![0.0; 5], "PINHOLE", vec![]),
        ("", vec![], "PINHOLE", vec![]),
        ("plumb_bob", vec![0.1, 0.02, 0.003, 0.004, 0.0], "OPENCV", vec![0.1, 0.02, 0.003, 0.004]),
        (
            "plumb_bob",
            vec![0.1, 0.02, 0.003, 0.004, 0.05],
            "FULL_OPENCV",
            vec![0.1, 0.02, 0.003, 0.004, 0.05, 0.0, 0.0, 0.0],
        ),
        (
            "rational_polynomial",
            vec![0.1, 0.2, 0.003, 0.004, 0.5, 0.6, 0.7, 0.8, 0.0, 0.0, 0.0, 0.0],
            "FULL_OPENCV",
            vec![0.1, 0.2, 0.003, 0.004, 0.5, 0.6, 0.7, 0.8],
        ),
        ("equidistant", vec![0.1, 0.2, 0.3, 0.4], "OPENCV_FISHEYE", vec![0.1, 0.2, 0.3, 0.4]),
        ("kannala_brandt", vec![0.0; 4], "OPENCV_FISHEYE", vec![0.0; 4]),
    ] {
        let found = camera(&info(model, &d)).unwrap();
        assert_eq!((found.model.as_str(), &found.params[4..]), (name, &rest[..]), "{model} {d:?}");
        assert_eq!(found.params[..4], [500.0, 510.0, 320.0, 240.0]);
        assert_eq!((found.width, found.height), (Some(640.0), Some(480.0)));
    }
    let refused = |model: &str, d: &[f64]| camera(&info(model, d)).unwrap_err();
    assert!(refused("fisheye_62", &[0.1]).contains("\"fisheye_62\" is not supported; expected plumb_bob,"));
    assert!(refused("plumb_bob", &[0.1; 3]).ends_with("\"plumb_bob\" has 3 coefficients; expected 4 or 5"));
    assert!(refused("rational_polynomial", &[0.1; 14]).contains("thin-prism or tilt"));
    let mut none = info("plumb_bob", &[]);
    none["k"] = json!([0, 0, 0, 0, 0, 0, 0, 0, 0]);
    assert_eq!(camera(&none).unwrap_err(), "K is zero: the camera is not calibrated");
    none["k"] = json!([1, 0]);
    assert_eq!(camera(&none).unwrap_err(), "k: expected 9 numbers");
}

#[test]
fn parts_of_images_and_rectified_images_have_other_matrices() {
    let mut json = info("plumb_bob", &[]);
    json["binning_x"] = json!(2);
    json["binning_y"] = json!(2);
    json["roi"] = json!({ "x_offset": 100, "y_offset": 40, "width": 200, "height": 100, "do_rectify": false });
    let found = camera(&json).unwrap();
    assert_eq!(found.params, [250.0, 255.0, 110.0, 100.0]);
    assert_eq!((found.width, found.height), (Some(100.0), Some(50.0)));
    // Half a pixel is half a pixel of the full image.
    let integer = CameraOptions { pixel_centers: PixelCenters::Integer, ..CameraOptions::default() };
    assert_eq!(calibration(&value(&json), integer).unwrap().camera.params[2], 110.25);
    let rectified = CameraOptions { rectified: true, ..CameraOptions::default() };
    let found = calibration(&value(&info("rational_polynomial", &[0.1; 8])), rectified).unwrap();
    assert_eq!((found.camera.model.as_str(), found.camera.params), ("PINHOLE", vec![400.0, 400.0, 300.0, 200.0]));
    // A quarter turn, and the right camera of a pair a tenth of a meter to the right.
    let point = found.cam_from_frame * nalgebra::Point3::new(1.0, 2.0, 3.0);
    assert!((point - nalgebra::Point3::new(2.0 - 0.1, -1.0, 3.0)).norm() < 1e-12, "{point}");
}

#[test]
fn detections_of_all_versions_are_the_same() {
    let pose = json!({});
    let now = json!({
        "header": stamp_of(7),
        "results": [
            { "hypothesis": { "class_id": "cup", "score": 0.4 }, "pose": pose },
            { "hypothesis": { "class_id": "mug", "score": 0.6 }, "pose": pose },
        ],
        "bbox": { "center": { "position": { "x": 50, "y": 40 }, "theta": 0 }, "size_x": 20, "size_y": 10 },
        "id": "12",
    });
    let before = json!({
        "header": stamp_of(7),
        "results": [{ "id": "cup", "score": 0.4, "pose": pose }, { "id": "mug", "score": 0.6, "pose": pose }],
        "bbox": { "center": { "x": 50, "y": 40, "theta": 0 }, "size_x": 20, "size_y": 10 },
        "is_tracking": true,
        "tracking_id": "12",
    });
    let read = |entries: Json| {
        let empty = json!({ "stamp": { "sec": 7, "nanosec": 5 }, "frame_id": "" });
        detections(&value(&json!({ "header": empty, "detections": entries }))).unwrap()
    };
    let found = read(json!([now]));
    assert_eq!(read(json!([before])), found);
    assert_eq!((found.stamp, found.frame.as_str()), (7_000_000_005, "camera"), "of the entry");
    let record = &found.detections[0];
    assert_eq!(
        (record.category.as_deref(), record.score, record.object.as_deref()),
        (Some("mug"), Some(0.6), Some("t12"))
    );
    assert_eq!(record.bounding_box, Some([40.0, 35.0, 60.0, 45.0]));
    let mut untracked = before.clone();
    untracked["is_tracking"] = json!(false);
    assert_eq!(read(json!([untracked])).detections[0].object, None);
    // A rotated box, and one without a width.
    let (mut turned, mut empty) = (now.clone(), now);
    turned["bbox"]["center"]["theta"] = json!(std::f64::consts::FRAC_PI_2);
    empty["bbox"]["size_x"] = json!(0);
    let found = read(json!([turned, empty]));
    let turned = found.detections[0].oriented_box.as_ref().unwrap();
    assert_eq!((turned.center, turned.size, turned.angle), ([50.0, 40.0], [20.0, 10.0], std::f64::consts::FRAC_PI_2));
    assert_eq!((found.detections[0].bounding_box, &found.detections[0].ellipse), (None, &None));
    assert_eq!(found.detections.len(), 1);
    assert_eq!(found.problems, ["detections[1].bbox: found the box 0 x 10 at [50, 40]; expected a size above 0"]);
}

#[test]
fn annotations_that_are_boxes_have_the_nearest_text() {
    let time = json!({ "sec": 7, "nsec": 5 });
    let corners = |x: f64| json!([{ "x": x, "y": 10 }, { "x": x + 20.0, "y": 10 }, { "x": x + 20.0, "y": 30 }, { "x": x, "y": 30 }]);
    let line = |kind: Json, points: Json, metadata: Json| json!({ "timestamp": time, "type": kind, "points": points, "metadata": metadata });
    let text = |x: f64, text: &str| json!({ "timestamp": time, "position": { "x": x, "y": 8 }, "text": text });
    let metadata =
        json!([{ "key": "class", "value": "tin" }, { "key": "score", "value": "0.5" }, { "key": "id", "value": "3" }]);
    let mut tilted = corners(10.0);
    tilted[1]["y"] = json!(12);
    let message = json!({
        "points": [
            line(json!(2), corners(10.0), json!([])),
            line(json!("LINE_LOOP"), corners(100.0), metadata),
            line(json!(2), corners(500.0), json!([])),
            line(json!(2), tilted, json!([])),
            line(json!(1), corners(10.0), json!([])),
        ],
        "texts": [text(11.0, "cup"), text(19.0, "mug"), text(104.0, "no")],
    });
    let found = annotations(&value(&message)).unwrap().unwrap();
    assert_eq!(found.stamp, 7_000_000_005);
    let boxes: Vec<_> =
        found.detections.iter().map(|d| (d.category.as_deref(), d.score, d.object.as_deref())).collect();
    assert_eq!(boxes, [(Some("cup"), None, None), (Some("tin"), Some(0.5), Some("t3")), (None, None, None)]);
    assert_eq!(found.detections[0].bounding_box, Some([10.0, 10.0, 30.0, 30.0]));
    assert_eq!(annotations(&value(&json!({ "points": [], "texts": [] }))), Ok(None));
}

#[test]
fn poses_and_transforms_of_both_kinds_are_read() {
    let place = json!({ "x": 1, "y": 2, "z": 3 });
    let turn = json!({ "x": 0, "y": 0, "z": 0, "w": 1 });
    let ros = json!({ "transforms": [
        { "header": { "stamp": { "sec": 7, "nanosec": 5 }, "frame_id": "/map" }, "child_frame_id": "base",
          "transform": { "translation": place, "rotation": turn } },
        { "header": stamp_of(7), "child_frame_id": "camera", "transform": { "translation": place, "rotation": turn } },
    ]});
    let foxglove = json!({ "timestamp": { "sec": 7, "nsec": 5 }, "parent_frame_id": "map", "child_frame_id": "base",
        "translation": place, "rotation": turn });
    let list = transforms(&value(&ros)).unwrap();
    assert_eq!(transforms(&value(&foxglove)).unwrap()[0], list[0]);
    assert_eq!(list[0].as_ref().unwrap().parent_from_child.translation.vector, nalgebra::Vector3::new(1.0, 2.0, 3.0));
    let message = list[1].as_ref().unwrap_err();
    assert_eq!(message, "transforms[1]: found the transform \"camera\" to \"camera\"; expected two frames");
    let inner = json!({ "position": place, "orientation": turn });
    let header = json!({ "stamp": { "sec": 7, "nanosec": 5 }, "frame_id": "map" });
    let odometry = json!({ "header": header, "child_frame_id": "base", "pose": { "pose": inner, "covariance": [] } });
    assert_eq!(Ok(pose(&value(&odometry)).unwrap()), list[0]);
    let mut wrong = json!({ "header": header, "pose": inner });
    assert_eq!(pose(&value(&wrong)).unwrap().child, "");
    wrong["pose"]["orientation"]["w"] = json!(0.5);
    let message = pose(&value(&wrong)).unwrap_err();
    assert_eq!(message, "pose.orientation: found the quaternion [0, 0, 0, 0.5]; expected one of length 1");
    wrong["header"]["stamp"]["sec"] = json!(9_000_000_000_i64);
    assert!(pose(&value(&wrong)).unwrap_err().starts_with("header.stamp: found 9000000000 seconds"));
}
