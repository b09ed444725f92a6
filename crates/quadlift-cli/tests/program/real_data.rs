//! Real scenes, where they are at hand (they cannot be shipped): the program runs on them and finds plausible objects.

use crate::common::{Folder, real_scenes};
use quadlift::nalgebra::{Matrix3x4, Vector3};
use serde_json::Value;

/// Localizes a real scene and gives the evaluation.
fn score(scene: &str, options: &str) -> Option<Value> {
    let path = real_scenes()?.join(scene);
    let folder = Folder::new();
    let path = path.to_str().unwrap();
    let mut arguments = vec!["localize", path, "-o", "estimate.json"];
    arguments.extend(options.split_whitespace());
    let run = folder.run_list(&arguments);
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    let run = folder.run_list(&["evaluate", "estimate.json", path, "--json"]);
    assert_eq!(run.code, 0, "{}{}", run.stdout, run.stderr);
    println!("{scene} {options}: {}", serde_json::from_str::<Value>(&run.stdout).unwrap()["mean"]);
    Some(serde_json::from_str(&run.stdout).unwrap())
}

fn mean(scores: &Value, name: &str) -> f64 {
    scores["mean"][name]["value"].as_f64().unwrap_or_else(|| panic!("no {name} in {scores:#}"))
}

/// LINEMOD objects in the paper's ACCV sequences, boxes of a detector, defaults.
#[test]
fn objects_on_a_turntable() {
    let objects = ["ape", "can", "cat", "driller", "duck", "glue", "iron", "vise"];
    let scores: Vec<Value> =
        objects.iter().filter_map(|name| score(&format!("accv_{name}.json"), "--source yolo --enclosing")).collect();
    if scores.is_empty() {
        return;
    }
    assert!(scores.iter().all(|s| s["failures"] == 0));
    let mean_over_objects = |name| scores.iter().map(|s| mean(s, name)).sum::<f64>() / scores.len() as f64;
    let (tangent, enclosing) = (mean_over_objects("iou3d"), mean_over_objects("iou3d_enclosing"));
    let theta_err = mean_over_objects("theta_err");
    println!("ACCV, yolo boxes: tangent {tangent:.4}, enclosing {enclosing:.4}, theta_err {theta_err:.4}");
    assert!(tangent >= 0.76, "{tangent}");
    assert!(enclosing >= 0.86, "{enclosing}");
    assert!(theta_err <= 0.25, "{theta_err}");
}

#[test]
fn cars_from_a_car() {
    if let Some(scores) = score("kitti_S09_oxts.json", "--source rrc --body cuboid --priors builtin") {
        assert_eq!(scores["failures"], 0);
        assert!(mean(&scores, "cuboid_iou3d") > 0.4, "{scores:#}");
        assert!(mean(&scores, "center_error") < 1.0, "{scores:#}");
    }
    score("kitti_S09_oxts.json", "--source rrc --body cuboid");
}

#[test]
fn things_on_a_table() {
    if let Some(scores) = score("tuw_demo.json", "--source authors --body ellipsoid") {
        assert_eq!(scores["failures"], 0);
        assert!(mean(&scores, "iou3d") >= 0.65, "{scores:#}");
    }
    if let Some(scores) = score("lmo_A.json", "--source model") {
        assert_eq!(scores["failures"], 0);
        assert!(mean(&scores, "iou3d") > 0.5, "{scores:#}");
    }
}

/// Frames of a scene that are located in a map of ten of them: medians of degrees and of % of the depth, the number of located and of all.
fn located(scene: &std::path::Path, source: Option<&str>) -> (f64, f64, usize, usize) {
    let folder = Folder::new();
    let mut map: Value = serde_json::from_slice(&std::fs::read(scene).unwrap()).unwrap();
    map.as_object_mut().unwrap().remove("objects");
    for detection in map["detections"].as_array_mut().unwrap() {
        detection.as_object_mut().unwrap().remove("mask");
        detection["category"] = detection["object"].clone();
    }
    let of_source = |detection: &Value| source.is_none() || detection["source"].as_str() == source;
    map["detections"].as_array_mut().unwrap().retain(of_source);
    let count = map["frames"].as_array().unwrap().len();
    let of_map: Vec<String> =
        (0..10).map(|k| map["frames"][k * count / 10]["id"].as_str().unwrap().to_owned()).collect();
    let is_of_map = |id: &Value| of_map.iter().any(|other| id == other.as_str());
    let mut query = map.clone();
    map["frames"].as_array_mut().unwrap().retain(|frame| is_of_map(&frame["id"]));
    map["detections"].as_array_mut().unwrap().retain(|detection| is_of_map(&detection["frame"]));
    query["frames"].as_array_mut().unwrap().retain(|frame| !is_of_map(&frame["id"]));
    query["detections"].as_array_mut().unwrap().retain(|detection| !is_of_map(&detection["frame"]));
    let pose = |frame: &Value| -> Option<Matrix3x4<f64>> {
        let rows: [[f64; 4]; 3] = serde_json::from_value(frame["cam_from_world"].clone()).ok()?;
        Some(Matrix3x4::from_fn(|i, j| rows[i][j]))
    };
    let truth: Vec<Matrix3x4<f64>> = query["frames"].as_array().unwrap().iter().filter_map(pose).collect();
    for frame in query["frames"].as_array_mut().unwrap() {
        frame.as_object_mut().unwrap().remove("cam_from_world");
    }
    folder.write_json("map_scene.json", &map);
    folder.write_json("query.json", &query);
    folder.run_list(&["localize", "map_scene.json", "-o", "map.json"]);
    folder.run_list(&["relocalize", "map.json", "query.json", "-o", "located.json", "--allow-inconsistent"]);
    let objects = folder.json("map.json")["objects"].as_array().unwrap().clone();
    let centers: Vec<Vector3<f64>> = objects
        .iter()
        .filter_map(|o| serde_json::from_value(o["center"].clone()).ok())
        .map(|c: [f64; 3]| c.into())
        .collect();
    let middle = centers.iter().sum::<Vector3<f64>>() / centers.len() as f64;
    let (mut degrees, mut shares) = (Vec::new(), Vec::new());
    for (frame, truth) in folder.json("located.json")["frames"].as_array().unwrap().iter().zip(&truth) {
        let Some(found) = pose(frame) else { continue };
        let parts = |pose: &Matrix3x4<f64>| {
            let rotation = pose.fixed_columns::<3>(0).into_owned();
            (rotation, -rotation.tr_mul(&pose.column(3).into_owned()))
        };
        let ((r, c), (r0, c0)) = (parts(&found), parts(truth));
        degrees.push((((r.tr_mul(&r0)).trace() - 1.0) / 2.0).clamp(-1.0, 1.0).acos().to_degrees());
        shares.push(100.0 * (c - c0).norm() / (truth * middle.push(1.0)).z);
    }
    let median = |all: &mut Vec<f64>| {
        all.sort_by(f64::total_cmp);
        all[all.len() / 2]
    };
    let located = degrees.len();
    (median(&mut degrees), median(&mut shares), located, truth.len())
}

/// Real objects are no ellipsoids and no cuboids: their supports are corrected by the residuals of the map.
#[test]
fn cameras_from_maps_of_ten_frames() {
    let Some(scenes) = real_scenes() else { return };
    let (lmo, diorama) = (scenes.join("lmo_A.json"), scenes.join("../diorama/scene.json"));
    for (scene, source, degrees, share, least) in [
        (&lmo, Some("model"), 0.5, 1.0, 0.9),
        (&lmo, Some("visible-mask"), 1.25, 2.0, 0.9),
        (&diorama, None, 0.6, 1.0, 75.0 / 90.0),
    ] {
        if !scene.exists() {
            continue;
        }
        let found = located(scene, source);
        println!("{} {source:?}: {found:?}", scene.display());
        assert!(found.0 <= degrees && found.1 <= share, "{found:?}");
        assert!(found.2 as f64 >= least * found.3 as f64, "{found:?}");
    }
}
