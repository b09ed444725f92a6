//! Rigs of scene files.

use std::path::Path;

use quadlift::calibrate_rig::{CalibrateOptions, CameraStatus, calibrate_rig};
use quadlift::synthetic::{HallOptions, generate_hall};
use serde_json::{Value, json};

use super::{CALIBRATION, RigOptions};
use crate::scene_file::{SceneFile, parse_scene_file};

/// A hall as a scene file: by times, with ids.
fn hall(cameras: usize) -> Value {
    let hall = generate_hall(&HallOptions { cameras, edge_noise: 0.02, seed: 3, ..Default::default() }).unwrap();
    let k = &hall.intrinsics;
    let camera = |c: usize| {
        json!({"id": format!("cam{c}"), "model": "PINHOLE", "width": hall.image_size[0], "height": hall.image_size[1],
               "params": [k.fx, k.fy, k.cx, k.cy]})
    };
    let name = |c: usize, time_step: usize| format!("{c}/{time_step}");
    let frame = |(c, time_step): (usize, usize)| json!({"id": name(c, time_step), "camera": format!("cam{c}"), "time": 0.5 * time_step as f64});
    let time_steps = hall.boxes.iter().map(|b| b.time_step).max().unwrap() + 1;
    let detections = hall.boxes.iter().map(|b| {
        json!({"frame": name(b.camera, b.time_step), "object": "anna", "category": "person", "box": b.bounding_box.edges()})
    });
    json!({
        "format": "quadlift.scene", "version": 1,
        "cameras": (0..cameras).map(camera).collect::<Vec<_>>(),
        "frames": (0..cameras).flat_map(|c| (0..time_steps).map(move |i| (c, i))).map(frame).collect::<Vec<_>>(),
        "detections": detections.collect::<Vec<_>>(),
    })
}

fn parsed(scene: &Value) -> SceneFile {
    parse_scene_file(Path::new("rig.json"), &scene.to_string().into_bytes()).unwrap()
}

#[test]
fn poses_of_a_rig_are_written_into_its_frames() {
    let mut file = parsed(&hall(3));
    let scene = file.to_rig(false).unwrap();
    assert_eq!((scene.time_steps(), scene.camera("cam1"), scene.any_given()), (100, Some(1), false));
    let options = RigOptions { sizes: crate::builtin_priors(), ..Default::default() };
    let rig = scene.rig(None, None, &options).unwrap();
    assert!(rig.categories[0].upright && rig.categories[0].size.is_some());
    let found = calibrate_rig(&rig, &CalibrateOptions::default());
    assert!(found.cameras.iter().all(|camera| camera.status == CameraStatus::Ok), "{found:?}");
    scene.write(&mut file, &found, Some("m"), false);
    assert_eq!((file.length_unit.as_deref(), file.up), (Some("m"), Some([0.0, 0.0, 1.0])));
    let poses: Vec<_> = file.frames.iter().map(|frame| frame.cam_from_world.unwrap()).collect();
    assert!(poses[..100].iter().all(|pose| *pose == poses[0]) && poses[100] != poses[0]);
    let record = &file.extra[CALIBRATION];
    assert_eq!((&record["reference"], &record["scale"]), (&json!("cam0"), &json!("sizes")));
    assert_eq!((&record["cameras"][1]["camera"], &record["cameras"][1]["status"]), (&json!("cam1"), &json!("ok")));
    assert!(record["cameras"][1]["covariance"][5][5].as_f64().unwrap() > 0.0);
    // Read again, all poses are given, and kept.
    let again = file.to_rig(false).unwrap();
    let rig = again.rig(None, None, &options).unwrap();
    let kept = calibrate_rig(&rig, &CalibrateOptions::default());
    assert!(kept.cameras.iter().all(|camera| camera.status == CameraStatus::Given));
    let sought = file.to_rig(true).unwrap().rig(None, None, &options).unwrap();
    assert!(sought.cameras.iter().all(|camera| camera.cam_from_world.is_none()) && sought.up.is_none());
}

#[test]
fn mistakes_are_named() {
    let problem = |change: &dyn Fn(&mut Value)| {
        let mut scene = hall(2);
        change(&mut scene);
        parsed(&scene).to_rig(false).unwrap_err().to_string()
    };
    let no_time = problem(&|scene| drop(scene["frames"][3].as_object_mut().unwrap().remove("time")));
    assert!(no_time.contains("frames[3]") && no_time.contains("\"time\""), "{no_time}");
    let twice = problem(&|scene| scene["frames"][4]["time"] = json!(0.0));
    assert!(twice.contains("frames[4]") && twice.contains("frames[0]"), "{twice}");
    let no_camera = problem(&|scene| drop(scene["frames"][2].as_object_mut().unwrap().remove("camera")));
    assert!(no_camera.contains("frames[2]") && no_camera.contains("camera"), "{no_camera}");
    let moves = problem(&|scene| {
        scene["frames"][0]["cam_from_world"] = json!([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]);
        scene["frames"][1]["cam_from_world"] = json!([[1, 0, 0, 1], [0, 1, 0, 0], [0, 0, 1, 0]]);
    });
    assert!(moves.contains("frames[1]") && moves.contains("cam0"), "{moves}");
}
