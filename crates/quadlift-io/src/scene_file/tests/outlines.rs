//! Outlines and oriented boxes of detections in scene files.

use std::path::Path;

use insta::assert_snapshot;
use serde_json::{Value, json};

use super::messages::VALID;
use crate::scene_file::{SceneFile, parse_scene_file, write_scene};

/// The valid scene, whose first detection has these fields instead of its box.
fn with(fields: &Value) -> String {
    let mut scene: Value = serde_json::from_str(VALID).unwrap();
    let detection = scene["detections"][0].as_object_mut().unwrap();
    detection.remove("box");
    detection.extend(fields.as_object().unwrap().clone());
    scene.to_string()
}

fn read(fields: &Value) -> SceneFile {
    parse_scene_file(Path::new("scene.json"), with(fields).as_bytes()).unwrap()
}

#[test]
fn outlines_and_oriented_boxes_are_lines_of_detections_and_kept() {
    let outline = json!({"outline": [[20, 30], [60, 30], [40, 80.5]]});
    let file = read(&outline);
    let detection = &file.to_scene().unwrap().detections[0];
    assert_eq!(detection.bounding_box.unwrap().edges(), [20.0, 30.0, 60.0, 80.5]);
    assert_eq!(detection.tangent_lines.as_deref().unwrap().count(), 8);
    let turned = json!({"oriented_box": {"center": [80, 60], "size": [30, 10], "angle": 0.5, "note": "kept"}});
    let both = read(&turned);
    let detection = &both.to_scene().unwrap().detections[0];
    let ellipse = detection.tangent_lines.as_deref().unwrap().inscribed_ellipse().unwrap();
    assert!((ellipse.center() - nalgebra::Vector2::new(80.0, 60.0)).norm() < 1e-12 && ellipse.angle() == 0.5);
    for (file, fields) in [(file, outline), (both, turned)] {
        let mut bytes = Vec::new();
        write_scene(&file, &mut bytes).unwrap();
        let written: Value = serde_json::from_slice(&bytes).unwrap();
        for (name, expected) in fields.as_object().unwrap() {
            // Numbers may have got a decimal point.
            let found = &written["detections"][0][name];
            assert_eq!(found.to_string().replace(".0", ""), expected.to_string().replace(".0", ""));
        }
        assert_eq!(parse_scene_file(Path::new("scene.json"), &bytes).unwrap(), file);
    }
}

#[test]
fn an_outline_is_the_mask_of_a_detection_without_one() {
    let file = read(&json!({"outline": [[20, 30], [60, 30], [60, 50], [20, 50]]}));
    let images = file.to_images(Path::new("scene.json")).unwrap();
    let scene = file.to_scene().unwrap();
    let mask = images.read_masks(&scene, &[0]).into_iter().next().unwrap().unwrap().unwrap();
    assert_eq!((mask.count(), mask.bounding_box().unwrap().edges()), (800, [20.0, 30.0, 60.0, 50.0]));
}

#[test]
fn what_is_wrong_with_them_is_said_with_its_place() {
    let message = |fields: &Value| match parse_scene_file(Path::new("scene.json"), with(fields).as_bytes()) {
        Err(error) => error.problem,
        Ok(file) => file.to_scene().unwrap_err().to_string(),
    };
    assert_snapshot!(message(&json!({"outline": [[1, 2], [3, 4]]})), @"detections[0].outline: the outline has 2 points; expected three or more");
    assert_snapshot!(message(&json!({"outline": [[1, 2], [3, 4], [5, 6]]})), @"detections[0].outline: all points of the outline lie on a line; expected a polygon");
    assert_snapshot!(message(&json!({"outline": [1, 2, 3, 4, 5, 6]})), @r#"found the number `1`, expected a list of 2 numbers ("outline": [[x, y], [x, y], ...] in pixels, the corners of a polygon)"#);
    assert_snapshot!(message(&json!({"outline": [[1, 2], [3, 4, 5], [5, 6]]})), @r#"found 3 entries, expected a list of 2 numbers ("outline": [[x, y], [x, y], ...] in pixels, the corners of a polygon)"#);
    assert_snapshot!(message(&json!({"oriented_box": {"center": [1, 2], "size": [3, 0], "angle": 0}})), @"detections[0].oriented_box: the size of the oriented box is 3 x 0; expected two positive numbers");
    assert_snapshot!(message(&json!({"oriented_box": {"center": [1, 2], "size": [3, 4]}})), @r#"missing field `angle` ("oriented_box": {"center": [x, y], "size": [width, height], "angle": radians})"#);
    assert_snapshot!(message(&json!({})), @r#"detections[0]: the detection has none of "box", "outline", "oriented_box" and "ellipse", and no "box3d" with a center"#);
}
