use nalgebra::{Quaternion, UnitQuaternion, Vector4};
use serde_json::{Value, json};

use super::super::poses::from_rows;
use super::*;

/// The tables of a drive in two scenes with two cameras and a lidar; the camera in front looks along the vehicle's x.
fn tables() -> [Value; 6] {
    let scene = json!([
        {"token": "s1", "name": "scene-0061", "description": "x", "log_token": "l", "nbr_samples": 2,
         "first_sample_token": "a", "last_sample_token": "b"},
        {"token": "s2", "name": "scene-0103", "nbr_samples": 1},
    ]);
    let sample = json!([
        {"token": "a", "timestamp": 1532402927647951u64, "prev": "", "next": "b", "scene_token": "s1"},
        {"token": "b", "timestamp": 1532402928147847u64, "prev": "a", "next": "", "scene_token": "s1"},
        {"token": "c", "timestamp": 1532402929147847u64, "prev": "", "next": "", "scene_token": "s2"},
    ]);
    let sensor = json!([
        {"token": "front", "channel": "CAM_FRONT", "modality": "camera"},
        {"token": "back", "channel": "CAM_BACK", "modality": "camera"},
        {"token": "top", "channel": "LIDAR_TOP", "modality": "lidar"},
    ]);
    let k = json!([[1266.5, 0.0, 816.25], [0.0, 1266.5, 491.5], [0.0, 0.0, 1.0]]);
    let calibrated = json!([
        {"token": "cf", "sensor_token": "front", "translation": [1.5, 0.25, 1.75], "rotation": [0.5, -0.5, 0.5, -0.5],
         "camera_intrinsic": k},
        {"token": "cb", "sensor_token": "back", "translation": [0, 0, 1.5], "rotation": [0.5, -0.5, -0.5, 0.5],
         "camera_intrinsic": k},
        {"token": "ct", "sensor_token": "top", "translation": [1, 0, 2], "rotation": [1, 0, 0, 0], "camera_intrinsic": []},
    ]);
    let row = |sample: &str, pose: &str, sensor: &str, name: &str, time: u64, key: bool| {
        let (width, height) = if name.ends_with("jpg") { (json!(1600), json!(900)) } else { (json!(0), json!(0)) };
        json!({"token": name, "sample_token": sample, "ego_pose_token": pose, "calibrated_sensor_token": sensor,
               "timestamp": time, "fileformat": "jpg", "is_key_frame": key, "height": height, "width": width,
               "filename": name, "prev": "", "next": ""})
    };
    let data = json!([
        row("b", "p2", "cf", "samples/CAM_FRONT/2.jpg", 1532402928112460, true),
        row("a", "p1", "cf", "samples/CAM_FRONT/1.jpg", 1532402927612460, true),
        row("a", "p3", "cb", "samples/CAM_BACK/1.jpg", 1532402927637525, true),
        row("a", "p1", "ct", "samples/LIDAR_TOP/1.pcd.bin", 1532402927647951, true),
        row("b", "p3", "cf", "sweeps/CAM_FRONT/15.jpg", 1532402927862460, false),
        row("c", "p1", "cf", "samples/CAM_FRONT/9.jpg", 1532402929112460, true),
    ]);
    // The vehicle turns left by 90 degrees on its way.
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let pose = json!([
        {"token": "p1", "timestamp": 0, "rotation": [1, 0, 0, 0], "translation": [600, 1600, 0]},
        {"token": "p2", "timestamp": 0, "rotation": [half, 0, 0, half], "translation": [610, 1600, 0]},
        {"token": "p3", "timestamp": 0, "rotation": [0.9238795325112867, 0, 0, 0.3826834323650898], "translation": [605, 1600, 0]},
        {"token": "unused", "timestamp": 0, "rotation": [0, 0, 0, 0], "translation": [0, 0, 0]},
    ]);
    [scene, sample, sensor, calibrated, data, pose]
}

fn parse(tables: &[Value; 6], options: &ReadOptions) -> Result<Import, ReadError> {
    let texts = tables.each_ref().map(Value::to_string);
    let names = TABLES.map(|table| format!("{table}.json"));
    parse_nuscenes([0, 1, 2, 3, 4, 5].map(|k| (Path::new(names[k].as_str()), texts[k].as_bytes())), options)
}

fn of_scene(name: &str) -> ReadOptions {
    ReadOptions { sequence: Some(name.to_owned()), ..ReadOptions::default() }
}

/// Where a point of the world is in the camera of a frame.
fn in_camera(import: &Import, frame: usize, [x, y, z]: [f64; 3]) -> [f64; 3] {
    let point = from_rows(&import.scene.frames[frame].cam_from_world.unwrap()) * Vector4::new(x, y, z, 1.0);
    [point.x, point.y, point.z]
}

#[test]
fn cameras_of_a_scene_are_read() {
    let import = parse(&tables(), &of_scene("scene-0061")).unwrap();
    let frames: Vec<(&str, &str, f64)> = (import.scene.frames.iter())
        .map(|frame| (frame.id.as_str(), frame.camera.as_deref().unwrap(), frame.time.unwrap()))
        .collect();
    assert_eq!(
        frames,
        [
            ("samples/CAM_FRONT/1.jpg", "CAM_FRONT", 1532402927.61246),
            ("samples/CAM_BACK/1.jpg", "CAM_BACK", 1532402927.637525),
            ("samples/CAM_FRONT/2.jpg", "CAM_FRONT", 1532402928.11246),
        ]
    );
    let rig_frames = |import: &Import| -> Vec<Option<u64>> {
        import.scene.frames.iter().map(|frame| frame.extra.get("rig_frame").and_then(Value::as_u64)).collect()
    };
    assert_eq!(rig_frames(&import), [Some(0), Some(0), Some(1)]);
    let camera = &import.scene.cameras[1];
    assert_eq!((camera.id.as_str(), camera.width, camera.height), ("CAM_FRONT", Some(1600.0), Some(900.0)));
    assert_eq!(camera.params, [1266.5, 1266.5, 816.25, 491.5]);
    assert_eq!((import.scene.up, import.scene.length_unit.as_deref()), (Some([0.0, 0.0, 1.0]), Some("m")));
    assert!(import.notes.iter().any(|note| note == "1 image between the key frames left out"));
    let with_sweeps = parse(&tables(), &ReadOptions { sweeps: true, ..of_scene("scene-0061") }).unwrap();
    assert_eq!(with_sweeps.scene.frames[2].id, "sweeps/CAM_FRONT/15.jpg");
    assert_eq!(rig_frames(&with_sweeps), [None; 4]);
    let back = ReadOptions { channels: vec!["CAM_BACK".to_owned()], ..of_scene("scene-0061") };
    let back = parse(&tables(), &back).unwrap();
    assert_eq!((back.scene.frames.len(), back.scene.cameras.len()), (1, 1));
    assert_eq!(rig_frames(&back), [None]);
    assert_eq!(parse(&tables(), &of_scene("scene-0103")).unwrap().scene.frames.len(), 1);
}

#[test]
fn cameras_look_along_the_vehicle() {
    let import = parse(&tables(), &of_scene("scene-0061")).unwrap();
    // 10 ahead of the camera in front (the world's x), 2 to the left (y) and 1 above.
    assert_eq!(in_camera(&import, 0, [600.0 + 1.5 + 10.0, 1600.0 + 0.25 + 2.0, 1.75 + 1.0]), [-2.0, -1.0, 10.0]);
    // After the turn to the left ahead is y, and left is -x.
    let turned = in_camera(&import, 2, [610.0 - 0.25 - 2.0, 1600.0 + 1.5 + 10.0, 1.75 + 1.0]);
    assert!(turned.iter().zip([-2.0, -1.0, 10.0]).all(|(x, y)| (x - y).abs() < 1e-12), "{turned:?}");
    // The steps of nuscenes-devkit for a box (get_sample_data): minus the vehicle's translation, its rotation undone, minus the
    // sensor's translation, its rotation undone.
    let rotated = |q: [f64; 4], v: Vector3<f64>| {
        let [w, x, y, z] = q;
        UnitQuaternion::from_quaternion(Quaternion::new(w, x, y, z)).inverse() * v
    };
    let point = Vector3::new(590.0, 1612.0, 3.0);
    let in_ego = rotated([0.9238795325112867, 0.0, 0.0, 0.3826834323650898], point - Vector3::new(605.0, 1600.0, 0.0));
    let expected = rotated([0.5, -0.5, -0.5, 0.5], in_ego - Vector3::new(0.0, 0.0, 1.5));
    let found = Vector3::from(in_camera(&import, 1, [590.0, 1612.0, 3.0]));
    assert!((found - expected).norm() < 1e-12, "{found} {expected}");
}

#[test]
fn tables_are_found_in_a_version() {
    let folder = tempfile::tempdir().unwrap();
    let version = folder.path().join("v1.0-mini");
    std::fs::create_dir_all(&version).unwrap();
    for (name, table) in TABLES.iter().zip(tables()) {
        std::fs::write(version.join(format!("{name}.json")), table.to_string()).unwrap();
    }
    for path in [folder.path(), &version] {
        let import = read_nuscenes(path, &of_scene("scene-0061")).unwrap();
        assert_eq!(import.scene.frames.len(), 3);
        assert_eq!(import.image_folder.unwrap().canonicalize().unwrap(), folder.path().canonicalize().unwrap());
    }
    std::fs::remove_file(version.join("sensor.json")).unwrap();
    let error = read_nuscenes(folder.path(), &of_scene("scene-0061")).unwrap_err();
    assert!(error.problem.starts_with("expected the folder of nuScenes"), "{error}");
}

#[test]
fn what_is_wrong_is_named_with_its_row() {
    let message = |table: usize, change: &dyn Fn(&mut Value)| {
        let mut tables = tables();
        change(&mut tables[table]);
        parse(&tables, &of_scene("scene-0061")).unwrap_err().to_string()
    };
    insta::assert_snapshot!(parse(&tables(), &ReadOptions::default()).unwrap_err(), @"scene.json: choose a scene; the tables have 2 scenes: scene-0061, scene-0103");
    insta::assert_snapshot!(parse(&tables(), &of_scene("scene-1")).unwrap_err(), @r#"scene.json: there is no scene "scene-1"; the tables have 2 scenes: scene-0061, scene-0103"#);
    let channels = vec!["CAM_TOP".to_owned()];
    let camera = ReadOptions { channels, ..of_scene("scene-0061") };
    insta::assert_snapshot!(parse(&tables(), &camera).unwrap_err(), @r#"sensor.json: there is no camera "CAM_TOP"; there are CAM_BACK, CAM_FRONT"#);
    insta::assert_snapshot!(message(0, &|t| *t = json!({"a": 1})), @"scene.json: found an object {...}, expected a list of rows");
    insta::assert_snapshot!(message(1, &|t| { t[1].as_object_mut().unwrap().remove("scene_token"); }), @"sample.json: [1]: missing field `scene_token`");
    insta::assert_snapshot!(message(3, &|t| t[0]["rotation"] = json!([1, 0, 0])), @"calibrated_sensor.json: [0]: found 3 entries, expected a list of 4 numbers");
    insta::assert_snapshot!(message(3, &|t| t[0]["rotation"] = json!([0, 0, 0, 0])), @"calibrated_sensor.json: [0]: the rotation [0.0, 0.0, 0.0, 0.0] is not a quaternion w, x, y, z");
    insta::assert_snapshot!(message(3, &|t| t[1]["camera_intrinsic"] = json!([])), @"calibrated_sensor.json: [1]: camera_intrinsic is []; expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]");
    insta::assert_snapshot!(message(4, &|t| t[2]["timestamp"] = json!("now")), @r#"sample_data.json: [2]: found the text "now", expected a number"#);
    insta::assert_snapshot!(message(4, &|t| t[0]["ego_pose_token"] = json!("p9")), @r#"ego_pose.json: there is no pose "p9", which "samples/CAM_FRONT/2.jpg" has"#);
    insta::assert_snapshot!(message(4, &|t| t[0]["filename"] = t[1]["filename"].clone()), @r#"scene.json: the scene made of this file is not valid: frames[2]: the frame id "samples/CAM_FRONT/1.jpg" is used twice"#);
    let texts = tables().map(|table| table.to_string());
    let cut = &texts[5][..100];
    let files = [0, 1, 2, 3, 4, 5].map(|k| (Path::new(TABLES[k]), if k == 5 { cut } else { &texts[k] }.as_bytes()));
    insta::assert_snapshot!(parse_nuscenes(files, &of_scene("scene-0061")).unwrap_err(), @"ego_pose:1:100: this is not valid JSON: EOF while parsing a list");
}
