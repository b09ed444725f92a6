//! Real scenes, where they are at hand (they cannot be shipped): the program runs on them and finds plausible objects.

use crate::common::{Folder, real_scenes};
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
