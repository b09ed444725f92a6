use nalgebra::Rotation3;
use serde_json::{Value, json};

use super::*;
use crate::scene_file::FrameRecord;

/// A camera 1.5 above the origin that looks along the world's -z, turned to the left by 90 degrees: along -x. Its x axis is the
/// world's -z, its y axis the world's y, and its z axis, backwards, the world's x.
fn looks_along_minus_x() -> Matrix4<f64> {
    Matrix4::from_row_slice(&[0.0, 0.0, 1.0, 0.5, 0.0, 1.0, 0.0, 1.5, -1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0])
}

/// Names of images by their stems: all of them, with .jpg.
fn all_there() -> CaptureImages<'static> {
    CaptureImages { named: &|stem| Some(format!("{stem}.jpg")), size_of: &|_| Some([1920.0, 1440.0]) }
}

fn none_there() -> CaptureImages<'static> {
    CaptureImages { named: &|_| None, size_of: &|_| None }
}

fn polycam_frame(transform: &Matrix4<f64>) -> Value {
    let mut camera = json!({
        "fx": 700.5, "fy": 701.0, "cx": 511.0, "cy": 383.5, "width": 1024, "height": 768, "blur_score": 115.28,
        "timestamp": 638443502, "manual_keyframe": false, "neighbors": [],
    });
    for i in 0..3 {
        for j in 0..4 {
            camera[format!("t_{i}{j}")] = json!(transform[(i, j)]);
        }
    }
    camera
}

fn scanner_frame(transform: &Matrix4<f64>) -> Value {
    json!({
        "cameraPoseARFrame": transform.transpose().as_slice(),
        "intrinsics": [1348.5, 0, 961.0, 0, 1349.0, 718.5, 0, 0, 1],
        "time": 1234.5, "frame_index": 0, "motionQuality": 1,
    })
}

fn record3d(poses: &Value) -> Value {
    json!({"w": 720, "h": 960, "fps": 30, "K": [601, 0, 0, 0, 602, 0, 358.5, 481, 1], "poses": poses})
}

fn polycam(camera: &Value) -> Result<Import, ReadError> {
    let text = camera.to_string();
    let file = FrameFile { stem: "638443502", path: Path::new("638443502.json"), bytes: text.as_bytes() };
    parse_polycam(Path::new("cameras"), &[file], &all_there(), &ReadOptions::default())
}

fn scanner(frame: &Value, images: &CaptureImages) -> Result<Import, ReadError> {
    let text = frame.to_string();
    let file = FrameFile { stem: "frame_00000", path: Path::new("frame_00000.json"), bytes: text.as_bytes() };
    parse_scanner(Path::new("scan"), &[file], images, &ReadOptions::default())
}

fn metadata(document: &Value, images: &CaptureImages) -> Result<Import, ReadError> {
    parse_record3d(Path::new("metadata"), document.to_string().as_bytes(), images, &ReadOptions::default())
}

/// Where a point of the world is seen, in pixels, and its depth.
fn seen(scene: &SceneFile, frame: &FrameRecord, point: [f64; 3]) -> [f64; 3] {
    let camera = scene.cameras.iter().find(|camera| Some(&camera.id) == frame.camera.as_ref()).unwrap();
    let in_camera = from_rows(&frame.cam_from_world.unwrap()) * Vector4::new(point[0], point[1], point[2], 1.0);
    let [fx, fy, cx, cy] = camera.params[..] else { panic!("{camera:?}") };
    [fx * in_camera.x / in_camera.z + cx, fy * in_camera.y / in_camera.z + cy, in_camera.z]
}

#[test]
fn polycams_cameras_look_where_arkit_says() {
    let import = polycam(&polycam_frame(&looks_along_minus_x())).unwrap();
    let scene = &import.scene;
    assert_eq!((scene.up, scene.length_unit.as_deref()), (Some([0.0, 1.0, 0.0]), Some("m")));
    let frame = &scene.frames[0];
    assert_eq!((frame.id.as_str(), frame.time), ("638443502.jpg", Some(638.443502)));
    // Two units ahead, a half to the right (the world's -z) and a quarter above.
    let pixel = seen(scene, frame, [0.5 - 2.0, 1.5 + 0.25, 2.0 - 0.5]);
    assert_eq!(pixel, [511.0 + 700.5 * 0.25, 383.5 - 701.0 * 0.125, 2.0]);
    assert_eq!((scene.cameras[0].width, scene.cameras[0].height), (Some(1024.0), Some(768.0)));
}

#[test]
fn the_three_apps_give_the_same_pose() {
    let turn = Rotation3::from_euler_angles(0.3, -0.8, 1.2);
    let transform = matrix4(turn.matrix(), &Vector3::new(0.4, -0.7, 2.5));
    let q = nalgebra::UnitQuaternion::from_rotation_matrix(&turn);
    let poses = json!([[q.i, q.j, q.k, q.w, 0.4, -0.7, 2.5]]);
    let imports = [
        polycam(&polycam_frame(&transform)).unwrap(),
        scanner(&scanner_frame(&transform), &all_there()).unwrap(),
        metadata(&record3d(&poses), &all_there()).unwrap(),
    ];
    // The inverse of the transform, with y and z of the camera turned.
    let mut expected = transform.try_inverse().unwrap();
    for row in [1, 2] {
        expected.row_mut(row).neg_mut();
    }
    for import in imports {
        let found = from_rows(&import.scene.frames[0].cam_from_world.unwrap());
        assert!((found - expected).amax() < 1e-15, "{found}");
    }
}

#[test]
fn sizes_times_and_names_are_found() {
    let frame = scanner_frame(&looks_along_minus_x());
    let import = scanner(&frame, &all_there()).unwrap();
    let (scene, size) =
        (&import.scene, |import: &Import| import.scene.cameras[0].width.zip(import.scene.cameras[0].height));
    assert_eq!((scene.frames[0].id.as_str(), scene.frames[0].time), ("frame_00000.jpg", Some(1234.5)));
    assert_eq!(scene.cameras[0].params, [1348.5, 1349.0, 961.0, 718.5]);
    assert_eq!(size(&import), Some((1920.0, 1440.0)));
    let without = scanner(&frame, &none_there()).unwrap();
    assert_eq!(size(&without), None);
    assert!(without.notes.iter().any(|note| note == "no images were found: the names in the scene end in .jpg"));
    assert!(without.notes.iter().any(|note| note.starts_with("the image sizes are unknown")));
    // Images that were turned.
    let turned = CaptureImages { size_of: &|_| Some([1440.0, 1920.0]), ..all_there() };
    let note =
        "1 image with a principal point far from the middle, such as \"frame_00000.jpg\": were they turned or resized?";
    assert!(scanner(&frame, &turned).unwrap().notes.iter().any(|found| found == note));
    // Intrinsics of each frame, and times.
    let pose = json!([0, 0, 0, 1, 0, 0, 0]);
    let mut document = record3d(&json!([pose, pose, pose]));
    document["perFrameIntrinsicCoeffs"] = json!([[600, 601, 360, 480], [610, 611, 360, 480]]);
    let only_two = CaptureImages { named: &|stem| (stem != "1").then(|| format!("{stem}.png")), ..all_there() };
    let import = metadata(&document, &only_two).unwrap();
    let frames: Vec<(&str, f64, &str)> = import
        .scene
        .frames
        .iter()
        .map(|frame| (frame.id.as_str(), frame.time.unwrap(), frame.camera.as_deref().unwrap()))
        .collect();
    assert_eq!(frames, [("0.png", 0.0, "0"), ("2.png", 2.0 / 30.0, "1")]);
    assert_eq!(import.scene.cameras[0].params, [600.0, 601.0, 360.0, 480.0]);
    assert_eq!(import.scene.cameras[1].params, [601.0, 602.0, 358.5, 481.0]);
    assert!(import.notes.iter().any(|note| note == "1 frame without an image left out"));
    document["frameTimestamps"] = json!([5.0, 5.25, 5.5]);
    assert_eq!(metadata(&document, &all_there()).unwrap().scene.frames[1].time, Some(5.25));
}

#[test]
fn captures_are_found_in_their_folders() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    let camera = polycam_frame(&looks_along_minus_x()).to_string();
    write("polycam/keyframes/cameras/1000000.json", &camera);
    write("polycam/keyframes/cameras/2000000.json", &camera);
    write("polycam/keyframes/corrected_cameras/1000000.json", &camera);
    write("polycam/keyframes/corrected_images/1000000.jpg", "x");
    write("scan/frame_00000.json", &scanner_frame(&looks_along_minus_x()).to_string());
    write("scan/frame_00003.json", &scanner_frame(&looks_along_minus_x()).to_string());
    write("scan/info.json", "{}");
    write("scan/frame_00003.jpg", "x");
    let poses = json!([[0, 0, 0, 1, 0, 0, 0]]);
    write("r3d/metadata", &record3d(&poses).to_string());
    write("r3d/rgbd/0.jpg", "x");
    write("exr/EXR_RGBD/metadata.json", &record3d(&poses).to_string());
    write("exr/EXR_RGBD/rgb/0.png", "x");
    let ids = |name: &str| {
        let import = read_arkit(&folder.path().join(name), &ReadOptions::default()).unwrap();
        let ids: Vec<String> = import.scene.frames.into_iter().map(|frame| frame.id).collect();
        (ids.join(" "), import.image_folder.map(|folder| folder.file_name().unwrap().to_string_lossy().into_owned()))
    };
    let found = |id: &str, folder: &str| (id.to_owned(), Some(folder.to_owned()));
    for path in ["polycam", "polycam/keyframes", "polycam/keyframes/corrected_cameras"] {
        assert_eq!(ids(path), found("1000000.jpg", "corrected_images"), "{path}");
    }
    assert_eq!(ids("polycam/keyframes/cameras"), ("1000000.jpg 2000000.jpg".to_owned(), None));
    write("polycam/keyframes/depth/1000000.png", "x");
    let with_depth = read_arkit(&folder.path().join("polycam"), &ReadOptions::default()).unwrap();
    let depth = with_depth.scene.frames[0].depth.as_ref().unwrap();
    assert_eq!((depth.path.as_str(), depth.scale), ("../depth/1000000.png", 0.001));
    assert!(with_depth.notes.contains(&"1 frame with a depth image".to_owned()), "{:?}", with_depth.notes);
    assert_eq!(ids("scan"), found("frame_00003.jpg", "scan"));
    assert_eq!(ids("r3d"), found("0.jpg", "rgbd"));
    assert_eq!(ids("r3d/metadata"), found("0.jpg", "rgbd"));
    assert_eq!(ids("exr"), found("0.png", "rgb"));
    write("a.r3d", "PK");
    let message = |name: &str| read_arkit(&folder.path().join(name), &ReadOptions::default()).unwrap_err().problem;
    assert_eq!(message("a.r3d"), "this is a zip archive; unpack it and give its folder");
    assert!(message("polycam/keyframes/corrected_images").starts_with("expected the folder of a capture"));
}

#[test]
fn what_is_wrong_is_named_with_its_entry() {
    let good = looks_along_minus_x();
    let polycam = |change: &dyn Fn(&mut Value)| {
        let mut camera = polycam_frame(&good);
        change(&mut camera);
        polycam(&camera).unwrap_err().to_string()
    };
    insta::assert_snapshot!(polycam(&|c| { c["t_12"].take(); }), @r#"638443502.json: there is no "t_12""#);
    insta::assert_snapshot!(polycam(&|c| c["t_11"] = json!(2)), @"638443502.json: the 3x3 part of the transform is not a rotation (|R R^T - I| is 3.000e0, at most 1e-3 is accepted)");
    insta::assert_snapshot!(polycam(&|c| c["width"] = json!(0)), @"638443502.json: width: found 0, expected a positive number of pixels");
    insta::assert_snapshot!(polycam(&|c| c["fx"] = json!(-1)), @"638443502.json: focal lengths are (-1, 701); expected two positive numbers (the intrinsics are singular)");
    let scanner = |change: &dyn Fn(&mut Value)| {
        let mut frame = scanner_frame(&good);
        change(&mut frame);
        scanner(&frame, &all_there()).unwrap_err().to_string()
    };
    insta::assert_snapshot!(scanner(&|f| f["cameraPoseARFrame"] = json!([1, 2])), @"frame_00000.json: cameraPoseARFrame: found a list of 2, expected a list of 16 numbers");
    insta::assert_snapshot!(scanner(&|f| f["cameraPoseARFrame"] = json!(good.as_slice())), @"frame_00000.json: cameraPoseARFrame: the last row of the transform is [0.5, 1.5, 2.0, 1.0], expected [0, 0, 0, 1]: the matrix by rows");
    insta::assert_snapshot!(scanner(&|f| f["intrinsics"] = json!([1348, 3, 0, 0, 1349, 0, 961, 718, 1])), @"frame_00000.json: intrinsics[1] is 3, expected 0: the intrinsics by rows, without skew");
    let record = |change: &dyn Fn(&mut Value)| {
        let mut document = record3d(&json!([[0, 0, 0, 1, 0, 0, 0]]));
        change(&mut document);
        metadata(&document, &all_there()).unwrap_err().to_string()
    };
    insta::assert_snapshot!(record(&|d| d["poses"][0] = json!([0, 0, 0, 0, 0, 0, 0])), @"metadata: poses[0]: the quaternion x, y, z, w is not a rotation");
    insta::assert_snapshot!(record(&|d| d["K"] = json!([[1, 0, 0], [0, 1, 0], [0, 0, 1]])), @"metadata: K: found a list of 3, expected a list of 9 numbers");
    insta::assert_snapshot!(record(&|d| d["poses"][0] = json!([0, 0, 1])), @"metadata: poses[0]: found a list of 3, expected a list of 7 numbers");
    insta::assert_snapshot!(record(&|d| d["w"] = json!(-1)), @"metadata: w: found -1, expected a positive number of pixels");
}

#[test]
fn an_up_that_the_cameras_contradict_is_left_out() {
    // Cameras around the z axis that look at the origin, with z upwards in their images, and with y, ARKit's.
    for (up, expected) in [(Vector3::z(), None), (Vector3::y(), Some([0.0, 1.0, 0.0]))] {
        let texts: Vec<String> = (0..12)
            .map(|k| {
                let turn = Rotation3::from_axis_angle(&nalgebra::Unit::new_normalize(up), 0.5 * f64::from(k));
                let side = if up == Vector3::z() { Vector3::x() } else { Vector3::z() };
                let back = turn * (side + 0.1 * up).normalize();
                let right = up.cross(&back).normalize();
                let rotation = Matrix3::from_columns(&[right, back.cross(&right), back]);
                scanner_frame(&matrix4(&rotation, &(back * 2.0))).to_string()
            })
            .collect();
        let stems: Vec<String> = (0..12).map(|k| format!("frame_{k:05}")).collect();
        let files: Vec<FrameFile> = texts
            .iter()
            .zip(&stems)
            .map(|(text, stem)| FrameFile { stem, path: Path::new("frame.json"), bytes: text.as_bytes() })
            .collect();
        let import = parse_scanner(Path::new("scan"), &files, &all_there(), &ReadOptions::default()).unwrap();
        assert_eq!(import.scene.up, expected);
        assert_eq!(import.notes.iter().any(|note| note.contains("not upright")), expected.is_none());
    }
}
