//! What a person reads when a scene file is wrong.

use std::path::Path;

use insta::assert_snapshot;

use crate::scene_file::{parse_scene_file, read_scene_file};

/// A scene with every kind of entry.
pub(super) const VALID: &str = r#"{
 "format": "quadlift.scene", "version": 1, "name": "test", "up": [0, -1, 0],
 "cameras": [{"id": "cam", "model": "PINHOLE", "width": 640, "height": 480, "params": [500, 500, 320, 240]}],
 "frames": [
  {"id": "000012", "camera": "cam", "cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4]]},
  {"id": "000013", "projection": [[500, 0, 320, 0], [0, 500, 240, 0], [0, 0, 1, 5]], "width": 640, "height": 480}
 ],
 "detections": [
  {"frame": "000012", "object": "duck", "category": "toy", "source": "yolo", "score": 0.9, "box": [10, 20, 30, 40]},
  {"frame": "000013", "object": "duck", "source": "yolo", "occluded": 1,
   "ellipse": {"center": [20, 30], "semi_axes": [9, 8], "angle": 0.5}}
 ],
 "objects": [
  {"id": "duck", "ellipsoid": {"center": [0, 0, 0], "semi_axes": [3, 2, 1], "rotation": [1, 0, 0, 0]},
   "cuboid": {"center": [0, 0, 0], "half_extents": [3, 2, 1], "rotation": [1, 0, 0, 0]},
   "superellipsoid": {"center": [0, 0, 0], "semi_axes": [3, 2, 1], "rotation": [1, 0, 0, 0], "support_exponent": 1.5},
   "status": "ok"}
 ]
}
"#;

/// The message for the content of a file, from whichever step refuses it.
fn message(bytes: &[u8]) -> String {
    let path = Path::new("scene.json");
    let file = match parse_scene_file(path, bytes) {
        Ok(file) => file,
        Err(error) => return error.to_string(),
    };
    match (file.to_scene(), file.to_objects()) {
        (Err(error), _) | (_, Err(error)) => error.in_file(path).to_string(),
        _ => "no error".to_owned(),
    }
}

/// The message after one change of the valid scene.
fn after(from: &str, to: &str) -> String {
    assert_eq!(VALID.matches(from).count(), 1, "{from} must be in the text once");
    message(VALID.replace(from, to).as_bytes())
}

#[test]
fn the_valid_scene_is_valid() {
    assert_eq!(message(VALID.as_bytes()), "no error");
    assert_eq!(message(format!("\u{feff}{VALID}").as_bytes()), "no error");
    assert_eq!(message(br#"{"format": "quadlift.scene", "version": 1}"#), "no error");
}

#[test]
fn files_that_are_no_scenes() {
    assert_snapshot!(message(b""), @"scene.json: the file is empty");
    assert_snapshot!(message(b" \n "), @"scene.json: the file is empty");
    assert_snapshot!(message(b"# frame x y\n1 2 3\n"), @"scene.json:1:1: this is not a scene file: expected a JSON object, which starts with {; found '#'");
    assert_snapshot!(message(b"[1, 2]"), @"scene.json:1:1: this is not a scene file: expected a JSON object, which starts with {; found '['");
    assert_snapshot!(message(&b"[".repeat(100_000)), @"scene.json:1:1: this is not a scene file: expected a JSON object, which starts with {; found '['");
    assert_snapshot!(message(b"{\"a\": \"b\xE9\"}"), @"scene.json:1:9: the byte 0xe9 is not UTF-8 text; expected a text file in UTF-8");
    assert_snapshot!(message(b"\xFF\xFE{\0}\0"), @"scene.json: the file is UTF-16 text; save it as UTF-8");
    assert_snapshot!(message(b"{}"), @r#"scene.json: this is not a scene file: it has no "format"; expected "format": "quadlift.scene""#);
    assert_snapshot!(message(br#"{"images": [], "annotations": []}"#), @r#"scene.json: this is not a scene file: it has no "format"; expected "format": "quadlift.scene""#);
    assert_snapshot!(after(r#""quadlift.scene""#, r#""coco""#), @r#"scene.json: this is not a scene file: "format" is "coco"; expected "quadlift.scene""#);
    assert_snapshot!(after(r#""quadlift.scene""#, "7"), @r#"scene.json: this is not a scene file: "format" is 7; expected "quadlift.scene""#);
    assert_snapshot!(after(r#""version": 1, "#, ""), @r#"scene.json: the file has no "version"; expected "version": 1"#);
    assert_snapshot!(after(r#""version": 1"#, r#""version": "1""#), @r#"scene.json: "version" is "1"; expected the number 1"#);
    assert_snapshot!(message(br#"{"frames": {"a": 1}, "version": 2, "format": "quadlift.scene"}"#), @"scene.json: the file has version 2 of the scene format; this program reads version 1");
    assert_snapshot!(message(br#"{"format": "quadlift.scene", "version": 1.5, "detections": 3}"#), @"scene.json: the file has version 1.5 of the scene format; this program reads version 1");
}

#[test]
fn paths_that_are_no_files() {
    let folder = tempfile::tempdir().unwrap();
    let problem = |path: &Path| read_scene_file(path).unwrap_err().problem;
    assert_snapshot!(problem(folder.path()), @"this is a folder; expected a file");
    assert_snapshot!(problem(&folder.path().join("no.json")), @"there is no such file");
    assert_snapshot!(problem(&folder.path().join("no/scene.json")), @"there is no such file");
    assert_snapshot!(read_scene_file(Path::new("no.json")).unwrap_err().to_string(), @"no.json: there is no such file");
}

#[test]
fn invalid_json() {
    assert_snapshot!(message(&VALID.as_bytes()[..VALID.len() / 2]), @"scene.json:9:89: detections[0]: the file ends too early, it may be cut off (EOF while parsing an object)");
    assert_snapshot!(after(r#""score": 0.9,"#, r#""score": 0.9"#), @"scene.json:9:91: detections[0]: this is not valid JSON: expected `,` or `}`");
    assert_snapshot!(after("[10, 20, 30, 40]}", "[10, 20, 30, 40]},"), @"scene.json:9:117: detections[1]: this is not valid JSON: expected value");
    assert_snapshot!(after("0.9", "NaN"), @"scene.json:9:87: detections[0].score: NaN is not JSON; leave the field out when there is no value (expected value)");
    assert_snapshot!(after("[10, 20, 30, 40]", "[10, 20, 30, -Infinity]"), @"scene.json:9:113: detections[0].box[3]: -Infinity is not JSON; leave the field out when there is no value (invalid number)");
    assert_snapshot!(after("0.9", "None"), @"scene.json:9:87: detections[0].score: None is not JSON; leave the field out when there is no value (expected value)");
    assert_snapshot!(after("0.9", "1e999"), @"scene.json:9:91: detections[0].score: this is not valid JSON: number out of range");
    assert_snapshot!(after(r#""name": "test""#, r#"'name': 'test'"#), @"scene.json:2:44: this is not valid JSON: key must be a string");
    assert_snapshot!(after(r#""name": "test""#, r#""version": 1"#), @"scene.json:2:52: duplicate field `version`");
    assert_snapshot!(message(format!("{VALID}x").as_bytes()), @"scene.json:20:1: this is not valid JSON: there is more text after the end");
    assert_snapshot!(after(r#""test""#, &"[".repeat(100_000)), @"scene.json:2:51: name: found a list, expected text in quotes");
    assert_snapshot!(after(r#""name""#, &format!("\"mine\": {}", "[".repeat(100_000))), @"scene.json:2:178: mine[0][0][0][0][0]...: the entries are nested too deeply");
}

#[test]
fn entries_of_another_shape() {
    assert_snapshot!(after("[10, 20, 30, 40]", "[10, 20, 30]"), @r#"scene.json:9:110: detections[0].box: found 3 entries, expected a list of 4 numbers ("box": [x0, y0, x1, y1] in pixels)"#);
    assert_snapshot!(after("[10, 20, 30, 40]", "[10, 20, 30, 40, 50]"), @r#"scene.json:9:118: detections[0].box: found 5 entries, expected a list of 4 numbers ("box": [x0, y0, x1, y1] in pixels)"#);
    assert_snapshot!(after("[10, 20, 30, 40]", "[10, 20, \"30\", 40]"), @r#"scene.json:9:111: detections[0].box[2]: found the text "30", expected a number ("box": [x0, y0, x1, y1] in pixels)"#);
    assert_snapshot!(after("[10, 20, 30, 40]", r#"{"x": 1}"#), @r#"scene.json:9:98: detections[0].box: found an object {...}, expected a list of 4 numbers ("box": [x0, y0, x1, y1] in pixels)"#);
    assert_snapshot!(after(r#"{"frame": "000012", "#, "{"), @"scene.json:9:96: detections[0]: missing field `frame`");
    assert_snapshot!(after(r#""frame": "000012""#, r#""frame": 12"#), @r#"scene.json:9:14: detections[0].frame: found the number `12`, expected text in quotes (ids and names are text, also "12")"#);
    assert_snapshot!(after(r#""frame": "000012""#, r#""frame": "000012", "frame": "000013""#), @"scene.json:9:29: detections[0]: duplicate field `frame`");
    assert_snapshot!(after("[0, 0, 1, 4]]", "[0, 0, 1, 4], [0, 0, 0, 1]]"), @r#"scene.json:5:110: frames[0].cam_from_world: found 4 entries, expected a list of 3 lists of 4 numbers ("cam_from_world": three rows [r, r, r, t], which map world points to camera points)"#);
    assert_snapshot!(after("[0, 0, 1, 4]]", "[0, 0, 1]]"), @r#"scene.json:5:92: frames[0].cam_from_world[2]: found 3 entries, expected a list of 4 numbers ("cam_from_world": three rows [r, r, r, t], which map world points to camera points)"#);
    assert_snapshot!(after(r#""semi_axes": [9, 8]"#, r#""axes": [9, 8]"#), @r#"scene.json:11:64: detections[1].ellipse: missing field `semi_axes` ("ellipse": {"center": [x, y], "semi_axes": [a, b], "angle": radians})"#);
    assert_snapshot!(after("[0, -1, 0]", r#""y""#), @r#"scene.json:2:68: up: found the text "y", expected a list of 3 numbers ("up": [x, y, z], the world direction against gravity)"#);
    assert_snapshot!(after("640, \"height\": 480, \"params\"", "\"640\", \"height\": 480, \"params\""), @r#"scene.json:3:61: cameras[0].width: found the text "640", expected a number"#);
    assert_snapshot!(after(r#""occluded": 1"#, r#""occluded": true"#), @"scene.json:10:74: detections[1].occluded: found `true`, expected a number");
}

#[test]
fn cameras() {
    assert_snapshot!(after("PINHOLE", "OPENCV"), @"scene.json: cameras[0].params: a OPENCV camera has 8 params [fx, fy, cx, cy, k1, k2, p1, p2]; found 4");
    assert_snapshot!(after("PINHOLE", "pinhole"), @r#"scene.json: cameras[0].model: unknown camera model "pinhole"; did you mean "PINHOLE"?"#);
    assert_snapshot!(after("PINHOLE", "SIMPLE_PINHOLE"), @"scene.json: cameras[0].params: a SIMPLE_PINHOLE camera has 3 params [f, cx, cy]; found 4");
    assert_snapshot!(after("[500, 500, 320, 240]", "[500, 320, 240]"), @"scene.json: cameras[0].params: a PINHOLE camera has 4 params [fx, fy, cx, cy]; found 3");
    assert_snapshot!(after("[500, 500, 320, 240]", "[0, 500, 320, 240]"), @"scene.json: cameras[0].params: focal lengths are (0, 500); expected two positive numbers (the intrinsics are singular)");
    assert_snapshot!(after("[500, 500, 320, 240]", "[500, -500, 320, 240]"), @"scene.json: cameras[0].params: focal lengths are (500, -500); expected two positive numbers (the intrinsics are singular)");
    assert_snapshot!(after("\"width\": 640, \"height\": 480, \"params\"", "\"width\": 640, \"params\""), @r#"scene.json: cameras[0]: there is a "width" but no "height""#);
    assert_snapshot!(after("\"width\": 640, \"height\": 480, \"params\"", "\"width\": 0, \"height\": 480, \"params\""), @"scene.json: cameras[0]: the image size is 0 x 480; expected two positive numbers");
    assert_snapshot!(after("\"width\": 640, \"height\": 480, \"params\"", "\"params\""), @"no error");
    let twice = r#"[{"id": "cam", "model": "SIMPLE_PINHOLE", "params": [500, 320, 240]}, {"#;
    assert_snapshot!(after("\"cameras\": [{", &format!("\"cameras\": {twice}")), @r#"scene.json: cameras[1]: the camera id "cam" is used twice"#);
}

#[test]
fn frames() {
    assert_snapshot!(after(r#""camera": "cam""#, r#""camera": "Cam""#), @r#"scene.json: frames[0].camera: unknown camera "Cam"; did you mean "cam"?"#);
    assert_snapshot!(after(r#""camera": "cam""#, r#""camera": "left""#), @r#"scene.json: frames[0].camera: unknown camera "left"; the cameras are: "cam""#);
    assert_snapshot!(after(r#""camera": "cam", "#, ""), @r#"scene.json: frames[0]: expected "camera" and "cam_from_world", or "projection" alone; found "cam_from_world""#);
    assert_snapshot!(after(r#""camera": "cam", "cam_from_world": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 4]]"#, r#""time": 3"#), @r#"scene.json: frames[0]: expected "camera" and "cam_from_world", or "projection" alone; found none of them"#);
    assert_snapshot!(after(r#""projection""#, r#""camera": "cam", "projection""#), @r#"scene.json: frames[1]: expected "camera" and "cam_from_world", or "projection" alone; found "camera" and "projection""#);
    assert_snapshot!(after("[[1, 0, 0, 0]", "[[2, 0, 0, 0]"), @"scene.json: frames[0].cam_from_world: the 3x3 part of cam_from_world is not a rotation (|R R^T - I| is 3.000e0, at most 1e-3 is accepted)");
    assert_snapshot!(after("[[1, 0, 0, 0]", "[[-1, 0, 0, 0]"), @"scene.json: frames[0].cam_from_world: the 3x3 part of cam_from_world is not a rotation (|R R^T - I| is inf, at most 1e-3 is accepted)");
    assert_snapshot!(after("[[500, 0, 320, 0]", "[[0, 500, 240, 0]"), @"scene.json: frames[1].projection: the left 3x3 block of the projection is singular (its determinant is 0.000e0)");
    assert_snapshot!(after(r#""id": "000013""#, r#""id": "000012""#), @r#"scene.json: frames[1]: the frame id "000012" is used twice"#);
    assert_snapshot!(after("\"width\": 640, \"height\": 480}", "\"height\": 480}"), @r#"scene.json: frames[1]: there is a "height" but no "width""#);
    assert_snapshot!(after("\"width\": 640, \"height\": 480}", "\"width\": 640, \"height\": -1}"), @"scene.json: frames[1]: the image size is 640 x -1; expected two positive numbers");
    assert_snapshot!(after("[0, -1, 0]", "[0, 0, 0]"), @"scene.json: up: [0.0, 0.0, 0.0] is not a direction; expected the world direction against gravity");
}

#[test]
fn detections() {
    assert_snapshot!(after(r#""frame": "000012""#, r#""frame": "12""#), @r#"scene.json: detections[0].frame: unknown frame "12"; did you mean "000012"?"#);
    assert_snapshot!(after(r#""frame": "000012""#, r#""frame": "img_7""#), @r#"scene.json: detections[0].frame: unknown frame "img_7"; the frames are: "000012", "000013""#);
    assert_snapshot!(after(r#""frame": "000013""#, r#""frame": "000012""#), @r#"scene.json: detections[1]: object "duck" is detected twice in frame "000012" by the same source (first by detections[0])"#);
    assert_snapshot!(after("[10, 20, 30, 40]", "[30, 20, 10, 40]"), @"scene.json: detections[0].box: the box [30, 20, 10, 40] is empty or reversed; expected [x0, y0, x1, y1] with x0 < x1 and y0 < y1 (if the numbers are x, y, width, height: --assume boxes=xywh; center and size: --assume boxes=cxcywh)");
    assert_snapshot!(after("[10, 20, 30, 40]", "[10, 20, 30, 20]"), @"scene.json: detections[0].box: the box [10, 20, 30, 20] is empty or reversed; expected [x0, y0, x1, y1] with x0 < x1 and y0 < y1 (if the numbers are x, y, width, height: --assume boxes=xywh; center and size: --assume boxes=cxcywh)");
    assert_snapshot!(after(r#", "box": [10, 20, 30, 40]"#, ""), @r#"scene.json: detections[0]: the detection has none of "box", "outline", "oriented_box" and "ellipse", and no "box3d" with a center"#);
    assert_snapshot!(after("[9, 8]", "[9, 0]"), @r#"scene.json: detections[1].ellipse: the conic is not an ellipse with positive semi-axes; "semi_axes" is [9.0, 0.0]"#);
    let no_frames = VALID.find("\"frames\"").unwrap()..VALID.find("\"detections\"").unwrap();
    let mut text = VALID.to_owned();
    text.replace_range(no_frames, "");
    assert_snapshot!(message(text.as_bytes()), @r#"scene.json: detections[0].frame: unknown frame "000012"; the file has no frames"#);
}

#[test]
fn objects() {
    let other = r#""objects": [{"id": "duck"}, "#;
    assert_snapshot!(after("\"objects\": [", other), @r#"scene.json: objects[1]: the object id "duck" is used twice (first by objects[0])"#);
    assert_snapshot!(after(r#"[3, 2, 1], "rotation": [1, 0, 0, 0]},
   "cuboid""#, r#"[3, 2, 0], "rotation": [1, 0, 0, 0]},
   "cuboid""#), @"scene.json: objects[0].ellipsoid.semi_axes: expected three positive numbers, found [3.0, 2.0, 0.0]");
    assert_snapshot!(after(r#""half_extents": [3, 2, 1], "rotation": [1, 0, 0, 0]"#, r#""half_extents": [3, 2, 1], "rotation": [1, 1, 0, 0]"#), @"scene.json: objects[0].cuboid.rotation: expected a unit quaternion [w, x, y, z], found [1.0, 1.0, 0.0, 0.0]");
    assert_snapshot!(after("1.5", "3"), @"scene.json: objects[0].superellipsoid.support_exponent: 3 is not a number from 1 (cuboid) to 2 (ellipsoid)");
    assert_snapshot!(after(r#""status": "ok""#, r#""status": "fine""#), @r#"scene.json: objects[0].status: unknown status "fine"; expected one of ok, inconsistent, undetermined, not_an_ellipsoid, too_few_views, degenerate, diverged"#);
    assert_snapshot!(after(r#""status": "ok""#, r#""covariance": {"coordinates": "x", "matrix": [[1]]}"#), @"scene.json:17:52: objects[0].covariance.matrix[0]: found 1 entry, expected a list of 9 numbers");
    let matrix = serde_json::to_string(&[[1.0; 9]; 9]).unwrap();
    assert_snapshot!(after(r#""status": "ok""#, &format!(r#""covariance": {{"coordinates": "x", "matrix": {matrix}}}"#)), @r#"scene.json: objects[0].covariance.coordinates: unknown coordinates "x"; expected center_vech_shape or center_rotation_log_axes"#);
}

#[test]
fn the_size_of_a_frame_comes_before_that_of_its_camera() {
    let text = r#"{"format": "quadlift.scene", "version": 1,
        "cameras": [{"id": "c", "model": "PINHOLE", "width": 640, "height": 480, "params": [500, 500, 320, 240]}],
        "frames": [
            {"id": "own", "camera": "c", "width": 320, "height": 200, "cam_from_world": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]},
            {"id": "other", "camera": "c", "cam_from_world": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]}"#;
    let scene = parse_scene_file(Path::new("scene.json"), text.as_bytes()).unwrap().to_scene().unwrap();
    let sizes: Vec<[f64; 2]> = scene.frames.iter().map(|frame| frame.image_size.unwrap().into()).collect();
    assert_eq!(sizes, [[320.0, 200.0], [640.0, 480.0]]);
}
