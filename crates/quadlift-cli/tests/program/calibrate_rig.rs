//! `quadlift calibrate-rig`, through the built program.

use crate::common::Folder;
use serde_json::{Value, json};

/// A hall of which the cameras are known (`hall.json`), and without poses (`rig.json`).
fn rig(folder: &Folder, options: &str) -> Value {
    folder.succeed(&format!("synth -q -o hall.json --pedestrians 2 --noise box:0.02 --seed 3 {options}"));
    let mut rig = folder.json("hall.json");
    for frame in rig["frames"].as_array_mut().unwrap() {
        frame.as_object_mut().unwrap().remove("cam_from_world");
    }
    folder.write_json("rig.json", &rig);
    rig
}

fn center(pose: &Value) -> [f64; 3] {
    let number = |i: usize, j: usize| pose[i][j].as_f64().unwrap();
    [0, 1, 2].map(|j| -(0..3).map(|i| number(i, j) * number(i, 3)).sum::<f64>())
}

/// Distance of two cameras in a scene.
fn apart(scene: &Value, a: &str, b: &str) -> f64 {
    let pose = |id: &str| {
        let frames = scene["frames"].as_array().unwrap();
        frames.iter().find(|frame| frame["camera"] == id).unwrap()["cam_from_world"].clone()
    };
    let (a, b) = (center(&pose(a)), center(&pose(b)));
    (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt()
}

#[test]
fn cameras_get_their_poses_and_the_scale_of_a_known_distance() {
    let folder = Folder::new();
    rig(&folder, "--misses 0.2 --false-positives 0.05");
    let truth = folder.json("hall.json");
    let length = apart(&truth, "cam0", "cam1");
    let text = folder.succeed(&format!("calibrate-rig rig.json -o out.json --baseline cam0,cam1,{length}"));
    assert!(text.contains("rig.json: calibrated 4 of 4 cameras"), "{text}");
    assert!(text.contains("quadlift view out.json"), "{text}");
    let out = folder.json("out.json");
    for (a, b) in [("cam0", "cam1"), ("cam0", "cam2"), ("cam1", "cam3")] {
        assert!((apart(&out, a, b) - apart(&truth, a, b)).abs() < 0.1, "{a} {b}");
    }
    assert_eq!((&out["up"], &out["length_unit"]), (&json!([0.0, 0.0, 1.0]), &json!("m")));
    let record = &out["calibration"];
    assert_eq!((&record["reference"], &record["scale"]), (&json!("cam0"), &json!("baselines")));
    let of_camera = &record["cameras"][2];
    assert_eq!((&of_camera["camera"], &of_camera["status"]), (&json!("cam2"), &json!("ok")));
    assert!(of_camera["position_sd"].as_f64().unwrap() < 0.05 && of_camera["residual_px"].as_f64().unwrap() < 20.0);
    assert_eq!(of_camera["covariance"].as_array().unwrap().len(), 6);
    // Other commands read it, and the same input gives the same bytes.
    folder.succeed("info out.json");
    folder.succeed(&format!("calibrate-rig -q rig.json -o second.json --threads 1 --baseline cam0,cam1,{length}"));
    assert_eq!(folder.read("out.json"), folder.read("second.json"));
    // Poses that are there are kept; with --include-posed they are not used.
    let kept: Value = serde_json::from_str(&folder.succeed("calibrate-rig out.json -o kept.json --json")).unwrap();
    assert_eq!(kept["cameras"][1]["status"], "given");
    let again: Value =
        serde_json::from_str(&folder.succeed("calibrate-rig out.json -o again.json --include-posed --json")).unwrap();
    assert_eq!((&again["cameras"][1]["status"], &again["scale"]), (&json!("ok"), &json!("sizes")));
}

#[test]
fn cameras_that_cannot_be_calibrated_are_named_and_have_no_pose() {
    let folder = Folder::new();
    let mut rig = rig(&folder, "");
    rig["detections"].as_array_mut().unwrap().retain(|d| !d["frame"].as_str().unwrap().starts_with("cam3"));
    folder.write_json("rig.json", &rig);
    let text = folder.succeed("calibrate-rig rig.json -o out.json");
    assert!(text.contains("calibrated 3 of 4 cameras") && text.contains("not_connected"), "{text}");
    let with_pose = |name: &str| {
        let scene = folder.json(name);
        let frames = scene["frames"].as_array().unwrap();
        (frames.len(), frames.iter().filter(|frame| !frame["cam_from_world"].is_null()).count())
    };
    assert_eq!(with_pose("out.json"), (400, 300));
    folder.succeed("calibrate-rig -q rig.json -o posed.json --drop-unposed");
    assert_eq!(with_pose("posed.json"), (300, 300));
    folder.succeed("view -q posed.json --no-browser");
    // No scale: no unit.
    folder.succeed("calibrate-rig -q rig.json -o open.json --priors none");
    let open = folder.json("open.json");
    assert_eq!((&open["calibration"]["scale"], &open["length_unit"]), (&json!("arbitrary"), &Value::Null));
    // Nobody walks by.
    rig["detections"] = json!([]);
    folder.write_json("empty.json", &rig);
    assert_eq!(folder.run("calibrate-rig empty.json -o none.json").code, 1);
}

#[test]
fn cameras_that_contradict_each_other_are_named_and_the_exit_code_is_3() {
    let folder = Folder::new();
    let mut scene = rig(&folder, "--misses 0.1");
    for detection in scene["detections"].as_array_mut().unwrap() {
        if detection["frame"].as_str().unwrap().starts_with("cam1") {
            for edge in detection["box"].as_array_mut().unwrap() {
                *edge = json!(0.5 * edge.as_f64().unwrap());
            }
        }
    }
    folder.write_json("rig.json", &scene);
    let run = folder.run("calibrate-rig rig.json -o out.json --json");
    assert_eq!(run.code, 3, "{}", run.stderr);
    assert!(run.stderr.contains("the cameras are inconsistent: camera cam1: "), "{}", run.stderr);
    let record = &folder.json("out.json")["calibration"];
    assert_eq!((&record["consistent"], &record["cameras"][1]["status"]), (&json!(false), &json!("inconsistent")));
    assert!(record["cameras"][1]["contradiction"].is_string() && record["cameras"][0]["contradiction"].is_null());
    for camera in [0, 2, 3] {
        assert_eq!(record["cameras"][camera]["status"], "ok");
    }
}

#[test]
fn people_by_another_name_are_asked_for() {
    let folder = Folder::new();
    let mut scene = rig(&folder, "");
    for detection in scene["detections"].as_array_mut().unwrap() {
        detection["category"] = "player".into();
    }
    folder.write_json("rig.json", &scene);
    let run = folder.run("calibrate-rig rig.json -o out.json");
    let hint = "no prior for: player; they may lie any way; if their bodies are upright";
    assert!(run.code == 1 && run.stderr.contains(hint), "{} {}", run.code, run.stderr);
    let run = folder.run("calibrate-rig rig.json -o out.json --upright player");
    assert!(run.code == 0 && !run.stderr.contains(hint), "{} {}", run.code, run.stderr);
}

#[test]
fn mistakes_are_named() {
    let folder = Folder::new();
    let rig = rig(&folder, "--cameras 2 --time-steps 10");
    for (arguments, code, message) in [
        ("rig.json -o out.json --baseline cam0,cam7,3", 2, "there is no camera \"cam7\""),
        ("rig.json -o out.json --baseline cam0,cam0,3", 2, "twice"),
        ("rig.json -o out.json --baseline cam0,cam1", 2, "CAM_A,CAM_B,LENGTH"),
        ("rig.json -o rig.json", 2, "rig.json"),
        ("no.json -o out.json", 1, "no.json"),
    ] {
        let run = folder.run(&format!("calibrate-rig {arguments}"));
        assert_eq!(run.code, code, "{arguments}: {}", run.stderr);
        assert!(run.stderr.contains(message), "{arguments}: {}", run.stderr);
    }
    let mut wrong = rig.clone();
    for key in ["time", "rig_frame"] {
        wrong["frames"][3].as_object_mut().unwrap().remove(key);
    }
    folder.write_json("wrong.json", &wrong);
    let run = folder.run("calibrate-rig wrong.json -o out.json");
    assert!(run.code == 1 && run.stderr.contains("wrong.json") && run.stderr.contains("frames[3]"), "{}", run.stderr);
    assert!(!folder.path("out.json").exists());
}
